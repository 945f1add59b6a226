//! Dabs: one touch of the brush, as a function on the surface.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use std::sync::Arc;

use fantex_base::Result;
use fantex_base::input::{Held, reserve};
use fantex_cover::TexelTriangle;
use fantex_mesh::interpolate;
use fantex_texture::Image;
use glam::{DVec2, DVec3, Vec2, Vec3};

use crate::cover::Touch;
use crate::region::IndexHash;
use crate::{Region, RegionTriangle, Surface, SurfacePoint, Tip};

/// One touch of the brush.
#[derive(Clone, Debug)]
pub struct Dab {
    /// Where.
    pub center: SurfacePoint,
    /// Mesh units along the surface.
    pub radius: f32,
    /// Share of the radius within which the dab is full, 0..1.
    pub hardness: f32,
    /// Coverage that it adds at its centre, 0..1.
    pub flow: f32,
    /// Of the stamp, radians, counter-clockwise on the surface.
    pub angle: f32,
    /// Left and right of the stamp are changed.
    pub mirrored: bool,
    /// Width over length, above 0 up to 1: an ellipse that is the radius long, along the stamp's x axis. 1 is round.
    pub aspect: f32,
    /// Whether it goes on beyond gaps of the mesh: open edges that another one is near to.
    pub across_gaps: bool,
    /// Its picture, if any.
    pub stamp: Option<Arc<Stamp>>,
    /// Of which copy of a symmetric stroke it is; 0 is the stroke itself. Clones copy from another place for each.
    pub copy: u32,
}

/// Widest gap that dabs cross, as a share of their radius and in texels: whichever is more.
const MAX_GAP: (f32, f32) = (0.25, 2.0);

impl Dab {
    /// Mesh units; `texel` is the length of one. Negative where none is crossed.
    pub(crate) fn max_gap(&self, texel: f32) -> f32 {
        if self.across_gaps { (MAX_GAP.0 * self.radius).max(MAX_GAP.1 * texel) } else { -1.0 }
    }
}

/// The flattest dab.
pub(crate) const MIN_ASPECT: f32 = 0.05;

/// A dab with the part of the surface that it covers.
#[derive(Clone, Debug)]
pub(crate) struct PlacedDab {
    pub(crate) region: Region,
    dab: Dab,
    /// Mesh space.
    center: Vec3,
    /// The stamp's axes in the tangent plane, divided by the ellipse's radii.
    axes: [Vec3; 2],
    /// Distances at which the fall-off starts and ends.
    fade: [f32; 2],
}

impl PlacedDab {
    /// `texel`: the length of a texel in mesh units; even a hard brush fades over one and a half of them.
    pub(crate) fn new(surface: &Surface, dab: &Dab, texel: f32) -> Self {
        let radius = dab.radius.max(texel * 0.5);
        let end = radius + 0.75 * texel;
        let start = (radius * dab.hardness.clamp(0.0, 1.0)).min(end - 1.5 * texel).max(0.0);
        let normal = surface.outer_normal(dab.center.triangle);
        let (x, y) = tangent_axes(normal);
        let (sin, cos) = f64::from(dab.angle).sin_cos();
        let [along, across] =
            [x * cos + y * sin, y * cos - x * sin].map(|axis| (axis / f64::from(radius)).as_vec3());
        let axes = [along, across / dab.aspect.clamp(MIN_ASPECT, 1.0)];
        Self {
            region: Region::grow_across(surface, dab.center, end, dab.max_gap(texel)),
            center: surface.position(dab.center).as_vec3(),
            axes,
            fade: [start, end],
            dab: dab.clone(),
        }
    }

    /// Of which copy of the stroke it is.
    pub(crate) fn copy(&self) -> u32 {
        self.dab.copy
    }

    /// Distance along the surface at which it ends, mesh units.
    pub(crate) fn reach(&self) -> f32 {
        self.fade[1]
    }

    /// Coverage that the dab adds at a point of a triangle of its region, 0..1.
    #[inline]
    pub(crate) fn coverage(&self, triangle: &RegionTriangle, lambda: Vec3, position: Vec3) -> f32 {
        let [start, end] = self.fade;
        let distance = triangle.distance(lambda);
        if distance >= end {
            return 0.0;
        }
        let distance = if self.dab.aspect < 1.0 { self.stretched(distance, position) } else { distance };
        if distance >= end {
            return 0.0;
        }
        let s = ((distance - start) / (end - start)).max(0.0);
        let falloff = 1.0 - s * s * (3.0 - 2.0 * s);
        let stamp = self.dab.stamp.as_ref().map_or(1.0, |stamp| {
            let q = position - self.center;
            let x = q.dot(self.axes[0]);
            stamp.coverage(if self.dab.mirrored { -x } else { x }, q.dot(self.axes[1]))
        });
        self.dab.flow * falloff * stamp
    }

