//! What is baked: functions of a surface point and a texel's footprint.

use fantex_base::{Error, Result};
use fantex_mesh::{Mesh, ObjectSpace, SurfacePoint, interpolate};
use fantex_store::{ChannelKind, Damage};
use fantex_texture::{AnyMapping, ImageTexture, Solid, SolidPoint, Wrap};
use glam::{Vec3, Vec4};

use crate::LightMapSource;
use crate::light::unwatched;

/// A point of the surface and the texel around it.
#[derive(Clone, Copy, Debug)]
pub struct TexelPoint {
    /// The point; barycentric coordinates are slightly outside 0..1 for texels off the surface.
    pub at: SurfacePoint,
    /// Change of the barycentric coordinates along the texel's width and height.
    pub lambda_steps: [Vec3; 2],
    /// Mesh space.
    pub position: Vec3,
    /// Change of `position` along the texel's width and height, mesh space.
    pub position_steps: [Vec3; 2],
    /// Unit vertex normal, interpolated, mesh space.
    pub normal: Vec3,
}

/// What a source gives for one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceChannel {
    /// The channel. Normals are given as unit vectors in mesh space (xyz), all others as linear RGBA.
    pub kind: ChannelKind,
    /// True where alpha carries information: it is coverage, and colours count in proportion to it when they are averaged.
    pub has_alpha: bool,
    /// True where values exceed 1, which 8-bit formats cannot hold.
    pub exceeds_one: bool,
}

impl SourceChannel {
    /// Without alpha, up to 1.
    pub const fn new(kind: ChannelKind) -> Self {
        Self { kind, has_alpha: false, exceeds_one: false }
    }
}

/// How a value relates to the function at the texel's centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Prefilter {
    /// The value at the point: the function has no detail finer than a texel.
    Point,
    /// The mean over the texel's footprint.
    Box,
}

impl Prefilter {
    /// The share of its second differences that a texel is moved against, so that bilinear look-ups read the function instead of a blurred
    /// copy: the second-order form of the inverse of the linear spline's autocorrelation (M. Unser, "Splines: A Perfect Fit for Signal
    /// and Image Processing", 1999).
    pub fn sharpening(self) -> f32 {
        match self {
            Self::Point => 1.0 / 12.0,
            Self::Box => 1.0 / 8.0,
        }
    }
}

/// A function on the surface that can be baked.
pub trait Source: Sync {
    /// The channels it gives, in the order of `evaluate`'s output: base colour alone, unless the source says more.
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel::new(ChannelKind::BaseColor)]
    }

    /// How its values relate to the texel's centre.
    fn prefilter(&self) -> Prefilter {
        Prefilter::Box
    }

    /// Whether it gives normals that do not follow the creases of the mesh that is baked, such as those of a smoother mesh. They
    /// are then stored relative to normals without creases, which become those of the asset's mesh.
    fn crosses_creases(&self) -> bool {
        false
    }

    /// Whether its values jump where the mesh has creases, as light does: covers for it are
    /// [cut there](fantex_cover::CoverOptions::cut_creases).
    fn jumps_at_creases(&self) -> bool {
        false
    }

    /// Whether the alpha of cut-outs is the share of the texel that is there, and not a number to be compared with their threshold.
    fn has_shares(&self) -> bool {
        false
    }

    /// Whether a point may take milliseconds, as following rays through crowded places does: bakes then ask between points whether they are
    /// to go on.
    fn has_slow_points(&self) -> bool {
        false
    }

    /// How many points it is asked for at a time, at most: enough for vectors, few enough that they stay in the nearest cache. Sources that take
    /// long for each call say more.
    fn points_at_once(&self) -> usize {
        128
    }

    /// Writes one value per channel. What is not finite is baked as 0.
    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]);

    /// The same at many texels, those of a triangle in a row: writes one value per channel and point, those of a point
    /// together. Sources that can share work between texels override this.
    fn evaluate_all(&self, points: &[TexelPoint], values: &mut [Vec4]) {
        let channels = self.channels().len();
        let values = values.chunks_mut(channels);
        points.iter().zip(values).for_each(|(point, values)| self.evaluate(point, values));
    }

    /// The light that its values are made of. Bakes find that first, take the noise out where that is wanted, and take values from
    /// [`Source::evaluate_lit`].
    fn light_map(&self) -> Option<&LightMapSource<'_>> {
        None
    }

    /// The texels of assets that could not be read so far, so that coarser ones stood in.
    fn damage(&self) -> Damage {
        Damage::default()
    }

    /// As [`Source::evaluate_all`], with the light at each point given (irradiance over pi, linear RGB).
    fn evaluate_lit(&self, points: &[TexelPoint], light: &[Vec3], values: &mut [Vec4]) {
        let _ = light;
        self.evaluate_all(points, values);
    }
}

