//! What a tile costs: texels per unit of error along the direction in which the surface is resolved worst.
//!
//! Interpolation between texels of length `h` is off by a multiple of `h^2` times the second derivative, so the squared error
//! of smooth detail grows with `h^4`. Where the map into the tile shrinks the surface, texels are longer on it. With `G` the
//! metric, the squared lengths on the surface per squared length in the plane, the mean over all directions of detail is
//! `|G|^2 / 2` (Frobenius), 1 where nothing is shrunk. A patch whose tile has `R` texels at the nominal density `1` and whose integral
//! of that is `E` (in texels, too) has the error `E / s^4` and `s^2 R` texels at the density `s`. The least error of all patches for
//! a sum of texels has `s = (E / R)^(1/6)` up to a common factor, and is the third power of the sum of [`cost`]s
//! `E^(1/3) R^(2/3)`, over the square of the sum of texels. So costs can be added up and compared.

use glam::{Vec2, Vec3};

use crate::stored::{self, GROWTH};

/// Surfaces seen at a smaller cosine than this are so bad that how bad makes no difference.
const MIN_COSINE: f32 = 0.125;

/// Texels beside a rectangle on both sides together, and what rounding to multiples of four adds on average.
const MARGIN_TEXELS: f32 = 1.5;

/// Blocks are kept that meet a region grown on all sides: this long is a square around a point that meets those that the point needs.
const REACH_TEXELS: f32 = stored::BLOCK as f32 + 2.0 * GROWTH;

/// Texels of the blocks beside a convex region, per texel of its outline: `A + 2/pi s P + s^2` with the side `s` of that square are kept on
/// average over all places and directions (L. A. Santalo, "Integral Geometry and Geometric Probability", 1976).
const TEXELS_PER_OUTLINE: f32 = 2.0 / std::f32::consts::PI * REACH_TEXELS;

/// The same of a point.
const POINT_TEXELS: f32 = REACH_TEXELS * REACH_TEXELS;

/// A region in the plane, in any unit of length.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Region {
    /// Sides of its rectangle.
    pub(crate) size: Vec2,
    pub(crate) area: f32,
    /// Length of its outline.
    pub(crate) outline: f32,
}

impl Region {
    /// A disc, which no rectangle is in the way of.
    pub(crate) fn disc(area: f32) -> Self {
        let outline = 2.0 * (std::f32::consts::PI * area).sqrt();
        Self { size: Vec2::INFINITY, area, outline }
    }

    /// The region, stretched along the sides of its rectangle.
    pub(crate) fn scaled(self, factors: Vec2) -> Self {
        let Vec2 { x, y } = factors;
        Self { size: self.size * factors, area: self.area * x * y, outline: self.outline * 0.5 * (x + y) }
    }

    /// How many texels are stored for a region measured in texels, nearly: the blocks that it meets, or its whole rectangle.
    #[inline]
    pub(crate) fn texels(&self) -> f32 {
        let whole = (self.size.x + MARGIN_TEXELS) * (self.size.y + MARGIN_TEXELS);
        whole.min(self.block_texels())
    }

    /// Texels of the blocks that the region meets, nearly, if its rectangle is not in the way.
    pub(crate) fn block_texels(&self) -> f32 {
        self.area + TEXELS_PER_OUTLINE * self.outline + POINT_TEXELS
    }
}

/// Texels that a tile's entries in the file and the atlas are worth.
const ENTRY_TEXELS: f32 = 64.0;

/// Texels that the coordinates of a corner in an unfolded group are worth.
const CORNER_TEXELS: f32 = 2.0;

/// The error of a facet per area where it is seen with a cosine.
#[inline]
pub(crate) fn error_at(cos: f32) -> f32 {
    let squared = cos.max(MIN_COSINE);
    let squared = squared * squared;
    0.5 + 0.5 / (squared * squared)
}

/// The cost of a patch with an error (in texels, at least its area) that takes up a region (in texels).
#[inline]
pub(crate) fn cost(error: f32, region: &Region) -> f32 {
    unfolded_cost(error, region, 0)
}

/// The same of an unfolded patch with coordinates for so many corners.
pub(crate) fn unfolded_cost(error: f32, region: &Region, corners: usize) -> f32 {
    libm::cbrtf(cubed_cost(error, region, corners))
}

/// The third power of [`unfolded_cost`].
#[inline]
pub(crate) fn cubed_cost(error: f32, region: &Region, corners: usize) -> f32 {
    let texels = region.texels() + ENTRY_TEXELS + CORNER_TEXELS * corners as f32;
    error * texels * texels
}

/// Replaces numbers by their cube roots, those of `libm`: its steps, several numbers at once.
pub(crate) fn take_cube_roots<const COUNT: usize>(numbers: &mut [f32; COUNT]) {
    const FIRST_GUESS: u32 = 709_958_130;
    let closer = |root: f64, x: f64| {
        let cube = root * root * root;
        root * (x + x + cube) / (x + cube + cube)
    };
    let mut roots = [0.0; COUNT];
    for (root, &x) in roots.iter_mut().zip(numbers.iter()) {
        let guess = f64::from(f32::from_bits(x.to_bits() / 3 + FIRST_GUESS));
        let x = f64::from(x);
        *root = closer(closer(guess, x), x) as f32;
    }
    for (number, root) in numbers.iter_mut().zip(roots) {
        let is_usual = (f32::MIN_POSITIVE..f32::INFINITY).contains(number);
        *number = if is_usual { root } else { libm::cbrtf(*number) };
    }
}

