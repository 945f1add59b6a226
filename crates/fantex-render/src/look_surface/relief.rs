//! Bent normals.
//!
//! Bump mapping in the form that needs no parametrisation (M. Mikkelsen, "Bump Mapping Unparametrized Surfaces on the GPU",
//! 2010): Blinn's `N' = N + (F_u (N x P_v) - F_v (N x P_u)) / |N|` holds for any two directions in the surface, and the edges
//! of the pixel's footprint are two whose changes of position and height are at hand.

use fantex_texture::look::Difference;
use fantex_texture::material::TangentFrame;
use fantex_texture::{ShadingPoint, Texture};
use glam::{Quat, Vec2, Vec3, Vec4};

use super::point::{evaluate_beside, spread};

/// Smallest step of a difference, as a share of the mesh's unit: below, single precision would be seen.
pub(super) const LEAST_STEP: f32 = 5e-5;

/// Points of the footprint at which slopes are looked up to find their variance.
const SLOPES: usize = 8;

/// After this many points that agree with the mean slope no more are asked.
const SLOPES_TO_AGREE: usize = 2;

/// Width of the slopes' own footprints, as a share of the pixel's.
const SLOPE_SHARE: f32 = 1.0 / 64.0;

/// Variance of slopes that no highlight shows.
const INVISIBLE_VARIANCE: f32 = 1e-5;

/// What relief does to a normal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bent {
    /// Unit vector.
    pub(super) normal: Vec3,
    /// Variance, along each axis, of the slopes within the footprint.
    pub(super) slope_variance: f32,
}

/// Two directions in a surface, as what is perpendicular to them: a function that changes by `d` along them has the surface
/// gradient `(d.x x + d.y y)`.
#[derive(Clone, Copy, Debug)]
struct GradientAxes {
    x: Vec3,
    y: Vec3,
}

impl GradientAxes {
    /// `None` where the directions are parallel in the plane of `normal`.
    fn new([along_x, along_y]: [Vec3; 2], normal: Vec3) -> Option<Self> {
        let x = along_y.cross(normal);
        let determinant = along_x.dot(x);
        let scale = determinant.recip();
        let is_plane = determinant.abs() > 1e-6 * along_x.length() * along_y.length();
        (is_plane && scale.is_finite()).then(|| Self { x: x * scale, y: normal.cross(along_x) * scale })
    }

    fn gradient(&self, change: Vec2) -> Vec3 {
        self.x * change.x + self.y * change.y
    }
}

/// Bump mapping by a texture of heights.
pub(super) struct Bump<'a> {
    pub(super) texture: &'a dyn Texture,
    /// World units per unit of the texture.
    pub(super) height: f32,
    pub(super) difference: Difference,
    /// World units.
    pub(super) least_step: f32,
}

impl Bump<'_> {
    /// Bends a unit normal.
    pub(super) fn bend(&self, normal: Vec3, at: &ShadingPoint, with_variance: bool) -> Bent {
        let unbent = Bent { normal, slope_variance: 0.0 };
        let Some(axes) = GradientAxes::new(at.position_steps, normal) else { return unbent };
        let gradient = axes.gradient(self.change(at));
        let Some(bent) = (normal - gradient).try_normalize() else { return unbent };
        let slope_variance = if with_variance { self.slope_variance(at, &axes, gradient) } else { 0.0 };
        Bent { normal: bent, slope_variance }
    }

    /// Change of the height along the footprint's edges, from differences over half of them.
    fn change(&self, at: &ShadingPoint) -> Vec2 {
        let height = |offset: Vec2| self.height * evaluate_beside(self.texture, at, offset, 1.0).x;
        let steps = at.position_steps.map(|edge| self.least_share(edge).max(0.5));
        let here = match self.difference {
            Difference::Central => 0.0,
            Difference::Forward | Difference::Backward => height(Vec2::ZERO),
        };
        let along = |axis: Vec2, step: f32| match self.difference {
            Difference::Forward => (height(axis * step) - here) / step,
            Difference::Backward => (here - height(axis * -step)) / step,
            Difference::Central => (height(axis * step) - height(axis * -step)) / (2.0 * step),
        };
        Vec2::new(along(Vec2::X, steps[0]), along(Vec2::Y, steps[1]))
    }

    /// The share of an edge that still has enough digits for a difference along it; may be larger than one.
    fn least_share(&self, edge: Vec3) -> f32 {
        let length = edge.length();
        if length > 0.0 { (self.least_step / length).min(1e6) } else { 1.0 }
    }

    /// Variance of the slopes within the footprint.
    fn slope_variance(&self, at: &ShadingPoint, axes: &GradientAxes, mean: Vec3) -> f32 {
        let [along, across] = at.position_steps.map(|edge| self.least_share(edge));
        let share = along.max(across).max(SLOPE_SHARE);
        if share > 0.5 {
            return 0.0;
        }
        let height = |offset: Vec2| evaluate_beside(self.texture, at, offset, share).x;
        variance(mean, |p| {
            let here = height(p);
            let there = Vec2::new(height(p + Vec2::X * share), height(p + Vec2::Y * share));
            axes.gradient((there - here) * (self.height / share))
        })
    }
}

