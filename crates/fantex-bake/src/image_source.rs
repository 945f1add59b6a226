//! The model's own textures, through its own texture coordinates: all material channels at once.

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_mesh::{AlphaMode, Material, Mesh, interpolate, shading_normals};
use fantex_store::ChannelKind;
use fantex_texture::material::{
    ImageSlots, MaterialTextures, TangentFrame, TextureLayer, base_color, emission, normal_map_tangents,
    occlusion_roughness_metallic, vertex_color,
};
use fantex_texture::{AREAS_AT_ONCE, AreaSampler, Areas, ImageTexture};
use glam::{Vec2, Vec3, Vec4};

use crate::{Source, SourceChannel, TexelPoint, for_each_run};

#[derive(Debug)]
pub(crate) struct ImageSource<'a> {
    mesh: &'a Mesh,
    materials: Vec<MaterialTextures>,
    tangents: Vec<Vec4>,
    normals: Vec<Vec3>,
    kinds: Vec<ChannelKind>,
    has_alpha: bool,
}

impl<'a> ImageSource<'a> {
    /// `materials`: the decoded images, an entry per material.
    pub(crate) fn new(mesh: &'a Mesh, materials: Vec<MaterialTextures>) -> Self {
        let has_normal_maps = materials.iter().any(|m| m.normal.is_some());
        let normals = if has_normal_maps { shading_normals(mesh) } else { Vec::new() };
        let tangents = normal_map_tangents(mesh, &normals, &materials);
        let kinds = channel_kinds(mesh, &materials);
        let has_alpha = mesh.materials.iter().any(|m| m.alpha != AlphaMode::Opaque);
        Self { mesh, materials, tangents, normals, kinds, has_alpha }
    }

    pub(crate) fn tangents(&self) -> &[Vec4] {
        &self.tangents
    }

    pub(crate) fn has_textures(&self) -> bool {
        self.materials.iter().any(|m| m.layers().next().is_some())
    }

    /// How many materials have an image whose texels are to appear as squares, more than one of them on a triangle. (Of a palette each
    /// triangle shows one.)
    pub(crate) fn square_texel_materials(&self) -> usize {
        let mut shows_squares = vec![false; self.materials.len()];
        for triangle in 0..self.mesh.triangles.len() {
            let material = self.mesh.material_of(triangle);
            let crosses = |layer: &TextureLayer| layer.nearest && self.crosses_texels(layer, triangle);
            shows_squares[material] =
                shows_squares[material] || self.materials[material].layers().any(crosses);
        }
        shows_squares.into_iter().filter(|&shows| shows).count()
    }

    /// Whether an edge between texels of a layer may lie within a triangle.
    fn crosses_texels(&self, layer: &TextureLayer, triangle: usize) -> bool {
        let size = layer.texture.size();
        let [a, b, c] =
            layer.corner_uv(self.mesh, triangle).map(|uv| uv * Vec2::from(size.map(|n| n as f32)));
        let first = a.min(b).min(c) + ON_EDGE;
        let last = a.max(b).max(c) - ON_EDGE;
        size != [1, 1] && first.floor().cmplt(last.floor()).any()
    }

    /// Texels of the finest texture per mesh unit, for each triangle: what a bake needs to lose nothing. Triangles without
    /// texture, with degenerate coordinates, or too slender to show any take the mean of the others, by area. Those that show a point of
    /// a palette get what crisp borders between its colours need.
    pub(crate) fn density(&self) -> Vec<f32> {
        let mut densities: Vec<f32> =
            (0..self.mesh.triangles.len()).map(|t| self.triangle_density(t)).collect();
        let (mut texels, mut area) = (0.0, 0.0);
        for (triangle, &density) in densities.iter().enumerate().filter(|(_, d)| **d > 0.0) {
            let [a, b, c] = self.mesh.triangle_positions(triangle);
            let of_triangle = f64::from((b - a).cross(c - a).length());
            texels += of_triangle * f64::from(density).powi(2);
            area += of_triangle;
        }
        let mean = if area > 0.0 { (texels / area).sqrt() as f32 } else { NO_IMAGE_DENSITY };
        // A sliver in the atlas can have any density; sixteen times the mean linear one is no intention.
        densities
            .iter_mut()
            .for_each(|d| *d = if *d > 0.0 { d.clamp(mean / 16.0, mean * 16.0) } else { mean });
        let of_points = (PALETTE_TEXELS / self.mesh.area()).sqrt() as f32;
        for (triangle, density) in densities.iter_mut().enumerate() {
            if *density < of_points && self.shows_a_point(triangle) {
                *density = of_points;
            }
        }
        densities
    }

