//! Lenses: from directions to the picture plane and back.
//!
//! *Camera space* is that of computer vision: x to the right, y downwards, z into the scene. The *picture plane* is at
//! distance 1: a pinhole takes `(x, y, z)` to `(x/z, y/z)`. Real lenses bend that. Two families are known here, both as OpenCV
//! and COLMAP write them:
//!
//! - rational radial and tangential distortion (D. C. Brown, "Decentering distortion of lenses", 1966);
//! - the equidistant fisheye with a polynomial of the angle (J. Kannala and S. Brandt, "A generic camera model and
//!   calibration method for conventional, wide-angle, and fish-eye lenses", 2006).
//!
//! Their polynomials are fitted inside of the picture. Farther out they may turn round and fold directions from
//! far outside back into the picture, so every lens knows the radius up to which it grows, and sees nothing beyond.

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
    /// `theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)` from the middle, for a direction that is `theta` off the axis.
    Fisheye {
        /// `k1` to `k4`.
        radial: [f64; 4],
    },
}

impl Distortion {
    /// No distortion.
    pub const PINHOLE: Self = Self::Perspective { radial: [0.0; 6], tangential: [0.0; 2] };

    /// True where all coefficients are numbers.
    pub(crate) fn is_finite(&self) -> bool {
        match self {
            Self::Perspective { radial, tangential } => {
                radial.iter().chain(tangential).all(|k| k.is_finite())
            }
            Self::Fisheye { radial } => radial.iter().all(|k| k.is_finite()),
        }
    }
}

/// A lens: a distortion, and how far out it can be trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    distortion: Distortion,
    /// On the picture plane for a perspective lens, an angle for a fisheye.
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
const WIDEST_PERSPECTIVE: f64 = 1.55;
/// Steps in which the valid radius is looked for.
const RADIUS_STEPS: u32 = 4096;
/// Newton's steps of the way back; three to five are enough in practice.
const MOST_STEPS: usize = 50;

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

    /// The depth that pictures of this lens order surfaces by: along the axis for a perspective lens (its inverse is then
    /// linear over the picture of a plane), the distance for a fisheye.
    pub fn depth(&self, p_camera: DVec3) -> f64 {
        if self.is_fisheye() { p_camera.length() } else { p_camera.z }
    }

    /// Where a point of camera space is seen; `None` behind a perspective lens and beyond the valid radius.
    pub fn project(&self, p_camera: DVec3) -> Option<OnPlane> {
        let (radius, position) = match self.distortion {
            Distortion::Perspective { radial, tangential } => {
                if p_camera.z <= 0.0 {
                    return None;
                }
                let n = p_camera.truncate() / p_camera.z;
                (n.length(), bent(n, &radial, tangential))
            }
            Distortion::Fisheye { radial } => {
                let across = p_camera.truncate();
                let length = across.length();
                let theta = length.atan2(p_camera.z);
                let scale = if length > 0.0 { fisheye_radius(theta, &radial) / length } else { 0.0 };
                (theta, across * scale)
            }
        };
        let room = 1.0 - radius / self.valid_radius;
        (room > 0.0 && position.is_finite()).then_some(OnPlane { position, room })
    }

    /// The unit direction that is seen at a position of the picture plane; `None` where no valid direction is.
    pub fn direction(&self, position: DVec2) -> Option<DVec3> {
        let direction = match self.distortion {
            Distortion::Perspective { radial, tangential } => {
                straight(position, &radial, tangential)?.extend(1.0).normalize()
            }
            Distortion::Fisheye { radial } => {
                let bent = position.length();
                let mut theta = bent;
                for _ in 0..MOST_STEPS {
                    let slope = (fisheye_radius(theta + 1e-6, &radial)
                        - fisheye_radius(theta - 1e-6, &radial))
                        / 2e-6;
                    let step = (fisheye_radius(theta, &radial) - bent) / slope;
                    theta = (theta - step).clamp(0.0, std::f64::consts::PI);
                    if step.abs() < 1e-12 {
                        break;
                    }
                }
                (position.normalize_or_zero() * theta.sin()).extend(theta.cos())
            }
        };
        let back = self.project(direction)?;
        ((back.position - position).length() < 1e-6).then_some(direction)
    }

    /// How far out the distorted radius grows with the radius.
    fn growing_radius(&self) -> f64 {
        let (widest, radius_at): (f64, Box<dyn Fn(f64) -> [f64; 2]>) = match self.distortion {
            Distortion::Perspective { radial, .. } => (
                WIDEST_PERSPECTIVE,
                Box::new(move |angle: f64| {
                    [angle.tan(), angle.tan() * radial_factor(angle.tan().powi(2), &radial)]
                }),
            ),
            Distortion::Fisheye { radial } => {
                (std::f64::consts::PI, Box::new(move |angle| [angle, fisheye_radius(angle, &radial)]))
            }
        };
        let mut before = [0.0; 2];
        for step in 1..=RADIUS_STEPS {
            let now = radius_at(widest * f64::from(step) / f64::from(RADIUS_STEPS));
            if now[1].is_nan() || now[1] <= before[1] {
                return before[0];
            }
            before = now;
        }
        before[0]
    }
}

