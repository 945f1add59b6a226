//! A mesh whose materials are looks: every property may be a texture.
//!
//! ```text
//!  Hit --point--> ShadingPoint --slots--> numbers --finish--> MaterialSample, Finish
//!                      |                     ^
//!                      '--relief--> normal, slope variance (widens the highlight)
//! ```

use std::rc::Rc;
use std::sync::Arc;

use fantex_base::Result;
use fantex_mesh::{CornerNormals, Mesh, ObjectSpace, OpposedTriangles};
use fantex_store::limits::MAX_UV_SETS;
use fantex_texture::combine::TextureUse;
use fantex_texture::look::{
    Anisotropy, Difference, GradientAxes, LightingModel, LookMaterial, LookTangents, MIN_RELIEF_STEP,
    NormalSpace, Opacity, Relief, Slot, TangentSpace, height_change, normal_by_map,
};
use fantex_texture::material::{
    LeftOut, ROUNDED_LENGTH, TangentFrame, roughness_with_variance, vertex_color,
};
use fantex_texture::{Eye, Filtering, ShadingPoint, Stretch, Texture, UvPoint};
use glam::{Mat3, Vec2, Vec3, Vec4};

use crate::image_surface::ImageSurface;
use crate::surface::NormalsOfHits as _;
use crate::{
    AnisotropySample, Coverage, FilterOptions, Finish, Hit, MaterialSample, Shaded, SmoothPoint, Surface,
};

/// What a mesh looks like: with a look for each of its materials, or with its own.
#[derive(Debug)]
pub struct LookSurface<'a>(Materials<'a>);

/// Materials by how they are evaluated. Layers that are plain look-ups in images share the weights of texels.
#[derive(Debug)]
enum Materials<'a> {
    Textures(TextureSurface<'a>),
    Images(ImageSurface<'a>),
}

impl<'a> LookSurface<'a> {
    /// Material `i` of the mesh looks like `materials[i]`, those beyond the last like the last; without any, everything looks
    /// like [`LookMaterial::default`].
    pub fn new(mesh: &'a Mesh, materials: Vec<Arc<LookMaterial>>) -> Self {
        Self(Materials::Textures(TextureSurface::new(mesh, materials)))
    }

    /// The model's own materials, the glTF way, their images filtered like this. Textures whose texture coordinates the mesh
    /// lacks are left out, as are images that are missing or broken.
    ///
    /// # Errors
    /// An image takes more memory than there is, or a disk fails.
    pub fn of_model(mesh: &'a Mesh, filter: FilterOptions) -> Result<Self> {
        Ok(Self(Materials::Images(ImageSurface::load(mesh, filter)?)))
    }

    /// Images of the model that could not be read; none of looks.
    pub fn left_out(&self) -> LeftOut {
        match &self.0 {
            Materials::Textures(_) => LeftOut::default(),
            Materials::Images(surface) => surface.left_out().clone(),
        }
    }

    /// The surface at another time of an animation, seconds.
    pub fn at_time(mut self, seconds: f32) -> Self {
        if let Materials::Textures(surface) = &mut self.0 {
            surface.time = seconds;
        }
        self
    }

    /// The surface of an object whose place in its scene has this linear part: what depends on the eye counts with angles there.
    pub fn in_scene(mut self, scene_from_object: Mat3) -> Self {
        if let Materials::Textures(surface) = &mut self.0 {
            surface.stretch = Stretch::of(scene_from_object);
        }
        self
    }

    fn materials(&self) -> &dyn Surface {
        match &self.0 {
            Materials::Textures(surface) => surface,
            Materials::Images(surface) => surface,
        }
    }
}

impl Surface for LookSurface<'_> {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        self.materials().shade(hit)
    }

    fn shade_all<'s>(&'s self, hits: &[Hit], out: &mut Vec<Shaded<'s>>) {
        self.materials().shade_all(hits, out);
    }

    fn alpha(&self, hit: &Hit) -> f32 {
        self.materials().alpha(hit)
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        self.materials().smooth_point(hit)
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        self.materials().coverage(triangle)
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        self.materials().is_double_sided(triangle)
    }
}

#[derive(Debug)]
struct TextureSurface<'a> {
    mesh: &'a Mesh,
    space: ObjectSpace,
    normals: CornerNormals,
    tangents: LookTangents<'a>,
    materials: Vec<Arc<LookMaterial>>,
    time: f32,
    stretch: Option<Stretch>,
    opposed: OpposedTriangles,
}

