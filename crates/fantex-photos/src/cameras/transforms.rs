//! `transforms.json`: cameras as NeRF's data sets and nerfstudio write them.
//!
//! Matrices take camera to world space, with OpenGL's camera axes: x to the right, y upwards, z towards the viewer. What describes the
//! camera may stand at the top for all frames or in each frame.

use std::fmt::Write as _;
use std::io::{self, BufReader, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use fantex_base::files::write_whole;
use fantex_base::input::{self, check_below, check_inside};
use fantex_base::{Error, Place, Result, json_problem};
use glam::{DMat3, DQuat, DVec2, DVec3};
use image::{ImageError, ImageFormat, ImageReader};
use serde::Deserialize;
use serde_json::{Value, json};

use super::{
    CameraFrame, MAX_ENTRIES, MODELS, checked_camera, checked_name, mask_beside, no_photographs, no_pose,
    open_within, too_many, unknown_model,
};
use crate::{CameraFromWorld, Distortion, PhotoCamera, Photograph};

const MAX_BYTES: u64 = 256 << 20;
/// How far the columns of a rotation may be from orthonormal: files are written with few digits.
const ROTATION_TOLERANCE: f64 = 1e-2;
const EXTENSIONS: [&str; 6] = ["png", "jpg", "jpeg", "JPG", "PNG", "exr"];

#[derive(Debug, Deserialize)]
struct Document {
    #[serde(flatten)]
    camera: Intrinsics,
    frames: Vec<Frame>,
    /// How the cameras were moved before they were written: three or four rows of four numbers.
    applied_transform: Option<Vec<Vec<f64>>>,
    /// By what they were scaled after that.
    applied_scale: Option<f64>,
}

#[derive(Debug, Deserialize)]
struct Frame {
    file_path: String,
    mask_path: Option<String>,
    transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    camera: Intrinsics,
}

#[derive(Clone, Debug, Default, Deserialize)]
struct Intrinsics {
    camera_model: Option<String>,
    /// instant-ngp's word for OpenCV's fisheye.
    is_fisheye: Option<bool>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    k5: Option<f64>,
    k6: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

pub(super) fn read(path: &Path, images: Option<&Path>, camera_frame: CameraFrame) -> Result<Vec<Photograph>> {
    let failed = |source| Error::reading(path, source);
    let mut text = Vec::new();
    open_within(path, MAX_BYTES)?.take(MAX_BYTES).read_to_end(&mut text).map_err(failed)?;
    let document: Document = serde_json::from_slice(&text).map_err(|source| {
        let problem = json_problem(&text, &source);
        problem.context(format_args!("{} is no transforms.json", path.display())).with_path(path)
    })?;
    if document.frames.is_empty() {
        return Err(no_photographs(path));
    }
    let wrong =
        |frame: usize, problem: Error| problem.at(Place::Item(format!("frame {frame}"))).in_file(path);
    if document.frames.len() > MAX_ENTRIES {
        let problem = too_many("photographs", MAX_ENTRIES);
        return Err(wrong(MAX_ENTRIES, problem));
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let moved = match camera_frame {
        CameraFrame::OfFile => Moved::NOT,
        CameraFrame::Original => {
            document.moved().ok_or_else(|| {
                Error::malformed(format!(
                    "{}: its applied_transform is not a rotation and a translation, or its applied_scale is not positive; leave \
                     out frame=original and bring the model into the coordinates of the cameras",
                    path.display()
                ))
                .with_path(path)
            })?
        }
    };
    let frames = document.frames.iter().enumerate();
    frames
        .map(|(i, frame)| {
            frame.check_places(path, images)?;
            let photograph = frame.photograph(&document.camera, folder, images).map_err(|p| wrong(i, p))?;
            Ok(Photograph { camera_from_world: moved.undone(photograph.camera_from_world), ..photograph })
        })
        .collect()
}

/// How cameras were moved: `p_file = scale * (rotation * p_original + translation)`.
struct Moved {
    rotation: DMat3,
    translation: DVec3,
    scale: f64,
}

impl Moved {
    const NOT: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO, scale: 1.0 };

    /// The pose of a camera before it was moved. Its own space is scaled with the world, which changes no picture.
    fn undone(&self, pose: CameraFromWorld) -> CameraFromWorld {
        CameraFromWorld {
            rotation: pose.rotation * self.rotation,
            translation: pose.rotation * self.translation + pose.translation / self.scale,
        }
    }
}

impl Document {
    /// None where it is no motion.
    fn moved(&self) -> Option<Moved> {
        let scale = self.applied_scale.unwrap_or(1.0);
        let (axes, translation) = match &self.applied_transform {
            None => (DMat3::IDENTITY, DVec3::ZERO),
            Some(rows) => columns(rows)?,
        };
        (is_rotation(axes) && translation.is_finite() && scale.is_finite() && scale > 0.0).then_some(Moved {
            rotation: axes,
            translation,
            scale,
        })
    }
}

impl Frame {
    /// # Errors
    /// A name leads out of its folder. Where the folder of photographs is given, [`image_path`] has names without their own folders.
    fn check_places(&self, path: &Path, images: Option<&Path>) -> Result<()> {
        let photograph = images.is_none().then_some(&self.file_path);
        [photograph, self.mask_path.as_ref()]
            .into_iter()
            .flatten()
            .try_for_each(|name| check_inside(path, Path::new(name)))
    }

    fn photograph(&self, shared: &Intrinsics, folder: &Path, images: Option<&Path>) -> Result<Photograph> {
        let name = checked_name(&self.file_path)?;
        let path = image_path(&name, folder, images);
        let camera = self.camera.clone().or(shared).camera(&path)?;
        let mask = match &self.mask_path {
            Some(mask) => Some(folder.join(checked_name(mask)?)),
            None => images.and_then(|images| mask_beside(images, &name)),
        };
        Ok(Photograph { camera, camera_from_world: pose(&self.transform_matrix)?, name, path, mask })
    }
}

/// Where a photograph is. With a folder given, the name is looked for there with and without its own folders.
fn image_path(name: &str, folder: &Path, images: Option<&Path>) -> PathBuf {
    let places = match images {
        None => vec![folder.join(name)],
        Some(images) => {
            let file_name = Path::new(name).file_name().unwrap_or_default();
            let whole = check_below(images, images, Path::new(name)).is_ok().then(|| images.join(name));
            whole.into_iter().chain([images.join(file_name)]).collect()
        }
    };
    let with_extensions = places.iter().flat_map(|place| {
        let extended = |extension: &&str| PathBuf::from(format!("{}.{extension}", place.display()));
        std::iter::once(place.clone()).chain(EXTENSIONS.iter().map(extended))
    });
    let missing = places[places.len() - 1].clone();
    with_extensions.into_iter().find(|path| path.is_file()).unwrap_or(missing)
}

impl Intrinsics {
    /// What a frame does not say itself is said for all.
    fn or(self, shared: &Self) -> Self {
        // An angle at the top must not go before a focal length of the frame, nor the other way round.
        let has_focal = self.fl_x.is_some() || self.camera_angle_x.is_some();
        let focal = |shared: Option<f64>| if has_focal { None } else { shared };
        Self {
            camera_model: self.camera_model.or_else(|| shared.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(shared.is_fisheye),
            camera_angle_x: self.camera_angle_x.or(focal(shared.camera_angle_x)),
            camera_angle_y: self.camera_angle_y.or(focal(shared.camera_angle_y)),
            fl_x: self.fl_x.or(focal(shared.fl_x)),
            fl_y: self.fl_y.or(focal(shared.fl_y)),
            cx: self.cx.or(shared.cx),
            cy: self.cy.or(shared.cy),
            w: self.w.or(shared.w),
            h: self.h.or(shared.h),
            k1: self.k1.or(shared.k1),
            k2: self.k2.or(shared.k2),
            k3: self.k3.or(shared.k3),
            k4: self.k4.or(shared.k4),
            k5: self.k5.or(shared.k5),
            k6: self.k6.or(shared.k6),
            p1: self.p1.or(shared.p1),
            p2: self.p2.or(shared.p2),
        }
    }

    fn camera(&self, path: &Path) -> Result<PhotoCamera> {
        let size = match (self.w, self.h) {
            (Some(width), Some(height)) => [width, height],
            _ => picture_size(path)?.map(f64::from),
        };
        let of_angle = |angle: Option<f64>, side: f64| angle.map(|angle| 0.5 * side / (0.5 * angle).tan());
        let focal_x = self
            .fl_x
            .or(of_angle(self.camera_angle_x, size[0]))
            .ok_or_else(|| Error::malformed("there is no focal length: expected fl_x or camera_angle_x"))?;
        let focal_y = self.fl_y.or(of_angle(self.camera_angle_y, size[1])).unwrap_or(focal_x);
        let center = DVec2::new(self.cx.unwrap_or(0.5 * size[0]), self.cy.unwrap_or(0.5 * size[1]));
        // Numbers that are no sizes become 0 here, and are refused with it.
        let size = size.map(|side| if side.fract() == 0.0 { side.max(0.0) as u64 } else { 0 });
        checked_camera(size, DVec2::new(focal_x, focal_y), center, self.distortion()?)
    }

    fn distortion(&self) -> Result<Distortion> {
        let k = [self.k1, self.k2, self.k3, self.k4, self.k5, self.k6].map(|k| k.unwrap_or(0.0));
        let unnamed = if self.is_fisheye == Some(true) { "OPENCV_FISHEYE" } else { "OPENCV" };
        match self.camera_model.as_deref().unwrap_or(unnamed) {
            "SIMPLE_PINHOLE" | "PINHOLE" => Ok(Distortion::PINHOLE),
            // In files of nerfstudio, k4 is left over from other models; the polynomial's denominator is FULL_OPENCV's.
            "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" => Ok(Distortion::Perspective {
                radial: [k[0], k[1], k[2], 0.0, 0.0, 0.0],
                tangential: [self.p1.unwrap_or(0.0), self.p2.unwrap_or(0.0)],
            }),
            "FULL_OPENCV" => Ok(Distortion::Perspective {
                radial: k,
                tangential: [self.p1.unwrap_or(0.0), self.p2.unwrap_or(0.0)],
            }),
            "OPENCV_FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" => {
                Ok(Distortion::fisheye([k[0], k[1], k[2], k[3]]))
            }
            name => Err(unknown_model(name, &known_models())),
        }
    }
}

/// The camera models of COLMAP that a `transforms.json` has no keys for.
const COLMAP_ONLY: [&str; 2] = ["FOV", "THIN_PRISM_FISHEYE"];

fn known_models() -> String {
    let known: Vec<&str> = MODELS.iter().map(|m| m.name).filter(|name| !COLMAP_ONLY.contains(name)).collect();
    let (known, others) = (known.join(", "), COLMAP_ONLY.join(" and "));
    format!("{known}; COLMAP's files hold {others}, too")
}

/// Width and height of a photograph, as its header tells them.
fn picture_size(path: &Path) -> Result<[u32; 2]> {
    let failed = |source: ImageError| {
        let name = path.display();
        Error::malformed(format!("w and h are not given, and the size of {name} cannot be read: {source}"))
            .with_source(source)
    };
    let file = input::open(path).map_err(|source| failed(source.into()))?;
    let mut reader = ImageReader::new(BufReader::new(file));
    // Where the first bytes do not tell the format, the name does.
    if let Ok(format) = ImageFormat::from_path(path) {
        reader.set_format(format);
    }
    let size = || reader.with_guessed_format()?.into_dimensions();
    let damaged =
        || Err(ImageError::IoError(io::Error::new(ErrorKind::InvalidData, "its header is damaged")));
    input::guarded(size).unwrap_or_else(damaged).map(<[u32; 2]>::from).map_err(failed)
}

/// The inverse of a matrix that takes camera to world, with y and z turned round.
fn pose(rows: &[Vec<f64>]) -> Result<CameraFromWorld> {
    let (axes, eye) =
        columns(rows).ok_or_else(|| no_pose("transform_matrix has not four rows of four numbers"))?;
    if !(is_rotation(axes) && eye.is_finite()) {
        return Err(no_pose("the columns of transform_matrix are no right-handed frame of unit vectors"));
    }
    let x = axes.x_axis.normalize();
    let z = x.cross(axes.y_axis).normalize();
    let rotation = DMat3::from_cols(x, -z.cross(x), -z).transpose();
    Ok(CameraFromWorld { rotation, translation: -(rotation * eye) })
}

/// The linear part and the last column of three or four rows of four numbers.
fn columns(rows: &[Vec<f64>]) -> Option<(DMat3, DVec3)> {
    if !(3..=4).contains(&rows.len()) || rows.iter().any(|row| row.len() != 4) {
        return None;
    }
    let column = |k: usize| DVec3::new(rows[0][k], rows[1][k], rows[2][k]);
    Some((DMat3::from_cols(column(0), column(1), column(2)), column(3)))
}

/// Whether axes are orthonormal and right-handed, but for a few digits.
fn is_rotation(axes: DMat3) -> bool {
    let off = axes.transpose() * axes - DMat3::IDENTITY;
    let is_small = off.to_cols_array().into_iter().all(|e| e.abs() < ROTATION_TOLERANCE);
    axes.is_finite() && is_small && axes.determinant() > 0.0
}

// ---- Cameras to files.

/// Writes `cameras.txt`, `images.txt` and an empty `points3D.txt` into a folder, one camera per photograph.
///
/// # Errors
/// A file cannot be written.
pub fn write_colmap_text(folder: &Path, photographs: &[Photograph]) -> Result<()> {
    let mut cameras = "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n".to_owned();
    let mut images =
        "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n".to_owned();
    for (number, photograph) in (1..).zip(photographs) {
        let (model, _, parameters) = parameters(&photograph.camera);
        let [width, height] = photograph.camera.size;
        let numbers = joined(&parameters);
        let pose_numbers = joined(&pose_numbers(photograph));
        // Writing to a string does not fail.
        let _infallible = writeln!(cameras, "{number} {model} {width} {height} {numbers}");
        let _infallible = writeln!(images, "{number} {pose_numbers} {number} {}\n", photograph.name);
    }
    write(folder.join("cameras.txt"), cameras.as_bytes())?;
    write(folder.join("images.txt"), images.as_bytes())?;
    write(folder.join("points3D.txt"), b"# POINT3D_ID X Y Z R G B ERROR TRACK[]\n")
}

/// Writes `cameras.bin`, `images.bin` and an empty `points3D.bin` into a folder, one camera per photograph.
///
/// # Errors
/// A file cannot be written.
pub fn write_colmap_binary(folder: &Path, photographs: &[Photograph]) -> Result<()> {
    let count = (photographs.len() as u64).to_le_bytes();
    let (mut cameras, mut images) = (count.to_vec(), count.to_vec());
    for (number, photograph) in (1_u32..).zip(photographs) {
        let (_, model, parameters) = parameters(&photograph.camera);
        cameras.extend(number.to_le_bytes());
        cameras.extend(model.to_le_bytes());
        cameras.extend(photograph.camera.size.iter().flat_map(|&side| u64::from(side).to_le_bytes()));
        cameras.extend(parameters.iter().flat_map(|p| p.to_le_bytes()));
        images.extend(number.to_le_bytes());
        images.extend(pose_numbers(photograph).iter().flat_map(|p| p.to_le_bytes()));
        images.extend(number.to_le_bytes());
        images.extend(photograph.name.bytes().chain([0]));
        images.extend(0_u64.to_le_bytes());
    }
    write(folder.join("cameras.bin"), &cameras)?;
    write(folder.join("images.bin"), &images)?;
    write(folder.join("points3D.bin"), &0_u64.to_le_bytes())
}

/// Writes a `transforms.json`; the names of the photographs are taken as paths relative to it, below `image_folder`.
///
/// # Errors
/// The file cannot be written, or there are lenses that such a file cannot hold: fisheyes beside others, fisheyes with tangential
/// or thin-prism shifts, field-of-view lenses.
pub fn write_transforms(path: &Path, photographs: &[Photograph], image_folder: &str) -> Result<()> {
    let fisheyes = photographs.iter().filter(|p| p.camera.lens.is_fisheye()).count();
    if fisheyes != 0 && fisheyes != photographs.len() {
        return Err(unwritable_lenses());
    }
    let frames = photographs.iter().map(|photograph| frame(photograph, image_folder));
    let frames: Vec<Value> = frames.collect::<Option<_>>().ok_or_else(unwritable_lenses)?;
    let document = json!({
        "camera_model": if fisheyes == 0 { "OPENCV" } else { "OPENCV_FISHEYE" },
        "frames": frames,
    });
    write(path.into(), format!("{document:#}\n").as_bytes())
}

/// `None` for a lens that has no place there.
fn frame(photograph: &Photograph, image_folder: &str) -> Option<Value> {
    let PhotoCamera { size, focal, center, lens } = photograph.camera;
    let world_from_camera = photograph.camera_from_world.rotation.transpose();
    let gl = world_from_camera * DMat3::from_diagonal(glam::DVec3::new(1.0, -1.0, -1.0));
    let eye = photograph.camera_from_world.eye();
    let row = |k: usize| [gl.x_axis[k], gl.y_axis[k], gl.z_axis[k], eye[k]];
    let mut frame = json!({
        "file_path": format!("{image_folder}/{}", photograph.name),
        "w": size[0], "h": size[1],
        "fl_x": focal.x, "fl_y": focal.y, "cx": center.x, "cy": center.y,
        "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
    });
    match lens.distortion() {
        Distortion::Perspective { radial, tangential } => {
            for (name, value) in ["k1", "k2", "k3"].into_iter().zip(radial) {
                frame[name] = value.into();
            }
            frame["p1"] = tangential[0].into();
            frame["p2"] = tangential[1].into();
            if radial[3..] != [0.0; 3] {
                frame["camera_model"] = "FULL_OPENCV".into();
                for (name, value) in ["k4", "k5", "k6"].into_iter().zip(&radial[3..]) {
                    frame[name] = (*value).into();
                }
            }
        }
        Distortion::Fisheye { radial, tangential: [0.0, 0.0], prism: [0.0, 0.0] } => {
            for (name, value) in ["k1", "k2", "k3", "k4"].into_iter().zip(radial) {
                frame[name] = value.into();
            }
        }
        Distortion::Fisheye { .. } | Distortion::FieldOfView { .. } => return None,
    }
    Some(frame)
}

/// The simplest model that holds a camera: name, number, parameters.
fn parameters(camera: &PhotoCamera) -> (&'static str, i32, Vec<f64>) {
    let PhotoCamera { focal: f, center: c, lens, .. } = camera;
    let start = [f.x, f.y, c.x, c.y];
    match lens.distortion() {
        distortion if distortion == Distortion::PINHOLE => ("PINHOLE", 1, start.to_vec()),
        Distortion::Perspective { radial: [k1, k2, 0.0, 0.0, 0.0, 0.0], tangential } => {
            ("OPENCV", 4, [&start[..], &[k1, k2], &tangential].concat())
        }
        Distortion::Perspective { radial: [k1, k2, rest @ ..], tangential } => {
            ("FULL_OPENCV", 6, [&start[..], &[k1, k2], &tangential, &rest].concat())
        }
        Distortion::Fisheye { radial, tangential: [0.0, 0.0], prism: [0.0, 0.0] } => {
            ("OPENCV_FISHEYE", 5, [&start[..], &radial].concat())
        }
        Distortion::Fisheye { radial: [k1, k2, k3, k4], tangential, prism } => {
            let numbers = [&start[..], &[k1, k2], &tangential, &[k3, k4], &prism].concat();
            ("THIN_PRISM_FISHEYE", 10, numbers)
        }
        Distortion::FieldOfView { omega } => ("FOV", 7, [&start[..], &[omega]].concat()),
    }
}

/// Quaternion `w, x, y, z` and translation.
fn pose_numbers(photograph: &Photograph) -> [f64; 7] {
    let q = DQuat::from_mat3(&photograph.camera_from_world.rotation);
    let t = photograph.camera_from_world.translation;
    [q.w, q.x, q.y, q.z, t.x, t.y, t.z]
}

fn joined(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

fn write(path: PathBuf, bytes: &[u8]) -> Result<()> {
    write_whole(&path, true, |out| out.write_all(bytes))
}

fn unwritable_lenses() -> Error {
    Error::unsupported(
        "transforms.json cannot hold fisheyes beside other lenses, thin prisms or field-of-view lenses; write COLMAP's files \
         instead",
    )
}
