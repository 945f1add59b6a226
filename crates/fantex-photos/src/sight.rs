//! What a photograph sees: a map of depths, and how far from an edge every pixel of it is.
//!
//! A ray from a point to the camera would say whether the photograph sees it, and nothing more. The weight of a photograph must fall to
//! zero *before* something gets in the way, at a distance that is measured in the picture, or blending would have edges. So
//! every photograph has a map of its own:
//!
//! ```text
//!  mesh --rasterise--> inverse depths --second differences--> edges --distance--> clearance 0..1
//! ```
//!
//! and both questions are answered by one look-up, whatever the mesh is. Surfaces in the map are drawn from both sides, through the
//! photograph's own lens: triangles are cut until their sides are straight in the picture.

use std::io;

use fantex_bake::Progress;
use fantex_mesh::Mesh;
use glam::{DMat3, DVec2, DVec3, Vec2};
use rayon::prelude::*;

use crate::PhotoCamera;
use crate::pyramid::PixelRect;
use crate::pyramid::{PAGE, PageReader, PageStore, Stored};

/// Longest side of a map: a quarter of the photograph's, within these bounds and no more than the photograph's own.
const SIDES: std::ops::RangeInclusive<u32> = 1024..=2048;
/// Depths differ by this much, mesh units (a model is two wide), before anything is in front of anything.
const DEPTH_SLACK: f64 = 0.002;
/// And by this share of a pixel's width on the surface: what creases are off when they are interpolated.
const CREASE_SLACK: f64 = 1.0;
/// Change of the slope that makes an edge, in widths of a pixel on the surface.
const EDGE_SLOPE: f64 = 3.0;
/// Clearance is 1 at this share of the map's longer side away from an edge.
const CLEAR_SHARE: f64 = 0.012;
/// Triangles up to this long are drawn with straight sides, pixels of the map.
const STRAIGHT_PIXELS: f64 = 8.0;
/// Longer ones are cut where a side's middle is farther off than this.
const BENT_PIXELS: f64 = 0.25;
/// The distance from a fisheye is not linear in its picture, so triangles are cut to this length.
const FISHEYE_PIXELS: f64 = 24.0;
const MAX_CUTS: u32 = 9;
/// Triangles are drawn this much larger, pixels, so that nothing shows between them.
const INFLATION: f64 = 0.05;
/// The same where sides are not quite straight.
const BENT_INFLATION: f64 = 0.3;
const BYTES: usize = 8;
/// Triangles that are drawn between two looks at whether the user wants to stop.
const DRAWN_AT_ONCE: usize = 1 << 10;

/// A camera in mesh space: `p_camera = rotation * (p_mesh - eye)`, in mesh units.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MeshCamera {
    pub(crate) camera: PhotoCamera,
    pub(crate) rotation: DMat3,
    pub(crate) eye: DVec3,
}

impl MeshCamera {
    pub(crate) fn in_camera(&self, p_mesh: DVec3) -> DVec3 {
        self.rotation * (p_mesh - self.eye)
    }

    pub(crate) fn focal(&self) -> f64 {
        (self.camera.focal.x * self.camera.focal.y).sqrt()
    }
}

pub(crate) struct SightMap {
    extent: [u32; 2],
    /// Texels of the map per pixel of the camera.
    scale: DVec2,
    /// 1 / depth, mesh units; 0 where nothing is.
    inverse_depths: Vec<f32>,
    /// 0 at an edge, 1 far from all.
    clearances: Vec<f32>,
}

impl SightMap {
    /// Nothing if it was cancelled.
    pub(crate) fn draw(mesh: &Mesh, camera: &MeshCamera, progress: &dyn Progress) -> Option<Self> {
        let size = camera.camera.size;
        let longest = size[0].max(size[1]);
        let side = (longest / 4).clamp(*SIDES.start(), *SIDES.end()).min(longest);
        let extent =
            size.map(|n| (u64::from(n) * u64::from(side)).div_ceil(u64::from(longest)).max(1) as u32);
        let scale = DVec2::from(extent.map(f64::from)) / DVec2::from(size.map(f64::from));
        let texels = extent[0] as usize * extent[1] as usize;
        let mut map = Self { extent, scale, inverse_depths: vec![0.0; texels], clearances: Vec::new() };
        let painter = Painter::new(camera, scale);
        let corners: Vec<(DVec3, Option<DVec3>)> = mesh
            .positions
            .par_iter()
            .with_min_len(1 << 12)
            .map(|p| {
                let p = camera.in_camera(p.as_dvec3());
                (p, painter.on_map(p))
            })
            .collect();
        for triangles in mesh.triangles.chunks(DRAWN_AT_ONCE) {
            if progress.is_cancelled() {
                return None;
            }
            for triangle in triangles {
                let [a, b, c] = triangle.map(|v| corners[v as usize]);
                painter.triangle(&mut map, [a.0, b.0, c.0], [a.1, b.1, c.1], 0);
            }
        }
        map.find_clearances(camera);
        Some(map)
    }