/// Calls `visit` with the points of each run that `together` accepts, and with their values, `channels` for each point.
pub fn for_each_run(
    points: &[TexelPoint],
    mut values: &mut [Vec4],
    channels: usize,
    together: impl Fn(&TexelPoint, &TexelPoint) -> bool,
    mut visit: impl FnMut(&[TexelPoint], &mut [Vec4]),
) {
    for run in points.chunk_by(together) {
        let (own, rest) = std::mem::take(&mut values).split_at_mut(run.len() * channels);
        visit(run, own);
        values = rest;
    }
}

impl TexelPoint {
    /// How wide the texel is, mesh space.
    pub fn width(&self) -> f32 {
        width(self.position_steps)
    }

    /// Whether both lie on (or beside) the same triangle, so that their steps are equal as well.
    pub fn is_on_triangle_of(&self, other: &Self) -> bool {
        self.at.triangle == other.at.triangle
    }
}

/// The root mean square of a texel's two sides.
fn width([along, across]: [Vec3; 2]) -> f32 {
    (0.5 * (along.length_squared() + across.length_squared())).sqrt()
}

/// A triangle and the plane that continues it: where its texels' points come from.
pub struct TrianglePlane {
    triangle: usize,
    corners: [Vec3; 3],
    /// At the corners.
    normals: [Vec3; 3],
    facet_normal: Vec3,
    lambda_steps: [Vec3; 2],
    position_steps: [Vec3; 2],
}

impl TrianglePlane {
    /// `normals`: unit vectors, of each triangle's corners; none of them: the triangle's own. `lambda_steps` as in [`TexelPoint`].
    pub fn new(mesh: &Mesh, normals: &[Vec3], triangle: usize, lambda_steps: [Vec3; 2]) -> Self {
        let corners @ [a, b, c] = mesh.triangle_positions(triangle);
        let facet_normal = (b - a).cross(c - a).normalize_or(Vec3::Z);
        Self {
            triangle,
            corners,
            normals: [0, 1, 2].map(|k| normals.get(3 * triangle + k).copied().unwrap_or(facet_normal)),
            facet_normal,
            lambda_steps,
            position_steps: lambda_steps.map(|step| interpolate(corners, step)),
        }
    }

    /// The point with these barycentric coordinates.
    #[inline(always)]
    pub fn point(&self, lambda: Vec3) -> TexelPoint {
        let [normal] = self.normals_at(&[lambda]);
        self.point_with(lambda, normal)
    }

    /// The points with these barycentric coordinates: roots and quotients of several at once.
    #[inline(always)]
    pub fn points<'p, const COUNT: usize>(
        &'p self,
        lambda: &'p [Vec3; COUNT],
    ) -> impl Iterator<Item = TexelPoint> + 'p {
        let normals = self.normals_at(lambda);
        lambda.iter().zip(normals).map(|(&lambda, normal)| self.point_with(lambda, normal))
    }

    // Inlined always: what is stored in parts and read as a whole from memory stalls.
    #[inline(always)]
    fn point_with(&self, lambda: Vec3, normal: Vec3) -> TexelPoint {
        TexelPoint {
            at: SurfacePoint { triangle: self.triangle as u32, lambda },
            lambda_steps: self.lambda_steps,
            position: interpolate(self.corners, lambda),
            position_steps: self.position_steps,
            normal,
        }
    }

    #[inline(always)]
    fn normals_at<const COUNT: usize>(&self, lambda: &[Vec3; COUNT]) -> [Vec3; COUNT] {
        let (mut normals, mut scales) = ([Vec3::ZERO; COUNT], [0.0; COUNT]);
        for ((normal, scale), lambda) in normals.iter_mut().zip(&mut scales).zip(lambda) {
            // Off the surface the plane goes on, but a normal must not be extrapolated.
            *normal = interpolate(self.normals, lambda.clamp(Vec3::ZERO, Vec3::ONE));
            *scale = normal.length_squared();
        }
        for scale in &mut scales {
            *scale = scale.sqrt().recip();
        }
        for (normal, &scale) in normals.iter_mut().zip(&scales) {
            let is_usable = scale.is_finite() && scale > 0.0;
            *normal = if is_usable { *normal * scale } else { self.facet_normal };
        }
        normals
    }
}

