//! Closed-form maps between texture and image space, and the two ways to texture an image by them.
//!
//! Texture coordinates are `[0,1]` over the texture; image coordinates are pixels, `x` to the right and `y` downwards, pixel
//! centres at half integers.
//!
//! ```text
//!                  map                         warp_forward: scan the texture, spread each texel's colour
//!  texture (u,v) -------> image (x,y)
//!                <-------                      warp_inverse: scan the image, look each pixel's colour up
//!                 inverse
//! ```
//!
//! Paul Heckbert, "Fundamentals of texture mapping and image warping", 1989, has the maps and their inverses.

use fantex_base::input::{self, Held};
use fantex_base::{Error, Result};
use glam::{DMat2, DMat3, DVec2, DVec3, DVec4, Vec2};
use rayon::prelude::*;

use crate::{Image, ImageTexture, SampleOptions, Wrap};

/// A map from texture coordinates to a position in an image.
pub trait PlaneMap: Send + Sync {
    /// The position of the texture coordinates `uv`.
    fn map(&self, uv: DVec2) -> DVec2;

    /// The texture coordinates that are seen at a position, or `None` where the texture is not seen.
    fn inverse(&self, position: DVec2) -> Option<DVec2>;

    /// Whether the texture is seen at these coordinates; a projective map has a horizon beyond which it is not.
    fn is_seen(&self, _uv: DVec2) -> bool {
        true
    }

    /// The derivatives of the position by `u` (first column) and `v`.
    fn jacobian(&self, uv: DVec2) -> DMat2;
}

/// The longest side of a warped image, in pixels. They take 16 bytes each, and forward mapping 40 more while it lasts.
pub const MAX_SIDE: u32 = 16_384;

/// Bytes of a pixel of a warped image.
const PIXEL_BYTES: u64 = size_of::<[f32; 4]>() as u64;
/// Bytes of a pixel of a [`Canvas`].
const CANVAS_BYTES: u64 = (size_of::<DVec4>() + size_of::<f64>()) as u64;

/// Refuses sizes that are not allowed, or whose pixels of so many bytes find no memory.
fn reserve([width, height]: [u32; 2], bytes: u64) -> Result<Held> {
    let is_side = |n: u32| (1..=MAX_SIDE).contains(&n);
    if is_side(width) && is_side(height) {
        let bytes = bytes * u64::from(width) * u64::from(height);
        return input::reserve(format_args!("warping into {width} x {height} pixels"), bytes);
    }
    let message =
        format!("cannot warp into {width} x {height} pixels; both sides must be between 1 and {MAX_SIDE}");
    Err(Error::invalid(message))
}

fn not_finite() -> Error {
    Error::invalid("a map between texture and image needs finite numbers")
}

/// The texture or the image is squeezed into a line or a point: no inverse exists.
fn singular() -> Error {
    Error::invalid(
        "the corners of a map between texture and image must span an area: three of them lie on one line",
    )
}

// ---- Affine maps: parallels stay parallel.

/// `position = linear uv + translation`: scaling, rotation, shear and translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AffineMap {
    linear: DMat2,
    translation: DVec2,
    inverse: DMat2,
}

impl AffineMap {
    /// From its matrix, whose columns are the images of one texture width and one texture height.
    ///
    /// # Errors
    /// A number is not finite, or the columns are parallel.
    pub fn new(linear: DMat2, translation: DVec2) -> Result<Self> {
        if !linear.is_finite() || !translation.is_finite() {
            return Err(not_finite());
        }
        let lengths = linear.x_axis.length() * linear.y_axis.length();
        let inverse = linear.inverse();
        if linear.determinant().abs() <= 1e-12 * lengths || !inverse.is_finite() {
            return Err(singular());
        }
        Ok(Self { linear, translation, inverse })
    }

