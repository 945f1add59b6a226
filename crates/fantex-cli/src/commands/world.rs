//! `fantex world`: an index of assets; and what `fantex info` and `fantex verify` say of one.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use fantex::store::{JUMP_BOUND, VerifyOptions};
use fantex::{Error, PreviewOptions, Result, World, WorldChange, WorldChanged, change_world, verify_world};
use serde::Serialize;

use crate::context::Context;
use crate::text::{ShownPath, Table, counted, grouped, megabytes};

/// Make a world, an index of assets that are shown together, or change one.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex world town.fanworld houses/*.fan ground.fan --make-previews --make-coarse
  fantex world town.fanworld houses/church.fan
  fantex world town.fanworld --remove houses/barn.fan
  fantex info town.fanworld

Assets stay where they are, below the folder of the index or at an address; an index at an address names such at addresses. One that is in the index already is read again. Viewers \
show assets near the eye whole, others by their previews. 'fantex split' makes a world of one large asset. See docs/worlds.md.")]
pub(crate) struct WorldArgs {
    /// The index (.fanworld), also at an s3://, gs:// or az:// address
    index: PathBuf,
    /// Assets to add or to read again (.fan, also at an https://, s3://, gs:// or az:// address)
    #[arg(required_unless_present_any = ["remove", "make_previews", "make_coarse"])]
    assets: Vec<PathBuf>,
    /// Take an asset out of the index; its file stays
    #[arg(long, value_name = "ASSET")]
    remove: Vec<PathBuf>,
    /// Give a preview to assets without one, which keeps their open borders; they are changed in place
    #[arg(long)]
    make_previews: bool,
    /// Make coarse assets beside the index, each of which stands from afar for up to 16 of the assets with previews; they replace those
    /// that were made so before
    #[arg(long)]
    make_coarse: bool,
}

#[derive(Debug, Serialize)]
struct WorldChangeInfo {
    index: ShownPath,
    added: u64,
    updated: u64,
    removed: u64,
    /// Coarse assets that showed what has changed or is gone; their files stay.
    coarse_removed: u64,
    previews_made: u64,
    coarse_made: u64,
    #[serde(flatten)]
    world: WorldInfo,
    seconds: f64,
}

pub(crate) fn run(args: &WorldArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    let previews = PreviewOptions {
        keeps_borders: true,
        memory_bytes: context.memory_bytes,
        strict: context.strict,
        ..PreviewOptions::default()
    };
    let change = WorldChange {
        put: &args.assets,
        remove: &args.remove,
        previews: args.make_previews.then_some(previews),
        coarse: args.make_coarse.then_some(previews),
    };
    let changed = {
        let _deferral = context.defer_interrupt();
        change_world(&args.index, &change, context)?
    };
    changed.notes.iter().for_each(|note| context.note(note));
    let WorldChanged { added, updated, removed, coarse_removed, previews_made, coarse_made, .. } = changed;
    let seconds = started.elapsed().as_secs_f64();
    let index = (&args.index).into();
    let world = WorldInfo::of(&changed.world);
    let info = WorldChangeInfo {
        index,
        added,
        updated,
        removed,
        coarse_removed,
        previews_made,
        coarse_made,
        world,
        seconds,
    };
    context.print(&info, |info| {
        let WorldChangeInfo { added, updated, removed, world, .. } = info;
        let counts = format!("{added} added, {updated} updated, {removed} removed");
        format!("{}: {}, {counts}\n", info.index.display(), counted(world.objects, "asset"))
    })
}

/// What an index says.
#[derive(Debug, Serialize)]
struct WorldInfo {
    kind: &'static str,
    objects: u64,
    triangles: u64,
    texels: u64,
    bytes: u64,
    /// Corners of the box, world units; none without assets.
    low: Option<[f64; 3]>,
    high: Option<[f64; 3]>,
    /// Assets with one.
    previews: u64,
    preview_triangles: u64,
    preview_texels: u64,
    /// The coarsest, world units.
    preview_detail: Option<f64>,
    /// Assets that stand for several of the others.
    coarse: u64,
    coarse_triangles: u64,
    coarse_texels: u64,
    coarse_bytes: u64,
    assets: Vec<String>,
}

