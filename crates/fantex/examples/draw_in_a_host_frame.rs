//! Draws an asset into a frame of a host that has its own wgpu device and target.
//!
//! ```text
//! cargo run -p fantex --features gpu --example draw_in_a_host_frame
//! ```

use std::error::Error;
use std::time::Duration;

use fantex::gpu::{DrawOptions, Frame, Gpu, Model, Renderer, StreamedModel, stream_view};
use fantex::mesh::generate::torus;
use fantex::scene::{Camera, Lights};
use fantex::{Asset, Baker, Mesh, Source};

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::temp_dir().join("fantex-example-wood.fan");
    let mesh = Mesh::from_model(torus(48, 24), "torus")?;
    Baker::new(&mesh).source(Source::solid("wood")).texels(100_000).overwrite(true).write(&path)?;
    let asset = Asset::open(&path)?;

    // The host's own device and target; a window's surface texture takes its place.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let Ok(adapter) = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))
    else {
        println!("there is no graphics adapter, not even a software one");
        return Ok(());
    };
    let opened = pollster::block_on(adapter.request_device(&Gpu::wanted_device_descriptor(&adapter)));
    let (device, queue) = opened?;
    let (size, format) = ([640, 480], wgpu::TextureFormat::Rgba8UnormSrgb);
    let target = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("host frame"),
        size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });

    let gpu = Gpu::from_parts(&adapter, device.clone(), queue.clone());
    let mut streamed = StreamedModel::open(&gpu, asset.shared().clone(), 64 << 20)?;
    let camera = Camera::framing_mesh(asset.mesh(), Camera::THREE_QUARTER, 4.0 / 3.0);
    let (lights, options) = (Lights::behind(&camera), DrawOptions::default());
    let view = stream_view(&camera, size, streamed.model.space());
    // A host calls `advance` once per frame instead, and draws what has come so far.
    streamed.wait_until_sharp(&gpu, &view, &options.filter, Duration::from_secs(60))?;

    let mut renderer = Renderer::new(&gpu, format);
    let mut commands = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let model = &mut streamed.model;
    let mut frame = Frame { size, camera: &camera, lights: &lights, model, options: &options };
    renderer.draw(
        &gpu,
        &mut commands,
        &target.create_view(&wgpu::TextureViewDescriptor::default()),
        &mut frame,
    )?;
    queue.submit([commands.finish()]);
    println!("drawn by {}", gpu.info().name);
    Ok(())
}
