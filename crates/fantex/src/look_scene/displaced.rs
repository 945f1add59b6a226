//! Displacement mapping of a dressed model.

use fantex_look::{Key, LookError, LookProblem};
use fantex_mesh::{DisplaceOptions, DisplacePoint, Mesh, Refinement, displace};
use fantex_texture::look::{Resolver, Slot};
use fantex_texture::material::vertex_color;
use fantex_texture::{Filtering, ShadingPoint, UvPoint};
use glam::{Vec2, Vec3};

use super::{Dress, Wardrobe};

/// A material's heights, in mesh units.
struct Heights {
    texture: Slot,
    /// Mesh units per unit of the texture.
    height: f32,
    middle: f32,
}

/// The mesh with the displacements of what it wears as real geometry; as it is where there are none.
pub(super) fn displaced(wardrobe: &Wardrobe<'_>, mesh: Mesh, dress: &Dress) -> Result<Mesh, LookError> {
    let scale = mesh.world_from_mesh.scale;
    let mut resolver = Resolver::new(wardrobe.file, &mesh, wardrobe.images, wardrobe.options);
    let mut heights: Vec<Option<Heights>> = Vec::new();
    let mut options = DisplaceOptions { max_triangles: 0, ..DisplaceOptions::default() };
    let mut edge = f64::INFINITY;
    let mut key = Key::default();
    for name in &dress.names {
        let table = name.as_ref().and_then(|n| wardrobe.file.look().materials.get(n)?.displacement.as_ref());
        let (Some(name), Some(table)) = (name, table) else {
            heights.push(None);
            continue;
        };
        let Some(texture) = resolver.displacement(name)? else { continue };
        key = Key::of(["materials", name, "displacement"]);
        let height = (table.height / scale) as f32;
        heights.push(Some(Heights { texture, height, middle: table.middle as f32 }));
        options.max_triangles = options.max_triangles.max(table.max_triangles);
        // A hundredth of the model's largest extent, which is between 1 and 2 mesh units.
        edge = edge.min(table.edge.map_or(0.01, |edge| edge / scale));
    }
    if heights.iter().all(Option::is_none) {
        return Ok(mesh);
    }
    options.refinement = Refinement::Uniform { longest_edge: edge as f32 };
    let ask = |point: &DisplacePoint| match heights.get(mesh.material_of(point.triangle)) {
        Some(Some(heights)) => heights.at(&mesh, point, edge as f32),
        _ => 0.0,
    };
    let result = displace(&mesh, &options, ask);
    let (displaced, _) = result.map_err(|error| wardrobe.file.error(&key, LookProblem::refused(error)))?;
    Ok(displaced)
}

impl Heights {
    /// In mesh units, averaged over about one of the small triangles.
    fn at(&self, mesh: &Mesh, point: &DisplacePoint, width: f32) -> f32 {
        let scale = mesh.world_from_mesh.scale as f32;
        let (along, across) = point.normal.any_orthonormal_pair();
        let steps_mesh = [along * width, across * width];
        let uv: Vec<UvPoint> =
            mesh.corners.uv_sets.iter().map(|set| uv_point(mesh, set, point, steps_mesh)).collect();
        let at = ShadingPoint {
            position: point.position * scale,
            position_steps: steps_mesh.map(|step| step * scale),
            normal: point.normal,
            normal_steps: [Vec3::ZERO; 2],
            uv: &uv,
            vertex_color: vertex_color(mesh, point.triangle, point.lambda),
            to_eye: None,
            time: 0.0,
            filtering: Filtering::Area,
        };
        self.height * (self.texture.evaluate_number(&at) - self.middle)
    }
}

/// Coordinates change with the position as over the flat triangle.
fn uv_point(mesh: &Mesh, set: &[Vec2], point: &DisplacePoint, steps_mesh: [Vec3; 2]) -> UvPoint {
    let Some(corners) = set.get(3 * point.triangle..3 * point.triangle + 3) else {
        return UvPoint::default();
    };
    let [a, b, c] = mesh.triangle_positions(point.triangle);
    let (ab, ac) = (b - a, c - a);
    let normal = ab.cross(ac);
    let scale = normal.length_squared().recip();
    let steps = steps_mesh.map(|step| {
        let (along_ab, along_ac) = (step.cross(ac).dot(normal) * scale, ab.cross(step).dot(normal) * scale);
        let change = (corners[1] - corners[0]) * along_ab + (corners[2] - corners[0]) * along_ac;
        if change.is_finite() { change } else { Vec2::ZERO }
    });
    let l = point.lambda;
    UvPoint { uv: corners[0] * l.x + corners[1] * l.y + corners[2] * l.z, steps }
}