/// Puts 0 where a value is no number: it would spread to the texels around it and to all coarser levels.
pub fn clear_what_is_no_number(values: &mut [Vec4]) {
    for value in values.iter_mut().filter(|value| !value.is_finite()) {
        *value = Vec4::from_array(value.to_array().map(|x| if x.is_finite() { x } else { 0.0 }));
    }
}

// Vertex colours.

/// The mesh's vertex colours, interpolated over the triangles.
#[derive(Clone, Copy, Debug)]
pub struct VertexColorSource<'a> {
    colors: &'a [Vec4],
    has_alpha: bool,
}

impl<'a> VertexColorSource<'a> {
    /// Takes the mesh's colours.
    ///
    /// # Errors
    /// The mesh has none.
    pub fn new(mesh: &'a Mesh) -> Result<Self> {
        let colors = mesh.corners.colors.as_slice();
        if colors.len() != 3 * mesh.triangles.len() || colors.is_empty() {
            return Err(Error::invalid("the model has no vertex colours; choose another source"));
        }
        Ok(Self { colors, has_alpha: colors.iter().any(|c| c.w < 1.0) })
    }
}

impl Source for VertexColorSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { has_alpha: self.has_alpha, ..SourceChannel::new(ChannelKind::BaseColor) }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let c = &self.colors[3 * point.at.index()..3 * point.at.index() + 3];
        let color = point.at.interpolate([c[0], c[1], c[2]]);
        // Just off the surface the plane of colours goes on, but not beyond the corners' range.
        values[0] = color.clamp(c[0].min(c[1]).min(c[2]), c[0].max(c[1]).max(c[2]));
    }
}

// An image laid over the model by a mapping.

/// An image through a planar, box, cylinder, sphere or triplanar mapping.
pub struct MappedImageSource {
    texture: ImageTexture,
    mapping: AnyMapping,
    wrap: [Wrap; 2],
    space: ObjectSpace,
}

impl MappedImageSource {
    /// `mapping` takes points of [`ObjectSpace`].
    pub fn new(mesh: &Mesh, texture: ImageTexture, mapping: AnyMapping, wrap: [Wrap; 2]) -> Self {
        Self { texture, mapping, wrap, space: ObjectSpace::of(mesh) }
    }
}

impl Source for MappedImageSource {
    fn channels(&self) -> Vec<SourceChannel> {
        let has_alpha = self.texture.level(0).has_alpha();
        vec![SourceChannel { has_alpha, ..SourceChannel::new(ChannelKind::BaseColor) }]
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let p = self.space.point(point.position);
        let steps = point.position_steps.map(|step| self.space.vector(step));
        let color = self.mapping.evaluate(p, point.normal, steps, |uv, footprint| {
            self.texture.sample_area(uv, footprint, self.wrap)
        });
        values[0] = Vec4::from_array(color);
    }
}

// Solid textures.

/// A recipe that is defined everywhere in space, evaluated in object space. Solids fade what is finer than the footprint, as a mean
/// over the texel would.
pub struct SolidSource {
    solid: Box<dyn Solid>,
    space: ObjectSpace,
}

impl SolidSource {
    /// `solid` takes points of [`ObjectSpace`].
    pub fn new(mesh: &Mesh, solid: Box<dyn Solid>) -> Self {
        Self { solid, space: ObjectSpace::of(mesh) }
    }

    /// The footprint of a texel, object space.
    fn footprint(&self, point: &TexelPoint) -> f32 {
        width(point.position_steps.map(|step| self.space.vector(step)))
    }

    #[inline(always)]
    fn solid_point(&self, point: &TexelPoint, footprint: f32) -> SolidPoint {
        SolidPoint { p: self.space.point(point.position), n: point.normal, footprint, time: 0.0 }
    }
}

impl Source for SolidSource {
    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        values[0] = Vec4::from_array(self.solid.color(&self.solid_point(point, self.footprint(point))));
    }

    fn evaluate_all(&self, points: &[TexelPoint], values: &mut [Vec4]) {
        let mut at = Vec::with_capacity(points.len());
        for run in points.chunk_by(TexelPoint::is_on_triangle_of) {
            let footprint = self.footprint(&run[0]);
            at.extend(run.iter().map(|point| self.solid_point(point, footprint)));
        }
        self.solid.colors(&at, bytemuck::cast_slice_mut(values));
    }
}

// A sum of three sine waves: the test function for fidelity.

