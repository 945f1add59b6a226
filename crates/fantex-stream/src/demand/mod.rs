//! Demand: how fine every tile is needed for a view, from geometry alone.
//!
//! ```text
//!  mesh, cover --kites, bounds--> DemandSurface --lens--> Detail per group, pages of large tiles
//!                                 groups, blocks, tree      (only what changed since the last view)
//! ```
//!
//! **What is computed.** For every group that may be in the picture a lower bound of the width of a pixel in its texels,
//! rounded down to an eighth of a level: never coarser than what a look-up reads, a little finer (`tests/stream/demand.rs` compares it
//! with every triangle, point by point).
//!
//! **What makes it cheap.** A result is valid until the camera has moved or turned so far that a bound could be crossed: the
//! bounds are taken with that much slack ([`TRAVEL`], [`TURN`]). A node of the tree keeps the earliest time, measured in the
//! way and the angle that the camera has covered so far, at which anything below it must be looked at again. Blocks that are
//! small against their distance, inside the picture and turned to the camera are bounded once for all their groups. An update is told how
//! long it may take; after a cut in a view of hundreds of thousands of tiles some wait for the next one. Bounds of pages of large tiles are
//! taken by several threads at once ([`bounding`]).
//!
//! **What it gives away.** On average 0.1 to 0.4 levels; normals, rays and densities are bounded together ([`Relief`]), because at a slant
//! of 75 degrees a cone of normals of 13 degrees alone costs 0.4 levels. Groups at a silhouette, of which a sliver is seen at a grazing
//! angle, are demanded finer than they are seen, and 10 to 16 % of the wanted groups of curved bodies lie within the slack or turn their
//! back at most points.
//!
//! **Occlusion is not computed**: depth is known to the renderer only, and only for the last picture. What hidden surfaces cost is room in
//! the pool, which the bias takes into account.

mod bounding;
mod bounds;
mod paged;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::sync::Arc;

use bounds::{Bounds, LogDensities, Relief, Sight, Slack, group_bounds};
pub(crate) use bounds::{Lens, Sphere};
use fantex_cover::GroupTriangles;
use glam::{Mat3, Vec3};
pub use paged::PageDemand;
use paged::{PagedTile, PagesWanted};

pub use crate::shape::Detail;
use crate::shape::{SparseLists, TileShapes};
use crate::{Geometry, StreamView};

/// The camera may move by this share of its distance from a block before the block is looked at again.
const TRAVEL: f32 = 0.02;
/// The camera may turn by this angle, radians.
const TURN: f32 = 0.01;
/// The same for blocks well inside the picture, whose level alone is at stake.
const UNIFORM_TRAVEL: f32 = 0.03;
/// Radians for such blocks.
const UNIFORM_TURN: f32 = 0.03;
/// Maximum ratio of the depths of a block's farthest and nearest points for it to be bounded as a whole: a fifth of a level.
const UNIFORM_DEPTH: f32 = 1.15;

/// Cost of bounding a group: the unit of work.
const GROUP_NANOSECONDS: u32 = 85;
/// Cost of bounding a block as a whole, in units.
const BLOCK_WORK: usize = 4;
/// The same where each of the block's reliefs is visited.
const RELIEF_BLOCK_WORK: usize = 16;

/// The way and the angle that a camera has covered.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Course {
    travel: f64,
    turn: f64,
}

impl Course {
    const START: Self = Self { travel: 0.0, turn: 0.0 };
    const PAST: Self = Self { travel: f64::NEG_INFINITY, turn: f64::NEG_INFINITY };
    const NEVER: Self = Self { travel: f64::INFINITY, turn: f64::INFINITY };

    fn plus(self, slack: Slack) -> Self {
        Self { travel: self.travel + f64::from(slack.travel), turn: self.turn + f64::from(slack.turn) }
    }

    fn min(self, other: Self) -> Self {
        Self { travel: self.travel.min(other.travel), turn: self.turn.min(other.turn) }
    }

    fn is_before(self, due: Self) -> bool {
        self.travel <= due.travel && self.turn <= due.turn
    }
}

/// What is known of a node for the current view.
#[derive(Clone, Copy, Debug)]
struct NodeState {
    /// Valid until then.
    due: Course,
    is_hidden: bool,
}

