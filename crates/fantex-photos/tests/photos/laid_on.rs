//! Photographs of a real model, laid on it again: they must look like the model itself.

use std::f32::consts::TAU;
use std::sync::OnceLock;

use fantex_bake::{NoProgress, Progress, Source};
use fantex_mesh::Mesh;
use fantex_photos::{CameraFromWorld, Distortion, Lens, PhotoCamera, PhotoOptions, PhotoSource, Photograph};
use fantex_texture::{ColorSpace, Depth, Image, Samples};
use glam::{DVec3, Quat, Vec3};
use tempfile::TempDir;

use crate::common::{
    barrel, bottle, cameras, difference, encoded_color, field_of_view, fisheye, own_look, point_of, take,
    thin_prism,
};

/// Mesh units: the model is two long.
const TEXEL: f32 = 0.004;

/// The model and photographs of it: every second one through a lens, all exposed differently, none from straight below.
struct Shoot {
    mesh: Mesh,
    photographs: Vec<Photograph>,
    exposures: Vec<Vec3>,
    _folder: TempDir,
}

fn shoot() -> Shoot {
    let shoot = shoot_of(|i| Vec3::new(1.0, 0.95, 1.08) * (1.0 + 0.25 * (i as f32 * 1.9).sin()));
    take(&shoot.mesh, &own_look(&shoot.mesh), &shoot.photographs, |i| shoot.exposures[i]);
    shoot
}

/// The same cameras. Their pictures show waves, for tests to which it does not matter what is seen.
fn waves() -> &'static Shoot {
    static WAVES: OnceLock<Shoot> = OnceLock::new();
    WAVES.get_or_init(|| {
        let shoot = shoot_of(|_| Vec3::ONE);
        for (i, photograph) in shoot.photographs.iter().enumerate() {
            let [width, height] = photograph.camera.size;
            let wave = |pixel: u32| {
                let at = Vec3::new((pixel % width) as f32, (pixel / width) as f32, i as f32);
                let phases = Vec3::new(at.x * 0.05 + at.z, at.y * 0.04 + 2.0 * at.z, (at.x + at.y) * 0.03);
                // Greenish.
                let value = Vec3::new(0.3, 0.5, 0.3) + 0.15 * phases.map(f32::sin);
                value.extend(1.0).to_array()
            };
            let pixels: Vec<_> = (0..width * height).map(wave).collect();
            let picture = Image::from_linear_rgb(width, height, &pixels);
            picture.converted(Depth::U8, ColorSpace::Srgb).save(&photograph.path).unwrap();
        }
        shoot
    })
}

/// Cameras around the bottle, before they take pictures.
fn shoot_of(exposure: impl Fn(usize) -> Vec3) -> Shoot {
    let mesh = bottle();
    let folder = tempfile::tempdir().unwrap();
    let lenses = [Lens::new(Distortion::PINHOLE), barrel(), fisheye(), thin_prism(), field_of_view()];
    let photographs = cameras(&mesh, 12, [360, 480], &lenses, folder.path());
    let exposures = (0..photographs.len()).map(exposure).collect();
    Shoot { mesh, photographs, exposures, _folder: folder }
}

fn options() -> PhotoOptions {
    PhotoOptions { texel_size: Some(TEXEL), ..PhotoOptions::default() }
}

