//! Building the cover of a mesh.

use std::time::Instant;

use fantex_mesh::{Fans, Mesh, VertexCorners};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::extent::{MAX_EXTENT, side_texels};
use crate::fan_shape::{FanShape, Layout, ShapeFinder};
use crate::grouping::{GroupLimits, Grouping, Patch, group_fans};
use crate::surface::Surface;
use crate::{Cover, CoverStats, Group, GroupKind, REPORTED_FANS, UnfoldedCorner};

/// How many texels the surface gets.
#[derive(Clone, Debug, PartialEq)]
pub enum TexelBudget {
    /// So many texels in all tiles at level 0 (reached within a percent unless tiles are at their smallest).
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
    /// Target extent of a tile in texels; 0 gives every fan its own tile.
    pub tile: u32,
    /// Width of the blend band in barycentric coordinates, 0 < delta <= 1/3.
    pub delta: f32,
    /// Groups of several fans keep this cosine between projection direction and every triangle normal.
    pub facing: f32,
    /// While patches are cut, fans' directions keep this cosine to the patch's.
    pub patch_facing: f32,
}

impl Default for CoverOptions {
    fn default() -> Self {
        Self {
            budget: TexelBudget::Total(4 << 20),
            tile: 128,
            delta: 1.0 / 16.0,
            facing: 0.6,
            patch_facing: 0.85,
        }
    }
}

/// Why no cover was built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CoverError {
    /// Nothing to cover.
    #[error("the mesh has no triangles; a cover needs at least one")]
    NoTriangles,
    /// Corner indices have 31 bits.
    #[error("the mesh has {triangles} triangles; a cover handles at most {limit}")]
    TooManyTriangles {
        /// In the mesh.
        triangles: usize,
        /// Allowed.
        limit: usize,
    },
    /// A tile would be larger than any format can hold.
    #[error(
        "a tile would need {wanted} texels along one side, the limit is {limit}: ask for fewer texels, or subdivide the \
         mesh"
    )]
    TileTooLarge {
        /// Along the longer side.
        wanted: u64,
        /// Allowed.
        limit: u32,
    },
    /// A budget that is not a positive finite number.
    #[error("the texel budget must be positive and finite, got {given}")]
    BadBudget {
        /// As given.
        given: f64,
    },
    /// The per-triangle budget does not fit the mesh.
    #[error("the density field has {given} values, expected one for each of the {triangles} triangles")]
    DensityFieldLength {
        /// Values.
        given: usize,
        /// Triangles.
        triangles: usize,
    },
    /// The blend band is out of range.
    #[error("the blend band must be wider than 0 and at most 1/3, got {given}")]
    BadDelta {
        /// As given.
        given: f32,
    },
}

const MAX_TRIANGLES: usize = (1 << 31) / 3;

/// Covers a mesh. Deterministic on any number of threads; linear in the triangles.
///
/// # Errors
///
/// An empty or too large mesh, or options out of range.
pub fn build_cover(mesh: &Mesh, options: &CoverOptions) -> Result<(Cover, CoverStats), CoverError> {
    check(mesh, options)?;
    let started = Instant::now();
    let vertex_corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
    let fans = Fans::of(&mesh.triangles, &vertex_corners);
    drop(vertex_corners);
    let mut surface = Surface::new(mesh, fans);
    let (shapes, counts, split_centers) = shape_fans(&mut surface);
    let mut stats = CoverStats { fans: counts, split_centers, ..CoverStats::default() };
    stats.seconds_fans = started.elapsed().as_secs_f64();

    let density = NominalDensity::new(&surface, options);
    let limits = GroupLimits {
        delta: options.delta,
        extent_texels: options.tile as f32,
        facing: options.facing,
        patch_facing: options.patch_facing,
    };
    let grouping = group_fans(&surface, &shapes, &|fan| density.of_fan(&surface, fan), &limits);
    let scale = match options.budget {
        TexelBudget::Total(texels) => scale_to_total(&grouping.patches, texels),
        _ => 1.0,
    };
    let cover = assemble(&surface, &shapes, grouping, scale, density.mean(&surface) * scale, options.delta)?;
    stats.seconds_groups = started.elapsed().as_secs_f64() - stats.seconds_fans;
    stats.measure(mesh, &surface.areas, &cover, |t| density.of_triangle(t) * scale);
    Ok((cover, stats))
}

