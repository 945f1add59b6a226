//! Something that is being painted on, as the window knows it: what the hand does becomes orders for the worker.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use fantex::base::Aabb;
use fantex::glam::{DVec2, DVec3, Vec4};
use fantex::paint::{
    BlendMode, GraphFill, Layer, LayerContent, MaskSource, Painter, Sample, Stamp, Surface, SurfacePoint,
    Target, WorkProgress,
};
use fantex::scene::world_bounds;
use fantex::store::{Asset, Channel, ChannelKind};
use fantex::texture::color::srgb_from_linear;

use crate::notices::Notices;
use crate::paint::cursor::world_position;
use crate::paint::{
    ChosenTexture, Cursor, Exchange, Order, PaintCommand, PaintSettings, PaintThread, PaintTool, Presets,
    Report, SaveState, Section, SizeUnit, Snapshot, StencilPicture, StencilSettings, SymmetryKind,
    TextureChoice, Thumbnail, Viewpoint,
};
use crate::viewer::Wake;

/// For so long it is told that the pen went down beside the model.
const MISSED_SECONDS: f64 = 4.0;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Hand {
    #[default]
    Idle,
    /// A stroke. The point is where it was last; none where it has left the surface.
    Stroke(Option<Sample>),
    /// Turning the view: it touched beside the model.
    Turn,
    /// It touched beside the model; a stroke begins as soon as the surface is met.
    Wait,
    /// Turning the view by `Alt`. As long as it has not moved from this place in the scene, letting go picks the point that it touched.
    AltTurn(Option<(SurfacePoint, DVec2)>),
}

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
    /// When the pen last went down beside the model, seconds; none once it has met it.
    pub(super) missed: Option<f64>,
    /// Where cloning copies from.
    pub(super) source: Option<SurfacePoint>,
    /// Where the last stroke ended.
    pub(super) last: Option<SurfacePoint>,
    pub(super) stamp: Option<(PathBuf, Arc<Stamp>)>,
    pub(super) texture: Option<(TextureChoice, Result<Option<ChosenTexture>, String>)>,
    pub(super) stencil: Option<(PathBuf, Result<Arc<StencilPicture>, String>)>,
    /// How far something is that takes long.
    pub work: Option<WorkProgress>,
    /// From where it was seen when the worker was last told.
    told_view: Option<Viewpoint>,
    pub(super) strokes: u64,
    /// A newer state of the asset; the older ones are to be let go.
    pub newer: Option<Arc<Asset>>,
    pub(super) section: Section,
    /// A layer's name while it is being edited.
    pub renaming: Option<(u64, String)>,
    /// A layer's opacity while it is being dragged.
    pub fading: Option<(u64, f32)>,
    /// What a layer's mask is made from while that is being dragged.
    pub shaping: Option<(u64, MaskSource)>,
    /// A layer that is being dragged to another place.
    pub moving: Option<LayerDrag>,
    /// The layer whose mask is seen instead of the base colour.
    pub seen_mask: Option<u64>,
    /// To be painted on as soon as there is such a thing.
    wanted_target: Option<Target>,
    /// What layers, masks and the base hold.
    pub thumbnails: BTreeMap<Target, Thumbnail>,
}

