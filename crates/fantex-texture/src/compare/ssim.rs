//! Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error visibility to structural similarity", 2004.

use super::{CompareError, Plane, check_sizes, display_rgb};
use crate::image::Image;

/// Mean structural similarity of the luma (`0.299 R + 0.587 G + 0.114 B` of the sRGB-encoded colours): 1 for equal
/// pictures, smaller otherwise. Gaussian window of 11x11 texels with standard deviation 1.5, `K1 = 0.01`, `K2 = 0.03`,
/// dynamic range 1. As in the paper, only windows that lie inside the picture count, unless it is smaller than one.
pub fn ssim(reference: &Image, test: &Image) -> Result<f64, CompareError> {
    check_sizes(reference, test)?;
    let (a, b) = (luma(reference), luma(test));
    let window = gaussian();
    let mean = |plane: &Plane| plane.separable(&window, &window);
    let (mean_a, mean_b) = (mean(&a), mean(&b));
    let mean_aa = mean(&a.map2(&a, |x, y| x * y));
    let mean_bb = mean(&b.map2(&b, |x, y| x * y));
    let mean_ab = mean(&a.map2(&b, |x, y| x * y));

    let margin = |size: usize| if size >= WINDOW { RADIUS } else { 0 };
    let (mx, my) = (margin(a.width), margin(a.height));
    let (mut sum, mut count) = (0.0, 0_u64);
    for y in my..a.height - my {
        for x in mx..a.width - mx {
            let at = |plane: &Plane| f64::from(plane.values[y * plane.width + x]);
            let moments = [&mean_a, &mean_b, &mean_aa, &mean_bb, &mean_ab].map(at);
            sum += similarity(moments);
            count += 1;
        }
    }
    Ok(sum / count as f64)
}

const WINDOW: usize = 11;
const RADIUS: usize = WINDOW / 2;

/// From the means of `a`, `b`, `a^2`, `b^2` and `a b` in a window.
fn similarity([a, b, aa, bb, ab]: [f64; 5]) -> f64 {
    const C1: f64 = 0.01 * 0.01;
    const C2: f64 = 0.03 * 0.03;
    let (variance_a, variance_b, covariance) = (aa - a * a, bb - b * b, ab - a * b);
    (2.0 * a * b + C1) * (2.0 * covariance + C2) / ((a * a + b * b + C1) * (variance_a + variance_b + C2))
}

fn gaussian() -> [f32; WINDOW] {
    let weight = |i: usize| (-(i as f64 - RADIUS as f64).powi(2) / (2.0 * 1.5 * 1.5)).exp();
    let total: f64 = (0..WINDOW).map(weight).sum();
    std::array::from_fn(|i| (weight(i) / total) as f32)
}

fn luma(image: &Image) -> Plane {
    let values = display_rgb(image).into_iter().map(|[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b).collect();
    Plane { width: image.width as usize, height: image.height as usize, values }
}
