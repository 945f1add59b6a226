//! Lamps for shaders: their records, the pictures that projectors cast, shadow maps.

use std::sync::Arc;

use fantex_base::Result;
use fantex_mesh::WorldFromMesh;
use fantex_scene::{
    Cookie, Falloff, FittedView, LampView, Lens, Light, LightKind, Penumbra, Projector, ShadowOptions,
    SpotLight, Spread, lamp_views, projector_view,
};
use glam::{DVec3, Mat4, Vec2, Vec3};
use half::f16;
use rayon::prelude::*;

use super::environment::{half_texel, write_level};
use super::{LampRecord, SHADOW_FORMAT, ShadowFaceRecord};
use crate::gpu::SAMPLED;
use crate::{Gpu, ModelSpace};

/// The records of lamps that have no defect, without their shadow maps. Cookies are numbered in the order of the projectors.
pub(super) fn lamp_records(lamps: &[Light], space: &WorldFromMesh) -> Vec<LampRecord> {
    let mut cookies = 0..;
    lamps
        .iter()
        .map(|light| {
            let record = LampRecord { color: light.color, ..of_kind(&light.kind, space) };
            let is_projector = matches!(light.kind, LightKind::Projector(_));
            LampRecord { cookie: if is_projector { cookies.next().unwrap_or(0) } else { 0 }, ..record }
        })
        .collect()
}

fn of_kind(kind: &LightKind, space: &WorldFromMesh) -> LampRecord {
    match kind {
        LightKind::Directional { to_light } => {
            LampRecord { kind: 0, direction: to_light.normalize_or(Vec3::Y), ..LampRecord::default() }
        }
        LightKind::Point { position, falloff } => placed(1, *position, falloff, space),
        LightKind::Spot(light) => spot(light, space),
        LightKind::Projector(light) => projector(light, space),
    }
}

fn placed(kind: u32, position: DVec3, falloff: &Falloff, space: &WorldFromMesh) -> LampRecord {
    let [inverse_reference, inverse_range] = match *falloff {
        Falloff::None => [0.0; 2],
        Falloff::InverseSquare { reference, range } => {
            [1.0 / reference, range.map_or(0.0, |range| 1.0 / range)].map(|v| v as f32)
        }
    };
    let position = space.inverse_point(position);
    LampRecord { kind, position, inverse_reference, inverse_range, ..LampRecord::default() }
}

fn spot(light: &SpotLight, space: &WorldFromMesh) -> LampRecord {
    let cone = light.cone();
    LampRecord {
        direction: light.direction.normalize_or(Vec3::NEG_Y),
        cosine_outer: cone.cosine_outer,
        inverse_cosine_range: 1.0 / cone.cosine_range,
        ..placed(2, light.position, &light.falloff, space)
    }
}

fn projector(light: &Projector, space: &WorldFromMesh) -> LampRecord {
    let kind = match light.lens {
        Lens::Perspective { .. } => 3,
        Lens::Orthographic { .. } => 4,
    };
    let view: LampView = projector_view(light, space);
    LampRecord {
        direction: view.forward().as_vec3(),
        cookie_from_mesh: view.matrix().as_mat4(),
        ..placed(kind, light.position, &light.falloff, space)
    }
}

// What projectors project, as the layers of one texture.

/// Texels along the sides of a cookie; sharper images and procedural textures are reduced to it.
const SIDE: u32 = 1024;

#[derive(Debug)]
pub(super) struct CookieTextures {
    shown: Vec<(Cookie, f32)>,
    pub(super) view: wgpu::TextureView,
}

impl CookieTextures {
    /// None.
    pub(super) fn none(gpu: &Gpu) -> Self {
        let texture = texture(gpu, 1, 1);
        Self { shown: Vec::new(), view: array_view(&texture) }
    }

