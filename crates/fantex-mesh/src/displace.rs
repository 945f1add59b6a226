//! Displacement: `P' = P + h n`, as real geometry.
//!
//! The mesh is cut finer where that is needed ([`Refinement`]) and every vertex is moved along a normal that all triangles
//! around it share, by a height that they share, too: the mean of what the height function says at each of their corners. So
//! a surface without cracks stays without cracks, whatever the function does at texture seams and creases. The idea of
//! displacing a finely cut surface is that of R. Cook, "Shade Trees", 1984.

use std::collections::HashSet;

use fantex_base::{Aabb, Error, Result};
use glam::{DVec3, Vec3, Vec4};
use rayon::prelude::*;

use crate::normals::corner_angle;
use crate::{
    CREASE_DEGREES, CleanOptions, CleanReport, CornerAttributes, Mesh, Model, SurfacePoint, VertexCorners,
    clean, corner_normals, interpolate, shading_normals,
};

/// A point whose height is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplacePoint {
    /// Where on the mesh that is being cut. At vertices and on edges every triangle that lies there is asked.
    pub at: SurfacePoint,
    /// The same, mesh space.
    pub position: Vec3,
    /// Unit normal along which it will be displaced.
    pub normal: Vec3,
}

/// What was done.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DisplaceReport {
    /// How often edges were cut.
    pub rounds: u32,
    /// What had to be cleaned (triangles that collapsed, vertices that met), and the topology of the result.
    pub clean: CleanReport,
}

/// Cuts a mesh finer and moves its vertices along their normals by `height`, mesh units.
///
/// Attributes are interpolated over each original triangle; normals are computed anew and tangents dropped. Time and memory
/// are linear in the result's triangles, except that each round of cutting looks at all of them. The result does not depend
/// on the number of threads.
///
/// # Errors
/// An option out of range, more triangles than allowed, a height that is no number, or nothing left.
pub fn displace(
    mesh: &Mesh,
    options: &DisplaceOptions,
    height: impl Fn(&DisplacePoint) -> f32 + Sync,
) -> Result<(Mesh, DisplaceReport)> {
    displaced(mesh, options, &height)
}

/// The height along the normal at a point.
type Height<'h> = &'h (dyn Fn(&DisplacePoint) -> f32 + Sync);

// Compiled once, not for every function that says a height.
fn displaced(mesh: &Mesh, options: &DisplaceOptions, height: Height<'_>) -> Result<(Mesh, DisplaceReport)> {
    options.check()?;
    let vertices = displaced_vertices(mesh, height)?;
    let pieces = whole_triangles(mesh);
    let mut tessellation =
        Tessellation { vertices, pieces, height, facets: Vec::new(), places: HashSet::new() };
    let mut rounds = 0;
    while tessellation.refine(options.refinement.limits(), options.max_triangles)? > 0 {
        rounds += 1;
    }
    let model = model_of(mesh, tessellation.vertices, tessellation.pieces);
    let (mut displaced, clean) = clean(model, &CleanOptions::default())?;
    displaced.corners.normals = corner_normals(&displaced, options.crease_degrees);
    let Aabb { min, max } = mesh.undisplaced_bounds.unwrap_or_else(|| mesh.bounds());
    let moved = |p: Vec3| displaced.world_from_mesh.inverse_point(mesh.world_from_mesh.point(p));
    displaced.undisplaced_bounds = Some(Aabb { min: moved(min), max: moved(max) });
    Ok((displaced, DisplaceReport { rounds, clean }))
}

/// Facets whose normals have a larger cosine count as one plane.
const FLAT_COSINE: f32 = 0.99;