    /// Whether so little of its images lies on a triangle that this says nothing about how many texels it needs.
    fn shows_a_point(&self, triangle: usize) -> bool {
        let textures = &self.materials[self.mesh.material_of(triangle)];
        let shown = textures.layers().map(|layer| self.texel_area(layer, triangle)).reduce(f32::max);
        shown.is_some_and(|shown| shown < 2.0 * POINT_TEXELS)
    }

    /// Twice the area of a triangle on an image, in its texels.
    fn texel_area(&self, layer: &TextureLayer, triangle: usize) -> f32 {
        let [ta, tb, tc] = layer.corner_uv(self.mesh, triangle);
        let [width, height] = layer.texture.size().map(|n| n as f32);
        ((tb - ta).perp_dot(tc - ta) * width * height).abs()
    }

    /// Texels of the largest image of each material; an image that several materials share counts once.
    pub(crate) fn image_texels(&self) -> u64 {
        let texels = |layer: &TextureLayer| layer.texture.size().map(u64::from).into_iter().product::<u64>();
        let largest = self.materials.iter().filter_map(|m| m.layers().max_by_key(|&layer| texels(layer)));
        let images: BTreeMap<*const ImageTexture, u64> =
            largest.map(|layer| (Arc::as_ptr(&layer.texture), texels(layer))).collect();
        images.values().sum()
    }

    fn triangle_density(&self, triangle: usize) -> f32 {
        let [a, b, c] = self.mesh.triangle_positions(triangle);
        let area = (b - a).cross(c - a).length();
        let longest2 = [b - a, c - b, a - c].map(Vec3::length_squared).into_iter().fold(0.0, f32::max);
        if area < MIN_SLENDERNESS * longest2 {
            return 0.0;
        }
        let textures = &self.materials[self.mesh.material_of(triangle)];
        let finest = textures.layers().map(|layer| self.texel_area(layer, triangle)).fold(0.0, f32::max);
        let density = (finest / area).sqrt();
        if density.is_finite() { density } else { 0.0 }
    }

    /// A layer's look-ups on the triangle of a texel; `None` without texture.
    fn sampler<'s>(&self, layer: &'s Option<TextureLayer>, on: &TexelPoint) -> Option<LayerSampler<'s>> {
        let layer = layer.as_ref()?;
        let corners = layer.corner_uv(self.mesh, on.at.index());
        let edges = on.lambda_steps.map(|step| interpolate(corners, step));
        let smooth = (!layer.nearest).then(|| layer.texture.area_sampler(edges, layer.wrap));
        Some(LayerSampler { layer, corners, edges, smooth, follows: false })
    }
}

/// Texels per mesh unit where no image says.
pub(crate) const NO_IMAGE_DENSITY: f32 = 256.0;

/// A triangle that shows less of its images, in texels, shows a point of them: what is left of its area comes of rounded coordinates, or of
/// patches of a palette that are shown nearly whole by thousands of triangles.
const POINT_TEXELS: f32 = 1.0 / 16.0;

/// Texels of a whole model at the density of triangles that show a point each: those of an image of 512 x 512, for borders between colours that
/// look crisp where the model fills a picture of that size.
const PALETTE_TEXELS: f64 = (1 << 18) as f64;

