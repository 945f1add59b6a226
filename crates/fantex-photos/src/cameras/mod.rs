//! Cameras from files and to files.
//!
//! - COLMAP's sparse models (J. L. Schoenberger and J.-M. Frahm, "Structure-from-Motion Revisited", 2016), text and binary, which
//!   RealityCapture, Metashape and others write, too: `cameras` and `images`; points are not read;
//! - `transforms.json` as NeRF's data sets and nerfstudio have it (M. Tancik et al., "Nerfstudio: A Modular Framework for Neural
//!   Radiance Field Development", 2023).
//!
//! Nothing in a file is trusted: counts, names and numbers are checked before they are used and before anything is allocated for
//! them.

mod colmap;
mod transforms;

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use fantex_base::input::check_below;
use fantex_base::{Error, Result, are, counted};
use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::{CameraFromWorld, Distortion, Lens, PhotoCamera, Photograph};

pub use self::transforms::{write_colmap_binary, write_colmap_text, write_transforms};

const MAX_ENTRIES: usize = 1 << 16;
const MAX_NAME_BYTES: usize = 4096;

/// The cameras of a file by their numbers.
type Cameras = BTreeMap<u32, PhotoCamera>;

#[derive(Debug)]
struct Listed {
    name: String,
    camera: u32,
    camera_from_world: CameraFromWorld,
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

/// Reads the cameras of a set of photographs, sorted by name, in the coordinates of `frame`.
///
/// `path` is a `transforms.json`, or a folder with one, or with a sparse model of COLMAP in it or in its folder `sparse/0` or
/// `sparse`; binary files go before text. `images` is the folder of the photographs: not given, it is
/// the folder `images` beside the model, or beside one of the two folders above it, or that of `transforms.json`.
///
/// # Errors
/// The sentence names the file, the place in it and what was expected there. Photographs that are not there are an
/// error, too; their content is not looked at. So are names that lead out of the folder that they are relative to, unless that is
/// [allowed](fantex_base::ReadOptions::allow_outside).
pub fn read_cameras(path: &Path, images: Option<&Path>, frame: CameraFrame) -> Result<Vec<Photograph>> {
    let metadata = path.metadata().map_err(|source| Error::reading(path, source))?;
    let mut photographs = match metadata.is_dir() {
        false => transforms::read(path, images, frame)?,
        true => read_folder(path, images, frame)?,
    };
    photographs.sort_by(|a, b| a.name.cmp(&b.name));
    let missing: Vec<&Photograph> = photographs.iter().filter(|p| !p.path.is_file()).collect();
    if let Some(first) = missing.first() {
        let (missing, name) = (missing.len(), first.path.display());
        let (total, are) = (counted(photographs.len(), "photograph"), are(missing));
        let message = format!(
            "{missing} of {total} {are} missing, the first is {name}; say where they are with images=FOLDER"
        );
        return Err(Error::not_found(message).with_path(&first.path));
    }
    let mut masks = photographs.iter().filter_map(|p| p.mask.as_ref());
    match masks.find(|mask| !mask.is_file()) {
        Some(mask) => {
            let name = mask.display();
            let message = format!(
                "the mask {name} is missing; give it, or take its mask_path out of the file of cameras"
            );
            Err(Error::not_found(message).with_path(mask))
        }
        None => Ok(photographs),
    }
}

fn read_folder(folder: &Path, images: Option<&Path>, frame: CameraFrame) -> Result<Vec<Photograph>> {
    for model in [folder.to_owned(), folder.join("sparse/0"), folder.join("sparse")] {
        let [binary, text] =
            ["bin", "txt"].map(|end| ["cameras", "images"].map(|name| model.join(format!("{name}.{end}"))));
        let exist = |files: &[PathBuf; 2]| files.iter().all(|file| file.is_file());
        let (listed, cameras, file) = if exist(&binary) {
            let cameras = colmap::read_binary_cameras(&binary[0])?;
            (colmap::read_binary_images(&binary[1], &cameras)?, cameras, &binary[1])
        } else if exist(&text) {
            let cameras = colmap::read_text_cameras(&text[0])?;
            (colmap::read_text_images(&text[1], &cameras)?, cameras, &text[1])
        } else {
            continue;
        };
        return located(listed, &cameras, file, &image_folder(&model, images));
    }
    match folder.join("transforms.json") {
        file if file.is_file() => transforms::read(&file, images, frame),
        _ => Err(Error::not_found(format!(
            "{} holds no cameras: expected cameras.bin and images.bin, or cameras.txt and images.txt, in it or in its folder \
             sparse/0, or a transforms.json",
            folder.display()
        ))
        .with_path(folder)),
    }
}

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

fn located(listed: Vec<Listed>, cameras: &Cameras, file: &Path, folder: &Path) -> Result<Vec<Photograph>> {
    listed.iter().try_for_each(|listed| check_below(file, folder, Path::new(&listed.name)))?;
    let photograph = |Listed { name, camera, camera_from_world }: Listed| {
        let camera = *cameras.get(&camera)?;
        let mask = mask_beside(folder, &name);
        Some(Photograph { path: folder.join(&name), mask, name, camera, camera_from_world })
    };
    let photographs: Vec<_> = listed.into_iter().filter_map(photograph).collect();
    if photographs.is_empty() {
        return Err(no_photographs(file));
    }
    Ok(photographs)
}

/// The mask of a photograph as COLMAP has it: in `masks` beside the folder of photographs, by the whole name with `.png` after it.
fn mask_beside(images: &Path, name: &str) -> Option<PathBuf> {
    let masks = images.parent()?.join("masks");
    let name = format!("{name}.png");
    let is_inside = check_below(&masks, &masks, Path::new(&name)).is_ok();
    Some(masks.join(name)).filter(|mask| is_inside && mask.is_file())
}

fn checked_name(name: &str) -> Result<String> {
    match name {
        "" => Err(bad_name("empty")),
        name if name.len() > MAX_NAME_BYTES => Err(bad_name("longer than 4096 bytes")),
        // It would break the lines of messages that name it.
        name if name.contains(char::is_control) => Err(bad_name("not printable: it has a control character")),
        name => Ok(name.to_owned()),
    }
}

/// Opens a file of cameras that is not longer than `limit`.
fn open_within(path: &Path, limit: u64) -> Result<std::fs::File> {
    let failed = |source| Error::reading(path, source);
    let file = fantex_base::input::open(path).map_err(failed)?;
    let bytes = file.metadata().map_err(failed)?.len();
    if bytes > limit {
        let message = format!("{} has {bytes} bytes, more than the limit of {limit}", path.display());
        return Err(Error::too_large(message).with_path(path));
    }
    Ok(file)
}

// ---- Camera models by name and number: what their parameters mean.

pub(crate) const MAX_SIDE: u64 = 1 << 16;

fn no_pose(reason: &str) -> Error {
    Error::malformed(format!("the camera's place is no rotation and translation: {reason}"))
}

fn unknown_model(name: &str, known: &str) -> Error {
    let name: String = name.chars().take(40).collect();
    Error::unsupported(format!(
        "the camera model '{name}' is not supported (known: {known}); undistort the photographs first, for example with 'colmap \
         image_undistorter'"
    ))
}

#[derive(Debug)]
pub(crate) struct CameraModel {
    pub(crate) name: &'static str,
    pub(crate) number: i32,
    pub(crate) parameters: usize,
    two_focals: bool,
    lens: fn(&[f64]) -> Distortion,
}

fn perspective<const N: usize>(radial: [f64; N], tangential: [f64; 2]) -> Distortion {
    let mut all = [0.0; 6];
    all[..N].copy_from_slice(&radial);
    Distortion::Perspective { radial: all, tangential }
}

const fn model(
    name: &'static str,
    number: i32,
    parameters: usize,
    focals: usize,
    lens: fn(&[f64]) -> Distortion,
) -> CameraModel {
    CameraModel { name, number, parameters, two_focals: focals == 2, lens }
}

/// The models that are known: name, the number that binary files use, parameters, focal lengths, lens.
pub(crate) const MODELS: [CameraModel; 11] = [
    model("SIMPLE_PINHOLE", 0, 3, 1, |_| Distortion::PINHOLE),
    model("PINHOLE", 1, 4, 2, |_| Distortion::PINHOLE),
    model("SIMPLE_RADIAL", 2, 4, 1, |k| perspective([k[0]], [0.0; 2])),
    model("RADIAL", 3, 5, 1, |k| perspective([k[0], k[1]], [0.0; 2])),
    model("OPENCV", 4, 8, 2, |k| perspective([k[0], k[1]], [k[2], k[3]])),
    model("OPENCV_FISHEYE", 5, 8, 2, |k| Distortion::fisheye([k[0], k[1], k[2], k[3]])),
    model("FULL_OPENCV", 6, 12, 2, |k| perspective([k[0], k[1], k[4], k[5], k[6], k[7]], [k[2], k[3]])),
    model("FOV", 7, 5, 2, |k| Distortion::FieldOfView { omega: k[0] }),
    model("SIMPLE_RADIAL_FISHEYE", 8, 4, 1, |k| Distortion::fisheye([k[0], 0.0, 0.0, 0.0])),
    model("RADIAL_FISHEYE", 9, 5, 1, |k| Distortion::fisheye([k[0], k[1], 0.0, 0.0])),
    model("THIN_PRISM_FISHEYE", 10, 12, 2, |k| Distortion::Fisheye {
        radial: [k[0], k[1], k[4], k[5]],
        tangential: [k[2], k[3]],
        prism: [k[6], k[7]],
    }),
];

fn known_models() -> String {
    MODELS.map(|m| m.name).join(", ")
}

impl CameraModel {
    pub(crate) fn by_name(name: &str) -> Result<&'static Self> {
        MODELS.iter().find(|m| m.name == name).ok_or_else(|| unknown_model(name, &known_models()))
    }

