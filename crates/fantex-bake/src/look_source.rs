//! Materials whose properties are textures: what does not depend on the eye, as tiles.

use std::cell::RefCell;
use std::sync::Arc;

use fantex_base::{Error, Result};
use fantex_mesh::{AlphaMode, Material, Mesh, ObjectSpace, interpolate, shading_normals};
use fantex_store::ChannelKind;
use fantex_texture::look::{
    Anisotropy, GradientAxes, LightingModel, LookMaterial, LookTangents, MIN_RELIEF_STEP, NormalSpace,
    Opacity, Relief, Slot, TangentSpace, height_change, normal_by_map,
};
use fantex_texture::material::{
    LeftOut, MaterialTextures, TangentFrame, load_material_textures, vertex_color,
};
use fantex_texture::{Filtering, ShadingPoint, Texture, UvPoint};
use glam::{Vec2, Vec3, Vec4};

use crate::image_source::{ImageSource, NO_IMAGE_DENSITY};
use crate::{Prefilter, Source, SourceChannel, TexelPoint, for_each_run};

/// What a mesh looks like, as a source: base colour with alpha, the normal with all relief applied, occlusion with roughness
/// and metallic, emission, the direction of stretched highlights. Of a look, a property that is the same everywhere is no channel
/// but a factor of [`baked_materials`].
#[derive(Debug)]
pub struct LookSource<'a>(Materials<'a>, LeftOut);

/// Materials by how they are evaluated. Layers that are plain look-ups in images share the weights of texels.
#[derive(Debug)]
enum Materials<'a> {
    Textures(TextureSource<'a>),
    Images(ImageSource<'a>),
}

impl<'a> LookSource<'a> {
    /// Material `i` of the mesh looks like `materials[i]`, those beyond the last like the last; without any, everything looks
    /// like the default. `time` is in seconds.
    ///
    /// # Errors
    /// A texture depends on the eye.
    pub fn new(mesh: &'a Mesh, materials: Vec<Arc<LookMaterial>>, time: f32) -> Result<Self> {
        Ok(Self(Materials::Textures(TextureSource::new(mesh, materials, time)?), LeftOut::default()))
    }

    /// With a channel of heights: the red of `heights[i]` on material `i`, 0 where there is none.
    ///
    /// # Errors
    /// A texture depends on the eye.
    pub fn with_heights(mut self, heights: Vec<Option<Slot>>) -> Result<Self> {
        if heights.iter().flatten().any(Slot::is_view_dependent) {
            return Err(view_dependent("the displacement"));
        }
        if let Materials::Textures(source) = &mut self.0 {
            source.channels.push(SourceChannel::new(ChannelKind::Displacement));
            source.heights = heights;
        }
        Ok(self)
    }

    /// With a channel of emission where anything glows, also where that is the same everywhere: for light that is baked, what glows is a lamp.
    pub fn with_all_emission(mut self) -> Self {
        if let Materials::Textures(source) = &mut self.0
            && source.channels.iter().all(|channel| channel.kind != ChannelKind::Emission)
            && source.materials.iter().any(|m| max_value(&m.emission) != Vec3::ZERO)
        {
            source.channels.push(emission_channel(&source.materials));
        }
        self
    }

    /// The model's own materials through its own texture coordinates: base colour always, other channels where a texture varies
    /// them or materials differ in them. Images that are missing or broken are [left out](Self::left_out).
    ///
    /// # Errors
    /// An image takes more memory than there is, or a disk fails.
    pub fn of_model(mesh: &'a Mesh) -> Result<Self> {
        let (materials, left_out) = load_material_textures(mesh)?;
        let Self(source, _) = Self::of_decoded(mesh, materials);
        Ok(Self(source, left_out))
    }

    /// Images of the model that could not be read.
    pub fn left_out(&self) -> &LeftOut {
        &self.1
    }

    /// As [`of_model`](Self::of_model), with the images of its materials, an entry per material.
    pub fn of_decoded(mesh: &'a Mesh, materials: Vec<MaterialTextures>) -> Self {
        Self(Materials::Images(ImageSource::new(mesh, materials)), LeftOut::default())
    }

    /// The tangents that normal maps of models are relative to, one per corner; empty without normal maps, and in looks.
    pub fn normal_map_tangents(&self) -> &[Vec4] {
        match &self.0 {
            Materials::Images(source) => source.tangents(),
            Materials::Textures(_) => &[],
        }
    }

    /// Whether a material of the model has an image; true for looks.
    pub fn has_textures(&self) -> bool {
        match &self.0 {
            Materials::Images(source) => source.has_textures(),
            Materials::Textures(_) => true,
        }
    }

    /// How many of the model's materials have an image whose texels are to appear as squares when magnified, and show more than one of
    /// them on a triangle; 0 for looks. A bake takes means of squares, but what is read from it is blended between its texels.
    pub fn square_texel_materials(&self) -> usize {
        match &self.0 {
            Materials::Images(source) => source.square_texel_materials(),
            Materials::Textures(_) => 0,
        }
    }

    /// Texels of the finest image per mesh unit, for each triangle: what a bake needs to lose nothing. Triangles without image,
    /// with degenerate coordinates, or too slender to show any take the mean of the others, by area; where nothing has an image,
    /// as in looks, it is 256. Triangles that show less than a sixteenth of a texel, as those of models coloured by a palette do, have at
    /// least the density at which the whole model has 2^18 texels.
    pub fn density(&self) -> Vec<f32> {
        match &self.0 {
            Materials::Images(source) => source.density(),
            Materials::Textures(source) => vec![NO_IMAGE_DENSITY; source.finder.mesh.triangles.len()],
        }
    }

    /// Texels of the model's images, those of the largest of each material; 0 for looks. Where [`density`](Self::density) asks for more, the
    /// model shows parts of its images again and again.
    pub fn image_texels(&self) -> u64 {
        match &self.0 {
            Materials::Images(source) => source.image_texels(),
            Materials::Textures(_) => 0,
        }
    }

    fn materials(&self) -> &dyn Source {
        match &self.0 {
            Materials::Textures(source) => source,
            Materials::Images(source) => source,
        }
    }
}

impl Source for LookSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        self.materials().channels()
    }

    fn prefilter(&self) -> Prefilter {
        self.materials().prefilter()
    }

    fn has_shares(&self) -> bool {
        self.materials().has_shares()
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        self.materials().evaluate(point, values);
    }

    fn evaluate_all(&self, points: &[TexelPoint], values: &mut [Vec4]) {
        self.materials().evaluate_all(points, values);
    }
}

