//! What the user does with layers.

use fantex_paint::{BlendMode, Layer, LayerContent, Target};

use super::{Order, PaintThread, Snapshot};

/// Something done with layers.
#[derive(Clone, Debug, PartialEq)]
pub enum LayerAction {
    /// Paint on this.
    Select(Target),
    /// An empty layer above the chosen one.
    Add,
    /// A layer of the current colour or texture: shown everywhere (true), or where its mask is painted.
    AddFill(bool),
    /// A fill layer takes the current colour or texture.
    Refill(u64),
    /// Away with it.
    Delete(u64),
    /// Another name.
    Rename(u64, String),
    /// Shown or not.
    Show(u64, bool),
    /// 0..1.
    Opacity(u64, f32),
    /// Another blend mode.
    Blend(u64, BlendMode),
    /// One place towards the top (true) or the bottom.
    Move(u64, bool),
    /// A mask that shows (true) or hides all until it is painted.
    AddMask(u64, bool),
    /// No mask any more.
    RemoveMask(u64),
    /// Shown in a channel of the asset or not.
    Channel(u64, usize, bool),
}

/// Changes one layer.
pub(super) fn change(
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

/// Moves a layer by one place.
pub(super) fn shift(layers: &mut [Layer], id: u64, is_up: bool) {
    let Some(at) = layers.iter().position(|layer| layer.id() == id) else { return };
    let to = if is_up { (at + 1).min(layers.len() - 1) } else { at.saturating_sub(1) };
    layers.swap(at, to);
}

/// Hides or shows a channel.
pub(super) fn set_channel(layer: &mut Layer, channel: usize, is_shown: bool) {
    if layer.channels.len() <= channel {
        layer.channels.resize(channel + 1, true);
    }
    layer.channels[channel] = is_shown;
}

/// The first free name of the form `Layer 3`.
pub(super) fn free_name(snapshot: &Snapshot, start: &str) -> String {
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
