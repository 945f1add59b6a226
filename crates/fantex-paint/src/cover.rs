//! Dabs to coverage: which pages a dab touches, and what it adds to their texels.

use std::collections::BTreeMap;

use fantex_cover::{NO_OWNER, TexelTriangle};
use fantex_mesh::SurfacePoint;
use fantex_store::{PAGE, PageId};
use glam::{Vec2, Vec4};

use crate::dab::PlacedDab;
use crate::region::ALL_TEXELS;
use crate::stroke_page::StrokePage;
use crate::texel_page::{Rect, TexelPage, texel_triangle};
use crate::{Region, Surface};

/// Texels beside a triangle that may show it: those that continue the surface, and half a texel of rounding.
const MARGIN_TEXELS: f32 = 2.5;

/// What covers a part of the surface.
pub(crate) trait Touch {
    /// The part of the surface.
    fn region(&self) -> &Region;

    /// Lower and upper corner of a box with all texels that it covers of the region's triangle number `index`, on it and beside it; none where
    /// it covers none. `shown`: the triangle in a tile.
    fn texels(&self, index: usize, shown: &TexelTriangle) -> Option<[Vec2; 2]>;
}

/// All of it.
impl Touch for Region {
    fn region(&self) -> &Region {
        self
    }

    fn texels(&self, _: usize, _: &TexelTriangle) -> Option<[Vec2; 2]> {
        Some(ALL_TEXELS)
    }
}

/// Lower and upper corner of the texels that may show a triangle.
fn texels_around(shown: &TexelTriangle) -> [Vec2; 2] {
    let [low, high] = shown.bounds();
    [low - MARGIN_TEXELS, high + MARGIN_TEXELS]
}

/// The same of those that may be covered.
fn covered_texels<T: Touch + ?Sized>(touch: &T, index: usize, shown: &TexelTriangle) -> Option<[Vec2; 2]> {
    let ([low, high], [first, last]) = (texels_around(shown), touch.texels(index, shown)?);
    let (low, high) = (low.max(first), high.min(last));
    low.cmple(high).all().then_some([low, high])
}

