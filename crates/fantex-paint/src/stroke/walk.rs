//! Walking on the surface: along the cut of a plane, from triangle to triangle.

use glam::{DVec3, Vec3};

use crate::{Surface, SurfacePoint};

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

/// Where a walk ends.
#[derive(Clone, Copy, Debug)]
enum Goal {
    Point(SurfacePoint),
    Length(f64),
}

/// Steps after which a walk is given up.
const MAX_STEPS: usize = 1 << 16;

/// A way around may be this much longer than the straight line before it is given up.
const LONGEST_DETOUR: f64 = 4.0;

/// The way from one point to another along the cut of the plane through both that stands upright on the surface between
/// them: a straight line on a plane, nearly the shortest way elsewhere. None where the cut does not lead there.
pub(crate) fn path_between(surface: &Surface, from: SurfacePoint, to: SurfacePoint) -> Option<Path> {
    let (p, q) = (surface.position(from), surface.position(to));
    if from.triangle == to.triangle {
        return Some(Path { points: vec![(from, 0.0), (to, p.distance(q))] });
    }
    let up = surface.facet_normal(from.triangle) + surface.facet_normal(to.triangle);
    let plane = (q - p).cross(up).try_normalize()?;
    walk(surface, from, q - p, plane, Goal::Point(to))
}

/// The point so many mesh units away in a direction (mesh space, projected onto the surface). Ends at a boundary.
pub(crate) fn walk_straight(
    surface: &Surface,
    from: SurfacePoint,
    direction: DVec3,
    length: f64,
) -> SurfacePoint {
    let plane = direction.cross(surface.facet_normal(from.triangle)).try_normalize();
    let path = plane.and_then(|plane| walk(surface, from, direction, plane, Goal::Length(length)));
    path.map_or(from, |path| path.at(length))
}

/// Follows the cut of a plane through `from`.
fn walk(surface: &Surface, from: SurfacePoint, direction: DVec3, plane: DVec3, goal: Goal) -> Option<Path> {
    let origin = surface.position(from);
    let longest = match goal {
        Goal::Point(_) => LONGEST_DETOUR * direction.length(),
        Goal::Length(length) => length,
    };
    let mut path = Path { points: vec![(from, 0.0)] };
    let (mut triangle, mut entered, mut at, mut along) = (from.triangle, None, origin, 0.0);
    for _ in 0..MAX_STEPS {
        if let Goal::Point(to) = goal
            && to.triangle == triangle
        {
            path.points.push((to, along + at.distance(surface.position(to))));
            return Some(path);
        }
        let exit = exit_edge(surface, triangle, origin, plane, direction, entered, at);
        let Some((edge, lambda)) = exit else { break };
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

/// The edge through which the cut leaves a triangle, as a half-edge, and where.
fn exit_edge(
    surface: &Surface,
    triangle: u32,
    origin: DVec3,
    plane: DVec3,
    direction: DVec3,
    entered: Option<u32>,
    at: DVec3,
) -> Option<(u32, Vec3)> {
    let corners = surface.corners(triangle);
    // A corner in the plane counts as above it, so that every cut crosses two edges or none.
    let heights = corners.map(|corner| (corner - origin).dot(plane));
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
        let ahead = (crossing - at).dot(direction);
        if best.is_none_or(|(other, ..)| ahead > other) {
            best = Some((ahead, edge, lambda.into()));
        }
    }
    best.map(|(_, edge, lambda)| (edge, lambda))
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
