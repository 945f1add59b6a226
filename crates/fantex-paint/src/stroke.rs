//! Strokes: from input samples to dabs, spaced evenly along the surface.
//!
//! ```text
//!  samples --symmetry--> copies --smoothing--> samples --walk--> way on the surface --spacing, jitter--> dabs
//! ```

use std::path::PathBuf;
use std::sync::Arc;

use fantex_base::Random;
use glam::{DVec3, Vec3};

use crate::dab::tangent_axes;
use crate::symmetry::CopiedRun;
use crate::{Dab, Stamp, Surface, SurfacePoint, Symmetry, Tip};

/// The least distance of dabs in texels: closer ones change nothing but the time they take.
const MIN_SPACING_TEXELS: f32 = 0.5;

/// Dabs of one stroke, at most.
const MAX_DABS: usize = 1 << 20;

/// An input: where the pen went, with which brush.
#[derive(Clone, Debug)]
pub struct Stroke {
    /// With what.
    pub brush: Brush,
    /// The picture of a dab; round without one.
    pub stamp: Option<Arc<Stamp>>,
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

/// The dabs of a stroke, copy after copy; the same for the same stroke.
pub fn dabs_of(surface: &Surface, stroke: &Stroke) -> Vec<Dab> {
    let samples = match (stroke.line, stroke.samples.as_slice()) {
        (true, [first, .., last]) => vec![*first, *last],
        (_, samples) => samples.to_vec(),
    };
    let Stroke { brush, stamp, symmetry, .. } = stroke;
    let diameter = mesh_length(surface, brush.size);
    let stamp = stamp.as_ref();
    let mut dabs = Vec::new();
    for CopiedRun { copy, samples } in symmetry.copies(surface, &samples, 0.5 * diameter) {
        let way = Way::new(brush);
        let mut spacer = Spacer { surface, brush, stamp, diameter, symmetry, copy, way };
        for (k, sample) in samples.iter().enumerate() {
            spacer.go_to(sample, k + 1 == samples.len(), &mut dabs);
        }
    }
    dabs
}

struct Spacer<'a> {
    surface: &'a Surface,
    brush: &'a Brush,
    stamp: Option<&'a Arc<Stamp>>,
    /// Mesh units.
    diameter: f32,
    symmetry: &'a Symmetry,
    /// Number of the copy.
    copy: u32,
    way: Way,
}

/// How far a copy of a stroke is.
#[derive(Clone, Debug)]
struct Way {
    /// Where the brush is; none before the first sample.
    last: Option<Sample>,
    /// What it has left to the last sample: a smoothed brush lags behind.
    lag: Option<Lag>,
    /// Mesh units to go until the next dab.
    due: f64,
    random: Random,
}

/// The rest of a path between two samples.
#[derive(Clone, Debug)]
struct Lag {
    path: Path,
    /// Mesh units of the path that the brush has gone.
    gone: f64,
    from: Sample,
    to: Sample,
}

impl Way {
    fn new(brush: &Brush) -> Self {
        Self { last: None, lag: None, due: 0.0, random: Random::new(brush.seed) }
    }
}

