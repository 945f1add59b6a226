//! Cameras from files and to files.
//!
//! - COLMAP's sparse models (J. L. Schoenberger and J.-M. Frahm, "Structure-from-Motion Revisited", 2016), text and binary, which
//!   RealityCapture, Metashape and others write, too: `cameras` and `images`; points are not read;
//! - `transforms.json` as NeRF's data sets and nerfstudio have it (M. Tancik et al., "Nerfstudio: A Modular Framework for Neural
//!   Radiance Field Development", 2023).
//!
//! Nothing in a file is trusted: counts, names and numbers are checked before they are used and before anything is allocated for
//! them.

mod colmap_binary;
mod colmap_text;
mod error;
mod model;
mod transforms;
mod write;

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

pub use self::error::{EntryProblem, ReadCamerasError, WriteCamerasError};
pub use self::model::CameraProblem;
pub use self::write::{write_colmap_binary, write_colmap_text, write_transforms};

use crate::{CameraFromWorld, PhotoCamera, Photograph};

/// Most cameras, and most photographs, of a set.
const MOST_ENTRIES: usize = 1 << 16;
/// Longest name of a photograph in bytes.
const LONGEST_NAME: usize = 4096;

/// The cameras of a file by their numbers.
type Cameras = BTreeMap<u32, PhotoCamera>;

/// A photograph as COLMAP lists it.
#[derive(Debug)]
struct Listed {
    name: String,
    camera: u32,
    camera_from_world: CameraFromWorld,
}

/// Reads the cameras of a set of photographs, sorted by name.
///
/// `path` is a `transforms.json`, or a folder with one, or with a sparse model of COLMAP in it or in its folder `sparse/0` or
/// `sparse`; binary files go before text. `images` is the folder of the photographs: not given, it is
/// the folder `images` beside the model, or beside one of the two folders above it, or that of `transforms.json`.
///
/// # Errors
///
/// A [`ReadCamerasError`] that names the file, the place in it and what was expected there. Photographs that are not there are an
/// error, too; their content is not looked at.
pub fn read_cameras(path: &Path, images: Option<&Path>) -> Result<Vec<Photograph>, ReadCamerasError> {
    read_cameras_in(path, images, CameraFrame::default())
}

/// In which coordinates cameras are wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CameraFrame {
    /// Those of the file.
    #[default]
    OfFile,
    /// Those that the cameras had before they were written to a `transforms.json` with `applied_transform` (and
    /// `applied_scale`), which say how they were moved then: those of the photogrammetry program and of its mesh.
    Original,
}

/// As [`read_cameras`], in the coordinates of `frame`.
///
/// # Errors
///
/// As [`read_cameras`].
pub fn read_cameras_in(
    path: &Path,
    images: Option<&Path>,
    frame: CameraFrame,
) -> Result<Vec<Photograph>, ReadCamerasError> {
    let metadata = path.metadata().map_err(|source| ReadCamerasError::Read { path: path.into(), source })?;
    let mut photographs = match metadata.is_dir() {
        false => transforms::read(path, images, frame)?,
        true => read_folder(path, images, frame)?,
    };
    photographs.sort_by(|a, b| a.name.cmp(&b.name));
    let missing: Vec<&Photograph> = photographs.iter().filter(|p| !p.path.is_file()).collect();
    if let Some(first) = missing.first() {
        return Err(ReadCamerasError::MissingPhotographs {
            first: first.path.clone(),
            missing: missing.len(),
            total: photographs.len(),
        });
    }
    let mut masks = photographs.iter().filter_map(|p| p.mask.as_ref());
    match masks.find(|mask| !mask.is_file()) {
        Some(mask) => Err(ReadCamerasError::MissingMask { path: mask.clone() }),
        None => Ok(photographs),
    }
}

