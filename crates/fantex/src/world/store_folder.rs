//! Worlds on their way to object stores: the sectors of an asset, and what was split before.
//!
//! ```text
//!  old index  -> sector-0001.fan, ...         1. new assets, under names that nobody has, the first one first
//!  new index  -> sector-0001-2.fan, ...       2. the new index, in the place of that which was looked at
//!                                             3. the old assets go, the first one last
//! ```
//!
//! So readers see one world or the other, and what ends on the way leaves the old one. Of a *generation*, the names with one number behind them, the
//! first asset is there as long as any is: whoever writes takes another generation where it is, and two who write at once have one each.

use std::collections::HashSet;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::{Error, ErrorKind, Result, files, input};
use fantex_store::Asset;
use fantex_stream::{ObjectTarget, Replace};

use super::split::names::generation_of;
use super::split::output::left_behind;
use crate::addresses::staging::{SendTarget, Staging};
use crate::addresses::watched;
use crate::{Split, SplitOptions, World, split};

/// A folder in an object store that an asset is split into: what the keys of its world begin with.
#[derive(Clone, Debug)]
pub struct StoreFolder {
    /// Ends with a slash.
    address: String,
    /// The index's file.
    index: String,
}

/// A world that is in a store.
#[derive(Debug)]
pub(crate) struct SentWorld {
    /// What its index says.
    world: World,
    /// The index and what it names.
    pub(crate) objects: u64,
    /// Their bytes.
    pub(crate) bytes: u64,
    /// What is to be known, a sentence each.
    pub(crate) notes: Vec<String>,
}

/// Generations that are tried, at most: more are not there unless uploads were killed so often.
const MAX_GENERATIONS: u32 = 1000;

/// How often an index that somebody else has replaced meanwhile is replaced after all.
const MAX_INDEXES: u32 = 5;

impl StoreFolder {
    /// For an asset at a path or an address. Refuses, before any work is done, what could not be written.
    ///
    /// # Errors
    /// The address is that of no store that is written to; the asset lies there under a name that a sector or a coarse asset may get; a world or a
    /// sector is there, unless it may be replaced (`force`); the store does not answer, or does not let these keys write, or, with `force`, look at the
    /// index.
    pub fn of_split(folder: &Path, asset: &Path, force: bool) -> Result<Self> {
        let address = format!("{}/", folder.display().to_string().trim_end_matches('/'));
        let prefix = Self { address, index: Split::index_name(asset) };
        if prefix.may_write_over(asset) {
            return Err(input::is_read(asset));
        }
        prefix.checked(force)
    }

    /// For an index at an address, as [`of_split`](Self::of_split).
    pub(crate) fn of_index(index: &Path, force: bool) -> Result<Self> {
        let address = index.display().to_string();
        let (folder, index) = address.rsplit_once('/').unwrap_or_default();
        Self { address: format!("{folder}/"), index: index.to_owned() }.checked(force)
    }

    fn checked(self, force: bool) -> Result<Self> {
        for name in [self.index.as_str(), "sector-0001.fan"] {
            self.object(name)?.check(force)?;
        }
        if force {
            let seen = self.object(&self.index)?.version();
            seen.map_err(|error| error.context("to replace a world its index is looked at first (--force)"))?;
        }
        Ok(self)
    }

    /// Whether a place is that of the index, or one that a sector or a coarse asset may get.
    fn may_write_over(&self, place: &Path) -> bool {
        let name = place.file_name().and_then(|name| name.to_str());
        let is_written = |name: &str| name == self.index || Split::is_asset_name(name);
        place.parent() == Some(Path::new(&self.address)) && name.is_some_and(is_written)
    }

    fn place(&self, name: &str) -> PathBuf {
        PathBuf::from(format!("{}{name}", self.address))
    }

    fn object(&self, name: &str) -> Result<ObjectTarget> {
        ObjectTarget::at(&self.place(name))
    }

    /// [Splits](split()) the asset on this machine, then writes the sectors and at last the index, which takes the place of one that is there at once.
    /// `sending` counts bytes.
    ///
    /// # Errors
    /// As [`split()`]; the store does not answer or refuses; somebody wants to stop. Then the world that was there is as it was, and what was written of
    /// the new one goes away; if it was finished, it is kept on this machine, and the error says where.
    pub fn split(
        &self,
        asset: &Arc<Asset>,
        options: &SplitOptions,
        [splitting, sending]: [&dyn Progress; 2],
    ) -> Result<Split> {
        let (staging, folder) = (Staging::new()?, Path::new("world"));
        let mut written = split(asset, &staging.path().join(folder), options, splitting)?;
        let (index, force) = (self.place(&self.index), options.force);
        let world = std::mem::take(&mut written.world);
        let target = SendTarget { place: &index, force, is_version: false };
        let sent = staging.send(&folder.join(&self.index), &target, |staged| {
            self.send(&staged.join(folder), world, force, sending)
        })?;
        written.notes.extend(sent.notes);
        Ok(Split { index, world: sent.world, ..written })
    }

