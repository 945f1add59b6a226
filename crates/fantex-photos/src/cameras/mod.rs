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
use std::io;
use std::path::{Component, Path, PathBuf};

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::{CameraFromWorld, Distortion, Lens, PhotoCamera, Photograph};

pub use self::transforms::{write_colmap_binary, write_colmap_text, write_transforms};

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
            let cameras = colmap::read_binary_cameras(&cameras)?;
            let listed = colmap::read_binary_images(&images_file, &cameras)?;
            return located(listed, &cameras, &images_file, &image_folder(&model, images));
        }
        if has("cameras.txt") && has("images.txt") {
            let (cameras, images_file) = (model.join("cameras.txt"), model.join("images.txt"));
            let cameras = colmap::read_text_cameras(&cameras)?;
            let listed = colmap::read_text_images(&images_file, &cameras)?;
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

// ---- Camera models by name and number: what their parameters mean.

/// Longest side of a photograph in pixels.
pub(crate) const LONGEST_SIDE: u64 = 1 << 16;

/// What is wrong with a camera.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraProblem {
    /// A model that is not known here.
    #[error(
        "the camera model '{name}' is not supported (known: {}); undistort the photographs first, for example with \
         'colmap image_undistorter'",
        known_models()
    )]
    UnknownModel {
        /// Name or number, as the file says it.
        name: String,
    },
    /// Not as many parameters as the model has.
    #[error("{model} has {expected} parameters, not {found}")]
    ParameterCount {
        /// The model.
        model: &'static str,
        /// How many it has.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// A side of the picture is zero or absurdly long.
    #[error("the picture has {width} x {height} pixels, but a side must be 1 to {LONGEST_SIDE}")]
    Size {
        /// Columns.
        width: u64,
        /// Rows.
        height: u64,
    },
    /// A parameter that is no number, or a focal length that is not positive.
    #[error("a parameter of the lens is not finite or far out of range, or a focal length is not above 0")]
    Parameters,
    /// A position or rotation that is none.
    #[error("the camera's place is no rotation and translation: {0}")]
    Pose(&'static str),
}

/// One of COLMAP's camera models.
#[derive(Debug)]
pub(crate) struct CameraModel {
    pub(crate) name: &'static str,
    pub(crate) number: i32,
    pub(crate) parameters: usize,
    /// Whether x and y have a focal length each.
    two_focals: bool,
    lens: fn(&[f64]) -> Distortion,
}

fn perspective<const N: usize>(radial: [f64; N], tangential: [f64; 2]) -> Distortion {
    let mut all = [0.0; 6];
    all[..N].copy_from_slice(&radial);
    Distortion::Perspective { radial: all, tangential }
}

/// The models that are known, with the numbers that binary files use.
pub(crate) const MODELS: [CameraModel; 11] = [
    CameraModel {
        name: "SIMPLE_PINHOLE",
        number: 0,
        parameters: 3,
        two_focals: false,
        lens: |_| Distortion::PINHOLE,
    },
    CameraModel {
        name: "PINHOLE",
        number: 1,
        parameters: 4,
        two_focals: true,
        lens: |_| Distortion::PINHOLE,
    },
    CameraModel {
        name: "SIMPLE_RADIAL",
        number: 2,
        parameters: 4,
        two_focals: false,
        lens: |k| perspective([k[0]], [0.0; 2]),
    },
    CameraModel {
        name: "RADIAL",
        number: 3,
        parameters: 5,
        two_focals: false,
        lens: |k| perspective([k[0], k[1]], [0.0; 2]),
    },
    CameraModel {
        name: "OPENCV",
        number: 4,
        parameters: 8,
        two_focals: true,
        lens: |k| perspective([k[0], k[1]], [k[2], k[3]]),
    },
    CameraModel {
        name: "OPENCV_FISHEYE",
        number: 5,
        parameters: 8,
        two_focals: true,
        lens: |k| Distortion::fisheye([k[0], k[1], k[2], k[3]]),
    },
    CameraModel {
        name: "FULL_OPENCV",
        number: 6,
        parameters: 12,
        two_focals: true,
        lens: |k| perspective([k[0], k[1], k[4], k[5], k[6], k[7]], [k[2], k[3]]),
    },
    CameraModel {
        name: "FOV",
        number: 7,
        parameters: 5,
        two_focals: true,
        lens: |k| Distortion::FieldOfView { omega: k[0] },
    },
    CameraModel {
        name: "SIMPLE_RADIAL_FISHEYE",
        number: 8,
        parameters: 4,
        two_focals: false,
        lens: |k| Distortion::fisheye([k[0], 0.0, 0.0, 0.0]),
    },
    CameraModel {
        name: "RADIAL_FISHEYE",
        number: 9,
        parameters: 5,
        two_focals: false,
        lens: |k| Distortion::fisheye([k[0], k[1], 0.0, 0.0]),
    },
    CameraModel {
        name: "THIN_PRISM_FISHEYE",
        number: 10,
        parameters: 12,
        two_focals: true,
        lens: |k| Distortion::Fisheye {
            radial: [k[0], k[1], k[4], k[5]],
            tangential: [k[2], k[3]],
            prism: [k[6], k[7]],
        },
    },
];

fn known_models() -> String {
    MODELS.map(|m| m.name).join(", ")
}

impl CameraModel {
    pub(crate) fn by_name(name: &str) -> Result<&'static Self, CameraProblem> {
        let unknown = || CameraProblem::UnknownModel { name: name.chars().take(40).collect() };
        MODELS.iter().find(|m| m.name == name).ok_or_else(unknown)
    }

    pub(crate) fn by_number(number: i32) -> Result<&'static Self, CameraProblem> {
        let unknown = || CameraProblem::UnknownModel { name: number.to_string() };
        MODELS.iter().find(|m| m.number == number).ok_or_else(unknown)
    }

    /// The camera with these parameters: focal lengths, middle, distortion.
    pub(crate) fn camera(&self, size: [u64; 2], parameters: &[f64]) -> Result<PhotoCamera, CameraProblem> {
        if parameters.len() != self.parameters {
            let (expected, found) = (self.parameters, parameters.len());
            return Err(CameraProblem::ParameterCount { model: self.name, expected, found });
        }
        let (focal, rest) = match self.two_focals {
            true => (DVec2::new(parameters[0], parameters[1]), &parameters[2..]),
            false => (DVec2::splat(parameters[0]), &parameters[1..]),
        };
        checked_camera(size, focal, DVec2::new(rest[0], rest[1]), (self.lens)(&rest[2..]))
    }
}