/// Cuts a mesh finer where it is bent, until no edge that ends at a bend is longer than `longest_edge`, mesh units; what lies in flat
/// faces is cut only as far as it takes to keep triangles in shape. The surface and its shading stay as they are; attributes are
/// interpolated, and normals are those that the mesh was shaded with.
///
/// # Errors
///
/// A length below [`Refinement::MIN_EDGE`], more than `max_triangles`, triangles so thin that single precision cannot cut them, or
/// many edges that lie on each other without a common vertex, for whose middles there are not places enough.
pub fn refine_at_bends(mesh: &Mesh, longest_edge: f32, max_triangles: u64) -> Result<Mesh> {
    let refinement = Refinement::Uniform { longest_edge };
    DisplaceOptions { refinement, ..DisplaceOptions::default() }.check()?;
    let facets: Vec<Vec3> = (0..mesh.triangles.len()).map(|t| mesh.facet_normal(t).as_vec3()).collect();
    let mut tessellation = Tessellation {
        vertices: undisplaced_vertices(mesh, &facets),
        pieces: whole_triangles(mesh),
        height: &|_: &DisplacePoint| 0.0,
        facets,
        places: mesh.positions.iter().map(|&position| place(position)).collect(),
    };
    let limits = Limits { only_bent: true, ..refinement.limits() };
    while tessellation.refine(limits, max_triangles)? > 0 {}
    let Tessellation { vertices, pieces, places, .. } = tessellation;
    let of = &mesh.corners;
    let unit = |v: Vec3| v.normalize_or(Vec3::Z);
    let refined = Mesh {
        positions: vertices.iter().map(|v| v.position).collect(),
        triangles: pieces.iter().map(|piece| piece.corners.map(|c| c.vertex)).collect(),
        corners: CornerAttributes {
            normals: interpolated(&shading_normals(mesh), &pieces).into_iter().map(unit).collect(),
            uv_sets: of.uv_sets.iter().map(|set| interpolated(set, &pieces)).collect(),
            colors: interpolated(&of.colors, &pieces),
            tangents: refined_tangents(&of.tangents, &pieces),
        },
        triangle_materials: materials_of(mesh, &pieces),
        parts: mesh.parts.of_sources(pieces.iter().map(|piece| piece.triangle)),
        ..mesh.clone()
    };
    let stays = |(t, piece): (usize, &Piece)| {
        let (own, whole) = (refined.facet_normal(t), mesh.facet_normal(piece.triangle as usize));
        own.dot(whole) > 0.9
    };
    if !pieces.par_iter().enumerate().all(stays) {
        return Err(Error::invalid("the mesh has triangles too thin to be cut finer"));
    }
    match places.len() < vertices.len() {
        true => Err(Error::invalid("the mesh has edges that lie on each other, and cannot be cut there")),
        false => Ok(refined),
    }
}

/// A position to compare: both zeros are one.
fn place(position: Vec3) -> [u32; 3] {
    position.to_array().map(|x| (x + 0.0).to_bits())
}

/// Interpolated and made unit vectors again, with the handedness of the triangle that was cut.
fn refined_tangents(tangents: &[Vec4], pieces: &[Piece]) -> Vec<Vec4> {
    let handedness = pieces.iter().flat_map(|piece| [3 * piece.triangle as usize; 3]);
    let interpolated = interpolated(tangents, pieces).into_iter().zip(handedness);
    interpolated.map(|(t, corner)| t.truncate().normalize_or(Vec3::X).extend(tangents[corner].w)).collect()
}

fn materials_of(mesh: &Mesh, pieces: &[Piece]) -> Vec<u32> {
    let material = |piece: &Piece| mesh.triangle_materials[piece.triangle as usize];
    match mesh.triangle_materials.is_empty() {
        true => Vec::new(),
        false => pieces.iter().map(material).collect(),
    }
}

/// The mesh's own vertices; those around which `facets` differ are bent.
fn undisplaced_vertices(mesh: &Mesh, facets: &[Vec3]) -> Vec<Vertex> {
    let plain = |&position: &Vec3| Vertex { position, normal: Vec3::Z, height: 0.0, is_bent: false, at: 0.5 };
    let mut vertices: Vec<Vertex> = mesh.positions.iter().map(plain).collect();
    let mut first = vec![NONE; vertices.len()];
    for ((number, triangle), facet) in (0..).zip(&mesh.triangles).zip(facets) {
        for &vertex in triangle {
            match &mut first[vertex as usize] {
                first if *first == NONE => *first = number,
                first => vertices[vertex as usize].is_bent |= is_bent(*facet, facets[*first as usize]),
            }
        }
    }
    vertices
}

