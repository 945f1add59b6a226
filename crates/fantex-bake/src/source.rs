//! What is baked: functions of a surface point and a texel's footprint.

use fantex_store::ChannelKind;
use glam::{Vec3, Vec4};

/// A point of the surface and the texel around it.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Triangle index.
    pub triangle: usize,
    /// Barycentric coordinates; slightly outside 0..1 for texels off the surface.
    pub lambda: Vec3,
    /// Change of `lambda` along the texel's width and height.
    pub lambda_steps: [Vec3; 2],
    /// Mesh space.
    pub position: Vec3,
    /// Change of `position` along the texel's width and height, mesh space.
    pub position_steps: [Vec3; 2],
    /// Unit vertex normal, interpolated, mesh space.
    pub normal: Vec3,
}

/// What a source gives for one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceChannel {
    /// The channel. Normals are given as unit vectors in mesh space (xyz), all others as linear RGBA.
    pub kind: ChannelKind,
    /// True where alpha carries information: it is coverage, and colours count in proportion to it when they are averaged.
    pub has_alpha: bool,
    /// True where values exceed 1, which 8-bit formats cannot hold.
    pub exceeds_one: bool,
}

/// How a value relates to the function at the texel's centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Prefilter {
    /// The value at the point: the function has no detail finer than a texel.
    Point,
    /// The mean over the texel's footprint.
    Box,
}

/// What all texels of a tile that lie on one triangle have in common.
#[derive(Clone, Copy, Debug)]
pub struct TriangleFootprint {
    /// Triangle index.
    pub triangle: usize,
    /// Change of the barycentric coordinates along a texel's width and height.
    pub lambda_steps: [Vec3; 2],
}

/// A source over one triangle: for many points of it at once, writes one value per channel and point, those of a point
/// together.
pub type TriangleSource<'s> = Box<dyn Fn(&[SurfacePoint], &mut [Vec4]) + 's>;

/// A function on the surface that can be baked.
pub trait Source: Sync {
    /// The channels it gives, in the order of `evaluate`'s output.
    fn channels(&self) -> Vec<SourceChannel>;

    /// How its values relate to the texel's centre.
    fn prefilter(&self) -> Prefilter;

    /// Writes one value per channel.
    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]);

    /// The same function for many texels of one triangle. Sources that can prepare something for them override this.
    fn on_triangle(&self, _footprint: &TriangleFootprint) -> TriangleSource<'_> {
        let channels = self.channels().len();
        Box::new(move |points, values| {
            points
                .iter()
                .zip(values.chunks_mut(channels))
                .for_each(|(point, values)| self.evaluate(point, values));
        })
    }
}
