//! From one mesh to another: what a detailed mesh looks like, baked onto a coarse one.
//!
//! Every point of the coarse mesh looks along its smooth normal, outwards and inwards, for the detailed surface (P. Cignoni,
//! C. Montani, C. Rocchini, R. Scopigno and M. Tarini, "Preserving attribute values on simplified meshes by resampling detail
//! textures", 1999). How far it looks is the *cage*; where nothing is found, the nearest point stands in, and is counted. What faces as the
//! coarse triangle does goes first: beside a crease smooth normals point across it, and a wall must not show the floor.
//! The meshes are brought together by their places in the world.
//!
//! - [`TransferSource`] bakes normals and any [`Source`] of the detailed mesh into fan tiles;
//! - [`bake_normal_map`] makes an ordinary image of normals for a coarse mesh with texture coordinates.

use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

use fantex_base::{Error, Result, counted, input};
use fantex_mesh::{
    Mesh, RayHit, SURFACE_OFFSET, SurfacePoint, TriangleBvh, corner_normals, corner_tangents, lambda_step,
    shading_normals,
};
use fantex_store::{ChannelKind, Damage};
use fantex_texture::Image;
use fantex_texture::material::TangentFrame;
use glam::{DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::charts::{Charts, lambda_at};
use crate::raster::texels_around;
use crate::samples::{cells, mean_of_cells};
use crate::{Source, SourceChannel, TexelPoint};

/// How well two meshes fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TransferReport {
    /// How far points looked for the detailed surface, world units.
    pub cage: f64,
    /// Points of the coarse mesh that were looked up.
    pub points: u64,
    /// Those whose rays found nothing, so that the nearest point stood in.
    pub missed: u64,
    /// Of a normal map: share of what the coarse mesh covers in it, 0..1, that shows texels of other triangles or copies of the map.
    pub shared_share: f64,
}

impl TransferReport {
    /// What should be known of a normal map's texture coordinates, if anything.
    pub fn coordinates_note(&self) -> Option<String> {
        if self.points == 0 {
            let note =
                "its texture coordinates cover the middle of no texel, so the normal map shows nothing";
            return Some(note.to_owned());
        }
        (self.shared_share > MIN_SHARED).then(|| {
            format!(
                "{:.1} % of what its texture coordinates cover belongs to several triangles, or several times to one, and shows the normals of one \
                 place; that is right where the detailed model is alike there",
                100.0 * self.shared_share
            )
        })
    }
}

/// A smaller share of texels that several triangles have is not worth a note.
const MIN_SHARED: f64 = 0.005;

/// Rays along a texel's side at most.
const MAX_SAMPLES: u32 = 64;

fn check_samples(samples: u32) -> Result<()> {
    if (1..=MAX_SAMPLES).contains(&samples) {
        Ok(())
    } else {
        Err(Error::invalid(format!(
            "samples is {samples}, but a texel takes 1 to {MAX_SAMPLES} rays along each side"
        )))
    }
}

// From a point of the coarse mesh to the point of the detailed mesh that it stands for.

/// Points at which the distance of two meshes is measured, on each of them.
const PROBES: usize = 2048;
/// The cage is larger than the largest distance that was measured.
const CAGE_SLACK: f32 = 1.25;
/// Meshes that coincide still get a cage, mesh units.
const MIN_CAGE: f32 = 1e-4;
/// Triangles whose normals have at least this cosine face alike: less than 84 degrees apart.
const MIN_FACING: f32 = 0.1;

struct Projector<'a> {
    coarse: &'a Mesh,
    detailed: &'a Mesh,
    detailed_normals: Vec<Vec3>,
    bvh: TriangleBvh,
    /// Smooth over creases, so that neighbouring rays do not leave gaps.
    ray_normals: Vec<Vec3>,
    /// From coarse to detailed mesh space: `p * scale + offset`; directions are the same.
    scale: f64,
    offset: DVec3,
    /// Detailed mesh units.
    cage: f32,
    points: AtomicU64,
    missed: AtomicU64,
}

