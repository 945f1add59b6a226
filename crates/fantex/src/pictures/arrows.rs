//! The projection directions: an arrow on every group, standing on the lightly shaded model.
//!
//! Arrows are geometry: they are added to the mesh as thin triangles, so that the renderer decides what hides them.

use fantex::cover::{Cover, Group};
use fantex::mesh::Mesh;
use fantex::render::{FlatShading, FlatSurface, Hit, Picture, RenderOptions};
use glam::Vec3;

use crate::error::CliError;
use crate::scene::{photograph, portrait};

/// More arrows than this would only hide each other: then every second, third, ... group gets one.
const MOST_ARROWS: usize = 1500;
/// Sides of shaft and head.
const SIDES: usize = 5;
/// Triangles of an arrow: two per side of the shaft, two per side of the head (cone and its base).
const TRIANGLES: usize = 4 * SIDES;

/// How far the shaft reaches behind the surface, in arrow lengths: on a model that is inside out it is what is seen.
const TAIL: f32 = 0.4;

/// Draws the directions, each in its group's colour.
pub(super) fn draw(
    mesh: &Mesh,
    cover: &Cover,
    colors: &[Vec3],
    options: &RenderOptions,
) -> Result<Picture, CliError> {
    let step = cover.groups.len().div_ceil(MOST_ARROWS).max(1);
    let shown: Vec<usize> = (0..cover.groups.len()).step_by(step).collect();
    let length = ((mesh.area() / shown.len() as f64).sqrt() as f32 * 0.9).clamp(0.015, 0.2);
    let feet = feet(mesh, cover);
    let mut scene = Mesh {
        positions: mesh.positions.clone(),
        triangles: mesh.triangles.clone(),
        world_from_mesh: mesh.world_from_mesh,
        ..Mesh::default()
    };
    shown.iter().for_each(|&g| add_arrow(&mut scene, feet[g], &cover.groups[g], length));
    let model_triangles = mesh.triangles.len();
    let color = |hit: &Hit| match hit.triangle.checked_sub(model_triangles) {
        None => Vec3::splat(0.75),
        Some(i) => colors[shown[i / TRIANGLES]] * 0.8,
    };
    let surface = FlatSurface::new(&scene, FlatShading::Faceted, color);
    Ok(photograph(&scene, &surface, &portrait(&scene, options), options)?.picture)
}

/// For each group the vertex nearest to its middle, mesh space.
fn feet(mesh: &Mesh, cover: &Cover) -> Vec<Vec3> {
    let corners = || {
        (0..mesh.triangles.len()).flat_map(|t| {
            let positions = mesh.triangle_positions(t);
            let [a, b, c] = positions;
            let area = (b - a).cross(c - a).length();
            (0..3).map(move |k| (cover.corner_groups[t][k] as usize, positions[k], area))
        })
    };
    let mut sums = vec![(Vec3::ZERO, 0.0_f32); cover.groups.len()];
    for (group, position, area) in corners() {
        sums[group].0 += position * area;
        sums[group].1 += area;
    }
    let mut nearest = vec![(f32::INFINITY, Vec3::ZERO); cover.groups.len()];
    for (group, position, _) in corners() {
        let (sum, area) = sums[group];
        let distance = position.distance_squared(sum / area);
        if distance < nearest[group].0 {
            nearest[group] = (distance, position);
        }
    }
    nearest.into_iter().map(|(_, position)| position).collect()
}

/// Adds a shaft and a head that point along the group's direction.
fn add_arrow(scene: &mut Mesh, foot: Vec3, group: &Group, length: f32) {
    let (up, x, y) = (group.frame.direction, group.frame.x_axis, group.frame.y_axis());
    let first = scene.positions.len() as u32;
    let ring = |height: f32, radius: f32| {
        (0..SIDES).map(move |i| {
            let angle = i as f32 / SIDES as f32 * std::f32::consts::TAU;
            foot + length * (up * height + (x * angle.cos() + y * angle.sin()) * radius)
        })
    };
    scene.positions.extend(ring(-TAIL, 0.025).chain(ring(0.7, 0.025)).chain(ring(0.7, 0.1)));
    scene.positions.push(foot + length * up);
    let sides = SIDES as u32;
    let [low, high, wide] = [first, first + sides, first + 2 * sides];
    let tip = first + 3 * sides;
    for i in 0..sides {
        let j = (i + 1) % sides;
        scene.triangles.extend([
            [low + i, low + j, high + j],
            [low + i, high + j, high + i],
            [wide + i, wide + j, tip],
            [wide + j, wide + i, high + i],
        ]);
    }
}