    /// A distance along the surface in the measure of an ellipse: longer across it.
    fn stretched(&self, distance: f32, position: Vec3) -> f32 {
        let q = position - self.center;
        let [along, across] = self.axes;
        let (x, y) = (q.dot(along), q.dot(across));
        // The same without the ellipse's shape.
        let round = x.hypot(y * self.dab.aspect.clamp(MIN_ASPECT, 1.0));
        if round > 0.0 { distance * x.hypot(y) / round } else { distance }
    }
}

/// An ellipse or a stamp covers nothing beyond the circle.
impl Touch for PlacedDab {
    fn region(&self) -> &Region {
        &self.region
    }

    fn texels(&self, index: usize, shown: &TexelTriangle) -> Option<[Vec2; 2]> {
        self.region.triangles[index].texels_within(self.reach(), shown)
    }
}

/// Two unit vectors orthogonal to a normal and to each other; the second is as upright (along y) as can be, so that stamps
/// stand upright on walls.
pub(crate) fn tangent_axes(normal: DVec3) -> (DVec3, DVec3) {
    let up = if normal.y.abs() < 0.999 { DVec3::Y } else { DVec3::NEG_Z };
    let x = up.cross(normal).normalize_or(DVec3::X);
    (x, normal.cross(x))
}

// Pictures that shape a dab.

/// A picture whose alpha (or, where that is opaque everywhere, whose brightness) shapes a dab.
#[derive(Clone, Debug)]
pub struct Stamp {
    extent: [usize; 2],
    coverage: Vec<f32>,
    _held: Held,
}

impl Stamp {
    /// From a picture; its longer side spans the brush's diameter.
    ///
    /// # Errors
    /// The budget of memory for input does not allow it.
    pub fn new(image: &Image) -> Result<Self> {
        let (width, height) = (image.width, image.height);
        let bytes = u64::from(width) * u64::from(height) * size_of::<f32>() as u64;
        let _held = reserve(format_args!("a stamp of {width} x {height} texels"), bytes)?;
        Ok(Self { extent: [width as usize, height as usize], coverage: coverage_of(image), _held })
    }

    /// A shape that comes with the program.
    ///
    /// # Errors
    /// The budget of memory for input does not allow it.
    pub fn of_tip(tip: Tip) -> Result<Self> {
        let bytes = (Tip::SIDE * Tip::SIDE * size_of::<f32>()) as u64;
        let _held = reserve(format_args!("the tip of a brush"), bytes)?;
        Ok(Self { extent: [Tip::SIDE; 2], coverage: tip.texels().to_vec(), _held })
    }

    /// Columns and rows, and the coverage of each texel, row-major.
    pub(crate) fn texels(&self) -> ([usize; 2], &[f32]) {
        (self.extent, &self.coverage)
    }

    /// Bilinear coverage at a place of the brush: x to the right and y upwards, -1..1 over the picture's longer side; 0
    /// outside, with the picture's border fading over a texel.
    pub fn coverage(&self, x: f32, y: f32) -> f32 {
        let [width, height] = self.extent;
        let scale = 0.5 * width.max(height) as f32;
        let column = x * scale + 0.5 * width as f32 - 0.5;
        let row = -y * scale + 0.5 * height as f32 - 0.5;
        let (c, r) = (column.floor(), row.floor());
        let (fx, fy) = (column - c, row - r);
        let at = |dx: f32, dy: f32| {
            let (c, r) = (c + dx, r + dy);
            let inside = c >= 0.0 && r >= 0.0 && c < width as f32 && r < height as f32;
            if inside { self.coverage[r as usize * width + c as usize] } else { 0.0 }
        };
        let top = at(0.0, 0.0) * (1.0 - fx) + at(1.0, 0.0) * fx;
        let bottom = at(0.0, 1.0) * (1.0 - fx) + at(1.0, 1.0) * fx;
        top * (1.0 - fy) + bottom * fy
    }
}

