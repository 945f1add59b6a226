//! A mesh whose materials are looks: every property may be a texture.
//!
//! ```text
//!  Hit --point--> ShadingPoint --slots--> numbers --finish--> MaterialSample, Finish
//!                      |                     ^
//!                      '--relief--> normal, slope variance (widens the highlight)
//! ```

mod opacity;
mod point;
mod relief;
mod slots;

use std::sync::Arc;

use fantex_mesh::{Mesh, Twins, corner_tangents};
use fantex_texture::ShadingPoint;
use fantex_texture::look::{Anisotropy, LightingModel, LookMaterial, NormalSpace, Opacity, Relief};
use fantex_texture::material::{TangentFrame, roughness_with_variance};
use glam::{Vec3, Vec4};

use crate::normals::CornerNormals;
use crate::{AnisotropySample, Coverage, Finish, Hit, MaterialSample, SmoothPoint, Surface};
use point::SurfacePoint;
use relief::Bent;
use slots::{Column, Slots};

/// A mesh with a look material for each of its materials.
#[derive(Debug)]
pub struct LookSurface<'a> {
    mesh: &'a Mesh,
    normals: CornerNormals,
    /// Per set of texture coordinates an entry per corner; empty for sets that nothing refers to.
    tangents: Vec<Vec<Vec4>>,
    materials: Vec<Arc<LookMaterial>>,
    time: f32,
    twins: Twins,
}

impl<'a> LookSurface<'a> {
    /// Material `i` of the mesh looks like `materials[i]`, those beyond the last like the last; without any, everything looks
    /// like [`LookMaterial::default`].
    pub fn new(mesh: &'a Mesh, mut materials: Vec<Arc<LookMaterial>>) -> Self {
        if materials.is_empty() {
            materials.push(Arc::default());
        }
        let normals = CornerNormals::of_mesh(mesh);
        let tangents = (0..mesh.corners.uv_sets.len())
            .map(|set| {
                let is_asked = materials.iter().any(|m| refers_to(m, set));
                if is_asked { set_tangents(mesh, &normals, set) } else { Vec::new() }
            })
            .collect();
        Self { mesh, normals, tangents, materials, time: 0.0, twins: Twins::of(&mesh.triangles) }
    }

    /// The surface at another time of an animation, seconds.
    pub fn at_time(self, seconds: f32) -> Self {
        Self { time: seconds, ..self }
    }

    /// The material of a triangle.
    pub fn material_of(&self, triangle: usize) -> &LookMaterial {
        let last = self.materials.len() - 1;
        &self.materials[self.mesh.material_of(triangle).min(last)]
    }

    /// The frame of tangent space, in mesh space; `None` where there are no such texture coordinates.
    fn tangent_frame(&self, hit: &Hit, uv_set: usize) -> Option<TangentFrame> {
        let tangents = self.tangents.get(uv_set).filter(|t| !t.is_empty())?;
        Some(TangentFrame::at(self.normals.all(), tangents, hit.triangle, hit.lambda))
    }

    /// The normal bent by a material's relief, and what of the relief is too fine to be seen.
    fn relief(&self, material: &LookMaterial, hit: &Hit, at: &ShadingPoint, vertex_normal: Vec3) -> Bent {
        let mut bent = Bent { normal: vertex_normal, slope_variance: 0.0 };
        let shows_highlights = material.lighting != LightingModel::Unlit;
        for relief in &material.relief {
            let next = match relief {
                Relief::Bump { texture, height, difference } => {
                    let bump = relief::Bump {
                        texture: &**texture,
                        height: *height,
                        difference: *difference,
                        least_step: relief::LEAST_STEP * self.mesh.world_from_mesh.scale as f32,
                    };
                    bump.bend(bent.normal, at, shows_highlights)
                }
                Relief::Derivatives { texture, uv_set, height, range } => {
                    let map =
                        relief::DerivativeMap { texture: &**texture, uv_set: *uv_set, scale: height * range };
                    map.bend(bent.normal, at, shows_highlights)
                }
                Relief::Normal { texture, scale, space } => {
                    let texel = texture.evaluate(at).truncate() * 2.0 - 1.0;
                    let frame = match space {
                        NormalSpace::Object => None,
                        NormalSpace::Tangent { uv_set } => match self.tangent_frame(hit, *uv_set) {
                            Some(frame) => Some(frame),
                            None => continue,
                        },
                    };
                    relief::bend_by_normal(bent.normal, vertex_normal, texel, *scale, frame.as_ref())
                }
            };
            bent = Bent { normal: next.normal, slope_variance: bent.slope_variance + next.slope_variance };
        }
        bent
    }