impl<'a> Projector<'a> {
    /// `cage` in world units.
    pub(crate) fn new(coarse: &'a Mesh, detailed: &'a Mesh, cage: Option<f64>) -> Result<Self> {
        if let Some(cage) = cage.filter(|c| !(c.is_finite() && *c > 0.0)) {
            return Err(Error::invalid(format!(
                "the cage is {cage} world units, but must be a positive number; leave it out to have it measured"
            )));
        }
        let empty =
            [("coarse", coarse), ("detailed", detailed)].into_iter().find(|m| m.1.triangles.is_empty());
        if let Some((which, _)) = empty {
            return Err(Error::invalid(format!("the {which} mesh has no triangles")));
        }
        let (from, to) = (&coarse.world_from_mesh, &detailed.world_from_mesh);
        let mut projector = Self {
            coarse,
            detailed,
            detailed_normals: shading_normals(detailed),
            bvh: TriangleBvh::new(detailed),
            ray_normals: corner_normals(coarse, 180.0),
            scale: from.scale / to.scale,
            offset: (from.offset - to.offset) / to.scale,
            cage: 0.0,
            points: AtomicU64::new(0),
            missed: AtomicU64::new(0),
        };
        projector.cage = match cage {
            Some(world) => (world / to.scale) as f32,
            None => (CAGE_SLACK * projector.sampled_distance()).max(MIN_CAGE),
        };
        Ok(projector)
    }

    /// The match of a point of a coarse triangle: along the smooth normal, outwards or inwards, whichever is nearer; or else the nearest point.
    /// What faces as the triangle does is looked for in both ways before anything else is taken.
    pub(crate) fn find(&self, at: SurfacePoint) -> SurfacePoint {
        self.points.fetch_add(1, Relaxed);
        let p = self.in_detailed(at.position(self.coarse));
        let normal = at.smooth_normal(&self.ray_normals);
        let facet = at.facet_normal(self.coarse);
        let faces_alike = |[a, b, c]: [Vec3; 3]| {
            let normal = (b - a).cross(c - a);
            normal.dot(facet) > MIN_FACING * normal.length()
        };
        let alike = normal.and_then(|normal| {
            let accept = |point: SurfacePoint| faces_alike(self.detailed.triangle_positions(point.index()));
            self.hit_along(p, normal, accept)
        });
        if let Some(point) = alike {
            return point;
        }
        let any = normal.and_then(|normal| self.hit_along(p, normal, |_| true));
        self.missed.fetch_add(u64::from(any.is_none()), Relaxed);
        let nearest = self.bvh.nearest_point_where(p, self.cage, faces_alike).map(|nearest| nearest.point);
        let nearest = nearest.or(any);
        let nearest =
            nearest.or_else(|| self.bvh.nearest_point(p, f32::INFINITY).map(|nearest| nearest.point));
        // There is none only where the point is no number.
        nearest.unwrap_or(SurfacePoint::corner(0, 0))
    }

    /// The nearest hit that is accepted within the cage, outwards on what is left there, inwards on what is entered.
    fn hit_along(
        &self,
        p: Vec3,
        normal: Vec3,
        accept: impl Fn(SurfacePoint) -> bool,
    ) -> Option<SurfacePoint> {
        let hit = |direction: Vec3, front: bool, reach: f32| {
            // From a little behind, since the surfaces may touch at the point itself.
            let origin = p - direction * SURFACE_OFFSET;
            let is_match = |hit: &RayHit| hit.front == front && accept(hit.point);
            self.bvh.first_hit_where(origin, direction, reach, is_match)
        };
        let reach = self.cage + SURFACE_OFFSET;
        let outwards = hit(normal, false, reach);
        // What is farther inwards is not the nearest.
        let inwards = hit(-normal, true, outwards.as_ref().map_or(reach, |hit| hit.distance));
        let nearest =
            [outwards, inwards].into_iter().flatten().min_by(|a, b| a.distance.total_cmp(&b.distance));
        nearest.map(|hit| hit.point)
    }

    /// Unit shading normal of the detailed mesh; directions are the same in both mesh spaces.
    fn shading_normal(&self, at: SurfacePoint) -> Vec3 {
        at.smooth_normal(&self.detailed_normals).unwrap_or(self.detailed_normals[3 * at.index()])
    }

