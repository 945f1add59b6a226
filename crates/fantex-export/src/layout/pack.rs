//! Packing masks of blocks into a square.

use super::mask::Mask;

/// Where each mask lies (in blocks) in a square of `side` blocks, the largest first into the topmost, then leftmost free
/// place; none where they do not fit.
pub(super) fn pack(masks: &[Mask], side: u32) -> Option<Vec<[u32; 2]>> {
    let counts: Vec<u64> = masks.iter().map(Mask::count).collect();
    if counts.iter().sum::<u64>() > u64::from(side) * u64::from(side) {
        return None;
    }
    let mut order: Vec<usize> = (0..masks.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(counts[i]), i));
    let mut grid = Mask::empty(side, side);
    let mut places = vec![[0, 0]; masks.len()];
    // Where one of a size was placed, another one of that size rarely finds a place further up.
    let mut first_rows = [0; 64];
    for i in order {
        let mask = &masks[i];
        let first_row = &mut first_rows[counts[i].max(1).ilog2() as usize];
        let place = find(&grid, mask, *first_row..side).or_else(|| find(&grid, mask, 0..*first_row))?;
        *first_row = (*first_row).max(place[1]);
        grid.stamp(mask, place[0], place[1]);
        places[i] = place;
    }
    Some(places)
}

/// The first free place whose upper row is in `rows`.
fn find(grid: &Mask, mask: &Mask, rows: std::ops::Range<u32>) -> Option<[u32; 2]> {
    let (columns, last_row) = (grid.width.checked_sub(mask.width)?, grid.height.checked_sub(mask.height)?);
    let rows = rows.start..rows.end.min(last_row + 1);
    rows.flat_map(|y| (0..=columns).map(move |x| [x, y])).find(|&[x, y]| !grid.collides(mask, x, y))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rectangle(width: u32, height: u32) -> Mask {
        let mut mask = Mask::empty(width, height);
        (0..height).for_each(|y| (0..width).for_each(|x| mask.insert(x, y)));
        mask
    }

    #[test]
    fn squares_that_fill_a_square_are_packed() {
        let masks = vec![rectangle(16, 16); 16];
        let places = pack(&masks, 64).unwrap();
        let mut sorted = places.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), 16);
        assert!(pack(&[masks, vec![rectangle(1, 1)]].concat(), 64).is_none());
    }

    #[test]
    fn a_small_piece_goes_into_the_hollow_of_a_large_one() {
        let mut frame = rectangle(10, 10);
        frame = {
            let mut hollow = Mask::empty(10, 10);
            frame
                .blocks()
                .filter(|&[x, y]| x < 2 || y < 2 || x > 7 || y > 7)
                .for_each(|[x, y]| hollow.insert(x, y));
            hollow
        };
        assert_eq!(pack(&[rectangle(6, 6), frame], 10).unwrap(), [[2, 2], [0, 0]]);
    }
}
