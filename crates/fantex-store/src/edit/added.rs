//! Channels that an asset is given after it was baked, or that are taken out of it.
//!
//! Those that it is given hold what renderers showed without them, so that nothing looks different: the factors of the model's materials, the mesh's own
//! normals, a middle height.

use std::path::Path;
use std::sync::Arc;

use fantex_base::files::scratch_folder;
use fantex_base::srgb::srgb_from_linear;
use fantex_base::{Error, Result};
use fantex_mesh::{AlphaMode, Material, Mesh};

use super::compact::NewChannel;
use super::{AssetEditor, CompactSummary, EditOptions};
use crate::channel::check_channels;
use crate::{Asset, BytesSource, Channel, ChannelKind, PREVIEW, Quality, TexelFormat, TexelSlice, encode};

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
        Self::plain_value_of(kind, mesh.materials.get(mesh.material_of(triangle)).unwrap_or(&plain))
    }

    /// As [`plain_value`](Self::plain_value), where a material is.
    pub fn plain_value_of(kind: ChannelKind, material: &Material) -> [f32; 4] {
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

impl Asset {
    /// The numbers of channels of these kinds, ascending, if they can be removed together.
    ///
    /// # Errors
    /// The asset has none of a kind, or no other channel.
    pub fn removable_channels(&self, kinds: &[ChannelKind]) -> Result<Vec<usize>> {
        let path = self.path();
        let sentence = |kind: ChannelKind, why: &str| {
            format!("cannot remove the channel {kind} from {}: {why}", path.display())
        };
        let channels = self.channels();
        let mut removed = Vec::new();
        for &kind in kinds {
            let known = removed.len();
            removed.extend((0..channels.len()).filter(|&index| channels[index].kind == kind));
            if removed.len() == known {
                // The file is there: an error with its path would be one of a missing file.
                return Err(Error::not_found(sentence(kind, "it has none")));
            }
        }
        removed.sort_unstable();
        removed.dedup();
        match kinds.last() {
            Some(&last) if removed.len() == channels.len() => {
                let why = "it has no other channel, and an asset needs one";
                Err(Error::invalid(sentence(last, why)).with_path(path))
            }
            _ => Ok(removed),
        }
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
        let mut new = NewChannel::all_of(&self.asset);
        let refused = |why: String| {
            let sentence = format!("cannot add a channel to {}: {why}", path.display());
            Error::invalid(sentence).with_path(&path)
        };
        for &kind in kinds {
            if new.iter().any(|new| new.channel.kind == kind) {
                return Err(refused(format!("it has one of {kind}")));
            }
            let channel = Channel::beside(kind, self.asset.channels());
            let channel = channel.ok_or_else(|| refused(format!("only a bake makes one of {kind}")))?;
            new.push(NewChannel { channel, from: None });
        }
        let channels: Vec<Channel> = new.iter().map(|new| new.channel.clone()).collect();
        check_channels(&channels)
            .map_err(|error| error.context(format!("cannot change {}", path.display())))?;
        self.rewrite(&new, None, |_| false, |_, contents| Ok(Some(contents)))
    }

    /// Commits, then replaces the file by one without the channels of these kinds, atomically. The others stay as they are, and move
    /// up. Attachments do, too, but those that `concerns` names hold what `change` makes of their contents; where that is none, they are
    /// left out. The [preview](PREVIEW) loses these channels, too, and goes where it has no others. Needs room for the copy; memory does
    /// not grow with the asset. Readers that have the old file open keep it.
    ///
    /// # Errors
    /// As [`removable_channels`](Asset::removable_channels) and `change`, or there is no room for a temporary file of the preview's size: the
    /// asset then stays as it is; else as [`compact`](Self::compact).
    pub fn remove_channels(
        &mut self,
        kinds: &[ChannelKind],
        concerns: impl Fn(&str) -> bool,
        mut change: impl FnMut(&str, Vec<u8>) -> Result<Option<Vec<u8>>>,
    ) -> Result<CompactSummary> {
        let removed = self.asset.removable_channels(kinds)?;
        let mut new = NewChannel::all_of(&self.asset);
        new.retain(|new| new.from.is_some_and(|index| !removed.contains(&index)));
        let (has_preview, path, options) = (self.has_preview(), self.asset.path().to_owned(), self.options);
        self.rewrite(
            &new,
            None,
            |name| if name == PREVIEW { has_preview } else { concerns(name) },
            |name, contents| match name {
                PREVIEW => edited_preview(&path, contents, &options, |preview| preview.lose_channels(kinds)),
                _ => change(name, contents),
            },
        )
    }

    /// False, too, where the preview is damaged: it is copied as it is, and reported when it is read.
    fn has_preview(&self) -> bool {
        self.attachment(PREVIEW).is_ok_and(|preview| preview.is_some())
    }

    /// Removes the channels of these kinds, as far as it has them; false where it has no others.
    fn lose_channels(&mut self, kinds: &[ChannelKind]) -> Result<bool> {
        let own: Vec<ChannelKind> = self.asset.channels().iter().map(|channel| channel.kind).collect();
        let removed: Vec<ChannelKind> = own.iter().copied().filter(|kind| kinds.contains(kind)).collect();
        if removed.len() == own.len() {
            return Ok(false);
        }
        if !removed.is_empty() {
            self.remove_channels(&removed, |_| false, |_, contents| Ok(Some(contents)))?;
        }
        Ok(true)
    }

    /// Commits, then replaces the file by one all of whose materials take alpha so, those of the [preview](PREVIEW), too, atomically.
    /// Texels stay as they are. Needs room for the copy. Readers that have the old file open keep it.
    ///
    /// # Errors
    /// There is no room for a temporary file of the preview's size: the asset then stays as it is; else as [`compact`](Self::compact).
    pub fn set_alpha_mode(&mut self, alpha: AlphaMode) -> Result<()> {
        let mut mesh = self.asset.mesh().clone();
        if !mesh.set_alpha_mode(alpha) {
            return Ok(());
        }
        let channels = NewChannel::all_of(&self.asset);
        let (has_preview, path, options) = (self.has_preview(), self.asset.path().to_owned(), self.options);
        let change = |_: &str, contents| {
            edited_preview(&path, contents, &options, |preview| preview.set_alpha_mode(alpha).map(|()| true))
        };
        self.rewrite(&channels, Some(&mesh), |name| has_preview && name == PREVIEW, change).map(drop)
    }
}

/// The preview of the asset at `path` as `edit` leaves it; none where that is false: nothing of it is left. What is no asset stays as it
/// is.
fn edited_preview(
    path: &Path,
    contents: Vec<u8>,
    options: &EditOptions,
    edit: impl FnOnce(&mut AssetEditor) -> Result<bool>,
) -> Result<Option<Vec<u8>>> {
    let edited = || -> Result<Option<Vec<u8>>> {
        // Not from its copy: what is opened as an input may not be written.
        if Asset::open_source(Arc::new(BytesSource::new(path, contents.clone()))).is_err() {
            return Ok(Some(contents));
        }
        let folder = scratch_folder()?;
        let copy = folder.path().join("preview.fan");
        std::fs::write(&copy, contents).map_err(|error| Error::writing(&copy, error))?;
        let mut editor = AssetEditor::open(&copy, options)?;
        let is_left = edit(&mut editor)?;
        drop(editor);
        is_left.then(|| std::fs::read(&copy).map_err(|error| Error::reading(&copy, error))).transpose()
    };
    edited().map_err(|error| {
        // Its path is that of a copy that is gone.
        error.context(format!("cannot change the preview of {}", path.display())).with_path(path)
    })
}
