//! Cleaning: from a model as its file says to the mesh that everything else works on.
//!
//! ```text
//!  Model --drop NaN--> mesh space --weld--> drop no-area, duplicates --drop isolated vertices--> orient --> Mesh
//! ```
//!
//! Each step runs in parallel, takes time linear in the model and gives the same result on any number of threads. What a
//! step does not change is not copied.

mod collapse;
mod exact;
mod facing;
mod inward;
mod repeats;
mod seams;
mod topology;

use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;

use fantex_base::{Error, Result, counted, numbered};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;
use repeats::Repeat;

use crate::counts::there_are;
use crate::{CornerAttributes, Material, Mesh, Model, VertexCorners, WorldFromMesh};

pub use inward::inward_parts;
pub(crate) use topology::Components;
pub use topology::Topology;

/// How to clean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CleanOptions {
    /// Weld vertices up to this far apart, in world units. 0 (the default) welds only equal positions, and those that nothing but rounding
    /// in double precision sets apart: coordinates next to zero count as equal up to 2^-44 of the model's size.
    pub weld_distance: f64,
    /// Turn closed components of negative volume inside out. Off by default: the file's sides are believed.
    pub turn_outward: bool,
    /// The mesh space to use, in which all positions must lie within [-1, 1]: that of another mesh, to which this one belongs. By default
    /// it is made for the model.
    pub world_from_mesh: Option<WorldFromMesh>,
}

impl CleanOptions {
    /// Welds vertices up to a distance, in world units, where one is given.
    pub fn welding(distance: Option<f64>) -> Self {
        Self { weld_distance: distance.unwrap_or(0.0), ..Self::default() }
    }
}

/// Cleans a model: see the module's description for the steps and [`Mesh`] for what holds afterwards.
///
/// # Errors
/// Where no triangle is left, most of them vanish in single precision beside vertices that lie far away, a count exceeds 32-bit indices, or the
/// model contradicts itself.
pub fn clean(model: Model, options: &CleanOptions) -> Result<(Mesh, CleanReport)> {
    let (mesh, report, _) = clean_traced(model, options)?;
    Ok((mesh, report))
}

/// As [`clean`], and says which corner of the model each corner of the mesh was.
///
/// # Errors
/// As [`clean`].
pub fn clean_traced(model: Model, options: &CleanOptions) -> Result<(Mesh, CleanReport, CornerOrigins)> {
    clean_watched(model, options, &|_| {})
}

