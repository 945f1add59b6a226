//! Which objects of a world are shown whole, which by their previews, which by coarse assets, within a budget of memory.
//!
//! Objects are boxes here, with the memory that they take. A preview suffices while its finest detail is less than a pixel long. First all
//! that is in the picture gets what is coarsest of it, the largest on the screen first; then what is too coarse becomes finer, the coarsest
//! first, as long as there is memory: an object by its preview becomes whole, a coarse asset is replaced by all of its parts at once. What is
//! finer comes on top of what is coarse, which stays for the way back. What leaves the picture stays while nobody else needs its memory, and
//! what is whole until what is more urgent is there. What is there counts as a little more urgent, so that equals do not displace each other.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::Vec3;

use crate::StreamView;
use crate::demand::{Lens, Sphere};

/// An object or a coarse asset, as the choice needs to know it.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewObject {
    /// Corners of its box, in the space of the view.
    pub bounds: [Vec3; 2],
    /// Where its surface is, once that is known: the eye is often in the boxes of several objects.
    pub surface: SurfaceSamples,
    /// Memory that it takes whole; of a coarse asset 0.
    pub whole_bytes: u64,
    /// Its preview, if it has one. A coarse asset is one itself.
    pub preview: Option<ViewPreview>,
    /// Of a coarse asset what it stands for: numbers in the list of all. They are part of nothing else, and make no circles.
    pub parts: Vec<usize>,
}

/// Points of a surface, for its distance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceSamples {
    points: Vec<Vec3>,
    /// Every point that was given is as near to one of them.
    spacing: f32,
}

/// Points that are kept of a surface.
const SAMPLES: usize = 256;

impl SurfaceSamples {
    /// Some hundred of the points of a surface.
    pub fn of(points: &[Vec3]) -> Self {
        let step = points.len().div_ceil(SAMPLES).max(1);
        let mut samples = Self { points: points.iter().copied().step_by(step).collect(), spacing: 0.0 };
        samples.spacing = points.iter().map(|&p| samples.nearest(p)).fold(0.0, f32::max);
        samples
    }

    /// Distance of the nearest of the points.
    fn nearest(&self, p: Vec3) -> f32 {
        self.points.iter().map(|q| q.distance_squared(p)).fold(f32::INFINITY, f32::min).sqrt()
    }

    /// About the distance of the surface from a point; 0 where nothing is known of it.
    fn distance(&self, p: Vec3) -> f32 {
        if self.points.is_empty() {
            return 0.0;
        }
        let nearest = self.nearest(p);
        // What is nearer than the points lie apart still has an order.
        (nearest - self.spacing).max(NEAR_SHARE * nearest)
    }
}

/// Of the distance of the nearest sample, the least that the surface is taken to be away.
const NEAR_SHARE: f32 = 0.25;

/// The preview of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewPreview {
    /// Memory that it takes.
    pub bytes: u64,
    /// Length of the finest detail that it shows.
    pub detail: f32,
}

/// How much is shown of an object or a coarse asset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum ObjectDetail {
    /// Nothing.
    #[default]
    Absent,
    /// Its preview, or the coarse asset.
    Preview,
    /// All of it, or all parts of the coarse asset. Its preview is kept, for the way back.
    Whole,
}

/// What is to be shown of objects.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectChoice {
    /// Per object and coarse asset. What a coarse asset stands for is absent while that is shown itself.
    pub details: Vec<ObjectDetail>,
    /// What is to be there, the most urgent first: an object and one of its details, or a coarse asset as a preview.
    pub order: Vec<(usize, ObjectDetail)>,
    /// Memory that it takes.
    pub bytes: u64,
    /// Objects that are shown whole and should be, but for which there is no memory; the most urgent first.
    pub displaced: Vec<usize>,
}