    /// The map that takes three texture coordinates to three positions.
    ///
    /// # Errors
    /// A number is not finite, or three points lie on one line.
    pub fn from_points(uv: [DVec2; 3], positions: [DVec2; 3]) -> Result<Self> {
        let edges = |p: [DVec2; 3]| DMat2::from_cols(p[1] - p[0], p[2] - p[0]);
        let from = Self::new(edges(uv), uv[0])?;
        let linear = edges(positions) * from.inverse;
        Self::new(linear, positions[0] - linear * uv[0])
    }
}

impl PlaneMap for AffineMap {
    fn map(&self, uv: DVec2) -> DVec2 {
        self.linear * uv + self.translation
    }

    fn inverse(&self, position: DVec2) -> Option<DVec2> {
        Some(self.inverse * (position - self.translation))
    }

    fn jacobian(&self, _uv: DVec2) -> DMat2 {
        self.linear
    }
}

// ---- Bilinear maps: the square becomes any quadrilateral, diagonals become curves.

/// `q(u,v) = (1-u)(1-v) P00 + u(1-v) P10 + (1-u)v P01 + uv P11`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BilinearMap {
    /// `P00`.
    origin: DVec2,
    /// `P10 - P00`.
    along_u: DVec2,
    /// `P01 - P00`.
    along_v: DVec2,
    /// `P00 - P10 + P11 - P01`: 0 for a parallelogram.
    twist: DVec2,
}

/// How far beyond the square coordinates still count as inside: rounding errors on its edges.
const TOLERANCE: f64 = 1e-9;

impl BilinearMap {
    /// The map that takes the corners (0,0), (1,0), (1,1), (0,1) of the texture to four positions in this order.
    ///
    /// # Errors
    /// A number is not finite, or all corners lie on one line.
    pub fn from_quad([p00, p10, p11, p01]: [DVec2; 4]) -> Result<Self> {
        let map = Self { origin: p00, along_u: p10 - p00, along_v: p01 - p00, twist: p00 - p10 + p11 - p01 };
        if ![p00, p10, p11, p01].iter().all(|corner| corner.is_finite()) {
            return Err(not_finite());
        }
        let edges = [map.along_u, map.along_v, p11 - p00];
        let longest = edges.iter().map(|edge| edge.length_squared()).fold(0.0, f64::max);
        let area = |a: usize, b: usize| edges[a].perp_dot(edges[b]).abs();
        if area(0, 1).max(area(0, 2)).max(area(1, 2)) <= 1e-12 * longest {
            return Err(singular());
        }
        Ok(map)
    }

    /// `u` for the right `v`: by the coordinate in which the line of that `v` is longer.
    fn u_at(&self, position: DVec2, v: f64) -> f64 {
        let line = self.along_u + self.twist * v;
        let offset = position - self.origin - self.along_v * v;
        if line.x.abs() >= line.y.abs() { offset.x / line.x } else { offset.y / line.y }
    }
}

/// The real solutions of `a x^2 + b x + c = 0`, without cancellation, and with the right limit for small `a`; NaN or infinite
/// where there is none.
fn quadratic_roots(a: f64, b: f64, c: f64) -> [f64; 2] {
    let discriminant = b * b - 4.0 * a * c;
    // At a double root, rounding may make it negative.
    let root = if discriminant > -1e-12 * b * b { discriminant.max(0.0).sqrt() } else { f64::NAN };
    let q = -0.5 * (b + root.copysign(b));
    [c / q, q / a]
}

impl PlaneMap for BilinearMap {
    fn map(&self, uv: DVec2) -> DVec2 {
        self.origin + self.along_u * uv.x + self.along_v * uv.y + self.twist * (uv.x * uv.y)
    }

