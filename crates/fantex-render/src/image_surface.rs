//! A model's own materials: every property is a factor times one look-up in an image. They are evaluated a layer at a time, for many
//! points at once.

use fantex_base::Result;
use fantex_mesh::{CornerNormals, Material, Mesh, OpposedTriangles, SurfacePoint};
use fantex_texture::material::{
    ImageSlots, LeftOut, MaterialTextures, TangentFrame, TextureLayer, base_color, emission,
    load_material_textures, normal_map_tangents, occlusion_roughness_metallic, preserve_coverage,
    vertex_color,
};
use fantex_texture::{Filter, SampleOptions, UvPoint};
use glam::{Mat2, Vec2, Vec3, Vec4};

use crate::surface::{NormalsOfHits as _, bent_steps, opacity};
use crate::{Coverage, FilterOptions, Hit, MaterialSample, Shaded, SmoothPoint, Surface};

/// A mesh with its own materials. Textures whose texture coordinates the mesh lacks are left out.
#[derive(Debug)]
pub(crate) struct ImageSurface<'a> {
    mesh: &'a Mesh,
    normals: CornerNormals,
    tangents: Vec<Vec4>,
    textures: Vec<MaterialTextures>,
    filter: FilterOptions,
    opposed: OpposedTriangles,
    left_out: LeftOut,
}

impl<'a> ImageSurface<'a> {
    /// Decodes the images that the materials use and prepares normals and tangents.
    ///
    /// # Errors
    /// An image takes more memory than there is, or a disk fails.
    pub(crate) fn load(mesh: &'a Mesh, filter: FilterOptions) -> Result<Self> {
        let (mut textures, left_out) = load_material_textures(mesh)?;
        preserve_coverage(&mesh.materials, &mut textures);
        let normals = CornerNormals::of(mesh);
        let tangents = normal_map_tangents(mesh, &normals, &textures);
        let opposed = OpposedTriangles::of(&mesh.triangles);
        Ok(Self { mesh, normals, tangents, textures, filter, opposed, left_out })
    }

    /// Images of the model that could not be read.
    pub(crate) fn left_out(&self) -> &LeftOut {
        &self.left_out
    }

    fn material(&self, triangle: usize) -> Option<(&Material, &MaterialTextures)> {
        let index = self.mesh.material_of(triangle);
        Some((self.mesh.materials.get(index)?, &self.textures[index]))
    }

    fn texel(&self, layer: &TextureLayer, hit: &Hit) -> Vec4 {
        let (uv, footprint) = hit.interpolate(layer.corner_uv(self.mesh, hit.triangle()));
        let size = layer.texture.size().map(|n| n as f32);
        let texels = Mat2::from_diagonal(Vec2::from(size));
        let magnified = footprint.iter().all(|d| (texels * *d).length_squared() <= 1.0);
        let own = self.options(layer);
        let filter = if layer.nearest && magnified { Filter::Nearest } else { own.filter };
        Vec4::from_array(layer.texture.sample(uv, footprint, &SampleOptions { filter, ..own }))
    }

    /// [`ImageSurface::texel`] at many points.
    fn texels(&self, layer: &TextureLayer, hits: &[Hit]) -> Vec<[f32; 4]> {
        if layer.nearest {
            return hits.iter().map(|hit| self.texel(layer, hit).to_array()).collect();
        }
        let point = |hit: &Hit| {
            let (uv, steps) = hit.interpolate(layer.corner_uv(self.mesh, hit.triangle()));
            UvPoint { uv, steps }
        };
        let points: Vec<UvPoint> = hits.iter().map(point).collect();
        let mut texels = vec![[0.0; 4]; hits.len()];
        layer.texture.sample_all(&points, &self.options(layer), &mut texels);
        texels
    }

    fn options(&self, layer: &TextureLayer) -> SampleOptions {
        let FilterOptions { filter, max_anisotropy } = self.filter;
        SampleOptions { wrap: layer.wrap, filter, max_anisotropy }
    }
}

type Texels = ImageSlots<Option<Vec4>>;

