//! Fan-textured models: geometry, atlas and texture function on the GPU.
//!
//! ```text
//!  Mesh, Cover  --drawing---> plain triangles, border triangles     vertex buffers (fantex_stream::drawing)
//!               --bindings--> groups, means, frames                 storage buffers
//!  FrameChanges --atlas-----> pages in the atlas, page table        textures
//!  fan_lookup.wgsl    a tile: levels, probes, where they lie in the atlas
//!  fan.wgsl           a fragment: the groups that have weight, blended; from there on as any surface
//! ```
//!
//! **The atlas is one texture without mip levels; the shader blends two levels.** Arrays by size class with real mip chains would fragment
//! a small pool and keep whole chains. `examples/fan_speed.rs` of `fantex-bench` compares frames with those of the same model with an
//! ordinary texture; figures are in `docs/benchmarks.md`.
//!
//! **The shaders are shaped by software adapters**, which execute both sides of every branch, run a loop's body once more than needed if
//! its test comes first, and read storage buffers lane by lane. So tiles of one page per level have a straight path, and larger tiles
//! (`FAN_PAGED`) a pipeline of their own; border triangles loop over the groups that have weight and test at the loop's end; pages are
//! fetched from a texture whose words name the coarser level that stands in for a missing one; materials are uniforms. **Graphics cards**
//! go round what a pixel does not need (`FAN_BRANCHES`): levels that have no weight, and, in larger tiles, all that is asked per probe where
//! the pixel reads one page of each level. Both read the same (`tests/gpu/sampler.rs`).
//!
//! **Uploads** go through mapped staging buffers that are used again: a steady stream of pages allocates nothing.

mod atlas;
mod bindings;
#[cfg(not(target_arch = "wasm32"))]
mod blocking;
mod colors;
mod programs;

use std::ops::Range;
use std::sync::Arc;

pub use atlas::AtlasViewer;
use atlas::{DRAWN_KINDS, Uploader, checked_grid};
use bindings::{BindingSource, FanBindings, FanMaterials, FanTables};
use colors::FanColors;
use fantex_base::Result;
use fantex_cover::Cover;
use fantex_mesh::{Material, Mesh, OpposedTriangles, shading_normals};
use fantex_scene::{Camera, FilterOptions};
use fantex_store::{Asset, Channel, ChannelKind};
use fantex_stream::drawing::{
    AtlasGrid, CHUNK_TRIANGLES, GeometryChunk, GeometrySource, MaterialRun, PageWords,
};
use fantex_stream::{
    AtlasFormat, AtlasShape, FrameChanges, FrameOptions, Geometry, PageTable, ParcelLoader, StreamView,
    Streamer, StreamerOptions, complete_atlas,
};
use fantex_texture::Filter;
use glam::Vec3;
pub(crate) use programs::FanPrograms;
use programs::{FanPipelines, Part, Shape, Surface};

use crate::surface_pipeline::{Run, SortedTriangle, SortedTriangles};
use crate::{FrameContext, Gpu, Model, ModelSpace, Overlay, SurfaceKey};

// A fan-textured model.

/// A mesh with the tiles of its cover on the device. Which pages are in its atlas is decided elsewhere and passed to
/// [`FanModel::update`]; until then groups show their mean colours.
#[derive(Debug)]
pub struct FanModel {
    space: ModelSpace,
    shape: AtlasShape,
    formats: Vec<AtlasFormat>,
    bindings: FanBindings,
    chunks: Vec<Chunk>,
    blended: Blended,
    materials: FanMaterials,
    /// One per material.
    surfaces: Vec<Surface>,
    uploader: Uploader,
    /// The atlas that takes the place of the present one.
    next: Option<(FanBindings, Uploader)>,
    pipelines: FanPipelines,
    fan_colors: Option<FanColors>,
    /// Of the current frame.
    key: Option<SurfaceKey>,
    shadow_revision: u64,
}

