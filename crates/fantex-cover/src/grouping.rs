//! From fans to groups that are laid flat.

use fantex_mesh::Fans;
use rayon::prelude::*;

use crate::fan_shape::{FanShape, Layout};
use crate::flatten::{Flat, Flattener, Membership};
use crate::merge::merge_small;
use crate::partition::{Item, PatchLimits, halve_by_length, partition};
use crate::surface::Surface;

/// How groups may grow.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroupLimits {
    pub(crate) delta: f32,
    /// Target tile extent in texels; 0 = one fan per group.
    pub(crate) extent_texels: f32,
    /// Smallest cosine between a group's direction and its triangles' normals.
    pub(crate) facing: f32,
    /// Smallest cosine between a patch's direction and its fans' directions while patches are cut.
    pub(crate) patch_facing: f32,
}

/// One group while the cover is built.
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    /// The group's fans are `Grouping::order[start..start + length]`.
    pub(crate) start: u32,
    pub(crate) length: u32,
    pub(crate) flat: Flat,
    /// Nominal texels per mesh unit.
    pub(crate) density: f32,
}

impl Patch {
    pub(crate) fn fans<'a>(&self, order: &'a [u32]) -> &'a [u32] {
        &order[self.start as usize..(self.start + self.length) as usize]
    }
}

/// The groups of a mesh, before tiles are sized.
pub(crate) struct Grouping {
    /// Fans, group by group, along a space-filling curve.
    pub(crate) order: Vec<u32>,
    pub(crate) patches: Vec<Patch>,
    /// Group of each fan.
    pub(crate) fan_groups: Vec<u32>,
}

/// Groups the fans of a surface. `fan_density` is the nominal number of texels per mesh unit around each fan.
pub(crate) fn group_fans(
    surface: &Surface<'_>,
    shapes: &[FanShape],
    fan_density: &(dyn Fn(usize) -> f32 + Sync),
    limits: &GroupLimits,
) -> Grouping {
    let mut items: Vec<Item> =
        (0..shapes.len()).into_par_iter().map(|f| item(surface, shapes, f, fan_density(f))).collect();
    let grouped = limits.extent_texels > 0.0;
    let patch_limits = PatchLimits { extent_texels: limits.extent_texels, facing: limits.patch_facing };
    let lengths = if grouped {
        let lengths = partition(&mut items, &patch_limits);
        let mut labels = vec![ALONE; shapes.len()];
        separate_components(surface, shapes, &mut items, &lengths, &mut labels, 0)
    } else {
        sort_along_curve(&mut items);
        vec![1; items.len()]
    };
    let grouping = flatten_all(surface, shapes, items, lengths, limits);
    if grouped { merge_small(surface, shapes, grouping, limits) } else { grouping }
}

fn item(surface: &Surface<'_>, shapes: &[FanShape], fan: usize, density: f32) -> Item {
    let area: f32 = surface.fans.corners(fan).iter().map(|c| surface.areas[c.triangle()]).sum();
    Item {
        position: surface.fan_center(fan),
        axis: shapes[fan].cone.axis,
        area: area / 3.0,
        density,
        fan: fan as u32,
    }
}

/// Orders fans along a Morton curve through mesh space, 10 bits per axis.
fn sort_along_curve(items: &mut [Item]) {
    let spread = |x: f32| {
        let mut bits = ((x + 1.0) * 511.5) as u32 & 1023;
        bits = (bits | bits << 16) & 0x0300_00ff;
        bits = (bits | bits << 8) & 0x0300_f00f;
        bits = (bits | bits << 4) & 0x030c_30c3;
        (bits | bits << 2) & 0x0924_9249
    };
    items.par_sort_by_cached_key(|i| {
        let [x, y, z] = i.position.to_array().map(spread);
        (x | y << 1 | z << 2, i.fan)
    });
}

/// Reorders every patch by connected components (through triangles); unfolded fans become patches of their own.
/// `labels` has an entry per fan; fans of other patches must not be labelled with `first_label..first_label + lengths.len()`.
fn separate_components(
    surface: &Surface<'_>,
    shapes: &[FanShape],
    items: &mut [Item],
    lengths: &[u32],
    labels: &mut [u32],
    first_label: u32,
) -> Vec<u32> {
    let mut slices = Vec::with_capacity(lengths.len());
    let mut rest = items;
    for (&length, label) in lengths.iter().zip(first_label..) {
        let (slice, tail) = rest.split_at_mut(length as usize);
        for item in slice.iter() {
            let alone = shapes[item.fan as usize].layout != Layout::Projected;
            labels[item.fan as usize] = if alone { ALONE } else { label };
        }
        slices.push(slice);
        rest = tail;
    }
    let labels = &*labels;
    let parts: Vec<Vec<u32>> = slices
        .into_par_iter()
        .map_init(ComponentFinder::default, |finder, slice| finder.split(&surface.fans, labels, slice))
        .collect();
    parts.into_iter().flatten().collect()
}

/// Label of fans that join no group.
const ALONE: u32 = u32::MAX;

/// Finds the connected components of one patch. Keeps its buffers.
#[derive(Default)]
struct ComponentFinder {
    /// `(fan, index in the patch)`, ascending by fan.
    index: Vec<(u32, u32)>,
    component: Vec<u32>,
    stack: Vec<u32>,
}

