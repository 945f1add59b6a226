//! Texels under triangles and beside them, against a walk over all triangles for each texel.

use fantex_base::Random;
use fantex_cover::{Footprints, NO_OWNER, TexelBlock, TexelTriangle};
use glam::{DVec2, Vec2};

/// Beside a triangle, texels.
const REACH: f64 = 2.0;

/// How far a texel's centre lies outside the farthest side's line, texels; not positive inside. By the lines' normals.
fn outside(corners: [Vec2; 3], at: Vec2) -> f64 {
    let [a, b, c] = corners.map(Vec2::as_dvec2);
    let turn = (b - a).perp_dot(c - a).signum();
    let line = |from: DVec2, to: DVec2| -turn * (to - from).normalize().perp_dot(at.as_dvec2() - from);
    line(a, b).max(line(b, c)).max(line(c, a))
}

fn in_reach_of_box(corners: [Vec2; 3], at: Vec2, reach: f32) -> bool {
    let [a, b, c] = corners;
    let (low, high) = (a.min(b).min(c) - reach, a.max(b).max(c) + reach);
    at.cmpge(low).all() && at.cmple(high).all()
}

#[test]
fn texels_belong_to_the_triangle_under_them_or_to_the_nearest_in_reach() {
    let mut random = Random::new(7);
    let mut point = |low: f64, size: f64| {
        Vec2::new((low + size * random.unit()) as f32, (low + size * random.unit()) as f32)
    };
    let block = TexelBlock { origin: [32, 64], extent: [70, 50] };
    let mut owned = 0;
    for trial in 0..200 {
        let corners: Vec<[Vec2; 3]> = (0..1 + trial % 5)
            .map(|_| {
                let a = point(20.0, 100.0);
                match trial % 3 {
                    0 => [a, point(20.0, 100.0), point(20.0, 100.0)],
                    // Needles, and specks.
                    1 => [a, point(20.0, 100.0), a + point(-0.05, 0.1)],
                    _ => [a, a + point(-1.0, 2.0), a + point(-1.0, 2.0)],
                }
            })
            .collect();
        let triangles: Vec<_> = (0..)
            .zip(&corners)
            .filter_map(|(t, &corners)| TexelTriangle::new(t, [true; 3], corners))
            .collect();
        let mut footprints = Footprints { triangles, ..Footprints::default() };
        footprints.cover(block, 0.1);
        for texel in 0..block.texel_count() {
            let (x, y) = (texel as u32 % block.extent[0], texel as u32 / block.extent[0]);
            let at = Vec2::new((block.origin[0] + x) as f32 + 0.5, (block.origin[1] + y) as f32 + 0.5);
            let distance = |t: &TexelTriangle| outside(corners[t.triangle as usize], at);
            let least = |reach: f64| {
                let near =
                    |t: &&TexelTriangle| in_reach_of_box(corners[t.triangle as usize], at, reach as f32);
                footprints.triangles.iter().filter(near).map(distance).fold(f64::INFINITY, f64::min)
            };
            let owner = footprints.owner[texel];
            if owner == NO_OWNER {
                assert!(
                    least(REACH - 0.01) > REACH - 0.01,
                    "trial {trial}, texel {x} {y}: {}",
                    least(REACH - 0.01)
                );
            } else {
                owned += 1;
                let own = distance(&footprints.triangles[owner as usize]);
                let stated = f64::from(footprints.distance[texel]);
                assert!(
                    (own.max(0.0) - stated.max(0.0)).abs() < 0.02,
                    "trial {trial}: {own} is not {stated}"
                );
                assert!(
                    own <= least(REACH - 0.01).max(0.0) + 0.02,
                    "trial {trial}, texel {x} {y}: {own}, {}",
                    least(REACH - 0.01)
                );
            }
        }
    }
    assert!(owned > 50_000, "{owned}");
}
