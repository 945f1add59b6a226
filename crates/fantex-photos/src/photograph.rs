//! A photograph and the camera that took it.

use std::path::PathBuf;

use glam::{DMat3, DVec2, DVec3};

use crate::{Distortion, Lens, OnPlane};

/// A calibrated camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoCamera {
    /// Width and height in pixels, as the calibration knows them.
    pub size: [u32; 2],
    /// Focal lengths along x and y, pixels.
    pub focal: DVec2,
    /// Where the axis meets the picture, pixels from the top left corner (pixel centres at half integers).
    pub center: DVec2,
    /// The lens.
    pub lens: Lens,
}

/// Where a point is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnPicture {
    /// Pixels from the top left corner.
    pub pixel: DVec2,
    /// [`OnPlane::room`].
    pub room: f64,
}

impl PhotoCamera {
    /// A camera without distortion, its axis in the middle of the picture, square pixels.
    pub fn pinhole(size: [u32; 2], focal: f64) -> Self {
        let center = DVec2::from(size.map(f64::from)) * 0.5;
        Self { size, focal: DVec2::splat(focal), center, lens: Lens::new(Distortion::PINHOLE) }
    }

    /// Where a point of camera space is seen; it may lie outside of the picture.
    pub fn project(&self, p_camera: DVec3) -> Option<OnPicture> {
        let OnPlane { position, room } = self.lens.project(p_camera)?;
        Some(OnPicture { pixel: self.center + position * self.focal, room })
    }

    /// The unit direction, camera space, that is seen at a position in pixels.
    pub fn direction(&self, pixel: DVec2) -> Option<DVec3> {
        self.lens.direction((pixel - self.center) / self.focal)
    }
}

/// The rigid motion that takes world space to camera space: `p_camera = rotation * p_world + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraFromWorld {
    /// A rotation.
    pub rotation: DMat3,
    /// World units.
    pub translation: DVec3,
}

impl CameraFromWorld {
    /// A camera at `eye` that looks at `target`, both world space, with `up` upwards in the picture.
    pub fn looking_at(eye: DVec3, target: DVec3, up: DVec3) -> Self {
        let forward = (target - eye).try_normalize().unwrap_or(DVec3::NEG_Z);
        let right = forward.cross(up).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
        let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        Self { rotation, translation: -(rotation * eye) }
    }

    /// The pinhole, world space.
    pub fn eye(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }
}

/// One photograph of a set.
#[derive(Clone, Debug, PartialEq)]
pub struct Photograph {
    /// As the set of cameras names it.
    pub name: String,
    /// The image file.
    pub path: PathBuf,
    /// An image of the same shape that is black where the photograph is not to be used.
    pub mask: Option<PathBuf>,
    /// What took it.
    pub camera: PhotoCamera,
    /// Where it stood.
    pub camera_from_world: CameraFromWorld,
}

/// How far the sides' ratio of a picture may be from that of another one of the same shape, but for a rounded pixel.
const SHAPE_TOLERANCE: f64 = 0.01;

/// Whether a picture of so many pixels may be another one at another size.
pub(crate) fn have_one_shape(found: [u32; 2], expected: [u32; 2]) -> bool {
    let scale = DVec2::from(found.map(f64::from)) / DVec2::from(expected.map(f64::from));
    (scale.x / scale.y - 1.0).abs() <= SHAPE_TOLERANCE + 1.0 / f64::from(found[0].min(found[1]).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_look_where_they_are_told_to() {
        let pose =
            CameraFromWorld::looking_at(DVec3::new(0.0, 1.0, 5.0), DVec3::new(0.0, 1.0, 0.0), DVec3::Y);
        assert!((pose.eye() - DVec3::new(0.0, 1.0, 5.0)).length() < 1e-12);
        assert!((pose.rotation.determinant() - 1.0).abs() < 1e-12);
        let seen = |p: DVec3| {
            let camera = PhotoCamera::pinhole([200, 100], 100.0);
            camera.project(pose.rotation * p + pose.translation).unwrap().pixel
        };
        assert!((seen(DVec3::new(0.0, 1.0, 0.0)) - DVec2::new(100.0, 50.0)).length() < 1e-9);
        assert!(seen(DVec3::new(1.0, 1.0, 0.0)).x > 100.0, "+x is on the right of a camera on +z");
        assert!(seen(DVec3::new(0.0, 2.0, 0.0)).y < 50.0, "up is up");
    }
}
