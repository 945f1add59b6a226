//! `fantex world`: an index of assets; and what `fantex info` and `fantex verify` say of one.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use fantex::base::input::{self, ReadLimits, ReadOptions};
use fantex::store::{Asset, JUMP_BOUND, PREVIEW, VerifyOptions};
use fantex::stream::{ObjectTarget, Replace, url_of};
use fantex::{
    Error, Preview, PreviewOptions, Result, WORLD_EXTENSION, World, WorldObject, WorldReport, verify_world,
};
use serde::Serialize;

use super::verify::not_verified;
use crate::addresses::{self, Target, is_object};
use crate::context::Context;
use crate::scene::open_asset;
use crate::text::{Table, counted, grouped, megabytes};

/// Make a world, an index of assets that are shown together, or change one.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex world town.fanworld houses/*.fan ground.fan --make-previews
  fantex world town.fanworld houses/church.fan
  fantex world town.fanworld --remove houses/barn.fan
  fantex info town.fanworld

Assets stay where they are, below the folder of the index or at an address; an index at an address names such at addresses. One that is in the index already is read again. Viewers
show assets near the eye whole, others by their previews. 'fantex split' makes a world of one large asset. See docs/worlds.md.")]
pub(crate) struct WorldArgs {
    /// The index (.fanworld), also at an s3:// or gs:// address
    index: PathBuf,
    /// Assets to add or to read again (.fan, also at an https://, s3:// or gs:// address)
    #[arg(required_unless_present_any = ["remove", "make_previews"])]
    assets: Vec<PathBuf>,
    /// Take an asset out of the index; its file stays
    #[arg(long, value_name = "ASSET")]
    remove: Vec<PathBuf>,
    /// Give a preview to assets without one, which keeps their open borders; they are changed in place
    #[arg(long)]
    make_previews: bool,
}

#[derive(Debug, Serialize)]
struct WorldChange {
    index: PathBuf,
    added: u64,
    updated: u64,
    removed: u64,
    /// Coarse assets that showed what has changed or is gone; their files stay.
    coarse_removed: u64,
    previews_made: u64,
    #[serde(flatten)]
    world: WorldInfo,
    seconds: f64,
}

pub(crate) fn run(args: &WorldArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    check_index(&args.index)?;
    let replace = replaced(&args.index)?;
    let is_there = if is_object(&args.index) { replace != Replace::Nothing } else { args.index.exists() };
    let mut world = if is_there { open_to_change(&args.index)? } else { World::default() };
    let coarse_before = world.coarse.len();
    let mut removed = 0;
    for asset in &args.remove {
        remove(&mut world, &args.index, asset)?;
        removed += 1;
    }
    let (mut added, mut updated, mut previews_made) = (0, 0, 0);
    let known = world.objects.iter().map(|object| World::asset_place(&args.index, object));
    let others = if args.make_previews { known.collect() } else { Vec::new() };
    for (place, is_named) in
        args.assets.iter().map(|asset| (asset, true)).chain(others.iter().map(|asset| (asset, false)))
    {
        context.check_interrupt()?;
        let name = World::name_of(&args.index, place)?;
        let mut asset = open_asset(place)?;
        let is_made = args.make_previews && make_preview(place, &mut asset, context)?;
        previews_made += u64::from(is_made);
        if is_named || is_made {
            let is_update = world.put(WorldObject::of(name, &asset)?);
            *if is_update { &mut updated } else { &mut added } += 1;
        }
    }
    let coarse_removed = (coarse_before - world.coarse.len()) as u64;
    if coarse_removed > 0 {
        context.note(format!(
            "{} showed what has changed and went from the index, so views from afar take more memory; 'fantex split' of the whole asset makes \
             them anew",
            counted(coarse_removed, "coarse asset")
        ));
    }
    {
        let _deferral = context.defer_interrupt();
        let target = Target::new(&args.index)?;
        world.write(target.file())?;
        target.finish(&replace, context)?;
    }
    let seconds = started.elapsed().as_secs_f64();
    let index = args.index.clone();
    let info = WorldInfo::of(&world);
    let change =
        WorldChange { index, added, updated, removed, coarse_removed, previews_made, world: info, seconds };
    context.print(&change, |change| {
        let WorldChange { added, updated, removed, world, .. } = change;
        let counts = format!("{added} added, {updated} updated, {removed} removed");
        format!("{}: {}, {counts}\n", change.index.display(), counted(world.objects, "asset"))
    })
}

