//! Shadow maps: where they look, their texture, when they must be drawn again.

use std::sync::Arc;

use fantex_scene::{FittedView, Light, Penumbra, ShadowOptions, Spread, lamp_views};
use glam::{Mat4, Vec3, Vec4};

use super::layout::SHADOW_FORMAT;
use super::records::{LampRecord, ShadowFaceRecord};
use crate::{Gpu, GpuError, ModelSpace};

/// The near plane of a lamp as a share of the farthest depth.
const NEAREST_SHARE: f64 = 1e-4;

/// One map.
#[derive(Debug)]
pub(crate) struct ShadowFace {
    pub(super) record: ShadowFaceRecord,
    /// From mesh space to clip space of the map.
    pub(super) clip_from_mesh: Mat4,
    /// Its layer, as a target.
    pub(crate) target: wgpu::TextureView,
    /// Texels along its sides.
    pub(crate) resolution: u32,
}

/// All maps of a scene's lamps.
#[derive(Debug)]
pub(super) struct ShadowMaps {
    drawn: Option<Drawn>,
    pub(super) faces: Vec<ShadowFace>,
    /// First face and number of faces per lamp.
    pub(super) of_lamps: Vec<[u32; 2]>,
    texture: wgpu::Texture,
    pub(super) view: wgpu::TextureView,
}

/// What decides what the maps hold.
#[derive(Debug)]
struct Drawn {
    lamps: Vec<(LampRecord, Option<ShadowOptions>)>,
    points: Arc<[Vec3]>,
    revision: u64,
}

/// What has to be done about the maps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ShadowChanges {
    /// They must be drawn.
    pub(super) stale: bool,
    /// They are in another texture.
    pub(super) moved: bool,
}

impl ShadowMaps {
    pub(super) fn none(gpu: &Gpu) -> Self {
        let texture = create(gpu, 1, 1);
        let view = array_view(&texture);
        Self { drawn: None, faces: Vec::new(), of_lamps: Vec::new(), texture, view }
    }

    /// Fits the maps to lamps, of which `records` are the records, and to a model.
    pub(super) fn update(
        &mut self,
        gpu: &Gpu,
        lamps: &[Light],
        records: &[LampRecord],
        space: &ModelSpace,
        revision: u64,
    ) -> Result<ShadowChanges, GpuError> {
        // Its colour does not change a lamp's shadow.
        let colorless = |record: &LampRecord| LampRecord { color: Vec3::ONE, ..*record };
        let wanted: Vec<_> = records.iter().zip(lamps).map(|(r, l)| (colorless(r), l.shadow)).collect();
        let is_same = |drawn: &Drawn| {
            drawn.lamps == wanted && Arc::ptr_eq(&drawn.points, &space.points) && drawn.revision == revision
        };
        if self.drawn.as_ref().is_some_and(is_same) {
            return Ok(ShadowChanges::default());
        }
        let fitted: Vec<Vec<FittedView>> = lamps
            .iter()
            .map(|light| match light.shadow {
                Some(_) => {
                    let casters = space.points.iter().copied();
                    lamp_views(&light.kind, &space.world_from_mesh, &space.points, casters)
                }
                None => Vec::new(),
            })
            .collect();
        let moved = self.make_room(gpu, lamps, &fitted)?;
        let all_faces = lamps.iter().zip(&fitted).flat_map(|(light, views)| {
            light.shadow.into_iter().flat_map(move |options| views.iter().map(move |view| (view, options)))
        });
        let mesh_per_world = (1.0 / space.world_from_mesh.scale) as f32;
        self.faces = all_faces
            .enumerate()
            .map(|(layer, (fitted, options))| self.face(layer as u32, fitted, &options, mesh_per_world))
            .collect();
        let mut first = 0;
        self.of_lamps = fitted
            .iter()
            .map(|views| {
                let entry = [first, views.len() as u32];
                first += views.len() as u32;
                entry
            })
            .collect();
        self.drawn = Some(Drawn { lamps: wanted, points: Arc::clone(&space.points), revision });
        Ok(ShadowChanges { stale: !self.faces.is_empty(), moved })
    }

