//! Materials whose properties are textures: what does not depend on the eye, as tiles.

mod answers;
mod point;
mod relief;

use std::sync::Arc;

use fantex_mesh::{AlphaMode, Material, Mesh, corner_tangents, shading_normals};
use fantex_store::ChannelKind;
use fantex_texture::look::{Anisotropy, LightingModel, LookMaterial, NormalSpace, Opacity, Relief, Slot};
use fantex_texture::material::TangentFrame;
use fantex_texture::{ShadingPoint, Texture};
use glam::{Vec2, Vec3, Vec4};

use crate::{Prefilter, Source, SourceChannel, SurfacePoint, TriangleFootprint, TriangleSource};
use answers::{Answers, Ask, ask_at};
use point::PointFinder;

/// Why a look cannot be baked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LookSourceError {
    /// A texture depends on the eye.
    #[error(
        "{what} depends on the eye (a reflection, or the angle of view), and a bake has no eye; leave it out, or render instead"
    )]
    ViewDependent {
        /// The property of the material.
        what: &'static str,
    },
}

/// The materials of a look as a source: base colour with alpha, the normal with all relief applied, occlusion with roughness
/// and metallic, emission, the direction of stretched highlights. A property that is the same everywhere is no channel but a factor of [`baked_materials`].
#[derive(Debug)]
pub struct LookSource<'a> {
    materials: Vec<Arc<LookMaterial>>,
    finder: PointFinder<'a>,
    /// Per set of texture coordinates an entry per corner; empty for sets that nothing refers to.
    tangents: Vec<Vec<Vec4>>,
    channels: Vec<SourceChannel>,
}

impl<'a> LookSource<'a> {
    /// Material `i` of the mesh looks like `materials[i]`, those beyond the last like the last; without any, everything looks
    /// like the default. `time` is in seconds.
    ///
    /// # Errors
    ///
    /// A texture depends on the eye.
    pub fn new(
        mesh: &'a Mesh,
        mut materials: Vec<Arc<LookMaterial>>,
        time: f32,
    ) -> Result<Self, LookSourceError> {
        if materials.is_empty() {
            materials.push(Arc::default());
        }
        materials.iter().try_for_each(|m| check_eye(m))?;
        let channels = channels(&materials);
        let normals = shading_normals(mesh);
        let sets = 0..mesh.corners.uv_sets.len();
        let tangents = sets
            .map(|set| {
                let is_asked = materials.iter().any(|m| refers_to_tangents(m, set));
                if is_asked { set_tangents(mesh, &normals, set) } else { Vec::new() }
            })
            .collect();
        Ok(Self { materials, finder: PointFinder { mesh, normals, time }, tangents, channels })
    }

    /// A single texture as base colour, opaque.
    ///
    /// # Errors
    ///
    /// It depends on the eye.
    pub fn of_texture(mesh: &'a Mesh, texture: Arc<dyn Texture>, time: f32) -> Result<Self, LookSourceError> {
        let material = LookMaterial { base_color: Slot::Texture(texture), ..LookMaterial::default() };
        Self::new(mesh, vec![Arc::new(material)], time)
    }

    fn material_of(&self, triangle: usize) -> &LookMaterial {
        let last = self.materials.len() - 1;
        &self.materials[self.finder.mesh.material_of(triangle).min(last)]
    }

    /// The direction of a stretched highlight, mesh space, and its strength; the direction need not lie in the surface.
    fn direction(&self, anisotropy: &Anisotropy, point: &SurfacePoint, ask: &Ask<'_>) -> Vec4 {
        let [along, across, ..] = (value_of(&anisotropy.direction, ask) * 2.0 - 1.0).to_array();
        let tangents = self.tangents.get(anisotropy.uv_set).filter(|tangents| !tangents.is_empty());
        let direction = match tangents {
            Some(tangents) => {
                let lambda = point.lambda.clamp(Vec3::ZERO, Vec3::ONE);
                let frame = TangentFrame::at(&self.finder.normals, tangents, point.triangle, lambda);
                frame.mesh_vector(Vec3::new(along, across, 0.0))
            }
            None => {
                let tangent = Vec3::Y.cross(point.normal).try_normalize().unwrap_or(Vec3::X);
                tangent * along + point.normal.cross(tangent) * across
            }
        };
        direction.extend(value_of(&anisotropy.strength, ask).x.clamp(-1.0, 1.0))
    }
}

