//! Fan models against the CPU renderer's `FanSurface`: the same camera, lights and filter.

use std::sync::Arc;

use fantex_bake::{BakeFormat, BakeOptions, LookSource, Source, SourceChannel, TexelPoint, baked_materials};
use fantex_base::ErrorKind;
use fantex_cover::{Cover, CoverOptions, GroupKind, TexelBudget, build_cover};
use fantex_gpu::{DrawOptions, FanModel, Gpu, Model as _, Overlay, StreamedModel, stream_view};
use fantex_mesh::{AlphaMode, Material, Mesh, clean, generate};
use fantex_render::LookSurface;
use fantex_scene::{Background, Camera, FilterOptions, Lights, Picture, Shading, ShadowOptions};
use fantex_store::{ChannelKind, PAGE, PageId, group_pages};
use fantex_stream::{AtlasFormat, AtlasShape, FrameOptions, PageTable};
use fantex_test::cleaned;
use fantex_texture::look::{Anisotropy, LookMaterial, Slot};
use fantex_texture::{ColorRamp, Filter, RampInterpolation, ShadingPoint, Texture};
use glam::{DVec3, Vec3, Vec4};

use crate::common;
use crate::common::{Baked, Comparison, Residents, compare, cpu, gpu, loaded_data, rendered};
use crate::pictures::{discs, textured_square, two_sided_sheet};

/// A colour with detail of a few texels.
fn color(p: Vec3) -> Vec4 {
    let wave = |k: Vec3| 0.5 + 0.45 * p.dot(k).sin();
    Vec4::new(
        wave(Vec3::new(60.0, 13.0, 0.0)),
        wave(Vec3::new(-9.0, 70.0, 20.0)),
        wave(Vec3::splat(31.0)),
        1.0,
    )
}

struct Colors;

impl Source for Colors {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::BaseColor, has_alpha: false, exceeds_one: false }]
    }

    fn prefilter(&self) -> fantex_bake::Prefilter {
        fantex_bake::Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        values[0] = color(point.position);
    }
}

fn cover(mesh: &Mesh, tile: u32, texels: u64) -> Cover {
    let budget = TexelBudget::Total(texels);
    build_cover(mesh, &CoverOptions { tile, budget, ..CoverOptions::default() }).unwrap().0
}

fn baked(mesh: &Mesh, cover: &Cover, format: BakeFormat) -> Baked {
    Baked::new(mesh, cover, &Colors, &BakeOptions { format, ..BakeOptions::default() })
}

fn options(shading: Shading, filter: Filter) -> DrawOptions {
    DrawOptions {
        shading,
        filter: FilterOptions { filter, max_anisotropy: 8.0 },
        background: Background::Transparent,
        tone_map: None,
        samples: 1,
        ..DrawOptions::default()
    }
}

/// The same view of an asset by both renderers.
fn both(name: &str, baked: &Baked, direction: DVec3, options: &DrawOptions) -> Option<Comparison> {
    let gpu = gpu()?;
    let mesh = baked.asset().mesh();
    let camera = Camera::framing_mesh(mesh, direction, 1.5);
    let lights = Lights::sun(Vec3::new(0.3, 0.8, 0.5));
    Some(compare(name, &gpu, baked, &camera, &lights, options))
}

const FILTERS: [Filter; 4] = [Filter::Nearest, Filter::Bilinear, Filter::Trilinear, Filter::Anisotropic];

/// Where the pictures of an asset may differ, and by how much.
///
/// The GPU reads the same texels at the same places. What differs: samplers weigh texels in steps of 1/256; derivatives are
/// differences within a block of 2x2 pixels, so that the level is off by some hundredths where a surface curves, and by
/// more in the blocks along a triangle's edge; normals have 16 bits; half floats round to 1/2048. The mean says whether
/// the look-ups agree; single pixels may differ as much as neighbouring pixels do.
fn assert_close(seen: &Comparison, mean: f32, most: f32) {
    assert!(seen.mean < mean, "{}: mean difference {}", seen.name, seen.mean);
    assert!(seen.quantile < most, "{}: 999 of 1000 differ by less than {}", seen.name, seen.quantile);
}

