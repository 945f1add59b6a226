//! Channels that what is painted on is given, or loses, and what its alpha means. It is saved and opened again for that.

use fantex::store::ChannelKind;

use crate::display::ShadingView;
use crate::document::ChannelChange;
use crate::paint::{AlphaShown, SaveState, channel_name};
use crate::viewer::Viewer;

impl Viewer {
    /// Gives what is painted on further channels, and lets the brush paint them.
    pub fn add_channels(&mut self, kinds: &[ChannelKind]) {
        if !self.change_channels(ChannelChange::Add(kinds.to_vec())) {
            return;
        }
        // Normals that come with height follow it by themselves.
        let follows = |kind| kind == ChannelKind::Normal && kinds.contains(&ChannelKind::Displacement);
        for &kind in kinds.iter().filter(|kind| !follows(**kind)) {
            if let Some(is_painted) = self.settings.paint.channels.of(kind) {
                *is_painted = true;
            }
        }
    }

    /// Asks whether a channel of what is painted on is to be removed.
    pub fn ask_removal(&mut self, kind: ChannelKind) {
        let channels = self.painting.as_ref().map_or(&[][..], |painting| &painting.channels);
        if channels.iter().all(|channel| channel.kind == kind) {
            let name = channel_name(kind);
            return self.notices.warning(format!(
                "{name} cannot be removed: an asset needs a channel, and this one has no other."
            ));
        }
        self.removal = Some(kind);
    }

    /// What is lost with a channel of what is painted on.
    pub fn removal_sentence(&self, kind: ChannelKind) -> String {
        let name = channel_name(kind);
        let (layers, has_normals) = self.painting.as_ref().map_or((0, false), |painting| {
            let has_normals = painting.channels.iter().any(|channel| channel.kind == ChannelKind::Normal);
            (painting.snapshot.layers.len(), has_normals)
        });
        let layers = match layers {
            0 => String::new(),
            1 => " and on the layer".into(),
            count => format!(" and on all {count} layers"),
        };
        let relief = match kind {
            ChannelKind::Displacement if has_normals => {
                " Normals lose the relief of layers, and earlier steps cannot be undone any more."
            }
            ChannelKind::Light | ChannelKind::Anisotropy => " Only a bake makes such a channel again.",
            _ => "",
        };
        format!(
            "The channel {name} goes with all that it holds, on the base{layers}. This cannot be undone.{relief}"
        )
    }

    /// Takes channels out of what is painted on.
    pub fn remove_channels(&mut self, kinds: &[ChannelKind]) {
        self.removal = None;
        if self.change_channels(ChannelChange::Remove(kinds.to_vec())) {
            let shading = &mut self.settings.display.shading;
            if kinds.iter().any(|kind| ShadingView::of_channel(*kind) == Some(*shading)) {
                *shading = ShadingView::Lit;
            }
        }
    }

    /// Lets all materials of what is painted on make this of the opacity.
    pub fn show_alpha(&mut self, shown: AlphaShown) {
        self.change_channels(ChannelChange::Alpha(shown.mode()));
    }

    /// False where that cannot be.
    fn change_channels(&mut self, change: ChannelChange) -> bool {
        let (Some(painting), Some(document)) = (&mut self.painting, &self.document) else { return false };
        painting.apply_placing();
        if let SaveState::Failed(reason) = &painting.save {
            self.notices.error(format!("The asset's channels cannot be changed: {reason}"));
            return false;
        }
        let place = document.place.clone();
        self.begin_change(place, change);
        true
    }
}
