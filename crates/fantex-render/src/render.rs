//! The renderer: mesh, surface, camera and lights in, picture out.
//!
//! ```text
//!  PreparedLights: shadow maps             per lamp, parallel inside
//!  prepare: project, clip, cull, bin       per chunk of triangles, parallel
//!  TileSamples: coverage and visibility    per tile, parallel
//!  Resolve: shade, composite, average      per tile, or part of one with many layers: pieces of its pixels, many at once,
//!                                          then pixels
//! ```

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

use fantex_base::input::{self, Held};
use fantex_base::{Error, Result, bits};
use fantex_mesh::Mesh;
use fantex_scene::{AmbientLight, Glow, Projection};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::hit::{HitFinder, Seen};
use crate::illumination::PreparedLights;
use crate::primitive::{Chunk, SUBPIXELS, TILE, TileGrid, prepare, reserve_drawing};
use crate::raster::{Fragment, MAX_LAYERED, MAX_SAMPLES, NO_TRIANGLE, SamplePattern, TileSamples};
use crate::shading::evaluate_all;
use crate::{Background, Camera, Interpolation, Lights, Picture, Shading, ShadingRate, Surface};

/// What rendering took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RenderStats {
    /// Triangles of the mesh.
    pub triangles: u64,
    /// Materials evaluated.
    pub shaded: u64,
    /// Filtered look-ups, as the surface counts them.
    pub lookups: u64,
    /// Wall clock.
    pub elapsed: Duration,
}

/// A picture and what it took.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// The picture.
    pub picture: Picture,
    /// What it took.
    pub stats: RenderStats,
}

/// Renders a mesh on the current rayon pool. The picture does not depend on the number of threads.
///
/// # Errors
/// An option is out of its range, or the camera or a lamp is none; the picture, the mesh or the shadows take more memory than
/// is [left](input::memory_left) of the budget; it was [stopped](RenderOptions::stop) ([`Error::is_cancelled`]).
pub fn render(
    mesh: &Mesh,
    surface: &dyn Surface,
    camera: &Camera,
    lights: &Lights,
    options: &RenderOptions,
) -> Result<Rendering> {
    let start = Instant::now();
    // Before shadows are drawn, which takes long.
    drop(options.check(camera)?);
    check_lamps(lights)?;
    let lights = PreparedLights::new(lights, mesh, surface, options)?;
    let rendering = render_lit(mesh, surface, camera, &lights, options)?;
    let stats = RenderStats { elapsed: start.elapsed(), ..rendering.stats };
    Ok(Rendering { stats, ..rendering })
}

/// # Errors
/// A lamp is none.
pub(crate) fn check_lamps(lights: &Lights) -> Result<()> {
    match lights.defect() {
        Some((lamp, defect)) => {
            Err(Error::invalid(format!("cannot render with lamp {lamp} of the scene: {defect}")))
        }
        None => Ok(()),
    }
}

/// As [`render`], with lights that were prepared for the same mesh, surface, shading and time.
pub(crate) fn render_lit(
    mesh: &Mesh,
    surface: &dyn Surface,
    camera: &Camera,
    lights: &PreparedLights<'_>,
    options: &RenderOptions,
) -> Result<Rendering> {
    let _picture = options.check(camera)?;
    let start = Instant::now();
    let _triangles = reserve_drawing(mesh)?;
    let size = [options.width, options.height];
    let projection = Projection::new(camera, size, mesh);
    let grid = TileGrid { size };
    let pattern = SamplePattern::new(options.samples);
    let chunks = prepare(mesh, surface, &projection, &grid, &pattern);
    let spacing = match options.shading_rate {
        ShadingRate::PerPixel => 1.0,
        ShadingRate::PerSample => 1.0 / (options.samples as f32).sqrt(),
    };
    let hits = HitFinder { mesh, projection: &projection, interpolation: options.interpolation, spacing };
    let resolve = Resolve { surface, hits, lights, options, pattern: &pattern };
    let is_stopped = || options.stop.as_ref().is_some_and(StopSignal::is_given);
    let tiles: Option<Vec<PixelColors>> = (0..grid.len())
        .into_par_iter()
        .map(|tile| (!is_stopped()).then(|| resolve.tile(&chunks, &grid, tile)))
        .collect();
    let tiles = tiles.ok_or_else(|| Error::cancelled("rendering was stopped"))?;
    let stats = tiles.iter().fold(RenderStats::default(), |sum, t| RenderStats {
        shaded: sum.shaded + t.shaded,
        lookups: sum.lookups + t.lookups,
        ..sum
    });
    let picture = assemble(&grid, &tiles);
    let stats = RenderStats { triangles: mesh.triangles.len() as u64, elapsed: start.elapsed(), ..stats };
    Ok(Rendering { picture, stats })
}

