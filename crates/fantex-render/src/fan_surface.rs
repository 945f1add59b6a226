//! A baked asset: fan tiles through the texture function.

use fantex_cover::{Cover, Group};
use fantex_mesh::{Material, Mesh};
use fantex_store::{Channel, ChannelKind, PageCache};
use glam::{Vec3, Vec4};

use crate::normals::CornerNormals;
use crate::surface::apply_alpha_mode;
use crate::tile_filter::TileLookup;
use crate::tiles::TileSource;
use crate::{Coverage, FilterOptions, Hit, MaterialSample, Surface};

/// A mesh with the tiles of its cover.
///
/// A channel that the asset has holds the final values: base colour, emission and the rest are taken from the tiles as
/// they are, without the material's factors or vertex colours. What has no channel comes from the factors. Whether a
/// triangle is cut out, blended, double-sided or unlit is the material's business in any case.
#[derive(Debug)]
pub struct FanSurface<'a, S> {
    mesh: &'a Mesh,
    cover: &'a Cover,
    tiles: S,
    filter: FilterOptions,
    normals: CornerNormals,
    base_color: Option<usize>,
    normal: Option<usize>,
    occlusion_roughness_metallic: Option<usize>,
    emission: Option<usize>,
}

impl<'a> FanSurface<'a, &'a PageCache> {
    /// The surface of an open asset.
    pub fn of_asset(cache: &'a PageCache, filter: FilterOptions) -> Self {
        let asset = cache.asset();
        Self::new(asset.mesh(), asset.cover(), asset.channels(), cache, filter)
    }
}

impl<'a, S: TileSource> FanSurface<'a, S> {
    /// The surface of a mesh with a cover whose tiles have these channels.
    pub fn new(
        mesh: &'a Mesh,
        cover: &'a Cover,
        channels: &[Channel],
        tiles: S,
        filter: FilterOptions,
    ) -> Self {
        let channel_of = |kind| channels.iter().position(|c| c.kind == kind);
        Self {
            mesh,
            cover,
            tiles,
            filter,
            normals: CornerNormals::of_mesh(mesh),
            base_color: channel_of(ChannelKind::BaseColor),
            normal: channel_of(ChannelKind::Normal),
            occlusion_roughness_metallic: channel_of(ChannelKind::OcclusionRoughnessMetallic),
            emission: channel_of(ChannelKind::Emission),
        }
    }

    fn material(&self, triangle: usize) -> Option<&Material> {
        self.mesh.materials.get(self.mesh.material_of(triangle))
    }

    /// The look-ups of the texture function at a hit, at most one per corner, with their weights.
    fn lookups(&self, hit: &Hit) -> impl Iterator<Item = (TileLookup, &Group, f32)> {
        let (triangle, cover) = (hit.triangle, self.cover);
        let weights = cover.weights(triangle, hit.lambda);
        let planned = [0, 1, 2].map(|slot| {
            let weight = weights.iter().find(|(s, _)| *s == slot)?.1;
            let group_index = cover.corner_groups[triangle][slot];
            let group = &cover.groups[group_index as usize];
            let corners = cover.tile_corners(self.mesh, triangle, slot);
            let (uv, footprint) = hit.blend_coordinates(corners);
            Some((TileLookup::new(group_index, group, uv, footprint, &self.filter), group, weight))
        });
        planned.into_iter().flatten()
    }

    /// The values of all channels, blended from the tiles.
    fn blend(&self, hit: &Hit, vertex_normal: Vec3) -> Blended {
        let mut sum = Blended::default();
        for (lookup, group, weight) in self.lookups(hit) {
            let mut read = |channel: Option<usize>| {
                let channel = channel?;
                sum.lookups += 1;
                Some(lookup.sample(&self.tiles, channel))
            };
            let base_color = read(self.base_color);
            let material = read(self.occlusion_roughness_metallic);
            let emission = read(self.emission);
            let normal = read(self.normal);
            add(&mut sum.base_color, base_color, weight);
            add(&mut sum.occlusion_roughness_metallic, material, weight);
            add(&mut sum.emission, emission, weight);
            if let Some(stored) = normal {
                sum.normal += mesh_normal(stored, group, vertex_normal) * weight;
            }
        }
        sum
    }
}

/// The texture function's values at a point; zero where there is no channel.
#[derive(Clone, Copy, Debug, Default)]
struct Blended {
    base_color: Vec4,
    occlusion_roughness_metallic: Vec4,
    emission: Vec4,
    /// Mesh space, not normalised.
    normal: Vec3,
    lookups: u32,
}

fn add(sum: &mut Vec4, value: Option<Vec4>, weight: f32) {
    *sum += value.unwrap_or(Vec4::ZERO) * weight;
}

/// Turns a stored normal (see [`ChannelKind::Normal`]) from its tile's shading frame into mesh space.
fn mesh_normal(stored: Vec4, group: &Group, vertex_normal: Vec3) -> Vec3 {
    let [x, y] = [stored.x, stored.y].map(|c| c * 2.0 - 1.0);
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    let [x_axis, y_axis] = group.shading_axes(vertex_normal);
    (x_axis * x + y_axis * y + vertex_normal * z).normalize_or(vertex_normal)
}

impl<S: TileSource> Surface for FanSurface<'_, S> {
    fn shade_inputs(&self, hit: &Hit) -> MaterialSample {
        let default_material;
        let material = match self.material(hit.triangle) {
            Some(material) => material,
            None => {
                default_material = Material::default();
                &default_material
            }
        };
        let vertex_normal = self.normals.at(self.mesh, hit);
        let blended = self.blend(hit, vertex_normal);
        let or_factors = |channel: Option<usize>, value: Vec4, factors: Vec4| {
            if channel.is_some() { value } else { factors }
        };
        let base = or_factors(self.base_color, blended.base_color, material.base_color);
        let [occlusion, roughness, metallic, _] = or_factors(
            self.occlusion_roughness_metallic,
            blended.occlusion_roughness_metallic,
            Vec4::new(1.0, material.roughness, material.metallic, 1.0),
        )
        .to_array()
        .map(|v| v.clamp(0.0, 1.0));
        let emission = or_factors(self.emission, blended.emission, material.emission.extend(1.0));
        let normal = blended.normal.try_normalize().unwrap_or(vertex_normal);
        MaterialSample {
            // Bicubic filters overshoot.
            base_color: base.truncate().max(Vec3::ZERO),
            alpha: apply_alpha_mode(material.alpha, base.w),
            normal: if hit.front { normal } else { -normal },
            normal_steps: self.normals.steps(hit),
            occlusion,
            roughness,
            metallic,
            emission: emission.truncate().max(Vec3::ZERO),
            unlit: material.unlit,
            lookups: blended.lookups,
        }
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        self.material(triangle).map_or(Coverage::Opaque, Coverage::of)
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        self.material(triangle).is_none_or(|m| m.double_sided)
    }
}
