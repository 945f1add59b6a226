//! What projectors project, as the layers of one texture.

use std::sync::Arc;

use fantex_scene::{Light, LightKind, Slide};
use fantex_texture::{Filtering, SampleOptions, ShadingPoint, UvPoint, Wrap};
use glam::{Vec2, Vec3, Vec4};
use half::f16;
use rayon::prelude::*;

use super::environment::{half_texel, write_level};
use crate::Gpu;

/// Texels along the sides of a slide; sharper images and procedural textures are reduced to it.
const SIDE: u32 = 1024;

/// The slides of a scene's projectors.
#[derive(Debug)]
pub(super) struct SlideTextures {
    shown: Vec<(Slide, f32)>,
    pub(super) view: wgpu::TextureView,
}

impl SlideTextures {
    /// None.
    pub(super) fn none(gpu: &Gpu) -> Self {
        let texture = texture(gpu, 1, 1);
        Self { shown: Vec::new(), view: array_view(&texture) }
    }

    /// Draws the slides of all projectors among the lamps, in their order, unless they are there already.
    pub(super) fn update(&mut self, gpu: &Gpu, lamps: &[Light], seconds: f32) -> bool {
        let slides = lamps.iter().filter_map(|lamp| match &lamp.kind {
            LightKind::Projector(projector) => Some(&projector.slide),
            _ => None,
        });
        let wanted: Vec<_> = slides.map(|slide| (slide.clone(), shown_time(slide, seconds))).collect();
        let same = |(a, b): (&(Slide, f32), &(Slide, f32))| a.1 == b.1 && is_same(&a.0, &b.0);
        if wanted.is_empty() || wanted.len() == self.shown.len() && wanted.iter().zip(&self.shown).all(same) {
            return false;
        }
        let texture = texture(gpu, SIDE, wanted.len() as u32);
        for level in 0..texture.mip_level_count() {
            let side = SIDE >> level;
            let texels: Vec<[f16; 4]> =
                wanted.iter().flat_map(|(slide, seconds)| draw(slide, side, *seconds)).collect();
            write_level(gpu, &texture, level, [side, side, wanted.len() as u32], &texels);
        }
        self.view = array_view(&texture);
        self.shown = wanted;
        true
    }
}

/// The time of an animation; of a still the same always.
fn shown_time(slide: &Slide, seconds: f32) -> f32 {
    match slide {
        Slide::Texture(texture) if texture.is_animated() => seconds,
        _ => 0.0,
    }
}

fn is_same(a: &Slide, b: &Slide) -> bool {
    match (a, b) {
        (Slide::Image { image: a, options: x }, Slide::Image { image: b, options: y }) => {
            Arc::ptr_eq(a, b) && x == y
        }
        (Slide::Texture(a), Slide::Texture(b)) => Arc::ptr_eq(a, b),
        _ => false,
    }
}

/// Colour times alpha at the texels of a square of the given side.
fn draw(slide: &Slide, side: u32, seconds: f32) -> Vec<[f16; 4]> {
    let texel = 1.0 / side as f32;
    let steps = [Vec2::X * texel, Vec2::Y * texel];
    let value = |uv: Vec2| match slide {
        Slide::Image { image, options } => {
            let options = SampleOptions { wrap: [Wrap::Clamp; 2], ..*options };
            Vec4::from_array(image.sample(uv, steps, &options))
        }
        Slide::Texture(texture) => texture.evaluate(&ShadingPoint {
            position: Vec3::new(uv.x - 0.5, 0.5 - uv.y, 0.0),
            position_steps: steps.map(|step| Vec3::new(step.x, -step.y, 0.0)),
            normal: Vec3::Z,
            normal_steps: [Vec3::ZERO; 2],
            uv: &[UvPoint { uv, steps }],
            vertex_color: Vec4::ONE,
            to_eye: None,
            time: seconds,
            filtering: Filtering::Own,
        }),
    };
    let pixel = |i: u32| {
        let uv = (Vec2::new((i % side) as f32, (i / side) as f32) + 0.5) * texel;
        let value = value(uv);
        half_texel((value.truncate() * value.w).max(Vec3::ZERO).extend(1.0))
    };
    (0..side * side).into_par_iter().map(pixel).collect()
}

fn texture(gpu: &Gpu, side: u32, layers: u32) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("slides"),
        size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: layers },
        mip_level_count: side.ilog2() + 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

fn array_view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}