/// Opens the index without marking it as an input, which nothing may overwrite.
fn open_to_change(index: &Path) -> Result<World> {
    let options = ReadOptions { protect_inputs: false, ..*ReadLimits::current().options() };
    ReadLimits::new(options).run(|| World::open(index))
}

/// Which version of an index in a store a changed one replaces. It is known before the index is read, so that no change of somebody else is lost.
fn replaced(index: &Path) -> Result<Replace> {
    if !is_object(index) {
        return Ok(Replace::Anything);
    }
    let object = ObjectTarget::at(index)?;
    object.check(true)?;
    Ok(object.version()?.map_or(Replace::Nothing, Replace::Version))
}

fn check_index(index: &Path) -> Result<()> {
    if let Some(url) = url_of(index).filter(|_| !is_object(index)) {
        return Err(Error::unsupported(format!("{url} can only be read: change a copy of the index")));
    }
    if !World::is_named(index) {
        let index = index.display();
        return Err(Error::invalid(format!(
            "{index} is no name for a world: end it with .{WORLD_EXTENSION}"
        )));
    }
    input::check_output(index)
}

/// Takes an asset out, by its name in the index or by its path.
fn remove(world: &mut World, index: &Path, asset: &Path) -> Result<()> {
    let name = World::name_of(index, asset).ok();
    let is_it =
        |object: &WorldObject| Path::new(&object.asset) == asset || Some(&object.asset) == name.as_ref();
    if world.remove(is_it) == 0 {
        let (index, asset) = (index.display(), asset.display());
        return Err(Error::not_found(format!("{index} has no asset {asset} that could be removed")));
    }
    Ok(())
}

/// Gives an asset a preview where it has none; the asset is opened again.
fn make_preview(place: &Path, asset: &mut Arc<Asset>, context: &Context) -> Result<bool> {
    if asset.attachment_bytes(PREVIEW)?.is_some() {
        return Ok(false);
    }
    if url_of(place).is_some() && !is_object(place) {
        context.note(format!("{} has no preview and gets none: it can only be read", place.display()));
        return Ok(false);
    }
    let options = PreviewOptions {
        keeps_borders: true,
        memory_bytes: context.memory_bytes,
        ..PreviewOptions::default()
    };
    addresses::change(place, context, |file| Preview::add_to(file, &options))?;
    *asset = open_asset(place)?;
    Ok(true)
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
            triangles: objects().map(|object| object.triangles).sum(),
            texels: objects().map(|object| object.texels).sum(),
            bytes: objects().map(|object| object.bytes).sum(),
            low: bounds.map(|[low, _]| low.into()),
            high: bounds.map(|[_, high]| high.into()),
            previews: previews().count() as u64,
            preview_triangles: previews().map(|preview| preview.triangles).sum(),
            preview_texels: previews().map(|preview| preview.texels).sum(),
            preview_detail: previews().map(|preview| preview.detail).reduce(f64::max),
            coarse: world.coarse.len() as u64,
            coarse_triangles: coarse().map(|coarse| coarse.triangles).sum(),
            coarse_texels: coarse().map(|coarse| coarse.texels).sum(),
            coarse_bytes: coarse().map(|coarse| coarse.bytes).sum(),
            assets: objects().map(|object| object.asset.clone()).collect(),
        }
    }
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
        table
            .row("previews", grouped(info.previews))
            .row("  triangles", grouped(info.preview_triangles))
            .row("  texels", grouped(info.preview_texels));
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
    let faults = faults(&report);
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

/// All faults, a sentence each.
fn faults(report: &WorldReport) -> Vec<String> {
    let mut faults = Vec::new();
    for object in report.objects.iter().chain(&report.coarse) {
        if let Some(found) = object.asset.as_ref().filter(|found| !found.ok) {
            faults.push(not_verified(&object.place, found).to_string());
        }
        faults.extend(object.faults.iter().map(|fault| format!("{}: {fault}", object.place.display())));
    }
    if report.largest_jump > JUMP_BOUND
        && let Some(seam) = report.worst_seam
    {
        let [a, b] = seam.map(|number| report.objects[number].place.display());
        let jump = report.largest_jump;
        faults.push(format!(
            "the texture jumps by {jump:.1e} between {a} and {b}, more than the bound of {JUMP_BOUND:.0e}"
        ));
    }
    faults
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