/// What is opaque in a tile.
fn rasterise<'a>(
    chunks: &[Chunk],
    tile: usize,
    grid: &TileGrid,
    pattern: &'a SamplePattern,
) -> TileSamples<'a> {
    let mut samples = TileSamples::new(pattern, grid.rect(tile));
    for chunk in chunks {
        chunk.dots_in_tile(tile).iter().for_each(|dot| samples.add_dot(dot));
        chunk.in_tile(grid, tile).filter(|p| !p.layered).for_each(|p| samples.add_opaque(p));
    }
    samples
}

fn assemble(grid: &TileGrid, tiles: &[PixelColors]) -> Picture {
    let [width, height] = grid.size;
    let mut rgba = vec![[0.0; 4]; width as usize * height as usize];
    let bands = rgba.par_chunks_mut(width as usize * TILE as usize);
    bands.zip(tiles.par_chunks(grid.columns() as usize)).enumerate().for_each(|(band, (pixels, tiles))| {
        for (column, colors) in tiles.iter().enumerate() {
            let [[x0, _], [columns, _]] = grid.rect(band * grid.columns() as usize + column);
            let rows = pixels.chunks_mut(width as usize);
            for (row, colors) in rows.zip(colors.rgba.chunks(columns as usize)) {
                row[x0 as usize..][..columns as usize].copy_from_slice(colors);
            }
        }
    });
    Picture { width, height, rgba }
}

// How to render.

/// How to render.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderOptions {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples per pixel, 1..=64; 4, 8 and 16 have the best patterns.
    pub samples: u32,
    /// Where materials are evaluated.
    pub shading_rate: ShadingRate,
    /// Perspective-correct or affine.
    pub interpolation: Interpolation,
    /// Lighting model.
    pub shading: Shading,
    /// What is seen where no surface is. Of these, exposure affects environments only.
    pub background: Background,
    /// Factor of the light that reaches the eye.
    pub exposure: f32,
    /// Seconds since the start of an animation, for what lamps project. (Surfaces have a time of their own.)
    pub time: f32,
    /// Ends it early, where it is given.
    pub stop: Option<StopSignal>,
}

/// Ends renderings early, from another thread.
#[derive(Clone, Debug, Default)]
pub struct StopSignal(Arc<AtomicBool>);

impl StopSignal {
    /// From now on, renderings with this signal end as soon as they can.
    pub fn give(&self) {
        self.0.store(true, Relaxed);
    }

    fn is_given(&self) -> bool {
        self.0.load(Relaxed)
    }
}

impl PartialEq for StopSignal {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Default for RenderOptions {
    /// 1280x720, 8 samples.
    fn default() -> Self {
        Self {
            width: 1280,
            height: 720,
            samples: 8,
            shading_rate: ShadingRate::default(),
            interpolation: Interpolation::default(),
            shading: Shading::default(),
            background: Background::default(),
            exposure: 1.0,
            time: 0.0,
            stop: None,
        }
    }
}

/// Longest side of a picture in pixels.
pub const MAX_PICTURE_SIDE: u32 = 16_384;

/// Memory for a pixel: in its tile and in the picture, and while the picture is written.
const PIXEL_BYTES: u64 = 40;

impl RenderOptions {
    /// Counts the picture's memory, too, as long as what is returned lives.
    pub(crate) fn check(&self, camera: &Camera) -> Result<Held> {
        let (width, height) = (self.width, self.height);
        if !(1..=MAX_PICTURE_SIDE).contains(&width) || !(1..=MAX_PICTURE_SIDE).contains(&height) {
            return Err(Error::invalid(format!(
                "cannot render {width}x{height} pixels: both sides must be between 1 and {MAX_PICTURE_SIDE}"
            )));
        }
        if !(1..=MAX_SAMPLES).contains(&self.samples) {
            return Err(Error::invalid(format!(
                "cannot render with {} samples per pixel: ask for 1 to {MAX_SAMPLES}",
                self.samples
            )));
        }
        let what = format_args!("a picture of {width} x {height} pixels");
        let held = input::reserve(what, PIXEL_BYTES * u64::from(width) * u64::from(height))?;
        match camera.defect() {
            Some(defect) => Err(Error::invalid(format!("cannot render from this camera: {defect}"))),
            None => Ok(held),
        }
    }
}

// From visible samples to pixel colours.

#[derive(Debug)]
struct PixelColors {
    /// Linear RGB and straight alpha, row-major over the tile's extent.
    rgba: Vec<[f32; 4]>,
    shaded: u64,
    lookups: u64,
}

struct Resolve<'a> {
    surface: &'a dyn Surface,
    hits: HitFinder<'a>,
    lights: &'a PreparedLights<'a>,
    options: &'a RenderOptions,
    pattern: &'a SamplePattern,
}

