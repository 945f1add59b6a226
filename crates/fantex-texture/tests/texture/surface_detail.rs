//! Surface-detail polygons: shares of footprints against areas known by heart and against many points.

use fantex_texture::coordinates::{Coordinates, TextureMatrix};
use fantex_texture::look::Slot;
use fantex_texture::{
    DetailCoverage, DetailPolygon, Filtering, PolygonsTexture, ShadingPoint, SurfaceDetail, Texture, UvPoint,
};
use glam::{Vec2, Vec3, Vec4};

fn rectangle(low: [f32; 2], high: [f32; 2]) -> Vec<Vec2> {
    vec![Vec2::from(low), Vec2::new(high[0], low[1]), Vec2::from(high), Vec2::new(low[0], high[1])]
}

fn star(centre: Vec2, points: u32, outer: f32, inner: f32) -> Vec<Vec2> {
    let turn = std::f32::consts::PI / points as f32;
    let radius = |i: u32| if i.is_multiple_of(2) { outer } else { inner };
    (0..2 * points).map(|i| centre + Vec2::from_angle(i as f32 * turn + 0.3) * radius(i)).collect()
}

fn polygon(outline: Vec<Vec2>, material: u32, priority: i32) -> DetailPolygon {
    DetailPolygon { outlines: vec![outline], material, priority }
}

const PIXEL: [Vec2; 2] = [Vec2::X, Vec2::Y];

fn weight_of(coverage: &DetailCoverage, polygon: u32) -> f32 {
    coverage.details.iter().filter(|d| d.polygon == polygon).map(|d| d.weight).sum()
}

fn assert_complete(coverage: &DetailCoverage) {
    let sum = coverage.base + coverage.details.iter().map(|d| d.weight).sum::<f32>();
    assert!((sum - 1.0).abs() < 1e-5 && coverage.base >= 0.0, "{coverage:?}");
    assert!(coverage.details.iter().all(|d| d.weight > 0.0));
}

#[test]
fn shares_of_a_square_are_exact() {
    let detail = SurfaceDetail::new(&[polygon(rectangle([0.0, 0.0], [2.0, 2.0]), 7, 0)]).unwrap();
    let share = |x: f32, y: f32, footprint: [Vec2; 2]| {
        let coverage = detail.coverage(Vec2::new(x, y), footprint);
        assert_complete(&coverage);
        assert!(coverage.details.iter().all(|d| d.material == 7));
        weight_of(&coverage, 0)
    };
    assert_eq!(share(1.0, 1.0, PIXEL), 1.0);
    assert_eq!(share(3.0, 1.0, PIXEL), 0.0);
    assert!((share(0.0, 1.0, PIXEL) - 0.5).abs() < 1e-6);
    assert!((share(2.2, -0.1, PIXEL) - 0.3 * 0.4).abs() < 1e-6);
    // The pixel turned by 45 degrees on the edge, either way round; a pixel that covers all.
    let diagonal = [Vec2::new(0.5, 0.5), Vec2::new(-0.5, 0.5)];
    assert!((share(0.0, 1.0, diagonal) - 0.5).abs() < 1e-6);
    assert!((share(0.0, 1.0, [diagonal[1], diagonal[0]]) - 0.5).abs() < 1e-6);
    assert!((share(0.0, 0.0, diagonal) - 0.25).abs() < 1e-6);
    assert!((share(5.0, 5.0, [Vec2::X * 100.0, Vec2::Y * 100.0]) - 4e-4).abs() < 1e-9);
    // Without area: the point.
    assert_eq!(share(0.1, 0.1, [Vec2::ZERO; 2]), 1.0);
    assert_eq!(share(-0.1, 0.1, [Vec2::X, Vec2::X]), 0.0);
}