#[test]
fn all_filters_on_a_curved_surface() {
    let mesh = cleaned(generate::torus(96, 48));
    let baked = baked(&mesh, &cover(&mesh, 96, 1 << 20), BakeFormat::Rgba8);
    for filter in FILTERS {
        let name = format!("torus {filter:?}");
        let Some(seen) = both(&name, &baked, Camera::THREE_QUARTER, &options(Shading::BaseColor, filter))
        else {
            return;
        };
        // The nearest texel flips where rounding does.
        let most = if filter == Filter::Nearest { 0.1 } else { 0.02 };
        assert_close(&seen, 0.002, most);
    }
}

#[test]
fn a_scanned_model_under_a_lamp() {
    let Some(mesh) = loaded_data("meshes/bunny/stanford_bunny.ply") else { return };
    let baked = baked(&mesh, &cover(&mesh, 128, 1 << 21), BakeFormat::Bc7);
    for (shading, filter) in
        [(Shading::MetallicRoughness, Filter::Anisotropic), (Shading::BlinnPhong, Filter::Trilinear)]
    {
        let name = format!("bunny {shading:?}");
        let Some(seen) = both(&name, &baked, Camera::THREE_QUARTER, &options(shading, filter)) else {
            return;
        };
        assert_close(&seen, 0.002, 0.015);
    }
}

#[test]
fn all_channels_of_a_material() {
    let Some(mesh) = loaded_data("meshes/WaterBottle/WaterBottle.gltf") else { return };
    let cover = cover(&mesh, 128, 1 << 20);
    let source = LookSource::of_model(&mesh).unwrap();
    let baked = Baked::new(&mesh, &cover, &source, &BakeOptions::default());
    assert!(baked.asset().channels().len() >= 3);
    for shading in [
        Shading::BaseColor,
        Shading::Normal,
        Shading::OcclusionRoughnessMetallic,
        Shading::Emission,
        Shading::MetallicRoughness,
    ] {
        let name = format!("bottle {shading:?}");
        let options = options(shading, Filter::Trilinear);
        let Some(seen) = both(&name, &baked, Camera::THREE_QUARTER, &options) else { return };
        assert_close(&seen, 0.002, 0.04);
    }
}

#[test]
fn one_fan_per_tile() {
    let mesh = cleaned(generate::icosphere(3));
    let cover = cover(&mesh, 0, 1 << 19);
    assert!(cover.groups.len() > 500);
    let baked = baked(&mesh, &cover, BakeFormat::Rgba8);
    for filter in [Filter::Trilinear, Filter::Anisotropic] {
        let name = format!("fans {filter:?}");
        let Some(seen) = both(&name, &baked, Camera::THREE_QUARTER, &options(Shading::BaseColor, filter))
        else {
            return;
        };
        assert_close(&seen, 0.002, 0.015);
    }
}

/// Front and back of a sheet, which are equally near, each from its front.
#[test]
fn both_sides_of_a_sheet() {
    let mesh = two_sided_sheet();
    let source = LookSource::of_model(&mesh).unwrap();
    let baked = Baked::new(&mesh, &cover(&mesh, 96, 1 << 18), &source, &BakeOptions::default());
    for z in [1.0, -1.0] {
        let options = options(Shading::BaseColor, Filter::Trilinear);
        let Some(seen) = both(&format!("sheet {z}"), &baked, DVec3::new(0.3, 0.2, z), &options) else {
            return;
        };
        assert_close(&seen, 0.002, 0.02);
    }
}

/// Cards decide sample by sample what is cut out; the CPU gives every pixel its share.
#[test]
fn edges_of_cut_outs() {
    let material = Material { alpha: AlphaMode::Mask(0.5), ..Material::default() };
    let mesh = textured_square(&discs(64), material);
    let source = LookSource::of_model(&mesh).unwrap();
    let baked = Baked::new(&mesh, &cover(&mesh, 96, 1 << 18), &source, &BakeOptions::default());
    for (samples, mean, most) in [(4, 0.002, 0.2), (1, 0.005, 0.6)] {
        let background = Background::Color(Vec3::splat(0.4));
        let options = DrawOptions { samples, background, ..options(Shading::BaseColor, Filter::Trilinear) };
        let name = format!("discs in {samples} samples");
        let Some(seen) = both(&name, &baked, DVec3::new(0.2, 0.1, 1.0), &options) else { return };
        assert_close(&seen, mean, most);
    }
}