/// As [`clean_traced`], and tells after each step which share of the work is done, about.
///
/// # Errors
/// As [`clean`].
pub fn clean_watched(
    mut model: Model,
    options: &CleanOptions,
    watch: &dyn Fn(f32),
) -> Result<(Mesh, CleanReport, CornerOrigins)> {
    check(&model)?;
    watch(0.0);
    let mut surface = Surface::new(&mut model);
    let mut report = CleanReport {
        triangles_in: surface.triangles.len() as u64,
        vertices_in: model.positions.len() as u64,
        ..CleanReport::default()
    };

    // Step 1: drop triangles whose positions cannot be computed with.
    let unusable: Vec<bool> = model.positions.par_iter().map(|&p| !exact::is_usable(p)).collect();
    if unusable.par_iter().any(|&u| u) {
        report.triangles_non_finite = surface.retain(|t| t.iter().all(|&v| !unusable[v as usize]));
    }
    let used = used_vertices(&surface.triangles, model.positions.len());

    // Step 2: to mesh space.
    let Some(own_space) = exact::world_from_mesh(&model.positions, |v| used[v]) else {
        report.triangles_degenerate = surface.triangles.len() as u64;
        return Err(nothing_left(&report, options, &model.name));
    };
    let world_from_mesh = options.world_from_mesh.unwrap_or(own_space);
    let positions = mesh_positions(&model, &used, &world_from_mesh);
    if options.world_from_mesh.is_none()
        && let Some(problem) =
            collapse::problem(&model.name, &model.positions, &positions, &world_from_mesh, &surface.triangles)
    {
        return Err(problem);
    }
    let step = collapse::single_step(&model.positions, &used);
    model.positions = Vec::new();

    // Step 3: weld.
    watch(0.1);
    let welded = if options.weld_distance > 0.0 {
        let distance = repeats::mesh_distance(options.weld_distance, world_from_mesh.scale);
        repeats::within(&positions, |v| used[v], distance)
    } else {
        repeats::coinciding(&positions, |v| used[v])
    };
    report.vertices_welded = welded.len() as u64;
    report.vertices_at_seams = surface.count_at_seams(&welded, &model.corners, positions.len());
    surface.weld(&welded, positions.len());

    // Step 4: drop triangles without area, then repeated ones.
    watch(0.3);
    report.triangles_degenerate = surface.retain(|t| !exact::has_no_area(t.map(|v| positions[v as usize])));
    // A few triangles without area are in every scan.
    if report.triangles_degenerate > report.triangles_in / 8 {
        report.coordinate_step = step;
    }
    if surface.triangles.is_empty() {
        return Err(nothing_left(&report, options, &model.name));
    }
    let mut corners = VertexCorners::of(&surface.triangles, positions.len());
    let is_disc;
    (report.topology, is_disc) = Topology::and_discs(&surface.triangles, &corners);
    let duplicates = repeats::find(&surface.triangles, |v| is_disc[v as usize]);
    report.double_sided_pairs = duplicates.double_sided_pairs;
    report.triangles_duplicate = duplicates.repeated.len() as u64;
    surface.remove(&duplicates.repeated);

    // Step 5: drop vertices that nothing uses any more.
    let positions = surface.compact_vertices(positions, &corners);
    report.vertices_isolated = report.vertices_in - report.vertices_welded - positions.len() as u64;

    // Step 6: make neighbours agree.
    watch(0.4);
    if positions.len() < corners.len() || !duplicates.repeated.is_empty() {
        corners = VertexCorners::of(&surface.triangles, positions.len());
        report.topology = Topology::of(&surface.triangles, &corners);
    }
    let normals = &model.corners.normals;
    let turned;
    (turned, corners) = orient(&mut surface, &positions, normals, options.turn_outward, corners, &mut report);
    if options.weld_distance == 0.0
        && report.topology.edges_boundary as f64 >= MIN_BOUNDARY_SHARE * report.topology.edges as f64
    {
        let near = seams::open(&positions, &surface.triangles, &corners, 2.0 * NEAR_SHARE);
        report.vertices_near = near.len() as u64;
        report.near_distance = 2.0 * f64::from(NEAR_SHARE) * world_from_mesh.scale;
    }
    watch(0.9);
    let sources = surface.sources.take();
    let mut mesh = surface.into_mesh(model, positions, (sources.as_deref(), &turned), world_from_mesh);
    facing::reverse_opposed(&mut mesh, &turned);
    report.corner_values_non_finite = replace_unusable(&mut mesh.corners);
    watch(1.0);
    Ok((mesh, report, CornerOrigins { sources, turned }))
}

fn nothing_left(report: &CleanReport, options: &CleanOptions, name: &str) -> Error {
    let CleanReport { triangles_in, triangles_non_finite, triangles_degenerate, .. } = report;
    let triangles = counted(*triangles_in, "triangle");
    let welded = match options.weld_distance {
        distance if distance > 0.0 => format!(" once vertices up to {distance} apart are welded"),
        _ => String::new(),
    };
    Error::malformed(format!(
        "nothing is left of {name}, which has {triangles}: {triangles_non_finite} with unusable positions (NaN, infinite or beyond 1e100), \
         {triangles_degenerate} without area{welded}"
    ))
}

/// Turns triangles so that neighbours agree, by the model's `normals` where these help; returns which were turned (empty: none), and the
/// corners around every vertex, which `corners` are before.
fn orient(
    surface: &mut Surface,
    positions: &[Vec3],
    normals: &[Vec3],
    turn_outward: bool,
    corners: VertexCorners,
    report: &mut CleanReport,
) -> (Vec<bool>, VertexCorners) {
    if report.topology.edges_inconsistent == 0 && !turn_outward {
        return (Vec::new(), corners);
    }
    let area_in_front = |t: u32| {
        let source = surface.sources.as_ref().map_or(t, |sources| sources[t as usize]) as usize;
        let normals = normals.get(3 * source..3 * source + 3).unwrap_or_default();
        facing::area_in_front(surface.triangles[t as usize].map(|v| positions[v as usize]), normals)
    };
    let turning = topology::decide(positions, &surface.triangles, &corners, area_in_front, turn_outward);
    report.non_orientable_components = turning.non_orientable;
    report.triangles_flipped = surface.turn(&turning.turn);
    let corners = VertexCorners::of(&surface.triangles, positions.len());
    report.topology = Topology::of(&surface.triangles, &corners);
    (turning.turn, corners)
}