fn check(mesh: &Mesh, options: &CoverOptions) -> Result<(), CoverError> {
    let triangles = mesh.triangles.len();
    if triangles == 0 {
        return Err(CoverError::NoTriangles);
    }
    if triangles > MAX_TRIANGLES {
        return Err(CoverError::TooManyTriangles { triangles, limit: MAX_TRIANGLES });
    }
    if !(options.delta > 0.0 && options.delta <= 1.0 / 3.0) {
        return Err(CoverError::BadDelta { given: options.delta });
    }
    // Densities are kept in single precision, where 1e-60 is zero and 1e60 infinite.
    let positive = |given: f64| {
        let kept = given as f32;
        if kept.is_finite() && kept > 0.0 { Ok(()) } else { Err(CoverError::BadBudget { given }) }
    };
    match &options.budget {
        TexelBudget::Total(n) => positive(*n as f64),
        TexelBudget::Density(d) => positive(*d),
        TexelBudget::PerTriangle(field) if field.len() != triangles => {
            Err(CoverError::DensityFieldLength { given: field.len(), triangles })
        }
        TexelBudget::PerTriangle(field) => field.iter().try_for_each(|&d| positive(f64::from(d))),
    }
}

/// Counts of fans by how they were laid flat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FanCounts {
    /// All fans of the mesh.
    pub total: u64,
    /// Laid flat by projection.
    pub projected: u64,
    /// Laid flat by unfolding.
    pub unfolded: u64,
    /// Neither: split into their triangles (two triangles glued back to back, for example).
    pub split: u64,
    /// Fans that no direction sees wholly from the front (they are among the unfolded and the split).
    pub folding: u64,
}

/// Decides about every fan; fans that must be split are replaced by one fan per triangle.
fn shape_fans(surface: &mut Surface<'_>) -> (Vec<FanShape>, FanCounts, Vec<Vec3>) {
    let find = |surface: &Surface<'_>| -> Vec<FanShape> {
        (0..surface.fans.len())
            .into_par_iter()
            .with_min_len(1024)
            .map_init(ShapeFinder::default, |finder, fan| finder.shape(surface, fan))
            .collect()
    };
    let mut shapes = find(surface);
    let count = |layout| shapes.iter().filter(|s| s.layout == layout).count() as u64;
    let counts = FanCounts {
        total: shapes.len() as u64,
        projected: count(Layout::Projected),
        unfolded: count(Layout::Unfolded),
        split: count(Layout::Split),
        folding: shapes.iter().filter(|s| s.folds).count() as u64,
    };
    let split = (0..shapes.len()).filter(|&fan| shapes[fan].layout == Layout::Split).take(REPORTED_FANS);
    let split_centers = split.map(|fan| surface.fan_center(fan)).collect();
    if counts.split > 0 {
        surface.fans = surface.fans.with_split(|fan| shapes[fan].layout == Layout::Split);
        shapes = find(surface);
    }
    (shapes, counts, split_centers)
}

