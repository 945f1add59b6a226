//! Models that single precision bends or lets collapse: because a few vertices lie far away, or because their file's numbers do.

use fantex_base::Error;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::{BLOCK, exact};
use crate::WorldFromMesh;

/// Triangles whose height is a smaller share of their longest edge are lines in double precision, too.
const LINE: f64 = 1e-9;

/// Where the triangles that collapse spread over a larger share of the model, it is not for far vertices that they do.
const MAX_SPREAD: f64 = 0.01;

/// Rounding moves the corners of triangles by no larger share of their longest edge, or they are steps instead of a surface.
const MAX_MOVE: f64 = 0.1;

/// Steps between coordinates that are a larger share of the model's longest side are told of where much of it has no area: a thousand edges of it
/// along that side are then shifted by a hundredth of their length.
const SEEN_STEP: f64 = 1e-5;

/// Triangles are looked at in so many parts, at most.
const PARTS: usize = 16;

/// Why a model is refused: more than half of its triangles have an area in double precision (`world`) and none in mesh space (`mesh`), or corners
/// that rounding has moved far, and lie together, far from other vertices. None where that is not so.
pub(super) fn problem(
    name: &str,
    world: &[DVec3],
    mesh: &[Vec3],
    world_from_mesh: &WorldFromMesh,
    triangles: &[[u32; 3]],
) -> Option<Error> {
    // No rounding in a box of this size moves corners by so much of an edge that is longer.
    let long = world_from_mesh.scale * f64::from(f32::EPSILON) / MAX_MOVE;
    let is_collapsed = |&t: &[u32; 3]| {
        let corners = [world[t[0] as usize], world[t[1] as usize], world[t[2] as usize]];
        let longest = longest_squared(corners);
        let moved =
            || t.iter().map(|&v| world_from_mesh.point(mesh[v as usize]).distance_squared(world[v as usize]));
        let is_moved =
            || longest < long * long && moved().fold(0.0, f64::max) > MAX_MOVE * MAX_MOVE * longest;
        (exact::has_no_area(t.map(|v| mesh[v as usize])) || is_moved()) && has_area(corners)
    };
    // No more triangles are looked at than tell that half of them or more do not collapse.
    let (mut collapsed, mut left): (Vec<[u32; 3]>, usize) = (Vec::new(), triangles.len());
    for part in triangles.chunks(triangles.len().div_ceil(PARTS).max(BLOCK)) {
        collapsed.par_extend(part.par_iter().with_min_len(BLOCK / 4).copied().filter(is_collapsed));
        left -= part.len();
        if 2 * (collapsed.len() + left) <= triangles.len() {
            return None;
        }
    }
    let firsts: Vec<DVec3> = collapsed.iter().map(|t| world[t[0] as usize]).collect();
    let middle = median(&firsts);
    let distance = |v: &u32| world[*v as usize].distance(middle);
    let mut spreads: Vec<f64> =
        collapsed.iter().map(|t| t.iter().map(distance).fold(0.0, f64::max)).collect();
    // Nine of ten.
    let most = 9 * spreads.len() / 10;
    let spread = *spreads.select_nth_unstable_by(most, f64::total_cmp).1;
    let reach =
        triangles.par_iter().with_min_len(BLOCK).flatten_iter().map(distance).reduce(|| 0.0, f64::max);
    if spread > MAX_SPREAD * reach {
        return None;
    }
    let first = triangles.iter().flatten().filter(|&v| distance(v) > 0.5 * reach).min()?;
    let place = middle.to_array().map(|x| rounded(x, spread)).join(", ");
    Some(Error::unsupported(format!(
        "{name}: positions reach {reach:.0e} while most triangles lie within {} of ({place}), too far apart for single precision; remove \
         stray vertices (first: vertex {first}, counted from 0)",
        in_one_digit(spread)
    )))
}

/// How far numbers of single precision lie apart around the farthest of these positions; 0 where one of them is none of these numbers, or the step
/// is small beside the model.
pub(super) fn single_step(positions: &[DVec3], used: &[bool]) -> f64 {
    let all =
        || positions.par_iter().zip(used).with_min_len(BLOCK).filter(|(_, used)| **used).map(|(p, _)| *p);
    if !all().all(|p| p.as_vec3().as_dvec3() == p) {
        return 0.0;
    }
    let low = all().reduce(|| DVec3::INFINITY, DVec3::min);
    let high = all().reduce(|| DVec3::NEG_INFINITY, DVec3::max);
    let farthest = low.abs().max(high.abs()).max_element() as f32;
    let step = f64::from(farthest.next_up()) - f64::from(farthest);
    if step > SEEN_STEP * (high - low).max_element() { step } else { 0.0 }
}

fn has_area([a, b, c]: [DVec3; 3]) -> bool {
    (b - a).cross(c - a).length() > LINE * longest_squared([a, b, c])
}

fn longest_squared([a, b, c]: [DVec3; 3]) -> f64 {
    a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a))
}

/// Of each coordinate of at least one point.
fn median(points: &[DVec3]) -> DVec3 {
    let of_axis = |axis: usize| {
        let mut numbers: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        let middle = numbers.len() / 2;
        *numbers.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    DVec3::new(of_axis(0), of_axis(1), of_axis(2))
}

/// The power of ten that a length begins with.
fn power_of_ten(length: f64) -> i32 {
    length.max(f64::MIN_POSITIVE).log10().floor() as i32
}

/// A length that is not above this: `2 units`.
pub(super) fn in_one_digit(length: f64) -> String {
    let power = power_of_ten(length);
    let unit = 10_f64.powi(power);
    let whole = (length / unit).ceil() * unit;
    let noun = if whole == 1.0 { "unit" } else { "units" };
    let decimals = (-power).max(0) as usize;
    match power {
        -4..=5 => format!("{whole:.decimals$} {noun}"),
        _ => format!("{whole:.0e} {noun}"),
    }
}

/// A coordinate, to a tenth of a length.
fn rounded(x: f64, length: f64) -> String {
    let power = 1 - power_of_ten(length);
    let unit = 10_f64.powi(power);
    // Without a minus before zero.
    let x = (x * unit).round() / unit + 0.0;
    let decimals = power.max(0) as usize;
    if decimals <= 6 { format!("{x:.decimals$}") } else { format!("{x:.2e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_not_below_what_they_stand_for() {
        let said = [1.0, 1.01, 0.021, 4321.0, 2.5e7, 2.5e-9].map(in_one_digit);
        assert_eq!(said, ["1 unit", "2 units", "0.03 units", "5000 units", "3e7 units", "3e-9 units"]);
    }

    #[test]
    fn coordinates_are_rounded() {
        let said = [(-0.01, 1.0), (12.346, 0.5), (-7.0, 30.0)].map(|(x, length)| rounded(x, length));
        assert_eq!(said, ["0.0", "12.35", "-7"]);
    }
}