    /// True where a surface is seen in some pixel of a rectangle.
    pub(crate) fn sees_any(&self, [low, high]: PixelRect, pixel_scale: DVec2) -> bool {
        let last = DVec2::from(self.extent.map(|n| f64::from(n - 1)));
        let low = (low * pixel_scale * self.scale - 1.0).floor().clamp(DVec2::ZERO, last);
        let high = (high * pixel_scale * self.scale + 1.0).ceil().clamp(DVec2::ZERO, last);
        let row = |y: u32| {
            let first = (y * self.extent[0]) as usize;
            &self.clearances[first + low.x as usize..=first + high.x as usize]
        };
        (low.y as u32..=high.y as u32).any(|y| row(y).iter().any(|&c| c > 0.0))
    }

    fn find_clearances(&mut self, camera: &MeshCamera) {
        let [width, height] = self.extent.map(|n| n as usize);
        let footprint = 1.0 / (camera.focal() * (self.scale.x * self.scale.y).sqrt());
        let far = f32::from(u16::MAX);
        let is_edge = |index: usize, before: Option<usize>, after: Option<usize>| {
            let [Some(before), Some(after)] = [before, after] else { return false };
            let at = |i: usize| f64::from(self.inverse_depths[i]);
            let (here, depth) = (at(index), 1.0 / at(index));
            let slack = DEPTH_SLACK + EDGE_SLOPE * footprint * depth;
            let bend = (at(before) + at(after) - 2.0 * here).abs();
            at(before) == 0.0 || at(after) == 0.0 || bend > slack * here * here
        };
        let mut distances: Vec<f32> = (0..width * height)
            .into_par_iter()
            .with_min_len(1 << 14)
            .map(|index| {
                let (x, y) = (index % width, index / width);
                let row = is_edge(index, (x > 0).then(|| index - 1), (x + 1 < width).then(|| index + 1));
                let column =
                    is_edge(index, (y > 0).then(|| index - width), (y + 1 < height).then(|| index + width));
                if self.inverse_depths[index] == 0.0 || row || column { 0.0 } else { far }
            })
            .collect();
        chamfer(&mut distances, width);
        let clear = (CLEAR_SHARE * width.max(height) as f64).max(2.0) as f32;
        // The first texel beside an edge counts as none: it may hold a mixture.
        self.clearances = distances.into_iter().map(|d| ((d - 1.0) / clear).clamp(0.0, 1.0)).collect();
    }

    pub(crate) fn store(&self, store: &PageStore) -> io::Result<Sight> {
        let grid = self.extent.map(|n| n.div_ceil(PAGE));
        let mut pages = Vec::with_capacity(grid[0] as usize * grid[1] as usize);
        for row in 0..grid[1] {
            for column in 0..grid[0] {
                let page = self.cut([column * PAGE, row * PAGE]);
                pages.push(page.map(|page| store.append(page)).transpose()?);
            }
        }
        Ok(Sight { extent: self.extent, scale: self.scale, columns: grid[0], pages })
    }

    /// The bytes of a page, nothing where nothing is seen.
    fn cut(&self, [left, top]: [u32; 2]) -> Option<Vec<u8>> {
        let mut page = vec![0; (PAGE * PAGE) as usize * BYTES];
        let mut is_seen = false;
        for y in top..(top + PAGE).min(self.extent[1]) {
            for x in left..(left + PAGE).min(self.extent[0]) {
                let index = (y * self.extent[0] + x) as usize;
                let (inverse_depth, clearance) = (self.inverse_depths[index], self.clearances[index]);
                is_seen |= clearance > 0.0;
                let first = ((y - top) * PAGE + x - left) as usize * BYTES;
                page[first..first + 4].copy_from_slice(&inverse_depth.to_le_bytes());
                page[first + 4..first + BYTES].copy_from_slice(&clearance.to_le_bytes());
            }
        }
        is_seen.then_some(page)
    }
}

