//! Polygonising a density by marching tetrahedra: the surface is a manifold whatever the density does.
//!
//! Every lattice cube is cut into the six tetrahedra around its main diagonal (H. W. Kuhn, "Some combinatorial lemmas in
//! topology", 1960), the same way everywhere, so faces of neighbouring cubes match. A tetrahedron's corners are either
//! inside or outside (never on) the surface, which therefore crosses it in one triangle or one quadrilateral, and the
//! whole is a closed manifold (A. Doi and A. Koide, "An efficient method of triangulating equi-valued surfaces by using
//! tetrahedral cells", 1991).
//!
//! The lattice is worked through in chunks that follow the surface: a chunk is looked at if a coarse sampling or a
//! neighbour's border face finds a change of sign there. So no part of a found surface is ever missing, and time and
//! memory grow with the surface, not with the volume.

use std::collections::{BTreeMap, BTreeSet};

use glam::{UVec3, Vec3};
use rayon::prelude::*;

use super::landscape::Noise;
use crate::{VertexCorners, unit_vector};

const CHUNK: u32 = 16;
/// Lattice points per side of a chunk, borders included.
const SIDE: u32 = CHUNK + 1;
/// Every so many-th lattice point is sampled to find where the surface is.
const SAMPLED: u32 = 4;
/// A world of no more chunks than this is looked at whole.
const FEW_CHUNKS: u32 = 64;
/// Crossings keep this share of an edge's length away from its ends: no slivers, no coinciding vertices.
const MARGIN: f32 = 0.08;

#[derive(Clone, Copy, Debug)]
pub(super) struct Lattice {
    /// Position of point (0, 0, 0), metres.
    pub(super) origin: Vec3,
    pub(super) step: f32,
    /// Number of cubes along each axis. The surface must not reach the lattice's border.
    pub(super) cubes: UVec3,
}

impl Lattice {
    pub(super) fn point(&self, index: UVec3) -> Vec3 {
        self.origin + index.as_vec3() * self.step
    }