/// Nothing shows through where all is there, though beside the edges of triangles slopes are those of texels beyond.
#[test]
fn cut_outs_without_holes_are_whole() {
    let Some(gpu) = gpu() else { return };
    let mut mesh = cleaned(generate::torus(48, 24));
    mesh.materials = vec![Material { alpha: AlphaMode::Mask(0.8), ..Material::default() }];
    let opaque = Material { alpha: AlphaMode::Opaque, ..Material::default() };
    let cover = cover(&mesh, 24, 1 << 17);
    assert!(cover.groups.len() > 100);
    let options = DrawOptions { samples: 4, ..options(Shading::BaseColor, Filter::Anisotropic) };
    let [cut_out, whole] = [mesh.materials[0].clone(), opaque].map(|material| {
        mesh.materials = vec![material];
        let baked = baked(&mesh, &cover, BakeFormat::Rgba8);
        let camera = Camera::framing_mesh(baked.asset().mesh(), DVec3::new(0.2, 0.25, 1.0), 1.5);
        let seen = rendered(&gpu, &baked, &Residents::all(), &camera, &Lights::default(), &options);
        seen.rgba.iter().map(|pixel| pixel[3]).collect::<Vec<f32>>()
    });
    assert!(whole.iter().filter(|alpha| **alpha == 1.0).count() > 1000);
    assert_eq!(cut_out, whole);
}

/// A square whose tiles are cut into several pages.
fn paged() -> Baked {
    let mesh = cleaned(generate::grid(12));
    let cover = cover(&mesh, 1024, 4 << 20);
    assert!(cover.groups.len() > 1);
    assert!(cover.groups.iter().any(|g| g.extent[0] > 2 * PAGE && g.extent[1] > 2 * PAGE));
    baked(&mesh, &cover, BakeFormat::Rgba8)
}

#[test]
fn tiles_of_several_pages() {
    let baked = paged();
    for filter in FILTERS {
        let name = format!("pages {filter:?}");
        let Some(seen) = both(&name, &baked, Camera::THREE_QUARTER, &options(Shading::BaseColor, filter))
        else {
            return;
        };
        let most = if filter == Filter::Nearest { 0.1 } else { 0.02 };
        assert_close(&seen, 0.002, most);
    }
}

/// A many-pointed star: its points fold under any projection.
fn star() -> Mesh {
    let mut model = generate::icosphere(2);
    for (i, p) in model.positions.iter_mut().enumerate() {
        *p *= if i % 5 == 0 { 3.5 } else { 1.0 };
    }
    cleaned(model)
}

#[test]
fn unfolded_fans() {
    let mesh = star();
    let cover = cover(&mesh, 96, 1 << 19);
    let unfolded = cover.groups.iter().filter(|g| g.kind == GroupKind::Unfolded).count();
    assert!(unfolded > 0, "the star has no fan that folds");
    let baked = baked(&mesh, &cover, BakeFormat::Rgba8);
    let options = options(Shading::BaseColor, Filter::Trilinear);
    let Some(seen) = both("unfolded", &baked, Camera::THREE_QUARTER, &options) else { return };
    assert_close(&seen, 0.002, 0.02);
}

#[test]
fn a_model_without_any_texture() {
    let mesh = cleaned(generate::torus(48, 24));
    let baked = Baked::without_channels(&mesh, &cover(&mesh, 96, 1 << 18));
    let options = options(Shading::MetallicRoughness, Filter::Anisotropic);
    let Some(seen) = both("untextured", &baked, Camera::THREE_QUARTER, &options) else { return };
    assert_close(&seen, 0.002, 0.02);
}

/// Only what is at least as coarse as a level.
#[test]
fn coarse_levels_stand_in_for_missing_ones() {
    let Some(gpu) = gpu() else { return };
    let mesh = cleaned(generate::torus(96, 48));
    let baked = baked(&mesh, &cover(&mesh, 128, 1 << 20), BakeFormat::Rgba8);
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
    let options = options(Shading::BaseColor, Filter::Bilinear);
    for level in [1, 2, 4, 99] {
        let residents = Residents::of_level(level);
        let seen = rendered(&gpu, &baked, &residents, &camera, &Lights::default(), &options);
        let expected = common::cpu_with_stand_ins(&baked, |asked| asked.max(level), &camera, &options);
        let seen = Comparison::of(&format!("level {level}"), &seen, &expected);
        assert_close(&seen, 0.002, 0.01);
    }
}