/// `0.5 + (sin(k x) + sin(k y + 1) + sin(k z + 2)) / 6`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SineSource {
    /// Angular frequency in radians per mesh unit.
    pub k: f32,
}

impl SineSource {
    /// The function's value at a point, mesh space. In double precision: errors of the test function are not to be
    /// counted as errors of the texture.
    pub fn value(&self, p: Vec3) -> f32 {
        let q = p.as_dvec3() * f64::from(self.k);
        (0.5 + (q.x.sin() + (q.y + 1.0).sin() + (q.z + 2.0).sin()) / 6.0) as f32
    }
}

impl Source for SineSource {
    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        values[0] = Vec3::splat(self.value(point.position)).extend(1.0);
    }
}

// The finished picture of a surface: its light, multiplied with its colour.

/// Light as base colour, with the colour and the alpha of another source, or alone.
pub struct LitSource<'a> {
    light: LightMapSource<'a>,
    colors: Option<SurfaceColors<'a>>,
    exceeds_one: bool,
}

/// A source, and where its base colour and emission are among its channels.
pub(crate) struct SurfaceColors<'a> {
    source: &'a dyn Source,
    channels: usize,
    pub(crate) base_color: Option<usize>,
    pub(crate) emission: Option<usize>,
    pub(crate) has_alpha: bool,
    /// Of the base colour or the emission.
    exceeds_one: bool,
}

impl<'a> SurfaceColors<'a> {
    pub(crate) fn new(source: &'a dyn Source) -> Self {
        let channels = source.channels();
        let position = |kind: ChannelKind| channels.iter().position(|c| c.kind == kind);
        let (base_color, emission) = (position(ChannelKind::BaseColor), position(ChannelKind::Emission));
        let has_alpha = base_color.is_some_and(|c| channels[c].has_alpha);
        let exceeds_one = [base_color, emission].into_iter().flatten().any(|c| channels[c].exceeds_one);
        Self { source, channels: channels.len(), base_color, emission, has_alpha, exceeds_one }
    }

    /// As [`Source::has_shares`].
    pub(crate) fn has_shares(&self) -> bool {
        self.source.has_shares()
    }

    /// The values of all channels.
    pub(crate) fn values(&self, point: &TexelPoint) -> Vec<Vec4> {
        let mut values = vec![Vec4::ZERO; self.channels];
        self.source.evaluate(point, &mut values);
        values
    }
}

impl std::fmt::Debug for LitSource<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LitSource").field("light", &self.light).finish_non_exhaustive()
    }
}

impl<'a> LitSource<'a> {
    /// The light, and what it falls on: without a source, or with one that has no base colour, the light alone.
    pub fn new(light: LightMapSource<'a>, source: Option<&'a dyn Source>) -> Self {
        let colors = source.map(SurfaceColors::new).filter(|colors| colors.base_color.is_some());
        let exceeds_one = colors.as_ref().is_some_and(|colors| colors.exceeds_one);
        // Rounding of white under white light is no glare.
        let exceeds_one = exceeds_one || light.brightest() > 1.001;
        Self { light, colors, exceeds_one }
    }
}

impl Source for LitSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        let has_alpha = self.colors.as_ref().is_some_and(|colors| colors.has_alpha);
        vec![SourceChannel { kind: ChannelKind::BaseColor, has_alpha, exceeds_one: self.exceeds_one }]
    }

    fn jumps_at_creases(&self) -> bool {
        true
    }

    fn has_shares(&self) -> bool {
        self.colors.as_ref().is_some_and(SurfaceColors::has_shares)
    }

    fn damage(&self) -> Damage {
        self.colors.as_ref().map_or_else(Damage::default, |colors| colors.source.damage())
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let Ok(light) = self.light.noisy(point, unwatched);
        self.evaluate_lit(std::slice::from_ref(point), &[light.unwrap_or_default()], values);
    }

    fn light_map(&self) -> Option<&LightMapSource<'_>> {
        Some(&self.light)
    }

    fn evaluate_lit(&self, points: &[TexelPoint], light: &[Vec3], values: &mut [Vec4]) {
        for ((point, &light), value) in points.iter().zip(light).zip(values) {
            let (color, emission) = self.colors.as_ref().map_or((Vec4::ONE, Vec3::ZERO), |colors| {
                let all = colors.values(point);
                let emission = colors.emission.map_or(Vec3::ZERO, |c| all[c].truncate());
                (colors.base_color.map_or(Vec4::ONE, |c| all[c]), emission)
            });
            *value = (color.truncate() * light + emission).extend(color.w);
        }
    }
}
