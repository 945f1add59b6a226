//! Symmetry as the user sets it, and its plane in the scene.

use std::collections::BTreeMap;
use std::time::Instant;

use fantex::base::Aabb;
use fantex::glam::{DVec2, DVec3};
use fantex::paint::{Surface, Symmetry};
use serde::{Deserialize, Serialize};

use crate::paint::Viewpoint;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SymmetryKind {
    #[default]
    Off,
    Mirror,
    Radial,
}

impl SymmetryKind {
    pub const ALL: [(Self, &'static str); 3] =
        [(Self::Off, "Off"), (Self::Mirror, "Mirror"), (Self::Radial, "Radial")];
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SymmetrySettings {
    pub kind: SymmetryKind,
    /// The axis: 0 x, 1 y, 2 z.
    pub axis: usize,
    /// World units along the axis from the model's centre to the mirror's plane. Radial symmetry turns around the axis through the centre.
    pub offset: f64,
    /// Copies around an axis, the stroke itself included: one of [`Symmetry::COPIES`].
    pub count: u32,
    pub shows_plane: bool,
}

impl Default for SymmetrySettings {
    fn default() -> Self {
        Self { kind: SymmetryKind::Off, axis: 0, offset: 0.0, count: 6, shows_plane: true }
    }
}

impl SymmetrySettings {
    /// As the engine knows it. `center` is the model's, world space.
    pub fn symmetry(&self, center: DVec3) -> Symmetry {
        let axis = self.axis.min(2);
        match self.kind {
            SymmetryKind::Off => Symmetry::None,
            SymmetryKind::Mirror => Symmetry::Mirror { axis, offset: center[axis] + self.offset },
            SymmetryKind::Radial => {
                let (fewest, most) = Symmetry::COPIES.into_inner();
                Symmetry::Radial { axis, center: center.to_array(), count: self.count.clamp(fewest, most) }
            }
        }
    }
}

/// The corners of a plane orthogonal to an axis, around the model's box, in order; world space.
pub fn plane_outline(bounds: &Aabb<DVec3>, axis: usize, offset: f64) -> [DVec3; 4] {
    let axis = axis.min(2);
    let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
    let center = bounds.center();
    let margin = 0.06 * (bounds.max - bounds.min).length();
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(s, t)| {
        let mut corner = center;
        corner[axis] = offset;
        corner[i] += s * (0.5 * (bounds.max - bounds.min)[i] + margin);
        corner[j] += t * (0.5 * (bounds.max - bounds.min)[j] + margin);
        corner
    })
}

// Where a plane cuts the model: the line that symmetry mirrors at.
//
// Every triangle that the plane crosses gives a piece between two of its edges. Pieces are chained together through the edges
// that they share, so that the line has no gaps but where the model ends. What hides it is asked piece by piece.

/// The line along which a plane orthogonal to an axis cuts a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    /// The axis and where the plane meets it, world units.
    plane: Option<(usize, f64)>,
    runs: Vec<Run>,
    seen_from: Option<Viewpoint>,
    seen: Vec<Vec<DVec3>>,
    /// While plane or view move, nothing is computed before then.
    rests_until: Option<Instant>,
}

/// Pieces that hang together.
#[derive(Clone, Debug, PartialEq)]
struct Run {
    /// World space.
    points: Vec<DVec3>,
    /// From each point to the next one the outward normal.
    normals: Vec<DVec3>,
}

/// A piece: the edges between which it lies (by their vertices, ascending), and the points there.
struct Piece {
    edges: [(u32, u32); 2],
    points: [DVec3; 2],
    normal: DVec3,
}

/// Places that are tested for what lies before them.
const MAX_RAYS: usize = 5000;

/// While plane or view move, the line rests so many times as long as it took to compute.
const REST: u32 = 4;

/// Pixels between two such places at most.
const STEP_PIXELS: f64 = 10.0;

/// A hidden part that is no longer than so many pixels is shown: roughness, not a fold, hides it.
const BRIDGED_PIXELS: f64 = 9.0;

/// How far above the surface a place is tested, in mesh units.
const LIFT: f64 = 2e-3;

impl Section {
    /// Brings plane and view up to date, unless that took long just now: then the line stays as it was. False where it has stayed
    /// behind.
    pub fn update(&mut self, surface: &Surface, axis: usize, offset: f64, view: &Viewpoint) -> bool {
        if self.plane == Some((axis, offset)) && self.seen_from == Some(*view) {
            return true;
        }
        let begun = Instant::now();
        if self.rests_until.is_some_and(|until| begun < until) {
            return false;
        }
        self.follow(surface, axis, offset);
        self.seen(surface, view);
        let ended = Instant::now();
        self.rests_until = Some(ended + REST * (ended - begun));
        true
    }

