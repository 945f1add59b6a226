//! One tile: evaluating the source, fitting, levels, encoding.
//!
//! ```text
//!  block 0,0 | block 1,0      a tile up to MAX_BLOCK_SIDE texels long is one block
//!  ----------+----------      each block: levels 0..SHARED_LEVEL as whole pages, and its part of SHARED_LEVEL
//!  block 0,1 | block 1,1      the tile:   SHARED_LEVEL and everything coarser
//! ```
//!
//! Large tiles are cut into blocks with a margin of `BLOCK_MARGIN` texels (`NOISY_MARGIN` for light that is denoised), so that a texel's value does
//! not depend on the cut, but for texels that lie under something and take what their block shows farther away. The memory for texels in work
//! does not grow with the tile. Its encoded pages do take more: the writer wants all of a level before the next.

use std::time::{Duration, Instant};

use fantex_base::Result;
use fantex_cover::{
    BLOCK_MARGIN, BlockPart, Cover, Footprints, Group, MAX_BLOCK_SIDE, SHARED_LEVEL, TexelBlock,
    TexelTriangle, TileBlock,
};
use fantex_mesh::{AlphaMode, Mesh};
use fantex_store::{
    Channel, ChannelKind, EncodedPage, PageId, PageTexels, Quality, TexelFormat, TexelSlice, encode_many,
    page_extent, page_grid, page_origin,
};
use fantex_texture::color::{srgb8_encoder, unorm8};
use fantex_texture::levels::{Covered, CutOuts, LargestCutOut, Raster, TexelMean};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::bake::Meter;
use crate::light::{NoisyLight, REACH_TEXELS};
use crate::raster::{Fitting, Overshoot, StoredRows, is_block_read, mean, texels_around};
use crate::{BakeFormat, BakeOptions, LightMapSource, Source, SourceChannel, TexelPoint, TrianglePlane};
use evaluation::Evaluation;

mod evaluation;

/// The margin of light that is denoised, a multiple of `BLOCK_MARGIN` as all margins are.
const NOISY_MARGIN: u32 = BLOCK_MARGIN + REACH_TEXELS.next_multiple_of(BLOCK_MARGIN);

/// Points of a triangle that are found at once.
const PLANE_POINTS: usize = 8;

/// How large a part of a texel's side stands for its centre: relief is a difference of heights, so it must not be zero.
const POINT_SIDE: f32 = 1.0 / 64.0;

/// Texels of light between two looks at whether the user wants to stop.
const LIT_TEXELS: u32 = 16;

/// Makes the area around a point so small that its mean is the value at the point.
fn narrow(point: &mut TexelPoint) {
    point.lambda_steps = point.lambda_steps.map(|step| step * POINT_SIDE);
    point.position_steps = point.position_steps.map(|step| step * POINT_SIDE);
}

pub(crate) struct TileBaker<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) cover: &'a Cover,
    pub(crate) source: &'a dyn Source,
    pub(crate) normals: &'a [Vec3],
    pub(crate) plans: &'a [ChannelPlan],
    pub(crate) options: &'a BakeOptions,
    /// Texels that may be in work at once.
    pub(crate) in_work: u64,
    pub(crate) meter: &'a Meter<'a>,
}

#[derive(Default)]
pub(crate) struct BakedTile {
    /// All pages, as the writer wants them.
    pub(crate) pages: Vec<EncodedPage>,
    /// Mean linear value per channel.
    pub(crate) means: Vec<[f32; 4]>,
    /// The shares of cut-outs that are there, once they are known.
    covered: Covered,
    pub(crate) bake_time: Duration,
    pub(crate) encode_time: Duration,
}

