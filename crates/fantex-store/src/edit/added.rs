//! Channels that an asset is given after it was baked.
//!
//! They hold what renderers showed without them, so that nothing looks different: the factors of the model's materials, the mesh's own
//! normals, a middle height.

use fantex_base::srgb::srgb_from_linear;
use fantex_base::{Error, Result};
use fantex_mesh::{Material, Mesh};

use super::{AssetEditor, CompactSummary};
use crate::channel::check_channels;
use crate::{Channel, ChannelKind, Quality, TexelFormat, TexelSlice, encode};

/// The height that is neither raised nor lowered.
pub const MIDDLE_HEIGHT: f32 = 0.5;

/// Texels of a block.
const BLOCK: [u32; 2] = [4, 4];

impl Channel {
    /// A channel beside others, stored as these are: in floats where all are, compressed where some is. None for light and anisotropy,
    /// which only bakes make.
    pub fn beside(kind: ChannelKind, others: &[Self]) -> Option<Self> {
        use ChannelKind::{
            Anisotropy, BaseColor, Displacement, Emission, Light, Normal, OcclusionRoughnessMetallic,
        };
        let is_float = others.iter().all(|channel| channel.format == TexelFormat::Rgba32F);
        let is_compressed = others.iter().any(|channel| channel.format.is_compressed());
        let format = match (kind, is_compressed) {
            (Light | Anisotropy, _) => return None,
            _ if is_float => TexelFormat::Rgba32F,
            (Normal, true) => TexelFormat::Bc5,
            (Normal, false) => TexelFormat::Rg8,
            (Displacement, true) => TexelFormat::Bc4,
            (Displacement, false) => TexelFormat::R8,
            (BaseColor | OcclusionRoughnessMetallic | Emission, true) => TexelFormat::Bc7,
            (BaseColor | OcclusionRoughnessMetallic | Emission, false) => TexelFormat::Rgba8,
        };
        Some(Self { kind, format, srgb: !is_float && matches!(kind, BaseColor | Emission) })
    }

    /// What a channel holds that says no more than the model: **linear** RGBA (normals as stored) at a triangle.
    pub fn plain_value(kind: ChannelKind, mesh: &Mesh, triangle: usize) -> [f32; 4] {
        let plain = Material::default();
        let material = mesh.materials.get(mesh.material_of(triangle)).unwrap_or(&plain);
        let grey = |x: f32| [x, x, x, 1.0];
        match kind {
            ChannelKind::BaseColor => material.base_color.to_array(),
            ChannelKind::OcclusionRoughnessMetallic => [1.0, material.roughness, material.metallic, 1.0],
            ChannelKind::Emission => material.emission.extend(1.0).to_array(),
            ChannelKind::Displacement => grey(MIDDLE_HEIGHT),
            ChannelKind::Normal | ChannelKind::Anisotropy => [0.5, 0.5, 0.0, 1.0],
            ChannelKind::Light => grey(0.0),
        }
    }

    /// The bytes of a page of one **linear** value. `beside`: the page in other channels, with these; where a BC7 one says that
    /// nothing reads a block, neither does anything read this one.
    ///
    /// # Errors
    /// The extent is not one of whole blocks.
    pub fn plain_page(
        &self,
        extent: [u32; 2],
        value: [f32; 4],
        beside: &[(&Self, &[u8])],
    ) -> Result<Vec<u8>> {
        let [r, g, b, a] = value;
        let [r, g, b] = if self.srgb { [r, g, b].map(srgb_from_linear) } else { [r, g, b] };
        let block = encode(self.format, Quality::UltraFast, BLOCK, TexelSlice::F32(&[[r, g, b, a]; 16]))?;
        let unit = if self.format.is_compressed() { block.as_slice() } else { &block[..block.len() / 16] };
        let mut bytes = unit.repeat(self.format.bytes(extent) / unit.len());
        let outline = beside.iter().find(|(channel, _)| channel.format == TexelFormat::Bc7);
        if let Some((_, outline)) = outline.filter(|_| self.format.is_compressed()) {
            let blocks = bytes.chunks_exact_mut(unit.len()).zip(outline.chunks_exact(16));
            blocks
                .filter(|(_, seen)| seen.iter().all(|byte| *byte == 0))
                .for_each(|(block, _)| block.fill(0));
        }
        Ok(bytes)
    }
}

impl AssetEditor {
    /// Commits, then replaces the file by one that has further channels behind those that it has, atomically; they show what was seen
    /// without them ([`Channel::plain_value`]). Needs room for the copy; memory does not grow with the asset. Attachments stay as they
    /// are. Readers that have the old file open keep it.
    ///
    /// # Errors
    /// The asset has such a channel, or would have too many; light and anisotropy cannot be added; else as
    /// [`compact`](Self::compact).
    pub fn add_channels(&mut self, kinds: &[ChannelKind]) -> Result<CompactSummary> {
        let path = self.asset.path().to_owned();
        let mut channels = self.asset.channels().to_vec();
        let refused = |why: String| {
            let sentence = format!("cannot add a channel to {}: {why}", path.display());
            Error::invalid(sentence).with_path(&path)
        };
        for &kind in kinds {
            if channels.iter().any(|channel| channel.kind == kind) {
                return Err(refused(format!("it has one of {kind}")));
            }
            let channel = Channel::beside(kind, self.asset.channels());
            channels.push(channel.ok_or_else(|| refused(format!("only a bake makes one of {kind}")))?);
        }
        check_channels(&channels)
            .map_err(|error| error.context(format!("cannot change {}", path.display())))?;
        self.rewrite(&channels)
    }
}
