//! How far a triangle reaches in a band of rows: so a needle across a picture costs the texels beside it, not those of its box.

use std::ops::{Add, Div, Mul, Sub};

/// What bands and spans are widened by, so that rounding leaves nothing out: in units of a picture's texels.
pub const SPAN_SLACK: f32 = 0.01;

/// The least and the greatest x of the part of a triangle between two heights; none where no part of it lies there. In single or double precision.
pub fn span<T>(corners: [[T; 2]; 3], low: T, high: T) -> Option<[T; 2]>
where
    T: Copy + PartialOrd + Add<Output = T> + Sub<Output = T> + Mul<Output = T> + Div<Output = T> + From<f32>,
{
    let [zero, one] = [0.0f32, 1.0f32].map(<T as From<f32>>::from);
    let mut span: Option<[T; 2]> = None;
    let mut add = |x: T| {
        let [first, last] = span.unwrap_or([x; 2]);
        span = Some([lesser(first, x), greater(last, x)]);
    };
    // The part is a polygon, each of whose corners lies on a side of the triangle.
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        let ([upper_x, upper_y], [lower_x, lower_y]) = if a[1] <= b[1] { (a, b) } else { (b, a) };
        if upper_y > high || lower_y < low {
            continue;
        }
        let height = lower_y - upper_y;
        for y in [greater(low, upper_y), lesser(high, lower_y)] {
            if height > zero {
                add(upper_x + (lower_x - upper_x) * lesser((y - upper_y) / height, one));
            } else {
                add(upper_x);
                add(lower_x);
            }
        }
    }
    span
}

fn lesser<T: PartialOrd>(a: T, b: T) -> T {
    if b < a { b } else { a }
}

fn greater<T: PartialOrd>(a: T, b: T) -> T {
    if b > a { b } else { a }
}

#[cfg(test)]
mod tests {
    use fantex_base::Random;
    use glam::Vec2;

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
            match span([a, b, c].map(|p| p.to_array()), low, high) {
                Some([first, last]) => {
                    assert!(first - SPAN_SLACK <= least && greatest <= last + SPAN_SLACK);
                    let ends = [a, b, c].map(|p| p.x);
                    assert!(first >= ends.into_iter().fold(f32::INFINITY, f32::min) - SPAN_SLACK);
                    assert!(last <= ends.into_iter().fold(f32::NEG_INFINITY, f32::max) + SPAN_SLACK);
                }
                None => assert!(least > greatest),
            }
        }
    }

    #[test]
    fn sides_along_rows_and_points_have_spans() {
        let flat = [[1.0f64, 2.0], [7.0, 2.0], [3.0, 2.0]];
        assert_eq!(span(flat, 1.5, 2.5), Some([1.0, 7.0]));
        assert_eq!(span(flat, 2.5, 3.5), None);
        assert_eq!(span([[4.0f64; 2]; 3], 3.0, 4.0), Some([4.0; 2]));
        let upright = [[0.0f64, 0.0], [4.0, 0.0], [0.0, 8.0]];
        assert_eq!(span(upright, 2.0, 4.0), Some([0.0, 3.0]));
        assert_eq!(span(upright.map(|corner| corner.map(|x| x as f32)), 2.0, 4.0), Some([0.0f32, 3.0]));
    }
}