    fn in_detailed(&self, p: Vec3) -> Vec3 {
        (p.as_dvec3() * self.scale + self.offset).as_vec3()
    }

    fn length_in_detailed(&self) -> f32 {
        self.scale as f32
    }

    pub(crate) fn report(&self) -> TransferReport {
        TransferReport {
            cage: f64::from(self.cage) * self.detailed.world_from_mesh.scale,
            points: self.points.load(Relaxed),
            missed: self.missed.load(Relaxed),
            shared_share: 0.0,
        }
    }

    /// The largest distance, in detailed mesh units, of a point of either mesh to the other, over points spread evenly.
    fn sampled_distance(&self) -> f32 {
        let to_detailed = spread_points(self.coarse).into_iter().filter_map(|p| {
            let nearest = self.bvh.nearest_point(self.in_detailed(p), f32::INFINITY)?;
            Some(nearest.distance)
        });
        let coarse_bvh = TriangleBvh::new(self.coarse);
        let to_coarse = spread_points(self.detailed).into_iter().filter_map(|p| {
            let p = ((p.as_dvec3() - self.offset) / self.scale).as_vec3();
            let nearest = coarse_bvh.nearest_point(p, f32::INFINITY)?;
            Some(nearest.distance * self.length_in_detailed())
        });
        to_detailed.chain(to_coarse).fold(0.0, f32::max)
    }
}

/// `PROBES` points of a mesh, as many per area everywhere (M. Roberts, "The Unreasonable Effectiveness of Quasirandom
/// Sequences", 2018, within triangles).
fn spread_points(mesh: &Mesh) -> Vec<Vec3> {
    let step = mesh.area() / PROBES as f64;
    let mut points = Vec::with_capacity(PROBES);
    // Area up to the next point.
    let mut left = 0.5 * step;
    for triangle in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.triangle_positions(triangle);
        let mut area = 0.5 * f64::from((b - a).cross(c - a).length());
        while area >= left && points.len() < PROBES {
            area -= left;
            left = step;
            let n = points.len() as f64;
            let (mut u, mut v) = ((n * 0.754_877_666_2).fract() as f32, (n * 0.569_840_291_0).fract() as f32);
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            points.push(a + (b - a) * u + (c - a) * v);
        }
        left -= area;
    }
    points
}

// The detailed mesh as a source for the coarse one.

/// How to transfer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransferOptions {
    /// How far the detailed surface is looked for along the normal, world units, positive. Not given: a quarter more than the
    /// largest distance between the meshes at a few thousand points.
    pub cage: Option<f64>,
    /// Rays along each side of a texel, 1 to 64.
    pub samples: u32,
    /// Transfer the shading normal, too.
    pub normals: bool,
}

impl Default for TransferOptions {
    /// Normals, four rays per texel, a measured cage.
    fn default() -> Self {
        Self { cage: None, samples: 2, normals: true }
    }
}

/// What a detailed mesh looks like, as a source for a coarse one: its shading normals, and all channels of any source that
/// is made for the detailed mesh (its textures, vertex colours, a recipe).
pub struct TransferSource<'a> {
    projector: Projector<'a>,
    detail: Option<&'a dyn Source>,
    channels: Vec<SourceChannel>,
    /// Shading normals come as an additional, first channel.
    own_normals: bool,
    samples: u32,
}

impl std::fmt::Debug for TransferSource<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TransferSource").field("channels", &self.channels).finish_non_exhaustive()
    }
}

impl<'a> TransferSource<'a> {
    /// A source for `coarse`. `detail` is a source for `detailed`; if it gives normals, these are taken instead of the
    /// mesh's shading normals.
    ///
    /// # Errors
    /// An option is out of its range, or a mesh is empty.
    pub fn new(
        coarse: &'a Mesh,
        detailed: &'a Mesh,
        detail: Option<&'a dyn Source>,
        options: &TransferOptions,
    ) -> Result<Self> {
        check_samples(options.samples)?;
        let projector = Projector::new(coarse, detailed, options.cage)?;
        let mut channels = detail.map_or_else(Vec::new, Source::channels);
        let own_normals = options.normals && channels.iter().all(|c| c.kind != ChannelKind::Normal);
        if own_normals {
            let normals = SourceChannel::new(ChannelKind::Normal);
            channels.insert(0, normals);
        }
        Ok(Self { projector, detail, channels, own_normals, samples: options.samples })
    }

