//! Channels that an asset is given while it is painted on.
//!
//! `channels/added` lists them, so that strokes of the log find their channels on other assets, too. They are no step of the history:
//! what is painted on them is. `channels/adding` is there while pages under layers are given the new channels: whoever opens the asset
//! after a crash goes on with that.

use fantex_base::Result;
use fantex_store::{Asset, ChannelKind};

use crate::base_levels::with_added_channels;
use crate::error::encoded;
use crate::layers::prefix;
use crate::stroke_file::KindName;
use crate::{Painter, Target};

pub(crate) const LIST: &str = "channels/added";

const ADDING: &str = "channels/adding";

impl Painter {
    /// Gives the asset channels that it does not have, and commits. They show what was seen without them: the model's materials, its
    /// own normals, a middle height. Rewrites the file, which needs room for a copy.
    ///
    /// # Errors
    /// As [`AssetEditor::add_channels`](fantex_store::AssetEditor::add_channels). If the file cannot be written, the asset stays as it is.
    pub fn add_channels(&mut self, kinds: &[ChannelKind]) -> Result<()> {
        let channels = self.editor.asset().channels();
        let mut missing: Vec<ChannelKind> = Vec::new();
        for &kind in kinds {
            if channels.iter().all(|channel| channel.kind != kind) && !missing.contains(&kind) {
                missing.push(kind);
            }
        }
        if missing.is_empty() {
            return Ok(());
        }
        self.finish_work()?;
        self.end()?;
        let mut all = added_to(self.editor.attachment(LIST)?);
        all.extend(missing.iter().copied().map(KindName));
        self.editor.attach(ADDING, encoded(&all)?)?;
        self.commit()?;
        if let Err(error) = self.editor.add_channels(&missing) {
            self.editor.detach(ADDING);
            // Where there is no room for this either, the next commit does it.
            return self.commit().and(Err(error));
        }
        self.finish_adding()
    }

    /// Gives what is kept under layers the channels that the asset has by now.
    pub(crate) fn finish_adding(&mut self) -> Result<()> {
        let Some(list) = self.editor.attachment(ADDING)? else { return Ok(()) };
        let budget = self.options.budget();
        for name in self.editor.attachment_names_with(&prefix(Target::Base)) {
            if let Some(contents) = self.editor.attachment(&name)? {
                let length = contents.len();
                let contents = with_added_channels(&self.editor, &name, contents)?;
                if contents.len() > length {
                    self.editor.attach(&name, contents)?;
                    self.room.relieve(&mut self.editor, budget)?;
                }
            }
        }
        // A crash before the channels were there: they are not in the list.
        let channels = self.editor.asset().channels();
        let mut all = added_to(Some(list));
        all.retain(|kind| channels.iter().any(|channel| channel.kind == kind.0));
        self.editor.attach(LIST, encoded(&all)?)?;
        self.editor.detach(ADDING);
        self.commit().map(drop)
    }
}

/// The channels that an asset was given after it was baked.
pub(crate) fn added_channels(asset: &Asset) -> Result<Vec<KindName>> {
    Ok(added_to(asset.attachment(LIST)?))
}

/// The list without channels of these kinds.
pub(crate) fn without_kinds(list: Vec<u8>, kinds: &[ChannelKind]) -> Result<Vec<u8>> {
    let mut all = added_to(Some(list));
    all.retain(|kind| !kinds.contains(&kind.0));
    encoded(&all)
}

fn added_to(list: Option<Vec<u8>>) -> Vec<KindName> {
    // A list that cannot be read is as none: strokes say which channel they miss.
    list.and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
}
