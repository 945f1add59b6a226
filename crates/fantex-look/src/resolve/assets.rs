//! Baked assets as textures: light maps above all.

use std::sync::Arc;

use fantex_base::{Error, Result};
use fantex_mesh::{ObjectSpace, TriangleBvh, lambda_step};
use fantex_store::{Asset, ChannelKind, Footprint, PageCache, Sampler};
use fantex_texture::{FilterOptions, ShadingPoint, Texture};
use glam::{Vec3, Vec4};

use super::{Node, Resolver};
use crate::data::{AssetChannel, AssetTable};
use crate::{Key, problem};

/// A channel of an asset, at the point of its surface that is nearest to the one that asks and faces the same way.
struct AssetTexture {
    sampler: Sampler,
    rays: TriangleBvh,
    channel: usize,
    /// The model's object space in the asset's mesh space.
    origin_mesh: Vec3,
    mesh_from_object: f32,
}

/// Mesh units along the normal at which the surface is looked for, so that beside a crease the right side is the nearest.
const LIFT: f32 = 1e-5;

impl Texture for AssetTexture {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let p = self.origin_mesh + at.position * self.mesh_from_object + at.normal * LIFT;
        let faces = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a).dot(at.normal) > 0.0;
        let facing = self.rays.nearest_point_where(p, f32::INFINITY, faces);
        let Some(nearest) = facing.or_else(|| self.rays.nearest_point(p, f32::INFINITY)) else {
            return Vec4::ZERO;
        };
        let corners = self.sampler.mesh().triangle_positions(nearest.point.index());
        let lambda_steps = at.position_steps.map(|step| lambda_step(corners, step * self.mesh_from_object));
        self.sampler.sample_channel(self.channel, nearest.point, Footprint { lambda_steps })
    }
}

impl Resolver<'_> {
    pub(super) fn asset(&self, table: &AssetTable, key: &Key) -> Result<Node> {
        let Some(file) = &table.asset else { return self.refuse(key, problem::missing_key("asset")) };
        let file_key = key.name("asset");
        let asset = Arc::new(self.accept(&file_key, Asset::open(&self.file.file(file)))?);
        let Some(mesh) = self.mesh else {
            return self.refuse(key, Error::malformed("an asset lies on a model, and there is none here"));
        };
        let kinds: Vec<ChannelKind> = asset.channels().iter().map(|channel| channel.kind).collect();
        let position = |kind: ChannelKind| kinds.iter().position(|&one| one == kind);
        let (wanted, channel) = match table.channel {
            Some(AssetChannel::Light) => ("light", position(ChannelKind::Light)),
            Some(AssetChannel::BaseColor) => ("base_color", position(ChannelKind::BaseColor)),
            Some(AssetChannel::Emission) => ("emission", position(ChannelKind::Emission)),
            Some(AssetChannel::Displacement) => ("displacement", position(ChannelKind::Displacement)),
            Some(AssetChannel::Orm | AssetChannel::Surface) => {
                ("orm", position(ChannelKind::OcclusionRoughnessMetallic))
            }
            None => {
                let light = position(ChannelKind::Light);
                ("light or base_color", light.or_else(|| position(ChannelKind::BaseColor)))
            }
        };
        let Some(channel) = channel else {
            let names: Vec<String> = kinds.iter().map(ToString::to_string).collect();
            let sentence = format!("the asset has no channel {wanted}; it has {}", names.join(", "));
            return self.refuse(&file_key, Error::malformed(sentence));
        };
        let of_asset = &asset.mesh().world_from_mesh;
        let (model_space, asset_space) = (ObjectSpace::of(mesh), ObjectSpace::of(asset.mesh()));
        let origin_mesh = of_asset.inverse_point(mesh.world_from_mesh.point(model_space.origin_mesh()));
        let mesh_from_object = (1.0 / of_asset.scale) as f32;
        let apart = (origin_mesh - asset_space.origin_mesh()).length() / mesh_from_object;
        if apart.is_nan() || apart > self.radius() {
            let sentence = format!(
                "the asset was baked on another model: their middles are {apart} world units apart, and this one's radius is {}",
                self.radius()
            );
            return self.refuse(&file_key, Error::malformed(sentence));
        }
        let filter = FilterOptions { filter: self.filter(table.filter), ..FilterOptions::default() };
        let cache = PageCache::new(Arc::clone(&asset), self.options.memory_bytes as usize);
        let sampler = Sampler::of_cache(&cache, filter);
        let rays = TriangleBvh::new(asset.mesh());
        Ok(Arc::new(AssetTexture { sampler, rays, channel, origin_mesh, mesh_from_object }))
    }
}
