//! Maps between texture and image space, and both ways to warp.

use std::sync::Arc;

use fantex_base::input::{ReadLimits, ReadOptions};
use fantex_texture::warp::{
    AffineMap, BilinearMap, PlaneMap, ProjectiveMap, Spread, warp_forward, warp_inverse,
};
use fantex_texture::{Filter, Image, ImageTexture, SampleOptions, Wrap};
use glam::{DMat2, DMat3, DVec2, DVec3};
use proptest::prelude::*;

fn point() -> impl Strategy<Value = DVec2> {
    (-1.0..1.0, -1.0..1.0).prop_map(|(x, y)| DVec2::new(x, y))
}

fn unit() -> impl Strategy<Value = DVec2> {
    (0.0..1.0, 0.0..1.0).prop_map(|(x, y)| DVec2::new(x, y))
}

/// A convex quadrilateral round the origin, each corner in its quadrant: (-,-), (+,-), (+,+), (-,+).
fn convex_quad() -> impl Strategy<Value = [DVec2; 4]> {
    let corner = || (40.0..60.0, 40.0..60.0).prop_map(|(x, y)| DVec2::new(x, y));
    let signs = [DVec2::NEG_ONE, DVec2::new(1.0, -1.0), DVec2::ONE, DVec2::new(-1.0, 1.0)];
    [corner(), corner(), corner(), corner()].prop_map(move |quad| std::array::from_fn(|i| quad[i] * signs[i]))
}

const SQUARE: [DVec2; 4] = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];

fn assert_inverse(map: &dyn PlaneMap, uv: DVec2) {
    let back = map.inverse(map.map(uv));
    assert!(back.is_some_and(|back| back.distance(uv) < 1e-8), "{uv} came back as {back:?}");
}

fn assert_jacobian(map: &dyn PlaneMap, uv: DVec2) {
    let step = 1e-6;
    let column = |axis: DVec2| (map.map(uv + axis * step) - map.map(uv - axis * step)) / (2.0 * step);
    let difference = map.jacobian(uv) - DMat2::from_cols(column(DVec2::X), column(DVec2::Y));
    assert!(difference.to_cols_array().iter().all(|d| d.abs() < 1e-4), "{difference} at {uv}");
}

proptest! {
    #[test]
    fn affine_maps_lead_back(a in point(), b in point(), origin in point(), uv in point()) {
        prop_assume!(a.perp_dot(b).abs() > 1e-3);
        let map = AffineMap::new(DMat2::from_cols(a, b), origin).unwrap();
        assert_inverse(&map, uv);
        assert_jacobian(&map, uv);
        let points = [DVec2::ZERO, DVec2::X, DVec2::new(0.3, 2.0)];
        let again = AffineMap::from_points(points, points.map(|uv| map.map(uv))).unwrap();
        prop_assert!(again.map(uv).distance(map.map(uv)) < 1e-9);
    }

    #[test]
    fn projective_maps_lead_back(from in convex_quad(), quad in convex_quad(), uv in unit()) {
        let map = ProjectiveMap::from_quad(quad).unwrap();
        for (corner, position) in SQUARE.into_iter().zip(quad) {
            prop_assert!(map.map(corner).distance(position) < 1e-9);
        }
        assert_inverse(&map, uv);
        assert_jacobian(&map, uv);
        let between = ProjectiveMap::from_points(from, quad).unwrap();
        for (corner, position) in from.into_iter().zip(quad) {
            prop_assert!(between.map(corner).distance(position) < 1e-8);
        }
        let inside = from[0] * (1.0 - uv.x) + from[2] * uv.x;
        assert_inverse(&between, inside);
    }

    #[test]
    fn bilinear_maps_lead_back(quad in convex_quad(), uv in unit()) {
        let map = BilinearMap::from_quad(quad).unwrap();
        for (corner, position) in SQUARE.into_iter().zip(quad) {
            prop_assert!(map.map(corner).distance(position) < 1e-9);
            assert_inverse(&map, corner);
        }
        assert_inverse(&map, uv);
        assert_jacobian(&map, uv);
        prop_assert_eq!(map.inverse(DVec2::splat(200.0)), None);
    }

    #[test]
    fn bilinear_maps_of_parallelograms_are_affine(a in point(), b in point(), origin in point(), uv in unit()) {
        prop_assume!(a.perp_dot(b).abs() > 1e-3);
        // Almost a parallelogram, too: the quadratic's first coefficient nearly vanishes.
        for twist in [0.0, 1e-15, 1e-9, 1e-5] {
            let quad = [origin, origin + a, origin + a + b + DVec2::splat(twist), origin + b];
            assert_inverse(&BilinearMap::from_quad(quad).unwrap(), uv);
        }
    }
}