/// Whether some texel of an image is not opaque: then its alpha is its shape, else its brightness.
pub fn is_shaped_by_alpha(image: &Image) -> bool {
    let is_clear = |x, y| image.linear_texel(x, y)[3] < 1.0;
    image.has_alpha() && (0..image.height).any(|y| (0..image.width).any(|x| is_clear(x, y)))
}

/// A number of a picture as a share, 0..1: floats may hold any, or none.
pub(crate) fn share_of(number: f32) -> f32 {
    if number.is_nan() { 0.0 } else { number.clamp(0.0, 1.0) }
}

/// The shape of an image, row-major, 0..1: its alpha, or, where that is opaque everywhere, its brightness.
pub(crate) fn coverage_of(image: &Image) -> Vec<f32> {
    let has_alpha = is_shaped_by_alpha(image);
    let covered = |x, y| {
        let [r, g, b, a] = image.linear_texel(x, y);
        // Luminance (ITU-R BT.709).
        share_of(if has_alpha { a } else { 0.2126 * r + 0.7152 * g + 0.0722 * b })
    };
    (0..image.height).flat_map(|y| (0..image.width).map(move |x| covered(x, y))).collect()
}

// Flat coordinates around a point of the surface, for pictures that lie on it.
//
// Triangles are unfolded into the tangent plane of the centre one after the other, each over the edge through which it is
// reached first, and every vertex is moved to its distance along the surface: a discrete exponential map as in R. Schmidt, C.
// Grimm and B. Wyvill, "Interactive decal compositing with discrete exponential maps" (2006), by unfolded edges instead of
// rotated frames. Exact where the surface can be rolled out. Coordinates belong to vertices and are linear within
// triangles, so they are continuous across the edges of the region, and the same in every tile.

/// Coordinates of a region's triangles, mesh units from the centre.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chart {
    /// Per triangle of the region its corners' places; none where the map is torn.
    corners: Vec<Option<[Vec2; 3]>>,
}

/// A triangle whose sides are stretched by more than this lies on a tear.
const MAX_STRETCH: f32 = 3.0;

struct Unfolder<'a> {
    surface: &'a Surface,
    places: HashMap<u32, DVec2, IndexHash>,
    /// Edges nearest first; ties by number, so that the order is fixed.
    front: BinaryHeap<Reverse<(u64, u32)>>,
}

impl Chart {
    /// The chart of a region that was grown around `center`. `axes`: orthonormal, in the plane of the centre's triangle.
    pub(crate) fn unfold(surface: &Surface, region: &Region, center: SurfacePoint, axes: [DVec3; 2]) -> Self {
        let mut unfolder = Unfolder { surface, places: HashMap::default(), front: BinaryHeap::new() };
        unfolder.start(center, axes);
        while let Some(Reverse((_, half_edge))) = unfolder.front.pop() {
            unfolder.cross(half_edge, region);
        }
        let corners = region.triangles.iter().map(|entry| unfolder.corners(entry.triangle));
        Self { corners: corners.collect() }
    }

    /// Where a point of the region's triangle number `index` lies.
    #[inline]
    pub(crate) fn at(&self, index: usize, lambda: Vec3) -> Option<Vec2> {
        self.corners[index].map(|corners| interpolate(corners, lambda))
    }

    /// Corners of the region's triangle number `index`.
    pub(crate) fn triangle(&self, index: usize) -> Option<[Vec2; 3]> {
        self.corners[index]
    }
}