impl ObjectChoice {
    /// The displaced objects that stay whole: those whose memory what is there of the choice does not need yet.
    pub fn staying(
        &self,
        objects: &[ViewObject],
        budget_bytes: u64,
        is_there: impl Fn(usize, ObjectDetail) -> bool,
    ) -> Vec<usize> {
        let there = self.order.iter().filter(|&&(index, detail)| is_there(index, detail));
        let bytes = there.map(|&(index, detail)| objects[index].bytes(detail));
        let mut sum = bytes.fold(0, u64::saturating_add);
        let mut fits = |&index: &usize| {
            let next = objects[index].whole_bytes.saturating_add(sum);
            let fits = next <= budget_bytes;
            sum = if fits { next } else { sum };
            fits
        };
        self.displaced.iter().copied().filter(|index| fits(index)).collect()
    }

    /// What is drawn once all is there, in the order of `objects`: what is shown without the coarse assets whose parts are.
    pub fn drawn<'a>(
        &'a self,
        objects: &'a [ViewObject],
    ) -> impl Iterator<Item = (usize, ObjectDetail)> + 'a {
        let details = self.details.iter().copied().enumerate();
        details.filter(move |&(index, detail)| match detail {
            ObjectDetail::Absent => false,
            ObjectDetail::Preview => true,
            ObjectDetail::Whole => objects[index].parts.is_empty(),
        })
    }

    /// Adds what is shown of an object, if the budget allows it.
    fn add(&mut self, objects: &[ViewObject], index: usize, detail: ObjectDetail, budget_bytes: u64) -> bool {
        let sum = self.bytes.saturating_add(objects[index].bytes(detail));
        let is_enough = sum <= budget_bytes;
        if is_enough {
            self.bytes = sum;
            self.details[index] = detail;
            self.order.push((index, detail));
        }
        is_enough
    }
}

/// Length in pixels of a preview's finest detail from which the object itself is wanted.
const COARSE_PIXELS: f32 = 1.0;

/// One that is whole stays so down to this length, so that nothing flickers.
const STAYING_PIXELS: f32 = 0.75;

/// What is there is so many times as urgent as what would take its place.
const STAYING_URGENCY: f32 = 1.25;

/// Objects whose boxes are shorter on the screen are not shown, in pixels.
const MIN_PIXELS: f32 = 0.5;

/// An object without a preview is as urgent as if it had one whose detail is such a part of its length.
const ASSUMED_DETAIL: f32 = 1.0 / 64.0;

/// A part of the preference that what is in the picture has over what is beside it.
const UNSEEN: f32 = 1.0 / 64.0;

