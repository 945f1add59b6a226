//! Meshes to cover, and what must hold for every cover.

use std::collections::BTreeMap;

use fantex_cover::{Cover, CoverOptions, CoverStats, GroupKind, Tap, TexelBudget, build_cover};
use fantex_mesh::{
    EdgeSide, Fans, Material, Mesh, Model, SurfacePoint, VertexCorners, continued_by_angle, generate,
    interpolate,
};
pub(crate) use fantex_test::{cleaned, data_folder, loaded};
use glam::{DVec2, DVec3, Vec2, Vec3};

/// A mesh of positions and triangles as they are, in mesh space already.
pub(crate) fn raw(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh { positions, triangles, materials: vec![Material::default()], ..Mesh::default() }
}

pub(crate) fn model(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Model {
    Model {
        name: "test".into(),
        positions,
        triangles,
        materials: vec![Material::default()],
        ..Model::default()
    }
}

pub(crate) fn landscape(triangles: u64) -> Mesh {
    let landscape = generate::landscape(&generate::LandscapeOptions {
        triangles,
        ..generate::LandscapeOptions::default()
    })
    .unwrap();
    cleaned(model(landscape.positions.iter().map(|p| p.as_dvec3()).collect(), landscape.triangles))
}

/// A closed cone: `n` triangles around the tip, `n` around the middle of the base.
pub(crate) fn spike(n: u32, height: f64) -> Mesh {
    let mut positions = vec![DVec3::new(0.0, height, 0.0), DVec3::ZERO];
    positions.extend((0..n).map(|i| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(n)).sin_cos();
        DVec3::new(cos, 0.0, -sin)
    }));
    let triangles = (0..n).flat_map(|i| {
        let (a, b) = (2 + i, 2 + (i + 1) % n);
        [[0, a, b], [1, b, a]]
    });
    cleaned(model(positions, triangles.collect()))
}

/// An open umbrella whose ring goes up and down: its angles sum up to more than a full turn. Where it also goes back and
/// forth by more than `turn` times the mean step, no direction sees all of it from the front.
pub(crate) fn saddle(n: u32, height: f64, turn: f64) -> Mesh {
    let mut positions = vec![DVec3::ZERO];
    positions.extend((0..n).map(|i| {
        let side = if i % 2 == 0 { 1.0 } else { -1.0 };
        let (sin, cos) = (std::f64::consts::TAU * (f64::from(i) + side * turn) / f64::from(n)).sin_cos();
        DVec3::new(cos, sin, side * height)
    }));
    cleaned(model(positions, (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect()))
}

/// A sheet with the triangles of both of its sides.
pub(crate) fn leaf() -> Mesh {
    let mut model = generate::grid(8);
    let backs: Vec<[u32; 3]> = model.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    model.triangles.extend(backs);
    model.corners = fantex_mesh::CornerAttributes::default();
    cleaned(model)
}

/// Small meshes of all kinds.
pub(crate) fn generated() -> Vec<(&'static str, Mesh)> {
    vec![
        ("cube 1", cleaned(generate::cube(1))),
        ("cube 7", cleaned(generate::cube(7))),
        ("icosphere 0", cleaned(generate::icosphere(0))),
        ("icosphere 4", cleaned(generate::icosphere(4))),
        ("torus", cleaned(generate::torus(40, 20))),
        ("grid 1", cleaned(generate::grid(1))),
        ("grid 25", cleaned(generate::grid(25))),
        ("book", cleaned(generate::book(7))),
        ("uv sphere", cleaned(generate::uv_sphere(90, 12))),
        ("landscape", landscape(6_000)),
        ("spike", spike(12, 15.0)),
        ("saddle", saddle(10, 1.2, 0.0)),
        ("folded saddle", saddle(10, 1.2, 1.4)),
        ("twins", cleaned(model(vec![DVec3::X, DVec3::Y, DVec3::Z], vec![[0, 1, 2], [0, 2, 1]]))),
        ("leaf", leaf()),
        ("boxes that touch along an edge", touching_boxes()),
        ("crossing sheets", crossing_sheets()),
        ("triangle", cleaned(model(vec![DVec3::X, DVec3::Y, DVec3::Z], vec![[0, 1, 2]]))),
    ]
}

/// Two cubes with an edge in common.
pub(crate) fn touching_boxes() -> Mesh {
    let mut boxes = generate::cube(3);
    let own = boxes.positions.clone();
    let (low, high) =
        own.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    let size = high - low;
    let count = own.len() as u32;
    boxes.positions.extend(own.iter().map(|p| *p + DVec3::new(size.x, size.y, 0.0)));
    boxes.triangles.extend_from_within(..);
    let half = boxes.triangles.len() / 2;
    boxes.triangles[half..].iter_mut().for_each(|t| *t = t.map(|v| v + count));
    cleaned(model(boxes.positions, boxes.triangles))
}

/// Two squares that cross in a line of edges.
fn crossing_sheets() -> Mesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for axis in [DVec3::X, DVec3::Z] {
        for (i, j) in [(-1, 0), (0, 0), (-1, 1), (0, 1)] {
            let corner = |a: i32, b: i32| axis * f64::from(i + a) + DVec3::Y * f64::from(j + b);
            let base = positions.len() as u32;
            positions.extend([corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)]);
            triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
        }
    }
    cleaned(model(positions, triangles))
}

