//! Cut-outs and highlights under minification; images of materials.

use fantex_base::{ErrorKind, ReadLimits, ReadOptions};
use fantex_mesh::{
    AlphaMode, BumpImage, CleanOptions, CornerAttributes, ImageChannel, ImageSource, Material, Mesh, Model,
    PackedChannel, PackedImage, TextureRef, WrapMode, clean,
};
use fantex_texture::material::{
    AlphaCoverage, LeftOut, MaterialTextures, ROUNDED_LENGTH, TextureLayer, load_material_textures,
    preserve_coverage, read_image, roughness_with_variance,
};
use fantex_texture::{ColorSpace, Depth, Filter, Image, ImageTexture, SampleOptions, Samples, Wrap};
use glam::{DVec3, Mat3, Vec2, Vec3};
use std::sync::Arc;

/// Leaves: soft blobs of random size and place.
fn leaves(side: u32) -> ImageTexture {
    let mut state = 1_u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let blobs: Vec<_> = (0..60).map(|_| [random(), random(), 0.015 + 0.04 * random()]).collect();
    let texel = |i: u32| {
        let [x, y] = [i % side, i / side].map(|c| (c as f32 + 0.5) / side as f32);
        let inside = |&[bx, by, r]: &[f32; 3]| {
            let wrapped = |d: f32| d - d.round();
            (1.5 - wrapped(x - bx).hypot(wrapped(y - by)) / r).clamp(0.0, 1.0)
        };
        let alpha = blobs.iter().map(inside).fold(0.0, f32::max);
        [0.1, 0.4, 0.1, alpha]
    };
    let texels: Vec<_> = (0..side * side).map(texel).collect();
    ImageTexture::new(Arc::new(Image::from_linear_rgba(side, side, &texels)))
}

fn covered_at(texture: &ImageTexture, level: usize, threshold: f32) -> f32 {
    let options = SampleOptions { filter: Filter::Trilinear, ..SampleOptions::default() };
    let width = (1 << level) as f32 / texture.size()[0] as f32;
    let points = 300;
    let seen = (0..points * points).filter(|i| {
        let uv = Vec2::new((i % points) as f32, (i / points) as f32) / points as f32;
        texture.sample(uv, [Vec2::X * width, Vec2::Y * width], &options)[3] >= threshold
    });
    seen.count() as f32 / (points * points) as f32
}

/// The density of Beckmann's microfacets about `normal` in the direction `half`, both unit vectors.
fn beckmann(normal: Vec3, half: Vec3, perceptual_roughness: f32) -> f32 {
    let alpha2 = perceptual_roughness.powi(4);
    let cos2 = normal.dot(half).powi(2);
    (-(1.0 - cos2) / (cos2 * alpha2)).exp() / (std::f32::consts::PI * alpha2 * cos2 * cos2)
}

#[test]
fn cut_outs_share_their_images() {
    let samples = Samples::U8(vec![255; 3 * 16]);
    let opaque = Image { width: 4, height: 4, channels: 3, space: ColorSpace::Srgb, samples };
    let [leaves, opaque] = [leaves(16), ImageTexture::new(Arc::new(opaque))].map(Arc::new);
    let layer = |texture: &Arc<ImageTexture>| TextureLayer {
        uv_set: 0,
        uv_transform: Mat3::IDENTITY,
        wrap: [Wrap::Repeat; 2],
        nearest: false,
        texture: texture.clone(),
    };
    let uses = [(0.5, &leaves), (0.5, &leaves), (0.7, &leaves), (0.5, &opaque)];
    let materials = uses.map(|(t, _)| Material { alpha: AlphaMode::Mask(t), ..Material::default() });
    let mut textures =
        uses.map(|(_, image)| MaterialTextures { base_color: Some(layer(image)), ..Default::default() });
    preserve_coverage(&materials, &mut textures);
    let [first, same, other, kept] = textures.map(|textures| textures.base_color.unwrap().texture);
    assert!(Arc::ptr_eq(&first, &same) && Arc::ptr_eq(&kept, &opaque));
    assert!(!Arc::ptr_eq(&first, &leaves) && !Arc::ptr_eq(&first, &other));
}

