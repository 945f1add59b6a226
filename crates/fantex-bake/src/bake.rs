//! The bake of a whole asset.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use fantex_base::{Error, Result, input};
use fantex_cover::{Cover, GroupTriangles};
use fantex_mesh::{Mesh, creaseless_normals, shading_normals};
use fantex_store::{AssetWriter, CreateOptions, Quality};
use rayon::prelude::*;

use crate::Source;
use crate::tile::{BakedTile, ChannelPlan, TileBaker};

/// Bytes that one texel of a batch takes in encoded form, per channel: an uncompressed byte format with its levels.
const ENCODED_BYTES_PER_TEXEL: u64 = 6;
const ENCODED_BYTES_PER_FLOAT_TEXEL: u64 = 22;

/// Bytes that one texel takes while its tile is made, per channel: its value, the fitted one, and both as they are encoded.
const WORKING_BYTES_PER_TEXEL: u64 = 40;

/// A batch is large enough to keep all threads busy and small enough for progress to move.
const BATCH_TEXELS: std::ops::RangeInclusive<u64> = 1 << 16..=8 << 20;

/// Bakes `source` into the tiles of `cover` and writes the asset `path`.
///
/// Where the source [crosses creases](Source::crosses_creases), the asset's mesh has normals without creases.
///
/// Memory besides mesh, cover and source is bounded by `options.memory_bytes`, whatever the number of texels. The asset's
/// bytes do not depend on the number of threads.
///
/// # Errors
/// The file exists already (unless forced), cannot be written, or the bake was cancelled; in all cases nothing is left behind.
pub fn bake(
    mesh: &Mesh,
    cover: &Cover,
    source: &dyn Source,
    path: &Path,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<BakeSummary> {
    if cover.corner_groups.len() != mesh.triangles.len() {
        return Err(Error::invalid(format!(
            "the cover has {} triangles, the mesh {}: build the cover of this mesh first",
            cover.corner_groups.len(),
            mesh.triangles.len()
        )));
    }
    let smoothed = source.crosses_creases().then(|| without_creases(mesh)).flatten();
    let mesh = smoothed.as_ref().unwrap_or(mesh);
    let source_channels = source.channels();
    let plans: Vec<ChannelPlan> =
        source_channels.iter().map(|c| ChannelPlan::new(c, options.format)).collect();
    if plans.is_empty() {
        return Err(Error::invalid("the source has no channel to bake"));
    }
    let channels: Vec<_> = plans.iter().map(|p| p.channel.clone()).collect();
    let create = CreateOptions { force: options.force, ..CreateOptions::default() };
    let mut writer = AssetWriter::create(path, &create, mesh, cover, &channels)?;

    let triangles = GroupTriangles::of(cover);
    let normals = shading_normals(mesh);
    let meter = Meter::new(progress, cover.texels());
    let limits = BatchLimits::new(options, plans.len());
    let in_work = limits.in_work;
    let baker =
        TileBaker { mesh, cover, source, normals: &normals, plans: &plans, options, in_work, meter: &meter };
    let mut summary = BakeSummary {
        texels: cover.stored_texels(mesh),
        channels: channels.iter().map(|c| format!("{:?}", c.kind)).collect(),
        ..BakeSummary::default()
    };
    let mut means = Vec::with_capacity(cover.groups.len() * plans.len());
    let (mut bake_time, mut encode_time, mut write_time) = (Duration::ZERO, Duration::ZERO, Duration::ZERO);
    for batch in batches(cover, limits.texels) {
        let tiles = batch
            .into_par_iter()
            .map(|group| match meter.is_cancelled() {
                true => Err(cancelled()),
                false => baker.bake(group, triangles.of_group(group)),
            })
            .collect::<Result<Vec<BakedTile>>>()?;
        let started = Instant::now();
        for tile in tiles {
            bake_time += tile.bake_time;
            encode_time += tile.encode_time;
            means.extend(tile.means);
            writer.write_pages(tile.pages)?;
        }
        write_time += started.elapsed();
    }
    let started = Instant::now();
    let written = writer.finish(&means)?;
    write_time += started.elapsed();
    summary.bytes = written.bytes;
    summary.texel_bytes = written.cluster_bytes;
    summary.bake_seconds = bake_time.as_secs_f64();
    summary.encode_seconds = encode_time.as_secs_f64();
    summary.write_seconds = write_time.as_secs_f64();
    Ok(summary)
}

/// The mesh with normals that are continuous; `None` if its own are.
fn without_creases(mesh: &Mesh) -> Option<Mesh> {
    let mut smoothed = mesh.clone();
    smoothed.corners.normals = creaseless_normals(mesh)?;
    Some(smoothed)
}

pub(crate) fn cancelled() -> Error {
    Error::cancelled("the bake was cancelled; nothing was written")
}

/// What the memory allows at once, in texels.
struct BatchLimits {
    /// Of a batch: a quarter of the memory holds those that wait, encoded, for the writer.
    texels: u64,
    /// In work. (A thread that waits for a part of its tile begins another tile, so that all of a batch may be.)
    in_work: u64,
}

impl BatchLimits {
    fn new(options: &BakeOptions, channels: usize) -> Self {
        let per_texel = match options.format {
            BakeFormat::Float => ENCODED_BYTES_PER_FLOAT_TEXEL,
            _ => ENCODED_BYTES_PER_TEXEL,
        };
        let quarter = input::share_of_cache(options.memory_bytes) / 4 / channels as u64;
        let in_work = 3 * quarter / WORKING_BYTES_PER_TEXEL;
        let texels = (quarter / per_texel).min(in_work);
        Self { texels: texels.clamp(*BATCH_TEXELS.start(), *BATCH_TEXELS.end()), in_work }
    }
}

/// Runs of groups with at most `texels` texels each, or single groups.
fn batches(cover: &Cover, texels: u64) -> Vec<std::ops::Range<u32>> {
    let mut batches = Vec::new();
    let (mut start, mut sum) = (0, 0);
    for (group, shape) in (0u32..).zip(&cover.groups) {
        let own = u64::from(shape.extent[0]) * u64::from(shape.extent[1]);
        if start < group && sum + own > texels {
            batches.push(start..group);
            (start, sum) = (group, 0);
        }
        sum += own;
    }
    let end = cover.groups.len() as u32;
    if start < end {
        batches.push(start..end);
    }
    batches
}

// Options and outcome of a bake.

/// How texel values are found from the source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fit {
    /// Fitted to the bilinear reconstruction (local least squares), with overshoot bounded.
    #[default]
    Sharp,
    /// The source's value at the texel's centre.
    Point,
    /// The mean over the texel.
    Box,
}

