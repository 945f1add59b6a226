//! Something that is being painted on, as the window knows it: what the hand does becomes orders for the worker.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

use fantex::base::Aabb;
use fantex::glam::{DVec2, DVec3, Vec4};
use fantex::paint::{
    Layer, MaskSource, Painter, Sample, Stamp, Surface, SurfacePoint, Target, Tip, WorkProgress,
};
use fantex::scene::world_bounds;
use fantex::store::{Asset, Channel, ChannelKind};
use fantex::texture::color::srgb_from_linear;

use crate::notices::Notices;
use crate::paint::cursor::world_position;
use crate::paint::gradient::GradientDrag;
use crate::paint::layer_actions::{own_target, valid_target};
use crate::paint::placing::Placing;
use crate::paint::texture::StickerShape;
use crate::paint::{
    Alone, AlphaShown, ChosenTexture, Cursor, Exchange, FileState, LayerAction, LayerDrag, Leave, LoadedFile,
    Order, PaintCommand, PaintSettings, PaintThread, PaintTool, PictureUse, Presets, Report, SaveState,
    Section, SizeUnit, Snapshot, StencilPicture, StencilSettings, SymmetryKind, TextureChoice, Thumbnail,
    Viewpoint,
};
use crate::readout::Values;
use crate::viewer::{HandedOver, Wake};

/// For so long it is told that the pen went down beside the model.
const MISSED_SECONDS: f64 = 4.0;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Hand {
    #[default]
    Idle,
    /// A stroke. The point is where it was last; none where it has left the surface.
    Stroke(Option<Sample>),
    /// A gradient, laid where the pen is lifted.
    Gradient(GradientDrag),
    /// Turning the view: it touched beside the model.
    Turn,
    /// It touched beside the model; a stroke begins as soon as the surface is met.
    Wait,
    /// Turning the view by `Alt`. As long as it has not moved from this place in the scene, letting go picks the point that it touched.
    AltTurn(Option<(SurfacePoint, DVec2)>),
}

/// Whether it may be left, while something was not in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Leaving {
    #[default]
    Stays,
    /// The worker was asked to save for that.
    Asked,
    /// It has.
    Saved,
}

/// The file of a stamp's picture and its state, and a tip that is made.
pub(super) type StampChoice = (Option<(PathBuf, FileState)>, Option<Tip>);

/// What shapes dabs.
#[derive(Clone, Debug)]
pub(super) struct ChosenStamp {
    pub(super) stamp: Arc<Stamp>,
    /// The picture's.
    pub(super) file: Option<LoadedFile>,
}

/// What was made of a choice and the state of its file, or why it could not be.
type Made<C, T> = Option<((C, FileState), Result<T, String>)>;

#[derive(Debug)]
pub struct Painting {
    pub(super) thread: PaintThread,
    pub surface: Arc<Surface>,
    /// The model's, world space.
    pub bounds: Aabb<DVec3>,
    pub channels: Vec<Channel>,
    pub snapshot: Snapshot,
    pub target: Target,
    /// Whether the target was chosen already, by the user or for him.
    has_target: bool,
    pub save: SaveState,
    pub presets: Presets,
    presets_file: Option<PathBuf>,
    pub(super) hand: Hand,
    /// A text or a picture that is not applied yet.
    pub(super) placing: Option<Placing>,
    /// When the pen last went down beside the model, seconds; none once it has met it.
    pub(super) missed: Option<f64>,
    /// Where cloning copies from.
    pub(super) source: Option<SurfacePoint>,
    /// Where the last stroke ended.
    pub(super) last: Option<SurfacePoint>,
    /// What shapes the dabs, with the picture or the tip that it was made of.
    pub(super) stamp: Option<(StampChoice, ChosenStamp)>,
    texture: Made<TextureChoice, Option<ChosenTexture>>,
    stencil: Made<PathBuf, Arc<StencilPicture>>,
    /// A picture to lay onto the surface.
    pub(super) sticker: Made<(PathBuf, PictureUse), StickerShape>,
    /// How far something is that takes long.
    pub work: Option<WorkProgress>,
    /// From where it was seen when the worker was last told.
    told_view: Option<Viewpoint>,
    pub(super) strokes: u64,
    /// A newer state of the asset; the older ones are to be let go.
    pub newer: Option<Arc<Asset>>,
    pub(super) section: Section,
    /// What the channels hold where the pointer was, as far as that is known.
    pub probed: Option<Values>,
    /// The point that was asked for, and how many steps there were then; whether the answer is on its way.
    probing: Option<(SurfacePoint, [usize; 3])>,
    is_probing: bool,
    /// A layer's name while it is being edited.
    pub renaming: Option<(u64, String)>,
    /// A layer's opacity while it is being dragged.
    pub fading: Option<(u64, f32)>,
    /// What a layer's mask is made from while that is being dragged.
    pub shaping: Option<(u64, MaskSource)>,
    /// A layer that is being dragged to another place.
    pub moving: Option<LayerDrag>,
    /// What is seen instead of the base colour.
    pub seen_alone: Option<Alone>,
    /// What is known of whether it may be left.
    leaving: Leaving,
    /// The worker has ended before its time.
    is_gone: bool,
    /// Orders that were done when reports were last taken.
    told: u64,
    /// To be painted on as soon as there is such a thing.
    pub(super) wanted_target: Option<Target>,
    /// What layers, masks and the base hold.
    pub thumbnails: BTreeMap<Target, Thumbnail>,
}