impl<'a> TextureSurface<'a> {
    fn new(mesh: &'a Mesh, mut materials: Vec<Arc<LookMaterial>>) -> Self {
        if materials.is_empty() {
            materials.push(Arc::default());
        }
        let normals = CornerNormals::of(mesh);
        let tangents = LookTangents::new(mesh, &normals, &materials);
        let (space, opposed) = (ObjectSpace::of(mesh), OpposedTriangles::of(&mesh.triangles));
        Self { mesh, space, normals, tangents, materials, time: 0.0, stretch: None, opposed }
    }

    fn material_of(&self, triangle: usize) -> &LookMaterial {
        let last = self.materials.len() - 1;
        &self.materials[self.mesh.material_of(triangle).min(last)]
    }

    /// The frame of tangent space, in mesh space; `None` where there are no such texture coordinates.
    fn tangent_frame(&self, hit: &Hit, space: &TangentSpace) -> Option<TangentFrame> {
        self.tangents.frame(space, &self.normals, hit.triangle(), hit.at.lambda)
    }

    /// The normal bent by a material's relief, and what of the relief is too fine to be seen.
    fn relief(&self, material: &LookMaterial, hit: &Hit, at: &ShadingPoint, vertex_normal: Vec3) -> Bent {
        let mut bent = Bent { normal: vertex_normal, slope_variance: 0.0 };
        let shows_highlights = material.lighting != LightingModel::Unlit;
        for relief in &material.relief {
            let next = match relief {
                Relief::Bump { texture, height, difference } => {
                    let bump = Bump {
                        texture: &**texture,
                        height: *height,
                        difference: *difference,
                        min_step: MIN_RELIEF_STEP * self.mesh.world_from_mesh.scale as f32,
                    };
                    bump.bend(bent.normal, at, shows_highlights)
                }
                Relief::Derivatives { texture, uv_set, height, range } => {
                    let map = DerivativeMap { texture: &**texture, uv_set: *uv_set, scale: height * range };
                    map.bend(bent.normal, at, shows_highlights)
                }
                Relief::Normal { texture, scale, space } => {
                    let texel = texture.evaluate(at).truncate() * 2.0 - 1.0;
                    let frame = match space {
                        NormalSpace::Object => None,
                        NormalSpace::Tangent(space) => match self.tangent_frame(hit, space) {
                            Some(frame) => Some(frame),
                            None => continue,
                        },
                    };
                    bend_by_normal(bent.normal, vertex_normal, texel, *scale, frame.as_ref())
                }
            };
            bent = Bent { normal: next.normal, slope_variance: bent.slope_variance + next.slope_variance };
        }
        bent
    }

