//! Pairs of things in the plane whose boxes meet, by a sweep along x.

/// Whether `holds` for two items whose boxes meet; it is asked of the earlier one and the later one, until it says so. A box is its lowest and its
/// highest number along x, and the same along y. The items ascend by their lowest x. `None` where more pairs than `max_pairs` meet along x, and
/// none of the first so many holds.
pub fn any_pair_of_boxes<T, N: PartialOrd>(
    items: &[T],
    ranges: impl Fn(&T) -> [(N, N); 2],
    max_pairs: usize,
    mut holds: impl FnMut(&T, &T) -> bool,
) -> Option<bool> {
    let mut left = max_pairs;
    for (i, one) in items.iter().enumerate() {
        let [(_, end), (low, high)] = ranges(one);
        for other in &items[i + 1..] {
            let [(start, _), (other_low, other_high)] = ranges(other);
            if start > end {
                break;
            }
            left = left.checked_sub(1)?;
            if other_low <= high && other_high >= low && holds(one, other) {
                return Some(true);
            }
        }
    }
    Some(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_pairs_that_meet_are_asked_of_once() {
        let boxes =
            [[(0, 4), (0, 1)], [(1, 2), (1, 3)], [(2, 9), (3, 5)], [(4, 5), (-2, 0)], [(10, 11), (4, 4)]];
        let mut asked = Vec::new();
        let found = any_pair_of_boxes(
            &boxes,
            |b| *b,
            5,
            |a, b| {
                asked.push((a[0].0, b[0].0));
                false
            },
        );
        assert_eq!(found, Some(false));
        assert_eq!(asked, [(0, 1), (0, 4), (1, 2)]);
        assert_eq!(any_pair_of_boxes(&boxes, |b| *b, 5, |a, _| a[0].0 == 1), Some(true));
        assert_eq!(any_pair_of_boxes(&boxes, |b| *b, 4, |_, _| false), None);
    }
}
