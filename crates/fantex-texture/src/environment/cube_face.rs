//! The six faces of a cube map.
//!
//! KTX, OpenGL and Direct3D agree on a left-handed system for cube maps (x right, y up, z *forward*), in which the pictures
//! of the faces are what is seen from inside. The world is right-handed. The two meet by mirroring z: the face that those
//! formats call `+z`, the picture ahead, lies in the world's direction `-z`. All others keep their axes.

use glam::Vec3;

/// A face of a cube map, in the order of KTX and OpenGL (`+x -x +y -y +z -z` there).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CubeFace {
    /// World `+x`; KTX `+x`.
    Right,
    /// World `-x`; KTX `-x`.
    Left,
    /// World `+y`; KTX `+y`.
    Up,
    /// World `-y`; KTX `-y`.
    Down,
    /// World `-z`; KTX `+z`.
    Front,
    /// World `+z`; KTX `-z`.
    Back,
}

impl CubeFace {
    /// All faces in storage order.
    pub const ALL: [Self; 6] = [Self::Right, Self::Left, Self::Up, Self::Down, Self::Front, Self::Back];

    /// The direction of the face's middle.
    pub fn forward(self) -> Vec3 {
        match self {
            Self::Right => Vec3::X,
            Self::Left => Vec3::NEG_X,
            Self::Up => Vec3::Y,
            Self::Down => Vec3::NEG_Y,
            Self::Front => Vec3::NEG_Z,
            Self::Back => Vec3::Z,
        }
    }

    /// Upwards in the face's picture.
    pub fn up(self) -> Vec3 {
        match self {
            Self::Up => Vec3::Z,
            Self::Down => Vec3::NEG_Z,
            _ => Vec3::Y,
        }
    }

    /// To the right in the face's picture, seen from inside.
    pub fn right(self) -> Vec3 {
        self.forward().cross(self.up())
    }

    /// The face that a direction meets, and where: `s` to the right and `t` downwards, both in `[-1,1]`. Also the
    /// direction's component along the face's axis, which is its largest.
    #[inline]
    pub(super) fn meet(direction: Vec3) -> (Self, [f32; 2], f32) {
        let [x, y, z] = direction.to_array();
        let [ax, ay, az] = direction.abs().to_array();
        if ax >= ay && ax >= az {
            let (face, side) = if x >= 0.0 { (Self::Right, z) } else { (Self::Left, -z) };
            (face, [side / ax, -y / ax], ax)
        } else if ay >= az {
            let (face, down) = if y >= 0.0 { (Self::Up, -z) } else { (Self::Down, z) };
            (face, [x / ay, down / ay], ay)
        } else {
            let (face, side) = if z <= 0.0 { (Self::Front, x) } else { (Self::Back, -x) };
            (face, [side / az, -y / az], az)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_seen_from_inside_without_mirroring() {
        for face in CubeFace::ALL {
            let axes = glam::Mat3::from_cols(face.right(), face.up(), -face.forward());
            assert!((axes.determinant() - 1.0).abs() < 1e-6, "{face:?} is a right-handed camera");
        }
        assert_eq!(CubeFace::Front.right(), Vec3::X);
    }

    #[test]
    fn meeting_agrees_with_the_axes() {
        for face in CubeFace::ALL {
            for (s, t) in [(0.0, 0.0), (0.3, -0.6), (-0.9, 0.5)] {
                let d = face.forward() + face.right() * s - face.up() * t;
                let (met, [s2, t2], length) = CubeFace::meet(d * 2.0);
                assert_eq!(met, face);
                assert!((s - s2).abs() < 1e-6 && (t - t2).abs() < 1e-6 && (length - 2.0).abs() < 1e-6);
            }
        }
    }
}