    /// `None` outside the quadrilateral: the inverse has two values, and only one in the unit square is of use. (A
    /// quadrilateral that is not convex covers some positions twice; then it is the one with the smaller `v`.)
    fn inverse(&self, position: DVec2) -> Option<DVec2> {
        // Eliminating u leaves a quadratic in v: (along_u + twist v) x (offset - along_v v) = 0.
        let offset = position - self.origin;
        let a = self.along_v.perp_dot(self.twist);
        let b = self.twist.perp_dot(offset) - self.along_u.perp_dot(self.along_v);
        let c = self.along_u.perp_dot(offset);
        let [first, second] = quadratic_roots(a, b, c);
        let inside = 0.5 + TOLERANCE;
        [first.min(second), first.max(second)]
            .into_iter()
            .map(|v| DVec2::new(self.u_at(position, v), v))
            .find(|uv| (*uv - 0.5).abs().max_element() <= inside)
            .map(|uv| uv.clamp(DVec2::ZERO, DVec2::ONE))
    }

    fn jacobian(&self, uv: DVec2) -> DMat2 {
        DMat2::from_cols(self.along_u + self.twist * uv.y, self.along_v + self.twist * uv.x)
    }
}

// ---- Projective maps: straight lines stay straight, as in a perspective picture of a plane.

/// `x = (a u + b v + c) / (g u + h v + i)`, `y = (d u + e v + f) / (g u + h v + i)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProjectiveMap {
    matrix: DMat3,
    inverse: DMat3,
}

impl ProjectiveMap {
    /// From the matrix with the rows `(a b c)`, `(d e f)`, `(g h i)`, which counts up to a positive factor: the plane is seen
    /// where the denominator is positive.
    ///
    /// # Errors
    /// A number is not finite, or the matrix has no inverse.
    pub fn new(matrix: DMat3) -> Result<Self> {
        if !matrix.is_finite() {
            return Err(not_finite());
        }
        let inverse = matrix.inverse();
        let volume = matrix.x_axis.length() * matrix.y_axis.length() * matrix.z_axis.length();
        if matrix.determinant().abs() <= 1e-14 * volume || !inverse.is_finite() {
            return Err(singular());
        }
        Ok(Self { matrix, inverse })
    }

    /// The map that takes the corners (0,0), (1,0), (1,1), (0,1) of the texture to four positions in this order.
    ///
    /// # Errors
    /// A number is not finite, or three corners lie on one line.
    pub fn from_quad(corners: [DVec2; 4]) -> Result<Self> {
        let [p0, p1, p2, p3] = corners;
        // Heckbert 1989, 2.2.3: the sums and differences whose ratios are g and h.
        let sum = p0 - p1 + p2 - p3;
        let (across, down) = (p1 - p2, p3 - p2);
        let area = across.perp_dot(down);
        let g = sum.perp_dot(down) / area;
        let h = across.perp_dot(sum) / area;
        if area == 0.0 && corners.iter().all(|corner| corner.is_finite()) {
            return Err(singular());
        }
        Self::new(DMat3::from_cols(
            (p1 - p0 + g * p1).extend(g),
            (p3 - p0 + h * p3).extend(h),
            p0.extend(1.0),
        ))
    }

    /// The map that takes four texture coordinates to four positions, both in the same order round a quadrilateral.
    ///
    /// # Errors
    /// A number is not finite, or three of the texture coordinates or of the positions lie on one line.
    pub fn from_points(uv: [DVec2; 4], positions: [DVec2; 4]) -> Result<Self> {
        let matrix = Self::from_quad(positions)?.matrix * Self::from_quad(uv)?.inverse;
        // The denominator shall be positive at the points.
        let denominator = (matrix * uv[0].extend(1.0)).z;
        Self::new(matrix * denominator.signum())
    }

    /// The matrix with the rows `(a b c)`, `(d e f)`, `(g h i)`.
    pub fn matrix(&self) -> DMat3 {
        self.matrix
    }
}

/// The foot of a homogeneous point, if it lies in front of the horizon.
fn project(point: DVec3) -> Option<DVec2> {
    let smallest = 1e-12 * point.truncate().abs().max_element();
    (point.z > smallest).then(|| point.truncate() / point.z)
}

