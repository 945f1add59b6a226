//! Strokes: from input samples to dabs, spaced evenly along the surface.
//!
//! ```text
//!  samples --symmetry--> copies --smoothing--> samples --walk--> way on the surface --spacing, jitter--> dabs
//! ```

mod brush;
mod live;
mod symmetry;
mod walk;

pub use brush::{Brush, Jitter, PressureResponse, Sample, Size};
pub use live::LiveStroke;
pub use symmetry::Symmetry;

use glam::DVec3;
pub(crate) use walk::walk_straight;
use walk::{Path, path_between};

use crate::{Dab, Surface};

/// The least distance of dabs in texels: closer ones change nothing but the time they take.
const LEAST_SPACING_TEXELS: f32 = 0.5;

/// Dabs of one stroke, at most.
const MAX_DABS: usize = 1 << 20;

/// An input: where the pen went, with which brush.
#[derive(Clone, Debug)]
pub struct Stroke {
    /// With what.
    pub brush: Brush,
    /// Where.
    pub samples: Vec<Sample>,
    /// Only the first and the last sample count: a straight line.
    pub line: bool,
    /// Copies.
    pub symmetry: Symmetry,
}

/// Mesh units of a length.
pub(crate) fn mesh_length(surface: &Surface, size: Size) -> f32 {
    match size {
        Size::Texels(texels) => texels / surface.cover().density,
        Size::World(world) => (f64::from(world) / surface.mesh().world_from_mesh.scale) as f32,
    }
}

/// The dabs of a stroke, in order; the same for the same stroke.
pub fn dabs_of(surface: &Surface, stroke: &Stroke) -> Vec<Dab> {
    let samples = match (stroke.line, stroke.samples.as_slice()) {
        (true, [first, .., last]) => vec![*first, *last],
        (_, samples) => samples.to_vec(),
    };
    let diameter = mesh_length(surface, stroke.brush.size);
    let mut dabs = Vec::new();
    for samples in stroke.symmetry.copies(surface, &samples, 0.5 * diameter) {
        Spacer::new(surface, &stroke.brush, diameter).run(&samples, &mut dabs);
    }
    dabs
}

/// Places dabs along one copy of a stroke.
struct Spacer<'a> {
    surface: &'a Surface,
    brush: &'a Brush,
    diameter: f32,
    way: Way,
}

/// How far a copy of a stroke is.
#[derive(Clone, Debug)]
struct Way {
    /// Where the brush is; none before the first sample.
    last: Option<Sample>,
    /// Mesh units to go until the next dab.
    due: f64,
    random: Random,
}

impl Way {
    fn new(brush: &Brush) -> Self {
        Self { last: None, due: 0.0, random: Random(brush.seed) }
    }
}

impl<'a> Spacer<'a> {
    fn new(surface: &'a Surface, brush: &'a Brush, diameter: f32) -> Self {
        Self { surface, brush, diameter, way: Way::new(brush) }
    }

    fn run(&mut self, samples: &[Sample], dabs: &mut Vec<Dab>) {
        for (k, sample) in samples.iter().enumerate() {
            self.go_to(sample, k + 1 == samples.len(), dabs);
        }
    }

    /// Goes on to the next sample; all the way where it is the last one.
    fn go_to(&mut self, sample: &Sample, is_end: bool, dabs: &mut Vec<Dab>) {
        let path = self.way.last.map(|last| (last, path_between(self.surface, last.point, sample.point)));
        let Some((last, Some(path))) = path else {
            // The first one; or the surface does not lead there, and the stroke goes on beyond the gap.
            self.way.last = Some(*sample);
            self.dab(sample, dabs);
            self.way.due = self.spacing(sample);
            return;
        };
        let smoothing = f64::from(self.brush.smoothing.clamp(0.0, 0.98));
        let share = if is_end { 1.0 } else { 1.0 - smoothing };
        let end = Sample { point: path.at(share * path.length()), ..mixed(&last, sample, share as f32) };
        self.along(&path, share * path.length(), &last, &end, dabs);
        self.way.last = Some(end);
    }