/// The same at least, of nothing shrunk: with so many texels and so long an outline, or a disc's if that is longer, in blocks or, if it may be, in a
/// square without gaps.
pub(crate) fn least_unfolded_cost(texels: f32, outline: f32, corners: usize, may_be_square: bool) -> f32 {
    let outline = outline.max(Region::disc(texels).outline);
    let side = if may_be_square { texels.sqrt() } else { f32::INFINITY };
    unfolded_cost(texels, &Region { size: Vec2::splat(side), area: texels, outline }, corners)
}

/// The direction in which facets of given normals and areas are seen with the least error, nearly, from a first guess: the
/// error's gradient weighs normals by the inverse fifth power of their cosine.
pub(crate) fn direction(facets: impl Iterator<Item = (Vec3, f32)> + Clone, mut guess: Vec3) -> Vec3 {
    for _ in 0..DIRECTION_ROUNDS {
        let mut sum = Vec3::ZERO;
        for (normal, area) in facets.clone() {
            let cos = normal.dot(guess).max(MIN_COSINE);
            let squared = cos * cos;
            sum += normal * (area / (squared * squared * cos));
        }
        let Some(next) = sum.try_normalize() else { break };
        // Half way: the full step goes too far where normals disagree.
        let Some(middle) = (next + guess).try_normalize() else { break };
        guess = middle;
    }
    guess
}

const DIRECTION_ROUNDS: usize = 4;

/// The integral over a patch of products of its metric, from which errors follow for every scale along the axes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Distortion {
    area: f32,
    xx: f32,
    xy: f32,
    yy: f32,
}

/// Density along the axes of a tile relative to the mean, at most that far from one.
const MAX_ASPECT: f32 = 2.0;

/// The most and the least that a tile's density may differ from the nominal one.
const DENSITY_RANGE: [f32; 2] = [0.7, 4.0];

impl Distortion {
    /// Adds a facet of unit normal `normal` in the frame of a projection (its z along the direction).
    pub(crate) fn add_projected(&mut self, normal: Vec3, area: f32) {
        let z = normal.z.max(MIN_COSINE);
        let slope = normal.truncate() / z;
        self.add([1.0 + slope.x * slope.x, slope.x * slope.y, 1.0 + slope.y * slope.y], area);
    }

    /// Adds a facet by two of its edges on the surface and in the plane.
    pub(crate) fn add_edges(&mut self, spatial: [Vec3; 2], planar: [Vec2; 2], area: f32) {
        let [p, q] = planar;
        let determinant = p.perp_dot(q);
        let limit = 1.0 / (MIN_COSINE * MIN_COSINE);
        // The inverse of the planar edges takes the axes to combinations of the edges.
        let inverse = determinant.abs().max(f32::MIN_POSITIVE).recip() * determinant.signum();
        let x = (spatial[0] * q.y - spatial[1] * p.y) * inverse;
        let y = (spatial[1] * p.x - spatial[0] * q.x) * inverse;
        let metric = [x.length_squared(), x.dot(y), y.length_squared()];
        let clamped = metric.map(|m| if m.is_finite() { m.clamp(-limit, limit) } else { limit });
        self.add(clamped, area);
    }

    /// The area of all facets, mesh units.
    pub(crate) fn area(&self) -> f32 {
        self.area
    }

    fn add(&mut self, [xx, xy, yy]: [f32; 3], area: f32) {
        self.area += area;
        self.xx += area * xx * xx;
        self.xy += area * xy * xy;
        self.yy += area * yy * yy;
    }

    /// The factors of the density along both axes that have the least error for their product, which is one.
    pub(crate) fn aspect(&self) -> Vec2 {
        let ratio = (self.xx / self.yy.max(f32::MIN_POSITIVE)).powf(0.125);
        let ratio = if ratio.is_finite() { ratio.clamp(1.0 / MAX_ASPECT, MAX_ASPECT) } else { 1.0 };
        Vec2::new(ratio, 1.0 / ratio)
    }

    /// The error at factors of the density along both axes.
    pub(crate) fn error(&self, factors: Vec2) -> f32 {
        let Vec2 { x, y } = factors * factors;
        0.5 * (self.xx / (x * x) + 2.0 * self.xy / (x * y) + self.yy / (y * y))
    }

    /// The density of a tile relative to all others' that makes the most of the texels, for a region in texels, of
    /// which there are `texels_per_area`.
    pub(crate) fn density(&self, region: Region, texels_per_area: f32) -> f32 {
        let aspect = self.aspect();
        let error = self.error(aspect) * texels_per_area;
        clamped_density((error / region.scaled(aspect).texels()).powf(1.0 / 6.0))
    }

    /// The density at which the error is that of a surface at the nominal density.
    pub(crate) fn density_for_nominal(&self) -> f32 {
        clamped_density((self.error(self.aspect()) / self.area.max(f32::MIN_POSITIVE)).powf(0.25))
    }

    /// The cost of the patch that takes up a region, in texels, at the best aspect, with coordinates for so many corners.
    pub(crate) fn cost(&self, region: Region, texels_per_area: f32, corners: usize) -> f32 {
        let aspect = self.aspect();
        unfolded_cost(self.error(aspect) * texels_per_area, &region.scaled(aspect), corners)
    }
}

fn clamped_density(density: f32) -> f32 {
    if density.is_finite() { density.clamp(DENSITY_RANGE[0], DENSITY_RANGE[1]) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cube_roots_are_those_of_the_library() {
        let mut bits = 1_u32;
        for _ in 0..2000 {
            let numbers: [f32; 16] = std::array::from_fn(|_| {
                bits = bits.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
                f32::from_bits(bits)
            });
            let mut roots = numbers;
            take_cube_roots(&mut roots);
            assert_eq!(roots.map(f32::to_bits), numbers.map(|x| libm::cbrtf(x).to_bits()), "{numbers:?}");
        }
    }
}