    pub(crate) fn by_number(number: i32) -> Result<&'static Self> {
        let model = MODELS.iter().find(|m| m.number == number);
        model.ok_or_else(|| unknown_model(&number.to_string(), &known_models()))
    }

    /// The camera with these parameters: focal lengths, middle, distortion.
    pub(crate) fn camera(&self, size: [u64; 2], parameters: &[f64]) -> Result<PhotoCamera> {
        if parameters.len() != self.parameters {
            let (model, expected, found) = (self.name, self.parameters, parameters.len());
            return Err(Error::malformed(format!("{model} has {expected} parameters, not {found}")));
        }
        let (focal, rest) = match self.two_focals {
            true => (DVec2::new(parameters[0], parameters[1]), &parameters[2..]),
            false => (DVec2::splat(parameters[0]), &parameters[1..]),
        };
        checked_camera(size, focal, DVec2::new(rest[0], rest[1]), (self.lens)(&rest[2..]))
    }
}

pub(crate) fn checked_camera(
    size: [u64; 2],
    focal: DVec2,
    center: DVec2,
    distortion: Distortion,
) -> Result<PhotoCamera> {
    let [width, height] = size;
    if size.iter().any(|side| !(1..=MAX_SIDE).contains(side)) {
        let message =
            format!("the picture has {width} x {height} pixels, but a side must be 1 to {MAX_SIDE}");
        return Err(Error::malformed(message));
    }
    // Far beyond every lens; products of such numbers are still finite.
    let sane = |v: DVec2| v.is_finite() && v.abs().max_element() < 1e9;
    if !(sane(focal) && sane(center) && focal.min_element() > 1e-3 && distortion.is_valid()) {
        let message =
            "a parameter of the lens is not finite or far out of range, or a focal length is not above 0";
        return Err(Error::malformed(message));
    }
    Ok(PhotoCamera { size: [width as u32, height as u32], focal, center, lens: Lens::new(distortion) })
}