/// How much work an update was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DemandWork {
    /// Nodes of the tree that were looked at.
    pub nodes: u32,
    /// Blocks that were bounded as a whole.
    pub uniform_blocks: u32,
    /// Groups that were bounded one by one.
    pub groups: u32,
    /// Times that a large tile was looked at page by page.
    pub paged: u32,
}

pub(crate) struct Demand {
    max_anisotropy: f32,
    /// Per group what it needs.
    pub(crate) details: Vec<Detail>,
    pages: SparseLists<PageDemand>,
    nodes: Vec<Vec<NodeState>>,
    view: Option<StreamView>,
    course: Course,
    pub(crate) work: DemandWork,
    /// Work that the last update might do, in units of a group's bounds.
    may_do: usize,
    /// What it has left of that.
    left: usize,
    /// The block at which the last update ran out of work; the next one begins there, so that all have their turn.
    resume: Option<usize>,
    /// Visible large tiles some of whose pages have no bounds yet, and the slack with which these are looked at.
    waiting: BTreeMap<u32, Slack>,
}

/// Share of an update's work that is kept for pages that wait for bounds, while there is much else to look at: one part of so many.
const BOUNDING_SHARE: usize = 4;

impl Demand {
    /// Nothing is visible yet. `max_anisotropy` is 1 for trilinear look-ups.
    pub(crate) fn new(surface: &DemandSurface, max_anisotropy: f32) -> Self {
        let hidden = NodeState { due: Course::PAST, is_hidden: true };
        Self {
            max_anisotropy,
            details: vec![Detail::HIDDEN; surface.groups.len()],
            pages: SparseLists::new(surface.groups.len()),
            nodes: surface.nodes.iter().map(|nodes| vec![hidden; nodes.len()]).collect(),
            view: None,
            course: Course::START,
            work: DemandWork::default(),
            may_do: 0,
            left: 0,
            resume: None,
            waiting: BTreeMap::new(),
        }
    }

    /// Whether the last update left groups or pages for the next one.
    pub(crate) fn is_behind(&self) -> bool {
        self.resume.is_some() || !self.waiting.is_empty()
    }

    #[inline]
    pub(crate) fn detail(&self, group: u32) -> Detail {
        self.details[group as usize]
    }

    /// The [own](TileShape::own_pages) pages that a large tile needs, ascending; none for a tile of one page per level.
    pub(crate) fn pages(&self, group: u32) -> &[PageDemand] {
        self.pages.get(group)
    }

    /// Nanoseconds that the last update should have taken, where there are as many threads as work is counted for.
    pub(crate) fn nanoseconds(&self) -> u32 {
        (self.may_do - self.left) as u32 * GROUP_NANOSECONDS
    }

    /// Honours another greatest anisotropy from the next update on.
    pub(crate) fn set_max_anisotropy(&mut self, max_anisotropy: f32) {
        if max_anisotropy != self.max_anisotropy {
            self.max_anisotropy = max_anisotropy;
            self.forget();
        }
    }

    /// Moves the view; `None` sees nothing. Groups whose demand is another one now are added to `changed`, some of them more than once.
    /// Takes about as long as it may, or less.
    pub(crate) fn update(
        &mut self,
        surface: &mut DemandSurface,
        view: Option<&StreamView>,
        nanoseconds: u32,
        changed: &mut Vec<u32>,
    ) {
        self.may_do = (nanoseconds / GROUP_NANOSECONDS).max(1) as usize;
        self.work = DemandWork::default();
        self.left = self.may_do;
        let root = self.nodes.len() - 1;
        if self.details.is_empty() {
            return;
        }
        let Some(view) = view.filter(|v| is_usable(v)) else {
            self.hide(root, 0, changed);
            self.forget();
            (self.view, self.resume) = (None, None);
            return;
        };
        self.advance(view);
        let lens = Lens::new(view, self.max_anisotropy);
        let reserved = if self.waiting.is_empty() { 0 } else { self.may_do / BOUNDING_SHARE };
        self.left -= reserved;
        self.walk(surface, lens, changed);
        self.left += reserved;
        self.bound_pages(surface, &lens, changed);
    }

    /// Brings the tree up to date, from the block on at which the last update ended.
    fn walk(&mut self, surface: &mut DemandSurface, lens: Lens, changed: &mut Vec<u32>) {
        let root = self.nodes.len() - 1;
        let begin = self.resume.take().unwrap_or(0);
        let mut visit = Visit { demand: self, surface, lens, changed, blocks: begin..usize::MAX };
        visit.node(root, 0);
        if begin > 0 {
            visit.blocks = 0..begin;
            visit.node(root, 0);
        }
    }