    /// How well the meshes have fitted so far. It does not depend on the number of threads.
    pub fn report(&self) -> TransferReport {
        self.projector.report()
    }

    /// All channels at one point of the detailed mesh; `steps` are the sides of the area that it stands for, coarse mesh
    /// space.
    fn value_at(&self, at: SurfacePoint, steps: [Vec3; 2], values: &mut [Vec4]) {
        let (first, rest) = values.split_at_mut(usize::from(self.own_normals));
        if let Some(normal) = first.first_mut() {
            *normal = self.projector.shading_normal(at).extend(0.0);
        }
        let Some(detail) = self.detail else { return };
        let corners = self.projector.detailed.triangle_positions(at.index());
        let position_steps = steps.map(|s| s * self.projector.length_in_detailed());
        let point = TexelPoint {
            at,
            lambda_steps: position_steps.map(|s| lambda_step(corners, s)),
            position: at.interpolate(corners),
            position_steps,
            normal: self.projector.shading_normal(at),
        };
        detail.evaluate(&point, rest);
    }
}

impl Source for TransferSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        self.channels.clone()
    }

    fn crosses_creases(&self) -> bool {
        self.channels.iter().any(|channel| channel.kind == ChannelKind::Normal)
    }

    /// Where the detailed mesh has a crease, too, points on either side see what faces as they do, and that jumps. Where it has none, nothing
    /// jumps at the cut, which costs some texels. Normals do not count: they [cross](Source::crosses_creases) creases.
    fn jumps_at_creases(&self) -> bool {
        self.detail.is_some_and(Source::jumps_at_creases)
    }

    fn has_shares(&self) -> bool {
        self.detail.is_some_and(Source::has_shares)
    }

    fn damage(&self) -> Damage {
        self.detail.map_or_else(Damage::default, Source::damage)
    }

    fn has_slow_points(&self) -> bool {
        true
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let share = 1.0 / self.samples as f32;
        let steps = point.position_steps.map(|s| s * share);
        mean_of_cells(self.samples, point, &self.channels, values, |[x, y], values| {
            let lambda = point.at.lambda + point.lambda_steps[0] * x + point.lambda_steps[1] * y;
            // Parts of a texel may lie beside its triangle, which may be a sliver.
            let at = SurfacePoint { lambda, ..point.at }.on_triangle(self.projector.coarse);
            self.value_at(self.projector.find(at), steps, values);
        });
    }
}

// An ordinary normal map: an image over the coarse mesh's texture coordinates.

/// The axes that a normal map's colours are relative to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NormalSpace {
    /// Tangent, bitangent (to the top of the image) and shading normal of the coarse mesh, as glTF has them.
    #[default]
    Tangent,
    /// The axes of the model.
    Object,
}

/// How to bake a normal map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalMapOptions {
    /// Columns and rows, 1 to 8192 each.
    pub size: [u32; 2],
    /// The set of texture coordinates.
    pub uv_set: usize,
    /// What colours are relative to.
    pub space: NormalSpace,
    /// Texels by which the edges of charts are continued, so that filters do not read what lies beside; at most 256.
    pub padding: u32,
    /// Rays along each side of a texel, 1 to 64.
    pub samples: u32,
    /// As [`TransferOptions::cage`](super::TransferOptions::cage).
    pub cage: Option<f64>,
}

impl Default for NormalMapOptions {
    /// Tangent space, 1024 x 1024, 8 texels of padding, four rays per texel, a measured cage.
    fn default() -> Self {
        Self { size: [1024; 2], uv_set: 0, space: NormalSpace::Tangent, padding: 8, samples: 2, cage: None }
    }
}