impl Spacer<'_> {
    /// Goes on to the next sample; all the way where it is the last one.
    fn go_to(&mut self, sample: &Sample, is_end: bool, dabs: &mut Vec<Dab>) {
        if is_end && self.way.lag.as_ref().is_some_and(|lag| lag.to == *sample) {
            // A pen may be lifted where it was seen last.
            return self.catch_up(dabs);
        }
        self.way.lag = None;
        let path = self.way.last.map(|last| (last, self.path_between(last.point, sample.point)));
        let Some((last, Some(path))) = path else {
            // The first one; or the surface does not lead there, and the stroke goes on beyond the gap.
            self.way.last = Some(*sample);
            self.dab(sample, dabs);
            self.way.due = self.spacing(sample);
            return;
        };
        let smoothing = f64::from(self.brush.smoothing.clamp(0.0, 0.98));
        let share = if is_end { 1.0 } else { 1.0 - smoothing };
        let gone = share * path.length();
        let end = Sample { point: path.at(gone), ..mixed(&last, sample, share as f32) };
        self.along(&path, [0.0, gone], [&last, &end], dabs);
        self.way.last = Some(end);
        self.way.lag = (share < 1.0).then_some(Lag { path, gone, from: last, to: *sample });
    }

    /// Goes all the way to the last sample.
    fn catch_up(&mut self, dabs: &mut Vec<Dab>) {
        let (Some(Lag { path, gone, from, to }), Some(last)) = (self.way.lag.take(), self.way.last) else {
            return;
        };
        let end = Sample { point: path.at(path.length()), ..mixed(&from, &to, 1.0) };
        self.along(&path, [gone, path.length()], [&last, &end], dabs);
        self.way.last = Some(end);
    }

    fn path_between(&self, from: SurfacePoint, to: SurfacePoint) -> Option<Path> {
        let across = || path_across(self.surface, from, to, 0.25 * self.diameter);
        path_between(self.surface, from, to).or_else(|| across().filter(|_| self.brush.across_gaps))
    }

    /// Dabs on a part of a path, mesh units from its start, between samples at the part's ends.
    fn along(&mut self, path: &Path, part: [f64; 2], [from, to]: [&Sample; 2], dabs: &mut Vec<Dab>) {
        let [start, length] = [part[0], part[1] - part[0]];
        let mut at = 0.0;
        while at + self.way.due <= length && dabs.len() < MAX_DABS {
            at += self.way.due;
            let sample = mixed(from, to, (at / length) as f32);
            let sample = Sample { point: path.at(start + at), ..sample };
            self.dab(&sample, dabs);
            self.way.due = self.spacing(&sample);
        }
        self.way.due -= length - at;
    }

    fn spacing(&self, sample: &Sample) -> f64 {
        let least = MIN_SPACING_TEXELS / self.surface.cover().density;
        f64::from((self.brush.spacing * self.diameter * self.size_factor(sample)).max(least))
    }

    fn size_factor(&self, sample: &Sample) -> f32 {
        1.0 - self.brush.pressure.size.clamp(0.0, 1.0) * (1.0 - sample.pressure.clamp(0.0, 1.0))
    }

    fn dab(&mut self, sample: &Sample, dabs: &mut Vec<Dab>) {
        let (brush, jitter) = (self.brush, self.brush.jitter);
        // Always the same number of draws, so that one property's jitter does not depend on another's.
        let [turn, out, size, flow, angle] =
            [(); 5].map(|()| (self.way.random.next_u64() >> 40) as f32 / (1u64 << 24) as f32);
        let radius = 0.5 * self.diameter * self.size_factor(sample);
        let mut center = sample.point;
        if jitter.position > 0.0 {
            let distance = f64::from(jitter.position * radius * out);
            center = walk_straight(self.surface, center, self.tangent(sample, turn), distance);
        }
        let pressure = 1.0 - brush.pressure.flow.clamp(0.0, 1.0) * (1.0 - sample.pressure.clamp(0.0, 1.0));
        let [lean, aspect] = if brush.follow_tilt { tilted(sample.tilt) } else { [0.0, 1.0] };
        let turned = brush.angle.to_radians() + lean + jitter.angle * (2.0 * angle - 1.0);
        dabs.push(Dab {
            center,
            radius: radius * (1.0 - jitter.size.clamp(0.0, 1.0) * size),
            hardness: brush.hardness,
            flow: brush.flow.clamp(0.0, 1.0) * pressure * (1.0 - jitter.flow.clamp(0.0, 1.0) * flow),
            angle: self.angle_of_copy(center, turned),
            mirrored: self.symmetry.is_mirrored(self.copy),
            aspect,
            across_gaps: brush.across_gaps,
            stamp: self.stamp.cloned(),
            copy: self.copy,
        });
    }

    /// A direction in the tangent plane; `turn` 0..1 is once around.
    fn tangent(&self, sample: &Sample, turn: f32) -> DVec3 {
        let normal = self.surface.facet_normal(sample.point.triangle);
        self.symmetry.moved_tangent(normal, self.copy, |normal| {
            let x = normal.any_orthonormal_vector();
            let (sin, cos) = (std::f64::consts::TAU * f64::from(turn)).sin_cos();
            x * cos + normal.cross(x) * sin
        })
    }

    /// The angle of a dab at a place of the copy; `angle` is that of the stroke itself.
    fn angle_of_copy(&self, center: SurfacePoint, angle: f32) -> f32 {
        if self.copy == 0 {
            return angle;
        }
        let normal = self.surface.outer_normal(center.triangle);
        let right = self.symmetry.moved_tangent(normal, self.copy, |normal| {
            let (x, y) = tangent_axes(normal);
            let (sin, cos) = f64::from(angle).sin_cos();
            x * cos + y * sin
        });
        self.symmetry.moved_angle(right, normal, self.copy)
    }
}

