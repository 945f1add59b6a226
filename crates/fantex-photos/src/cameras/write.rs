//! Cameras to files.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat};
use serde_json::{Value, json};

use super::WriteCamerasError;
use crate::{Distortion, PhotoCamera, Photograph};

/// Writes `cameras.txt`, `images.txt` and an empty `points3D.txt` into a folder, one camera per photograph.
///
/// # Errors
///
/// A file cannot be written.
pub fn write_colmap_text(folder: &Path, photographs: &[Photograph]) -> Result<(), WriteCamerasError> {
    let mut cameras = "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n".to_owned();
    let mut images =
        "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n".to_owned();
    for (number, photograph) in (1..).zip(photographs) {
        let (model, _, parameters) = parameters(&photograph.camera);
        let [width, height] = photograph.camera.size;
        let numbers = joined(&parameters);
        let pose = joined(&pose(photograph));
        // Writing to a string does not fail.
        let _infallible = writeln!(cameras, "{number} {model} {width} {height} {numbers}");
        let _infallible = writeln!(images, "{number} {pose} {number} {}\n", photograph.name);
    }
    write(folder.join("cameras.txt"), cameras.as_bytes())?;
    write(folder.join("images.txt"), images.as_bytes())?;
    write(folder.join("points3D.txt"), b"# POINT3D_ID X Y Z R G B ERROR TRACK[]\n")
}

/// Writes `cameras.bin`, `images.bin` and an empty `points3D.bin` into a folder, one camera per photograph.
///
/// # Errors
///
/// A file cannot be written.
pub fn write_colmap_binary(folder: &Path, photographs: &[Photograph]) -> Result<(), WriteCamerasError> {
    let count = (photographs.len() as u64).to_le_bytes();
    let (mut cameras, mut images) = (count.to_vec(), count.to_vec());
    for (number, photograph) in (1_u32..).zip(photographs) {
        let (_, model, parameters) = parameters(&photograph.camera);
        cameras.extend(number.to_le_bytes());
        cameras.extend(model.to_le_bytes());
        cameras.extend(photograph.camera.size.iter().flat_map(|&side| u64::from(side).to_le_bytes()));
        cameras.extend(parameters.iter().flat_map(|p| p.to_le_bytes()));
        images.extend(number.to_le_bytes());
        images.extend(pose(photograph).iter().flat_map(|p| p.to_le_bytes()));
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
///
/// The file cannot be written, or there are lenses that such a file cannot hold: fisheyes beside others, fisheyes with tangential
/// or thin-prism shifts, field-of-view lenses.
pub fn write_transforms(
    path: &Path,
    photographs: &[Photograph],
    image_folder: &str,
) -> Result<(), WriteCamerasError> {
    let fisheyes = photographs.iter().filter(|p| p.camera.lens.is_fisheye()).count();
    if fisheyes != 0 && fisheyes != photographs.len() {
        return Err(WriteCamerasError::Lenses);
    }
    let frames = photographs.iter().map(|photograph| frame(photograph, image_folder));
    let frames: Vec<Value> = frames.collect::<Option<_>>().ok_or(WriteCamerasError::Lenses)?;
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
fn pose(photograph: &Photograph) -> [f64; 7] {
    let q = DQuat::from_mat3(&photograph.camera_from_world.rotation);
    let t = photograph.camera_from_world.translation;
    [q.w, q.x, q.y, q.z, t.x, t.y, t.z]
}

fn joined(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

fn write(path: PathBuf, bytes: &[u8]) -> Result<(), WriteCamerasError> {
    std::fs::write(&path, bytes).map_err(|source| WriteCamerasError::Write { path, source })
}
