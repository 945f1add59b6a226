//! From fans to groups that are laid flat.

use fantex_mesh::Fans;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::Frame;
use crate::build::NominalDensity;
use crate::cost::Region;
use crate::fan_shape::{FanShape, Layout};
use crate::flatten::{Flat, FlatLimits, Flattener, Laid, Membership, unfolded_rectangle};
use crate::merge::{MergeLimits, choose_unions};
use crate::partition::{Connector, Cutting, Item, partition};
use crate::rectangle::{Rectangle, RectangleFinder};
use crate::surface::{Ring, Surface};

/// How groups may grow.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroupLimits {
    pub(crate) delta: f32,
    /// Target tile extent in texels.
    pub(crate) extent_texels: f32,
    /// Smallest cosine between a group's direction and its triangles' normals.
    pub(crate) facing: f32,
}

/// One group while the cover is built.
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    /// The group's fans are `order[start..start + length]`.
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
    fn fans<'a>(&self, order: &'a [u32]) -> &'a [u32] {
        &order[self.start as usize..(self.start + self.length) as usize]
    }

    fn laid(&self, order: &[u32], density: &NominalDensity<'_>) -> Laid {
        let Flat { frame, min, region, distortion, .. } = self.flat;
        let fan = order[self.start as usize];
        let factor = if density.is_total() {
            distortion.density(region.scaled(Vec2::splat(self.density)), self.density * self.density)
        } else {
            distortion.density_for_nominal()
        };
        let (density, pad) = (distortion.aspect() * factor * self.density, pad(self.density));
        Laid { frame, min, region, density, pad, fan, layout: self.layout, folds: false }
    }

    /// See [`cost`](crate::cost).
    pub(crate) fn cost(&self) -> f32 {
        let region = self.flat.region.scaled(Vec2::splat(self.density));
        self.flat.distortion.cost(region, self.density * self.density)
    }
}

/// The filter margin of both sides, mesh units.
fn pad(density: f32) -> f32 {
    1.0 / density.max(f32::MIN_POSITIVE)
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
    items: Vec<Item>,
    density: &NominalDensity<'_>,
    limits: &GroupLimits,
) -> Grouping {
    let ways = if items.len() <= MAX_FANS_FOR_ALL_WAYS { WAYS.as_slice() } else { &WAYS[..1] };
    let (first, others) = ways.split_first().unwrap_or((&WAYS[0], &[]));
    let tried = others.iter().map(|&way| grouped(surface, shapes, items.clone(), density, limits, way));
    let tried: Vec<(f32, Grouping)> = tried.collect();
    let first = grouped(surface, shapes, items, density, limits, *first);
    tried.into_iter().fold(first, |best, next| if next.0 < best.0 { next } else { best }).1
}

/// Ways to cut: how much dearer parts may be, and whether long sets are cut between their normals. The first is best for nearly all
/// scans; which is best for a model of few large triangles is found by trying.
const WAYS: [(f32, f32); 4] = [(1.03, 768.0), (1.15, 768.0), (1.03, f32::INFINITY), (1.15, f32::INFINITY)];

/// On meshes with more fans only the first way is tried: on scans the others find nothing better, and take four times as long.
const MAX_FANS_FOR_ALL_WAYS: usize = 8_000;

/// The groups found in one way, and what they cost.
fn grouped(
    surface: &Surface<'_>,
    shapes: &[FanShape],
    mut items: Vec<Item>,
    density: &NominalDensity<'_>,
    limits: &GroupLimits,
    (tolerance, normals_below): (f32, f32),
) -> (f32, Grouping) {
    let cutting = Cutting { extent_texels: limits.extent_texels, tolerance, normals_below };
    let lengths = partition(&mut items, &cutting);
    let mut connector = Connector::new(&surface.fans, shapes);
    let (order, lengths) = connector.connect(&items, &lengths, limits.facing);
    drop(items);
    let fan_groups = vec![0; shapes.len()];
    let apart = surface.fans_across_creases();
    let mut builder =
        Builder { surface, shapes, density, limits, connector, order, fan_groups, unused_label: 0, apart };
    let mut patches = builder.flatten(Pieces::consecutive(lengths));
    builder.number_groups(&patches);
    let merge_limits = MergeLimits { extent_texels: limits.extent_texels, facing: limits.facing };
    for _ in 0..JOIN_ROUNDS {
        let joined = choose_unions(&surface.fans, &patches, &builder.fan_groups, &merge_limits);
        let before = patches.len();
        patches = builder.join(patches, &joined);
        builder.number_groups(&patches);
        if patches.len() as f32 > 0.995 * before as f32 {
            break;
        }
    }
    builder.unfold_lone_fans(&mut patches);
    let laid = patches.iter().map(|patch| patch.laid(&builder.order, density)).collect();
    let cost = patches.iter().map(Patch::cost).sum();
    (cost, Grouping { laid, fan_groups: builder.fan_groups })
}