impl PlaneMap for ProjectiveMap {
    fn map(&self, uv: DVec2) -> DVec2 {
        let point = self.matrix * uv.extend(1.0);
        point.truncate() / point.z
    }

    fn is_seen(&self, uv: DVec2) -> bool {
        (self.matrix * uv.extend(1.0)).z > 0.0
    }

    /// `None` beyond the horizon.
    fn inverse(&self, position: DVec2) -> Option<DVec2> {
        // The inverse's denominator is one over the map's: both have the same sign.
        project(self.inverse * position.extend(1.0))
    }

    fn jacobian(&self, uv: DVec2) -> DMat2 {
        let point = self.matrix * uv.extend(1.0);
        let position = point.truncate() / point.z;
        let column = |axis: DVec3| (axis.truncate() - position * axis.z) / point.z;
        DMat2::from_cols(column(self.matrix.x_axis), column(self.matrix.y_axis))
    }
}

// ---- Inverse mapping: for each row `y'` and column `x'` of the image, compute `u` and `v` and look the texture up.

/// The texture seen through `map`, in an image of `size` (columns, rows): linear RGBA, transparent where it is not seen; at a border
/// alpha is multiplied with the share of the pixel where it is.
///
/// The footprint of a pixel is the pre-image of its square to first order: the inverse of the map's derivative.
///
/// # Errors
/// A side is 0 or longer than [`MAX_SIDE`], or the pixels take more memory than is left.
pub fn warp_inverse(
    texture: &ImageTexture,
    map: &dyn PlaneMap,
    size: [u32; 2],
    options: &SampleOptions,
) -> Result<Image> {
    let _held = reserve(size, PIXEL_BYTES)?;
    let [width, height] = size;
    let mut texels = vec![[0.0; 4]; width as usize * height as usize];
    texels.par_chunks_mut(width as usize).enumerate().for_each(|(y, row)| {
        for (x, texel) in row.iter_mut().enumerate() {
            let corner = DVec2::new(x as f64, y as f64);
            let (position, covered) = seen_part(map, corner);
            if let Some((uv, footprint)) = look_up(map, position, options.wrap).filter(|_| covered > 0.0) {
                *texel = texture.sample(uv, footprint, options);
                texel[3] *= covered;
            }
        }
    });
    Ok(Image::from_linear(width, height, 4, texels.into_flattened()))
}

/// Cells along each side of a pixel at a border.
const CELLS: u32 = 8;

/// A place in the pixel from `corner` on at which the texture is seen, and the share of the pixel where it is: 1 where it is seen at
/// the middle and at all corners, else by cells.
fn seen_part(map: &dyn PlaneMap, corner: DVec2) -> (DVec2, f32) {
    let is_seen = |offset: DVec2| map.inverse(corner + offset).is_some();
    let middle = DVec2::splat(0.5);
    let corners = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].map(is_seen);
    let seen = is_seen(middle);
    if corners.iter().all(|&corner| corner == seen) {
        return (corner + middle, f32::from(u8::from(seen)));
    }
    let cells = (0..CELLS * CELLS)
        .map(|i| (DVec2::new(f64::from(i % CELLS), f64::from(i / CELLS)) + 0.5) / f64::from(CELLS));
    let seen: Vec<DVec2> = cells.filter(|&cell| is_seen(cell)).collect();
    // The seen cell nearest to the middle of all: their mean itself may lie outside of a part with a notch.
    let mean = seen.iter().sum::<DVec2>() / seen.len().max(1) as f64;
    let distance = |cell: &&DVec2| cell.distance_squared(mean);
    let nearest = seen.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
    (corner + nearest.copied().unwrap_or(middle), seen.len() as f32 / (CELLS * CELLS) as f32)
}