/// A pose of COLMAP's numbers: quaternion `w, x, y, z` and translation, world to camera.
pub(crate) fn pose_of_quaternion([w, x, y, z]: [f64; 4], translation: [f64; 3]) -> Result<CameraFromWorld> {
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let translation = DVec3::from(translation);
    let length = quaternion.length();
    if !(quaternion.is_finite() && (1e-6..1e6).contains(&length)) {
        return Err(no_pose("its quaternion is zero or not finite"));
    }
    if !translation.is_finite() {
        return Err(no_pose("its translation is not finite"));
    }
    Ok(CameraFromWorld { rotation: DMat3::from_quat(quaternion.normalize()), translation })
}

// ---- What is wrong with files of cameras.

fn syntax(expected: &str, found: &str) -> Error {
    let found: String = found.chars().take(40).collect();
    Error::malformed(format!("expected {expected}, found '{found}'"))
}

fn truncated(what: &str) -> Error {
    Error::malformed(format!("the file ends here, in the middle of {what}"))
}

fn bad_name(what: &str) -> Error {
    Error::malformed(format!("the name of a photograph is {what}"))
}

fn unknown_camera(name: &str, camera: u32) -> Error {
    Error::malformed(format!(
        "the photograph '{name}' is of camera {camera}, which is not in the file of cameras"
    ))
}

fn two_cameras(camera: u32) -> Error {
    Error::malformed(format!("there are two cameras {camera}"))
}

fn too_many(what: &str, limit: usize) -> Error {
    Error::too_large(format!("more than {limit} {what}"))
}

fn no_photographs(path: &Path) -> Error {
    Error::malformed(format!("{} names no photograph", path.display())).with_path(path)
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
