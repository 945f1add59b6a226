//! From the layout of a picture to its texels: the texture function of the asset at every texel's point of the surface.
//!
//! ```text
//!  Page --regions--> Region (which point under which texel) --Sampler--> linear values --fit--> rows --> files
//! ```
//!
//! A picture is made in bands of rows, a band in square regions in parallel; nothing but one band of all maps is in memory.

mod fit;
mod region;
mod sampler;

use fantex_bake::Progress;
use rayon::prelude::*;

use crate::error::ExportError;
use crate::layout::{Page, Placed};
use crate::maps::Map;
use region::Region;
pub(crate) use sampler::Sampler;

/// Columns of a region.
const REGION: u32 = 256;

/// Rows of a band, at least.
const FEWEST_ROWS: u32 = 16;

/// Linear values of a rectangle of texels, row-major.
pub(crate) type Values = Vec<[f32; 4]>;

/// What was seen while a page was made.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PageStats {
    /// Texels whose centre lies on a triangle.
    pub(crate) covered: u64,
    /// Of these, texels that several triangles claim.
    pub(crate) contested: u64,
}

/// Takes rows of a map from the top.
pub(crate) trait RowSink: Send {
    /// Linear values of whole rows.
    fn rows(&mut self, values: &[[f32; 4]]) -> Result<(), ExportError>;

    /// After the last row.
    fn finish(&mut self) -> Result<(), ExportError>;
}

/// Makes the maps of a page and hands their rows to `sinks`, one per map. `texels_done` counts up over all pages.
///
/// # Errors
///
/// A sink's, or the user's wish to stop.
pub(crate) fn make_page(
    page: &Page,
    maps: &[Map],
    sampler: &Sampler<'_>,
    memory_bytes: u64,
    sinks: &mut [Box<dyn RowSink + '_>],
    progress: (&dyn Progress, &mut u64, u64),
) -> Result<PageStats, ExportError> {
    let (watch, texels_done, total) = progress;
    let rows = band_rows(page.side, maps.len(), memory_bytes);
    let columns = page.side.div_ceil(REGION);
    let bins = Bins::new(page, rows);
    let mut stats = PageStats::default();
    for band in 0..page.side.div_ceil(rows) {
        let height = rows.min(page.side - band * rows);
        let make = |column: u32| {
            if watch.is_cancelled() {
                return (Vec::new(), PageStats::default());
            }
            let origin = [column * REGION, band * rows];
            let extent = [REGION.min(page.side - origin[0]), height];
            let members = bins.members((band * columns + column) as usize);
            let region = Region::find(page, members, origin, extent);
            let values = sampler.values(page, &region, maps);
            let fitted = maps.iter().zip(&values).map(|(map, values)| fit::fitted(values, &region, map));
            (fitted.collect(), region.stats)
        };
        let regions: Vec<(Vec<Values>, PageStats)> = (0..columns).into_par_iter().map(make).collect();
        if watch.is_cancelled() {
            return Err(ExportError::Cancelled);
        }
        for (_, region) in &regions {
            stats.covered += region.covered;
            stats.contested += region.contested;
        }
        sinks.par_iter_mut().enumerate().try_for_each(|(map, sink)| {
            let mut row_values = Vec::with_capacity(page.side as usize * height as usize);
            for row in 0..height as usize {
                for (values, _) in &regions {
                    let width = values[map].len() / height as usize;
                    row_values.extend_from_slice(&values[map][row * width..(row + 1) * width]);
                }
            }
            sink.rows(&row_values)
        })?;
        *texels_done += u64::from(page.side) * u64::from(height);
        watch.report(*texels_done, total);
    }
    sinks.par_iter_mut().try_for_each(|sink| sink.finish())?;
    Ok(stats)
}

/// Rows of a band: its values, twice, take a quarter of the memory at most.
fn band_rows(side: u32, maps: usize, memory_bytes: u64) -> u32 {
    let row_bytes = 2 * 16 * u64::from(side) * maps.max(1) as u64;
    let rows = (memory_bytes / 4 / row_bytes).clamp(1, u64::from(REGION)) as u32;
    (1 << rows.ilog2()).max(FEWEST_ROWS)
}

/// Which placed triangles may matter to which region, in rows of a compressed table.
struct Bins {
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl Bins {
    fn new(page: &Page, rows: u32) -> Self {
        let (columns, bands) = (page.side.div_ceil(REGION), page.side.div_ceil(rows));
        let margin = (region::margin(page) + region::BORDER) as f32 + 2.0;
        let each = |mut visit: Box<dyn FnMut(u32, usize) + '_>| {
            for (i, placed) in (0u32..).zip(&page.placed) {
                let [low, high] = bounds(placed);
                let bin = |x: f32, size: u32, count: u32| ((x / size as f32).max(0.0) as u32).min(count - 1);
                let (x0, x1) = (bin(low.x - margin, REGION, columns), bin(high.x + margin, REGION, columns));
                let (y0, y1) = (bin(low.y - margin, rows, bands), bin(high.y + margin, rows, bands));
                (y0..=y1).for_each(|y| (x0..=x1).for_each(|x| visit(i, (y * columns + x) as usize)));
            }
        };
        let mut starts = vec![0u32; columns as usize * bands as usize + 1];
        each(Box::new(|_, bin| starts[bin + 1] += 1));
        (1..starts.len()).for_each(|i| starts[i] += starts[i - 1]);
        let mut next = starts.clone();
        let mut members = vec![0; starts[starts.len() - 1] as usize];
        each(Box::new(|i, bin| {
            members[next[bin] as usize] = i;
            next[bin] += 1;
        }));
        Self { starts, members }
    }

    /// Indices into the page's placed triangles, ascending.
    fn members(&self, bin: usize) -> &[u32] {
        &self.members[self.starts[bin] as usize..self.starts[bin + 1] as usize]
    }
}

/// Lower and upper corner of a triangle's rectangle, texels.
fn bounds(placed: &Placed) -> [glam::Vec2; 2] {
    let [a, b, c] = placed.corners;
    [a.min(b).min(c), a.max(b).max(c)]
}
