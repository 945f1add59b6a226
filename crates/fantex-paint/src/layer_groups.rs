//! Groups of layers: how they lie in the list, and how layers get into and out of them.
//!
//! The list stays flat, from the bottom to the top. A group is an entry of its own; its members name it as their `parent` and lie
//! directly below it, so that everything within a group is one run that ends with the group. [`tidy`] brings any list into that order.

use std::collections::{BTreeMap, BTreeSet};

use fantex_base::union_find::UnionFind;
use fantex_base::{Error, Result};
use serde::{Deserialize, Serialize};

use crate::error::encoded;
use crate::layers::Layers;
use crate::{BlendMode, Layer, LayerContent, LayerMove, Painter};

/// How deep groups may be nested.
pub const MAX_GROUP_DEPTH: usize = 16;

/// Which groups are folded in the list, by number. A matter of view: no step of the history.
pub(crate) const COLLAPSED: &str = "layers/collapsed";

/// How the members of a group meet what lies below it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroupKind {
    /// They blend with what lies below, as if there were no group; its opacity and mask mix the result with what was there before.
    #[default]
    PassThrough,
    /// They blend among themselves, over nothing; the result is laid on as one layer, with the group's blend mode.
    Isolated,
}

/// Where a layer is put.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerPlace {
    /// On top of all others, in no group.
    Top,
    /// Directly above another layer, in the same group.
    Above(u64),
    /// Directly below another layer, in the same group.
    Below(u64),
    /// In a group, above its other members.
    Into(u64),
}

impl Layer {
    /// An empty group.
    pub fn group(name: &str, kind: GroupKind) -> Self {
        Self { content: LayerContent::Group(kind), ..Self::painted(name) }
    }

    /// How it is a group; none where it is a layer.
    pub fn group_kind(&self) -> Option<GroupKind> {
        match self.content {
            LayerContent::Group(kind) => Some(kind),
            _ => None,
        }
    }
}

/// The groups around layers, by the layers' numbers.
struct Parents(BTreeMap<u64, u64>);

impl Parents {
    fn of(stack: &[Layer]) -> Self {
        Self(stack.iter().filter_map(|layer| Some((layer.id, layer.parent?))).collect())
    }

    /// The groups around a layer, the innermost first; without end in a ring.
    fn around(&self, id: u64) -> impl Iterator<Item = u64> {
        let parent = |id: &u64| self.0.get(id).copied();
        std::iter::successors(parent(&id), parent)
    }
}

/// The groups around a layer, the innermost first.
pub fn groups_around(stack: &[Layer], id: u64) -> Vec<u64> {
    let parent = |id: u64| stack.iter().find(|layer| layer.id() == id)?.parent;
    std::iter::successors(parent(id), |&id| parent(id)).take(stack.len()).collect()
}

/// A layer and everything within it, in the order of the list.
pub(crate) fn with_members(stack: &[Layer], id: u64) -> Vec<u64> {
    let parents = Parents::of(stack);
    let is_within = |layer: &&Layer| {
        layer.id() == id || parents.around(layer.id()).take(stack.len()).any(|group| group == id)
    };
    stack.iter().filter(is_within).map(Layer::id).collect()
}

/// The layer directly below another one in the same group.
pub fn layer_below(stack: &[Layer], id: u64) -> Option<&Layer> {
    let parent = stack.iter().find(|layer| layer.id() == id)?.parent;
    stack.iter().take_while(|layer| layer.id() != id).filter(|layer| layer.parent == parent).last()
}

/// True where a layer does nothing but take opacity from what lies below it: one that erases, or a group that lets pass through and shows
/// none but such.
pub(crate) fn only_erases(stack: &[Layer], id: u64) -> bool {
    let Some(layer) = stack.iter().find(|layer| layer.id() == id) else { return false };
    if layer.group_kind() != Some(GroupKind::PassThrough) {
        return layer.erases();
    }
    let mut members = stack.iter().filter(|layer| layer.parent == Some(id) && layer.visible).peekable();
    members.peek().is_some() && members.all(|member| only_erases(stack, member.id()))
}

/// Removes a layer, and everything within it.
pub fn remove_layer(stack: &mut Vec<Layer>, id: u64) {
    let gone = with_members(stack, id);
    stack.retain(|layer| !gone.contains(&layer.id()));
}

/// Removes a group but not what is within: that takes its place.
pub fn dissolve_group(stack: &mut Vec<Layer>, id: u64) {
    let Some(at) = stack.iter().position(|layer| layer.id() == id && layer.group_kind().is_some()) else {
        return;
    };
    let parent = stack.remove(at).parent;
    stack.iter_mut().filter(|layer| layer.parent == Some(id)).for_each(|layer| layer.parent = parent);
}