/// Block format of the texels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BakeFormat {
    /// BC7 for colours, BC5 for normals.
    #[default]
    Bc7,
    /// BC1 for colours, BC5 for normals.
    Bc1,
    /// 8 bits per channel, uncompressed.
    Rgba8,
    /// 32-bit floats.
    Float,
}

/// Options of [`bake`](crate::bake).
#[derive(Clone, Debug)]
pub struct BakeOptions {
    /// How texel values are found.
    pub fit: Fit,
    /// Block format.
    pub format: BakeFormat,
    /// Effort of the block encoder.
    pub quality: Quality,
    /// Overwrite an existing asset.
    pub force: bool,
    /// Bytes that texels in flight may take, whatever the texture's size.
    pub memory_bytes: u64,
}

impl Default for BakeOptions {
    /// Sharp BC7, fast encoder, 512 MiB, no overwriting.
    fn default() -> Self {
        Self {
            fit: Fit::default(),
            format: BakeFormat::default(),
            quality: Quality::default(),
            force: false,
            memory_bytes: 512 << 20,
        }
    }
}

/// What was baked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BakeSummary {
    /// Texels at level 0, per channel.
    pub texels: u64,
    /// Bytes of the asset.
    pub bytes: u64,
    /// Of that, texels of all levels and channels, packed.
    pub texel_bytes: u64,
    /// Names of the channels.
    pub channels: Vec<String>,
    /// Seconds of all threads together spent evaluating the source.
    pub bake_seconds: f64,
    /// Seconds of all threads together spent encoding blocks.
    pub encode_seconds: f64,
    /// Seconds spent packing and writing.
    pub write_seconds: f64,
}