/// Width over length of the dab of a pen that lies almost flat.
const MIN_TILT_ASPECT: f32 = 0.2;

/// Where a pen's lean points, radians, and the aspect of the spot that it leaves: a round tip that leans touches as an ellipse.
fn tilted([x, y]: [f32; 2]) -> [f32; 2] {
    let lean = x.hypot(y).min(std::f32::consts::FRAC_PI_2);
    [y.atan2(x), lean.cos().max(MIN_TILT_ASPECT)]
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

// The brush: how an input becomes dabs.

/// A length on the surface.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Size {
    /// Nominal texels of level 0 (the cover's density).
    Texels(f32),
    /// World units.
    World(f32),
}

/// How far pressure goes into a property: 0 not at all, 1 proportionally.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PressureResponse {
    /// Of the radius.
    pub size: f32,
    /// Of the flow.
    pub flow: f32,
}

/// Random changes from dab to dab, drawn from the stroke's seed.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Jitter {
    /// Largest distance from the path, in radii, along the surface.
    pub position: f32,
    /// Largest share that the radius shrinks by, 0..1.
    pub size: f32,
    /// Largest share that the flow shrinks by, 0..1.
    pub flow: f32,
    /// Largest turn of the stamp, radians.
    pub angle: f32,
}

/// A brush, in stroke files, too: what is left out there is as in the default.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Brush {
    /// Diameter: `{"texels": 64}` or `{"world": 0.1}`.
    pub size: Size,
    /// Share of the radius within which a dab is full, 0..1.
    pub hardness: f32,
    /// Most that a stroke covers, 0..1, however often it passes.
    pub opacity: f32,
    /// What each dab adds of what is missing to the opacity, 0..1.
    pub flow: f32,
    /// Distance of dabs in diameters.
    pub spacing: f32,
    /// 0: dabs follow the samples. Towards 1: they lag behind and cut corners.
    pub smoothing: f32,
    /// Angle of the stamp, degrees, counter-clockwise; 0 is upright.
    pub angle: f32,
    /// Dabs follow a tilted pen: added to the angle is the direction that it leans to, and they become ellipses along it.
    pub follow_tilt: bool,
    /// Dabs go on beyond gaps of the mesh that are small beside them, as at T-junctions.
    pub across_gaps: bool,
    /// Random changes.
    pub jitter: Jitter,
    /// What pressure does.
    pub pressure: PressureResponse,
    /// The picture file of a dab, in a stroke file relative to that; round without one. (It is [`Stroke::stamp`] that counts.)
    pub stamp: Option<PathBuf>,
    /// A shape of a dab that comes with the program; `stamp` goes before it. (It is [`Stroke::stamp`] that counts.)
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tip: Option<Tip>,
    /// Of the jitter.
    pub seed: u64,
}

impl Default for Brush {
    /// Round, soft, 64 texels wide.
    fn default() -> Self {
        Self {
            size: Size::Texels(64.0),
            hardness: 0.5,
            opacity: 1.0,
            flow: 1.0,
            spacing: 0.1,
            smoothing: 0.0,
            angle: 0.0,
            follow_tilt: false,
            across_gaps: false,
            jitter: Jitter::default(),
            pressure: PressureResponse::default(),
            stamp: None,
            tip: None,
            seed: 0,
        }
    }
}

/// Where the pen was at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// On the surface.
    pub point: SurfacePoint,
    /// 0..1.
    pub pressure: f32,
    /// Lean of the pen along the stamp's x and y axis, radians; zero upright.
    pub tilt: [f32; 2],
    /// Seconds since the stroke's start.
    pub time: f32,
}

impl Sample {
    /// Full pressure, upright.
    pub fn at(point: SurfacePoint) -> Self {
        Self { point, pressure: 1.0, tilt: [0.0; 2], time: 0.0 }
    }
}

// Walking on the surface: along the cut of a plane, from triangle to triangle.