/// Moves a layer with everything within it. Does nothing where the place is not there, or lies within the layer itself.
pub fn move_layer(stack: &mut Vec<Layer>, id: u64, place: LayerPlace) {
    let moved = with_members(stack, id);
    let (LayerPlace::Above(number) | LayerPlace::Below(number) | LayerPlace::Into(number)) = place else {
        return put(stack, &moved, id, None, |rest| rest.len());
    };
    let is_there = |layer: &&Layer| layer.id() == number && !moved.contains(&number);
    let Some(other) = stack.iter().find(is_there) else { return };
    let parent = other.parent;
    let at = |rest: &[Layer]| rest.iter().position(|layer| layer.id() == number).unwrap_or(rest.len());
    match place {
        LayerPlace::Above(_) => put(stack, &moved, id, parent, |rest| at(rest) + 1),
        LayerPlace::Into(_) if other.group_kind().is_none() => {}
        LayerPlace::Into(_) => put(stack, &moved, id, Some(number), at),
        // Below everything within it.
        _ => {
            let within = with_members(stack, number);
            let first = within.into_iter().find(|id| !moved.contains(id)).unwrap_or(number);
            let lowest = |rest: &[Layer]| rest.iter().position(|layer| layer.id() == first).unwrap_or(0);
            put(stack, &moved, id, parent, lowest);
        }
    }
}

/// Takes layers out and puts them in again, the one of number `id` into a group.
fn put(stack: &mut Vec<Layer>, moved: &[u64], id: u64, parent: Option<u64>, at: impl Fn(&[Layer]) -> usize) {
    let (mut run, rest): (Vec<Layer>, Vec<Layer>) =
        std::mem::take(stack).into_iter().partition(|layer| moved.contains(&layer.id()));
    run.iter_mut().filter(|layer| layer.id() == id).for_each(|layer| layer.parent = parent);
    let at = at(&rest).min(rest.len());
    *stack = rest;
    stack.splice(at..at, run);
}

/// Brings a list into order: members directly below their groups, in the order in which they are. What names no group of the list, or a
/// group within itself, belongs to none.
pub(crate) fn tidy(stack: &mut Vec<Layer>) {
    let groups = (0..).zip(stack.iter()).filter(|(_, layer)| layer.group_kind().is_some());
    let groups: BTreeMap<u64, u32> = groups.map(|(place, layer)| (layer.id, place)).collect();
    let mut sets = UnionFind::new(stack.len());
    for (place, layer) in (0..).zip(stack.iter_mut()) {
        let parent = layer.parent.and_then(|parent| groups.get(&parent));
        // As long as none of those before closes a ring, a layer without a parent closes one with what belongs to it.
        let is_apart = parent.is_some_and(|&parent| sets.union(place, parent));
        layer.parent = layer.parent.filter(|_| is_apart);
    }
    let mut members: BTreeMap<Option<u64>, Vec<Layer>> = BTreeMap::new();
    for layer in stack.drain(..) {
        members.entry(layer.parent).or_default().push(layer);
    }
    // From the top to the bottom: a group comes before its members.
    let mut open = members.remove(&None).unwrap_or_default();
    while let Some(layer) = open.pop() {
        open.extend(members.remove(&Some(layer.id)).unwrap_or_default());
        stack.push(layer);
    }
    stack.reverse();
}

/// Refuses groups that are nested too deeply.
pub(crate) fn check_depth(stack: &[Layer]) -> Result<()> {
    let parents = Parents::of(stack);
    let most = stack.len().min(MAX_GROUP_DEPTH + 1);
    let deep = stack.iter().find(|layer| parents.around(layer.id).take(most).count() > MAX_GROUP_DEPTH);
    deep.map_or(Ok(()), |layer| {
        let name = &layer.name;
        Err(Error::invalid(format!(
            "groups of layers are nested {MAX_GROUP_DEPTH} deep at most, but {name:?} lies deeper: move it outwards"
        )))
    })
}

impl Painter {
    /// Puts layers into a new group in the place of the topmost of them; returns the group's number. What lies within one of them
    /// comes with it.
    ///
    /// # Errors
    /// None of the numbers is that of a layer, groups would be nested too deeply, or the asset cannot be read or changed.
    pub fn group_layers(&mut self, name: &str, kind: GroupKind, ids: &[u64]) -> Result<u64> {
        let number = self.start_group_layers(name, kind, ids)?;
        self.finish_work()?;
        Ok(number)
    }

