//! Forward mapping: each texel's colour is spread over the pixels next to where the texel comes to lie.

use glam::{DVec2, DVec4};

use super::{PlaneMap, WarpError, check_size};
use crate::Image;

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
/// Texels that a projective map would bring behind the horizon must not occur: crop the texture before.
///
/// # Errors
///
/// A side is 0 or longer than [`MAX_SIDE`](super::MAX_SIDE).
pub fn warp_forward(
    texture: &Image,
    map: &dyn PlaneMap,
    size: [u32; 2],
    spread: Spread,
) -> Result<Image, WarpError> {
    check_size(size)?;
    let mut canvas = Canvas::new(size);
    let scale = DVec2::new(f64::from(texture.width), f64::from(texture.height)).recip();
    for y in 0..texture.height {
        for x in 0..texture.width {
            let color = DVec4::from_array(texture.linear_texel(x, y).map(f64::from));
            let at = |dx: f64, dy: f64| map.map(DVec2::new(f64::from(x) + dx, f64::from(y) + dy) * scale);
            match spread {
                Spread::Bilinear => canvas.spread_bilinear(at(0.5, 0.5), color),
                Spread::Area => canvas.spread_area([at(0., 0.), at(1., 0.), at(1., 1.), at(0., 1.)], color),
            }
        }
    }
    Ok(canvas.resolve(spread))
}

/// Weighted sums of colours per pixel.
struct Canvas {
    size: [u32; 2],
    /// Sums of `weight * alpha * rgb` and of `weight * alpha`.
    colors: Vec<DVec4>,
    /// Sums of weights.
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
        Image::from_linear_rgba(self.size[0], self.size[1], &texels)
    }
}

/// A quadrilateral's part between four lines at most: each cut adds at most one corner to a convex polygon, two to one with a
/// notch.
const MAX_CORNERS: usize = 12;

/// A polygon of few corners.
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