/// Distances to the nearest zero, by two passes over the neighbours (G. Borgefors, "Distance transformations in digital images",
/// 1986; steps 1 and sqrt 2).
fn chamfer(distances: &mut [f32], width: usize) {
    let diagonal = std::f32::consts::SQRT_2;
    let height = distances.len() / width.max(1);
    let mut relax = |x: usize, y: usize, neighbours: [(isize, isize, f32); 4]| {
        let mut best = distances[y * width + x];
        for (dx, dy, step) in neighbours {
            let (Some(x), Some(y)) = (x.checked_add_signed(dx), y.checked_add_signed(dy)) else { continue };
            if x < width && y < height {
                best = best.min(distances[y * width + x] + step);
            }
        }
        distances[y * width + x] = best;
    };
    for y in 0..height {
        for x in 0..width {
            relax(x, y, [(-1, 0, 1.0), (0, -1, 1.0), (-1, -1, diagonal), (1, -1, diagonal)]);
        }
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            relax(x, y, [(1, 0, 1.0), (0, 1, 1.0), (1, 1, diagonal), (-1, 1, diagonal)]);
        }
    }
}

struct Painter<'a> {
    camera: &'a MeshCamera,
    scale: DVec2,
    /// Nothing is seen farther off the axis, radians.
    widest: f64,
    is_straight: bool,
    inflation: f64,
}

impl<'a> Painter<'a> {
    fn new(camera: &'a MeshCamera, scale: DVec2) -> Self {
        let lens = &camera.camera.lens;
        let is_straight = lens.distortion() == crate::Distortion::PINHOLE;
        let inflation = if is_straight { INFLATION } else { BENT_INFLATION };
        Self { camera, scale, widest: widest_angle(&camera.camera), is_straight, inflation }
    }

    /// Position on the map and inverse depth.
    fn on_map(&self, p_camera: DVec3) -> Option<DVec3> {
        let seen = self.camera.camera.project(p_camera)?;
        let inverse_depth = 1.0 / self.camera.camera.lens.depth(p_camera);
        Some((seen.pixel * self.scale).extend(inverse_depth)).filter(|p| p.is_finite())
    }

    fn triangle(&self, map: &mut SightMap, corners: [DVec3; 3], seen: [Option<DVec3>; 3], cuts: u32) {
        if let [Some(a), Some(b), Some(c)] = seen {
            let sides = [b - a, c - b, a - c].map(|side| side.truncate().length());
            let longest = sides.into_iter().fold(0.0, f64::max);
            if longest <= STRAIGHT_PIXELS || self.is_straight || cuts == MAX_CUTS {
                return map.fill([a, b, c], self.inflation);
            }
        } else if cuts == MAX_CUTS {
            return;
        }
        if self.is_out_of_sight(corners) {
            return;
        }
        let [a, b, c] = corners;
        let middles = [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5];
        let middles_seen = middles.map(|m| self.on_map(m));
        if let [Some(a), Some(b), Some(c)] = seen
            && !self.is_bent([a, b, c], middles_seen)
        {
            return map.fill([a, b, c], self.inflation);
        }
        let ([ab, bc, ca], [sab, sbc, sca]) = (middles, middles_seen);
        let [sa, sb, sc] = seen;
        for (corners, seen) in [
            ([a, ab, ca], [sa, sab, sca]),
            ([ab, b, bc], [sab, sb, sbc]),
            ([ca, bc, c], [sca, sbc, sc]),
            ([ab, bc, ca], [sab, sbc, sca]),
        ] {
            self.triangle(map, corners, seen, cuts + 1);
        }
    }

    /// True if the sphere around a triangle lies outside of the cone of sight.
    fn is_out_of_sight(&self, corners: [DVec3; 3]) -> bool {
        let center = (corners[0] + corners[1] + corners[2]) / 3.0;
        let radius = corners.iter().map(|c| c.distance(center)).fold(0.0, f64::max);
        let distance = center.length();
        distance > radius
            && center.truncate().length().atan2(center.z) - (radius / distance).asin() > self.widest
    }

    /// True if a side's middle is not on the line between its ends.
    fn is_bent(&self, corners: [DVec3; 3], middles: [Option<DVec3>; 3]) -> bool {
        (0..3).any(|k| {
            let [from, to] = [corners[k], corners[(k + 1) % 3]].map(|p| p.truncate());
            let Some(middle) = middles[k].map(|m| m.truncate()) else { return true };
            let side = to - from;
            let length = side.length();
            let is_long = self.camera.camera.lens.is_fisheye() && length > FISHEYE_PIXELS;
            is_long || side.perp_dot(middle - from).abs() > BENT_PIXELS * length
        })
    }
}