#[test]
fn photographs_of_a_model_look_like_the_model_at_half_their_size_too() {
    let Shoot { mesh, photographs, exposures, .. } = &shoot();
    let truth = own_look(mesh);
    let source = PhotoSource::new(mesh, photographs, &options(), &NoProgress).unwrap();
    let report = source.report();
    assert_eq!((report.photographs, report.used), (12, 12));
    // Exposure is found up to a common factor, which no photograph tells.
    let products: Vec<Vec3> = report.gains.iter().zip(exposures).map(|(g, e)| *g * *e).collect();
    let common = products.iter().sum::<Vec3>() / products.len() as f32;
    let off = products.iter().map(|p| (*p / common - 1.0).abs().max_element()).fold(0.0, f32::max);
    assert!(off < 0.02, "gains are off by {off}");
    let leveled = Leveled { source: &source, factor: common.recip() };
    let sure = |p: &fantex_bake::TexelPoint| source.confidence(p.at.index(), p.at.lambda) > 0.3;
    let seen = difference(mesh, [&truth, &leveled], TEXEL, sure);
    eprintln!("seen surface: rms {:.4}, p95 {:.4} at {} points", seen.rms, seen.p95, seen.count);
    assert!(seen.count > 2000 && seen.rms < 0.07 && seen.p95 < 0.02, "{} {}", seen.rms, seen.p95);
    // Without exposure it is far off.
    let raw = PhotoOptions { exposure: false, ..options() };
    let raw = PhotoSource::new(mesh, photographs, &raw, &NoProgress).unwrap();
    assert!(raw.report().gains.iter().all(|&gain| gain == Vec3::ONE));
    assert!(difference(mesh, [&truth, &raw], TEXEL, sure).p95 > 0.05);
    // Those that were made smaller after their calibration fit their cameras all the same.
    let folder = tempfile::tempdir().unwrap();
    let mut smaller = photographs.clone();
    for photograph in &mut smaller {
        let image = Image::load(&photograph.path).unwrap();
        photograph.path = folder.path().join(&photograph.name);
        image.resized(180, 240, fantex_texture::AlphaUse::Independent).save(&photograph.path).unwrap();
    }
    let small = PhotoSource::new(mesh, &smaller, &options(), &NoProgress).unwrap();
    let sure = |p: &fantex_bake::TexelPoint| source.confidence(p.at.index(), p.at.lambda) > 0.5;
    let apart = difference(mesh, [&source, &small], 0.012, sure);
    assert!(apart.p95 < 0.03, "{} {}", apart.rms, apart.p95);
    assert!(small.density().iter().zip(source.density()).all(|(s, l)| (s * 2.0 - l).abs() < 0.02 * l));
}

/// A source times a factor.
struct Leveled<'a> {
    source: &'a PhotoSource<'a>,
    factor: Vec3,
}

impl Source for Leveled<'_> {
    fn channels(&self) -> Vec<fantex_bake::SourceChannel> {
        self.source.channels()
    }

    fn prefilter(&self) -> fantex_bake::Prefilter {
        self.source.prefilter()
    }

    fn evaluate(&self, point: &fantex_bake::TexelPoint, values: &mut [glam::Vec4]) {
        self.source.evaluate(point, values);
        values[0] = (values[0].truncate() * self.factor).extend(1.0);
    }
}

