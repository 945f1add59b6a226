//! Building the cover of a mesh.

use std::time::Instant;

use fantex_base::{Error, Result, counted, input};
use fantex_mesh::{
    FanCorner, Fans, HardEdges, MAX_FAN_TRIANGLES, Mesh, VertexCorners, check_hard_edges, is_crease,
    shading_normals,
};
use glam::Vec3;
use rayon::prelude::*;

use crate::fan_shape::{FanShape, Layout};
use crate::fan_tiles::{fan_groups, lay_fans};
use crate::groups::{GroupLimits, Grouping, expect_groups, group_fans};
use crate::nominal::NominalDensity;
use crate::sizing::{SizedCover, Sizing};
use crate::surface::{Ring, Surface};
use crate::watch::{Watch, time};
use crate::{Cover, CoverStats};

/// How many texels the surface gets.
#[derive(Clone, Debug, PartialEq)]
pub enum TexelBudget {
    /// So many stored texels at level 0 (see [`Cover::stored_texels`]; reached within a percent unless tiles are at their smallest).
    Total(u64),
    /// Texels per mesh unit of length, everywhere.
    Density(f64),
    /// Texels per mesh unit of length, one value per triangle (e.g. the density of a texture to be replaced).
    PerTriangle(Vec<f32>),
}

/// Options of [`build_cover`].
#[derive(Clone, Debug, PartialEq)]
pub struct CoverOptions {
    /// How many texels the surface gets.
    pub budget: TexelBudget,
    /// Stored texels at most, unless tiles are at their smallest: where densities would take more, all of them shrink alike.
    pub most_texels: Option<u64>,
    /// Longest side of a tile of several fans in texels; of 512 or more, up to eight times as much where surfaces would be torn into many pieces.
    /// 0 gives every fan its own tile.
    pub tile: u32,
    /// Width of the blend band in barycentric coordinates, 0 < delta <= 1/3.
    pub delta: f32,
    /// Groups of several fans keep this cosine between projection direction and every triangle normal.
    pub facing: f32,
    /// End fans at [creases](is_crease), so that no texel mixes both sides: for what jumps there as light does.
    pub cut_creases: bool,
    /// End fans at [hard edges](HardEdges), too, from so many degrees between the normals of their triangles on, 0 to 180: no tile lies across
    /// one, and the texture function may jump there. (Where a single one ends within a smooth part it stays continuous at that end.)
    pub hard_edges: Option<f32>,
}

impl Default for CoverOptions {
    fn default() -> Self {
        Self {
            budget: TexelBudget::Total(4 << 20),
            most_texels: None,
            tile: 1024,
            delta: 1.0 / 16.0,
            facing: 0.25,
            cut_creases: false,
            hard_edges: None,
        }
    }
}

/// What is known of a triangle and its half fan while a mesh is covered, measured on landscapes.
const BYTES_PER_TRIANGLE: u64 = 96;

/// Covers a mesh. Deterministic on any number of threads; linear in the triangles, for each of which it takes some 100 bytes of memory beside
/// the mesh's own.
///
/// # Errors
/// An empty or too large mesh, more triangles than the memory [allows](input::ReadLimits) that is left, or options out of range.
pub fn build_cover(mesh: &Mesh, options: &CoverOptions) -> Result<(Cover, CoverStats)> {
    build_cover_while(mesh, options, &|_| true)
}

/// As [`build_cover`], but ends soon once it is not wanted any more. `goes_on` is asked that often, from all threads, and told what share of
/// the time has gone, about, from 0 to 1: threads may tell theirs in any order.
///
/// # Errors
/// As [`build_cover`]; it is not wanted any more ([`Error::is_cancelled`]).
pub fn build_cover_while(
    mesh: &Mesh,
    options: &CoverOptions,
    goes_on: &(dyn Fn(f32) -> bool + Sync),
) -> Result<(Cover, CoverStats)> {
    check(mesh, options)?;
    let watch = Watch::new(goes_on);
    let triangles = mesh.triangles.len() as u64;
    let what = format_args!("a mesh of {} and its cover", counted(triangles, "triangle"));
    let _held = input::reserve(what, mesh.byte_len() + BYTES_PER_TRIANGLE * triangles)?;
    let started = Instant::now();
    watch.begin(time::ANGLES, 0)?;
    let vertex_corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
    let fans = Fans::by_angle(mesh, &vertex_corners);
    drop(vertex_corners);
    let (fans, creases) = cut_at_creases(mesh, fans, options);
    let mut surface = Surface::new(mesh, fans);
    surface.creases = creases;
    let count = surface.fans.len();
    let density = NominalDensity::new(&surface, options);
    let mut stats = CoverStats::default();
    let grouping = if options.tile == 0 {
        watch.expect(time::ANGLES + time::LAYING + time::SIZING);
        watch.begin(time::ANGLES + time::LAYING, count)?;
        let laid = lay_fans(&surface, &density, options.delta, &watch);
        stats.fans.folding = laid.iter().filter(|laid| laid.folds).count() as u64;
        stats.seconds_fans = started.elapsed().as_secs_f64();
        Grouping { fan_groups: fan_groups(&surface.fans, &laid), laid }
    } else {
        expect_groups(&watch, count);
        watch.begin(time::SHAPED, count)?;
        let shapes = shape_fans(&surface, &watch);
        stats.fans.folding = shapes.iter().filter(|shape| shape.folds).count() as u64;
        stats.seconds_fans = started.elapsed().as_secs_f64();
        let limits =
            GroupLimits { delta: options.delta, extent_texels: options.tile as f32, facing: options.facing };
        group_fans(&surface, &shapes, &density, &limits, &watch)?
    };
    stats.fans.total = surface.fans.len() as u64;
    let unfolded = grouping.laid.iter().filter(|laid| laid.layout == Layout::Unfolded);
    stats.fans.unfolded = unfolded.map(|laid| u64::from(laid.fans)).sum();
    stats.fans.projected = stats.fans.total - stats.fans.unfolded;
    let sizing = Sizing::new(&surface, &grouping, density.mean(&surface), options, &watch);
    watch.begin_last()?;
    let SizedCover { mut cover, texels, scale } = sizing.to_budget()?;
    (cover.is_creased, cover.hard_edges) = (options.cut_creases, options.hard_edges);
    stats.seconds_groups = started.elapsed().as_secs_f64() - stats.seconds_fans;
    stats.measure(&surface, &cover, texels, |t| density.of_triangle(t) * scale);
    watch.end()?;
    Ok((cover, stats))
}

