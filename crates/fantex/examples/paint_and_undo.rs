//! Paints a stroke onto an asset, and takes it back.
//!
//! ```text
//! cargo run -p fantex --features paint --example paint_and_undo
//! ```

use std::error::Error;

use fantex::glam::{Vec3, Vec4};
use fantex::mesh::generate::icosphere;
use fantex::paint::{
    BlendMode, Brush, ChannelPaint, Paint, PaintColor, PaintOptions, Painter, Sample, Size, Stroke, Symmetry,
    Tool, dabs_of,
};
use fantex::{Asset, Baker, ChannelKind, Footprint, Mesh, Source};

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::temp_dir().join("fantex-example-painted.fan");
    let mesh = Mesh::from_model(icosphere(4), "sphere")?;
    Baker::new(&mesh).source(Source::solid("clouds")).texels(200_000).overwrite(true).write(&path)?;
    let color = || -> Result<Vec4, Box<dyn Error>> {
        let asset = Asset::open(&path)?;
        let point = asset.nearest_point([0.0, 0.0, 1.0]).ok_or("no point of the world")?;
        Ok(asset.sampler(16 << 20).sample(ChannelKind::BaseColor, point, Footprint::NONE)?)
    };
    println!("before        {:.3}", color()?);

    let mut painter = Painter::open(&path, &PaintOptions::default())?;
    let surface = painter.surface().clone();
    let along = (-4..=4).filter_map(|i| surface.nearest(Vec3::new(0.1 * i as f32, 0.0, 1.0), f32::INFINITY));
    let stroke = Stroke {
        brush: Brush { size: Size::Texels(40.0), ..Brush::default() },
        stamp: None,
        samples: along.map(Sample::at).collect(),
        line: false,
        symmetry: Symmetry::None,
    };
    let red = ChannelPaint::new(0, PaintColor::Constant(Vec4::new(0.8, 0.05, 0.05, 1.0)));
    let paint = Paint {
        tool: Tool::Paint(BlendMode::Normal),
        opacity: 1.0,
        channels: vec![red],
        stencil: None,
        sight: None,
    };
    painter.begin("red line", paint)?;
    painter.dab(&dabs_of(&surface, &stroke))?;
    painter.end()?;
    painter.commit()?;
    println!("painted       {:.3}", color()?);

    painter.undo()?;
    painter.commit()?;
    println!("taken back    {:.3}", color()?);
    Ok(())
}
