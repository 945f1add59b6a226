//! The three pictures that explain a cover: the cover on the model, the projection directions, the packed texture.
//!
//! The projection directions are arrows, one on every group of the lightly shaded model. They are geometry, thin triangles that
//! are added to the mesh, so that the renderer decides what hides them.

use std::path::{Path, PathBuf};

use fantex::Result;
use fantex::cover::{Cover, Group, Packing, pack};
use fantex::mesh::Mesh;
use fantex::render::{FlatShading, FlatSurface, Hit, Picture, RenderOptions};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::commands::render::save;
use crate::context::Context;
use crate::scene::{photograph, portrait};

/// Draws all three and returns their paths: `DIR/cover.png`, `DIR/directions.png` and `DIR/tiles.png` for a folder, else
/// `PREFIX-cover.png` and so on.
pub(crate) fn draw(mesh: &Mesh, cover: &Cover, target: &Path, context: &Context) -> Result<Vec<PathBuf>> {
    let paths = paths(target, context)?;
    for path in &paths {
        context.check_output(path)?;
    }
    let options = RenderOptions { width: 1280, height: 960, ..RenderOptions::default() };
    for (picture, path) in cover_pictures(mesh, cover, &options)?.iter().zip(&paths) {
        save(picture, path, context)?;
    }
    Ok(paths.to_vec())
}

/// The cover on the model, the projection directions, and the packed texture (which has its own size).
pub(crate) fn cover_pictures(mesh: &Mesh, cover: &Cover, options: &RenderOptions) -> Result<[Picture; 3]> {
    let colors = group_colors(cover);
    Ok([
        draw_on_model(mesh, cover, &colors, options)?,
        draw_directions(mesh, cover, &colors, options)?,
        draw_sheet(mesh, cover, &colors),
    ])
}

fn paths(target: &Path, context: &Context) -> Result<[PathBuf; 3]> {
    let names = ["cover.png", "directions.png", "tiles.png"];
    let ends_like_folder = target.as_os_str().to_string_lossy().ends_with(['/', '\\']);
    if target.is_dir() || ends_like_folder {
        context.make_folder(target)?;
        return Ok(names.map(|name| target.join(name)));
    }
    if let Some(folder) = target.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        context.make_folder(folder)?;
    }
    Ok(names.map(|name| {
        let mut path = target.as_os_str().to_owned();
        path.push(format!("-{name}"));
        path.into()
    }))
}

fn draw_on_model(mesh: &Mesh, cover: &Cover, colors: &[Vec3], options: &RenderOptions) -> Result<Picture> {
    let color = |hit: &Hit| {
        let groups = cover.corner_groups[hit.triangle()];
        let weights = cover.weights(hit.triangle(), hit.at.lambda);
        weights.iter().map(|(slot, weight)| colors[groups[slot] as usize] * weight).sum()
    };
    let surface = FlatSurface::new(mesh, FlatShading::Smooth, color);
    Ok(photograph(mesh, &surface, &portrait(mesh, options), options)?.picture)
}

/// More arrows than this would only hide each other: then every second, third, ... group gets one.
const MAX_ARROWS: usize = 1500;
/// Sides of shaft and head.
const SIDES: usize = 5;
/// Triangles of an arrow: two per side of the shaft, two per side of the head (cone and its base).
const TRIANGLES: usize = 4 * SIDES;

/// How far the shaft reaches behind the surface, in arrow lengths: on a model that is inside out it is what is seen.
const TAIL: f32 = 0.4;

