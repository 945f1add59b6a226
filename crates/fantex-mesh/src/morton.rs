//! A curve through space.

use glam::Vec3;

/// The number of a point of the cube [-1, 1] along a Z-order curve, 10 bits per axis: `x` gives the lowest bit of each three. Points
/// outside count as the nearest on the cube, no numbers as -1. (G. M. Morton, "A Computer Oriented Geodetic Data Base", 1966.)
pub fn morton(p: Vec3) -> u32 {
    let spread = |x: f32| {
        let mut bits = ((x + 1.0) * 511.5).clamp(0.0, 1023.0) as u32;
        bits = (bits | bits << 16) & 0x0300_00ff;
        bits = (bits | bits << 8) & 0x0300_f00f;
        bits = (bits | bits << 4) & 0x030c_30c3;
        (bits | bits << 2) & 0x0924_9249
    };
    let [x, y, z] = p.to_array().map(spread);
    x | y << 1 | z << 2
}

#[cfg(test)]
mod tests {
    use fantex_base::Random;

    use super::*;

    #[test]
    fn bits_of_the_coordinates_alternate() {
        let mut random = Random::new(7);
        for _ in 0..1000 {
            let p = Vec3::from_array(std::array::from_fn(|_| 2.5 * random.unit() as f32 - 1.25));
            let cells = p.to_array().map(|x| ((x.clamp(-1.0, 1.0) + 1.0) * 511.5) as u32);
            let expected: u32 = (0..30).map(|bit| (cells[bit % 3] >> (bit / 3) & 1) << bit).sum();
            assert_eq!(morton(p), expected);
        }
        assert_eq!(morton(Vec3::splat(f32::NAN)), morton(Vec3::NEG_ONE));
    }
}
