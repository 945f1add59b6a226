//! What a stroke does to the texels that it covers.

use std::sync::Arc;

use fantex_texture::Texture;
use glam::Vec4;

use crate::BlendMode;

/// What a covered texel becomes.
#[derive(Clone, Debug)]
pub enum Tool {
    /// A colour is laid over what is there.
    Paint(BlendMode),
    /// Alpha goes to zero.
    Erase,
}

/// A colour on the surface: linear RGBA with straight alpha.
#[derive(Clone, Debug)]
pub enum PaintColor {
    /// The same everywhere.
    Constant(Vec4),
    /// A function of object space (world units, origin at the centre of the model's bounding box).
    Texture(Arc<dyn Texture>),
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
}

impl Paint {
    /// The texel after the stroke; `coverage` 0..1 is what the dabs have gathered.
    pub(crate) fn apply(&self, before: Vec4, color: Vec4, coverage: f32) -> Vec4 {
        let share = coverage * self.opacity.clamp(0.0, 1.0);
        match self.tool {
            Tool::Paint(mode) => mode.compose(before, color, share),
            Tool::Erase => before.truncate().extend(before.w * (1.0 - share)),
        }
    }
}