    /// The parts of the line that were seen when it was last brought up to date.
    pub fn parts(&self) -> &[Vec<DVec3>] {
        &self.seen
    }

    /// Brings the line up to date with a plane; costs something only where that is another one.
    pub fn follow(&mut self, surface: &Surface, axis: usize, offset: f64) {
        if self.plane == Some((axis, offset)) {
            return;
        }
        self.plane = Some((axis, offset));
        self.seen_from = None;
        let triangles = 0..surface.mesh().triangles.len() as u32;
        self.runs = chained(triangles.filter_map(|t| piece(surface, t, axis.min(2), offset)).collect());
    }

    /// The parts of the line that are seen, with nothing before them. Costs something only where the view is another one.
    pub fn seen(&mut self, surface: &Surface, view: &Viewpoint) -> &[Vec<DVec3>] {
        if self.seen_from != Some(*view) {
            self.seen_from = Some(*view);
            let fine: Vec<Run> = self.runs.iter().map(|run| run.divided(view)).collect();
            let places: usize = fine.iter().map(|run| run.normals.len()).sum();
            let stride = places.div_ceil(MAX_RAYS).max(1);
            self.seen = fine.iter().flat_map(|run| run.seen(surface, view, stride)).collect();
        }
        &self.seen
    }
}

/// Where a plane crosses a triangle.
fn piece(surface: &Surface, triangle: u32, axis: usize, offset: f64) -> Option<Piece> {
    let mesh = surface.mesh();
    let place = mesh.world_from_mesh;
    let vertices = mesh.triangles[triangle as usize];
    let corners = mesh.triangle_positions(triangle as usize).map(|p| place.point(p));
    let heights = corners.map(|corner| corner[axis] - offset);
    // A corner in the plane counts as above it, so that two edges are crossed or none.
    let crossing = |k: usize| {
        // From the lower vertex number to the higher one: both triangles of the edge find the same point.
        let (a, b) = (k, (k + 1) % 3);
        let (a, b) = if vertices[a] < vertices[b] { (a, b) } else { (b, a) };
        let is_crossed = (heights[a] >= 0.0) != (heights[b] >= 0.0);
        let point = || corners[a].lerp(corners[b], heights[a] / (heights[a] - heights[b]));
        is_crossed.then(|| ((vertices[a], vertices[b]), point()))
    };
    let mut ends = (0..3).filter_map(crossing);
    let (first, second) = (ends.next()?, ends.next()?);
    let normal = surface.outer_normal(triangle);
    Some(Piece { edges: [first.0, second.0], points: [first.1, second.1], normal })
}

/// Puts pieces that share an edge behind each other.
fn chained(pieces: Vec<Piece>) -> Vec<Run> {
    let mut at_edge: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
    for (index, piece) in pieces.iter().enumerate() {
        piece.edges.iter().for_each(|edge| at_edge.entry(*edge).or_default().push(index));
    }
    let mut is_used = vec![false; pieces.len()];
    let is_end = |index: usize| pieces[index].edges.iter().position(|edge| at_edge[edge].len() != 2);
    // Open lines from an end of theirs, then closed ones from anywhere.
    let open = (0..pieces.len()).filter_map(|index| Some((index, is_end(index)?)));
    let starts: Vec<(usize, usize)> = open.chain((0..pieces.len()).map(|index| (index, 0))).collect();
    let mut runs = Vec::new();
    for (start, from) in starts {
        if is_used[start] {
            continue;
        }
        let mut run = Run { points: vec![pieces[start].points[from]], normals: Vec::new() };
        let (mut index, mut from) = (start, from);
        loop {
            is_used[index] = true;
            let piece = &pieces[index];
            run.points.push(piece.points[1 - from]);
            run.normals.push(piece.normal);
            let edge = piece.edges[1 - from];
            let next = at_edge[&edge].iter().find(|next| !is_used[**next]);
            let Some(&next) = next.filter(|_| at_edge[&edge].len() == 2) else { break };
            from = usize::from(pieces[next].edges[0] != edge);
            index = next;
        }
        runs.push(run);
    }
    runs
}

impl Run {
    /// The same with points no further apart in the picture than places that are tested.
    fn divided(&self, view: &Viewpoint) -> Self {
        let mut fine = Self { points: vec![self.points[0]], normals: Vec::new() };
        for (ends, normal) in self.points.windows(2).zip(&self.normals) {
            let count = (pixels_between(view, ends[0], ends[1]) / STEP_PIXELS).ceil().clamp(1.0, 64.0);
            for k in 1..=count as u32 {
                fine.points.push(ends[0].lerp(ends[1], f64::from(k) / count));
                fine.normals.push(*normal);
            }
        }
        fine
    }