fn is_bent(a: Vec3, b: Vec3) -> bool {
    a.dot(b) < FLAT_COSINE
}

/// The mesh's own vertices: their normal is the mean of the shading normals at their corners, weighted by angle.
fn displaced_vertices(mesh: &Mesh, height: Height<'_>) -> Result<Vec<Vertex>> {
    let normals = shading_normals(mesh);
    let corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
    let of_vertex = |v: usize| {
        let row = corners.at(v);
        let weighted = |&corner: &u32| normals[corner as usize].as_dvec3() * corner_angle(mesh, corner);
        let sum: DVec3 = row.iter().map(weighted).sum();
        let first = || row.first().map_or(Vec3::Z, |&corner| normals[corner as usize]);
        let normal = sum.try_normalize().map_or_else(first, |n| n.as_vec3());
        let position = mesh.positions[v];
        let mut heights = 0.0;
        for &corner in row {
            let lambda = Vec3::AXES[corner as usize % 3];
            heights += height_at(height, corner / 3, lambda, position, normal)?;
        }
        let height = (heights / row.len().max(1) as f64) as f32;
        Ok(Vertex { position, normal, height, is_bent: false, at: 0.5 })
    };
    (0..corners.len()).into_par_iter().with_min_len(1 << 10).map(of_vertex).collect()
}

fn whole_triangles(mesh: &Mesh) -> Vec<Piece> {
    let piece = |(triangle, vertices): (u32, &[u32; 3])| Piece {
        triangle,
        corners: [0, 1, 2].map(|k| Corner { vertex: vertices[k], lambda: Vec3::AXES[k] }),
    };
    (0..).zip(&mesh.triangles).map(piece).collect()
}

/// The pieces with the attributes of the triangles that they were cut from, in world space.
fn model_of(mesh: &Mesh, vertices: Vec<Vertex>, pieces: Vec<Piece>) -> Model {
    let of = &mesh.corners;
    let corners = CornerAttributes {
        normals: Vec::new(),
        uv_sets: of.uv_sets.iter().map(|set| interpolated(set, &pieces)).collect(),
        colors: interpolated(&of.colors, &pieces),
        tangents: Vec::new(),
    };
    Model {
        name: "the displaced mesh".to_owned(),
        positions: vertices.iter().map(|v| mesh.world_from_mesh.point(v.displaced())).collect(),
        triangles: pieces.iter().map(|piece| piece.corners.map(|c| c.vertex)).collect(),
        corners,
        triangle_materials: materials_of(mesh, &pieces),
        materials: mesh.materials.clone(),
        images: mesh.images.clone(),
        image_places: mesh.image_places.clone(),
        parts: mesh.parts.of_sources(pieces.iter().map(|piece| piece.triangle)),
        notes: Vec::new(),
    }
}

/// Values at the pieces' corners; empty where there are none.
fn interpolated<T>(values: &[T], pieces: &[Piece]) -> Vec<T>
where
    T: Copy + Send + Sync + std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
{
    if values.is_empty() {
        return Vec::new();
    }
    let of_piece = |piece: &Piece| {
        let first = 3 * piece.triangle as usize;
        let values = [0, 1, 2].map(|k| values[first + k]);
        piece.corners.map(|corner| interpolate(values, corner.lambda))
    };
    pieces.par_iter().with_min_len(1 << 12).flat_map_iter(of_piece).collect()
}

// Options of a displacement, and why there may be none.

/// Where a mesh is cut finer before it is displaced. Lengths are mesh units, measured before the displacement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refinement {
    /// Until no edge is longer than this (at least [`Refinement::MIN_EDGE`]).
    Uniform {
        /// Longest edge.
        longest_edge: f32,
    },
    /// Until no edge is longer than `longest_edge`, and along none that is longer than `shortest_edge` the displaced surface
    /// leaves the straight line between the edge's displaced ends by more than `tolerance`.
    Adaptive {
        /// Longest edge: detail that is smaller may be missed.
        longest_edge: f32,
        /// Edges up to this length stay whole; at least [`Refinement::MIN_EDGE`], not above `longest_edge`.
        shortest_edge: f32,
        /// Positive.
        tolerance: f32,
    },
}