/// The fans, cut at the creases and hard edges that the options name; and of every edge that was cut the corners of both triangles at its
/// ends, `[[own, own], [other, other]]`.
fn cut_at_creases(mesh: &Mesh, fans: Fans, options: &CoverOptions) -> (Fans, Vec<[[u32; 2]; 2]>) {
    let normals = options.cut_creases.then(|| shading_normals(mesh));
    let hard = options.hard_edges.map(|degrees| HardEdges::of(mesh, degrees));
    let is_cut = |before: FanCorner, after: FanCorner| {
        let is_crease =
            |normals: &Vec<Vec3>| is_crease(normals, before.corner() as usize, after.corner() as usize);
        let is_hard = |hard: &HardEdges<'_>| {
            let triangle = mesh.triangles[before.triangle()];
            let [center, _, ring] = before.slots().map(|k| triangle[k]);
            hard.is_hard([before, after].map(|corner| corner.triangle() as u32), [center, ring])
        };
        normals.as_ref().is_some_and(is_crease) || hard.as_ref().is_some_and(is_hard)
    };
    let mut creases = Vec::new();
    if normals.is_none() && hard.is_none() {
        return (fans, creases);
    }
    for fan in 0..fans.len() {
        let corners = fans.corners(fan);
        let count = corners.len() - usize::from(!fans.is_closed(fan));
        for (i, &before) in corners.iter().enumerate().take(count) {
            let after = corners[(i + 1) % corners.len()];
            if is_cut(before, after) {
                let ends = |corner: FanCorner, ring: usize| {
                    [corner.corner(), (3 * corner.triangle() + corner.slots()[ring]) as u32]
                };
                creases.push([ends(before, 2), ends(after, 1)]);
            }
        }
    }
    let fans = if creases.is_empty() { fans } else { fans.cut(is_cut) };
    (fans, creases)
}

fn check(mesh: &Mesh, options: &CoverOptions) -> Result<()> {
    let triangles = mesh.triangles.len();
    if triangles == 0 {
        return Err(Error::invalid("the mesh has no triangles; a cover needs at least one"));
    }
    if triangles > MAX_FAN_TRIANGLES {
        return Err(Error::too_large(format!(
            "the mesh has {triangles} triangles; a cover handles at most {MAX_FAN_TRIANGLES}"
        )));
    }
    if !(options.delta > 0.0 && options.delta <= 1.0 / 3.0) {
        let given = options.delta;
        return Err(Error::invalid(format!(
            "the blend band must be wider than 0 and at most 1/3, got {given}"
        )));
    }
    options.hard_edges.map_or(Ok(()), check_hard_edges)?;
    options.budget.check(triangles)
}

impl TexelBudget {
    /// Refuses what no surface of so many triangles can have.
    ///
    /// # Errors
    /// Texels or densities that are not positive and finite, or not one for each triangle.
    pub fn check(&self, triangles: usize) -> Result<()> {
        // Densities are kept in single precision, where 1e-60 is zero and 1e60 infinite.
        let positive = |given: f64| {
            let kept = given as f32;
            match kept.is_finite() && kept > 0.0 {
                true => Ok(()),
                false => {
                    Err(Error::invalid(format!("the texel budget must be positive and finite, got {given}")))
                }
            }
        };
        match self {
            Self::Total(n) => positive(*n as f64),
            Self::Density(d) => positive(*d),
            Self::PerTriangle(field) if field.len() != triangles => Err(Error::invalid(format!(
                "the density field has {} values, expected one for each of the {triangles} triangles",
                field.len()
            ))),
            Self::PerTriangle(field) => field.iter().try_for_each(|&d| positive(f64::from(d))),
        }
    }
}

/// Counts of fans by how they were laid flat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FanCounts {
    /// All fans of the mesh.
    pub total: u64,
    /// Laid flat by projection.
    pub projected: u64,
    /// Unfolded about their centres, or unrolled with others across creases.
    pub unfolded: u64,
    /// Fans that no direction sees wholly from the front.
    pub folding: u64,
}

/// How each fan is laid flat by itself.
pub(crate) fn shape_fans(surface: &Surface<'_>, watch: &Watch<'_>) -> Vec<FanShape> {
    let shape = |ring: &mut Ring, fan: usize| {
        if fan.is_multiple_of(1024) {
            watch.add(1024);
        }
        ring.gather(surface, fan);
        FanShape::of(ring, surface, fan)
    };
    (0..surface.fans.len()).into_par_iter().with_min_len(1024).map_init(Ring::default, shape).collect()
}