#[derive(Debug)]
struct TextureSource<'a> {
    materials: Vec<Arc<LookMaterial>>,
    finder: PointFinder<'a>,
    /// Per set of texture coordinates an entry per corner; empty for sets that nothing refers to.
    tangents: LookTangents<'a>,
    channels: Vec<SourceChannel>,
    /// Per material.
    heights: Vec<Option<Slot>>,
}

impl<'a> TextureSource<'a> {
    fn new(mesh: &'a Mesh, mut materials: Vec<Arc<LookMaterial>>, time: f32) -> Result<Self> {
        if materials.is_empty() {
            materials.push(Arc::default());
        }
        materials.iter().try_for_each(|m| check_eye(m))?;
        let channels = channels(&materials);
        let normals = shading_normals(mesh);
        let tangents = LookTangents::new(mesh, &normals, &materials);
        let finder = PointFinder { mesh, space: ObjectSpace::of(mesh), normals, time };
        Ok(Self { materials, finder, tangents, channels, heights: Vec::new() })
    }

    fn material_of(&self, triangle: usize) -> &LookMaterial {
        let last = self.materials.len() - 1;
        &self.materials[self.finder.mesh.material_of(triangle).min(last)]
    }

    /// The direction of a stretched highlight, mesh space, and its strength; the direction need not lie in the surface.
    fn direction(&self, anisotropy: &Anisotropy, point: &TexelPoint, ask: &Ask<'_>) -> Vec4 {
        let [along, across, ..] = (value_of(&anisotropy.direction, ask) * 2.0 - 1.0).to_array();
        let space = TangentSpace::of_set(anisotropy.uv_set);
        let lambda = point.at.lambda.clamp(Vec3::ZERO, Vec3::ONE);
        let frame = self.tangents.frame(&space, &self.finder.normals, point.at.index(), lambda);
        let direction = match frame {
            Some(frame) => frame.mesh_vector(Vec3::new(along, across, 0.0)),
            None => {
                let tangent = Vec3::Y.cross(point.normal).try_normalize().unwrap_or(Vec3::X);
                tangent * along + point.normal.cross(tangent) * across
            }
        };
        direction.extend(value_of(&anisotropy.strength, ask).x.clamp(-1.0, 1.0))
    }
}