    /// Looks at everything again in the next update.
    fn forget(&mut self) {
        self.nodes.iter_mut().flatten().for_each(|state| state.due = Course::PAST);
    }

    /// Takes account of the way from the last view to this one.
    fn advance(&mut self, view: &StreamView) {
        match self.view.replace(*view) {
            Some(last) if last.half_extent == view.half_extent && last.focal_pixels == view.focal_pixels => {
                self.course.travel += f64::from(last.eye.distance(view.eye));
                self.course.turn += angle_between(last.axes, view.axes);
            }
            _ => self.forget(),
        }
    }

    /// Hides everything below a node.
    fn hide(&mut self, height: usize, node: usize, changed: &mut Vec<u32>) {
        let state = &mut self.nodes[height][node];
        if std::mem::replace(&mut state.is_hidden, true) {
            return;
        }
        if height == 0 {
            for group in block(node, self.details.len()) {
                self.set(group as u32, Detail::HIDDEN, changed);
            }
        } else {
            for child in children(node, self.nodes[height - 1].len()) {
                self.hide(height - 1, child, changed);
            }
        }
    }

    fn set(&mut self, group: u32, detail: Detail, changed: &mut Vec<u32>) {
        let known = &mut self.details[group as usize];
        if *known != detail {
            *known = detail;
            changed.push(group);
            if !detail.is_visible() {
                self.pages.set(group, Vec::new());
                self.waiting.remove(&group);
            }
        }
    }

    /// Takes over what a large tile wants of its pages. Where bounds are missing, it waits for them.
    fn take_pages(&mut self, group: u32, slack: Slack, wanted: PagesWanted, changed: &mut Vec<u32>) {
        if wanted.unbounded.is_empty() {
            self.waiting.remove(&group);
        } else {
            self.waiting.insert(group, slack);
        }
        self.set_pages(group, wanted.pages, changed);
    }

    fn set_pages(&mut self, group: u32, pages: Vec<PageDemand>, changed: &mut Vec<u32>) {
        if self.pages(group) != pages {
            self.pages.set(group, pages);
            if changed.last() != Some(&group) {
                changed.push(group);
            }
        }
    }
}

/// One walk down the tree.
struct Visit<'a> {
    demand: &'a mut Demand,
    surface: &'a mut DemandSurface,
    lens: Lens,
    changed: &'a mut Vec<u32>,
    /// Those that are visited.
    blocks: Range<usize>,
}