/// A camera of numbers from a file.
pub(crate) fn checked_camera(
    size: [u64; 2],
    focal: DVec2,
    center: DVec2,
    distortion: Distortion,
) -> Result<PhotoCamera, CameraProblem> {
    let [width, height] = size;
    if size.iter().any(|side| !(1..=LONGEST_SIDE).contains(side)) {
        return Err(CameraProblem::Size { width, height });
    }
    // Far beyond every lens; products of such numbers are still finite.
    let sane = |v: DVec2| v.is_finite() && v.abs().max_element() < 1e9;
    if !(sane(focal) && sane(center) && focal.min_element() > 1e-3 && distortion.is_valid()) {
        return Err(CameraProblem::Parameters);
    }
    Ok(PhotoCamera { size: [width as u32, height as u32], focal, center, lens: Lens::new(distortion) })
}

/// A pose of COLMAP's numbers: quaternion `w, x, y, z` and translation, world to camera.
pub(crate) fn pose_of_quaternion(
    [w, x, y, z]: [f64; 4],
    translation: [f64; 3],
) -> Result<CameraFromWorld, CameraProblem> {
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let translation = DVec3::from(translation);
    let length = quaternion.length();
    if !(quaternion.is_finite() && (1e-6..1e6).contains(&length)) {
        return Err(CameraProblem::Pose("its quaternion is zero or not finite"));
    }
    if !translation.is_finite() {
        return Err(CameraProblem::Pose("its translation is not finite"));
    }
    Ok(CameraFromWorld { rotation: DMat3::from_quat(quaternion.normalize()), translation })
}