    /// The material at a hit, from the values of its slots there.
    fn shaded<'s>(
        &self,
        material: &'s LookMaterial,
        hit: &Hit,
        at: &ShadingPoint<'_>,
        slots: &Slots<Vec4>,
    ) -> (MaterialSample, Option<Finish<'s>>) {
        let side = if hit.front { 1.0 } else { -1.0 };
        // Relief rises from the front, so that a sheet seen from behind shows its dents as bumps.
        let bent = self.relief(material, hit, at, at.normal * side);
        let normal = bent.normal * side;
        let base = slots.base_color;
        let color = |value: Vec4| value.truncate().max(Vec3::ZERO);
        let mut sample = MaterialSample {
            base_color: color(base),
            alpha: opacity::alpha(material, at, base.w),
            normal,
            normal_steps: at.normal_steps,
            occlusion: slots.occlusion.x.clamp(0.0, 1.0),
            roughness: slots.roughness.x.clamp(0.0, 1.0),
            metallic: slots.metallic.x.clamp(0.0, 1.0),
            emission: color(slots.emission),
            unlit: false,
            lookups: material.textures().count() as u32,
        };
        let mut finish = Finish {
            lighting: material.lighting,
            color_use: material.color_use,
            ambient: color(slots.ambient),
            specular: color(slots.specular),
            shininess: slots.shininess.map(|exponent| exponent.x.max(0.0)),
            reflection: color(slots.reflection),
            light_map: slots.light_map.map(color),
            modulate: slots.modulate.map_or(Vec3::ONE, color),
            toon: material.toon.as_deref(),
            normal_width: at.normal_steps[0].length().max(at.normal_steps[1].length()),
            anisotropy: None,
        };
        if let Some(anisotropy) = &material.anisotropy {
            finish.anisotropy = self.anisotropy(anisotropy, hit, at, normal);
        }
        if bent.slope_variance > 0.0 {
            widen(&mut sample, &mut finish, bent.slope_variance);
        }
        (sample, Some(finish))
    }

    fn anisotropy(
        &self,
        anisotropy: &Anisotropy,
        hit: &Hit,
        at: &ShadingPoint,
        normal: Vec3,
    ) -> Option<AnisotropySample> {
        let encoded = anisotropy.direction.evaluate(at);
        let [along, across] = [encoded.x * 2.0 - 1.0, encoded.y * 2.0 - 1.0];
        let direction = match self.tangent_frame(hit, anisotropy.uv_set) {
            Some(frame) => frame.mesh_vector(Vec3::new(along, across, 0.0)),
            None => {
                // Around the upright axis, as on a lathe: smooth but for the poles.
                let tangent = Vec3::Y.cross(normal).try_normalize().unwrap_or(Vec3::X);
                tangent * along + normal.cross(tangent) * across
            }
        };
        let direction = (direction - normal * normal.dot(direction)).try_normalize()?;
        let strength = anisotropy.strength.evaluate_number(at).clamp(-1.0, 1.0);
        Some(AnisotropySample { direction, strength })
    }
}

/// Whether a material needs the tangents of a set of texture coordinates.
fn refers_to(material: &LookMaterial, set: usize) -> bool {
    let by_relief = material.relief.iter().any(|relief| {
        matches!(relief, Relief::Normal { space: NormalSpace::Tangent { uv_set }, .. } if *uv_set == set)
    });
    by_relief || material.anisotropy.as_ref().is_some_and(|a| a.uv_set == set)
}

/// The mesh's own tangents belong to its first set.
fn set_tangents(mesh: &Mesh, normals: &CornerNormals, set: usize) -> Vec<Vec4> {
    let corners = 3 * mesh.triangles.len();
    let uv = &mesh.corners.uv_sets[set];
    if uv.len() != corners {
        return Vec::new();
    }
    if set == 0 && mesh.corners.tangents.len() == corners {
        return mesh.corners.tangents.clone();
    }
    corner_tangents(mesh, normals.all(), |t| Some([uv[3 * t], uv[3 * t + 1], uv[3 * t + 2]]))
}

impl Surface for LookSurface<'_> {
    fn shade_inputs(&self, hit: &Hit) -> MaterialSample {
        self.shade(hit).0
    }

    fn shade(&self, hit: &Hit) -> (MaterialSample, Option<Finish<'_>>) {
        let material = self.material_of(hit.triangle);
        let own = SurfacePoint::new(self.mesh, &self.normals, hit, self.time);
        let at = own.shading_point();
        self.shaded(material, hit, &at, &Slots::new(material, |slot| slot.evaluate(&at)))
    }

    fn shade_all<'s>(&'s self, hits: &[Hit], out: &mut Vec<(MaterialSample, Option<Finish<'s>>)>) {
        let material_of = |hit: &Hit| self.material_of(hit.triangle);
        for hits in hits.chunk_by(|a, b| std::ptr::eq(material_of(a), material_of(b))) {
            let material = material_of(&hits[0]);
            let own = |hit: &Hit| SurfacePoint::new(self.mesh, &self.normals, hit, self.time);
            let own: Vec<SurfacePoint> = hits.iter().map(own).collect();
            let at: Vec<ShadingPoint<'_>> = own.iter().map(SurfacePoint::shading_point).collect();
            let slots = Slots::new(material, |slot| Column::new(slot, &at));
            let shaded = hits.iter().zip(&at).enumerate();
            out.extend(shaded.map(|(index, (hit, at))| self.shaded(material, hit, at, &slots.at(index))));
        }
    }

    fn alpha(&self, hit: &Hit) -> f32 {
        let material = self.material_of(hit.triangle);
        let own = SurfacePoint::new(self.mesh, &self.normals, hit, self.time);
        let at = own.shading_point();
        opacity::alpha(material, &at, material.base_color.evaluate(&at).w)
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        Some(self.normals.smooth_point(self.mesh, hit))
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        match self.material_of(triangle).opacity {
            Opacity::Opaque => Coverage::Opaque,
            Opacity::Mask { .. } | Opacity::Blend => Coverage::Layered,
        }
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        self.material_of(triangle).double_sided && !self.twins.contains(triangle)
    }
}

/// Turns relief that is too fine for the picture into roughness: slopes of variance `v` along each axis widen a lobe of slope
/// `alpha` to `sqrt(alpha^2 + 2 v)` (M. Toksvig, "Mipmapping Normal Maps", 2005). Highlights keep their energy.
fn widen(sample: &mut MaterialSample, finish: &mut Finish, slope_variance: f32) {
    sample.roughness = roughness_with_variance(sample.roughness, slope_variance);
    if let Some(exponent) = finish.shininess {
        let widened = exponent / (1.0 + exponent * slope_variance);
        finish.shininess = Some(widened);
        finish.specular *= (widened + 2.0) / (exponent + 2.0);
    }
}
