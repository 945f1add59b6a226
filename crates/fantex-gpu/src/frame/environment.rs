//! An environment map and its blurred levels as cube textures.

use std::sync::Arc;

use fantex_scene::{EnvironmentLight, split_sum};
use fantex_texture::environment::{EnvironmentForm, PREFILTERED_LEVELS, PrefilteredEnvironment};
use glam::{Vec3, Vec4};
use half::f16;
use rayon::prelude::*;

use crate::Gpu;
use crate::gpu::SAMPLED;

/// Most texels along a face; sharper maps are reduced.
const MAX_SIDE: u32 = 1024;

/// Texels along a face of the first blurred level, and of all others. The CPU renderer's have 128, 64 and fewer.
const FIRST_SIDE: u32 = 128;
const ROUGH_SIDE: u32 = 64;

/// Nodes of the split sum's table along each axis, as in `shading.wgsl`.
const SPLIT_SUM_NODES: u32 = 24;

#[derive(Debug)]
pub(super) struct EnvironmentTextures {
    /// The map that is shown; nothing for black ones of one texel.
    source: Option<Arc<PrefilteredEnvironment>>,
    pub(super) sharp: wgpu::TextureView,
    pub(super) first: wgpu::TextureView,
    pub(super) rough: wgpu::TextureView,
}

impl EnvironmentTextures {
    /// Black.
    pub(super) fn none(gpu: &Gpu) -> Self {
        let black = |cubes| Cubes::new(gpu, 1, 1, cubes, |_, _, _| Vec3::ZERO);
        Self { source: None, sharp: black(1).one(), first: black(1).one(), rough: black(2).array() }
    }

    /// Those of a light's map, unless they are these already.
    pub(super) fn update(&mut self, gpu: &Gpu, light: Option<&EnvironmentLight>) -> bool {
        // Without an environment, the last one's stay: it may come back.
        let Some(light) = light else { return false };
        if self.source.as_ref().is_some_and(|map| Arc::ptr_eq(map, &light.map)) {
            return false;
        }
        *self = Self::of_map(gpu, &light.map);
        true
    }

    fn of_map(gpu: &Gpu, prefiltered: &Arc<PrefilteredEnvironment>) -> Self {
        let map = prefiltered.map();
        let side = sharp_side(map.form(), map.chart_size()).min(gpu.limits().max_texture_dimension_2d);
        let levels = side.ilog2() + 1;
        let sharp = Cubes::new(gpu, side, levels, 1, |_, direction, steps| map.sample(direction, steps));
        let at = |level: usize, direction| {
            let roughness = level as f32 / PREFILTERED_LEVELS as f32;
            prefiltered.reflected(direction, [Vec3::ZERO; 2], roughness)
        };
        let first = Cubes::new(gpu, FIRST_SIDE, 1, 1, |_, direction, _| at(1, direction));
        let others = PREFILTERED_LEVELS as u32 - 1;
        let rough = Cubes::new(gpu, ROUGH_SIDE, 1, others, |cube, direction, _| at(cube + 2, direction));
        Self {
            source: Some(Arc::clone(prefiltered)),
            sharp: sharp.one(),
            first: first.one(),
            rough: rough.array(),
        }
    }
}

/// Texels along a cube's face that are about as dense as a map's own.
fn sharp_side(form: EnvironmentForm, chart: [u32; 2]) -> u32 {
    let side = match form {
        EnvironmentForm::Cube => chart[0],
        // A quarter of the circle has half as many texels as there are rows; in the middle of a cube's face they are
        // sparser.
        EnvironmentForm::Sphere => (chart[1] * 2 / 3).next_power_of_two(),
        EnvironmentForm::DualParaboloid | EnvironmentForm::MirrorBall => (chart[0] / 2).next_power_of_two(),
    };
    side.clamp(1, MAX_SIDE)
}

/// One or several cubes in a texture.
struct Cubes {
    texture: wgpu::Texture,
}