impl Refinement {
    /// The shortest edge that can be asked for, mesh units: single precision must tell its middle from its ends.
    pub const MIN_EDGE: f32 = 1.0 / (1 << 18) as f32;

    fn limits(&self) -> Limits {
        match *self {
            Self::Uniform { longest_edge } => {
                let tolerance = f32::INFINITY;
                Limits { longest: longest_edge, shortest: longest_edge, tolerance, only_bent: false }
            }
            Self::Adaptive { longest_edge, shortest_edge, tolerance } => {
                Limits { longest: longest_edge, shortest: shortest_edge, tolerance, only_bent: false }
            }
        }
    }
}

#[derive(Clone, Copy)]
struct Limits {
    longest: f32,
    shortest: f32,
    tolerance: f32,
    /// Edges that are too long are cut only where one of their ends is bent.
    only_bent: bool,
}

/// How to displace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplaceOptions {
    /// Where the mesh is cut finer.
    pub refinement: Refinement,
    /// Triangles of the result at most.
    pub max_triangles: u64,
    /// Edges of the result that bend less than this are shaded smooth, 0 to 180.
    pub crease_degrees: f32,
}

impl Default for DisplaceOptions {
    /// Edges of 1/128 of the model's largest extent, four million triangles at most.
    fn default() -> Self {
        Self {
            refinement: Refinement::Uniform { longest_edge: 1.0 / 64.0 },
            max_triangles: 4 << 20,
            crease_degrees: CREASE_DEGREES,
        }
    }
}

impl DisplaceOptions {
    /// Checks every range.
    ///
    /// # Errors
    /// The first option that is out of range.
    pub fn check(&self) -> Result<()> {
        let in_range = |what: &str, value: f32, good: bool, allowed: &str| match good {
            true => Ok(()),
            false => Err(Error::invalid(format!("{what} is {value}, but must be {allowed}"))),
        };
        let length = |x: f32| x.is_finite() && x >= Refinement::MIN_EDGE;
        let longest = self.refinement.limits().longest;
        in_range("longest_edge", longest, length(longest), "a length of at least 2^-18 mesh units")?;
        if let Refinement::Adaptive { shortest_edge, tolerance, .. } = self.refinement {
            let good = length(shortest_edge) && shortest_edge <= longest;
            in_range("shortest_edge", shortest_edge, good, "2^-18 mesh units to longest_edge")?;
            in_range("tolerance", tolerance, tolerance.is_finite() && tolerance > 0.0, "a positive number")?;
        }
        let crease = self.crease_degrees;
        in_range("crease_degrees", crease, (0.0..=180.0).contains(&crease), "0 to 180")
    }
}

// Cutting triangles at the middles of their edges, round by round, without cracks.
//
// Whether an edge is cut is decided once for the edge, from what all its triangles agree on: its length, and the mean over
// them of the heights along it. Where any side of a triangle is cut, its longest one is, too (M. Rivara, "Algorithms for
// refining triangular grids suitable for adaptive and multigrid techniques", 1984): so no angle becomes much smaller than
// the mesh had, and cutting comes to an end. A triangle is then cut by the pattern of its cut edges:
//
// ```text
//      c2               c2                 c2                  c2
//      /\               /|\                /\                  /\
//     /  \             / | \              /  \ M1           M2/__\M1
//    /    \           /  |  \            / ./ \              /\  /\
//   /______\         /___|___\          /./____\            /__\/__\
//  c0      c1       c0   M0   c1       c0  M0   c1         c0  M0   c1
//    none               one          two: the shorter         three
//                                     diagonal
// ```