    fn chunks(&self) -> UVec3 {
        (self.cubes + CHUNK - 1) / CHUNK
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct Surface {
    pub(super) positions: Vec<Vec3>,
    /// Counter-clockwise seen from outside (from where the density is negative).
    pub(super) triangles: Vec<[u32; 3]>,
}

/// The surface `density = 0` of a solid where `density > 0`, as far as it hangs together with what a sampling of every
/// [`SAMPLED`]th lattice point finds.
pub(super) fn polygonise(lattice: &Lattice, density: impl Fn(Vec3) -> f32 + Sync) -> Surface {
    let marching = Marching { lattice: *lattice, density, cases: cases() };
    let mut frontier = marching.seeds();
    let mut seen: BTreeSet<[u32; 3]> = frontier.iter().copied().collect();
    let mut chunks = BTreeMap::new();
    while !frontier.is_empty() {
        let done: Vec<([u32; 3], Chunk)> = frontier.par_iter().map(|&c| (c, marching.chunk(c))).collect();
        frontier = done.iter().flat_map(|(c, chunk)| marching.neighbours(*c, chunk)).collect();
        frontier.sort_unstable();
        frontier.dedup();
        frontier.retain(|&c| seen.insert(c));
        chunks.extend(done.into_iter().filter(|(_, chunk)| !chunk.triangles.is_empty()));
    }
    stitch(&chunks)
}

#[derive(Default)]
struct Chunk {
    /// Lattice edge of every vertex: global index of its lower point times 8 plus direction; ascending among the
    /// chunk's own vertices, which come first.
    keys: Vec<u64>,
    positions: Vec<Vec3>,
    /// The first so many vertices start at a lattice point of this chunk; the others belong to neighbours.
    own: usize,
    triangles: Vec<[u32; 3]>,
    /// The surface crosses the faces at low x, y, z, high x, y, z.
    crossed_faces: [bool; 6],
}

/// For each of the 16 sign patterns (bit `i`: corner `i` inside) of a positively oriented tetrahedron the polygon of
/// crossed edges, as corner pairs (inside, outside), counter-clockwise seen from outside.
type Cases = Vec<Vec<[usize; 2]>>;

struct Marching<D> {
    lattice: Lattice,
    density: D,
    cases: Cases,
}

impl<D: Fn(Vec3) -> f32 + Sync> Marching<D> {
    /// Chunks in which a sampling of every fourth point finds both signs; all where there are few.
    fn seeds(&self) -> Vec<[u32; 3]> {
        let chunks = self.lattice.chunks();
        let all = (0..chunks.element_product())
            .into_par_iter()
            .map(|i| [i % chunks.x, i / chunks.x % chunks.y, i / (chunks.x * chunks.y)]);
        let is_small = chunks.element_product() <= FEW_CHUNKS;
        all.filter(|&c| {
            let base = UVec3::from(c) * CHUNK;
            let side = CHUNK / SAMPLED + 1;
            let sample = |i: u32| {
                let offset = UVec3::new(i % side, i / side % side, i / (side * side)) * SAMPLED;
                self.value(base + offset) > 0.0
            };
            let first = sample(0);
            is_small || (1..side.pow(3)).any(|i| sample(i) != first)
        })
        .collect()
    }

    /// The density at a lattice point, nudged away from zero.
    fn value(&self, index: UVec3) -> f32 {
        let d = (self.density)(self.lattice.point(index));
        let least = 1e-5 * self.lattice.step;
        if d.abs() < least { least } else { d }
    }

    /// Neighbours across the faces that the surface crosses.
    fn neighbours(&self, chunk: [u32; 3], content: &Chunk) -> Vec<[u32; 3]> {
        let chunks = self.lattice.chunks().to_array();
        let mut found = Vec::new();
        for axis in 0..3 {
            if content.crossed_faces[axis] && chunk[axis] > 0 {
                found.push(chunk);
                found.last_mut().into_iter().for_each(|c| c[axis] -= 1);
            }
            if content.crossed_faces[3 + axis] && chunk[axis] + 1 < chunks[axis] {
                found.push(chunk);
                found.last_mut().into_iter().for_each(|c| c[axis] += 1);
            }
        }
        found
    }

    fn chunk(&self, chunk: [u32; 3]) -> Chunk {
        let base = UVec3::from(chunk) * CHUNK;
        let values: Vec<f32> = (0..SIDE.pow(3)).map(|i| self.value(base + unpack(i))).collect();
        let first = values[0] > 0.0;
        if values.iter().all(|&v| (v > 0.0) == first) {
            return Chunk::default();
        }
        let mut builder = Builder {
            lattice: &self.lattice,
            base,
            values: &values,
            vertices: vec![u32::MAX; 8 * values.len()],
            chunk: Chunk { crossed_faces: crossed_faces(&values), ..Chunk::default() },
        };
        for cube in 0..CHUNK.pow(3) {
            let low = UVec3::new(cube % CHUNK, cube / CHUNK % CHUNK, cube / (CHUNK * CHUNK));
            builder.cube(low, &self.cases);
        }
        builder.finish()
    }
}

struct Builder<'a> {
    lattice: &'a Lattice,
    base: UVec3,
    values: &'a [f32],
    /// Vertex on each lattice edge: `8 * lower point + direction`.
    vertices: Vec<u32>,
    chunk: Chunk,
}

impl Builder<'_> {
    fn cube(&mut self, low: UVec3, cases: &Cases) {
        let corner = |bits: u32| pack(low + UVec3::new(bits & 1, bits >> 1 & 1, bits >> 2));
        let inside: u32 = (0..8).map(|b| u32::from(self.values[corner(b) as usize] > 0.0) << b).sum();
        if inside == 0 || inside == 255 {
            return;
        }
        // The tetrahedra follow the paths along the axes from corner 000 to corner 111; odd orders are mirrored.
        for (path, is_mirrored) in [
            ([1, 3], false),
            ([2, 6], false),
            ([4, 5], false),
            ([1, 5], true),
            ([2, 3], true),
            ([4, 6], true),
        ] {
            let bits = [0, path[0], path[1], 7];
            let mask: usize = (0..4).map(|i| ((inside >> bits[i] & 1) as usize) << i).sum();
            let polygon = &cases[mask];
            let mut points = [0; 4];
            for (point, &[a, b]) in points.iter_mut().zip(polygon) {
                let (lower, upper) = (bits[a].min(bits[b]), bits[a].max(bits[b]));
                *point = self.vertex(corner(lower), corner(upper), upper ^ lower);
            }
            match polygon.len() {
                3 => self.triangle([points[0], points[1], points[2]], is_mirrored),
                4 => self.quadrilateral(points, is_mirrored),
                _ => {}
            }
        }
    }