/// Along lines over the surface, and across the edges of the triangles, colours and confidences make no steps.
#[test]
fn weights_fall_to_zero_without_a_step() {
    // A ball, on which nothing but photographs changes the colour; their cameras see most of it.
    let (mesh, _) = fantex_mesh::clean(fantex_mesh::generate::icosphere(5), &Default::default()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let photographs = cameras(&mesh, 7, [300, 300], &[barrel()], folder.path());
    // Every photograph has another colour: transitions between them are as bad as can be.
    for (i, photograph) in photographs.iter().enumerate() {
        let hue = Vec3::new((i as f32).sin(), (i as f32 * 2.0).sin(), (i as f32 * 3.0).sin()) * 0.5 + 0.5;
        let color = Image::from_linear_rgb(300, 300, &vec![hue.extend(1.0).to_array(); 90_000]);
        color.save(&photograph.path).unwrap();
    }
    let options = PhotoOptions { exposure: false, ..options() };
    let source = PhotoSource::new(&mesh, &photographs, &options, &NoProgress).unwrap();
    assert!(source.report().unseen_share > 0.01, "{:?}", source.report());
    let bvh = fantex_mesh::TriangleBvh::new(&mesh);
    let color = |direction: Vec3| {
        let at = bvh.first_hit(Vec3::ZERO, direction, f32::INFINITY).unwrap().point;
        let point = point_of(mesh.triangle_positions(at.index()), at.index(), at.lambda, direction, 1e-3);
        encoded_color(&source, &point)
    };
    let mut largest = [0.0_f32; 2];
    for turn in 0..6 {
        let axis = Vec3::new(0.3, turn as f32 * 0.4 - 1.0, 0.5).normalize();
        let across = axis.any_orthonormal_vector();
        for (largest, steps) in largest.iter_mut().zip([5000, 40_000]) {
            let at = |i: u32| color(Quat::from_axis_angle(axis, i as f32 / steps as f32 * TAU) * across);
            let mut before = at(0);
            for i in 1..=steps {
                let now = at(i);
                *largest = largest.max((now - before).abs().max_element());
                before = now;
            }
        }
    }
    // Where a poor view takes over from a good one at the border of a picture, colours may change within a pixel or two, which is
    // three of the coarser steps; but eight times finer steps are nearly eight times smaller, as those of a jump would not be.
    let [coarse, fine] = largest;
    assert!(coarse < 0.5 && fine < 0.25 * coarse, "{largest:?}");
}

/// Something magenta stands before every camera, and a mask says so.
#[test]
fn what_a_mask_leaves_out_is_not_laid_on() {
    let Shoot { mesh, photographs, .. } = waves();
    let folder = tempfile::tempdir().unwrap();
    let spoiled: Vec<Photograph> = photographs
        .iter()
        .map(|photograph| {
            let mut image = Image::load(&photograph.path).unwrap();
            let Samples::U8(samples) = &mut image.samples else { panic!("pictures of bytes") };
            let is_before = |pixel: usize| pixel % 360 > 200;
            for (pixel, sample) in samples.chunks_mut(usize::from(image.channels)).enumerate() {
                if is_before(pixel) {
                    sample[..3].copy_from_slice(&[255, 0, 255]);
                }
            }
            let path = folder.path().join(&photograph.name);
            image.save(&path).unwrap();
            // A mask of half the size: a file that says the same as well as it can, a pixel more on the side of safety.
            let used: Vec<f32> =
                (0..180 * 240).map(|pixel| f32::from(u8::from(pixel % 180 * 2 < 198))).collect();
            let mask = path.with_extension("mask.png");
            Image::from_linear(180, 240, 1, used)
                .converted(Depth::U8, ColorSpace::Linear)
                .save(&mask)
                .unwrap();
            Photograph { path, mask: Some(mask), ..photograph.clone() }
        })
        .collect();
    let unmasked: Vec<Photograph> = spoiled.iter().map(|p| Photograph { mask: None, ..p.clone() }).collect();
    let options = PhotoOptions { exposure: false, ..options() };
    let share_of_magenta = |photographs: &[Photograph]| {
        let source = PhotoSource::new(mesh, photographs, &options, &NoProgress).unwrap();
        let is_magenta = |triangle: usize| {
            let corners = mesh.triangle_positions(triangle);
            let point = point_of(corners, triangle, Vec3::splat(1.0 / 3.0), Vec3::Y, TEXEL);
            let Vec3 { x, y, z } = encoded_color(&source, &point);
            x.min(z) - y > 0.3
        };
        let triangles = (0..mesh.triangles.len()).step_by(3);
        let count = triangles.len();
        (
            triangles.filter(|&triangle| is_magenta(triangle)).count() as f32 / count as f32,
            source.report().masked,
        )
    };
    let [(spoiled_share, none), (share, all)] = [&unmasked, &spoiled].map(|set| share_of_magenta(set));
    assert!(spoiled_share > 0.1 && share == 0.0, "{spoiled_share} {share}");
    assert_eq!((none, all), (0, photographs.len()));
    // A mask of another shape is refused.
    let mut wrong = spoiled;
    wrong[0].mask = Some(wrong[0].path.with_extension("wide.png"));
    let wide = Image::from_linear(64, 16, 1, vec![1.0; 1024]);
    wide.converted(Depth::U8, ColorSpace::Linear).save(wrong[0].mask.as_ref().unwrap()).unwrap();
    let error = PhotoSource::new(mesh, &wrong, &options, &NoProgress).unwrap_err();
    assert!(error.to_string().contains("has [64, 16] pixels, but its photograph has"), "{error}");
}

/// A green photograph from near by, and a red one from so far that it does not count beside the green one.
#[test]
fn what_a_mask_leaves_out_of_the_best_photograph_the_next_one_shows() {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let mesh = Mesh {
        positions: corners.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    let folder = tempfile::tempdir().unwrap();
    let saved = |name: &str, color: [f32; 4]| {
        let path = folder.path().join(name);
        Image::from_linear_rgb(100, 100, &vec![color; 10_000]).save(&path).unwrap();
        path
    };
    let photograph = |name: &str, color: [f32; 4], distance: f64| Photograph {
        path: saved(name, color),
        mask: None,
        name: name.into(),
        camera: PhotoCamera::pinhole([100, 100], 112.0),
        camera_from_world: CameraFromWorld::looking_at(DVec3::Z * distance, DVec3::ZERO, DVec3::Y),
    };
    let mut photographs =
        [photograph("near.png", [0.0, 1.0, 0.0, 1.0], 3.0), photograph("far.png", [1.0, 0.0, 0.0, 1.0], 4.8)];
    let mask = folder.path().join("mask.png");
    let is_used = |pixel: usize| !((30..70).contains(&(pixel % 100)) && (30..70).contains(&(pixel / 100)));
    let used = (0..10_000).map(|pixel| f32::from(u8::from(is_used(pixel)))).collect();
    Image::from_linear(100, 100, 1, used).converted(Depth::U8, ColorSpace::Linear).save(&mask).unwrap();
    photographs[0].mask = Some(mask);
    let options = PhotoOptions { exposure: false, unseen: Some(Vec3::Z), ..options() };
    let source = PhotoSource::new(&mesh, &photographs, &options, &NoProgress).unwrap();
    // In the middle of the mask, and far from it.
    for (lambda, expected) in [(Vec3::new(0.5, 0.02, 0.48), Vec3::X), (Vec3::new(0.04, 0.92, 0.04), Vec3::Y)]
    {
        let point = point_of(mesh.triangle_positions(0), 0, lambda, Vec3::Z, TEXEL);
        let color = encoded_color(&source, &point);
        assert!(color.abs_diff_eq(expected, 0.02), "{lambda}: {color}");
    }
}

#[test]
fn unseen_surface_takes_the_colours_around_it_or_a_given_one() {
    let Shoot { mesh, photographs, .. } = waves();
    let source = PhotoSource::new(mesh, photographs, &options(), &NoProgress).unwrap();
    let given = PhotoOptions { unseen: Some(Vec3::X), ..options() };
    let given = PhotoSource::new(mesh, photographs, &given, &NoProgress).unwrap();
    let mut unseen = 0;
    for triangle in 0..mesh.triangles.len() {
        let lambda = Vec3::splat(1.0 / 3.0);
        if source.confidence(triangle, lambda) == 0.0 {
            let point = point_of(mesh.triangle_positions(triangle), triangle, lambda, Vec3::Y, TEXEL);
            assert!(encoded_color(&given, &point).abs_diff_eq(Vec3::X, 1e-6));
            // Colours, not none.
            let spread = encoded_color(&source, &point);
            assert!(spread.is_finite() && spread.max_element() > 0.0);
            unseen += 1;
        }
    }
    let share = source.report().unseen_share;
    assert!(unseen > 100 && (0.05..0.5).contains(&share), "{unseen} {share}");
}

/// With next to no memory, pages come from the scratch file, and colours stay the same to the bit.
#[test]
fn little_memory_changes_no_colour() {
    let Shoot { mesh, photographs, .. } = waves();
    let plenty = PhotoSource::new(mesh, photographs, &options(), &NoProgress).unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let little = PhotoOptions { memory_bytes: 1 << 20, scratch: scratch.path().into(), ..options() };
    let little = PhotoSource::new(mesh, photographs, &little, &NoProgress).unwrap();
    assert_eq!(plenty.report().scratch_bytes, 0);
    assert!(little.report().memory_bytes <= 1 << 19 && little.report().scratch_bytes > 4 << 20);
    assert_eq!(std::fs::read_dir(scratch.path()).unwrap().count(), 0, "the scratch file has no name");
    assert_eq!(little.report().gains, plenty.report().gains);
    for triangle in (0..mesh.triangles.len()).step_by(3) {
        let point =
            point_of(mesh.triangle_positions(triangle), triangle, Vec3::new(0.2, 0.3, 0.5), Vec3::Y, TEXEL);
        assert_eq!(encoded_color(&little, &point), encoded_color(&plenty, &point));
    }
    assert!(little.failure().is_none());
}

#[test]
fn what_cannot_be_used_is_said() {
    let Shoot { mesh, photographs, .. } = waves();
    let failure = |photographs: &[Photograph], progress: &dyn Progress| {
        PhotoSource::new(mesh, photographs, &options(), progress).unwrap_err()
    };
    let mut away = photographs[..2].to_vec();
    for photograph in &mut away {
        photograph.camera_from_world.translation += DVec3::new(0.0, 0.0, -1e4);
    }
    let message = failure(&away, &NoProgress).to_string();
    assert!(message.contains("none of 2 photographs sees the model"), "{message}");
    let mut squeezed = photographs[..1].to_vec();
    squeezed[0].camera.size[0] *= 2;
    let message = failure(&squeezed, &NoProgress).to_string();
    assert!(message.contains("another shape"), "{message}");
    struct Cancelled;
    impl Progress for Cancelled {
        fn report(&self, _: u64, _: u64) {}
        fn is_cancelled(&self) -> bool {
            true
        }
    }
    assert!(failure(photographs, &Cancelled).is_cancelled());
    let folder = tempfile::tempdir().unwrap();
    let mut broken = photographs[..1].to_vec();
    broken[0].path = folder.path().join("broken.png");
    std::fs::write(&broken[0].path, b"\x89PNG\r\n\x1a\n rubbish").unwrap();
    let message = failure(&broken, &NoProgress).to_string();
    assert!(message.contains("broken.png"), "{message}");
    // No room for pages.
    let nowhere = PhotoOptions { memory_bytes: 0, scratch: folder.path().join("missing"), ..options() };
    let message = PhotoSource::new(mesh, photographs, &nowhere, &NoProgress).unwrap_err().to_string();
    assert!(message.contains("cannot keep photographs in"), "{message}");
}

/// Glass in front of a wall lets it through by its opacity, a cut-out wholly where its alpha is below the threshold.
#[test]
fn glass_and_cut_outs_are_seen_through() {
    use fantex_bake::TexelPoint;
    use fantex_mesh::{AlphaMode, Material};
    use fantex_photos::{CaptureOptions, CaptureScene};
    use glam::Vec4;

    let quad = |z: f32| [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| Vec3::new(x, y, z));
    let positions = [quad(0.5), quad(0.0)].concat();
    let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
    struct Colors;
    impl Source for Colors {
        fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
            values[0] = if point.position.z > 0.25 {
                Vec4::new(0.0, 1.0, 0.0, 0.25)
            } else {
                Vec4::new(1.0, 0.0, 0.0, 1.0)
            };
        }
    }
    for (alpha, expected) in [
        (AlphaMode::Opaque, Vec3::new(0.0, 1.0, 0.0)),
        (AlphaMode::Blend, Vec3::new(0.75, 0.25, 0.0)),
        (AlphaMode::Mask(0.5), Vec3::new(1.0, 0.0, 0.0)),
        (AlphaMode::Mask(0.2), Vec3::new(0.0, 1.0, 0.0)),
    ] {
        let materials = vec![Material { alpha, ..Material::default() }, Material::default()];
        let mesh = Mesh {
            positions: positions.clone(),
            triangles: triangles.clone(),
            triangle_materials: vec![0, 0, 1, 1],
            materials,
            ..Mesh::default()
        };
        let photograph = Photograph {
            path: "a.png".into(),
            mask: None,
            name: "a.png".into(),
            camera: PhotoCamera::pinhole([9, 9], 20.0),
            camera_from_world: CameraFromWorld::looking_at(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, DVec3::Y),
        };
        let scene = CaptureScene::new(&mesh, &Colors);
        let picture = scene.capture(&photograph, &CaptureOptions::default(), &|| false).unwrap();
        let [r, g, b, _] = picture.linear_texel(4, 4);
        assert!((Vec3::new(r, g, b) - expected).abs().max_element() < 1e-5, "{alpha:?}: {r} {g} {b}");
    }
}

#[test]
fn photographs_that_are_too_large_are_refused_and_long_ones_end_when_they_are_to() {
    use std::sync::atomic::AtomicU32;
    use std::sync::atomic::Ordering::Relaxed;

    use fantex_base::{ErrorKind, ReadLimits, ReadOptions};
    use fantex_photos::{CaptureOptions, CaptureScene};

    let mesh = bottle();
    let look = own_look(&mesh);
    let scene = CaptureScene::new(&mesh, &look);
    let capture = |size, is_cancelled: &(dyn Fn() -> bool + Sync)| {
        let photograph = Photograph {
            path: "a.png".into(),
            mask: None,
            name: "a.png".into(),
            camera: PhotoCamera::pinhole(size, 20.0),
            camera_from_world: CameraFromWorld::looking_at(DVec3::Z, DVec3::ZERO, DVec3::Y),
        };
        scene.capture(&photograph, &CaptureOptions::default(), is_cancelled)
    };
    for size in [[0, 4], [4, 16_385]] {
        let sentence = capture(size, &|| false).unwrap_err().to_string();
        assert!(sentence.contains("both sides must be between 1 and 16384"), "{sentence}");
    }
    let limits = ReadLimits::new(ReadOptions { memory_bytes: 1 << 20, ..ReadOptions::default() });
    let error = limits.run(|| capture([1024, 1024], &|| false)).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::TooLarge, "{error}");
    let asked = AtomicU32::new(0);
    let error = capture([1, 16_384], &|| asked.fetch_add(1, Relaxed) >= 100).unwrap_err();
    assert!(error.is_cancelled() && asked.load(Relaxed) < 1000, "{error}");
    let picture = capture([1, 1], &|| false).unwrap();
    assert_eq!((picture.width, picture.height, picture.channels), (1, 1, 3));
}
