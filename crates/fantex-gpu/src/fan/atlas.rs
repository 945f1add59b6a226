//! The atlas in graphics memory: a texture per channel, its page table, uploads, and a picture of it.

use std::ops::Range;

use fantex_base::Result;
use fantex_cover::Cover;
use fantex_store::{Channel, ChannelKind};
use fantex_stream::{
    AtlasFormat, AtlasPlace, AtlasShape, FrameChanges, OutlineRun, PageTable, ParcelUpload, TableChange,
    TableEntry,
};
use wgpu::util::StagingBelt;

use super::FanModel;
use super::geometry::is_paged;
use crate::Gpu;
use crate::gpu::SAMPLED;
use crate::renderer::{color_attachment, screen_pipeline};
use crate::shader::{FAN_ATLAS, module};

pub(crate) const KINDS: usize = 6;

/// The kinds of channel that are drawn, in the order of their bindings.
pub(crate) const DRAWN_KINDS: [ChannelKind; KINDS] = [
    ChannelKind::BaseColor,
    ChannelKind::Normal,
    ChannelKind::OcclusionRoughnessMetallic,
    ChannelKind::Emission,
    ChannelKind::Light,
    ChannelKind::Anisotropy,
];

/// The texture format that decodes a channel's texels, sRGB included.
fn texture_format(format: AtlasFormat, srgb: bool) -> wgpu::TextureFormat {
    use wgpu::TextureFormat as T;
    match (format, srgb) {
        (AtlasFormat::Bc1, false) => T::Bc1RgbaUnorm,
        (AtlasFormat::Bc1, true) => T::Bc1RgbaUnormSrgb,
        (AtlasFormat::Bc4, _) => T::Bc4RUnorm,
        (AtlasFormat::Bc5, _) => T::Bc5RgUnorm,
        (AtlasFormat::Bc7, false) => T::Bc7RgbaUnorm,
        (AtlasFormat::Bc7, true) => T::Bc7RgbaUnormSrgb,
        (AtlasFormat::R8, _) => T::R8Unorm,
        (AtlasFormat::Rg8, _) => T::Rg8Unorm,
        (AtlasFormat::Rgba8, false) => T::Rgba8Unorm,
        (AtlasFormat::Rgba8, true) => T::Rgba8UnormSrgb,
        (AtlasFormat::Rgba16F, _) => T::Rgba16Float,
    }
}

#[derive(Debug)]
pub(crate) struct ChannelAtlas {
    pub(crate) format: AtlasFormat,
    pub(crate) texture: wgpu::Texture,
    pub(crate) view: wgpu::TextureView,
}

impl ChannelAtlas {
    pub(crate) fn new(gpu: &Gpu, grid: AtlasGrid, channel: &Channel, format: AtlasFormat) -> Self {
        let texture = texture(gpu, grid.extent(), texture_format(format, channel.srgb));
        Self { format, view: texture.create_view(&Default::default()), texture }
    }
}

/// What stands for a channel that an asset has not; it is never read.
pub(crate) fn no_channel(gpu: &Gpu) -> wgpu::TextureView {
    texture(gpu, [1, 1], wgpu::TextureFormat::Rgba8Unorm).create_view(&Default::default())
}

fn texture(gpu: &Gpu, [width, height]: [u32; 2], format: wgpu::TextureFormat) -> wgpu::Texture {
    gpu.texture("fan atlas", [width, height, 1], 1, format, SAMPLED)
}

// Layers of an atlas beside each other in one texture.
//
// The atlas' layers are the cells of a grid in one texture per channel: shaders then know of no layers, and look-ups are
// those of a plain texture, the kind that software adapters do best.

/// Where layers lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct AtlasGrid {
    side: u32,
    /// Columns and rows of layers, all of them used.
    pub(crate) cells: [u32; 2],
}