/// Chooses what to show of objects within `budget_bytes`. `shown` is what is shown of each now.
///
/// Coarse assets are among the objects. What is part of one is not shown while the coarse asset is, and all parts are shown where it is not,
/// however small they are: nothing is missing, and nothing is there twice.
pub fn choose_objects(
    objects: &[ViewObject],
    view: &StreamView,
    budget_bytes: u64,
    shown: &[ObjectDetail],
) -> ObjectChoice {
    let lens = Lens::new(view, 1.0);
    let now = |index: usize| shown.get(index).copied().unwrap_or_default();
    let is_seen = |index: usize| lens.may_see(&objects[index].sphere());
    // By the length in pixels of what is missing without it.
    let step = |index: usize, detail: ObjectDetail, pixels: f32| {
        let staying = if now(index) >= detail { STAYING_URGENCY } else { 1.0 };
        let preference = if is_seen(index) { 1.0 } else { UNSEEN };
        Step { urgency: pixels * preference * staying, index }
    };
    // What is not seen is not fetched, but may stay. Without a preview there is nothing else than the whole.
    let finer = |index: usize| {
        let [_, detail] = objects[index].pixels(view);
        let is_shown = now(index) == ObjectDetail::Whole;
        let enough = if is_shown { STAYING_PIXELS } else { COARSE_PIXELS };
        let is_wanted = objects[index].preview.is_none() || detail > enough;
        let is_due = (is_shown || is_seen(index)) && is_wanted;
        is_due.then(|| step(index, ObjectDetail::Whole, detail))
    };
    let mut choice =
        ObjectChoice { details: vec![ObjectDetail::Absent; objects.len()], ..ObjectChoice::default() };

    // What is part of nothing, by its preview.
    let mut roots = root_objects(objects);
    roots.retain(|&index| objects[index].pixels(view)[0] >= MIN_PIXELS);
    let small = roots.iter().copied().filter(|&index| objects[index].preview.is_some());
    let mut sizes: Vec<Step> =
        small.map(|index| step(index, ObjectDetail::Preview, objects[index].pixels(view)[0])).collect();
    sizes.sort_unstable();
    for Step { index, .. } in sizes.into_iter().rev() {
        choice.add(objects, index, ObjectDetail::Preview, budget_bytes);
    }

    // What is too coarse, finer.
    let mut steps: BinaryHeap<Step> = roots.into_iter().filter_map(finer).collect();
    while let Some(Step { index, .. }) = steps.pop() {
        let parts = &objects[index].parts;
        if parts.is_empty() {
            let fits = choice.add(objects, index, ObjectDetail::Whole, budget_bytes);
            if !fits && now(index) == ObjectDetail::Whole {
                choice.displaced.push(index);
            }
            continue;
        }
        let coarsest = parts.iter().map(|&part| objects[part].bytes(objects[part].coarsest()));
        let bytes = coarsest.fold(choice.bytes, u64::saturating_add);
        if choice.details[index] == ObjectDetail::Absent || bytes > budget_bytes {
            continue;
        }
        choice.details[index] = ObjectDetail::Whole;
        for &part in parts {
            choice.add(objects, part, objects[part].coarsest(), budget_bytes);
            // What has no preview is whole already.
            steps.extend(finer(part).filter(|_| objects[part].preview.is_some()));
        }
    }
    choice
}

/// What is part of nothing.
pub fn root_objects(objects: &[ViewObject]) -> Vec<usize> {
    let mut is_part = vec![false; objects.len()];
    objects.iter().flat_map(|object| &object.parts).for_each(|&part| is_part[part] = true);
    (0..objects.len()).filter(|&index| !is_part[index]).collect()
}

/// What there is of an object or a coarse asset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ObjectState {
    /// It can be drawn: whole, by its preview, or as the coarse asset.
    pub is_there: bool,
    /// It is a coarse asset in whose place its parts are wanted.
    pub is_divided: bool,
}

/// What is drawn of what is there of `roots`: a coarse asset until all of its parts are there; where it is not there itself, those parts that
/// are.
pub fn drawn_objects(
    objects: &[ViewObject],
    roots: &[usize],
    state: impl Fn(usize) -> ObjectState,
) -> Vec<usize> {
    let mut drawn = Vec::new();
    for &root in roots {
        add_drawn(objects, root, &state, &mut drawn);
    }
    drawn
}

/// Adds what is drawn of one of them; whether that is all of it.
fn add_drawn(
    objects: &[ViewObject],
    index: usize,
    state: &impl Fn(usize) -> ObjectState,
    drawn: &mut Vec<usize>,
) -> bool {
    let ObjectState { is_there, is_divided } = state(index);
    if is_there && !is_divided {
        drawn.push(index);
        return true;
    }
    let before = drawn.len();
    let parts = objects[index].parts.iter();
    // All are added, whatever the first ones have.
    let lacking = parts.filter(|part| !add_drawn(objects, **part, state, drawn)).count();
    if is_divided && lacking == 0 {
        return true;
    }
    if is_there {
        drawn.truncate(before);
        drawn.push(index);
    }
    is_there
}

/// Something to be added, the most urgent first; of equals that with the lowest number.
struct Step {
    urgency: f32,
    index: usize,
}

impl Ord for Step {
    fn cmp(&self, other: &Self) -> Ordering {
        self.urgency.total_cmp(&other.urgency).then(other.index.cmp(&self.index))
    }
}

