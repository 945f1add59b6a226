//! Solid textures: functions of the point in space, so that an object looks carved from a block.
//!
//! Recipes are written for a model whose bounding sphere has radius 1 about the origin; [`Placed`] brings a point there.

/// A recipe that is evaluated as it is, and whose pattern depends on a seed.
macro_rules! seeded {
    ($solid:ident $(, |$of:ident| $check:block)?) => {
        impl $solid {
            /// The default parameters with a pattern of one's own.
            pub fn new(seed: u32) -> Self {
                Self { seed, ..Self::default() }
            }
        }

        impl $crate::Recipe for $solid {
            type Solid = Self;

            fn prepared(&self, seed: u32) -> Self {
                Self { seed: self.seed.wrapping_add(seed), ..*self }
            }

            $(fn check(&self) -> fantex_base::Result<()> {
                let $of = self;
                $check
            })?
        }
    };
}

mod landscape;
mod pattern;
mod rings;
mod stone;

use arrayvec::ArrayVec;
use fantex_base::{Aabb, Error, Result};
use glam::{Vec3, Vec4};

use crate::coordinates::NormalAxes;
use crate::noise::{Fractal, Noise, OctaveShape};

use crate::{ShadingPoint, Texture};

pub use landscape::Landscape;
pub use pattern::{Brick, Checker, CloudField, Clouds};
pub use rings::Rings;
pub use stone::{Granite, Marble, Rock, Wood};

/// Where a solid is asked for its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidPoint {
    /// The point.
    pub p: Vec3,
    /// The unit normal of the surface, in the axes of [`Solid::normal_axes`].
    pub n: Vec3,
    /// The width over which the caller averages, in the units of `p`; 0 for the exact value at the point.
    pub footprint: f32,
    /// Seconds since the start of an animation.
    pub time: f32,
}

/// A texture that is defined everywhere in space.
pub trait Solid: Send + Sync {
    /// The colours of many points, linear RGBA; details narrower than the footprint have faded to their mean. Panics where the
    /// slices differ in length.
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]);

    /// The colour of one point.
    fn color(&self, at: &SolidPoint) -> [f32; 4] {
        let mut color = [[0.0; 4]];
        self.colors(std::slice::from_ref(at), &mut color);
        color[0]
    }

    /// The axes of the normal where the solid is placed in an object.
    fn normal_axes(&self) -> NormalAxes {
        NormalAxes::Object
    }
}

impl Solid for Box<dyn Solid> {
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        (**self).colors(at, colors);
    }

    fn normal_axes(&self) -> NormalAxes {
        (**self).normal_axes()
    }
}

/// Calls `block` with up to [`BLOCK`] points and their colours at a time.
fn in_blocks(
    at: &[SolidPoint],
    colors: &mut [[f32; 4]],
    mut block: impl FnMut(&[SolidPoint], &mut [[f32; 4]]),
) {
    assert_eq!(at.len(), colors.len(), "one colour for every point");
    at.chunks(BLOCK).zip(colors.chunks_mut(BLOCK)).for_each(|(at, colors)| block(at, colors));
}

/// Points that recipes work on at a time.
const BLOCK: usize = 64;

/// What recipes note about a block of points.
type Notes<T> = ArrayVec<T, BLOCK>;

/// A block of points, coordinate by coordinate, as vectors take them.
struct Columns {
    count: usize,
    coordinates: [[f32; BLOCK]; 3],
    footprint: [f32; BLOCK],
}

impl Columns {
    /// Those of up to [`BLOCK`] points.
    fn of(at: &[SolidPoint]) -> Self {
        let mut columns =
            Self { count: at.len().min(BLOCK), coordinates: [[0.0; BLOCK]; 3], footprint: [0.0; BLOCK] };
        for (i, at) in at.iter().take(BLOCK).enumerate() {
            columns.set(i, at.p, at.footprint);
        }
        columns
    }

    #[inline]
    fn set(&mut self, i: usize, p: Vec3, footprint: f32) {
        let [x, y, z] = &mut self.coordinates;
        (x[i], y[i], z[i]) = (p.x, p.y, p.z);
        self.footprint[i] = footprint;
    }