impl Painting {
    /// Begins to paint.
    ///
    /// # Errors
    /// The operating system's, where there can be no further thread.
    pub fn new(painter: Painter, presets_file: Option<PathBuf>, wake: Wake) -> std::io::Result<Self> {
        let surface = painter.surface().clone();
        let channels = painter.editor().asset().channels().to_vec();
        Ok(Self {
            bounds: world_bounds(surface.mesh()),
            thread: PaintThread::start(painter, wake)?,
            surface,
            channels,
            snapshot: Snapshot::default(),
            target: Target::Base,
            has_target: false,
            save: SaveState::default(),
            presets: Presets::default(),
            presets_file,
            hand: Hand::default(),
            placing: None,
            missed: None,
            source: None,
            last: None,
            stamp: None,
            texture: None,
            stencil: None,
            sticker: None,
            work: None,
            told_view: None,
            strokes: 0,
            newer: None,
            section: Section::default(),
            probed: None,
            probing: None,
            is_probing: false,
            renaming: None,
            fading: None,
            shaping: None,
            moving: None,
            seen_alone: None,
            leaving: Leaving::default(),
            is_gone: false,
            told: 0,
            wanted_target: None,
            thumbnails: BTreeMap::new(),
        })
    }

    /// Reads the user's brushes; tells what is wrong with them.
    pub fn load_presets(&mut self, notices: &mut Notices) {
        match self.presets_file.as_deref().map(Presets::load) {
            None => {}
            Some(Ok(presets)) => self.presets = presets,
            Some(Err(error)) => notices.warning(error.to_string()),
        }
    }

    pub fn exchange(&self) -> &Arc<Exchange> {
        self.thread.exchange()
    }

    /// Asks what the channels hold at a point, unless that is known, or changes with every move of the pen.
    pub fn probe(&mut self, point: SurfacePoint) {
        let Snapshot { older, done, undone, .. } = &self.snapshot;
        let probing = Some((point, [*older, done.len(), undone.len()]));
        if self.is_drawing() || self.is_probing || self.probing == probing {
            return;
        }
        (self.probing, self.is_probing) = (probing, true);
        self.thread.order(Order::Probe(point));
    }

    /// The layer that is painted on or whose mask is.
    pub fn layer(&self) -> Option<&Layer> {
        match self.target {
            Target::Base => None,
            Target::Layer(id) | Target::Mask(id) => self.snapshot.layers.iter().find(|l| l.id() == id),
        }
    }

    /// Whether what was asked for is not all done yet.
    pub fn is_busy(&self) -> bool {
        self.thread.is_busy()
    }

    /// Whether all that was asked for is done, and known here with all that came of it: layers, steps, what is not in the file.
    pub fn is_told(&self) -> bool {
        self.told == self.thread.sent()
    }