/// What a model is made of.
#[derive(Clone, Copy, Debug)]
pub struct FanModelSource<'a> {
    /// The mesh.
    pub mesh: &'a Mesh,
    /// Its cover.
    pub cover: &'a Cover,
    /// The channels of the tiles.
    pub channels: &'a [Channel],
    /// The formats of their texels, see [`FanModel::atlas_formats`].
    pub formats: &'a [AtlasFormat],
    /// Numbering of the pages.
    pub pages: &'a PageTable,
    /// The atlas, see [`FanModel::atlas_shape`].
    pub shape: AtlasShape,
}

/// Buffers of one [`GeometryChunk`]; none where they would be empty.
#[derive(Debug)]
struct Chunk {
    plain: Option<(wgpu::Buffer, wgpu::Buffer)>,
    border: Option<wgpu::Buffer>,
    runs: Vec<MaterialRun>,
}

/// Blended triangles: all as border triangles, the farthest first.
#[derive(Debug)]
struct Blended {
    vertices: Option<wgpu::Buffer>,
    indices: Option<wgpu::Buffer>,
    sorted: SortedTriangles,
    runs: Vec<Run>,
}

impl FanModel {
    /// Has the pipelines compiled with which frames draw a small asset that has channels of these kinds and a plain opaque material, so that they
    /// are there when it is. What another asset needs is compiled when it is first drawn.
    pub fn prepare_pipelines(gpu: &Gpu, kinds: &[ChannelKind], frame: SurfaceKey) {
        let drawn = DRAWN_KINDS.map(|kind| kinds.contains(&kind));
        let surface = Surface::of(&Material::default());
        for shape in [Shape::Plain, Shape::Border] {
            let part = Part { shape, surface, is_paged: false };
            gpu.fan_programs().surface(gpu, frame, part, drawn);
        }
    }

    /// The formats in which [`FanModel::update`] takes the channels' texels: block-compressed as they are stored where the device
    /// samples that at full speed, else decoded.
    pub fn atlas_formats(gpu: &Gpu, channels: &[Channel]) -> Vec<AtlasFormat> {
        let has_blocks = gpu.has_block_compression();
        channels.iter().map(|channel| AtlasFormat::of(channel.format, has_blocks)).collect()
    }

    /// The largest atlas for these formats within a budget that the device's textures can hold.
    pub fn atlas_shape(gpu: &Gpu, budget_bytes: u64, formats: &[AtlasFormat]) -> AtlasShape {
        AtlasGrid::fitting(AtlasShape::within(budget_bytes, formats), gpu.limits().max_texture_dimension_2d)
    }

    /// A model of an open asset whose texels take at most `budget_bytes` of graphics memory. Mesh and cover are `geometry`, the asset's own
    /// or a copy.
    ///
    /// # Errors
    /// As [`FanModel::new`].
    pub fn of_asset(
        gpu: &Gpu,
        asset: &Asset,
        geometry: &dyn Geometry,
        pages: &PageTable,
        budget_bytes: u64,
    ) -> Result<Self> {
        let formats = Self::atlas_formats(gpu, asset.channels());
        let shape = Self::atlas_shape(gpu, budget_bytes, &formats);
        Self::with_atlas(gpu, asset, geometry, pages, shape, &|_| {})
    }

    /// A small asset with all its texels, which stay. Mesh and cover are `geometry`, the asset's own or a copy.
    ///
    /// # Errors
    /// As [`FanModel::new`]; the texels cannot be read or are too many for one atlas.
    pub fn complete(gpu: &Gpu, asset: &Asset, geometry: &dyn Geometry) -> Result<Self> {
        let formats = Self::atlas_formats(gpu, asset.channels());
        let (shape, changes) = complete_atlas(asset, &formats, gpu.limits().max_texture_dimension_2d)?;
        let pages = PageTable::new(geometry.cover());
        let mut model = Self::with_atlas(gpu, asset, geometry, &pages, shape, &|_| {})?;
        model.update(gpu, &changes);
        Ok(model)
    }

