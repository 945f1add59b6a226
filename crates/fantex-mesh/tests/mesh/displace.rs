//! Displacement: no cracks on real meshes, and area and volume of displaced spheres against closed forms.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use fantex_base::ErrorKind;
use fantex_mesh::{
    CornerAttributes, DisplaceOptions, DisplacePoint, Mesh, Model, ObjectSpace, Refinement, Topology,
    VertexCorners, displace, generate, refine_at_bends, shading_normals,
};
use fantex_test::{cleaned, loaded};
use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::common::data_folder;

fn topology(mesh: &Mesh) -> Topology {
    Topology::of(&mesh.triangles, &VertexCorners::of(&mesh.triangles, mesh.positions.len()))
}

fn uniform(longest_edge: f32) -> DisplaceOptions {
    DisplaceOptions { refinement: Refinement::Uniform { longest_edge }, ..DisplaceOptions::default() }
}

fn adaptive(longest_edge: f32, shortest_edge: f32, tolerance: f32) -> DisplaceOptions {
    let refinement = Refinement::Adaptive { longest_edge, shortest_edge, tolerance };
    DisplaceOptions { refinement, ..DisplaceOptions::default() }
}

fn waves(p: Vec3, k: f32) -> f32 {
    (k * p.x).sin() * (1.3 * k * p.y + 1.0).sin() * (0.7 * k * p.z + 2.0).sin()
}

/// Volume in world units, by the divergence theorem.
fn volume(mesh: &Mesh) -> f64 {
    let of = |t: usize| {
        let [a, b, c] = mesh.triangle_positions(t).map(|p| p.as_dvec3());
        a.dot(b.cross(c)) / 6.0
    };
    (0..mesh.triangles.len()).map(of).sum::<f64>() * mesh.world_from_mesh.scale.powi(3)
}

fn area(mesh: &Mesh) -> f64 {
    mesh.area() * mesh.world_from_mesh.scale.powi(2)
}

/// Boundary edges may be cut, but there are no new ones: they form as many vertices as edges, and nothing else changes.
fn assert_no_cracks(name: &str, before: &Mesh, after: &Mesh) {
    let (old, new) = (topology(before), topology(after));
    assert_eq!(new.euler_characteristic(), old.euler_characteristic(), "{name}");
    assert_eq!(
        (new.components, new.edges_non_manifold >= old.edges_non_manifold, new.edges_inconsistent),
        (old.components, true, old.edges_inconsistent),
        "{name}"
    );
    assert_eq!(old.edges_boundary == 0, new.edges_boundary == 0, "{name}");
    assert_eq!(3 * new.triangles, 2 * new.edges - new.edges_boundary, "{name}: no edge of more than two");
    // Every boundary vertex of the result has as many boundary edges as it must: they form the same closed loops.
    assert_eq!(boundary_loops(after), boundary_loops(before), "{name}");
}

/// Number of connected pieces of the boundary.
fn boundary_loops(mesh: &Mesh) -> usize {
    let mut count: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            *count.entry([a.min(b), a.max(b)]).or_default() += 1;
        }
    }
    let mut parent: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    let boundary: Vec<[u32; 2]> = count.iter().filter(|(_, n)| **n == 1).map(|(e, _)| *e).collect();
    for [a, b] in &boundary {
        let (a, b) = (root(&mut parent, *a), root(&mut parent, *b));
        parent[a as usize] = b;
    }
    let mut roots: Vec<u32> = boundary.iter().map(|e| root(&mut parent, e[0])).collect();
    roots.sort_unstable();
    roots.dedup();
    roots.len()
}

fn longest_edge(mesh: &Mesh) -> f32 {
    let of = |t: usize| {
        let [a, b, c] = mesh.triangle_positions(t);
        a.distance(b).max(b.distance(c)).max(c.distance(a))
    };
    (0..mesh.triangles.len()).map(of).fold(0.0, f32::max)
}

