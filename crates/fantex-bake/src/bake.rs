//! The bake of a whole asset, or of a part of a planned one.

use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use fantex_base::{Error, Result, counted, input};
use fantex_cover::{Cover, Group, GroupTriangles};
use fantex_mesh::{Mesh, creaseless_normals, shading_normals};
use fantex_store::{
    AssetWriter, Channel, CreateOptions, Damage, EncodedPage, PartWriter, Plan, Quality, Recipe, WriteSummary,
};
use rayon::prelude::*;

use crate::light::BYTES_PER_TEXEL;
use crate::samples::TexelMeans;
use crate::tile::{BakedTile, ChannelPlan, TileBaker};
use crate::{LightMapNoise, LightMapSource, Prefilter, Source};

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
/// Memory besides mesh, cover and source is bounded by `options.memory_bytes`, whatever the number of texels, but for the encoded pages
/// of a tile that is larger than a batch. The asset's bytes do not depend on the number of threads.
///
/// # Errors
/// The file exists already (unless forced), cannot be written, the source has met damaged texels (if strict), or the bake was cancelled; in
/// all cases nothing is left behind.
pub fn bake(
    mesh: &Mesh,
    cover: &Cover,
    source: &dyn Source,
    path: &Path,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<BakeSummary> {
    let job = Job::new(mesh, cover, source, options)?;
    let create = CreateOptions { force: options.force, ..CreateOptions::default() };
    let mut writer = AssetWriter::create(path, &create, &job.mesh, cover, &job.channels())?;
    let mut baked =
        job.bake(0..cover.groups.len() as u32, progress, &mut |pages| writer.write_pages(pages))?;
    job.check_damage()?;
    let started = Instant::now();
    let written = writer.finish(&baked.means)?;
    baked.write_time += started.elapsed();
    Ok(job.summary(&baked, &written))
}

/// Writes the plan of a bake: all that [`bake`] would write but texels. `recipe` is what decides these, and `about` for whoever bakes its parts.
///
/// # Errors
/// The file exists already (unless forced), or cannot be written.
pub fn plan_bake(
    mesh: &Mesh,
    cover: &Cover,
    source: &dyn Source,
    path: &Path,
    options: &BakeOptions,
    recipe: &Recipe,
    about: &[u8],
) -> Result<BakeSummary> {
    let job = Job::new(mesh, cover, source, options)?;
    let bytes = Plan::write(path, options.force, &job.mesh, cover, &job.channels(), recipe, about)?;
    let written = WriteSummary { bytes, ..WriteSummary::default() };
    Ok(job.summary(&Texels::default(), &written))
}

/// Bakes shard `shard[0]` of `shard[1]` of a plan, whose recipe the caller has [checked](Plan::check_recipe), into a part. [Merged](fantex_store::merge_parts),
/// the parts are what [`bake`] writes in one go, byte for byte.
///
/// # Errors
/// As [`bake`]; mesh, source or options are not those that were planned; there is no such shard.
pub fn bake_part(
    mesh: &Mesh,
    planned: &Plan,
    shard: [u32; 2],
    source: &dyn Source,
    path: &Path,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<BakeSummary> {
    let not_planned = || {
        Error::invalid(format!(
            "the model or its channels are not those that {} was made for; plan anew",
            planned.path.display()
        ))
    };
    if planned.cover.corner_groups.len() != mesh.triangles.len() {
        return Err(not_planned());
    }
    let job = Job::new(mesh, &planned.cover, source, options)?;
    if !planned.is_of(&job.mesh, &job.channels()) {
        return Err(not_planned());
    }
    let create = CreateOptions { force: options.force, ..CreateOptions::default() };
    let mut writer = PartWriter::create(path, &create, planned, shard[0], shard[1])?;
    let baked = job.bake(writer.groups(), progress, &mut |pages| writer.write_pages(pages))?;
    job.check_damage()?;
    let written = writer.finish(&baked.means)?;
    Ok(job.summary(&baked, &written))
}

/// What is baked, and how.
struct Job<'a> {
    mesh: Cow<'a, Mesh>,
    cover: &'a Cover,
    source: &'a dyn Source,
    plans: Vec<ChannelPlan>,
    options: &'a BakeOptions,
}

/// What was made of a run of groups, besides pages.
#[derive(Default)]
struct Texels {
    /// Per group and channel.
    means: Vec<[f32; 4]>,
    /// Of all threads together.
    bake_time: Duration,
    /// Of all threads together.
    encode_time: Duration,
    write_time: Duration,
}

impl<'a> Job<'a> {
    fn new(
        mesh: &'a Mesh,
        cover: &'a Cover,
        source: &'a dyn Source,
        options: &'a BakeOptions,
    ) -> Result<Self> {
        if cover.corner_groups.len() != mesh.triangles.len() {
            return Err(Error::invalid(format!(
                "the cover has {}, the mesh {}: build the cover of this mesh first",
                counted(cover.corner_groups.len(), "triangle"),
                mesh.triangles.len()
            )));
        }
        let mesh = mesh_under(mesh, source);
        let plans: Vec<_> = source.channels().iter().map(|c| ChannelPlan::new(c, options.format)).collect();
        if plans.is_empty() {
            return Err(Error::invalid("the source has no channel to bake"));
        }
        Ok(Self { mesh, cover, source, plans, options })
    }

    fn channels(&self) -> Vec<Channel> {
        self.plans.iter().map(|plan| plan.channel.clone()).collect()
    }

    /// Bakes groups, and hands their pages on in order.
    fn bake(
        &self,
        groups: Range<u32>,
        progress: &dyn Progress,
        write: &mut dyn FnMut(Vec<EncodedPage>) -> Result<()>,
    ) -> Result<Texels> {
        let Self { mesh, cover, source, plans, options } = self;
        let triangles = GroupTriangles::of(cover);
        let normals = shading_normals(mesh);
        // Of large meshes these leave little for texels.
        let by_triangle =
            size_of_val(mesh.triangles.as_slice()) + size_of_val(cover.corner_groups.as_slice());
        let _held = input::hold((by_triangle + size_of_val(normals.as_slice())) as u64);
        let own = &cover.groups[groups.start as usize..groups.end as usize];
        let meter = Meter::new(progress, own.iter().map(Group::texels).sum());
        let means = TexelMeans::of(*source);
        let gives_points = source.prefilter() == Prefilter::Point && source.light_map().is_none();
        let source: &dyn Source = if options.fit == Fit::Box && gives_points { &means } else { *source };
        let is_noisy = source.light_map().is_some_and(LightMapSource::denoises);
        let extra = if is_noisy { BYTES_PER_TEXEL } else { 0 };
        let limits = BatchLimits::new(options, plans.len(), extra);
        let in_work = limits.in_work;
        let baker =
            TileBaker { mesh, cover, source, normals: &normals, plans, options, in_work, meter: &meter };
        let mut baked = Texels { means: Vec::with_capacity(own.len() * plans.len()), ..Texels::default() };
        for batch in batches(cover, groups, limits.texels) {
            let tiles = batch
                .into_par_iter()
                .map(|group| {
                    meter.check()?;
                    baker.bake(group, triangles.of_group(group))
                })
                .collect::<Result<Vec<BakedTile>>>()?;
            let started = Instant::now();
            for tile in tiles {
                baked.bake_time += tile.bake_time;
                baked.encode_time += tile.encode_time;
                baked.means.extend(tile.means);
                write(tile.pages)?;
            }
            baked.write_time += started.elapsed();
        }
        Ok(baked)
    }

    /// Refuses what coarser texels stood in for, where that is asked for.
    fn check_damage(&self) -> Result<()> {
        let Damage { pages, first } = self.source.damage();
        match first.first() {
            Some((_, page, reason)) if self.options.strict => Err(Error::damaged(format!(
                "coarser texels stand in for {}; the first: {page}: {reason}",
                counted(pages, "damaged tile")
            ))),
            _ => Ok(()),
        }
    }

    fn summary(&self, baked: &Texels, written: &WriteSummary) -> BakeSummary {
        BakeSummary {
            texels: self.cover.stored_texels(&self.mesh),
            bytes: written.bytes,
            texel_bytes: written.cluster_bytes,
            channels: self.plans.iter().map(|plan| format!("{:?}", plan.channel.kind)).collect(),
            bake_seconds: baked.bake_time.as_secs_f64(),
            encode_seconds: baked.encode_time.as_secs_f64(),
            write_seconds: baked.write_time.as_secs_f64(),
            light: self.source.light_map().map(LightMapSource::noise),
            damage: self.source.damage(),
        }
    }
}

/// The mesh that shows what a source gives: with normals without creases where the source [crosses](Source::crosses_creases) those of the mesh.
pub fn mesh_under<'m>(mesh: &'m Mesh, source: &dyn Source) -> Cow<'m, Mesh> {
    let Some(normals) = source.crosses_creases().then(|| creaseless_normals(mesh)).flatten() else {
        return Cow::Borrowed(mesh);
    };
    let mut smoothed = mesh.clone();
    smoothed.corners.normals = normals;
    Cow::Owned(smoothed)
}