    /// Whether all that was asked for is done and in the file. What has just been done may be told with the next reports only.
    pub fn is_saved(&self) -> bool {
        !self.is_busy() && self.save == SaveState::Saved && !self.thread.is_unsaved()
    }

    /// What is lost where it is dropped. Where that is not known yet, it is saved, which [`stay`](Self::stay) forgets.
    pub fn leave(&mut self) -> Leave {
        match &self.save {
            SaveState::Failed(reason) => Leave::Loses(reason.clone()),
            _ if self.is_saved() => Leave::Free,
            // What takes long goes on changing it, and is left to whoever opens it next.
            save if self.leaving == Leaving::Saved
                && (self.work.is_some() || *save == SaveState::Saved && !self.thread.is_unsaved()) =>
            {
                Leave::Free
            }
            _ => {
                if self.leaving != Leaving::Asked {
                    self.leaving = Leaving::Asked;
                    self.thread.order(Order::Leave);
                }
                Leave::Waits
            }
        }
    }

    /// It is not left after all.
    pub fn stay(&mut self) {
        self.leaving = Leaving::Stays;
    }

    /// Asks for the asset with all that was painted, to be copied.
    pub fn hand_over(&mut self) -> Receiver<HandedOver> {
        self.apply_placing();
        let (sender, handed) = channel();
        self.thread.order(Order::HandOver(sender));
        handed
    }

    /// What was handed over last is in another file.
    pub fn take_copied(&self) {
        self.thread.order(Order::Copied);
    }

    pub fn give_up_work(&self) {
        self.thread.order(Order::GiveUp);
    }

    /// Tells from where the scene is seen, while something takes long.
    pub fn look_from(&mut self, view: &Viewpoint) {
        if self.work.is_some() && self.told_view != Some(*view) {
            self.told_view = Some(*view);
            self.thread.order(Order::Look(*view));
        }
    }

    /// Files that are painted with are read again: one of them was chosen.
    pub fn forget_files(&mut self) {
        (self.stamp, self.texture, self.stencil, self.sticker) = (None, None, None, None);
    }

    /// The texture that is chosen, made once and whenever its look's file has changed; none where a colour is, else why it cannot be made.
    ///
    /// # Errors
    /// It cannot be made: one sentence.
    pub fn texture(&mut self, choice: &TextureChoice) -> Result<Option<ChosenTexture>, String> {
        let key = (choice.clone(), choice.file_state());
        if let Some((known, made)) = &self.texture
            && *known == key
        {
            return made.clone();
        }
        let made = ChosenTexture::make(choice, &self.surface).map_err(|error| error.to_string());
        self.texture = Some((key, made.clone()));
        made
    }

    /// The picture over the view, read once and whenever its file has changed; none where there is none, else why it cannot be read.
    ///
    /// # Errors
    /// It cannot be read: one sentence.
    pub fn stencil(&mut self, settings: &StencilSettings) -> Result<Option<Arc<StencilPicture>>, String> {
        let Some(path) = settings.image.as_ref().filter(|_| settings.is_on) else { return Ok(None) };
        let key = (path.clone(), FileState::of(path));
        if let Some((known, read)) = &self.stencil
            && *known == key
        {
            return read.clone().map(Some);
        }
        let read = StencilPicture::load(path).map(Arc::new).map_err(|error| error.to_string());
        self.stencil = Some((key, read.clone()));
        read.map(Some)
    }

    pub fn is_drawing(&self) -> bool {
        matches!(self.hand, Hand::Stroke(_))
    }

    /// Whether a stroke goes on, or begins as soon as the surface is met.
    pub fn has_stroke_begun(&self) -> bool {
        matches!(self.hand, Hand::Stroke(_) | Hand::Wait)
    }

    /// Whether the pen has begun something that ends when it is lifted.
    pub fn has_hand_down(&self) -> bool {
        self.hand != Hand::Idle
    }

    pub fn is_turning(&self) -> bool {
        matches!(self.hand, Hand::Turn | Hand::AltTurn(_))
    }