#[test]
fn real_meshes_stay_without_cracks() {
    let Some(folder) = data_folder() else { return };
    for (name, fine) in [
        ("bunny/stanford_bunny.ply", 0.012),
        ("suzanne.ply", 0.03),
        ("spot/spot_triangulated.obj", 0.03),
        ("WaterBottle/WaterBottle.gltf", 0.03),
        ("mengerSponge3.glb", 0.1),
    ] {
        let mesh = loaded(&folder.join("meshes"), name);
        let height = |p: &DisplacePoint| 0.01 * waves(p.position, 40.0);
        let (even, report) = displace(&mesh, &uniform(fine), height).unwrap();
        eprintln!(
            "{name}: {} -> {} triangles in {} rounds, cleaned {:?}",
            mesh.triangles.len(),
            even.triangles.len(),
            report.rounds,
            report.clean.lines()
        );
        assert!(even.triangles.len() > mesh.triangles.len());
        assert_no_cracks(name, &mesh, &even);
        // Waves of slope up to one make edges longer by half at most.
        let scale = (even.world_from_mesh.scale / mesh.world_from_mesh.scale) as f32;
        assert!(longest_edge(&even) * scale < 1.6 * fine, "{name}");
        let (lean, _) = displace(&mesh, &adaptive(0.2, fine / 2.0, 0.001), height).unwrap();
        eprintln!("{name}: adaptive {}", lean.triangles.len());
        assert_no_cracks(name, &mesh, &lean);
        let kept = (lean.triangles.len(), lean.corners.normals.len(), lean.corners.uv_sets.len());
        assert_eq!(kept, (lean.triangles.len(), 3 * lean.triangles.len(), mesh.corners.uv_sets.len()));
    }
}

/// Heights that jump at texture seams and differ from triangle to triangle are averaged, not torn apart.
#[test]
fn heights_that_disagree_do_not_tear_the_surface() {
    let Some(folder) = data_folder() else { return };
    let mesh = loaded(&folder.join("meshes"), "WaterBottle/WaterBottle.gltf");
    let uv = &mesh.corners.uv_sets[0];
    let by_uv = |p: &DisplacePoint| {
        let at = |k: usize| uv[3 * p.at.index() + k] * p.at.lambda[k];
        0.02 * (at(0) + at(1) + at(2)).x.fract()
    };
    let (bumpy, _) = displace(&mesh, &uniform(0.05), by_uv).unwrap();
    assert_no_cracks("by texture coordinates", &mesh, &bumpy);
    let by_triangle = |p: &DisplacePoint| if p.at.triangle.is_multiple_of(2) { 0.0 } else { 0.01 };
    let (jagged, _) = displace(&mesh, &adaptive(0.3, 0.02, 0.001), by_triangle).unwrap();
    assert_no_cracks("by triangle", &mesh, &jagged);
}

/// Heights count from where the surface was, not from the middle of what became of it.
#[test]
fn displaced_meshes_keep_their_object_space() {
    let mut model = generate::grid(8);
    model.positions.iter_mut().for_each(|p| *p += glam::DVec3::new(70.3, -4.1, 900.7));
    let plane = cleaned(model);
    let hill = |p: &DisplacePoint| 0.4 * (1.0 - p.position.length_squared()).max(0.0);
    let once = displace(&plane, &uniform(0.05), hill).unwrap().0;
    let twice = displace(&once, &uniform(0.05), |_| 0.1).unwrap().0;
    for displaced in [&once, &twice] {
        let [space, before] = [displaced, &plane].map(ObjectSpace::of);
        let origins = [(displaced, space), (&plane, before)]
            .map(|(mesh, space)| mesh.world_from_mesh.point(space.origin_mesh()));
        assert!(origins[0].distance(origins[1]) < 1e-5, "{origins:?}");
        let [a, b] = [space, before].map(|space| space.bounds());
        assert!(a.min.distance(b.min) + a.max.distance(b.max) < 1e-5, "{a:?} {b:?}");
    }
}