    fn shaded<'s>(
        &self,
        material: &'s LookMaterial,
        hit: &Hit,
        at: &ShadingPoint<'_>,
        slots: &Slots<Vec4>,
    ) -> Shaded<'s> {
        let side = if hit.front { 1.0 } else { -1.0 };
        // Relief rises from the front, so that a sheet seen from behind shows its dents as bumps.
        let bent = self.relief(material, hit, at, at.normal);
        let normal = bent.normal * side;
        let base = slots.base_color;
        let color = |value: Vec4| value.truncate().max(Vec3::ZERO);
        let mut sample = MaterialSample {
            base_color: color(base),
            alpha: material.opacity_at(at, base.w),
            normal,
            normal_steps: at.normal_steps.map(|step| step * side),
            occlusion: slots.occlusion.x.clamp(0.0, 1.0),
            roughness: slots.roughness.x.clamp(0.0, 1.0),
            metallic: slots.metallic.x.clamp(0.0, 1.0),
            emission: color(slots.emission),
            mirrored: Vec3::ZERO,
            unlit: material.lighting == LightingModel::Unlit,
            lookups: material.textures().count() as u32,
        };
        let mut finish = Finish {
            is_blinn_phong: material.lighting == LightingModel::BlinnPhong,
            color_use: material.color_use,
            ambient: color(slots.ambient),
            specular: color(slots.specular),
            shininess: slots.shininess.map(|exponent| exponent.x.max(0.0)),
            reflection: color(slots.reflection),
            light_map: slots.light_map.map(color),
            modulate: slots.modulate.map_or(Vec3::ONE, color),
            fragment: material
                .fragment
                .as_ref()
                .zip(slots.fragment)
                .map(|(f, texel)| (f.mode, texel, f.constant)),
            toon: material.toon.as_deref(),
            normal_width: at.normal_steps[0].length().max(at.normal_steps[1].length()),
            anisotropy: None,
        };
        if let Some(anisotropy) = &material.anisotropy {
            finish.anisotropy = self.anisotropy(anisotropy, hit, at, bent.normal);
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
        let direction = match self.tangent_frame(hit, &TangentSpace::of_set(anisotropy.uv_set)) {
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

impl Surface for TextureSurface<'_> {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        let material = self.material_of(hit.triangle());
        let own = LookPoint::new(self, hit);
        let at = own.shading_point();
        self.shaded(material, hit, &at, &Slots::new(material, |slot| slot.evaluate(&at)))
    }

    fn shade_all<'s>(&'s self, hits: &[Hit], out: &mut Vec<Shaded<'s>>) {
        let material_of = |hit: &Hit| self.material_of(hit.triangle());
        for hits in hits.chunk_by(|a, b| std::ptr::eq(material_of(a), material_of(b))) {
            let material = material_of(&hits[0]);
            let own = |hit: &Hit| LookPoint::new(self, hit);
            let own: Vec<LookPoint<'_>> = hits.iter().map(own).collect();
            let at: Vec<ShadingPoint<'_>> = own.iter().map(LookPoint::shading_point).collect();
            let mut columns = Columns { at: &at, asked: Vec::new() };
            let slots = Slots::new(material, |slot| columns.of(slot));
            let shaded = hits.iter().zip(&at).enumerate();
            out.extend(shaded.map(|(index, (hit, at))| self.shaded(material, hit, at, &slots.at(index))));
        }
    }

    fn alpha(&self, hit: &Hit) -> f32 {
        let material = self.material_of(hit.triangle());
        let own = LookPoint::new(self, hit);
        let at = own.shading_point();
        material.opacity_at(&at, material.base_color.evaluate(&at).w)
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
        self.material_of(triangle).double_sided && !self.opposed.contains(triangle)
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

// The values of all slots of a material.

/// One `T` for every slot of a material that the shading reads at every point.
#[derive(Clone, Copy, Debug)]
struct Slots<T> {
    base_color: T,
    metallic: T,
    roughness: T,
    occlusion: T,
    ambient: T,
    specular: T,
    shininess: Option<T>,
    emission: T,
    reflection: T,
    light_map: Option<T>,
    modulate: Option<T>,
    fragment: Option<T>,
}

impl<T> Slots<T> {
    fn new<'m>(material: &'m LookMaterial, mut of: impl FnMut(&'m Slot) -> T) -> Self {
        Self {
            base_color: of(&material.base_color),
            metallic: of(&material.metallic),
            roughness: of(&material.roughness),
            occlusion: of(&material.occlusion),
            ambient: of(&material.ambient),
            specular: of(&material.specular),
            shininess: material.shininess.as_ref().map(&mut of),
            emission: of(&material.emission),
            reflection: of(&material.reflection),
            light_map: material.light_map.as_ref().map(&mut of),
            modulate: material.modulate.as_ref().map(&mut of),
            fragment: material.fragment.as_ref().map(|fragment| of(&fragment.texture)),
        }
    }
}

/// The values of a slot at many points.
#[derive(Debug)]
enum Column<'m> {
    Same(Vec4),
    Each(Rc<[Vec4]>),
    Use(&'m TextureUse, Rc<[Vec4]>),
}

/// The values of slots at many points: several uses of one texture ask it once.
struct Columns<'a> {
    at: &'a [ShadingPoint<'a>],
    /// By the address of the texture.
    asked: Vec<(*const (), Rc<[Vec4]>)>,
}

impl Columns<'_> {
    fn of<'m>(&mut self, slot: &'m Slot) -> Column<'m> {
        match slot {
            Slot::Constant(value) => Column::Same(*value),
            Slot::Texture(texture) => match texture.as_use() {
                Some(texture_use) => Column::Use(texture_use, self.values(&*texture_use.texture)),
                None => Column::Each(self.values(&**texture)),
            },
        }
    }

    fn values(&mut self, texture: &dyn Texture) -> Rc<[Vec4]> {
        let address = std::ptr::from_ref(texture).cast::<()>();
        if let Some((_, values)) = self.asked.iter().find(|(asked, _)| *asked == address) {
            return Rc::clone(values);
        }
        let mut values = vec![Vec4::ZERO; self.at.len()];
        texture.evaluate_all(self.at, &mut values);
        let values = Rc::from(values);
        self.asked.push((address, Rc::clone(&values)));
        values
    }
}

