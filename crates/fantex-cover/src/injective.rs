//! Does a projected region overlap itself?
//!
//! All triangles of a connected region face the direction and no interior vertex is wound around twice, so the projection is
//! an immersion. The turning numbers of its boundary curves sum up to the Euler characteristic; if no two boundary
//! segments cross, every curve is simple, exactly one of them runs counter-clockwise and the immersion is an embedding.
//! So it is enough to look for crossing segments.

use glam::Vec2;

/// A boundary segment, named by its vertices so that neighbours are recognised.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment {
    pub(crate) vertices: [u32; 2],
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

#[cfg(test)]
mod tests {
    use super::*;

    fn path(points: &[[f32; 2]]) -> Vec<Segment> {
        let n = points.len();
        (0..n)
            .map(|i| Segment {
                vertices: [i as u32, ((i + 1) % n) as u32],
                ends: [points[i].into(), points[(i + 1) % n].into()],
            })
            .collect()
    }

    #[test]
    fn a_square_is_simple_and_a_bow_tie_is_not() {
        assert!(!any_crossing(&mut path(&[[0., 0.], [1., 0.], [1., 1.], [0., 1.]])));
        assert!(any_crossing(&mut path(&[[0., 0.], [1., 1.], [1., 0.], [0., 1.]])));
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
