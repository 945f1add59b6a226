//! A baked asset: fan tiles through the texture function.

use fantex_mesh::{CornerNormals, Material, OpposedTriangles};
use fantex_store::{
    ChannelKind, Footprint, PageCache, SamplePoint, Sampler, Stretch, SurfaceValues, TileSource,
};
use fantex_texture::ColorRamp;
use glam::{Vec3, Vec4};

use crate::surface::{NormalsOfHits as _, bent_steps, opacity};
use crate::{
    AnisotropySample, Coverage, FilterOptions, Finish, Hit, MaterialSample, Shaded, SmoothPoint, Surface,
};

/// A mesh with the tiles of its cover.
///
/// A channel that the asset has holds the final values: base colour, emission and the rest are taken from the tiles as
/// they are, without the material's factors or vertex colours. What has no channel comes from the factors. Whether a
/// triangle is cut out, blended, double-sided, unlit or toon-shaded is the material's business in any case.
///
/// A light channel replaces direct and ambient light of the diffuse part; highlights remain. Points with that, with a stretched
/// highlight or a toon scale have a [`Finish`], so the metallic-roughness model lights them whatever the picture asks for.
#[derive(Debug)]
pub struct FanSurface<S = PageCache> {
    sampler: Sampler<S>,
    normals: CornerNormals,
    base_color_channel: Option<usize>,
    normal_channel: Option<usize>,
    has_surface: bool,
    has_emission: bool,
    has_light: bool,
    /// Of triangles without one.
    no_material: Material,
    /// Per material.
    toon: Vec<Option<ColorRamp>>,
    opposed: OpposedTriangles,
}

impl FanSurface {
    /// The surface of an open asset.
    pub fn of_asset(cache: &PageCache, filter: FilterOptions) -> Self {
        Self::new(Sampler::of_cache(cache, filter))
    }

    /// The same for renderers. What it does is compiled with this crate, where [`of_asset`](Self::of_asset) leaves that to the crate
    /// that asks, which may be compiled without optimisation.
    pub fn boxed(cache: &PageCache, filter: FilterOptions) -> Box<dyn Surface> {
        Box::new(Self::of_asset(cache, filter))
    }
}

impl<S: TileSource> FanSurface<S> {
    /// The surface that a sampler reads.
    pub fn new(sampler: Sampler<S>) -> Self {
        let mesh = sampler.mesh();
        let channel_of = |kind| sampler.channels().iter().position(|channel| channel.kind == kind);
        Self {
            normals: CornerNormals::of(mesh),
            base_color_channel: channel_of(ChannelKind::BaseColor),
            normal_channel: channel_of(ChannelKind::Normal),
            has_surface: sampler.has(ChannelKind::OcclusionRoughnessMetallic),
            has_emission: sampler.has(ChannelKind::Emission),
            has_light: sampler.has(ChannelKind::Light),
            no_material: Material::default(),
            toon: mesh.materials.iter().map(toon_ramp).collect(),
            opposed: OpposedTriangles::of(&mesh.triangles),
            sampler,
        }
    }

    fn material(&self, triangle: usize) -> Option<&Material> {
        let mesh = self.sampler.mesh();
        mesh.materials.get(mesh.material_of(triangle))
    }

