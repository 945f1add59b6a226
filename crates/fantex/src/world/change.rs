//! Changes to the index of a world.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::files::check_folder_of;
use fantex_base::{Error, ErrorKind, Result, counted, input};
use fantex_store::{Asset, PREVIEW};
use fantex_stream::{ObjectTarget, Replace, open_asset, url_of};

use super::coarse::objects::{MadeCoarse, make_coarse};
use super::split::output::lock_index;
use crate::addresses::{Target, is_object, watched};
use crate::preview::CancelOnly;
use crate::{FileKind, Preview, PreviewOptions, WORLD_EXTENSION, World, WorldObject};

/// What to change in an index.
#[derive(Clone, Copy, Debug, Default)]
pub struct WorldChange<'a> {
    /// Assets to add, and such to read again that have changed: paths or addresses.
    pub put: &'a [PathBuf],
    /// Assets to take out, by their names in the index or by their places; their files stay.
    pub remove: &'a [PathBuf],
    /// Makes previews, like this, of all assets of the index that have none; these are changed in place.
    pub previews: Option<PreviewOptions>,
    /// Makes coarse assets, about as large as this, of all that have previews and for which no coarse asset of a split stands, beside the index:
    /// `NAME-coarse-0001.fan`, ... They take the place of those that were made so before. What is open at borders between assets stays.
    pub coarse: Option<PreviewOptions>,
}

/// An index that was changed, and how.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WorldChanged {
    /// What it says now.
    pub world: World,
    /// Assets that were not in it before.
    pub added: u64,
    /// Assets that were read again.
    pub updated: u64,
    /// Assets that were taken out.
    pub removed: u64,
    /// Coarse assets that showed what has changed or is gone, and went with it; their files stay.
    pub coarse_removed: u64,
    /// Previews that were made.
    pub previews_made: u64,
    /// Coarse assets that were made.
    pub coarse_made: u64,
    /// What is to be known, a sentence each.
    pub notes: Vec<String>,
}

/// Changes the index at a path, or at an address in a store; makes it where there is none. `progress` counts assets.
///
/// # Errors
/// The index is no name for one, or can only be read; an asset cannot be read, or [cannot be named](World::name_of) in it; there is none of those to
/// be removed; somebody else changes the index, or has changed it in its store meanwhile; somebody wants to stop. Then the index is as it was. Previews that were
/// made stay.
pub fn change_world(index: &Path, change: &WorldChange<'_>, progress: &dyn Progress) -> Result<WorldChanged> {
    check_index(index)?;
    // One in a store is known by its version.
    let _lock = if is_object(index) { None } else { lock_index(index)? };
    let replace = replaced(index)?;
    let is_there = if is_object(index) { replace != Replace::Nothing } else { index.exists() };
    let is_for_known = change.put.is_empty() && (change.previews.is_some() || change.coarse.is_some());
    if !is_there && is_for_known {
        let index = index.display();
        return Err(Error::not_found(format!(
            "{index} is not there: name the assets that a new world is to have"
        )));
    }
    let mut world = if is_there { World::open_to_change(index)? } else { World::default() };
    let mut changed = WorldChanged::default();
    let coarse_before = world.coarse.len();
    for asset in change.remove {
        remove(&mut world, index, asset)?;
        changed.removed += 1;
    }
    // What the index names keeps its name.
    let known: Vec<(PathBuf, String)> = match &change.previews {
        Some(_) => {
            let objects = world.objects.iter();
            objects.map(|object| (World::asset_place(index, object), object.asset.clone())).collect()
        }
        None => Vec::new(),
    };
    let total = (change.put.len() + known.len()) as u64;
    let put = change.put.iter().map(|asset| (asset, None));
    let places = put.chain(known.iter().map(|(place, name)| (place, Some(name))));
    for (done, (place, name)) in (1..).zip(places) {
        check_cancelled(progress)?;
        let is_named = name.is_none();
        let name = name.map_or_else(|| World::name_of(index, place), |name| Ok(name.clone()))?;
        let mut asset = open(place)?;
        let is_made = match &change.previews {
            Some(options) => make_preview(place, &mut asset, options, progress, &mut changed.notes)?,
            None => false,
        };
        changed.previews_made += u64::from(is_made);
        if is_named || is_made {
            let is_update = world.put(WorldObject::of(name, &asset)?);
            *if is_update { &mut changed.updated } else { &mut changed.added } += 1;
        }
        progress.report(done, total);
    }
    changed.coarse_removed = (coarse_before - world.coarse.len()) as u64;
    let made = match &change.coarse {
        Some(options) => Some(make_coarse(&mut world, index, options, progress)?),
        None => None,
    };
    if changed.coarse_removed > 0 && made.is_none() {
        changed.notes.push(format!(
            "{} showed what has changed and went from the index, so views from afar take more memory; 'fantex split' of the whole asset makes \
             those of sectors anew, --make-coarse those of separate assets",
            counted(changed.coarse_removed, "coarse asset")
        ));
    }
    check_cancelled(progress)?;
    let mut made = made;
    put_index(index, &world, &replace, made.as_mut(), progress)?;
    if let Some(mut made) = made {
        changed.coarse_made = made.count;
        changed.notes.append(&mut made.notes);
        changed.notes.extend(made.stay());
    }
    Ok(WorldChanged { world, ..changed })
}