impl Column<'_> {
    fn value(&self, index: usize) -> Vec4 {
        match self {
            Self::Same(value) => *value,
            Self::Each(values) => values[index],
            Self::Use(texture_use, values) => texture_use.of(values[index]),
        }
    }
}

impl Slots<Column<'_>> {
    pub(crate) fn at(&self, index: usize) -> Slots<Vec4> {
        let value = |column: &Column<'_>| column.value(index);
        Slots {
            base_color: value(&self.base_color),
            metallic: value(&self.metallic),
            roughness: value(&self.roughness),
            occlusion: value(&self.occlusion),
            ambient: value(&self.ambient),
            specular: value(&self.specular),
            shininess: self.shininess.as_ref().map(value),
            emission: value(&self.emission),
            reflection: value(&self.reflection),
            light_map: self.light_map.as_ref().map(value),
            modulate: self.modulate.as_ref().map(value),
            fragment: self.fragment.as_ref().map(value),
        }
    }
}

// From a hit to the point that textures are asked at.

/// What a [`ShadingPoint`] borrows, and the rest of it.
#[derive(Clone, Copy, Debug)]
struct LookPoint<'a> {
    position: Vec3,
    position_steps: [Vec3; 2],
    normal: Vec3,
    normal_steps: [Vec3; 2],
    uv: [UvPoint; MAX_UV_SETS],
    uv_sets: usize,
    vertex_color: Vec4,
    eye: Eye<'a>,
    time: f32,
}

impl<'a> LookPoint<'a> {
    fn new(surface: &'a TextureSurface<'_>, hit: &Hit) -> Self {
        let TextureSurface { mesh, space, normals, time, stretch, .. } = surface;
        let positions = mesh.triangle_positions(hit.triangle()).map(|p| space.point(p));
        let (position, position_steps) = hit.interpolate(positions);
        let (normal, normal_steps) = smooth_normal(mesh, normals, hit);
        let mut uv = [UvPoint::default(); MAX_UV_SETS];
        let sets = &mesh.corners.uv_sets;
        for (point, set) in uv.iter_mut().zip(sets) {
            if let Some(corners) = set.get(3 * hit.triangle()..).and_then(|rest| rest.first_chunk::<3>()) {
                let (uv, steps) = hit.interpolate(*corners);
                *point = UvPoint { uv, steps };
            }
        }
        Self {
            position,
            position_steps,
            normal,
            normal_steps,
            uv,
            uv_sets: sets.len().min(MAX_UV_SETS),
            vertex_color: vertex_color(mesh, hit.triangle(), hit.at.lambda),
            eye: Eye { direction: hit.to_eye, stretch: stretch.as_ref() },
            time: *time,
        }
    }

    fn shading_point(&self) -> ShadingPoint<'_> {
        ShadingPoint {
            position: self.position,
            position_steps: self.position_steps,
            normal: self.normal,
            normal_steps: self.normal_steps,
            uv: &self.uv[..self.uv_sets],
            vertex_color: self.vertex_color,
            eye: Some(self.eye),
            time: self.time,
            filtering: Filtering::Own,
        }
    }
}

/// The interpolated unit normal of the front, whichever side is seen, and its change along the footprint's edges: of `b / |b|` that is
/// `(db - n (n . db)) / |b|`.
fn smooth_normal(mesh: &Mesh, normals: &CornerNormals, hit: &Hit) -> (Vec3, [Vec3; 2]) {
    let normal = normals.at(mesh, hit.at);
    let (blend, changes) = hit.interpolate(hit.at.corner_values(normals));
    let length = blend.length().max(1e-3);
    (normal, changes.map(|change| (change - normal * normal.dot(change)) / length))
}

/// Point `i` of an even spread over the footprint, each coordinate in -0.5..0.5: the additive recurrence on the plastic
/// number (M. Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018).
pub(crate) fn spread(i: usize) -> Vec2 {
    const STEP: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);
    (STEP * i as f32 + 0.5).fract() - 0.5
}

// Bent normals, and what of the relief is too fine to be seen.

/// Points of the footprint at which slopes are looked up to find their variance.
const SLOPES: usize = 8;