    /// The same; what it shows is left to [`work_on`](Self::work_on).
    ///
    /// # Errors
    /// As [`group_layers`](Self::group_layers).
    pub fn start_group_layers(&mut self, name: &str, kind: GroupKind, ids: &[u64]) -> Result<u64> {
        self.finish_work()?;
        self.end()?;
        let stack = &self.layers.stack;
        let is_outermost = |layer: &&Layer| {
            let around = groups_around(stack, layer.id);
            ids.contains(&layer.id) && !around.iter().any(|group| ids.contains(group))
        };
        let chosen: Vec<u64> = stack.iter().filter(is_outermost).map(Layer::id).collect();
        let Some(&top) = chosen.last() else {
            return Err(Error::not_found("there is no layer to be put into a group: name one at least"));
        };
        let mut number = 0;
        self.change_layers("group layers", &[], |layers| {
            number = layers.add(Layer::group(name, kind));
            move_layer(&mut layers.stack, number, LayerPlace::Above(top));
            for &id in &chosen {
                move_layer(&mut layers.stack, id, LayerPlace::Into(number));
            }
        })?;
        Ok(number)
    }

    /// Makes one painted layer of a group, which holds what the group's members show over nothing, with the group's opacity and mask. The
    /// picture stays as it is where the group is isolated, or where its members blend as `Normal`, or all as `Erase`: then so does the
    /// layer.
    ///
    /// # Errors
    /// There is no such group, it is hidden, or the asset cannot be read or changed.
    pub fn merge_group(&mut self, id: u64) -> Result<()> {
        self.start_merge_group(id)?;
        self.finish_work()
    }

    /// The same; what it shows is left to [`work_on`](Self::work_on).
    ///
    /// # Errors
    /// As [`merge_group`](Self::merge_group).
    pub fn start_merge_group(&mut self, id: u64) -> Result<()> {
        self.finish_work()?;
        self.end()?;
        let group = self.known_layer(id)?;
        let name = group.name.clone();
        if group.group_kind().is_none() {
            return Err(Error::invalid(format!("the layer {name:?} is no group that could be merged")));
        }
        if !group.visible {
            let sentence = format!("the group {name:?} is hidden, and would be lost: show it, then merge");
            return Err(Error::invalid(sentence));
        }
        self.change_layers("merge group", &[LayerMove::Merge([id, id])], |layers| {
            become_painted(layers, id);
        })
    }

    /// Groups that are folded in the list, by number.
    pub fn collapsed_groups(&self) -> &BTreeSet<u64> {
        &self.collapsed
    }

    /// Folds a group in the list, or unfolds it. No step of the history.
    ///
    /// # Errors
    /// The asset cannot be changed.
    pub fn collapse_group(&mut self, id: u64, is_collapsed: bool) -> Result<()> {
        let changed = match is_collapsed {
            true => {
                self.layers.find(id).is_some_and(|layer| layer.group_kind().is_some())
                    && self.collapsed.insert(id)
            }
            false => self.collapsed.remove(&id),
        };
        if changed {
            self.editor.attach(COLLAPSED, encoded(&self.collapsed)?)?;
        }
        Ok(())
    }
}

/// Lets a painted layer take the place of a layer and all within it; how it blends stays.
pub(crate) fn become_painted(layers: &mut Layers, id: u64) {
    let erases = only_erases(&layers.stack, id);
    let gone: Vec<u64> = with_members(&layers.stack, id).into_iter().filter(|&other| other != id).collect();
    layers.stack.retain(|layer| !gone.contains(&layer.id));
    for layer in layers.stack.iter_mut().filter(|layer| layer.id == id) {
        let blend = match layer.group_kind() {
            Some(GroupKind::PassThrough) if erases => BlendMode::Erase,
            Some(GroupKind::PassThrough) => BlendMode::Normal,
            _ => layer.blend,
        };
        *layer = Layer { id, blend, parent: layer.parent, ..Layer::painted(&layer.name) };
    }
}

