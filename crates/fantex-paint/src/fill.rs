//! Choosing triangles to fill.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use fantex_store::{PAGE, PageCache, PageId};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::composite::look_up;
use crate::texel_page::TexelPage;
use crate::{FillSettings, Paint, Surface, SurfacePoint, Symmetry};

/// What a fill covers.
#[derive(Clone, Debug, PartialEq)]
pub enum FillArea {
    /// All there is.
    Everything,
    /// Triangles, ascending.
    Triangles(Vec<u32>),
    /// What looks, in a channel, like points of the surface do.
    Color {
        /// Index of the channel.
        channel: usize,
        /// The points.
        starts: Vec<SurfacePoint>,
        /// How alike, and whether anywhere.
        fill: ColorFill,
    },
}

impl FillArea {
    /// What a fill of settings covers with a paint, from a point and its copies; none where it needs a point and there is none.
    pub fn of(
        surface: &Surface,
        fill: FillSettings,
        paint: &Paint,
        start: Option<SurfacePoint>,
        symmetry: &Symmetry,
    ) -> Option<Self> {
        let channel = paint.channels.first()?.channel;
        Some(match (fill, &paint.stencil) {
            // Nothing else can be covered.
            (FillSettings::Whole, Some(stencil)) => Self::Triangles(stencil.triangles(surface)),
            (FillSettings::Whole, None) => Self::Everything,
            (FillSettings::Connected | FillSettings::Angle(_), _) => {
                Self::Triangles(fill_triangles_with(surface, start?, fill, symmetry))
            }
            (FillSettings::Color(fill), _) => {
                Self::Color { channel, starts: fill_starts(surface, start?, symmetry), fill }
            }
        })
    }
}

/// Mesh units from where a copy of a fill's start falls to the surface, at most. (Models are about 2 mesh units wide.)
const COPY_REACH: f32 = 0.1;

/// The triangles of a fill and its copies, ascending.
pub fn fill_triangles_with(
    surface: &Surface,
    start: SurfacePoint,
    fill: FillSettings,
    symmetry: &Symmetry,
) -> Vec<u32> {
    let starts = fill_starts(surface, start, symmetry);
    let mut all = BTreeSet::new();
    for start in starts {
        // What is filled already goes as far, seen from any of its triangles.
        if !all.contains(&start.triangle) {
            all.extend(fill_triangles(surface, start, fill));
        }
    }
    all.into_iter().collect()
}

/// Where a fill and its copies start.
fn fill_starts(surface: &Surface, start: SurfacePoint, symmetry: &Symmetry) -> Vec<SurfacePoint> {
    symmetry.places(surface, start, COPY_REACH).into_iter().flatten().collect()
}

/// The triangles of a fill, ascending; of one by colour those that it may reach.
pub fn fill_triangles(surface: &Surface, start: SurfacePoint, fill: FillSettings) -> Vec<u32> {
    let min_cosine = match fill {
        FillSettings::Whole | FillSettings::Color(ColorFill { connected: false, .. }) => {
            return (0..surface.mesh().triangles.len() as u32).collect();
        }
        FillSettings::Connected | FillSettings::Color(_) => -2.0,
        FillSettings::Angle(degrees) => f64::from(degrees).to_radians().cos() - 1e-9,
    };
    let mut chosen = vec![false; surface.mesh().triangles.len()];
    chosen[start.triangle as usize] = true;
    let mut waiting = vec![start.triangle];
    while let Some(triangle) = waiting.pop() {
        let normal = surface.facet_normal(triangle);
        for edge in 3 * triangle..3 * triangle + 3 {
            let Some(other) = surface.opposite(edge) else { continue };
            let neighbour = other / 3;
            if !chosen[neighbour as usize] && surface.facet_normal(neighbour).dot(normal) >= min_cosine {
                chosen[neighbour as usize] = true;
                waiting.push(neighbour);
            }
        }
    }
    (0u32..).zip(chosen).filter_map(|(triangle, is_chosen)| is_chosen.then_some(triangle)).collect()
}