/// A way on the surface: points with their distance from its start, mesh units, ascending.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Path {
    pub(crate) points: Vec<(SurfacePoint, f64)>,
}

impl Path {
    pub(crate) fn length(&self) -> f64 {
        self.points.last().map_or(0.0, |(_, along)| *along)
    }

    /// The point at a distance from the start (clamped to the path).
    pub(crate) fn at(&self, distance: f64) -> SurfacePoint {
        let after = self.points.partition_point(|(_, along)| *along < distance);
        let (Some(&(b, to)), Some(&(a, from))) =
            (self.points.get(after), self.points.get(after.wrapping_sub(1)))
        else {
            return self.points[after.min(self.points.len() - 1)].0;
        };
        // Both lie on the triangle of the later one, unless it is an end where the way jumped.
        if a.triangle != b.triangle || to <= from {
            return b;
        }
        let t = ((distance - from) / (to - from)) as f32;
        SurfacePoint { triangle: b.triangle, lambda: a.lambda + (b.lambda - a.lambda) * t }
    }
}

#[derive(Clone, Copy, Debug)]
enum Goal<'p> {
    /// On each triangle that has it, reached on no longer way.
    Point {
        places: &'p [SurfacePoint],
        longest: f64,
    },
    Length(f64),
}

const MAX_STEPS: usize = 1 << 16;

/// A way around may be this much longer than the straight line before it is given up.
const MAX_DETOUR: f64 = 4.0;

/// The way from one point to another along the cut of the plane through both that stands upright on the surface between
/// them: a straight line on a plane, nearly the shortest way elsewhere. None where the cut does not lead there.
///
/// From a vertex or an edge a cut may set out on several triangles, and only some of them lie towards the goal: the shortest
/// way counts.
fn path_between(surface: &Surface, start: SurfacePoint, to: SurfacePoint) -> Option<Path> {
    let (p, q) = (surface.position(start), surface.position(to));
    let (starts, goals) = (places_of(surface, start), places_of(surface, to));
    let shared = |from: &SurfacePoint| Some((*from, *goals.iter().find(|to| to.triangle == from.triangle)?));
    if let Some((from, to)) = starts.iter().find_map(shared) {
        return Some(Path { points: vec![(from, 0.0), (to, p.distance(q))] });
    }
    let straight = p.distance(q);
    let mean = |places: &[SurfacePoint]| -> DVec3 {
        places.iter().map(|place| surface.facet_normal(place.triangle)).sum::<DVec3>().normalize_or_zero()
    };
    let of_the_points = surface.facet_normal(start.triangle) + surface.facet_normal(to.triangle);
    let mut shortest: Option<Path> = None;
    for up in [of_the_points, mean(&starts) + mean(&goals)] {
        let Some(plane) = (q - p).cross(up).try_normalize() else { continue };
        // Along edges, which lie in the plane, triangles on either side lead there.
        for aside in [0.0, SIDEWAYS * straight, -SIDEWAYS * straight] {
            for from in &starts {
                let longest = shortest.as_ref().map_or(MAX_DETOUR * straight, Path::length);
                if longest <= straight * (1.0 + NEARLY_STRAIGHT) {
                    return shortest;
                }
                let goal = Goal::Point { places: &goals, longest };
                let path = walk(surface, *from, q - p, plane, aside, goal);
                shortest = path.filter(|path| path.length() < longest).or(shortest);
            }
        }
    }
    shortest
}

/// How far beside an edge along which a stroke goes its cut lies, in lengths of the stroke.
const SIDEWAYS: f64 = 1e-5;

/// A way that is longer than the straight line by no more than this share need not be shortened.
const NEARLY_STRAIGHT: f64 = 1e-3;

/// Triangles around a vertex that are looked at.
const MAX_AROUND: usize = 64;

/// The point as a point of each triangle that it lies on, the given one first: several at edges and vertices.
fn places_of(surface: &Surface, point: SurfacePoint) -> Vec<SurfacePoint> {
    let mut places = vec![point];
    let mut next = 0;
    while let Some(&place) = places.get(next).filter(|_| places.len() < MAX_AROUND) {
        next += 1;
        for k in 0..3_u32 {
            // The edge from corner k on lies opposite of corner k + 2.
            let is_on_edge = place.lambda[(k as usize + 2) % 3].abs() < ON_EDGE;
            let edge = 3 * place.triangle + k;
            if let Some(other) = surface.opposite(edge).filter(|_| is_on_edge)
                && places.iter().all(|known| known.triangle != other / 3)
            {
                places.push(on_other_side(surface, place, edge, other));
            }
        }
    }
    places
}

