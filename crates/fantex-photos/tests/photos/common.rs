//! A textured model, and photographs of it with known cameras.

use std::path::{Path, PathBuf};

use fantex_bake::{LookSource, Source, TexelPoint};
use fantex_mesh::{CleanOptions, LoadOptions, Mesh, clean, load, shading_normals};
use fantex_photos::{
    CameraFromWorld, CaptureOptions, CaptureScene, Distortion, Lens, PhotoCamera, Photograph,
};
use fantex_texture::color::srgb_from_linear;
use fantex_texture::{ColorSpace, Depth};
use glam::{DVec3, Vec3, Vec4};

pub(crate) fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The model that comes with the repository.
pub(crate) fn bottle() -> Mesh {
    let path = workspace().join("assets/WaterBottle/WaterBottle.gltf");
    clean(load(&path, &LoadOptions::default()).unwrap(), &CleanOptions::default()).unwrap().0
}

/// A barrel distortion with everything in it.
pub(crate) fn barrel() -> Lens {
    Lens::new(Distortion::Perspective {
        radial: [-0.15, 0.02, 0.0, 0.0, 0.0, 0.0],
        tangential: [1e-3, -2e-3],
    })
}

pub(crate) fn fisheye() -> Lens {
    Lens::new(Distortion::fisheye([-0.03, 0.004, -0.002, 0.0]))
}

pub(crate) fn thin_prism() -> Lens {
    Lens::new(Distortion::Fisheye {
        radial: [0.05, -0.01, 0.0, 0.0],
        tangential: [4e-3, -3e-3],
        prism: [8e-3, -5e-3],
    })
}

pub(crate) fn field_of_view() -> Lens {
    Lens::new(Distortion::FieldOfView { omega: 0.8 })
}

/// Cameras on rings around a mesh, from above and below, that show it whole; none looks at it from straight below.
pub(crate) fn cameras(
    mesh: &Mesh,
    count: usize,
    size: [u32; 2],
    lenses: &[Lens],
    folder: &Path,
) -> Vec<Photograph> {
    let world = mesh.world_from_mesh;
    let radius = mesh.positions.iter().map(|p| p.length()).fold(0.0, f32::max) as f64;
    (0..count)
        .map(|i| {
            let angle = i as f64 * 2.399_963;
            let height = [0.15, 0.6, -0.35, 0.95][i % 4];
            let direction = DVec3::new(angle.sin(), height, angle.cos()).normalize();
            let distance = 3.2 * radius * (1.0 + 0.15 * (i % 3) as f64);
            let pose = CameraFromWorld::looking_at(
                world.offset + direction * distance * world.scale,
                world.offset + DVec3::new(0.03, 0.05, 0.02) * radius * world.scale,
                DVec3::Y,
            );
            let focal = 2.4 * f64::from(size[0].min(size[1]));
            let name = format!("{i:03}.png");
            let mut camera = PhotoCamera::pinhole(size, focal);
            camera.center += glam::DVec2::new(3.0, -2.0);
            camera.lens = lenses[i % lenses.len()];
            Photograph { path: folder.join(&name), mask: None, name, camera, camera_from_world: pose }
        })
        .collect()
}

/// Takes all photographs and writes them; `exposure` per photograph.
pub(crate) fn take(
    mesh: &Mesh,
    source: &dyn Source,
    photographs: &[Photograph],
    exposure: impl Fn(usize) -> Vec3,
) {
    let scene = CaptureScene::new(mesh, source);
    for (i, photograph) in photographs.iter().enumerate() {
        let options = CaptureOptions { samples: 2, exposure: exposure(i), ..CaptureOptions::default() };
        let picture = scene.capture(photograph, &options, &|| false).unwrap();
        picture.converted(Depth::U8, ColorSpace::Srgb).save(&photograph.path).unwrap();
    }
}

/// Differences of two sources' base colours, sRGB 0..1, at points spread over the surface.
pub(crate) struct Difference {
    /// Root mean square.
    pub(crate) rms: f64,
    /// The value below which 95 % of the points are.
    pub(crate) p95: f64,
    /// Points that count.
    pub(crate) count: usize,
}

/// Compares sources at one point of every triangle, for texels of a width in mesh units, where `counts` says so.
pub(crate) fn difference(
    mesh: &Mesh,
    [a, b]: [&dyn Source; 2],
    texel: f32,
    counts: impl Fn(&TexelPoint) -> bool,
) -> Difference {
    let normals = shading_normals(mesh);
    // Squared difference and area.
    let mut squares: Vec<(f64, f64)> = Vec::new();
    for triangle in 0..mesh.triangles.len() {
        let corners = mesh.triangle_positions(triangle);
        let lambda =
            [Vec3::splat(1.0 / 3.0), Vec3::new(0.6, 0.3, 0.1), Vec3::new(0.1, 0.2, 0.7)][triangle % 3];
        let point = point_of(corners, triangle, lambda, normals[3 * triangle], texel);
        if !counts(&point) {
            continue;
        }
        let (a, b) = (encoded_color(a, &point), encoded_color(b, &point));
        let area = (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        squares.push((f64::from((a - b).length_squared()) / 3.0, f64::from(area)));
    }
    squares.sort_by(|a, b| a.0.total_cmp(&b.0));
    let area: f64 = squares.iter().map(|s| s.1).sum();
    let mut below = 0.0;
    let p95 = squares.iter().find(|s| {
        below += s.1;
        below >= 0.95 * area
    });
    Difference {
        rms: (squares.iter().map(|s| s.0 * s.1).sum::<f64>() / area).sqrt(),
        p95: p95.unwrap().0.sqrt(),
        count: squares.len(),
    }
}

/// The base colour of a source at a point, sRGB.
pub(crate) fn encoded_color(source: &dyn Source, point: &TexelPoint) -> Vec3 {
    let mut values = vec![Vec4::ZERO; source.channels().len()];
    source.evaluate(point, &mut values);
    Vec3::from(values[0].truncate().to_array().map(|c| srgb_from_linear(c.clamp(0.0, 1.0))))
}

/// A texel on a triangle.
pub(crate) fn point_of(
    corners: [Vec3; 3],
    triangle: usize,
    lambda: Vec3,
    normal: Vec3,
    texel: f32,
) -> TexelPoint {
    let along = (corners[1] - corners[0]).normalize();
    let face = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let steps = [along * texel, face.normalize().cross(along) * texel];
    let lambda_of = |step: Vec3| {
        let part = |from: Vec3, to: Vec3| face.cross(to - from).dot(step) / face.length_squared();
        Vec3::new(part(corners[1], corners[2]), part(corners[2], corners[0]), part(corners[0], corners[1]))
    };
    TexelPoint {
        at: fantex_mesh::SurfacePoint { triangle: triangle as u32, lambda },
        lambda_steps: steps.map(lambda_of),
        position: fantex_mesh::interpolate(corners, lambda),
        position_steps: steps,
        normal,
    }
}

/// The model's own look.
pub(crate) fn own_look(mesh: &Mesh) -> LookSource<'_> {
    LookSource::of_model(mesh).unwrap()
}
