//! The list of layers as it is shown: its lines, and where a layer goes that is dragged through them.

use std::collections::BTreeSet;

use fantex::paint::{Layer, LayerPlace, groups_around};

/// A line of the list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayerRow {
    pub id: u64,
    /// The group that it lies in.
    pub parent: Option<u64>,
    /// Groups around it.
    pub depth: usize,
    pub is_group: bool,
    /// Whether its members are listed.
    pub is_open: bool,
}

/// The lines, the top one first. `dragged` is listed without its members.
pub fn layer_rows(
    layers: &[Layer],
    collapsed: &BTreeSet<u64>,
    dragged: Option<u64>,
) -> Vec<(LayerRow, Layer)> {
    let is_closed = |id: &u64| collapsed.contains(id) || dragged == Some(*id);
    let mut rows = Vec::with_capacity(layers.len());
    for layer in layers.iter().rev() {
        let around = groups_around(layers, layer.id());
        if around.iter().any(is_closed) {
            continue;
        }
        let (id, is_group) = (layer.id(), layer.group_kind().is_some());
        let is_open = is_group && !is_closed(&id);
        let row = LayerRow { id, parent: layer.parent, depth: around.len(), is_group, is_open };
        rows.push((row, layer.clone()));
    }
    rows
}

/// Where a layer goes whose line is dragged onto another one, or aside by `steps` of the indentation: to the right into the group above it, to
/// the left out of its own. None where it stays.
pub fn drop_place(rows: &[LayerRow], dragged: u64, onto: usize, steps: i32) -> Option<LayerPlace> {
    let from = rows.iter().position(|row| row.id == dragged)?;
    let other = rows[onto.min(rows.len() - 1)];
    if other.id == dragged {
        return match steps {
            0 => None,
            1.. => inward(rows, from),
            _ => outward(rows, from),
        };
    }
    // Lines that are passed on the way down lie above it afterwards.
    let is_down = onto > from;
    Some(match (is_down, other.is_open) {
        (true, true) => LayerPlace::Into(other.id),
        (true, false) => LayerPlace::Below(other.id),
        (false, _) => LayerPlace::Above(other.id),
    })
}

/// Into the group that lies directly above, at its bottom.
fn inward(rows: &[LayerRow], from: usize) -> Option<LayerPlace> {
    let row = rows[from];
    let group = rows[..from].iter().rev().find(|above| above.depth == row.depth)?;
    if !group.is_group || group.parent != row.parent {
        return None;
    }
    let lowest = rows[..from].iter().rev().find(|above| above.parent == Some(group.id));
    Some(lowest.map_or(LayerPlace::Into(group.id), |lowest| LayerPlace::Below(lowest.id)))
}

/// Out of its group, where it is the lowest there.
fn outward(rows: &[LayerRow], from: usize) -> Option<LayerPlace> {
    let group = rows[from].parent?;
    let is_lowest = !rows[from + 1..].iter().any(|row| row.parent == Some(group));
    is_lowest.then_some(LayerPlace::Below(group))
}