impl AtlasGrid {
    /// The grid of a shape in a texture of at most `longest` texels per side, as square as it comes. A shape that does not
    /// fit ([`AtlasGrid::fitting`]) gives one row.
    pub(crate) fn new(shape: AtlasShape, longest: u32) -> Self {
        let most = (longest / shape.side).max(1);
        let fits = |columns: &u32| shape.layers.is_multiple_of(*columns) && shape.layers / columns <= most;
        let columns = (1..=most.min(shape.layers)).filter(fits).min_by_key(|&c| c.abs_diff(shape.layers / c));
        let columns = columns.unwrap_or(shape.layers);
        Self { side: shape.side, cells: [columns, shape.layers / columns] }
    }

    /// The shape with as many of its layers as fill a grid in a texture of at most `longest` texels per side. (Entries of the
    /// page table can name places in 16384x16384 texels.)
    pub(crate) fn fitting(shape: AtlasShape, longest: u32) -> AtlasShape {
        let side = shape.side.min(longest);
        let most = (longest.min(16384) / side).max(1);
        let is_grid = |layers: &u32| (1..=most).any(|c| layers.is_multiple_of(c) && layers / c <= most);
        AtlasShape { side, layers: (1..=shape.layers).rev().find(is_grid).unwrap_or(1) }
    }

    /// The grid of a shape, unless the device's textures cannot hold it.
    pub(crate) fn checked(gpu: &Gpu, shape: AtlasShape) -> Result<Self> {
        let allowed = gpu.limits().max_texture_dimension_2d;
        if Self::fitting(shape, allowed) != shape {
            return Err(gpu.too_large("the atlas", shape.side.into(), allowed.into(), "texels per side"));
        }
        Ok(Self::new(shape, allowed))
    }

    /// Columns and rows in texels.
    pub(crate) fn extent(self) -> [u32; 2] {
        self.cells.map(|n| n * self.side)
    }

    /// The first texel of a page.
    pub(crate) fn texel(self, place: AtlasPlace) -> [u32; 2] {
        let (column, row) = (u32::from(place.layer) % self.cells[0], u32::from(place.layer) / self.cells[0]);
        [column * self.side + u32::from(place.x), row * self.side + u32::from(place.y)]
    }

    /// An entry as the shader reads it: zero, or quarters of the first texel: column, row << 12, and 1 << 31.
    fn word(self, entry: TableEntry) -> u32 {
        entry.place().map_or(0, |place| {
            let [x, y] = self.texel(place);
            1 << 31 | (y / 4) << 12 | (x / 4)
        })
    }
}

// The page table as shaders read it: a texture of a word per page.
//
// The word of a page says where it lies in the atlas. Where it is not resident and its tile has one page per level, the word
// says where the finest coarser level lies that is, and how many levels coarser; zero says that there is none, so shaders
// need not search. Pages of larger tiles have a word of their own only, zero where they are not resident.
//
// The words are kept in main memory, too: 4 bytes per page.
//
// Why a texture: software adapters read storage buffers lane by lane, but fetch texels of 32 bits for all lanes at once.

/// Columns of the texture, as a binary logarithm; `PAGE_ROW_SHIFT` in `fan_lookup.wgsl`.
const ROW_SHIFT: u32 = 13;

/// Where the number of levels stands in a word.
const COARSER_SHIFT: u32 = 24;

/// Texels between two runs of changes that are copied once more rather than made two copies.
const GAP: u32 = 64;

/// What is in the texture.
#[derive(Debug)]
pub(crate) struct PageWords {
    /// Per group the number of its first page, ascending; then the number of pages.
    firsts: Vec<u32>,
    /// Per group whether levels have several pages.
    is_paged: Vec<bool>,
    /// Per page.
    words: Vec<u32>,
}

