//! A colour for every group, different from its neighbours'.

use fantex::cover::Cover;
use glam::Vec3;
use rayon::prelude::*;

/// Number of different colours. Groups have about six neighbours; a few have many more.
const COLORS: u32 = 18;

/// Linear RGB per group. Neighbouring groups get different colours wherever a group has fewer neighbours than there are
/// colours (greedy colouring in the groups' order).
pub(crate) fn group_colors(cover: &Cover) -> Vec<Vec3> {
    let palette: Vec<Vec3> = (0..COLORS).map(color).collect();
    let mut pairs: Vec<[u32; 2]> = cover
        .corner_groups
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .filter(|[a, b]| a != b)
        .flat_map(|[a, b]| [[a, b], [b, a]])
        .collect();
    pairs.par_sort_unstable();
    pairs.dedup();
    let mut chosen: Vec<u32> = Vec::with_capacity(cover.groups.len());
    let mut rest = pairs.as_slice();
    for group in 0..cover.groups.len() as u32 {
        let own = rest.partition_point(|pair| pair[0] <= group);
        let (neighbours, later) = rest.split_at(own);
        rest = later;
        let taken = neighbours
            .iter()
            .filter_map(|pair| chosen.get(pair[1] as usize))
            .fold(0_u32, |mask, &color| mask | 1 << color);
        // Start anywhere, so that all colours are used.
        let first = group.wrapping_mul(0x9e37_79b1) >> 16;
        let free = (0..COLORS).map(|i| (first + i) % COLORS).find(|&color| taken >> color & 1 == 0);
        chosen.push(free.unwrap_or(first % COLORS));
    }
    chosen.into_iter().map(|color| palette[color as usize]).collect()
}

/// Hues round the circle in three lightnesses.
fn color(index: u32) -> Vec3 {
    let hue = index as f32 / COLORS as f32 * std::f32::consts::TAU;
    let lightness = [0.58, 0.82, 0.7][index as usize % 3];
    let chroma = 0.15;
    linear_from_oklab(Vec3::new(lightness, chroma * hue.cos(), chroma * hue.sin()))
        .clamp(Vec3::ZERO, Vec3::ONE)
}

/// Linear sRGB of an Oklab colour (B. Ottosson, "A perceptual color space for image processing", 2020).
fn linear_from_oklab(lab: Vec3) -> Vec3 {
    let l = lab.x + 0.396_337_78 * lab.y + 0.215_803_76 * lab.z;
    let m = lab.x - 0.105_561_346 * lab.y - 0.063_854_17 * lab.z;
    let s = lab.x - 0.089_484_18 * lab.y - 1.291_485_5 * lab.z;
    let [l, m, s] = [l, m, s].map(|c| c * c * c);
    Vec3::new(
        4.076_741_7 * l - 3.307_711_6 * m + 0.230_969_94 * s,
        -1.268_438 * l + 2.609_757_4 * m - 0.341_319_38 * s,
        -0.004_196_086_3 * l - 0.703_418_6 * m + 1.707_614_7 * s,
    )
}

#[cfg(test)]
mod tests {
    use fantex::cover::{CoverOptions, TexelBudget, build_cover};
    use fantex::mesh::generate::icosphere;
    use fantex::mesh::{CleanOptions, clean};

    use super::*;

    #[test]
    fn neighbours_differ() {
        let (mesh, _) = clean(icosphere(5), &CleanOptions::default()).unwrap();
        let options = CoverOptions { budget: TexelBudget::Total(1 << 20), ..CoverOptions::default() };
        let (cover, _) = build_cover(&mesh, &options).unwrap();
        assert!(cover.groups.len() > 20);
        let colors = group_colors(&cover);
        let mut borders = 0;
        for groups in &cover.corner_groups {
            for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (groups[i], groups[j])) {
                if a != b {
                    borders += 1;
                    assert_ne!(colors[a as usize], colors[b as usize], "groups {a} and {b}");
                }
            }
        }
        assert!(borders > 100);
    }

    #[test]
    fn grey_is_grey() {
        let grey = linear_from_oklab(Vec3::new(0.5, 0.0, 0.0));
        assert!((grey - Vec3::splat(0.125)).abs().max_element() < 1e-4, "{grey}");
    }
}