    fn with_atlas(
        gpu: &Gpu,
        asset: &Asset,
        geometry: &dyn Geometry,
        pages: &PageTable,
        shape: AtlasShape,
        progress: &dyn Fn(f32),
    ) -> Result<Self> {
        let channels = asset.channels();
        let formats = &Self::atlas_formats(gpu, channels)[..];
        let (mesh, cover) = (geometry.mesh(), geometry.cover());
        let source = FanModelSource { mesh, cover, channels, formats, pages, shape };
        Self::with_progress(gpu, &source, |channel, group| asset.mean(channel, group), progress)
    }

    /// A model; `mean` gives the mean linear RGBA of a channel and group.
    ///
    /// # Errors
    /// The device cannot hold the cover's tables or the atlas.
    pub fn new(
        gpu: &Gpu,
        source: &FanModelSource<'_>,
        mean: impl Fn(usize, u32) -> [f32; 4],
    ) -> Result<Self> {
        Self::with_progress(gpu, source, mean, &|_| {})
    }

    /// The same; `progress` is told the share that is done, 0..1, ascending.
    fn with_progress(
        gpu: &Gpu,
        source: &FanModelSource<'_>,
        mean: impl Fn(usize, u32) -> [f32; 4],
        progress: &dyn Fn(f32),
    ) -> Result<Self> {
        let FanModelSource { mesh, cover, channels, formats, pages, shape } = *source;
        let limits = gpu.limits();
        let longest = FanTables::longest_bytes(cover, channels);
        gpu.allow("the tables of a cover", longest, limits.max_storage_buffer_binding_size, "bytes")?;
        let allowed = limits.max_texture_dimension_2d;
        let [columns, rows] = PageWords::extent(pages.len());
        gpu.allow("the page table", columns.max(rows), allowed, "texels per side")?;
        let grid = checked_grid(gpu, shape)?;
        let parts = BindingSource { cover, channels, formats, grid, pages };
        let bindings = FanBindings::new(gpu, parts, mean);
        progress(0.1);
        let normals = shading_normals(mesh);
        progress(0.3);
        let opposed = OpposedTriangles::of(&mesh.triangles);
        let geometry = GeometrySource { mesh, cover, normals: &normals, opposed: &opposed };
        let [solid, blended] = geometry.order();
        progress(0.4);
        let mut chunks = Vec::new();
        for chunk in geometry.chunks(&solid) {
            chunks.push(Chunk::new(gpu, chunk));
            let done = (chunks.len() * CHUNK_TRIANGLES) as f32 / solid.len().max(1) as f32;
            progress(0.4 + 0.5 * done.min(1.0));
        }
        let blended = Blended::new(gpu, &geometry, &blended)?;
        progress(0.95);
        let default_material = [Material::default()];
        let materials =
            if mesh.materials.is_empty() { &default_material[..] } else { mesh.materials.as_slice() };
        Ok(Self {
            space: ModelSpace::of_mesh(mesh),
            shape,
            uploader: Uploader::new(&gpu.device, grid, PageWords::new(cover, pages)),
            next: None,
            pipelines: FanPipelines::default(),
            surfaces: materials.iter().map(Surface::of).collect(),
            materials: FanMaterials::new(gpu, materials)?,
            formats: formats.to_vec(),
            bindings,
            chunks,
            blended,
            fan_colors: None,
            key: None,
            shadow_revision: 0,
        })
    }

    /// Begins to replace the atlas by an empty one of another shape. From now on [`FanModel::update`] fills that one, while
    /// pictures show the present one as it is, until [`FanModel::finish_atlas`]; for that time both take graphics memory.
    /// `pages` is the numbering that the model was made with.
    ///
    /// # Errors
    /// The device cannot hold it; then everything is as it was.
    pub fn begin_atlas(
        &mut self,
        gpu: &Gpu,
        cover: &Cover,
        pages: &PageTable,
        shape: AtlasShape,
    ) -> Result<()> {
        let grid = checked_grid(gpu, shape)?;
        // One that is being filled stays until there is another: the streamer counts on it.
        let bindings = gpu.make(|| self.bindings.with_atlas(gpu, grid, &self.formats))?;
        let uploader = Uploader::new(&gpu.device, grid, PageWords::new(cover, pages));
        self.next = Some((bindings, uploader));
        self.shape = shape;
        Ok(())
    }