impl SightMap {
    /// Draws a triangle with straight sides; the nearest surface stays.
    fn fill(&mut self, [a, mut b, mut c]: [DVec3; 3], inflation: f64) {
        let mut area = (b - a).truncate().perp_dot((c - a).truncate());
        if area < 0.0 {
            std::mem::swap(&mut b, &mut c);
            area = -area;
        }
        let last = DVec2::from(self.extent.map(f64::from)) - 1.0;
        let low = a.min(b).min(c).truncate() - 0.5 - inflation;
        let high = a.max(b).max(c).truncate() - 0.5 + inflation;
        if area <= 1e-12 || high.min_element() < 0.0 || low.x > last.x || low.y > last.y {
            return;
        }
        let (low, high) = (low.ceil().max(DVec2::ZERO), high.floor().min(last));
        if low.x > high.x || low.y > high.y {
            return;
        }
        let sides = [(b, c), (c, a), (a, b)].map(|(from, to)| {
            let side = (to - from).truncate();
            (from.truncate(), side, -inflation * side.length())
        });
        for y in low.y as u32..=high.y as u32 {
            for x in low.x as u32..=high.x as u32 {
                let p = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let edge = sides.map(|(from, side, _)| side.perp_dot(p - from));
                if (0..3).any(|k| edge[k] < sides[k].2) {
                    continue;
                }
                let weights = DVec3::from(edge).max(DVec3::ZERO);
                let inverse = weights.dot(DVec3::new(a.z, b.z, c.z)) / weights.element_sum();
                let texel = &mut self.inverse_depths[(y * self.extent[0] + x) as usize];
                *texel = texel.max(inverse as f32);
            }
        }
    }
}

/// The largest angle off the axis of a direction that a picture shows.
fn widest_angle(camera: &PhotoCamera) -> f64 {
    let size = DVec2::from(camera.size.map(f64::from));
    let steps = 32;
    let border = (0..=steps).flat_map(|i| {
        let t = f64::from(i) / f64::from(steps);
        [DVec2::new(t, 0.0), DVec2::new(t, 1.0), DVec2::new(0.0, t), DVec2::new(1.0, t)]
    });
    let valid = camera.lens.valid_angle();
    // Parts of the border may lie beyond all directions.
    let angle = |at: DVec2| camera.direction(at * size).map_or(valid, |d| d.truncate().length().atan2(d.z));
    // A little more: between the points of the border, and for tangential distortion.
    (border.map(angle).fold(0.0, f64::max) + 0.05).min(valid)
}

#[derive(Debug)]
pub(crate) struct Sight {
    extent: [u32; 2],
    scale: DVec2,
    columns: u32,
    pages: Vec<Option<Stored>>,
}