/// A level that cannot be read: finer ones are shown, and where it would be, the one after it.
#[test]
fn look_ups_climb_past_a_hole() {
    let Some(gpu) = gpu() else { return };
    let mesh = cleaned(generate::torus(96, 48));
    for (tile, filter) in [(128, Filter::Trilinear), (128, Filter::Anisotropic), (1024, Filter::Trilinear)] {
        let baked = baked(&mesh, &cover(&mesh, tile, 1 << 20), BakeFormat::Rgba8);
        let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
        let options = options(Shading::BaseColor, filter);
        for hole in [0, 1, 2, 3] {
            let residents = Residents::without_level(hole);
            let seen = rendered(&gpu, &baked, &residents, &camera, &Lights::default(), &options);
            let shown = |asked| if asked == hole { hole + 1 } else { asked };
            let expected = common::cpu_with_stand_ins(&baked, shown, &camera, &options);
            let name = format!("tiles of {tile}, {filter:?}, without level {hole}");
            assert_close(&Comparison::of(&name, &seen, &expected), 0.002, 0.02);
        }
    }
}

/// Whatever is resident, neighbouring pixels of a smooth colour differ no more than they should.
#[test]
fn any_residency_is_continuous() {
    let Some(gpu) = gpu() else { return };
    let mesh = cleaned(generate::cube(3));
    let cover = cover(&mesh, 1024, 4 << 20);
    let baked = baked(&mesh, &cover, BakeFormat::Rgba8);
    // So close that a texel is larger than a pixel.
    let camera = Camera {
        eye: DVec3::new(0.2, 0.1, 0.62),
        target: DVec3::new(0.0, 0.0, 0.5),
        up: DVec3::Y,
        fov_degrees: 40.0,
    };
    let options = options(Shading::BaseColor, Filter::Trilinear);
    let whole = rendered(&gpu, &baked, &Residents::all(), &camera, &Lights::default(), &options);
    let limit = 1.5 * common::largest_step(&whole) + 0.02;
    for seed in 0..4 {
        let residents = Residents::random(seed);
        let seen = rendered(&gpu, &baked, &residents, &camera, &Lights::default(), &options);
        common::save(&format!("residency {seed}"), &seen);
        let step = common::largest_step(&seen);
        assert!(step < limit, "seed {seed}: a step of {step}, {limit} where all is resident");
    }
}

/// The same blocks, decoded by the device or on their way to it.
#[test]
fn block_compressed_texels_look_as_decoded_ones() {
    let Some(gpu) = gpu() else { return };
    if !gpu.device.features().contains(wgpu::Features::TEXTURE_COMPRESSION_BC) {
        fantex_test::skip("the device has no block-compressed textures");
        return;
    }
    let mesh = cleaned(generate::torus(48, 24));
    let options = options(Shading::BaseColor, Filter::Trilinear);
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
    for format in [BakeFormat::Bc1, BakeFormat::Bc7] {
        let baked = baked(&mesh, &cover(&mesh, 96, 1 << 19), format);
        let decoded = rendered(&gpu, &baked, &Residents::all(), &camera, &Lights::default(), &options);
        let table = PageTable::new(baked.asset().cover());
        let formats: Vec<_> =
            baked.channels().iter().map(|channel| AtlasFormat::of(channel.format, true)).collect();
        let mut model = common::model(&gpu, &baked, &table, &formats);
        common::upload(&gpu, &mut model, baked.asset(), &table, &Residents::all());
        let compressed = common::draw(&gpu, &mut model, &camera, &Lights::default(), &options);
        let seen = Comparison::of(&format!("blocks {format:?}"), &compressed, &decoded);
        // BC1's palette is rounded to 8 bits by our decoder, but not by every device.
        assert_close(&seen, 0.002, 0.01);
    }
}

