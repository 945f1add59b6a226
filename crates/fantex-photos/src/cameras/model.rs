//! Camera models by name and number: what their parameters mean.

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::{CameraFromWorld, Distortion, Lens, PhotoCamera};

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

#[cfg(test)]
mod tests {
    use super::*;

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
