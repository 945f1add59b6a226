//! Properties of coverage and visibility: no gaps, no double hits, the right triangle, the right point.

use fantex_base::ErrorKind;
use fantex_mesh::Mesh;
use fantex_render::{
    Background, Camera, Coverage, FlatShading, FlatSurface, Hit, Interpolation, Lights, MaterialSample,
    Picture, RenderOptions, Shaded, Shading, ShadingRate, StopSignal, Surface, render,
};
use glam::{DVec3, Vec3};

use crate::common;
use crate::common::{cast, frontal, ray, sheet, sphere, square};

fn options(samples: u32) -> RenderOptions {
    RenderOptions {
        width: 97,
        height: 61,
        samples,
        background: Background::Transparent,
        ..RenderOptions::default()
    }
}

fn picture(mesh: &Mesh, surface: &dyn Surface, camera: &Camera, options: &RenderOptions) -> Picture {
    render(mesh, surface, camera, &Lights::default(), options).unwrap().picture
}

/// Half transparent everywhere: a sample hit once has alpha 1/2, one missed 0, one hit twice 3/4.
struct Half;

impl Surface for Half {
    fn shade(&self, _: &Hit) -> Shaded<'_> {
        (MaterialSample { alpha: 0.5, ..MaterialSample::with_normal(Vec3::Z) }, None)
    }

    fn coverage(&self, _: usize) -> Coverage {
        Coverage::Layered
    }
}

#[test]
fn a_sheet_over_the_whole_picture_is_hit_exactly_once_everywhere() {
    for (seed, samples) in [1, 2, 3, 4, 5, 8, 13, 16, 64].into_iter().enumerate() {
        for cells in [1, 7, 40, 200] {
            let mesh = sheet(cells, 0.1 / cells as f32, seed as u64);
            let seen = picture(&mesh, &Half, &frontal(1.0, 50.0), &options(samples));
            assert!(seen.rgba.iter().all(|p| p[3] == 0.5), "{cells} cells, {samples} samples");
        }
    }
}

/// Before its first tile, so that it does not depend on how long one takes.
#[test]
fn a_rendering_that_is_stopped_gives_no_picture() {
    let stop = StopSignal::default();
    let options = RenderOptions { stop: Some(stop.clone()), ..options(1) };
    let mesh = sheet(7, 0.0, 0);
    let draw = || render(&mesh, &Half, &frontal(1.0, 50.0), &Lights::default(), &options);
    assert!(draw().is_ok());
    stop.give();
    assert!(draw().unwrap_err().is_cancelled());
}

#[test]
fn edges_through_sample_positions_belong_to_one_side() {
    // Corners at whole and half pixels: the samples of one and four per pixel lie exactly on edges.
    let camera = frontal(1.0, 90.0);
    let options = RenderOptions { width: 64, height: 64, ..options(1) };
    let mut mesh = sheet(64, 0.0, 3);
    for (i, p) in mesh.positions.iter_mut().enumerate() {
        *p = Vec3::new((i % 65) as f32 + 0.5, (i / 65) as f32 - 0.5, 0.0) / 32.0 - Vec3::new(1.0, 1.0, 0.0);
    }
    let seen = picture(&mesh, &Half, &camera, &options);
    let (inner, border): (Vec<_>, Vec<_>) =
        (0..64 * 64).partition(|i| (1..63).contains(&(i % 64)) && (1..63).contains(&(i / 64)));
    assert!(inner.iter().all(|&i: &usize| seen.rgba[i][3] == 0.5));
    assert!(border.iter().all(|&i| seen.rgba[i][3] == 0.5 || seen.rgba[i][3] == 0.0));
}

/// Compares the middle of every pixel with a ray.
fn assert_matches_rays(mesh: &Mesh, camera: &Camera, interpolation: Interpolation, tolerance: f32) {
    let options = RenderOptions { interpolation, ..options(1) };
    let size = [options.width, options.height];
    let by_lambda = FlatSurface::new(mesh, FlatShading::Unlit, |hit: &Hit| hit.at.lambda);
    let by_triangle =
        FlatSurface::new(mesh, FlatShading::Unlit, |hit: &Hit| Vec3::splat(hit.triangle() as f32));
    let lambda = picture(mesh, &by_lambda, camera, &options);
    let triangles = picture(mesh, &by_triangle, camera, &options);
    let (mut compared, mut on_edges) = (0, 0);
    for y in 0..size[1] {
        for x in 0..size[0] {
            let hit = cast(mesh, camera.eye, ray(camera, size, f64::from(x) + 0.5, f64::from(y) + 0.5));
            let seen = (triangles.pixel(x, y), lambda.pixel(x, y));
            match hit {
                Some((t, expected)) if seen.0[3] == 1.0 && seen.0[0] == t as f32 => {
                    let error = (Vec3::from_slice(&seen.1[..3]) - expected.as_vec3()).abs().max_element();
                    assert!(error < tolerance, "{x},{y}: {:?} instead of {expected}", seen.1);
                    compared += 1;
                }
                None if seen.0[3] == 0.0 => compared += 1,
                // Corners are rounded to 1/256 pixel, so a ray close to an edge may fall on its other side.
                _ => on_edges += 1,
            }
        }
    }
    assert!(on_edges * 50 < compared, "{on_edges} of {compared} differ");
}

