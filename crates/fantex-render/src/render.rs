//! The renderer: mesh, surface, camera and lights in, picture out.
//!
//! ```text
//!  PreparedLights: shadow maps             per lamp, parallel inside
//!  prepare: project, clip, cull, bin       per chunk of triangles, parallel
//!  TileSamples: coverage and visibility    per tile, parallel
//!  Resolve: shade, composite, average      per tile: pieces of its pixels, many at once, then pixels
//! ```

use std::time::{Duration, Instant};

use fantex_mesh::Mesh;
use rayon::prelude::*;

use crate::hit::HitFinder;
use crate::illumination::PreparedLights;
use crate::pattern::SamplePattern;
use crate::primitive::{Chunk, TILE, TileGrid, prepare};
use crate::raster::TileSamples;
use crate::resolve::{PixelColors, Resolve};
use crate::{Camera, Lights, Picture, RenderError, RenderOptions, ShadingRate, Surface};
use fantex_scene::Projection;

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
pub fn render(
    mesh: &Mesh,
    surface: &dyn Surface,
    camera: &Camera,
    lights: &Lights,
    options: &RenderOptions,
) -> Result<Rendering, RenderError> {
    options.check(camera)?;
    if let Some((lamp, defect)) = lights.defect() {
        return Err(RenderError::Light { lamp, defect });
    }
    let start = Instant::now();
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
    let lights = &PreparedLights::new(lights, mesh, surface, options);
    let resolve = Resolve { surface, hits, lights, options, pattern: &pattern };
    let tiles: Vec<PixelColors> = (0..grid.len())
        .into_par_iter()
        .map(|tile| resolve.tile(grid.rect(tile), rasterise(&chunks, tile, &grid, &pattern)))
        .collect();
    let stats = tiles.iter().fold(RenderStats::default(), |sum, t| RenderStats {
        shaded: sum.shaded + t.shaded,
        lookups: sum.lookups + t.lookups,
        ..sum
    });
    let picture = assemble(&grid, &tiles);
    let stats = RenderStats { triangles: mesh.triangles.len() as u64, elapsed: start.elapsed(), ..stats };
    Ok(Rendering { picture, stats })
}

/// Visibility of one tile.
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
    for chunk in chunks.iter().filter(|chunk| chunk.has_layers) {
        chunk.in_tile(grid, tile).filter(|p| p.layered).for_each(|p| samples.add_layered(p));
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