impl PageWords {
    /// Nothing is resident.
    pub(crate) fn new(cover: &Cover, pages: &PageTable) -> Self {
        let groups = 0..cover.groups.len() as u32;
        Self {
            firsts: groups.map(|group| pages.first(group)).chain([pages.len() as u32]).collect(),
            is_paged: cover.groups.iter().map(is_paged).collect(),
            words: vec![0; pages.len()],
        }
    }

    /// Columns and rows of a texture for a number of pages.
    pub(crate) fn extent(pages: usize) -> [u32; 2] {
        [1 << ROW_SHIFT, pages.div_ceil(1 << ROW_SHIFT).max(1) as u32]
    }

    /// Takes over entries, ascending by index. Returns the pages whose words are others now (and some between them), ascending,
    /// each run within one row of the texture.
    pub(crate) fn change(&mut self, entries: &[TableChange], grid: AtlasGrid) -> Vec<Range<u32>> {
        let mut runs: Vec<Range<u32>> = Vec::new();
        let mut rest = entries;
        while let Some(&TableChange { index, .. }) = rest.first() {
            let group = self.firsts.partition_point(|&first| first <= index) - 1;
            let pages = self.firsts[group]..self.firsts[group + 1];
            let count = rest.iter().take_while(|change| change.index < pages.end).count();
            let (own, others) = rest.split_at(count);
            rest = others;
            for change in own {
                self.words[change.index as usize] = grid.word(change.entry);
            }
            let last = own[count - 1].index;
            let changed = if self.is_paged[group] {
                index..last + 1
            } else {
                self.chain(pages.start..last + 1, pages.end);
                pages.start..last + 1
            };
            match runs.last_mut().filter(|run| changed.start <= run.end + GAP) {
                Some(run) => run.end = changed.end,
                None => runs.push(changed),
            }
        }
        runs.into_iter().flat_map(rows).collect()
    }

    /// Hands coarser levels' words on to finer ones, from the last of `levels` down; the tile's levels end before `end`.
    fn chain(&mut self, levels: Range<u32>, end: u32) {
        for level in levels.rev().map(|level| level as usize) {
            let own = self.words[level];
            let is_resident = own != 0 && own >> COARSER_SHIFT & 0x7F == 0;
            if !is_resident {
                let next = if level + 1 < end as usize { self.words[level + 1] } else { 0 };
                self.words[level] = if next == 0 { 0 } else { next + (1 << COARSER_SHIFT) };
            }
        }
    }
}

/// The parts of a run in rows of the texture.
fn rows(run: Range<u32>) -> impl Iterator<Item = Range<u32>> {
    (run.start >> ROW_SHIFT..=(run.end - 1) >> ROW_SHIFT)
        .map(move |row| run.start.max(row << ROW_SHIFT)..run.end.min((row + 1) << ROW_SHIFT))
}

// Parcels and page-table entries on their way into graphics memory.
//
// Texels are written into mapped staging buffers, rows at multiples of 256 bytes, and copied into the atlas by the frame's
// own commands. The staging buffers come back when the frame is done and are used again, so that a steady stream
// allocates nothing.

/// Bytes of a staging buffer: sixteen pages of 256x256 RGBA texels.
const STAGING_BYTES: u64 = 4 << 20;

/// The staging buffers.
#[derive(Debug)]
pub(crate) struct Uploader {
    belt: StagingBelt,
    grid: AtlasGrid,
    words: PageWords,
}

impl Uploader {
    pub(crate) fn new(device: &wgpu::Device, grid: AtlasGrid, words: PageWords) -> Self {
        Self { belt: StagingBelt::new(device.clone(), STAGING_BYTES), grid, words }
    }

    /// Records the changes of a frame: first texels, then entries. `atlases` has an entry per channel of the asset; texels
    /// of channels without an atlas are passed over.
    pub(crate) fn record(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        changes: &FrameChanges,
        atlases: &[Option<ChannelAtlas>],
        table: &wgpu::Texture,
    ) {
        for upload in &changes.uploads {
            for (atlas, texels) in atlases.iter().zip(&upload.texels.channels) {
                if let Some(atlas) = atlas {
                    self.texels(encoder, upload, atlas, texels);
                }
            }
        }
        self.entries(encoder, &changes.entries, table);
        self.belt.finish_and_recall_on_submit(encoder);
    }