/// The centre vertices of the fans that can neither be projected nor unfolded, ascending: only there may a cover be split, so
/// a verifier can tell a split that had to be from a fault.
pub fn unflattenable_vertices(mesh: &Mesh) -> Vec<u32> {
    let vertex_corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
    let surface = Surface::new(mesh, Fans::of(&mesh.triangles, &vertex_corners));
    let must_split = |finder: &mut ShapeFinder, fan: usize| {
        let corner = surface.fans.corners(fan)[0].corner() as usize;
        (finder.shape(&surface, fan).layout == Layout::Split).then(|| mesh.triangles[corner / 3][corner % 3])
    };
    let mut vertices: Vec<u32> = (0..surface.fans.len())
        .into_par_iter()
        .map_init(ShapeFinder::default, must_split)
        .flatten()
        .collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

/// Texels per mesh unit before the total is met.
enum NominalDensity<'a> {
    Uniform(f32),
    PerTriangle(&'a [f32]),
}

/// A guess of the share of the ideal density that a grouped cover reaches; only decides how large groups grow.
const EXPECTED_SHARE: f64 = 0.7;

impl<'a> NominalDensity<'a> {
    fn new(surface: &Surface<'_>, options: &'a CoverOptions) -> Self {
        let area: f64 = surface.areas.iter().map(|&a| f64::from(a)).sum();
        match &options.budget {
            TexelBudget::Total(n) => {
                Self::Uniform((EXPECTED_SHARE * *n as f64 / area.max(f64::MIN_POSITIVE)).sqrt() as f32)
            }
            TexelBudget::Density(d) => Self::Uniform(*d as f32),
            TexelBudget::PerTriangle(field) => Self::PerTriangle(field),
        }
    }

    fn of_triangle(&self, triangle: usize) -> f32 {
        match self {
            Self::Uniform(d) => *d,
            Self::PerTriangle(field) => field[triangle],
        }
    }

    /// The densest of a fan's triangles decides, so that no detail is lost where densities meet.
    fn of_fan(&self, surface: &Surface<'_>, fan: usize) -> f32 {
        match self {
            Self::Uniform(d) => *d,
            Self::PerTriangle(field) => {
                surface.fans.corners(fan).iter().map(|c| field[c.triangle()]).fold(0.0, f32::max)
            }
        }
    }

    /// Root of the area-weighted mean square.
    fn mean(&self, surface: &Surface<'_>) -> f32 {
        let (mut texels, mut area) = (0.0, 0.0);
        for (t, &a) in surface.areas.iter().enumerate() {
            let d = f64::from(self.of_triangle(t));
            texels += f64::from(a) * d * d;
            area += f64::from(a);
        }
        (texels / area.max(f64::MIN_POSITIVE)).sqrt() as f32
    }
}

fn extent(patch: &Patch, scale: f32) -> [u32; 2] {
    let texels = patch.flat.size * patch.density * scale;
    [side_texels(texels.x), side_texels(texels.y)]
}

/// The factor of all densities with which the tiles hold `texels` together, as nearly as rounding allows and not more.
fn scale_to_total(patches: &[Patch], texels: u64) -> f32 {
    let total = |scale: f32| -> u64 {
        patches.par_iter().map(|p| extent(p, scale).map(u64::from)).map(|[w, h]| w * h).sum()
    };
    let (mut low, mut high) = (1.0 / 1024.0, 1024.0f32);
    // Tiles have at least 4x4 texels; where these alone exceed the budget, they are at least used to the full.
    let texels = texels.max(total(low));
    // Texels grow nearly with the square of the scale: a few steps by that rule bracket the answer closely.
    let mut scale = 1.0f32;
    for step in 0..16 {
        let reached = total(scale);
        if reached <= texels {
            low = low.max(scale)
        } else {
            high = high.min(scale)
        }
        let guess = scale
            * (texels as f64 / reached as f64).sqrt() as f32
            * if step % 2 == 0 { 1.0005 } else { 0.9995 };
        let middle = 0.5 * (low + high);
        scale = if step < 8 && guess > low && guess < high { guess } else { middle };
    }
    low
}

fn assemble(
    surface: &Surface<'_>,
    shapes: &[FanShape],
    grouping: Grouping,
    scale: f32,
    density: f32,
    delta: f32,
) -> Result<Cover, CoverError> {
    let longest =
        grouping.patches.iter().map(|p| p.flat.size.max_element() * p.density * scale).fold(0.0, f32::max);
    if longest + 1.0 > MAX_EXTENT as f32 {
        return Err(CoverError::TileTooLarge { wanted: (longest + 1.0) as u64, limit: MAX_EXTENT });
    }
    let groups: Vec<Group> = grouping
        .patches
        .par_iter()
        .map(|patch| {
            let first = patch.fans(&grouping.order)[0] as usize;
            let kind = match shapes[first].layout {
                Layout::Unfolded => GroupKind::Unfolded,
                Layout::Projected | Layout::Split => GroupKind::Projected,
            };
            place(patch, kind, scale)
        })
        .collect();
    let mut unfolded = Vec::new();
    for (patch, group) in grouping.patches.iter().zip(&groups) {
        unfolded.extend(patch.flat.unfolded.iter().map(|&(corner, planar)| UnfoldedCorner {
            corner,
            uv: planar.map(|p| group.uv_offset + group.uv_scale * p),
        }));
    }
    unfolded.sort_unstable_by_key(|u| u.corner);
    let corner_groups = (0..surface.mesh.triangles.len())
        .into_par_iter()
        .map(|t| surface.fans.of_triangle(t).map(|fan| grouping.fan_groups[fan as usize]))
        .collect();
    Ok(Cover { delta, density, corner_groups, groups, unfolded })
}

/// The tile map that takes the patch's rectangle to the tile, half a texel inside.
fn place(patch: &Patch, kind: GroupKind, scale: f32) -> Group {
    let extent = extent(patch, scale);
    let texels = Vec2::new(extent[0] as f32, extent[1] as f32);
    // A rectangle thinner than the nominal density can tell (a point, a line) is not blown up to the tile's size.
    let thinnest = Vec2::splat(0.5 / (patch.density * scale));
    let uv_scale = (texels - 1.0) / texels / patch.flat.size.max(thinnest);
    let middle = patch.flat.min + 0.5 * patch.flat.size;
    let uv_offset = Vec2::splat(0.5) - uv_scale * middle;
    Group { kind, frame: patch.flat.frame, uv_scale, uv_offset, extent }
}
