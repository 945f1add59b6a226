//! A baked asset: fan tiles through the texture function.

mod batch;

use fantex_cover::{Cover, Group};
use fantex_mesh::{Material, Mesh, Twins};
use fantex_store::{Channel, ChannelKind, PageCache};
use fantex_texture::ColorRamp;
use glam::{Vec2, Vec3, Vec4};

use crate::surface::CornerNormals;
use crate::surface::apply_alpha_mode;
use crate::tile_filter::TileLookup;
use crate::tiles::TileSource;
use crate::{AnisotropySample, Coverage, FilterOptions, Finish, Hit, MaterialSample, SmoothPoint, Surface};

/// A mesh with the tiles of its cover.
///
/// A channel that the asset has holds the final values: base colour, emission and the rest are taken from the tiles as
/// they are, without the material's factors or vertex colours. What has no channel comes from the factors. Whether a
/// triangle is cut out, blended, double-sided, unlit or toon-shaded is the material's business in any case.
///
/// A light channel replaces direct and ambient light of the diffuse part; highlights remain. Points with that, with a stretched
/// highlight or a toon scale have a [`Finish`], so the metallic-roughness model lights them whatever the picture asks for.
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
    light: Option<usize>,
    anisotropy: Option<usize>,
    /// Per material.
    toon: Vec<Option<ColorRamp>>,
    twins: Twins,
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
            light: channel_of(ChannelKind::Light),
            anisotropy: channel_of(ChannelKind::Anisotropy),
            toon: mesh.materials.iter().map(toon_ramp).collect(),
            twins: Twins::of(&mesh.triangles),
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
            let light = read(self.light);
            let anisotropy = read(self.anisotropy);
            add(&mut sum.base_color, base_color, weight);
            add(&mut sum.occlusion_roughness_metallic, material, weight);
            add(&mut sum.emission, emission, weight);
            add(&mut sum.light, light, weight);
            if let Some(stored) = normal {
                sum.normal += mesh_normal(stored, group, vertex_normal) * weight;
            }
            if let Some(stored) = anisotropy {
                sum.stretch += mesh_stretch(stored, group, vertex_normal) * weight;
            }
        }
        sum
    }

    /// The material at a point, of its values.
    fn sample(
        &self,
        hit: &Hit,
        (vertex_normal, normal_steps): (Vec3, [Vec3; 2]),
        blended: &Blended,
    ) -> MaterialSample {
        let default_material;
        let material = match self.material(hit.triangle) {
            Some(material) => material,
            None => {
                default_material = Material::default();
                &default_material
            }
        };
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
            normal_steps,
            occlusion,
            roughness,
            metallic,
            emission: emission.truncate().max(Vec3::ZERO),
            unlit: material.unlit,
            lookups: blended.lookups,
        }
    }

    /// What a point has beside its material.
    fn finish(
        &self,
        hit: &Hit,
        vertex_normal: Vec3,
        sample: &MaterialSample,
        blended: &Blended,
    ) -> Option<Finish<'_>> {
        let toon = self.toon(hit.triangle);
        if toon.is_none() && self.light.is_none() && self.anisotropy.is_none() {
            return None;
        }
        Some(Finish {
            light_map: self.light.map(|_| blended.light.truncate().max(Vec3::ZERO)),
            toon,
            normal_width: sample.normal_steps[0].length().max(sample.normal_steps[1].length()),
            anisotropy: self.anisotropy.map(|_| anisotropy_sample(blended.stretch, vertex_normal)),
            ..Finish::default()
        })
    }

    fn finished(
        &self,
        hit: &Hit,
        normals: (Vec3, [Vec3; 2]),
        blended: &Blended,
    ) -> (MaterialSample, Option<Finish<'_>>) {
        let sample = self.sample(hit, normals, blended);
        let finish = self.finish(hit, normals.0, &sample, blended);
        (sample, finish)
    }

    /// The scale of a triangle's material, if that is toon-shaded.
    fn toon(&self, triangle: usize) -> Option<&ColorRamp> {
        self.toon.get(self.mesh.material_of(triangle))?.as_ref()
    }
}

fn toon_ramp(material: &Material) -> Option<ColorRamp> {
    material.toon.as_ref().and_then(ColorRamp::of_toon_scale)
}

/// The texture function's values at a point; zero where there is no channel.
#[derive(Clone, Copy, Debug, Default)]
struct Blended {
    base_color: Vec4,
    occlusion_roughness_metallic: Vec4,
    emission: Vec4,
    /// Mesh space, not normalised.
    normal: Vec3,
    light: Vec4,
    /// As stored (-1..1), relative to [`stretch_axes`].
    stretch: Vec2,
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

/// Axes in the surface that all tiles' stretches (see [`ChannelKind::Anisotropy`]) are turned to before they are blended; which
/// ones makes no difference.
fn stretch_axes(vertex_normal: Vec3) -> [Vec3; 2] {
    let x = vertex_normal.any_orthonormal_vector();
    [x, vertex_normal.cross(x)]
}

/// Turns a stored stretch from its tile's shading frame to [`stretch_axes`].
fn mesh_stretch(stored: Vec4, group: &Group, vertex_normal: Vec3) -> Vec2 {
    let [x_axis, _] = group.shading_axes(vertex_normal);
    let axis = Vec2::from(stretch_axes(vertex_normal).map(|axis| axis.dot(x_axis)));
    // Angles are doubled, so that between the frames is, too.
    (Vec2::new(stored.x, stored.y) * 2.0 - 1.0).rotate(axis.rotate(axis))
}

/// A blended stretch as shading takes it.
fn anisotropy_sample(stretch: Vec2, vertex_normal: Vec3) -> AnisotropySample {
    let [x, y] = stretch_axes(vertex_normal);
    let (sine, cosine) = (0.5 * stretch.to_angle()).sin_cos();
    AnisotropySample { direction: x * cosine + y * sine, strength: stretch.length().min(1.0) }
}

/// Fewer points than this are shaded one by one.
const FEW: usize = 4;

impl<S: TileSource> Surface for FanSurface<'_, S> {
    fn shade_inputs(&self, hit: &Hit) -> MaterialSample {
        let normals = self.normals.with_steps(self.mesh, hit);
        self.sample(hit, normals, &self.blend(hit, normals.0))
    }

    fn shade(&self, hit: &Hit) -> (MaterialSample, Option<Finish<'_>>) {
        let normals = self.normals.with_steps(self.mesh, hit);
        self.finished(hit, normals, &self.blend(hit, normals.0))
    }

    fn shade_all<'s>(&'s self, hits: &[Hit], out: &mut Vec<(MaterialSample, Option<Finish<'s>>)>) {
        if hits.len() < FEW || !TileLookup::has_taps(self.filter.filter) {
            out.extend(hits.iter().map(|hit| self.shade(hit)));
            return;
        }
        let normals: Vec<_> = hits.iter().map(|hit| self.normals.with_steps(self.mesh, hit)).collect();
        let blended = self.blend_all(hits, |index| normals[index].0);
        let points = hits.iter().zip(normals).zip(&blended);
        out.extend(points.map(|((hit, normals), blended)| self.finished(hit, normals, blended)));
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        Some(self.normals.smooth_point(self.mesh, hit))
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        self.material(triangle).map_or(Coverage::Opaque, Coverage::of)
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        self.material(triangle).is_none_or(|m| m.double_sided) && !self.twins.contains(triangle)
    }
}
