//! The sectors of an asset on their way to an object store.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::{Error, Result, input};
use fantex_store::Asset;
use fantex_stream::{ObjectTarget, Replace};

use crate::addresses::{temporary_folder, watched};
use crate::{Split, SplitOptions, World, split};

/// A folder in an object store that an asset is split into: what the keys of its world begin with.
#[derive(Clone, Debug)]
pub struct StoreFolder {
    /// Ends with a slash.
    address: String,
    /// The index's file.
    index: String,
}

impl StoreFolder {
    /// For an asset at a path or an address. Refuses, before any work is done, what could not be written.
    ///
    /// # Errors
    /// The address is that of no store that is written to; the asset lies there under a name that a sector or a coarse asset may get; a world or a
    /// sector is there, unless it may be replaced (`force`); the store does not answer, or does not let these keys write.
    pub fn of_split(folder: &Path, asset: &Path, force: bool) -> Result<Self> {
        let address = format!("{}/", folder.display().to_string().trim_end_matches('/'));
        let prefix = Self { address, index: Split::index_name(asset) };
        if prefix.may_write_over(asset) {
            return Err(input::is_read(asset));
        }
        for name in [prefix.index.as_str(), "sector-0001.fan"] {
            prefix.object(name)?.check(force)?;
        }
        Ok(prefix)
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

    /// [Splits](split()) the asset on this machine, then writes the sectors and at last the index. There is no index while a world is exchanged. What
    /// was written goes away where not all could be. `sending` counts bytes.
    ///
    /// # Errors
    /// As [`split()`]; the store does not answer or refuses; somebody wants to stop.
    pub fn split(
        &self,
        asset: &Arc<Asset>,
        options: &SplitOptions,
        [splitting, sending]: [&dyn Progress; 2],
    ) -> Result<Split> {
        let folder = temporary_folder()?;
        let mut written = split(asset, folder.path(), options, splitting)?;
        let mut names: Vec<&str> = written.world.assets().collect();
        let old = if options.force { self.old_assets()? } else { Vec::new() };
        if options.force {
            self.object(&self.index)?.remove()?;
        }
        names.push(&self.index);
        let replace = if options.force { Replace::Anything } else { Replace::Nothing };
        let mut done = Vec::new();
        if let Err(error) = self.put_all(folder.path(), &names, &mut done, &replace, sending) {
            // Sectors that cannot be removed either have no index that names them. Where the store does not answer, one attempt will do.
            done.iter().try_for_each(ObjectTarget::remove).unwrap_or_default();
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
        replace: &Replace,
        progress: &dyn Progress,
    ) -> Result<()> {
        let bytes = |name: &&str| {
            let path = folder.join(name);
            path.metadata().map(|found| found.len()).map_err(|error| Error::reading(path, error))
        };
        let lengths = names.iter().map(bytes).collect::<Result<Vec<_>>>()?;
        let (mut before, total) = (0, lengths.iter().sum());
        for (name, length) in names.iter().zip(lengths) {
            let object = self.object(name)?;
            object.put(&folder.join(name), replace, &|sent, _| watched(progress, before + sent, total))?;
            before += length;
            done.push(object);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use fantex_base::ErrorKind;

    use super::*;

    #[test]
    fn an_asset_is_not_split_over_itself() {
        for folder in ["s3://scans/land", "s3://scans/land/"] {
            for asset in ["sector-0001.fan", "sector-0002.fan", "coarse-0012.fan"] {
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
}
