//! `fantex split`: a large asset as a world of small ones.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use fantex::addresses::is_address;
use fantex::store::Asset;
use fantex::{Result, SectorPreviews, Split, SplitOptions, StoreFolder, World, split};
use serde::Serialize;

use crate::context::{Context, check_can_be_folder};
use crate::scene::open_asset;
use crate::text::{Count, ShownPath, counted, megabytes};

/// Split a large asset into a world: many small assets that viewers show near the eye, and an index.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex split land.fan -o land
  fantex split land.fan -o land --triangles 1M --preview-triangles 5k
  fantex info land/land.fanworld
  fantex verify land/land.fanworld

The folder gets the sectors, sector-0001.fan and so on, and when all are there the index, named after the asset. Sectors show what the \
whole shows, to the last bit: tiles are copied, those at borders into each sector that needs them. Their previews, by which they are \
shown far away, keep their borders, so that nothing shows through between them. More than 16 sectors also get coarse assets, \
coarse-0001.fan and so on, each of which is shown from still farther away in the place of up to 16. Surfaces that can hardly be \
simplified get neither. With --force, a world that is there is replaced at once, and stays where the split fails; the new files are \
sector-0001-2.fan and so on then. See docs/worlds.md.")]
pub(crate) struct SplitArgs {
    /// The asset (.fan, also at an https://, s3://, gs:// or az:// address), which stays as it is
    asset: PathBuf,
    /// The folder to write into; it is made where there is none. Also at an s3://, gs:// or az:// address
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Triangles of a sector, about
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "250k")]
    triangles: Count,
    /// Triangles of a sector's preview and of a coarse asset, about [default: a 64th of a sector's, and what the border needs]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    preview_triangles: Option<Count>,
    /// Stored texels of their finest level [default: a 64th of a sector's, at least 16 per triangle]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    preview_texels: Option<Count>,
    /// Make neither previews nor coarse assets
    #[arg(long, conflicts_with_all = ["preview_triangles", "preview_texels"])]
    no_previews: bool,
}

#[derive(Debug, Serialize)]
struct SplitInfo {
    index: ShownPath,
    sectors: u64,
    triangles: u64,
    /// Of all sectors, previews included.
    bytes: u64,
    /// Of the asset.
    bytes_before: u64,
    /// Texels of tiles that more than one sector has, counted beyond the first.
    repeated_texels: u64,
    preview_triangles: u64,
    preview_texels: u64,
    /// Assets that stand for several sectors.
    coarse: u64,
    coarse_triangles: u64,
    coarse_bytes: u64,
    notes: Vec<String>,
    seconds: f64,
}

pub(crate) fn run(args: &SplitArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    let in_store = if is_address(&args.output) {
        let _deferral = context.defer_interrupt();
        let folder = StoreFolder::of_split(&args.output, &args.asset, context.force)?;
        context.check_interrupt()?;
        Some(folder)
    } else {
        check_can_be_folder(&args.output)?;
        None
    };
    let asset = open_asset(&args.asset)?;
    let previews = SectorPreviews {
        triangles: args.preview_triangles.map(|n| usize::try_from(n.0).unwrap_or(usize::MAX)),
        texels: args.preview_texels.map(|n| n.0),
    };
    let options = SplitOptions {
        triangles: usize::try_from(args.triangles.0).unwrap_or(usize::MAX),
        previews: (!args.no_previews).then_some(previews),
        memory_bytes: context.memory_bytes,
        force: context.force,
    };
    let written = {
        let _deferral = context.defer_interrupt();
        match &in_store {
            Some(folder) => {
                let splitting = context.step("split", "M texels");
                let sending = context.step("uploading", "MB");
                folder.split(&asset, &options, [&splitting, &sending])?
            }
            None => split(&asset, &args.output, &options, &context.progress("split"))?,
        }
    };
    written.notes.iter().for_each(|note| context.note(note));
    let info = SplitInfo::of(written, &asset, started.elapsed());
    context.print(&info, split_text)
}

impl SplitInfo {
    fn of(written: Split, asset: &Asset, time: Duration) -> Self {
        let World { objects, coarse } = &written.world;
        let previews = || objects.iter().filter_map(|object| object.preview);
        Self {
            index: written.index.into(),
            sectors: objects.len() as u64,
            triangles: objects.iter().map(|object| object.triangles).sum(),
            bytes: objects.iter().map(|object| object.bytes).sum(),
            bytes_before: asset.file_bytes(),
            repeated_texels: written.repeated_texels,
            preview_triangles: previews().map(|preview| preview.triangles).sum(),
            preview_texels: previews().map(|preview| preview.texels).sum(),
            coarse: coarse.len() as u64,
            coarse_triangles: coarse.iter().map(|coarse| coarse.triangles).sum(),
            coarse_bytes: coarse.iter().map(|coarse| coarse.bytes).sum(),
            notes: written.notes,
            seconds: time.as_secs_f64(),
        }
    }
}

fn split_text(info: &SplitInfo) -> String {
    let coarse = match info.coarse {
        0 => String::new(),
        count => {
            let triangles = counted(info.coarse_triangles, "triangle");
            format!("{} of {triangles}, ", counted(count, "coarse asset"))
        }
    };
    format!(
        "{}: {} of {}, {} (the asset: {}), previews of {}, {coarse}{:.1} s\n",
        info.index.display(),
        counted(info.sectors, "sector"),
        counted(info.triangles, "triangle"),
        megabytes(info.bytes),
        megabytes(info.bytes_before),
        counted(info.preview_triangles, "triangle"),
        info.seconds
    )
}
