//! The pictures that an asset gives.

use fantex_mesh::AlphaMode;
use fantex_store::{Asset, ChannelKind};

/// A picture of one channel, or of one component of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ChannelMap {
    /// RGB colour; with opacity where a material lets something show through.
    BaseColor,
    /// The alpha of the base colour.
    Opacity,
    /// Normals in tangent space, +y up.
    Normal,
    /// Red = occlusion, green = roughness, blue = metallic.
    OcclusionRoughnessMetallic,
    /// Occlusion alone.
    Occlusion,
    /// Roughness alone.
    Roughness,
    /// Metallic alone.
    Metallic,
    /// Emitted light.
    Emission,
    /// Height.
    Displacement,
    /// Light that arrives.
    Light,
}

impl ChannelMap {
    /// The channel that it is taken from.
    pub fn channel(self) -> ChannelKind {
        match self {
            Self::BaseColor | Self::Opacity => ChannelKind::BaseColor,
            Self::Normal => ChannelKind::Normal,
            Self::OcclusionRoughnessMetallic | Self::Occlusion | Self::Roughness | Self::Metallic => {
                ChannelKind::OcclusionRoughnessMetallic
            }
            Self::Emission => ChannelKind::Emission,
            Self::Displacement => ChannelKind::Displacement,
            Self::Light => ChannelKind::Light,
        }
    }

    /// What it is called in names of files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::BaseColor => "base-color",
            Self::Opacity => "opacity",
            Self::Normal => "normal",
            Self::OcclusionRoughnessMetallic => "orm",
            Self::Occlusion => "occlusion",
            Self::Roughness => "roughness",
            Self::Metallic => "metallic",
            Self::Emission => "emission",
            Self::Displacement => "displacement",
            Self::Light => "light",
        }
    }
}

/// Which numbers of a value a picture keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Components {
    /// One of them, as grey.
    One(usize),
    /// Red, green, blue.
    Rgb,
    /// All.
    Rgba,
}

impl Components {
    /// How many numbers a texel has.
    pub(crate) fn count(self) -> usize {
        match self {
            Self::One(_) => 1,
            Self::Rgb => 3,
            Self::Rgba => 4,
        }
    }
}

/// A picture that is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Map {
    pub(crate) kind: ChannelMap,
    /// Index of the asset's channel.
    pub(crate) channel: usize,
    pub(crate) components: Components,
    /// True where fixed-point numbers of red, green and blue are sRGB-encoded.
    pub(crate) is_srgb: bool,
    /// Values are divided by this, so that fixed-point numbers hold them.
    pub(crate) scale: f32,
    /// What unused texels hold, linear.
    pub(crate) background: [f32; 4],
}

impl Map {
    /// The map of an asset; none where it has no such channel.
    pub(crate) fn of(asset: &Asset, kind: ChannelMap) -> Option<Self> {
        let channel = asset.channel_of_kind(kind.channel())?;
        let shows_through = asset.mesh().materials.iter().any(|m| m.alpha != AlphaMode::Opaque);
        let components = match kind {
            ChannelMap::BaseColor if shows_through => Components::Rgba,
            ChannelMap::BaseColor
            | ChannelMap::Normal
            | ChannelMap::OcclusionRoughnessMetallic
            | ChannelMap::Emission
            | ChannelMap::Light => Components::Rgb,
            ChannelMap::Occlusion | ChannelMap::Displacement => Components::One(0),
            ChannelMap::Roughness => Components::One(1),
            ChannelMap::Metallic => Components::One(2),
            ChannelMap::Opacity => Components::One(3),
        };
        let is_srgb = matches!(kind, ChannelMap::BaseColor | ChannelMap::Emission | ChannelMap::Light);
        let background = match kind {
            ChannelMap::Normal => [0.5, 0.5, 1.0, 1.0],
            _ => mean(asset, channel),
        };
        Some(Self { kind, channel, components, is_srgb, scale: 1.0, background })
    }

    /// The same with values divided by a number.
    pub(crate) fn scaled(self, scale: f32) -> Self {
        Self { scale, background: self.background.map(|x| x / scale), ..self }
    }
}

/// Mean of a channel over all tiles.
fn mean(asset: &Asset, channel: usize) -> [f32; 4] {
    let (mut sum, mut texels) = ([0.0f64; 4], 0.0);
    for (i, group) in (0u32..).zip(&asset.cover().groups) {
        let weight = f64::from(group.extent[0]) * f64::from(group.extent[1]);
        let value = asset.mean(channel, i);
        (0..4).for_each(|k| sum[k] += weight * f64::from(value[k]));
        texels += weight;
    }
    sum.map(|s| (s / f64::max(texels, 1.0)) as f32)
}
