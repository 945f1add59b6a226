//! What makes a model impossible to clean, and the check that comes before everything else.

use rayon::prelude::*;
use thiserror::Error;

use super::CleanReport;
use crate::{Model, counted};

/// One corner index per corner must fit 32 bits, with one value to spare.
const MAX_TRIANGLES: usize = (u32::MAX / 3 - 1) as usize;
/// One value of the vertex index is spare.
const MAX_VERTICES: usize = u32::MAX as usize - 1;

/// Why a model cannot be cleaned.
#[derive(Debug, Error, PartialEq)]
pub enum CleanError {
    /// The model has no triangles at all.
    #[error("{name} has no triangles ({}); a textured surface needs at least one triangle", counted(*vertices, "vertex"))]
    NoTriangles {
        /// The model.
        name: String,
        /// Number of positions.
        vertices: usize,
    },
    /// Every triangle had to be dropped.
    #[error(
        "nothing is left of {name}, which has {}: {} with unusable positions (NaN, infinite), {} without area",
        counted(report.triangles_in, "triangle"), report.triangles_non_finite, report.triangles_degenerate
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
    #[error(
        "triangle {triangle} of {name} refers to vertex {index}, but there are {vertices} (counting starts at 0)"
    )]
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
    #[error("{name} has {found} {what} for {}; expected {expected} or none", counted(*triangles, "triangle"))]
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

/// Checks counts and indices before anything relies on them.
pub(super) fn check(model: &Model) -> Result<(), CleanError> {
    let (triangles, vertices) = (model.triangles.len(), model.positions.len());
    let name = || model.name.clone();
    if triangles == 0 {
        return Err(CleanError::NoTriangles { name: name(), vertices });
    }
    for (what, count, limit) in
        [("triangles", triangles, MAX_TRIANGLES), ("vertices", vertices, MAX_VERTICES)]
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
    if let Some(triangle) = model.triangles.par_iter().with_min_len(1 << 14).position_first(out_of_range) {
        let index = model.triangles[triangle].into_iter().max().unwrap_or(0);
        return Err(CleanError::IndexOutOfRange { name: name(), triangle, index, vertices });
    }
    Ok(())
}