/// So near to each other, as a share of the model's size, are vertices that somebody may want to weld.
const NEAR_SHARE: f32 = 1e-6;

/// Vertices next to each other are looked for where this share of all edges is boundary.
const MIN_BOUNDARY_SHARE: f64 = 1e-3;

/// Which corner of a model each corner of the cleaned mesh was. Triangles keep their order; some are left out, some turned.
#[derive(Clone, Debug, Default)]
pub struct CornerOrigins {
    /// Index of each triangle in the model; `None` where none was dropped.
    sources: Option<Vec<u32>>,
    /// Triangles whose corners 1 and 2 have changed places; empty: none.
    turned: Vec<bool>,
}

impl CornerOrigins {
    /// The triangle of the model that a triangle of the mesh was.
    pub fn triangle(&self, triangle: usize) -> usize {
        self.sources.as_ref().map_or(triangle, |sources| sources[triangle] as usize)
    }

    /// The corner (0, 1, 2) of that triangle that a corner of the mesh's triangle was.
    pub fn corner(&self, triangle: usize, corner: usize) -> usize {
        match self.turned.get(triangle) {
            Some(true) => [0, 2, 1][corner],
            _ => corner,
        }
    }
}

/// All used positions in mesh space; unused ones are zero.
fn mesh_positions(model: &Model, used: &[bool], world_from_mesh: &WorldFromMesh) -> Vec<Vec3> {
    let of = |(&p, &used)| if used { exact::mesh_position(world_from_mesh, p) } else { Vec3::ZERO };
    model.positions.par_iter().zip(used).with_min_len(1 << 14).map(of).collect()
}

// The triangles while they are being cleaned: dropping, renumbering and turning them, and their attributes with them.

const BLOCK: usize = 1 << 14;

/// The triangles while they are being cleaned, and which triangle of the model each of them was.
struct Surface {
    triangles: Vec<[u32; 3]>,
    /// Index of each triangle in the model; `None` while nothing was dropped.
    sources: Option<Vec<u32>>,
}

impl Surface {
    fn new(model: &mut Model) -> Self {
        Self { triangles: std::mem::take(&mut model.triangles), sources: None }
    }

    /// Keeps the triangles that the predicate accepts; returns how many were dropped.
    fn retain(&mut self, keep: impl Fn([u32; 3]) -> bool + Sync) -> u64 {
        let dropped: Vec<u32> = self
            .triangles
            .par_iter()
            .enumerate()
            .with_min_len(BLOCK)
            .filter(|&(_, &t)| !keep(t))
            .map(|(i, _)| i as u32)
            .collect();
        self.remove(&dropped);
        dropped.len() as u64
    }

    fn remove(&mut self, dropped: &[u32]) {
        if dropped.is_empty() {
            return;
        }
        let mut keep = vec![true; self.triangles.len()];
        dropped.iter().for_each(|&t| keep[t as usize] = false);
        let sources = self.sources.take().unwrap_or_else(|| (0..self.triangles.len() as u32).collect());
        self.sources = Some(kept(sources, &keep));
        self.triangles = kept(std::mem::take(&mut self.triangles), &keep);
    }

    /// How many welded vertices have other texture coordinates than the one they are welded to.
    fn count_at_seams(&self, welded: &[Repeat], corners: &CornerAttributes, vertex_count: usize) -> u64 {
        let (Some(uv), false) = (corners.uv_sets.first(), welded.is_empty()) else { return 0 };
        let mut uv_of_vertex = vec![None; vertex_count];
        for (t, triangle) in self.triangles.iter().enumerate() {
            let source = self.sources.as_ref().map_or(t, |sources| sources[t] as usize);
            triangle.iter().zip(&uv[3 * source..]).for_each(|(&v, &uv)| uv_of_vertex[v as usize] = Some(uv));
        }
        let is_at_seam = |repeat: &&Repeat| {
            let [own, first] = [repeat.element, repeat.first].map(|v| uv_of_vertex[v as usize]);
            own != first
        };
        welded.iter().filter(is_at_seam).count() as u64
    }