#[test]
fn cut_outs_cover_the_same_share_at_every_level() {
    let threshold = 0.6;
    let plain = leaves(256);
    let kept = plain.clone().with_preserved_coverage(threshold);
    let near = covered_at(&plain, 0, threshold);
    assert!((AlphaCoverage::of(&plain, threshold).covered() - near).abs() < 0.01);
    for level in 1..5 {
        let (without, with) = (covered_at(&plain, level, threshold), covered_at(&kept, level, threshold));
        assert!((with / near - 1.0).abs() < 0.04, "level {level}: {with} instead of {near}");
        assert!((with - near).abs() <= (without - near).abs() + 0.01, "level {level}: {without}");
    }
    let lost = covered_at(&plain, 4, threshold) / near;
    assert!(lost < 0.9, "without, a good part is lost: {lost}");
}

#[test]
fn empty_and_full_images_stay_so() {
    for alpha in [0.0, 1.0] {
        let texels = vec![[1.0, 1.0, 1.0, alpha]; 64];
        let texture = ImageTexture::new(Arc::new(Image::from_linear_rgba(8, 8, &texels)));
        let coverage = AlphaCoverage::of(&texture, 0.5);
        assert_eq!(coverage.covered(), alpha);
        assert!(coverage.scales().iter().all(|s| *s == 1.0), "{coverage:?}");
    }
}

/// By the length of the mean of unit normals.
fn widened_roughness(roughness: f32, mean_normal: Vec3) -> f32 {
    let length = mean_normal.length().min(1.0);
    roughness_with_variance(roughness, (1.0 - length) / length)
}

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
                normals.iter().map(|(n, weight)| weight * beckmann(*n, half, roughness)).sum::<f32>() / total;
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

/// Numbers by hand; the smaller image is scaled, grey serves as any channel, and alpha is no light.
#[test]
fn packed_images_take_a_channel_of_each_source() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, width: u32, channels: u8, samples: &[u8]| {
        let path = folder.path().join(name);
        let samples = Samples::U8(samples.to_vec());
        let height = samples.len() as u32 / u32::from(channels) / width;
        Image { width, height, channels, space: ColorSpace::Linear, samples }.save(&path).unwrap();
        ImageSource::File(path)
    };
    let packed = |channels: [Option<(&ImageSource, ImageChannel)>; 4], space| {
        let channels =
            channels.map(|of| of.map(|(source, channel)| PackedChannel { source: source.clone(), channel }));
        read_image(&ImageSource::Packed(Box::new(PackedImage { channels })), space).unwrap()
    };
    let bytes = |image: &Image| match &image.samples {
        Samples::U8(samples) => samples.clone(),
        other => panic!("{other:?}"),
    };
    let grey = file("grey.png", 2, 1, &[10, 20, 30, 40]);
    let color = file("color.png", 1, 3, &[200, 100, 50]);
    let surface = packed(
        [None, Some((&grey, ImageChannel::Green)), Some((&color, ImageChannel::Red)), None],
        ColorSpace::Linear,
    );
    assert_eq!((surface.width, surface.height, surface.channels), (2, 2, 3));
    assert_eq!(bytes(&surface), [255, 10, 200, 255, 20, 200, 255, 30, 200, 255, 40, 200]);
    // Colours keep their encoding, opacity its numbers.
    let rgb =
        [ImageChannel::Red, ImageChannel::Green, ImageChannel::Blue].map(|channel| Some((&color, channel)));
    let with_opacity = |source, channel| {
        let [r, g, b] = rgb;
        packed([r, g, b, Some((source, channel))], ColorSpace::Srgb)
    };
    let leaf = with_opacity(&grey, ImageChannel::Opacity);
    assert_eq!(
        (leaf.space, &bytes(&leaf)[..8]),
        (ColorSpace::Srgb, &[200, 100, 50, 10, 200, 100, 50, 20][..])
    );
    let clear = file("clear.png", 1, 4, &[0, 0, 0, 90]);
    let opaque = file("opaque.png", 1, 4, &[255, 0, 0, 255]);
    assert_eq!(bytes(&with_opacity(&clear, ImageChannel::Opacity)), [200, 100, 50, 90]);
    // 0.2126 of 255.
    assert_eq!(bytes(&with_opacity(&opaque, ImageChannel::Opacity)), [200, 100, 50, 54]);
    assert_eq!(bytes(&with_opacity(&opaque, ImageChannel::Alpha))[3], 255);
    // Stripes that cross would become a large square.
    let (wide, high) = (file("wide.png", 64, 1, &[9; 64]), file("high.png", 1, 1, &[9; 64]));
    let [red, green] = [&wide, &high]
        .map(|source| Some(PackedChannel { source: source.clone(), channel: ImageChannel::Red }));
    let crossed = ImageSource::Packed(Box::new(PackedImage { channels: [red, green, None, None] }));
    let refused = read_image(&crossed, ColorSpace::Linear).unwrap_err();
    assert!(refused.to_string().contains("64 x 64 texels"), "{refused}");
}