impl PartialOrd for Step {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Step {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Step {}

impl ViewObject {
    /// The least that is shown of it.
    fn coarsest(&self) -> ObjectDetail {
        if self.preview.is_some() { ObjectDetail::Preview } else { ObjectDetail::Whole }
    }

    /// Memory that a detail takes, on top of the one before.
    fn bytes(&self, detail: ObjectDetail) -> u64 {
        match detail {
            ObjectDetail::Absent => 0,
            ObjectDetail::Preview => self.preview.map_or(0, |preview| preview.bytes),
            ObjectDetail::Whole => self.whole_bytes,
        }
    }

    fn sphere(&self) -> Sphere {
        let [low, high] = self.bounds;
        Sphere { center: 0.5 * (low + high), radius: 0.5 * low.distance(high) }
    }

    /// About its distance from a point.
    pub fn distance(&self, p: Vec3) -> f32 {
        let [low, high] = self.bounds;
        p.distance(p.clamp(low, high)).max(self.surface.distance(p))
    }

    /// Lengths on the screen where it is nearest to the eye, in pixels: of the whole object, and of what its preview lacks.
    fn pixels(&self, view: &StreamView) -> [f32; 2] {
        let [low, high] = self.bounds;
        let distance = self.distance(view.eye).max(f32::MIN_POSITIVE);
        let length = low.distance(high);
        let detail = self.preview.map_or(length * ASSUMED_DETAIL, |preview| preview.detail);
        [length, detail].map(|length| length * view.focal_pixels / distance)
    }
}

#[cfg(test)]
mod tests {
    use glam::Mat3;
    use proptest::prelude::*;

    use super::*;

    /// From the origin along negative z, 90 degrees high, 200 pixels: a length of 1 at a distance of 1 has 100 pixels.
    fn view() -> StreamView {
        StreamView::new(Vec3::ZERO, Mat3::IDENTITY, std::f32::consts::FRAC_PI_2, [200, 200])
    }

    fn object(center: Vec3, detail: f32) -> ViewObject {
        let half = Vec3::splat(0.5);
        ViewObject {
            bounds: [center - half, center + half],
            surface: SurfaceSamples::default(),
            whole_bytes: 100,
            preview: Some(ViewPreview { bytes: 1, detail }),
            parts: Vec::new(),
        }
    }

    #[test]
    fn what_is_near_is_whole_and_what_is_far_is_a_preview() {
        let objects = [-2.0, -20.0, -500.0, 3.0].map(|z| object(Vec3::Z * z, 0.05));
        let choice = choose_objects(&objects, &view(), 1000, &[]);
        use ObjectDetail::{Absent, Preview, Whole};
        // The detail of the third has 0.01 pixels, and it is 0.35 pixels long; the fourth is behind the eye.
        assert_eq!(choice.details, [Whole, Preview, Absent, Preview]);
        assert_eq!(choice.order[0], (0, Preview));
        assert_eq!(choice.bytes, 103);
    }

    #[test]
    fn what_is_whole_stays_so_a_little_longer() {
        // 0.9 pixels.
        let objects = [object(Vec3::Z * -10.5, 0.09)];
        let detail = |shown| choose_objects(&objects, &view(), 1000, &[shown]).details[0];
        assert_eq!(detail(ObjectDetail::Preview), ObjectDetail::Preview);
        assert_eq!(detail(ObjectDetail::Whole), ObjectDetail::Whole);
    }

    #[test]
    fn of_equals_what_is_there_stays_until_another_is_clearly_nearer() {
        use ObjectDetail::{Preview, Whole};
        // Memory for the previews and one that is whole.
        let budget = 102;
        let at = |x: f32, shown: &[ObjectDetail]| {
            let objects = [-1.0, 1.0].map(|x| object(Vec3::new(x, 0.0, -2.0), 0.5));
            let view = StreamView { eye: Vec3::X * x, ..view() };
            let choice = choose_objects(&objects, &view, budget, shown);
            (choice.staying(&objects, budget, |_, detail| detail == Preview), choice.details)
        };
        let (_, left) = at(-0.01, &[]);
        assert_eq!(left, [Whole, Preview]);
        for x in [0.01, 0.1, -0.1, 0.3] {
            assert_eq!(at(x, &left), (vec![], left.clone()), "{x}");
        }
        // The second comes, and the first stays until it is there.
        let (staying, right) = at(2.0, &left);
        assert_eq!((&staying[..], &right[..]), (&[0][..], &[Preview, Whole][..]));
        assert_eq!(at(2.0, &[Whole, Whole]).1, right);
        assert_eq!(at(-0.1, &right).1, right);
    }