impl TileBaker<'_> {
    /// Bakes the tile of a group; `triangles` are those with a corner in the group.
    pub(crate) fn bake(&self, group: u32, triangles: &[u32]) -> Result<BakedTile> {
        let extent = self.cover.groups[group as usize].extent;
        let started = Instant::now();
        let cut_outs = self.cut_outs(triangles);
        let largest_cut_out = self.largest_cut_out(triangles);
        let triangles = self.texel_triangles(group, triangles);
        let mut tile = BakedTile { bake_time: started.elapsed(), ..BakedTile::default() };
        if extent.iter().all(|&n| n <= MAX_BLOCK_SIDE) {
            let block = TexelBlock { origin: [0, 0], extent };
            let (raster, read) = self.evaluate(group, triangles, block, &cut_outs, &mut tile)?;
            self.finish_levels(group, 0, raster, &read, &mut tile)?;
            self.meter.add(u64::from(extent[0]) * u64::from(extent[1]));
        } else {
            self.bake_blocks(group, &triangles, &cut_outs, &mut tile)?;
        }
        if let (Some(cut_out), Some(channel)) = (largest_cut_out, self.coverage_channel()) {
            let alpha = &mut tile.means[channel][3];
            *alpha = cut_out.alpha_of_mean(*alpha, &tile.covered, group);
        }
        Ok(tile)
    }

    fn texel_triangles(&self, group: u32, triangles: &[u32]) -> Vec<TexelTriangle> {
        let extent = self.cover.groups[group as usize].extent;
        let texels = Vec2::new(extent[0] as f32, extent[1] as f32);
        let in_tile = |&t: &u32| {
            let inside = self.cover.corner_groups[t as usize].map(|g| g == group);
            let slot = inside.iter().position(|&i| i)?;
            let corners = self.cover.tile_corners(self.mesh, t as usize, slot).map(|uv| uv * texels);
            TexelTriangle::new(t, inside, corners)
        };
        triangles.iter().filter_map(in_tile).collect()
    }

    fn bake_blocks(
        &self,
        group: u32,
        triangles: &[TexelTriangle],
        cut_outs: &CutOuts,
        tile: &mut BakedTile,
    ) -> Result<()> {
        let shape = &self.cover.groups[group as usize];
        let shared_extent = shape.level_extent(SHARED_LEVEL);
        let margin = if self.noisy_light().is_some() { NOISY_MARGIN } else { BLOCK_MARGIN };
        let blocks = TileBlock::all(shape.extent, margin);
        let at_once = (self.in_work / u64::from(MAX_BLOCK_SIDE).pow(2)).max(1) as usize;
        let mut baked = Vec::with_capacity(blocks.len());
        for blocks in blocks.chunks(at_once) {
            let bake = |block: &TileBlock| self.bake_block(group, triangles, block, cut_outs);
            baked.append(&mut blocks.par_iter().map(bake).collect::<Result<Vec<_>>>()?);
        }
        let mut shared = self.empty_raster(shared_extent).with_cut_outs(cut_outs);
        let known: Vec<Covered> = baked.iter().map(|(block, ..)| block.covered.clone()).collect();
        tile.covered = Covered::mean(&known);
        for (block, part, origin) in baked {
            shared.paste(origin, &part);
            tile.pages.extend(block.pages);
            tile.bake_time += block.bake_time;
            tile.encode_time += block.encode_time;
        }
        tile.pages.sort_by_key(|p| (p.id.level, p.id.page[1], p.id.page[0]));
        self.finish_levels(group, SHARED_LEVEL, shared, &[], tile)
    }

    /// The pages of a block finer than `SHARED_LEVEL`, and its part of that level with its place there.
    fn bake_block(
        &self,
        group: u32,
        triangles: &[TexelTriangle],
        block: &TileBlock,
        cut_outs: &CutOuts,
    ) -> Result<(BakedTile, Raster, [u32; 2])> {
        self.meter.check()?;
        let near: Vec<TexelTriangle> =
            triangles.iter().filter(|t| t.touches(block.around)).copied().collect();
        let mut tile = BakedTile::default();
        let (mut raster, read) = self.evaluate(group, near, block.around, cut_outs, &mut tile)?;
        for level in 0..SHARED_LEVEL {
            self.encode_level(group, level, &raster, block.at_level(level), &read, &mut tile)?;
            raster = raster.halved(block.halved(level, raster.extent));
        }
        let part = block.at_level(SHARED_LEVEL);
        self.meter.add(block.texel_count());
        Ok((tile, raster.window(part.start, part.size), part.first))
    }

    /// The texels of a block, and which of its 4x4 blocks look-ups read at level 0.
    fn evaluate(
        &self,
        group: u32,
        triangles: Vec<TexelTriangle>,
        block: TexelBlock,
        cut_outs: &CutOuts,
        tile: &mut BakedTile,
    ) -> Result<(Raster, Vec<bool>)> {
        let started = Instant::now();
        let mut footprints = Footprints { triangles, ..Footprints::default() };
        footprints.cover(block, self.cover.delta);
        let smooth =
            self.noisy_light().map(|light| self.smooth_light(light, &footprints, block)).transpose()?;
        let raster = self.empty_raster(block.extent).with_cut_outs(cut_outs);
        let mut evaluation = Evaluation::new(self, group, raster, smooth);
        self.for_each_point(&footprints, block, |texel, point| evaluation.add(texel, point))?;
        let (mut raster, hidden) = evaluation.finish()?;
        let extent = self.cover.groups[group as usize].extent;
        let read = footprints.read_blocks(block, extent, self.cover.delta);
        raster.read = footprints.in_region;
        if !hidden.is_empty() {
            continue_over(&mut raster, &hidden);
        }
        tile.bake_time += started.elapsed();
        Ok((raster, read))
    }

    /// All texels of a block that a triangle owns, those of a triangle in a row, up to the first error.
    fn for_each_point(
        &self,
        footprints: &Footprints,
        block: TexelBlock,
        mut visit: impl FnMut(u32, TexelPoint) -> Result<()>,
    ) -> Result<()> {
        let width = block.extent[0];
        let corner = Vec2::new(block.origin[0] as f32 + 0.5, block.origin[1] as f32 + 0.5);
        let mut outcome = Ok(());
        footprints.for_each_owner(block, |triangle, owned| {
            if outcome.is_err() {
                return;
            }
            let plane =
                TrianglePlane::new(self.mesh, self.normals, triangle.triangle as usize, triangle.steps);
            // Divisions would take as long as all else about a point.
            let mut row = owned.first().map_or(0, |first| first / width);
            outcome = owned.chunks(PLANE_POINTS).try_for_each(|owned| {
                let mut lambda = [Vec3::ZERO; PLANE_POINTS];
                for (lambda, &texel) in lambda.iter_mut().zip(owned) {
                    while texel < row * width {
                        row -= 1;
                    }
                    while texel - row * width >= width {
                        row += 1;
                    }
                    let place = Vec2::new((texel - row * width) as f32, row as f32);
                    *lambda = triangle.lambda(corner + place);
                }
                owned.iter().zip(plane.points(&lambda)).try_for_each(|(&texel, point)| visit(texel, point))
            });
        });
        outcome
    }

    /// The light that is to be denoised.
    fn noisy_light(&self) -> Option<&LightMapSource<'_>> {
        self.source.light_map().filter(|light| light.denoises())
    }

    /// The light at the texels of a block, without its noise; none at those that are hidden.
    fn smooth_light(
        &self,
        light: &LightMapSource<'_>,
        footprints: &Footprints,
        block: TexelBlock,
    ) -> Result<Vec<Option<Vec3>>> {
        let check = || self.meter.check();
        let mut noisy = NoisyLight::new(block.extent);
        self.for_each_point(footprints, block, |texel, point| {
            if texel.is_multiple_of(LIT_TEXELS) {
                check()?;
            }
            if let Some(estimate) = light.estimate(&point, check)? {
                noisy.set(texel as usize, &estimate, &point);
            }
            Ok(())
        })?;
        let smooth = noisy.smoothed(check)?;
        light.count_left(&smooth);
        Ok(noisy.known(smooth.values))
    }

    /// Normals and directions are stored in the tile's shading frame, as numbers in 0..1. `values` has those of all channels for
    /// every point.
    fn turn_vectors(&self, group: u32, points: &[TexelPoint], values: &mut [Vec4]) {
        let group = &self.cover.groups[group as usize];
        for (channel, plan) in self.plans.iter().enumerate() {
            let stored: fn(&Group, Vec4, Vec3) -> Vec2 = match plan.channel.kind {
                ChannelKind::Normal => {
                    |group, value, normal| group.stored_from_normal(value.truncate(), normal)
                }
                ChannelKind::Anisotropy => {
                    |group, value, normal| group.stored_from_stretch(value.truncate(), value.w, normal)
                }
                _ => continue,
            };
            let values = values.iter_mut().skip(channel).step_by(self.plans.len());
            for (point, value) in points.iter().zip(values) {
                *value = stored(group, *value, point.normal).extend(0.0).extend(1.0);
            }
        }
    }

    /// Encodes `raster`, which is the whole tile at `level`, and all coarser levels; computes the means. `read` are the blocks of level 0 that are
    /// read, if that is the level.
    fn finish_levels(
        &self,
        group: u32,
        level: u32,
        mut raster: Raster,
        read: &[bool],
        tile: &mut BakedTile,
    ) -> Result<()> {
        let shape = &self.cover.groups[group as usize];
        tile.means = means(&raster);
        for l in level..shape.level_count() {
            if l > level {
                let started = Instant::now();
                raster = raster.halved(shape.level_extent(l));
                tile.bake_time += started.elapsed();
            }
            let all = BlockPart { start: [0, 0], size: raster.extent, first: [0, 0] };
            self.encode_level(group, l, &raster, all, read, tile)?;
        }
        Ok(())
    }

    /// Fits, fills and encodes a part of `raster`. `read` are the blocks that are read at level 0; on coarser levels those are kept that a
    /// look-up falls into or beside.
    fn encode_level(
        &self,
        group: u32,
        level: u32,
        raster: &Raster,
        BlockPart { start, size, first }: BlockPart,
        read: &[bool],
        tile: &mut BakedTile,
    ) -> Result<()> {
        let started = Instant::now();
        let mut fitting = match level {
            0 => Fitting::new(raster, self.options.fit, self.source.prefilter(), |c| self.overshoot(c)),
            _ => Fitting::of_values(raster),
        };
        fitting.keep_coverage(&mut tile.covered);
        tile.bake_time += started.elapsed();
        let offset = first.map(|f| f / fantex_store::PAGE);
        let grid = page_grid(size);
        // A row of pages at a time: what is stored takes as much memory as the raster.
        for y in 0..grid[1] {
            self.meter.check()?;
            let started = Instant::now();
            let row = (start[1] + page_origin([0, y])[1]) as usize;
            let rows = row..row + page_extent(size, [0, y])[1] as usize;
            let columns = raster.extent[0] as usize / 4;
            let stored = match level {
                0 => fitting.rows(rows, |[x, y]| read[y * columns + x]),
                _ => fitting.rows(rows, |block| is_block_read(raster, block)),
            };
            tile.bake_time += started.elapsed();
            let started = Instant::now();
            let window = |x| Window {
                rows: &stored,
                left: (start[0] + page_origin([x, y])[0]) as usize,
                extent: page_extent(size, [x, y]),
            };
            let windows: Vec<Window<'_>> = (0..grid[0]).map(window).collect();
            for (x, channels) in (0..).zip(encode_pages(self.plans, self.options.quality, &windows)?) {
                let page = [offset[0] + x, offset[1] + y];
                tile.pages.push(EncodedPage { id: PageId { group, level, page }, channels });
            }
            tile.encode_time += started.elapsed();
        }
        Ok(())
    }

    fn empty_raster(&self, extent: [u32; 2]) -> Raster {
        Raster::empty(extent, self.plans.len(), self.coverage_channel())
    }

    /// The channel whose alpha is coverage.
    fn coverage_channel(&self) -> Option<usize> {
        self.plans.iter().position(|plan| plan.has_alpha)
    }

    /// The cut-outs among the triangles of a tile.
    fn cut_outs(&self, triangles: &[u32]) -> CutOuts {
        let modes = triangles.iter().map(|&triangle| self.alpha_mode(triangle));
        CutOuts::of(modes, self.source.has_shares())
    }

    /// The cut-out that takes most of the area.
    fn largest_cut_out(&self, triangles: &[u32]) -> Option<LargestCutOut> {
        let parts = triangles.iter().map(|&t| (self.alpha_mode(t), self.mesh.triangle_area(t as usize)));
        LargestCutOut::of(parts)
    }

    /// What alpha means on a triangle, as the asset has it.
    fn alpha_mode(&self, triangle: u32) -> AlphaMode {
        self.mesh.alpha_mode(triangle as usize).of_asset()
    }

    fn overshoot(&self, channel: usize) -> Overshoot {
        match self.plans[channel].channel.kind {
            ChannelKind::Normal | ChannelKind::Displacement | ChannelKind::Anisotropy => Overshoot::SIGNED,
            _ => Overshoot::COLOR,
        }
    }
}