impl Sight {
    /// How well a point is seen, 0 (hidden, or at an edge) to 1: at a position in pixels of the camera, at a depth.
    ///
    /// The inverse depth of a plane is linear in the picture, so between the map's pixels it is interpolated exactly; only
    /// curvature and creases, less than a pixel wide, must be forgiven. Across an edge it means nothing, but there the clearance is 0.
    pub(crate) fn clearance(&self, reader: &PageReader<'_>, pixel: DVec2, depth: f64, focal: f64) -> f32 {
        let footprint = depth / (focal * (self.scale.x * self.scale.y).sqrt());
        let slack = DEPTH_SLACK + CREASE_SLACK * footprint;
        let last = DVec2::from(self.extent.map(|n| f64::from(n - 1)));
        let at = (pixel * self.scale - 0.5).clamp(DVec2::ZERO, last);
        let low = at.floor();
        let share: Vec2 = (at - low).as_vec2();
        let [x, y] = [low.x as u32, low.y as u32];
        let next = [(x + 1).min(self.extent[0] - 1), (y + 1).min(self.extent[1] - 1)];
        // Inverse depth and clearance.
        let texel = |x: u32, y: u32| {
            let stored = self.pages[(y / PAGE * self.columns + x / PAGE) as usize].as_ref();
            let Some(page) = stored.and_then(|page| reader.page(page)) else { return Vec2::ZERO };
            let first = (y % PAGE * PAGE + x % PAGE) as usize * BYTES;
            match page.get(first..first + BYTES) {
                Some(&[a, b, c, d, e, f, g, h]) => {
                    Vec2::new(f32::from_le_bytes([a, b, c, d]), f32::from_le_bytes([e, f, g, h]))
                }
                _ => Vec2::ZERO,
            }
        };
        let upper = texel(x, y).lerp(texel(next[0], y), share.x);
        let lower = texel(x, next[1]).lerp(texel(next[0], next[1]), share.x);
        let [inverse_depth, clearance] = upper.lerp(lower, share.y).to_array();
        if clearance <= 0.0 {
            return 0.0;
        }
        let behind = (depth - 1.0 / f64::from(inverse_depth) - slack) / slack;
        clearance * (1.0 - behind.clamp(0.0, 1.0)) as f32
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicU32;
    use std::sync::atomic::Ordering::Relaxed;

    use fantex_base::Random;
    use fantex_mesh::{CleanOptions, clean, generate};

    use crate::{Distortion, Lens};

    use super::*;

    fn camera(distortion: Distortion) -> MeshCamera {
        let camera = PhotoCamera { lens: Lens::new(distortion), ..PhotoCamera::pinhole([256, 256], 100.0) };
        MeshCamera { camera, rotation: DMat3::IDENTITY, eye: DVec3::ZERO }
    }

    /// Polynomials that turn round have no directions for the corners of the picture: the angle at which they turn bounds what is seen.
    #[test]
    fn what_no_lens_sees_is_out_of_sight() {
        let mut random = Random::new(7);
        for (distortion, turns) in [
            (Distortion::fisheye([-0.1, 0.0, 0.0, 0.0]), true),
            (Distortion::fisheye([0.0; 4]), false),
            (Distortion::Perspective { radial: [-0.2, 0.0, 0.0, 0.0, 0.0, 0.0], tangential: [0.0; 2] }, true),
            (Distortion::PINHOLE, false),
        ] {
            let camera = camera(distortion);
            let painter = Painter::new(&camera, DVec2::ONE);
            let corner = camera.camera.direction(DVec2::ZERO);
            assert_eq!(corner.is_none(), turns, "{distortion:?}");
            let (mut seen, mut hidden) = (0, 0);
            for _ in 0..20_000 {
                let mut unit = || random.unit() - 0.5;
                let mut point = || DVec3::new(unit(), unit(), unit());
                let (place, sides) = (point(), [point(), point(), point()]);
                let corners = sides.map(|side| place + side * 0.02);
                let middle = corners.iter().sum::<DVec3>() / 3.0;
                let is_inside = |p: &DVec3| {
                    let seen = painter.on_map(*p);
                    seen.is_some_and(|p| p.min_element() >= 0.0 && p.x.max(p.y) <= 256.0)
                };
                let any = corners.iter().chain([&middle]).any(is_inside);
                seen += u32::from(any);
                if painter.is_out_of_sight(corners) {
                    assert!(!any, "{distortion:?}: {corners:?}");
                    hidden += 1;
                } else if middle.length() > 0.2 && !any {
                    // Beside the picture, or not far behind what the lens sees.
                    let angle = middle.truncate().length().atan2(middle.z);
                    assert!(angle < camera.camera.lens.valid_angle() + 0.3, "{distortion:?}: {angle}");
                }
            }
            assert!(seen > 1000 && hidden > 1000, "{distortion:?}: {seen} {hidden}");
        }
    }

    #[test]
    fn drawing_can_be_cancelled() {
        struct Asked(AtomicU32, u32);
        impl Progress for Asked {
            fn report(&self, _: u64, _: u64) {}
            fn is_cancelled(&self) -> bool {
                self.0.fetch_add(1, Relaxed) >= self.1
            }
        }
        let mesh = clean(generate::icosphere(4), &CleanOptions::default()).unwrap().0;
        let draw = |asked: &Asked| SightMap::draw(&mesh, &camera(Distortion::PINHOLE), asked).is_some();
        let patient = Asked(AtomicU32::new(0), u32::MAX);
        assert!(draw(&patient));
        assert_eq!(patient.0.load(Relaxed) as usize, mesh.triangles.len().div_ceil(DRAWN_AT_ONCE));
        let impatient = Asked(AtomicU32::new(0), 2);
        assert!(!draw(&impatient));
        assert_eq!(impatient.0.load(Relaxed), 3);
    }
}