    #[inline]
    fn sample(&self, hit: &Hit, vertex_steps: [Vec3; 2], values: &SurfaceValues) -> MaterialSample {
        let material = self.material(hit.triangle()).unwrap_or(&self.no_material);
        let or_factors = |has: bool, value: Vec4, factors: Vec4| if has { value } else { factors };
        let base = or_factors(self.base_color_channel.is_some(), values.base_color, material.base_color);
        let surface = or_factors(
            self.has_surface,
            values.occlusion_roughness_metallic,
            Vec4::new(1.0, material.roughness, material.metallic, 1.0),
        );
        let share = |number: f32| number.clamp(0.0, 1.0);
        let (occlusion, roughness, metallic) = (share(surface.x), share(surface.y), share(surface.z));
        let emission = or_factors(self.has_emission, values.emission, material.emission.extend(1.0));
        let footprint = Footprint { lambda_steps: hit.lambda_steps };
        let normal_steps = self.normal_channel.and_then(|channel| {
            let at = |moved: &Hit| Some(self.sampler.sample_channel(channel, moved.at, footprint).truncate());
            bent_steps(hit, roughness, values.normal, at)
        });
        MaterialSample {
            // Bicubic filters overshoot.
            base_color: base.truncate().max(Vec3::ZERO),
            alpha: opacity(material.alpha, base.w, hit, |there| match self.base_color_channel {
                Some(channel) => self.sampler.sample_channel(channel, there, footprint).w,
                None => base.w,
            }),
            normal: if hit.front { values.normal } else { -values.normal },
            normal_steps: normal_steps.unwrap_or(vertex_steps),
            occlusion,
            roughness,
            metallic,
            emission: emission.truncate().max(Vec3::ZERO),
            mirrored: Vec3::ZERO,
            unlit: material.unlit,
            lookups: values.lookups,
        }
    }

    #[inline]
    fn finish(&self, hit: &Hit, sample: &MaterialSample, values: &SurfaceValues) -> Option<Finish<'_>> {
        let toon = self.toon(hit.triangle());
        if toon.is_none() && !self.has_light && values.stretch.is_none() {
            return None;
        }
        let anisotropy = |Stretch { direction, strength }| AnisotropySample { direction, strength };
        Some(Finish {
            light_map: self.has_light.then(|| values.light.truncate().max(Vec3::ZERO)),
            toon,
            normal_width: sample.normal_steps[0].length().max(sample.normal_steps[1].length()),
            anisotropy: values.stretch.map(anisotropy),
            ..Finish::default()
        })
    }

    fn finished(&self, hit: &Hit, normal_steps: [Vec3; 2], values: &SurfaceValues) -> Shaded<'_> {
        let sample = self.sample(hit, normal_steps, values);
        let finish = self.finish(hit, &sample, values);
        (sample, finish)
    }

    fn toon(&self, triangle: usize) -> Option<&ColorRamp> {
        self.toon.get(self.sampler.mesh().material_of(triangle))?.as_ref()
    }

    /// A hit as a sampler takes it, and the change of the normal along the pixel's edges.
    #[inline]
    fn sample_point(&self, hit: &Hit) -> (SamplePoint, [Vec3; 2]) {
        let (vertex_normal, normal_steps) = self.normals.with_steps(self.sampler.mesh(), hit);
        let footprint = Footprint { lambda_steps: hit.lambda_steps };
        (SamplePoint { point: hit.at, footprint, vertex_normal }, normal_steps)
    }
}

fn toon_ramp(material: &Material) -> Option<ColorRamp> {
    material.toon.as_ref().and_then(ColorRamp::of_toon_scale)
}

impl<S: TileSource> Surface for FanSurface<S> {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        let (point, normal_steps) = self.sample_point(hit);
        self.finished(hit, normal_steps, &self.sampler.values(&point))
    }

    fn shade_all<'s>(&'s self, hits: &[Hit], out: &mut Vec<Shaded<'s>>) {
        let point = |index: usize| {
            let Hit { at, lambda_steps, .. } = hits[index];
            (at, Footprint { lambda_steps })
        };
        let mut values = self.sampler.read_values(hits.len(), point);
        out.extend(hits.iter().map(|hit| {
            let (point, normal_steps) = self.sample_point(hit);
            self.finished(hit, normal_steps, &values.next(&point))
        }));
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        Some(self.normals.smooth_point(self.sampler.mesh(), hit))
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        self.material(triangle).map_or(Coverage::Opaque, Coverage::of)
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        self.material(triangle).is_none_or(|m| m.double_sided) && !self.opposed.contains(triangle)
    }
}