#[test]
fn displaced_spheres_have_the_area_and_volume_of_their_formulas() {
    let sphere = cleaned(generate::icosphere(5));
    let flat_error = 4.0 * PI / 3.0 / volume(&sphere);
    // A larger sphere.
    let (larger, report) = displace(&sphere, &uniform(0.05), |_| 0.25).unwrap();
    assert_eq!(report.clean.topology.genus(), Some(0));
    let error = volume(&larger) * flat_error / (4.0 / 3.0 * PI * 1.25_f64.powi(3)) - 1.0;
    assert!(error.abs() < 1e-3, "{error}");
    assert!((area(&larger) / (4.0 * PI * 1.25_f64.powi(2)) - 1.0).abs() < 2e-3);
    // r = 1 + e P2(cos): the mean of P2^2 is 1/5, that of P2^3 is 2/35.
    let e = 0.4;
    let pear = |p: &DisplacePoint| {
        let z = p.normal.z;
        e as f32 * (1.5 * z * z - 0.5)
    };
    let expected = 4.0 / 3.0 * PI * (1.0 + 3.0 * e * e / 5.0 + e * e * e * 2.0 / 35.0);
    for options in [uniform(0.03), adaptive(0.2, 0.01, 0.0005)] {
        let (displaced, _) = displace(&sphere, &options, pear).unwrap();
        let error = volume(&displaced) * flat_error / expected - 1.0;
        assert!(error.abs() < 2e-3, "{error}");
        // Normals are those of the new surface: r n = (1 + e P2) u - e P2' (z - (z u) u).
        let mut largest = 0.0_f32;
        for (corner, &normal) in displaced.corners.normals.iter().enumerate() {
            let p = displaced.positions[displaced.triangles[corner / 3][corner % 3] as usize];
            let u = (p.as_dvec3() * displaced.world_from_mesh.scale).normalize();
            let z = u.z;
            let (r, dr) = (1.0 + e * (1.5 * z * z - 0.5), e * 3.0 * z);
            let exact = (r * u - dr * (glam::DVec3::Z - z * u)).normalize();
            largest = largest.max(normal.angle_between(exact.as_vec3()));
        }
        assert!(largest < 0.06, "{largest}");
    }
}

#[test]
fn adaptive_cutting_spends_triangles_where_the_surface_bends() {
    let mesh = cleaned(generate::grid(4));
    // A single bump in the middle.
    let bump = |p: &DisplacePoint| 0.3 * (-40.0 * p.position.length_squared()).exp();
    let even = displace(&mesh, &uniform(0.02), bump).unwrap().0;
    let lean = displace(&mesh, &adaptive(0.1, 0.01, 0.001), bump).unwrap().0;
    assert!(
        4 * lean.triangles.len() < even.triangles.len(),
        "{} {}",
        lean.triangles.len(),
        even.triangles.len()
    );
    assert_no_cracks("bump", &mesh, &lean);
    // The piecewise flat surface is near the true one everywhere, not only at its vertices.
    let deviation = |mesh: &Mesh| {
        let scale = mesh.world_from_mesh.scale as f32;
        let offset = mesh.world_from_mesh.offset.as_vec3();
        let mut largest = 0.0_f32;
        for t in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.triangle_positions(t).map(|p| p * scale + offset);
            let middle = (a + b + c) / 3.0;
            let flat = Vec3::new(middle.x, 0.0, middle.z);
            largest = largest.max((middle.y - 0.3 * (-40.0 * flat.length_squared()).exp()).abs());
        }
        largest
    };
    assert!(deviation(&lean) < 0.003, "{}", deviation(&lean));
}