    /// Forgets that the maps were drawn.
    pub(super) fn forget(&mut self) {
        self.drawn = None;
    }

    /// A texture with a layer for every map, as large as the largest; whether it is a new one.
    fn make_room(
        &mut self,
        gpu: &Gpu,
        lamps: &[Light],
        fitted: &[Vec<FittedView>],
    ) -> Result<bool, GpuError> {
        let layers = fitted.iter().map(Vec::len).sum::<usize>().max(1) as u32;
        let side = lamps.iter().filter_map(|l| l.shadow).map(|s| s.resolution).max().unwrap_or(1);
        if self.texture.width() == side && self.texture.depth_or_array_layers() == layers {
            return Ok(false);
        }
        let limits = gpu.limits();
        if side > limits.max_texture_dimension_2d {
            let allowed = u64::from(limits.max_texture_dimension_2d);
            return Err(gpu.too_large("a shadow map", u64::from(side), allowed, "texels along a side"));
        }
        if layers > limits.max_texture_array_layers {
            let allowed = u64::from(limits.max_texture_array_layers);
            return Err(gpu.too_large("the scene's lamps", u64::from(layers), allowed, "shadow maps"));
        }
        self.texture = create(gpu, side, layers);
        self.view = array_view(&self.texture);
        Ok(true)
    }

    fn face(
        &self,
        layer: u32,
        fitted: &FittedView,
        options: &ShadowOptions,
        mesh_per_world: f32,
    ) -> ShadowFace {
        let FittedView { view, far } = fitted;
        let near = match view.spread() {
            Spread::Perspective => (far * NEAREST_SHARE) as f32,
            Spread::Parallel => 0.0,
        };
        let [right, up] = view.sides().map(|side| side.as_vec3());
        let half = view.half_extent().as_vec2();
        let (penumbra, penumbra_width) = match (options.penumbra, view.spread()) {
            (Penumbra::Sharp, _) => (0, 0.0),
            (Penumbra::Even(width), _) => (1, width * mesh_per_world),
            (Penumbra::Lamp(size), Spread::Perspective) => (2, size * mesh_per_world),
            (Penumbra::Lamp(tangent), Spread::Parallel) => (2, tangent),
        };
        let map_from_mesh = view.matrix().as_mat4();
        let record = ShadowFaceRecord {
            map_from_mesh,
            right,
            half_width: half.x,
            up,
            half_height: half.y,
            forward: view.forward().as_vec3(),
            far: *far as f32,
            origin: view.origin.as_vec3(),
            near,
            resolution: options.resolution as f32,
            layer,
            bias: options.bias,
            normal_offset: options.normal_offset,
            penumbra,
            penumbra_width,
            pad: [0.0; 2],
        };
        let target = self.texture.create_view(&wgpu::TextureViewDescriptor {
            label: Some("shadow map"),
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer: layer,
            array_layer_count: Some(1),
            ..Default::default()
        });
        let clip_from_mesh = clip_from_mesh(map_from_mesh, near, *far as f32);
        ShadowFace { record, clip_from_mesh, target, resolution: options.resolution }
    }
}

/// From mesh to clip space of a map. Depth becomes `near / depth`, or without a near plane (of parallel light) the distance
/// from the far end over the whole depth.
fn clip_from_mesh(map_from_mesh: Mat4, near: f32, far: f32) -> Mat4 {
    let [u, v, w, depth] = [0, 1, 2, 3].map(|row| map_from_mesh.row(row));
    let z = if near > 0.0 { Vec4::W * near } else { w - depth / far };
    Mat4::from_cols(u * 2.0 - w, w - v * 2.0, z, w).transpose()
}

fn create(gpu: &Gpu, side: u32, layers: u32) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("shadow maps"),
        size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: SHADOW_FORMAT,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    })
}

fn array_view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}
