//! The texture function in WGSL against `fantex_store::Sampler`, point by point: random points and footprints on random meshes whose
//! texels are noise.
//!
//! Tolerance. Samplers weigh texels in steps of 1/256 along two axes and between levels, and neighbouring texels of noise differ by
//! up to one; sRGB is decoded to about 1/1000. So values may differ by [`TOLERANCE`]. A weight that is cut off is too low by 1/512 on
//! average, two texels of noise differ by 1/3, and two axes and the largest of three components make that about 1/500, a sixth of
//! the tolerance; a quarter is allowed. Normals magnify: stored components span two units, the third follows from them with a slope of at
//! most 3/4 (the noise leans by at most a sine of 0.6), and a blend of such normals, of length 0.8 or more, is brought to one.
//! That makes 2 * 1.25 / 0.8, or [`NORMAL_TOLERANCE`]. Where the number of probes is a ratio's next integer, rounding may give one
//! probe more or less: that is left out.

use std::f32::consts::TAU;

use fantex_bake::{BakeFormat, BakeOptions, Prefilter, Source, SourceChannel, TexelPoint};
use fantex_base::Random;
use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_gpu::{FanModel, Gpu, shader};
use fantex_mesh::{Mesh, Model, generate};
use fantex_scene::FilterOptions;
use fantex_store::{ChannelKind, Footprint, PAGE, Sampler};
use fantex_stream::PageTable;
use fantex_test::cleaned;
use fantex_texture::Filter;
use fantex_texture::filter::FootprintAxes;
use glam::{DVec3, Vec2, Vec3, Vec4, Vec4Swizzles};

use crate::common::{Baked, Residents, gpu, model, read_back, target, upload};

/// See the module.
const TOLERANCE: f32 = 0.012;

/// See the module.
const NORMAL_TOLERANCE: f32 = 3.2 * TOLERANCE;

const POINTS: usize = 4096;

/// Columns of the picture that holds a value per point.
const COLUMNS: u32 = 64;

/// Noise, another number at every point.
struct Noise;

impl Source for Noise {
    fn channels(&self) -> Vec<SourceChannel> {
        let kinds = [ChannelKind::BaseColor, ChannelKind::Normal, ChannelKind::OcclusionRoughnessMetallic];
        kinds.map(|kind| SourceChannel { kind, has_alpha: false, exceeds_one: false }).to_vec()
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let mut random = Random::of_seeds(point.position.to_array().map(|v| u64::from(v.to_bits())));
        let mut unit = || random.unit() as f32;
        values[0] = Vec4::new(unit(), unit(), unit(), 1.0);
        let (angle, z) = (TAU * unit(), 0.8 + 0.2 * unit());
        let flat = Vec3::new(angle.cos(), angle.sin(), 0.0) * (1.0 - z * z).sqrt();
        let (right, up) = point.normal.any_orthonormal_pair();
        values[1] = (right * flat.x + up * flat.y + point.normal * z).extend(1.0);
        values[2] = Vec4::new(unit(), unit(), unit(), 1.0);
    }
}

/// A ball or a ring with bumps, in tiles of one page or of several.
fn random_mesh(random: &mut Random) -> (Mesh, u32, u64) {
    let ball: Model = generate::icosphere(3);
    let (mut model, tile, texels) = match random.below(4) {
        0 => (ball, 0, 1 << 19),
        1 => (ball, 64, 1 << 18),
        2 => (generate::torus(40, 24), 128, 1 << 20),
        _ => (generate::cube(3), 1024, 3 << 20),
    };
    for p in &mut model.positions {
        let bump = DVec3::new(random.unit(), random.unit(), random.unit()) - 0.5;
        *p += bump * 0.03;
    }
    (cleaned(model), tile, texels)
}

/// A point with its footprint, as both are given it.
struct Query {
    point: fantex_mesh::SurfacePoint,
    footprint: Footprint,
}

