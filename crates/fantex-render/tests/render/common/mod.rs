//! Meshes, cameras and rays that several tests share.
pub(crate) mod golden;
pub(crate) mod looks;
pub(crate) mod staging;
pub(crate) mod tiles;

use fantex_mesh::Mesh;
use fantex_render::{Camera, Hit};
use glam::{DVec3, Vec3};

/// A small deterministic random number generator (xorshift64*, S. Vigna 2014).
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// Uniform in 0..1.
    pub(crate) fn unit(&mut self) -> f32 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform in -1..1.
    pub(crate) fn signed(&mut self) -> f32 {
        self.unit() * 2.0 - 1.0
    }
}

/// A bumpy sheet in [-1, 1]^2 around z = 0: points jittered (so little that no cell folds), random diagonals. No part of it hides another from a
/// camera on the z axis.
pub(crate) fn sheet(cells: usize, bumps: f32, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = Mesh::default();
    let row = cells + 1;
    for y in 0..=cells {
        for x in 0..=cells {
            let on_border = x == 0 || y == 0 || x == cells || y == cells;
            let jitter = if on_border { 0.0 } else { 0.2 };
            let at = |i: usize, r: f32| (i as f32 + jitter * r) / cells as f32 * 2.0 - 1.0;
            let (px, py) = (at(x, random.signed()), at(y, random.signed()));
            mesh.positions.push(Vec3::new(px, py, bumps * random.signed()));
        }
    }
    for y in 0..cells {
        for x in 0..cells {
            let [a, b, c, d] =
                [y * row + x, y * row + x + 1, (y + 1) * row + x + 1, (y + 1) * row + x].map(|i| i as u32);
            let halves = if random.unit() < 0.5 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
            mesh.triangles.extend(halves);
        }
    }
    mesh
}

/// A sphere of radius `radius` around the origin, `segments` x `2 segments` patches.
pub(crate) fn sphere(segments: u32, radius: f32) -> Mesh {
    use std::f32::consts::PI;
    let mut mesh = Mesh::default();
    let ring = 2 * segments;
    mesh.positions.push(Vec3::Y * radius);
    for i in 1..segments {
        let (y, r) = ((PI * i as f32 / segments as f32).cos(), (PI * i as f32 / segments as f32).sin());
        for j in 0..ring {
            let angle = 2.0 * PI * j as f32 / ring as f32;
            mesh.positions.push(Vec3::new(r * angle.sin(), y, r * angle.cos()) * radius);
        }
    }
    mesh.positions.push(Vec3::NEG_Y * radius);
    let bottom = mesh.positions.len() as u32 - 1;
    let at = |i: u32, j: u32| 1 + (i - 1) * ring + j % ring;
    for j in 0..ring {
        mesh.triangles.push([0, at(1, j), at(1, j + 1)]);
        for i in 1..segments - 1 {
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
        mesh.triangles.push([bottom, at(segments - 1, j + 1), at(segments - 1, j)]);
    }
    mesh
}

/// A unit square around the origin in the xy plane, facing +z, with upright texture coordinates.
pub(crate) fn square() -> Mesh {
    let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
    let mut mesh = Mesh {
        positions: corners.iter().map(|&[x, y]| Vec3::new(x, y, 0.0)).collect(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        materials: vec![fantex_mesh::Material::default()],
        ..Mesh::default()
    };
    let uv = mesh
        .triangles
        .iter()
        .flatten()
        .map(|&v| mesh.positions[v as usize])
        .map(|p| glam::Vec2::new(p.x + 0.5, 0.5 - p.y))
        .collect();
    mesh.corners.uv_sets = vec![uv];
    mesh
}

/// A camera that looks along -z.
pub(crate) fn frontal(distance: f64, fov_degrees: f64) -> Camera {
    Camera { eye: DVec3::Z * distance, target: DVec3::ZERO, up: DVec3::Y, fov_degrees }
}

/// The ray through a position in pixels, by the camera's definition.
pub(crate) fn ray(camera: &Camera, size: [u32; 2], x: f64, y: f64) -> DVec3 {
    let forward = (camera.target - camera.eye).normalize();
    let right = forward.cross(camera.up).normalize();
    let up = right.cross(forward);
    let [width, height] = size.map(f64::from);
    let tangent = (camera.fov_degrees.to_radians() / 2.0).tan();
    let (sx, sy) = ((x / width * 2.0 - 1.0) * tangent * width / height, (1.0 - y / height * 2.0) * tangent);
    forward + right * sx + up * sy
}

/// The nearest intersection of a ray: triangle and barycentric coordinates.
pub(crate) fn cast(mesh: &Mesh, origin: DVec3, direction: DVec3) -> Option<(usize, DVec3)> {
    let mut best: Option<(f64, usize, DVec3)> = None;
    for t in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.triangle_positions(t).map(|p| p.as_dvec3());
        let n = (b - a).cross(c - a);
        let s = (a - origin).dot(n) / direction.dot(n);
        let p = origin + direction * s;
        let area = |u: DVec3, v: DVec3| (u - p).cross(v - p).dot(n) / n.length_squared();
        let lambda = DVec3::new(area(b, c), area(c, a), area(a, b));
        if s > 0.0 && lambda.min_element() >= 0.0 && best.is_none_or(|b| s < b.0) {
            best = Some((s, t, lambda));
        }
    }
    best.map(|(_, t, lambda)| (t, lambda))
}

/// A colour that tells triangles apart.
pub(crate) fn triangle_color(hit: &Hit) -> Vec3 {
    let h = (hit.triangle as u32).wrapping_mul(2_654_435_761);
    Vec3::new((h >> 24) as f32, (h >> 16 & 255) as f32, (h >> 8 & 255) as f32) / 255.0
}
