//! From fans to groups that are laid flat.

use rayon::prelude::*;

use crate::border::Membership;
use crate::connect::Connector;
use crate::fan_shape::{FanShape, Layout};
use crate::flatten::{Flat, FlatLimits, Flattener, Laid};
use crate::merge::{MergeLimits, choose_unions};
use crate::partition::{Item, PatchLimits, halve_by_length, partition};
use crate::surface::Surface;

/// How groups may grow.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroupLimits {
    pub(crate) delta: f32,
    /// Target tile extent in texels.
    pub(crate) extent_texels: f32,
    /// Smallest cosine between a group's direction and its triangles' normals.
    pub(crate) facing: f32,
    /// Smallest cosine between a patch's direction and its fans' directions while patches are cut.
    pub(crate) patch_facing: f32,
}

/// One group while the cover is built.
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    /// The group's fans are those of the items `start..start + length`.
    pub(crate) start: u32,
    pub(crate) length: u32,
    pub(crate) flat: Flat,
    pub(crate) layout: Layout,
    /// Nominal texels per mesh unit.
    pub(crate) density: f32,
    /// Smallest facing cosine that one of its fans reaches alone.
    pub(crate) steepest_fan: f32,
}

impl Patch {
    fn laid(&self, items: &[Item]) -> Laid {
        let Flat { frame, min, size, .. } = self.flat;
        let fan = items[self.start as usize].fan;
        Laid { frame, min, size, density: self.density, fan, layout: self.layout, folds: false }
    }
}

/// The groups of a mesh, before tiles are sized.
pub(crate) struct Grouping {
    /// Along a space-filling curve.
    pub(crate) laid: Vec<Laid>,
    /// Group of each fan.
    pub(crate) fan_groups: Vec<u32>,
}

/// Groups the fans of a surface, of which there is an item each.
pub(crate) fn group_fans(
    surface: &Surface<'_>,
    shapes: &[FanShape],
    mut items: Vec<Item>,
    limits: &GroupLimits,
) -> Grouping {
    let patch_limits = PatchLimits { extent_texels: limits.extent_texels, facing: limits.patch_facing };
    let lengths = partition(&mut items, &patch_limits);
    let mut connector = Connector::new(&surface.fans, shapes);
    let lengths = connector.connect(&mut items, &lengths, limits.facing);
    let fan_groups = vec![0; shapes.len()];
    let mut builder = Builder { surface, shapes, limits, connector, items, fan_groups, unused_label: 0 };
    let mut patches = builder.flatten(Pieces::consecutive(lengths));
    builder.number_groups(&patches);
    let merge_limits = MergeLimits { extent_texels: limits.extent_texels, facing: limits.facing };
    let joined = choose_unions(&surface.fans, &patches, &builder.fan_groups, &merge_limits);
    patches = builder.join(patches, &joined);
    builder.number_groups(&patches);
    let laid = patches.iter().map(|patch| patch.laid(&builder.items)).collect();
    Grouping { laid, fan_groups: builder.fan_groups }
}

/// Runs of items, `(start, length)`.
struct Pieces(Vec<(u32, u32)>);

impl Pieces {
    fn consecutive(lengths: Vec<u32>) -> Self {
        let mut start = 0;
        let pieces = lengths.into_iter().map(|length| {
            start += length;
            (start - length, length)
        });
        Self(pieces.collect())
    }
}

/// The state while patches are laid flat, halved and joined. Every patch is a run of `items`.
struct Builder<'a> {
    surface: &'a Surface<'a>,
    shapes: &'a [FanShape],
    limits: &'a GroupLimits,
    connector: Connector<'a>,
    items: Vec<Item>,
    /// A label per fan; equal in one patch, different in different patches.
    fan_groups: Vec<u32>,
    /// Labels from here on are not in use.
    unused_label: u32,
}