    /// Seconds for which it is still to be told that the pen went down beside the model; none where it did not, or long ago.
    pub fn missed_for(&self, now: f64) -> Option<f64> {
        let since = self.missed?;
        if self.is_turning() {
            return Some(MISSED_SECONDS);
        }
        Some(since + MISSED_SECONDS - now).filter(|left| *left > 0.0)
    }

    /// The line where symmetry's plane cuts the model, as far as it is seen, and whether it is up to date; `offset` is from the model's
    /// middle, world units.
    pub fn section(&mut self, axis: usize, offset: f64, view: &Viewpoint) -> (&[Vec<DVec3>], bool) {
        let center = self.bounds.center()[axis.min(2)];
        let is_current = self.section.update(&self.surface, axis, center + offset, view);
        (self.section.parts(), is_current)
    }

    /// Where cloning copies from, world space.
    pub fn source(&self) -> Option<DVec3> {
        self.source.map(|point| world_position(&self.surface, point))
    }

    /// Where the pen was last, world units; before that the middle of the model.
    pub fn last_position(&self) -> DVec3 {
        self.last.map_or(self.bounds.center(), |point| world_position(&self.surface, point))
    }

    /// Keeps the brush among the presets, on the disk too.
    pub fn keep_brush(&mut self, settings: &PaintSettings, notices: &mut Notices) {
        self.change_presets(|presets| presets.keep(&settings.brush), notices);
    }

    /// What the model's materials make of the opacity.
    pub fn alpha_shown(&self) -> AlphaShown {
        let first = self.surface.mesh().materials.first();
        first.map_or(AlphaShown::Opaque, |material| AlphaShown::of(material.alpha))
    }

    pub fn drop_brush(&mut self, name: &str, notices: &mut Notices) {
        self.change_presets(|presets| presets.brushes.retain(|brush| brush.name != name), notices);
    }

    /// Brings the program's own brushes back, on the disk too.
    pub fn restore_brushes(&mut self, notices: &mut Notices) {
        self.change_presets(Presets::restore, notices);
    }

    /// Changes the presets as they are on the disk: other windows keep theirs there, too.
    fn change_presets(&mut self, change: impl FnOnce(&mut Presets), notices: &mut Notices) {
        // In the place of a file that is damaged or gone those that are known here are written.
        match self.presets_file.as_deref().filter(|file| file.exists()).map(Presets::load) {
            None => {}
            Some(Ok(presets)) => self.presets = presets,
            Some(Err(error)) => notices.warning(error.to_string()),
        }
        change(&mut self.presets);
        if let Some(Err(error)) = self.presets_file.as_deref().map(|file| self.presets.save(file)) {
            notices.error(error.to_string());
        }
    }

    pub fn poll(&mut self, settings: &mut PaintSettings, notices: &mut Notices) {
        let is_gone = self.thread.is_gone();
        // What is done later than that may be told with the next reports only.
        self.told = self.thread.done();
        self.take_reports(settings, notices);
        if is_gone && !std::mem::replace(&mut self.is_gone, true) {
            let reason = "The program has failed while it painted: nothing more is painted or saved. Open the asset again; it \
                          holds what was saved before";
            notices.error(format!("{reason}."));
            (self.save, self.work) = (SaveState::Failed(reason.into()), None);
        }
    }

