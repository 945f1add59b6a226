//! How far a triangle reaches in a band of rows: so a needle across a picture costs the texels beside it, not those of its box.

use glam::Vec2;

/// What bands and spans are widened by, so that rounding leaves nothing out.
pub(crate) const SLACK: f32 = 0.01;

/// The least and the greatest x of the part of a triangle between two heights; none where no part of it lies there.
pub(crate) fn span(corners: [Vec2; 3], low: f32, high: f32) -> Option<[f32; 2]> {
    let mut span: Option<[f32; 2]> = None;
    let mut add = |x: f32| {
        let [first, last] = span.unwrap_or([x; 2]);
        span = Some([first.min(x), last.max(x)]);
    };
    // The part is a polygon, each of whose corners lies on a side of the triangle.
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        let (upper, lower) = if a.y <= b.y { (a, b) } else { (b, a) };
        if upper.y > high || lower.y < low {
            continue;
        }
        let height = lower.y - upper.y;
        for y in [low.max(upper.y), high.min(lower.y)] {
            if height > 0.0 {
                add(upper.x + (lower.x - upper.x) * ((y - upper.y) / height).min(1.0));
            } else {
                add(upper.x);
                add(lower.x);
            }
        }
    }
    span
}

#[cfg(test)]
mod tests {
    use fantex_base::Random;

    use super::*;

    /// Points along each side of a triangle that are looked at.
    const STEPS: u32 = 60;

    #[test]
    fn a_span_holds_what_lies_in_the_band_and_no_more() {
        let mut random = Random::new(5);
        for round in 0..2_000 {
            let mut point = || Vec2::new(100.0 * random.unit() as f32, 100.0 * random.unit() as f32);
            let [a, b, mut c] = [point(), point(), point()];
            if round % 2 == 0 {
                // A needle.
                c = a.lerp(b, 0.4) + Vec2::new(1e-3, 1e-3);
            }
            let low = 90.0 * random.unit() as f32;
            let high = low + 10.0 * random.unit() as f32;
            let (mut least, mut greatest) = (f32::INFINITY, f32::NEG_INFINITY);
            for i in 0..=STEPS {
                for j in 0..=STEPS - i {
                    let [s, t] = [i, j].map(|n| n as f32 / STEPS as f32);
                    let p = a + s * (b - a) + t * (c - a);
                    if (low..=high).contains(&p.y) {
                        (least, greatest) = (least.min(p.x), greatest.max(p.x));
                    }
                }
            }
            match span([a, b, c], low, high) {
                Some([first, last]) => {
                    assert!(first - SLACK <= least && greatest <= last + SLACK);
                    let ends = [a, b, c].map(|p| p.x);
                    assert!(first >= ends.into_iter().fold(f32::INFINITY, f32::min) - SLACK);
                    assert!(last <= ends.into_iter().fold(f32::NEG_INFINITY, f32::max) + SLACK);
                }
                None => assert!(least > greatest),
            }
        }
    }

    #[test]
    fn sides_along_rows_and_points_have_spans() {
        let flat = [[1.0, 2.0], [7.0, 2.0], [3.0, 2.0]].map(Vec2::from);
        assert_eq!(span(flat, 1.5, 2.5), Some([1.0, 7.0]));
        assert_eq!(span(flat, 2.5, 3.5), None);
        assert_eq!(span([Vec2::splat(4.0); 3], 3.0, 4.0), Some([4.0; 2]));
        let upright = [[0.0, 0.0], [4.0, 0.0], [0.0, 8.0]].map(Vec2::from);
        assert_eq!(span(upright, 2.0, 4.0), Some([0.0, 3.0]));
    }
}
