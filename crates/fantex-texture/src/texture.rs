//! The interface of all textures: a point of a surface (or of space) with a footprint in, a value out.

use std::fmt;

use glam::{Vec2, Vec3, Vec4};

use crate::Eye;
use crate::combine::TextureUse;
use crate::look::Slot;

/// Where a texture is asked, and how far the asker averages.
///
/// The footprint is a parallelogram around the point: for a picture one pixel (edges to the right and downwards), for a bake
/// one texel (edges along its width and height). Everything that varies over the surface comes with its change along both
/// edges, to first order.
#[derive(Clone, Copy, Debug)]
pub struct ShadingPoint<'a> {
    /// Object space: world units and axes, origin in the middle of the model's bounding box.
    pub position: Vec3,
    /// Change of `position` along the footprint's edges.
    pub position_steps: [Vec3; 2],
    /// Unit normal of the smooth surface, object space, on its front: a bake has no other side.
    pub normal: Vec3,
    /// Change of `normal` along the footprint's edges.
    pub normal_steps: [Vec3; 2],
    /// Texture coordinates of the model, one entry per set; empty where it has none.
    pub uv: &'a [UvPoint],
    /// Linear RGBA of the model's vertex colours, white where it has none.
    pub vertex_color: Vec4,
    /// The eye; `None` in a bake, which has none.
    pub eye: Option<Eye<'a>>,
    /// Seconds since the start of an animation.
    pub time: f32,
    /// How discrete textures are filtered.
    pub filtering: Filtering,
}

/// Texture coordinates at a point, with their change along the footprint's edges.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UvPoint {
    /// `u` to the right and `v` downwards, `[0,1]` over the image.
    pub uv: Vec2,
    /// Change along the footprint's edges.
    pub steps: [Vec2; 2],
}

/// How discrete textures are filtered over the footprint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filtering {
    /// By the texture's own filter: for pictures.
    #[default]
    Own,
    /// By the exact mean over the footprint, which is a texel: for bakes.
    Area,
}

/// Sets of texture coordinates that are moved without allocation.
const INLINE_UV_SETS: usize = 4;

impl ShadingPoint<'_> {
    /// Asks at the point moved by `a` and `b` times the footprint's edges: position, normal and texture coordinates change
    /// to first order, everything else (the footprint's size too) stays.
    pub fn shifted<R>(&self, a: f32, b: f32, ask: impl FnOnce(&ShadingPoint<'_>) -> R) -> R {
        self.part(Vec2::new(a, b), 1.0, ask)
    }

    /// The same with a footprint that is `share` times as wide.
    pub fn part<R>(&self, at: Vec2, share: f32, ask: impl FnOnce(&ShadingPoint<'_>) -> R) -> R {
        let [a, b] = at.to_array();
        let move_uv = |set: &UvPoint| UvPoint {
            uv: set.uv + set.steps[0] * a + set.steps[1] * b,
            steps: set.steps.map(|step| step * share),
        };
        let (mut inline, heap);
        let uv = if self.uv.len() <= INLINE_UV_SETS {
            inline = [UvPoint::default(); INLINE_UV_SETS];
            inline.iter_mut().zip(self.uv).for_each(|(moved, set)| *moved = move_uv(set));
            &inline[..self.uv.len()]
        } else {
            heap = self.uv.iter().map(move_uv).collect::<Vec<_>>();
            &heap
        };
        let normal = self.normal + self.normal_steps[0] * a + self.normal_steps[1] * b;
        ask(&ShadingPoint {
            position: self.position + self.position_steps[0] * a + self.position_steps[1] * b,
            position_steps: self.position_steps.map(|step| step * share),
            normal: normal.try_normalize().unwrap_or(self.normal),
            normal_steps: self.normal_steps.map(|step| step * share),
            uv,
            ..*self
        })
    }

    /// The width over which the asker averages, in the units of `position`: the root mean square of the edges.
    pub fn width(&self) -> f32 {
        let [x, y] = self.position_steps;
        (0.5 * (x.length_squared() + y.length_squared())).sqrt()
    }
}

/// A texture: a function of a surface point.
pub trait Texture: Send + Sync {
    /// Linear RGBA with straight alpha. Textures of a single number (heights, masks) give it as red, green and blue.
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4;

    /// [`Texture::evaluate`] at many points. Textures that look up many texels, or work out many numbers, faster than one by
    /// one override this; images may differ by what [`ImageTexture::sample_all`](crate::ImageTexture::sample_all) differs by.
    /// Panics where the slices differ in length.
    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        assert_eq!(at.len(), values.len(), "one value for every point");
        at.iter().zip(values).for_each(|(at, value)| *value = self.evaluate(at));
    }

    /// Itself, for the use of another texture: whoever asks several uses of one texture may ask it once and make their values of its.
    fn as_use(&self) -> Option<&TextureUse> {
        None
    }

    /// How many of the footprint's edges are a texel long, along each of both; `None` for textures that have no texels, or several
    /// kinds. Differences of heights step so far at least: within a texel, they would show the interpolation.
    fn edges_per_texel(&self, at: &ShadingPoint<'_>) -> Option<[f32; 2]> {
        let _ = at;
        None
    }

    /// Whether the value depends on something besides positions and normals.
    fn depends_on(&self, what: Dependence) -> bool {
        let _ = what;
        false
    }

    /// Whether the value depends on the eye: such a texture cannot be baked.
    fn is_view_dependent(&self) -> bool {
        self.depends_on(Dependence::Eye)
    }

    /// Whether the value depends on the time.
    fn is_animated(&self) -> bool {
        self.depends_on(Dependence::Time)
    }
}

