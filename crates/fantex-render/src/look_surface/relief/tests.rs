use fantex_texture::{Filtering, UvPoint};

use super::*;

/// Waves over x and y of the position.
struct Waves {
    amplitude: f32,
    frequency: f32,
}

impl Waves {
    fn height(&self, p: Vec3) -> f32 {
        self.amplitude * ((self.frequency * p.x).sin() + (0.7 * self.frequency * p.y).cos())
    }

    /// The unit normal of the plane `z = 0` displaced by the waves.
    fn normal(&self, p: Vec3) -> Vec3 {
        let scale = self.amplitude * self.frequency;
        let x = scale * (self.frequency * p.x).cos();
        let y = -0.7 * scale * (0.7 * self.frequency * p.y).sin();
        Vec3::new(-x, -y, 1.0).normalize()
    }
}

impl Texture for Waves {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        Vec4::splat(self.height(at.position))
    }
}

fn point(position: Vec3, steps: [Vec3; 2], uv: &[UvPoint]) -> ShadingPoint<'_> {
    ShadingPoint {
        position,
        position_steps: steps,
        normal: Vec3::Z,
        normal_steps: [Vec3::ZERO; 2],
        uv,
        vertex_color: Vec4::ONE,
        to_eye: None,
        time: 0.0,
        filtering: Filtering::Own,
    }
}

/// Footprints of any shape: rectangular, mirrored, sheared, rotated.
fn footprints(size: f32) -> [[Vec3; 2]; 4] {
    [
        [Vec3::X, Vec3::Y],
        [Vec3::X, Vec3::NEG_Y],
        [Vec3::new(1.0, 0.8, 0.0), Vec3::new(-0.1, 0.6, 0.0)],
        [Vec3::new(0.0, -2.0, 0.0), Vec3::new(0.5, 0.5, 0.0)],
    ]
    .map(|steps| steps.map(|step| step * size))
}

fn bump(texture: &dyn Texture, difference: Difference) -> Bump<'_> {
    Bump { texture, height: 1.0, difference, least_step: LEAST_STEP }
}

#[test]
fn bumps_have_the_normal_of_the_displaced_plane() {
    let waves = Waves { amplitude: 0.1, frequency: 8.0 };
    for (difference, tolerance) in
        [(Difference::Central, 3e-4), (Difference::Forward, 2e-2), (Difference::Backward, 2e-2)]
    {
        for steps in footprints(0.01) {
            for p in [Vec3::ZERO, Vec3::new(0.3, -0.2, 0.0), Vec3::new(-0.9, 0.45, 0.0)] {
                let bent = bump(&waves, difference).bend(Vec3::Z, &point(p, steps, &[]), false).normal;
                let off = (bent - waves.normal(p)).length();
                assert!(off < tolerance, "{difference:?} at {p} over {steps:?}: off by {off}");
            }
        }
    }
}

#[test]
fn tiny_footprints_do_not_drown_in_rounding() {
    let waves = Waves { amplitude: 0.1, frequency: 8.0 };
    let p = Vec3::new(0.913, -0.377, 0.0);
    for size in [1e-5, 1e-7, 1e-9] {
        let bent = bump(&waves, Difference::Central);
        let bent = bent.bend(Vec3::Z, &point(p, footprints(size)[2], &[]), true);
        assert!((bent.normal - waves.normal(p)).length() < 5e-3, "{size}: {}", bent.normal);
        assert_eq!(bent.slope_variance, 0.0);
    }
}

#[test]
fn bumps_too_fine_to_see_are_variance() {
    // Slopes of sine waves have half their squared amplitude as variance.
    let waves = Waves { amplitude: 1e-4, frequency: 3000.0 };
    let expected = 0.5 * (0.5 * 0.09 + 0.5 * 0.49 * 0.09);
    let n = 400;
    let mean = (0..n)
        .map(|i| {
            let p = Vec3::new(0.013 * i as f32, 0.0077 * i as f32, 0.0) % 1.0;
            bump(&waves, Difference::Central)
                .bend(Vec3::Z, &point(p, [Vec3::X * 0.02, Vec3::Y * 0.02], &[]), true)
                .slope_variance
        })
        .sum::<f32>()
        / n as f32;
    assert!((mean / expected - 1.0).abs() < 0.15, "{mean} against {expected}");
    let smooth = Waves { amplitude: 0.1, frequency: 8.0 };
    let seen =
        bump(&smooth, Difference::Central).bend(Vec3::Z, &point(Vec3::X, footprints(0.002)[2], &[]), true);
    assert!(seen.slope_variance < 1e-4, "{}", seen.slope_variance);
}

#[test]
fn stored_derivatives_bend_as_the_height_does() {
    // The height 0.3 u + 0.1 v, with u along x and v downwards.
    let (range, height) = (0.5, 2.0);
    let texel = Vec4::new(0.0, 0.5 + 0.5 * 0.3 / range, 0.5 + 0.5 * 0.1 / range, 1.0);
    let expected = Vec3::new(-0.3 * height, 0.1 * height, 1.0).normalize();
    for steps in footprints(0.01) {
        let uv = [UvPoint { uv: Vec2::ZERO, steps: steps.map(|s| Vec2::new(s.x, -s.y)) }];
        let at = point(Vec3::ZERO, steps, &uv);
        let bent =
            DerivativeMap { texture: &texel, uv_set: 0, scale: height * range }.bend(Vec3::Z, &at, true);
        assert_eq!(bent.slope_variance, 0.0);
        let bent = bent.normal;
        assert!((bent - expected).length() < 1e-5, "{bent} against {expected}");
    }
}

#[test]
fn normal_maps_follow_their_frame() {
    let texel = Vec3::new(0.6, 0.0, 0.8);
    let object = bend_by_normal(Vec3::Z, Vec3::Z, texel, 1.0, None);
    assert!((object.normal - texel).length() < 1e-6 && object.slope_variance < 1e-3);
    let stronger = bend_by_normal(Vec3::Z, Vec3::Z, texel, 2.0, None).normal;
    assert!((stronger - Vec3::new(1.2, 0.0, 0.8).normalize()).length() < 1e-6);
    let normals = [Vec3::Y; 3];
    let frame = TangentFrame::at(&normals, &[Vec4::new(0.0, 0.0, 1.0, 1.0); 3], 0, Vec3::X);
    let tangent = bend_by_normal(Vec3::Y, Vec3::Y, texel, 1.0, Some(&frame)).normal;
    assert!((tangent - Vec3::new(0.0, 0.8, 0.6)).length() < 1e-6, "{tangent}");
}

#[test]
fn one_relief_upon_another_adds_up() {
    let tilt = Vec3::new(0.1, 0.0, 1.0).normalize();
    let both = bend_by_normal(tilt, Vec3::Z, Vec3::new(0.1, 0.0, 1.0).normalize(), 1.0, None).normal;
    assert!((both.x / both.z - 0.2).abs() < 5e-3, "{both}");
}

#[test]
fn short_mean_normals_are_rough() {
    let spread = bend_by_normal(Vec3::Z, Vec3::Z, Vec3::Z * 0.8, 1.0, None).slope_variance;
    assert!((spread - 0.25).abs() < 0.01, "{spread}");
    assert_eq!(mean_normal_variance(0.998), 0.0);
    assert!(mean_normal_variance(0.0).is_finite());
}