impl Source for TextureSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        self.channels.clone()
    }

    fn has_shares(&self) -> bool {
        true
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let material = self.material_of(point.at.index());
        self.finder.at(point, |at| {
            let ask = |texture: &dyn Texture, offset: Vec2| ask_at(at, texture, offset);
            self.values(material, point, at, &ask, values);
        });
    }

    fn evaluate_all(&self, points: &[TexelPoint], values: &mut [Vec4]) {
        let channels = self.channels.len();
        // How far neighbouring heights lie apart may depend on the triangle; else it is the material that texels share.
        let together = |a: &TexelPoint, b: &TexelPoint| {
            let [material, other] = [a, b].map(|point| self.material_of(point.at.index()));
            let bumps = material.relief.iter().any(|relief| matches!(relief, Relief::Bump { .. }));
            a.is_on_triangle_of(b) || (std::ptr::eq(material, other) && !bumps)
        };
        for_each_run(points, values, channels, together, |points, values| {
            let material = self.material_of(points[0].at.index());
            self.finder.at_all(points, |at| {
                let answers = Answers::new(at);
                let of_points = points.iter().zip(at).zip(values.chunks_mut(channels));
                for (index, ((point, at), values)) in of_points.enumerate() {
                    let ask = |texture: &dyn Texture, offset: Vec2| answers.ask(index, texture, offset);
                    self.values(material, point, at, &ask, values);
                }
            });
        });
    }
}

impl TextureSource<'_> {
    /// Writes one value per channel. `ask` answers for the point.
    fn values(
        &self,
        material: &LookMaterial,
        point: &TexelPoint,
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
                    let alpha = match material.opacity {
                        Opacity::Mask { .. } => material.opacity_at(at, base.w),
                        Opacity::Opaque => 1.0,
                        Opacity::Blend => base.w * value(&material.alpha).x,
                    };
                    color(base).extend(alpha)
                }
                ChannelKind::Normal => {
                    let reliefs = Reliefs {
                        relief: &material.relief,
                        tangents: &self.tangents,
                        normals: &self.finder.normals,
                        min_step: MIN_RELIEF_STEP * self.finder.mesh.world_from_mesh.scale as f32,
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
                ChannelKind::Displacement => {
                    let height = self.heights.get(self.finder.mesh.material_of(point.at.index()));
                    height.and_then(Option::as_ref).map_or(Vec4::ZERO, value)
                }
                ChannelKind::Light => Vec4::ZERO,
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
            // What is baked is the share of the texel that is there.
            Opacity::Mask { .. } => AlphaMode::Mask(0.5),
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

/// The largest red, green and blue of a slot whose textures do not exceed 1 before their factors. (How bright a texture is cannot be known
/// before it is asked everywhere.)
fn max_value(slot: &Slot) -> Vec3 {
    fn of_texture(texture: &dyn Texture) -> Vec3 {
        let Some(texture_use) = texture.as_use() else { return Vec3::ONE };
        let most = of_texture(&*texture_use.texture);
        let most = if texture_use.channel.is_some() { Vec3::splat(most.max_element()) } else { most };
        (texture_use.factor.rgba().truncate() * most).max(Vec3::ZERO) + texture_use.offset
    }
    match slot {
        Slot::Constant(value) => value.truncate(),
        Slot::Texture(texture) => of_texture(&**texture),
    }
}

/// Base colour always; the others where something varies them.
fn channels(materials: &[Arc<LookMaterial>]) -> Vec<SourceChannel> {
    let any = |test: &dyn Fn(&LookMaterial) -> bool| materials.iter().any(|m| test(m));
    let varies = |slot: &Slot| constant(slot).is_none();
    let has_alpha = any(&|m| !matches!(m.opacity, Opacity::Opaque));
    let channel = SourceChannel::new;
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
        channels.push(emission_channel(materials));
    }
    if any(&|m| m.anisotropy.is_some()) {
        channels.push(channel(ChannelKind::Anisotropy));
    }
    channels
}

fn emission_channel(materials: &[Arc<LookMaterial>]) -> SourceChannel {
    let exceeds_one = materials.iter().any(|m| max_value(&m.emission).max_element() > 1.0);
    SourceChannel { exceeds_one, ..SourceChannel::new(ChannelKind::Emission) }
}

fn view_dependent(what: &str) -> Error {
    Error::unsupported(format!(
        "{what} depends on the eye (a reflection, or the angle of view), and a bake has no eye; leave it out, or render instead"
    ))
}

fn check_eye(material: &LookMaterial) -> Result<()> {
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
        return Err(view_dependent(what));
    }
    let depends = |relief: &Relief| {
        let (Relief::Bump { texture, .. }
        | Relief::Derivatives { texture, .. }
        | Relief::Normal { texture, .. }) = relief;
        texture.is_view_dependent()
    };
    match material.relief.iter().any(depends) {
        true => Err(view_dependent("the relief")),
        false => Ok(()),
    }
}

