//! What a picture shows of its surfaces.

/// A lighting model, or one of the inputs of lighting as the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Shading {
    /// glTF 2.0 metallic-roughness: Lambert and GGX.
    #[default]
    MetallicRoughness,
    /// Blinn-Phong with ambient.
    BlinnPhong,
    /// The base colour.
    BaseColor,
    /// The shading normal, -1..1 shown as 0..1.
    Normal,
    /// Occlusion, roughness and metallic as red, green and blue.
    OcclusionRoughnessMetallic,
    /// Emitted light.
    Emission,
}

impl Shading {
    /// Whether lights make a difference.
    pub fn is_lit(self) -> bool {
        matches!(self, Self::MetallicRoughness | Self::BlinnPhong)
    }
}