/// The pages of level 0 on which something may be covered, with the indices of what covers it, ascending.
pub(crate) fn touched_pages<'a, T: Touch + 'a>(
    surface: &Surface,
    touches: impl Iterator<Item = &'a T>,
) -> BTreeMap<PageId, Vec<u32>> {
    let mut pages: BTreeMap<PageId, Vec<u32>> = BTreeMap::new();
    for (index, touch) in (0u32..).zip(touches) {
        for (number, reached) in touch.region().triangles.iter().enumerate() {
            let covered = |shown: &TexelTriangle| covered_texels(touch, number, shown);
            for_each_page_with(surface, reached.triangle, covered, |id| {
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
pub(crate) fn for_each_page(surface: &Surface, triangle: u32, visit: impl FnMut(PageId)) {
    for_each_page_with(surface, triangle, |shown| Some(texels_around(shown)), visit);
}

/// The same, of large tiles only the pages with some `texels`: lower and upper corner of a box.
fn for_each_page_with(
    surface: &Surface,
    triangle: u32,
    texels: impl Fn(&TexelTriangle) -> Option<[Vec2; 2]>,
    mut visit: impl FnMut(PageId),
) {
    for group in surface.cover().groups_of(triangle) {
        let extent = surface.cover().groups[group as usize].extent;
        if extent.iter().all(|&n| n <= PAGE) {
            visit(PageId { group, level: 0, page: [0, 0] });
            continue;
        }
        let extent = Vec2::new(extent[0] as f32, extent[1] as f32);
        let shown = texel_triangle(surface, group, triangle, extent);
        let Some([low, high]) = shown.and_then(|shown| texels(&shown)) else { continue };
        let last = extent - 1.0;
        let page = |at: Vec2| (at.clamp(Vec2::ZERO, last) / PAGE as f32).as_uvec2();
        let (from, to) = (page(low), page(high));
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
        for_each_texel(map, dab, &mut in_region, |under| {
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
pub(crate) trait Patch: Touch + Sync {
    /// Coverage at a texel, 0..1; where it is not 0, colours (multiplied by alpha) go into `colors`, one per painted channel.
    fn at(&self, map: &TexelPage, under: &TexelUnder<'_>, colors: &mut [Vec4]) -> f32;
}

/// Adds a touch with colours to a page.
pub(crate) fn cover_page_colored(map: &TexelPage, patch: &dyn Patch, channels: usize, page: &mut StrokePage) {
    let mut in_region = vec![NO_OWNER; map.triangles.len()];
    let mut colors = vec![Vec4::ZERO; channels];
    for_each_texel(map, patch, &mut in_region, |under| {
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

/// Visits the texels of a page that may be covered. `in_region`: per triangle of the page, all `NO_OWNER`; left so.
fn for_each_texel<T: Touch + ?Sized>(
    map: &TexelPage,
    touch: &T,
    in_region: &mut [u32],
    mut visit: impl FnMut(&TexelUnder<'_>),
) {
    let region = touch.region();
    let mut rect = Rect::EMPTY;
    let mut met = Vec::new();
    let mut meet = |index: usize, number: usize| {
        if let Some(covered) = covered_texels(touch, number, &map.triangles[index]) {
            in_region[index] = number as u32;
            met.push(index);
            rect = rect.union(texel_rect(map, covered));
        }
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

/// The texels of a page that a box of the tile meets.
fn texel_rect(map: &TexelPage, [low, high]: [Vec2; 2]) -> Rect {
    let origin = Vec2::new(map.block.origin[0] as f32, map.block.origin[1] as f32);
    let extent = Vec2::new(map.block.extent[0] as f32, map.block.extent[1] as f32);
    let from = (low - origin).clamp(Vec2::ZERO, extent).floor().as_uvec2();
    let to = (high - origin).clamp(Vec2::ZERO, extent).ceil().as_uvec2();
    Rect { low: from.into(), high: to.into() }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;
    use std::iter::once;
    use std::sync::Arc;

    use fantex_bake::{BakeOptions, NoProgress, Source, TexelPoint, bake};
    use fantex_base::Random;
    use fantex_cover::{CoverOptions, TexelBudget, build_cover};
    use fantex_mesh::{Mesh, generate};
    use fantex_store::Asset;
    use fantex_test::{cleaned, mesh_of};
    use fantex_texture::Image;
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::composite::PaintContext;
    use crate::picture::PlacedDecal;
    use crate::{BlendMode, ChannelPaint, Dab, Decal, Paint, PaintColor, Picture, Stamp, Tip, Tool};

    fn surface(mesh: Mesh, texels: u64) -> Surface {
        let options = CoverOptions { budget: TexelBudget::Total(texels), ..CoverOptions::default() };
        let (cover, _) = build_cover(&mesh, &options).unwrap();
        Surface::new(Arc::new(mesh), Arc::new(cover))
    }

    /// A triangle that lies along no axis.
    fn slanted() -> Mesh {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.9, -0.3], [0.2, 0.7, 0.8]];
        mesh_of(corners.map(DVec3::from).to_vec(), vec![[0, 1, 2]])
    }

    /// Triangles around a vertex, so high above the others, which are 1 away from its foot.
    fn tent(sides: u32, height: f64) -> Mesh {
        let around = (0..sides).map(|k| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(sides)).sin_cos();
            DVec3::new(cos, 0.1 * f64::from(k % 2), sin)
        });
        let positions = once(DVec3::Y * height).chain(around).collect();
        mesh_of(positions, (0..sides).map(|k| [0, 1 + (k + 1) % sides, 1 + k]).collect())
    }

    /// All pages of level 0.
    fn pages(surface: &Surface) -> Vec<(PageId, TexelPage)> {
        let groups = (0u32..).zip(&surface.cover().groups);
        let ids = groups.flat_map(|(group, of)| {
            let [columns, rows] = of.extent.map(|n| n.div_ceil(PAGE));
            (0..rows).flat_map(move |y| (0..columns).map(move |x| PageId { group, level: 0, page: [x, y] }))
        });
        ids.map(|id| (id, TexelPage::build(surface, id))).collect()
    }

    fn random_dab(random: &mut Random, surface: &Surface) -> Dab {
        let triangle = random.below(surface.mesh().triangles.len() as u64) as u32;
        let lambda = Vec3::from_array([(); 3].map(|()| random.unit() as f32 + 1e-3));
        let texels = 2.0 * 60f32.powf(random.unit() as f32);
        Dab {
            center: SurfacePoint { triangle, lambda: lambda / lambda.element_sum() },
            radius: texels / surface.cover().density,
            hardness: random.unit() as f32,
            flow: 1.0,
            angle: TAU * random.unit() as f32,
            mirrored: random.chance(0.5),
            aspect: if random.chance(0.5) { 1.0 } else { random.unit() as f32 },
            across_gaps: random.chance(0.3),
            stamp: random.chance(0.3).then(|| Arc::new(Stamp::of_tip(Tip::Chalk).unwrap())),
            copy: 0,
        }
    }

    /// Coverage of a page by a dab where every texel of it is asked for.
    fn covered_anywhere(surface: &Surface, map: &TexelPage, dab: &PlacedDab) -> Vec<f32> {
        let mut page = StrokePage::new(map.block.texel_count());
        for place in Rect::of(map.block.extent).texels().filter(|place| map.is_valid(map.texel(*place))) {
            let point = map.point(place);
            if let Some(reached) = dab.region.get(point.triangle) {
                let position = point.position(surface.mesh());
                page.gather(map.texel(place), dab.coverage(reached, point.lambda, position), &[]);
            }
        }
        page.coverage
    }

    #[test]
    fn no_texel_that_a_dab_covers_is_left_out() {
        let mut random = Random::new(11);
        let meshes = [
            slanted(),
            cleaned(generate::grid(1)),
            cleaned(generate::cube(1)),
            cleaned(generate::icosphere(1)),
            tent(5, 1.0),
            tent(9, 3.0),
            tent(4, 0.1),
        ];
        for (number, mesh) in meshes.into_iter().enumerate() {
            let surface = surface(mesh, 150_000);
            let texel = 1.0 / surface.cover().density;
            let pages = pages(&surface);
            for round in 0..12 {
                let dab = random_dab(&mut random, &surface);
                let placed = PlacedDab::new(&surface, &dab, texel);
                let touched = touched_pages(&surface, once(&placed));
                let mut is_covered = false;
                for (id, map) in &pages {
                    let expected = covered_anywhere(&surface, map, &placed);
                    let mut page = StrokePage::new(map.block.texel_count());
                    cover_page(&surface, map, once(&placed), &mut page);
                    assert!(page.coverage == expected, "mesh {number}, dab {round}: {dab:?}");
                    let is_here = expected.iter().any(|coverage| *coverage > 0.0);
                    assert!(!is_here || touched.contains_key(id), "mesh {number}, dab {round}: {dab:?}");
                    is_covered |= is_here;
                }
                assert!(
                    is_covered || dab.stamp.is_some() || dab.aspect < 1.0,
                    "mesh {number}, dab {round}: {dab:?}"
                );
            }
        }
    }

    #[test]
    fn on_a_large_triangle_a_dab_visits_the_texels_around_it() {
        let surface = surface(slanted(), 4_000_000);
        let texel = 1.0 / surface.cover().density;
        let center = SurfacePoint::centroid(0);
        let dab = Dab {
            center,
            radius: 30.0 * texel,
            hardness: 0.5,
            flow: 1.0,
            angle: 0.0,
            mirrored: false,
            aspect: 1.0,
            across_gaps: false,
            stamp: None,
            copy: 0,
        };
        let placed = PlacedDab::new(&surface, &dab, texel);
        let touched = touched_pages(&surface, once(&placed));
        let all = touched_pages(&surface, once(&placed.region)).len();
        assert!(3 * touched.len() <= all, "{} of {all}", touched.len());
        let (mut visited, mut covered) = (0, 0);
        for id in touched.into_keys() {
            let map = TexelPage::build(&surface, id);
            let mut in_region = vec![NO_OWNER; map.triangles.len()];
            for_each_texel(&map, &placed, &mut in_region, |under| {
                let (lambda, position) = (under.point.lambda, under.point.position(surface.mesh()));
                let added = placed.coverage(&placed.region.triangles[under.index], lambda, position);
                (visited, covered) = (visited + 1, covered + u32::from(added > 0.0));
            });
            assert!(in_region.iter().all(|&number| number == NO_OWNER));
        }
        assert!(covered > 2000 && visited < 3 * covered, "{visited} visited, {covered} covered");
    }

    struct Grey;

    impl Source for Grey {
        fn evaluate(&self, _: &TexelPoint, values: &mut [Vec4]) {
            values[0] = Vec4::splat(0.5);
        }
    }

    #[test]
    fn no_texel_that_a_picture_covers_is_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let mut random = Random::new(12);
        let texels = vec![[1.0, 0.5, 0.25, 1.0]; 24 * 7];
        let picture = Picture::new(&Image::from_linear_rgba(24, 7, &texels)).unwrap();
        let channels = vec![ChannelPaint::new(0, PaintColor::Constant(Vec4::ONE))];
        let tool = Tool::Paint(BlendMode::Normal);
        let paint = Paint { tool, opacity: 1.0, channels, stencil: None, sight: None };
        let meshes = [slanted(), cleaned(generate::cube(1)), tent(5, 1.0)];
        for (number, mesh) in meshes.into_iter().enumerate() {
            let surface = surface(mesh, 60_000);
            let path = folder.path().join(format!("{number}.fan"));
            let options = BakeOptions::default();
            bake(surface.mesh(), surface.cover(), &Grey, &path, &options, &NoProgress).unwrap();
            let asset = Asset::open(&path).unwrap();
            let context = PaintContext::new(&surface, &asset, &paint, None);
            let pages = pages(&surface);
            for round in 0..8 {
                let Dab { center, radius, angle, .. } = random_dab(&mut random, &surface);
                let shape = Arc::new(picture.clone());
                let decal =
                    Decal { center, size: 2.0 * radius, angle, shape, mirrored: round % 2 == 1, copy: 0 };
                let placed = PlacedDecal::new(&surface, &decal, &context);
                let touched = touched_pages(&surface, once(&placed));
                for (id, map) in &pages {
                    let mut page = StrokePage::new(map.block.texel_count());
                    cover_page_colored(map, &placed, 1, &mut page);
                    let mut colors = [Vec4::ZERO];
                    for place in Rect::of(map.block.extent).texels() {
                        let texel = map.texel(place);
                        if !map.is_valid(texel) {
                            continue;
                        }
                        let (triangle, point) = (map.triangle(place), map.point(place));
                        let triangles = &placed.region().triangles;
                        let found = triangles.binary_search_by_key(&point.triangle, |t| t.triangle);
                        let expected = found.map_or(0.0, |index| {
                            placed.at(map, &TexelUnder { texel, place, triangle, index, point }, &mut colors)
                        });
                        assert_eq!(page.coverage[texel], expected, "mesh {number}, picture {round}");
                        assert!(expected == 0.0 || touched.contains_key(id));
                    }
                }
            }
        }
    }
}