#[test]
fn higher_priority_covers_and_holes_show_what_is_below() {
    let window = DetailPolygon {
        outlines: vec![rectangle([0.0, 0.0], [4.0, 4.0]), rectangle([1.0, 1.0], [3.0, 3.0])],
        material: 1,
        priority: 5,
    };
    let polygons = [
        window,
        polygon(rectangle([0.0, 0.0], [4.0, 2.0]), 2, 0),
        polygon(rectangle([-1.0, 1.5], [5.0, 2.5]), 3, 0),
    ];
    let detail = SurfaceDetail::new(&polygons).unwrap();
    let coverage = detail.coverage(Vec2::splat(2.0), [Vec2::X * 4.0, Vec2::Y * 4.0]);
    assert_complete(&coverage);
    let expected = [(0, 12.0), (2, 2.0), (1, 1.0)];
    for ((polygon, area), got) in expected.into_iter().zip(&coverage.details) {
        assert_eq!(got.polygon, polygon, "topmost first");
        assert!((got.weight - area / 16.0).abs() < 1e-6, "{coverage:?}");
    }
    assert!((coverage.base - 1.0 / 16.0).abs() < 1e-6);
    let topmost = |x: f32, y: f32| detail.topmost(Vec2::new(x, y));
    assert_eq!((topmost(0.5, 0.5), topmost(2.0, 1.2), topmost(2.0, 2.0)), (Some(0), Some(1), Some(2)));
    assert_eq!((topmost(2.0, 2.8), topmost(9.0, 0.0)), (None, None));
    let mean = coverage.mean(|material| material.map_or(0.0, |m| m as f32));
    assert!((mean - (12.0 + 6.0 + 2.0) / 16.0).abs() < 1e-5);
}

/// Stars of all sizes up to `largest` over each other, in the unit square.
fn many(count: u32, largest: f32) -> Vec<DetailPolygon> {
    let hash = |i: u32, k: u32| {
        let mut x = (i * 8 + k).wrapping_mul(0x9e37_79b9);
        x = (x ^ (x >> 15)).wrapping_mul(0x85eb_ca6b);
        ((x ^ (x >> 13)) >> 8) as f32 / (1 << 24) as f32
    };
    let star = |i: u32| {
        let outer = largest * (0.1 + 0.9 * hash(i, 3).powi(3));
        let outline = star(Vec2::new(hash(i, 1), hash(i, 2)), 3 + i % 5, outer, outer * 0.45);
        polygon(outline, i % 4, (i % 3) as i32)
    };
    (0..count).map(star).collect()
}

#[test]
fn shares_are_those_of_many_points() {
    let detail = SurfaceDetail::new(&many(3000, 0.034)).unwrap();
    for (i, size) in [0.002, 0.01, 0.05, 0.3].into_iter().enumerate() {
        for k in 0..6 {
            let uv = Vec2::new(0.15 + 0.13 * k as f32, 0.2 + 0.17 * i as f32);
            let turn = Vec2::from_angle(0.7 * k as f32);
            let footprint = [turn * size, (turn.perp() * 0.6 + turn * 0.2) * size];
            let coverage = detail.coverage(uv, footprint);
            assert_complete(&coverage);
            let n = 200;
            let mut counted = std::collections::BTreeMap::<Option<u32>, f32>::new();
            for j in 0..n * n {
                let at = [j % n, j / n].map(|c| (c as f32 + 0.5) / n as f32 - 0.5);
                let p = uv + footprint[0] * at[0] + footprint[1] * at[1];
                *counted.entry(detail.topmost(p)).or_default() += 1.0 / (n * n) as f32;
            }
            let difference = |d: &fantex_texture::DetailWeight| {
                (d.weight - counted.get(&Some(d.polygon)).copied().unwrap_or(0.0)).abs()
            };
            let largest = coverage.details.iter().map(difference).fold(0.0, f32::max);
            let base = (coverage.base - counted.get(&None).copied().unwrap_or(0.0)).abs();
            assert!(largest < 4e-3 && base < 4e-3, "{size}: {largest} {base}");
        }
    }
}

/// A deep stack is read from the top, until nothing is left to see.
#[test]
fn stacks_of_polygons_cost_what_is_seen_of_them() {
    let layer = |i: u32| polygon(star(Vec2::splat(0.5), 5, 0.2 + 1e-4 * i as f32, 0.1), i, -(i as i32));
    let detail = SurfaceDetail::new(&(0..200).map(layer).collect::<Vec<_>>()).unwrap();
    let started = std::time::Instant::now();
    let hidden = detail.coverage(Vec2::splat(0.5), [Vec2::X * 0.05, Vec2::Y * 0.05]);
    assert_eq!((hidden.details.len(), hidden.details[0].polygon, hidden.base), (1, 0, 0.0));
    let whole = detail.coverage(Vec2::splat(0.5), PIXEL);
    assert_complete(&whole);
    assert_eq!(whole.details.len(), 200);
    eprintln!("two looks at 200 layers: {:?}", started.elapsed());
}