/// After this many points that agree with the mean slope no more are asked.
const SLOPES_TO_AGREE: usize = 2;

/// Width of the slopes' own footprints, as a share of the pixel's.
const SLOPE_SHARE: f32 = 1.0 / 64.0;

/// Variance of slopes that no highlight shows.
const INVISIBLE_VARIANCE: f32 = 1e-5;

#[derive(Clone, Copy, Debug)]
struct Bent {
    /// Unit vector.
    normal: Vec3,
    /// Variance, along each axis, of the slopes within the footprint.
    slope_variance: f32,
}

struct Bump<'a> {
    texture: &'a dyn Texture,
    /// World units per unit of the texture.
    height: f32,
    difference: Difference,
    /// World units.
    min_step: f32,
}

impl Bump<'_> {
    /// Bends a unit normal.
    pub(crate) fn bend(&self, normal: Vec3, at: &ShadingPoint, with_variance: bool) -> Bent {
        let unbent = Bent { normal, slope_variance: 0.0 };
        let Some(axes) = GradientAxes::new(at.position_steps, normal) else { return unbent };
        let gradient = axes.gradient(self.change(at));
        let Some(bent) = (normal - gradient).try_normalize() else { return unbent };
        let slope_variance = if with_variance { self.slope_variance(at, &axes, gradient) } else { 0.0 };
        Bent { normal: bent, slope_variance }
    }

    /// Change of the height along the footprint's edges, from differences over half of them, or over a texel where that is longer.
    fn change(&self, at: &ShadingPoint) -> Vec2 {
        let height = |offset: Vec2| at.part(offset, 1.0, |there| self.texture.evaluate(there)).x;
        let texel = self.texture.edges_per_texel(at).unwrap_or([0.0; 2]);
        let share = |k: usize| self.min_share(at.position_steps[k]).max(texel[k]).max(0.5);
        let steps = [share(0), share(1)];
        height_change(self.difference, steps, height) * self.height
    }

    /// The share of an edge that still has enough digits for a difference along it; may be larger than one.
    fn min_share(&self, edge: Vec3) -> f32 {
        let length = edge.length();
        if length > 0.0 { (self.min_step / length).min(1e6) } else { 1.0 }
    }

    fn slope_variance(&self, at: &ShadingPoint, axes: &GradientAxes, mean: Vec3) -> f32 {
        let [along, across] = at.position_steps.map(|edge| self.min_share(edge));
        let share = along.max(across).max(SLOPE_SHARE);
        if share > 0.5 {
            return 0.0;
        }
        let height = |offset: Vec2| at.part(offset, share, |there| self.texture.evaluate(there)).x;
        variance(mean, |p| {
            let here = height(p);
            let there = Vec2::new(height(p + Vec2::X * share), height(p + Vec2::Y * share));
            axes.gradient((there - here) * (self.height / share))
        })
    }
}

/// Bump mapping by a texture that holds derivatives in green and blue.
struct DerivativeMap<'a> {
    texture: &'a dyn Texture,
    /// Whose `u` and `v` the derivatives belong to.
    uv_set: usize,
    /// World height of the largest derivative that the encoding holds, per unit of `u` or `v`.
    scale: f32,
}

impl DerivativeMap<'_> {
    /// Bends a unit normal.
    pub(crate) fn bend(&self, normal: Vec3, at: &ShadingPoint, with_variance: bool) -> Bent {
        let unbent = Bent { normal, slope_variance: 0.0 };
        let axes = GradientAxes::new(at.position_steps, normal);
        let (Some(uv), Some(axes)) = (at.uv.get(self.uv_set), axes) else { return unbent };
        let gradient = |texel: Vec4| axes.of_derivatives(texel, uv, self.scale);
        let mean = gradient(self.texture.evaluate(at));
        let Some(normal) = (normal - mean).try_normalize() else { return unbent };
        let slope = |p: Vec2| gradient(at.part(p, SLOPE_SHARE, |there| self.texture.evaluate(there)));
        let slope_variance = if with_variance { variance(mean, slope) } else { 0.0 };
        Bent { normal, slope_variance }
    }
}