/// Weight of a corner below which a point lies on the opposite edge.
const ON_EDGE: f32 = 1e-5;

/// Points of a way through space.
const MAX_HOPS: usize = 64;

/// The surface under the straight line between two points, where it is never farther away than `reach` mesh units.
fn path_across(surface: &Surface, from: SurfacePoint, to: SurfacePoint, reach: f32) -> Option<Path> {
    let (p, q) = (surface.position(from), surface.position(to));
    let hop = |k: usize| {
        let share = k as f64 / MAX_HOPS as f64;
        let point = surface.nearest(p.lerp(q, share).as_vec3(), reach)?;
        Some((point, share * p.distance(q)))
    };
    let mut points = (0..=MAX_HOPS).map(hop).collect::<Option<Vec<_>>>()?;
    (points[0].0, points[MAX_HOPS].0) = (from, to);
    Some(Path { points })
}

/// The longest straight walk, mesh units: around a model several times.
const MAX_WALK: f64 = 16.0;

/// The point so many mesh units away in a direction (mesh space, projected onto the surface), [`MAX_WALK`] at most. Ends at a
/// boundary.
pub(crate) fn walk_straight(
    surface: &Surface,
    from: SurfacePoint,
    direction: DVec3,
    length: f64,
) -> SurfacePoint {
    let length = length.min(MAX_WALK);
    let plane = direction.cross(surface.facet_normal(from.triangle)).try_normalize();
    let path = plane.and_then(|plane| walk(surface, from, direction, plane, 0.0, Goal::Length(length)));
    path.map_or(from, |path| path.at(length))
}

/// Follows the cut of a plane, given by its normal, that lies so far `aside` of `from`.
fn walk(
    surface: &Surface,
    from: SurfacePoint,
    direction: DVec3,
    plane: DVec3,
    aside: f64,
    goal: Goal<'_>,
) -> Option<Path> {
    let start = surface.position(from);
    let cut = Cut { origin: start + aside * plane, plane, direction };
    let longest = match goal {
        Goal::Point { longest, .. } => longest,
        Goal::Length(length) => length,
    };
    let mut path = Path { points: vec![(from, 0.0)] };
    let (mut triangle, mut entered, mut at, mut along) = (from.triangle, None, start, 0.0);
    for _ in 0..MAX_STEPS {
        if let Goal::Point { places, .. } = goal
            && let Some(&reached) = places.iter().find(|place| place.triangle == triangle)
        {
            path.points.push((reached, along + at.distance(surface.position(reached))));
            return Some(path);
        }
        let Some((edge, lambda)) = cut.exit_edge(surface, triangle, entered, at) else { break };
        let point = SurfacePoint { triangle, lambda };
        let next = surface.position(point);
        along += next.distance(at);
        path.points.push((point, along));
        if along >= longest {
            break;
        }
        let Some(other) = surface.opposite(edge) else { break };
        at = next;
        triangle = other / 3;
        entered = Some(other);
        path.points.push((on_other_side(surface, point, edge, other), along));
    }
    matches!(goal, Goal::Length(_)).then_some(path)
}

/// The cut of a plane through the surface, followed in a direction.
struct Cut {
    origin: DVec3,
    /// The plane's normal.
    plane: DVec3,
    direction: DVec3,
}

impl Cut {
    /// The edge through which it leaves a triangle, as a half-edge, and where. It is `at` a point of the triangle, and has come through the edge
    /// `entered`.
    fn exit_edge(
        &self,
        surface: &Surface,
        triangle: u32,
        entered: Option<u32>,
        at: DVec3,
    ) -> Option<(u32, Vec3)> {
        let corners = surface.corners(triangle);
        // A corner in the plane counts as above it, so that every cut crosses two edges or none.
        let heights = corners.map(|corner| (corner - self.origin).dot(self.plane));
        let mut best: Option<(f64, u32, Vec3)> = None;
        for k in 0..3 {
            let (i, j) = (k, (k + 1) % 3);
            let edge = 3 * triangle + k as u32;
            if (heights[i] >= 0.0) == (heights[j] >= 0.0) || Some(edge) == entered {
                continue;
            }
            let t = heights[i] / (heights[i] - heights[j]);
            let mut lambda = [0.0f32; 3];
            (lambda[i], lambda[j]) = ((1.0 - t) as f32, t as f32);
            let crossing = corners[i].lerp(corners[j], t);
            // At the start two edges are crossed: the one ahead is meant.
            let ahead = (crossing - at).dot(self.direction);
            if best.is_none_or(|(other, ..)| ahead > other) {
                best = Some((ahead, edge, lambda.into()));
            }
        }
        best.map(|(_, edge, lambda)| (edge, lambda))
    }
}