/// Bump mapping by a texture that holds derivatives in green and blue.
pub(super) struct DerivativeMap<'a> {
    pub(super) texture: &'a dyn Texture,
    /// Whose `u` and `v` the derivatives belong to.
    pub(super) uv_set: usize,
    /// World height of the largest derivative that the encoding holds, per unit of `u` or `v`.
    pub(super) scale: f32,
}

impl DerivativeMap<'_> {
    /// Bends a unit normal.
    pub(super) fn bend(&self, normal: Vec3, at: &ShadingPoint, with_variance: bool) -> Bent {
        let unbent = Bent { normal, slope_variance: 0.0 };
        let axes = GradientAxes::new(at.position_steps, normal);
        let (Some(uv), Some(axes)) = (at.uv.get(self.uv_set), axes) else { return unbent };
        let gradient = |texel: Vec4| {
            let by_uv = Vec2::new(texel.y * 2.0 - 1.0, texel.z * 2.0 - 1.0) * self.scale;
            axes.gradient(Vec2::new(by_uv.dot(uv.steps[0]), by_uv.dot(uv.steps[1])))
        };
        let mean = gradient(self.texture.evaluate(at));
        let Some(normal) = (normal - mean).try_normalize() else { return unbent };
        let slope = |p: Vec2| gradient(evaluate_beside(self.texture, at, p, SLOPE_SHARE));
        let slope_variance = if with_variance { variance(mean, slope) } else { 0.0 };
        Bent { normal, slope_variance }
    }
}

/// Variance of the slopes along each axis, around the slope of the whole footprint. Where the footprint is smaller than the
/// relief, the first points agree, and that was all.
fn variance(mean: Vec3, slope: impl Fn(Vec2) -> Vec3) -> f32 {
    let mut sum = 0.0;
    for i in 0..SLOPES {
        sum += 0.5 * (slope(spread(i)) - mean).length_squared();
        if i + 1 == SLOPES_TO_AGREE && sum < INVISIBLE_VARIANCE {
            return 0.0;
        }
    }
    if sum.is_finite() { sum / SLOPES as f32 } else { 0.0 }
}

/// Bends a unit normal by a decoded texel of a normal map, in tangent space or (without a frame) in the model's axes. What
/// bent the normal before is kept: the map's normal is turned as the vertex normal was.
pub(super) fn bend_by_normal(
    normal: Vec3,
    vertex_normal: Vec3,
    texel: Vec3,
    scale: f32,
    frame: Option<&TangentFrame>,
) -> Bent {
    let unbent = Bent { normal, slope_variance: 0.0 };
    let bent = match frame {
        Some(frame) => frame.mesh_vector(texel * Vec3::new(scale, scale, 1.0)),
        None => {
            let upright = vertex_normal * vertex_normal.dot(texel);
            upright + (texel - upright) * scale
        }
    };
    let Some(bent) = bent.try_normalize() else { return unbent };
    let turned =
        if normal == vertex_normal { bent } else { Quat::from_rotation_arc(vertex_normal, normal) * bent };
    Bent { normal: turned, slope_variance: scale * scale * mean_normal_variance(texel.length()) }
}

/// Shortest mean of unit normals that rounding to bytes explains.
const ROUNDED_LENGTH: f32 = 1.0 - 1.0 / 255.0;

/// Variance, along each axis, of the slopes of unit normals whose mean has this length.
fn mean_normal_variance(length: f32) -> f32 {
    let length = (length / ROUNDED_LENGTH).clamp(0.05, 1.0);
    (1.0 - length) / length
}

#[cfg(test)]
mod tests;