// Progress of a long operation, and the wish to end it.

/// Receives progress. Called from several threads.
pub trait Progress: Sync {
    /// `done` of `total` texels are finished.
    fn report(&self, done: u64, total: u64);

    /// True once the user wants to stop; the operation then ends soon and leaves nothing behind.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Neither shows nor stops anything.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn report(&self, _done: u64, _total: u64) {}
}

pub(crate) struct Meter<'a> {
    progress: &'a dyn Progress,
    done: AtomicU64,
    total: u64,
}

impl<'a> Meter<'a> {
    pub(crate) fn new(progress: &'a dyn Progress, total: u64) -> Self {
        Self { progress, done: AtomicU64::new(0), total }
    }

    pub(crate) fn add(&self, texels: u64) {
        let done = self.done.fetch_add(texels, Ordering::Relaxed) + texels;
        self.progress.report(done, self.total);
    }

    pub(crate) fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}

#[cfg(test)]
mod tests {
    use fantex_cover::{CoverOptions, TexelBudget, build_cover};
    use fantex_mesh::{CleanOptions, clean, generate};

    use crate::BakeFormat;

    use super::*;

    fn cover() -> Cover {
        let (mesh, _) = clean(generate::icosphere(4), &CleanOptions::default()).unwrap();
        let budget = TexelBudget::Total(4 << 20);
        build_cover(&mesh, &CoverOptions { budget, tile: 64, ..CoverOptions::default() }).unwrap().0
    }

    #[test]
    fn batches_follow_the_memory_and_hold_every_group_once() {
        let cover = cover();
        for memory_bytes in [0, 1 << 20, 16 << 20, 1 << 40] {
            for (format, channels) in [(BakeFormat::Bc7, 1), (BakeFormat::Bc7, 4), (BakeFormat::Float, 2)] {
                let options = BakeOptions { memory_bytes, format, ..BakeOptions::default() };
                let BatchLimits { texels, in_work } = BatchLimits::new(&options, channels);
                let smallest = *BATCH_TEXELS.start();
                // Those that wait, and those in work, with 40 bytes each.
                let per_texel = if format == BakeFormat::Float { 22 } else { 6 };
                let bytes = [texels * per_texel, texels.max(in_work) * 40].map(|n| n * channels as u64);
                let fits = bytes[0] <= memory_bytes / 4 && bytes[1] <= memory_bytes / 4 * 3;
                assert!(texels == smallest || fits, "{bytes:?} for {memory_bytes}");
                let batches = batches(&cover, texels);
                assert_eq!(batches.first().map(|b| b.start), Some(0));
                assert_eq!(batches.last().map(|b| b.end), Some(cover.groups.len() as u32));
                assert!(batches.windows(2).all(|pair| pair[0].end == pair[1].start));
                for batch in batches {
                    let groups = &cover.groups[batch.start as usize..batch.end as usize];
                    let sum: u64 =
                        groups.iter().map(|g| u64::from(g.extent[0]) * u64::from(g.extent[1])).sum();
                    assert!(groups.len() == 1 || sum <= texels, "{sum} of {texels}");
                }
            }
        }
        assert!(batches(&cover, 1 << 16).len() > 20);
        assert_eq!(batches(&cover, 1 << 30).len(), 1);
    }
}