    /// Replaces every welded vertex by the one it was welded to.
    fn weld(&mut self, welded: &[Repeat], vertex_count: usize) {
        if welded.is_empty() {
            return;
        }
        let mut target: Vec<u32> = (0..vertex_count as u32).collect();
        welded.iter().for_each(|repeat| target[repeat.element as usize] = repeat.first);
        self.renumber(&target);
    }

    fn renumber(&mut self, target: &[u32]) {
        let renumber = |t: &mut [u32; 3]| *t = t.map(|v| target[v as usize]);
        self.triangles.par_iter_mut().with_min_len(BLOCK).for_each(renumber);
    }

    /// Drops the vertices that have no corners.
    fn compact_vertices(&mut self, positions: Vec<Vec3>, corners: &VertexCorners) -> Vec<Vec3> {
        let used: Vec<bool> = (0..positions.len()).map(|v| !corners.at(v).is_empty()).collect();
        if used.iter().all(|&u| u) {
            return positions;
        }
        let mut next = 0;
        let target: Vec<u32> = used
            .iter()
            .map(|&used| {
                let index = next;
                next += u32::from(used);
                index
            })
            .collect();
        self.renumber(&target);
        kept(positions, &used)
    }

    /// Turns the flagged triangles round (corners 1 and 2 change places); returns how many.
    fn turn(&mut self, flags: &[bool]) -> u64 {
        let flagged = self.triangles.iter_mut().zip(flags).filter(|(_, turn)| **turn);
        flagged.map(|(t, _)| t.swap(1, 2)).count() as u64
    }

    /// Joins everything to a mesh; `sources` and `turned` as in [`CornerOrigins`].
    fn into_mesh(
        self,
        model: Model,
        positions: Vec<Vec3>,
        (sources, turned): (Option<&[u32]>, &[bool]),
        world_from_mesh: WorldFromMesh,
    ) -> Mesh {
        let triangle_materials = match sources {
            Some(sources) if !model.triangle_materials.is_empty() => {
                sources.iter().map(|&s| model.triangle_materials[s as usize]).collect()
            }
            _ => model.triangle_materials,
        };
        let parts = match sources {
            Some(sources) => model.parts.of_sources(sources.iter().copied()),
            None => model.parts,
        };
        let corners = model.corners;
        let corners = CornerAttributes {
            normals: follow(corners.normals, sources, turned),
            uv_sets: corners.uv_sets.into_iter().map(|set| follow(set, sources, turned)).collect(),
            colors: follow(corners.colors, sources, turned),
            tangents: follow(corners.tangents, sources, turned),
        };
        let materials = if model.materials.is_empty() { vec![Material::default()] } else { model.materials };
        Mesh {
            positions,
            triangles: self.triangles,
            corners,
            triangle_materials,
            materials,
            images: model.images,
            image_places: model.image_places,
            parts,
            world_from_mesh,
            undisplaced_bounds: None,
        }
    }
}

fn follow<T: Copy + Send + Sync>(values: Vec<T>, sources: Option<&[u32]>, turned: &[bool]) -> Vec<T> {
    if values.is_empty() {
        return values;
    }
    let mut values = match sources {
        Some(sources) => {
            sources.iter().flat_map(|&s| [0, 1, 2].map(|k| values[3 * s as usize + k])).collect()
        }
        None => values,
    };
    for (corners, _) in values.chunks_exact_mut(3).zip(turned).filter(|(_, turn)| **turn) {
        corners.swap(1, 2);
    }
    values
}

fn kept<T: Copy>(values: Vec<T>, keep: &[bool]) -> Vec<T> {
    values.into_iter().zip(keep).filter(|(_, keep)| **keep).map(|(value, _)| value).collect()
}

/// One flag per vertex: a triangle uses it.
fn used_vertices(triangles: &[[u32; 3]], vertex_count: usize) -> Vec<bool> {
    let used: Vec<AtomicBool> = (0..vertex_count).map(|_| AtomicBool::new(false)).collect();
    triangles
        .par_iter()
        .with_min_len(BLOCK)
        .flatten_iter()
        .for_each(|&v| used[v as usize].store(true, Relaxed));
    used.into_iter().map(AtomicBool::into_inner).collect()
}

