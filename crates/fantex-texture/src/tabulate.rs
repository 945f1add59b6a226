//! Tabulation: a function becomes a discrete texture, for a chosen domain and density of samples.

use fantex_base::{Error, Result};
use rayon::prelude::*;

use crate::Image;

/// How a function is tabulated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tabulation {
    /// Texels along each axis of the domain, which is `[0,1]` along each.
    pub size: [u32; 3],
    /// Samples per texel along each axis; their mean is the texel.
    pub samples: u32,
    /// Bytes that the table may take.
    pub memory_bytes: u64,
}

impl Default for Tabulation {
    /// 256 x 256 texels of 2 x 2 samples, within 1 GiB.
    fn default() -> Self {
        Self { size: [256, 256, 1], samples: 2, memory_bytes: 1 << 30 }
    }
}

impl Tabulation {
    /// The function's means over all texels: linear RGBA, x fastest, then y, then z. `function` is asked at points of the
    /// domain; the axes that have one texel only are asked in the middle.
    ///
    /// # Errors
    ///
    /// There is nothing to tabulate, or too much.
    pub fn texels(&self, function: impl Fn([f32; 3]) -> [f32; 4] + Sync) -> Result<Vec<[f32; 4]>> {
        let Self { size, samples, memory_bytes: allowed } = *self;
        let [x, y, z] = size;
        if size.contains(&0) || samples == 0 {
            let message = format!(
                "a table of {x} x {y} x {z} texels with {samples} samples each has nothing in it; all must be at least 1"
            );
            return Err(Error::invalid(message));
        }
        let count = size.iter().fold(1_u64, |product, &n| product.saturating_mul(u64::from(n)));
        let needed = count.saturating_mul(size_of::<[f32; 4]>() as u64);
        if needed > allowed {
            let message = format!(
                "a table of {x} x {y} x {z} texels takes {needed} bytes and only {allowed} are allowed; make it smaller or \
                 allow more memory"
            );
            return Err(Error::too_large(message));
        }
        let [width, height, _] = size.map(|n| n as usize);
        let mut texels = vec![[0.0; 4]; count as usize];
        texels.par_chunks_mut(width).enumerate().for_each(|(row, texels)| {
            for (x, texel) in texels.iter_mut().enumerate() {
                *texel = self.mean([x, row % height, row / height], &function);
            }
        });
        Ok(texels)
    }

    /// The same as an image: the plane in the middle of the third axis, row 0 at the second axis' 0.
    ///
    /// # Errors
    ///
    /// There is nothing to tabulate, or too much.
    pub fn image(&self, function: impl Fn([f32; 3]) -> [f32; 4] + Sync) -> Result<Image> {
        let [width, height, _] = self.size;
        let texels = Self { size: [width, height, 1], ..*self }.texels(function)?;
        Ok(Image::from_linear_rgba(width, height, &texels))
    }

    fn mean(&self, texel: [usize; 3], function: &impl Fn([f32; 3]) -> [f32; 4]) -> [f32; 4] {
        let counts = self.size.map(|n| if n == 1 { 1 } else { self.samples });
        let mut sum = [0.0_f64; 4];
        for index in 0..counts.iter().product::<u32>() {
            let sub = [index % counts[0], index / counts[0] % counts[1], index / counts[0] / counts[1]];
            let at = std::array::from_fn(|axis| {
                let inside = (sub[axis] as f32 + 0.5) / counts[axis] as f32;
                (texel[axis] as f32 + inside) / self.size[axis] as f32
            });
            let value = function(at);
            (0..4).for_each(|c| sum[c] += f64::from(value[c]));
        }
        sum.map(|s| (s / f64::from(counts.iter().product::<u32>())) as f32)
    }
}

#[cfg(test)]
mod tests {
    use fantex_base::ErrorKind;

    use super::*;

    #[test]
    fn tables_hold_means_in_their_order() {
        let table = Tabulation { size: [4, 3, 2], samples: 3, ..Tabulation::default() };
        let texels = table.texels(|[x, y, z]| [x, y, z, 1.0]).unwrap();
        assert_eq!(texels.len(), 24);
        for (i, texel) in texels.iter().enumerate() {
            let expected = [(i % 4) as f32 + 0.5, (i / 4 % 3) as f32 + 0.5, (i / 12) as f32 + 0.5];
            for (axis, n) in [4.0, 3.0, 2.0].into_iter().enumerate() {
                assert!((texel[axis] - expected[axis] / n).abs() < 1e-6, "{i}: {texel:?}");
            }
        }
    }

    #[test]
    fn a_dense_table_looked_up_is_the_function() {
        use crate::{Filter, ImageTexture, SampleOptions, Wrap};
        use glam::Vec2;
        let function = |[x, y, _]: [f32; 3]| [(6.0 * x).sin() * (5.0 * y).cos(), x * y, 0.0, 1.0];
        let image = Tabulation { size: [512, 512, 1], ..Tabulation::default() }.image(function).unwrap();
        let texture = ImageTexture::new(std::sync::Arc::new(image));
        let options =
            SampleOptions { filter: Filter::Bilinear, wrap: [Wrap::Clamp; 2], ..SampleOptions::default() };
        for i in 0..500 {
            let uv =
                Vec2::new(0.01 + 0.98 * (i as f32 * 0.618).fract(), 0.01 + 0.98 * (i as f32 * 0.414).fract());
            let value = texture.sample(uv, [Vec2::ZERO; 2], &options);
            let exact = function([uv.x, uv.y, 0.0]);
            assert!((value[0] - exact[0]).abs() < 1e-4 && (value[1] - exact[1]).abs() < 1e-4, "{uv}");
        }
    }

    #[test]
    fn tables_of_nothing_or_too_much_are_refused() {
        let constant = |_: [f32; 3]| [0.0; 4];
        let empty = Tabulation { size: [0, 1, 1], ..Tabulation::default() };
        assert_eq!(empty.texels(constant).unwrap_err().kind(), ErrorKind::InvalidArgument);
        let huge = Tabulation { size: [u32::MAX; 3], ..Tabulation::default() };
        assert_eq!(huge.texels(constant).unwrap_err().kind(), ErrorKind::TooLarge);
    }
}