impl NormalMapOptions {
    /// Refuses what no mesh can be baked with.
    ///
    /// # Errors
    /// An option is out of its range.
    pub fn check(&self) -> Result<()> {
        let [width, height] = self.size;
        if self.size.iter().any(|n| !(1..=MAX_SIDE).contains(n)) {
            return Err(Error::invalid(format!(
                "the size is {width} x {height} texels, but must be 1 to {MAX_SIDE} along each side"
            )));
        }
        if self.padding > MAX_PADDING {
            return Err(Error::invalid(format!(
                "the padding is {} texels, but must be at most {MAX_PADDING}",
                self.padding
            )));
        }
        check_samples(self.samples)
    }
}

const MAX_SIDE: u32 = 8192;
const MAX_PADDING: u32 = 256;
/// Of an image of normals: its triangles, the normals, those that padding adds, and what is returned.
const NORMAL_MAP_TEXEL_BYTES: u64 = 40;

/// Bakes the shading normals of `detailed` into an image over the texture coordinates of `coarse`: linear RGB floats, with
/// -1..1 as 0..1 (convert to the depth that you store).
///
/// A texel belongs to the first triangle that covers its centre; coordinates outside 0..1 wrap, and a triangle may lie over many copies of
/// the image. Tangents are the coarse mesh's own, or those of [`corner_tangents`]. The result does not depend on the number of threads.
///
/// # Errors
/// An option out of range, no such texture coordinates, an empty mesh, or more memory than is allowed.
pub fn bake_normal_map(
    coarse: &Mesh,
    detailed: &Mesh,
    options: &NormalMapOptions,
) -> Result<(Image, TransferReport)> {
    bake_normal_map_until(coarse, detailed, options, &|| false)
}

/// [`bake_normal_map`], until somebody wants to stop, which is asked for each triangle and row of it, each texel and each step of the padding.
///
/// # Errors
/// As there; or it was ended.
pub fn bake_normal_map_until(
    coarse: &Mesh,
    detailed: &Mesh,
    options: &NormalMapOptions,
    is_cancelled: &(dyn Fn() -> bool + Sync),
) -> Result<(Image, TransferReport)> {
    options.check()?;
    let uv = texture_coordinates(coarse, options.uv_set)?;
    let [width, height] = options.size;
    let bytes = u64::from(width) * u64::from(height) * NORMAL_MAP_TEXEL_BYTES;
    let _held = input::reserve(format_args!("a normal map of {width} x {height} texels"), bytes)?;
    let projector = Projector::new(coarse, detailed, options.cage)?;
    let cancelled = || Error::cancelled("the normal map was cancelled");
    let charts = Charts::new(uv, options.size, is_cancelled).ok_or_else(cancelled)?;
    let frames = Frames::new(coarse, uv, options.space);
    let normal_at = |texel: usize| {
        let owner = charts.owner(texel).filter(|_| !is_cancelled())?;
        let normal = |offset: [f32; 2]| {
            let lambda = lambda_at(owner.corners, owner.center + Vec2::from(offset).as_dvec2());
            let lambda = lambda.map_or(Vec3::splat(1.0 / 3.0), |lambda| lambda.as_vec3());
            let at = SurfacePoint { triangle: owner.triangle, lambda }.on_triangle(coarse);
            frames.relative(at, projector.shading_normal(projector.find(at)))
        };
        let sum: Vec3 = cells(options.samples).map(normal).sum();
        Some(sum.try_normalize().unwrap_or(frames.nothing()))
    };
    let mut normals: Vec<Option<Vec3>> =
        (0..charts.texels()).into_par_iter().with_min_len(256).map(normal_at).collect();
    pad(&mut normals, width as usize, options.padding, is_cancelled);
    if is_cancelled() {
        return Err(cancelled());
    }
    let encoded = |n: Option<Vec3>| (n.unwrap_or(frames.nothing()) * 0.5 + 0.5).to_array();
    let samples = normals.into_iter().flat_map(encoded).collect();
    let report = TransferReport { shared_share: charts.shared_share(), ..projector.report() };
    Ok((Image::from_linear(width, height, 3, samples), report))
}

