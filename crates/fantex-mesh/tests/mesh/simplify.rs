//! Meshes made coarser: how many triangles are left, how far they are from the fine ones, what goes on meeting.

use std::f64::consts::TAU;

use fantex_base::{Random, Result};
use fantex_mesh::generate::{book, grid, icosphere, torus, uv_sphere};
use fantex_mesh::{
    CleanOptions, Material, Mesh, Model, OpposedTriangles, Topology, TriangleBvh, VertexCorners, clean,
};
use fantex_test::{cleaned, data_folder, loaded};
use glam::{DVec3, Vec3};

fn simplified(mesh: &Mesh, triangles: usize) -> Result<Mesh> {
    Ok(clean(fantex_mesh::simplified(mesh, triangles)?, &CleanOptions::default())?.0)
}

/// The farthest that middles of triangles and vertices of one mesh are from another, world units.
fn farthest(from: &Mesh, to: &Mesh) -> f64 {
    let bvh = TriangleBvh::new(to);
    let middles =
        from.triangles.iter().map(|t| t.map(|v| from.positions[v as usize]).into_iter().sum::<Vec3>() / 3.0);
    let points = middles.chain(from.positions.iter().copied());
    let distance = |p: Vec3| {
        let p = to.world_from_mesh.inverse_point(from.world_from_mesh.point(p));
        f64::from(bvh.nearest_point(p, f32::INFINITY).unwrap().distance) * to.world_from_mesh.scale
    };
    points.map(distance).fold(0.0, f64::max)
}

fn topology(mesh: &Mesh) -> Topology {
    Topology::of(&mesh.triangles, &VertexCorners::of(&mesh.triangles, mesh.positions.len()))
}

#[test]
fn a_ball_stays_round_and_closed() {
    let ball = cleaned(icosphere(5));
    assert_eq!(ball.triangles.len(), 20480);
    for wanted in [5000, 1000, 200] {
        let coarse = simplified(&ball, wanted).unwrap();
        let count = coarse.triangles.len();
        assert!(count <= wanted && count * 10 > wanted * 9, "{count} of {wanted}");
        let topology = topology(&coarse);
        assert_eq!((topology.edges_boundary, topology.edges_non_manifold), (0, 0), "{wanted}");
        // A chord of a sphere that `wanted` equal triangles make is so far inside.
        let edge_squared = 4.0 * TAU / 2.0 / wanted as f64 * 4.0 / 3f64.sqrt();
        let sagitta = edge_squared / 6.0;
        let distance = farthest(&coarse, &ball);
        assert!(distance < 5.0 * sagitta, "{wanted}: {distance} of {sagitta}");
        // Vertices are those that the ball has.
        let radii = coarse.positions.iter().map(|&p| coarse.world_from_mesh.point(p).length());
        assert!(radii.into_iter().all(|r| (r - 1.0).abs() < 1e-6));
    }
}

#[test]
fn flat_parts_need_few_triangles_and_keep_their_rim() {
    let coarse = simplified(&cleaned(grid(100)), 8).unwrap();
    assert!(coarse.triangles.len() <= 8, "{}", coarse.triangles.len());
    let fine = cleaned(grid(100));
    let scale = |mesh: &Mesh| mesh.area() * mesh.world_from_mesh.scale.powi(2);
    assert!((scale(&coarse) / scale(&fine) - 1.0).abs() < 1e-6);
}

/// World units squared.
fn world_area(mesh: &Mesh) -> f64 {
    mesh.area() * mesh.world_from_mesh.scale.powi(2)
}

fn opposed(mesh: &Mesh) -> usize {
    let opposed = OpposedTriangles::of(&mesh.triangles);
    (0..mesh.triangles.len()).filter(|&t| opposed.contains(t)).count()
}

/// A sheet over the unit square, waving by `bend`, with a back.
fn flag(n: u32, bend: f64) -> Model {
    let mut model = grid(n);
    let low = model.positions.iter().copied().reduce(DVec3::min).unwrap();
    let high = model.positions.iter().copied().reduce(DVec3::max).unwrap();
    let (low, size) = (low, high - low);
    let flat = if size.y < size.z { 1 } else { 2 };
    for p in &mut model.positions {
        let q = *p - low;
        let (x, y) = (q.x / size.x, if flat == 1 { q.z / size.z } else { q.y / size.y });
        *p = DVec3::new(x, y, bend * (TAU * x).sin() * (1.0 + y));
    }
    let backs: Vec<_> = model.triangles.iter().map(|&[a, b, c]| [b, a, c]).collect();
    model.triangles.extend(backs);
    model
}