/// Overlays, to be looked at; each shows something else than the material.
#[test]
fn overlays_explain() {
    let Some(gpu) = gpu() else { return };
    let mesh = cleaned(generate::torus(96, 48));
    let baked = baked(&mesh, &cover(&mesh, 96, 1 << 20), BakeFormat::Rgba8);
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
    let lights = Lights::sun(Vec3::new(0.3, 0.8, 0.5));
    let plain = options(Shading::MetallicRoughness, Filter::Trilinear);
    let residents = Residents::random(7);
    let material = rendered(&gpu, &baked, &residents, &camera, &lights, &plain);
    let overlays = [Overlay::Groups, Overlay::Fans, Overlay::Levels, Overlay::Residency, Overlay::BlendBands];
    let mut pictures = vec![material];
    for overlay in overlays {
        let seen = rendered(&gpu, &baked, &residents, &camera, &lights, &DrawOptions { overlay, ..plain });
        common::save(&format!("overlay {overlay:?}"), &seen);
        assert!(pictures.iter().all(|other| *other != seen), "{overlay:?} looks like another");
        pictures.push(seen);
    }
}

#[test]
fn making_a_streamed_model_tells_how_far_it_is() {
    let Some(gpu) = gpu() else { return };
    let mesh = cleaned(generate::torus(24, 12));
    let baked = baked(&mesh, &cover(&mesh, 96, 1 << 14), BakeFormat::Rgba8);
    let asset = baked.asset();
    let loader = Box::new(StreamedModel::loader(&gpu, asset).unwrap());
    let told = std::cell::RefCell::new(Vec::new());
    let progress = |share: f32| told.borrow_mut().push(share);
    StreamedModel::with_pages_and_progress(&gpu, asset, asset.clone(), loader, 1 << 24, &progress).unwrap();
    let told = told.borrow();
    assert!(told.len() > 5 && told.is_sorted() && told.last() == Some(&1.0), "{told:?}");
}

/// What a streamer brings for a view is enough for the CPU's picture of it; the live atlas shows it.
#[test]
fn a_streamed_view_becomes_sharp() {
    let Some(gpu) = gpu() else { return };
    let mesh = cleaned(generate::torus(96, 48));
    let baked = baked(&mesh, &cover(&mesh, 96, 1 << 21), BakeFormat::Bc7);
    let camera = Camera::framing_mesh(&mesh, DVec3::new(0.1, 0.3, 1.0), 1.5);
    let options = options(Shading::BaseColor, Filter::Anisotropic);
    let lights = Lights::default();
    let mut streamed = StreamedModel::open(&gpu, baked.asset().clone(), 32 << 20).unwrap();
    assert!(streamed.model.texel_bytes() <= 32 << 20);
    let view = stream_view(&camera, common::SIZE, streamed.model.space());
    let patience = fantex_test::PATIENCE;
    assert!(streamed.wait_until_sharp(&gpu, &view, &options.filter, patience).unwrap());
    let statistics = streamed.streamer.statistics();
    assert!(statistics.resident.parcels > 0 && statistics.missing == 0, "{statistics:?}");
    let seen = common::draw(&gpu, &mut streamed.model, &camera, &lights, &options);
    let expected = common::cpu_with_stand_ins(&baked, |asked| asked, &camera, &options);
    assert_close(&Comparison::of("streamed", &seen, &expected), 0.002, 0.015);
    let atlas = common::live_atlas(&gpu, &streamed.model, 0);
    common::save("live atlas", &atlas);
    let bright = atlas.rgba.iter().filter(|p| p[0] + p[1] + p[2] > 0.3).count();
    assert!(bright * 50 > atlas.rgba.len(), "{bright} pixels of the live atlas show texels");
}

/// An asset that is opened with a view of it, and the picture by what is resident.
struct Streaming {
    baked: Baked,
    camera: Camera,
    options: DrawOptions,
}

impl Streaming {
    fn torus() -> Self {
        let mesh = cleaned(generate::torus(96, 48));
        let baked = baked(&mesh, &cover(&mesh, 96, 1 << 20), BakeFormat::Rgba8);
        let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
        Self { baked, camera, options: options(Shading::BaseColor, Filter::Trilinear) }
    }

    fn open(&self, gpu: &Gpu) -> StreamedModel {
        StreamedModel::open(gpu, self.baked.asset().clone(), 16 << 20).unwrap()
    }

    fn sharp(&self, gpu: &Gpu, streamed: &mut StreamedModel) -> Picture {
        let view = stream_view(&self.camera, common::SIZE, streamed.model.space());
        let patience = fantex_test::PATIENCE;
        assert!(streamed.wait_until_sharp(gpu, &view, &self.options.filter, patience).unwrap());
        self.draw(gpu, streamed)
    }