/// What lies so near to an edge between texels lies on it, in texels.
const ON_EDGE: f32 = 0.01;

/// Height of a triangle as a share of its longest side below which it shows no texture: the pole of a sphere whose vertices lie
/// beside each other by rounding errors has such triangles, with whole stripes of the image on them.
const MIN_SLENDERNESS: f32 = 1e-5;

struct LayerSampler<'s> {
    layer: &'s TextureLayer,
    corners: [Vec2; 3],
    /// Change of the coordinates along a texel's width and height.
    edges: [Vec2; 2],
    /// `None` where texels are to appear as squares.
    smooth: Option<AreaSampler<'s>>,
    /// Whether the areas of the triangle's first smooth layer serve this one, too.
    follows: bool,
}

/// What a layer gives for points that are looked up at once.
type Means = [[f32; 4]; AREAS_AT_ONCE];

impl LayerSampler<'_> {
    fn means(&self, points: &[TexelPoint], shared: Option<&Areas>) -> Means {
        let mut means = [[1.0; 4]; AREAS_AT_ONCE];
        let out = &mut means[..points.len()];
        match (&self.smooth, shared) {
            (Some(sampler), Some(areas)) if self.follows => sampler.sample_areas(areas, out),
            (Some(sampler), _) => sampler.sample_areas(&areas_around(sampler, self.corners, points), out),
            (None, _) => {
                for (out, point) in out.iter_mut().zip(points) {
                    let (uv, layer) = (interpolate(self.corners, point.at.lambda), self.layer);
                    *out = layer.texture.sample_area_nearest(uv, self.edges, layer.wrap);
                }
            }
        }
        means
    }
}

fn areas_around(sampler: &AreaSampler<'_>, corners: [Vec2; 3], points: &[TexelPoint]) -> Areas {
    let mut coordinates = [Vec2::ZERO; AREAS_AT_ONCE];
    for (uv, point) in coordinates.iter_mut().zip(points) {
        *uv = interpolate(corners, point.at.lambda);
    }
    sampler.areas(&coordinates[..points.len()])
}

/// The layers of a material on one triangle. Most materials look all of them up at the same place of equally large images:
/// the weights of the texels are then worked out once.
struct MaterialSampler<'s> {
    /// No occlusion where it is read with the metallic-roughness texture.
    layers: ImageSlots<Option<LayerSampler<'s>>>,
    /// The first smooth layer, and its coordinates at the corners.
    first: Option<(AreaSampler<'s>, [Vec2; 3])>,
}

impl<'s> MaterialSampler<'s> {
    fn new(layers: ImageSlots<Option<LayerSampler<'s>>>) -> Self {
        let first = layers.layers().find_map(|layer| Some((layer.smooth?, layer.corners)));
        let follows = |layer: &LayerSampler<'_>| {
            let (sampler, corners) = first.as_ref()?;
            Some(layer.corners == *corners && layer.smooth?.shares_areas_with(sampler))
        };
        let marked =
            |layer: LayerSampler<'s>| LayerSampler { follows: follows(&layer) == Some(true), ..layer };
        Self { layers: layers.map(|layer| layer.map(marked)), first }
    }

    fn means(&self, points: &[TexelPoint]) -> MaterialMeans {
        let areas = self.first.as_ref().map(|(sampler, corners)| areas_around(sampler, *corners, points));
        self.layers.each_ref().map(|layer| Some(layer.as_ref()?.means(points, areas.as_ref())))
    }
}

type MaterialMeans = ImageSlots<Option<Means>>;

/// White without texture.
fn or_white(means: &Option<Means>, index: usize) -> Vec4 {
    means.as_ref().map_or(Vec4::ONE, |means| Vec4::from_array(means[index]))
}

fn is_same_look_up(a: &Option<TextureLayer>, b: &Option<TextureLayer>) -> bool {
    let (Some(a), Some(b)) = (a, b) else { return false };
    Arc::ptr_eq(&a.texture, &b.texture)
        && (a.uv_set, a.uv_transform, a.wrap, a.nearest) == (b.uv_set, b.uv_transform, b.wrap, b.nearest)
}