/// A set of texture coordinates, of which there is one per corner.
fn texture_coordinates(coarse: &Mesh, number: usize) -> Result<&[Vec2]> {
    let sets = &coarse.corners.uv_sets;
    let set = sets.get(number).filter(|set| set.len() == 3 * coarse.triangles.len());
    set.map(Vec::as_slice).ok_or_else(|| {
        Error::invalid(format!(
            "the coarse mesh has {} of texture coordinates, but set {number} (from 0) is asked for",
            counted(sets.len(), "set")
        ))
    })
}

/// The axes at every point of the coarse mesh.
enum Frames {
    Tangent { normals: Vec<Vec3>, tangents: Vec<Vec4> },
    Object,
}

impl Frames {
    fn new(mesh: &Mesh, uv: &[Vec2], space: NormalSpace) -> Self {
        if space == NormalSpace::Object {
            return Self::Object;
        }
        let normals = shading_normals(mesh);
        let tangents = match mesh.corners.tangents.len() == 3 * mesh.triangles.len() {
            true => mesh.corners.tangents.clone(),
            false => corner_tangents(mesh, &normals, |t| Some([0, 1, 2].map(|k| uv[3 * t + k]))),
        };
        Self::Tangent { normals, tangents }
    }

    /// A unit normal relative to the axes, of unit length.
    fn relative(&self, at: SurfacePoint, normal: Vec3) -> Vec3 {
        match self {
            Self::Object => normal,
            Self::Tangent { normals, tangents } => {
                TangentFrame::at(normals, tangents, at.index(), at.lambda).relative(normal).unwrap_or(Vec3::Z)
            }
        }
    }

    fn nothing(&self) -> Vec3 {
        match self {
            Self::Object => Vec3::ZERO,
            Self::Tangent { .. } => Vec3::Z,
        }
    }
}

/// Fills what is empty beside what is full, so many texels far: each takes the mean of what was full around it before. Ends early if that is wanted.
fn pad(normals: &mut [Option<Vec3>], width: usize, texels: u32, is_cancelled: &(dyn Fn() -> bool + Sync)) {
    if texels == 0 {
        return;
    }
    let size = [width, normals.len() / width];
    let borders = (0..normals.len() as u32).into_par_iter().with_min_len(1 << 12).filter(|&texel| {
        let full = |around: usize| normals[around].is_some();
        normals[texel as usize].is_none() && texels_around(texel as usize, size).any(full)
    });
    let mut front: Vec<u32> = borders.collect();
    for step in 0..texels {
        if front.is_empty() || is_cancelled() {
            return;
        }
        let mean = |&texel: &u32| {
            let around = texels_around(texel as usize, size).filter_map(|around| normals[around]);
            around.reduce(|a, b| a + b).map(|sum| sum.try_normalize().unwrap_or(sum))
        };
        let means: Vec<Option<Vec3>> = front.par_iter().with_min_len(1 << 10).map(mean).collect();
        for (&texel, mean) in front.iter().zip(means) {
            normals[texel as usize] = mean;
        }
        if step + 1 < texels {
            let beside = front.iter().flat_map(|&texel| texels_around(texel as usize, size));
            let mut next: Vec<u32> =
                beside.filter(|&texel| normals[texel].is_none()).map(|texel| texel as u32).collect();
            next.sort_unstable();
            next.dedup();
            front = next;
        }
    }
}

#[cfg(test)]
mod tests {
    use fantex_base::{Random, ReadLimits, ReadOptions};
    use fantex_mesh::{CleanOptions, clean, generate, interpolate};

    use super::*;

    #[test]
    fn probes_cover_the_surface_evenly() {
        let (mesh, _) = clean(generate::icosphere(3), &CleanOptions::default()).unwrap();
        let points = spread_points(&mesh);
        assert!(points.len().abs_diff(PROBES) <= 1);
        let mean = points.iter().sum::<Vec3>() / points.len() as f32;
        assert!(mean.length() < 0.03, "{mean}");
        assert!(points.iter().all(|p| (0.98..1.001).contains(&p.length())));
    }

