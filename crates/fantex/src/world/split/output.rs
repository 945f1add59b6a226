//! The folder of a split: what is written appears when all is there, and what it replaces goes then.

use std::collections::HashSet;
use std::fs::File;
use std::path::{Path, PathBuf};

use fantex_base::files::{
    TemporaryFolder, persist_all, remove_if_there, remove_leftovers, sync_folder, temporary_folder,
};
use fantex_base::{Error, ErrorKind, Result, input};
use fantex_store::{Asset, WriterLock};
use tempfile::TempPath;

use super::Split;
use super::names::generation_of;
use crate::World;
use crate::asset::{ASSET_START, first_bytes};
use crate::world::coarse::tree::Node;

/// The folder while sectors are written, in a folder within it. What was written goes away unless it is finished.
pub(super) struct Output {
    folder: PathBuf,
    was_made: bool,
    /// That of an index that may be there.
    lock: Option<WriterLock>,
    unfinished: Option<TemporaryFolder>,
    /// Sectors and coarse assets that are there and belong to the world that is replaced, or to none.
    replaced: Vec<PathBuf>,
    /// Names of sectors and coarse assets.
    written: Vec<String>,
}

impl Output {
    pub(super) fn begin(folder: &Path, index: &Path, force: bool) -> Result<Self> {
        let writing = |error| Error::writing(folder, error);
        let was_made = !folder.exists();
        if was_made {
            std::fs::create_dir_all(folder).map_err(writing)?;
        }
        let mut output = Self {
            folder: folder.into(),
            was_made,
            lock: None,
            unfinished: None,
            replaced: Vec::new(),
            written: Vec::new(),
        };
        remove_leftovers(folder);
        let names = names_in(folder)?;
        if !force && !names.is_empty() {
            let folder = folder.display();
            return Err(Error::already_exists(format!(
                "{folder} is not empty; give another folder, or write over the world in it with --force"
            )));
        }
        // In an empty folder there is nothing that somebody else could change.
        output.lock = if force { lock_index(index)? } else { None };
        let others = assets_of_others(folder, &names, index)?;
        let assets = names.iter().filter(|name| Split::is_asset_name(name) && !others.contains(*name));
        output.replaced.extend(assets.map(|name| folder.join(name)).filter(|path| !is_foreign(path)));
        output.replaced.iter().map(PathBuf::as_path).chain([index]).try_for_each(input::check_output)?;
        // What somebody paints on one of them would be lost.
        output.replaced.iter().try_for_each(|path| WriterLock::of_replaced(path).map(drop))?;
        output.unfinished = Some(temporary_folder(folder).map_err(writing)?);
        Ok(output)
    }

    /// The folder in which files are until all are there.
    pub(super) fn unfinished_folder(&self) -> Option<PathBuf> {
        self.unfinished.as_ref().map(|unfinished| unfinished.path().to_owned())
    }

    /// Where a file is until all are there.
    fn unfinished(&self, name: impl AsRef<Path>) -> PathBuf {
        self.unfinished.as_ref().map_or(&*self.folder, TemporaryFolder::path).join(name)
    }

    /// The path of a file that is written now.
    pub(super) fn add(&mut self, name: &str) -> PathBuf {
        self.written.push(name.to_owned());
        self.unfinished(name)
    }

    /// The preview of a sector, or a coarse asset.
    pub(super) fn open_coarsest(&self, node: &Node) -> Result<Asset> {
        let path = self.unfinished(&node.asset);
        match node.is_object {
            true => World::open_preview(&path),
            false => Asset::open(&path),
        }
    }

    /// Puts all files in their places, then the index, and removes the assets of the world that it replaces. Nothing is changed of that before the
    /// new one is there and durable. Returns what is to be known.
    pub(super) fn finish(mut self, world: &mut World, index: &Path) -> Result<Vec<String>> {
        let taken: HashSet<u32> =
            names_in(&self.folder)?.iter().filter_map(|name| generation_of(name)).collect();
        let generation = (1..).find(|generation| !taken.contains(generation)).unwrap_or(1);
        let renamed = |name: &str| Split::name_in_generation(name, generation);
        world.rename_assets(renamed);
        let unfinished_index = self.unfinished(index.file_name().unwrap_or_default());
        world.write(&unfinished_index)?;
        let place = |name: &String| self.folder.join(renamed(name));
        let file = |name: &String| -> Result<(TempPath, PathBuf)> {
            let file = self.unfinished(name);
            let temporary = TempPath::try_from_path(&file).map_err(|error| Error::writing(&file, error))?;
            Ok((temporary, place(name)))
        };
        persist_all(self.written.iter().map(file).collect::<Result<_>>()?, false)?;
        if let Err(error) = std::fs::rename(unfinished_index, index) {
            self.written.iter().for_each(|name| std::fs::remove_file(place(name)).unwrap_or_default());
            return Err(Error::writing(index, error));
        }
        self.was_made = false;
        // Until then a crash may leave either index, so both worlds have to be there.
        sync_folder(&self.folder)?;
        let mut failure = None;
        let mut left = Vec::new();
        for path in &self.replaced {
            if let Err(error) = remove_asset(path) {
                left.push(path.display().to_string());
                failure.get_or_insert(error);
            }
        }
        Ok(failure.iter().map(|error| left_behind(&left, error)).collect())
    }
}

/// Removes an asset, if it is there and nobody changes it.
fn remove_asset(path: &Path) -> Result<()> {
    let _lock = WriterLock::of_replaced(path)?;
    remove_if_there(path)
}

/// Keeps others from changing or replacing an index in a folder meanwhile.
pub(crate) fn lock_index(index: &Path) -> Result<Option<WriterLock>> {
    match WriterLock::acquire(index) {
        Err(error) if error.kind() == ErrorKind::Conflict => Err(error),
        // Where there is no lock, the index cannot be written either, which is told then.
        lock => Ok(lock.ok()),
    }
}

/// Names of what is in a folder.
fn names_in(folder: &Path) -> Result<Vec<String>> {
    let names = folder.read_dir().and_then(|entries| {
        entries.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned())).collect()
    });
    names.map_err(|error| Error::writing(folder, error))
}

/// Whether a file has the name of an asset, but not its contents: somebody else made it, and it stays.
pub(crate) fn is_foreign(path: &Path) -> bool {
    let is_file = path.metadata().is_ok_and(|metadata| metadata.is_file());
    is_file && !File::open(path).and_then(first_bytes).is_ok_and(|start| start == ASSET_START)
}

/// What other indexes than `index` name in a folder: their assets stay.
pub(crate) fn assets_of_others(folder: &Path, names: &[String], index: &Path) -> Result<HashSet<String>> {
    let others = names.iter().map(|name| folder.join(name));
    let mut assets = HashSet::new();
    for other in others.filter(|other| World::is_named(other) && other != index) {
        let world = World::open_to_change(&other).map_err(|error| {
            let folder = folder.display();
            error.context(format!("cannot tell which files in {folder} belong to another world"))
        })?;
        assets.extend(world.assets().filter_map(World::path_below));
    }
    Ok(assets)
}

impl Drop for Output {
    fn drop(&mut self) {
        drop((self.unfinished.take(), self.lock.take()));
        if self.was_made {
            std::fs::remove_dir(&self.folder).unwrap_or_default();
        }
    }
}

/// Says that files or objects of a world which is no more could not be removed.
pub(crate) fn left_behind(left: &[String], error: &Error) -> String {
    const NAMED: usize = 8;
    let names = left.iter().take(NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
    let more = match left.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    format!(
        "the world that was replaced has left what could not be removed, and may go: {names}{more} ({error})"
    )
}