    /// A parcel of a channel: one copy per run of its outline, which is one for a whole rectangle.
    fn texels(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        upload: &ParcelUpload,
        atlas: &ChannelAtlas,
        texels: &[u8],
    ) {
        let extent = upload.texels.extent;
        let all = Rows::new(atlas.format, extent);
        debug_assert_eq!(texels.len(), all.bytes * all.count, "{}", upload.parcel);
        let [x, y] = self.grid.texel(upload.place);
        for OutlineRun { bands, blocks } in upload.texels.outline.runs(extent) {
            let size = [&blocks, &bands].map(|run| 4 * run.len() as u32);
            let rows = Rows::new(atlas.format, size);
            let before = Rows::new(atlas.format, [blocks.start, bands.start].map(|n| 4 * n));
            let Some(bytes) = wgpu::BufferSize::new((rows.pitch * rows.count) as u64) else { continue };
            let slice = self.belt.allocate(bytes, ALIGNMENT);
            // A belt's slice is always mapped; otherwise only these blocks would be missing.
            if let Ok(mut mapped) = slice.get_mapped_range_mut() {
                let sources = texels.chunks_exact(all.bytes).skip(before.count);
                for (row, source) in sources.take(rows.count).enumerate() {
                    let source = &source[before.bytes..before.bytes + rows.bytes];
                    mapped.slice(row * rows.pitch..row * rows.pitch + rows.bytes).copy_from_slice(source);
                }
            }
            let (offset, bytes_per_row) = (slice.offset(), Some(rows.pitch as u32));
            let layout = wgpu::TexelCopyBufferLayout { offset, bytes_per_row, rows_per_image: None };
            encoder.copy_buffer_to_texture(
                wgpu::TexelCopyBufferInfo { buffer: slice.buffer(), layout },
                place_in(&atlas.texture, [x + 4 * blocks.start, y + 4 * bands.start]),
                wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            );
        }
    }

    /// One copy per run of neighbouring words.
    fn entries(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        entries: &[TableChange],
        table: &wgpu::Texture,
    ) {
        let runs = self.words.change(entries, self.grid);
        let count: usize = runs.iter().map(|run| run.len()).sum();
        let Some(size) = wgpu::BufferSize::new((count * WORD_BYTES) as u64) else { return };
        let slice = self.belt.allocate(size, ALIGNMENT);
        let Ok(mut mapped) = slice.get_mapped_range_mut() else { return };
        let mut filled = 0;
        for run in runs {
            let words = bytemuck::cast_slice(&self.words.words[run.start as usize..run.end as usize]);
            mapped.slice(filled..filled + words.len()).copy_from_slice(words);
            let columns = (1 << ROW_SHIFT) - 1;
            let offset = slice.offset() + filled as u64;
            let layout = wgpu::TexelCopyBufferLayout { offset, bytes_per_row: None, rows_per_image: None };
            encoder.copy_buffer_to_texture(
                wgpu::TexelCopyBufferInfo { buffer: slice.buffer(), layout },
                place_in(table, [run.start & columns, run.start >> ROW_SHIFT]),
                wgpu::Extent3d { width: run.len() as u32, height: 1, depth_or_array_layers: 1 },
            );
            filled += words.len();
        }
    }
}

fn place_in(texture: &wgpu::Texture, [x, y]: [u32; 2]) -> wgpu::TexelCopyTextureInfo<'_> {
    wgpu::TexelCopyTextureInfo { origin: wgpu::Origin3d { x, y, z: 0 }, ..texture.as_image_copy() }
}

const WORD_BYTES: usize = size_of::<u32>();