/// Unions are chosen by summaries and then laid flat; so many times.
const JOIN_ROUNDS: usize = 4;

/// Runs of the order, `(start, length)`.
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

/// The state while patches are laid flat, halved and joined. Every patch is a run of `order`.
struct Builder<'a> {
    surface: &'a Surface<'a>,
    shapes: &'a [FanShape],
    density: &'a NominalDensity<'a>,
    limits: &'a GroupLimits,
    connector: Connector<'a>,
    /// All fans.
    order: Vec<u32>,
    /// A label per fan; equal in one patch, different in different patches.
    fan_groups: Vec<u32>,
    /// Labels from here on are not in use.
    unused_label: u32,
    /// Pairs of fans that must not share a tile, both ways around, ascending.
    apart: Vec<(u32, u32)>,
}

impl Builder<'_> {
    /// Lays every piece flat, halving those that cannot share a projection until all can. Ascending by start.
    fn flatten(&mut self, pieces: Pieces) -> Vec<Patch> {
        let mut patches: Vec<Patch> = Vec::new();
        let mut pending = pieces.0;
        while !pending.is_empty() {
            let first_label = self.unused_label;
            for (&(start, length), label) in pending.iter().zip(first_label..) {
                for &fan in &self.order[start as usize..(start + length) as usize] {
                    self.fan_groups[fan as usize] = label;
                }
            }
            let flats: Vec<Option<Patch>> = pending
                .par_iter()
                .enumerate()
                .map_init(Flattener::default, |flattener, (i, &(start, length))| {
                    self.flatten_piece(start, length, first_label + i as u32, flattener)
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

    fn flatten_piece(&self, start: u32, length: u32, group: u32, flattener: &mut Flattener) -> Option<Patch> {
        let fans = &self.order[start as usize..(start + length) as usize];
        let (mut area, mut weighted, mut steepest_fan) = (0.0, 0.0, 1.0f32);
        for &fan in fans {
            let shape = &self.shapes[fan as usize];
            area += shape.area;
            weighted += shape.area * self.density.of_fan(self.surface, fan as usize);
            steepest_fan = steepest_fan.min(shape.cone.cos);
        }
        let first = fans[0] as usize;
        let density = if area > 0.0 { weighted / area } else { self.density.of_fan(self.surface, first) };
        let must_part = |&fan: &u32| {
            let from = self.apart.partition_point(|pair| pair.0 < fan);
            let mut others = self.apart[from..].iter().take_while(|pair| pair.0 == fan);
            others.any(|pair| self.fan_groups[pair.1 as usize] == group)
        };
        if !self.apart.is_empty() && fans.iter().any(must_part) {
            return None;
        }
        let membership = Membership { fan_groups: &self.fan_groups, group };
        let limits = FlatLimits {
            delta: self.limits.delta,
            pad: pad(density),
            facing: facing_limit(self.limits.facing, steepest_fan),
        };
        let shape = &self.shapes[first];
        let flat = if shape.layout == Layout::Unfolded {
            flattener.unfold(self.surface, fans[0], shape.cone, &limits)?
        } else if fans.len() == 1 {
            flattener.project_fan(self.surface, first, shape.cone, &limits)
        } else {
            flattener.project(self.surface, fans, membership, &limits)?
        };
        Some(Patch { start, length, flat, layout: shape.layout, density, steepest_fan })
    }

    /// Cuts a piece in two, and each half into connected components.
    fn halve(&mut self, (start, length): (u32, u32)) -> Vec<(u32, u32)> {
        let fans = &mut self.order[start as usize..(start + length) as usize];
        let halves = halve_by_length(self.surface, fans);
        let parts = self.connector.separate(&mut self.order, start as usize, &halves);
        Pieces::consecutive(parts).0.into_iter().map(|(at, n)| (start + at, n)).collect()
    }

    /// Makes `fan_groups` agree with the order of the patches.
    fn number_groups(&mut self, patches: &[Patch]) {
        for (patch, group) in patches.iter().zip(0..) {
            for &fan in patch.fans(&self.order) {
                self.fan_groups[fan as usize] = group;
            }
        }
        self.unused_label = patches.len() as u32;
    }

    /// Brings the fans of joined patches together and lays the unions flat; those that cannot be, or cost more than their members, are
    /// undone. `joined` names each patch's union by one of its members.
    fn join(&mut self, patches: Vec<Patch>, joined: &[u32]) -> Vec<Patch> {
        let mut members: Vec<(u32, u32)> = joined.iter().copied().zip(0..).collect();
        members.sort_unstable();
        let mut unions: Vec<&[(u32, u32)]> = members.chunk_by(|a, b| a.0 == b.0).collect();
        unions.sort_unstable_by_key(|union| union[0].1);
        let mut order = Vec::with_capacity(self.order.len());
        let mut starts = Vec::with_capacity(unions.len());
        for union in &unions {
            starts.push(order.len() as u32);
            for &(_, p) in *union {
                order.extend_from_slice(patches[p as usize].fans(&self.order));
            }
        }
        self.order = order;
        let ends = starts.iter().copied().skip(1).chain([self.order.len() as u32]);
        let runs: Vec<(u32, u32)> = starts.iter().copied().zip(ends).collect();
        for (&(start, end), label) in runs.iter().zip(self.unused_label..) {
            for &fan in &self.order[start as usize..end as usize] {
                self.fan_groups[fan as usize] = label;
            }
        }
        let first_label = self.unused_label;
        self.unused_label += runs.len() as u32;
        let laid: Vec<Option<Patch>> = (0..runs.len())
            .into_par_iter()
            .map_init(Flattener::default, |flattener, i| {
                if unions[i].len() < 2 {
                    return None;
                }
                let (start, end) = runs[i];
                let union = self.flatten_piece(start, end - start, first_label + i as u32, flattener)?;
                let apart: f32 = unions[i].iter().map(|&(_, p)| patches[p as usize].cost()).sum();
                (union.cost() < apart).then_some(union)
            })
            .collect();
        let mut kept = Vec::with_capacity(patches.len());
        for ((union, laid), &(mut start, _)) in unions.iter().zip(laid).zip(&runs) {
            match laid {
                Some(patch) => kept.push(patch),
                None => {
                    for &(_, p) in *union {
                        let patch = &patches[p as usize];
                        kept.push(Patch { start, ..patch.clone() });
                        start += patch.length;
                    }
                }
            }
        }
        kept
    }

    /// Unfolds fans that are alone in their group where that costs less than projecting them.
    fn unfold_lone_fans(&self, patches: &mut [Patch]) {
        patches.par_iter_mut().filter(|p| p.length == 1 && p.layout == Layout::Projected).for_each_init(
            Flattener::default,
            |flattener, patch| {
                let fan = patch.fans(&self.order)[0];
                let limits = FlatLimits { delta: self.limits.delta, pad: pad(patch.density), facing: 0.0 };
                let cone = self.shapes[fan as usize].cone;
                let Some(flat) = flattener.unfold(self.surface, fan, cone, &limits) else { return };
                let unfolded = Patch { flat, layout: Layout::Unfolded, ..patch.clone() };
                if unfolded.cost() < UNFOLDED_WORTH * patch.cost() {
                    *patch = unfolded;
                }
            },
        );
    }
}

/// Unfolding must make a fan's tile cheaper by this factor: its coordinates are stored per corner.
const UNFOLDED_WORTH: f32 = 0.97;

/// The facing cosine that a group must keep: the one asked for, or somewhat less than what its steepest fan reaches alone.
/// Without the latter no two corners of a box could share a tile.
pub(crate) fn facing_limit(asked: f32, steepest_fan: f32) -> f32 {
    asked.min(0.8 * steepest_fan)
}

/// Cuts a patch that turned out invalid into two by rank along its longest extent; returns the halves' lengths.
fn halve_by_length(surface: &Surface<'_>, fans: &mut [u32]) -> [u32; 2] {
    let center = |fan: u32| surface.fan_center(fan as usize);
    let (low, high) = fans
        .iter()
        .map(|&fan| center(fan))
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    let axis = (high - low).max_position();
    fans.sort_by(|&a, &b| center(a)[axis].total_cmp(&center(b)[axis]).then(a.cmp(&b)));
    let middle = fans.len() / 2;
    [middle as u32, (fans.len() - middle) as u32]
}

// One fan per tile: every fan is classified and laid flat in one pass.
//
// Fans are visited along a space-filling curve, which is the order of the tiles, and everything about a fan is derived from
// one gathering of its ring while that is in the first cache.

/// Lays every fan flat, in the order of a Morton curve.
pub(crate) fn lay_fans(surface: &Surface<'_>, density: &NominalDensity<'_>, delta: f32) -> Vec<Laid> {
    let curve = curve(surface);
    curve
        .par_iter()
        .with_min_len(1 << 10)
        .map_init(Layer::default, |layer, &key| {
            let fan = key as u32;
            layer.lay(surface, fan, density.of_fan(surface, fan as usize), delta)
        })
        .collect()
}

/// The group of each fan, where every group is one fan.
pub(crate) fn fan_groups(fans: &Fans, laid: &[Laid]) -> Vec<u32> {
    let mut groups = vec![0; fans.len()];
    for (group, laid) in (0..).zip(laid) {
        groups[laid.fan as usize] = group;
    }
    groups
}

/// All fans along a Morton curve through mesh space, 10 bits per axis: the place on the curve above, the fan below.
fn curve(surface: &Surface<'_>) -> Vec<u64> {
    let spread = |x: f32| {
        let mut bits = ((x + 1.0) * 511.5) as u32 & 1023;
        bits = (bits | bits << 16) & 0x0300_00ff;
        bits = (bits | bits << 8) & 0x0300_f00f;
        bits = (bits | bits << 4) & 0x030c_30c3;
        (bits | bits << 2) & 0x0924_9249
    };
    let key = |fan: usize| {
        let [x, y, z] = surface.fan_center(fan).to_array().map(spread);
        u64::from(x | y << 1 | z << 2) << 32 | fan as u64
    };
    let mut keys: Vec<u64> = (0..surface.fans.len()).into_par_iter().with_min_len(1 << 12).map(key).collect();
    keys.par_sort_unstable();
    keys
}

/// Lays single fans flat. Keeps its buffers.
#[derive(Default)]
struct Layer {
    ring: Ring,
    spokes: Vec<Vec2>,
    outline: Vec<Vec2>,
    rectangles: RectangleFinder,
}

impl Layer {
    fn lay(&mut self, surface: &Surface<'_>, fan: u32, density: f32, delta: f32) -> Laid {
        self.ring.gather(surface, fan as usize);
        let FanShape { layout, cone, folds, .. } = FanShape::of(&self.ring, surface, fan as usize);
        let pad = pad(density);
        let (x, y) = cone.axis.any_orthonormal_pair();
        let (rectangle, x_axis) = match layout {
            Layout::Projected => {
                self.outline(x, y, delta);
                let r = self.rectangles.smallest_around_star(&self.outline, pad);
                (r, (x * r.x_axis.x + y * r.x_axis.y).normalize())
            }
            Layout::Unfolded => {
                let unfolded = unfolded_rectangle(surface, fan as usize, delta, pad, &mut self.rectangles);
                (unfolded.map_or(Rectangle::POINT, |u| u.0), x)
            }
        };
        let frame = Frame { origin: self.ring.center, direction: cone.axis, x_axis };
        let (min, size, density) = (rectangle.min, rectangle.size, Vec2::splat(density));
        let region = Region { size, area: size.x * size.y, outline: 2.0 * (size.x + size.y) };
        Laid { frame, min, region, density, pad, fan, layout, folds }
    }

    /// The outline of the projected partial fan, counter-clockwise: see `outline_points`.
    fn outline(&mut self, x: Vec3, y: Vec3, delta: f32) {
        let (along_spoke, between) = (0.5 + 0.5 * delta, (1.0 + delta) / 3.0);
        self.spokes.clear();
        self.spokes.extend(self.ring.spokes.iter().map(|s| Vec2::new(s.dot(x), s.dot(y))));
        self.outline.clear();
        if !self.ring.closed {
            self.outline.push(Vec2::ZERO);
        }
        for pair in self.spokes.windows(2) {
            self.outline.push(pair[0] * along_spoke);
            self.outline.push((pair[0] + pair[1]) * between);
        }
        if !self.ring.closed
            && let Some(&last) = self.spokes.last()
        {
            self.outline.push(last * along_spoke);
        }
    }
}