/// Gives texels that lie under something what is seen around them: the mean of their neighbours, or else what the finest level that shows
/// something there has. So coarser levels are means of all texels of the surface, as everywhere.
fn continue_over(raster: &mut Raster, hidden: &[u32]) {
    let mut levels: Vec<Raster> = Vec::new();
    loop {
        let finer = levels.last().unwrap_or(&*raster);
        if finer.extent == [1, 1] {
            break;
        }
        let coarser = finer.halved(finer.extent.map(|n| n.div_ceil(2)));
        levels.push(coarser);
    }
    let [width, height] = raster.extent.map(|n| n as usize);
    let mut continued = Vec::with_capacity(hidden.len() * raster.channels);
    for &texel in hidden {
        let [x, y] = [texel as usize % width, texel as usize / width];
        for channel in 0..raster.channels {
            let near = texels_around(texel as usize, [width, height]).filter(|&texel| raster.valid[texel]);
            let near = mean(near.map(|texel| raster.texel(texel)[channel]));
            let of_level = |level: &Raster| {
                let [columns, rows] = level.extent.map(|n| n as usize);
                let texel = y * rows / height * columns + x * columns / width;
                level.valid[texel].then(|| level.texel(texel)[channel])
            };
            continued.push(near.or_else(|| levels.iter().find_map(of_level)));
        }
    }
    for (&texel, values) in hidden.iter().zip(continued.chunks_exact(raster.channels)) {
        let first = texel as usize * raster.channels;
        for (channel, value) in values.iter().enumerate() {
            if let Some(value) = value {
                raster.values[first + channel] = *value;
                raster.valid[texel as usize] = true;
            }
        }
    }
}