    #[test]
    fn what_is_displaced_leaves_for_what_is_there() {
        let objects = [-2.0, -3.0, -4.0, -5.0].map(|z| object(Vec3::Z * z, 0.5));
        let shown = [ObjectDetail::Preview, ObjectDetail::Preview, ObjectDetail::Whole, ObjectDetail::Whole];
        let choice = choose_objects(&objects, &view(), 204, &shown);
        assert_eq!((&choice.details[..2], &choice.displaced), (&[ObjectDetail::Whole; 2][..], &vec![2, 3]));
        let staying = |there: usize| {
            let is_there = |index: usize, detail| detail == ObjectDetail::Preview || index < there;
            choice.staying(&objects, 204, is_there)
        };
        assert_eq!([0, 1, 2].map(staying), [vec![2, 3], vec![2], vec![]]);
    }

    #[test]
    fn of_objects_around_the_eye_the_nearer_surface_comes_first() {
        let around = |distance: f32| {
            // A floor below the eye.
            let points: Vec<_> = (0..2500)
                .map(|i| Vec3::new((i % 50) as f32 - 25.0, -distance, (i / 50) as f32 - 25.0))
                .collect();
            let surface = SurfaceSamples::of(&points);
            let found = surface.distance(Vec3::ZERO);
            assert!((0.25 * distance..=distance).contains(&found), "{found} of {distance}");
            ViewObject { bounds: [Vec3::splat(-50.0), Vec3::splat(50.0)], surface, ..object(Vec3::ZERO, 0.5) }
        };
        let objects = [20.0, 4.0, 9.0].map(around);
        let choice = choose_objects(&objects, &view(), 103, &[]);
        use ObjectDetail::{Preview, Whole};
        assert_eq!(choice.details, [Preview, Whole, Preview]);
    }

    fn any_object() -> impl Strategy<Value = ViewObject> {
        let place = [-10.0f32..10.0, -10.0..10.0, -10.0..10.0];
        (place, [0.1f32..3.0, 0.1..3.0, 0.1..3.0], 1u64..100, prop::option::of((1u64..10, 0.001f32..0.1)))
            .prop_map(|(low, size, whole_bytes, preview)| ViewObject {
                bounds: [Vec3::from(low), Vec3::from(low) + Vec3::from(size)],
                surface: SurfaceSamples::default(),
                whole_bytes,
                preview: preview.map(|(bytes, detail)| ViewPreview { bytes, detail }),
                parts: Vec::new(),
            })
    }

    /// A coarse asset over some of the objects.
    fn over(objects: &[ViewObject], parts: Vec<usize>, bytes: u64, detail: f32) -> ViewObject {
        let boxes = parts.iter().map(|&part| objects[part].bounds);
        let bounds = boxes.reduce(|[low, high], [l, h]| [low.min(l), high.max(h)]).unwrap();
        ViewObject {
            bounds,
            surface: SurfaceSamples::default(),
            whole_bytes: 0,
            preview: Some(ViewPreview { bytes, detail }),
            parts,
        }
    }

