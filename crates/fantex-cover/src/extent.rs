//! Tile extents: how many texels a rectangle gets.

/// Longest side of a tile in texels. Also keeps texel coordinates exact in single precision.
pub const MAX_EXTENT: u32 = 1 << 18;

/// Rounding a side down to a multiple of 4 may cost at most this share of the nominal density.
const TOLERATED_LOSS: f32 = 0.06;

/// Texels of the smallest tile.
pub(crate) const SMALLEST_TILE: u64 = 4 * 4;

/// The longest region in texels, rounded down a little, that gets a side of 4 texels.
pub(crate) const LONGEST_IN_SMALLEST: f32 = 0.99999 * 3.0 / (1.0 - TOLERATED_LOSS);

/// Sides longer than this are multiples of 32.
const LONG: f32 = 1024.0;

/// Texels along a side whose region is `length` texels long: the region plus half a texel of filter margin at both ends,
/// rounded to a multiple of 4. The tile map is then scaled so that the region fills the tile, whichever way the rounding
/// went, so no texel is left over; the density of the side follows by at most the tolerated loss or the gain.
pub(crate) fn side_texels(length: f32) -> u32 {
    let wanted = length + 1.0;
    if wanted > LONG {
        // Three levels halve exactly, so that long tiles can be baked in pieces.
        return 32 * ((wanted / 32.0).round() as u32).min(MAX_EXTENT / 32);
    }
    let blocks = (wanted * 0.25) as u32;
    let down = (4 * blocks) as f32;
    let good = blocks >= 1 && down - 1.0 >= (1.0 - TOLERATED_LOSS) * length;
    let side = if good || down == wanted { 4 * blocks } else { 4 * blocks + 4 };
    side.clamp(4, MAX_EXTENT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_are_multiples_of_four_that_hold_the_region() {
        assert_eq!(side_texels(0.0), 4);
        assert_eq!(side_texels(3.0), 4);
        assert_eq!(side_texels(3.2), 8);
        assert_eq!([1.0, 1.0001].map(|f| side_texels(f * LONGEST_IN_SMALLEST)), [4, 8]);
        assert_eq!(side_texels(64.0), 64);
        assert_eq!(side_texels(127.9), 128);
        for i in 0..10_000 {
            let length = i as f32 * 0.037;
            let side = side_texels(length);
            assert!(
                side.is_multiple_of(4)
                    && (side - 1) as f32 >= (1.0 - TOLERATED_LOSS) * length
                    && side as f32 <= length + 5.0
            );
        }
    }
}