#[test]
fn sheets_with_backs_keep_their_rim() {
    for (bend, wanted, max_loss, max_distance) in
        [(0.0, 200, 1e-6, 1e-6), (0.05, 200, 0.003, 0.008), (0.05, 60, 0.02, 0.03)]
    {
        let fine = cleaned(flag(29, bend));
        assert_eq!((fine.triangles.len(), opposed(&fine)), (3364, 3364));
        let coarse = simplified(&fine, wanted).unwrap();
        let count = coarse.triangles.len();
        assert_eq!(opposed(&coarse), count, "fronts and backs differ");
        assert!(count <= wanted && (bend == 0.0 || count * 10 > wanted * 9), "{count} of {wanted}");
        let loss = 1.0 - world_area(&coarse) / world_area(&fine);
        let [away, missing] = [farthest(&coarse, &fine), farthest(&fine, &coarse)];
        println!(
            "bend {bend}: {count} triangles, loss of area {loss:.6}, {away:.5} away, {missing:.5} missing"
        );
        assert!(loss.abs() <= max_loss, "bend {bend}: {loss}");
        assert!(away.max(missing) <= max_distance, "bend {bend}: {away} {missing}");
    }
}

/// Some triangles of a ball have backs, so that both kinds meet along a closed line; and a flag touches it.
#[test]
fn sheets_with_backs_go_on_meeting_what_has_none() {
    let mut model = icosphere(5);
    let middle_height = |t: &[u32; 3]| t.map(|v| model.positions[v as usize].y).iter().sum::<f64>() / 3.0;
    let backs: Vec<_> =
        model.triangles.iter().filter(|t| middle_height(t) > 0.5).map(|&[a, b, c]| [b, a, c]).collect();
    let with_backs = backs.len();
    model.triangles.extend(backs);
    let fine = cleaned(model);
    assert_eq!(opposed(&fine), 2 * with_backs);
    let wanted = 3000;
    let coarse = simplified(&fine, wanted).unwrap();
    let count = coarse.triangles.len();
    assert!(count.abs_diff(wanted) * 10 < wanted, "{count} of {wanted}");
    let share = opposed(&coarse) as f64 / count as f64;
    let loss = 1.0 - world_area(&coarse) / world_area(&fine);
    println!("{count} triangles, {share:.3} opposed, loss of area {loss:.5}");
    assert!((0.3..0.5).contains(&share), "{share}");
    assert!(loss.abs() < 0.01, "{loss}");
    // Without the backs it is a closed ball again.
    let opposed = OpposedTriangles::of(&coarse.triangles);
    let mut seen = std::collections::HashSet::new();
    let outside = coarse.triangles.iter().enumerate().filter(|&(t, triangle)| {
        let mut key = *triangle;
        key.sort_unstable();
        !opposed.contains(t) || seen.insert(key)
    });
    let outside: Vec<[u32; 3]> = outside.map(|(_, &triangle)| triangle).collect();
    let mut edges = std::collections::HashMap::new();
    for triangle in &outside {
        for k in 0..3 {
            let mut ends = [triangle[k], triangle[(k + 1) % 3]];
            ends.sort_unstable();
            *edges.entry(ends).or_insert(0) += 1;
        }
    }
    assert!(edges.values().all(|&count| count == 2), "cracks where backs begin");
    assert!(farthest(&fine, &coarse) < 0.02);
}

#[test]
fn materials_go_on_meeting() {
    let mut model = torus(96, 48);
    model.materials =
        ["a", "b", "c"].map(|name| Material { name: name.into(), ..Material::default() }).to_vec();
    model.triangle_materials = (0..model.triangles.len())
        .map(|t| {
            let middle: DVec3 = model.triangles[t].map(|v| model.positions[v as usize]).into_iter().sum();
            if middle.y > 0.3 { 2 } else { u32::from(middle.x > 0.0) }
        })
        .collect();
    let (fine, _) = clean(model, &CleanOptions::default()).unwrap();
    let coarse = simplified(&fine, 1500).unwrap();
    assert!(coarse.triangles.len() < 2500, "{}", coarse.triangles.len());
    assert_eq!(topology(&coarse).edges_boundary, 0, "cracks between materials");
    let share = |mesh: &Mesh, material: usize| {
        let own = (0..mesh.triangles.len()).filter(|&t| mesh.material_of(t) == material);
        own.map(|t| mesh.triangle_area(t)).sum::<f64>() / mesh.area()
    };
    for material in 0..3 {
        assert_eq!(coarse.materials[material].name, fine.materials[material].name);
        assert!((share(&coarse, material) - share(&fine, material)).abs() < 0.02);
    }
}

