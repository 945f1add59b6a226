//! What a surface tells the renderer about its points.

use fantex_mesh::{AlphaMode, CornerNormals, Material, Mesh, SurfacePoint};
use glam::Vec3;

use crate::{Finish, Hit};

/// Whether what lies behind a triangle may show through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Coverage {
    /// Hides everything behind it; [`MaterialSample::alpha`] is ignored.
    #[default]
    Opaque,
    /// Cut-outs and transparency: composited back to front with [`MaterialSample::alpha`].
    Layered,
}

impl Coverage {
    /// What a material asks for.
    pub fn of(material: &Material) -> Self {
        if material.alpha == AlphaMode::Opaque { Self::Opaque } else { Self::Layered }
    }
}

/// Opacity as a material means it; `alpha_at` gives alpha at other points of the triangle's plane.
pub(crate) fn opacity(mode: AlphaMode, alpha: f32, hit: &Hit, alpha_at: impl Fn(SurfacePoint) -> f32) -> f32 {
    match mode {
        AlphaMode::Opaque => 1.0,
        AlphaMode::Mask(threshold) => cut_out_share(threshold, alpha, hit, alpha_at),
        AlphaMode::Blend => alpha.clamp(0.0, 1.0),
    }
}

/// Alpha that is so near to 0 or 1, half a step of 8 bits, lies inside, where no slope is asked for.
const INSIDE: f32 = 0.5 / 255.0;

/// The share of the pixel whose alpha reaches the threshold, were alpha a ramp as steep as it is here along both sides of the pixel. All or
/// nothing, edges would be as jagged as a picture of one sample per pixel.
fn cut_out_share(threshold: f32, alpha: f32, hit: &Hit, alpha_at: impl Fn(SurfacePoint) -> f32) -> f32 {
    let all_or_nothing = f32::from(u8::from(alpha >= threshold));
    if threshold <= 0.0 || alpha <= INSIDE || alpha >= 1.0 - INSIDE {
        return all_or_nothing;
    }
    let change = |step: Vec3| {
        let part = (NEARBY / step.abs().max_element()).min(1.0);
        let there = SurfacePoint { lambda: hit.at.lambda + step * part, ..hit.at };
        (alpha_at(there) - alpha).abs() / part
    };
    let [x, y] = hit.lambda_steps.map(change);
    let share = half_plane_share(alpha - threshold, x.max(y), x.min(y));
    if share.is_nan() { all_or_nothing } else { share }
}

/// The share of a square where a ramp is positive that is `over` in its middle and changes by `most` along its one side and by `least` along
/// the other.
fn half_plane_share(over: f32, most: f32, least: f32) -> f32 {
    let beyond = 0.5 * (most + least) - over.abs();
    let smaller = match beyond {
        beyond if beyond <= 0.0 => 0.0,
        beyond if beyond < least => beyond * beyond / (2.0 * most * least),
        _ => 0.5 - over.abs() / most,
    };
    if over < 0.0 { smaller } else { 1.0 - smaller }
}

/// The material at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaterialSample {
    /// Linear RGB.
    pub base_color: Vec3,
    /// Opacity, 0..1, the cut-out threshold already applied.
    pub alpha: f32,
    /// Unit shading normal on the side that the eye sees, mesh space (whose directions are the world's).
    pub normal: Vec3,
    /// Change of `normal` along the pixel's edges; zero where it is not known. It is the footprint of mirrored
    /// surroundings.
    pub normal_steps: [Vec3; 2],
    /// Share of the surroundings' light that reaches the point, 0..1.
    pub occlusion: f32,
    /// Perceptual roughness, 0..1.
    pub roughness: f32,
    /// 0..1.
    pub metallic: f32,
    /// Emitted linear RGB.
    pub emission: Vec3,
    /// Linear RGB that is added to the lit colour: light of an environment that only this object mirrors. It is not emitted, so
    /// it has no halo.
    pub mirrored: Vec3,
    /// True where the base colour is the picture, without light, also emitted one.
    pub unlit: bool,
    /// Filtered look-ups (of one image, or of one channel in one group's tile) that it took.
    pub lookups: u32,
}

impl MaterialSample {
    /// A white, opaque, rough dielectric.
    pub fn with_normal(normal: Vec3) -> Self {
        Self {
            base_color: Vec3::ONE,
            alpha: 1.0,
            normal,
            normal_steps: [Vec3::ZERO; 2],
            occlusion: 1.0,
            roughness: 0.9,
            metallic: 0.0,
            emission: Vec3::ZERO,
            mirrored: Vec3::ZERO,
            unlit: false,
            lookups: 0,
        }
    }

    /// Light that is there without lamps and surroundings, linear RGB.
    pub(crate) fn own_light(&self) -> Vec3 {
        if self.unlit { self.mirrored } else { self.emission + self.mirrored }
    }
}

/// Roughness below which mirror images are so sharp that the change of a bent normal over the pixel matters.
const SHINY: f32 = 0.3;

/// Share of a triangle up to which its plane is continued beyond its border.
const NEARBY: f32 = 0.5;

/// The change of the bent `normal` of a shiny surface's front to the next pixels, on the side that the eye sees; `at` gives the
/// normal there. None where it does not matter, or the next pixels lie far beyond the triangle.
pub(crate) fn bent_steps(
    hit: &Hit,
    roughness: f32,
    normal: Vec3,
    at: impl Fn(&Hit) -> Option<Vec3>,
) -> Option<[Vec3; 2]> {
    let is_nearby = |step: &Vec3| step.abs().max_element() < NEARBY;
    if roughness >= SHINY || !hit.lambda_steps.iter().all(is_nearby) {
        return None;
    }
    let side = if hit.front { 1.0 } else { -1.0 };
    let [x, y] = hit.lambda_steps.map(|step| {
        let at_next = SurfacePoint { lambda: hit.at.lambda + step, ..hit.at };
        Some((at(&Hit { at: at_next, ..*hit })? - normal) * side)
    });
    Some([x?, y?])
}