    /// Cuts along the shorter diagonal.
    fn quadrilateral(&mut self, [a, b, c, d]: [u32; 4], is_mirrored: bool) {
        let p = |v: u32| self.chunk.positions[v as usize];
        if p(a).distance_squared(p(c)) <= p(b).distance_squared(p(d)) {
            self.triangle([a, b, c], is_mirrored);
            self.triangle([a, c, d], is_mirrored);
        } else {
            self.triangle([a, b, d], is_mirrored);
            self.triangle([b, c, d], is_mirrored);
        }
    }

    fn triangle(&mut self, [a, b, c]: [u32; 3], is_mirrored: bool) {
        self.chunk.triangles.push(if is_mirrored { [a, c, b] } else { [a, b, c] });
    }

    /// The vertex on the edge between two points of the chunk, `direction` being the bits in which they differ.
    fn vertex(&mut self, lower: u32, upper: u32, direction: u32) -> u32 {
        let slot = (8 * lower + direction) as usize;
        if self.vertices[slot] == u32::MAX {
            let (d0, d1) = (self.values[lower as usize], self.values[upper as usize]);
            let t = (d0 / (d0 - d1)).clamp(MARGIN, 1.0 - MARGIN);
            let [p0, p1] = [lower, upper].map(|i| self.lattice.point(self.base + unpack(i)));
            self.vertices[slot] = self.chunk.positions.len() as u32;
            self.chunk.positions.push(p0 + (p1 - p0) * t);
            self.chunk.keys.push(self.key(lower, direction));
        }
        self.vertices[slot]
    }

    fn key(&self, lower: u32, direction: u32) -> u64 {
        let [x, y, z] = (self.base + unpack(lower)).to_array().map(u64::from);
        ((z << 40 | y << 20 | x) << 3) | u64::from(direction)
    }

    /// Sorts the vertices by key, the chunk's own first.
    fn finish(self) -> Chunk {
        let Self { mut chunk, base, .. } = self;
        let owner = base / CHUNK;
        let mut order: Vec<u32> = (0..chunk.keys.len() as u32).collect();
        let is_foreign = |key: u64| chunk_of(key) != owner.to_array();
        order.sort_unstable_by_key(|&v| (is_foreign(chunk.keys[v as usize]), chunk.keys[v as usize]));
        let mut rank = vec![0; order.len()];
        order.iter().enumerate().for_each(|(r, &v)| rank[v as usize] = r as u32);
        chunk.own = chunk.keys.iter().filter(|&&key| !is_foreign(key)).count();
        chunk.keys = order.iter().map(|&v| chunk.keys[v as usize]).collect();
        chunk.positions = order.iter().map(|&v| chunk.positions[v as usize]).collect();
        chunk.triangles.iter_mut().for_each(|t| *t = t.map(|v| rank[v as usize]));
        chunk
    }
}

/// Joins the chunks: every vertex is taken from the chunk that owns it.
fn stitch(chunks: &BTreeMap<[u32; 3], Chunk>) -> Surface {
    let mut sum = 0;
    let starts: BTreeMap<[u32; 3], u32> = chunks
        .iter()
        .map(|(&c, chunk)| {
            let start = sum;
            sum += chunk.own as u32;
            (c, start)
        })
        .collect();
    let parts: Vec<(&[u32; 3], &Chunk)> = chunks.iter().collect();
    let global = |&(c, chunk): &(&[u32; 3], &Chunk)| -> Vec<u32> {
        let own = (0..chunk.own as u32).map(|v| starts[c] + v);
        let foreign = chunk.keys[chunk.own..].iter().map(|&key| {
            let owner = chunk_of(key);
            let keys = &chunks[&owner].keys[..chunks[&owner].own];
            starts[&owner] + keys.partition_point(|&k| k < key) as u32
        });
        own.chain(foreign).collect()
    };
    let triangles = parts
        .par_iter()
        .map(|part| {
            let index = global(part);
            part.1.triangles.iter().map(|t| t.map(|v| index[v as usize])).collect::<Vec<_>>()
        })
        .flatten_iter()
        .collect();
    Surface { positions: parts.iter().flat_map(|(_, c)| &c.positions[..c.own]).copied().collect(), triangles }
}