/// The mean of each channel where the tile is read, or of what there is. Colours count in proportion to their coverage.
fn means(raster: &Raster) -> Vec<[f32; 4]> {
    let mean = |channel: usize| {
        let of_read = mean_where(raster, channel, |texel| raster.valid[texel] && raster.read[texel]);
        of_read.or_else(|| mean_where(raster, channel, |texel| raster.valid[texel])).unwrap_or(Vec4::ZERO)
    };
    (0..raster.channels).map(|channel| mean(channel).to_array()).collect()
}

fn mean_where(raster: &Raster, channel: usize, counts: impl Fn(usize) -> bool) -> Option<Vec4> {
    let is_covered = raster.coverage == Some(channel);
    let mut mean = TexelMean::default();
    for texel in (0..raster.valid.len()).filter(|&texel| counts(texel)) {
        let value = raster.values[texel * raster.channels + channel];
        if is_covered { mean.add_covered(value) } else { mean.add(value) }
    }
    mean.value()
}

// From linear values to the numbers and bytes that a channel stores.

#[derive(Clone, Debug)]
pub(crate) struct ChannelPlan {
    pub(crate) channel: Channel,
    pub(crate) has_alpha: bool,
}

impl ChannelPlan {
    pub(crate) fn new(source: &SourceChannel, format: BakeFormat) -> Self {
        use ChannelKind::{
            Anisotropy, BaseColor, Displacement, Emission, Light, Normal, OcclusionRoughnessMetallic,
        };
        // Values that 8 bits cannot hold are kept as they are, whatever the format.
        let format = if source.exceeds_one { BakeFormat::Float } else { format };
        let texel_format = match (format, source.kind) {
            (BakeFormat::Float, _) => TexelFormat::Rgba32F,
            (BakeFormat::Rgba8, Normal | Anisotropy) => TexelFormat::Rg8,
            (BakeFormat::Rgba8, Displacement) => TexelFormat::R8,
            (BakeFormat::Rgba8, _) => TexelFormat::Rgba8,
            (_, Normal | Anisotropy) => TexelFormat::Bc5,
            (_, Displacement) => TexelFormat::Bc4,
            (BakeFormat::Bc1, BaseColor | OcclusionRoughnessMetallic | Emission | Light) => TexelFormat::Bc1,
            (BakeFormat::Bc7, BaseColor | OcclusionRoughnessMetallic | Emission | Light) => TexelFormat::Bc7,
        };
        let srgb = format != BakeFormat::Float && matches!(source.kind, BaseColor | Emission | Light);
        let channel = Channel { kind: source.kind, format: texel_format, srgb };
        Self { channel, has_alpha: source.has_alpha }
    }