impl Cubes {
    /// Cubes whose texels are `light(cube, direction of the texel's middle, its changes along the texel's edges)`.
    fn new(
        gpu: &Gpu,
        side: u32,
        levels: u32,
        cubes: u32,
        light: impl Fn(usize, Vec3, [Vec3; 2]) -> Vec3 + Sync,
    ) -> Self {
        let extent = [side, side, 6 * cubes];
        let format = wgpu::TextureFormat::Rgba16Float;
        let texture = gpu.texture("environment", extent, levels, format, SAMPLED);
        for level in 0..levels {
            let side = (side >> level).max(1);
            let layers = (0..6 * cubes as usize).into_par_iter();
            let texels: Vec<[f16; 4]> = layers
                .flat_map_iter(|layer| (0..side * side).map(move |i| (layer, i % side, i / side)))
                .map(|(layer, x, y)| {
                    let at = |dx: f32, dy: f32| face_direction(layer % 6, x as f32 + dx, y as f32 + dy, side);
                    let steps = [at(1.0, 0.5) - at(0.0, 0.5), at(0.5, 1.0) - at(0.5, 0.0)];
                    half_texel(light(layer / 6, at(0.5, 0.5), steps).extend(1.0))
                })
                .collect();
            write_level(gpu, &texture, level, [side, side, 6 * cubes], &texels);
        }
        Self { texture }
    }

    fn view(&self, dimension: wgpu::TextureViewDimension) -> wgpu::TextureView {
        let descriptor = wgpu::TextureViewDescriptor { dimension: Some(dimension), ..Default::default() };
        self.texture.create_view(&descriptor)
    }

    fn one(&self) -> wgpu::TextureView {
        self.view(wgpu::TextureViewDimension::Cube)
    }

    fn array(&self) -> wgpu::TextureView {
        self.view(wgpu::TextureViewDimension::CubeArray)
    }
}

/// The unit direction through a place of a face, in texels, as cube textures have it: +x, -x, +y, -y, +z, -z.
fn face_direction(face: usize, x: f32, y: f32, side: u32) -> Vec3 {
    let [s, t] = [x, y].map(|c| 2.0 * c / side as f32 - 1.0);
    let d = match face {
        0 => Vec3::new(1.0, -t, -s),
        1 => Vec3::new(-1.0, -t, s),
        2 => Vec3::new(s, 1.0, t),
        3 => Vec3::new(s, -1.0, -t),
        4 => Vec3::new(s, -t, 1.0),
        _ => Vec3::new(-s, -t, -1.0),
    };
    d.normalize()
}

/// Half floats end at 65504.
pub(super) fn half_texel(color: Vec4) -> [f16; 4] {
    color.to_array().map(|c| f16::from_f32(c.clamp(0.0, 65_504.0)))
}

/// Writes a level of a texture of half floats; `size` has columns, rows and layers.
pub(super) fn write_level(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    mip_level: u32,
    size: [u32; 3],
    texels: &[[f16; 4]],
) {
    let [width, height, depth_or_array_layers] = size;
    let target = wgpu::TexelCopyTextureInfo { mip_level, ..texture.as_image_copy() };
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(8 * width),
        rows_per_image: Some(height),
    };
    let size = wgpu::Extent3d { width, height, depth_or_array_layers };
    gpu.queue.write_texture(target, bytemuck::cast_slice(texels), layout, size);
}

/// The second half of the split sum as a texture: `n.v` to the right, roughness downwards.
pub(super) fn split_sum_texture(gpu: &Gpu) -> wgpu::TextureView {
    let node = |i: u32| i as f32 / (SPLIT_SUM_NODES - 1) as f32;
    let texel = |i: u32| {
        let [scale, bias] = split_sum(node(i / SPLIT_SUM_NODES), node(i % SPLIT_SUM_NODES));
        half_texel(Vec4::new(scale, bias, 0.0, 1.0))
    };
    let texels: Vec<_> = (0..SPLIT_SUM_NODES * SPLIT_SUM_NODES).map(texel).collect();
    let (extent, format) = ([SPLIT_SUM_NODES, SPLIT_SUM_NODES, 1], wgpu::TextureFormat::Rgba16Float);
    let texture = gpu.texture("split sum", extent, 1, format, SAMPLED);
    write_level(gpu, &texture, 0, extent, &texels);
    texture.create_view(&Default::default())
}