/// A picture is the same whether it is taken with large pixels or averaged from small ones.
#[test]
fn footprints_add_up() {
    let detail = SurfaceDetail::new(&many(500, 0.05)).unwrap();
    let (uv, size) = (Vec2::new(0.4, 0.5), 0.2);
    let whole = detail.coverage(uv, [Vec2::X * size, Vec2::Y * size]);
    let n = 9;
    let (mut base, mut first) = (0.0, 0.0);
    for i in 0..n * n {
        let at = Vec2::new((i % n) as f32, (i / n) as f32) - 0.5 * (n - 1) as f32;
        let part =
            detail.coverage(uv + at * (size / n as f32), [Vec2::X, Vec2::Y].map(|v| v * (size / n as f32)));
        base += part.base / (n * n) as f32;
        first += weight_of(&part, whole.details[0].polygon) / (n * n) as f32;
    }
    assert!((base - whole.base).abs() < 1e-5 && (first - whole.details[0].weight).abs() < 1e-5);
}

/// Small footprints ask few pieces, whatever there is elsewhere.
#[test]
fn thousands_of_polygons_are_no_burden() {
    let time = |count: u32| {
        let detail = SurfaceDetail::new(&many(count, 1.0 / (count as f32).sqrt())).unwrap();
        let size = 1.0 / (count as f32).sqrt();
        let started = std::time::Instant::now();
        let mut sum = 0.0;
        for i in 0..20_000_u32 {
            let uv = Vec2::new((i * 7 % 1000) as f32, (i * 13 % 997) as f32) / 1000.0;
            sum += detail.coverage(uv, [Vec2::X * size * 0.1, Vec2::Y * size * 0.1]).base;
        }
        assert!(sum > 100.0);
        started.elapsed().as_secs_f64() / 20_000.0
    };
    for count in [100, 10_000] {
        let seconds = time(count);
        eprintln!("{count} polygons: {:.2} us per look-up", seconds * 1e6);
        assert!(seconds < 1e-3);
    }
}

/// What a texture of polygons shows at texture coordinates.
fn seen(texture: &PolygonsTexture, uv: [f32; 2], steps: [Vec2; 2]) -> Vec4 {
    texture.evaluate(&ShadingPoint {
        position: Vec3::ZERO,
        position_steps: [Vec3::ZERO; 2],
        normal: Vec3::Y,
        normal_steps: [Vec3::ZERO; 2],
        uv: &[UvPoint { uv: uv.into(), steps }],
        vertex_color: Vec4::ONE,
        eye: None,
        time: 0.0,
        filtering: Filtering::Own,
    })
}

#[test]
fn polygons_are_a_texture_that_keeps_its_mean() {
    let place = || (Coordinates::default(), TextureMatrix::default());
    // A red quarter, and a half-transparent white square that hangs over into the next unit square.
    let polygons = [
        polygon(rectangle([0.0, 0.0], [0.5, 0.5]), 0, 0),
        polygon(rectangle([0.75, 0.5], [1.25, 1.0]), 1, 0),
    ];
    let colors = || vec![Slot::color(Vec3::X), Slot::Constant(Vec4::new(1.0, 1.0, 1.0, 0.5))];
    let base = || Slot::color(Vec3::Z);
    let once = PolygonsTexture::new(&polygons, colors(), base(), place(), false).unwrap();
    let point = [Vec2::ZERO; 2];
    assert_eq!(seen(&once, [0.2, 0.2], point), Vec4::new(1.0, 0.0, 0.0, 1.0));
    assert_eq!(seen(&once, [1.2, 0.2], point), Vec4::new(0.0, 0.0, 1.0, 1.0));
    assert_eq!(seen(&once, [0.9, 0.7], point).w, 0.5);
    let again = PolygonsTexture::new(&polygons, colors(), base(), place(), true).unwrap();
    for cell in [[0.0, 0.0], [1.0, 0.0], [-7.0, 3.0]] {
        let at = |u: f32, v: f32| seen(&again, [cell[0] + u, cell[1] + v], point);
        assert_eq!(at(0.2, 0.2), Vec4::new(1.0, 0.0, 0.0, 1.0));
        assert_eq!(at(0.1, 0.7), at(0.9, 0.7), "what hangs over");
        assert_eq!(at(0.6, 0.2), Vec4::new(0.0, 0.0, 1.0, 1.0));
    }
    // A footprint as large as the square, wherever it lies, and a larger one: a quarter red, a quarter half-transparent.
    let alpha = 0.75 + 0.25 * 0.5;
    let mean = Vec4::new((0.25 + 0.125) / alpha, 0.125 / alpha, (0.5 + 0.125) / alpha, alpha);
    for (uv, size) in [([0.5, 0.5], 1.0), ([0.3, 0.8], 1.0), ([0.1, 0.1], 40.0), ([0.1, 0.1], f32::NAN)] {
        let color = seen(&again, uv, [Vec2::X * size, Vec2::Y * size]);
        assert!((color - mean).abs().max_element() < 1e-5, "{uv:?} {size}: {color} instead of {mean}");
    }
}