/// Variance of the slopes along each axis, around the slope of the whole footprint. Where the footprint is smaller than the
/// relief, the first points agree, and that was all.
fn variance(mean: Vec3, slope: impl Fn(Vec2) -> Vec3) -> f32 {
    let mut sum = 0.0;
    for i in 0..SLOPES {
        sum += 0.5 * (slope(spread(i)) - mean).length_squared();
        if i + 1 == SLOPES_TO_AGREE && sum < INVISIBLE_VARIANCE {
            return 0.0;
        }
    }
    if sum.is_finite() { sum / SLOPES as f32 } else { 0.0 }
}

/// Bends a unit normal by a decoded texel of a normal map, in tangent space or (without a frame) in the model's axes. What
/// bent the normal before is kept: the map's normal is turned as the vertex normal was.
fn bend_by_normal(
    normal: Vec3,
    vertex_normal: Vec3,
    texel: Vec3,
    scale: f32,
    frame: Option<&TangentFrame>,
) -> Bent {
    match normal_by_map(normal, vertex_normal, texel, scale, frame) {
        Some(normal) => Bent { normal, slope_variance: scale * scale * mean_normal_variance(texel.length()) },
        None => Bent { normal, slope_variance: 0.0 },
    }
}

/// Variance, along each axis, of the slopes of unit normals whose mean has this length.
fn mean_normal_variance(length: f32) -> f32 {
    let length = (length / ROUNDED_LENGTH).clamp(0.05, 1.0);
    (1.0 - length) / length
}

#[cfg(test)]
mod tests {
    use fantex_texture::{Filtering, UvPoint};

    use super::*;

    /// Waves over x and y of the position.
    struct Waves {
        amplitude: f32,
        frequency: f32,
    }

    impl Waves {
        fn height(&self, p: Vec3) -> f32 {
            self.amplitude * ((self.frequency * p.x).sin() + (0.7 * self.frequency * p.y).cos())
        }

        /// The unit normal of the plane `z = 0` displaced by the waves.
        fn normal(&self, p: Vec3) -> Vec3 {
            let scale = self.amplitude * self.frequency;
            let x = scale * (self.frequency * p.x).cos();
            let y = -0.7 * scale * (0.7 * self.frequency * p.y).sin();
            Vec3::new(-x, -y, 1.0).normalize()
        }
    }