    fn draw(&self, gpu: &Gpu, streamed: &mut StreamedModel) -> Picture {
        common::draw(gpu, &mut streamed.model, &self.camera, &Lights::default(), &self.options)
    }
}

/// Pages lie elsewhere in another atlas, where samplers round otherwise.
fn assert_looks_the_same(seen: &Picture, expected: &Picture) {
    let differences =
        seen.rgba.iter().zip(&expected.rgba).flat_map(|(a, b)| [0, 1, 2, 3].map(|c| (a[c] - b[c]).abs()));
    let largest = differences.fold(0.0, f32::max);
    assert!(largest < 0.01, "the pictures differ by {largest}");
}

/// Outlines interlock in an atlas that is too small for the asset: other views, whose pages take the room of those before, and texels that
/// are read again in place look as in an atlas with room for all.
#[test]
fn pages_in_the_gaps_of_others_look_as_they_do_alone() {
    let Some(gpu) = gpu() else { return };
    let mesh = cleaned(generate::icosphere(4));
    let baked = baked(&mesh, &cover(&mesh, 256, 1 << 21), BakeFormat::Bc7);
    let options = options(Shading::BaseColor, Filter::Trilinear);
    let formats = FanModel::atlas_formats(&gpu, baked.channels());
    let budget = AtlasShape { side: 512, layers: 7 }.bytes(&formats);
    let [mut small, mut large] =
        [budget, 16 * budget].map(|budget| StreamedModel::open(&gpu, baked.asset().clone(), budget).unwrap());
    let pages: Vec<PageId> =
        (0..).zip(&baked.asset().cover().groups).flat_map(|(g, group)| group_pages(g, group)).collect();
    for direction in [DVec3::Z, DVec3::X, DVec3::NEG_Z, DVec3::NEG_X, DVec3::Z] {
        let camera = Camera::framing_mesh(&mesh, direction, 1.5);
        small.streamer.invalidate(&pages);
        let [seen, expected] = [&mut small, &mut large].map(|streamed| {
            let view = stream_view(&camera, common::SIZE, streamed.model.space());
            let patience = fantex_test::PATIENCE;
            assert!(streamed.wait_until_sharp(&gpu, &view, &options.filter, patience).unwrap());
            streamed.streamer.sanity_check();
            common::draw(&gpu, &mut streamed.model, &camera, &Lights::default(), &options)
        });
        assert_looks_the_same(&seen, &expected);
    }
    let statistics = small.streamer.statistics();
    assert!(statistics.evictions > 0 && large.streamer.statistics().evictions == 0, "{statistics:?}");
    let stored = statistics.resident.texels;
    let whole: u64 = statistics.resident_texels_by_level.iter().sum();
    assert!(stored < whole, "{stored} texels of {whole} are stored");
}

/// Nothing panics while the device is lost, and the asset looks on another one as it did.
#[test]
fn a_streamed_model_goes_on_with_another_device() {
    let Some(gpu) = gpu() else { return };
    let scene = Streaming::torus();
    let mut streamed = scene.open(&gpu);
    let before = scene.sharp(&gpu, &mut streamed);
    gpu.device.destroy();
    gpu.wait().ok();
    assert!(gpu.lost().is_some());
    // Another view, so that pages arrive.
    let near = Camera { eye: scene.camera.eye * 0.6, ..scene.camera };
    let view = stream_view(&near, common::SIZE, streamed.model.space());
    let patience = fantex_test::PATIENCE;
    let error = streamed.wait_until_sharp(&gpu, &view, &scene.options.filter, patience).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Unavailable, "{error}");
    // A device that was lost meanwhile is told by the next call; nothing fails on the way there.
    scene.open(&gpu);
    drop(streamed);
    let another = common::gpu().unwrap();
    assert_looks_the_same(&scene.sharp(&another, &mut scene.open(&another)), &before);
}

