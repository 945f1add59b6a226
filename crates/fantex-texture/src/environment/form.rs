//! The ways of flattening the sphere of directions, with their derivatives.
//!
//! * latitude-longitude: J. Blinn and M. Newell, "Texture and reflection in computer generated images", 1976;
//! * cube: N. Greene, "Environment mapping and other applications of world projections", 1986;
//! * two paraboloids: W. Heidrich and H.-P. Seidel, "View-independent environment maps", 1998. A ray that is reflected at
//!   the paraboloid `z = (1 - x² - y²) / 2` comes from the direction whose stereographic projection is `(x, y)`, so the
//!   chart's coordinates are `(x, y) / (1 + z)`, and texels beyond the rim have a direction, too;
//! * mirror ball: what a far camera sees in a reflecting sphere; OpenGL's sphere map. All texels have the same solid angle,
//!   but the whole rim is one direction.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::EnvironmentMap;
use crate::Image;

/// How a map's directions are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EnvironmentForm {
    /// One chart: longitude to the right, polar angle downwards. The middle shows `-z`, its right `+x`, row 0 `+y`.
    Sphere,
    /// Six charts in the order of KTX: `+x -x +y -y +z -z`.
    Cube,
    /// Two charts with an inscribed disc each: the hemisphere around `-z`, seen from inside (`+x` on the right), then the
    /// hemisphere around `+z` (`-x` on the right).
    #[serde(rename = "paraboloid")]
    DualParaboloid,
    /// One chart with an inscribed disc: a mirror ball seen from `+z`. Its middle shows `+z`, its rim `-z`.
    MirrorBall,
}

/// A point of a chart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChartPoint {
    /// Which chart.
    pub chart: usize,
    /// `u` to the right and `v` downwards, `[0,1]` over the chart.
    pub uv: Vec2,
}

impl EnvironmentForm {
    /// All forms.
    pub const ALL: [Self; 4] = [Self::Sphere, Self::Cube, Self::DualParaboloid, Self::MirrorBall];

    /// Number of charts.
    pub fn charts(self) -> usize {
        match self {
            Self::Sphere | Self::MirrorBall => 1,
            Self::Cube => 6,
            Self::DualParaboloid => 2,
        }
    }

    /// Columns and rows of a chart with `side` rows: a sphere's chart is twice as wide, the others are square.
    pub fn chart_size(self, side: u32) -> [u32; 2] {
        match self {
            Self::Sphere => [2 * side, side],
            _ => [side, side],
        }
    }

    pub(super) fn is_disc(self) -> bool {
        matches!(self, Self::DualParaboloid | Self::MirrorBall)
    }

    /// Whether a point of a chart belongs to the map (the corners outside a disc repeat what is elsewhere).
    pub fn is_inside(self, uv: Vec2) -> bool {
        !self.is_disc() || (uv * 2.0 - 1.0).length_squared() <= 1.0
    }

    /// Where a direction (of any length but zero) lies.
    #[inline]
    pub fn locate(self, direction: Vec3) -> ChartPoint {
        let (chart, uv) = match self {
            Self::Sphere => {
                let longitude = direction.x.atan2(-direction.z);
                // atan2 is precise near the poles, where acos is not.
                let polar = direction.x.hypot(direction.z).atan2(direction.y);
                (0, Vec2::new(0.5 + longitude / TAU, polar / PI))
            }
            Self::Cube => {
                let (face, [s, t], _) = CubeFace::meet(direction);
                (face as usize, from_symmetric(Vec2::new(s, t)))
            }
            Self::DualParaboloid => {
                let chart = usize::from(direction.z > 0.0);
                (chart, paraboloid_uv(chart, direction.normalize_or(Vec3::NEG_Z)))
            }
            Self::MirrorBall => {
                let d = direction.normalize_or(Vec3::Z);
                (0, from_symmetric(Vec2::new(d.x, -d.y) / ball_divisor(d)))
            }
        };
        ChartPoint { chart, uv }
    }