// Corner values that nothing can be computed with.

/// Replaces values that are NaN or infinite by what corners without the attribute have; returns how many.
fn replace_unusable(corners: &mut CornerAttributes) -> u64 {
    let CornerAttributes { normals, uv_sets, colors, tangents } = corners;
    let coordinates: u64 =
        uv_sets.iter_mut().map(|set| replace(set, |uv: &Vec2| uv.is_finite(), Vec2::ZERO)).sum();
    coordinates
        + replace(colors, |color: &Vec4| color.is_finite(), Vec4::ONE)
        // Zero stands for the triangle's own.
        + replace(normals, |normal: &Vec3| normal.is_finite(), Vec3::ZERO)
        + replace(tangents, |tangent: &Vec4| tangent.is_finite(), Vec4::ZERO)
}

fn replace<T: Copy + Send + Sync>(values: &mut [T], is_usable: impl Fn(&T) -> bool + Sync, by: T) -> u64 {
    let replace_in = |block: &mut [T]| {
        let unusable = block.iter_mut().filter(|value| !is_usable(value));
        unusable.map(|value| *value = by).count() as u64
    };
    values.par_chunks_mut(1 << 14).map(replace_in).sum()
}

// What cleaning found and did.

/// Counts of everything that cleaning changed or noticed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CleanReport {
    /// Triangles of the model.
    pub triangles_in: u64,
    /// Positions of the model.
    pub vertices_in: u64,
    /// Vertices merged into an earlier one at the same place.
    pub vertices_welded: u64,
    /// Of these, such that have other texture coordinates: seams of the coordinates, which most files can hold in no other way.
    pub vertices_at_seams: u64,
    /// Vertices dropped because no remaining triangle uses them.
    pub vertices_isolated: u64,
    /// Triangles dropped because a position is NaN, infinite or beyond 1e100.
    pub triangles_non_finite: u64,
    /// Triangles dropped because they have no area.
    pub triangles_degenerate: u64,
    /// Triangles dropped because an earlier one has the same vertices in the same order.
    pub triangles_duplicate: u64,
    /// Texture coordinates, colours, normals and tangents of corners that are NaN or infinite: replaced by zero, white, or the
    /// triangle's own.
    pub corner_values_non_finite: u64,
    /// Pairs of triangles with the same vertices in opposite order; both are kept.
    pub double_sided_pairs: u64,
    /// Triangles turned round to agree with their neighbours.
    pub triangles_flipped: u64,
    /// Patches that have no consistent orientation (Moebius strips and the like).
    pub non_orientable_components: u64,
    /// Vertices that are not welded and lie next to another one, across a seam: about those that a [distance](CleanOptions::weld_distance) of
    /// [`near_distance`](Self::near_distance) would weld and so close the seam. Counted where much of the model is boundary and no distance is given.
    pub vertices_near: u64,
    /// A millionth of the model's size, in world units; 0 where none were counted.
    pub near_distance: f64,
    /// How far numbers of single precision lie apart where the model is, world units, if it may be for that that much of it has no area; else 0.
    pub coordinate_step: f64,
    /// The cleaned mesh.
    pub topology: Topology,
}