impl Source for LookSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        self.channels.clone()
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Box
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        let material = self.material_of(point.triangle);
        self.finder.at(point, |at| {
            let ask = |texture: &dyn Texture, offset: Vec2| ask_at(at, texture, offset);
            self.values(material, point, at, &ask, values);
        });
    }

    fn on_triangle(&self, on: &TriangleFootprint) -> TriangleSource<'_> {
        let material = self.material_of(on.triangle);
        let channels = self.channels.len();
        Box::new(move |points, values| {
            self.finder.at_all(points, |at| {
                let answers = Answers::new(at);
                let of_points = points.iter().zip(at).zip(values.chunks_mut(channels));
                for (index, ((point, at), values)) in of_points.enumerate() {
                    let ask = |texture: &dyn Texture, offset: Vec2| answers.ask(index, texture, offset);
                    self.values(material, point, at, &ask, values);
                }
            });
        })
    }
}

impl LookSource<'_> {
    /// Writes one value per channel. `ask` answers for the point.
    fn values(
        &self,
        material: &LookMaterial,
        point: &SurfacePoint,
        at: &ShadingPoint<'_>,
        ask: &Ask<'_>,
        values: &mut [Vec4],
    ) {
        let value = |slot: &Slot| value_of(slot, ask);
        let number = |slot: &Slot| value(slot).x.clamp(0.0, 1.0);
        let color = |value: Vec4| value.truncate().max(Vec3::ZERO);
        for (channel, out) in self.channels.iter().zip(values) {
            *out = match channel.kind {
                ChannelKind::BaseColor => {
                    let base = value(&material.base_color);
                    color(base).extend(base.w * value(&material.alpha).x)
                }
                ChannelKind::Normal => {
                    let reliefs = relief::Reliefs {
                        relief: &material.relief,
                        tangents: &self.tangents,
                        normals: &self.finder.normals,
                        least_step: relief::LEAST_STEP * self.finder.mesh.world_from_mesh.scale as f32,
                    };
                    reliefs.bend(point, at, ask).extend(0.0)
                }
                ChannelKind::OcclusionRoughnessMetallic => {
                    let roughness = match &material.shininess {
                        Some(exponent) => roughness_of(value(exponent).x),
                        None => number(&material.roughness),
                    };
                    Vec4::new(number(&material.occlusion), roughness, number(&material.metallic), 1.0)
                }
                ChannelKind::Emission => color(value(&material.emission)).extend(1.0),
                ChannelKind::Anisotropy => {
                    let anisotropy = material.anisotropy.as_ref();
                    anisotropy.map_or(Vec4::ZERO, |anisotropy| self.direction(anisotropy, point, ask))
                }
                ChannelKind::Displacement | ChannelKind::Light => Vec4::ZERO,
            };
        }
    }
}

fn value_of(slot: &Slot, ask: &Ask<'_>) -> Vec4 {
    match slot {
        Slot::Constant(value) => *value,
        Slot::Texture(texture) => ask(&**texture, Vec2::ZERO),
    }
}

/// The perceptual roughness whose highlight is as wide as that of a Blinn-Phong exponent (`alpha^2 = 2 / (m + 2)`: B. Walter
/// et al., "Microfacet Models for Refraction through Rough Surfaces", 2007).
fn roughness_of(exponent: f32) -> f32 {
    (2.0 / (exponent.max(0.0) + 2.0)).powf(0.25)
}

/// The materials that an asset needs beside the tiles of a [`LookSource`]: what alpha means, sides, toon scales, and the
/// factors of all that is the same everywhere.
pub fn baked_materials(materials: &[Arc<LookMaterial>]) -> Vec<Material> {
    let baked = |look: &Arc<LookMaterial>| Material {
        metallic: constant(&look.metallic).map_or(0.0, |v| v.x.clamp(0.0, 1.0)),
        roughness: match &look.shininess {
            Some(exponent) => constant(exponent).map_or(0.9, |v| roughness_of(v.x)),
            None => constant(&look.roughness).map_or(0.9, |v| v.x.clamp(0.0, 1.0)),
        },
        emission: constant(&look.emission).map_or(Vec3::ZERO, |v| v.truncate().max(Vec3::ZERO)),
        alpha: match look.opacity {
            Opacity::Opaque => AlphaMode::Opaque,
            Opacity::Mask { threshold } => AlphaMode::Mask(threshold),
            Opacity::Blend => AlphaMode::Blend,
        },
        double_sided: look.double_sided,
        unlit: look.lighting == LightingModel::Unlit,
        toon: look.toon.as_ref().map(|ramp| ramp.toon_scale()),
        ..Material::default()
    };
    materials.iter().map(baked).collect()
}