fn crossed_faces(values: &[f32]) -> [bool; 6] {
    std::array::from_fn(|face| {
        let level = if face < 3 { 0 } else { CHUNK };
        let on_face = (0..SIDE * SIDE).map(|i| {
            let mut index = [i % SIDE, i / SIDE, level];
            index.rotate_left((5 - face % 3) % 3);
            values[pack(UVec3::from(index)) as usize] > 0.0
        });
        let count = on_face.filter(|&inside| inside).count() as u32;
        count > 0 && count < SIDE * SIDE
    })
}

fn chunk_of(key: u64) -> [u32; 3] {
    let point = key >> 3;
    [point, point >> 20, point >> 40].map(|v| (v & 0xf_ffff) as u32 / CHUNK)
}

fn pack(index: UVec3) -> u32 {
    (index.z * SIDE + index.y) * SIDE + index.x
}

fn unpack(index: u32) -> UVec3 {
    UVec3::new(index % SIDE, index / SIDE % SIDE, index / (SIDE * SIDE))
}

fn cases() -> Cases {
    (0..16_u32)
        .map(|mask| {
            let (inside, outside): (Vec<usize>, Vec<usize>) = (0..4).partition(|&i| mask >> i & 1 == 1);
            let mut order = [inside.clone(), outside.clone()].concat();
            if is_odd(&order) {
                let pair = if outside.len() >= 2 { 2 } else { 0 };
                order.swap(pair, pair + 1);
            }
            let [a, b, c, d] = [order[0], order[1], order[2], order[3]];
            match inside.len() {
                1 => vec![[a, b], [a, c], [a, d]],
                2 => vec![[a, c], [a, d], [b, d], [b, c]],
                3 => vec![[a, d], [b, d], [c, d]],
                _ => Vec::new(),
            }
        })
        .collect()
}

/// True for a permutation that an odd number of exchanges makes.
fn is_odd(order: &[usize]) -> bool {
    let inversions = |i: usize| order[i + 1..].iter().filter(|&&later| later < order[i]).count();
    (0..order.len()).map(inversions).sum::<usize>() % 2 == 1
}

// Moving vertices along a surface: to even its triangles out, or to make them uneven.

/// Share of the way to the mean of the neighbours that one round moves a vertex.
const SHARE: f32 = 0.5;
const ROUNDS: u32 = 3;

/// Moves every vertex towards the mean of its neighbours within its tangent plane (tangential Laplacian smoothing), which
/// evens out the slivers of marching tetrahedra.
pub(super) fn relax(positions: &mut Vec<Vec3>, triangles: &[[u32; 3]], corners: &VertexCorners) {
    for _ in 0..ROUNDS {
        *positions = moved(positions, triangles, corners, |_, star| {
            star.p + SHARE * (star.pull - star.normal * star.pull.dot(star.normal))
        });
    }
}

/// Moves every vertex in a random direction within its tangent plane, at most `amount` (0..1) of a third of its shortest
/// edge: neighbours do not meet.
pub(super) fn scatter(
    positions: &mut Vec<Vec3>,
    triangles: &[[u32; 3]],
    corners: &VertexCorners,
    amount: f32,
) {
    let random = Noise::new(0, 40);
    *positions = moved(positions, triangles, corners, |v, star| {
        let (x, y) = star.normal.any_orthonormal_pair();
        let direction = unit_vector(std::f32::consts::TAU * random.uniform(2 * v as u32));
        let way = amount * star.shortest / 3.0 * random.uniform(2 * v as u32 + 1).sqrt();
        star.p + way * (x * direction.x + y * direction.y)
    });
}

struct Star {
    p: Vec3,
    normal: Vec3,
    /// To the mean of the neighbours.
    pull: Vec3,
    shortest: f32,
}

/// All vertices after `step`, which sees the positions before.
fn moved(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    corners: &VertexCorners,
    step: impl Fn(usize, Star) -> Vec3 + Sync,
) -> Vec<Vec3> {
    (0..positions.len())
        .into_par_iter()
        .with_min_len(1 << 12)
        .map(|v| step(v, star(positions[v], positions, triangles, corners.at(v))))
        .collect()
}

fn star(p: Vec3, positions: &[Vec3], triangles: &[[u32; 3]], corners: &[u32]) -> Star {
    let (mut normal, mut pull, mut shortest) = (Vec3::ZERO, Vec3::ZERO, f32::MAX);
    for &corner in corners {
        let (triangle, k) = (triangles[corner as usize / 3], corner as usize % 3);
        let [next, previous] = [1, 2].map(|i| positions[triangle[(k + i) % 3] as usize] - p);
        normal += next.cross(previous);
        pull += next;
        shortest = shortest.min(next.length());
    }
    Star {
        p,
        normal: normal.try_normalize().unwrap_or(Vec3::Y),
        pull: pull / corners.len().max(1) as f32,
        shortest,
    }
}