/// Satisfies every format's block and the copies' own rule.
const ALIGNMENT: wgpu::BufferSize = match wgpu::BufferSize::new(256) {
    Some(alignment) => alignment,
    None => wgpu::BufferSize::MIN,
};

/// Rows of a page in a buffer: of texels, or of blocks.
struct Rows {
    count: usize,
    /// Bytes that mean something.
    bytes: usize,
    /// From one row to the next.
    pitch: usize,
}

impl Rows {
    fn new(format: AtlasFormat, [columns, rows]: [u32; 2]) -> Self {
        let blocks = columns as usize / 4;
        let (count, bytes) = if format.is_compressed() {
            (rows as usize / 4, blocks * format.block_bytes())
        } else {
            (rows as usize, blocks * format.block_bytes() / 4)
        };
        Self { count, bytes, pitch: bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize) }
    }
}

// The live atlas: what is in graphics memory, as a picture.

/// Draws atlases into targets of one format that does not encode sRGB itself.
#[derive(Debug)]
pub struct AtlasViewer {
    pipeline: wgpu::RenderPipeline,
}

impl AtlasViewer {
    /// For targets of a format.
    pub fn new(gpu: &Gpu, output: wgpu::TextureFormat) -> Self {
        let module = module(&gpu.device, "live atlas", FAN_ATLAS);
        let entries = ["vs_fan_atlas", "fs_fan_atlas"];
        Self { pipeline: screen_pipeline(gpu, "live atlas", &module, entries, None, output) }
    }

    /// Fills a target with the whole atlas of one of the asset's channels, each pixel the mean of up to four of the texels that it
    /// covers. Places that pages have left show what was there until others come. Nothing is drawn where the channel is not, and
    /// `false` is returned.
    pub fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        model: &FanModel,
        channel: usize,
    ) -> bool {
        let Some(atlas) = model.atlas_texture(channel) else { return false };
        let about = [u32::from(atlas.format().components()), u32::from(atlas.format().is_srgb()), 0, 0];
        let about = gpu.buffer("live atlas", bytemuck::bytes_of(&about), wgpu::BufferUsages::UNIFORM);
        let source = atlas.create_view(&Default::default());
        let resources = [wgpu::BindingResource::TextureView(&source), about.as_entire_binding()];
        let group = gpu.bind_group("live atlas", &self.pipeline.get_bind_group_layout(0), resources);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("live atlas"),
            color_attachments: &[Some(color_attachment(target, wgpu::Color::BLACK))],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
        true
    }
}

#[cfg(test)]
mod tests {
    use fantex_stream::{AtlasPlace, AtlasShape, TableEntry};

    use super::*;

    #[test]
    fn layers_lie_beside_each_other() {
        for (side, layers) in [(256, 1), (1024, 4), (2048, 12), (4096, 16), (512, 31)] {
            let shape = AtlasShape { side, layers };
            let fitting = AtlasGrid::fitting(shape, 16384);
            assert_eq!(fitting, shape);
            let grid = AtlasGrid::new(shape, 16384);
            assert_eq!(grid.cells[0] * grid.cells[1], layers, "nothing is wasted");
            assert!(grid.extent().iter().all(|&n| n <= 16384));
            let mut places: Vec<_> =
                (0..layers as u16).map(|layer| grid.texel(AtlasPlace { layer, x: 0, y: 0 })).collect();
            places.dedup();
            assert_eq!(places.len(), layers as usize);
        }
    }

    #[test]
    fn what_is_no_grid_loses_layers() {
        let fitting = |side, layers, longest| {
            let AtlasShape { side, layers } = AtlasGrid::fitting(AtlasShape { side, layers }, longest);
            (side, layers)
        };
        assert_eq!(fitting(4096, 5, 16384), (4096, 4));
        assert_eq!(fitting(4096, 128, 16384), (4096, 16));
        assert_eq!(fitting(4096, 3, 8192), (4096, 2));
        assert_eq!(fitting(4096, 3, 2048), (2048, 1));
    }

