//! Does a projected region overlap itself?
//!
//! All triangles of a connected region face the direction and no interior vertex is wound around twice, so the projection is
//! an immersion. The turning numbers of its boundary curves sum up to the Euler characteristic; if no two boundary
//! segments cross, every curve is simple, exactly one of them runs counter-clockwise and the immersion is an embedding.
//! So it is enough to look for crossing segments, and around the boundary's vertices: segments with a common vertex do not
//! cross elsewhere, but the wedges that they bound may overlap.

use glam::Vec2;

/// A boundary segment, named by its vertices so that neighbours are recognised. The region lies to its left.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment {
    pub(crate) vertices: [u32; 2],
    /// The fans around the vertices that the triangle beside the segment belongs to.
    pub(crate) fans: [u32; 2],
    pub(crate) ends: [Vec2; 2],
}

impl Segment {
    fn x_range(&self) -> (f32, f32) {
        (self.ends[0].x.min(self.ends[1].x), self.ends[0].x.max(self.ends[1].x))
    }

    fn y_range(&self) -> (f32, f32) {
        (self.ends[0].y.min(self.ends[1].y), self.ends[0].y.max(self.ends[1].y))
    }

    fn crosses(&self, other: &Segment) -> bool {
        if self.vertices.iter().any(|v| other.vertices.contains(v)) {
            return false;
        }
        let side = |s: &Segment, p: Vec2| {
            let [a, b] = s.ends.map(Vec2::as_dvec2);
            (b - a).perp_dot(p.as_dvec2() - a)
        };
        let straddles = |s: &Segment, o: &Segment| side(s, o.ends[0]) * side(s, o.ends[1]) <= 0.0;
        straddles(self, other) && straddles(other, self)
    }
}

/// True where two segments without a common vertex meet. Reorders `segments`. A sweep along x.
pub(crate) fn any_crossing(segments: &mut [Segment]) -> bool {
    segments
        .sort_unstable_by(|a, b| a.x_range().0.total_cmp(&b.x_range().0).then(a.vertices.cmp(&b.vertices)));
    for (i, s) in segments.iter().enumerate() {
        let (x_end, (y_start, y_end)) = (s.x_range().1, s.y_range());
        for o in segments[i + 1..].iter().take_while(|o| o.x_range().0 <= x_end) {
            let (o_start, o_end) = o.y_range();
            if o_start <= y_end && o_end >= y_start && s.crosses(o) {
                return true;
            }
        }
    }
    false
}

/// A boundary segment as one of its vertices sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spoke {
    vertex: u32,
    fan: u32,
    /// True where the segment begins at the vertex, and so does a wedge of the region, counter-clockwise.
    begins: bool,
    /// Towards the segment's other end.
    direction: Vec2,
}

/// True where the region overlaps itself at a vertex of its boundary: it surrounds the vertex more than once, or two of its
/// wedges there overlap. `turn` is the angle that the region's triangles in a fan span at its centre, in radians. `spokes`
/// is a buffer.
pub(crate) fn any_overlap_at_vertex(
    segments: &[Segment],
    turn: impl Fn(u32) -> f32,
    spokes: &mut Vec<Spoke>,
) -> bool {
    spokes.clear();
    spokes.extend(segments.iter().flat_map(|s| {
        let along = s.ends[1] - s.ends[0];
        [(0, true, along), (1, false, -along)].map(|(end, begins, direction)| Spoke {
            vertex: s.vertices[end],
            fan: s.fans[end],
            begins,
            direction,
        })
    }));
    spokes.sort_unstable_by_key(|s| (s.vertex, s.fan));
    spokes.chunk_by_mut(|a, b| a.vertex == b.vertex).any(|around| {
        let total: f32 = around.chunk_by(|a, b| a.fan == b.fan).map(|spokes| turn(spokes[0].fan)).sum();
        if total > FULL_TURN {
            return true;
        }
        // Around the vertex, ends and beginnings of wedges must take turns. Where a wedge begins where another ends, the
        // end comes first.
        let angle = |s: &Spoke| s.direction.y.atan2(s.direction.x);
        around.sort_unstable_by(|a, b| angle(a).total_cmp(&angle(b)).then(a.begins.cmp(&b.begins)));
        (0..around.len()).any(|i| around[i].begins == around[(i + 1) % around.len()].begins)
    })
}

/// With some rounding.
const FULL_TURN: f32 = std::f32::consts::TAU + 1e-3;

#[cfg(test)]
mod tests {
    use super::*;

    fn path(points: &[[f32; 2]]) -> Vec<Segment> {
        let n = points.len();
        (0..n)
            .map(|i| Segment {
                vertices: [i as u32, ((i + 1) % n) as u32],
                fans: [i as u32, ((i + 1) % n) as u32],
                ends: [points[i].into(), points[(i + 1) % n].into()],
            })
            .collect()
    }

    #[test]
    fn a_square_is_simple_and_a_bow_tie_is_not() {
        assert!(!any_crossing(&mut path(&[[0., 0.], [1., 0.], [1., 1.], [0., 1.]])));
        assert!(any_crossing(&mut path(&[[0., 0.], [1., 1.], [1., 0.], [0., 1.]])));
    }

    /// Two triangles with a common vertex 0, between the given angles.
    fn two_wedges(angles: [[f32; 2]; 2]) -> Vec<Segment> {
        let triangle = |[from, to]: [f32; 2], first: u32| {
            let corners =
                [(0, Vec2::ZERO), (first, Vec2::from_angle(from)), (first + 1, Vec2::from_angle(to))];
            [0, 1, 2].map(|k| [corners[k], corners[(k + 1) % 3]]).map(|pair| Segment {
                vertices: pair.map(|p| p.0),
                fans: pair.map(|p| p.0),
                ends: pair.map(|p| p.1),
            })
        };
        angles.into_iter().zip([1, 3]).flat_map(|(wedge, first)| triangle(wedge, first)).collect()
    }

    #[test]
    fn wedges_at_a_vertex_may_touch_but_not_overlap() {
        let overlap = |angles: [[f32; 2]; 2]| {
            let turn = |_| angles.iter().map(|[from, to]| to - from).sum();
            any_overlap_at_vertex(&two_wedges(angles), turn, &mut Vec::new())
        };
        assert!(!overlap([[0.0, 1.0], [2.0, 3.0]]));
        assert!(!overlap([[3.0, 4.0], [5.0, 6.0]]));
        assert!(!overlap([[0.0, 1.0], [1.0, 2.0]]));
        assert!(overlap([[0.0, 1.0], [0.5, 2.0]]));
        assert!(overlap([[0.0, 3.0], [1.0, 2.0]]));
        assert!(overlap([[3.0, 4.0], [3.5, 5.0]]));
        // Ends and beginnings take turns, but both wedges run almost all around.
        assert!(any_overlap_at_vertex(&two_wedges([[0.0, 1.0], [2.0, 3.0]]), |_| 8.0, &mut Vec::new()));
    }

    #[test]
    fn a_spiral_that_runs_into_itself_is_found() {
        let mut points: Vec<[f32; 2]> = (0..=40)
            .map(|i| {
                let a = i as f32 * 0.2;
                [a.cos(), a.sin()]
            })
            .collect();
        points.push([0.0, 0.0]);
        assert!(any_crossing(&mut path(&points)));
    }
}