/// Samples of a pixel that share one evaluation of the material.
#[derive(Clone, Copy, Debug)]
struct Piece<'a> {
    /// Index in the tile, row-major with stride [`TILE`].
    pixel: u32,
    triangle: u32,
    mask: u64,
    /// Where the triangle lets something through.
    layer: Option<&'a Fragment>,
}

/// Pieces that are shaded together: enough to fill vectors, few enough to stay in the cache.
const BATCH_PIECES: usize = 128;

impl Resolve<'_> {
    /// Colours a tile.
    fn tile(&self, chunks: &[Chunk], grid: &TileGrid, tile: usize) -> PixelColors {
        let rect = grid.rect(tile);
        let visibility = rasterise(chunks, tile, grid, self.pattern);
        let layered = || {
            let layered_chunks = chunks.iter().filter(|chunk| chunk.has_layers);
            layered_chunks.flat_map(|chunk| chunk.in_tile(grid, tile)).filter(|p| p.layered)
        };
        let count = rect[1].map(|side| side as usize).iter().product();
        let mut result = PixelColors { rgba: vec![[0.0; 4]; count], shaded: 0, lookups: 0 };
        let pieces_of = |fragment: &Fragment| self.part_count(fragment.mask) as usize;
        visibility.for_each_part(layered, pieces_of, MAX_LAYERED, |part, fragments| {
            self.part(rect, part, &visibility, fragments, &mut result);
        });
        result
    }

    /// Colours a part of a tile, both given by their first pixel and extent.
    fn part(
        &self,
        [origin, [stride, _]]: [[u32; 2]; 2],
        [first, [columns, rows]]: [[u32; 2]; 2],
        visibility: &TileSamples,
        fragments: &[Fragment],
        result: &mut PixelColors,
    ) {
        let first = [0, 1].map(|i| first[i] - origin[i]);
        let pieces = self.pieces([first, [columns, rows]], visibility, fragments);
        result.shaded += pieces.len() as u64;
        let colors = self.shade(origin, &pieces, &mut result.lookups);
        let (mut pieces, mut colors) = (pieces.as_slice(), colors.as_slice());
        let mut samples = vec![Vec4::ZERO; self.pattern.len()];
        for y in first[1]..first[1] + rows {
            for x in first[0]..first[0] + columns {
                let index = y * TILE + x;
                let count = pieces.iter().take_while(|piece| piece.pixel == index).count();
                let own;
                (own, pieces) = pieces.split_at(count);
                let shades;
                (shades, colors) = colors.split_at(count);
                let pixel = [origin[0] + x, origin[1] + y];
                let color = self.pixel(pixel, (own, shades), visibility.visible(index), &mut samples);
                result.rgba[(y * stride + x) as usize] = color;
            }
        }
    }

    /// The colour of a pixel with these pieces: linear RGB, straight alpha.
    fn pixel(
        &self,
        pixel: [u32; 2],
        (pieces, shades): (&[Piece], &[Vec4]),
        visible: &[u32],
        samples: &mut [Vec4],
    ) -> [f32; 4] {
        match (pieces, shades) {
            ([], _) => return straight(self.behind(pixel)),
            ([piece], [color]) if piece.layer.is_none() && piece.mask == self.pattern.full_mask() => {
                return color.truncate().extend(1.0).to_array();
            }
            _ => {}
        }
        self.background(pixel, visible, samples);
        for (piece, color) in pieces.iter().zip(shades).filter(|(piece, _)| piece.layer.is_none()) {
            bits(piece.mask).for_each(|s| samples[s] = color.truncate().extend(1.0));
        }
        self.layers(pixel, pieces, shades, samples);
        straight(samples.iter().sum::<Vec4>() / samples.len() as f32)
    }

    /// What is to be shaded, pixel by pixel: what is opaque, then the layers. The rectangle begins at a pixel of the tile.
    fn pieces<'f>(
        &self,
        [first, [columns, rows]]: [[u32; 2]; 2],
        visibility: &TileSamples,
        fragments: &'f [Fragment],
    ) -> Vec<Piece<'f>> {
        let mut pieces = Vec::with_capacity((columns * rows) as usize);
        let mut rest = fragments;
        for y in first[1]..first[1] + rows {
            for x in first[0]..first[0] + columns {
                let pixel = y * TILE + x;
                let visible = visibility.visible(pixel);
                let mut open = self.pattern.full_mask();
                while open != 0 {
                    let triangle = visible[open.trailing_zeros() as usize];
                    let mask = bits(open).filter(|&s| visible[s] == triangle).fold(0, |m, s| m | 1 << s);
                    open &= !mask;
                    if triangle != NO_TRIANGLE {
                        let parts = self.shading_parts(mask);
                        pieces.extend(parts.map(|mask| Piece { pixel, triangle, mask, layer: None }));
                    }
                }
                let (own, later) = rest.split_at(rest.partition_point(|f| f.pixel <= pixel));
                rest = later;
                for fragment in own {
                    let triangle = fragment.triangle;
                    let parts = self.shading_parts(fragment.mask);
                    pieces.extend(parts.map(|mask| Piece { pixel, triangle, mask, layer: Some(fragment) }));
                }
            }
        }
        pieces
    }

    fn behind(&self, pixel: [u32; 2]) -> Vec4 {
        let (projection, ambient) = (self.hits.projection, &self.lights.ambient);
        behind(&self.options.background, pixel, self.options, projection, ambient)
    }

    fn background(&self, pixel: [u32; 2], visible: &[u32], samples: &mut [Vec4]) {
        if !visible.contains(&NO_TRIANGLE) {
            return;
        }
        let color = self.behind(pixel);
        for (sample, _) in samples.iter_mut().zip(visible).filter(|(_, seen)| **seen == NO_TRIANGLE) {
            *sample = color;
        }
    }

    /// Lays the layers among the pieces of a pixel over its samples, the farthest first.
    fn layers(&self, pixel: [u32; 2], pieces: &[Piece], colors: &[Vec4], samples: &mut [Vec4]) {
        if pieces.last().is_none_or(|piece| piece.layer.is_none()) {
            return;
        }
        let corner = pixel.map(|c| c as i32 * SUBPIXELS);
        for (s, offset) in self.pattern.offsets().iter().enumerate() {
            let position = [corner[0] + offset[0], corner[1] + offset[1]];
            let mut here: Vec<(f32, Vec4)> = pieces
                .iter()
                .zip(colors)
                .filter(|(piece, _)| piece.mask >> s & 1 == 1)
                .filter_map(|(piece, &color)| Some((piece.layer?.nearness.at(position), color)))
                .collect();
            // Stable: of equally near layers the later triangle lies on top.
            here.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (_, color) in here {
                let premultiplied = (color.truncate() * color.w).extend(color.w);
                samples[s] = premultiplied + samples[s] * (1.0 - color.w);
            }
        }
    }

    /// Evaluations of the material for the samples of one triangle in a pixel.
    fn part_count(&self, mask: u64) -> u32 {
        match self.options.shading_rate {
            ShadingRate::PerPixel => 1,
            ShadingRate::PerSample => mask.count_ones(),
        }
    }

    fn shading_parts(&self, mask: u64) -> impl Iterator<Item = u64> + use<> {
        let per_sample = self.options.shading_rate == ShadingRate::PerSample;
        let mut rest = mask;
        (0..self.part_count(mask)).map(move |_| {
            let part = if per_sample { 1 << rest.trailing_zeros() } else { mask };
            rest &= !part;
            part
        })
    }

    /// The light from every piece, seen in the middle of its samples, and its opacity; adds the look-ups that it took.
    fn shade(&self, origin: [u32; 2], pieces: &[Piece], lookups: &mut u64) -> Vec<Vec4> {
        let mut colors = Vec::with_capacity(pieces.len());
        let (mut seen, mut hits) = (Vec::with_capacity(BATCH_PIECES), Vec::with_capacity(BATCH_PIECES));
        let (mut materials, mut light) = (Vec::with_capacity(BATCH_PIECES), Vec::with_capacity(BATCH_PIECES));
        for pieces in pieces.chunks(BATCH_PIECES) {
            seen.clear();
            hits.clear();
            materials.clear();
            light.clear();
            seen.extend(pieces.iter().map(|piece| self.seen(origin, piece)));
            self.hits.find_all(&seen, &mut hits);
            self.surface.shade_all(&hits, &mut materials);
            let shaded = (hits.as_slice(), materials.as_slice());
            let (shading, finder) = (self.options.shading, &self.hits);
            evaluate_all(shading, shaded, finder, self.surface, self.lights, &mut light);
            for ((material, _), &light) in materials.iter().zip(&light) {
                *lookups += u64::from(material.lookups);
                // One texel that is not a number must not spoil its pixel's other samples.
                let light = if light.is_finite() { light } else { Vec3::ZERO };
                colors.push((light * self.options.exposure).extend(material.alpha.clamp(0.0, 1.0)));
            }
        }
        colors
    }

    /// The middle of a piece's samples, in pixels.
    fn seen(&self, origin: [u32; 2], piece: &Piece) -> Seen {
        let corner = [origin[0] + piece.pixel % TILE, origin[1] + piece.pixel / TILE];
        let corner = Vec2::new(corner[0] as f32, corner[1] as f32);
        (piece.triangle, corner + self.pattern.centroid(piece.mask))
    }
}

