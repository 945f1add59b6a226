//! Which objects of a world are shown whole, which by their previews, within a budget of memory.
//!
//! Objects are boxes here, with the memory that they take. A preview suffices while its finest detail is less than a pixel long. First all
//! that is in the picture gets its preview, the largest on the screen first; then those whose previews are too coarse become whole, the
//! coarsest first, as long as there is memory. What leaves the picture stays while nobody else needs its memory.

use glam::Vec3;

use crate::StreamView;
use crate::demand::{Lens, Sphere};

/// An object, as the choice needs to know it.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewObject {
    /// Corners of its box, in the space of the view.
    pub bounds: [Vec3; 2],
    /// Where its surface is, once that is known: the eye is often in the boxes of several objects.
    pub surface: SurfaceSamples,
    /// Memory that it takes whole.
    pub whole_bytes: u64,
    /// Its preview, if it has one.
    pub preview: Option<ViewPreview>,
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

/// How much is shown of an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum ObjectDetail {
    /// Nothing.
    #[default]
    Absent,
    /// Its preview.
    Preview,
    /// All of it. Its preview is kept, for the way back.
    Whole,
}

/// What is to be shown of objects.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectChoice {
    /// Per object.
    pub details: Vec<ObjectDetail>,
    /// What is to be there, the most urgent first: an object and one of its details.
    pub order: Vec<(usize, ObjectDetail)>,
    /// Memory that it takes.
    pub bytes: u64,
}

/// Length in pixels of a preview's finest detail from which the object itself is wanted.
const COARSE_PIXELS: f32 = 1.0;

/// One that is whole stays so down to this length, so that nothing flickers.
const STAYING_PIXELS: f32 = 0.75;

/// Objects whose boxes are shorter on the screen are not shown, in pixels.
const LEAST_PIXELS: f32 = 0.5;

/// An object without a preview is as urgent as if it had one whose detail is such a part of its length.
const ASSUMED_DETAIL: f32 = 1.0 / 64.0;

/// A part of the preference that what is in the picture has over what is beside it.
const UNSEEN: f32 = 1.0 / 64.0;

/// Chooses what to show of objects within `budget_bytes`. `shown` is what is shown of each now.
pub fn choose_objects(
    objects: &[ViewObject],
    view: &StreamView,
    budget_bytes: u64,
    shown: &[ObjectDetail],
) -> ObjectChoice {
    let lens = Lens::new(view, 1.0);
    let (mut previews, mut wholes) = (Vec::new(), Vec::new());
    for (index, object) in objects.iter().enumerate() {
        let now = shown.get(index).copied().unwrap_or_default();
        let [size, detail] = object.pixels(view);
        if size < LEAST_PIXELS {
            continue;
        }
        let is_seen = lens.may_see(&object.sphere());
        let preference = if is_seen { 1.0 } else { UNSEEN };
        if let Some(preview) = object.preview {
            previews.push((size * preference, index, ObjectDetail::Preview, preview.bytes));
        }
        let enough = if now == ObjectDetail::Whole { STAYING_PIXELS } else { COARSE_PIXELS };
        // Without a preview there is nothing else. What is not seen is not fetched, but may stay.
        let is_wanted = object.preview.is_none() || detail > enough;
        if (is_seen || now == ObjectDetail::Whole) && is_wanted {
            wholes.push((detail * preference, index, ObjectDetail::Whole, object.whole_bytes));
        }
    }
    let mut choice =
        ObjectChoice { details: vec![ObjectDetail::Absent; objects.len()], ..ObjectChoice::default() };
    for mut steps in [previews, wholes] {
        steps.sort_by(|(a, i, ..), (b, j, ..)| b.total_cmp(a).then(i.cmp(j)));
        for (_, index, detail, bytes) in steps {
            if choice.bytes + bytes <= budget_bytes {
                choice.bytes += bytes;
                choice.details[index] = detail;
                choice.order.push((index, detail));
            }
        }
    }
    choice
}

impl ViewObject {
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
            })
    }

    proptest! {
        #[test]
        fn the_budget_holds_and_more_memory_never_shows_less(
            objects in prop::collection::vec(any_object(), 0..40),
            budget in 0u64..2000,
        ) {
            let choice = choose_objects(&objects, &view(), budget, &[]);
            prop_assert!(choice.bytes <= budget);
            let cost = |&(index, detail): &(usize, ObjectDetail)| match detail {
                ObjectDetail::Whole => objects[index].whole_bytes,
                _ => objects[index].preview.unwrap().bytes,
            };
            prop_assert_eq!(choice.order.iter().map(cost).sum::<u64>(), choice.bytes);
            let all = choose_objects(&objects, &view(), u64::MAX, &[]);
            prop_assert!(choice.details.iter().zip(&all.details).all(|(some, all)| some <= all));
            // Whoever is content with what there is, is so with it again.
            let again = choose_objects(&objects, &view(), u64::MAX, &all.details);
            prop_assert_eq!(again.details, all.details);
        }
    }
}