#[test]
fn repeated_polygons_come_from_any_distance() {
    let place = || (Coordinates::default(), TextureMatrix::default());
    let repeated = |outline: Vec<Vec2>| {
        let colors = vec![Slot::color(Vec3::X)];
        PolygonsTexture::new(&[polygon(outline, 0, 0)], colors, Slot::color(Vec3::Z), place(), true)
    };
    let is_red = |texture: &PolygonsTexture, uv| seen(texture, uv, [Vec2::ZERO; 2]).x == 1.0;
    let far = repeated(rectangle([7.0, -4.0], [7.5, -3.5])).unwrap();
    assert!(is_red(&far, [0.2, 0.2]) && !is_red(&far, [0.7, 0.2]) && !is_red(&far, [0.2, 0.7]));
    // A bar over several squares covers them all.
    let bar = repeated(rectangle([0.0, 0.4], [4.5, 0.6])).unwrap();
    assert!(is_red(&bar, [0.2, 0.5]) && is_red(&bar, [0.8, 0.5]) && !is_red(&bar, [0.8, 0.7]));
    let half = seen(&far, [0.2, 0.2], [Vec2::X, Vec2::Y]);
    assert!((half - Vec4::new(0.25, 0.0, 0.75, 1.0)).abs().max_element() < 1e-5, "{half}");
    let error = repeated(rectangle([0.0, 0.0], [1e6, 1e6])).unwrap_err();
    let expected = "1000002 x 1000002 copies of it would repeat it; one polygon has at most 10000";
    assert!(error.to_string().contains(expected), "{error}");
}

#[test]
fn what_is_no_polygon_is_refused() {
    let square = rectangle([0.0, 0.0], [1.0, 1.0]);
    let refused = |outlines: Vec<Vec<Vec2>>| {
        let bad = DetailPolygon { outlines, ..DetailPolygon::default() };
        SurfaceDetail::new(&[polygon(square.clone(), 0, 9), bad]).unwrap_err().to_string()
    };
    let line = vec![Vec2::ZERO, Vec2::X];
    assert!(refused(vec![line]).starts_with("outline 1 of detail polygon 2 has 2 corners"));
    let mut broken = square.clone();
    broken[2].y = f32::NAN;
    assert!(refused(vec![square.clone(), broken]).starts_with("corner 3 of outline 2 of detail polygon 2"));
    let bow = vec![Vec2::ZERO, Vec2::ONE, Vec2::X, Vec2::Y];
    assert!(refused(vec![bow]).starts_with("the outlines of detail polygon 2 cross"));
    assert_eq!(SurfaceDetail::new(&[]).unwrap().coverage(Vec2::ZERO, PIXEL).base, 1.0);
    let flat = polygon(vec![Vec2::ZERO, Vec2::X, Vec2::X * 2.0], 0, 0);
    assert_eq!(SurfaceDetail::new(&[flat]).unwrap().coverage(Vec2::ZERO, PIXEL).base, 1.0);
}
