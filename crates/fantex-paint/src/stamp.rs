//! Pictures that shape a dab.

use fantex_texture::Image;

/// A picture whose alpha (or, where it has none, whose brightness) shapes a dab.
#[derive(Clone, Debug, PartialEq)]
pub struct Stamp {
    extent: [usize; 2],
    coverage: Vec<f32>,
}

impl Stamp {
    /// From a picture; its longer side spans the brush's diameter.
    pub fn new(image: &Image) -> Self {
        let coverage = |x, y| {
            let [r, g, b, a] = image.linear_texel(x, y);
            // Luminance (ITU-R BT.709).
            if image.has_alpha() { a } else { 0.2126 * r + 0.7152 * g + 0.0722 * b }
        };
        let texels = (0..image.height).flat_map(|y| (0..image.width).map(move |x| coverage(x, y)));
        Self { extent: [image.width as usize, image.height as usize], coverage: texels.collect() }
    }

    /// Columns and rows, and the coverage of each texel, row-major.
    pub(crate) fn texels(&self) -> ([usize; 2], &[f32]) {
        (self.extent, &self.coverage)
    }

    /// Bilinear coverage at a place of the brush: x to the right and y upwards, -1..1 over the picture's longer side; 0
    /// outside, with the picture's border fading over a texel.
    pub(crate) fn coverage(&self, x: f32, y: f32) -> f32 {
        let [width, height] = self.extent;
        let scale = 0.5 * width.max(height) as f32;
        let column = x * scale + 0.5 * width as f32 - 0.5;
        let row = -y * scale + 0.5 * height as f32 - 0.5;
        let (c, r) = (column.floor(), row.floor());
        let (fx, fy) = (column - c, row - r);
        let at = |dx: f32, dy: f32| {
            let (c, r) = (c + dx, r + dy);
            let inside = c >= 0.0 && r >= 0.0 && c < width as f32 && r < height as f32;
            if inside { self.coverage[r as usize * width + c as usize] } else { 0.0 }
        };
        let top = at(0.0, 0.0) * (1.0 - fx) + at(1.0, 0.0) * fx;
        let bottom = at(0.0, 1.0) * (1.0 - fx) + at(1.0, 1.0) * fx;
        top * (1.0 - fy) + bottom * fy
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_covers_where_its_picture_is_opaque() {
        let texels: Vec<[f32; 4]> =
            (0..64).map(|i| [0.0, 0.0, 0.0, if i % 8 < 4 { 1.0 } else { 0.0 }]).collect();
        let stamp = Stamp::new(&Image::from_linear_rgba(8, 8, &texels));
        let found = [(-0.5, 0.3), (0.5, 0.3), (-1.3, 0.0), (-0.5, 1.2)].map(|(x, y)| stamp.coverage(x, y));
        assert_eq!(found, [1.0, 0.0, 0.0, 0.0]);
        // Without alpha brightness counts, and wide pictures keep their shape.
        let grey = Stamp::new(&Image::from_linear_rgb(8, 4, &[[0.25, 0.25, 0.25, 1.0]; 32]));
        assert!((grey.coverage(0.5, 0.2) - 0.25).abs() < 1e-6);
        assert_eq!(grey.coverage(0.0, 0.8), 0.0);
    }
}