/// A layer on its way to another place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LayerDrag {
    pub id: u64,
    /// All layers as they are to lie, from the bottom to the top.
    pub order: Vec<u64>,
    /// Whether another order than the first one was asked for.
    pub has_moved: bool,
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
            missed: None,
            source: None,
            last: None,
            stamp: None,
            texture: None,
            stencil: None,
            work: None,
            told_view: None,
            strokes: 0,
            newer: None,
            section: Section::default(),
            renaming: None,
            fading: None,
            shaping: None,
            moving: None,
            seen_mask: None,
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

    /// The texture that is chosen, made once; none where a colour is, else why it cannot be made.
    ///
    /// # Errors
    /// It cannot be made: one sentence.
    pub fn texture(&mut self, choice: &TextureChoice) -> Result<Option<ChosenTexture>, String> {
        if let Some((known, made)) = &self.texture
            && known == choice
        {
            return made.clone();
        }
        let made = ChosenTexture::make(choice, &self.surface).map_err(|error| error.to_string());
        self.texture = Some((choice.clone(), made.clone()));
        made
    }

    /// The picture over the view, read once; none where there is none, else why it cannot be read.
    ///
    /// # Errors
    /// It cannot be read: one sentence.
    pub fn stencil(&mut self, settings: &StencilSettings) -> Result<Option<Arc<StencilPicture>>, String> {
        let Some(path) = settings.image.as_ref().filter(|_| settings.is_on) else { return Ok(None) };
        if let Some((known, read)) = &self.stencil
            && known == path
        {
            return read.clone().map(Some);
        }
        let read = StencilPicture::load(path).map(Arc::new).map_err(|error| error.to_string());
        self.stencil = Some((path.clone(), read.clone()));
        read.map(Some)
    }

    pub fn is_drawing(&self) -> bool {
        matches!(self.hand, Hand::Stroke(_))
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

    /// The line where symmetry's plane cuts the model, as far as it is seen; `offset` is from the model's middle, world units.
    pub fn section(&mut self, axis: usize, offset: f64, view: &Viewpoint) -> &[Vec<DVec3>] {
        let center = self.bounds.center()[axis.min(2)];
        self.section.follow(&self.surface, axis, center + offset);
        self.section.seen(&self.surface, view)
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
        self.presets.keep(&settings.brush);
        self.save_presets(notices);
    }

    pub fn drop_brush(&mut self, name: &str, notices: &mut Notices) {
        self.presets.brushes.retain(|brush| brush.name != name);
        self.save_presets(notices);
    }

    fn save_presets(&self, notices: &mut Notices) {
        if let Some(file) = &self.presets_file
            && let Err(error) = self.presets.save(file)
        {
            notices.error(error.to_string());
        }
    }

    pub fn poll(&mut self, settings: &mut PaintSettings, notices: &mut Notices) {
        for report in self.thread.reports() {
            match report {
                Report::State(snapshot) => {
                    self.snapshot = *snapshot;
                    if !std::mem::replace(&mut self.has_target, true) {
                        self.target = self.snapshot.layers.last().map_or(Target::Base, own_target);
                    }
                    if let Some(wanted) = self.wanted_target.take() {
                        self.target = wanted;
                    }
                    self.target = valid_target(&self.snapshot, self.target);
                    let has_mask =
                        |id: &u64| self.snapshot.layers.iter().any(|l| l.id() == *id && l.mask.is_some());
                    if self.seen_mask.is_some() && !self.seen_mask.as_ref().is_some_and(has_mask) {
                        self.see_mask(None);
                    }
                }
                Report::Thumbnail(target, thumbnail) => {
                    self.thumbnails.insert(target, thumbnail);
                }
                Report::Added(id) => self.target = Target::Layer(id),
                Report::Picked(values) => self.take_picked(&values, settings),
                Report::Work(work) => {
                    if work.is_none() {
                        self.told_view = None;
                    }
                    self.work = work;
                }
                Report::Save(state) => {
                    if let SaveState::Failed(reason) = &state
                        && state != self.save
                    {
                        notices.error(reason.clone());
                    }
                    if matches!((&self.save, &state), (SaveState::Failed(_), SaveState::Saved)) {
                        notices.info("Saved: all that was painted is on the disk.");
                    }
                    self.save = state;
                }
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
            // It needs the view: see `project`.
            PaintCommand::Project => {}
            PaintCommand::AddLayer => {
                // An empty layer can always be added.
                self.layer_action(&LayerAction::Add, settings).unwrap_or_default();
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
        self.leave_stroke(Order::GoTo(done));
    }

    /// What a fill layer shows: the texture that is chosen, or the current colour and material.
    fn fill_layer(&mut self, name: &str, settings: &PaintSettings) -> Result<Layer, String> {
        let value = |channel: &Channel| settings.material.value(channel.kind, settings.colors.linear());
        let values: Vec<Vec4> = self.channels.iter().map(value).collect();
        let mut layer = Layer::fill(name, &values);
        if let Some(chosen) = self.texture(&settings.texture)? {
            layer.content = LayerContent::Graph(self.graph_fill(chosen, &values));
        }
        layer.channels = self.channels.iter().map(|channel| settings.channels.paints(channel.kind)).collect();
        Ok(layer)
    }

    /// The texture in the base colour, and constants in the other channels.
    fn graph_fill(&self, chosen: ChosenTexture, values: &[Vec4]) -> GraphFill {
        let mut graph = chosen.graph;
        let mut textures = Vec::with_capacity(values.len());
        for (index, (channel, value)) in self.channels.iter().zip(values).enumerate() {
            if channel.kind == ChannelKind::BaseColor {
                textures.push(Some(chosen.name.clone()));
                continue;
            }
            let name = format!("fantex_channel_{index}");
            let [r, g, b, _] = value.to_array();
            let table = format!("\n[textures.{name}]\nkind = \"color\"\ncolor = [{r:?}, {g:?}, {b:?}]\n");
            graph.look.push_str(&table);
            textures.push(Some(name));
        }
        GraphFill { graph, textures }
    }

    /// Shows a layer's mask instead of the base colour, or no mask.
    pub fn see_mask(&mut self, layer: Option<u64>) {
        self.seen_mask = layer;
        self.thread.order(Order::SeeMask(layer));
    }

    /// Layers as they lie, or as they are to lie while one is dragged; from the bottom to the top.
    pub fn layers_in_order(&self) -> Vec<Layer> {
        let mut layers = self.snapshot.layers.clone();
        if let Some(moving) = &self.moving {
            layers.sort_by_key(|layer| moving.order.iter().position(|id| *id == layer.id()));
        }
        layers
    }

    /// What is done with layers; why not, where it cannot be done.
    ///
    /// # Errors
    /// It cannot be done: one sentence.
    pub fn layer_action(&mut self, action: &LayerAction, settings: &PaintSettings) -> Result<(), String> {
        let fill = match action {
            LayerAction::AddFill(_) => Some(self.fill_layer(&free_name(&self.snapshot, "Fill"), settings)?),
            LayerAction::Refill(_) => Some(self.fill_layer("", settings)?),
            _ => None,
        };
        let thread = &self.thread;
        let above = self.layer().map(Layer::id);
        match action.clone() {
            LayerAction::Select(target) => self.target = valid_target(&self.snapshot, target),
            LayerAction::Add => {
                let layer = Layer::painted(&free_name(&self.snapshot, "Layer"));
                thread.order(Order::AddLayer(Box::new(layer), above));
            }
            LayerAction::AddFill(is_everywhere) => {
                if let Some(mut layer) = fill {
                    layer.mask = layer.mask.filter(|_| !is_everywhere);
                    thread.order(Order::AddLayer(Box::new(layer), above));
                }
            }
            LayerAction::Refill(id) => {
                if let Some(fill) = fill {
                    change(thread, "change fill", id, move |layer| layer.content = fill.content);
                }
            }
            LayerAction::Delete(id) => thread.order(Order::EditLayers(
                "delete layer",
                Box::new(move |layers| layers.retain(|layer| layer.id() != id)),
            )),
            LayerAction::Rename(id, name) => change(thread, "rename layer", id, |layer| layer.name = name),
            LayerAction::Show(id, is_shown) => {
                let label = if is_shown { "show layer" } else { "hide layer" };
                change(thread, label, id, move |layer| layer.visible = is_shown);
            }
            LayerAction::Opacity(id, opacity) => {
                change(thread, "layer opacity", id, move |layer| layer.opacity = opacity.clamp(0.0, 1.0));
            }
            LayerAction::Blend(id, mode) => {
                change(thread, "layer blend mode", id, move |layer| layer.blend = mode);
            }
            LayerAction::Move(id, is_up) => thread
                .order(Order::EditLayers("move layer", Box::new(move |layers| shift(layers, id, is_up)))),
            LayerAction::MoveTo(order, goes_on) => thread.order(Order::MoveLayers { order, goes_on }),
            LayerAction::Duplicate(id) => thread.order(Order::DuplicateLayer(id)),
            LayerAction::MergeDown(id) => thread.order(Order::MergeLayer(id)),
            LayerAction::AddMask(id, shows) => {
                change(thread, "add mask", id, move |layer| layer.mask = Some(f32::from(u8::from(shows))));
                self.wanted_target = Some(Target::Mask(id));
            }
            LayerAction::MakeMask(id, source) => {
                change(thread, "make mask", id, move |layer| {
                    layer.mask.get_or_insert(0.0);
                    layer.mask_source = source;
                });
                self.wanted_target = Some(Target::Mask(id));
            }
            LayerAction::InvertMask(id) => {
                change(thread, "invert mask", id, |layer| layer.mask_inverted = !layer.mask_inverted);
            }
            LayerAction::SeeMask(id) => self.see_mask(id),
            LayerAction::RemoveMask(id) => change(thread, "remove mask", id, |layer| {
                (layer.mask, layer.mask_source, layer.mask_inverted) = (None, None, false);
            }),
            LayerAction::Channel(id, channel, is_shown) => {
                change(thread, "layer channels", id, move |layer| {
                    set_channel(layer, channel, is_shown);
                })
            }
        }
        Ok(())
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

// What the user does with layers.

#[derive(Clone, Debug, PartialEq)]
pub enum LayerAction {
    Select(Target),
    /// An empty layer above the chosen one.
    Add,
    /// A layer of the current colour or texture: shown everywhere (true), or where its mask is painted.
    AddFill(bool),
    /// A fill layer takes the current colour or texture.
    Refill(u64),
    Delete(u64),
    Rename(u64, String),
    Show(u64, bool),
    /// 0..1.
    Opacity(u64, f32),
    Blend(u64, BlendMode),
    /// One place towards the top (true) or the bottom.
    Move(u64, bool),
    /// All layers by their numbers, from the bottom to the top; whether a drag goes on.
    MoveTo(Vec<u64>, bool),
    /// A copy above it.
    Duplicate(u64),
    /// One layer of this one and the one below.
    MergeDown(u64),
    /// A mask that shows (true) or hides all until it is painted.
    AddMask(u64, bool),
    /// A mask that is made from the model's shape, or (none) only painted.
    MakeMask(u64, Option<MaskSource>),
    InvertMask(u64),
    /// The mask is seen instead of the base colour; none ends that.
    SeeMask(Option<u64>),
    RemoveMask(u64),
    /// Shown in a channel of the asset or not.
    Channel(u64, usize, bool),
}

pub(crate) fn change(
    thread: &PaintThread,
    label: &'static str,
    id: u64,
    change: impl FnOnce(&mut Layer) + Send + 'static,
) {
    let change = move |layers: &mut Vec<Layer>| {
        if let Some(layer) = layers.iter_mut().find(|layer| layer.id() == id) {
            change(layer);
        }
    };
    thread.order(Order::EditLayers(label, Box::new(change)));
}

pub(crate) fn shift(layers: &mut [Layer], id: u64, is_up: bool) {
    let Some(at) = layers.iter().position(|layer| layer.id() == id) else { return };
    let to = if is_up { (at + 1).min(layers.len() - 1) } else { at.saturating_sub(1) };
    layers.swap(at, to);
}

fn set_channel(layer: &mut Layer, channel: usize, is_shown: bool) {
    if layer.channels.len() <= channel {
        layer.channels.resize(channel + 1, true);
    }
    layer.channels[channel] = is_shown;
}

/// The first free name of the form `Layer 3`.
fn free_name(snapshot: &Snapshot, start: &str) -> String {
    let is_free = |name: &String| snapshot.layers.iter().all(|layer| layer.name != *name);
    (1..).map(|n| format!("{start} {n}")).find(is_free).unwrap_or_default()
}

/// What is painted on after a change: what was, if it is still there, else the layer on top.
fn valid_target(snapshot: &Snapshot, target: Target) -> Target {
    let find = |id: u64| snapshot.layers.iter().find(|layer| layer.id() == id);
    let top = || snapshot.layers.last().map_or(Target::Base, own_target);
    match target {
        Target::Base => Target::Base,
        Target::Layer(id) => find(id).map_or_else(top, own_target),
        Target::Mask(id) => match find(id) {
            Some(layer) if layer.mask.is_some() => Target::Mask(id),
            Some(layer) => own_target(layer),
            None => top(),
        },
    }
}

/// What painting on a layer means: fill layers have their mask only.
fn own_target(layer: &Layer) -> Target {
    match layer.content {
        LayerContent::Fill(_) | LayerContent::Graph(_) if layer.mask.is_some() => Target::Mask(layer.id()),
        _ => Target::Layer(layer.id()),
    }
}
