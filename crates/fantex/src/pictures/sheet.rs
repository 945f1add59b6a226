//! The packed virtual texture: all tiles on one sheet, each with its partial fans in its group's colour.

use fantex::cover::{Cover, Packing, pack};
use fantex::mesh::Mesh;
use fantex::render::Picture;
use glam::{Vec2, Vec3};

/// Longest side of the picture in pixels; a larger sheet is drawn smaller.
const LONGEST_SIDE: f32 = 2048.0;
/// Colour of the sheet where no tile lies, linear.
const EMPTY: Vec3 = Vec3::splat(0.01);
/// Brightness of a tile's texels outside its partial fans: filter margin and gaps.
const MARGIN: f32 = 0.16;

/// Draws the sheet.
pub(super) fn draw(mesh: &Mesh, cover: &Cover, colors: &[Vec3]) -> Picture {
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
        let pixels_per_texel = (LONGEST_SIDE / packing.width.max(packing.height).max(1) as f32).min(1.0);
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
