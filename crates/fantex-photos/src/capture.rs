//! Taking photographs of a model: sets with known cameras, to try things out and to measure against.

use fantex_bake::{Source, SurfacePoint};
use fantex_mesh::{Mesh, TriangleBvh, shading_normals};
use fantex_store::ChannelKind;
use fantex_texture::Image;
use glam::{DVec2, DVec3, Vec3, Vec4};
use rayon::prelude::*;

use crate::Photograph;
use crate::sight::MeshCamera;
use crate::view::mesh_camera;

/// How to take a photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureOptions {
    /// Rays along each side of a pixel, at least 1.
    pub samples: u32,
    /// Factor of red, green and blue, linear light.
    pub exposure: Vec3,
    /// What is seen beside the model, linear; exposed, too.
    pub background: Vec3,
}

impl Default for CaptureOptions {
    /// Nine rays per pixel, exposed as it is, before a grey wall.
    fn default() -> Self {
        Self { samples: 3, exposure: Vec3::ONE, background: Vec3::splat(0.18) }
    }
}

/// The picture that a photograph's camera takes of the base colour of a mesh, through its lens: linear RGB, as if lit from everywhere.
/// Rays go through the lens, so any distortion is exact.
pub fn capture(
    mesh: &Mesh,
    bvh: &TriangleBvh,
    source: &dyn Source,
    photograph: &Photograph,
    options: &CaptureOptions,
) -> Image {
    let channels = source.channels();
    let camera = mesh_camera(photograph, mesh);
    let taker = Taker {
        mesh,
        bvh,
        source,
        base_color: channels.iter().position(|c| c.kind == ChannelKind::BaseColor),
        channels: channels.len(),
        normals: shading_normals(mesh),
        mesh_from_camera: camera.rotation.transpose(),
        camera,
        options,
    };
    let [width, height] = photograph.camera.size;
    let pixels: Vec<f32> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| (0..width).map(move |x| [x, y]))
        .flat_map_iter(|pixel| taker.pixel(pixel).to_array())
        .collect();
    Image::from_linear(width, height, 3, pixels)
}

struct Taker<'a> {
    mesh: &'a Mesh,
    bvh: &'a TriangleBvh,
    source: &'a dyn Source,
    base_color: Option<usize>,
    channels: usize,
    normals: Vec<Vec3>,
    mesh_from_camera: glam::DMat3,
    camera: MeshCamera,
    options: &'a CaptureOptions,
}

impl Taker<'_> {
    fn pixel(&self, [x, y]: [u32; 2]) -> Vec3 {
        let samples = self.options.samples.max(1);
        let step = 1.0 / f64::from(samples);
        let mut sum = Vec3::ZERO;
        for i in 0..samples * samples {
            let offset = DVec2::new(f64::from(i % samples) + 0.5, f64::from(i / samples) + 0.5) * step;
            let at = DVec2::new(f64::from(x), f64::from(y)) + offset;
            sum += self.seen(at, step).unwrap_or(self.options.background);
        }
        sum / (samples * samples) as f32 * self.options.exposure
    }

    fn direction(&self, at: DVec2) -> Option<DVec3> {
        Some(self.mesh_from_camera * self.camera.camera.direction(at)?)
    }

    fn seen(&self, at: DVec2, step: f64) -> Option<Vec3> {
        let direction = self.direction(at)?;
        // Rays begin near the mesh, where single precision is enough.
        let start = self.camera.eye + direction * (self.camera.eye.length() - 2.0).max(0.0);
        let hit = self.bvh.first_hit(start.as_vec3(), direction.as_vec3(), f32::INFINITY)?;
        let corners = self.mesh.triangle_positions(hit.triangle).map(|c| c.as_dvec3());
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let on_plane = |direction: DVec3| {
            self.camera.eye + direction * (normal.dot(corners[0] - self.camera.eye) / normal.dot(direction))
        };
        let middle = on_plane(direction);
        let steps = [DVec2::X, DVec2::Y].map(|axis| {
            let beside = self.direction(at + axis * step).map(on_plane);
            beside.filter(|p| p.is_finite()).map_or(DVec3::ZERO, |p| p - middle)
        });
        let squared = normal.length_squared();
        let lambda_step = |step: DVec3| {
            let along = |from: DVec3, to: DVec3| normal.cross(to - from).dot(step) / squared;
            let [a, b, c] = corners;
            DVec3::new(along(b, c), along(c, a), along(a, b)).as_vec3()
        };
        let vertex_normals = [0, 1, 2].map(|k| self.normals[3 * hit.triangle + k]);
        let blend = |v: [Vec3; 3]| v[0] * hit.lambda.x + v[1] * hit.lambda.y + v[2] * hit.lambda.z;
        let point = SurfacePoint {
            triangle: hit.triangle,
            lambda: hit.lambda,
            lambda_steps: steps.map(lambda_step),
            position: blend(self.mesh.triangle_positions(hit.triangle)),
            position_steps: steps.map(|s| s.as_vec3()),
            normal: blend(vertex_normals).try_normalize().unwrap_or(normal.normalize().as_vec3()),
        };
        let mut values = vec![Vec4::ZERO; self.channels];
        self.source.evaluate(&point, &mut values);
        Some(self.base_color.map_or(Vec3::ONE, |channel| values[channel].truncate()))
    }
}