impl WorldInfo {
    fn of(world: &World) -> Self {
        let objects = || world.objects.iter();
        let previews = || objects().filter_map(|object| object.preview);
        let coarse = || world.coarse.iter();
        let bounds = world.bounds();
        Self {
            kind: "world",
            objects: world.objects.len() as u64,
            triangles: total(objects().map(|object| object.triangles)),
            texels: total(objects().map(|object| object.texels)),
            bytes: total(objects().map(|object| object.bytes)),
            low: bounds.map(|[low, _]| low.into()),
            high: bounds.map(|[_, high]| high.into()),
            previews: previews().count() as u64,
            preview_triangles: total(previews().map(|preview| preview.triangles)),
            preview_texels: total(previews().map(|preview| preview.texels)),
            preview_detail: previews().map(|preview| preview.detail).reduce(f64::max),
            coarse: world.coarse.len() as u64,
            coarse_triangles: total(coarse().map(|coarse| coarse.triangles)),
            coarse_texels: total(coarse().map(|coarse| coarse.texels)),
            coarse_bytes: total(coarse().map(|coarse| coarse.bytes)),
            assets: objects().map(|object| object.asset.clone()).collect(),
        }
    }
}

/// A sum of numbers that an index may say anything of.
fn total(numbers: impl Iterator<Item = u64>) -> u64 {
    numbers.fold(0, u64::saturating_add)
}

/// Prints what an index says; its assets are not opened.
pub(crate) fn print_world(world: &World, path: &Path, context: &Context) -> Result<()> {
    context.print(&WorldInfo::of(world), |info| {
        let mut table = Table::default();
        table
            .row("world", path.display().to_string())
            .row("assets", grouped(info.objects))
            .row("triangles", grouped(info.triangles))
            .row("texels per channel", grouped(info.texels))
            .row("bytes", format!("{} ({})", grouped(info.bytes), megabytes(info.bytes)));
        if let (Some(low), Some(high)) = (info.low, info.high) {
            let corner = |[x, y, z]: [f64; 3]| format!("{x} {y} {z}");
            table.row("box", format!("{} to {}", corner(low), corner(high)));
        }
        table.row("previews", grouped(info.previews));
        if info.previews > 0 {
            table
                .row("  triangles", grouped(info.preview_triangles))
                .row("  texels", grouped(info.preview_texels));
        }
        table.rows("  coarsest detail", info.preview_detail.map(|detail| format!("{detail:.4}")));
        if info.coarse > 0 {
            table
                .row("coarse assets", grouped(info.coarse))
                .row("  triangles", grouped(info.coarse_triangles))
                .row("  texels", grouped(info.coarse_texels))
                .row("  bytes", format!("{} ({})", grouped(info.coarse_bytes), megabytes(info.coarse_bytes)));
        }
        table.rows("asset", &info.assets);
        table.to_text()
    })
}

#[derive(Debug, Serialize)]
struct WorldVerifyInfo {
    ok: bool,
    objects: u64,
    coarse: u64,
    /// Of both, such with a fault.
    faulty: u64,
    seam_edges: u64,
    largest_jump: f32,
    bound: f32,
    /// A sentence each.
    faults: Vec<String>,
    seconds: f64,
}

/// `fantex verify` for a world.
pub(crate) fn verify_and_print(index: &Path, texels: bool, context: &Context) -> Result<()> {
    let started = Instant::now();
    let options = VerifyOptions { memory_bytes: context.memory_bytes as usize, texels };
    let report = {
        let _deferral = context.defer_interrupt();
        verify_world(index, &options, &context.progress("verify"))?
    };
    let faults = report.faults();
    let info = WorldVerifyInfo {
        ok: report.ok,
        objects: report.objects.len() as u64,
        coarse: report.coarse.len() as u64,
        faulty: report.objects.iter().chain(&report.coarse).filter(|object| !object.ok).count() as u64,
        seam_edges: report.seam_edges,
        largest_jump: report.largest_jump,
        bound: JUMP_BOUND,
        faults,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| verify_text(info, index))?;
    match info.faults.first() {
        Some(fault) if !info.ok => {
            let (index, count) = (index.display(), counted(info.faults.len() as u64, "fault"));
            Err(Error::damaged(format!("{index} did not pass: {count}; the first: {fault}")))
        }
        _ => Ok(()),
    }
}

fn verify_text(info: &WorldVerifyInfo, index: &Path) -> String {
    let mut table = Table::default();
    table
        .row("world", index.display().to_string())
        .row("assets", grouped(info.objects))
        .row("coarse assets", grouped(info.coarse))
        .row("with a fault", grouped(info.faulty))
        .row("edges compared between them", grouped(info.seam_edges))
        .row("largest jump there", format!("{:.2e} (bound {:.0e})", info.largest_jump, info.bound))
        .row("result", if info.ok { "passed" } else { "NOT PASSED" });
    table.rows("fault", &info.faults);
    table.to_text()
}