pub(crate) fn options(tile: u32, budget: TexelBudget) -> CoverOptions {
    CoverOptions { tile, budget, ..CoverOptions::default() }
}

pub(crate) fn fans_of(mesh: &Mesh) -> Fans {
    Fans::by_angle(mesh, &VertexCorners::of(&mesh.triangles, mesh.positions.len()))
}

/// Builds a cover and checks all that must hold for any.
#[track_caller]
pub(crate) fn covered(name: &str, mesh: &Mesh, options: &CoverOptions) -> (Cover, CoverStats) {
    let (cover, stats) = build_cover(mesh, options).unwrap();
    let context = format!("{name}, tile {}, {:?}", options.tile, brief(&options.budget));
    check_form(&context, mesh, &cover, &stats);
    check_maps(&context, mesh, &cover);
    check_edges(&context, mesh, &cover);
    check_inside(&context, mesh, &cover);
    check_injective(&context, mesh, &cover);
    (cover, stats)
}

fn brief(budget: &TexelBudget) -> String {
    match budget {
        TexelBudget::PerTriangle(_) => "per triangle".into(),
        other => format!("{other:?}"),
    }
}

/// Ranges, extents, levels, counts.
#[track_caller]
fn check_form(context: &str, mesh: &Mesh, cover: &Cover, stats: &CoverStats) {
    assert_eq!(cover.corner_groups.len(), mesh.triangles.len(), "{context}");
    let mut used = vec![false; cover.groups.len()];
    for g in cover.corner_groups.iter().flatten() {
        used[*g as usize] = true;
    }
    assert!(used.iter().all(|&u| u), "{context}: a group that no corner names");
    for (g, group) in cover.groups.iter().enumerate() {
        assert!(group.extent.iter().all(|n| *n >= 4 && n.is_multiple_of(4)), "{context}: {:?}", group.extent);
        assert!(
            group.frame.direction.is_normalized() && group.frame.x_axis.is_normalized(),
            "{context}: {g}"
        );
        assert!(group.frame.direction.dot(group.frame.x_axis).abs() < 1e-5, "{context}: group {g}");
        let [u, v] = (group.uv_scale).to_array();
        assert!(
            u.is_finite() && v.is_finite() && u > 0.0 && v > 0.0,
            "{context}: group {g} {:?}",
            group.uv_scale
        );
        assert!(group.uv_offset.is_finite() && group.frame.origin.is_finite(), "{context}: group {g}");
        assert_eq!(group.level_extent(0), group.extent);
        assert_eq!(group.level_extent(group.level_count() - 1), [4, 4]);
        for level in 0..group.level_count() {
            let ideal = group.extent.map(|n| f64::from(n) / f64::from(1 << level));
            for (n, ideal) in group.level_extent(level).into_iter().zip(ideal) {
                assert!(
                    n.is_multiple_of(4) && (f64::from(n) - ideal.max(4.0)).abs() <= 2.0,
                    "{context}: {n} for {ideal}"
                );
            }
        }
    }
    assert!(cover.unfolded.windows(2).all(|w| w[0].corner < w[1].corner), "{context}");
    let kind = |t: usize, k: usize| cover.groups[cover.corner_groups[t][k] as usize].kind;
    let expected: Vec<u32> = (0..3 * mesh.triangles.len())
        .filter(|c| kind(c / 3, c % 3) == GroupKind::Unfolded)
        .map(|c| c as u32)
        .collect();
    assert_eq!(cover.unfolded.iter().map(|u| u.corner).collect::<Vec<_>>(), expected, "{context}");

    let fans = stats.fans;
    assert_eq!(fans.total, fans_of(mesh).len() as u64, "{context}");
    assert_eq!(fans.projected + fans.unfolded, fans.total, "{context}");
    assert!(fans.folding <= fans.unfolded, "{context}: {fans:?}");
    assert_eq!(
        (stats.groups, stats.texels),
        (cover.groups.len() as u64, cover.stored_texels(mesh)),
        "{context}"
    );
    assert!(stats.texels <= cover.texels(), "{context}");
    assert!(stats.density_share > 0.0 && stats.density_share.is_finite(), "{context}: {stats:?}");
    assert!((1.0..1.8).contains(&stats.lookups_per_sample), "{context}: {stats:?}");
}