// Filling by colour: what looks like the start, everywhere or as far as it hangs together along the surface.
//
// How much a point is covered depends on the texture function there, so all tiles agree. What hangs together is found texel
// by texel: from a texel to its neighbours in the tile, and to the texel that shows the same point in the other tiles.

/// Fills by colour.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ColorFill {
    /// Largest distance of what is filled from the start's value, over red, green, blue and alpha: linear light, 0..2.
    pub tolerance: f32,
    /// Further distance over which the fill fades out.
    pub softness: f32,
    /// Only what hangs together with the start along the surface.
    pub connected: bool,
}

impl Default for ColorFill {
    /// A tenth, fading over a twentieth, connected.
    fn default() -> Self {
        Self { tolerance: 0.1, softness: 0.05, connected: true }
    }
}

impl ColorFill {
    fn coverage(&self, value: Vec4, start: Vec4) -> f32 {
        let beyond = value.distance(start) - self.tolerance.max(0.0);
        if beyond <= 0.0 {
            return 1.0;
        }
        let s = (beyond / self.softness.max(1e-6)).min(1.0);
        1.0 - s * s * (3.0 - 2.0 * s)
    }
}

pub(crate) struct ColorSearch<'a> {
    pub(crate) surface: &'a Surface,
    /// What is compared.
    pub(crate) before: &'a PageCache,
    pub(crate) channel: usize,
    pub(crate) start: Vec4,
    pub(crate) fill: ColorFill,
}

/// Pages with the coverage of their texels.
pub(crate) type Reached = BTreeMap<PageId, Vec<f32>>;

struct ReachedPage {
    map: Arc<TexelPage>,
    /// Coverage of every texel, reached or not; 0 off the surface.
    coverage: Vec<f32>,
    reached: Vec<bool>,
}