    /// Whether an atlas is being filled that is not shown yet.
    pub fn has_hidden_atlas(&self) -> bool {
        self.next.is_some()
    }

    /// Shows the atlas that was begun, if any, and drops the one before.
    pub fn finish_atlas(&mut self) {
        if let Some((bindings, uploader)) = self.next.take() {
            (self.bindings, self.uploader) = (bindings, uploader);
            self.shadow_revision += 1;
        }
    }

    /// The shape of the atlas that takes pages.
    pub fn shape(&self) -> AtlasShape {
        self.shape
    }

    /// The atlas of one of the asset's channels, to be looked at: layers beside each other. None for channels that are not drawn.
    pub fn atlas_texture(&self, channel: usize) -> Option<&wgpu::Texture> {
        let filled = self.next.as_ref().map_or(&self.bindings, |(bindings, _)| bindings);
        filled.atlases.get(channel)?.as_ref().map(|atlas| &atlas.texture)
    }

    /// Bind group 1 of shaders that evaluate the texture function ([`shader::FAN`](crate::shader::FAN)), and its layout.
    pub fn texture_group(&self) -> (&wgpu::BindGroup, &wgpu::BindGroupLayout) {
        (&self.bindings.group, &self.bindings.layout)
    }

    /// Values of the overrides of such shaders, for a filter and for tiles of [several pages](fantex_store::PAGE) or of one.
    pub fn texture_constants(&self, filter: Filter, is_paged: bool) -> Vec<(&'static str, f64)> {
        self.bindings.constants(filter, is_paged)
    }

    /// Has such shaders use a filter; frames do it themselves.
    pub fn set_filter(&mut self, gpu: &Gpu, filter: &FilterOptions) {
        self.bindings.set_filter(&gpu.queue, filter);
    }

    /// Bytes of graphics memory that texels take: those of the channels that are drawn, in the atlas that takes pages.
    pub fn texel_bytes(&self) -> u64 {
        let drawn = self.bindings.atlases.iter().flatten().map(|atlas| atlas.format);
        self.shape.bytes(&drawn.collect::<Vec<_>>())
    }

    /// The formats of the channels' texels in [`FanModel::update`].
    pub fn formats(&self) -> &[AtlasFormat] {
        &self.formats
    }

    /// Brings pages into the atlas and entries into the page table, before the next frame that is submitted.
    pub fn update(&mut self, gpu: &Gpu, changes: &FrameChanges) {
        if changes.uploads.is_empty() && changes.entries.is_empty() {
            return;
        }
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let (bindings, uploader) = match &mut self.next {
            Some((bindings, uploader)) => (bindings, uploader),
            None => (&mut self.bindings, &mut self.uploader),
        };
        uploader.record(&mut encoder, changes, &bindings.atlases, &bindings.tables.pages);
        gpu.queue.submit([encoder.finish()]);
        if self.surfaces.iter().any(|m| m.alpha_mode != 0) {
            self.shadow_revision += 1;
        }
    }

