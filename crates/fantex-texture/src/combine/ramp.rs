//! A scalar in false colours.

use std::sync::Arc;

use glam::Vec4;

use super::{Channel, interval};
use crate::look::Slot;
use crate::{ColorRamp, ShadingPoint, Texture};

/// A number of a texture as index of a colour scale, averaged over the numbers within the footprint, so that jumps of the
/// scale have smooth edges.
#[derive(Clone, Debug)]
pub struct RampTexture {
    /// Where the number comes from.
    pub input: Slot,
    /// Which number of it.
    pub channel: Channel,
    /// The colours.
    pub ramp: Arc<ColorRamp>,
}

impl Texture for RampTexture {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let (center, width) = interval(&self.input, self.channel, at);
        self.ramp.mean(center - 0.5 * width, center + 0.5 * width)
    }

    depends_on!(input);
}