/// A larger and a smaller atlas: the picture stays as it is until the new one can show it.
#[test]
fn another_budget_leaves_the_picture() {
    let Some(gpu) = gpu() else { return };
    let scene = Streaming::torus();
    let mut streamed = scene.open(&gpu);
    let mut before = scene.sharp(&gpu, &mut streamed);
    let view = stream_view(&scene.camera, common::SIZE, streamed.model.space());
    for budget in [8 << 20, 4 << 20] {
        streamed.set_budget(&gpu, budget).unwrap();
        assert!(streamed.model.has_hidden_atlas() && streamed.model.texel_bytes() <= budget);
        // A page per frame: nothing is sharp in the first ones.
        let frame = FrameOptions { upload_bytes: 1, ..FrameOptions::default() };
        for _ in 0..3 {
            streamed.advance(&gpu, Some(&view), frame);
            assert!(scene.draw(&gpu, &mut streamed) == before, "the atlas that is shown has changed");
        }
        assert!(streamed.model.has_hidden_atlas());
        let after = scene.sharp(&gpu, &mut streamed);
        assert_looks_the_same(&after, &before);
        before = after;
        assert!(!streamed.model.has_hidden_atlas());
    }
    // What cannot be brought in time is not waited for.
    streamed.set_budget(&gpu, 48 << 20).unwrap();
    let late = FrameOptions { upload_bytes: 1, elapsed_seconds: 4.0 };
    streamed.advance(&gpu, Some(&view), late);
    assert!(!streamed.model.has_hidden_atlas());
}

// Assets of looks: toon scales, stretched highlights and baked light, by the GPU, by the CPU renderer, and against the looks
// themselves.

fn torus() -> Mesh {
    clean(generate::torus(96, 48), &Default::default()).unwrap().0
}

/// Trilinear, by the metallic-roughness model.
fn lit_options() -> DrawOptions {
    options(Shading::MetallicRoughness, Filter::Trilinear)
}

fn lights() -> Lights {
    Lights::sun(Vec3::new(0.3, 0.8, 0.5))
}

/// A look on a torus, as an asset; compared by both renderers, and with the look itself.
fn assert_shows_the_look(name: &str, material: LookMaterial, format: BakeFormat, tolerance: [f32; 2]) {
    assert_shows_the_look_within(name, material, format, tolerance, 0.02);
}

/// `most` is what 999 of 1000 pixels may differ by from those of the CPU.
fn assert_shows_the_look_within(
    name: &str,
    material: LookMaterial,
    format: BakeFormat,
    [look_mean, look_most]: [f32; 2],
    most: f32,
) {
    let Some(gpu) = gpu() else { return };
    let mut mesh = torus();
    let materials = vec![Arc::new(material)];
    mesh.materials = baked_materials(&materials);
    let source = LookSource::new(&mesh, materials.clone(), 0.0).unwrap();
    let options = BakeOptions { format, ..BakeOptions::default() };
    let baked = Baked::new(&mesh, &cover(&mesh, 128, 1 << 20), &source, &options);
    assert_eq!(baked.asset().mesh().materials, mesh.materials, "the asset keeps its materials");
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
    let (lights, options) = (lights(), lit_options());
    let seen = compare(name, &gpu, &baked, &camera, &lights, &options);
    assert_close(&seen, 0.002, most);
    let look = cpu(&mesh, &LookSurface::new(&mesh, materials), &camera, &lights, &options);
    let asset = baked.surface(baked.cache(), &options);
    let asset = cpu(&mesh, &asset, &camera, &lights, &options);
    assert_close(&Comparison::of(&format!("{name} as a look"), &asset, &look), look_mean, look_most);
}

fn toon(interpolation: RampInterpolation) -> Arc<ColorRamp> {
    let grey = |v: f32| Vec4::new(v, v, 0.8 * v, 1.0);
    let stops = vec![(-0.2, grey(0.05)), (0.2, grey(0.3)), (0.55, grey(0.6)), (0.85, grey(1.0))];
    Arc::new(ColorRamp::new(stops, interpolation).unwrap())
}

#[test]
fn toon_scales() {
    for interpolation in [RampInterpolation::Constant, RampInterpolation::Linear, RampInterpolation::Smooth] {
        let material = LookMaterial {
            base_color: Slot::color(Vec3::new(0.8, 0.3, 0.2)),
            toon: Some(toon(interpolation)),
            ..LookMaterial::default()
        };
        assert_shows_the_look(&format!("toon {interpolation:?}"), material, BakeFormat::Rgba8, [0.003, 0.02]);
    }
}

/// A direction that turns around the ring, encoded in 0..1.
struct Swirl;

