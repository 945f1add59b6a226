//! An open asset, and the streaming of its texels into a page's textures.

use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use fantex_store::{Asset, ChannelKind, TexelFormat};
use fantex_stream::drawing::{
    AtlasGrid, PAGE_ROW_SHIFT, PageWords, frame_records, group_records, mean_records, upload_rectangles,
};
use fantex_stream::read::{RemoteAccess, RemoteFile};
use fantex_stream::{
    AtlasFormat, AtlasShape, ClusterLoader, ClusterLoaderOptions, FrameChanges, FrameOptions, PageTable,
    ParcelUpload, StreamView, Streamer, StreamerOptions, open_fetched,
};
use js_sys::Function;
use wasm_bindgen::prelude::*;

use crate::geometry::{FanGeometry, ObjectSpace};
use crate::materials::FanMaterial;

/// Longest time that a frame counts for: a page that was hidden goes on where it was.
const MAX_FRAME_SECONDS: f32 = 0.1;

/// Bytes of texels that a frame uploads.
const UPLOAD_BYTES: usize = 2 << 20;

/// What pages draw.
const DRAWN: [ChannelKind; 5] = [
    ChannelKind::BaseColor,
    ChannelKind::Normal,
    ChannelKind::OcclusionRoughnessMetallic,
    ChannelKind::Emission,
    ChannelKind::Light,
];

/// Has panics say in the console where they were.
#[wasm_bindgen(start)]
pub fn start() {
    std::panic::set_hook(Box::new(|panic| web_sys::console::error_1(&panic.to_string().into())));
}

#[wasm_bindgen]
extern "C" {
    /// Whoever hands texels and words to the textures.
    #[derive(Debug)]
    pub type Sink;

    /// Texels of a channel for the rectangle `x, y, width, height` of its atlas: rows of blocks or of texels. The bytes are the
    /// core's own, and are gone after the call.
    #[wasm_bindgen(method)]
    fn texels(this: &Sink, channel: usize, x: u32, y: u32, width: u32, height: u32, bytes: &[u8]);

    /// Words of the page table, for one row from `x, y` on.
    #[wasm_bindgen(method)]
    fn words(this: &Sink, x: u32, y: u32, words: &[u32]);
}

/// An open asset.
#[wasm_bindgen]
#[derive(Debug)]
pub struct FanCore {
    asset: Arc<Asset>,
    file: Rc<RemoteFile>,
    connections: usize,
    space: ObjectSpace,
    pages: PageTable,
    streaming: Option<Streaming>,
}

/// What is made for a device.
struct Streaming {
    streamer: Streamer,
    grid: AtlasGrid,
    words: PageWords,
    drawn: Vec<(usize, AtlasFormat)>,
    /// Bytes of texels of all channels, of which [`UPLOAD_BYTES`] are drawn.
    upload_bytes: usize,
    /// Bytes of one upload, kept for the next.
    staging: Vec<u8>,
}

impl std::fmt::Debug for Streaming {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Streaming")
            .field("grid", &self.grid)
            .field("drawn", &self.drawn)
            .finish_non_exhaustive()
    }
}

/// How far streaming is.
#[wasm_bindgen]
#[derive(Clone, Copy, Debug)]
pub struct FanProgress {
    /// Share of the visible tiles that are as sharp as the view asks for, 0 to 1.
    pub share: f64,
    /// Whether nothing is on its way: the picture stays until the view changes.
    pub is_settled: bool,
    /// Bytes of texels uploaded so far.
    pub uploaded_bytes: f64,
    /// Parts that cannot be read; coarser ones stand in for them.
    pub damaged: u32,
}

fn said(error: impl std::fmt::Display) -> JsError {
    JsError::new(&error.to_string())
}

#[wasm_bindgen]
impl FanCore {
    /// Opens the asset at `url` with so many requests at a time, which have these `headers`, names and values in turn, and send
    /// `credentials` also to servers elsewhere. `progress` is called with the number of bytes that have come.
    ///
    /// # Errors
    /// The asset cannot be read, or is damaged.
    pub async fn open(
        url: String,
        connections: usize,
        headers: Vec<String>,
        credentials: bool,
        progress: Function,
    ) -> Result<FanCore, JsError> {
        let headers = headers.as_chunks().0.to_vec();
        let access = RemoteAccess { headers, sends_credentials: credentials };
        let file = Rc::new(RemoteFile::new(url).with_access(access));
        let opening = Rc::clone(&file);
        let loaded = std::cell::Cell::new(0.0);
        let fetch = async |range| {
            let fetched = opening.fetch(range).await?;
            loaded.set(loaded.get() + fetched.bytes.len() as f64);
            // What the page's function throws is the page's affair.
            progress.call1(&JsValue::NULL, &loaded.get().into()).unwrap_or_default();
            Ok(fetched)
        };
        let asset = open_fetched(file.url(), fetch).await.map_err(said)?;
        let (space, pages) = (ObjectSpace::of(asset.mesh()), PageTable::new(asset.cover()));
        Ok(Self { asset: Arc::new(asset), file, connections, space, pages, streaming: None })
    }