impl ColorSearch<'_> {
    /// Coverage of all texels of a page by their colour alone.
    pub(crate) fn coverage(&self, map: &TexelPage) -> Vec<f32> {
        let of_texel = |texel: usize| {
            if !map.is_valid(texel) {
                return 0.0;
            }
            let point = map.point(map.place(texel)).clamped();
            self.fill.coverage(look_up(self.surface, self.before, self.channel, point), self.start)
        };
        (0..map.owner.len()).into_par_iter().map(of_texel).collect()
    }

    /// What hangs together with a point. `map_of` finds or makes pages.
    pub(crate) fn connected(
        &self,
        start: SurfacePoint,
        mut map_of: impl FnMut(&BTreeSet<PageId>) -> Vec<Arc<TexelPage>>,
    ) -> Reached {
        let mut pages: BTreeMap<PageId, ReachedPage> = BTreeMap::new();
        let mut front: Vec<(PageId, u32)> = self.places_of(start, None);
        // Wave after wave: within the pages that are there, then with those that were asked for.
        while !front.is_empty() {
            let wanted: BTreeSet<PageId> =
                front.iter().map(|(id, _)| *id).filter(|id| !pages.contains_key(id)).collect();
            for (&id, map) in wanted.iter().zip(map_of(&wanted)) {
                let coverage = self.coverage(&map);
                let reached = vec![false; coverage.len()];
                pages.insert(id, ReachedPage { map, coverage, reached });
            }
            front = self.flood(&mut pages, front);
        }
        let covered = pages.into_iter().map(|(id, mut page)| {
            page.coverage.iter_mut().zip(&page.reached).for_each(|(c, reached)| {
                if !reached {
                    *c = 0.0;
                }
            });
            (id, page.coverage)
        });
        covered.collect()
    }

    /// Goes on within the known pages; returns places on others.
    fn flood(
        &self,
        pages: &mut BTreeMap<PageId, ReachedPage>,
        mut front: Vec<(PageId, u32)>,
    ) -> Vec<(PageId, u32)> {
        let mut elsewhere = Vec::new();
        while let Some((id, texel)) = front.pop() {
            let Some(page) = pages.get_mut(&id) else {
                elsewhere.push((id, texel));
                continue;
            };
            let place = texel as usize;
            if page.coverage[place] <= 0.0 || std::mem::replace(&mut page.reached[place], true) {
                continue;
            }
            let extent = page.map.block.extent;
            let [x, y] = [texel % extent[0], texel / extent[0]];
            let (point, position) = self.point(&page.map, [x, y]);
            let near = |place: [u32; 2]| {
                let texel = page.map.texel(place);
                // Beside a slit the next texel may show another part of the surface.
                let texels = 3.0 / self.surface.cover().density;
                let is_near =
                    page.map.is_valid(texel) && self.point(&page.map, place).1.distance(position) < texels;
                is_near.then_some((id, texel as u32))
            };
            let right = (x + 1 < extent[0]).then(|| [x + 1, y]);
            let lower = (y + 1 < extent[1]).then(|| [x, y + 1]);
            let left = (x > 0).then(|| [x - 1, y]);
            let upper = (y > 0).then(|| [x, y - 1]);
            let around: Vec<_> = [right, lower, left, upper].into_iter().flatten().filter_map(near).collect();
            front.extend(around);
            // The same tile may go on in another page.
            let is_border = right.is_none() || lower.is_none() || left.is_none() || upper.is_none();
            if is_border {
                front.extend(self.across(id, [x, y]));
            }
            front.extend(self.places_of(point, Some(id.group)));
        }
        elsewhere
    }

    /// Neighbours of a texel in the tile's other pages.
    fn across(&self, id: PageId, [x, y]: [u32; 2]) -> Vec<(PageId, u32)> {
        let tile = self.surface.cover().groups[id.group as usize].extent;
        let at = [i64::from(id.page[0] * PAGE + x), i64::from(id.page[1] * PAGE + y)];
        let steps = [[1, 0], [0, 1], [-1, 0], [0, -1]];
        let moved = steps.map(|[dx, dy]| [at[0] + dx, at[1] + dy]);
        let inside = moved
            .into_iter()
            .filter(|[x, y]| (0..i64::from(tile[0])).contains(x) && (0..i64::from(tile[1])).contains(y));
        inside
            .map(|[x, y]| place_in(id.group, tile, [x as u32, y as u32]))
            .filter(|(p, _)| *p != id)
            .collect()
    }

    fn point(&self, map: &TexelPage, place: [u32; 2]) -> (SurfacePoint, Vec3) {
        let point = map.point(place).clamped();
        (point, self.surface.position(point).as_vec3())
    }

    /// The texels that show a point, but for those of one tile.
    fn places_of(&self, point: SurfacePoint, without: Option<u32>) -> Vec<(PageId, u32)> {
        let (mesh, cover) = (self.surface.mesh(), self.surface.cover());
        let triangle = point.triangle as usize;
        let groups = cover.corner_groups[triangle];
        let mut places = Vec::with_capacity(2);
        for (slot, group) in groups.into_iter().enumerate() {
            if Some(group) == without || groups[..slot].contains(&group) {
                continue;
            }
            let uv = point.interpolate(cover.tile_corners(mesh, triangle, slot));
            let extent = cover.groups[group as usize].extent;
            let texels = Vec2::new(extent[0] as f32, extent[1] as f32);
            let at = (uv * texels).clamp(Vec2::ZERO, texels - 1.0).as_uvec2();
            places.push(place_in(group, extent, at.into()));
        }
        places
    }
}

/// Page and number within it of a tile's texel.
fn place_in(group: u32, extent: [u32; 2], [x, y]: [u32; 2]) -> (PageId, u32) {
    let page = [x / PAGE, y / PAGE];
    let columns = (extent[0] - page[0] * PAGE).min(PAGE);
    (PageId { group, level: 0, page }, y % PAGE * columns + x % PAGE)
}