/// Which groups are folded. A list that cannot be read is as none.
pub(crate) fn load_collapsed(bytes: Option<Vec<u8>>) -> BTreeSet<u64> {
    bytes.and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layer(id: u64, parent: Option<u64>) -> Layer {
        Layer { id, parent, ..Layer::painted("layer") }
    }

    fn group(id: u64, parent: Option<u64>) -> Layer {
        Layer { id, parent, ..Layer::group("group", GroupKind::PassThrough) }
    }

    fn listed(stack: &[Layer]) -> Vec<(u64, Option<u64>)> {
        stack.iter().map(|layer| (layer.id, layer.parent)).collect()
    }

    #[test]
    fn lists_are_brought_into_order() {
        let mut stack =
            vec![layer(1, Some(9)), group(9, None), layer(2, None), layer(3, Some(8)), group(8, Some(9))];
        stack.extend([layer(4, Some(2)), layer(5, Some(77)), group(6, Some(7)), group(7, Some(6))]);
        tidy(&mut stack);
        let expected = [
            (1, Some(9)),
            (3, Some(8)),
            (8, Some(9)),
            (9, None),
            (2, None),
            (4, None),
            (5, None),
            (6, Some(7)),
            (7, None),
        ];
        assert_eq!(listed(&stack), expected);
        let before = stack.clone();
        tidy(&mut stack);
        assert_eq!(stack, before);
        assert_eq!(with_members(&stack, 9), [1, 3, 8, 9]);
        assert_eq!(groups_around(&stack, 3), [8, 9]);
        assert_eq!(layer_below(&stack, 8).map(Layer::id), Some(1));
        assert_eq!(layer_below(&stack, 2).map(Layer::id), Some(9));
        assert_eq!(layer_below(&stack, 1), None);
    }

    #[test]
    fn layers_move_with_all_that_is_within() {
        let start = [layer(1, None), layer(2, Some(9)), layer(3, Some(9)), group(9, None), layer(4, None)];
        let moved = |id, place| {
            let mut stack = start.to_vec();
            move_layer(&mut stack, id, place);
            let kept = stack.clone();
            tidy(&mut stack);
            assert_eq!(stack, kept, "moving keeps the order");
            listed(&stack)
        };
        let (within, out) = (Some(9), None);
        let expected = [(1, out), (4, out), (2, within), (3, within), (9, out)];
        assert_eq!(moved(9, LayerPlace::Top), expected);
        assert_eq!(moved(9, LayerPlace::Above(4)), expected);
        assert_eq!(moved(4, LayerPlace::Below(9)), expected);
        let expected = [(2, within), (3, within), (1, within), (9, out), (4, out)];
        assert_eq!(moved(1, LayerPlace::Into(9)), expected);
        assert_eq!(moved(1, LayerPlace::Above(3)), expected);
        let expected = [(1, out), (3, within), (9, out), (2, out), (4, out)];
        assert_eq!(moved(2, LayerPlace::Above(9)), expected);
        let expected = [(1, out), (2, out), (3, within), (9, out), (4, out)];
        assert_eq!(moved(2, LayerPlace::Below(9)), expected);
        for nothing in [LayerPlace::Into(4), LayerPlace::Above(77), LayerPlace::Below(9), LayerPlace::Into(9)]
        {
            assert_eq!(moved(9, nothing), listed(&start));
        }
        let mut stack = start.to_vec();
        dissolve_group(&mut stack, 9);
        assert_eq!(listed(&stack), [(1, out), (2, out), (3, out), (4, out)]);
        let mut stack = start.to_vec();
        remove_layer(&mut stack, 9);
        assert_eq!(listed(&stack), [(1, out), (4, out)]);
    }

    /// Each layer within the one before.
    #[test]
    fn long_lists_are_brought_into_order_at_once() {
        let count = 60_000;
        let mut stack: Vec<Layer> = (0..count).map(|n| group(n, Some(n + 1))).collect();
        stack[count as usize - 1].parent = Some(0);
        let begin = std::time::Instant::now();
        tidy(&mut stack);
        assert_eq!(stack.iter().filter(|layer| layer.parent.is_none()).count(), 1, "where the ring closes");
        check_depth(&stack).unwrap_err();
        assert_eq!(with_members(&stack[..20], 19).len(), 20);
        assert!(begin.elapsed().as_secs() < 2, "{:?}", begin.elapsed());
    }

    #[test]
    fn groups_are_nested_so_deep_and_no_deeper() {
        let depth = MAX_GROUP_DEPTH as u64;
        let mut stack: Vec<Layer> = (0..depth).map(|n| group(n, n.checked_sub(1))).collect();
        stack.push(layer(99, Some(depth - 1)));
        tidy(&mut stack);
        check_depth(&stack).unwrap();
        stack[0].parent = Some(100);
        stack.push(group(100, Some(depth - 1)));
        tidy(&mut stack);
        assert!(check_depth(&stack).unwrap_err().to_string().contains("16 deep at most"));
    }
}