fn random_query(random: &mut Random, mesh: &Mesh) -> Query {
    let triangle = random.below(mesh.triangles.len() as u64) as u32;
    let (a, b) = (random.unit().sqrt() as f32, random.unit() as f32);
    let lambda = Vec3::new(1.0 - a, a * (1.0 - b), a * b);
    // From a small part of a texel to the whole triangle, and up to sixteen times as long as wide.
    let (length, stretch) = (1e-3 * 1e3f64.powf(random.unit()), 1.0 + 15.0 * random.unit());
    let mut step = |length: f64| {
        let angle = f64::from(TAU) * random.unit();
        let (x, y) = ((length * angle.cos()) as f32, (length * angle.sin()) as f32);
        Vec3::new(x, y, -x - y)
    };
    let lambda_steps = [step(length), step(length / stretch)];
    Query { point: fantex_mesh::SurfacePoint { triangle, lambda }, footprint: Footprint { lambda_steps } }
}

/// Evaluates points by the shader; a channel of [`Noise`] with the same conventions as [`Sampler`]. `has_branches`: as on graphics
/// cards, or as on software.
fn on_gpu(
    gpu: &Gpu,
    fan: &FanModel,
    sampler: &Sampler,
    (filter, has_branches): (Filter, bool),
    queries: &[Query],
) -> [Vec<Vec4>; 3] {
    let source = format!("{}{}", shader::compose_surface(&shader::FAN), include_str!("sampler.wgsl"));
    let module = shader::module(&gpu.device, "points", &source);
    let (mesh, cover) = (sampler.mesh(), sampler.cover());
    let records: Vec<[Vec4; 9]> = queries
        .iter()
        .map(|query| {
            let triangle = query.point.triangle as usize;
            let groups = cover.corner_groups[triangle];
            let uv = [0, 1, 2].map(|slot| cover.tile_corners(mesh, triangle, slot));
            let at = |slot: usize, lambda: Vec3| -> Vec2 { fantex_mesh::interpolate(uv[slot], lambda) };
            let steps = query.footprint.lambda_steps;
            let slot = |slot: usize| {
                let [dx, dy] = steps.map(|step| at(slot, step));
                [at(slot, query.point.lambda).extend(0.0).extend(0.0), Vec4::new(dx.x, dx.y, dy.x, dy.y)]
            };
            let ([a, da], [b, db], [c, dc]) = (slot(0), slot(1), slot(2));
            let [g0, g1, g2] = groups.map(|group| group as f32);
            let normal = sampler.vertex_normal(query.point).extend(0.0);
            [query.point.lambda.extend(0.0), Vec4::new(g0, g1, g2, 0.0), normal, a, da, b, db, c, dc]
        })
        .collect();
    let points = gpu.buffer("points", bytemuck::cast_slice(&records), wgpu::BufferUsages::STORAGE);
    let entry = wgpu::BindGroupLayoutEntry {
        binding: 0,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only: true },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    };
    let layout = gpu
        .device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &[entry] });
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &layout,
        entries: &[wgpu::BindGroupEntry { binding: 0, resource: points.as_entire_binding() }],
    });
    let (texture_group, texture_layout) = fan.texture_group();
    let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[None, Some(texture_layout), None, Some(&layout)],
        immediate_size: 0,
    });
    let is_paged = cover.groups.iter().any(|group| group.extent.iter().any(|&n| n > PAGE));
    [0, 1, 2].map(|channel| {
        let mut constants = fan.texture_constants(filter, is_paged);
        constants.retain(|(name, _)| *name != "FAN_BRANCHES");
        constants.push(("FAN_BRANCHES", f64::from(u8::from(has_branches))));
        constants.push(("POINT_CHANNEL", f64::from(channel)));
        let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
        let format = wgpu::TextureFormat::Rgba32Float;
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vs_points"),
                compilation_options: options.clone(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fs_points"),
                compilation_options: options,
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let values = target(gpu, [COLUMNS, (queries.len() as u32).div_ceil(COLUMNS)], format);
        let view = values.create_view(&Default::default());
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: Default::default(),
            })],
            ..Default::default()
        });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(1, texture_group, &[]);
        pass.set_bind_group(3, &group, &[]);
        pass.draw(0..3, 0..1);
        drop(pass);
        let bytes = read_back(gpu, encoder, &values);
        bytes.chunks_exact(16).map(bytemuck::pod_read_unaligned).take(queries.len()).collect()
    })
}