/// What the memory allows at once, in texels.
struct BatchLimits {
    /// Of a batch: a quarter of the memory holds those that wait, encoded, for the writer.
    texels: u64,
    /// In work. (A thread that waits for a part of its tile begins another tile, so that all of a batch may be.)
    in_work: u64,
}

impl BatchLimits {
    /// `extra`: bytes of a texel in work besides those of its channels.
    fn new(options: &BakeOptions, channels: usize, extra: u64) -> Self {
        let per_texel = match options.format {
            BakeFormat::Float => ENCODED_BYTES_PER_FLOAT_TEXEL,
            _ => ENCODED_BYTES_PER_TEXEL,
        };
        let quarter = input::share_of_cache(options.memory_bytes) / 4;
        let in_work = 3 * quarter / (WORKING_BYTES_PER_TEXEL * channels as u64 + extra);
        let texels = (quarter / channels as u64 / per_texel).min(in_work);
        Self { texels: texels.clamp(*BATCH_TEXELS.start(), *BATCH_TEXELS.end()), in_work }
    }
}

/// Runs of groups with at most `texels` texels each, or single groups.
fn batches(cover: &Cover, groups: Range<u32>, texels: u64) -> Vec<Range<u32>> {
    let mut batches = Vec::new();
    let (mut start, mut sum) = (groups.start, 0);
    for group in groups.clone() {
        let own = cover.groups[group as usize].texels();
        if start < group && sum + own > texels {
            batches.push(start..group);
            (start, sum) = (group, 0);
        }
        sum += own;
    }
    if start < groups.end {
        batches.push(start..groups.end);
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
    /// The source's value at the texel's centre, however fine its detail is: what is finer than a texel aliases. Baked
    /// light is the mean over the texel in any case.
    Point,
    /// The mean over the texel; that of 4 x 4 points of it where the source gives values at points.
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
    /// Fail, and write nothing, where the source is an asset and coarser texels stand in for damaged ones.
    pub strict: bool,
    /// Bytes that texels in flight may take, whatever the texture's size; the encoded pages of one tile may take more.
    pub memory_bytes: u64,
}

impl Default for BakeOptions {
    /// Sharp BC7, fast encoder, 512 MiB, no overwriting, damage allowed.
    fn default() -> Self {
        Self {
            fit: Fit::default(),
            format: BakeFormat::default(),
            quality: Quality::default(),
            force: false,
            strict: false,
            memory_bytes: 512 << 20,
        }
    }
}

/// What was baked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BakeSummary {
    /// Texels at level 0, per channel; of the whole asset also where a part of it was baked.
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
    /// The noise of baked light; of a part of the asset where that was baked.
    pub light: Option<LightMapNoise>,
    /// Texels of assets that the source could not read, so that coarser ones stood in.
    pub damage: Damage,
}