// ---- Why cameras could not be read or written.

/// Why the cameras of a set of photographs could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadCamerasError {
    /// The operating system refused.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// No set of cameras where one was looked for.
    #[error(
        "{} holds no cameras: expected cameras.bin and images.bin, or cameras.txt and images.txt, in it or in its \
         folder sparse/0, or a transforms.json", path.display()
    )]
    NoCameras {
        /// The folder.
        path: PathBuf,
    },
    /// More bytes than are read.
    #[error("{} has {bytes} bytes, more than the limit of {limit}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its length.
        bytes: u64,
        /// The limit.
        limit: u64,
    },
    /// A text file is wrong.
    #[error("{}, line {line}: {problem}", path.display())]
    Text {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        problem: EntryProblem,
    },
    /// A binary file is wrong.
    #[error("{}, byte {byte}: {problem}", path.display())]
    Binary {
        /// The file.
        path: PathBuf,
        /// Where the entry or number begins, from 0.
        byte: u64,
        /// What is wrong.
        problem: EntryProblem,
    },
    /// A JSON file is wrong; the parser names line and column.
    #[error("{} is no transforms.json: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What the parser found.
        source: serde_json::Error,
    },
    /// What a JSON file says about how its cameras were moved cannot be undone.
    #[error(
        "{}: its applied_transform is not a rotation and a translation, or its applied_scale is not positive; leave out \
         frame=original and bring the model into the coordinates of the cameras", path.display()
    )]
    AppliedTransform {
        /// The file.
        path: PathBuf,
    },
    /// A frame of a JSON file is wrong.
    #[error("{}, frame {frame}: {problem}", path.display())]
    Frame {
        /// The file.
        path: PathBuf,
        /// Its index, from 0.
        frame: usize,
        /// What is wrong.
        problem: EntryProblem,
    },
    /// Cameras, but not one photograph.
    #[error("{} names no photograph", path.display())]
    NoPhotographs {
        /// The file.
        path: PathBuf,
    },
    /// A mask that a file of cameras names is not there.
    #[error("the mask {} is missing; give it, or take its mask_path out of the file of cameras", path.display())]
    MissingMask {
        /// Where it should be.
        path: PathBuf,
    },
    /// Photographs that are not there.
    #[error(
        "{missing} of {total} photographs are missing, the first is {}; say where they are with images=FOLDER",
        first.display()
    )]
    MissingPhotographs {
        /// The first of them.
        first: PathBuf,
        /// How many are missing.
        missing: usize,
        /// How many there are in all.
        total: usize,
    },
}

