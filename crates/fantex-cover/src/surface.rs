//! The mesh as the cover's construction sees it: normals, areas, fans.

use fantex_mesh::{FanCorner, Fans, Mesh};
use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// A mesh with per-triangle geometry and its fans. Lengths are mesh units.
pub(crate) struct Surface<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) fans: Fans,
    /// Where fans were cut at creases, of each edge the corners of both triangles at its ends.
    pub(crate) creases: Vec<[[u32; 2]; 2]>,
    /// Unit normal of each triangle, by its winding, and its area: they are mostly needed together.
    facets: Vec<Vec4>,
}

impl<'a> Surface<'a> {
    pub(crate) fn new(mesh: &'a Mesh, fans: Fans) -> Self {
        let facets = (0..mesh.triangles.len()).into_par_iter().with_min_len(1 << 12);
        let facets = facets.map(|t| facet(mesh.triangle_positions(t))).collect();
        Self { mesh, fans, creases: Vec::new(), facets }
    }

    /// Area of a triangle.
    #[inline]
    pub(crate) fn area(&self, triangle: usize) -> f32 {
        self.facets[triangle].w
    }

    /// The integral of a value per triangle over the surface, the same on any number of threads.
    pub(crate) fn total(&self, value: impl Fn(usize) -> f64 + Sync) -> f64 {
        const CHUNK: usize = 1 << 14;
        let chunk_sum = |(i, facets): (usize, &[Vec4])| -> f64 {
            (i * CHUNK..).zip(facets).map(|(t, facet)| f64::from(facet.w) * value(t)).sum()
        };
        let sums: Vec<f64> = self.facets.par_chunks(CHUNK).enumerate().map(chunk_sum).collect();
        sums.into_iter().sum()
    }

    /// The normal of a fan's triangle on the fan's front side, and the triangle's area.
    #[inline]
    pub(crate) fn fan_facet(&self, corner: FanCorner) -> (Vec3, f32) {
        let facet = self.facets[corner.triangle()];
        let normal = facet.truncate();
        (if corner.reversed() { -normal } else { normal }, facet.w)
    }

    /// The centre vertex and the earlier and later ring vertex.
    #[inline]
    pub(crate) fn fan_vertices(&self, corner: FanCorner) -> [u32; 3] {
        let t = self.mesh.triangles[corner.triangle()];
        let [center, from, to] = corner.slots();
        [t[center], t[from], t[to]]
    }

    /// Positions of the centre and of the earlier and later ring vertex.
    #[inline]
    pub(crate) fn fan_triangle(&self, corner: FanCorner) -> [Vec3; 3] {
        let t = self.mesh.triangle_positions(corner.triangle());
        let [center, from, to] = corner.slots();
        [t[center], t[from], t[to]]
    }

    /// Pairs of fans on different sides of a crease, both ways around, ascending.
    pub(crate) fn fans_across_creases(&self) -> Vec<(u32, u32)> {
        let fan = |corner: u32| self.fans.of_corner(corner as usize);
        let across =
            |&[own, other]: &[[u32; 2]; 2]| own.map(|a| other.map(|b| [(fan(a), fan(b)), (fan(b), fan(a))]));
        let mut pairs: Vec<(u32, u32)> =
            self.creases.iter().flat_map(across).flatten().flatten().filter(|(a, b)| a != b).collect();
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }

    /// The centre vertex' position.
    #[inline]
    pub(crate) fn fan_center(&self, fan: usize) -> Vec3 {
        let corner = self.fans.corners(fan)[0].corner() as usize;
        self.mesh.positions[self.mesh.triangles[corner / 3][corner % 3] as usize]
    }
}

/// The unit normal and area of a triangle.
#[inline]
fn facet([a, b, c]: [Vec3; 3]) -> Vec4 {
    let (u, v) = (b - a, c - a);
    let cross = u.cross(v);
    let squared = cross.length_squared();
    // The cross product is off by at most some ulp of |u| |v|: in single precision a normal to a ten-thousandth, unless the
    // triangle is a sliver (or so small that squares underflow), which lose all their digits.
    if squared > SLIVER * SLIVER * (u.length_squared() * v.length_squared()) && squared > MIN_SQUARED {
        let length = squared.sqrt();
        return (cross / length).extend(0.5 * length);
    }
    let [a, b, c] = [a, b, c].map(|p| p.as_dvec3());
    let cross = (b - a).cross(c - a);
    let length = cross.length();
    (cross / length.max(f64::MIN_POSITIVE)).as_vec3().extend(0.5 * length as f32)
}

/// The sine of the widest angle that needs double precision.
const SLIVER: f32 = 0.02;

/// Squares of cross products from here on are normal numbers, and so are the squares of the lengths.
const MIN_SQUARED: f32 = 1e-30;

// The geometry of one fan, gathered once for all that is asked of it.

/// A fan relative to its centre. Keeps its buffers between fans.
#[derive(Default)]
pub(crate) struct Ring {
    /// The centre's position, mesh space.
    pub(crate) center: Vec3,
    /// True where the fan surrounds its centre.
    pub(crate) closed: bool,
    /// From the centre to the ring vertices in the order of the walk. Triangle `i` lies between spokes `i` and `i + 1`; the
    /// last spoke of a closed fan repeats the first.
    pub(crate) spokes: Vec<Vec3>,
    /// Unit normals of the triangles, on the fan's front side.
    pub(crate) normals: Vec<Vec3>,
    /// Their areas.
    pub(crate) areas: Vec<f32>,
    /// Sum of the triangles' areas.
    pub(crate) area: f32,
}

impl Ring {
    /// Replaces the contents by a fan of the surface.
    pub(crate) fn gather(&mut self, surface: &Surface<'_>, fan: usize) {
        let corners = surface.fans.corners(fan);
        self.center = surface.fan_center(fan);
        self.closed = surface.fans.is_closed(fan);
        self.spokes.clear();
        self.normals.clear();
        self.areas.clear();
        self.area = 0.0;
        for &corner in corners {
            let vertex = surface.mesh.triangles[corner.triangle()][corner.slots()[1]];
            self.spokes.push(surface.mesh.positions[vertex as usize] - self.center);
            let (normal, area) = surface.fan_facet(corner);
            self.normals.push(normal);
            self.areas.push(area);
            self.area += area;
        }
        let last = match corners.last() {
            Some(&last) if !self.closed => surface.fan_triangle(last)[2] - self.center,
            _ => self.spokes[0],
        };
        self.spokes.push(last);
    }
}
