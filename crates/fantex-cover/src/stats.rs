//! Figures that describe a cover.

use std::ops::Range;

use fantex_mesh::Mesh;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::surface::Surface;
use crate::{Cover, FanCounts, GroupKind};

/// First, fiftieth and ninety-ninth percentile, by surface area.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Percentiles {
    /// 1 %.
    pub p1: f32,
    /// 50 %.
    pub median: f32,
    /// 99 %.
    pub p99: f32,
}

/// Figures of a cover, measured over the whole surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CoverStats {
    /// Fans by how they were laid flat.
    pub fans: FanCounts,
    /// Groups, which is also the number of tiles.
    pub groups: u64,
    /// Texels at level 0 that are stored: those in blocks that something reads.
    pub texels: u64,
    /// Texels that lie on the surface (each point counted once), divided by those that are stored: 1 would be a texture
    /// without margins, gaps, overlaps and foreshortening, and so at the ideal density.
    pub density_share: f64,
    /// The same where each triangle counts with the density along the direction in which its texels lie least dense.
    pub worst_share: f64,
    /// Share of the tiles' rectangles in blocks that nothing reads, which are not stored.
    pub gap_share: f64,
    /// Share of the stored texels beside the regions: the half texel that filters read, and the rest of blocks at outlines.
    pub margin_share: f64,
    /// Share of the stored texels that repeat others in the blend bands.
    pub overlap_share: f64,
    /// What the cover costs, in decibels of the error of smooth detail, beside a texture of as many texels without gaps and
    /// foreshortening: the mean squared error of interpolation grows with the fourth power of a texel's length, up to eight times
    /// the ideal length.
    pub loss_db: f64,
    /// Mean number of tiles that the texture function reads at a point of the surface.
    pub lookups_per_sample: f64,
    /// Texel density along the direction in which a triangle's texels are most stretched, divided by the nominal density:
    /// the cosine that the projection costs, times what the rounding of the tile's sides gives or takes.
    pub stretch: Percentiles,
    /// Texels per area, divided by the nominal number.
    pub density_spread: Percentiles,
    /// Duration of gathering fans and choosing their directions.
    pub seconds_fans: f64,
    /// Duration of grouping and of sizing the tiles.
    pub seconds_groups: f64,
}

impl CoverStats {
    /// Measures a cover. `nominal` is the nominal number of texels per mesh unit of a triangle. Large meshes are measured
    /// at `SAMPLED_CHUNKS` evenly spaced runs of triangles.
    pub(crate) fn measure(
        &mut self,
        surface: &Surface<'_>,
        cover: &Cover,
        stored_texels: u64,
        nominal: impl Fn(usize) -> f32 + Sync,
    ) {
        self.texels = stored_texels;
        self.groups = cover.groups.len() as u64;
        let triangles = surface.mesh.triangles.len();
        let whole_area = surface.total(|_| 1.0);
        let ideal = self.texels as f64 / whole_area;
        let chunks = triangles.div_ceil(CHUNK);
        let parts: Vec<Part> = (0..chunks)
            .into_par_iter()
            .step_by(chunks.div_ceil(SAMPLED_CHUNKS))
            .map(|i| i * CHUNK..triangles.min((i + 1) * CHUNK))
            .map(|chunk| Part::of(chunk, surface, cover, ideal, &nominal))
            .collect();
        let mut sum = Part::default();
        parts.iter().for_each(|p| sum.add(p));
        let share = |texels: f64| texels / sum.area * whole_area / self.texels as f64;
        self.density_share = share(sum.surface_texels);
        self.worst_share = share(sum.worst_texels);
        self.overlap_share = share(sum.read_texels) - self.density_share;
        self.loss_db = 10.0 * (sum.error / sum.area).log10();
        self.margin_share = 1.0 - self.density_share - self.overlap_share;
        self.gap_share = 1.0 - self.texels as f64 / cover.texels() as f64;
        self.lookups_per_sample = sum.lookups / sum.area;
        self.stretch = sum.stretch.percentiles();
        self.density_spread = sum.spread.percentiles();
    }
}

/// Triangles measured in one go.
const CHUNK: usize = 1024;

/// Texels eight times as long as the ideal show nothing of detail that takes sixteen of those.
const MAX_ERROR: f64 = 4096.0;

/// 2^18 triangles tell percentiles as well as two million do.
const SAMPLED_CHUNKS: usize = 256;