/// What is wrong with an entry of a file of cameras.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EntryProblem {
    /// A camera that is none, or of an unknown kind.
    #[error(transparent)]
    Camera(#[from] CameraProblem),
    /// Words that are missing or no numbers.
    #[error("expected {expected}, found '{found}'")]
    Syntax {
        /// What the format prescribes.
        expected: &'static str,
        /// What stands there, shortened.
        found: String,
    },
    /// The file ends in the middle of an entry.
    #[error("the file ends here, in the middle of {what}")]
    Truncated {
        /// What it should hold.
        what: &'static str,
    },
    /// A name that is no name.
    #[error("the name of a photograph is {0}")]
    Name(&'static str),
    /// A reference to a camera that is not there.
    #[error("the photograph '{name}' is of camera {camera}, which is not in the file of cameras")]
    UnknownCamera {
        /// The photograph.
        name: String,
        /// The camera's number.
        camera: u32,
    },
    /// Two cameras of one number.
    #[error("there are two cameras {camera}")]
    Duplicate {
        /// The number.
        camera: u32,
    },
    /// More entries than are read.
    #[error("more than {limit} {what}")]
    TooMany {
        /// What there is too much of.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
    /// Nothing says how wide the lens sees.
    #[error("there is no focal length: expected fl_x or camera_angle_x")]
    NoFocalLength,
    /// The size of a picture is not said, and the picture cannot be asked.
    #[error("w and h are not given, and the size of {} cannot be read: {source}", path.display())]
    Size {
        /// The picture.
        path: PathBuf,
        /// What the decoder said.
        source: image::ImageError,
    },
}

/// Why a set of cameras could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteCamerasError {
    /// The operating system refused.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// Lenses that a `transforms.json` cannot hold.
    #[error(
        "transforms.json cannot hold fisheyes beside other lenses, thin prisms or field-of-view lenses; write COLMAP's files \
         instead"
    )]
    Lenses,
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

    #[test]
    fn parameters_mean_what_the_models_say() {
        let model = CameraModel::by_name("FULL_OPENCV").unwrap();
        let numbers: Vec<f64> = (1..=12).map(f64::from).collect();
        let camera = model.camera([8, 6], &numbers).unwrap();
        assert_eq!((camera.focal, camera.center), (DVec2::new(1.0, 2.0), DVec2::new(3.0, 4.0)));
        assert_eq!(
            camera.lens.distortion(),
            Distortion::Perspective { radial: [5.0, 6.0, 9.0, 10.0, 11.0, 12.0], tangential: [7.0, 8.0] }
        );
        let prism = CameraModel::by_name("THIN_PRISM_FISHEYE").unwrap().camera([8, 6], &numbers).unwrap();
        let expected = Distortion::Fisheye {
            radial: [5.0, 6.0, 9.0, 10.0],
            tangential: [7.0, 8.0],
            prism: [11.0, 12.0],
        };
        assert_eq!(prism.lens.distortion(), expected);
        for model in &MODELS {
            let mut numbers = vec![0.01; model.parameters];
            numbers[0] = 500.0;
            numbers[1] = 501.0;
            let camera = model.camera([8, 6], &numbers).unwrap();
            assert_eq!(camera.focal.x, 500.0);
            assert_eq!(camera.focal.y == 501.0, model.two_focals, "{}", model.name);
            assert_eq!(CameraModel::by_number(model.number).unwrap().name, model.name);
        }
    }

    #[test]
    fn bad_cameras_are_refused_in_a_sentence() {
        assert!(CameraModel::by_name("EUCM").unwrap_err().to_string().contains("'EUCM' is not supported"));
        assert!(CameraModel::by_number(99).unwrap_err().to_string().contains("'99' is not supported"));
        let wide = CameraModel::by_name("FOV").unwrap().camera([8, 6], &[1.0, 1.0, 4.0, 3.0, 3.2]);
        assert_eq!(wide.unwrap_err(), CameraProblem::Parameters);
        let pinhole = CameraModel::by_number(1).unwrap();
        let message = |size, numbers: &[f64]| pinhole.camera(size, numbers).unwrap_err().to_string();
        assert!(message([8, 6], &[1.0; 3]).contains("4 parameters, not 3"));
        assert!(message([0, 6], &[1.0; 4]).contains("0 x 6 pixels"));
        assert!(message([8, u64::MAX], &[1.0; 4]).contains("1 to 65536"));
        assert!(message([8, 6], &[f64::NAN, 1.0, 1.0, 1.0]).contains("not finite"));
        assert!(message([8, 6], &[-1.0, 1.0, 1.0, 1.0]).contains("above 0"));
        assert!(pose_of_quaternion([0.0; 4], [0.0; 3]).is_err());
        assert!(pose_of_quaternion([2.0, 0.0, 0.0, 0.0], [f64::INFINITY; 3]).is_err());
        assert_eq!(pose_of_quaternion([2.0, 0.0, 0.0, 0.0], [1.0; 3]).unwrap().rotation, DMat3::IDENTITY);
    }
}