#[test]
fn attributes_follow_their_triangles() {
    let mut model = generate::grid(1);
    let at = |model: &Model, c: usize| model.positions[model.triangles[c / 3][c % 3] as usize].as_vec3();
    let corners: Vec<Vec3> = (0..6).map(|c| at(&model, c)).collect();
    // Linear in the position, with a jump between the two triangles.
    let jump = |c: usize| if c < 3 { 0.0 } else { 10.0 };
    model.corners.uv_sets =
        vec![corners.iter().enumerate().map(|(c, p)| Vec2::new(p.x + jump(c), p.z)).collect()];
    model.corners.colors = corners.iter().map(|p| Vec4::new(p.x, p.z, 0.5, 1.0)).collect();
    model.triangle_materials = vec![0, 1];
    model.materials = vec![Default::default(), Default::default()];
    let mesh = cleaned(model);
    let (fine, _) = displace(&mesh, &uniform(0.1), |_| 0.0).unwrap();
    assert!(fine.triangles.len() > 500);
    for c in 0..3 * fine.triangles.len() {
        let p = fine.positions[fine.triangles[c / 3][c % 3] as usize] * fine.world_from_mesh.scale as f32;
        let jump = if fine.triangle_materials[c / 3] == 0 { 0.0 } else { 10.0 };
        assert!(fine.corners.uv_sets[0][c].distance(Vec2::new(p.x + jump, p.z)) < 1e-5);
        assert!(fine.corners.colors[c].distance(Vec4::new(p.x, p.z, 0.5, 1.0)) < 1e-5);
        assert!(fine.corners.normals[c].distance(Vec3::Y) < 1e-6);
    }
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let mesh = cleaned(generate::torus(40, 20));
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let height = |p: &DisplacePoint| 0.02 * waves(p.position, 30.0);
        pool.install(|| displace(&mesh, &adaptive(0.1, 0.01, 0.001), height).unwrap().0)
    };
    assert!(on(1) == on(3));
}

#[test]
fn what_cannot_be_done_is_refused() {
    let mesh = cleaned(generate::icosphere(1));
    let refused = |options: DisplaceOptions, height: f32, kind: ErrorKind, what: &str| {
        let error = displace(&mesh, &options, |_| height).unwrap_err();
        assert_eq!(error.kind(), kind);
        assert!(error.to_string().contains(what), "{error}");
    };
    let limited = DisplaceOptions { max_triangles: 10_000, ..uniform(1e-5) };
    refused(limited, 0.0, ErrorKind::TooLarge, "max_triangles is 10000");
    refused(uniform(0.5), f32::NAN, ErrorKind::InvalidArgument, "the height on triangle");
    let out_of_range = [
        uniform(0.0),
        uniform(f32::NAN),
        adaptive(0.1, 0.2, 0.1),
        adaptive(0.1, 0.05, 0.0),
        DisplaceOptions { crease_degrees: 181.0, ..uniform(0.1) },
    ];
    for options in out_of_range {
        refused(options, 0.0, ErrorKind::InvalidArgument, "but must be");
    }
    // All points meet in the centre.
    let sphere = cleaned(generate::uv_sphere(8, 4));
    let to_centre = |p: &DisplacePoint| -p.position.dot(p.normal);
    let collapsed = displace(&sphere, &uniform(4.0), |p| 2.0 * to_centre(p));
    let collapsed_kind = collapsed.as_ref().err().map(|error| error.kind());
    assert!(
        collapsed.is_ok_and(|(mesh, _)| !mesh.triangles.is_empty())
            || collapsed_kind == Some(ErrorKind::Malformed)
    );
}