/// A triangle with coordinates and these materials.
fn triangle(materials: Vec<Material>, images: Vec<ImageSource>) -> Mesh {
    let model = Model {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
        triangles: vec![[0, 1, 2]],
        corners: CornerAttributes {
            uv_sets: vec![vec![Vec2::ZERO, Vec2::X, Vec2::Y]],
            ..CornerAttributes::default()
        },
        materials,
        images,
        ..Model::default()
    };
    clean(model, &CleanOptions::default()).unwrap().0
}

fn use_of(image: usize) -> Option<TextureRef> {
    let (uv_transform, wrap) = (Mat3::IDENTITY, [WrapMode::Repeat; 2]);
    Some(TextureRef { image, uv_set: 0, uv_transform, wrap, nearest: false })
}

#[test]
fn images_that_are_missing_or_broken_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| ImageSource::File(folder.path().join(name));
    let samples = Samples::U8(vec![200, 100, 50, 255]);
    let image = Image { width: 1, height: 1, channels: 4, space: ColorSpace::Linear, samples };
    image.save(folder.path().join("there.png")).unwrap();
    let whole = std::fs::read(folder.path().join("there.png")).unwrap();
    let channel = |name: &str, channel| Some(PackedChannel { source: file(name), channel });
    let (green, alpha) =
        (channel("there.png", ImageChannel::Green), channel("gone.png", ImageChannel::Alpha));
    let packed = PackedImage { channels: [None, green, channel("gone.png", ImageChannel::Red), alpha] };
    let broken = whole[..whole.len() / 2].into();
    let images = vec![
        file("gone.png"),
        ImageSource::Embedded { label: "image 1 of a.glb".into(), bytes: broken },
        ImageSource::Packed(Box::new(packed)),
        file("there.png"),
        ImageSource::File(folder.path().to_owned()),
    ];
    let material = Material {
        name: "oak".into(),
        base_color_texture: use_of(0),
        normal_texture: use_of(1),
        metallic_roughness_texture: use_of(2),
        occlusion_texture: use_of(3),
        emission_texture: use_of(4),
        ..Material::default()
    };
    let mesh = triangle(vec![material.clone()], images.clone());
    let (textures, left_out) = load_material_textures(&mesh).unwrap();
    let MaterialTextures { base_color, metallic_roughness, normal, occlusion, emission } = &textures[0];
    assert!(base_color.is_none() && normal.is_none() && occlusion.is_some());
    let texel = |layer: &Option<TextureLayer>| {
        let texture = &layer.as_ref().unwrap().texture;
        texture.sample(Vec2::splat(0.5), [Vec2::ZERO; 2], &SampleOptions::default())
    };
    // What is packed of several keeps those that are there.
    assert!((texel(metallic_roughness)[1] - 100.0 / 255.0).abs() < 1e-3, "{:?}", texel(metallic_roughness));
    assert_eq!([0, 2, 3].map(|channel| texel(metallic_roughness)[channel]), [1.0; 3]);
    assert_eq!(texel(emission), [0.0, 0.0, 0.0, 1.0]);
    let notes = left_out.notes();
    let expected = [
        "a texture was left out: the base colour of material \"oak\": cannot read ",
        "a texture was left out: the normal map of material \"oak\": 'image 1 of a.glb' is not a readable PNG image: ",
        "a texture was left out: the metallic-roughness texture of material \"oak\": cannot read ",
        "a texture was left out: the emission texture of material \"oak\": cannot read ",
    ];
    assert_eq!(notes.len(), expected.len(), "{notes:?}");
    assert!(notes.iter().zip(expected).all(|(note, start)| note.starts_with(start)), "{notes:?}");
    assert!(notes[3].ends_with("it is a folder, not a regular file"), "{notes:?}");
    let error = left_out.check().unwrap_err();
    assert_eq!((error.kind(), error.path()), (ErrorKind::NotFound, Some(&*folder.path().join("gone.png"))));
    // Many are counted.
    let mut many = LeftOut::default();
    (0..3).for_each(|_| many.extend(left_out.clone()));
    let notes = many.notes();
    assert!(notes.len() == 9 && notes[8].contains("4 more textures"), "{notes:?}");
}

