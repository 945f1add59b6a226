//! Cleaning: from a model as its file says to the mesh that everything else works on.
//!
//! ```text
//!  Model --drop NaN--> mesh space --weld--> drop no-area, duplicates --drop isolated vertices--> orient --> Mesh
//! ```
//!
//! Each step runs in parallel, takes time linear in the model and gives the same result on any number of threads. What a
//! step does not change is not copied.
//!
//! Measured on two cores (wall-clock, no attributes): 11 ms for a grid of 100 k triangles, 87 ms for 1 M, 170 ms for 2 M;
//! a landscape of 1.9 M triangles takes 0.21 s of processor time, of which 0.06 s go into the report's topology, 0.05 s
//! into the corners at each vertex and the rest into finding equal vertices and equal triangles.

mod attributes;
mod degenerate;
mod duplicates;
mod error;
mod first;
mod orientation;
mod report;
mod space;
mod star;
mod surface;
mod topology;
mod weld;

use glam::Vec3;
use rayon::prelude::*;

use crate::{Mesh, Model, VertexCorners, WorldFromMesh};

use surface::{Surface, used_vertices};

pub use error::CleanError;
pub use report::CleanReport;
pub(crate) use star::{Star, root};
pub(crate) use topology::Components;
pub use topology::Topology;

/// How to clean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CleanOptions {
    /// Weld vertices up to this far apart, in world units. 0 (the default) welds only equal positions.
    pub weld_distance: f64,
    /// Turn closed components of negative volume inside out. Off by default: the file's sides are believed.
    pub turn_outward: bool,
}

/// Cleans a model: see the module's description for the steps and [`Mesh`] for what holds afterwards.
///
/// # Errors
///
/// [`CleanError`], where no triangle is left, a count exceeds 32-bit indices, or the model contradicts itself.
pub fn clean(mut model: Model, options: &CleanOptions) -> Result<(Mesh, CleanReport), CleanError> {
    error::check(&model)?;
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
    let welded = if options.weld_distance > 0.0 {
        let distance = weld::mesh_distance(options.weld_distance, world_from_mesh.scale);
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
    let corners = VertexCorners::of(&surface.triangles, positions.len());
    report.topology = Topology::of(&surface.triangles, &corners);
    let mut turned = Vec::new();
    if report.topology.edges_inconsistent > 0 || options.turn_outward {
        let turning = orientation::decide(&positions, &surface.triangles, &corners, options.turn_outward);
        turned = turning.turn;
        report.non_orientable_components = turning.non_orientable;
        report.triangles_flipped = surface.turn(&turned);
        let corners = VertexCorners::of(&surface.triangles, positions.len());
        report.topology = Topology::of(&surface.triangles, &corners);
    }
    let mut mesh = surface.into_mesh(model, positions, &turned, world_from_mesh);
    report.corner_values_non_finite = attributes::replace_unusable(&mut mesh.corners);
    Ok((mesh, report))
}

/// All used positions in mesh space; unused ones are zero.
fn mesh_positions(model: &Model, used: &[bool], world_from_mesh: &WorldFromMesh) -> Vec<Vec3> {
    let of = |(&p, &used)| if used { space::mesh_position(world_from_mesh, p) } else { Vec3::ZERO };
    model.positions.par_iter().zip(used).with_min_len(1 << 14).map(of).collect()
}