fn constant(slot: &Slot) -> Option<Vec4> {
    match slot {
        Slot::Constant(value) => Some(*value),
        Slot::Texture(_) => None,
    }
}

/// Base colour always; the others where something varies them.
fn channels(materials: &[Arc<LookMaterial>]) -> Vec<SourceChannel> {
    let any = |test: &dyn Fn(&LookMaterial) -> bool| materials.iter().any(|m| test(m));
    let varies = |slot: &Slot| constant(slot).is_none();
    let has_alpha = any(&|m| !matches!(m.opacity, Opacity::Opaque));
    let channel = |kind| SourceChannel { kind, has_alpha: false, exceeds_one: false };
    let mut channels = vec![SourceChannel { has_alpha, ..channel(ChannelKind::BaseColor) }];
    if any(&|m| !m.relief.is_empty()) {
        channels.push(channel(ChannelKind::Normal));
    }
    let surface_varies = any(&|m| {
        // An occlusion that is the same everywhere is no factor of a material.
        let occludes = constant(&m.occlusion).is_none_or(|v| v.x != 1.0);
        occludes || varies(&m.roughness) || varies(&m.metallic) || m.shininess.as_ref().is_some_and(varies)
    });
    if surface_varies {
        channels.push(channel(ChannelKind::OcclusionRoughnessMetallic));
    }
    if any(&|m| varies(&m.emission)) {
        // How bright a texture is cannot be known before it is asked everywhere.
        channels.push(channel(ChannelKind::Emission));
    }
    if any(&|m| m.anisotropy.is_some()) {
        channels.push(channel(ChannelKind::Anisotropy));
    }
    channels
}

fn check_eye(material: &LookMaterial) -> Result<(), LookSourceError> {
    let slots = [
        ("the base colour", &material.base_color),
        ("alpha", &material.alpha),
        ("the metallic share", &material.metallic),
        ("the roughness", &material.roughness),
        ("the occlusion", &material.occlusion),
        ("the emission", &material.emission),
    ];
    let stretched = material.anisotropy.iter().flat_map(|a| {
        [("the anisotropy's strength", &a.strength), ("the anisotropy's direction", &a.direction)]
    });
    if let Some((what, _)) = slots.into_iter().chain(stretched).find(|(_, slot)| slot.is_view_dependent()) {
        return Err(LookSourceError::ViewDependent { what });
    }
    let depends = |relief: &Relief| {
        let (Relief::Bump { texture, .. }
        | Relief::Derivatives { texture, .. }
        | Relief::Normal { texture, .. }) = relief;
        texture.is_view_dependent()
    };
    match material.relief.iter().any(depends) {
        true => Err(LookSourceError::ViewDependent { what: "the relief" }),
        false => Ok(()),
    }
}

fn refers_to_tangents(material: &LookMaterial, set: usize) -> bool {
    material.anisotropy.as_ref().is_some_and(|anisotropy| anisotropy.uv_set == set)
        || material.relief.iter().any(|relief| {
        matches!(relief, Relief::Normal { space: NormalSpace::Tangent { uv_set }, .. } if *uv_set == set)
    })
}

/// The mesh's own tangents belong to its first set.
fn set_tangents(mesh: &Mesh, normals: &[Vec3], set: usize) -> Vec<Vec4> {
    let corners = 3 * mesh.triangles.len();
    let uv = &mesh.corners.uv_sets[set];
    if uv.len() != corners {
        return Vec::new();
    }
    if set == 0 && mesh.corners.tangents.len() == corners {
        return mesh.corners.tangents.clone();
    }
    corner_tangents(mesh, normals, |t| Some([uv[3 * t], uv[3 * t + 1], uv[3 * t + 2]]))
}