// From a texel on a mesh to what textures are asked by.

/// Sets of texture coordinates that need no allocation per texel.
const INLINE_SETS: usize = 4;

#[derive(Debug)]
struct PointFinder<'a> {
    mesh: &'a Mesh,
    space: ObjectSpace,
    /// Unit vectors, per corner.
    normals: Vec<Vec3>,
    /// Seconds.
    time: f32,
}

impl PointFinder<'_> {
    /// Asks at a texel: object space, averaging over the texel, without an eye.
    pub(crate) fn at<R>(&self, point: &TexelPoint, ask: impl FnOnce(&ShadingPoint<'_>) -> R) -> R {
        let sets = &self.mesh.corners.uv_sets;
        let (mut inline, heap);
        let uv = if sets.len() <= INLINE_SETS {
            inline = [UvPoint::default(); INLINE_SETS];
            inline.iter_mut().zip(sets).for_each(|(uv, set)| *uv = uv_point(set, point));
            &inline[..sets.len()]
        } else {
            heap = sets.iter().map(|set| uv_point(set, point)).collect::<Vec<_>>();
            &heap
        };
        ask(&self.shading_point(point, uv))
    }

    fn at_all<R>(&self, points: &[TexelPoint], ask: impl FnOnce(&[ShadingPoint<'_>]) -> R) -> R {
        let sets = &self.mesh.corners.uv_sets;
        let uv: Vec<UvPoint> =
            points.iter().flat_map(|point| sets.iter().map(|set| uv_point(set, point))).collect();
        let of = |index: usize| &uv[index * sets.len()..(index + 1) * sets.len()];
        let at: Vec<ShadingPoint<'_>> =
            points.iter().enumerate().map(|(index, point)| self.shading_point(point, of(index))).collect();
        ask(&at)
    }

    fn shading_point<'u>(&self, point: &TexelPoint, uv: &'u [UvPoint]) -> ShadingPoint<'u> {
        // Off the triangle, colours must not be extrapolated.
        let inside = point.at.lambda.clamp(Vec3::ZERO, Vec3::ONE);
        ShadingPoint {
            position: self.space.point(point.position),
            position_steps: point.position_steps.map(|step| self.space.vector(step)),
            normal: point.normal,
            normal_steps: self.normal_steps(point),
            uv,
            vertex_color: vertex_color(self.mesh, point.at.index(), inside),
            eye: None,
            time: self.time,
            filtering: Filtering::Area,
        }
    }

    /// Derivatives of the normalised blend of the corners' normals.
    fn normal_steps(&self, point: &TexelPoint) -> [Vec3; 2] {
        let corners = point.at.corner_values(&self.normals);
        let length = point.at.interpolate(corners).length().max(1e-3);
        point.lambda_steps.map(|step| {
            let change = interpolate(corners, step) / length;
            change - point.normal * point.normal.dot(change)
        })
    }
}

fn uv_point(set: &[Vec2], point: &TexelPoint) -> UvPoint {
    let corners = set.get(3 * point.at.index()..).and_then(|rest| rest.first_chunk::<3>());
    corners.map_or_else(UvPoint::default, |&corners| UvPoint {
        uv: point.at.interpolate(corners),
        steps: point.lambda_steps.map(|step| interpolate(corners, step)),
    })
}

// Normals bent by relief, over a texel.

/// A material's relief and the frames that it is relative to.
struct Reliefs<'a> {
    relief: &'a [Relief],
    tangents: &'a LookTangents<'a>,
    normals: &'a [Vec3],
    /// World units.
    min_step: f32,
}

