//! Packing all tiles into one sheet: the virtual texture as a picture.
//!
//! Shelves: the tiles, sorted by height, fill one row after the other from the left; a row is as high as its first tile.
//! With many tiles of similar heights little is lost. Several widths are tried and the fullest sheet is kept.
//! (The algorithm is "next fit, decreasing height" of E. Coffman, M. Garey, D. Johnson and R. Tarjan, "Performance Bounds
//! for Level-Oriented Two-Dimensional Packing Algorithms", 1980.)

/// Widths that are tried, from the side of the square that the tiles would fill upwards.
const TRIALS: u32 = 24;
/// How much wider each trial is than the one before.
const WIDER: f64 = 1.015;

/// Where tiles lie on a sheet.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Packing {
    /// Sheet width in texels, a multiple of 4.
    pub width: u32,
    /// Sheet height in texels, a multiple of 4.
    pub height: u32,
    /// Left and upper edge of every tile in texels, multiples of 4, in the order in which the tiles were given.
    pub positions: Vec<[u32; 2]>,
}

impl Packing {
    /// Share of the sheet that the given tiles cover, 0..=1.
    pub fn fill(&self, extents: &[[u32; 2]]) -> f64 {
        let sheet = f64::from(self.width) * f64::from(self.height);
        if sheet > 0.0 { texels(extents) as f64 / sheet } else { 0.0 }
    }
}

/// Packs rectangles (width, height in texels, multiples of 4) without overlaps into a sheet that is about square. The same
/// extents give the same packing.
pub fn pack(extents: &[[u32; 2]]) -> Packing {
    packed(extents, None).unwrap_or_default()
}

/// As [`pack`], into a sheet of at most `largest_side` columns and rows; none where the rectangles find no place there.
pub fn pack_within(extents: &[[u32; 2]], largest_side: u32) -> Option<Packing> {
    packed(extents, Some(largest_side / 4 * 4))
}

fn packed(extents: &[[u32; 2]], largest_side: Option<u32>) -> Option<Packing> {
    let mut order: Vec<usize> = (0..extents.len()).collect();
    order.sort_by_key(|&i| {
        let [width, height] = extents[i];
        (std::cmp::Reverse(height), std::cmp::Reverse(width), i)
    });
    let widest = extents.iter().map(|e| e[0]).max().unwrap_or(0);
    let side = (texels(extents) as f64).sqrt();
    let width_of = |trial: u32| {
        let width = (side * WIDER.powi(trial as i32)).ceil() as u64;
        (width.next_multiple_of(4) as u32).max(widest)
    };
    let height = |width: u32| shelves(extents, &order, width, |_, _| ());
    let fits = |width: u32, height: u64| {
        largest_side.is_none_or(|largest| width <= largest && height <= u64::from(largest))
    };
    let (width, _) = (0..TRIALS)
        .map(width_of)
        // A few large tiles may fit at no width near that of a square.
        .chain(largest_side.filter(|&largest| largest >= widest))
        .map(|width| (width, height(width)))
        .filter(|&(width, height)| fits(width, height))
        .min_by_key(|&(width, height)| (u64::from(width) * height, width))?;
    let mut positions = vec![[0; 2]; extents.len()];
    let height = shelves(extents, &order, width, |i, position| positions[i] = position);
    Some(Packing { width, height: height as u32, positions })
}

/// Lays the tiles onto shelves of a width and returns the height of all shelves.
fn shelves(extents: &[[u32; 2]], order: &[usize], width: u32, mut place: impl FnMut(usize, [u32; 2])) -> u64 {
    let (mut left, mut top, mut bottom) = (0, 0_u64, 0_u64);
    for &i in order {
        let [tile_width, tile_height] = extents[i];
        if left + tile_width > width {
            (left, top) = (0, bottom);
        }
        if left == 0 {
            bottom = top + u64::from(tile_height);
        }
        place(i, [left, top as u32]);
        left += tile_width;
    }
    bottom
}

fn texels(extents: &[[u32; 2]]) -> u64 {
    extents.iter().map(|&[width, height]| u64::from(width) * u64::from(height)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_is_kept_where_the_fullest_sheet_is_too_wide() {
        // Side by side 320 x 180 texels; on two shelves 240 x 300, which are more.
        let tiles = [[80, 160], [160, 180], [80, 120]];
        let [free, limited] = [pack(&tiles), pack_within(&tiles, 316).unwrap()];
        assert_eq!([free.width, free.height, limited.width, limited.height], [320, 180, 240, 300]);
        for (i, [x, y]) in limited.positions.iter().enumerate() {
            for (j, [left, top]) in limited.positions.iter().enumerate().take(i) {
                let apart = x + tiles[i][0] <= *left
                    || left + tiles[j][0] <= *x
                    || y + tiles[i][1] <= *top
                    || top + tiles[j][1] <= *y;
                assert!(apart, "{i} and {j}: {limited:?}");
            }
        }
        assert_eq!(pack_within(&tiles, 160), None);
        // The same where there is room.
        assert_eq!(pack_within(&tiles, 4096), Some(free));
    }
}
