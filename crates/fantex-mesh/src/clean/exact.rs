//! From world space to mesh space: the box of the positions that matter, and the rounding to single precision.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::WorldFromMesh;

/// Coordinates beyond this are treated as damage: their squares and differences must stay finite.
const ABSURD: f64 = 1e100;
/// A box smaller than this is a point: a power of two near it must still be a normal number.
const COINCIDENT: f64 = 1e-300;
/// Mesh-space coordinates are whole multiples of `1 / GRID`. Differences of positions then never underflow single
/// precision when they are multiplied, and 128-bit integers evaluate determinants of positions exactly.
const GRID: f64 = (1_u64 << 60) as f64;
/// Below this magnitude single precision is finer than the grid.
const GRID_MATTERS: f32 = 1.0 / (1_u64 << 36) as f32;

/// True for positions that cleaning accepts: finite, and of a magnitude that can be computed with.
pub(super) fn is_usable(p: DVec3) -> bool {
    p.abs().max_element() <= ABSURD && p.is_finite()
}

/// Centre and scale for the used positions; `None` where they all coincide (to 1e-300) or none is used.
pub(super) fn world_from_mesh(
    positions: &[DVec3],
    used: impl Fn(usize) -> bool + Sync,
) -> Option<WorldFromMesh> {
    let (low, high) = positions
        .par_iter()
        .enumerate()
        .with_min_len(1 << 14)
        .filter(|&(i, _)| used(i))
        .fold(|| (DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), (_, &p)| (low.min(p), high.max(p)))
        .reduce(|| (DVec3::INFINITY, DVec3::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    WorldFromMesh::of_box(low, high)
}

impl WorldFromMesh {
    /// The mesh space of what fills a box, given by its corners; `None` for a box of a single point, or of none.
    ///
    /// The origin is the middle of the box, rounded to a few bits relative to the scale: subtracting it then loses nothing of positions that
    /// were single precision in the file. So boxes that are nearly the same have the same space.
    pub fn of_box(low: DVec3, high: DVec3) -> Option<Self> {
        let half_extent = (0.5 * (high - low)).max_element();
        if half_extent.is_nan() || half_extent < COINCIDENT {
            return None;
        }
        let middle = 0.5 * (low + high);
        let mut scale = power_of_two_at_least(half_extent);
        loop {
            let step = scale / 8.0;
            let rounded = (middle / step).round() * step;
            let offset = if rounded.is_finite() { rounded } else { middle };
            if (high - offset).max_element() <= scale && (offset - low).max_element() <= scale {
                return Some(Self { offset, scale });
            }
            scale *= 2.0;
        }
    }
}

/// A position in mesh space, rounded to the grid; zero is always positive.
pub(super) fn mesh_position(world_from_mesh: &WorldFromMesh, p_world: DVec3) -> Vec3 {
    let p = world_from_mesh.inverse_point(p_world);
    if p.abs().min_element() < GRID_MATTERS { p.map(on_grid) } else { p }
}

/// Rounds to a multiple of `1 / GRID` and turns -0 into +0.
fn on_grid(x: f32) -> f32 {
    if x.abs() < GRID_MATTERS { ((f64::from(x) * GRID).round() / GRID) as f32 + 0.0 } else { x }
}

/// A mesh-space coordinate as a whole number of grid steps, exactly.
fn grid_steps(x: f32) -> i128 {
    (f64::from(x) * GRID) as i128
}

/// The smallest power of two that is not below `x` (positive, normal).
fn power_of_two_at_least(x: f64) -> f64 {
    let below = f64::from_bits(x.to_bits() & !((1 << (f64::MANTISSA_DIGITS - 1)) - 1));
    if below < x { 2.0 * below } else { below }
}

// Which triangles have no area, decided exactly.

/// Relative error of a cross product of two differences in double precision, with room to spare.
const CROSS_ERROR: f64 = 16.0 * f64::EPSILON;

/// True where a triangle with these corners (mesh space, on the grid) has no area: two corners coincide or all three are
/// exactly collinear, or its area is too small for double precision.
///
/// A floating-point filter decides all but nearly collinear triangles; those are decided with 128-bit integers (after
/// J. R. Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997, whose
/// filters these are; the grid of mesh space makes plain integers do for the exact stage).
pub(super) fn has_no_area([a, b, c]: [Vec3; 3]) -> bool {
    let [a64, b64, c64] = [a, b, c].map(|p| p.as_dvec3());
    let (u, v) = (b64 - a64, c64 - a64);
    let cross = u.cross(v).length_squared();
    if cross > CROSS_ERROR * CROSS_ERROR * u.length_squared() * v.length_squared() {
        return false;
    }
    cross == 0.0 || are_collinear(a, b, c)
}

/// Exactly collinear: all three projections onto coordinate planes have no area.
fn are_collinear(a: Vec3, b: Vec3, c: Vec3) -> bool {
    let [a, b, c] = [a, b, c].map(|p| p.to_array().map(grid_steps));
    // Differences of coordinates are below 2^62, their products below 2^124.
    let u = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let v = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
    (0..3).all(|i| {
        let j = (i + 1) % 3;
        u[i] * v[j] == u[j] * v[i]
    })
}