fn draw_directions(mesh: &Mesh, cover: &Cover, colors: &[Vec3], options: &RenderOptions) -> Result<Picture> {
    let step = cover.groups.len().div_ceil(MAX_ARROWS).max(1);
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
    let color = |hit: &Hit| match hit.triangle().checked_sub(model_triangles) {
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

/// Longest side of the picture in pixels; a larger sheet is drawn smaller.
const MAX_SIDE: f32 = 2048.0;
/// Colour of the sheet where no tile lies, linear.
const EMPTY: Vec3 = Vec3::splat(0.01);
/// Brightness of a tile's texels outside its partial fans: filter margin and gaps.
const MARGIN: f32 = 0.16;

fn draw_sheet(mesh: &Mesh, cover: &Cover, colors: &[Vec3]) -> Picture {
    let extents: Vec<[u32; 2]> = cover.groups.iter().map(|g| g.extent).collect();
    let packing = pack(&extents);
    let mut canvas = Canvas::new(&packing);
    for (group, (position, extent)) in packing.positions.iter().zip(&extents).enumerate() {
        canvas.fill_tile(*position, *extent, colors[group] * MARGIN);
    }
    for triangle in 0..mesh.triangles.len() {
        let groups = cover.corner_groups[triangle];
        for slot in (0..3).filter(|&slot| !groups[..slot].contains(&groups[slot])) {
            let group = groups[slot] as usize;
            let origin = as_vec2(packing.positions[group]);
            let extent = as_vec2(extents[group]);
            let corners = cover.tile_corners(mesh, triangle, slot).map(|uv| origin + uv * extent);
            canvas.fill_triangle(corners, |lambda| {
                let weights = cover.weights(triangle, lambda);
                let weight = weights.iter().find(|(s, _)| groups[*s] == groups[slot])?.1;
                Some(colors[group] * (MARGIN + (1.0 - MARGIN) * weight))
            });
        }
    }
    canvas.picture
}

/// A picture of a sheet, at most as large.
struct Canvas {
    picture: Picture,
    pixels_per_texel: f32,
}

impl Canvas {
    fn new(packing: &Packing) -> Self {
        let pixels_per_texel = (MAX_SIDE / packing.width.max(packing.height).max(1) as f32).min(1.0);
        let side = |texels: u32| ((texels as f32 * pixels_per_texel).ceil() as u32).max(1);
        let (width, height) = (side(packing.width), side(packing.height));
        let rgba = vec![EMPTY.extend(1.0).to_array(); width as usize * height as usize];
        Self { picture: Picture { width, height, rgba }, pixels_per_texel }
    }

    fn fill_tile(&mut self, position: [u32; 2], extent: [u32; 2], color: Vec3) {
        let low = as_vec2(position);
        let high = low + as_vec2(extent);
        let corners = [low, Vec2::new(high.x, low.y), high, Vec2::new(low.x, high.y)];
        self.fill_triangle([corners[0], corners[1], corners[2]], |_| Some(color));
        self.fill_triangle([corners[0], corners[2], corners[3]], |_| Some(color));
    }

    /// Colours the pixels whose centres lie in a triangle (corners in texels) by their barycentric coordinates.
    fn fill_triangle(&mut self, corners_texels: [Vec2; 3], color: impl Fn(Vec3) -> Option<Vec3>) {
        let [a, b, c] = corners_texels.map(|p| p * self.pixels_per_texel);
        let doubled_area = (b - a).perp_dot(c - a);
        if doubled_area == 0.0 || !doubled_area.is_finite() {
            return;
        }
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let range = |low: f32, high: f32, count: u32| {
            let first = (low - 0.5).ceil().max(0.0) as u32;
            first..((high + 0.5).floor().max(0.0) as u32).min(count)
        };
        for y in range(low.y, high.y, self.picture.height) {
            for x in range(low.x, high.x, self.picture.width) {
                let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let [l0, l1] = [(b - p).perp_dot(c - p), (c - p).perp_dot(a - p)].map(|d| d / doubled_area);
                let lambda = Vec3::new(l0, l1, 1.0 - l0 - l1);
                if lambda.min_element() < -1e-4 {
                    continue;
                }
                if let Some(color) = color(lambda) {
                    let index = y as usize * self.picture.width as usize + x as usize;
                    self.picture.rgba[index] = color.extend(1.0).to_array();
                }
            }
        }
    }
}

fn as_vec2(texels: [u32; 2]) -> Vec2 {
    Vec2::new(texels[0] as f32, texels[1] as f32)
}

/// Number of different colours. Groups have about six neighbours; a few have many more.
const COLORS: u32 = 18;

/// Linear RGB per group. Neighbouring groups get different colours wherever a group has fewer neighbours than there are
/// colours (greedy colouring in the groups' order).
pub(crate) fn group_colors(cover: &Cover) -> Vec<Vec3> {
    let palette: Vec<Vec3> = (0..COLORS).map(color).collect();
    let mut pairs: Vec<[u32; 2]> = cover
        .corner_groups
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .filter(|[a, b]| a != b)
        .flat_map(|[a, b]| [[a, b], [b, a]])
        .collect();
    pairs.par_sort_unstable();
    pairs.dedup();
    let mut chosen: Vec<u32> = Vec::with_capacity(cover.groups.len());
    let mut rest = pairs.as_slice();
    for group in 0..cover.groups.len() as u32 {
        let own = rest.partition_point(|pair| pair[0] <= group);
        let (neighbours, later) = rest.split_at(own);
        rest = later;
        let taken = neighbours
            .iter()
            .filter_map(|pair| chosen.get(pair[1] as usize))
            .fold(0_u32, |mask, &color| mask | 1 << color);
        // Start anywhere, so that all colours are used.
        let first = group.wrapping_mul(0x9e37_79b1) >> 16;
        let free = (0..COLORS).map(|i| (first + i) % COLORS).find(|&color| taken >> color & 1 == 0);
        chosen.push(free.unwrap_or(first % COLORS));
    }
    chosen.into_iter().map(|color| palette[color as usize]).collect()
}

/// Hues round the circle in three lightnesses.
fn color(index: u32) -> Vec3 {
    let hue = index as f32 / COLORS as f32 * std::f32::consts::TAU;
    let lightness = [0.58, 0.82, 0.7][index as usize % 3];
    let chroma = 0.15;
    linear_from_oklab(Vec3::new(lightness, chroma * hue.cos(), chroma * hue.sin()))
        .clamp(Vec3::ZERO, Vec3::ONE)
}

/// Linear sRGB of an Oklab colour (B. Ottosson, "A perceptual color space for image processing", 2020).
fn linear_from_oklab(lab: Vec3) -> Vec3 {
    let l = lab.x + 0.396_337_78 * lab.y + 0.215_803_76 * lab.z;
    let m = lab.x - 0.105_561_346 * lab.y - 0.063_854_17 * lab.z;
    let s = lab.x - 0.089_484_18 * lab.y - 1.291_485_5 * lab.z;
    let [l, m, s] = [l, m, s].map(|c| c * c * c);
    Vec3::new(
        4.076_741_7 * l - 3.307_711_6 * m + 0.230_969_94 * s,
        -1.268_438 * l + 2.609_757_4 * m - 0.341_319_38 * s,
        -0.004_196_086_3 * l - 0.703_418_6 * m + 1.707_614_7 * s,
    )
}

#[cfg(test)]
mod tests {
    use fantex::cover::{CoverOptions, TexelBudget, build_cover};
    use fantex::mesh::generate::icosphere;
    use fantex::mesh::{CleanOptions, clean};

    use super::*;

    #[test]
    fn neighbours_differ() {
        let (mesh, _) = clean(icosphere(5), &CleanOptions::default()).unwrap();
        let options =
            CoverOptions { budget: TexelBudget::Total(1 << 20), tile: 128, ..CoverOptions::default() };
        let (cover, _) = build_cover(&mesh, &options).unwrap();
        assert!(cover.groups.len() > 20);
        let colors = group_colors(&cover);
        let mut borders = 0;
        for groups in &cover.corner_groups {
            for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (groups[i], groups[j])) {
                if a != b {
                    borders += 1;
                    assert_ne!(colors[a as usize], colors[b as usize], "groups {a} and {b}");
                }
            }
        }
        assert!(borders > 100);
    }

    #[test]
    fn grey_is_grey() {
        let grey = linear_from_oklab(Vec3::new(0.5, 0.0, 0.0));
        assert!((grey - Vec3::splat(0.125)).abs().max_element() < 1e-4, "{grey}");
    }
}