#[test]
fn points_are_where_rays_meet_the_mesh() {
    let camera =
        Camera { eye: DVec3::new(0.9, -1.3, 0.8), target: DVec3::ZERO, up: DVec3::Z, fov_degrees: 60.0 };
    assert_matches_rays(&sheet(5, 0.2, 1), &camera, Interpolation::Perspective, 2e-3);
    assert_matches_rays(&sphere(8, 0.8), &camera, Interpolation::Perspective, 5e-3);
}

#[test]
fn affine_interpolation_is_wrong_in_perspective_and_right_without() {
    let oblique =
        Camera { eye: DVec3::new(0.0, -1.3, 0.4), target: DVec3::ZERO, up: DVec3::Z, fov_degrees: 60.0 };
    let wrong = std::panic::catch_unwind(|| {
        assert_matches_rays(&sheet(2, 0.0, 1), &oblique, Interpolation::Affine, 2e-2);
    });
    assert!(wrong.is_err());
    assert_matches_rays(&sheet(2, 0.0, 1), &frontal(1.5, 60.0), Interpolation::Affine, 2e-3);
}

#[test]
fn an_eye_inside_the_mesh_sees_it_all_around() {
    let mesh = sphere(10, 1.0);
    for target in [DVec3::X, DVec3::NEG_Z, DVec3::new(1.0, 2.0, -0.5), DVec3::new(0.01, -1.0, 0.0)] {
        let camera = Camera { eye: DVec3::new(0.3, 0.2, -0.1), target, up: DVec3::Y, fov_degrees: 110.0 };
        let seen = picture(&mesh, &Half, &camera, &options(4));
        assert!(seen.rgba.iter().all(|p| p[3] == 0.5), "towards {target}");
        assert_matches_rays(&mesh, &camera, Interpolation::Perspective, 5e-3);
    }
}

#[test]
fn triangles_around_the_near_plane_and_far_off_the_screen_leave_no_gaps() {
    // A floor that passes right under the eye and reaches far behind it.
    let mut mesh = sheet(9, 0.0, 5);
    mesh.positions.iter_mut().for_each(|p| *p = Vec3::new(p.x, -0.001, p.y));
    let camera =
        Camera { eye: DVec3::ZERO, target: DVec3::new(0.1, -0.3, 0.9), up: DVec3::Y, fov_degrees: 20.0 };
    let seen = picture(&mesh, &Half, &camera, &options(4));
    assert!(seen.rgba.iter().all(|p| p[3] == 0.5));
}

#[test]
fn degenerate_and_broken_triangles_do_no_harm() {
    let mut mesh = sphere(6, 0.5);
    let n = mesh.positions.len() as u32;
    mesh.positions.extend([
        Vec3::NAN,
        Vec3::splat(f32::INFINITY),
        Vec3::splat(1e30),
        Vec3::Z * 1.5,
        Vec3::ZERO,
    ]);
    mesh.triangles.extend([
        [n, 0, 1],
        [n + 1, 1, 2],
        [n + 2, 2, 3],
        [n + 3, 0, 5],
        [1, 1, 2],
        [4, 4, 4],
        [n + 4, n + 3, 0],
    ]);
    for shading in [Shading::MetallicRoughness, Shading::BlinnPhong, Shading::Normal] {
        let surface = FlatSurface::new(&mesh, FlatShading::Smooth, |_: &Hit| Vec3::ONE);
        let seen = picture(&mesh, &surface, &frontal(1.5, 60.0), &RenderOptions { shading, ..options(4) });
        assert!(seen.rgba.iter().flatten().all(|v| v.is_finite()), "{shading:?}");
    }
}

#[test]
fn single_sided_triangles_are_seen_from_the_front_only() {
    struct OneSided;
    impl Surface for OneSided {
        fn shade(&self, hit: &Hit) -> Shaded<'_> {
            assert!(hit.front);
            (MaterialSample::with_normal(Vec3::Z), None)
        }
        fn is_double_sided(&self, _: usize) -> bool {
            false
        }
    }
    let mesh = sheet(4, 0.0, 1);
    let alpha = |eye: f64| picture(&mesh, &OneSided, &frontal(eye, 40.0), &options(1)).pixel(48, 30)[3];
    assert_eq!(alpha(1.5), 1.0);
    assert_eq!(alpha(-1.5), 0.0);
}

