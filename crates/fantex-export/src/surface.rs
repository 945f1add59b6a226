//! What pictures are made of.

use fantex_bake::{Prefilter, Progress};
use fantex_mesh::{Mesh, interpolate};
use fantex_store::ChannelKind;
use fantex_texture::material::TangentFrame;
use glam::{Vec2, Vec3, Vec4};

use crate::ChannelMap;
use crate::export::Map;
use crate::layout::{Page, Placed};
use crate::texels::{Region, Values};

/// A textured surface.
pub(crate) trait Surface: Sync {
    fn mesh(&self) -> &Mesh;

    /// Texels per mesh unit of length that its texture has.
    fn texels_per_unit(&self) -> f32;

    fn channels(&self) -> Vec<ChannelKind>;

    /// What a picture of it shows; none where it has no such channel.
    fn map(&self, kind: ChannelMap) -> Option<Map>;

    /// How values relate to the texel's centre.
    fn prefilter(&self) -> Prefilter;

    /// Linear values of every map at the points of a region, one list per map.
    fn values(&self, page: &Page, region: &Region, maps: &[Map], frames: &Frames<'_>) -> Vec<Values>;

    /// The largest red, green or blue number, at least 1; none where only all texels tell, anything once `progress` is cancelled.
    fn largest(&self, map: &Map, progress: &dyn Progress) -> Option<f32>;

    /// Pieces that could not be read and were replaced by coarser ones; the first, with its reason.
    fn damage(&self) -> Option<(u64, String)>;
}

/// The frames of normal maps.
pub(crate) struct Frames<'a> {
    /// Unit normals, one per corner.
    pub(crate) normals: &'a [Vec3],
    /// Tangents of the layout's coordinates, one per corner; empty where no normals are wanted.
    pub(crate) tangents: &'a [Vec4],
}

/// Those of one triangle.
pub(crate) struct TriangleFrames {
    normals: [Vec3; 3],
    tangents: [Vec4; 3],
}

impl Frames<'_> {
    /// `steps`: change of the barycentric coordinates per texel to the right and downwards.
    pub(crate) fn of_triangle(&self, mesh: &Mesh, placed: &Placed, steps: [Vec3; 2]) -> TriangleFrames {
        let triangle = placed.triangle as usize;
        let normals = [0, 1, 2].map(|k| self.normals[3 * triangle + k]);
        let tangents = match self.tangents.get(3 * triangle..3 * triangle + 3) {
            Some(own) if !placed.is_beyond() => [own[0], own[1], own[2]],
            _ => tangents_of_picture(mesh, triangle, &normals, steps),
        };
        TriangleFrames { normals, tangents }
    }
}

impl TriangleFrames {
    /// The vertices' normal at a point, unit.
    pub(crate) fn normal(&self, lambda: Vec3) -> Vec3 {
        interpolate(self.normals, lambda).normalize_or(Vec3::Z)
    }

    /// A normal in mesh space, of any length, as the texel of a normal map; what points backwards is turned to the nearest one in front.
    pub(crate) fn texel(&self, n_mesh: Vec3, lambda: Vec3) -> Vec4 {
        let frame = TangentFrame::at(&self.normals, &self.tangents, 0, lambda);
        let mut relative = frame.relative(n_mesh.normalize_or(self.normal(lambda))).unwrap_or(Vec3::Z);
        if relative.z < 0.0 {
            relative = Vec3 { z: 0.0, ..relative }.normalize_or(Vec3::Z);
        }
        (relative * 0.5 + 0.5).extend(1.0)
    }
}

/// Twice the area, in texels of a picture, below which a triangle has none.
pub(crate) const NO_AREA: f32 = 1e-9;

/// Change of the barycentric coordinates per texel to the right and downwards: over all of a triangle where it has no area, so that it shows
/// its mean.
pub(crate) fn lambda_steps([a, b, c]: [Vec2; 3]) -> [Vec3; 2] {
    let area = (b - a).perp_dot(c - a);
    if area.abs() < NO_AREA {
        return [Vec3::new(-1.0, 1.0, 0.0), Vec3::new(-1.0, 0.0, 1.0)];
    }
    [Vec3::new(b.y - c.y, c.y - a.y, a.y - b.y) / area, Vec3::new(c.x - b.x, a.x - c.x, b.x - a.x) / area]
}

/// Tangents along the picture's rows, for triangles that continue a chart.
fn tangents_of_picture(mesh: &Mesh, triangle: usize, normals: &[Vec3; 3], steps: [Vec3; 2]) -> [Vec4; 3] {
    let along = interpolate(mesh.triangle_positions(triangle), steps[0]);
    normals.map(|n| (along - n * n.dot(along)).normalize_or(n.any_orthonormal_vector()).extend(1.0))
}