    /// Writes a world whose assets lie in a folder, as [`split`](Self::split) does. `progress` counts bytes.
    pub(crate) fn send(
        &self,
        folder: &Path,
        mut world: World,
        force: bool,
        progress: &dyn Progress,
    ) -> Result<SentWorld> {
        check_names(&world)?;
        let names: Vec<String> = world.assets().map(str::to_owned).collect();
        let bytes = |name: &String| {
            let path = folder.join(name);
            path.metadata().map(|found| found.len()).map_err(|error| Error::reading(path, error))
        };
        let lengths = names.iter().map(bytes).collect::<Result<Vec<_>>>()?;
        let mut of_assets: u64 = 0;
        // What is sent before each.
        let mut starts = Vec::with_capacity(lengths.len());
        for length in lengths {
            starts.push(of_assets);
            of_assets += length;
        }
        let taken = if force { self.generations_of_index()? } else { HashSet::new() };
        let most = if force { MAX_GENERATIONS } else { 1 };
        let staging = Staging::new()?;
        let mut sent = Err(files::exists(&self.place(&names[0])));
        for generation in (1..=most).filter(|generation| !taken.contains(generation)) {
            let mut done = Vec::new();
            let put = self.put_all(folder, &names, generation, &mut done, &|sent, number| {
                watched(progress, starts[number] + sent, of_assets)
            });
            if put.is_err() {
                remove_own(&done);
            }
            let is_taken = put.as_ref().is_err_and(|error| error.kind() == ErrorKind::AlreadyExists);
            sent = put.map(|()| (generation, done));
            if !(force && is_taken) {
                break;
            }
        }
        let (generation, done) = sent?;
        world.rename_assets(|name| Split::name_in_generation(name, generation));
        let file = staging.path().join(&self.index);
        world.write(&file).inspect_err(|_| remove_own(&done))?;
        let old = self.put_index(&file, &world, force, progress, &done)?;
        let of_index = file.metadata().map_or(0, |found| found.len());
        let notes = self.remove_old(&old, &world, progress);
        Ok(SentWorld { objects: names.len() as u64 + 1, bytes: of_assets + of_index, world, notes })
    }

    /// The generations of the assets that the index names which is there; none where it cannot be understood: it is replaced all the same.
    fn generations_of_index(&self) -> Result<HashSet<u32>> {
        let object = self.object(&self.index)?;
        let world = if object.version()?.is_some() { self.world_there()? } else { None };
        Ok(world.iter().flat_map(World::assets).filter_map(generation_of).collect())
    }

    /// The world that is there, if it can be understood.
    fn world_there(&self) -> Result<Option<World>> {
        match World::open_to_change(self.place(&self.index)) {
            Err(error) if error.kind() != ErrorKind::Io => Ok(None),
            world => world.map(Some),
        }
    }

    /// Writes the assets of a generation, in this order, where nothing is; `done` are those that are there. `watch` gets the bytes of an asset that
    /// are sent, and its number.
    fn put_all(
        &self,
        folder: &Path,
        names: &[String],
        generation: u32,
        done: &mut Vec<ObjectTarget>,
        watch: &(dyn Fn(u64, usize) -> ControlFlow<()> + Sync),
    ) -> Result<()> {
        for (number, name) in names.iter().enumerate() {
            let object = self.object(&Split::name_in_generation(name, generation))?;
            // An upload in parts would tell at its end.
            if number == 0 && object.visible_version()?.is_some() {
                return Err(files::exists(object.location()));
            }
            object.put(&folder.join(name), &Replace::Nothing, &|sent, _| watch(sent, number))?;
            done.push(object);
        }
        Ok(())
    }

    /// Puts the index there, in the place of the one that is there then, and gives the world that this was. Where that fails, the assets of the new
    /// world (`done`) go again, unless the store does not say whether the index is there.
    fn put_index(
        &self,
        file: &Path,
        world: &World,
        force: bool,
        progress: &dyn Progress,
        done: &[ObjectTarget],
    ) -> Result<World> {
        let failed = |error: Error| {
            // Nobody else has these names.
            let is_it = |there: &World| there.assets().eq(world.assets());
            match self.world_there() {
                // The answer was lost.
                Ok(there) if there.as_ref().is_some_and(is_it) => Ok(()),
                Ok(_) => {
                    remove_own(done);
                    Err(error)
                }
                Err(_) => Err(error.leaving(format!(
                    "whether {} is there the store does not say, so its assets stay there",
                    self.place(&self.index).display()
                ))),
            }
        };
        let go_on =
            || if progress.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
        let mut attempt = 1;
        loop {
            let (replace, old) = match self.index_there(force) {
                Ok(there) => there,
                Err(error) => return failed(error).map(|()| World::default()),
            };
            let put = self.object(&self.index).and_then(|object| object.put(file, &replace, &|_, _| go_on()));
            match put {
                // Somebody else was faster, and theirs is replaced then.
                Err(error)
                    if force
                        && attempt < MAX_INDEXES
                        && matches!(error.kind(), ErrorKind::AlreadyExists | ErrorKind::Conflict) => {}
                put => return put.or_else(failed).map(|()| old),
            }
            attempt += 1;
        }
    }