impl Reliefs<'_> {
    /// The unit normal after all relief. `ask` answers for the point.
    fn bend(&self, point: &TexelPoint, at: &ShadingPoint<'_>, ask: &Ask<'_>) -> Vec3 {
        self.relief.iter().fold(at.normal, |normal, relief| {
            let by_gradient = |gradient: Vec3| (normal - gradient).try_normalize();
            let axes = || GradientAxes::new(at.position_steps, normal);
            let bent = match relief {
                Relief::Bump { texture, height, difference } => axes().and_then(|axes| {
                    // Neighbouring texels' heights; farther where that would be below the digits, or within a texel of the height's.
                    let texel = texture.edges_per_texel(at).unwrap_or([0.0; 2]);
                    let step = |k: usize| {
                        let length = at.position_steps[k].length().max(f32::MIN_POSITIVE);
                        (self.min_step / length).max(texel[k]).clamp(1.0, 1e6)
                    };
                    let height_at = |offset: Vec2| ask(&**texture, offset).x;
                    let change = height_change(*difference, [step(0), step(1)], height_at);
                    by_gradient(axes.gradient(change * *height))
                }),
                Relief::Derivatives { texture, uv_set, height, range } => {
                    let texel = ask(&**texture, Vec2::ZERO);
                    let uv = at.uv.get(*uv_set);
                    axes()
                        .zip(uv)
                        .and_then(|(axes, uv)| by_gradient(axes.of_derivatives(texel, uv, height * range)))
                }
                Relief::Normal { texture, scale, space } => {
                    let texel = ask(&**texture, Vec2::ZERO).truncate() * 2.0 - 1.0;
                    match self.frame(*space, point) {
                        Some(frame) => normal_by_map(normal, point.normal, texel, *scale, frame.as_ref()),
                        None => None,
                    }
                }
            };
            bent.unwrap_or(normal)
        })
    }

    /// The frame of a normal map, none for one in the model's axes; `None` where its texture coordinates are missing.
    fn frame(&self, space: NormalSpace, point: &TexelPoint) -> Option<Option<TangentFrame>> {
        let NormalSpace::Tangent(space) = space else { return Some(None) };
        let lambda = point.at.lambda.clamp(Vec3::ZERO, Vec3::ONE);
        self.tangents.frame(&space, self.normals, point.at.index(), lambda).map(Some)
    }
}

// Textures asked once for many texels.

/// The value of a texture at the point in question, moved by so many of the texel's edges.
type Ask<'a> = dyn Fn(&dyn Texture, Vec2) -> Vec4 + 'a;

fn ask_at(at: &ShadingPoint<'_>, texture: &dyn Texture, offset: Vec2) -> Vec4 {
    if offset == Vec2::ZERO {
        return texture.evaluate(at);
    }
    at.shifted(offset.x, offset.y, |there| texture.evaluate(there))
}

/// What textures answer at many points. Each is asked at all of them as soon as it is asked at one; the texels have the same material,
/// so that is what will be wanted.
struct Answers<'a> {
    at: &'a [ShadingPoint<'a>],
    columns: RefCell<Vec<Column>>,
}

struct Column {
    /// Where the texture lies in memory tells it from others.
    texture: *const (),
    offset: Vec2,
    values: Vec<Vec4>,
}

impl<'a> Answers<'a> {
    pub(crate) fn new(at: &'a [ShadingPoint<'a>]) -> Self {
        Self { at, columns: RefCell::default() }
    }

    fn ask(&self, index: usize, texture: &dyn Texture, offset: Vec2) -> Vec4 {
        // Several uses of one texture ask it once.
        if let Some(texture_use) = texture.as_use() {
            return texture_use.of(self.ask(index, &*texture_use.texture, offset));
        }
        let address = std::ptr::from_ref(texture).cast::<()>();
        let mut columns = self.columns.borrow_mut();
        let known = columns.iter().position(|c| c.texture == address && c.offset == offset);
        let column = known.unwrap_or_else(|| {
            columns.push(Column { texture: address, offset, values: self.values(texture, offset) });
            columns.len() - 1
        });
        columns[column].values[index]
    }

    fn values(&self, texture: &dyn Texture, offset: Vec2) -> Vec<Vec4> {
        let mut values = vec![Vec4::ZERO; self.at.len()];
        if offset == Vec2::ZERO {
            texture.evaluate_all(self.at, &mut values);
        } else {
            texture.evaluate_all(&self.moved(offset, &mut Vec::new()), &mut values);
        }
        values
    }

    /// The points moved by so many of their texels' edges; their texture coordinates lie in `uv`.
    fn moved<'u>(&self, offset: Vec2, uv: &'u mut Vec<UvPoint>) -> Vec<ShadingPoint<'u>> {
        let Some(sets) = self.at.first().map(|at| at.uv.len()) else { return Vec::new() };
        let mut places = Vec::with_capacity(self.at.len());
        for at in self.at {
            at.shifted(offset.x, offset.y, |there| {
                uv.extend_from_slice(there.uv);
                places.push((there.position, there.normal));
            });
        }
        let uv: &'u [UvPoint] = uv;
        let moved = self.at.iter().zip(places).enumerate().map(|(index, (at, (position, normal)))| {
            let uv = &uv[index * sets..(index + 1) * sets];
            // Bakes have no eye.
            ShadingPoint { position, normal, uv, eye: None, ..*at }
        });
        moved.collect()
    }
}
