//! What the user does with layers.

use fantex::glam::Vec4;
use fantex::paint::{
    BlendMode, GraphFill, GroupKind, Layer, LayerContent, LayerPlace, MaskSource, Target, dissolve_group,
    move_layer, remove_layer,
};
use fantex::store::{Channel, ChannelKind};

use crate::paint::{ChosenTexture, Order, PaintSettings, PaintThread, Painting, Snapshot};

/// What is seen instead of the base colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alone {
    /// The mask of a layer, by its number.
    Mask(u64),
    /// The height: black is 0, white 1.
    Height,
}

/// A layer on its way to another place.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerDrag {
    pub id: u64,
    /// All layers as they lay before, from the bottom to the top.
    pub layers: Vec<Layer>,
    /// Where it is to lie; none as long as it was not moved.
    pub place: Option<LayerPlace>,
    /// Where the pointer was, points to the right, when the layer last changed its place.
    pub right: f32,
}

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
    /// One place towards the top (true) or the bottom, into and out of groups.
    Move(u64, bool),
    /// To a place; whether a drag goes on.
    MoveTo(u64, LayerPlace, bool),
    /// A copy above it.
    Duplicate(u64),
    /// One layer of this one and the one below.
    MergeDown(u64),
    /// A new group with this layer.
    Group(u64),
    /// What lies in the group takes its place.
    Ungroup(u64),
    /// One layer of a group.
    MergeGroup(u64),
    /// How a group meets what lies below it.
    GroupKind(u64, GroupKind),
    /// A group is folded in the list (true) or not.
    Collapse(u64, bool),
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

fn change(
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

fn set_channel(layer: &mut Layer, channel: usize, is_shown: bool) {
    if layer.channels.len() <= channel {
        layer.channels.resize(channel + 1, true);
    }
    layer.channels[channel] = is_shown;
}

/// Where a layer goes by one place towards the top or the bottom: past a layer or a folded group, into one that is unfolded, out of its own.
fn next_place(snapshot: &Snapshot, id: u64, is_up: bool) -> Option<LayerPlace> {
    let stack = &snapshot.layers;
    let parent = stack.iter().find(|layer| layer.id() == id)?.parent;
    let siblings: Vec<&Layer> = stack.iter().filter(|layer| layer.parent == parent).collect();
    let at = siblings.iter().position(|layer| layer.id() == id)?;
    let next = if is_up { siblings.get(at + 1) } else { at.checked_sub(1).and_then(|at| siblings.get(at)) };
    let to = |other| if is_up { LayerPlace::Above(other) } else { LayerPlace::Below(other) };
    match next {
        None => parent.map(to),
        Some(group) if group.group_kind().is_some() && !snapshot.collapsed.contains(&group.id()) => {
            let lowest = stack.iter().find(|layer| layer.parent == Some(group.id()) && is_up);
            Some(lowest.map_or(LayerPlace::Into(group.id()), |lowest| LayerPlace::Below(lowest.id())))
        }
        Some(other) => Some(to(other.id())),
    }
}

/// The first free name of the form `Layer 3`.
fn free_name(snapshot: &Snapshot, start: &str) -> String {
    let is_free = |name: &String| snapshot.layers.iter().all(|layer| layer.name != *name);
    (1..).map(|n| format!("{start} {n}")).find(is_free).unwrap_or_default()
}

/// What is painted on after a change: what was, if it is still there, else the layer on top.
pub(super) fn valid_target(snapshot: &Snapshot, target: Target) -> Target {
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
pub(super) fn own_target(layer: &Layer) -> Target {
    match layer.content {
        LayerContent::Fill(_) | LayerContent::Graph(_) if layer.mask.is_some() => Target::Mask(layer.id()),
        _ => Target::Layer(layer.id()),
    }
}

impl Painting {
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

    /// Shows something instead of the base colour, or that again.
    pub fn see_alone(&mut self, what: Option<Alone>) {
        self.seen_alone = what;
        self.thread.order(Order::SeeAlone(what));
    }

    /// The layer whose mask is seen.
    pub fn seen_mask(&self) -> Option<u64> {
        match self.seen_alone {
            Some(Alone::Mask(id)) => Some(id),
            Some(Alone::Height) | None => None,
        }
    }

    /// Layers as they lie, or as they are to lie while one is dragged; from the bottom to the top.
    pub fn layers_in_order(&self) -> Vec<Layer> {
        let Some(moving) = &self.moving else { return self.snapshot.layers.clone() };
        let mut layers = moving.layers.clone();
        if let Some(place) = moving.place {
            move_layer(&mut layers, moving.id, place);
        }
        layers
    }

    /// Above the chosen layer; in the chosen group if it is unfolded.
    fn place_of_new(&self) -> LayerPlace {
        match self.layer() {
            None => LayerPlace::Top,
            Some(layer) if layer.group_kind().is_some() && !self.snapshot.collapsed.contains(&layer.id()) => {
                LayerPlace::Into(layer.id())
            }
            Some(layer) => LayerPlace::Above(layer.id()),
        }
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
        if !matches!(action, LayerAction::Collapse(..) | LayerAction::SeeMask(_)) {
            self.apply_placing();
        }
        let thread = &self.thread;
        let place = self.place_of_new();
        match action.clone() {
            LayerAction::Select(target) => {
                (self.target, self.wanted_target) = (valid_target(&self.snapshot, target), None);
            }
            LayerAction::Add => {
                let layer = Layer::painted(&free_name(&self.snapshot, "Layer"));
                thread.order(Order::AddLayer(Box::new(layer), place));
            }
            LayerAction::AddFill(is_everywhere) => {
                if let Some(mut layer) = fill {
                    layer.mask = layer.mask.filter(|_| !is_everywhere);
                    thread.order(Order::AddLayer(Box::new(layer), place));
                }
            }
            LayerAction::Refill(id) => {
                if let Some(fill) = fill {
                    change(thread, "change fill", id, move |layer| layer.content = fill.content);
                }
            }
            LayerAction::Delete(id) => thread
                .order(Order::EditLayers("delete layer", Box::new(move |layers| remove_layer(layers, id)))),
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
            LayerAction::Move(id, is_up) => {
                if let Some(place) = next_place(&self.snapshot, id, is_up) {
                    thread.order(Order::MoveLayer { id, place, goes_on: false });
                }
            }
            LayerAction::MoveTo(id, place, goes_on) => thread.order(Order::MoveLayer { id, place, goes_on }),
            LayerAction::Group(id) => {
                thread.order(Order::GroupLayer(id, free_name(&self.snapshot, "Group")));
            }
            LayerAction::Ungroup(id) => thread.order(Order::EditLayers(
                "ungroup layers",
                Box::new(move |layers| dissolve_group(layers, id)),
            )),
            LayerAction::MergeGroup(id) => thread.order(Order::MergeGroup(id)),
            LayerAction::GroupKind(id, kind) => {
                change(thread, "group blending", id, move |layer| layer.content = LayerContent::Group(kind));
            }
            LayerAction::Collapse(id, is_collapsed) => {
                // Seen at once; the answer says the same.
                match is_collapsed {
                    true => self.snapshot.collapsed.insert(id),
                    false => self.snapshot.collapsed.remove(&id),
                };
                thread.order(Order::Collapse(id, is_collapsed));
            }
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
            LayerAction::SeeMask(id) => self.see_alone(id.map(Alone::Mask)),
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
}
