//! Dabs to coverage: which pages a dab touches, and what it adds to their texels.

use std::collections::BTreeMap;

use fantex_cover::{NO_OWNER, TexelTriangle};
use fantex_mesh::SurfacePoint;
use fantex_store::{PAGE, PageId};
use glam::{Vec2, Vec4};

use crate::dab::PlacedDab;
use crate::stroke_page::StrokePage;
use crate::texel_page::{Rect, TexelPage, texel_triangle};
use crate::{Region, Surface};

/// Texels beside a triangle that may show it: those that continue the surface, and half a texel of rounding.
const MARGIN_TEXELS: f32 = 2.5;

/// The pages of level 0 that show regions, with the indices of these, ascending.
pub(crate) fn touched_pages<'a>(
    surface: &Surface,
    regions: impl Iterator<Item = &'a Region>,
) -> BTreeMap<PageId, Vec<u32>> {
    let mut pages: BTreeMap<PageId, Vec<u32>> = BTreeMap::new();
    for (index, region) in (0u32..).zip(regions) {
        for triangle in &region.triangles {
            for_each_page(surface, triangle.triangle, |id| {
                let touching = pages.entry(id).or_default();
                if touching.last() != Some(&index) {
                    touching.push(index);
                }
            });
        }
    }
    pages
}

/// The pages of level 0 that show a triangle.
pub(crate) fn for_each_page(surface: &Surface, triangle: u32, mut visit: impl FnMut(PageId)) {
    for group in surface.cover().groups_of(triangle) {
        let extent = surface.cover().groups[group as usize].extent;
        if extent.iter().all(|&n| n <= PAGE) {
            visit(PageId { group, level: 0, page: [0, 0] });
            continue;
        }
        let texels = Vec2::new(extent[0] as f32, extent[1] as f32);
        let Some(triangle) = texel_triangle(surface, group, triangle, texels) else { continue };
        let [low, high] = triangle.bounds();
        let last = texels - 1.0;
        let page = |at: Vec2| (at.clamp(Vec2::ZERO, last) / PAGE as f32).as_uvec2();
        let (from, to) = (page(low - MARGIN_TEXELS), page(high + MARGIN_TEXELS));
        for y in from.y..=to.y {
            (from.x..=to.x).for_each(|x| visit(PageId { group, level: 0, page: [x, y] }));
        }
    }
}

pub(crate) fn cover_page<'a>(
    surface: &Surface,
    map: &TexelPage,
    dabs: impl Iterator<Item = &'a PlacedDab>,
    page: &mut StrokePage,
) {
    let mut in_region = vec![NO_OWNER; map.triangles.len()];
    for dab in dabs {
        for_each_texel(map, &dab.region, &mut in_region, |under| {
            let position = under.point.position(surface.mesh());
            let added = dab.coverage(&dab.region.triangles[under.index], under.point.lambda, position);
            if added > 0.0 {
                page.gather(under.texel, added, &[]);
                page.touch(under.place);
            }
        });
    }
}

/// A touch that brings its own colours.
pub(crate) trait Patch: Sync {
    /// The part of the surface that it covers.
    fn region(&self) -> &Region;

    /// Coverage at a texel, 0..1; where it is not 0, colours (multiplied by alpha) go into `colors`, one per painted channel.
    fn at(&self, map: &TexelPage, under: &TexelUnder<'_>, colors: &mut [Vec4]) -> f32;
}

/// Adds a touch with colours to a page.
pub(crate) fn cover_page_colored(map: &TexelPage, patch: &dyn Patch, channels: usize, page: &mut StrokePage) {
    let mut in_region = vec![NO_OWNER; map.triangles.len()];
    let mut colors = vec![Vec4::ZERO; channels];
    for_each_texel(map, patch.region(), &mut in_region, |under| {
        let added = patch.at(map, under, &mut colors);
        if added > 0.0 {
            page.gather(under.texel, added, &colors);
            page.touch(under.place);
        }
    });
}

pub(crate) struct TexelUnder<'a> {
    /// Row-major number within the page.
    pub(crate) texel: usize,
    /// Column and row within the page.
    pub(crate) place: [u32; 2],
    pub(crate) triangle: &'a TexelTriangle,
    /// That triangle's number in the region.
    pub(crate) index: usize,
    /// The texel's centre, on that triangle or just beside it.
    pub(crate) point: SurfacePoint,
}

/// Visits the texels of a page that show triangles of a region. `in_region`: per triangle of the page, all `NO_OWNER`; left so.
fn for_each_texel(
    map: &TexelPage,
    region: &Region,
    in_region: &mut [u32],
    mut visit: impl FnMut(&TexelUnder<'_>),
) {
    let mut rect = Rect::EMPTY;
    let mut met = Vec::new();
    let mut meet = |index: usize, number: usize| {
        in_region[index] = number as u32;
        met.push(index);
        rect = rect.union(texel_rect(map, map.triangles[index].bounds()));
    };
    // The shorter list is looked up in the longer one.
    if region.triangles.len() < map.triangles.len() {
        for (number, reached) in region.triangles.iter().enumerate() {
            let found = map.triangles.binary_search_by_key(&reached.triangle, |t| t.triangle);
            found.into_iter().for_each(|index| meet(index, number));
        }
    } else {
        for (index, shown) in map.triangles.iter().enumerate() {
            let found = region.triangles.binary_search_by_key(&shown.triangle, |t| t.triangle);
            found.into_iter().for_each(|number| meet(index, number));
        }
    }
    for place in rect.texels() {
        let texel = map.texel(place);
        let owner = map.owner[texel];
        if owner == NO_OWNER || in_region[owner as usize] == NO_OWNER {
            continue;
        }
        let index = in_region[owner as usize] as usize;
        let (triangle, point) = (&map.triangles[owner as usize], map.point(place));
        visit(&TexelUnder { texel, place, triangle, index, point });
    }
    met.into_iter().for_each(|index| in_region[index] = NO_OWNER);
}

pub(crate) fn fill_page(map: &TexelPage, is_chosen: impl Fn(u32) -> bool, page: &mut StrokePage) {
    let chosen: Vec<bool> = map.triangles.iter().map(|t| is_chosen(t.triangle)).collect();
    for (texel, &owner) in map.owner.iter().enumerate() {
        if owner != NO_OWNER && chosen[owner as usize] {
            page.coverage[texel] = 1.0;
            page.touch(map.place(texel));
        }
    }
}

/// Covers the texels of a page by given numbers, one per texel.
pub(crate) fn cover_texels(coverage: &[f32], map: &TexelPage, page: &mut StrokePage) {
    for (texel, &added) in coverage.iter().enumerate().filter(|(_, added)| **added > 0.0) {
        page.gather(texel, added, &[]);
        page.touch(map.place(texel));
    }
}

/// The texels of a page that a triangle with these bounds may own.
fn texel_rect(map: &TexelPage, [low, high]: [Vec2; 2]) -> Rect {
    let origin = Vec2::new(map.block.origin[0] as f32, map.block.origin[1] as f32);
    let extent = Vec2::new(map.block.extent[0] as f32, map.block.extent[1] as f32);
    let from = (low - origin - MARGIN_TEXELS).clamp(Vec2::ZERO, extent).floor().as_uvec2();
    let to = (high - origin + MARGIN_TEXELS).clamp(Vec2::ZERO, extent).ceil().as_uvec2();
    Rect { low: from.into(), high: to.into() }
}