    #[test]
    fn words_name_places() {
        let grid = AtlasGrid::new(AtlasShape { side: 1024, layers: 4 }, 16384);
        assert_eq!(grid.word(TableEntry::ABSENT), 0);
        let word = grid.word(TableEntry::at(AtlasPlace { layer: 3, x: 8, y: 256 }));
        assert_eq!(word, 1 << 31 | (1280 / 4) << 12 | (1032 / 4));
    }

    fn grid() -> AtlasGrid {
        AtlasGrid::new(AtlasShape { side: 1024, layers: 1 }, 16384)
    }

    fn words(firsts: &[u32], is_paged: &[bool]) -> PageWords {
        let pages = firsts[firsts.len() - 1] as usize;
        PageWords { firsts: firsts.to_vec(), is_paged: is_paged.to_vec(), words: vec![0; pages] }
    }

    fn resident(index: u32) -> TableChange {
        TableChange { index, entry: TableEntry::at(AtlasPlace { layer: 0, x: 4 * index as u16, y: 8 }) }
    }

    fn absent(index: u32) -> TableChange {
        TableChange { index, entry: TableEntry::ABSENT }
    }

    /// What the word of a page means: which page is found there.
    fn found(words: &PageWords, index: u32) -> Option<u32> {
        let word = words.words[index as usize];
        (word != 0).then(|| {
            assert_eq!(word >> 31, 1);
            let page = word & 0xFFF;
            assert_eq!(index + (word >> COARSER_SHIFT & 0x7F), page, "levels between them");
            page
        })
    }

    #[test]
    fn finer_levels_name_the_finest_coarser_one() {
        let mut words = words(&[0, 5, 10], &[false, false]);
        let all = |words: &PageWords| (0..10).map(|i| found(words, i)).collect::<Vec<_>>();
        assert_eq!(words.change(&[resident(4), resident(8)], grid()), std::slice::from_ref(&(0..9)));
        assert_eq!(all(&words), [&[Some(4); 5][..], &[Some(8); 4], &[None]].concat());
        assert_eq!(words.change(&[resident(1)], grid()), std::slice::from_ref(&(0..2)));
        assert_eq!(all(&words)[..5], [Some(1), Some(1), Some(4), Some(4), Some(4)]);
        // What was handed on is not taken for resident when it goes.
        words.change(&[absent(1), absent(4)], grid());
        assert_eq!(all(&words)[..5], [None; 5]);
        words.change(&[resident(0), resident(2)], grid());
        assert_eq!(all(&words)[..5], [Some(0), Some(2), Some(2), None, None]);
    }

    #[test]
    fn pages_of_large_tiles_stand_alone() {
        let mut words = words(&[0, 7], &[true]);
        assert_eq!(words.change(&[resident(2), resident(5)], grid()), std::slice::from_ref(&(2..6)));
        let own: Vec<_> = (0..7).map(|i| found(&words, i)).collect();
        assert_eq!(own, [None, None, Some(2), None, None, Some(5), None]);
    }

    #[test]
    fn runs_end_with_rows_and_join_over_small_gaps() {
        let row = 1 << ROW_SHIFT;
        let firsts: Vec<u32> = (0..=3 * row / 4).map(|group| 4 * group).collect();
        let mut words = words(&firsts, &vec![false; firsts.len() - 1]);
        let runs = words.change(&[resident(3), resident(40), resident(1003), resident(row - 1)], grid());
        assert_eq!(runs, [0..41, 1000..1004, row - 4..row]);
        let runs = words.change(&[resident(row - 2), resident(row + 1)], grid());
        assert_eq!(runs, [row - 4..row, row..row + 2]);
        assert_eq!(PageWords::extent(3 * row as usize), [row, 3]);
        assert_eq!(PageWords::extent(0), [row, 1]);
    }
}