#[derive(Default)]
struct Part {
    area: f64,
    surface_texels: f64,
    worst_texels: f64,
    read_texels: f64,
    error: f64,
    lookups: f64,
    stretch: Histogram,
    spread: Histogram,
}

impl Part {
    fn of(
        triangles: Range<usize>,
        surface: &Surface<'_>,
        cover: &Cover,
        ideal: f64,
        nominal: &(impl Fn(usize) -> f32 + Sync),
    ) -> Self {
        let mut part = Self::default();
        for t in triangles {
            let density = f64::from(nominal(t));
            let a = f64::from(surface.area(t));
            part.area += a;
            part.lookups += a * expected_lookups(cover.corner_groups[t], f64::from(cover.delta));
            let groups = cover.corner_groups[t];
            let alike = groups[0] == groups[1] && groups[1] == groups[2];
            let (slots, weight) = if alike { (1, a) } else { (3, a / 3.0) };
            let plane = Plane::of(surface.mesh.triangle_positions(t));
            for slot in 0..slots {
                let values = |plane: &Plane| singular_values(plane, surface.mesh, cover, t, slot);
                let [large, small] = plane.as_ref().map_or([0.0; 2], values);
                let texels = large * small;
                part.surface_texels += texels * weight;
                part.worst_texels += small * small * weight;
                let fourth = |length: f64| length.powi(4).max(f64::MIN_POSITIVE);
                let error = 0.5 * ideal * ideal * (1.0 / fourth(large) + 1.0 / fourth(small));
                part.error += weight * error.min(MAX_ERROR);
                part.read_texels += texels * a * region_share(groups, slot, f64::from(cover.delta));
                part.stretch.add(small / density, weight);
                part.spread.add(texels / (density * density), weight);
            }
        }
        part
    }

    fn add(&mut self, other: &Part) {
        self.area += other.area;
        self.surface_texels += other.surface_texels;
        self.worst_texels += other.worst_texels;
        self.read_texels += other.read_texels;
        self.error += other.error;
        self.lookups += other.lookups;
        self.stretch.merge(&other.stretch);
        self.spread.merge(&other.spread);
    }
}

/// Mean number of groups with a positive weight over a triangle. A lone corner's region takes `(1 + d)^2 / 3` of the area,
/// that of two corners `1 - (1 - d)^2 / 3`.
fn expected_lookups([a, b, c]: [u32; 3], delta: f64) -> f64 {
    match (a == b, b == c, c == a) {
        (true, true, _) => 1.0,
        (false, false, false) => (1.0 + delta) * (1.0 + delta),
        _ => 1.0 + 4.0 / 3.0 * delta,
    }
}

/// The share of a triangle's area in which the group of a corner has a positive weight, divided among that group's corners,
/// except where all have one group: then the first stands for all.
fn region_share(groups: [u32; 3], slot: usize, delta: f64) -> f64 {
    match groups.iter().filter(|&&group| group == groups[slot]).count() {
        1 => (1.0 + delta) * (1.0 + delta) / 3.0,
        2 => 0.5 - (1.0 - delta) * (1.0 - delta) / 6.0,
        _ => 1.0,
    }
}

/// A triangle's plane: an orthonormal basis whose first vector lies along the first edge, and the triangle in it. In double precision:
/// triangles may be millions of times smaller than the mesh, and their densities as much larger.
struct Plane {
    x: DVec3,
    y: DVec3,
    /// Length of the first edge.
    length: f64,
    /// The third corner.
    apex: DVec2,
}

/// Heights below this share of the second edge are rounding errors.
const MIN_HEIGHT: f64 = 1e-14;