// Progress of a long operation, and the wish to end it.

/// Receives progress. Called from several threads.
pub trait Progress: Sync {
    /// `done` of `total` texels are finished. Reports of one step may come out of order; none of its texels, and another total, begin
    /// another step.
    fn report(&self, done: u64, total: u64);

    /// So much of what comes before texels is done, 0 to 1; `word` says what that is, such as "covering". A step of its own, of which the share
    /// never falls; it is [reported](Self::report) in thousandths unless it is shown otherwise.
    fn prepare(&self, word: &'static str, share: f32) {
        let _ = word;
        self.report((1000.0 * share) as u64, 1000);
    }

    /// A sentence that is worth knowing before long work begins. The outcome of the work may hold it as well.
    fn note(&self, sentence: &str) {
        let _ = sentence;
    }

    /// True once the user wants to stop; the operation then ends soon and leaves nothing behind. Asked often, and meant to answer at once.
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
        progress.report(0, total);
        Self { progress, done: AtomicU64::new(0), total }
    }

    pub(crate) fn add(&self, texels: u64) {
        let done = self.done.fetch_add(texels, Ordering::Relaxed) + texels;
        self.progress.report(done, self.total);
    }

    /// An error once the user wants to stop. Cheap enough for every few milliseconds of work.
    pub(crate) fn check(&self) -> Result<()> {
        match self.progress.is_cancelled() {
            true => Err(Error::cancelled("the bake was cancelled; nothing was written")),
            false => Ok(()),
        }
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
                let BatchLimits { texels, in_work } = BatchLimits::new(&options, channels, 0);
                let smallest = *BATCH_TEXELS.start();
                // Those that wait, and those in work, with 40 bytes each.
                let per_texel = if format == BakeFormat::Float { 22 } else { 6 };
                let bytes = [texels * per_texel, texels.max(in_work) * 40].map(|n| n * channels as u64);
                let fits = bytes[0] <= memory_bytes / 4 && bytes[1] <= memory_bytes / 4 * 3;
                assert!(texels == smallest || fits, "{bytes:?} for {memory_bytes}");
                let batches = batches(&cover, 0..cover.groups.len() as u32, texels);
                assert_eq!(batches.first().map(|b| b.start), Some(0));
                assert_eq!(batches.last().map(|b| b.end), Some(cover.groups.len() as u32));
                assert!(batches.windows(2).all(|pair| pair[0].end == pair[1].start));
                for batch in batches {
                    let groups = &cover.groups[batch.start as usize..batch.end as usize];
                    let sum: u64 = groups.iter().map(Group::texels).sum();
                    assert!(groups.len() == 1 || sum <= texels, "{sum} of {texels}");
                }
            }
        }
        assert!(batches(&cover, 0..cover.groups.len() as u32, 1 << 16).len() > 20);
        assert_eq!(batches(&cover, 0..cover.groups.len() as u32, 1 << 30).len(), 1);
    }
}