impl Texture for Swirl {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let (sine, cosine) = (3.0 * at.position.z.atan2(at.position.x)).sin_cos();
        Vec4::new(0.5 + 0.5 * cosine, 0.5 + 0.5 * sine, 0.5, 1.0)
    }
}

#[test]
fn stretched_highlights() {
    // Along and, where the strength is negative, across the direction.
    for (strength, format) in
        [(0.9, BakeFormat::Rgba8), (-0.6, BakeFormat::Float), (0.7, BakeFormat::Bc7), (0.0, BakeFormat::Bc7)]
    {
        let material = LookMaterial {
            base_color: Slot::color(Vec3::new(0.9, 0.7, 0.5)),
            metallic: Slot::number(1.0),
            roughness: Slot::number(0.45),
            anisotropy: Some(Anisotropy {
                strength: Slot::number(strength),
                direction: Slot::Texture(Arc::new(Swirl)),
                uv_set: 7,
            }),
            ..LookMaterial::default()
        };
        // With texels of floats the two differ by a fifth of this: steep highlights magnify how hardware filters eight bits.
        assert_shows_the_look_within(&format!("stretched {strength}"), material, format, [0.004, 0.05], 0.03);
    }
}

#[test]
fn stretched_highlights_on_toon() {
    let material = LookMaterial {
        toon: Some(toon(RampInterpolation::Constant)),
        roughness: Slot::number(0.4),
        anisotropy: Some(Anisotropy {
            strength: Slot::number(0.8),
            direction: Slot::color(Vec3::new(1.0, 0.5, 0.5)),
            uv_set: 7,
        }),
        ..LookMaterial::default()
    };
    assert_shows_the_look("both", material, BakeFormat::Rgba8, [0.004, 0.05]);
}

/// Base colour and the light that arrives.
struct Lit;

impl Source for Lit {
    fn channels(&self) -> Vec<SourceChannel> {
        let channel = |kind, exceeds_one| SourceChannel { kind, has_alpha: false, exceeds_one };
        vec![channel(ChannelKind::BaseColor, false), channel(ChannelKind::Light, true)]
    }

    fn prefilter(&self) -> fantex_bake::Prefilter {
        fantex_bake::Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let p = point.position;
        let wave = |k: Vec3| 0.5 + 0.45 * p.dot(k).sin();
        values[0] = Vec4::new(wave(Vec3::X * 20.0), wave(Vec3::Y * 20.0), 0.5, 1.0);
        values[1] = (Vec3::new(1.5, 1.2, 1.0) * wave(Vec3::splat(9.0))).extend(1.0);
    }
}

#[test]
fn baked_light() {
    let Some(gpu) = gpu() else { return };
    let mesh = torus();
    let baked = Baked::new(&mesh, &cover(&mesh, 128, 1 << 20), &Lit, &BakeOptions::default());
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
    let bright = compare("light", &gpu, &baked, &camera, &lights(), &lit_options());
    assert_close(&bright, 0.002, 0.02);
    // What arrives was computed before, so a lamp adds its highlights alone.
    let surface = baked.surface(baked.cache(), &lit_options());
    let [dark, lit] = [Lights::default(), lights()]
        .map(|lights| cpu(baked.asset().mesh(), &surface, &camera, &lights, &lit_options()));
    let brighter = dark.rgba.iter().zip(&lit.rgba).filter(|(d, l)| l[0] > d[0] + 0.2).count();
    assert!(brighter * 20 < lit.rgba.len(), "{brighter} pixels are far brighter under the lamp");
}

#[test]
fn toon_in_shadow() {
    let Some(gpu) = gpu() else { return };
    let mut mesh = torus();
    let look = LookMaterial { toon: Some(toon(RampInterpolation::Constant)), ..LookMaterial::default() };
    let materials = vec![Arc::new(look)];
    mesh.materials = baked_materials(&materials);
    let source = LookSource::new(&mesh, materials, 0.0).unwrap();
    let baked = Baked::new(&mesh, &cover(&mesh, 128, 1 << 20), &source, &BakeOptions::default());
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
    let lights = Lights::sun(Vec3::new(0.9, 0.35, 0.1)).with_shadows(ShadowOptions::default());
    let seen = compare("toon shadow", &gpu, &baked, &camera, &lights, &lit_options());
    // Shadows fall on facets here, and a step of the scale makes much of a little difference.
    assert!(seen.mean < 0.01, "{}", seen.mean);
}
