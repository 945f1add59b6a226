//! The model's own textures, through its own texture coordinates: all material channels at once.

use fantex_mesh::{AlphaMode, Material, Mesh, shading_normals};
use fantex_store::ChannelKind;
use fantex_texture::LoadImageError;
use fantex_texture::material::{
    MaterialTextures, TangentFrame, TextureLayer, base_color, emission, load_material_textures,
    normal_map_tangents, occlusion_roughness_metallic, vertex_color,
};
use glam::{Vec2, Vec3, Vec4};

use crate::{Prefilter, Source, SourceChannel, SurfacePoint};

/// The materials of a mesh as a source.
#[derive(Debug)]
pub struct UvSource<'a> {
    mesh: &'a Mesh,
    materials: Vec<MaterialTextures>,
    tangents: Vec<Vec4>,
    normals: Vec<Vec3>,
    kinds: Vec<ChannelKind>,
    has_alpha: bool,
}

impl<'a> UvSource<'a> {
    /// Decodes the images.
    ///
    /// # Errors
    ///
    /// An image that is used cannot be read.
    pub fn new(mesh: &'a Mesh) -> Result<Self, LoadImageError> {
        let materials = load_material_textures(mesh)?;
        let has_normal_maps = materials.iter().any(|m| m.normal.is_some());
        let normals = if has_normal_maps { shading_normals(mesh) } else { Vec::new() };
        let tangents = normal_map_tangents(mesh, &normals, &materials);
        let kinds = channel_kinds(mesh, &materials);
        let has_alpha = mesh.materials.iter().any(|m| m.alpha != AlphaMode::Opaque);
        Ok(Self { mesh, materials, tangents, normals, kinds, has_alpha })
    }

    /// True where at least one material has a texture.
    pub fn has_textures(&self) -> bool {
        self.materials.iter().any(|m| m.layers().next().is_some())
    }

    /// Texels of the finest texture per mesh unit, for each triangle: what a bake needs to lose nothing. Triangles without
    /// texture, or with degenerate coordinates, take the mean of the others.
    pub fn density(&self) -> Vec<f32> {
        let mut densities: Vec<f32> =
            (0..self.mesh.triangles.len()).map(|t| self.triangle_density(t)).collect();
        let (mut sum, mut count) = (0.0, 0.0);
        for &d in densities.iter().filter(|&&d| d > 0.0) {
            sum += f64::from(d);
            count += 1.0;
        }
        let mean = if count > 0.0 { (sum / count) as f32 } else { 256.0 };
        // A sliver in the atlas can have any density; sixteen times the mean linear one is no intention.
        densities
            .iter_mut()
            .for_each(|d| *d = if *d > 0.0 { d.clamp(mean / 16.0, mean * 16.0) } else { mean });
        densities
    }

    fn triangle_density(&self, triangle: usize) -> f32 {
        let [a, b, c] = self.mesh.triangle_positions(triangle);
        let area = (b - a).cross(c - a).length();
        let texel_area = |layer: &TextureLayer| {
            let [ta, tb, tc] = layer.corner_uv(self.mesh, triangle);
            let [width, height] = layer.texture.size().map(|n| n as f32);
            ((tb - ta).perp_dot(tc - ta) * width * height).abs()
        };
        let textures = &self.materials[self.mesh.material_of(triangle)];
        let finest = textures.layers().map(texel_area).fold(0.0, f32::max);
        let density = (finest / area).sqrt();
        if density.is_finite() { density } else { 0.0 }
    }

    /// The mean of a texture over the texel's footprint; white without texture.
    fn area_mean(&self, layer: &Option<TextureLayer>, point: &SurfacePoint) -> Vec4 {
        let Some(layer) = layer else { return Vec4::ONE };
        let [a, b, c] = layer.corner_uv(self.mesh, point.triangle);
        let blend = |l: Vec3| -> Vec2 { a * l.x + b * l.y + c * l.z };
        let (uv, footprint) = (blend(point.lambda), point.lambda_steps.map(blend));
        let mean = match layer.nearest {
            true => layer.texture.sample_area_nearest(uv, footprint, layer.wrap),
            false => layer.texture.sample_area(uv, footprint, layer.wrap),
        };
        Vec4::from_array(mean)
    }

    /// The shading normal, mesh space.
    fn normal(&self, material: &Material, textures: &MaterialTextures, point: &SurfacePoint) -> Vec3 {
        if textures.normal.is_none() {
            return point.normal;
        }
        let frame =
            TangentFrame::at(&self.normals, &self.tangents, point.triangle, lambda_on_triangle(point));
        frame.bend(material, self.area_mean(&textures.normal, point)).unwrap_or(point.normal)
    }
}

/// Off the surface, what is interpolated between corners must not be extrapolated.
fn lambda_on_triangle(point: &SurfacePoint) -> Vec3 {
    point.lambda.clamp(Vec3::ZERO, Vec3::ONE)
}

impl Source for UvSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        let has_alpha = |kind| kind == ChannelKind::BaseColor && self.has_alpha;
        self.kinds.iter().map(|&kind| SourceChannel { kind, has_alpha: has_alpha(kind) }).collect()
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Box
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        let index = self.mesh.material_of(point.triangle);
        let (material, textures) = (&self.mesh.materials[index], &self.materials[index]);
        for (kind, value) in self.kinds.iter().zip(values) {
            *value = match kind {
                ChannelKind::BaseColor => {
                    let vertex_color = vertex_color(self.mesh, point.triangle, lambda_on_triangle(point));
                    base_color(material, vertex_color, self.area_mean(&textures.base_color, point))
                }
                ChannelKind::Normal => self.normal(material, textures, point).extend(0.0),
                ChannelKind::OcclusionRoughnessMetallic => occlusion_roughness_metallic(
                    material,
                    self.area_mean(&textures.occlusion, point),
                    self.area_mean(&textures.metallic_roughness, point),
                )
                .extend(1.0),
                ChannelKind::Emission => {
                    emission(material, self.area_mean(&textures.emission, point)).extend(1.0)
                }
                ChannelKind::Displacement => Vec4::ZERO,
            };
        }
    }
}

/// Base colour always; the others where a texture varies them or materials differ in them.
fn channel_kinds(mesh: &Mesh, textures: &[MaterialTextures]) -> Vec<ChannelKind> {
    let first = &mesh.materials[0];
    let any = |test: fn(&MaterialTextures) -> bool| textures.iter().any(test);
    let differs = |test: &dyn Fn(&Material) -> bool| mesh.materials.iter().any(test);
    let mut kinds = vec![ChannelKind::BaseColor];
    if any(|t| t.normal.is_some()) {
        kinds.push(ChannelKind::Normal);
    }
    let surface_differs = differs(&|m| m.roughness != first.roughness || m.metallic != first.metallic);
    if any(|t| t.metallic_roughness.is_some() || t.occlusion.is_some()) || surface_differs {
        kinds.push(ChannelKind::OcclusionRoughnessMetallic);
    }
    if any(|t| t.emission.is_some()) || differs(&|m| m.emission != first.emission) {
        kinds.push(ChannelKind::Emission);
    }
    kinds
}