    #[test]
    fn the_cage_follows_from_the_distance_of_the_meshes() {
        let sphere = |radius: f64| {
            let mut model = generate::icosphere(4);
            model.positions.iter_mut().for_each(|p| *p = *p * radius + DVec3::new(3.0, 0.0, 9.0));
            clean(model, &CleanOptions::default()).unwrap().0
        };
        let (inner, outer) = (sphere(2.0), sphere(2.3));
        for (coarse, detailed) in [(&inner, &outer), (&outer, &inner)] {
            let cage = Projector::new(coarse, detailed, None).unwrap().report().cage;
            assert!((cage / 0.3 / f64::from(CAGE_SLACK) - 1.0).abs() < 0.05, "{cage}");
        }
        let cage = Projector::new(&inner, &inner, None).unwrap().report().cage;
        assert!(cage > 0.0 && cage < 1e-3);
    }

    /// All texels, again and again.
    fn padded(normals: &[Option<Vec3>], width: usize) -> Vec<Option<Vec3>> {
        let value = |texel: usize| {
            let around =
                texels_around(texel, [width, normals.len() / width]).filter_map(|around| normals[around]);
            let mean = || around.reduce(|a, b| a + b).map(|sum| sum.try_normalize().unwrap_or(sum));
            normals[texel].or_else(mean)
        };
        (0..normals.len()).map(value).collect()
    }

    #[test]
    fn padding_goes_on_from_where_it_was() {
        let mut random = Random::new(5);
        for (width, height) in [(23, 17), (1, 40), (40, 1)] {
            let mut normal = |_| {
                let unit = |random: &mut Random| random.unit() as f32 - 0.5;
                let direction = Vec3::new(unit(&mut random), unit(&mut random), unit(&mut random));
                (random.below(30) == 0).then(|| direction.normalize())
            };
            let start: Vec<Option<Vec3>> = (0..width * height).map(&mut normal).collect();
            let mut expected = start.clone();
            for texels in 0..12 {
                let mut found = start.clone();
                pad(&mut found, width, texels, &|| false);
                assert!(found == expected, "{width} x {height}, {texels} texels");
                expected = padded(&expected, width);
            }
        }
    }

    #[test]
    fn who_wants_to_stop_is_asked_before_texels_have_triangles() {
        let (mut mesh, _) = clean(generate::icosphere(2), &CleanOptions::default()).unwrap();
        // All triangles lie in one point of the image, and none has a texel.
        mesh.corners.uv_sets = vec![vec![Vec2::ZERO; 3 * mesh.triangles.len()]];
        let asked = AtomicU64::new(0);
        let bake = |last: u64| {
            asked.store(0, Relaxed);
            let options = NormalMapOptions { size: [16; 2], ..NormalMapOptions::default() };
            bake_normal_map_until(&mesh, &mesh, &options, &|| asked.fetch_add(1, Relaxed) >= last)
        };
        bake(u64::MAX).unwrap();
        assert!(asked.load(Relaxed) >= mesh.triangles.len() as u64);
        assert!(bake(9).unwrap_err().is_cancelled());
        assert_eq!(asked.load(Relaxed), 10);
    }

    #[test]
    fn large_normal_maps_count_as_memory() {
        let (mut mesh, _) = clean(generate::icosphere(1), &CleanOptions::default()).unwrap();
        mesh.corners.uv_sets = vec![vec![Vec2::ZERO; 3 * mesh.triangles.len()]];
        let limits = ReadLimits::new(ReadOptions { memory_bytes: 64 << 20, ..ReadOptions::default() });
        let options = NormalMapOptions { size: [4096; 2], ..NormalMapOptions::default() };
        let error = limits.run(|| bake_normal_map(&mesh, &mesh, &options)).unwrap_err();
        assert!(error.to_string().contains("a normal map of 4096 x 4096 texels"), "{error}");
    }

    #[test]
    fn lambda_steps_undo_position_steps() {
        let corners = [Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.9, 0.1, -0.2), Vec3::new(0.3, 0.8, 0.1)];
        for lambda in [Vec3::new(0.1, -0.3, 0.2), Vec3::new(-0.5, 0.25, 0.25)] {
            let step = interpolate(corners, lambda);
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            assert!((lambda_step(corners, step + 3.0 * normal) - lambda).length() < 1e-5);
        }
    }
}