fn read_folder(
    folder: &Path,
    images: Option<&Path>,
    frame: CameraFrame,
) -> Result<Vec<Photograph>, ReadCamerasError> {
    for model in [folder.to_owned(), folder.join("sparse/0"), folder.join("sparse")] {
        let has = |name: &str| model.join(name).is_file();
        if has("cameras.bin") && has("images.bin") {
            let (cameras, images_file) = (model.join("cameras.bin"), model.join("images.bin"));
            let cameras = colmap_binary::read_cameras(&cameras)?;
            let listed = colmap_binary::read_images(&images_file, &cameras)?;
            return located(listed, &cameras, &images_file, &image_folder(&model, images));
        }
        if has("cameras.txt") && has("images.txt") {
            let (cameras, images_file) = (model.join("cameras.txt"), model.join("images.txt"));
            let cameras = colmap_text::read_cameras(&cameras)?;
            let listed = colmap_text::read_images(&images_file, &cameras)?;
            return located(listed, &cameras, &images_file, &image_folder(&model, images));
        }
    }
    match folder.join("transforms.json") {
        file if file.is_file() => transforms::read(&file, images, frame),
        _ => Err(ReadCamerasError::NoCameras { path: folder.into() }),
    }
}

/// Where the photographs of a sparse model are.
fn image_folder(model: &Path, given: Option<&Path>) -> PathBuf {
    if let Some(given) = given {
        return given.into();
    }
    let candidates =
        ["images", "../images", "../../images"].map(|folder| without_detours(model.join(folder)));
    let missing = candidates[0].clone();
    candidates.into_iter().find(|folder| folder.is_dir()).unwrap_or(missing)
}

/// The path without `name/..` in it, if that leads to the same place: a link may lead elsewhere.
fn without_detours(path: PathBuf) -> PathBuf {
    let mut plain = PathBuf::new();
    for component in path.components() {
        let is_detour = matches!(plain.components().next_back(), Some(Component::Normal(_)));
        match component {
            Component::ParentDir if is_detour => _ = plain.pop(),
            other => plain.push(other),
        }
    }
    let place = |path: &Path| path.canonicalize().ok();
    if place(&plain) == place(&path) { plain } else { path }
}

fn located(
    listed: Vec<Listed>,
    cameras: &Cameras,
    file: &Path,
    folder: &Path,
) -> Result<Vec<Photograph>, ReadCamerasError> {
    let photograph = |Listed { name, camera, camera_from_world }: Listed| {
        let camera = *cameras.get(&camera)?;
        let mask = mask_beside(folder, &name);
        Some(Photograph { path: folder.join(&name), mask, name, camera, camera_from_world })
    };
    let photographs: Vec<_> = listed.into_iter().filter_map(photograph).collect();
    if photographs.is_empty() {
        return Err(ReadCamerasError::NoPhotographs { path: file.into() });
    }
    Ok(photographs)
}

/// The mask of a photograph as COLMAP has it: in `masks` beside the folder of photographs, by the whole name with `.png` after it.
fn mask_beside(images: &Path, name: &str) -> Option<PathBuf> {
    let mask = images.parent()?.join("masks").join(format!("{name}.png"));
    mask.is_file().then_some(mask)
}

/// Checks the name of a photograph.
fn checked_name(name: &str) -> Result<String, EntryProblem> {
    match name {
        "" => Err(EntryProblem::Name("empty")),
        name if name.len() > LONGEST_NAME => Err(EntryProblem::Name("longer than 4096 bytes")),
        // It would break the lines of messages that name it.
        name if name.contains(char::is_control) => {
            Err(EntryProblem::Name("not printable: it has a control character"))
        }
        name => Ok(name.to_owned()),
    }
}

/// Opens a file of cameras that is not longer than `limit`.
fn open_within(path: &Path, limit: u64) -> Result<std::fs::File, ReadCamerasError> {
    let failed = |source| ReadCamerasError::Read { path: path.into(), source };
    let file = std::fs::File::open(path).map_err(failed)?;
    let bytes = file.metadata().map_err(failed)?.len();
    match bytes > limit {
        true => Err(ReadCamerasError::TooLarge { path: path.into(), bytes, limit }),
        false => Ok(file),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detours_are_left_out() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        std::fs::create_dir_all(at("d/sparse/0")).unwrap();
        std::fs::create_dir_all(at("d/images")).unwrap();
        assert_eq!(without_detours(at("d/sparse/0/../../images")), at("d/images"));
        assert_eq!(without_detours("../../images".into()), Path::new("../../images"));
        // Neither is there.
        assert_eq!(without_detours(at("d/none/../gone")), at("d/gone"));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(at("d/sparse/0"), at("link")).unwrap();
            std::fs::create_dir_all(at("d/sparse/images")).unwrap();
            assert_eq!(without_detours(at("link/../images")), at("link/../images"));
        }
    }
}
