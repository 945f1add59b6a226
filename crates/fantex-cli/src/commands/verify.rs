//! `fantex verify`: structure, checksums and the continuity certificate of an asset, and whether its texels agree.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use fantex::store::{self, JUMP_BOUND, TexelReport, VerifyOptions};
use fantex::{Error, ErrorKind, FileKind, Result, not_verified};
use serde::Serialize;

use super::world::verify_and_print;
use crate::context::Context;
use crate::scene::open_asset;
use crate::text::Table;
use crate::text::{grouped, megabytes};

/// Check an asset, or all assets of a world: structure, checksums, and that the texture is continuous across every edge.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex verify bottle.fan
  fantex verify bottle.fan --json
  fantex verify bottle.fan --texels
  fantex verify land/land.fanworld

Checked are both headers, every stored cluster and attachment against its checksum, the mesh, and the texture function on both sides of every \
edge, in all channels, at every level and at mixed levels. Hard edges that a bake was asked to cut (--hard-edges) are counted, and the jump there is measured, but has no bound. Edges say nothing of what texels show. With --texels, all that look-ups read at coarser \
levels are compared with the finer ones that they are made of; docs/format.md says what that finds and what it cannot. Of a world, every asset and preview is checked, that the index is true, and that sectors of one asset agree \
where they meet.")]
pub(crate) struct VerifyArgs {
    /// An asset (.fan) or a world (.fanworld), also at an https://, s3://, gs:// or az:// address
    asset: PathBuf,

    /// Compare detail levels, too: all texels that look-ups read, with the finer ones that they are made of
    #[arg(long)]
    texels: bool,
}

#[derive(Debug, Serialize)]
struct ContinuityInfo {
    largest_jump: f32,
    bound: f32,
    edges: u64,
    levels: u32,
    samples: u64,
    exempt_edges: u64,
    /// Of these, those that were asked to be cut.
    hard_edges: u64,
    /// Across these, which no bound is for.
    largest_hard_jump: f32,
    needless_splits: u64,
}

#[derive(Debug, Serialize)]
struct TexelInfo {
    compared: u64,
    contradictions: u64,
    empty_blocks: u64,
    left_out: u64,
    /// The first few, a sentence each.
    faults: Vec<String>,
}

impl TexelInfo {
    fn of(report: &TexelReport) -> Self {
        Self {
            compared: report.compared,
            contradictions: report.contradictions,
            empty_blocks: report.empty_blocks,
            left_out: report.left_out,
            faults: report.first.clone(),
        }
    }
}

#[derive(Debug, Serialize)]
struct VerifyInfo {
    ok: bool,
    damaged_tiles: u64,
    damaged_headers: u32,
    damaged_attachments: u64,
    damage: Vec<String>,
    mesh_faults: Vec<String>,
    continuity: ContinuityInfo,
    /// With `--texels`, where everything could be read.
    #[serde(skip_serializing_if = "Option::is_none")]
    texels: Option<TexelInfo>,
    levels: u32,
    bytes: u64,
    seconds: f64,
}

pub(crate) fn run(args: &VerifyArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    if FileKind::of(&args.asset)? == FileKind::World {
        return verify_and_print(&args.asset, args.texels, context);
    }
    // Opening says what is wrong with files of other kinds.
    let asset = open_asset(&args.asset).or_else(|error| unreadable(error, context))?;
    let options = VerifyOptions { memory_bytes: context.memory_bytes as usize, texels: args.texels };
    let report = store::verify_asset(&asset, &options);
    let continuity = &report.continuity;
    let info = VerifyInfo {
        ok: report.ok,
        damaged_tiles: report.damaged_tiles,
        damaged_headers: report.damaged_headers,
        damaged_attachments: report.damaged_attachments,
        damage: report.first_damage.clone(),
        mesh_faults: report.mesh_faults.iter().map(ToString::to_string).collect(),
        continuity: ContinuityInfo {
            largest_jump: continuity.largest_jump,
            bound: JUMP_BOUND,
            edges: continuity.edges,
            levels: continuity.levels,
            samples: continuity.samples,
            exempt_edges: continuity.exempt_edges,
            hard_edges: continuity.exempt.hard,
            largest_hard_jump: continuity.largest_hard_jump,
            needless_splits: continuity.needless_splits,
        },
        texels: report.texels.as_ref().map(TexelInfo::of),
        levels: report.levels,
        bytes: report.bytes,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| text(info, &args.asset))?;
    if report.ok { Ok(()) } else { Err(not_verified(&args.asset, &report)) }
}

/// What can be said of an asset that is too damaged to be opened.
#[derive(Debug, Serialize)]
struct UnreadableInfo {
    ok: bool,
    /// Nobody knows.
    damaged_tiles: Option<u64>,
    damage: Vec<String>,
}

/// Says so to programs, too.
fn unreadable<T>(error: Error, context: &Context) -> Result<T> {
    if error.kind() == ErrorKind::Damaged && context.is_json() {
        let info = UnreadableInfo { ok: false, damaged_tiles: None, damage: vec![error.to_string()] };
        context.print(&info, |_| String::new())?;
    }
    Err(error)
}

fn text(info: &VerifyInfo, path: &Path) -> String {
    let continuity = &info.continuity;
    let mut table = Table::default();
    table
        .row("asset", format!("{}, {}", path.display(), megabytes(info.bytes)))
        .row("damaged tiles", grouped(info.damaged_tiles))
        .row("largest jump", format!("{:.2e} (bound {:.0e})", continuity.largest_jump, continuity.bound))
        .row("edges compared", grouped(continuity.edges))
        .row("edges left out", grouped(continuity.exempt_edges));
    if continuity.hard_edges > 0 {
        table
            .row("  hard edges, as asked", grouped(continuity.hard_edges))
            .row("  largest jump there", format!("{:.2e} (no bound)", continuity.largest_hard_jump));
    }
    table
        .row("levels compared", continuity.levels.to_string())
        .row("values compared", grouped(continuity.samples));
    if let Some(texels) = &info.texels {
        let faults = texels.contradictions + texels.empty_blocks;
        table.row("texels compared", grouped(texels.compared)).row("contradictions", grouped(faults));
        if texels.left_out > 0 {
            table.row("tiles left out", grouped(texels.left_out));
        }
    }
    table.row("result", if info.ok { "passed" } else { "NOT PASSED" });
    table.to_text()
}
