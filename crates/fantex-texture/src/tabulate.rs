//! Tabulation: a function becomes a discrete texture, for a chosen domain and density of samples.

use fantex_base::{Error, Result, counted, input};
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
    /// There is nothing to tabulate, or too much.
    pub fn texels(&self, function: impl Fn([f32; 3]) -> [f32; 4] + Sync) -> Result<Vec<[f32; 4]>> {
        let Self { size, samples, memory_bytes: allowed } = *self;
        let [x, y, z] = size;
        if size.contains(&0) || samples == 0 {
            let samples = counted(samples, "sample");
            let message = format!(
                "a table of {x} x {y} x {z} texels with {samples} each has nothing in it; all must be at least 1"
            );
            return Err(Error::invalid(message));
        }
        let count = size.iter().fold(1_u64, |product, &n| product.saturating_mul(u64::from(n)));
        let needed = count.saturating_mul(size_of::<[f32; 4]>() as u64);
        if needed > allowed {
            let message = format!(
                "a table of {x} x {y} x {z} texels takes {needed} bytes, more than the {allowed} that are allowed; make it smaller or \
                 allow more memory"
            );
            return Err(Error::too_large(message));
        }
        // With the levels that are made of it.
        let what = format_args!("a table of {x} x {y} x {z} texels");
        let _held = input::reserve(what, needed.saturating_add(needed / 3))?;
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
    /// There is nothing to tabulate, or too much.
    pub fn image(&self, function: impl Fn([f32; 3]) -> [f32; 4] + Sync) -> Result<Image> {
        let [width, height, _] = self.size;
        let texels = Self { size: [width, height, 1], ..*self }.texels(function)?;
        Ok(Image::from_linear_rgba(width, height, &texels))
    }

    /// Samples per texel along each axis: a single one along an axis of one texel, in its middle.
    pub fn sample_counts(&self) -> [u32; 3] {
        self.size.map(|n| if n == 1 { 1 } else { self.samples })
    }

    fn mean(&self, texel: [usize; 3], function: &impl Fn([f32; 3]) -> [f32; 4]) -> [f32; 4] {
        let counts = self.sample_counts().map(u64::from);
        let count = counts.iter().fold(1_u64, |product, &n| product.saturating_mul(n));
        let mut sum = [0.0_f64; 4];
        for index in 0..count {
            let sub = [index % counts[0], index / counts[0] % counts[1], index / counts[0] / counts[1]];
            let at = std::array::from_fn(|axis| {
                let inside = (sub[axis] as f32 + 0.5) / counts[axis] as f32;
                (texel[axis] as f32 + inside) / self.size[axis] as f32
            });
            let value = function(at);
            (0..4).for_each(|c| sum[c] += f64::from(value[c]));
        }
        sum.map(|s| (s / count as f64) as f32)
    }
}