    fn take_reports(&mut self, settings: &mut PaintSettings, notices: &mut Notices) {
        for report in self.thread.reports() {
            match report {
                Report::State(snapshot) => {
                    self.snapshot = *snapshot;
                    if !std::mem::replace(&mut self.has_target, true) {
                        self.target = self.snapshot.layers.last().map_or(Target::Base, own_target);
                    }
                    // Other states may be told before that of the step that makes it.
                    let is_there = |target: &Target| valid_target(&self.snapshot, *target) == *target;
                    if let Some(wanted) = self.wanted_target.filter(is_there) {
                        (self.target, self.wanted_target) = (wanted, None);
                    }
                    self.target = valid_target(&self.snapshot, self.target);
                    let has_mask =
                        |id: u64| self.snapshot.layers.iter().any(|l| l.id() == id && l.mask.is_some());
                    if self.seen_mask().is_some_and(|id| !has_mask(id)) {
                        self.see_alone(None);
                    }
                }
                Report::Thumbnail(target, thumbnail) => {
                    self.thumbnails.insert(target, thumbnail);
                }
                Report::Added(id) => (self.target, self.wanted_target) = (Target::Layer(id), None),
                Report::Picked(values) => self.take_picked(&values, settings),
                Report::Probed(point, channels) => {
                    self.is_probing = false;
                    self.probed = Some(Values { point, channels, since: notices.now });
                }
                Report::Work(work) => {
                    if work.is_none() {
                        self.told_view = None;
                    }
                    self.work = work;
                }
                Report::Save(state) => {
                    if state != self.save {
                        if let SaveState::Failed(before) = &self.save {
                            notices.take_back(before);
                        }
                        if let SaveState::Failed(reason) = &state {
                            notices.error(reason.clone());
                        }
                    }
                    if matches!((&self.save, &state), (SaveState::Failed(_), SaveState::Saved)) {
                        notices.info("Saved: all that was painted is on the disk.");
                    }
                    if matches!(state, SaveState::Failed(_)) {
                        self.leaving = Leaving::Stays;
                    }
                    self.save = state;
                }
                Report::MayLeave if self.leaving == Leaving::Asked => self.leaving = Leaving::Saved,
                Report::MayLeave => {}
                Report::Newer(asset) => self.newer = Some(asset),
                Report::Failed(reason) => notices.error(reason),
            }
        }
    }

    fn take_picked(&self, values: &[Vec4], settings: &mut PaintSettings) {
        let bytes =
            |v: Vec4| [v.x, v.y, v.z].map(|c| (srgb_from_linear(c) * 255.0).round().clamp(0.0, 255.0) as u8);
        for (channel, &value) in self.channels.iter().zip(values) {
            if !settings.channels.paints(channel.kind) {
                continue;
            }
            let material = &mut settings.material;
            match channel.kind {
                ChannelKind::BaseColor => settings.colors.foreground = bytes(value),
                ChannelKind::OcclusionRoughnessMetallic => {
                    (material.occlusion, material.roughness, material.metallic) = (value.x, value.y, value.z);
                }
                ChannelKind::Emission => material.emission = bytes(value),
                ChannelKind::Displacement => material.height = value.x,
                ChannelKind::Normal | ChannelKind::Light | ChannelKind::Anisotropy => {}
            }
        }
    }

    pub fn command(&mut self, command: &PaintCommand, settings: &mut PaintSettings) {
        match command {
            PaintCommand::Undo if self.drop_placing() => return,
            PaintCommand::Undo
            | PaintCommand::Redo
            | PaintCommand::AddLayer
            | PaintCommand::GroupLayer
            | PaintCommand::UngroupLayer
            | PaintCommand::Project
            | PaintCommand::Apply
            | PaintCommand::Save => {
                self.apply_placing();
            }
            _ => {}
        }
        let stencil = &mut settings.stencil;
        let brush = &mut settings.brush;
        match *command {
            PaintCommand::Tool(tool) => settings.tool = tool,
            PaintCommand::Size(steps) => brush.change_size(steps as f32),
            PaintCommand::Hardness(tenths) => brush.change_hardness(tenths as f32),
            PaintCommand::Opacity(percent) => brush.opacity = percent as f32 / 100.0,
            PaintCommand::Flow(percent) => brush.flow = percent as f32 / 100.0,
            PaintCommand::SwapColors => settings.colors.swap(),
            PaintCommand::ResetColors => settings.colors.reset(),
            PaintCommand::Undo => self.leave_stroke(Order::Undo),
            PaintCommand::Redo => self.leave_stroke(Order::Redo),
            PaintCommand::ToggleSymmetry => {
                let kind = &mut settings.symmetry.kind;
                *kind = if *kind == SymmetryKind::Off { SymmetryKind::Mirror } else { SymmetryKind::Off };
            }
            PaintCommand::ToggleStencil => stencil.is_on = !stencil.is_on,
            PaintCommand::AdjustStencil => {
                stencil.is_adjusted = !(stencil.is_adjusted && stencil.is_on);
                stencil.is_on = true;
            }
            // `Project` needs the view: see `project`.
            PaintCommand::Project | PaintCommand::Apply => {}
            PaintCommand::AddLayer => {
                // An empty layer can always be added.
                self.layer_action(&LayerAction::Add, settings).unwrap_or_default();
            }
            PaintCommand::GroupLayer | PaintCommand::UngroupLayer => {
                let is_group = *command == PaintCommand::GroupLayer;
                let action = if is_group { LayerAction::Group } else { LayerAction::Ungroup };
                if let Some(id) = self.layer().map(Layer::id) {
                    // Neither needs a texture.
                    self.layer_action(&action(id), settings).unwrap_or_default();
                }
            }
            PaintCommand::Save => self.thread.order(Order::Commit),
            PaintCommand::TogglePanels => {
                let is_shown = settings.has_brush_panel || settings.has_layer_panel;
                (settings.has_brush_panel, settings.has_layer_panel) = (!is_shown, !is_shown);
            }
        }
    }

