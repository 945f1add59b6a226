//! Pictures of a million textured triangles, beside the same pictures by a software rasteriser: that of the Vulkan driver
//! (Mesa's), on the same cores in the same run.

use std::error::Error;
use std::path::Path;

use fantex::glam::{DVec3, Mat3, Vec2};
use fantex::gpu::{DrawOptions, Frame, Gpu, GpuOptions, UvModel, frame_times};
use fantex::mesh::generate::grid;
use fantex::mesh::{self, CleanOptions, ImageSource, Mesh, TextureRef, WrapMode};
use fantex::render::{Camera, FilterOptions, Lights, LookSurface, RenderOptions, render};
use fantex::texture::{ColorSpace, Filter, Image, Samples};

use crate::{Measured, Row, fastest};

/// Frames of the peer; the fastest counts.
const FRAMES: usize = 5;

/// Rendering with a texture of 4096 x 4096 texels at one sample per pixel: lit, and as the texture is.
pub(crate) fn rows() -> Measured {
    let folder = tempfile::tempdir()?;
    let mut mesh = textured_terrain(707, folder.path())?;
    let gpu = software_gpu();
    let mut rows = Vec::new();
    for (light, is_unlit) in [("lit", false), ("unlit", true)] {
        mesh.materials[0].unlit = is_unlit;
        for (name, filter) in [("trilinear", Filter::Trilinear), ("anisotropic 8:1", Filter::Anisotropic)] {
            let filter = FilterOptions { filter, max_anisotropy: 8.0 };
            let row = Row::new(
                format!("render 1 M triangles, 1280x720, {light}, {name}"),
                on_the_cpu(&mesh, filter)?,
                "ms",
            );
            let peer = gpu.as_ref().map(|gpu| by_the_driver(gpu, &mesh, filter)).transpose()?;
            rows.push(row.beside(peer));
        }
    }
    Ok(rows)
}

/// The driver that draws without a graphics card, or a note that there is none.
fn software_gpu() -> Option<Gpu> {
    match Gpu::headless(&GpuOptions { software: true }) {
        Ok(gpu) => {
            eprintln!("the peer of pictures of a million triangles is {}", gpu.info().name);
            Some(gpu)
        }
        Err(error) => {
            eprintln!("no software rasteriser to compare pictures of a million triangles with: {error}");
            None
        }
    }
}

fn camera(mesh: &Mesh) -> Camera {
    Camera::framing_mesh(mesh, DVec3::new(0.3, 0.8, 1.0), 1280.0 / 720.0)
}

/// Milliseconds of the fastest picture.
fn on_the_cpu(mesh: &Mesh, filter: FilterOptions) -> Result<f64, Box<dyn Error>> {
    let options = RenderOptions { samples: 1, ..RenderOptions::default() };
    let (camera, surface) = (camera(mesh), LookSurface::of_model(mesh, filter)?);
    Ok(1e3 * fastest(|| render(mesh, &surface, &camera, &Lights::behind(&camera), &options))?)
}

/// Milliseconds of the fastest frame.
fn by_the_driver(gpu: &Gpu, mesh: &Mesh, filter: FilterOptions) -> Result<f64, Box<dyn Error>> {
    let camera = camera(mesh);
    let (mut model, lights) = (UvModel::load(gpu, mesh)?, Lights::behind(&camera));
    let options = DrawOptions { filter, samples: 1, tone_map: None, ..DrawOptions::default() };
    let (camera, lights, options, size) = (&camera, &lights, &options, [1280, 720]);
    let times = frame_times(gpu, &mut Frame { size, camera, lights, model: &mut model, options }, FRAMES)?;
    Ok(1e3 * times.minimum().as_secs_f64())
}

/// Hills of `2 n n` triangles under one image of 4096 x 4096 texels.
fn textured_terrain(n: u32, folder: &Path) -> Result<Mesh, Box<dyn Error>> {
    let mut model = grid(n);
    for p in &mut model.positions {
        p.y = 0.1 * (15.0 * p.x).sin() * (10.0 * p.z).cos() + 0.02 * (85.0 * p.x + 15.0 * p.z).sin();
    }
    let corners = model.triangles.iter().flatten();
    let uv =
        corners.map(|&v| model.positions[v as usize]).map(|p| 0.5 * Vec2::new(p.x as f32, p.z as f32) + 0.5);
    model.corners.uv_sets = vec![uv.collect()];
    let side = 4096;
    let texels = (0..side * side)
        .map(|i| {
            let [x, y] = [i % side, i / side];
            let dark = (x / 64 + y / 64) % 2 == 0;
            [if dark { 40 } else { 220 }, (x >> 4) as u8, (y >> 4) as u8, 255]
        })
        .collect::<Vec<[u8; 4]>>();
    let image = Image {
        width: side,
        height: side,
        channels: 4,
        space: ColorSpace::Srgb,
        samples: Samples::U8(texels.into_flattened()),
    };
    let path = folder.join("checks.png");
    image.save(&path)?;
    model.images.push(ImageSource::File(path));
    model.materials[0].base_color_texture = Some(TextureRef {
        image: 0,
        uv_set: 0,
        uv_transform: Mat3::IDENTITY,
        wrap: [WrapMode::Repeat; 2],
        nearest: false,
    });
    Ok(mesh::clean(model, &CleanOptions::default())?.0)
}