    /// Four numbers per channel: its kind and its format as files number them, whether its values are sRGB, and whether it is drawn.
    pub fn channels(&self) -> Vec<u32> {
        let channels = self.asset.channels().iter().enumerate();
        let format = |format| TexelFormat::ALL.iter().position(|known| *known == format).unwrap_or(0) as u32;
        channels
            .flat_map(|(index, channel)| {
                let is_drawn = self.is_drawn(index);
                [channel.kind as u32, format(channel.format), channel.srgb.into(), is_drawn.into()]
            })
            .collect()
    }

    /// The materials.
    pub fn materials(&self) -> Vec<FanMaterial> {
        let materials = &self.asset.mesh().materials;
        if materials.is_empty() {
            return vec![FanMaterial::from(&fantex_mesh::Material::default())];
        }
        materials.iter().map(FanMaterial::from).collect()
    }

    /// The triangles.
    pub fn geometry(&self) -> FanGeometry {
        FanGeometry::new(&self.asset, &self.space)
    }

    /// The object's origin in the file's coordinates.
    pub fn origin(&self) -> Vec<f64> {
        self.space.origin.to_array().to_vec()
    }

    /// Width of the blend bands.
    pub fn delta(&self) -> f32 {
        self.asset.cover().delta
    }

    /// Two per group, see [`group_records`].
    pub fn groups(&self) -> Vec<u32> {
        group_records(self.asset.cover(), &self.pages).into_flattened()
    }

    /// Four half floats per group and channel, see [`mean_records`].
    pub fn means(&self) -> Vec<u16> {
        let (groups, channels) = (self.asset.cover().groups.len(), self.asset.channels().len());
        let means = mean_records(groups, channels, |channel, group| self.asset.mean(channel, group));
        bytemuck::cast_slice(&means).to_vec()
    }

    /// Six per group, or none, see [`frame_records`].
    pub fn frames(&self) -> Vec<f32> {
        frame_records(self.asset.cover(), self.asset.channels()).into_flattened()
    }

    /// Columns and rows of the page table.
    pub fn page_extent(&self) -> Vec<u32> {
        PageWords::extent(self.pages.len()).to_vec()
    }

    /// Columns and rows of the textures of an atlas, see [`begin`](Self::begin).
    pub fn atlas_extent(&self, has_blocks: bool, max_side: u32, atlas_bytes: f64) -> Vec<u32> {
        let shape = self.atlas_shape(&self.drawn(has_blocks), max_side, atlas_bytes);
        AtlasGrid::new(shape, max_side).extent().to_vec()
    }

    /// Makes an atlas in which nothing is resident, also after another one was lost: of at most so many bytes, or room for all pages where
    /// that is less, in textures of at most `max_side` texels. `has_blocks`: the device has all compressed formats of the asset. Updates unpack for so many milliseconds, and one
    /// cluster longer at most.
    pub fn begin(
        &mut self,
        has_blocks: bool,
        max_side: u32,
        atlas_bytes: f64,
        max_anisotropy: f32,
        slice_milliseconds: u32,
    ) {
        let drawn = self.drawn(has_blocks);
        let atlas = self.atlas_shape(&drawn, max_side, atlas_bytes);
        let grid = AtlasGrid::new(atlas, max_side);
        let options =
            ClusterLoaderOptions { block_compressed: has_blocks, ..ClusterLoaderOptions::default() };
        let reader = Box::new(self.file.reader(self.connections));
        let slice = Duration::from_millis(slice_milliseconds.into());
        let loader = ClusterLoader::without_threads(Arc::clone(&self.asset), reader, &options, slice);
        let options = StreamerOptions { atlas, max_anisotropy, ..StreamerOptions::default() };
        let streamer = Streamer::new(self.asset.clone(), Box::new(loader), options);
        let words = PageWords::new(self.asset.cover(), &self.pages);
        let upload_bytes = self.upload_bytes(&drawn, has_blocks);
        self.streaming = Some(Streaming { streamer, grid, words, drawn, upload_bytes, staging: Vec::new() });
    }