/// What a texture may depend on besides positions and normals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dependence {
    /// Where it is seen from.
    Eye,
    /// Seconds since the start of an animation.
    Time,
    /// A set of the model's texture coordinates, counted from 0.
    Uv(usize),
}

impl fmt::Debug for dyn Texture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Texture(..)")
    }
}

/// The same value everywhere.
impl Texture for Vec4 {
    fn evaluate(&self, _at: &ShadingPoint<'_>) -> Vec4 {
        *self
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        assert_eq!(at.len(), values.len(), "one value for every point");
        values.fill(*self);
    }
}

/// A constant or a texture, as a texture again.
impl Texture for Slot {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        Self::evaluate(self, at)
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        match self {
            Self::Constant(value) => value.evaluate_all(at, values),
            Self::Texture(texture) => texture.evaluate_all(at, values),
        }
    }

    fn edges_per_texel(&self, at: &ShadingPoint<'_>) -> Option<[f32; 2]> {
        if let Self::Texture(texture) = self { texture.edges_per_texel(at) } else { None }
    }

    fn depends_on(&self, what: Dependence) -> bool {
        matches!(self, Self::Texture(texture) if texture.depends_on(what))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shifted_points_move_by_the_edges_of_the_footprint() {
        let set = UvPoint { uv: Vec2::new(0.5, 0.25), steps: [Vec2::new(0.1, 0.0), Vec2::new(0.0, 0.2)] };
        for count in [0, 1, INLINE_UV_SETS, INLINE_UV_SETS + 3] {
            let uv = vec![set; count];
            let point = ShadingPoint {
                position: Vec3::new(1.0, 2.0, 3.0),
                position_steps: [Vec3::X, Vec3::Z],
                normal: Vec3::Y,
                normal_steps: [Vec3::X, Vec3::ZERO],
                uv: &uv,
                vertex_color: Vec4::ONE,
                eye: None,
                time: 2.0,
                filtering: Filtering::Own,
            };
            point.shifted(1.0, -0.5, |moved| {
                assert_eq!(moved.position, Vec3::new(2.0, 2.0, 2.5));
                assert!((moved.normal - Vec3::new(1.0, 1.0, 0.0).normalize()).length() < 1e-6);
                assert_eq!(moved.uv.len(), count);
                assert!(moved.uv.iter().all(|set| (set.uv - Vec2::new(0.6, 0.15)).length() < 1e-6));
                assert_eq!(moved.time, 2.0);
            });
        }
    }
}