impl Unfolder<'_> {
    fn start(&mut self, center: SurfacePoint, [x, y]: [DVec3; 2]) {
        let origin = self.surface.position(center);
        let vertices = self.surface.mesh().triangles[center.triangle as usize];
        for (vertex, corner) in vertices.into_iter().zip(self.surface.corners(center.triangle)) {
            let q = corner - origin;
            self.places.insert(vertex, DVec2::new(q.dot(x), q.dot(y)));
        }
        (0..3).for_each(|k| self.push(3 * center.triangle + k));
    }

    fn push(&mut self, half_edge: u32) {
        let [(a, _), (b, _), _] = self.surface.turned(half_edge);
        if let (Some(a), Some(b)) = (self.places.get(&a), self.places.get(&b)) {
            let nearest = segment_distance(*a, *b);
            self.front.push(Reverse((nearest.to_bits(), half_edge)));
        }
    }

    /// Unfolds the triangle beyond an edge, if its third vertex has no place yet.
    fn cross(&mut self, half_edge: u32, region: &Region) {
        let Some(other) = self.surface.opposite(half_edge) else { return };
        let Some(entry) = region.get(other / 3) else { return };
        let [(a, qa), (b, qb), (apex, qc)] = self.surface.turned(other);
        let [_, _, (behind, _)] = self.surface.turned(half_edge);
        if self.places.contains_key(&apex) {
            return;
        }
        let Some([pa, pb, pc]) = self.places_of([a, b, behind]) else { return };
        let length = qa.distance(qb);
        let Some(along_axis) = (pb - pa).try_normalize().filter(|_| length > 0.0) else { return };
        let along = (qc - qa).dot(qb - qa) / length;
        let height = ((qc - qa).length_squared() - along * along).max(0.0).sqrt();
        let side = along_axis.perp().dot(pc - pa);
        let up = if side > 0.0 { -along_axis.perp() } else { along_axis.perp() };
        let place = 0.5 * (pa + pb) + along_axis * (along - 0.5 * length) + up * height;
        let distance = entry.corner_distance((other as usize + 2) % 3);
        let scale = distance / place.length();
        let place = if scale.is_finite() && (0.3..3.0).contains(&scale) { place * scale } else { place };
        self.places.insert(apex, place);
        let triangle = other / 3;
        (0..3).map(|k| 3 * triangle + k).filter(|edge| *edge != other).for_each(|edge| self.push(edge));
    }

    fn places_of(&self, vertices: [u32; 3]) -> Option<[DVec2; 3]> {
        let [a, b, c] = vertices.map(|v| self.places.get(&v).copied());
        Some([a?, b?, c?])
    }

    fn corners(&self, triangle: u32) -> Option<[Vec2; 3]> {
        let vertices = self.surface.mesh().triangles[triangle as usize];
        let places = self.places_of(vertices)?.map(|p| p.as_vec2());
        let corners = self.surface.corners(triangle).map(|p| p.as_vec3());
        let is_whole = (0..3).all(|k| {
            let flat = places[k].distance(places[(k + 1) % 3]);
            flat <= MAX_STRETCH * corners[k].distance(corners[(k + 1) % 3]).max(1e-9)
        });
        is_whole.then_some(places)
    }
}

fn segment_distance(a: DVec2, b: DVec2) -> f64 {
    let edge = b - a;
    let t = (-a.dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (a + edge * t).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_covers_where_its_picture_is_opaque() {
        let texels: Vec<[f32; 4]> =
            (0..64).map(|i| [0.0, 0.0, 0.0, if i % 8 < 4 { 1.0 } else { 0.0 }]).collect();
        let stamp = Stamp::new(&Image::from_linear_rgba(8, 8, &texels)).unwrap();
        let found = [(-0.5, 0.3), (0.5, 0.3), (-1.3, 0.0), (-0.5, 1.2)].map(|(x, y)| stamp.coverage(x, y));
        assert_eq!(found, [1.0, 0.0, 0.0, 0.0]);
        // An alpha that is opaque everywhere says nothing.
        let dim: Vec<[f32; 4]> =
            (0..64).map(|i| if i % 8 < 4 { [1.0; 4] } else { [0.0, 0.0, 0.0, 1.0] }).collect();
        let opaque = Stamp::new(&Image::from_linear_rgba(8, 8, &dim)).unwrap();
        assert_eq!([-0.5, 0.5].map(|x| opaque.coverage(x, 0.3)), [1.0, 0.0]);
        // Without alpha brightness counts, and wide pictures keep their shape.
        let grey = Stamp::new(&Image::from_linear_rgb(8, 4, &[[0.25, 0.25, 0.25, 1.0]; 32])).unwrap();
        assert!((grey.coverage(0.5, 0.2) - 0.25).abs() < 1e-6);
        assert_eq!(grey.coverage(0.0, 0.8), 0.0);
    }

    #[test]
    fn a_stamp_of_floats_covers_at_most_wholly() {
        let row = [4.0, -1.0, f32::NAN, 0.5];
        let bright = row.map(|x| [x, x, x, 1.0]);
        assert_eq!(coverage_of(&Image::from_linear_rgb(4, 1, &bright)), [1.0, 0.0, 0.0, 0.5]);
        let clear = row.map(|a| [1.0, 1.0, 1.0, a]);
        assert_eq!(coverage_of(&Image::from_linear_rgba(4, 1, &clear)), [1.0, 0.0, 0.0, 0.5]);
    }
}
