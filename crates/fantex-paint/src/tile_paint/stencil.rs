//! Stencils: pictures over the view that a stroke is laid on through.
//!
//! How much a stencil lets through is asked once per texel and stroke, when the texel is first covered: sight costs rays.

use fantex_cover::NOBODY;
use rayon::prelude::*;

use super::cover::blend;
use super::ink::nearest_inside;
use super::stroke_page::StrokePage;
use super::texel_page::TexelPage;
use crate::{Projection, Surface};

/// Brings the stencil of a page up to date with its coverage.
pub(crate) fn see_through(surface: &Surface, map: &TexelPage, stencil: &Projection, page: &mut StrokePage) {
    let rect = page.stale;
    if rect.is_empty() {
        return;
    }
    if page.stencil.is_empty() {
        page.stencil = vec![f32::NAN; page.coverage.len()];
    }
    let width = map.block.extent[0];
    let (coverage, stencil_texels) = (&page.coverage, &mut page.stencil);
    let rows = stencil_texels.par_chunks_mut(width as usize).zip(0..map.block.extent[1]);
    let rows = rows.skip(rect.low[1] as usize).take((rect.high[1] - rect.low[1]) as usize);
    rows.for_each(|(row, y)| {
        for x in rect.low[0]..rect.high[0] {
            let texel = (y * width + x) as usize;
            let passes = &mut row[x as usize];
            let owner = map.owner[texel];
            if coverage[texel] <= 0.0 || !passes.is_nan() || owner == NOBODY {
                continue;
            }
            let triangle = &map.triangles[owner as usize];
            let point = nearest_inside(triangle.triangle, map.lambda(triangle, x, y));
            let steps = triangle.steps.map(|step| blend(surface, triangle.triangle, step));
            *passes = stencil.at(surface, point, steps).map_or(0.0, |color| color.w);
        }
    });
}