/// Texel coordinates of a triangle's corners in the tile of one of them.
fn texel_corners(mesh: &Mesh, cover: &Cover, triangle: usize, slot: usize) -> [DVec2; 3] {
    let extent = cover.groups[cover.corner_groups[triangle][slot] as usize].extent;
    let texels = DVec2::new(f64::from(extent[0]), f64::from(extent[1]));
    cover.tile_corners(mesh, triangle, slot).map(|uv| uv.as_dvec2() * texels)
}

/// Tile coordinates are finite; no triangle lies face down, except where its fan passes it against its winding.
#[track_caller]
fn check_maps(context: &str, mesh: &Mesh, cover: &Cover) {
    let fans = fans_of(mesh);
    let mut reversed = vec![false; 3 * mesh.triangles.len()];
    for fan in 0..fans.len() {
        fans.corners(fan).iter().for_each(|c| reversed[c.corner() as usize] = c.reversed());
    }
    let any_reversed = reversed.contains(&true);
    for t in 0..mesh.triangles.len() {
        for slot in 0..3 {
            let corners = texel_corners(mesh, cover, t, slot);
            assert!(corners.iter().all(|c| c.is_finite()), "{context}: triangle {t}: {corners:?}");
            // On surfaces that cannot be oriented a split fan's triangles are front up again.
            if any_reversed {
                continue;
            }
            let [a, b, c] = corners;
            let longest = [b - a, c - b, a - c].map(|e| e.length()).into_iter().fold(0.0, f64::max);
            assert!(
                (b - a).perp_dot(c - a) > -1e-3 * longest,
                "{context}: triangle {t} slot {slot} lies face down"
            );
        }
    }
}

/// A triangle at an edge, and the slots of the edge's lower and higher vertex in it.
type Side = (usize, usize, usize);

/// The sides of edges across which triangles continue each other.
fn continued_edges(mesh: &Mesh) -> Vec<[Side; 2]> {
    let mut edges: BTreeMap<(u32, u32), Vec<Side>> = BTreeMap::new();
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            let (i, j) = if triangle[i] < triangle[j] { (i, j) } else { (j, i) };
            edges.entry((triangle[i], triangle[j])).or_default().push((t, i, j));
        }
    }
    let pairs = |(ends, sides): ((u32, u32), Vec<Side>)| {
        let side = |&(t, i, j): &Side| EdgeSide {
            opposite: mesh.triangles[t][3 - i - j],
            is_forward: j == (i + 1) % 3,
        };
        let at_edge: Vec<EdgeSide> = sides.iter().map(side).collect();
        continued_by_angle(&at_edge, ends.into(), &mesh.positions)
            .into_iter()
            .map(move |pair| pair.map(|k| sides[k]))
    };
    edges.into_iter().flat_map(pairs).collect()
}

/// What the texture function reads at a point on an edge: group, weight and tile coordinates, ascending by group.
fn read(mesh: &Mesh, cover: &Cover, (t, i, j): Side, s: f32) -> Vec<(u32, f32, Vec2)> {
    let mut lambda = Vec3::ZERO;
    (lambda[i], lambda[j]) = (1.0 - s, s);
    let taps = cover.taps(mesh, SurfacePoint { triangle: t as u32, lambda });
    let read = |tap: Tap| {
        assert!(tap.slot == i || tap.slot == j || tap.group == cover.corner_groups[t][i]);
        (tap.group, tap.weight, tap.uv)
    };
    let mut reads: Vec<_> = taps.map(read).collect();
    reads.sort_by_key(|r| r.0);
    reads
}

