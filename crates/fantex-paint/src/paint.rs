//! What a stroke does to the texels that it covers.

use std::sync::Arc;

use fantex_texture::Texture;
use glam::{Vec3, Vec4};

use crate::{BlendMode, Picture, Projection};

/// Dabs of a smudge should be no farther apart than this, in diameters: farther apart they show as stripes.
pub const SMUDGE_SPACING: f32 = 0.025;

/// What a covered texel becomes.
#[derive(Clone, Debug)]
pub enum Tool {
    /// A colour is laid over what is there.
    Paint(BlendMode),
    /// Alpha goes to zero.
    Erase,
    /// What is seen around is averaged; the channels' colours do not matter.
    Blur {
        /// How far around, mesh units along the surface.
        radius: f32,
    },
    /// What is under the brush is dragged along; the channels' colours do not matter.
    Smudge {
        /// Share of the dragged colour that is left after a way of one brush radius, 0..1.
        strength: f32,
    },
    /// What is seen elsewhere is copied; the channels' colours do not matter.
    Clone {
        /// Mesh space: added to a point, and from there to the nearest point of the surface.
        offset: Vec3,
        /// Mesh units from there to the surface at most; beyond it nothing is copied.
        reach: f32,
    },
}

impl Tool {
    /// True where it asks for what was seen before the stroke.
    pub(crate) fn reads_surface(&self) -> bool {
        matches!(self, Self::Blur { .. } | Self::Clone { .. } | Self::Smudge { .. })
    }
}

/// A colour on the surface: linear RGBA with straight alpha.
#[derive(Clone, Debug)]
pub enum PaintColor {
    /// The same everywhere.
    Constant(Vec4),
    /// A function of object space (world units, origin at the centre of the model's bounding box).
    Texture(Arc<dyn Texture>),
    /// A picture in the coordinates of the [`Decal`](crate::Decal) that lays it; a brush leaves no trace with it.
    Image(Arc<Picture>),
    /// A picture through a camera, onto what the camera sees.
    Projected(Arc<Projection>),
}

/// What is painted into one channel.
#[derive(Clone, Debug)]
pub struct ChannelPaint {
    /// Index of the channel.
    pub channel: usize,
    /// With what.
    pub color: PaintColor,
}

/// What a stroke paints, into all its channels together.
#[derive(Clone, Debug)]
pub struct Paint {
    /// How.
    pub tool: Tool,
    /// Most that it covers, 0..1.
    pub opacity: f32,
    /// Where to; none twice.
    pub channels: Vec<ChannelPaint>,
    /// A picture through a camera that the stroke is laid on through: what it covers is multiplied by the picture's alpha, and
    /// nothing is covered beside the picture and where the camera does not see. Projected colours then count without
    /// their alpha.
    pub stencil: Option<Arc<Projection>>,
}

impl Paint {
    /// The texel after the stroke; `coverage` 0..1 is what the dabs have gathered.
    pub(crate) fn apply(&self, before: Vec4, color: Vec4, coverage: f32) -> Vec4 {
        let share = coverage * self.opacity.clamp(0.0, 1.0);
        match self.tool {
            Tool::Paint(mode) => mode.compose(before, color, share),
            Tool::Erase => before.truncate().extend(before.w * (1.0 - share)),
            Tool::Blur { .. } | Tool::Clone { .. } | Tool::Smudge { .. } => mixed(before, color, share),
        }
    }
}

/// Between two straight colours, each weighted by its alpha.
pub(crate) fn mixed(a: Vec4, b: Vec4, share: f32) -> Vec4 {
    let (wa, wb) = (a.w * (1.0 - share), b.w * share);
    if wa + wb > 0.0 { ((a.truncate() * wa + b.truncate() * wb) / (wa + wb)).extend(wa + wb) } else { a }
}
