//! How fast painting is: opening, dabs, the end of a stroke, undo.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use fantex::base::files::scratch_folder;
use fantex::paint::{
    BlendMode, Brush, ChannelPaint, Dab, Layer, Paint, PaintColor, PaintOptions, Painter, Sample, Size,
    Stroke, Surface, Symmetry, Target, Tool, dabs_of,
};
use fantex::{Error, Result};
use glam::{Vec3, Vec4};

use super::Row;
use crate::context::Context;
use crate::scene::open_asset;

/// Paint a long stroke onto a copy of an asset, dab by dab: what a dab takes up to the visible update, the end of the stroke,
/// undo, redo, the commit; then what strokes wait for: one right after another in the same place, a large one in all channels, one
/// under layers; and how long opening takes, of each asset that is named.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex bench paint statue.fan
  fantex bench paint small.fan large.fan --json")]
pub(super) struct PaintBenchArgs {
    /// Assets (.fan): the first one is painted on, all are opened
    #[arg(required = true)]
    assets: Vec<PathBuf>,
    /// Diameter of the brush in texels
    #[arg(long, value_name = "TEXELS", default_value_t = 200.0, value_parser = crate::text::positive)]
    brush: f64,
    /// Dabs of the stroke
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 300, value_parser = crate::text::whole::<usize>)]
    dabs: usize,
}

pub(super) fn paint(args: &PaintBenchArgs, context: &Context) -> Result<Vec<Row>> {
    let options = PaintOptions { memory_bytes: context.memory_bytes as usize, ..PaintOptions::default() };
    let mut rows = Vec::new();
    for asset in &args.assets {
        rows.extend(opening(asset, &options)?);
    }
    let folder = scratch_folder()?;
    let copy = folder.path().join("painted.fan");
    std::fs::copy(&args.assets[0], &copy).map_err(|error| Error::reading(&args.assets[0], error))?;
    let mut painter = Painter::open(&copy, &options)?;
    rows.extend(stroke(&mut painter, args)?);
    rows.extend(strokes_in_a_row(&mut painter, args)?);
    Ok(rows)
}

fn milliseconds(since: Instant) -> f64 {
    1e3 * since.elapsed().as_secs_f64()
}

fn opening(asset: &Path, options: &PaintOptions) -> Result<Vec<Row>> {
    // Opening to read says what is wrong with files of other kinds.
    drop(open_asset(asset)?);
    let started = Instant::now();
    let opened = Painter::open(asset, options)?;
    let time = milliseconds(started);
    let cover = opened.surface().cover();
    let texels: f64 = cover.groups.iter().map(|g| f64::from(g.extent[0]) * f64::from(g.extent[1])).sum();
    let triangles = opened.surface().mesh().triangles.len();
    let name = format!("open {}: {:.1} M texels, {triangles} triangles", asset.display(), 1e-6 * texels);
    Ok(vec![Row::new(name, time, "ms")])
}

fn stroke(painter: &mut Painter, args: &PaintBenchArgs) -> Result<Vec<Row>> {
    let surface = Arc::clone(painter.surface());
    let dabs = dabs_around(&surface, args.brush as f32, args.dabs);
    begin(painter, Target::Base, 1)?;
    let mut times = Vec::with_capacity(dabs.len());
    for dab in &dabs {
        let started = Instant::now();
        painter.dab(std::slice::from_ref(dab))?;
        painter.show()?;
        times.push(milliseconds(started));
    }
    times.sort_by(f64::total_cmp);
    let share = |share: f64| times.get((times.len().saturating_sub(1) as f64 * share) as usize).copied();
    let mut rows = vec![
        Row::new("dab, median", share(0.5).unwrap_or(0.0), "ms"),
        Row::new("dab, 99 of 100", share(0.99).unwrap_or(0.0), "ms"),
    ];
    rows.push(timed("end of the stroke", || painter.end_in_background().map(drop))?);
    rows.push(timed("its coarser levels", || painter.finish_levels().map(drop))?);
    rows.push(timed("undo", || painter.undo().map(drop))?);
    rows.push(timed("redo", || painter.redo().map(drop))?);
    rows.push(timed("commit", || painter.commit().map(drop))?);
    rows.push(Row::new("dabs of the stroke", dabs.len() as f64, ""));
    Ok(rows)
}