#[test]
fn loose_and_non_manifold_pieces_get_fewer_too() {
    // Ten thousand loose triangles: nothing can collapse within any of them.
    let corner = |i: u64, k: u64| {
        let at = |n: u64| (i * 7919 + n * 104_729).wrapping_mul(2_654_435_761) % 1000;
        let base = DVec3::new(at(1) as f64, at(2) as f64, at(3) as f64);
        base + DVec3::new((k == 1) as u8 as f64, (k == 2) as u8 as f64, 0.0)
    };
    let positions: Vec<DVec3> = (0..10_000).flat_map(|i| (0..3).map(move |k| corner(i, k))).collect();
    let triangles = (0..10_000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let loose =
        cleaned(Model { positions, triangles, materials: vec![Material::default()], ..Model::default() });
    let pages = cleaned(book(200));
    for (mesh, wanted) in [(&loose, 1000), (&pages, 100)] {
        let coarse = simplified(mesh, wanted);
        let count = coarse.map_or(0, |mesh| mesh.triangles.len());
        assert!(count <= 2 * wanted, "{count} of {wanted}");
    }
}

#[test]
fn triangles_at_hubs_stay_or_go_into_the_grid() {
    // A disc around a hub, beside a ball.
    let (mut model, n) = (icosphere(3), 4100);
    let hub = model.positions.len() as u32;
    let rim = (0..n).map(|i| (TAU * f64::from(i) / f64::from(n)).sin_cos());
    model.positions.extend([DVec3::X * 3.0]);
    model.positions.extend(rim.map(|(sin, cos)| DVec3::new(3.0 + cos, sin, 0.0)));
    model.triangles.extend((0..n).map(|i| [hub, hub + 1 + i, hub + 1 + (i + 1) % n]));
    let coarse = simplified(&cleaned(model), 4600).unwrap();
    assert!((4400..=4700).contains(&coarse.triangles.len()), "{}", coarse.triangles.len());
    let corners = VertexCorners::of(&coarse.triangles, coarse.positions.len());
    let hubs = (0..coarse.positions.len()).filter(|&v| corners.at(v).len() == n as usize).count();
    assert_eq!(hubs, 1);
    let count = simplified(&cleaned(uv_sphere(4100, 2)), 1000).unwrap().triangles.len();
    assert!((100..=2000).contains(&count), "{count}");
}

#[test]
fn a_mesh_with_no_more_triangles_keeps_them_all() {
    let mesh = cleaned(icosphere(1));
    let same = simplified(&mesh, 1000).unwrap();
    assert_eq!((same.triangles.len(), same.positions.len()), (mesh.triangles.len(), mesh.positions.len()));
}

#[test]
fn scans_keep_their_shape() {
    let Some(folder) = data_folder() else { return };
    let bunny = loaded(&folder, "meshes/bunny/stanford_bunny.ply");
    let coarse = simplified(&bunny, 5000).unwrap();
    let count = coarse.triangles.len();
    assert!((4000..=5000).contains(&count), "{count}");
    let size = bunny.bounds().max - bunny.bounds().min;
    let diagonal = f64::from(size.length()) * bunny.world_from_mesh.scale;
    let distance = farthest(&coarse, &bunny) / diagonal;
    println!("{distance:.5} of the diagonal");
    assert!(distance < 0.01, "{distance}");
}

/// A noisy ball with holes all over, in which few edges may collapse in the end.
#[test]
fn a_scan_with_holes_never_vanishes() {
    let mut model = icosphere(5);
    let mut random = Random::new(11);
    for p in &mut model.positions {
        *p *= 1.0 + 0.02 * (random.unit() - 0.5);
    }
    model.triangles.retain(|_| random.unit() > 0.03);
    let fine = cleaned(model);
    for wanted in [8000, 2000, 500, 100, 20] {
        let coarse = simplified(&fine, wanted).unwrap();
        let count = coarse.triangles.len();
        assert!((wanted / 4..=2 * wanted).contains(&count), "{count} of {wanted}");
        let distance = farthest(&fine, &coarse);
        assert!(distance < 8.0 / (wanted as f64).sqrt(), "{wanted}: {distance}");
    }
}