    /// The parts that are seen; one in `stride` places is tested.
    fn seen(&self, surface: &Surface, view: &Viewpoint, stride: usize) -> Vec<Vec<DVec3>> {
        let tested: Vec<bool> = (0..self.normals.len())
            .step_by(stride)
            .map(|k| is_free(surface, view, 0.5 * (self.points[k] + self.points[k + 1]), self.normals[k]))
            .collect();
        let mut is_seen: Vec<bool> = (0..self.normals.len()).map(|k| tested[k / stride]).collect();
        self.bridge(view, &mut is_seen);
        let mut parts = Vec::new();
        let mut part: Vec<DVec3> = Vec::new();
        for (k, is_seen) in is_seen.into_iter().enumerate() {
            if is_seen {
                if part.is_empty() {
                    part.push(self.points[k]);
                }
                part.push(self.points[k + 1]);
            } else if !part.is_empty() {
                parts.push(std::mem::take(&mut part));
            }
        }
        // A closed line begins anywhere, perhaps where it is seen.
        let is_closed = self.points[0].distance_squared(self.points[self.points.len() - 1]) == 0.0;
        match parts.first_mut().filter(|first| is_closed && first[0] == self.points[0]) {
            Some(first) if !part.is_empty() => {
                part.extend_from_slice(&first[1..]);
                *first = part;
            }
            _ => parts.extend((!part.is_empty()).then_some(part)),
        }
        parts
    }

    /// Shows short hidden parts between parts that are seen.
    fn bridge(&self, view: &Viewpoint, is_seen: &mut [bool]) {
        let mut hidden_since = None;
        for k in 0..is_seen.len() {
            match (is_seen[k], hidden_since) {
                (false, None) if k > 0 => hidden_since = Some(k),
                (true, Some(since)) => {
                    let way = self.points[since..=k].windows(2);
                    let length: f64 = way.map(|ends| pixels_between(view, ends[0], ends[1])).sum();
                    if length <= BRIDGED_PIXELS {
                        is_seen[since..k].fill(true);
                    }
                    hidden_since = None;
                }
                _ => {}
            }
        }
    }
}

/// Whether nothing lies between the eye and a place just above the surface.
fn is_free(surface: &Surface, view: &Viewpoint, point: DVec3, normal: DVec3) -> bool {
    let place = surface.mesh().world_from_mesh;
    let to_eye = (view.rig.eye - point).normalize_or_zero();
    let outwards = if normal.dot(to_eye) < 0.0 { DVec3::ZERO } else { normal };
    let lifted = point + (to_eye + outwards) * (LIFT * place.scale);
    let distance = (view.rig.eye - lifted).length() / place.scale;
    let from = place.inverse_point(lifted);
    let hit = surface.hit(from, to_eye.as_vec3());
    hit.is_none_or(|hit| surface.position(hit).as_vec3().distance(from) > distance as f32)
}

fn pixels_between(view: &Viewpoint, a: DVec3, b: DVec3) -> f64 {
    let [Some(a), Some(b)] = [a, b].map(|p| view.project(p)) else { return 0.0 };
    ((b - a) * DVec2::from(view.pixels.map(f64::from))).length()
}
