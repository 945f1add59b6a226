//! Whether sectors of one asset fit together where they meet.

use std::collections::{HashMap, HashSet};

use fantex_mesh::{Edge, Edges, HardAngle, Mesh, SurfacePoint, WorldFromMesh};
use fantex_store::{PageCache, TileId, TileSource, TileTexels, jump};
use glam::{DVec3, Vec3, Vec4};
use rayon::prelude::*;

/// The places of the ends of an edge in the world, ascending, as bits.
type Ends = [[u64; 3]; 2];

/// A border edge: what sectors of one asset have in common (mesh space, blend band, density), as bits, and its ends.
type SeamKey = ([u64; 6], Ends);

/// What a sector has at a border edge.
struct SeamSide {
    /// The texture function along it: per point and channel.
    values: Vec<Vec4>,
    /// The triangle's normal, and whether it runs from the first end to the second.
    facet: (DVec3, bool),
    /// See [`Cover::hard_edges`](fantex_cover::Cover::hard_edges).
    hard_edges: Option<f32>,
}

/// Where points lie along an edge: in the middle of the blend band, and on both sides of it.
const SEAM_POINTS: [f32; 5] = [0.02, 0.3, 0.5, 0.7, 0.98];

/// Border edges that wait for their other side.
#[derive(Default)]
pub(super) struct Seams {
    open: HashMap<SeamKey, (usize, SeamSide)>,
    /// Whether edges that had two sides are remembered.
    keeps_meetings: bool,
    /// Those edges, and the objects on both sides.
    meetings: Vec<(Ends, [usize; 2])>,
    pub(super) edges: u64,
    pub(super) largest_jump: f32,
    pub(super) worst: Option<[usize; 2]>,
}

impl Seams {
    pub(super) fn new(keeps_meetings: bool) -> Self {
        Self { keeps_meetings, ..Self::default() }
    }

    pub(super) fn add(&mut self, object: usize, cache: &PageCache) {
        let mesh = cache.asset().mesh();
        let edges = Edges::of(&mesh.triangles);
        let borders = edges.iter().filter(|edge| edge.triangle_count() == 1);
        let sides: Vec<(u32, [u32; 2])> =
            borders.filter_map(|edge| Some((edge.triangles().next()?.0, edge.vertices()))).collect();
        let sides: Vec<(SeamKey, SeamSide)> =
            sides.into_par_iter().map(|(triangle, ends)| seam_side(cache, triangle, ends)).collect();
        for (key, side) in sides {
            match self.open.remove(&key) {
                Some((other, seen)) if other != object => {
                    if self.keeps_meetings {
                        self.meetings.push((key.1, [other, object]));
                    }
                    if !are_apart(&seen, &side) {
                        self.compare([other, object], &seen.values, &side.values);
                    }
                }
                Some(twice) => drop(self.open.insert(key, twice)),
                None => drop(self.open.insert(key, (object, side))),
            }
        }
    }

    fn compare(&mut self, objects: [usize; 2], a: &[Vec4], b: &[Vec4]) {
        self.edges += 1;
        let largest = match a.len() == b.len() {
            true => a.iter().zip(b).map(|(a, b)| jump(a.to_array(), b.to_array())).fold(0.0, f32::max),
            // Other channels.
            false => f32::INFINITY,
        };
        if largest > self.largest_jump {
            (self.largest_jump, self.worst) = (largest, Some(objects));
        }
    }

    /// How many edges a mesh lacks that stands for some of the objects: those at which one of them meets another one, which do not end
    /// at the outline of all objects.
    pub(super) fn missing(&self, mesh: &Mesh, stands_for: &[bool]) -> usize {
        let at_outline: HashSet<[u64; 3]> = self.open.keys().flat_map(|(_, ends)| *ends).collect();
        let space = mesh.world_from_mesh;
        let places: Vec<[u64; 3]> = mesh.positions.iter().map(|&p| place(&space, p)).collect();
        let ends = |edge: Edge<'_>| sorted(edge.vertices().map(|vertex| places[vertex as usize]));
        let own: HashSet<Ends> = Edges::of(&mesh.triangles).iter().map(ends).collect();
        let is_border = |[a, b]: [usize; 2]| stands_for[a] != stands_for[b];
        let borders = self.meetings.iter().filter(|(_, objects)| is_border(*objects));
        let inner = borders.filter(|(ends, _)| !ends.iter().any(|end| at_outline.contains(end)));
        inner.filter(|(ends, _)| !own.contains(ends)).count()
    }
}

/// A place in the world, to the last bit.
fn place(space: &WorldFromMesh, p: Vec3) -> [u64; 3] {
    // Adding zero makes -0 and 0 the same.
    space.point(p).to_array().map(|x| (x + 0.0).to_bits())
}

fn sorted(mut ends: Ends) -> Ends {
    ends.sort_unstable();
    ends
}

/// Whether the sectors' whole was cut there, at a hard edge.
fn are_apart(a: &SeamSide, b: &SeamSide) -> bool {
    a.hard_edges.is_some_and(|degrees| HardAngle::new(degrees).is_reached([a.facet, b.facet]))
}

fn seam_side(cache: &PageCache, triangle: u32, ends: [u32; 2]) -> (SeamKey, SeamSide) {
    let asset = cache.asset();
    let (mesh, cover) = (asset.mesh(), asset.cover());
    let space = mesh.world_from_mesh;
    let mut ends = ends.map(|vertex| (place(&space, mesh.positions[vertex as usize]), vertex));
    ends.sort_unstable();
    let corners = mesh.triangles[triangle as usize];
    let slots = ends.map(|(_, vertex)| corners.iter().position(|&corner| corner == vertex).unwrap_or(0));
    let mut values = Vec::new();
    for s in SEAM_POINTS {
        let mut lambda = Vec3::ZERO;
        lambda[slots[0]] = 1.0 - s;
        lambda[slots[1]] = s;
        for channel in 0..asset.channels().len() {
            let value = cover.taps(mesh, SurfacePoint { triangle, lambda }).map(|tap| {
                let tile = cache.tile(channel, TileId { group: tap.group, level: 0 });
                Vec4::from(tile.bilinear(tap.uv)) * tap.weight
            });
            values.push(value.sum());
        }
    }
    let [x, y, z] = space.offset.to_array().map(f64::to_bits);
    let common =
        [x, y, z, space.scale.to_bits(), cover.delta.to_bits().into(), cover.density.to_bits().into()];
    let facet = (mesh.facet_normal(triangle as usize), (slots[0] + 1) % 3 == slots[1]);
    let side = SeamSide { values, facet, hard_edges: cover.hard_edges };
    ((common, ends.map(|(place, _)| place)), side)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_on_one_side_of_a_seam_only_is_a_jump() {
        let jump_between = |a: f32, b: f32| {
            let mut seams = Seams::default();
            seams.compare([0, 1], &[Vec4::splat(a)], &[Vec4::new(a, a, a, b)]);
            (seams.largest_jump, seams.worst)
        };
        assert_eq!(jump_between(0.25, 0.25), (0.0, None));
        assert_eq!(jump_between(0.25, 0.75), (0.5, Some([0, 1])));
        assert_eq!(jump_between(0.25, f32::NAN), (1.0, Some([0, 1])));
        assert_eq!(jump_between(f32::NAN, f32::NAN), (0.0, None));
    }
}