impl Visit<'_> {
    /// Brings a node up to date; returns until when it is.
    fn node(&mut self, height: usize, node: usize) -> Course {
        let course = self.demand.course;
        let state = self.demand.nodes[height][node];
        if course.is_before(state.due) || !self.is_visited(height, node) {
            return state.due;
        }
        if self.demand.left == 0 {
            self.demand.resume.get_or_insert(node * FAN_OUT.pow(height as u32));
            return state.due;
        }
        self.demand.work.nodes += 1;
        let bounds = self.surface.nodes[height][node];
        // A node that is hidden for this very view waits until it may not be.
        let due = match self.lens.sight(&bounds, Slack { travel: 0.0, turn: 0.0 }) {
            Sight::Hidden(slack) => {
                self.demand.hide(height, node, self.changed);
                course.plus(slack)
            }
            _ if height == 0 => self.block(node, &bounds),
            _ => {
                if state.is_hidden {
                    self.wake_children(height, node);
                }
                self.demand.nodes[height][node].is_hidden = false;
                let children = children(node, self.demand.nodes[height - 1].len());
                children.map(|child| self.node(height - 1, child)).fold(Course::NEVER, Course::min)
            }
        };
        self.demand.nodes[height][node].due = due;
        due
    }

    fn spend(&mut self, work: usize) {
        self.demand.left = self.demand.left.saturating_sub(work);
    }

    /// Whether a node has blocks that are visited.
    fn is_visited(&self, height: usize, node: usize) -> bool {
        let blocks = FAN_OUT.pow(height as u32);
        node * blocks < self.blocks.end && self.blocks.start < (node + 1) * blocks
    }

    /// What was known of the children of a node that was hidden may be out of date.
    fn wake_children(&mut self, height: usize, node: usize) {
        let children = children(node, self.demand.nodes[height - 1].len());
        self.demand.nodes[height - 1][children].iter_mut().for_each(|child| child.due = Course::PAST);
    }

    fn block(&mut self, node: usize, bounds: &Bounds) -> Course {
        self.demand.nodes[0][node].is_hidden = false;
        let gap = self.lens.gap(&bounds.sphere).max(0.25 * bounds.sphere.radius);
        let slack = Slack { travel: TRAVEL * gap, turn: TURN };
        if self.lens.depth_ratio(&bounds.sphere) < UNIFORM_DEPTH {
            let wide = Slack { travel: UNIFORM_TRAVEL * gap, turn: UNIFORM_TURN };
            for slack in [wide, slack] {
                if self.lens.sight(bounds, slack) == Sight::Whole {
                    if !self.uniform_block(node, bounds, slack) {
                        break;
                    }
                    return self.demand.course.plus(slack);
                }
            }
        }
        let groups = block(node, self.demand.details.len());
        self.demand.work.groups += groups.len() as u32;
        self.spend(groups.len());
        for group in groups {
            self.group(group as u32, slack);
        }
        self.demand.course.plus(slack)
    }

    /// One bound for all groups of a block: they differ by their densities only. False where a large tile is wanted so fine
    /// that its pages differ.
    fn uniform_block(&mut self, node: usize, bounds: &Bounds, slack: Slack) -> bool {
        self.demand.work.uniform_blocks += 1;
        let uses_relief = self.lens.uses_relief();
        self.spend(if uses_relief { RELIEF_BLOCK_WORK } else { BLOCK_WORK });
        let pixel = self.lens.pixel_on(bounds, slack);
        let groups = block(node, self.demand.details.len());
        let mut details = [Detail::HIDDEN; BLOCK];
        for (detail, group) in details.iter_mut().zip(groups.clone()) {
            let densities = self.surface.densities[group];
            if densities == LogDensities::NOTHING {
                continue;
            }
            let mut log2_width = pixel.log2_width(densities);
            if uses_relief {
                let (center, relief) =
                    (self.surface.groups[group].sphere.center, &self.surface.reliefs[group]);
                log2_width = log2_width.max(self.lens.log2_width_in_tile(&pixel, center, relief, slack));
            }
            *detail = Detail::from_log2(log2_width);
        }
        let differs = |(group, &detail): (usize, &Detail)| {
            let shape = self.surface.shapes.of(group as u32);
            detail.is_visible() && shape.is_paged() && shape.single_pages(detail).is_none()
        };
        let has_paged = self.surface.has_paged[node];
        if has_paged && groups.clone().zip(&details).any(differs) {
            return false;
        }
        if self.demand.details[groups.clone()] != details[..groups.len()] {
            for (group, detail) in groups.zip(details) {
                if has_paged {
                    self.set(group as u32, detail);
                } else {
                    self.demand.set(group as u32, detail, self.changed);
                }
            }
        }
        true
    }

    /// Sets what a group needs and, where each of its levels is one page, what of its pages. Returns whether more must be known
    /// of its pages.
    fn set(&mut self, group: u32, detail: Detail) -> bool {
        let is_new = self.demand.detail(group) != detail;
        self.demand.set(group, detail, self.changed);
        let shape = self.surface.shapes.of(group);
        if !detail.is_visible() || !shape.is_paged() {
            return false;
        }
        let Some(pages) = shape.single_pages(detail) else { return true };
        // These pages follow from the detail.
        self.demand.waiting.remove(&group);
        if is_new {
            let own = pages.start..pages.end.min(shape.own_pages());
            let pages = own.map(|index| PageDemand { index, detail }).collect();
            self.demand.set_pages(group, pages, self.changed);
        }
        false
    }

    fn group(&mut self, group: u32, slack: Slack) {
        let bounds = self.surface.groups[group as usize];
        let detail = match self.lens.sight(&bounds, slack) {
            Sight::Hidden(_) => Detail::HIDDEN,
            _ => {
                let relief = &self.surface.reliefs[group as usize];
                Detail::from_log2(self.lens.log2_width(&bounds, relief, slack))
            }
        };
        if self.set(group, detail) {
            if let Some(tile) = self.surface.paged.get_mut(&group) {
                tile.trim();
            }
            self.demand.work.paged += 1;
            let wanted = self.surface.pages_wanted(group, (&self.lens, slack), self.demand.pages(group));
            self.spend(wanted.looked_at);
            self.demand.take_pages(group, slack, wanted, self.changed);
        }
    }
}