    /// An order that ends a stroke.
    pub(super) fn leave_stroke(&mut self, order: Order) {
        self.hand = Hand::Idle;
        self.thread.order(order);
    }

    /// Back or forth to where so many steps are done.
    pub fn go_to_step(&mut self, done: usize) {
        self.drop_placing();
        self.leave_stroke(Order::GoTo(done));
    }

    /// The outline of the brush under the cursor.
    pub fn cursor(&self, settings: &PaintSettings, view: &Viewpoint, at: DVec2) -> Option<Cursor> {
        let point = view.hit(&self.surface, at)?;
        let radius = if settings.tool.has_brush() || settings.tool == PaintTool::Sticker {
            0.5 * self.world_size(settings, view, point)
        } else {
            5.0 * view.world_per_pixel(world_position(&self.surface, point))
        };
        let hardness = if settings.tool.has_brush() { settings.brush.hardness } else { 1.0 };
        let symmetry = settings.symmetry.symmetry(self.bounds.center());
        Some(Cursor::new(&self.surface, view, point, radius, hardness, &symmetry))
    }

    /// Diameter of the brush at a point, world units.
    pub(super) fn world_size(&self, settings: &PaintSettings, view: &Viewpoint, point: SurfacePoint) -> f64 {
        let size = f64::from(settings.brush.size);
        match settings.brush.unit {
            SizeUnit::Pixels => size * view.world_per_pixel(world_position(&self.surface, point)),
            SizeUnit::World => size,
            SizeUnit::Texels => {
                size / f64::from(self.surface.cover().density) * self.surface.mesh().world_from_mesh.scale
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use fantex::Mesh;
    use fantex::bake::NoProgress;
    use fantex::mesh::generate::torus;
    use fantex::paint::PaintOptions;

    use super::*;
    use crate::paint::{NewAsset, bake_model};

    #[test]
    fn a_worker_that_has_failed_is_told_once_and_nothing_waits_for_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("torus.fan");
        let mesh = Mesh::from_model(torus(24, 12), "torus").unwrap();
        let new = NewAsset { texels: Some(5_000), ..NewAsset::default() };
        bake_model(&mesh, &new, &path, &NoProgress).unwrap();
        let painter = Painter::open(&path, &PaintOptions::default()).unwrap();
        let mut painting = Painting::new(painter, None, Arc::new(|| {})).unwrap();
        painting.thread.order(Order::EditLayers("fail", Box::new(|_| panic!("on purpose"))));
        let handed = painting.hand_over();
        assert!(handed.recv().is_err(), "it waits for ever");
        let (mut settings, mut notices) = (PaintSettings::default(), Notices::default());
        while !painting.thread.is_gone() {
            std::thread::yield_now();
        }
        painting.poll(&mut settings, &mut notices);
        painting.poll(&mut settings, &mut notices);
        let told = notices.log().filter(|text| text.contains("failed while it painted")).count();
        assert_eq!(told, 1);
        assert!(matches!(painting.leave(), Leave::Loses(_)));
    }
}