/// Straight from premultiplied alpha.
fn straight(premultiplied: Vec4) -> [f32; 4] {
    match premultiplied.w {
        w if w >= 1.0 - 1e-6 => premultiplied.truncate().extend(1.0).to_array(),
        w if w <= 0.0 => [0.0; 4],
        w => (premultiplied.truncate() / w).extend(w).to_array(),
    }
}

// The surroundings as the picture's background: a sky box, infinitely far away.

/// The light of the surroundings through a pixel, linear RGB: the mean over it, blurred by a perceptual roughness.
fn seen(ambient: &AmbientLight, projection: &Projection, middle: Vec2, blur: f32) -> Vec3 {
    let direction = |p: Vec2| projection.direction(p).as_vec3();
    let ahead = direction(middle);
    match &ambient.environment {
        Some(environment) => {
            let across = |edge: Vec2| direction(middle + edge * 0.5) - direction(middle - edge * 0.5);
            environment.reflected(ahead, [across(Vec2::X), across(Vec2::Y)], blur)
        }
        None => ambient.radiance_from(ahead),
    }
}

/// Premultiplied RGBA behind a pixel. Surroundings are light and so scaled by the exposure, as their reflections are; the
/// other backgrounds are paint.
pub(crate) fn behind(
    background: &Background,
    pixel: [u32; 2],
    options: &RenderOptions,
    projection: &Projection,
    ambient: &AmbientLight,
) -> Vec4 {
    let middle = Vec2::new(pixel[0] as f32, pixel[1] as f32) + 0.5;
    match *background {
        Background::Transparent => Vec4::ZERO,
        Background::Color(color) => color.extend(1.0),
        Background::Gradient { top, bottom } => {
            top.lerp(bottom, middle.y / options.height as f32).extend(1.0)
        }
        Background::Environment { blur } => {
            (seen(ambient, projection, middle, blur) * options.exposure).extend(1.0)
        }
    }
}

// Pictures with the halo of what glows in them.

/// Renders twice, the picture and what it emits, and adds the halo of the latter. The time is that of both passes and the
/// filter.
///
/// # Errors
/// As [`render`].
pub fn render_with_glow(
    mesh: &Mesh,
    surface: &dyn Surface,
    camera: &Camera,
    lights: &Lights,
    options: &RenderOptions,
    glow: &Glow,
) -> Result<Rendering> {
    let start = std::time::Instant::now();
    let seen = render(mesh, surface, camera, lights, options)?;
    let emission =
        RenderOptions { shading: Shading::Emission, background: Background::Transparent, ..options.clone() };
    let emitted = render(mesh, surface, camera, lights, &emission)?;
    let picture = seen.picture.with_glow(&emitted.picture, glow);
    let mut stats = seen.stats;
    stats.shaded += emitted.stats.shaded;
    stats.lookups += emitted.stats.lookups;
    stats.elapsed = start.elapsed();
    Ok(Rendering { picture, stats })
}