    /// Draws the chunks: `pipeline` says with which pipeline a surface is drawn, if at all.
    fn draw_chunks<'a>(
        &'a self,
        pass: &mut wgpu::RenderPass<'_>,
        pipeline: impl Fn(Part) -> Option<&'a wgpu::RenderPipeline>,
    ) {
        let mut current = None;
        for chunk in &self.chunks {
            for shape in [Shape::Plain, Shape::Border] {
                if !chunk.bind(pass, shape) {
                    continue;
                }
                for run in &chunk.runs {
                    let Some(next) = pipeline(self.part(shape, run)) else { continue };
                    if current != Some(next) {
                        pass.set_pipeline(next);
                        current = Some(next);
                    }
                    self.materials.bind(pass, run.material);
                    match shape {
                        Shape::Plain => pass.draw_indexed(run.plain.clone(), 0, 0..1),
                        Shape::Border => pass.draw(run.border.clone(), 0..1),
                    }
                }
            }
        }
    }

    fn draw_blended<'a>(
        &'a self,
        pass: &mut wgpu::RenderPass<'_>,
        pipeline: impl Fn(Part) -> Option<&'a wgpu::RenderPipeline>,
    ) {
        let (Some(vertices), Some(indices)) = (&self.blended.vertices, &self.blended.indices) else { return };
        pass.set_vertex_buffer(0, vertices.slice(..));
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
        for run in &self.blended.runs {
            if let Some(pipeline) = pipeline(self.blended_part(run)) {
                pass.set_pipeline(pipeline);
                self.materials.bind(pass, run.material);
                pass.draw_indexed(run.indices.clone(), 0, 0..1);
            }
        }
    }

    fn part(&self, shape: Shape, run: &MaterialRun) -> Part {
        let surface = self.surfaces[run.material as usize].opposed(run.is_opposed);
        Part { shape, surface, is_paged: run.is_paged }
    }

    fn blended_part(&self, run: &Run) -> Part {
        let surface = self.surfaces[run.material as usize].opposed(run.is_opposed);
        Part { shape: Shape::Border, surface, is_paged: true }
    }

    fn parts(&self) -> impl Iterator<Item = Part> {
        let solid = self.chunks.iter().flat_map(|chunk| &chunk.runs).flat_map(move |run| {
            let shapes = [(Shape::Plain, &run.plain), (Shape::Border, &run.border)];
            let drawn = shapes.into_iter().filter(|(_, range): &(_, &Range<u32>)| !range.is_empty());
            drawn.map(move |(shape, _)| self.part(shape, run))
        });
        solid.chain(self.blended.runs.iter().map(|run| self.blended_part(run)))
    }
}

impl Model for FanModel {
    fn space(&self) -> &ModelSpace {
        &self.space
    }

    fn shadow_revision(&self) -> u64 {
        self.shadow_revision
    }

    fn prepare(
        &mut self,
        gpu: &Gpu,
        _encoder: &mut wgpu::CommandEncoder,
        frame: &FrameContext<'_>,
    ) -> Result<()> {
        self.bindings.set_filter(&gpu.queue, &frame.options.filter);
        self.blended.sort(gpu, frame);
        self.key = Some(frame.key);
        if frame.key.overlay == Overlay::Fans {
            let colors = self.fan_colors.get_or_insert_with(|| FanColors::new(gpu, &self.space));
            colors.prepare(gpu, frame.key, &self.bindings, &self.materials);
        }
        let parts: Vec<_> = self.parts().collect();
        let drawn = self.bindings.drawn_kinds();
        for part in parts {
            self.pipelines.prepare_surface(gpu, frame.key, part, drawn);
            if frame.draws_shadows {
                self.pipelines.prepare_caster(gpu, part, drawn);
            }
        }
        Ok(())
    }

    fn draw_casters(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_bind_group(1, &self.bindings.group, &[]);
        self.draw_chunks(pass, |part| self.pipelines.caster(part));
        self.draw_blended(pass, |part| self.pipelines.caster(part));
    }

    fn draw_opaque(&self, pass: &mut wgpu::RenderPass<'_>) {
        let Some(key) = self.key else { return };
        pass.set_bind_group(1, &self.bindings.group, &[]);
        match &self.fan_colors {
            Some(colors) if key.overlay == Overlay::Fans => {
                self.materials.bind(pass, 0);
                colors.draw(pass, key);
            }
            _ => self.draw_chunks(pass, |part| self.pipelines.surfaces.get(&(key, part))),
        }
    }

    fn draw_layered(&self, pass: &mut wgpu::RenderPass<'_>) {
        let Some(key) = self.key else { return };
        if key.overlay != Overlay::Fans {
            pass.set_bind_group(1, &self.bindings.group, &[]);
            self.draw_blended(pass, |part| self.pipelines.surfaces.get(&(key, part)));
        }
    }
}