    /// The unit direction of a chart's point. Points outside a paraboloid's disc have the direction that continues the map;
    /// points outside a ball's disc have the rim's.
    #[inline]
    pub fn direction(self, at: ChartPoint) -> Vec3 {
        let Vec2 { x: s, y: t } = at.uv * 2.0 - 1.0;
        match self {
            Self::Sphere => {
                let (sin, cos) = (PI * s).sin_cos();
                let (sin_polar, cos_polar) = (PI * at.uv.y).sin_cos();
                Vec3::new(sin_polar * sin, cos_polar, -sin_polar * cos)
            }
            Self::Cube => {
                let face = CubeFace::ALL[at.chart];
                (face.forward() + face.right() * s - face.up() * t).normalize()
            }
            Self::DualParaboloid => {
                let r2 = s * s + t * t;
                let side = if at.chart == 0 { 1.0 } else { -1.0 };
                Vec3::new(2.0 * s * side, -2.0 * t, (r2 - 1.0) * side) / (1.0 + r2)
            }
            Self::MirrorBall => {
                let r2 = (s * s + t * t).min(1.0);
                let inwards = 2.0 * (1.0 - r2).sqrt();
                Vec3::new(s * inwards, -t * inwards, 1.0 - 2.0 * r2).normalize_or(Vec3::NEG_Z)
            }
        }
    }

    /// The change of `uv` when a unit direction moves by `step`, to first order, in the chart that
    /// [`EnvironmentForm::locate`] chooses. At a pole of the sphere and at the mirror ball's rim, where it has no bound,
    /// it is held to the chart's extent.
    pub fn uv_step(self, direction: Vec3, step: Vec3) -> Vec2 {
        let step = step - direction * direction.dot(step);
        let uv = match self {
            Self::Sphere => {
                let Vec3 { x, y, z } = direction;
                let around2 = (x * x + z * z).max(1e-12);
                let around = around2.sqrt();
                let outward = (x * step.x + z * step.z) / around;
                Vec2::new((x * step.z - z * step.x) / around2 / TAU, (outward * y - step.y * around) / PI)
            }
            Self::Cube => {
                let (face, [s, t], length) = CubeFace::meet(direction);
                let forward = face.forward().dot(step);
                let along = Vec2::new(face.right().dot(step), -face.up().dot(step));
                (along - Vec2::new(s, t) * forward) * (0.5 / length)
            }
            Self::DualParaboloid => {
                let chart = usize::from(direction.z > 0.0);
                let side = if chart == 0 { 1.0 } else { -1.0 };
                let st = paraboloid_uv(chart, direction) * 2.0 - 1.0;
                let along = Vec2::new(step.x * side, -step.y);
                (along + st * (step.z * side)) * (0.5 / (1.0 - direction.z * side))
            }
            Self::MirrorBall => {
                let divisor = ball_divisor(direction);
                let st = Vec2::new(direction.x, -direction.y) / divisor;
                (Vec2::new(step.x, -step.y) / divisor - st * (step.z / (divisor * divisor))) * 0.5
            }
        };
        uv.clamp(Vec2::NEG_ONE, Vec2::ONE)
    }

    /// Steradians per unit of `uv` area: the Jacobian of [`EnvironmentForm::direction`]. Over all charts (over their discs)
    /// it integrates to 4 pi.
    pub fn steradians_per_uv(self, uv: Vec2) -> f32 {
        let r2 = (uv * 2.0 - 1.0).length_squared();
        match self {
            Self::Sphere => TAU * PI * (PI * uv.y).sin().max(0.0),
            Self::Cube => 4.0 / ((1.0 + r2) * (1.0 + r2).sqrt()),
            Self::DualParaboloid => 16.0 / ((1.0 + r2) * (1.0 + r2)),
            Self::MirrorBall => 16.0,
        }
    }
}