/// Triangles that continue each other across an edge read the same tiles at the same places with the same weights. Returns the number of
/// edges where they name different groups (at fans that were split).
#[track_caller]
fn check_edges(context: &str, mesh: &Mesh, cover: &Cover) {
    let delta = cover.delta;
    let places = [0.0, 0.13, 0.31, 0.5 - 0.49 * delta, 0.5 - 0.2 * delta, 0.5, 0.5 + 0.4 * delta, 0.77, 1.0];
    for [p, q] in continued_edges(mesh) {
        let groups = |(t, i, j): Side| [cover.corner_groups[t][i], cover.corner_groups[t][j]];
        assert_eq!(groups(p), groups(q), "{context}: triangles {} and {}", p.0, q.0);
        for s in places {
            let (a, b) = (read(mesh, cover, p, s), read(mesh, cover, q, s));
            assert_eq!(a.len(), b.len(), "{context}: {a:?} {b:?}");
            let sum: f32 = a.iter().map(|r| r.1).sum();
            assert!((sum - 1.0).abs() < 1e-6 && a.iter().all(|r| r.1 > 0.0), "{context}: {a:?}");
            for (x, y) in a.iter().zip(&b) {
                let same = x.0 == y.0 && (x.1 - y.1).abs() < 1e-6 && (x.2 - y.2).abs().max_element() < 1e-5;
                assert!(same, "{context}: triangles {} and {} at {s}: {x:?} {y:?}", p.0, q.0);
            }
        }
    }
}

/// Barycentric coordinates on a triangular grid, corners and edges included.
fn barycentric_grid(n: u32) -> Vec<Vec3> {
    (0..=n)
        .flat_map(|i| (0..=n - i).map(move |j| Vec3::new(i as f32, j as f32, (n - i - j) as f32) / n as f32))
        .collect()
}

/// All that the texture function reads of a tile lies half a texel inside it.
#[track_caller]
fn check_inside(context: &str, mesh: &Mesh, cover: &Cover) {
    let grid = barycentric_grid(if mesh.triangles.len() > 2000 { 7 } else { 23 });
    for t in 0..mesh.triangles.len() {
        let tiles = cover.triangle_tiles(mesh, t as u32);
        for &lambda in &grid {
            let taps: Vec<Tap> = tiles.taps(lambda).collect();
            let sum: f32 = taps.iter().map(|tap| tap.weight).sum();
            assert!(
                (sum - 1.0).abs() < 1e-6 && taps.iter().all(|tap| tap.weight > 0.0),
                "{context}: {taps:?}"
            );
            for Tap { slot, group, .. } in taps {
                let at = interpolate(texel_corners(mesh, cover, t, slot), lambda.as_dvec3());
                let extent = cover.groups[group as usize].extent;
                for (x, n) in at.to_array().into_iter().zip(extent.map(f64::from)) {
                    let tolerance = 2e-3 + 2e-6 * n;
                    assert!(
                        x > 0.5 - tolerance && x < n - 0.5 + tolerance,
                        "{context}: triangle {t} slot {slot} at {lambda} lies at {at} of {extent:?}"
                    );
                }
            }
        }
    }
}

/// Points per tile side at which overlaps are looked for, at least.
const PROBES: u32 = 48;

/// No point of a tile is strictly inside two of its group's triangles.
#[track_caller]
fn check_injective(context: &str, mesh: &Mesh, cover: &Cover) {
    let mut members: Vec<Vec<(usize, usize)>> = vec![Vec::new(); cover.groups.len()];
    for (t, groups) in cover.corner_groups.iter().enumerate() {
        for slot in 0..3 {
            if !groups[..slot].contains(&groups[slot]) {
                members[groups[slot] as usize].push((t, slot));
            }
        }
    }
    let mut owner = Vec::new();
    for (g, (group, members)) in cover.groups.iter().zip(&members).enumerate() {
        if members.len() < 2 {
            continue;
        }
        let [width, height] = group.extent.map(|n| n.clamp(PROBES, 512) as usize);
        let probes_per_texel =
            DVec2::new(width as f64 / f64::from(group.extent[0]), height as f64 / f64::from(group.extent[1]));
        owner.clear();
        owner.resize(width * height, usize::MAX);
        for &(t, slot) in members {
            let [a, b, c] = texel_corners(mesh, cover, t, slot).map(|p| p * probes_per_texel);
            let area = (b - a).perp_dot(c - a);
            if area.abs() < 1e-9 {
                continue;
            }
            let range = |low: f64, high: f64, n: usize| {
                (low - 0.5).ceil().clamp(0.0, n as f64) as usize
                    ..((high - 0.5).floor() + 1.0).clamp(0.0, n as f64) as usize
            };
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            for y in range(low.y, high.y, height) {
                for x in range(low.x, high.x, width) {
                    let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                    let (l1, l2) = ((p - a).perp_dot(c - a) / area, (b - a).perp_dot(p - a) / area);
                    if l1.min(l2).min(1.0 - l1 - l2) > 1e-3 {
                        let other = std::mem::replace(&mut owner[y * width + x], t);
                        assert!(
                            other == usize::MAX || other == t,
                            "{context}: group {g} ({:?}, {:?}): triangles {other} and {t} both cover {p} of {width}x{height}",
                            group.kind,
                            group.extent
                        );
                    }
                }
            }
        }
    }
}