#[test]
fn pictures_do_not_depend_on_threads() {
    let mesh = sheet(150, 0.02, 9);
    let surface = FlatSurface::new(&mesh, FlatShading::Faceted, common::triangle_color);
    let with_threads = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| picture(&mesh, &surface, &frontal(1.2, 70.0), &options(8)))
    };
    assert_eq!(with_threads(1), with_threads(4));
}

/// A stack of tinted panes, of which each hides a twentieth of what lies behind.
struct Panes;

impl Panes {
    const ALPHA: f32 = 0.05;

    fn color(pane: usize) -> Vec3 {
        Vec3::new((pane % 2) as f32, (pane % 5) as f32 * 0.25, 0.5)
    }
}

impl Surface for Panes {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        let pane = MaterialSample {
            alpha: Self::ALPHA,
            base_color: Self::color(hit.triangle() / 2),
            unlit: true,
            ..MaterialSample::with_normal(Vec3::Z)
        };
        (pane, None)
    }

    fn coverage(&self, _: usize) -> Coverage {
        Coverage::Layered
    }
}

#[test]
fn many_layers_are_composited_from_the_farthest_to_the_nearest() {
    const COUNT: usize = 60;
    let pane = square();
    let mut mesh = Mesh::default();
    for i in 0..COUNT {
        // In no order: 37 has no divisor in common with 60.
        let depth = (i * 37 % COUNT) as f32 / COUNT as f32;
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(pane.positions.iter().map(|p| Vec3::new(p.x * 9.0, p.y * 9.0, depth)));
        mesh.triangles.extend(pane.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    let mut farthest_first: Vec<usize> = (0..COUNT).collect();
    farthest_first.sort_by_key(|i| i * 37 % COUNT);
    let mut expected = Vec3::ZERO;
    for pane in farthest_first {
        expected = expected.lerp(Panes::color(pane), Panes::ALPHA);
    }
    let options = RenderOptions { background: Background::Color(Vec3::ZERO), ..options(4) };
    for shading_rate in [ShadingRate::PerPixel, ShadingRate::PerSample] {
        let options = RenderOptions { shading_rate, ..options.clone() };
        let seen = render(&mesh, &Panes, &frontal(3.0, 40.0), &Lights::default(), &options).unwrap();
        for pixel in &seen.picture.rgba {
            let difference = (Vec3::from_slice(&pixel[..3]) - expected).abs().max_element();
            assert!(difference < 1e-4, "{pixel:?} instead of {expected}");
        }
        let pieces = if shading_rate == ShadingRate::PerPixel { 1 } else { 4 };
        // The diagonal of the panes counts twice.
        assert!(seen.stats.shaded >= COUNT as u64 * 97 * 61 * pieces);
    }
}

#[test]
fn supersampling_and_multisampling_agree_on_flat_colours() {
    let mesh = sheet(6, 0.1, 2);
    let surface = FlatSurface::new(&mesh, FlatShading::Unlit, common::triangle_color);
    let with_rate = |shading_rate| {
        picture(&mesh, &surface, &frontal(1.2, 70.0), &RenderOptions { shading_rate, ..options(8) })
    };
    let (a, b) = (with_rate(ShadingRate::PerPixel), with_rate(ShadingRate::PerSample));
    let differ = |(a, b): (&[f32; 4], &[f32; 4])| (0..4).any(|c| (a[c] - b[c]).abs() > 1e-5);
    assert!(!a.rgba.iter().zip(&b.rgba).any(differ));
}

#[test]
fn impossible_requests_are_refused() {
    let mesh = sheet(1, 0.0, 1);
    let error = |camera: Camera, options: RenderOptions| {
        render(&mesh, &Half, &camera, &Lights::default(), &options).unwrap_err()
    };
    let camera = frontal(1.0, 50.0);
    for (camera, options, what) in [
        (camera, RenderOptions { width: 0, ..options(1) }, "0x61 pixels"),
        (camera, options(0), "0 samples"),
        (camera, options(65), "65 samples"),
        (Camera { target: camera.eye, ..camera }, options(1), "this camera"),
        (Camera { fov_degrees: 180.0, ..camera }, options(1), "this camera"),
    ] {
        let error = error(camera, options);
        assert_eq!(error.kind(), ErrorKind::InvalidArgument);
        assert!(error.to_string().contains(what), "{error}");
    }
}