    fn float(&self, value: Vec4) -> [f32; 4] {
        let [r, g, b, a] = value.to_array();
        [r, g, b, if self.has_alpha { a } else { 1.0 }]
    }

    /// `srgb8` encodes colours.
    fn bytes(&self, value: Vec4, srgb8: impl Fn(f32) -> u8) -> [u8; 4] {
        let [r, g, b, a] = value.to_array();
        let alpha = if self.has_alpha { unorm8(a) } else { 255 };
        if self.channel.srgb {
            [srgb8(r), srgb8(g), srgb8(b), alpha]
        } else {
            [unorm8(r), unorm8(g), unorm8(b), alpha]
        }
    }
}

/// A page within stored rows, which are as high as it is.
struct Window<'a> {
    rows: &'a StoredRows,
    left: usize,
    extent: [u32; 2],
}

impl Window<'_> {
    /// Which of its blocks are read.
    fn read(&self) -> Vec<bool> {
        let (left, width) = (self.left / 4, self.extent[0] as usize / 4);
        self.rows
            .read
            .chunks_exact(self.rows.width / 4)
            .flat_map(|row| &row[left..][..width])
            .copied()
            .collect()
    }

    /// The values of one channel, stored as `store` says; all is zero where nothing is read.
    fn stored<T: Copy>(&self, channel: usize, store: impl Fn(Vec4) -> T) -> Vec<T> {
        let [width, height] = self.extent.map(|n| n as usize);
        let StoredRows { width: stride, values, channels, read } = self.rows;
        let mut stored = Vec::with_capacity(width * height);
        let zero = store(Vec4::ZERO);
        for (y, row) in values.chunks_exact(stride * channels).enumerate() {
            let read = &read[y / 4 * (stride / 4) + self.left / 4..][..width / 4];
            let mut row = &row[self.left * channels..(self.left + width) * channels];
            for blocks in read.chunk_by(PartialEq::eq) {
                let own;
                (own, row) = row.split_at(4 * blocks.len() * channels);
                match blocks[0] {
                    true => stored.extend(own.chunks_exact(*channels).map(|values| store(values[channel]))),
                    false => stored.resize(stored.len() + 4 * blocks.len(), zero),
                }
            }
        }
        stored
    }
}