    /// Draws the cookies of all projectors among the lamps, in their order, unless they are there already.
    pub(super) fn update(&mut self, gpu: &Gpu, lamps: &[Light], seconds: f32) -> Result<bool> {
        let cookies = lamps.iter().filter_map(|lamp| match &lamp.kind {
            LightKind::Projector(projector) => Some(&projector.cookie),
            _ => None,
        });
        let wanted: Vec<_> = cookies.map(|cookie| (cookie.clone(), shown_time(cookie, seconds))).collect();
        let same = |(a, b): (&(Cookie, f32), &(Cookie, f32))| a.1 == b.1 && is_same(&a.0, &b.0);
        if wanted.is_empty() || wanted.len() == self.shown.len() && wanted.iter().zip(&self.shown).all(same) {
            return Ok(false);
        }
        let (count, allowed) = (wanted.len() as u32, gpu.limits().max_texture_array_layers);
        gpu.allow("the scene's lamps", count, allowed, "projectors")?;
        let texture = texture(gpu, SIDE, count);
        for level in 0..texture.mip_level_count() {
            let side = SIDE >> level;
            let texels: Vec<[f16; 4]> =
                wanted.iter().flat_map(|(cookie, seconds)| draw(cookie, side, *seconds)).collect();
            write_level(gpu, &texture, level, [side, side, wanted.len() as u32], &texels);
        }
        self.view = array_view(&texture);
        self.shown = wanted;
        Ok(true)
    }
}

/// The time of an animation; of a still the same always.
fn shown_time(cookie: &Cookie, seconds: f32) -> f32 {
    match cookie {
        Cookie::Texture(texture) if texture.is_animated() => seconds,
        _ => 0.0,
    }
}

fn is_same(a: &Cookie, b: &Cookie) -> bool {
    match (a, b) {
        (Cookie::Image { image: a, options: x }, Cookie::Image { image: b, options: y }) => {
            Arc::ptr_eq(a, b) && x == y
        }
        (Cookie::Texture(a), Cookie::Texture(b)) => Arc::ptr_eq(a, b),
        _ => false,
    }
}

/// Colour times alpha at the texels of a square of the given side.
fn draw(cookie: &Cookie, side: u32, seconds: f32) -> Vec<[f16; 4]> {
    let texel = 1.0 / side as f32;
    let steps = [Vec2::X * texel, Vec2::Y * texel];
    let pixel = |i: u32| {
        let uv = (Vec2::new((i % side) as f32, (i / side) as f32) + 0.5) * texel;
        let value = cookie.color(uv, steps, seconds);
        half_texel((value.truncate() * value.w).max(Vec3::ZERO).extend(1.0))
    };
    (0..side * side).into_par_iter().map(pixel).collect()
}

fn texture(gpu: &Gpu, side: u32, layers: u32) -> wgpu::Texture {
    let levels = side.ilog2() + 1;
    gpu.texture("cookies", [side, side, layers], levels, wgpu::TextureFormat::Rgba16Float, SAMPLED)
}

fn array_view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

// Shadow maps: where they look, their texture, when they must be drawn again.

#[derive(Debug)]
pub(crate) struct ShadowFace {
    pub(super) record: ShadowFaceRecord,
    /// From mesh space to clip space of the map.
    pub(super) clip_from_mesh: Mat4,
    /// Its layer, as a target.
    pub(crate) target: wgpu::TextureView,
    /// Whether it is the first one in its layer.
    pub(crate) is_first: bool,
    /// The first of its texels.
    pub(crate) at: [u32; 2],
    /// Texels along its sides.
    pub(crate) resolution: u32,
}

#[derive(Debug)]
pub(super) struct ShadowMaps {
    pub(super) drawn: Option<Drawn>,
    pub(super) faces: Vec<ShadowFace>,
    /// First face and number of faces per lamp.
    pub(super) of_lamps: Vec<[u32; 2]>,
    texture: wgpu::Texture,
    pub(super) view: wgpu::TextureView,
}