impl Plane {
    /// `None` for a triangle without area.
    fn of(corners: [Vec3; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(|corner| corner.as_dvec3());
        let (e1, e2) = (b - a, c - a);
        let length = e1.length();
        let x = e1 / length;
        let along = e2.dot(x);
        let up = e2 - x * along;
        let height = up.length();
        (length > 0.0 && height > MIN_HEIGHT * e2.length()).then(|| Self {
            x,
            y: up / height,
            length,
            apex: DVec2::new(along, height),
        })
    }
}

/// Texels per mesh unit along the directions in which a triangle's texels lie densest and least dense.
fn singular_values(plane: &Plane, mesh: &Mesh, cover: &Cover, triangle: usize, slot: usize) -> [f64; 2] {
    let group = &cover.groups[cover.corner_groups[triangle][slot] as usize];
    let texels = DVec2::new(f64::from(group.extent[0]), f64::from(group.extent[1]));
    // The Jacobian of the map from the triangle's plane to texels.
    let [du, dv] = match group.kind {
        GroupKind::Projected => {
            let (u, v) = (group.frame.x_axis.as_dvec3(), group.frame.y_axis().as_dvec3());
            let scale = group.uv_scale.as_dvec2() * texels;
            [plane.x, plane.y].map(|axis| scale * DVec2::new(axis.dot(u), axis.dot(v)))
        }
        GroupKind::Unfolded => {
            let [a, b, c] = cover.tile_corners(mesh, triangle, slot).map(|uv| uv.as_dvec2() * texels);
            let du = (b - a) / plane.length;
            [du, ((c - a) - du * plane.apex.x) / plane.apex.y]
        }
    };
    singular_values_of(du, dv)
}

/// The singular values of a matrix with such columns, the larger first.
fn singular_values_of(du: DVec2, dv: DVec2) -> [f64; 2] {
    let (e, f, g) = (du.length_squared(), du.dot(dv), dv.length_squared());
    let large = (0.5 * (e + g + ((e - g) * (e - g) + 4.0 * f * f).sqrt())).sqrt();
    // The difference of the squares would lose all digits where one value is much smaller.
    let small = if large > 0.0 { du.perp_dot(dv).abs() / large } else { 0.0 };
    [large, small]
}

/// Area by value, in buckets of one part in two hundred.
#[derive(Clone)]
struct Histogram {
    buckets: Vec<f64>,
}

const BUCKETS_PER_UNIT: f64 = 200.0;
const BUCKETS: usize = 2000;

impl Default for Histogram {
    fn default() -> Self {
        Self { buckets: vec![0.0; BUCKETS] }
    }
}

impl Histogram {
    fn add(&mut self, value: f64, weight: f64) {
        let bucket = (value * BUCKETS_PER_UNIT) as usize;
        self.buckets[bucket.min(BUCKETS - 1)] += weight;
    }

    fn merge(&mut self, other: &Histogram) {
        self.buckets.iter_mut().zip(&other.buckets).for_each(|(a, b)| *a += b);
    }

    fn percentiles(&self) -> Percentiles {
        let total: f64 = self.buckets.iter().sum();
        let at = |share: f64| {
            let mut sum = 0.0;
            let bucket = self.buckets.iter().position(|b| {
                sum += b;
                sum >= share * total
            });
            ((bucket.unwrap_or(BUCKETS - 1) as f64 + 0.5) / BUCKETS_PER_UNIT) as f32
        };
        Percentiles { p1: at(0.01), median: at(0.5), p99: at(0.99) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn singular_values_are_exact_at_any_scale() {
        let turned = DVec2::from_angle(0.3);
        for scale in [1e-20, 1.0, 1e19, 1e40] {
            for ratio in [1.0, 0.5, 1e-9, 0.0] {
                // Columns of the product of a rotation, the values, and another rotation.
                let [du, dv] = [DVec2::from_angle(1.1), DVec2::from_angle(1.1).perp()]
                    .map(|column| (scale * DVec2::new(column.x, ratio * column.y)).rotate(turned));
                let [large, small] = singular_values_of(du, dv);
                assert!((large - scale).abs() < 1e-14 * scale, "{scale} {ratio}: {large}");
                assert!((small - ratio * scale).abs() < 1e-14 * scale, "{scale} {ratio}: {small}");
            }
        }
        assert_eq!(singular_values_of(DVec2::ZERO, DVec2::ZERO), [0.0, 0.0]);
    }

    #[test]
    fn planes_of_tiny_triangles_are_exact() {
        let corners = [[1e-30, 0.0, 0.0], [4e-30, 0.0, 0.0], [2e-30, 0.0, 2e-30]].map(Vec3::from);
        let plane = Plane::of(corners).unwrap();
        assert_eq!((plane.x.as_vec3(), plane.y.as_vec3()), (Vec3::X, Vec3::Z));
        assert!((plane.length - 3e-30).abs() < 1e-36);
        assert!((plane.apex - DVec2::new(1e-30, 2e-30)).length() < 1e-36);
        let along_a_line = [[0.0, 0.0, 0.0], [0.1, 0.2, 0.3], [0.2, 0.4, 0.6]].map(Vec3::from);
        assert!(Plane::of(along_a_line).is_none());
        assert!(Plane::of([Vec3::ONE; 3]).is_none());
    }
}