/// Sides up to which a cube's texels are measured exactly; beyond, the density at the middle is right to 1e-4.
const COARSE_SIDE: u32 = 64;

impl EnvironmentForm {
    /// The solid angle of a texel, steradians: exact for spheres and for the coarse cubes where that matters, else the
    /// density at the texel's middle times its area.
    pub(super) fn texel_steradians(self, size: [u32; 2], x: i32, y: i32) -> f32 {
        let [width, height] = size.map(|n| n as f32);
        let (left, top) = (x as f32 / width, y as f32 / height);
        let (right, bottom) = ((x + 1) as f32 / width, (y + 1) as f32 / height);
        match self {
            // cos a - cos b = 2 sin((a + b) / 2) sin((b - a) / 2), with its digits.
            Self::Sphere => {
                2.0 * TAU / width * (PI * 0.5 * (top + bottom)).sin() * (PI * 0.5 * (bottom - top)).sin()
            }
            Self::Cube if size[0] <= COARSE_SIDE => {
                let quadrant = |u: f32, v: f32| {
                    let (s, t) = (2.0 * u - 1.0, 2.0 * v - 1.0);
                    (s * t).atan2((1.0 + s * s + t * t).sqrt())
                };
                quadrant(right, bottom) - quadrant(left, bottom) - quadrant(right, top) + quadrant(left, top)
            }
            _ => {
                let middle = Vec2::new(0.5 * (left + right), 0.5 * (top + bottom));
                self.steradians_per_uv(middle) / (width * height)
            }
        }
    }
}

fn from_symmetric(st: Vec2) -> Vec2 {
    st * 0.5 + 0.5
}

/// The coordinates of a unit direction in one paraboloid's chart, which need not be the one it belongs to.
#[inline]
pub(super) fn paraboloid_uv(chart: usize, d: Vec3) -> Vec2 {
    let side = if chart == 0 { 1.0 } else { -1.0 };
    from_symmetric(Vec2::new(d.x * side, -d.y) / (1.0 - d.z * side).max(1e-6))
}

/// Half of OpenGL's `m = 2 sqrt(x² + y² + (z + 1)²)`, for a unit vector.
fn ball_divisor(d: Vec3) -> f32 {
    // Behind the ball `1 + z` has lost its digits; the other two coordinates have kept theirs.
    let one_plus_z = if d.z < 0.0 { (d.x * d.x + d.y * d.y) / (1.0 - d.z) } else { 1.0 + d.z };
    (2.0 * one_plus_z).sqrt().max(1e-6)
}

// ---- The six faces of a cube map.
//
// KTX, OpenGL and Direct3D agree on a left-handed system for cube maps (x right, y up, z *forward*), in which the pictures
// of the faces are what is seen from inside. The world is right-handed. The two meet by mirroring z: the face that those
// formats call `+z`, the picture ahead, lies in the world's direction `-z`. All others keep their axes.

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

// ---- Maps from and to pictures.
//
// ```text
//  horizontal cross 4:3      vertical cross 3:4     strips 6:1, 1:6
//      +y                        +y                  +x -x +y -y +z -z
//  -x  +z  +x  -z            -x  +z  +x
//      -y                        -y                 (names of KTX; see CubeFace)
//                                -z upside down
// ```

/// How a picture shows an environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EnvironmentLayout {
    /// Latitude-longitude, 2:1: all the way round, `-z` in the middle.
    Panorama,
    /// Six faces, 4:3: `-x +z +x -z` in the middle row (names of KTX), `+y` above and `-y` below `+z`.
    HorizontalCross,
    /// Six faces, 3:4: as the horizontal cross, but `-z` stands on its head below `-y`.
    VerticalCross,
    /// Six faces side by side, 6:1, in the order of KTX: `+x -x +y -y +z -z`.
    HorizontalStrip,
    /// Six faces one below the other, 1:6, in the order of KTX: `+x -x +y -y +z -z`.
    VerticalStrip,
    /// Two discs side by side, 2:1: around `-z`, around `+z`. Never recognised by its sides: a panorama has the same.
    #[serde(rename = "paraboloids")]
    DualParaboloid,
    /// One disc, 1:1: a mirror ball. Never recognised by its sides: any square picture has the same.
    MirrorBall,
}