/// The factor of the radial distortion.
fn radial_factor(r2: f64, k: &[f64; 6]) -> f64 {
    (1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]))) / (1.0 + r2 * (k[3] + r2 * (k[4] + r2 * k[5])))
}

/// Radial and tangential distortion.
fn bent(n: DVec2, radial: &[f64; 6], [p1, p2]: [f64; 2]) -> DVec2 {
    let r2 = n.length_squared();
    let shift = DVec2::new(
        2.0 * p1 * n.x * n.y + p2 * (r2 + 2.0 * n.x * n.x),
        p1 * (r2 + 2.0 * n.y * n.y) + 2.0 * p2 * n.x * n.y,
    );
    n * radial_factor(r2, radial) + shift
}

/// The inverse of [`bent`], by Newton's method with differences for derivatives.
fn straight(position: DVec2, radial: &[f64; 6], tangential: [f64; 2]) -> Option<DVec2> {
    let at = |n: DVec2| bent(n, radial, tangential);
    let mut n = position;
    for _ in 0..MOST_STEPS {
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

fn fisheye_radius(theta: f64, k: &[f64; 4]) -> f64 {
    let t2 = theta * theta;
    theta * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
}

#[cfg(test)]
mod tests {
    use super::*;

    const BARREL: Distortion =
        Distortion::Perspective { radial: [-0.2, 0.03, 0.0, 0.0, 0.0, 0.0], tangential: [0.001, -0.002] };
    const FISHEYE: Distortion = Distortion::Fisheye { radial: [-0.02, 0.003, -0.001, 0.0] };

    #[test]
    fn distortion_is_that_of_the_formulas() {
        // By hand: n = (0.3, -0.2), r^2 = 0.13; radial 1 - 0.2*0.13 + 0.03*0.0169 = 0.974507;
        // x: 0.2923521 + 2*0.001*(-0.06) - 0.002*(0.13 + 0.18), y: -0.1949014 + 0.001*(0.13 + 0.08) - 2*0.002*(-0.06).
        let seen = Lens::new(BARREL).project(DVec3::new(0.6, -0.4, 2.0)).unwrap();
        assert!((seen.position - DVec2::new(0.2916121, -0.1944514)).length() < 1e-7, "{seen:?}");
        // theta = atan(0.5): 0.46364761; radius theta (1 - 0.02 t2 + 0.003 t4 - 0.001 t6).
        let seen = Lens::new(FISHEYE).project(DVec3::new(0.0, 1.0, 2.0)).unwrap();
        let t2 = 0.463_647_61_f64.powi(2);
        let radius = 0.463_647_61 * (1.0 - 0.02 * t2 + 0.003 * t2 * t2 - 0.001 * t2 * t2 * t2);
        assert!((seen.position - DVec2::new(0.0, radius)).length() < 1e-8);
        let pinhole = Lens::new(Distortion::PINHOLE).project(DVec3::new(1.0, 2.0, 4.0)).unwrap();
        assert_eq!(pinhole.position, DVec2::new(0.25, 0.5));
    }

    #[test]
    fn the_way_back_is_the_way() {
        for distortion in [Distortion::PINHOLE, BARREL, FISHEYE] {
            let lens = Lens::new(distortion);
            for i in 0..200_u32 {
                let angle = f64::from(i) * 2.399;
                let off = 0.8 * f64::from(i) / 200.0;
                let direction = DVec3::new(off.sin() * angle.cos(), off.sin() * angle.sin(), off.cos());
                let back = lens.direction(lens.project(direction).unwrap().position).unwrap();
                assert!((back - direction).length() < 1e-9, "{distortion:?} {i}");
            }
        }
    }

    #[test]
    fn polynomials_do_not_fold_back() {
        // r (1 - 0.3 r^2) grows up to r = 1.054, and would bring r = 1.8 back to 0.05.
        let lens = Lens::new(Distortion::Perspective {
            radial: [-0.3, 0.0, 0.0, 0.0, 0.0, 0.0],
            tangential: [0.0; 2],
        });
        assert!((lens.valid_radius - (1.0_f64 / 0.9).sqrt()).abs() < 2e-3, "{}", lens.valid_radius);
        assert!(lens.project(DVec3::new(1.0, 0.0, 1.0)).unwrap().room < 0.06);
        assert_eq!(lens.project(DVec3::new(1.8, 0.0, 1.0)), None);
        assert_eq!(lens.project(DVec3::new(0.1, 0.0, -1.0)), None);
        // Nothing is seen where the lens reaches no more.
        assert_eq!(lens.direction(DVec2::new(0.9, 0.0)), None);
        // A fisheye sees behind.
        assert!(
            Lens::new(Distortion::Fisheye { radial: [0.0; 4] }).project(DVec3::new(1.0, 0.0, -0.2)).is_some()
        );
    }
}