const BLOCK: usize = 1 << 12;
const NONE: u32 = u32::MAX;
/// Where along an edge the displaced surface is compared with the straight line.
const PROBES: [f32; 3] = [0.25, 0.5, 0.75];
/// Where an edge is cut whose middle lies on another vertex, as that of a wall which stands on a longer one may.
const BESIDE_MIDDLE: [f32; 6] = [0.4375, 0.5625, 0.46875, 0.53125, 0.375, 0.625];

#[derive(Clone, Copy, Debug)]
struct Corner {
    vertex: u32,
    /// Barycentric coordinates on the triangle of the mesh that it is a piece of.
    lambda: Vec3,
}

#[derive(Clone, Copy, Debug)]
struct Piece {
    triangle: u32,
    corners: [Corner; 3],
}

#[derive(Clone, Copy, Debug)]
struct Vertex {
    /// Undisplaced, mesh space.
    position: Vec3,
    /// Unit normal along which it is displaced.
    normal: Vec3,
    height: f32,
    is_bent: bool,
    /// Where it lies on the edge that it cuts, from the lower to the higher vertex.
    at: f32,
}

impl Vertex {
    fn displaced(&self) -> Vec3 {
        self.position + self.normal * self.height
    }
}

struct Tessellation<'h> {
    vertices: Vec<Vertex>,
    pieces: Vec<Piece>,
    height: Height<'h>,
    /// Unit normals of the mesh's triangles, where vertices that are bent are to be known.
    facets: Vec<Vec3>,
    /// Of the vertices, where these stay in their places.
    places: HashSet<[u32; 3]>,
}

/// An edge of a piece: its vertices in ascending order, and the number of its first corner.
type Side = (u64, u32);

