//! Which of the asset's channels a brush paints, and with what.

use fantex_paint::{ChannelPaint, PaintColor};
use fantex_store::{Channel, ChannelKind};
use glam::Vec4;
use serde::{Deserialize, Serialize};

use super::colors::linear_of;

/// Channels that a brush paints, where the asset has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct ChannelSwitches {
    /// Base colour.
    pub color: bool,
    /// Occlusion, roughness and metallic, together.
    pub material: bool,
    /// Emission.
    pub emission: bool,
    /// Normal: towards the mesh's own.
    pub normal: bool,
    /// Displacement.
    pub height: bool,
}

impl Default for ChannelSwitches {
    fn default() -> Self {
        Self { color: true, material: false, emission: false, normal: false, height: false }
    }
}

/// What is painted besides the base colour.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Material {
    /// 0 a mirror, 1 dull.
    pub roughness: f32,
    /// 0 or 1, mostly.
    pub metallic: f32,
    /// 1 lets all light in.
    pub occlusion: f32,
    /// sRGB.
    pub emission: [u8; 3],
    /// 0..1.
    pub height: f32,
}

impl Default for Material {
    fn default() -> Self {
        Self { roughness: 0.5, metallic: 0.0, occlusion: 1.0, emission: [0xff, 0xd4, 0x8a], height: 0.5 }
    }
}

impl ChannelSwitches {
    /// Whether a kind of channel is painted.
    pub fn paints(&self, kind: ChannelKind) -> bool {
        match kind {
            ChannelKind::BaseColor => self.color,
            ChannelKind::OcclusionRoughnessMetallic => self.material,
            ChannelKind::Emission => self.emission,
            ChannelKind::Normal => self.normal,
            ChannelKind::Displacement => self.height,
            ChannelKind::Light | ChannelKind::Anisotropy => false,
        }
    }

    /// The switch of a kind of channel; light and anisotropy are not painted.
    pub fn of(&mut self, kind: ChannelKind) -> Option<&mut bool> {
        match kind {
            ChannelKind::BaseColor => Some(&mut self.color),
            ChannelKind::OcclusionRoughnessMetallic => Some(&mut self.material),
            ChannelKind::Emission => Some(&mut self.emission),
            ChannelKind::Normal => Some(&mut self.normal),
            ChannelKind::Displacement => Some(&mut self.height),
            ChannelKind::Light | ChannelKind::Anisotropy => None,
        }
    }

    /// What a stroke paints into an asset's channels. `color` is the base colour, linear RGBA.
    pub fn paint(&self, channels: &[Channel], color: Vec4, material: &Material) -> Vec<ChannelPaint> {
        let chosen = channels.iter().enumerate().filter(|(_, channel)| self.paints(channel.kind));
        chosen
            .map(|(index, channel)| {
                let value = material.value(channel.kind, color);
                ChannelPaint { channel: index, color: PaintColor::Constant(value) }
            })
            .collect()
    }
}

impl Material {
    /// Linear RGBA of a kind of channel.
    pub(super) fn value(&self, kind: ChannelKind, color: Vec4) -> Vec4 {
        match kind {
            ChannelKind::BaseColor | ChannelKind::Light => color,
            ChannelKind::OcclusionRoughnessMetallic => {
                Vec4::new(self.occlusion, self.roughness, self.metallic, 1.0)
            }
            ChannelKind::Emission => linear_of(self.emission),
            ChannelKind::Normal | ChannelKind::Anisotropy => Vec4::new(0.5, 0.5, 1.0, 1.0),
            ChannelKind::Displacement => Vec4::new(self.height, self.height, self.height, 1.0),
        }
    }
}