fn block(node: usize, group_count: usize) -> Range<usize> {
    node * BLOCK..group_count.min((node + 1) * BLOCK)
}

fn children(node: usize, count: usize) -> Range<usize> {
    node * FAN_OUT..count.min((node + 1) * FAN_OUT)
}

/// The angle of the rotation from one frame to another, radians.
fn angle_between(a: Mat3, b: Mat3) -> f64 {
    // The Frobenius norm of the difference is 2 sqrt(2) sin(angle / 2).
    let squared: f32 = [a.x_axis - b.x_axis, a.y_axis - b.y_axis, a.z_axis - b.z_axis]
        .into_iter()
        .map(Vec3::length_squared)
        .sum();
    2.0 * (f64::from(squared).sqrt() / 8f64.sqrt()).min(1.0).asin()
}

/// Whether a view has a picture: finite, not empty.
fn is_usable(view: &StreamView) -> bool {
    view.eye.is_finite()
        && view.axes.is_finite()
        && view.focal_pixels.is_finite()
        && view.focal_pixels > 0.0
        && view.half_extent.iter().all(|&n| n.is_finite() && n > 0.0)
}

// The surface as demand sees it: bounds of groups, of blocks of groups, of blocks of blocks.
//
// Groups are ordered along a space-filling curve over the surface, so consecutive ones are neighbours, and a tree needs no
// pointers: block `b` holds groups `32 b ..`, the nodes above hold eight each. Memory: 116 bytes per group, 60 of them for reliefs.

/// Groups of a block.
pub(crate) const BLOCK: usize = 32;
const FAN_OUT: usize = 8;

/// What all views of a covered mesh share.
pub(crate) struct DemandSurface {
    pub(crate) geometry: Arc<dyn Geometry>,
    pub(crate) shapes: Arc<TileShapes>,
    pub(crate) groups: Vec<Bounds>,
    pub(crate) reliefs: Vec<Relief>,
    /// The groups' densities, close together.
    pub(crate) densities: Vec<LogDensities>,
    /// Blocks, then the nodes over them, up to a single one.
    pub(crate) nodes: Vec<Vec<Bounds>>,
    pub(crate) paged: HashMap<u32, PagedTile>,
    /// Per block whether a tile in it has several pages.
    pub(crate) has_paged: Vec<bool>,
}

impl DemandSurface {
    pub(crate) fn new(geometry: Arc<dyn Geometry>, shapes: Arc<TileShapes>) -> Self {
        let (mesh, cover) = (geometry.mesh(), geometry.cover());
        let triangles = GroupTriangles::of(cover);
        let (groups, reliefs) = group_bounds(mesh, cover, &triangles);
        let mut nodes = vec![groups.chunks(BLOCK).map(Bounds::around).collect::<Vec<_>>()];
        while nodes[nodes.len() - 1].len() > 1 {
            let next = nodes[nodes.len() - 1].chunks(FAN_OUT).map(Bounds::around).collect();
            nodes.push(next);
        }
        let paged: HashMap<u32, PagedTile> = (0..groups.len() as u32)
            .filter(|&g| shapes.of(g).is_paged())
            .map(|g| (g, PagedTile::new(g, triangles.of_group(g).to_vec())))
            .collect();
        let has_paged = (0..groups.len() as u32)
            .collect::<Vec<_>>()
            .chunks(BLOCK)
            .map(|block| block.iter().any(|g| paged.contains_key(g)))
            .collect();
        let densities = groups.iter().map(|bounds| bounds.density).collect();
        Self { geometry, shapes, groups, reliefs, densities, nodes, paged, has_paged }
    }

    /// What a large tile wants of its pages from a view, as far as their bounds are known; `last` is what it wanted before.
    fn pages_wanted(&self, group: u32, view: (&Lens, Slack), last: &[PageDemand]) -> PagesWanted {
        let whole = (self.groups[group as usize], self.reliefs[group as usize]);
        let tile = self.paged.get(&group);
        tile.map(|tile| tile.wanted(self.shapes.of(group), &whole, view, last)).unwrap_or_default()
    }

    /// Of a ball around everything, mesh units; zero where there is nothing.
    pub(crate) fn radius(&self) -> f32 {
        self.nodes.last().and_then(|root| root.first()).map_or(0.0, |root| root.sphere.radius)
    }
}
