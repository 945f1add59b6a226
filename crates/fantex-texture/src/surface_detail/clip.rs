//! Convex polygons cut by convex pieces, and their areas.

use glam::DVec2;

/// Corners of a convex polygon, counter-clockwise.
pub(super) type Convex = Vec<DVec2>;

/// Twice the area's half: the area, positive.
pub(super) fn area(convex: &[DVec2]) -> f64 {
    let Some((&first, rest)) = convex.split_first() else { return 0.0 };
    rest.windows(2).map(|pair| 0.5 * (pair[0] - first).perp_dot(pair[1] - first)).sum::<f64>().max(0.0)
}

/// The parts of a convex polygon to the left and to the right of the line from `a` to `b` (I. Sutherland and G. Hodgman,
/// "Reentrant polygon clipping", 1974); either may be empty.
fn split(convex: &[DVec2], a: DVec2, b: DVec2) -> [Convex; 2] {
    let along = b - a;
    let side = |p: DVec2| along.perp_dot(p - a);
    let mut parts = [Vec::with_capacity(convex.len() + 1), Vec::with_capacity(convex.len() + 1)];
    for (i, &p) in convex.iter().enumerate() {
        let q = convex[(i + 1) % convex.len()];
        let (at_p, at_q) = (side(p), side(q));
        if at_p >= 0.0 {
            parts[0].push(p);
        }
        if at_p <= 0.0 {
            parts[1].push(p);
        }
        if at_p * at_q < 0.0 {
            let crossing = p + (q - p) * (at_p / (at_p - at_q));
            parts[0].push(crossing);
            parts[1].push(crossing);
        }
    }
    parts.map(|part| if part.len() < 3 { Vec::new() } else { part })
}

/// The part of `convex` inside `piece` (counter-clockwise); what is left outside goes to `outside`, in convex parts.
pub(super) fn carve(convex: Convex, piece: &[DVec2; 4], outside: &mut Vec<Convex>) -> Convex {
    let first_part = outside.len();
    let mut inside = convex.clone();
    for k in 0..4 {
        let (a, b) = (piece[k], piece[(k + 1) % 4]);
        if a == b {
            continue;
        }
        let [left, right] = split(&inside, a, b);
        if area(&left) == 0.0 {
            // Nothing is inside: no need to have it in parts.
            outside.truncate(first_part);
            outside.push(convex);
            return Vec::new();
        }
        if area(&right) > 0.0 {
            outside.push(right);
        }
        inside = left;
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_carved_out_and_what_is_left_make_the_whole() {
        let square: Convex = vec![DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        let mut outside = Vec::new();
        let half = [0.25, 0.75].map(|x| DVec2::new(x, 0.0));
        let piece = [half[0], half[1], half[1] + DVec2::Y * 0.5, half[0] + DVec2::Y * 0.5];
        let inside = carve(square.clone(), &piece, &mut outside);
        assert!((area(&inside) - 0.25).abs() < 1e-12);
        let left: f64 = outside.iter().map(|p| area(p)).sum();
        assert!((left - 0.75).abs() < 1e-12);
        let mut untouched = Vec::new();
        let beside = piece.map(|p| p + DVec2::X * 5.0);
        assert!(carve(square.clone(), &beside, &mut untouched).is_empty());
        assert_eq!(untouched, [square]);
    }
}