/// With more memory it could be read, so it is no fault of the model.
#[test]
fn images_for_which_there_is_no_memory_are_errors() {
    let samples = Samples::U8(vec![0; 256 * 256]);
    let image = Image { width: 256, height: 256, channels: 1, space: ColorSpace::Linear, samples };
    let bytes = image.encoded("a.png").unwrap().into();
    let images = vec![ImageSource::Embedded { label: "image 0".into(), bytes }];
    let material = Material { base_color_texture: use_of(0), ..Material::default() };
    let mesh = triangle(vec![material], images);
    let limits = ReadLimits::new(ReadOptions { memory_bytes: 10_000, ..ReadOptions::default() });
    let error = limits.run(|| load_material_textures(&mesh)).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::TooLarge);
    load_material_textures(&mesh).unwrap().1.check().unwrap();
}

#[test]
fn grey_bump_maps_are_heights_and_others_normals() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str, channels: u8, texel: fn(u32, u32) -> [u8; 3]| {
        let path = folder.path().join(name);
        let texels = (0..64).flat_map(|y| (0..64).map(move |x| texel(x, y)));
        let samples = texels.flat_map(|rgb| rgb.into_iter().take(usize::from(channels)));
        let samples = Samples::U8(samples.collect());
        let image = Image { width: 64, height: 64, channels, space: ColorSpace::Linear, samples };
        image.save(&path).unwrap();
        let bump = BumpImage { source: ImageSource::File(path), wrap: [WrapMode::Repeat, WrapMode::Clamp] };
        (read_image(&ImageSource::Bump(Box::new(bump)), ColorSpace::Linear).unwrap(), image)
    };
    // White is a texel high: steep enough to see which way the normals lean.
    let ramp = |x: u32, y: u32| [(x + 2 * y) as u8; 3];
    let (normals, _) = read("grey.png", 1, ramp);
    let at = |image: &Image, x, y| Vec3::from_slice(&image.linear_texel(x, y)[..3]);
    let leaning = |x: f32, y: f32| 0.5 + 0.5 * (Vec3::new(x, y, 255.0) / 255.0).normalize();
    let near = |x, y, expected: Vec3| {
        let found = at(&normals, x, y);
        assert!((found - expected).length() < 1e-4, "{x} {y}: {found} instead of {expected}");
    };
    // Uphill to the right and downwards.
    near(10, 10, leaning(-1.0, 2.0));
    near(10, 0, leaning(-1.0, 1.0));
    near(0, 10, leaning(31.0, 2.0));
    assert_eq!(read("gray_in_color.png", 3, ramp).0, normals);
    let (same, image) = read("colors.png", 3, |x, _| [128, 128, 255 - x as u8]);
    assert_eq!(same, image);
}

#[test]
fn no_normal_stays_short() {
    // A spiral over the upper half of the sphere, as long as a lossy file may leave normals.
    let normals: Vec<Vec3> = (0..1024)
        .map(|i| {
            let (height, angle) = (i as f32 / 1024.0, i as f32 * 2.4);
            (Vec2::from_angle(angle) * (1.0 - height * height).sqrt()).extend(height)
        })
        .collect();
    let lengths = (0..1024).map(|i| 0.8 + 0.2 * (i * 37 % 101) as f32 / 100.0);
    let texels: Vec<[f32; 4]> =
        normals.iter().zip(lengths).map(|(n, l)| (*n * l * 0.5 + 0.5).extend(1.0).to_array()).collect();
    // Each coordinate is rounded twice: to half a step of what is short, and by up to a step where that is needed.
    let off = |step: f32| 3_f32.sqrt() * (0.5 * step / 0.8 + step) + 1e-3;
    for (depth, step) in [(Depth::U8, 2.0 / 255.0), (Depth::U16, 2.0 / 65535.0), (Depth::F32, 0.0)] {
        let image = Image::from_linear_rgb(32, 32, &texels).converted(depth, ColorSpace::Linear);
        let image = image.with_unit_normals();
        for (i, normal) in (0u32..).zip(&normals) {
            let found = Vec3::from_slice(&image.linear_texel(i % 32, i / 32)[..3]) * 2.0 - 1.0;
            let length = found.length();
            assert!((ROUNDED_LENGTH..1.02).contains(&length), "{depth:?} {i}: {length}");
            assert!(found.angle_between(*normal) < off(step), "{depth:?} {i}: {found} instead of {normal}");
        }
    }
    // What is no direction stays, and so does what is no normal map.
    let grey = Image::from_linear_rgb(1, 1, &[[0.5; 4]]);
    assert_eq!(grey.clone().with_unit_normals(), grey);
}
