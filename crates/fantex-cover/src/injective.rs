//! Does a projected region overlap itself?
//!
//! All triangles of a connected region face the direction and no interior vertex is wound around twice, so the projection is
//! an immersion. The turning numbers of its boundary curves sum up to the Euler characteristic; if no two boundary
//! segments cross, every curve is simple, exactly one of them runs counter-clockwise and the immersion is an embedding.
//! So it is enough to look for crossing segments, and around the boundary's vertices: segments with a common vertex do not
//! cross elsewhere, but the wedges that they bound may overlap.

use glam::Vec2;

use crate::crossings::Segment;

/// What a triangle of the region spans around one of its vertices: the directions from `from` counter-clockwise to `to`, less
/// than half a turn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wedge {
    vertex: u32,
    from: Vec2,
    to: Vec2,
}

impl Wedge {
    /// For a triangle that is counter-clockwise in the order of the arguments.
    pub(crate) fn new(vertex: u32, at: Vec2, next: Vec2, previous: Vec2) -> Self {
        Self { vertex, from: next - at, to: previous - at }
    }

    /// Without the direction where the wedge ends.
    fn contains(&self, direction: Vec2) -> bool {
        self.from.perp_dot(direction) >= 0.0 && direction.perp_dot(self.to) > 0.0
    }
}

/// What is known of a vertex of the boundary.
#[derive(Clone, Copy, Debug)]
struct BoundaryVertex {
    vertex: u32,
    /// Towards the end of the first segment that begins here.
    direction: Vec2,
    /// Segments that begin here.
    begins: u32,
    /// Triangles that contain `direction`.
    layers: u32,
}

const NO_VERTEX: u32 = u32::MAX;

/// Finds vertices around which a region overlaps itself. Keeps its buffers.
#[derive(Default)]
pub(crate) struct OverlapFinder {
    /// Open addressing by vertex; at most half full.
    table: Vec<BoundaryVertex>,
    spokes: Vec<Spoke>,
}

/// A boundary segment as one of its vertices sees it.
#[derive(Clone, Copy, Debug)]
struct Spoke {
    vertex: u32,
    /// True where the segment begins at the vertex, and so does a run of the region's triangles, counter-clockwise.
    begins: bool,
    angle: f32,
}

impl OverlapFinder {
    /// True where the region overlaps itself at a vertex of its boundary: where it lies in two layers on one side of a
    /// segment that begins there, or where its beginnings and ends around the vertex do not take turns. (The number of
    /// layers changes at segments only. If these take turns, it is one and zero by turns as soon as it is one anywhere.)
    pub(crate) fn any_at_vertex(&mut self, segments: &[Segment], wedges: &[Wedge]) -> bool {
        let empty = BoundaryVertex { vertex: NO_VERTEX, direction: Vec2::ZERO, begins: 0, layers: 0 };
        self.table.clear();
        self.table.resize((2 * segments.len()).next_power_of_two().max(4), empty);
        let mut branches = false;
        for segment in segments {
            let entry = self.entry(segment.vertices[0]);
            if entry.begins == 0 {
                entry.vertex = segment.vertices[0];
                entry.direction = segment.ends[1] - segment.ends[0];
            }
            entry.begins += 1;
            branches |= entry.begins > 1;
        }
        for wedge in wedges {
            let entry = self.entry(wedge.vertex);
            if entry.vertex == wedge.vertex && wedge.contains(entry.direction) {
                entry.layers += 1;
                if entry.layers > 1 {
                    return true;
                }
            }
        }
        branches && self.any_out_of_turn(segments)
    }