impl ImageSurface<'_> {
    /// The unit normal that a normal map's texel gives the front side.
    fn bent_normal(&self, material: &Material, texel: Vec4, hit: &Hit) -> Option<Vec3> {
        let frame = TangentFrame::at(&self.normals, &self.tangents, hit.triangle(), hit.at.lambda);
        frame.bend(material, texel)
    }
}

impl ImageSurface<'_> {
    fn sample(
        &self,
        hit: &Hit,
        material: &Material,
        textures: &MaterialTextures,
        texels: &Texels,
    ) -> MaterialSample {
        let (vertex_normal, vertex_steps) = self.normals.with_steps(self.mesh, hit);
        let color_at = |at: SurfacePoint| vertex_color(self.mesh, at.index(), at.lambda);
        let or_white = |texel: Option<Vec4>| texel.unwrap_or(Vec4::ONE);
        let base = base_color(material, color_at(hit.at), or_white(texels.base_color));
        let surface = occlusion_roughness_metallic(
            material,
            or_white(texels.occlusion),
            or_white(texels.metallic_roughness),
        );
        let bent = texels.normal.and_then(|texel| self.bent_normal(material, texel, hit));
        let normal = bent.unwrap_or(vertex_normal);
        let normal_steps = match &textures.normal {
            Some(layer) => bent_steps(hit, surface.y, normal, |moved| {
                self.bent_normal(material, self.texel(layer, moved), moved)
            }),
            None => None,
        }
        .unwrap_or(vertex_steps);
        MaterialSample {
            // Bicubic filters overshoot.
            base_color: base.truncate().max(Vec3::ZERO),
            alpha: opacity(material.alpha, base.w, hit, |there| {
                let texel =
                    textures.base_color.as_ref().map(|layer| self.texel(layer, &Hit { at: there, ..*hit }));
                base_color(material, color_at(there), or_white(texel)).w
            }),
            normal: if hit.front { normal } else { -normal },
            normal_steps,
            occlusion: surface.x,
            roughness: surface.y,
            metallic: surface.z,
            emission: emission(material, or_white(texels.emission)).max(Vec3::ZERO),
            mirrored: Vec3::ZERO,
            unlit: material.unlit,
            lookups: textures.layers().count() as u32,
        }
    }

    fn without_material(&self, hit: &Hit) -> MaterialSample {
        let (vertex_normal, normal_steps) = self.normals.with_steps(self.mesh, hit);
        let normal = if hit.front { vertex_normal } else { -vertex_normal };
        MaterialSample { normal_steps, ..MaterialSample::with_normal(normal) }
    }
}

impl Surface for ImageSurface<'_> {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        let Some((material, textures)) = self.material(hit.triangle()) else {
            return (self.without_material(hit), None);
        };
        let texels = textures.each_ref().map(|layer| Some(self.texel(layer.as_ref()?, hit)));
        (self.sample(hit, material, textures, &texels), None)
    }

    fn shade_all<'s>(&'s self, hits: &[Hit], out: &mut Vec<Shaded<'s>>) {
        let is_one_material =
            |a: &Hit, b: &Hit| self.mesh.material_of(a.triangle()) == self.mesh.material_of(b.triangle());
        for run in hits.chunk_by(is_one_material) {
            let Some((material, textures)) = self.material(run[0].triangle()) else {
                out.extend(run.iter().map(|hit| (self.without_material(hit), None)));
                continue;
            };
            let texels = textures.each_ref().map(|layer| Some(self.texels(layer.as_ref()?, run)));
            for (index, hit) in run.iter().enumerate() {
                let own = texels.each_ref().map(|texels| Some(Vec4::from_array(texels.as_ref()?[index])));
                out.push((self.sample(hit, material, textures, &own), None));
            }
        }
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        Some(self.normals.smooth_point(self.mesh, hit))
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        self.material(triangle).map_or(Coverage::Opaque, |(material, _)| Coverage::of(material))
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        let is_double_sided = self.material(triangle).is_none_or(|(material, _)| material.double_sided);
        is_double_sided && !self.opposed.contains(triangle)
    }
}
