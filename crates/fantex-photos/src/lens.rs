//! Lenses: from directions to the picture plane and back.
//!
//! *Camera space* is that of computer vision: x to the right, y downwards, z into the scene. The *picture plane* is at
//! distance 1: a pinhole takes `(x, y, z)` to `(x/z, y/z)`. Real lenses bend that. Three families are known here, all as OpenCV
//! and COLMAP write them:
//!
//! - rational radial and tangential distortion (D. C. Brown, "Decentering distortion of lenses", 1966);
//! - the equidistant fisheye with a polynomial of the angle (J. Kannala and S. Brandt, "A generic camera model and
//!   calibration method for conventional, wide-angle, and fish-eye lenses", 2006), and with the tangential and thin-prism terms
//!   of J. Weng, P. Cohen and M. Herniou ("Camera calibration with distortion models and accuracy evaluation", 1992);
//! - the field-of-view lens with one angle (F. Devernay and O. Faugeras, "Straight lines have to be straight", 2001).
//!
//! All of them bend points of a plane, a fisheye those of the plane on which the distance from the middle is the angle off the axis.
//! Polynomials are fitted inside of the picture. Farther out they may turn round and fold directions from
//! far outside back into the picture, so every lens knows the radius up to which it grows, and sees nothing beyond.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

/// How a lens bends directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// `n * (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)`, and the tangential shift of `p1`, `p2`; all
    /// zero for a pinhole.
    Perspective {
        /// `k1` to `k6`.
        radial: [f64; 6],
        /// `p1` and `p2`.
        tangential: [f64; 2],
    },
    /// `theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)` from the middle, for a direction that is `theta` off the axis,
    /// and the tangential and thin-prism shifts there.
    Fisheye {
        /// `k1` to `k4`.
        radial: [f64; 4],
        /// `p1` and `p2`.
        tangential: [f64; 2],
        /// `s1` and `s2`, which shift along x and y by `theta^2`.
        prism: [f64; 2],
    },
    /// `atan(2 r tan(omega / 2)) / omega` from the middle.
    FieldOfView {
        /// Radians, -pi to pi; at 0 a pinhole.
        omega: f64,
    },
}

impl Distortion {
    /// No distortion.
    pub const PINHOLE: Self = Self::Perspective { radial: [0.0; 6], tangential: [0.0; 2] };

    /// A fisheye without tangential and thin-prism shifts, by `k1` to `k4`.
    pub const fn fisheye(radial: [f64; 4]) -> Self {
        Self::Fisheye { radial, tangential: [0.0; 2], prism: [0.0; 2] }
    }

    pub(crate) fn is_valid(&self) -> bool {
        let are_finite = |numbers: &[f64]| numbers.iter().all(|k| k.is_finite());
        match self {
            Self::Perspective { radial, tangential } => are_finite(radial) && are_finite(tangential),
            Self::Fisheye { radial, tangential, prism } => {
                are_finite(radial) && are_finite(tangential) && are_finite(prism)
            }
            Self::FieldOfView { omega } => omega.abs() < PI,
        }
    }

    fn bend(&self, n: DVec2) -> DVec2 {
        let r2 = n.length_squared();
        let (tangential, prism) = match *self {
            Self::Perspective { tangential, .. } => (tangential, [0.0; 2]),
            Self::Fisheye { tangential, prism, .. } => (tangential, prism),
            Self::FieldOfView { .. } => ([0.0; 2], [0.0; 2]),
        };
        n * self.radial_factor(r2) + tangential_shift(n, r2, tangential) + DVec2::from(prism) * r2
    }

    /// The factor of the radial distortion, of a squared radius.
    fn radial_factor(&self, r2: f64) -> f64 {
        match self {
            Self::Perspective { radial: k, .. } => {
                (1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]))) / (1.0 + r2 * (k[3] + r2 * (k[4] + r2 * k[5])))
            }
            Self::Fisheye { radial: k, .. } => 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3]))),
            Self::FieldOfView { omega } => field_of_view_factor(r2, *omega),
        }
    }
}

/// A lens: a distortion, and how far out it can be trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    distortion: Distortion,
    /// On the plane that is bent: an angle for a fisheye.
    valid_radius: f64,
}

/// Where a direction meets the picture plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnPlane {
    /// The bent position, picture plane.
    pub position: DVec2,
    /// What is left of the lens' valid radius, 1 on the axis, 0 at its end.
    pub room: f64,
}

/// Perspective lenses see directions up to this angle off the axis, radians.
const MAX_PERSPECTIVE: f64 = 1.55;
/// Steps in which the valid radius is looked for.
const RADIUS_STEPS: u32 = 4096;
/// Newton's steps of the way back; three to five are enough in practice.
const MAX_STEPS: usize = 50;

impl Lens {
    /// A lens with this distortion.
    pub fn new(distortion: Distortion) -> Self {
        let mut lens = Self { distortion, valid_radius: f64::INFINITY };
        lens.valid_radius = lens.growing_radius();
        lens
    }