    /// The entry of a vertex, or the empty one where it would be.
    fn entry(&mut self, vertex: u32) -> &mut BoundaryVertex {
        let mask = self.table.len() - 1;
        let mut place = (u64::from(vertex).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize & mask;
        while self.table[place].vertex != vertex && self.table[place].vertex != NO_VERTEX {
            place = (place + 1) & mask;
        }
        &mut self.table[place]
    }

    /// True where at a vertex with several beginnings these and the ends do not take turns.
    fn any_out_of_turn(&mut self, segments: &[Segment]) -> bool {
        let mut spokes = std::mem::take(&mut self.spokes);
        spokes.clear();
        for segment in segments {
            let along = segment.ends[1] - segment.ends[0];
            for (vertex, begins, direction) in
                [(segment.vertices[0], true, along), (segment.vertices[1], false, -along)]
            {
                if self.entry(vertex).begins > 1 {
                    spokes.push(Spoke { vertex, begins, angle: libm::atan2f(direction.y, direction.x) });
                }
            }
        }
        // Where a run begins where another ends, the end comes first.
        spokes.sort_unstable_by(|a, b| {
            a.vertex.cmp(&b.vertex).then(a.angle.total_cmp(&b.angle)).then(a.begins.cmp(&b.begins))
        });
        let out_of_turn = |around: &[Spoke]| {
            (0..around.len()).any(|i| around[i].begins == around[(i + 1) % around.len()].begins)
        };
        let found = spokes.chunk_by(|a, b| a.vertex == b.vertex).any(out_of_turn);
        self.spokes = spokes;
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crossings::any_crossing;

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

    /// Whether triangles around vertex 0 between the given angles overlap there. Those that follow each other share an edge.
    fn fan_overlaps(angles: &[[f32; 2]]) -> bool {
        let at = |angle: f32| if angle == 0.0 { Vec2::X } else { Vec2::from_angle(angle) };
        let mut wedges = Vec::new();
        let mut segments = Vec::new();
        for (i, &[from, to]) in (0..).zip(angles) {
            let vertices = [0, 2 * i + 1, 2 * i + 2];
            let corners = [Vec2::ZERO, at(from), at(to)];
            wedges.push(Wedge::new(0, corners[0], corners[1], corners[2]));
            for [a, b] in [[0, 1], [1, 2], [2, 0]] {
                let joins = |other: &[f32; 2]| (a == 0 && other[1] == from) || (b == 0 && other[0] == to);
                if !angles.iter().any(joins) {
                    segments.push(Segment::new([vertices[a], vertices[b]], [corners[a], corners[b]]));
                }
            }
        }
        OverlapFinder::default().any_at_vertex(&segments, &wedges)
    }

    #[test]
    fn wedges_at_a_vertex_may_touch_but_not_overlap() {
        assert!(!fan_overlaps(&[[0.0, 1.0], [2.0, 3.0]]));
        assert!(!fan_overlaps(&[[3.0, 4.0], [5.0, 6.0]]));
        assert!(fan_overlaps(&[[0.0, 1.0], [0.5, 2.0]]));
        assert!(fan_overlaps(&[[0.0, 3.0], [1.0, 2.0]]));
        assert!(fan_overlaps(&[[3.0, 4.0], [3.5, 5.0]]));
        // One run of triangles, and one that goes around more than once.
        let run = |n: u32| -> Vec<[f32; 2]> { (0..n).map(|i| [i as f32, (i + 1) as f32]).collect() };
        assert!(!fan_overlaps(&run(6)));
        assert!(fan_overlaps(&run(7)));
        // Beginnings and ends take turns, but in between the region lies in two layers.
        let mut twice = run(7);
        twice.extend([[7.0 + 0.2, 8.0], [8.0, 9.0]]);
        assert!(fan_overlaps(&twice));
    }

    #[test]
    fn runs_that_touch_at_an_edge_take_turns() {
        let at = Vec2::from_angle;
        let wedges =
            [Wedge::new(0, Vec2::ZERO, at(0.0), at(1.0)), Wedge::new(0, Vec2::ZERO, at(1.0), at(2.0))];
        let segments = [
            Segment::new([0, 1], [Vec2::ZERO, at(0.0)]),
            Segment::new([2, 0], [at(1.0), Vec2::ZERO]),
            Segment::new([0, 3], [Vec2::ZERO, at(1.0)]),
            Segment::new([4, 0], [at(2.0), Vec2::ZERO]),
        ];
        assert!(!OverlapFinder::default().any_at_vertex(&segments, &wedges));
    }

    /// Without clusters in the table, which took minutes here.
    #[test]
    fn a_wheel_of_very_many_spokes_is_soon_found_sound() {
        let n = 200_000;
        let at = |i: u32| Vec2::from_angle(i as f32 / n as f32 * std::f32::consts::TAU);
        let rim = |i: u32| Segment::new([i + 1, (i + 1) % n + 1], [at(i), at((i + 1) % n)]);
        let segments: Vec<Segment> = (0..n).map(rim).collect();
        let wedges: Vec<Wedge> = (0..n).map(|i| Wedge::new(0, Vec2::ZERO, at(i), at((i + 1) % n))).collect();
        assert!(!OverlapFinder::default().any_at_vertex(&segments, &wedges));
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
