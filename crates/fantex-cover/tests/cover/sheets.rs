//! All tiles on one sheet.

use fantex_cover::{Packing, pack};
use proptest::prelude::*;

/// The first two tiles that share a texel, found by marking blocks.
fn overlap(packing: &Packing, extents: &[[u32; 2]]) -> Option<(usize, usize)> {
    let columns = packing.width as usize / 4;
    let mut owner = vec![usize::MAX; columns * (packing.height as usize / 4)];
    for (i, (&[x, y], &[width, height])) in packing.positions.iter().zip(extents).enumerate() {
        for row in y / 4..(y + height) / 4 {
            for column in x / 4..(x + width) / 4 {
                let block = &mut owner[row as usize * columns + column as usize];
                if *block != usize::MAX {
                    return Some((*block, i));
                }
                *block = i;
            }
        }
    }
    None
}

fn extents(count: std::ops::Range<usize>, blocks: u32) -> impl Strategy<Value = Vec<[u32; 2]>> {
    prop::collection::vec((1..blocks, 1..blocks).prop_map(|(w, h)| [4 * w, 4 * h]), count)
}

proptest! {
    #[test]
    fn tiles_lie_inside_apart_and_on_blocks(extents in extents(0..200, 40)) {
        let packing = pack(&extents);
        prop_assert_eq!(packing.positions.len(), extents.len());
        prop_assert!(packing.width.is_multiple_of(4) && packing.height.is_multiple_of(4));
        for (&[x, y], &[width, height]) in packing.positions.iter().zip(&extents) {
            prop_assert!(x.is_multiple_of(4) && y.is_multiple_of(4));
            prop_assert!(x + width <= packing.width && y + height <= packing.height);
        }
        prop_assert_eq!(overlap(&packing, &extents), None);
    }

    #[test]
    fn many_tiles_waste_little(extents in extents(2000..2001, 32)) {
        let packing = pack(&extents);
        prop_assert!(packing.fill(&extents) > 0.93, "{}", packing.fill(&extents));
        prop_assert_eq!(&packing, &pack(&extents));
    }
}

#[test]
fn nothing_and_one_tile_fill_their_sheet() {
    assert_eq!(pack(&[]), Packing::default());
    assert_eq!(pack(&[]).fill(&[]), 0.0);
    let one = [[512, 4]];
    let packing = pack(&one);
    assert_eq!((packing.width, packing.height), (512, 4));
    assert_eq!(packing.fill(&one), 1.0);
}