impl CleanReport {
    /// One sentence for each finding that is not zero. Where all that was welded are seams of texture coordinates there is nothing to say of it.
    pub fn lines(&self) -> Vec<String> {
        let shape = &self.topology;
        let is_split = self.vertices_welded > self.vertices_at_seams;
        let findings = [
            (self.triangles_non_finite, "triangle", "dropped: a position is not a usable number"),
            (self.triangles_degenerate, "triangle", "dropped: no area"),
            (self.triangles_duplicate, "triangle", "dropped: the same vertices as an earlier triangle"),
            (
                self.corner_values_non_finite,
                "corner value",
                "replaced: a texture coordinate, colour or normal is not a usable number",
            ),
            (
                if is_split { self.vertices_welded } else { 0 },
                "vertex",
                "welded to an earlier vertex at the same place",
            ),
            (self.vertices_isolated, "vertex", "dropped: no triangle uses it"),
            (
                self.double_sided_pairs,
                "double-sided pair",
                "of triangles kept: same vertices, opposite order",
            ),
            (self.triangles_flipped, "triangle", "turned round to agree with the neighbours"),
            (self.non_orientable_components, "patch", "left with a seam: it has no consistent orientation"),
            (shape.edges_inconsistent, "edge", "left between triangles of opposite orientation"),
            (shape.edges_non_manifold, "edge", "shared by more than two triangles"),
            (shape.vertices_non_manifold, "vertex", "whose triangles do not form a single fan"),
            (shape.edges_boundary, "edge", "on the boundary"),
        ];
        let sentence = |(n, noun, fact)| format!("{} {fact}.", counted(n, noun));
        let mut lines: Vec<String> = findings.into_iter().filter(|f| f.0 > 0).map(sentence).collect();
        lines.extend(self.line_of_near());
        if self.coordinate_step > 0.0 {
            lines.push(format!(
                "Coordinates are numbers of single precision, which lie {} apart there, and much of the model has no area: write it relative to an \
                 origin nearby, or in double precision.",
                collapse::in_one_digit(self.coordinate_step)
            ));
        }
        lines
    }

    fn line_of_near(&self) -> Option<String> {
        let vertices = counted(self.vertices_near, "vertex");
        let length = in_two_digits(self.near_distance);
        (self.vertices_near > 0).then(|| {
            format!(
                "{vertices} within a millionth of the model's size of another one, but not joined to it: there the surface has a seam. 'fantex bake \
                 --weld' joins vertices that lie up to a length apart, such as {length}."
            )
        })
    }
}

/// A length to two digits, not less than it.
fn in_two_digits(length: f64) -> String {
    let unit = 10_f64.powf(length.log10().floor() - 1.0);
    // What is rounded up by rounding alone stays.
    let rounded = (length / unit - 1e-9).ceil() * unit;
    format!("{rounded:.1e}")
}

// Checks before the first step.

/// One corner index per corner must fit 32 bits, with one value to spare.
const MAX_TRIANGLES: usize = (u32::MAX / 3 - 1) as usize;
/// One value of the vertex index is spare.
const MAX_VERTICES: usize = u32::MAX as usize - 1;

fn check(model: &Model) -> Result<()> {
    let (triangles, vertices) = (model.triangles.len(), model.positions.len());
    let name = &model.name;
    if triangles == 0 {
        let vertices = counted(vertices, "vertex");
        return Err(Error::malformed(format!(
            "{name} has no triangles ({vertices}); a textured surface needs at least one triangle"
        )));
    }
    for (what, count, limit) in
        [("triangles", triangles, MAX_TRIANGLES), ("vertices", vertices, MAX_VERTICES)]
    {
        if count > limit {
            return Err(Error::too_large(format!(
                "{name} has {count} {what}, but at most {limit} are supported; split the model"
            )));
        }
    }
    let corners = &model.corners;
    let per_corner = [("normal", corners.normals.len()), ("color", corners.colors.len())]
        .into_iter()
        .chain([("tangent", corners.tangents.len())])
        .chain(corners.uv_sets.iter().map(|set| ("texture coordinate", set.len())))
        .map(|(what, found)| (what, found, 3 * triangles));
    let per_triangle = [
        ("material index", model.triangle_materials.len(), triangles),
        ("part index", model.parts.of_triangle.len(), triangles),
    ];
    for (what, found, expected) in per_corner.chain(per_triangle) {
        if found != 0 && found != expected {
            let (triangles, what) = (counted(triangles, "triangle"), numbered(found, what));
            return Err(Error::malformed(format!(
                "{name} has {found} {what} for {triangles}; expected {expected} or none"
            )));
        }
    }
    let out_of_range = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= vertices);
    if let Some(triangle) = model.triangles.par_iter().with_min_len(1 << 14).position_first(out_of_range) {
        let index = model.triangles[triangle].into_iter().max().unwrap_or(0);
        let there_are = there_are(vertices);
        return Err(Error::malformed(format!(
            "triangle {triangle} of {name} refers to vertex {index}, but {there_are} (counting starts at 0)"
        )));
    }
    Ok(())
}