/// The texture coordinates at a position with their change from pixel to pixel.
fn look_up(map: &dyn PlaneMap, position: DVec2, wrap: [Wrap; 2]) -> Option<(Vec2, [Vec2; 2])> {
    let uv = map.inverse(position)?;
    let derivative = map.jacobian(uv).inverse();
    let folded = DVec2::new(fold(uv.x, wrap[0]), fold(uv.y, wrap[1]));
    let footprint = [derivative.x_axis.as_vec2(), derivative.y_axis.as_vec2()];
    let is_finite = folded.is_finite() && footprint.iter().all(|step| step.is_finite());
    is_finite.then_some((folded.as_vec2(), footprint))
}

/// Moved by whole periods (two images, for mirrored ones) to where single precision is fine.
fn fold(coordinate: f64, wrap: Wrap) -> f64 {
    match wrap {
        Wrap::Repeat | Wrap::Mirror => coordinate.rem_euclid(2.0),
        Wrap::Clamp | Wrap::Border => coordinate.clamp(-1e6, 1e6),
    }
}

// ---- Forward mapping: each texel's colour is spread over the pixels next to where the texel comes to lie.

/// How a texel's colour is spread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Spread {
    /// Over the four pixels around the image of its centre, by bilinear weights. Where the map magnifies, pixels between the
    /// texels stay empty: the classical holes of forward mapping.
    Bilinear,
    /// Over all pixels that the image of its square covers, by the covered area, which is found by clipping. Exact, without
    /// holes, for maps that leave the texel's sides straight (all of this module).
    #[default]
    Area,
}

/// The texture carried through `map` into an image of `size` (columns, rows): linear RGBA, transparent where nothing
/// arrives. With [`Spread::Area`], alpha is the covered share of a pixel.
///
/// Texels that reach beyond the horizon of a projective map are left out.
///
/// # Errors
/// A side is 0 or longer than [`MAX_SIDE`], or the pixels take more memory than is left.
pub fn warp_forward(texture: &Image, map: &dyn PlaneMap, size: [u32; 2], spread: Spread) -> Result<Image> {
    let _held = reserve(size, CANVAS_BYTES + PIXEL_BYTES)?;
    let mut canvas = Canvas::new(size);
    let scale = DVec2::new(f64::from(texture.width), f64::from(texture.height)).recip();
    for y in 0..texture.height {
        for x in 0..texture.width {
            let at = |dx: f64, dy: f64| DVec2::new(f64::from(x) + dx, f64::from(y) + dy) * scale;
            let corners = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
            if !corners.iter().all(|&uv| map.is_seen(uv)) {
                continue;
            }
            let color = DVec4::from_array(texture.linear_texel(x, y).map(f64::from));
            match spread {
                Spread::Bilinear => canvas.spread_bilinear(map.map(at(0.5, 0.5)), color),
                Spread::Area => canvas.spread_area(corners.map(|uv| map.map(uv)), color),
            }
        }
    }
    Ok(canvas.resolve(spread))
}

struct Canvas {
    size: [u32; 2],
    /// Sums of `weight * alpha * rgb` and of `weight * alpha`.
    colors: Vec<DVec4>,
    weights: Vec<f64>,
}

impl Canvas {
    fn new(size: [u32; 2]) -> Self {
        let pixels = size[0] as usize * size[1] as usize;
        Self { size, colors: vec![DVec4::ZERO; pixels], weights: vec![0.0; pixels] }
    }

    fn add(&mut self, x: i64, y: i64, color: DVec4, weight: f64) {
        let [width, height] = self.size.map(i64::from);
        if (0..width).contains(&x) && (0..height).contains(&y) {
            let pixel = (y * width + x) as usize;
            self.colors[pixel] += (color.truncate() * color.w).extend(color.w) * weight;
            self.weights[pixel] += weight;
        }
    }

    fn spread_bilinear(&mut self, position: DVec2, color: DVec4) {
        let corner = (position - 0.5).floor();
        let share = position - 0.5 - corner;
        let (x, y) = (corner.x as i64, corner.y as i64);
        for (dx, along) in [(0, 1.0 - share.x), (1, share.x)] {
            for (dy, down) in [(0, 1.0 - share.y), (1, share.y)] {
                self.add(x.saturating_add(dx), y.saturating_add(dy), color, along * down);
            }
        }
    }

