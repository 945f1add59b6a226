//! Cleaning: from a model as its file says to the mesh that everything else works on.
//!
//! ```text
//!  Model --drop NaN--> mesh space --weld--> drop no-area, duplicates --drop isolated vertices--> orient --> Mesh
//! ```
//!
//! Each step runs in parallel, takes time linear in the model and gives the same result on any number of threads. What a
//! step does not change is not copied.

mod degenerate;
mod duplicates;
mod first;
mod orientation;
mod report;
mod space;
mod star;
mod topology;
mod weld;

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use glam::Vec3;
use rayon::prelude::*;
use thiserror::Error;

use crate::{CornerAttributes, Material, Mesh, Model, VertexCorners, WorldFromMesh};

use first::Repeat;
pub use report::CleanReport;
pub(crate) use star::{Star, root};
pub(crate) use topology::Components;
pub use topology::Topology;

/// Triangles per parallel task.
const BLOCK: usize = 1 << 14;
/// One corner index per corner must fit 32 bits, with one value to spare.
const MAX_TRIANGLES: usize = (u32::MAX / 3 - 1) as usize;

/// How to clean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CleanOptions {
    /// Weld vertices up to this far apart, in world units. 0 (the default) welds only equal positions.
    pub weld_distance: f64,
    /// Turn closed components of negative volume inside out. Off by default: the file's sides are believed.
    pub turn_outward: bool,
}

/// Why a model cannot be cleaned.
#[derive(Debug, Error, PartialEq)]
pub enum CleanError {
    /// The model has no triangles at all.
    #[error("{name} has no triangles ({vertices} vertices); a textured surface needs at least one triangle")]
    NoTriangles {
        /// The model.
        name: String,
        /// Number of positions.
        vertices: usize,
    },
    /// Every triangle had to be dropped.
    #[error(
        "nothing is left of {name}: of its {} triangles, {} have unusable positions (NaN, infinite) and {} have no area",
        report.triangles_in, report.triangles_non_finite, report.triangles_degenerate
    )]
    NothingLeft {
        /// The model.
        name: String,
        /// What was dropped.
        report: Box<CleanReport>,
    },
    /// Indices into the corners would not fit 32 bits.
    #[error("{name} has {count} {what}, but at most {limit} are supported; split the model")]
    TooMany {
        /// The model.
        name: String,
        /// `triangles` or `vertices`.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// How many are allowed.
        limit: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} of {name} refers to vertex {index}, but there are only {vertices} vertices")]
    IndexOutOfRange {
        /// The model.
        name: String,
        /// The triangle.
        triangle: usize,
        /// The index it holds.
        index: u32,
        /// Number of positions.
        vertices: usize,
    },
    /// An attribute array does not fit the number of triangles.
    #[error("{name} has {found} {what} for {triangles} triangles; expected {expected} or none")]
    AttributeCount {
        /// The model.
        name: String,
        /// Which attribute.
        what: &'static str,
        /// Number of values.
        found: usize,
        /// Number of triangles.
        triangles: usize,
        /// Number of values that would fit.
        expected: usize,
    },
}

/// Cleans a model: see the module's description for the steps and [`Mesh`] for what holds afterwards.
///
/// # Errors
///
/// [`CleanError`], where no triangle is left, a count exceeds 32-bit indices, or the model contradicts itself.
pub fn clean(mut model: Model, options: &CleanOptions) -> Result<(Mesh, CleanReport), CleanError> {
    check(&model)?;
    let mut surface = Surface::new(&mut model);
    let mut report = CleanReport {
        triangles_in: surface.triangles.len() as u64,
        vertices_in: model.positions.len() as u64,
        ..CleanReport::default()
    };
    let nothing_left = |report: CleanReport, name: &str| CleanError::NothingLeft {
        name: name.to_owned(),
        report: Box::new(report),
    };

    // Step 1: drop triangles whose positions cannot be computed with.
    let unusable: Vec<bool> = model.positions.par_iter().map(|&p| !space::is_usable(p)).collect();
    if unusable.par_iter().any(|&u| u) {
        report.triangles_non_finite = surface.retain(|t| t.iter().all(|&v| !unusable[v as usize]));
    }
    let used = used_vertices(&surface.triangles, model.positions.len());

    // Step 2: to mesh space.
    let Some(world_from_mesh) = space::world_from_mesh(&model.positions, |v| used[v]) else {
        report.triangles_degenerate = surface.triangles.len() as u64;
        return Err(nothing_left(report, &model.name));
    };
    let positions = mesh_positions(&model, &used, &world_from_mesh);
    model.positions = Vec::new();

    // Step 3: weld.
    let distance = weld::mesh_distance(options.weld_distance, world_from_mesh.scale);
    let welded = if distance > 0.0 {
        weld::within(&positions, |v| used[v], distance)
    } else {
        weld::coinciding(&positions, |v| used[v])
    };
    report.vertices_welded = welded.len() as u64;
    surface.weld(&welded, positions.len());

    // Step 4: drop triangles without area, then repeated ones.
    report.triangles_degenerate =
        surface.retain(|t| !degenerate::has_no_area(t.map(|v| positions[v as usize])));
    if surface.triangles.is_empty() {
        return Err(nothing_left(report, &model.name));
    }
    let duplicates = duplicates::find(&surface.triangles);
    report.double_sided_pairs = duplicates.double_sided_pairs;
    report.triangles_duplicate = duplicates.repeated.len() as u64;
    surface.remove(&duplicates.repeated);

    // Step 5: drop vertices that nothing uses any more.
    let positions = surface.compact_vertices(positions);
    report.vertices_isolated = report.vertices_in - report.vertices_welded - positions.len() as u64;

    // Step 6: make neighbours agree.
    report.topology =
        Topology::of(&surface.triangles, &VertexCorners::of(&surface.triangles, positions.len()));
    let mut turned = Vec::new();
    if report.topology.edges_inconsistent > 0 || options.turn_outward {
        let corners = VertexCorners::of(&surface.triangles, positions.len());
        let turning = orientation::decide(&positions, &surface.triangles, &corners, options.turn_outward);
        report.non_orientable_components = turning.non_orientable;
        turned = turning.turn;
        report.triangles_flipped = surface.turn(&turned);
        report.topology =
            Topology::of(&surface.triangles, &VertexCorners::of(&surface.triangles, positions.len()));
    }
    Ok((surface.into_mesh(model, positions, &turned, world_from_mesh), report))
}