    /// What an index takes the place of, and the world that this is.
    fn index_there(&self, force: bool) -> Result<(Replace, World)> {
        let index = self.object(&self.index)?;
        match if force { index.version()? } else { index.visible_version()? } {
            None => Ok((Replace::Nothing, World::default())),
            Some(_) if !force => Err(files::exists(&self.place(&self.index))),
            // It is read after its version is known: if it is another one by then, it is not replaced.
            Some(version) => Ok((Replace::Version(version), self.world_there()?.unwrap_or_default())),
        }
    }

    /// Removes the sectors and coarse assets of a world that another one has replaced, the first one last. Returns what is to be known.
    fn remove_old(&self, old: &World, new: &World, progress: &dyn Progress) -> Vec<String> {
        let kept: HashSet<&str> = new.assets().collect();
        let mut names: Vec<&str> = old.assets().collect();
        names.retain(|name| Split::is_asset_name(name) && !kept.contains(name));
        while let Some(name) = names.last() {
            let removed = match progress.is_cancelled() {
                true => Err(Error::cancelled("removing them was ended")),
                false => self.object(name).and_then(|object| object.remove()),
            };
            if let Err(error) = removed {
                let left = names.iter().map(|name| self.place(name).display().to_string());
                return vec![left_behind(&left.collect::<Vec<_>>(), &error)];
            }
            names.pop();
        }
        Vec::new()
    }
}

/// Removes what this process has written, the first one last. No index names it, so what cannot be removed does no harm; where the store does not
/// answer, one attempt will do.
fn remove_own(done: &[ObjectTarget]) {
    done.iter().rev().try_for_each(ObjectTarget::remove).unwrap_or_default();
}

/// Refuses a world whose assets are not named as those of a split.
fn check_names(world: &World) -> Result<()> {
    let mut known = HashSet::new();
    let wrong = world
        .assets()
        .find(|name| !Split::is_asset_name(name) || !known.insert(Split::name_in_generation(name, 1)));
    match wrong {
        Some(name) => Err(Error::unsupported(format!(
            "the world has an asset {name}, and only worlds that 'fantex split' has made are sent as a whole: send its assets, then make an index \
             there by 'fantex world'"
        ))),
        None if known.is_empty() => Err(Error::not_found("the world has no assets that could be sent")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::WorldObject;

    #[test]
    fn an_asset_is_not_split_over_itself() {
        for folder in ["s3://scans/land", "s3://scans/land/"] {
            for asset in ["sector-0001.fan", "sector-0002-2.fan", "coarse-0012.fan"] {
                let asset = Path::new("s3://scans/land").join(asset);
                let error = StoreFolder::of_split(Path::new(folder), &asset, true).unwrap_err();
                assert_eq!(error.kind(), ErrorKind::Conflict);
                assert!(error.to_string().contains("is what is read"), "{error}");
            }
        }
        let folder =
            StoreFolder { address: "s3://scans/land/".to_owned(), index: "land.fanworld".to_owned() };
        for (place, may) in [
            ("s3://scans/land/land.fanworld", true),
            ("s3://scans/land/land.fan", false),
            ("s3://scans/sector-0001.fan", false),
            ("s3://scans/land/old/sector-0001.fan", false),
            ("land/sector-0001.fan", false),
        ] {
            assert_eq!(folder.may_write_over(Path::new(place)), may, "{place}");
        }
    }

    #[test]
    fn only_what_was_split_is_sent_as_a_whole() {
        let world = |names: &[&str]| {
            let object = |name: &&str| WorldObject {
                asset: (*name).to_owned(),
                bytes: 1,
                triangles: 1,
                texels: 1,
                low: [0.0; 3],
                high: [1.0; 3],
                preview: None,
            };
            World { objects: names.iter().map(object).collect(), ..World::default() }
        };
        check_names(&world(&["sector-0001.fan", "sector-0002.fan", "coarse-0001.fan"])).unwrap();
        check_names(&world(&["sector-0001-3.fan", "sector-0002-3.fan"])).unwrap();
        for (names, word) in [
            (&["sector-0001.fan", "church.fan"][..], "church.fan"),
            (&["sector-0001.fan", "sector-0001-2.fan"], "sector-0001-2.fan"),
            (&["s3://scans/sector-0001.fan"], "s3://scans/sector-0001.fan"),
            (&[], "no assets"),
        ] {
            let error = check_names(&world(names)).unwrap_err();
            assert!(error.to_string().contains(word), "{error}");
        }
    }
}