/// What decides what the maps hold.
#[derive(Debug)]
pub(super) struct Drawn {
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
    ) -> Result<ShadowChanges> {
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
        let all_faces = lamps.iter().zip(&fitted).flat_map(|(light, views)| {
            light.shadow.into_iter().flat_map(move |options| views.iter().map(move |view| (view, options)))
        });
        let all_faces: Vec<_> = all_faces.collect();
        let sides: Vec<u32> = all_faces.iter().map(|(_, options)| options.resolution).collect();
        let (places, layers) = map_places(&sides);
        let moved = self.make_room(gpu, sides.iter().copied().max().unwrap_or(1), layers.max(1))?;
        let mesh_per_world = (1.0 / space.world_from_mesh.scale) as f32;
        let faces = all_faces.iter().zip(places);
        self.faces = faces
            .map(|((fitted, options), place)| self.face(place, fitted, options, mesh_per_world))
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

    /// A texture with so many layers; whether it is a new one.
    fn make_room(&mut self, gpu: &Gpu, side: u32, layers: u32) -> Result<bool> {
        if self.texture.width() == side && self.texture.depth_or_array_layers() == layers {
            return Ok(false);
        }
        let limits = gpu.limits();
        gpu.allow("a shadow map", side, limits.max_texture_dimension_2d, "texels along a side")?;
        gpu.allow("the scene's lamps", layers, limits.max_texture_array_layers, "layers of shadow maps")?;
        self.texture = create(gpu, side, layers);
        self.view = array_view(&self.texture);
        Ok(true)
    }

    fn face(
        &self,
        MapPlace { layer, at }: MapPlace,
        fitted: &FittedView,
        options: &ShadowOptions,
        mesh_per_world: f32,
    ) -> ShadowFace {
        let FittedView { view, far } = fitted;
        let [right, up] = view.sides().map(|side| side.as_vec3());
        let half = view.half_extent().as_vec2();
        let (penumbra, penumbra_width) = match (options.penumbra(), view.spread()) {
            (Penumbra::Sharp, _) => (0, 0.0),
            (Penumbra::Even(width), _) => (1, width * mesh_per_world),
            (Penumbra::Lamp(size), Spread::Perspective) => (2, size * mesh_per_world),
            (Penumbra::Lamp(tangent), Spread::Parallel) => (2, tangent),
        };
        let record = ShadowFaceRecord {
            map_from_mesh: view.matrix().as_mat4(),
            right,
            half_width: half.x,
            up,
            half_height: half.y,
            forward: view.forward().as_vec3(),
            far: *far as f32,
            origin: view.origin.as_vec3(),
            near: fitted.near() as f32,
            resolution: options.resolution as f32,
            layer,
            bias: options.bias,
            normal_offset: options.normal_offset,
            penumbra,
            penumbra_width,
            at,
        };
        let target = self.texture.create_view(&wgpu::TextureViewDescriptor {
            label: Some("shadow map"),
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer: layer,
            array_layer_count: Some(1),
            ..Default::default()
        });
        let clip_from_mesh = fitted.clip_from_mesh().as_mat4();
        let is_first = at == [0, 0];
        ShadowFace { record, clip_from_mesh, target, is_first, at, resolution: options.resolution }
    }
}

/// Where a shadow map lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct MapPlace {
    layer: u32,
    /// Its first texel.
    at: [u32; 2],
}

/// Places of square maps in layers as large as the largest, and the number of layers. Maps of one size share layers, row by row.
fn map_places(sides: &[u32]) -> (Vec<MapPlace>, u32) {
    let mut sizes = sides.to_vec();
    sizes.sort_unstable();
    sizes.dedup();
    let largest = sizes.last().copied().unwrap_or(1);
    let mut places = vec![MapPlace { layer: 0, at: [0; 2] }; sides.len()];
    let mut layers = 0;
    for &size in sizes.iter().rev() {
        let columns = largest / size;
        let of_size = places.iter_mut().zip(sides).filter(|(_, side)| **side == size).map(|(place, _)| place);
        let mut count = 0;
        for place in of_size {
            let at = [count % columns, count / columns % columns].map(|n| n * size);
            *place = MapPlace { layer: layers + count / (columns * columns), at };
            count += 1;
        }
        layers += count.div_ceil(columns * columns);
    }
    (places, layers)
}

fn create(gpu: &Gpu, side: u32, layers: u32) -> wgpu::Texture {
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::RENDER_ATTACHMENT;
    gpu.texture("shadow maps", [side, side, layers], 1, SHADOW_FORMAT, usage)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shadow_maps_share_layers_and_lie_apart() {
        let sides = [64, 8192, 512, 512, 3000, 512, 512, 512, 3000, 512, 3000, 3000, 3000];
        let (places, layers) = map_places(&sides);
        assert_eq!(layers, 5, "3000 lies four times in 8192");
        let maps: Vec<_> = places.iter().zip(sides).collect();
        for (i, (a, side)) in maps.iter().enumerate() {
            assert!(a.layer < layers && a.at.iter().all(|n| n + side <= 8192));
            for (b, other) in &maps[..i] {
                let apart = |k: usize| a.at[k] >= b.at[k] + other || b.at[k] >= a.at[k] + side;
                assert!(a.layer != b.layer || apart(0) || apart(1), "{a:?} {b:?}");
            }
        }
        assert!((0..layers).all(|layer| places.contains(&MapPlace { layer, at: [0, 0] })));
        assert_eq!(map_places(&[]), (Vec::new(), 0));
    }
}