fn timed(name: &str, run: impl FnOnce() -> Result<()>) -> Result<Row> {
    let started = Instant::now();
    run()?;
    Ok(Row::new(name, milliseconds(started), "ms"))
}

/// Begins a stroke in the first channels, so many of them at most.
fn begin(painter: &mut Painter, target: Target, channels: usize) -> Result<()> {
    let color = PaintColor::Constant(Vec4::new(0.8, 0.1, 0.05, 1.0));
    let channels = channels.min(painter.editor().asset().channels().len());
    let channels = (0..channels).map(|channel| ChannelPaint::new(channel, color.clone())).collect();
    let tool = Tool::Paint(BlendMode::Normal);
    painter.begin_on(target, "bench", Paint { tool, opacity: 0.9, channels, stencil: None, sight: None })
}

fn draw(painter: &mut Painter, dabs: &[Dab]) -> Result<()> {
    for dab in dabs {
        painter.dab(std::slice::from_ref(dab))?;
        painter.show()?;
    }
    Ok(())
}

/// What one stroke waits for because of the one before.
fn strokes_in_a_row(painter: &mut Painter, args: &PaintBenchArgs) -> Result<Vec<Row>> {
    let surface = Arc::clone(painter.surface());
    let dabs = dabs_around(&surface, args.brush as f32, args.dabs);
    // As long a way.
    let large = dabs_around(&surface, 4.0 * args.brush as f32, args.dabs.div_ceil(4));
    let first = &dabs[..dabs.len().min(1)];
    let mut rows = Vec::new();
    // Right after a stroke, one in the same place: its first dab asks for the levels there.
    begin(painter, Target::Base, usize::MAX)?;
    draw(painter, &dabs)?;
    rows.push(timed("end of a stroke, all channels", || painter.end_in_background().map(drop))?);
    rows.push(timed("first dab of the next one, in the same place", || {
        begin(painter, Target::Base, usize::MAX)?;
        draw(painter, first)
    })?);
    draw(painter, &dabs[first.len()..])?;
    rows.push(timed("end of that", || painter.end_in_background().map(drop))?);
    rows.push(timed("their coarser levels", || painter.finish_levels().map(drop))?);

    begin(painter, Target::Base, usize::MAX)?;
    draw(painter, &large)?;
    rows.push(timed("end of a large stroke, all channels", || painter.end_in_background().map(drop))?);
    rows.push(timed("coarser levels of that", || painter.finish_levels().map(drop))?);

    let layer = painter.add_layer(Layer::painted("bench"))?;
    begin(painter, Target::Layer(layer), usize::MAX)?;
    draw(painter, &dabs)?;
    painter.end()?;
    // As painters do that rest: what waits in memory would be written in the midst of the stroke.
    painter.commit()?;
    begin(painter, Target::Base, usize::MAX)?;
    draw(painter, &dabs)?;
    rows.push(timed("end of a stroke under layers", || painter.end_in_background().map(drop))?);
    rows.push(timed("coarser levels of that, too", || painter.finish_levels().map(drop))?);
    Ok(rows)
}

/// A stroke around the model, about its upright axis, over and over at changing heights.
fn dabs_around(surface: &Surface, texels: f32, count: usize) -> Vec<Dab> {
    let at = |i: usize| {
        let angle = 0.05 * i as f32;
        Vec3::new(angle.cos(), 0.3 * (0.07 * i as f32).sin(), angle.sin())
    };
    let brush = Brush { size: Size::Texels(texels), hardness: 0.2, ..Brush::default() };
    let mut samples = Vec::new();
    loop {
        let more = (samples.len()..samples.len() + 64).filter_map(|i| surface.nearest(at(i), f32::INFINITY));
        samples.extend(more.map(Sample::at));
        let (brush, samples_now) = (brush.clone(), samples.clone());
        let stroke =
            Stroke { brush, stamp: None, samples: samples_now, line: false, symmetry: Symmetry::None };
        let mut dabs = dabs_of(surface, &stroke);
        if dabs.len() >= count || samples.len() > 4096 || samples.is_empty() {
            dabs.truncate(count);
            return dabs;
        }
    }
}