/// A texel of a picture that is a texel of a chart.
type ChartTexel = (usize, [u32; 2]);

impl EnvironmentLayout {
    /// The layout of pictures with these sides: 2:1, 4:3, 3:4, 6:1 or 1:6; nothing for others.
    pub fn of_size(width: u32, height: u32) -> Option<Self> {
        let recognised = [
            Self::Panorama,
            Self::HorizontalCross,
            Self::VerticalCross,
            Self::HorizontalStrip,
            Self::VerticalStrip,
        ];
        recognised.into_iter().find(|layout| layout.side_of(width, height).is_some())
    }

    /// The form of maps in this layout.
    pub fn form(self) -> EnvironmentForm {
        match self {
            Self::Panorama => EnvironmentForm::Sphere,
            Self::DualParaboloid => EnvironmentForm::DualParaboloid,
            Self::MirrorBall => EnvironmentForm::MirrorBall,
            _ => EnvironmentForm::Cube,
        }
    }

    /// Columns and rows of pictures in this layout, in charts' sides.
    pub fn cells(self) -> [u32; 2] {
        match self {
            Self::Panorama | Self::DualParaboloid => [2, 1],
            Self::HorizontalCross => [4, 3],
            Self::VerticalCross => [3, 4],
            Self::HorizontalStrip => [6, 1],
            Self::VerticalStrip => [1, 6],
            Self::MirrorBall => [1, 1],
        }
    }

    /// The side of a chart in a picture of this size, if it has the right proportions.
    pub(super) fn side_of(self, width: u32, height: u32) -> Option<u32> {
        let [columns, rows] = self.cells();
        let fits = width > 0 && u64::from(width) * u64::from(rows) == u64::from(height) * u64::from(columns);
        (fits && width.is_multiple_of(columns)).then_some(width / columns)
    }

    /// The picture's cell of a cube's face, and whether it stands on its head there.
    fn face_cell(self, face: CubeFace) -> ([u32; 2], bool) {
        let index = face as u32;
        match (self, face) {
            (Self::HorizontalStrip, _) => ([index, 0], false),
            (Self::VerticalStrip, _) => ([0, index], false),
            (_, CubeFace::Left) => ([0, 1], false),
            (_, CubeFace::Front) => ([1, 1], false),
            (_, CubeFace::Right) => ([2, 1], false),
            (_, CubeFace::Up) => ([1, 0], false),
            (_, CubeFace::Down) => ([1, 2], false),
            (Self::VerticalCross, CubeFace::Back) => ([1, 3], true),
            (_, CubeFace::Back) => ([3, 1], false),
        }
    }

    /// Where the picture shows a texel of a chart with `side` rows.
    fn pixel_of(self, (chart, [x, y]): ChartTexel, side: u32) -> [u32; 2] {
        match self {
            Self::Panorama | Self::MirrorBall => [x, y],
            Self::DualParaboloid => [x + chart as u32 * side, y],
            _ => {
                let ([column, row], upside_down) = self.face_cell(CubeFace::ALL[chart]);
                let [x, y] = if upside_down { [side - 1 - x, side - 1 - y] } else { [x, y] };
                [column * side + x, row * side + y]
            }
        }
    }
}

impl EnvironmentMap {
    /// A map from a picture, texel by texel; nothing if the picture's sides do not have the layout's proportions. Alpha
    /// is ignored.
    pub fn from_image(image: &Image, layout: EnvironmentLayout) -> Option<Self> {
        let side = layout.side_of(image.width, image.height)?;
        let form = layout.form();
        Some(Self::from_texels(form, form.chart_size(side), |chart, x, y| {
            let [column, row] = layout.pixel_of((chart, [x, y]), side);
            let [r, g, b, _] = image.linear_texel(column, row);
            Vec3::new(r, g, b)
        }))
    }