/// Whether rounding may decide how many probes a look-up has.
fn is_uncertain(sampler: &Sampler, query: &Query) -> bool {
    let max_anisotropy = sampler.filter().max_anisotropy;
    sampler.filter().filter == Filter::Anisotropic
        && sampler.taps(query.point).any(|tap| {
            let extent = Vec2::from(sampler.cover().groups[tap.group as usize].extent.map(|n| n as f32));
            let [dx, dy] = query.footprint.lambda_steps;
            let [dx, dy] = [dx, dy].map(|step| fantex_mesh::interpolate(tap.corners, step) * extent);
            let axes = FootprintAxes::new(dx, dy);
            let ratio = axes.major / axes.limited_minor(max_anisotropy).max(1.0);
            (ratio - ratio.round()).abs() < 1e-2
        })
}

#[test]
fn shaders_look_up_what_the_sampler_does() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(13);
    for (round, filter) in
        [Filter::Trilinear, Filter::Anisotropic, Filter::Trilinear, Filter::Anisotropic, Filter::Bilinear]
            .into_iter()
            .enumerate()
    {
        let (mesh, tile, texels) = random_mesh(&mut random);
        let budget = TexelBudget::Total(texels);
        let (cover, _) = build_cover(&mesh, &CoverOptions { tile, budget, ..Default::default() }).unwrap();
        let options = BakeOptions { format: BakeFormat::Rgba8, ..BakeOptions::default() };
        let baked = Baked::new(&mesh, &cover, &Noise, &options);
        let filter = FilterOptions { filter, max_anisotropy: 8.0 };
        let sampler = Sampler::of_cache(baked.cache(), filter);
        let table = PageTable::new(sampler.cover());
        let formats = FanModel::atlas_formats(&gpu, baked.channels());
        let mut fan = model(&gpu, &baked, &table, &formats);
        upload(&gpu, &mut fan, baked.asset(), &table, &Residents::all());
        fan.set_filter(&gpu, &filter);
        let queries: Vec<Query> = (0..POINTS).map(|_| random_query(&mut random, sampler.mesh())).collect();
        let [seen, otherwise] = [false, true]
            .map(|has_branches| on_gpu(&gpu, &fan, &sampler, (filter.filter, has_branches), &queries));
        assert_same(&seen, &otherwise, &format!("round {round}, {filter:?}"));
        for (kind, seen) in Noise.channels().into_iter().map(|channel| channel.kind).zip(seen) {
            let (mut sum, mut largest, mut count) = (0.0, 0f32, 0);
            for (query, seen) in queries.iter().zip(seen) {
                if is_uncertain(&sampler, query) {
                    continue;
                }
                let expected = sampler.sample(kind, query.point, query.footprint).unwrap();
                let difference = (seen.xyz() - expected.xyz()).abs().max_element();
                assert!(difference.is_finite());
                (sum, largest, count) = (sum + difference, largest.max(difference), count + 1);
            }
            let mean = sum / count as f32;
            println!(
                "round {round}, {filter:?}, {kind}: mean {mean:.5}, largest {largest:.4} of {count} points"
            );
            assert!(count > POINTS / 2);
            let tolerance = if kind == ChannelKind::Normal { NORMAL_TOLERANCE } else { TOLERANCE };
            assert!(largest < tolerance, "{filter:?} {kind}: {largest}");
            assert!(mean < 0.25 * tolerance, "{filter:?} {kind}: {mean} on average");
        }
    }
}

/// Whether shaders with branches and without read the same. Texture units round coordinates to 1/256 of a texel, so what differs by a rounding
/// error may differ by as much.
fn assert_same(seen: &[Vec<Vec4>; 3], otherwise: &[Vec<Vec4>; 3], what: &str) {
    for (point, (a, b)) in seen.iter().flatten().zip(otherwise.iter().flatten()).enumerate() {
        assert!(a.distance(*b) < 0.01, "{what}: {a} and {b} with branches, point {point}");
    }
}