/// The material at a point, and what it has beyond the core of glTF.
pub type Shaded<'s> = (MaterialSample, Option<Finish<'s>>);

/// Where the surface would be if it were as smooth as its normals say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothPoint {
    /// From the point of the facet to the smooth surface; zero or outwards, mesh space.
    pub offset: Vec3,
    /// Unit normal without relief on the side that the eye sees, mesh space.
    pub normal: Vec3,
}

/// The appearance of a mesh.
pub trait Surface: Sync {
    /// The material at a point, and what it has beyond the core of glTF.
    fn shade(&self, hit: &Hit) -> Shaded<'_>;

    /// [`Surface::shade`] at many points: appends one pair for each. Surfaces that look up many texels at once faster than one
    /// by one override this; the results may differ by what their look-ups differ by.
    fn shade_all<'s>(&'s self, hits: &[Hit], out: &mut Vec<Shaded<'s>>) {
        out.extend(hits.iter().map(|hit| self.shade(hit)));
    }

    /// The opacity at a point: that of [`Surface::shade`].
    fn alpha(&self, hit: &Hit) -> f32 {
        self.shade(hit).0.alpha
    }

    /// Whether a triangle casts shadows. Where a floor casts none, the shadow map of a directional lamp is fitted to what
    /// stands on it.
    fn casts_shadow(&self, triangle: usize) -> bool {
        let _ = triangle;
        true
    }

    /// Where shadows fall, so that smooth shading does not show its facets at the shadow's border; `None` for surfaces
    /// whose facets are meant.
    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        let _ = hit;
        None
    }

    /// Whether a triangle hides what lies behind it.
    fn coverage(&self, triangle: usize) -> Coverage {
        let _ = triangle;
        Coverage::Opaque
    }

    /// Whether a triangle is seen from behind.
    fn is_double_sided(&self, triangle: usize) -> bool {
        let _ = triangle;
        true
    }
}

/// Shading normals as hits ask for them.
pub(crate) trait NormalsOfHits {
    /// The interpolated unit normal on the front side, and its change along the pixel's edges, on the side that the eye sees.
    fn with_steps(&self, mesh: &Mesh, hit: &Hit) -> (Vec3, [Vec3; 2]);

    /// The point lifted to the planes that stand on the normals at the facet's corners (J. Hanika, "Hacking the Shadow
    /// Terminator", 2021), and the normal there, on the side that the eye sees.
    fn smooth_point(&self, mesh: &Mesh, hit: &Hit) -> SmoothPoint;
}

impl NormalsOfHits for CornerNormals {
    #[inline]
    fn with_steps(&self, mesh: &Mesh, hit: &Hit) -> (Vec3, [Vec3; 2]) {
        let (unnormalised, steps) = hit.interpolate(hit.at.corner_values(self));
        let scale = unnormalised.length_recip();
        if !(scale.is_finite() && scale > 0.0) {
            return (hit.at.facet_normal(mesh), [Vec3::ZERO; 2]);
        }
        let normal = unnormalised * scale;
        let scale = if hit.front { scale } else { -scale };
        let along = |step: Vec3| {
            let step = step * scale;
            step - normal * normal.dot(step)
        };
        (normal, [along(steps[0]), along(steps[1])])
    }

    fn smooth_point(&self, mesh: &Mesh, hit: &Hit) -> SmoothPoint {
        let side = if hit.front { 1.0 } else { -1.0 };
        let positions = mesh.triangle_positions(hit.triangle());
        let point = hit.at.interpolate(positions);
        let normals = hit.at.corner_values(self);
        let lift = [0, 1, 2].map(|k| {
            let normal = normals[k] * side;
            normal * (positions[k] - point).dot(normal).max(0.0)
        });
        SmoothPoint { offset: hit.at.interpolate(lift), normal: self.at(mesh, hit.at) * side }
    }
}

// Colours computed from triangle and barycentric coordinates, for pictures that explain.

/// Which normals a [`FlatSurface`] has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FlatShading {
    /// Not lit at all: the colour is the picture.
    #[default]
    Unlit,
    /// Facets.
    Faceted,
    /// The mesh's shading normals.
    Smooth,
}

/// A surface whose linear RGB colour is a function of the hit.
#[derive(Debug)]
pub struct FlatSurface<'a, F> {
    mesh: &'a Mesh,
    normals: Option<CornerNormals>,
    unlit: bool,
    color: F,
}

impl<'a, F: Fn(&Hit) -> Vec3 + Sync> FlatSurface<'a, F> {
    /// Colours `mesh` by `color`.
    pub fn new(mesh: &'a Mesh, shading: FlatShading, color: F) -> Self {
        let normals = (shading == FlatShading::Smooth).then(|| CornerNormals::of(mesh));
        Self { mesh, normals, unlit: shading == FlatShading::Unlit, color }
    }
}

impl<F: Fn(&Hit) -> Vec3 + Sync> Surface for FlatSurface<'_, F> {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        let (normal, normal_steps) = match &self.normals {
            Some(normals) => normals.with_steps(self.mesh, hit),
            None => (hit.at.facet_normal(self.mesh), [Vec3::ZERO; 2]),
        };
        let material = MaterialSample {
            base_color: (self.color)(hit),
            unlit: self.unlit,
            normal_steps,
            ..MaterialSample::with_normal(if hit.front { normal } else { -normal })
        };
        (material, None)
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        self.normals.as_ref().map(|normals| normals.smooth_point(self.mesh, hit))
    }
}
