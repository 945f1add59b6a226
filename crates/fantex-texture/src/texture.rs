//! The interface of all textures: a point of a surface (or of space) with a footprint in, a value out.

use std::fmt;

use glam::{Vec2, Vec3, Vec4};

/// Where a texture is asked, and how far the asker averages.
///
/// The footprint is a parallelogram around the point: for a picture one pixel (edges to the right and downwards), for a bake
/// one texel (edges along its width and height). Everything that varies over the surface comes with its change along both
/// edges, to first order.
#[derive(Clone, Copy, Debug)]
pub struct ShadingPoint<'a> {
    /// Object space: world units and axes, origin at the centre of the model's bounding box.
    pub position: Vec3,
    /// Change of `position` along the footprint's edges.
    pub position_steps: [Vec3; 2],
    /// Unit normal of the smooth surface, object space, on the side that is asked.
    pub normal: Vec3,
    /// Change of `normal` along the footprint's edges.
    pub normal_steps: [Vec3; 2],
    /// Texture coordinates of the model, one entry per set; empty where it has none.
    pub uv: &'a [UvPoint],
    /// Linear RGBA of the model's vertex colours, white where it has none.
    pub vertex_color: Vec4,
    /// Unit vector to the eye, object space; `None` in a bake, which has no eye.
    pub to_eye: Option<Vec3>,
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

impl ShadingPoint<'_> {
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

    /// Whether the value depends on the eye: such a texture cannot be baked.
    fn is_view_dependent(&self) -> bool {
        false
    }

    /// Whether the value depends on the time.
    fn is_animated(&self) -> bool {
        false
    }
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
}