#[test]
fn a_refined_mesh_is_the_same_surface_in_smaller_triangles() {
    let mut mesh = cleaned(generate::icosphere(1));
    let corners = 3 * mesh.triangles.len();
    mesh.corners.uv_sets =
        vec![mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize].truncate()).collect()];
    mesh.corners.tangents = vec![Vec4::new(0.6, 0.8, 0.0, -1.0); corners];
    mesh.triangle_materials = (0..mesh.triangles.len() as u32).map(|t| t % 3).collect();
    let refined = refine_at_bends(&mesh, 0.2, 100_000).unwrap();
    assert!(refined.triangles.len() > 4 * mesh.triangles.len());
    assert!((refined.area() / mesh.area() - 1.0).abs() < 1e-5);
    assert_no_cracks("refined", &mesh, &refined);
    let shaded = shading_normals(&mesh);
    for (t, triangle) in refined.triangles.iter().enumerate() {
        let p = refined.triangle_positions(t);
        assert!((0..3).all(|k| p[k].distance(p[(k + 1) % 3]) <= 0.2));
        for k in 0..3 {
            let corner = 3 * t + k;
            assert!((refined.corners.uv_sets[0][corner] - p[k].truncate()).length() < 1e-6);
            let tangent = refined.corners.tangents[corner];
            assert!((tangent - Vec4::new(0.6, 0.8, 0.0, -1.0)).length() < 1e-6);
            // Shading is that of the whole triangles: a vertex of theirs keeps its normal, not that of its smaller fan.
            if let Some(whole) = mesh.triangles.iter().flatten().position(|&v| v == triangle[k]) {
                assert!((refined.corners.normals[corner] - shaded[whole]).length() < 1e-5);
            }
        }
    }
    assert_eq!(refined.triangle_materials.iter().copied().max(), Some(2));
    assert_eq!(refine_at_bends(&mesh, 10.0, 100_000).unwrap().triangles, mesh.triangles);
    assert!(refine_at_bends(&mesh, 0.01, 1000).is_err() && refine_at_bends(&mesh, 0.0, 1000).is_err());
}

/// Two boxes stand against each other, one twice as high: two edges of each have the same middles.
#[test]
fn parts_that_touch_along_their_edges_are_cut_apart() {
    let mut model = generate::cube(1);
    model.corners = CornerAttributes::default();
    let low = model.positions.iter().copied().fold(DVec3::MAX, DVec3::min);
    let high = model.positions.iter().copied().fold(DVec3::MIN, DVec3::max);
    let stretched = DVec3::new(1.0, 2.0, 1.0);
    let tower =
        |p: &DVec3| DVec3::X * (high - low).x + 0.5 * (low + high) + (*p - 0.5 * (low + high)) * stretched;
    let towers: Vec<DVec3> = model.positions.iter().map(tower).collect();
    let triangles: Vec<[u32; 3]> =
        model.triangles.iter().map(|t| t.map(|v| v + towers.len() as u32)).collect();
    model.positions.extend(towers);
    model.triangles.extend(triangles);
    let mut mesh = cleaned(model);
    mesh.corners.uv_sets =
        vec![mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize].truncate()).collect()];
    let refined = refine_at_bends(&mesh, 0.2, 100_000).unwrap();
    assert!(refined.triangles.len() > 10 * mesh.triangles.len());
    assert!((refined.area() / mesh.area() - 1.0).abs() < 1e-5);
    assert_no_cracks("towers", &mesh, &refined);
    let mut places: Vec<[u32; 3]> =
        refined.positions.iter().map(|p| p.to_array().map(f32::to_bits)).collect();
    places.sort_unstable();
    places.dedup();
    assert_eq!(places.len(), refined.positions.len());
    for (corner, &vertex) in refined.triangles.iter().flatten().enumerate() {
        let uv = refined.positions[vertex as usize].truncate();
        assert!((refined.corners.uv_sets[0][corner] - uv).length() < 1e-6);
    }
}

#[test]
fn flat_faces_are_cut_only_beside_their_edges() {
    let mesh = cleaned(generate::cube(1));
    let refined = refine_at_bends(&mesh, 0.1, 100_000).unwrap();
    assert_no_cracks("cube", &mesh, &refined);
    assert!((refined.area() / mesh.area() - 1.0).abs() < 1e-5);
    let half = mesh.positions.iter().map(|p| p.abs().max_element()).fold(0.0, f32::max);
    let is_at_edge = |p: Vec3| p.abs().to_array().iter().filter(|x| (**x - half).abs() < 1e-6).count() > 1;
    let mut longest = 0.0_f32;
    for t in 0..refined.triangles.len() {
        let p = refined.triangle_positions(t);
        for k in 0..3 {
            let (a, b) = (p[k], p[(k + 1) % 3]);
            longest = longest.max(a.distance(b));
            assert!(a.distance(b) <= 0.1 || !is_at_edge(a) && !is_at_edge(b));
        }
    }
    assert!(longest > 0.2, "the middle of a face keeps large triangles, not {longest}");
}