/// Off the surface, what is interpolated between corners must not be extrapolated.
fn lambda_on_triangle(point: &TexelPoint) -> Vec3 {
    point.at.lambda.clamp(Vec3::ZERO, Vec3::ONE)
}

impl Source for ImageSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        let has_alpha = |kind| kind == ChannelKind::BaseColor && self.has_alpha;
        let glows = self.mesh.materials.iter().any(|m| m.emission.max_element() > 1.0);
        let channel = |&kind| SourceChannel {
            kind,
            has_alpha: has_alpha(kind),
            exceeds_one: kind == ChannelKind::Emission && glows,
        };
        self.kinds.iter().map(channel).collect()
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        self.evaluate_all(std::slice::from_ref(point), values);
    }

    fn evaluate_all(&self, points: &[TexelPoint], values: &mut [Vec4]) {
        let together = TexelPoint::is_on_triangle_of;
        for_each_run(points, values, self.kinds.len(), together, |points, values| {
            self.on_triangle(points, values);
        });
    }
}

impl ImageSource<'_> {
    /// The values at texels of one triangle.
    fn on_triangle(&self, points: &[TexelPoint], values: &mut [Vec4]) {
        let on = points[0];
        let triangle = on.at.index();
        let index = self.mesh.material_of(triangle);
        let (material, textures) = (&self.mesh.materials[index], &self.materials[index]);
        let wanted = |kind| self.kinds.contains(&kind);
        let packed = is_same_look_up(&textures.metallic_roughness, &textures.occlusion);
        let occlusion = if packed { &None } else { &textures.occlusion };
        let emission_layer = if wanted(ChannelKind::Emission) { &textures.emission } else { &None };
        let textures = ImageSlots { occlusion, emission: emission_layer, ..textures.each_ref() };
        let layers = MaterialSampler::new(textures.map(|layer| self.sampler(layer, &on)));
        let at = |point: &TexelPoint, means: &MaterialMeans, index: usize, values: &mut [Vec4]| {
            for (kind, value) in self.kinds.iter().zip(values) {
                *value = match kind {
                    ChannelKind::BaseColor => {
                        let vertex_color = vertex_color(self.mesh, triangle, lambda_on_triangle(point));
                        let color = base_color(material, vertex_color, or_white(&means.base_color, index));
                        // Opaque materials ignore alpha.
                        if material.alpha == AlphaMode::Opaque { color.with_w(1.0) } else { color }
                    }
                    ChannelKind::Normal => {
                        let bent = means.normal.as_ref().and_then(|bends| {
                            let lambda = lambda_on_triangle(point);
                            let frame = TangentFrame::at(&self.normals, &self.tangents, triangle, lambda);
                            frame.bend(material, Vec4::from_array(bends[index]))
                        });
                        bent.unwrap_or(point.normal).extend(0.0)
                    }
                    ChannelKind::OcclusionRoughnessMetallic => {
                        let surface = or_white(&means.metallic_roughness, index);
                        let occlusion = if packed { surface } else { or_white(&means.occlusion, index) };
                        occlusion_roughness_metallic(material, occlusion, surface).extend(1.0)
                    }
                    ChannelKind::Emission => emission(material, or_white(&means.emission, index)).extend(1.0),
                    ChannelKind::Displacement | ChannelKind::Light | ChannelKind::Anisotropy => Vec4::ZERO,
                };
            }
        };
        let channels = self.kinds.len();
        let blocks = points.chunks(AREAS_AT_ONCE).zip(values.chunks_mut(AREAS_AT_ONCE * channels));
        for (points, values) in blocks {
            let means = layers.means(points);
            for (index, (point, values)) in points.iter().zip(values.chunks_mut(channels)).enumerate() {
                at(point, &means, index, values);
            }
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