#[test]
fn horizons_have_nothing_beyond() {
    // A floor that recedes upwards: y = 100 / v', the horizon at y = 0.
    let map = ProjectiveMap::from_quad([
        DVec2::new(-10.0, 10.0),
        DVec2::new(10.0, 10.0),
        DVec2::new(100.0, 100.0),
        DVec2::new(-100.0, 100.0),
    ])
    .unwrap();
    let near = map.inverse(DVec2::new(3.0, 1e-3)).unwrap();
    assert!(near.length() > 1e3, "{near} lies far away");
    assert_eq!(map.inverse(DVec2::new(3.0, -1e-3)), None);
    assert_eq!(map.inverse(DVec2::new(3.0, -50.0)), None);

    // A floor that goes on behind the eye: its horizon crosses the texture at v = 1/2.
    let map = ProjectiveMap::new(DMat3::from_cols(
        DVec3::new(30.0, 0.0, 0.0),
        DVec3::new(0.0, 0.0, -2.0),
        DVec3::new(0.0, 8.0, 1.0),
    ))
    .unwrap();
    for spread in [Spread::Area, Spread::Bilinear] {
        let warped = warp_forward(&smooth_image(32), &map, [40, 40], spread).unwrap();
        let covered = |y: u32| (0..40).any(|x| warped.linear_texel(x, y)[3] > 0.0);
        assert!(!covered(6) && covered(9), "{spread:?}: the floor lies below its nearest edge");
    }
}

#[test]
fn corners_on_a_line_are_refused() {
    let line = [0.0, 1.0, 2.0, 3.0].map(|x| DVec2::new(x, 2.0 * x));
    let affine = AffineMap::from_points([line[0], line[1], line[2]], [line[0]; 3]).unwrap_err();
    let nan = [DVec2::NAN, DVec2::X, DVec2::ONE, DVec2::Y];
    let of_quad =
        |quad| [ProjectiveMap::from_quad(quad).unwrap_err(), BilinearMap::from_quad(quad).unwrap_err()];
    for error in of_quad(line).into_iter().chain([affine]) {
        assert!(error.to_string().ends_with("three of them lie on one line"), "{error}");
    }
    for error in of_quad(nan) {
        assert!(error.to_string().ends_with("needs finite numbers"), "{error}");
    }
    let identity = AffineMap::new(DMat2::IDENTITY, DVec2::ZERO).unwrap();
    let image = smooth_image(2);
    let refused = warp_forward(&image, &identity, [0, 5], Spread::Area).unwrap_err();
    assert!(refused.to_string().starts_with("cannot warp into 0 x 5 pixels"), "{refused}");
}

/// Waves a third of the image long, with alpha 1.
fn smooth_image(side: u32) -> Image {
    let texels: Vec<[f32; 4]> = (0..side * side)
        .map(|i| {
            let [x, y] = [i % side, i / side].map(|k| (k as f32 + 0.5) / side as f32);
            [
                0.5 + 0.4 * (19.0 * x).sin(),
                0.5 + 0.4 * (15.0 * y).cos(),
                0.5 + 0.4 * (9.0 * (x + y)).sin(),
                1.0,
            ]
        })
        .collect();
    Image::from_linear_rgba(side, side, &texels)
}

#[test]
fn both_ways_agree_on_smooth_images() {
    let quad = [DVec2::new(9.3, 5.1), DVec2::new(58.2, 12.7), DVec2::new(51.0, 60.2), DVec2::new(4.9, 44.4)];
    let maps: [(&str, Box<dyn PlaneMap>); 3] = [
        (
            "affine",
            Box::new(
                AffineMap::from_points([SQUARE[0], SQUARE[1], SQUARE[3]], [quad[0], quad[1], quad[3]])
                    .unwrap(),
            ),
        ),
        ("projective", Box::new(ProjectiveMap::from_quad(quad).unwrap())),
        ("bilinear", Box::new(BilinearMap::from_quad(quad).unwrap())),
    ];
    // A texture of more texels than pixels, and one of fewer (which the area spread shows as squares).
    for (name, map) in &maps {
        for (side, spread, tolerance) in
            [(200, Spread::Bilinear, 0.04), (200, Spread::Area, 0.03), (64, Spread::Area, 0.04)]
        {
            let image = smooth_image(side);
            let forward = warp_forward(&image, map.as_ref(), [64, 64], spread).unwrap();
            let texture = ImageTexture::new(Arc::new(image));
            let options = SampleOptions {
                wrap: [Wrap::Border; 2],
                filter: Filter::Anisotropic,
                ..SampleOptions::default()
            };
            let inverse = warp_inverse(&texture, map.as_ref(), [64, 64], &options).unwrap();
            let (mut compared, mut worst) = (0, 0.0_f32);
            for (x, y) in (0..64 * 64).map(|i| (i % 64, i / 64)) {
                let (a, b) = (forward.linear_texel(x, y), inverse.linear_texel(x, y));
                let is_inside = [0, 1].iter().all(|dx| {
                    [0, 1].iter().all(|dy| {
                        let corner = DVec2::new(f64::from(x + dx), f64::from(y + dy));
                        map.inverse(corner).is_some_and(|uv| (uv - 0.5).abs().max_element() < 0.47)
                    })
                });
                if is_inside {
                    compared += 1;
                    let error = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                    worst = worst.max(error);
                }
            }
            assert!(compared > 1000, "{name}: {compared} pixels inside");
            assert!(worst < tolerance, "{name} {spread:?} of {side} texels: off by {worst}");
        }
    }
}

