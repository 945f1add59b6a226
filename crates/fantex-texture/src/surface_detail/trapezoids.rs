//! Polygons cut into trapezoids between horizontal lines: any outline, with holes, without a crossing.
//!
//! Between two neighbouring heights of corners no edge begins, ends or meets another, so the edges there have an order from
//! left to right, and the polygon lies between the first and the second, the third and the fourth, ... Trapezoids between the
//! same two edges join into one across such lines. (After F. Preparata and M. Shamos, "Computational Geometry", 1985.)

use glam::DVec2;

/// A convex piece: corners with increasing angle, the last two or first two may coincide.
pub(super) type Piece = [DVec2; 4];

/// An edge, upwards.
#[derive(Clone, Copy)]
struct Edge {
    low: DVec2,
    high: DVec2,
}

impl Edge {
    fn x_at(&self, y: f64) -> f64 {
        if y <= self.low.y {
            self.low.x
        } else if y >= self.high.y {
            self.high.x
        } else {
            self.low.x + (self.high.x - self.low.x) * ((y - self.low.y) / (self.high.y - self.low.y))
        }
    }
}

/// A trapezoid that may go on above.
struct Open {
    edges: [usize; 2],
    from: f64,
}

/// The pieces of the inside (points with an odd number of edges to their left); `None` where edges cross.
pub(super) fn trapezoids(outlines: &[Vec<DVec2>]) -> Option<Vec<Piece>> {
    let edges = edges_of(outlines);
    let mut heights: Vec<f64> = edges.iter().flat_map(|e| [e.low.y, e.high.y]).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    // Edges enter in the order of their lower ends.
    let mut by_start: Vec<usize> = (0..edges.len()).collect();
    by_start.sort_by(|&a, &b| edges[a].low.y.total_cmp(&edges[b].low.y));
    let mut waiting = by_start.into_iter().peekable();
    let (mut active, mut open, mut pieces) = (Vec::new(), Vec::<Open>::new(), Vec::new());
    for slab in heights.windows(2) {
        let [from, to] = [slab[0], slab[1]];
        active.retain(|&e: &usize| edges[e].high.y > from);
        while let Some(edge) = waiting.next_if(|&e| edges[e].low.y <= from) {
            active.push(edge);
        }
        active.sort_by(|&a, &b| {
            let places = |e: usize| [0.5 * (from + to), to].map(|y| edges[e].x_at(y));
            let ([a_middle, a_top], [b_middle, b_top]) = (places(a), places(b));
            a_middle.total_cmp(&b_middle).then(a_top.total_cmp(&b_top)).then(a.cmp(&b))
        });
        if !is_ordered(&edges, &active, from) || !is_ordered(&edges, &active, to) {
            return None;
        }
        let now: Vec<[usize; 2]> = active.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect();
        let (going_on, ended): (Vec<Open>, Vec<Open>) =
            open.into_iter().partition(|o| now.contains(&o.edges));
        pieces.extend(ended.iter().map(|o| piece(&edges, o, from)));
        open = going_on;
        let new: Vec<[usize; 2]> =
            now.into_iter().filter(|pair| open.iter().all(|o| o.edges != *pair)).collect();
        open.extend(new.into_iter().map(|edges| Open { edges, from }));
    }
    let top = heights.last().copied().unwrap_or(0.0);
    pieces.extend(open.iter().map(|o| piece(&edges, o, top)));
    Some(pieces)
}

/// All edges that are not horizontal.
fn edges_of(outlines: &[Vec<DVec2>]) -> Vec<Edge> {
    let sides = outlines.iter().flat_map(|o| (0..o.len()).map(move |i| (o[i], o[(i + 1) % o.len()])));
    sides
        .filter(|(a, b)| a.y != b.y)
        .map(|(a, b)| if a.y < b.y { Edge { low: a, high: b } } else { Edge { low: b, high: a } })
        .collect()
}

/// Whether edges that are ordered within a slab keep their order on its border, up to rounding.
fn is_ordered(edges: &[Edge], order: &[usize], y: f64) -> bool {
    let tolerance = |x: f64| 1e-9 * (1.0 + x.abs());
    order.windows(2).all(|pair| {
        let [a, b] = [pair[0], pair[1]].map(|e| edges[e].x_at(y));
        a <= b + tolerance(a)
    })
}

fn piece(edges: &[Edge], open: &Open, to: f64) -> Piece {
    let [left, right] = open.edges.map(|e| edges[e]);
    let at = |edge: &Edge, y: f64| DVec2::new(edge.x_at(y), y);
    [at(&left, open.from), at(&right, open.from), at(&right, to), at(&left, to)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(pieces: &[Piece]) -> f64 {
        pieces.iter().map(|[a, b, c, d]| 0.5 * (*c - *a).perp_dot(*d - *b)).sum()
    }

    fn ring(n: u32, radius: impl Fn(u32) -> f64) -> Vec<DVec2> {
        let turn = std::f64::consts::TAU / f64::from(n);
        (0..n).map(|i| DVec2::from_angle(f64::from(i) * turn + 0.1) * radius(i)).collect()
    }

    fn shoelace(outline: &[DVec2]) -> f64 {
        (0..outline.len()).map(|i| 0.5 * outline[i].perp_dot(outline[(i + 1) % outline.len()])).sum()
    }

    #[test]
    fn pieces_have_the_polygon_s_area() {
        let star = ring(20, |i| if i % 2 == 0 { 1.0 } else { 0.4 });
        assert!((area(&trapezoids(std::slice::from_ref(&star)).unwrap()) - shoelace(&star)).abs() < 1e-12);
        let hole = ring(7, |_| 0.3);
        let expected = shoelace(&star) - shoelace(&hole);
        assert!((area(&trapezoids(&[star, hole]).unwrap()) - expected).abs() < 1e-12);
        let square = vec![DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        assert_eq!(trapezoids(&[square]).unwrap().len(), 1);
    }

    #[test]
    fn trapezoids_join_where_nothing_happens_between_them() {
        // Corners on the right side cut only their own piece.
        let comb: Vec<DVec2> = (0..50)
            .map(|i| DVec2::new(if i % 2 == 0 { 1.0 } else { 2.0 }, f64::from(i)))
            .chain([DVec2::new(0.0, 49.0), DVec2::ZERO])
            .collect();
        assert!(trapezoids(&[comb]).unwrap().len() <= 50);
    }

    #[test]
    fn crossings_are_found() {
        let bow = vec![DVec2::ZERO, DVec2::ONE, DVec2::X, DVec2::Y];
        assert!(trapezoids(&[bow]).is_none());
        let star =
            (0..5).map(|i| DVec2::from_angle(f64::from(2 * i) * std::f64::consts::TAU / 5.0)).collect();
        assert!(trapezoids(&[star]).is_none());
    }
}