#[cfg(test)]
mod tests {
    use super::super::landscape::Noise;
    use super::*;
    use crate::{Topology, VertexCorners};

    /// A ball of the given radius filled with holes as small as the lattice can show.
    fn sponge(p: Vec3) -> f32 {
        let noise = Noise::new(9, 0);
        (14.0 - p.length()).min(3.0 * noise.at3(p / 2.3) + 0.6)
    }

    /// Every chunk, whether a sampling finds something in it or not.
    fn everything(lattice: Lattice, density: impl Fn(Vec3) -> f32 + Sync) -> Surface {
        let marching = Marching { lattice, density, cases: cases() };
        let chunks = lattice.chunks();
        let all = (0..chunks.element_product())
            .map(|i| [i % chunks.x, i / chunks.x % chunks.y, i / (chunks.x * chunks.y)]);
        stitch(&all.map(|c| (c, marching.chunk(c))).collect())
    }

    /// Euler characteristic of the tetrahedra's simplices with all corners inside: the solid's.
    fn euler_of_solid(lattice: Lattice) -> i64 {
        let marching = Marching { lattice, density: sponge, cases: cases() };
        let points = lattice.cubes + 1;
        let inside = |p: UVec3| p.cmplt(points).all() && marching.value(p) > 0.0;
        let step = |bits: u32| UVec3::new(bits & 1, bits >> 1 & 1, bits >> 2);
        // A simplex is a lattice point and a chain of growing bit sets: its corners' offsets.
        let mut chains: Vec<Vec<u32>> = vec![vec![]];
        for length in 1..4 {
            let longer: Vec<Vec<u32>> = chains
                .iter()
                .filter(|c| c.len() + 1 == length)
                .flat_map(|c| (1..8).map(move |b| [c.as_slice(), &[b]].concat()))
                .filter(|c| c.windows(2).all(|w| w[0] & w[1] == w[0] && w[0] != w[1]))
                .collect();
            chains.extend(longer);
        }
        let all = (0..points.element_product())
            .map(|i| UVec3::new(i % points.x, i / points.x % points.y, i / (points.x * points.y)));
        all.filter(|&p| inside(p))
            .flat_map(|p| chains.iter().filter(move |c| c.iter().all(|&b| inside(p + step(b)))))
            .map(|c| if c.len() % 2 == 0 { 1 } else { -1 })
            .sum()
    }

    #[test]
    fn a_sponge_is_a_closed_manifold_with_twice_the_solids_euler_characteristic() {
        let lattice = Lattice { origin: Vec3::splat(-16.2), step: 1.0, cubes: UVec3::splat(33) };
        let surface = everything(lattice, sponge);
        let topology =
            Topology::of(&surface.triangles, &VertexCorners::of(&surface.triangles, surface.positions.len()));
        assert!(topology.genus().is_some(), "{topology:?}");
        assert_eq!(topology.euler_characteristic(), 2 * euler_of_solid(lattice));
        assert!(topology.genus() > Some(50), "{topology:?}");
    }

    #[test]
    fn triangles_of_a_ball_face_the_outside() {
        let lattice = Lattice { origin: Vec3::splat(-5.3), step: 1.0, cubes: UVec3::splat(11) };
        let ball = everything(lattice, |p| 4.1 - p.length());
        assert!(ball.triangles.len() > 500);
        for [a, b, c] in ball.triangles.iter().map(|t| t.map(|v| ball.positions[v as usize])) {
            let normal = (b - a).cross(c - a).normalize();
            assert!(normal.dot((a + b + c).normalize()) > 0.0, "at {a}");
        }
    }

    #[test]
    fn following_the_surface_finds_what_looking_everywhere_finds() {
        let lattice = Lattice { origin: Vec3::splat(-16.2), step: 1.0, cubes: UVec3::splat(33) };
        let followed = polygonise(&lattice, |p| 14.0 - p.length());
        let looked = everything(lattice, |p| 14.0 - p.length());
        assert_eq!((followed.positions, followed.triangles), (looked.positions, looked.triangles));
    }
}