fn to_encode<'a>(
    texels: impl Iterator<Item = TexelSlice<'a>>,
    pages: &[Window<'_>],
    read: &'a [Vec<bool>],
) -> Vec<PageTexels<'a>> {
    let pages = pages.iter().zip(read).zip(texels);
    pages.map(|((page, read), texels)| PageTexels { extent: page.extent, texels, read: Some(read) }).collect()
}

/// Encodes pages of all channels: `result[page][channel]`.
fn encode_pages(plans: &[ChannelPlan], quality: Quality, pages: &[Window<'_>]) -> Result<Vec<Vec<Vec<u8>>>> {
    let mut encoded = vec![Vec::with_capacity(plans.len()); pages.len()];
    let read: Vec<Vec<bool>> = pages.iter().map(Window::read).collect();
    for (index, plan) in plans.iter().enumerate() {
        let format = plan.channel.format;
        let bytes = if format == TexelFormat::Rgba32F {
            let texels: Vec<Vec<[f32; 4]>> =
                pages.iter().map(|p| p.stored(index, |v| plan.float(v))).collect();
            encode_many(format, quality, &to_encode(texels.iter().map(|t| TexelSlice::F32(t)), pages, &read))?
        } else {
            let srgb8 = srgb8_encoder();
            let texels: Vec<Vec<[u8; 4]>> =
                pages.iter().map(|p| p.stored(index, |v| plan.bytes(v, srgb8))).collect();
            encode_many(format, quality, &to_encode(texels.iter().map(|t| TexelSlice::U8(t)), pages, &read))?
        };
        for (page, bytes) in encoded.iter_mut().zip(bytes) {
            page.push(bytes);
        }
    }
    Ok(encoded)
}

#[cfg(test)]
mod tests {
    use fantex_cover::{CoverOptions, TexelBudget, build_cover};
    use fantex_mesh::{SurfacePoint, generate, shading_normals};
    use fantex_test::cleaned;

    use super::*;
    use crate::{LightMapOptions, LightMapSource, LightScene, NoProgress};

    /// A block's margin is wide enough: within it, denoised light is that of the whole tile, bit by bit.
    #[test]
    fn denoised_light_does_not_depend_on_blocks() {
        let mesh = cleaned(generate::grid(3));
        let budget = TexelBudget::Total(200 * 200);
        let (cover, _) = build_cover(&mesh, &CoverOptions { budget, ..CoverOptions::default() }).unwrap();
        let sky = |direction: Vec3| direction.abs();
        let reflector = |_: SurfacePoint| Vec3::ONE;
        let scene = LightScene { lights: Vec::new(), sky: &sky, reflector: &reflector };
        let options = LightMapOptions { samples: 8, ..LightMapOptions::default() };
        let source = LightMapSource::new(&mesh, &scene, options).unwrap();
        let options = BakeOptions::default();
        let plans: Vec<_> =
            source.channels().iter().map(|channel| ChannelPlan::new(channel, options.format)).collect();
        let baker = TileBaker {
            mesh: &mesh,
            cover: &cover,
            source: &source,
            normals: &shading_normals(&mesh),
            plans: &plans,
            options: &options,
            in_work: u64::MAX,
            meter: &Meter::new(&NoProgress, 0),
        };
        assert_eq!(cover.groups.len(), 1);
        let all: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
        let raster = |block| {
            let triangles = baker.texel_triangles(0, &all);
            let (none, mut tile) = (CutOuts::default(), BakedTile::default());
            baker.evaluate(0, triangles, block, &none, &mut tile).unwrap().0
        };
        let extent = cover.groups[0].extent;
        let whole = raster(TexelBlock { origin: [0, 0], extent });
        let (origin, size, margin) = ([50, 30], [80, 90], REACH_TEXELS);
        let part = raster(TexelBlock { origin, extent: size });
        let mut differ = false;
        for y in 0..size[1] {
            for x in 0..size[0] {
                let at_whole = ((y + origin[1]) * extent[0] + x + origin[0]) as usize;
                let [own, expected] = [part.values[(y * size[0] + x) as usize], whole.values[at_whole]];
                let is_inside =
                    (margin..size[0] - margin).contains(&x) && (margin..size[1] - margin).contains(&y);
                assert!(own == expected || !is_inside, "{x} {y}: {own} {expected}");
                differ |= own != expected;
            }
        }
        assert!(differ, "texels at the cut know less");
    }
}