    #[test]
    fn far_objects_are_one_coarse_asset_and_near_ones_its_parts() {
        use ObjectDetail::{Absent, Preview, Whole};
        let mut objects: Vec<_> = [0.0, 1.0, 2.0, 3.0].map(|x| object(Vec3::X * x, 0.05)).into();
        objects.push(over(&objects, vec![0, 1], 2, 0.2));
        objects.push(over(&objects, vec![2, 3], 2, 0.2));
        objects.push(over(&objects, vec![4, 5], 3, 0.8));
        let at = |z: f32, budget, shown: &[ObjectDetail]| {
            let eye = Vec3::new(1.5, 0.0, z);
            let view = StreamView::new(eye, Mat3::IDENTITY, std::f32::consts::FRAC_PI_2, [200, 200]);
            choose_objects(&objects, &view, budget, shown)
        };
        // The details of the three levels have a pixel at 80, 20 and 5 units.
        let far = at(90.0, 1000, &[]);
        assert_eq!(far.details, [Absent, Absent, Absent, Absent, Absent, Absent, Preview]);
        let middle = at(50.0, 1000, &[]);
        assert_eq!(middle.details, [Absent, Absent, Absent, Absent, Preview, Preview, Whole]);
        assert_eq!(middle.order, [(6, Preview), (4, Preview), (5, Preview)]);
        assert_eq!(middle.bytes, 7);
        let near = at(10.0, 1000, &[]);
        assert_eq!(near.details, [Preview, Preview, Preview, Preview, Whole, Whole, Whole]);
        assert_eq!(near.drawn(&objects).map(|(index, _)| index).collect::<Vec<_>>(), [0, 1, 2, 3]);
        // Memory for the parts of one of the two only.
        let little = at(10.0, 9, &[]);
        assert_eq!(little.details, [Preview, Preview, Absent, Absent, Whole, Preview, Whole]);
        assert_eq!(little.drawn(&objects).map(|(index, _)| index).collect::<Vec<_>>(), [0, 1, 5]);
        assert_eq!(at(10.0, 6, &[]).details, far.details);
        // At 0.9 pixels nothing changes.
        assert_eq!(at(90.0, 1000, &middle.details).details, middle.details);
        assert_eq!(at(130.0, 1000, &middle.details).details, far.details);
    }

    #[test]
    fn a_coarse_asset_is_drawn_until_all_of_its_parts_are_there() {
        let mut objects: Vec<_> = [0.0, 1.0, 2.0, 3.0].map(|x| object(Vec3::X * x, 0.05)).into();
        for parts in [vec![0, 1], vec![2, 3], vec![4, 5]] {
            objects.push(over(&objects, parts, 2, 0.2));
        }
        let roots = root_objects(&objects);
        assert_eq!(roots, [6]);
        let drawn = |absent: &[usize], divided: &[usize]| {
            drawn_objects(&objects, &roots, |index| ObjectState {
                is_there: !absent.contains(&index),
                is_divided: divided.contains(&index),
            })
        };
        assert_eq!(drawn(&[], &[]), [6]);
        assert_eq!(drawn(&[], &[6]), [4, 5]);
        assert_eq!(drawn(&[], &[4, 6]), [0, 1, 5]);
        assert_eq!(drawn(&[4, 5, 6], &[4, 5, 6]), [0, 1, 2, 3]);
        // A part is missing, then what stands for it, then what stands for that.
        assert_eq!(drawn(&[3], &[4, 5, 6]), [0, 1, 5]);
        assert_eq!(drawn(&[3, 5], &[4, 5, 6]), [6]);
        assert_eq!(drawn(&[3, 5, 6], &[4, 5, 6]), [0, 1, 2]);
        // Nothing has come yet; then it is parts that leave.
        assert!(drawn(&[0, 1, 2, 3, 4, 5, 6], &[]).is_empty());
        assert_eq!(drawn(&[6], &[]), [4, 5]);
    }