    fn spread_area(&mut self, corners: [DVec2; 4], color: DVec4) {
        let quad = Polygon::from_quad(corners);
        let Some(rows) = quad.pixels(1, self.size[1]) else { return };
        for y in rows {
            let strip = quad.clipped_to(1, f64::from(y));
            let Some(columns) = strip.pixels(0, self.size[0]) else { continue };
            for x in columns {
                let area = strip.clipped_to(0, f64::from(x)).area();
                if area > 0.0 {
                    self.add(i64::from(x), i64::from(y), color, area);
                }
            }
        }
    }

    fn resolve(self, spread: Spread) -> Image {
        let texels: Vec<[f32; 4]> = self
            .colors
            .iter()
            .zip(&self.weights)
            .map(|(&sum, &weight)| {
                if weight <= 0.0 {
                    return [0.0; 4];
                }
                let color = if sum.w > 0.0 { sum.truncate() / sum.w } else { sum.truncate() };
                let coverage = match spread {
                    Spread::Bilinear => 1.0,
                    Spread::Area => weight.min(1.0),
                };
                color.extend(sum.w / weight * coverage).as_vec4().to_array()
            })
            .collect();
        Image::from_linear(self.size[0], self.size[1], 4, texels.into_flattened())
    }
}

/// A quadrilateral's part between four lines at most: each cut adds at most one corner to a convex polygon, two to one with a
/// notch.
const MAX_CORNERS: usize = 12;

#[derive(Clone, Copy)]
struct Polygon {
    corners: [DVec2; MAX_CORNERS],
    count: usize,
}

impl Polygon {
    fn from_quad(quad: [DVec2; 4]) -> Self {
        let mut corners = [DVec2::ZERO; MAX_CORNERS];
        corners[..4].copy_from_slice(&quad);
        Self { corners, count: 4 }
    }

    fn corners(&self) -> &[DVec2] {
        &self.corners[..self.count]
    }

    /// The pixels along an axis that it reaches, of `0..size`.
    fn pixels(&self, axis: usize, size: u32) -> Option<std::ops::Range<u32>> {
        let along = self.corners().iter().map(|corner| corner[axis]);
        let low = along.clone().fold(f64::INFINITY, f64::min).floor();
        let high = along.fold(f64::NEG_INFINITY, f64::max).ceil();
        let is_inside = high > 0.0 && low < f64::from(size);
        // Conversions saturate.
        is_inside.then(|| low as u32..(high as u32).min(size))
    }

    /// The part between `low` and `low + 1` along an axis.
    fn clipped_to(&self, axis: usize, low: f64) -> Self {
        self.clipped(|p| p[axis] - low).clipped(|p| low + 1.0 - p[axis])
    }

    /// The part where `distance` is not negative (Sutherland and Hodgman, "Reentrant polygon clipping", 1974).
    fn clipped(&self, distance: impl Fn(DVec2) -> f64) -> Self {
        let mut part = Self { corners: [DVec2::ZERO; MAX_CORNERS], count: 0 };
        let mut before = match self.corners().last() {
            Some(&corner) => (corner, distance(corner)),
            None => return part,
        };
        for &corner in self.corners() {
            let after = (corner, distance(corner));
            if (before.1 < 0.0) != (after.1 < 0.0) {
                part.push(before.0.lerp(after.0, before.1 / (before.1 - after.1)));
            }
            if after.1 >= 0.0 {
                part.push(corner);
            }
            before = after;
        }
        part
    }

    fn push(&mut self, corner: DVec2) {
        if self.count < MAX_CORNERS {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    /// The area, however the corners run.
    fn area(&self) -> f64 {
        let corners = self.corners();
        let after = corners.iter().cycle().skip(1);
        0.5 * corners.iter().zip(after).map(|(a, b)| a.perp_dot(*b)).sum::<f64>().abs()
    }
}
