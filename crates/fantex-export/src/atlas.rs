//! A model with texture coordinates and its pictures, in memory.

use std::sync::{Arc, Mutex, PoisonError};

use fantex_bake::Progress;
use fantex_base::{Error, Result};
use fantex_store::Asset;

use crate::asset_surface::AssetSurface;
use crate::export::{Job, Map};
use crate::pictures::{Depth, samples};
use crate::texels::RowSink;
use crate::{ChannelMap, ExportOptions, ExportSummary, SplitMesh};

/// An asset as a model with ordinary texture coordinates.
#[derive(Clone, Debug)]
pub struct Atlas {
    /// The asset's triangles, and vertices split where coordinates differ.
    pub mesh: SplitMesh,
    /// One for each map that the asset gives.
    pub pictures: Vec<AtlasPicture>,
    /// Charts, shares, what is left out; no files.
    pub summary: ExportSummary,
}

/// A square picture of 8 bits per sample.
#[derive(Clone, Debug, PartialEq)]
pub struct AtlasPicture {
    /// What it shows.
    pub map: ChannelMap,
    /// Columns and rows.
    pub side: u32,
    /// Samples per texel: 3, or 4 with opacity.
    pub components: usize,
    /// What values were divided by to lie in 0..1: more than 1 for bright emission.
    pub scale: f32,
    /// Row-major from the top; sRGB where the map is a colour.
    pub samples: Vec<u8>,
}

/// Makes what [`export_model`](crate::export_model) writes.
///
/// # Errors
/// An option is none that exists, the model's coordinates are missing or need several pictures, the pictures take more memory than is
/// allowed, or `progress` asked to stop.
pub fn export_atlas(
    asset: &Arc<Asset>,
    options: &ExportOptions<'_>,
    progress: &dyn Progress,
) -> Result<Atlas> {
    options.check()?;
    let surface = AssetSurface::new(asset, options);
    let job = Job::new(&surface, options, progress)?;
    let [page] = &job.layout.pages[..] else {
        let pages = job.layout.pages.len();
        return Err(Error::unsupported(format!(
            "the model's coordinates need {pages} pictures, one per material; use an own packing, or write a .gltf"
        )));
    };
    let maps = job.model_maps(progress);
    let bytes = |map: &Map| u64::from(page.side).pow(2) * map.components.count() as u64;
    let needed: u64 = maps.iter().map(bytes).sum();
    if needed > options.memory_bytes {
        return Err(Error::too_large(format!(
            "pictures of {0} x {0} texels need {needed} bytes at once, but {1} are allowed; give a lower resolution or more memory",
            page.side, options.memory_bytes
        )));
    }
    let filled = maps.iter().map(|map| Arc::new(Mutex::new(Vec::with_capacity(bytes(map) as usize))));
    let filled: Vec<_> = filled.collect();
    let sinks = maps.iter().zip(&filled);
    let sinks = sinks.map(|(&map, bytes)| Box::new(MemorySink(map, Arc::clone(bytes))) as Box<dyn RowSink>);
    let summary = job.run(&maps, &job.tangents(&maps), [Ok(sinks.collect())], progress)?;
    let picture = |(map, bytes): (&Map, Arc<Mutex<Vec<u8>>>)| AtlasPicture {
        map: map.kind,
        side: page.side,
        components: map.components.count(),
        scale: map.scale,
        samples: std::mem::take(&mut *bytes.lock().unwrap_or_else(PoisonError::into_inner)),
    };
    let pictures = maps.iter().zip(filled).map(picture).collect();
    Ok(Atlas { mesh: SplitMesh::new(&asset.mesh().triangles, &job.layout.uv), pictures, summary })
}

struct MemorySink(Map, Arc<Mutex<Vec<u8>>>);

impl RowSink for MemorySink {
    fn rows(&mut self, values: &[[f32; 4]]) -> Result<()> {
        let bytes = samples(values, &self.0, Depth::Eight);
        self.1.lock().unwrap_or_else(PoisonError::into_inner).extend(bytes);
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        Ok(())
    }
}
