//! How lamps cast shadows.

/// How a lamp casts shadows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowOptions {
    /// Texels along each side of a map, [`ShadowOptions::MIN_RESOLUTION`] to [`ShadowOptions::MAX_RESOLUTION`]. A
    /// directional lamp has one map over the whole scene, a point light six.
    pub resolution: u32,
    /// How far a receiver is lifted towards the lamp before it is compared, in texels.
    pub bias: f32,
    /// How far a receiver is lifted along its normal, in texels, where light grazes it; less where light falls steeply.
    pub normal_offset: f32,
    /// How soft the border is.
    pub penumbra: Penumbra,
}

/// How soft the border of a shadow is; never sharper than the map and the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Penumbra {
    /// As sharp as the map.
    #[default]
    Sharp,
    /// With the same half width everywhere, world units.
    Even(f32),
    /// Wider the farther the shadow falls, by the lamp's radius in world units (for parallel light: the tangent of the angle
    /// that the radius appears under, 0.0047 for the sun): R. Fernando, "Percentage-Closer Soft Shadows", 2005.
    Lamp(f32),
}

impl Default for ShadowOptions {
    /// Sharp shadows from a map of 2048 x 2048 texels (16 MiB).
    fn default() -> Self {
        Self { resolution: 2048, bias: 1.0, normal_offset: 1.5, penumbra: Penumbra::Sharp }
    }
}

impl ShadowOptions {
    /// Least texels along a side.
    pub const MIN_RESOLUTION: u32 = 16;

    /// Most texels along a side: 256 MiB per map.
    pub const MAX_RESOLUTION: u32 = 8_192;

    /// Why no shadow can be cast, or nothing.
    pub fn defect(&self) -> Option<&'static str> {
        let width = match self.penumbra {
            Penumbra::Sharp => 0.0,
            Penumbra::Even(width) | Penumbra::Lamp(width) => width,
        };
        if !(Self::MIN_RESOLUTION..=Self::MAX_RESOLUTION).contains(&self.resolution) {
            Some("its shadow map must have between 16 and 8192 texels along a side")
        } else if !(self.bias.is_finite() && self.normal_offset.is_finite()) {
            Some("the bias of its shadows is not finite")
        } else if !(width.is_finite() && width >= 0.0) {
            Some("the penumbra of its shadows must not be negative")
        } else {
            None
        }
    }
}
