//! The functions in WGSL that exports with fans carry, against `fantex_store::Sampler` on random points.
//!
//! Tolerance. Samplers weigh texels in steps of 1/256, sRGB is decoded to about 1/1000, sheets round values to 1/255, and neighbouring
//! texels of the waves differ by up to a tenth. Normals are blended as vectors in object space instead of two coordinates in the tile's
//! frame.

use fantex_bake::{BakeFormat, BakeOptions, NoProgress, Prefilter, Source, SourceChannel, TexelPoint};
use fantex_base::Random;
use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_export::{ChannelMap, Depth, FanSheetOptions, FanSheets, ShaderLanguage, fan_sheets};
use fantex_gpu::{Gpu, shader};
use fantex_mesh::{Material, SurfacePoint, generate};
use fantex_scene::FilterOptions;
use fantex_store::{ChannelKind, Footprint, Sampler};
use fantex_test::cleaned;
use fantex_texture::Filter;
use glam::{Vec3, Vec4, Vec4Swizzles};
use half::f16;

use crate::common::{Baked, gpu, read_back, target};

const COLUMNS: u32 = 64;
const ROWS: u32 = 32;

/// Smooth colours, materials and normals.
struct Waves;

impl Source for Waves {
    fn channels(&self) -> Vec<SourceChannel> {
        let kinds = [ChannelKind::BaseColor, ChannelKind::OcclusionRoughnessMetallic, ChannelKind::Normal];
        kinds.map(|kind| SourceChannel { kind, has_alpha: false, exceeds_one: false }).to_vec()
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let p = point.position * 4.0;
        let wave = Vec3::new(p.x.sin(), (p.y + 1.0).sin(), (p.z + 2.0).sin());
        values[0] = (wave * 0.4 + 0.5).extend(1.0);
        values[1] = (Vec3::new(wave.y, wave.z, wave.x) * 0.4 + 0.5).extend(1.0);
        values[2] = (point.normal + 0.2 * wave).normalize().extend(0.0);
    }
}

/// Values of a sheet's picture at points, by `fan_sample` or `fan_normal`.
fn on_gpu(gpu: &Gpu, fans: &FanSheets, map: usize, points: &[SurfacePoint]) -> Vec<Vec4> {
    let functions = fans.shader(ShaderLanguage::Wgsl, &Material::default());
    let module = shader::module(&gpu.device, "sheets", &(functions + include_str!("sheets.wgsl")));
    let [width, height] = fans.sheets[0].size;
    let (format, texels) = texels(fans, map);
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let sheet = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let bytes_per_row = Some(texels.len() as u32 / height);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row, rows_per_image: None };
    gpu.queue.write_texture(sheet.as_image_copy(), &texels, layout, size);
    let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        ..Default::default()
    });
    let records: Vec<[[f32; 2]; 4]> = points
        .iter()
        .map(|point| {
            let [a, b, c] = fans.uv[point.index()].map(|corners| point.interpolate(corners).to_array());
            [a, b, c, [point.lambda.x, point.lambda.y]]
        })
        .collect();
    let records = gpu.buffer("points", bytemuck::cast_slice(&records), wgpu::BufferUsages::STORAGE);
    let is_normal = fans.maps[map].map == ChannelMap::Normal;
    let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vs_points"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(if is_normal { "fs_normals" } else { "fs_values" }),
            compilation_options: Default::default(),
            targets: &[Some(wgpu::TextureFormat::Rgba32Float.into())],
        }),
        multiview_mask: None,
        cache: None,
    });
    let view = sheet.create_view(&Default::default());
    let resources = [
        wgpu::BindingResource::TextureView(&view),
        wgpu::BindingResource::Sampler(&sampler),
        records.as_entire_binding(),
    ];
    let entries = (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource });
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries.collect::<Vec<_>>(),
    });
    let values = target(gpu, [COLUMNS, ROWS], wgpu::TextureFormat::Rgba32Float);
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
    pass.set_bind_group(0, &group, &[]);
    pass.draw(0..3, 0..1);
    drop(pass);
    let bytes = read_back(gpu, encoder, &values);
    bytes.chunks_exact(16).map(bytemuck::pod_read_unaligned).collect()
}

/// A sheet's picture with four components.
fn texels(fans: &FanSheets, map: usize) -> (wgpu::TextureFormat, Vec<u8>) {
    let (about, picture) = (&fans.maps[map], &fans.sheets[0].pictures[map]);
    assert_eq!(about.components, 3);
    match (about.depth, about.is_srgb) {
        (Depth::Sixteen, _) => {
            let half =
                |big: [u8; 2]| f16::from_f32(f32::from(u16::from_be_bytes(big)) / 65535.0).to_le_bytes();
            let texel =
                |t: &[u8]| [half([t[0], t[1]]), half([t[2], t[3]]), half([t[4], t[5]]), [0; 2]].concat();
            (wgpu::TextureFormat::Rgba16Float, picture.chunks_exact(6).flat_map(texel).collect())
        }
        (Depth::Eight, is_srgb) => {
            let format = match is_srgb {
                true => wgpu::TextureFormat::Rgba8UnormSrgb,
                false => wgpu::TextureFormat::Rgba8Unorm,
            };
            (format, picture.chunks_exact(3).flat_map(|t| [t[0], t[1], t[2], 255]).collect())
        }
    }
}

#[test]
fn shaders_for_other_programs_give_what_the_sampler_does() {
    let Some(gpu) = gpu() else { return };
    let mesh = cleaned(generate::torus(40, 24));
    let options = CoverOptions { budget: TexelBudget::Total(100_000), ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options).unwrap();
    let options = BakeOptions { format: BakeFormat::Rgba8, ..BakeOptions::default() };
    let baked = Baked::new(&mesh, &cover, &Waves, &options);
    let fans = fan_sheets(baked.asset(), &FanSheetOptions::default(), &NoProgress).unwrap();
    assert_eq!(fans.sheets.len(), 1);
    let filter = FilterOptions { filter: Filter::Bilinear, ..FilterOptions::default() };
    let sampler = Sampler::of_cache(baked.cache(), filter);
    let mut random = Random::new(31);
    let mut random_point = || {
        let triangle = random.below(mesh.triangles.len() as u64) as u32;
        let (a, b) = (random.unit().sqrt() as f32, random.unit() as f32);
        SurfacePoint { triangle, lambda: Vec3::new(1.0 - a, a * (1.0 - b), a * b) }
    };
    let points: Vec<SurfacePoint> = (0..COLUMNS * ROWS).map(|_| random_point()).collect();
    for (map, about) in fans.maps.iter().enumerate() {
        let seen = on_gpu(&gpu, &fans, map, &points);
        let (mut sum, mut largest) = (0.0, 0f32);
        for (&point, seen) in points.iter().zip(seen) {
            let expected = sampler.sample(about.map.channel(), point, Footprint::NONE).unwrap();
            let difference = (seen.xyz() - expected.xyz()).abs().max_element();
            assert!(difference.is_finite());
            (sum, largest) = (sum + difference, largest.max(difference));
        }
        let mean = sum / points.len() as f32;
        println!("{}: mean {mean:.5}, largest {largest:.4}", about.map.name());
        assert!(mean < 0.002 && largest < 0.01, "{}: {mean} {largest}", about.map.name());
    }
}
