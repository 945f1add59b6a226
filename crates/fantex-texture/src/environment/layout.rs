//! Maps from and to pictures.
//!
//! ```text
//!  horizontal cross 4:3      vertical cross 3:4     strips 6:1, 1:6
//!      +y                        +y                  +x -x +y -y +z -z
//!  -x  +z  +x  -z            -x  +z  +x
//!      -y                        -y                 (names of KTX; see cube_face.rs)
//!                                -z upside down
//! ```

use glam::Vec3;

use super::{CubeFace, EnvironmentForm, EnvironmentMap};
use crate::Image;

/// How a picture shows an environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EnvironmentLayout {
    /// Latitude-longitude, 2:1: all the way round, `-z` in the middle.
    Panorama,
    /// Six faces, 4:3: `-x +z +x -z` in the middle row (names of KTX), `+y` above and `-y` below `+z`.
    HorizontalCross,
    /// Six faces, 3:4: as the horizontal cross, but `-z` stands on its head below `-y`.
    VerticalCross,
    /// Six faces side by side, 6:1, in the order of [`CubeFace::ALL`].
    HorizontalStrip,
    /// Six faces one below the other, 1:6, in the order of [`CubeFace::ALL`].
    VerticalStrip,
    /// Two discs side by side, 2:1: around `-z`, around `+z`. Never recognised by its sides: a panorama has the same.
    DualParaboloid,
    /// One disc, 1:1: a mirror ball.
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
        Some(Self::from_texels(EnvironmentForm::Cube, [side; 2], |chart, x, y| {
            let [r, g, b, _] = faces[chart].linear_texel(x, y);
            Vec3::new(r, g, b)
        }))
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