/// A point of an edge as a point of the triangle beyond it.
fn on_other_side(surface: &Surface, point: SurfacePoint, edge: u32, other: u32) -> SurfacePoint {
    let triangles = &surface.mesh().triangles;
    let vertices = triangles[point.triangle as usize];
    let beyond = triangles[(other / 3) as usize];
    let mut lambda = [0.0f32; 3];
    for slot in [edge % 3, (edge + 1) % 3].map(|slot| slot as usize) {
        if let Some(k) = beyond.iter().position(|&v| v == vertices[slot]) {
            lambda[k] = point.lambda[slot];
        }
    }
    SurfacePoint { triangle: other / 3, lambda: lambda.into() }
}

// Strokes whose samples come one after the other, from a hand.

/// A stroke that is being drawn. Its dabs are those of [`dabs_of`](dabs_of), though copies take turns; what comes after a
/// [`lift`](Self::lift) is a stroke of its own.
#[derive(Clone, Debug)]
pub struct LiveStroke {
    brush: Brush,
    stamp: Option<Arc<Stamp>>,
    symmetry: Symmetry,
    /// Mesh units.
    diameter: f32,
    /// Per copy.
    ways: Vec<Way>,
}

impl LiveStroke {
    /// Begins a stroke; dabs come with its samples.
    pub fn new(surface: &Surface, brush: Brush, stamp: Option<Arc<Stamp>>, symmetry: Symmetry) -> Self {
        let ways = vec![Way::new(&brush); symmetry.count() as usize];
        Self { diameter: mesh_length(surface, brush.size), ways, brush, stamp, symmetry }
    }

    /// The pen leaves the surface: the next sample begins anew. Returns the dabs up to the last sample, which a smoothed stroke has still
    /// to catch up with.
    pub fn lift(&mut self, surface: &Surface) -> Vec<Dab> {
        let mut dabs = Vec::new();
        (0..self.symmetry.count()).for_each(|copy| self.lift_copy(surface, copy, &mut dabs));
        dabs
    }

    /// The dabs up to a sample. With the last one (`is_end`) a smoothed stroke catches up.
    pub fn go_to(&mut self, surface: &Surface, sample: &Sample, is_end: bool) -> Vec<Dab> {
        let mut dabs = Vec::new();
        let reach = 0.5 * self.diameter;
        for copy in 0..self.symmetry.count() {
            let sample =
                if copy == 0 { Some(*sample) } else { self.symmetry.moved(surface, sample, copy, reach) };
            match sample {
                Some(sample) => {
                    self.with_copy(surface, copy, |spacer| spacer.go_to(&sample, is_end, &mut dabs));
                }
                // No surface there: what comes after is a stroke of its own.
                None => self.lift_copy(surface, copy, &mut dabs),
            }
        }
        dabs
    }

    fn lift_copy(&mut self, surface: &Surface, copy: u32, dabs: &mut Vec<Dab>) {
        self.with_copy(surface, copy, |spacer| spacer.catch_up(dabs));
        self.ways[copy as usize] = Way::new(&self.brush);
    }

    fn with_copy(&mut self, surface: &Surface, copy: u32, act: impl FnOnce(&mut Spacer<'_>)) {
        let Self { brush, stamp, symmetry, diameter, ways } = self;
        let way = &mut ways[copy as usize];
        let taken = std::mem::replace(way, Way::new(brush));
        let (stamp, diameter) = (stamp.as_ref(), *diameter);
        let mut spacer = Spacer { surface, brush, stamp, diameter, symmetry, copy, way: taken };
        act(&mut spacer);
        *way = spacer.way;
    }
}