impl ComponentFinder {
    /// Stable-sorts the slice by component; returns the components' lengths in order of their first fans.
    fn split(&mut self, fans: &Fans, labels: &[u32], slice: &mut [Item]) -> Vec<u32> {
        if slice.len() == 1 {
            return vec![1];
        }
        self.index.clear();
        self.index.extend(slice.iter().enumerate().map(|(i, item)| (item.fan, i as u32)));
        self.index.sort_unstable();
        self.component.clear();
        self.component.resize(slice.len(), u32::MAX);
        let mut count = 0;
        for i in 0..slice.len() {
            if self.component[i] == u32::MAX {
                self.flood(fans, labels, slice, i, count);
                count += 1;
            }
        }
        if count == 1 {
            return vec![slice.len() as u32];
        }
        let mut lengths = vec![0u32; count as usize];
        for &c in &self.component {
            lengths[c as usize] += 1;
        }
        let mut tagged: Vec<(u32, Item)> = self.component.iter().copied().zip(slice.iter().copied()).collect();
        tagged.sort_by_key(|t| t.0);
        for (to, (_, item)) in slice.iter_mut().zip(tagged) {
            *to = item;
        }
        lengths
    }

    fn flood(&mut self, fans: &Fans, labels: &[u32], slice: &[Item], seed: usize, component: u32) {
        self.component[seed] = component;
        let label = labels[slice[seed].fan as usize];
        if label == ALONE {
            return;
        }
        self.stack.push(seed as u32);
        while let Some(i) = self.stack.pop() {
            for corner in fans.corners(slice[i as usize].fan as usize) {
                for neighbour in fans.of_triangle(corner.triangle()) {
                    if labels[neighbour as usize] != label {
                        continue;
                    }
                    if let Ok(at) = self.index.binary_search_by_key(&neighbour, |x| x.0) {
                        let j = self.index[at].1;
                        if self.component[j as usize] == u32::MAX {
                            self.component[j as usize] = component;
                            self.stack.push(j);
                        }
                    }
                }
            }
        }
    }
}

/// Lays every patch flat, halving those that cannot share a projection until all can.
fn flatten_all(
    surface: &Surface<'_>,
    shapes: &[FanShape],
    mut items: Vec<Item>,
    lengths: Vec<u32>,
    limits: &GroupLimits,
) -> Grouping {
    let mut fan_groups = vec![0; shapes.len()];
    let mut pending = Vec::with_capacity(lengths.len());
    let mut start = 0;
    for length in lengths {
        pending.push((start, length));
        start += length;
    }
    let mut patches: Vec<Patch> = Vec::with_capacity(pending.len());
    let mut next_group = 0u32;
    while !pending.is_empty() {
        for (i, &(start, length)) in pending.iter().enumerate() {
            for item in &items[start as usize..(start + length) as usize] {
                fan_groups[item.fan as usize] = next_group + i as u32;
            }
        }
        let flats: Vec<Option<Patch>> = pending
            .par_iter()
            .enumerate()
            .map_init(Default::default, |scratch, (i, &(start, length))| {
                let group = next_group + i as u32;
                let members = &items[start as usize..(start + length) as usize];
                flatten_patch(surface, shapes, members, group, &fan_groups, limits, scratch)
                    .map(|(flat, density)| Patch { start, length, flat, density })
            })
            .collect();
        next_group += pending.len() as u32;
        let mut rejected = Vec::new();
        for (flat, (start, length)) in flats.into_iter().zip(pending) {
            match flat {
                Some(patch) => patches.push(patch),
                None => {
                    let slice = &mut items[start as usize..(start + length) as usize];
                    let halves = halve_by_length(slice);
                    let mut at = start;
                    for part in separate_components(surface, shapes, slice, &halves, &mut fan_groups, next_group) {
                        rejected.push((at, part));
                        at += part;
                    }
                }
            }
        }
        pending = rejected;
    }
    patches.sort_unstable_by_key(|p| p.start);
    let order: Vec<u32> = items.iter().map(|i| i.fan).collect();
    let mut grouping = Grouping { order, patches, fan_groups };
    grouping.number_groups();
    grouping
}

impl Grouping {
    /// Makes `fan_groups` agree with the order of the patches.
    pub(crate) fn number_groups(&mut self) {
        for (g, patch) in self.patches.iter().enumerate() {
            for &fan in patch.fans(&self.order) {
                self.fan_groups[fan as usize] = g as u32;
            }
        }
    }
}

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    flattener: Flattener,
    fans: Vec<u32>,
}

fn flatten_patch(
    surface: &Surface<'_>,
    shapes: &[FanShape],
    members: &[Item],
    group: u32,
    fan_groups: &[u32],
    limits: &GroupLimits,
    scratch: &mut Scratch,
) -> Option<(Flat, f32)> {
    let area: f32 = members.iter().map(|i| i.area).sum();
    let weighted: f32 = members.iter().map(|i| i.area * i.density).sum();
    let density = if area > 0.0 { weighted / area } else { members[0].density };
    let membership =
        Membership { fan_groups, groups: [group; 2], delta: limits.delta, pad: texel_pad(density), facing: limits.facing };
    let shape = &shapes[members[0].fan as usize];
    if shape.layout == Layout::Unfolded {
        let flat = scratch.flattener.unfold(surface, members[0].fan, shape.cone.axis, &membership);
        return flat.map(|flat| (flat, density));
    }
    scratch.fans.clear();
    scratch.fans.extend(members.iter().map(|i| i.fan));
    let flat = scratch.flattener.project(surface, &scratch.fans, &membership).ok();
    flat.map(|flat| (flat, density))
}

/// The filter margin of a tile, both sides together: one texel, in mesh units.
pub(crate) fn texel_pad(density: f32) -> f32 {
    1.0 / density.max(f32::MIN_POSITIVE)
}