impl Builder<'_> {
    /// Lays every piece flat, halving those that cannot share a projection until all can. Ascending by start.
    fn flatten(&mut self, pieces: Pieces) -> Vec<Patch> {
        let mut patches: Vec<Patch> = Vec::new();
        let mut pending = pieces.0;
        while !pending.is_empty() {
            let first_label = self.unused_label;
            for (&(start, length), label) in pending.iter().zip(first_label..) {
                for item in &self.items[start as usize..(start + length) as usize] {
                    self.fan_groups[item.fan as usize] = label;
                }
            }
            let flats: Vec<Option<Patch>> = pending
                .par_iter()
                .enumerate()
                .map_init(Default::default, |scratch, (i, &(start, length))| {
                    self.flatten_piece(start, length, first_label + i as u32, scratch)
                })
                .collect();
            self.unused_label += pending.len() as u32;
            let rejected: Vec<(u32, u32)> = flats
                .iter()
                .zip(&pending)
                .filter(|(flat, _)| flat.is_none())
                .map(|(_, &piece)| piece)
                .collect();
            if patches.is_empty() {
                // Collected in place.
                patches = flats.into_iter().flatten().collect();
            } else {
                patches.extend(flats.into_iter().flatten());
            }
            pending = rejected.into_iter().flat_map(|piece| self.halve(piece)).collect();
        }
        patches.sort_unstable_by_key(|p| p.start);
        patches
    }

    fn flatten_piece(&self, start: u32, length: u32, group: u32, scratch: &mut Scratch) -> Option<Patch> {
        let members = &self.items[start as usize..(start + length) as usize];
        let area: f32 = members.iter().map(|i| i.area).sum();
        let weighted: f32 = members.iter().map(|i| i.area * i.density).sum();
        let density = if area > 0.0 { weighted / area } else { members[0].density };
        let steepest_fan = members.iter().map(|i| self.shapes[i.fan as usize].cone.cos).fold(1.0, f32::min);
        let membership = Membership { fan_groups: &self.fan_groups, group };
        let limits = FlatLimits {
            delta: self.limits.delta,
            pad: 1.0 / density.max(f32::MIN_POSITIVE),
            facing: facing_limit(self.limits.facing, steepest_fan),
        };
        let shape = &self.shapes[members[0].fan as usize];
        let flat = if shape.layout == Layout::Unfolded {
            scratch.flattener.unfold(self.surface, members[0].fan, shape.cone, &limits)?
        } else if let [lone] = members {
            scratch.flattener.project_fan(self.surface, lone.fan as usize, shape.cone, &limits)
        } else {
            scratch.fans.clear();
            scratch.fans.extend(members.iter().map(|i| i.fan));
            scratch.flattener.project(self.surface, &scratch.fans, membership, &limits)?
        };
        Some(Patch { start, length, flat, layout: shape.layout, density, steepest_fan })
    }

    /// Cuts a piece in two, and each half into connected components.
    fn halve(&mut self, (start, length): (u32, u32)) -> Vec<(u32, u32)> {
        let halves = halve_by_length(&mut self.items[start as usize..(start + length) as usize]);
        let parts = self.connector.separate(&mut self.items, start as usize, &halves);
        Pieces::consecutive(parts).0.into_iter().map(|(at, n)| (start + at, n)).collect()
    }

    /// Makes `fan_groups` agree with the order of the patches.
    fn number_groups(&mut self, patches: &[Patch]) {
        for (patch, group) in patches.iter().zip(0..) {
            for item in &self.items[patch.start as usize..(patch.start + patch.length) as usize] {
                self.fan_groups[item.fan as usize] = group;
            }
        }
        self.unused_label = patches.len() as u32;
    }

    /// Brings the fans of joined patches together and lays the unions flat; `joined` names each patch's union by one of its
    /// members.
    fn join(&mut self, patches: Vec<Patch>, joined: &[u32]) -> Vec<Patch> {
        let mut members: Vec<(u32, u32)> = joined.iter().copied().zip(0..).collect();
        members.sort_unstable();
        let mut unions: Vec<&[(u32, u32)]> = members.chunk_by(|a, b| a.0 == b.0).collect();
        unions.sort_unstable_by_key(|union| union[0].1);
        let mut items = Vec::with_capacity(self.items.len());
        let mut kept = Vec::new();
        let mut pieces = Vec::new();
        for union in unions {
            let start = items.len() as u32;
            for &(_, p) in union {
                let patch = &patches[p as usize];
                items.extend_from_slice(
                    &self.items[patch.start as usize..(patch.start + patch.length) as usize],
                );
            }
            if let &[(_, p)] = union {
                kept.push(Patch { start, ..patches[p as usize].clone() });
            } else {
                pieces.push((start, items.len() as u32 - start));
            }
        }
        self.items = items;
        kept.extend(self.flatten(Pieces(pieces)));
        kept.sort_unstable_by_key(|p| p.start);
        kept
    }
}

/// The facing cosine that a group must keep: the one asked for, or somewhat less than what its steepest fan reaches alone.
/// Without the latter no two corners of a box could share a tile.
pub(crate) fn facing_limit(asked: f32, steepest_fan: f32) -> f32 {
    asked.min(0.8 * steepest_fan)
}

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    flattener: Flattener,
    fans: Vec<u32>,
}