    /// Hands over what has come, and asks for what a view needs. `view`, object space: see [`StreamView::of_numbers`]. An empty one sees
    /// nothing.
    pub fn update(&mut self, view: &[f64], seconds: f32, sink: &Sink) {
        let view = StreamView::of_numbers(&self.space.object_from_mesh, view);
        let Some(streaming) = &mut self.streaming else { return };
        let frame = FrameOptions {
            upload_bytes: streaming.upload_bytes,
            elapsed_seconds: seconds.clamp(0.0, MAX_FRAME_SECONDS),
        };
        let changes = streaming.streamer.update(view.as_ref(), frame);
        streaming.hand_over(&changes, sink);
    }

    /// How far streaming is.
    pub fn progress(&self) -> FanProgress {
        let Some(Streaming { streamer, upload_bytes, .. }) = &self.streaming else {
            return FanProgress { share: 0.0, is_settled: false, uploaded_bytes: 0.0, damaged: 0 };
        };
        let figures = streamer.statistics();
        FanProgress {
            share: figures.complete_share(),
            is_settled: streamer.is_settled(),
            uploaded_bytes: figures.uploaded_bytes as f64 * UPLOAD_BYTES as f64 / *upload_bytes as f64,
            damaged: figures.damaged as u32,
        }
    }

    /// Why the first part that cannot be read cannot be, if there is one.
    pub fn damage(&self) -> Option<String> {
        let mut damaged = self.streaming.as_ref()?.streamer.damaged();
        damaged.next().map(|(_, error)| error.to_string())
    }

    /// Asks once more for what could not be read.
    pub fn retry(&mut self) {
        if let Some(Streaming { streamer, .. }) = &mut self.streaming {
            streamer.retry_damaged();
        }
    }
}

impl FanCore {
    /// Whether a page draws a channel: of several of a kind the first one.
    fn is_drawn(&self, channel: usize) -> bool {
        let kind = self.asset.channels()[channel].kind;
        DRAWN.contains(&kind) && self.asset.channel_of_kind(kind) == Some(channel)
    }

    /// The channels that are drawn, and the formats of their texels in an atlas.
    fn drawn(&self, has_blocks: bool) -> Vec<(usize, AtlasFormat)> {
        let channels = self.asset.channels().iter().enumerate();
        let drawn = channels.filter(|(index, _)| self.is_drawn(*index));
        drawn.map(|(index, channel)| (index, AtlasFormat::of(channel.format, has_blocks))).collect()
    }

    /// What of so many bytes the pages need, in textures of at most `max_side` texels; the least where nothing is drawn.
    fn atlas_shape(&self, drawn: &[(usize, AtlasFormat)], max_side: u32, atlas_bytes: f64) -> AtlasShape {
        let formats: Vec<AtlasFormat> = drawn.iter().map(|(_, format)| *format).collect();
        let bytes = if formats.is_empty() { 0 } else { atlas_bytes as u64 };
        AtlasGrid::shape_for(self.asset.cover(), bytes, &formats, max_side)
    }

    /// Bytes of texels of all channels, of which [`UPLOAD_BYTES`] are drawn.
    fn upload_bytes(&self, drawn: &[(usize, AtlasFormat)], has_blocks: bool) -> usize {
        let channels = self.asset.channels().iter();
        let all: usize = channels.map(|c| AtlasFormat::of(c.format, has_blocks).block_bytes()).sum();
        let own: usize = drawn.iter().map(|(_, format)| format.block_bytes()).sum();
        (UPLOAD_BYTES as u64 * all.max(1) as u64 / own.max(1) as u64) as usize
    }
}

impl Streaming {
    fn hand_over(&mut self, changes: &FrameChanges, sink: &Sink) {
        for upload in &changes.uploads {
            self.hand_over_texels(upload, sink);
        }
        for run in self.words.change(&changes.entries, self.grid) {
            let (x, y) = (run.start & ((1 << PAGE_ROW_SHIFT) - 1), run.start >> PAGE_ROW_SHIFT);
            sink.words(x, y, &self.words.words()[run.start as usize..run.end as usize]);
        }
    }

    fn hand_over_texels(&mut self, ParcelUpload { place, texels, .. }: &ParcelUpload, sink: &Sink) {
        let [x, y] = self.grid.texel(*place);
        for &(channel, format) in &self.drawn {
            for rectangle in upload_rectangles(texels, channel, format) {
                self.staging.clear();
                rectangle.rows().for_each(|row| self.staging.extend_from_slice(row));
                let ([right, down], [width, height]) = (rectangle.offset, rectangle.size);
                sink.texels(channel, x + right, y + down, width, height, &self.staging);
            }
        }
    }
}