    impl Texture for Waves {
        fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
            Vec4::splat(self.height(at.position))
        }
    }

    fn point(position: Vec3, steps: [Vec3; 2], uv: &[UvPoint]) -> ShadingPoint<'_> {
        ShadingPoint {
            position,
            position_steps: steps,
            normal: Vec3::Z,
            normal_steps: [Vec3::ZERO; 2],
            uv,
            vertex_color: Vec4::ONE,
            eye: None,
            time: 0.0,
            filtering: Filtering::Own,
        }
    }

    /// Footprints of any shape: rectangular, mirrored, sheared, rotated.
    fn footprints(size: f32) -> [[Vec3; 2]; 4] {
        [
            [Vec3::X, Vec3::Y],
            [Vec3::X, Vec3::NEG_Y],
            [Vec3::new(1.0, 0.8, 0.0), Vec3::new(-0.1, 0.6, 0.0)],
            [Vec3::new(0.0, -2.0, 0.0), Vec3::new(0.5, 0.5, 0.0)],
        ]
        .map(|steps| steps.map(|step| step * size))
    }

    fn bump(texture: &dyn Texture, difference: Difference) -> Bump<'_> {
        Bump { texture, height: 1.0, difference, min_step: MIN_RELIEF_STEP }
    }

    #[test]
    fn bumps_have_the_normal_of_the_displaced_plane() {
        let waves = Waves { amplitude: 0.1, frequency: 8.0 };
        for (difference, tolerance) in
            [(Difference::Central, 3e-4), (Difference::Forward, 2e-2), (Difference::Backward, 2e-2)]
        {
            for steps in footprints(0.01) {
                for p in [Vec3::ZERO, Vec3::new(0.3, -0.2, 0.0), Vec3::new(-0.9, 0.45, 0.0)] {
                    let bent = bump(&waves, difference).bend(Vec3::Z, &point(p, steps, &[]), false).normal;
                    let off = (bent - waves.normal(p)).length();
                    assert!(off < tolerance, "{difference:?} at {p} over {steps:?}: off by {off}");
                }
            }
        }
    }

    #[test]
    fn tiny_footprints_do_not_drown_in_rounding() {
        let waves = Waves { amplitude: 0.1, frequency: 8.0 };
        let p = Vec3::new(0.913, -0.377, 0.0);
        for size in [1e-5, 1e-7, 1e-9] {
            let bent = bump(&waves, Difference::Central);
            let bent = bent.bend(Vec3::Z, &point(p, footprints(size)[2], &[]), true);
            assert!((bent.normal - waves.normal(p)).length() < 5e-3, "{size}: {}", bent.normal);
            assert_eq!(bent.slope_variance, 0.0);
        }
    }

    #[test]
    fn bumps_too_fine_to_see_are_variance() {
        // Slopes of sine waves have half their squared amplitude as variance.
        let waves = Waves { amplitude: 1e-4, frequency: 3000.0 };
        let expected = 0.5 * (0.5 * 0.09 + 0.5 * 0.49 * 0.09);
        let n = 400;
        let mean = (0..n)
            .map(|i| {
                let p = Vec3::new(0.013 * i as f32, 0.0077 * i as f32, 0.0) % 1.0;
                bump(&waves, Difference::Central)
                    .bend(Vec3::Z, &point(p, [Vec3::X * 0.02, Vec3::Y * 0.02], &[]), true)
                    .slope_variance
            })
            .sum::<f32>()
            / n as f32;
        assert!((mean / expected - 1.0).abs() < 0.15, "{mean} against {expected}");
        let smooth = Waves { amplitude: 0.1, frequency: 8.0 };
        let seen = bump(&smooth, Difference::Central).bend(
            Vec3::Z,
            &point(Vec3::X, footprints(0.002)[2], &[]),
            true,
        );
        assert!(seen.slope_variance < 1e-4, "{}", seen.slope_variance);
    }

    #[test]
    fn stored_derivatives_bend_as_the_height_does() {
        // The height 0.3 u + 0.1 v, with u along x and v downwards.
        let (range, height) = (0.5, 2.0);
        let texel = Vec4::new(0.0, 0.5 + 0.5 * 0.3 / range, 0.5 + 0.5 * 0.1 / range, 1.0);
        let expected = Vec3::new(-0.3 * height, 0.1 * height, 1.0).normalize();
        for steps in footprints(0.01) {
            let uv = [UvPoint { uv: Vec2::ZERO, steps: steps.map(|s| Vec2::new(s.x, -s.y)) }];
            let at = point(Vec3::ZERO, steps, &uv);
            let bent =
                DerivativeMap { texture: &texel, uv_set: 0, scale: height * range }.bend(Vec3::Z, &at, true);
            assert_eq!(bent.slope_variance, 0.0);
            let bent = bent.normal;
            assert!((bent - expected).length() < 1e-5, "{bent} against {expected}");
        }
    }

    #[test]
    fn normal_maps_follow_their_frame() {
        let texel = Vec3::new(0.6, 0.0, 0.8);
        let object = bend_by_normal(Vec3::Z, Vec3::Z, texel, 1.0, None);
        assert!((object.normal - texel).length() < 1e-6 && object.slope_variance < 1e-3);
        let stronger = bend_by_normal(Vec3::Z, Vec3::Z, texel, 2.0, None).normal;
        assert!((stronger - Vec3::new(1.2, 0.0, 0.8).normalize()).length() < 1e-6);
        let normals = [Vec3::Y; 3];
        let frame = TangentFrame::at(&normals, &[Vec4::new(0.0, 0.0, 1.0, 1.0); 3], 0, Vec3::X);
        let tangent = bend_by_normal(Vec3::Y, Vec3::Y, texel, 1.0, Some(&frame)).normal;
        assert!((tangent - Vec3::new(0.0, 0.8, 0.6)).length() < 1e-6, "{tangent}");
    }

    #[test]
    fn one_relief_upon_another_adds_up() {
        let tilt = Vec3::new(0.1, 0.0, 1.0).normalize();
        let both = bend_by_normal(tilt, Vec3::Z, Vec3::new(0.1, 0.0, 1.0).normalize(), 1.0, None).normal;
        assert!((both.x / both.z - 0.2).abs() < 5e-3, "{both}");
    }

    #[test]
    fn short_mean_normals_are_rough() {
        let spread = bend_by_normal(Vec3::Z, Vec3::Z, Vec3::Z * 0.8, 1.0, None).slope_variance;
        assert!((spread - 0.25).abs() < 0.01, "{spread}");
        assert_eq!(mean_normal_variance(0.998), 0.0);
        assert!(mean_normal_variance(0.0).is_finite());
    }
}