    /// Dabs on the first `length` mesh units of a path.
    fn along(&mut self, path: &Path, length: f64, from: &Sample, to: &Sample, dabs: &mut Vec<Dab>) {
        let mut at = 0.0;
        while at + self.way.due <= length && dabs.len() < MAX_DABS {
            at += self.way.due;
            let sample = mixed(from, to, (at / length) as f32);
            let sample = Sample { point: path.at(at), ..sample };
            self.dab(&sample, dabs);
            self.way.due = self.spacing(&sample);
        }
        self.way.due -= length - at;
    }

    fn spacing(&self, sample: &Sample) -> f64 {
        let least = LEAST_SPACING_TEXELS / self.surface.cover().density;
        f64::from((self.brush.spacing * self.diameter * self.size_factor(sample)).max(least))
    }

    fn size_factor(&self, sample: &Sample) -> f32 {
        1.0 - self.brush.pressure.size.clamp(0.0, 1.0) * (1.0 - sample.pressure.clamp(0.0, 1.0))
    }

    fn dab(&mut self, sample: &Sample, dabs: &mut Vec<Dab>) {
        let (brush, jitter) = (self.brush, self.brush.jitter);
        // Always the same number of draws, so that one property's jitter does not depend on another's.
        let [turn, out, size, flow, angle] = [(); 5].map(|()| self.way.random.next());
        let radius = 0.5 * self.diameter * self.size_factor(sample);
        let mut center = sample.point;
        if jitter.position > 0.0 {
            let distance = f64::from(jitter.position * radius * out);
            center = walk_straight(self.surface, center, self.tangent(sample, turn), distance);
        }
        let pressure = 1.0 - brush.pressure.flow.clamp(0.0, 1.0) * (1.0 - sample.pressure.clamp(0.0, 1.0));
        let [lean, aspect] = if brush.follow_tilt { tilted(sample.tilt) } else { [0.0, 1.0] };
        dabs.push(Dab {
            center,
            radius: radius * (1.0 - jitter.size.clamp(0.0, 1.0) * size),
            hardness: brush.hardness,
            flow: brush.flow.clamp(0.0, 1.0) * pressure * (1.0 - jitter.flow.clamp(0.0, 1.0) * flow),
            angle: brush.angle + lean + jitter.angle * (2.0 * angle - 1.0),
            aspect,
            stamp: brush.stamp.clone(),
        });
    }

    /// A direction in the tangent plane; `turn` 0..1 is once around.
    fn tangent(&self, sample: &Sample, turn: f32) -> DVec3 {
        let normal = self.surface.facet_normal(sample.point.triangle);
        let x = normal.any_orthonormal_vector();
        let (sin, cos) = (std::f64::consts::TAU * f64::from(turn)).sin_cos();
        x * cos + normal.cross(x) * sin
    }
}

/// Width over length of the dab of a pen that lies almost flat.
const FLATTEST: f32 = 0.2;

/// Where a pen's lean points, radians, and the aspect of the spot that it leaves: a round tip that leans touches as an ellipse.
fn tilted([x, y]: [f32; 2]) -> [f32; 2] {
    let lean = x.hypot(y).min(std::f32::consts::FRAC_PI_2);
    [y.atan2(x), lean.cos().max(FLATTEST)]
}

fn mixed(a: &Sample, b: &Sample, t: f32) -> Sample {
    let mix = |x: f32, y: f32| x + (y - x) * t;
    Sample {
        point: a.point,
        pressure: mix(a.pressure, b.pressure),
        tilt: [mix(a.tilt[0], b.tilt[0]), mix(a.tilt[1], b.tilt[1])],
        time: mix(a.time, b.time),
    }
}

/// A small generator (G. Steele, D. Lea and C. Flood, "Fast splittable pseudorandom number generators", 2014).
#[derive(Clone, Debug)]
struct Random(u64);

impl Random {
    /// Uniform in 0..1.
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }
}