impl Chunk {
    fn new(gpu: &Gpu, chunk: GeometryChunk) -> Self {
        use wgpu::BufferUsages as U;
        let plain = geometry_buffer(gpu, &chunk.plain_vertices, U::VERTEX).zip(geometry_buffer(
            gpu,
            &chunk.plain_indices,
            U::INDEX,
        ));
        Self { plain, border: geometry_buffer(gpu, &chunk.border_vertices, U::VERTEX), runs: chunk.runs }
    }

    fn bind(&self, pass: &mut wgpu::RenderPass<'_>, shape: Shape) -> bool {
        match (shape, &self.plain, &self.border) {
            (Shape::Plain, Some((vertices, indices)), _) => {
                pass.set_vertex_buffer(0, vertices.slice(..));
                pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
                true
            }
            (Shape::Border, _, Some(vertices)) => {
                pass.set_vertex_buffer(0, vertices.slice(..));
                true
            }
            _ => false,
        }
    }
}

impl Blended {
    fn new(gpu: &Gpu, geometry: &GeometrySource<'_>, triangles: &[u32]) -> Result<Self> {
        let corners: Vec<_> = triangles.iter().flat_map(|&t| geometry.border_corners(t as usize)).collect();
        let (bytes, allowed) = (size_of_val(corners.as_slice()) as u64, gpu.limits().max_buffer_size);
        gpu.allow("the blended part of a model", bytes, allowed, "bytes")?;
        let opposed = geometry.opposed;
        let sorted = triangles.iter().zip(0u32..).map(|(&t, i)| SortedTriangle {
            centre: geometry.mesh.triangle_positions(t as usize).iter().sum::<Vec3>() / 3.0,
            corners: [3 * i, 3 * i + 1, 3 * i + 2],
            material: geometry.material(t),
            is_opposed: opposed.contains(t as usize),
        });
        let sorted = SortedTriangles::new(sorted.collect());
        let indices = sorted.index_buffer(gpu);
        let vertices = geometry_buffer(gpu, &corners, wgpu::BufferUsages::VERTEX);
        Ok(Self { vertices, indices, sorted, runs: Vec::new() })
    }

    fn sort(&mut self, gpu: &Gpu, frame: &FrameContext<'_>) {
        let Some(indices) = &self.indices else { return };
        if let Some((corners, runs)) = self.sorted.sort(frame.view) {
            gpu.queue.write_buffer(indices, 0, bytemuck::cast_slice(&corners));
            self.runs = runs;
        }
    }
}

/// Vertices or indices; nothing where there are none.
fn geometry_buffer<T: bytemuck::Pod>(
    gpu: &Gpu,
    items: &[T],
    usage: wgpu::BufferUsages,
) -> Option<wgpu::Buffer> {
    (!items.is_empty()).then(|| gpu.buffer("fan triangles", bytemuck::cast_slice(items), usage))
}

// Models that bring their own pages: a streamer and a model put together.

/// An asset on the device, whose pages come as views need them.
pub struct StreamedModel {
    /// What is drawn.
    pub model: FanModel,
    /// What decides which pages are resident.
    pub streamer: Streamer,
    /// Seconds for which another atlas has been filled.
    filling_seconds: f32,
}

impl std::fmt::Debug for StreamedModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("StreamedModel").field("model", &self.model).finish_non_exhaustive()
    }
}

/// Share of the time of making a model that its streamer takes.
const STREAMER_SHARE: f32 = 0.3;

/// Seconds after which another atlas is shown even if it lacks pages.
const MAX_FILLING_SECONDS: f32 = 3.0;

impl StreamedModel {
    /// An asset whose pages come from `loader`, in at most `budget_bytes` of graphics memory, or room for all pages where that is less. Mesh and cover are kept as `geometry`, which is the asset's own or a copy; of
    /// the asset nothing else is.
    ///
    /// # Errors
    /// The device cannot take the model.
    pub fn with_pages(
        gpu: &Gpu,
        asset: &Asset,
        geometry: Arc<dyn Geometry>,
        loader: Box<dyn ParcelLoader>,
        budget_bytes: u64,
    ) -> Result<Self> {
        Self::with_pages_and_progress(gpu, asset, geometry, loader, budget_bytes, &|_| {})
    }