    /// The numbers of the points.
    #[inline]
    fn numbers(&self) -> std::ops::Range<usize> {
        // What the compiler knows of them spares checks.
        0..self.count.min(BLOCK)
    }

    /// A point.
    #[inline]
    fn p(&self, i: usize) -> Vec3 {
        let [x, y, z] = &self.coordinates;
        Vec3::new(x[i], y[i], z[i])
    }

    /// Calls `then` with the numbers of the points that are `wanted` and with these points, if there are any.
    fn for_some(&self, wanted: impl Fn(usize) -> bool, then: impl FnOnce(&[usize], &Self)) {
        let mut some = [0; BLOCK];
        let mut points = Self { count: 0, coordinates: [[0.0; BLOCK]; 3], footprint: [0.0; BLOCK] };
        for i in self.numbers().filter(|&i| wanted(i)) {
            some[points.count] = i;
            points.set(points.count, self.p(i), self.footprint[i]);
            points.count += 1;
        }
        match points.count {
            0 => {}
            count if count == self.count => then(&some[..count], self),
            count => then(&some[..count], &points),
        }
    }
}

/// A recipe scaled to a model.
#[derive(Clone, Copy, Debug)]
pub struct Placed<S> {
    /// The recipe in its own units.
    pub solid: S,
    /// The point that becomes the recipe's origin.
    pub center: Vec3,
    /// The length that becomes 1.
    pub radius: f32,
}

impl<S> Placed<S> {
    fn inside(&self, at: &SolidPoint) -> SolidPoint {
        // One division of four numbers.
        let inside = (at.p.extend(at.footprint) - self.center.extend(0.0)) / self.radius;
        SolidPoint { p: inside.truncate(), n: at.n, footprint: inside.w, time: at.time }
    }
}

impl<S: Solid> Solid for Placed<S> {
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        in_blocks(at, colors, |at, colors| {
            let mut inside = Notes::<SolidPoint>::new();
            inside.extend(at.iter().map(|at| self.inside(at)));
            self.solid.colors(&inside, colors);
        });
    }

    fn normal_axes(&self) -> NormalAxes {
        self.solid.normal_axes()
    }
}

/// The parameters of a solid, as files hold them.
pub trait Recipe {
    /// What is evaluated.
    type Solid: Solid + 'static;

    /// The solid of another pattern: `seed` is added to the recipe's own.
    fn prepared(&self, seed: u32) -> Self::Solid;

    /// Whether all numbers are in range.
    ///
    /// # Errors
    /// The first number that is not.
    fn check(&self) -> fantex_base::Result<()> {
        Ok(())
    }
}

/// The names that [`solid_by_name`] knows.
pub const SOLID_NAMES: [&str; 9] =
    ["wood", "rings", "marble", "rock", "granite", "clouds", "checker", "brick", "landscape"];

/// What to say of a name that is none of [`SOLID_NAMES`].
pub fn unknown_solid(name: &str) -> Error {
    Error::invalid(format!(
        "'{name}' is no solid; use wood, rings, marble, rock, granite, clouds, checker, brick or landscape"
    ))
}

/// The recipe `name`, scaled to a model with these bounds.
///
/// # Errors
/// There is no such recipe.
pub fn solid_by_name(name: &str, bounds: Aabb, seed: u32) -> Result<Box<dyn Solid>> {
    let center = bounds.center();
    let radius = 0.5 * (bounds.max - bounds.min).length();
    let radius = if radius > 0.0 { radius } else { 1.0 };
    fn placed<S: Solid + 'static>(solid: S, center: Vec3, radius: f32) -> Box<dyn Solid> {
        Box::new(Placed { solid, center, radius })
    }
    Ok(match name {
        "wood" => placed(Wood::new(seed), center, radius),
        "rings" => placed(Rings::default(), center, radius),
        "marble" => placed(Marble::new(seed), center, radius),
        "rock" => placed(Rock::new(seed), center, radius),
        "granite" => placed(Granite::new(seed), center, radius),
        "clouds" => placed(Clouds::default().prepared(seed), center, radius),
        "checker" => placed(Checker::default(), center, radius),
        "brick" => placed(Brick::new(seed), center, radius),
        "landscape" => {
            let half_height = (0.5 * (bounds.max.y - bounds.min.y) / radius).max(1e-6);
            placed(Landscape { half_height, ..Landscape::new(seed) }, center, radius)
        }
        _ => return Err(unknown_solid(name)),
    })
}