/// Writes the index. Where it lies in a store and that fails, nothing is kept of it: it is made anew in no time.
fn put_index(
    index: &Path,
    world: &World,
    replace: &Replace,
    mut made: Option<&mut MadeCoarse>,
    progress: &dyn Progress,
) -> Result<()> {
    let target = Target::new(index)?;
    let written = world.write(target.file());
    // Where only the folder cannot be made durable, the index is there, with what it names.
    let is_there = || std::fs::read(index).is_ok_and(|there| world.to_bytes().is_ok_and(|new| new == there));
    if let Some(made) = made.as_deref_mut().filter(|_| written.is_err() && is_there()) {
        made.keep();
    }
    written?;
    let Some(object) = target.object() else { return Ok(()) };
    let put = object.put(target.file(), replace, &|done, total| watched(&CancelOnly(progress), done, total));
    let Err(error) = put else { return Ok(()) };
    if matches!(error.kind(), ErrorKind::AlreadyExists | ErrorKind::Conflict) {
        return Err(error);
    }
    match World::open_to_change(index) {
        // The answer was lost.
        Ok(there) if there == World::open_to_change(target.file())? => Ok(()),
        Err(unknown) if unknown.kind() == ErrorKind::Io => {
            let left = match made {
                Some(made) if made.count > 0 => {
                    made.keep();
                    ", so the coarse assets that were made stay there"
                }
                _ => "",
            };
            let index = index.display();
            Err(error.leaving(format!("whether {index} is changed the store does not say{left}")))
        }
        _ => Err(error.leaving(format!("{} is as it was: run the command again", index.display()))),
    }
}

fn check_cancelled(progress: &dyn Progress) -> Result<()> {
    match progress.is_cancelled() {
        true => Err(Error::cancelled("the change of the world was cancelled")),
        false => Ok(()),
    }
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
    if url_of(index).is_none() {
        check_folder_of(index)?;
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

fn open(place: &Path) -> Result<Arc<Asset>> {
    FileKind::check_is_asset(place)?;
    open_asset(place).map(Arc::new)
}

/// Gives an asset a preview where it has none; the asset is opened again.
fn make_preview(
    place: &Path,
    asset: &mut Arc<Asset>,
    options: &PreviewOptions,
    progress: &dyn Progress,
    notes: &mut Vec<String>,
) -> Result<bool> {
    if asset.attachment_bytes(PREVIEW)?.is_some() {
        return Ok(false);
    }
    if url_of(place).is_some() && !is_object(place) {
        notes.push(format!("{} has no preview and gets none: it can only be read", place.display()));
        return Ok(false);
    }
    let progress: &dyn Progress = &CancelOnly(progress);
    Preview::add_at(place, options, [progress; 2])?;
    *asset = open(place)?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use fantex_bake::NoProgress;
    use fantex_store::WriterLock;

    use super::*;

    #[test]
    fn an_index_is_changed_by_one_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let index = folder.path().join("town.fanworld");
        let change = || change_world(&index, &WorldChange::default(), &NoProgress);
        let lock = WriterLock::acquire(&index).unwrap();
        let error = change().unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Conflict);
        assert!(error.to_string().contains("town.fanworld is being edited by another program"), "{error}");
        assert!(!index.exists());
        drop(lock);
        change().unwrap();
        let names: Vec<_> = folder.path().read_dir().unwrap().map(|entry| entry.unwrap().path()).collect();
        assert_eq!(names, [index]);
    }
}