    /// The same; `progress` is told the share that is done, 0..1, ascending.
    ///
    /// # Errors
    /// As [`with_pages`](Self::with_pages).
    pub fn with_pages_and_progress(
        gpu: &Gpu,
        asset: &Asset,
        geometry: Arc<dyn Geometry>,
        loader: Box<dyn ParcelLoader>,
        budget_bytes: u64,
        progress: &dyn Fn(f32),
    ) -> Result<Self> {
        let formats = FanModel::atlas_formats(gpu, asset.channels());
        let atlas = Self::atlas_shape(gpu, geometry.cover(), budget_bytes, &formats);
        let options = StreamerOptions { atlas, ..StreamerOptions::default() };
        let streamer = Streamer::new(Arc::clone(&geometry), loader, options);
        progress(STREAMER_SHARE);
        let in_all = |share: f32| progress(STREAMER_SHARE + (1.0 - STREAMER_SHARE) * share);
        let model = FanModel::with_atlas(gpu, asset, &*geometry, streamer.table(), atlas, &in_all)?;
        progress(1.0);
        Ok(Self { model, streamer, filling_seconds: 0.0 })
    }

    /// What of a budget a cover's pages need.
    fn atlas_shape(gpu: &Gpu, cover: &Cover, budget_bytes: u64, formats: &[AtlasFormat]) -> AtlasShape {
        AtlasGrid::shape_for(cover, budget_bytes, formats, gpu.limits().max_texture_dimension_2d)
    }

    /// Brings to the device what has arrived, and asks for what a view needs; `None` where nothing is seen. Returns what has
    /// changed.
    pub fn advance(&mut self, gpu: &Gpu, view: Option<&StreamView>, frame: FrameOptions) -> FrameChanges {
        let changes = self.streamer.update(view, frame);
        self.model.update(gpu, &changes);
        if self.model.has_hidden_atlas() {
            self.filling_seconds += frame.elapsed_seconds;
            if self.streamer.is_settled() || self.filling_seconds > MAX_FILLING_SECONDS {
                self.model.finish_atlas();
            }
        }
        changes
    }

    /// Gives texels another budget, without a pause: the new atlas is filled as pages arrive, and the present one is shown, as
    /// it is, until the new one has what the view needs, for a few seconds at most. For that time there are both.
    ///
    /// # Errors
    /// The device cannot take the atlas; then everything is as it was.
    pub fn set_budget(&mut self, gpu: &Gpu, budget_bytes: u64) -> Result<()> {
        let geometry = self.streamer.geometry().clone();
        let shape = Self::atlas_shape(gpu, geometry.cover(), budget_bytes, self.model.formats());
        if shape == self.model.shape() {
            return Ok(());
        }
        self.model.begin_atlas(gpu, geometry.cover(), self.streamer.table(), shape)?;
        self.streamer.set_atlas(shape);
        self.filling_seconds = 0.0;
        Ok(())
    }
}

/// What a filter asks of the demand: the greatest ratio of a pixel's axes that it honours.
pub fn max_anisotropy(filter: &FilterOptions) -> f32 {
    match filter.filter {
        Filter::Anisotropic | Filter::Ewa => filter.max_anisotropy,
        Filter::Nearest | Filter::Bilinear | Filter::Bicubic | Filter::BicubicMipmaps | Filter::Trilinear => {
            1.0
        }
    }
}

/// A camera's view onto `size` pixels of a model, as demand needs to know it.
pub fn stream_view(camera: &Camera, size: [u32; 2], space: &ModelSpace) -> StreamView {
    StreamView::in_world(&space.world_from_mesh, camera.eye, camera.axes(), camera.fov_degrees, size)
}