/// Checks counts and indices before anything relies on them.
fn check(model: &Model) -> Result<(), CleanError> {
    let (triangles, vertices) = (model.triangles.len(), model.positions.len());
    let name = || model.name.clone();
    if triangles == 0 {
        return Err(CleanError::NoTriangles { name: name(), vertices });
    }
    for (what, count, limit) in
        [("triangles", triangles, MAX_TRIANGLES), ("vertices", vertices, u32::MAX as usize - 1)]
    {
        if count > limit {
            return Err(CleanError::TooMany { name: name(), what, count, limit });
        }
    }
    let corners = &model.corners;
    let per_corner = [("normals", corners.normals.len()), ("colors", corners.colors.len())]
        .into_iter()
        .chain([("tangents", corners.tangents.len())])
        .chain(corners.uv_sets.iter().map(|set| ("texture coordinates", set.len())))
        .map(|(what, found)| (what, found, 3 * triangles));
    let per_triangle = [("material indices", model.triangle_materials.len(), triangles)];
    for (what, found, expected) in per_corner.chain(per_triangle) {
        if found != 0 && found != expected {
            return Err(CleanError::AttributeCount { name: name(), what, found, triangles, expected });
        }
    }
    let out_of_range = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= vertices);
    if let Some(triangle) = model.triangles.par_iter().with_min_len(BLOCK).position_first(out_of_range) {
        let index = model.triangles[triangle].into_iter().max().unwrap_or(0);
        return Err(CleanError::IndexOutOfRange { name: name(), triangle, index, vertices });
    }
    Ok(())
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

/// All used positions in mesh space; unused ones are zero.
fn mesh_positions(model: &Model, used: &[bool], world_from_mesh: &WorldFromMesh) -> Vec<Vec3> {
    let of = |(&p, &used)| if used { space::mesh_position(world_from_mesh, p) } else { Vec3::ZERO };
    model.positions.par_iter().zip(used).with_min_len(BLOCK).map(of).collect()
}

/// The triangles while they are being cleaned, and which triangle of the model each of them was.
struct Surface {
    triangles: Vec<[u32; 3]>,
    /// Index of each triangle in the model; `None` while nothing was dropped.
    sources: Option<Vec<u32>>,
}

impl Surface {
    /// Takes the triangles out of the model.
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

    /// Removes triangles, given by ascending index.
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

    /// Drops unused vertices, keeping the order of the others.
    fn compact_vertices(&mut self, positions: Vec<Vec3>) -> Vec<Vec3> {
        let used = used_vertices(&self.triangles, positions.len());
        if used.par_iter().all(|&u| u) {
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

    fn into_mesh(
        self,
        model: Model,
        positions: Vec<Vec3>,
        turned: &[bool],
        world_from_mesh: WorldFromMesh,
    ) -> Mesh {
        let sources = self.sources.as_deref();
        let triangle_materials = match sources {
            Some(sources) if !model.triangle_materials.is_empty() => {
                sources.iter().map(|&s| model.triangle_materials[s as usize]).collect()
            }
            _ => model.triangle_materials,
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
            world_from_mesh,
        }
    }
}

/// Corner values after dropping and turning triangles.
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

/// The flagged elements.
fn kept<T: Copy>(values: Vec<T>, keep: &[bool]) -> Vec<T> {
    values.into_iter().zip(keep).filter(|(_, keep)| **keep).map(|(value, _)| value).collect()
}
