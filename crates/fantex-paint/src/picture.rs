//! Pictures that are laid onto the surface: decals, texts, slides of a projection.

use fantex_texture::Image;
use glam::{Vec2, Vec4, Vec4Swizzles};

/// A picture with coarser versions of itself, so that a texel sees the mean of what it covers.
///
/// Coordinates: x to the right and y upwards, -1..1 over the picture's longer side, the origin in the middle.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Finest first.
    levels: Vec<Level>,
}

/// Linear RGBA, multiplied by alpha.
#[derive(Clone, Debug, PartialEq)]
struct Level {
    extent: [usize; 2],
    texels: Vec<Vec4>,
}

impl Picture {
    /// From an image.
    pub fn new(image: &Image) -> Self {
        let texel = |x, y| Vec4::from_array(image.linear_texel(x, y));
        let texels = (0..image.height).flat_map(|y| (0..image.width).map(move |x| texel(x, y)));
        Self::from_texels([image.width as usize, image.height as usize], texels.collect())
    }

    /// The shape of an image in white: its alpha, or, where it has none, its brightness.
    pub fn shape(image: &Image) -> Self {
        let covered = |x, y| {
            let [r, g, b, a] = image.linear_texel(x, y);
            // Luminance (ITU-R BT.709).
            if image.has_alpha() { a } else { 0.2126 * r + 0.7152 * g + 0.0722 * b }
        };
        let coverage: Vec<f32> =
            (0..image.height).flat_map(|y| (0..image.width).map(move |x| covered(x, y))).collect();
        Self::from_coverage([image.width as usize, image.height as usize], &coverage)
    }

    /// A shape in white: coverage 0..1, row-major from the top, as many as `extent` has texels.
    pub(crate) fn from_coverage(extent: [usize; 2], coverage: &[f32]) -> Self {
        Self::from_texels(extent, coverage.iter().map(|&a| Vec4::new(1.0, 1.0, 1.0, a)).collect())
    }

    /// Straight alpha.
    fn from_texels(extent: [usize; 2], mut texels: Vec<Vec4>) -> Self {
        texels.iter_mut().for_each(|t| *t = (t.xyz() * t.w).extend(t.w));
        let mut levels = vec![Level { extent, texels }];
        while let Some(coarser) = levels.last().and_then(Level::halved) {
            levels.push(coarser);
        }
        Self { levels }
    }

    /// Columns and rows.
    pub fn extent(&self) -> [usize; 2] {
        self.levels[0].extent
    }

    /// The mean over a square of side `width` at a place: linear RGBA, multiplied by alpha. Transparent outside.
    pub(crate) fn at(&self, place: Vec2, width: f32) -> Vec4 {
        let [columns, rows] = self.extent();
        let half = 0.5 * columns.max(rows) as f32;
        let texel = Vec2::new(place.x * half + 0.5 * columns as f32, 0.5 * rows as f32 - place.y * half);
        let level = (width * half).max(1.0).log2().min((self.levels.len() - 1) as f32);
        let (fine, share) = (level.floor(), level.fract());
        let value = |level: f32| self.levels[level as usize].at(texel * (-level).exp2());
        if share == 0.0 { value(fine) } else { value(fine).lerp(value(fine + 1.0), share) }
    }

    /// Alpha of [`at`](Self::at).
    pub(crate) fn alpha(&self, place: Vec2, width: f32) -> f32 {
        self.at(place, width).w
    }

    /// The colour of [`at`](Self::at) without its alpha: opaque; black where there is none.
    pub(crate) fn color(&self, place: Vec2, width: f32) -> Vec4 {
        let value = self.at(place, width);
        if value.w > 0.0 { (value.xyz() / value.w).extend(1.0) } else { Vec4::W }
    }
}

impl Level {
    /// Half as many columns and rows; none below one texel.
    fn halved(&self) -> Option<Self> {
        let [width, height] = self.extent;
        if width <= 1 && height <= 1 {
            return None;
        }
        let extent = [width.div_ceil(2), height.div_ceil(2)];
        // A picture of odd extent is continued by nothing.
        let at = |x: usize, y: usize| {
            if x < width && y < height { self.texels[y * width + x] } else { Vec4::ZERO }
        };
        let mean = |x, y| (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1)) * 0.25;
        let places = (0..extent[1]).flat_map(|y| (0..extent[0]).map(move |x| (2 * x, 2 * y)));
        Some(Self { extent, texels: places.map(|(x, y)| mean(x, y)).collect() })
    }

    /// Bilinear, at a place in texels of this level; transparent outside, with a border that fades over a texel.
    fn at(&self, place: Vec2) -> Vec4 {
        let corner = (place - 0.5).floor();
        let f = place - 0.5 - corner;
        let texel = |dx: f32, dy: f32| {
            let (x, y) = (corner.x + dx, corner.y + dy);
            let inside = x >= 0.0 && y >= 0.0 && x < self.extent[0] as f32 && y < self.extent[1] as f32;
            if inside { self.texels[y as usize * self.extent[0] + x as usize] } else { Vec4::ZERO }
        };
        let upper = texel(0.0, 0.0).lerp(texel(1.0, 0.0), f.x);
        upper.lerp(texel(0.0, 1.0).lerp(texel(1.0, 1.0), f.x), f.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn far_away_a_picture_is_its_mean() {
        let texels: Vec<[f32; 4]> =
            (0..64).map(|i| [1.0, 0.0, 0.0, if i % 8 < 4 { 1.0 } else { 0.0 }]).collect();
        let picture = Picture::new(&Image::from_linear_rgba(8, 8, &texels));
        assert_eq!(picture.alpha(Vec2::new(-0.5, 0.3), 0.0), 1.0);
        assert_eq!(picture.alpha(Vec2::new(0.5, 0.3), 0.0), 0.0);
        assert_eq!(picture.alpha(Vec2::new(-0.5, 1.3), 0.0), 0.0);
        assert!((picture.alpha(Vec2::ZERO, 2.0) - 0.5).abs() < 1e-6);
        assert_eq!(picture.color(Vec2::ZERO, 2.0), Vec4::new(1.0, 0.0, 0.0, 1.0));
    }

    #[test]
    fn odd_extents_keep_their_middle() {
        let texels = vec![[1.0, 1.0, 1.0, 1.0]; 25 * 15];
        let picture = Picture::new(&Image::from_linear_rgba(25, 15, &texels));
        for width in [0.0, 0.08, 0.16] {
            assert!((picture.alpha(Vec2::ZERO, width) - 1.0).abs() < 1e-6, "{width}");
        }
        assert_eq!(picture.alpha(Vec2::new(0.0, 0.8), 0.0), 0.0, "above a wide picture there is nothing");
    }
}
