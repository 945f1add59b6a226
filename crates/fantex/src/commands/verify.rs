//! `fantex verify`: structure, checksums and the continuity certificate of an asset.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use fantex::store::{self, JUMP_BOUND, VerifyOptions, VerifyReport};
use serde::Serialize;

use crate::context::Context;
use crate::error::CliError;
use crate::input::open_asset;
use crate::size::{grouped, megabytes};
use crate::table::Table;

/// Check an asset: structure, checksums, and that its texture is continuous across every edge.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex verify bottle.fan
  fantex verify bottle.fan --json")]
pub(crate) struct VerifyArgs {
    /// An asset (.fan)
    asset: PathBuf,
}

#[derive(Debug, Serialize)]
struct ContinuityInfo {
    largest_jump: f32,
    bound: f32,
    edges: u64,
    levels: u32,
    samples: u64,
    exempt_edges: u64,
}

#[derive(Debug, Serialize)]
struct VerifyInfo {
    ok: bool,
    damaged_tiles: u64,
    continuity: ContinuityInfo,
    levels: u32,
    bytes: u64,
    seconds: f64,
}

/// Runs the command.
pub(crate) fn run(args: &VerifyArgs, context: &Context) -> Result<(), CliError> {
    let started = Instant::now();
    // Opening says what is wrong with files of other kinds.
    drop(open_asset(&args.asset)?);
    let report = store::verify(&args.asset, &VerifyOptions { memory_bytes: context.memory_bytes as usize })?;
    let continuity = &report.continuity;
    let info = VerifyInfo {
        ok: report.ok,
        damaged_tiles: report.damaged_tiles,
        continuity: ContinuityInfo {
            largest_jump: continuity.largest_jump,
            bound: JUMP_BOUND,
            edges: continuity.edges,
            levels: continuity.levels,
            samples: continuity.samples,
            exempt_edges: continuity.exempt_edges,
        },
        levels: report.levels,
        bytes: report.bytes,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| text(info, &args.asset))?;
    if report.ok { Ok(()) } else { Err(not_verified(&args.asset, &report)) }
}

/// The sentence that says why.
pub(crate) fn not_verified(path: &Path, report: &VerifyReport) -> CliError {
    let jump = report.continuity.largest_jump;
    let reason = match report.damaged_tiles {
        0 if jump <= JUMP_BOUND => "its structure breaks a rule of the format".to_owned(),
        0 => {
            format!("its texture jumps by {jump:.1e} across an edge, more than the bound of {JUMP_BOUND:.0e}")
        }
        1 => "1 of its tiles is damaged".to_owned(),
        tiles => format!("{tiles} of its tiles are damaged"),
    };
    CliError::NotVerified { path: path.into(), reason }
}

fn text(info: &VerifyInfo, path: &Path) -> String {
    let continuity = &info.continuity;
    let mut table = Table::default();
    table
        .row("asset", format!("{}, {}", path.display(), megabytes(info.bytes)))
        .row("damaged tiles", grouped(info.damaged_tiles))
        .row("largest jump", format!("{:.2e} (bound {:.0e})", continuity.largest_jump, continuity.bound))
        .row("edges compared", grouped(continuity.edges))
        .row("edges left out", grouped(continuity.exempt_edges))
        .row("levels compared", continuity.levels.to_string())
        .row("values compared", grouped(continuity.samples))
        .row("result", if info.ok { "passed" } else { "NOT PASSED" });
    table.to_text()
}