    /// Objects, and coarse assets over runs of what is part of nothing yet, each with a detail so many times as long.
    fn any_tree() -> impl Strategy<Value = Vec<ViewObject>> {
        let objects = prop::collection::vec(any_object(), 1..40);
        let runs = prop::collection::vec((1usize..6, 1u64..10, 1.0f32..8.0), 0..20);
        (objects, runs).prop_map(|(mut objects, runs)| {
            let mut free: std::collections::VecDeque<usize> = (0..objects.len()).collect();
            for (length, bytes, factor) in runs {
                let parts: Vec<usize> = free.drain(..length.min(free.len())).collect();
                let finest = |&part: &usize| objects[part].preview.map_or(0.001, |preview| preview.detail);
                let detail = factor * parts.iter().map(finest).fold(0.0, f32::max);
                let coarse = over(&objects, parts, bytes, detail);
                free.push_back(objects.len());
                objects.push(coarse);
            }
            objects
        })
    }

    fn any_view() -> impl Strategy<Value = StreamView> {
        ([-20.0f32..20.0, -20.0..20.0, -20.0..20.0], 0.0f32..6.0).prop_map(|(eye, turn)| {
            let axes = Mat3::from_rotation_y(turn);
            StreamView::new(Vec3::from(eye), axes, std::f32::consts::FRAC_PI_2, [200, 200])
        })
    }

    fn any_shown() -> impl Strategy<Value = Vec<ObjectDetail>> {
        use ObjectDetail::{Absent, Preview, Whole};
        prop::collection::vec(prop::sample::select(vec![Absent, Preview, Whole]), 60)
    }

    proptest! {
        #[test]
        fn the_budget_holds_and_more_memory_never_shows_less(
            objects in any_tree(),
            view in any_view(),
            budget in 0u64..2000,
        ) {
            let choice = choose_objects(&objects, &view, budget, &[]);
            prop_assert!(choice.bytes <= budget);
            let cost = |&(index, detail): &(usize, ObjectDetail)| match detail {
                ObjectDetail::Whole => objects[index].whole_bytes,
                _ => objects[index].preview.unwrap().bytes,
            };
            prop_assert_eq!(choice.order.iter().map(cost).sum::<u64>(), choice.bytes);
            let all = choose_objects(&objects, &view, u64::MAX, &[]);
            prop_assert!(choice.details.iter().zip(&all.details).all(|(some, all)| some <= all));
            // Whoever is content with what there is, is so with it again.
            for (choice, budget) in [(choice, budget), (all, u64::MAX)] {
                let again = choose_objects(&objects, &view, budget, &choice.details);
                prop_assert_eq!(again.details, choice.details);
            }
        }

        #[test]
        fn nothing_is_missing_and_nothing_is_there_twice(
            objects in any_tree(),
            view in any_view(),
            budget in 0u64..300,
            shown in any_shown(),
        ) {
            let mut above = vec![None; objects.len()];
            for (index, object) in objects.iter().enumerate() {
                object.parts.iter().for_each(|&part| above[part] = Some(index));
            }
            let choice = choose_objects(&objects, &view, budget, &shown);
            prop_assert_eq!(&choice, &choose_objects(&objects, &view, budget, &shown));
            let mut drawn = vec![0; objects.len()];
            choice.drawn(&objects).for_each(|(index, _)| drawn[index] += 1);
            let roots = || (0..objects.len()).filter(|&index| above[index].is_none());
            let is_there = |index: usize| choice.details[index] > ObjectDetail::Absent;
            for object in (0..objects.len()).filter(|&index| objects[index].parts.is_empty()) {
                // From the object up to what is part of nothing.
                let way: Vec<usize> = std::iter::successors(Some(object), |&index| above[index]).collect();
                let times: usize = way.iter().map(|&index| drawn[index]).sum();
                prop_assert_eq!(times, usize::from(is_there(way[way.len() - 1])));
            }
            // Where the coarsest fits, all that is large enough to be seen is there.
            let previews: u64 = roots().filter_map(|index| Some(objects[index].preview?.bytes)).sum();
            if previews <= budget {
                let is_due = |index: &usize| {
                    objects[*index].preview.is_some() && objects[*index].pixels(&view)[0] >= MIN_PIXELS
                };
                prop_assert!(roots().filter(is_due).all(is_there));
            }
        }
    }
}