impl Tessellation<'_> {
    /// Cuts once all edges that need it; returns how many.
    fn refine(&mut self, limits: Limits, max_triangles: u64) -> Result<usize> {
        // Step 1: the sides that may be cut, those of one edge next to each other.
        let mut sides = self.long_sides(limits.shortest);
        sides.par_sort_unstable();

        // Step 2: decide edge by edge, then for the longest sides of pieces with a cut side.
        let edges: Vec<&[Side]> = sides.chunk_by(|a, b| a.0 == b.0).collect();
        let decide = |edge: &&[Side]| self.is_to_be_cut(edge, limits);
        let mut is_cut = edges.par_iter().with_min_len(256).map(decide).collect::<Result<Vec<bool>>>()?;
        self.cut_longest_sides(&edges, &mut is_cut);

        // Step 3: keep to the limit. Every cut adds one piece per side.
        let cut: Vec<&[Side]> = edges.iter().zip(&is_cut).filter(|e| *e.1).map(|e| *e.0).collect();
        let needed = (self.pieces.len() + cut.iter().map(|edge| edge.len()).sum::<usize>()) as u64;
        if needed > max_triangles {
            let shortest_edge = limits.shortest;
            return Err(Error::too_large(format!(
                "cutting edges to {shortest_edge} mesh units takes at least {needed} triangles, but max_triangles is \
                 {max_triangles}; choose longer edges"
            )));
        }

        // Step 4: make the new vertices and tell them to the sides.
        let middle = |edge: &&[Side]| self.on_edge(edge, 0.5);
        let mut middles = cut.par_iter().with_min_len(256).map(middle).collect::<Result<Vec<Vertex>>>()?;
        if limits.only_bent {
            self.set_apart(&cut, &mut middles)?;
        }
        let mut middle_of_side = vec![NONE; 3 * self.pieces.len()];
        for (vertex, edge) in (self.vertices.len() as u32..).zip(&cut) {
            edge.iter().for_each(|&(_, side)| middle_of_side[side as usize] = vertex);
        }
        self.vertices.extend(middles);

        // Step 5: cut the pieces.
        if !cut.is_empty() {
            let vertices = &self.vertices;
            let cut = |(piece, middles): (&Piece, &[u32])| cut_piece(vertices, piece, middles);
            let pieces = self.pieces.par_iter().zip(middle_of_side.par_chunks_exact(3));
            self.pieces = pieces.with_min_len(BLOCK).flat_map_iter(cut).collect();
        }
        Ok(cut.len())
    }

    /// Moves middles along their edges that lie on other vertices: parts of a model may touch along edges that they do not share.
    fn set_apart(&mut self, cut: &[&[Side]], middles: &mut [Vertex]) -> Result<()> {
        for (edge, middle) in cut.iter().zip(middles) {
            let mut others = BESIDE_MIDDLE.into_iter();
            while !self.places.insert(place(middle.position))
                && let Some(at) = others.next()
            {
                *middle = self.on_edge(edge, at)?;
            }
        }
        Ok(())
    }

    /// Flags the longest side of every piece that has a flagged side, and so on. A longest side is among `edges`, because
    /// these are all sides above a certain length.
    fn cut_longest_sides(&self, edges: &[&[Side]], is_cut: &mut [bool]) {
        let mut edge_of_side = vec![NONE; 3 * self.pieces.len()];
        for (number, edge) in (0..).zip(edges) {
            edge.iter().for_each(|&(_, side)| edge_of_side[side as usize] = number);
        }
        let mut waiting: Vec<u32> = (0..).zip(&*is_cut).filter(|e| *e.1).map(|e| e.0).collect();
        while let Some(edge) = waiting.pop() {
            for &(_, side) in edges[edge as usize] {
                let longest = edge_of_side[self.longest_side(side as usize / 3)];
                if let Some(flag) = is_cut.get_mut(longest as usize).filter(|flag| !**flag) {
                    *flag = true;
                    waiting.push(longest);
                }
            }
        }
    }

    /// Number of the longest side of a piece; of equal ones, that between the highest vertices, so that neighbours agree.
    fn longest_side(&self, piece: usize) -> usize {
        let order = |k: usize| {
            let (low, high) = self.ends(piece, k);
            (self.squared_length(low, high).to_bits(), high, low)
        };
        3 * piece + (0..3).max_by_key(|&k| order(k)).unwrap_or(0)
    }

    /// Vertices of a side of a piece, ascending.
    fn ends(&self, piece: usize, k: usize) -> (u32, u32) {
        let corners = &self.pieces[piece].corners;
        let (a, b) = (corners[k].vertex, corners[(k + 1) % 3].vertex);
        (a.min(b), a.max(b))
    }

    fn squared_length(&self, a: u32, b: u32) -> f32 {
        self.vertices[a as usize].position.distance_squared(self.vertices[b as usize].position)
    }

    /// Sides longer than `length`, in any order.
    fn long_sides(&self, length: f32) -> Vec<Side> {
        let of_piece = |piece: usize| {
            (0..3).filter_map(move |k| {
                let (low, high) = self.ends(piece, k);
                let is_long = self.squared_length(low, high) > length * length;
                is_long.then(|| ((u64::from(low) << 32) | u64::from(high), (3 * piece + k) as u32))
            })
        };
        (0..self.pieces.len()).into_par_iter().with_min_len(BLOCK).flat_map_iter(of_piece).collect()
    }

    /// Whether an edge is too long, or the displaced surface along it too far from straight; `sides` are those of all its
    /// pieces, ascending.
    fn is_to_be_cut(&self, sides: &[Side], limits: Limits) -> Result<bool> {
        let [a, b] = self.end_vertices(sides);
        if a.position.distance(b.position) > limits.longest {
            return Ok(!limits.only_bent || a.is_bent || b.is_bent);
        }
        if limits.tolerance == f32::INFINITY {
            return Ok(false);
        }
        let (from, to) = (a.displaced(), b.displaced());
        for at in PROBES {
            let vertex = self.on_edge(sides, at)?;
            if vertex.displaced().distance(from.lerp(to, at)) > limits.tolerance {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The vertices of an edge, the lower number first.
    fn end_vertices(&self, sides: &[Side]) -> [&Vertex; 2] {
        [sides[0].0 >> 32, sides[0].0 & u64::from(u32::MAX)].map(|v| &self.vertices[v as usize])
    }

    /// A vertex on an edge, at a share of the way from its lower to its higher vertex.
    fn on_edge(&self, sides: &[Side], at: f32) -> Result<Vertex> {
        let [a, b] = self.end_vertices(sides);
        let position = a.position * (1.0 - at) + b.position * at;
        let normal = (a.normal * (1.0 - at) + b.normal * at).try_normalize().unwrap_or(a.normal);
        let mut sum = 0.0;
        for &(_, side) in sides {
            let piece = &self.pieces[side as usize / 3];
            let (first, second) = (side as usize % 3, (side as usize + 1) % 3);
            let [p, q] = [first, second].map(|k| piece.corners[k]);
            let at = if p.vertex < q.vertex { at } else { 1.0 - at };
            let lambda = p.lambda * (1.0 - at) + q.lambda * at;
            sum += height_at(self.height, piece.triangle, lambda, position, normal)?;
        }
        let facet = |side: &Side| self.facets.get(self.pieces[side.1 as usize / 3].triangle as usize);
        let first = facet(&sides[0]);
        let is_bent =
            sides.iter().skip(1).any(|side| first.zip(facet(side)).is_some_and(|(a, b)| is_bent(*a, *b)));
        Ok(Vertex { position, normal, height: (sum / sides.len() as f64) as f32, is_bent, at })
    }
}

fn height_at(height: Height<'_>, triangle: u32, lambda: Vec3, position: Vec3, normal: Vec3) -> Result<f64> {
    let height = height(&DisplacePoint { at: SurfacePoint { triangle, lambda }, position, normal });
    if height.is_finite() {
        return Ok(height.into());
    }
    Err(Error::invalid(format!("the height on triangle {triangle} is {height}, but must be finite")))
}

/// Up to four pieces of a piece; `middles` holds the new vertex, if any, on the sides from corner 0, 1 and 2.
fn cut_piece(vertices: &[Vertex], piece: &Piece, middles: &[u32]) -> arrayvec::ArrayVec<Piece, 4> {
    let is_cut = |k: usize| middles[k] != NONE;
    // Turned so that sides 0 (and 1) are cut, or 0 alone.
    let turn = match (0..3).filter(|&k| is_cut(k)).count() {
        1 => (0..3).find(|&k| is_cut(k)),
        2 => (0..3).find(|&k| is_cut(k) && is_cut((k + 1) % 3)),
        _ => Some(0),
    };
    let turn = turn.unwrap_or(0);
    let c = [0, 1, 2].map(|k| piece.corners[(k + turn) % 3]);
    let middle = |k: usize| {
        let (from, to, vertex) = (c[k], c[(k + 1) % 3], middles[(k + turn) % 3]);
        let at = vertices.get(vertex as usize).map_or(0.5, |middle| middle.at);
        let at = if from.vertex < to.vertex { at } else { 1.0 - at };
        Corner { vertex, lambda: from.lambda * (1.0 - at) + to.lambda * at }
    };
    let m = [0, 1, 2].map(middle);
    let distance = |a: Corner, b: Corner| {
        vertices[a.vertex as usize].position.distance_squared(vertices[b.vertex as usize].position)
    };
    let cut = [0, 1, 2].map(|k| is_cut((k + turn) % 3));
    let corners: &[[Corner; 3]] = match cut {
        [true, true, true] => &[[c[0], m[0], m[2]], [m[0], c[1], m[1]], [m[2], m[1], c[2]], m],
        [true, true, false] if distance(c[0], m[1]) <= distance(m[0], c[2]) => {
            &[[m[0], c[1], m[1]], [c[0], m[0], m[1]], [c[0], m[1], c[2]]]
        }
        [true, true, false] => &[[m[0], c[1], m[1]], [c[0], m[0], c[2]], [m[0], m[1], c[2]]],
        [true, false, false] => &[[c[0], m[0], c[2]], [m[0], c[1], c[2]]],
        _ => &[c],
    };
    corners.iter().map(|&corners| Piece { triangle: piece.triangle, corners }).collect()
}