#[test]
fn branches_make_no_difference_where_pages_are_missing() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(29);
    let mesh = cleaned(generate::cube(3));
    let budget = TexelBudget::Total(3 << 20);
    let (cover, _) = build_cover(&mesh, &CoverOptions { tile: 1024, budget, ..Default::default() }).unwrap();
    assert!(cover.groups.iter().any(|group| group.extent.iter().any(|&n| n > 2 * PAGE)));
    let options = BakeOptions { format: BakeFormat::Rgba8, ..BakeOptions::default() };
    let baked = Baked::new(&mesh, &cover, &Noise, &options);
    let table = PageTable::new(&cover);
    let formats = FanModel::atlas_formats(&gpu, baked.channels());
    for (seed, filter) in [(1, Filter::Trilinear), (2, Filter::Anisotropic), (3, Filter::Anisotropic)] {
        let options = FilterOptions { filter, max_anisotropy: 8.0 };
        let sampler = Sampler::of_cache(baked.cache(), options);
        let mut fan = model(&gpu, &baked, &table, &formats);
        upload(&gpu, &mut fan, baked.asset(), &table, &Residents::random(seed));
        fan.set_filter(&gpu, &options);
        let queries: Vec<Query> = (0..POINTS).map(|_| random_query(&mut random, sampler.mesh())).collect();
        let [plain, branched] =
            [false, true].map(|has_branches| on_gpu(&gpu, &fan, &sampler, (filter, has_branches), &queries));
        assert_same(&plain, &branched, &format!("{filter:?}"));
    }
}

/// Triangles that are seen edge-on have such footprints.
#[test]
fn derivatives_without_bounds_are_held_as_the_sampler_holds_them() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(31);
    let mesh = cleaned(generate::icosphere(3));
    let budget = TexelBudget::Total(1 << 18);
    let (cover, _) = build_cover(&mesh, &CoverOptions { tile: 64, budget, ..Default::default() }).unwrap();
    let options = BakeOptions { format: BakeFormat::Rgba8, ..BakeOptions::default() };
    let baked = Baked::new(&mesh, &cover, &Noise, &options);
    let table = PageTable::new(&cover);
    let formats = FanModel::atlas_formats(&gpu, baked.channels());
    for filter in [Filter::Trilinear, Filter::Anisotropic] {
        let options = FilterOptions { filter, max_anisotropy: 8.0 };
        let sampler = Sampler::of_cache(baked.cache(), options);
        let mut fan = model(&gpu, &baked, &table, &formats);
        upload(&gpu, &mut fan, baked.asset(), &table, &Residents::all());
        fan.set_filter(&gpu, &options);
        let factors = [[1e15, 1e15], [1e25, 1.0], [f32::INFINITY, f32::INFINITY], [f32::NAN, f32::NAN]];
        let query = |[x, y]: [f32; 2]| {
            let mut query = random_query(&mut random, sampler.mesh());
            let [dx, dy] = query.footprint.lambda_steps;
            query.footprint.lambda_steps = [dx * x, dy * y];
            query
        };
        let queries: Vec<Query> = factors.into_iter().cycle().take(256).map(query).collect();
        let seen = on_gpu(&gpu, &fan, &sampler, (filter, false), &queries);
        for (kind, seen) in Noise.channels().into_iter().map(|channel| channel.kind).zip(seen) {
            let tolerance = if kind == ChannelKind::Normal { NORMAL_TOLERANCE } else { TOLERANCE };
            for (query, seen) in queries.iter().zip(seen) {
                let expected = sampler.sample(kind, query.point, query.footprint).unwrap();
                let difference = (seen.xyz() - expected.xyz()).abs().max_element();
                let steps = query.footprint.lambda_steps;
                assert!(difference < tolerance, "{filter:?} {kind}: {seen} and {expected}, {steps:?}");
            }
        }
    }
}