    /// A cube from the pictures of its faces in the order of [`CubeFace::ALL`], each as seen from inside; nothing if they
    /// are not squares of one size.
    pub fn from_faces(faces: &[Image; 6]) -> Option<Self> {
        let side = faces[0].width;
        if side == 0 || faces.iter().any(|face| face.width != side || face.height != side) {
            return None;
        }
        Some(Self::of_cube_faces(faces))
    }

    /// As [`EnvironmentMap::from_faces`], of six squares of one size.
    pub(super) fn of_cube_faces(faces: &[Image]) -> Self {
        Self::from_texels(EnvironmentForm::Cube, [faces[0].width; 2], |chart, x, y| {
            let [r, g, b, _] = faces[chart].linear_texel(x, y);
            Vec3::new(r, g, b)
        })
    }

    /// Linear RGBA picture of the map. Where the layout belongs to another form than the map's, the map is converted
    /// first, with about as many texels. What no chart covers (the empty cells of a cross, the corners around discs)
    /// is transparent.
    pub fn to_image(&self, layout: EnvironmentLayout) -> Image {
        if layout.form() != self.form() {
            return self.converted(layout.form(), self.like_side(layout.form())).to_image(layout);
        }
        let [width, side] = self.chart_size();
        let [columns, rows] = layout.cells();
        let columns = if layout == EnvironmentLayout::Panorama { width } else { columns * side };
        let mut texels = vec![[0.0; 4]; columns as usize * (rows * side) as usize];
        for chart in 0..self.form().charts() {
            for (x, y) in (0..side).flat_map(|y| (0..width).map(move |x| (x, y))) {
                if self.form().is_inside(self.level(0).texel_uv(x as i32, y as i32)) {
                    let [column, row] = layout.pixel_of((chart, [x, y]), side);
                    let color = self.texel(0, chart, x, y).extend(1.0).to_array();
                    texels[row as usize * columns as usize + column as usize] = color;
                }
            }
        }
        Image::from_linear_rgba(columns, rows * side, &texels)
    }

    /// The cube unfolded to a horizontal cross, as [`EnvironmentMap::to_image`] makes it.
    pub fn unfolded(&self) -> Image {
        self.to_image(EnvironmentLayout::HorizontalCross)
    }

    /// The side at which another form resolves about as much as this map.
    fn like_side(&self, form: EnvironmentForm) -> u32 {
        let quarter_turns = |form| match form {
            EnvironmentForm::Cube => 1,
            EnvironmentForm::Sphere | EnvironmentForm::DualParaboloid => 2,
            EnvironmentForm::MirrorBall => 3,
        };
        (self.chart_size()[1] * quarter_turns(form)).div_ceil(quarter_turns(self.form()))
    }
}

// ---- Mirrored view rays and their footprints.

/// The direction that a mirror with the unit `normal` shows to an eye in the unit direction `to_eye`.
pub fn mirrored(normal: Vec3, to_eye: Vec3) -> Vec3 {
    normal * (2.0 * normal.dot(to_eye)) - to_eye
}

/// The change of [`mirrored`] along a footprint's edges, to first order, from those of normal and eye direction: on
/// curved or bumpy mirrors neighbouring pixels look far apart.
pub fn mirrored_steps(
    normal: Vec3,
    normal_steps: [Vec3; 2],
    to_eye: Vec3,
    to_eye_steps: [Vec3; 2],
) -> [Vec3; 2] {
    [0, 1].map(|edge| {
        let (dn, dv) = (normal_steps[edge], to_eye_steps[edge]);
        let turned = dn.dot(to_eye) + normal.dot(dv);
        normal * (2.0 * turned) + dn * (2.0 * normal.dot(to_eye)) - dv
    })
}

#[cfg(test)]
mod tests {
    use super::*;

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