/// 64 x 64 pixels: 56 bytes each forwards, 16 each the other way.
#[test]
fn pixels_count_against_the_memory_that_is_allowed() {
    let image = smooth_image(8);
    let map = AffineMap::new(DMat2::from_diagonal(DVec2::splat(64.0)), DVec2::ZERO).unwrap();
    let within = |memory_bytes| ReadLimits::new(ReadOptions { memory_bytes, ..ReadOptions::default() });
    let forwards = || warp_forward(&image, &map, [64; 2], Spread::Area);
    within(56 << 12).run(forwards).unwrap();
    let error = within((56 << 12) - 1).run(forwards).unwrap_err().to_string();
    assert!(error.starts_with("warping into 64 x 64 pixels would take 229376 bytes of memory"), "{error}");
    let texture = ImageTexture::new(Arc::new(image.clone()));
    let backwards = || warp_inverse(&texture, &map, [64; 2], &SampleOptions::default());
    within(16 << 12).run(backwards).unwrap();
    let error = within((16 << 12) - 1).run(backwards).unwrap_err().to_string();
    assert!(error.starts_with("warping into 64 x 64 pixels would take 65536 bytes of memory"), "{error}");
}

#[test]
fn area_spread_covers_exactly() {
    // A square of 10.5 x 4 pixels: its edge pixels are half covered.
    let map = AffineMap::new(DMat2::from_diagonal(DVec2::new(10.5, 4.0)), DVec2::new(2.0, 3.0)).unwrap();
    let image = Image::from_linear_rgba(7, 3, &[[0.25, 0.5, 1.0, 1.0]; 21]);
    let warped = warp_forward(&image, &map, [16, 16], Spread::Area).unwrap();
    let total: f32 = (0..256).map(|i| warped.linear_texel(i % 16, i / 16)[3]).sum();
    assert!((total - 42.0).abs() < 1e-4, "{total} of 42 pixels are covered");
    crate::common::assert_close(warped.linear_texel(12, 4), [0.25, 0.5, 1.0, 0.5], 1e-6, "edge");
    crate::common::assert_close(warped.linear_texel(5, 4), [0.25, 0.5, 1.0, 1.0], 1e-6, "inside");
    assert_eq!(warped.linear_texel(1, 4), [0.0; 4]);
}

/// At the border of a bilinear warp alpha is the covered share of a pixel, as clipping says; and inside it is one.
#[test]
fn bilinear_warps_end_smoothly() {
    let quad = [[3.3, 2.1], [36.4, 6.2], [30.7, 37.9], [6.5, 28.6]].map(DVec2::from_array);
    let map = BilinearMap::from_quad(quad).unwrap();
    let white = Image::from_linear(8, 8, 1, vec![1.0; 64]);
    let options = SampleOptions { wrap: [Wrap::Clamp; 2], ..SampleOptions::default() };
    let inverse =
        warp_inverse(&ImageTexture::new(Arc::new(white.clone())), &map, [40, 40], &options).unwrap();
    let forward = warp_forward(&white, &map, [40, 40], Spread::Area).unwrap();
    let mut partial = 0;
    for (x, y) in (0..40).flat_map(|y| (0..40).map(move |x| (x, y))) {
        let [share, exact] = [&inverse, &forward].map(|image| image.linear_texel(x, y)[3]);
        assert!((share - exact).abs() < 0.04, "{x}, {y}: {share} instead of {exact}");
        partial += u32::from(share > 0.05 && share < 0.95);
    }
    assert!(partial > 80, "{partial} pixels at a border of about 120");
}
