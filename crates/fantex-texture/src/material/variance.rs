//! Roughness that grows by what averaging takes from the normals.
//!
//! Where a footprint covers bumps, the mean of their normals is shorter than one. The lost length is the spread of the
//! microfacets that the mean no longer shows; added to that of the material, the highlight keeps its width and energy under
//! minification. M. Toksvig, "Mipmapping Normal Maps", 2005, gives the variance as `(1 - |n|) / |n|`; M. Olano and D. Baker,
//! "LEAN Mapping", 2010, measure it from second moments of slopes. Both add to `alpha^2 / 2`, the slope variance of a
//! microfacet distribution with `alpha = roughness^2`.

use glam::Vec3;

/// The perceptual roughness (0..1) of a surface with microfacets of `perceptual_roughness` on bumps whose unit normals have
/// the mean `mean_normal` (any frame, length 0..1; a longer one counts as 1, a vanishing one gives roughness 1).
///
/// The texels that the mean was taken of must have unit length: the rounding of 8-bit normals
/// changes the length by up to half a percent.
pub fn widened_roughness(perceptual_roughness: f32, mean_normal: Vec3) -> f32 {
    let length = mean_normal.length().min(1.0);
    roughness_with_variance(perceptual_roughness, (1.0 - length) / length)
}

/// The perceptual roughness (0..1) of a surface with microfacets of `perceptual_roughness` on bumps whose slopes have the
/// variance `slope_variance` along each axis of the tangent plane. Negative variances (rounding) and NaN count as none.
pub fn roughness_with_variance(perceptual_roughness: f32, slope_variance: f32) -> f32 {
    let alpha2 = perceptual_roughness.clamp(0.0, 1.0).powi(4);
    (alpha2 + 2.0 * slope_variance.max(0.0)).min(1.0).sqrt().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_surface_keeps_its_roughness() {
        for roughness in [0.0, 0.1, 0.5, 1.0] {
            assert!((widened_roughness(roughness, Vec3::Y) - roughness).abs() < 1e-6);
            assert!((widened_roughness(roughness, Vec3::Y * 1.01) - roughness).abs() < 1e-6);
        }
    }

    #[test]
    fn shorter_normals_are_rougher() {
        let mut last = 0.2;
        for length in [0.999, 0.99, 0.9, 0.5, 0.1, 0.0] {
            let rougher = widened_roughness(0.2, Vec3::Z * length);
            assert!(rougher >= last && rougher <= 1.0, "{length}: {rougher}");
            last = rougher;
        }
        assert_eq!(last, 1.0);
    }

    /// Gaussian slopes of variance `v` are what a microfacet distribution with `alpha^2 = 2 v` is made of.
    #[test]
    fn bumps_of_a_mirror_become_its_roughness() {
        let variance = 0.02_f32;
        let wanted = (2.0 * variance).sqrt().sqrt();
        assert!((roughness_with_variance(0.0, variance) - wanted).abs() < 1e-6);
        // The mean normal of the same slopes, by quadrature over the Gaussian.
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for i in -60..=60 {
            for j in -60..=60 {
                let [x, y] = [i, j].map(|k| k as f32 / 12.0 * variance.sqrt());
                let weight = (-0.5 * (x * x + y * y) / variance).exp();
                sum += Vec3::new(-x, -y, 1.0).normalize() * weight;
                total += weight;
            }
        }
        let from_length = widened_roughness(0.0, sum / total);
        assert!((from_length - wanted).abs() < 0.01, "{from_length} against {wanted}");
        assert!(roughness_with_variance(0.3, f32::NAN).is_finite());
    }

    /// The density of Beckmann's microfacets about `normal` in the direction `half`, both unit vectors.
    fn beckmann(normal: Vec3, half: Vec3, perceptual_roughness: f32) -> f32 {
        let alpha2 = perceptual_roughness.powi(4);
        let cos2 = normal.dot(half).powi(2);
        (-(1.0 - cos2) / (cos2 * alpha2)).exp() / (std::f32::consts::PI * alpha2 * cos2 * cos2)
    }

    /// The highlight of many bumps under one pixel, averaged over them, is the one that the widened roughness gives.
    #[test]
    fn the_averaged_highlight_of_bumps_is_reproduced() {
        for (roughness, variance) in [(0.2_f32, 0.0005_f32), (0.2, 0.004), (0.3, 0.01), (0.4, 0.02)] {
            let mut normals = Vec::new();
            for i in -80..=80 {
                for j in -80..=80 {
                    let [x, y] = [i, j].map(|k| k as f32 / 20.0);
                    let slope = Vec3::new(-x, -y, 0.0) * variance.sqrt();
                    normals.push(((slope + Vec3::Z).normalize(), (-0.5 * (x * x + y * y)).exp()));
                }
            }
            let total: f32 = normals.iter().map(|(_, weight)| weight).sum();
            let mean = normals.iter().map(|(n, weight)| *n * *weight).sum::<Vec3>() / total;
            let widened = widened_roughness(roughness, mean);
            let peak = beckmann(Vec3::Z, Vec3::Z, widened);
            // From the middle of the highlight to where it has faded.
            for step in 0..8 {
                let half = Vec3::new(step as f32 / 4.0 * widened * widened, 0.0, 1.0).normalize();
                let truth =
                    normals.iter().map(|(n, weight)| weight * beckmann(*n, half, roughness)).sum::<f32>()
                        / total;
                let got = beckmann(Vec3::Z, half, widened);
                assert!(
                    (got - truth).abs() < 0.06 * peak,
                    "roughness {roughness}, variance {variance}, step {step}: {got} against {truth} of {peak}"
                );
            }
            // Without the variance, the peak would be far too bright.
            if variance > 0.001 {
                assert!(beckmann(Vec3::Z, Vec3::Z, roughness) > 2.0 * peak);
            }
        }
    }
}
