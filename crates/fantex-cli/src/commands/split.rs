//! `fantex split`: a large asset as a world of small ones.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use fantex::store::Asset;
use fantex::stream::ObjectTarget;
use fantex::{Error, Result, SectorPreviews, Split, SplitOptions, World, split};
use serde::Serialize;

use crate::addresses::{is_address, watched};
use crate::context::Context;
use crate::scene::open_asset;
use crate::text::{Count, counted, grouped, megabytes};

/// Split a large asset into a world: many small assets that viewers show near the eye, and an index.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex split land.fan -o land
  fantex split land.fan -o land --triangles 1M --preview-triangles 5k
  fantex info land/land.fanworld
  fantex verify land/land.fanworld

The folder gets the sectors, sector-0001.fan and so on, and when all are there the index, named after the asset. Sectors show what the
whole shows, to the last bit: tiles are copied, those at borders into each sector that needs them. Their previews, by which they are
shown far away, keep their borders, so that nothing shows through between them. More than 16 sectors also get coarse assets,
coarse-0001.fan and so on, each of which is shown from still farther away in the place of up to 16. See docs/worlds.md.")]
pub(crate) struct SplitArgs {
    /// The asset (.fan, also at an https://, s3://, gs:// or az:// address), which stays as it is
    asset: PathBuf,
    /// The folder to write into; it is made where there is none. Also at an s3://, gs:// or az:// address
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Triangles of a sector, about
    #[arg(long, value_name = "N", default_value = "250k")]
    triangles: Count,
    /// Triangles of a sector's preview and of a coarse asset, about [default: a 64th of a sector's, and what the border needs]
    #[arg(long, value_name = "N")]
    preview_triangles: Option<Count>,
    /// Stored texels of their finest level [default: a 64th of a sector's, at least 16 per triangle]
    #[arg(long, value_name = "N")]
    preview_texels: Option<Count>,
    /// Make neither previews nor coarse assets
    #[arg(long, conflicts_with_all = ["preview_triangles", "preview_texels"])]
    no_previews: bool,
}

#[derive(Debug, Serialize)]
struct SplitInfo {
    index: PathBuf,
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
    seconds: f64,
}

pub(crate) fn run(args: &SplitArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    let in_store = if is_address(&args.output) {
        Some(Prefix::check(&args.output, &args.asset, context)?)
    } else {
        check_folder(&args.output)?;
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
            Some(prefix) => prefix.split(&asset, &options, context)?,
            None => split(&asset, &args.output, &options, &context.progress("split"))?,
        }
    };
    let World { objects, coarse } = &written.world;
    let previews = || objects.iter().filter_map(|object| object.preview);
    let info = SplitInfo {
        index: written.index,
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
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| {
        let coarse = match info.coarse {
            0 => String::new(),
            count => {
                let triangles = grouped(info.coarse_triangles);
                format!("{} of {triangles} triangles, ", counted(count, "coarse asset"))
            }
        };
        format!(
            "{}: {} of {} triangles, {} (the asset: {}), previews of {} triangles, {coarse}{:.1} s\n",
            info.index.display(),
            counted(info.sectors, "sector"),
            grouped(info.triangles),
            megabytes(info.bytes),
            megabytes(info.bytes_before),
            grouped(info.preview_triangles),
            info.seconds
        )
    })
}

/// A folder in an object store: what the keys of a world begin with.
struct Prefix {
    /// Ends with a slash.
    address: String,
    /// The index's file.
    index: String,
}

impl Prefix {
    /// Refuses, before any work is done, what could not be written.
    fn check(folder: &Path, asset: &Path, context: &Context) -> Result<Self> {
        let address = format!("{}/", folder.display().to_string().trim_end_matches('/'));
        let prefix = Self { address, index: Split::index_name(asset) };
        for name in [prefix.index.as_str(), "sector-0001.fan"] {
            context.check_target_of(&prefix.place(name), [asset])?;
        }
        Ok(prefix)
    }

    fn place(&self, name: &str) -> PathBuf {
        PathBuf::from(format!("{}{name}", self.address))
    }

    fn object(&self, name: &str) -> Result<ObjectTarget> {
        ObjectTarget::at(&self.place(name))
    }

    /// Splits here, then writes the sectors and at last the index. There is no index while a world is exchanged. What was written goes away where
    /// not all could be.
    fn split(&self, asset: &Arc<Asset>, options: &SplitOptions, context: &Context) -> Result<Split> {
        let folder = Context::temporary_folder()?;
        let mut written = split(asset, folder.path(), options, &context.progress("split"))?;
        let mut names: Vec<&str> = written.world.assets().collect();
        let old = if context.force { self.old_assets()? } else { Vec::new() };
        if context.force {
            self.object(&self.index)?.remove()?;
        }
        names.push(&self.index);
        let mut done = Vec::new();
        if let Err(error) = self.put_all(folder.path(), &names, &mut done, context) {
            // Sectors that cannot be removed either have no index that names them.
            done.into_iter().for_each(|object| object.remove().unwrap_or_default());
            return Err(error);
        }
        for sector in old.iter().filter(|sector| !names.contains(&sector.as_str())) {
            self.object(sector)?.remove()?;
        }
        written.index = self.place(&self.index);
        Ok(written)
    }

    /// The sectors and coarse assets of a world that is there.
    fn old_assets(&self) -> Result<Vec<String>> {
        if self.object(&self.index)?.version()?.is_none() {
            return Ok(Vec::new());
        }
        // One that cannot be read is replaced all the same.
        let world = World::open(self.place(&self.index)).unwrap_or_default();
        Ok(world.assets().filter(|name| Split::is_asset_name(name)).map(str::to_owned).collect())
    }

    /// Writes files of a folder, in this order; `done` are those that are there.
    fn put_all(
        &self,
        folder: &Path,
        names: &[&str],
        done: &mut Vec<ObjectTarget>,
        context: &Context,
    ) -> Result<()> {
        let bytes = |name: &&str| {
            let path = folder.join(name);
            path.metadata().map(|found| found.len()).map_err(|error| Error::reading(path, error))
        };
        let lengths = names.iter().map(bytes).collect::<Result<Vec<_>>>()?;
        let (mut before, total) = (0, lengths.iter().sum());
        let bar = context.progress_of_bytes("uploading");
        for (name, length) in names.iter().zip(lengths) {
            let object = self.object(name)?;
            object.put(&folder.join(name), &context.replace(), &|sent, _| {
                watched(&bar, before + sent, total)
            })?;
            before += length;
            done.push(object);
        }
        Ok(())
    }
}

/// Refuses what can be no folder.
fn check_folder(folder: &Path) -> Result<()> {
    if folder.exists() && !folder.is_dir() {
        let folder = folder.display();
        return Err(Error::conflict(format!("cannot write into {folder}: it is a file; give a folder")));
    }
    Ok(())
}