    /// How it bends.
    pub fn distortion(&self) -> Distortion {
        self.distortion
    }

    /// True for fisheyes, which may see to the side and behind.
    pub fn is_fisheye(&self) -> bool {
        matches!(self.distortion, Distortion::Fisheye { .. })
    }

    /// Nothing is seen farther off the axis, radians.
    pub(crate) fn valid_angle(&self) -> f64 {
        if self.is_fisheye() { self.valid_radius } else { self.valid_radius.atan() }
    }

    /// The depth that pictures of this lens order surfaces by: along the axis for a perspective lens (its inverse is then
    /// linear over the picture of a plane), the distance for a fisheye.
    pub fn depth(&self, p_camera: DVec3) -> f64 {
        if self.is_fisheye() { p_camera.length() } else { p_camera.z }
    }

    /// Where a point of camera space is seen; `None` behind a perspective lens and beyond the valid radius.
    pub fn project(&self, p_camera: DVec3) -> Option<OnPlane> {
        let n = self.on_plane(p_camera)?;
        let position = self.distortion.bend(n);
        let room = 1.0 - n.length() / self.valid_radius;
        (room > 0.0 && position.is_finite()).then_some(OnPlane { position, room })
    }

    /// The unit direction that is seen at a position of the picture plane; `None` where no valid direction is.
    pub fn direction(&self, position: DVec2) -> Option<DVec3> {
        let n = self.straight(position)?;
        let direction = if self.is_fisheye() {
            let theta = n.length().min(PI);
            (n.normalize_or_zero() * theta.sin()).extend(theta.cos())
        } else {
            n.extend(1.0).normalize()
        };
        let back = self.project(direction)?;
        ((back.position - position).length() < 1e-6).then_some(direction)
    }

    fn on_plane(&self, p_camera: DVec3) -> Option<DVec2> {
        let across = p_camera.truncate();
        if !self.is_fisheye() {
            return (p_camera.z > 0.0).then(|| across / p_camera.z);
        }
        let length = across.length();
        if length == 0.0 {
            return (p_camera.z > 0.0).then_some(DVec2::ZERO);
        }
        Some(across * (length.atan2(p_camera.z) / length))
    }

    /// The inverse of [`Distortion::bend`], by Newton's method with differences for derivatives.
    fn straight(&self, position: DVec2) -> Option<DVec2> {
        let at = |n: DVec2| self.distortion.bend(n);
        let mut n = position;
        for _ in 0..MAX_STEPS {
            let h = 1e-6;
            let dx = (at(n + DVec2::X * h) - at(n - DVec2::X * h)) / (2.0 * h);
            let dy = (at(n + DVec2::Y * h) - at(n - DVec2::Y * h)) / (2.0 * h);
            let determinant = dx.perp_dot(dy);
            let off = at(n) - position;
            let step = DVec2::new(off.perp_dot(dy), dx.perp_dot(off)) / determinant;
            if !step.is_finite() {
                return None;
            }
            // Shortened, so that strong lenses do not throw it out of the valid radius.
            n -= step.clamp_length_max(0.5);
            if step.length_squared() < 1e-24 {
                break;
            }
        }
        Some(n)
    }

    /// How far out the distorted radius grows with the radius.
    fn growing_radius(&self) -> f64 {
        let widest = if self.is_fisheye() { PI } else { MAX_PERSPECTIVE };
        let mut before = [0.0; 2];
        for step in 1..=RADIUS_STEPS {
            let angle = widest * f64::from(step) / f64::from(RADIUS_STEPS);
            let radius = if self.is_fisheye() { angle } else { angle.tan() };
            let bent = radius * self.distortion.radial_factor(radius * radius);
            if bent.is_nan() || bent <= before[1] {
                return before[0];
            }
            before = [radius, bent];
        }
        before[0]
    }
}

/// `atan(2 r tan(omega / 2)) / (r omega)`, of a squared radius.
fn field_of_view_factor(r2: f64, omega: f64) -> f64 {
    // Below, series lose fewer digits than quotients of small numbers.
    const SMALL: f64 = 1e-8;
    let stretch = if omega.abs() < SMALL { 1.0 } else { 2.0 * (0.5 * omega).tan() / omega };
    let argument = 2.0 * r2.sqrt() * (0.5 * omega).tan();
    let flattening =
        if argument.abs() < 1e-4 { 1.0 - argument * argument / 3.0 } else { argument.atan() / argument };
    stretch * flattening
}

/// The shift of lens elements whose middles are not on one line.
fn tangential_shift(n: DVec2, r2: f64, [p1, p2]: [f64; 2]) -> DVec2 {
    DVec2::new(
        2.0 * p1 * n.x * n.y + p2 * (r2 + 2.0 * n.x * n.x),
        p1 * (r2 + 2.0 * n.y * n.y) + 2.0 * p2 * n.x * n.y,
    )
}