/// A solid as a texture of object space; [`Placed`] or a placed solid brings points into the recipe's units.
#[derive(Clone, Copy, Debug)]
pub struct SolidTexture<S>(pub S);

impl<S: Solid> Texture for SolidTexture<S> {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let point = SolidPoint { p: at.position, n: at.normal, footprint: at.width(), time: at.time };
        Vec4::from_array(self.0.color(&point))
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        assert_eq!(at.len(), values.len(), "one value for every point");
        for (at, values) in at.chunks(BLOCK).zip(values.chunks_mut(BLOCK)) {
            let point = |at: &ShadingPoint<'_>| SolidPoint {
                p: at.position,
                n: at.normal,
                footprint: at.width(),
                time: at.time,
            };
            let mut points = Notes::<SolidPoint>::new();
            points.extend(at.iter().map(point));
            self.0.colors(&points, bytemuck::cast_slice_mut(values));
        }
    }
}

/// Fractal Brownian motion of a block of points, each scaled and shifted by `place`; `frequency` is how much that shortens
/// lengths. Beyond the last point it is 0.
fn fbm(
    noise: &Noise,
    at: &Columns,
    octaves: u32,
    frequency: f32,
    place: impl Fn(usize, Vec3) -> Vec3,
) -> [f32; BLOCK] {
    fractal_sum(OctaveShape::PLAIN, noise, at, Fractal::octaves(octaves), frequency, place)
}

/// As [`fbm`], of any octaves.
fn fractal_sum(
    octave: OctaveShape,
    noise: &Noise,
    at: &Columns,
    octaves: Fractal,
    frequency: f32,
    place: impl Fn(usize, Vec3) -> Vec3,
) -> [f32; BLOCK] {
    let mut sums = [0.0; BLOCK];
    let out = &mut sums[at.numbers()];
    noise.sums_of(octave, octaves, |i| place(i, at.p(i)), |i| frequency * at.footprint[i], out);
    sums
}

/// One octave at a block of points, each scaled and shifted by `place`. Beyond the last point it is 0.
fn values(noise: &Noise, at: &Columns, place: impl Fn(usize, Vec3) -> Vec3) -> [f32; BLOCK] {
    let mut values = [0.0; BLOCK];
    noise.values_of(|i| place(i, at.p(i)), &mut values[at.numbers()]);
    values
}

/// `x.rem_euclid(PERIOD)` of a period that is a power of two, without a call of the library where `x` is not large.
#[inline]
fn remainder<const PERIOD: u8>(x: f32) -> f32 {
    let period = f32::from(PERIOD);
    let periods = x / period;
    if periods.abs() < 1e6 {
        // Exact, as no digit of the difference is finer than those of `x`.
        let rest = x - (periods as i32) as f32 * period;
        if rest < 0.0 { rest + period } else { rest }
    } else {
        x.rem_euclid(period)
    }
}

fn opaque(rgb: Vec3) -> [f32; 4] {
    [rgb.x, rgb.y, rgb.z, 1.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn remainders_are_those_of_the_library() {
        let near = (-4000..4000).map(|i| i as f32 * 0.125 + 1e-7 * (i % 3) as f32);
        for x in near.chain([1e-30, -1e-30, 1.9e6, -2.1e6, 3e9, -3e9, 1e30]) {
            assert_eq!(remainder::<1>(x), x.rem_euclid(1.0), "{x}");
            assert_eq!(remainder::<2>(x), x.rem_euclid(2.0), "{x}");
        }
        assert!(remainder::<2>(f32::NAN).is_nan());
    }
}
