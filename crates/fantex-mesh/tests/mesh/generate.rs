//! Shapes and landscapes: of known topology, and nothing for cleaning to do.

use std::collections::HashMap;

use fantex_base::{ErrorKind, ReadLimits, ReadOptions};
use fantex_mesh::generate::*;
use fantex_mesh::{CleanOptions, MAX_FAN_TRIANGLES, clean};

#[test]
fn shapes_are_closed_oriented_outward_and_of_the_right_genus() {
    let shapes = [(uv_sphere(12, 7), 0), (icosphere(2), 0), (cube(1), 0), (cube(5), 0), (torus(9, 5), 1)];
    for (shape, genus) in shapes {
        let volume: f64 = shape
            .triangles
            .iter()
            .map(|t| t.map(|v| shape.positions[v as usize]))
            .map(|[a, b, c]| a.dot(b.cross(c)))
            .sum();
        let name = shape.name.clone();
        assert!(volume > 0.0, "{name}");
        let (mesh, report) = clean(shape, &CleanOptions::default()).unwrap();
        assert_eq!(report.lines(), Vec::<String>::new(), "{name}");
        assert_eq!(report.topology.genus(), Some(genus), "{name}");
        assert_eq!(mesh.triangles.len() as u64, report.triangles_in);
    }
}

#[test]
fn a_book_has_one_edge_with_all_its_pages() {
    let (_, report) = clean(book(5), &CleanOptions::default()).unwrap();
    assert_eq!((report.topology.edges_non_manifold, report.topology.edges_boundary), (1, 10));
    let (_, report) = clean(grid(3), &CleanOptions::default()).unwrap();
    assert_eq!((report.topology.euler_characteristic(), report.topology.edges_boundary), (1, 12));
}

fn small(seed: u64) -> LandscapeOptions {
    LandscapeOptions { triangles: 40_000, seed, ..LandscapeOptions::default() }
}

#[test]
fn a_landscape_is_one_watertight_oriented_solid_of_the_size_asked_for() {
    for seed in 0..4 {
        let land = landscape(&small(seed)).unwrap();
        let count = land.triangles.len() as f32;
        assert!((count / 40_000.0 - 1.0).abs() < 0.1, "seed {seed}: {count} triangles");
        let mut half_edges = HashMap::new();
        for [a, b, c] in &land.triangles {
            for edge in [(a, b), (b, c), (c, a)] {
                *half_edges.entry(edge).or_insert(0) += 1;
            }
        }
        assert!(half_edges.iter().all(|(&(a, b), &n)| n == 1 && half_edges.get(&(b, a)) == Some(&1)));
        let volume: f64 = land
            .triangles
            .iter()
            .map(|t| t.map(|v| land.positions[v as usize].as_dvec3()))
            .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
            .sum();
        assert!(volume > 1e7, "seed {seed}: {volume} cubic metres");
        let euler = land.positions.len() as i64 - half_edges.len() as i64 / 2 + land.triangles.len() as i64;
        assert_eq!(euler, 2 - 2 * land.genus as i64);
        assert_eq!(land.components, 1);
        assert!(land.genus >= 2, "seed {seed}: genus {}", land.genus);
    }
}

#[test]
fn nothing_is_left_for_cleaning_to_do() {
    let land = landscape(&LandscapeOptions { irregularity: 1.0, ..small(3) }).unwrap();
    let (genus, count) = (land.genus, land.triangles.len());
    let (mesh, report) = clean(land.into(), &CleanOptions::default()).unwrap();
    assert_eq!(report.lines(), Vec::<String>::new());
    assert_eq!((report.topology.genus(), mesh.triangles.len()), (Some(genus), count));
}

#[test]
fn the_ground_overhangs() {
    let land = landscape(&small(2)).unwrap();
    let facing_down = land.triangles.iter().filter(|t| {
        let [a, b, c] = t.map(|v| land.positions[v as usize]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        normal.y < -0.2 && a.y > -15.0
    });
    assert!(facing_down.count() > 100);
}

#[test]
fn odd_wishes_are_met_as_far_as_possible() {
    let plain = LandscapeOptions { triangles: 3000, ..LandscapeOptions::default() };
    for options in [
        LandscapeOptions { triangles: 0, ..plain },
        LandscapeOptions { size: 1e-3, irregularity: f32::INFINITY, ..plain },
        LandscapeOptions { irregularity: f32::NAN, ..plain },
        LandscapeOptions { size: 1e9, seed: u64::MAX, ..plain },
        LandscapeOptions { tunnels: 1000, arches: 1000, ..plain },
    ] {
        let land = landscape(&options).unwrap();
        assert!((500..6000).contains(&land.triangles.len()), "{options:?}: {}", land.triangles.len());
        assert_eq!(land.components, 1);
    }
}

#[test]
fn landscapes_beyond_the_limits_are_refused_before_they_are_made() {
    let of = |triangles| landscape(&LandscapeOptions { triangles, ..LandscapeOptions::default() });
    for triangles in [MAX_FAN_TRIANGLES as u64 + 1, u64::MAX] {
        let error = of(triangles).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::TooLarge);
        assert!(error.to_string().contains(&format!("at most {MAX_FAN_TRIANGLES} are supported")), "{error}");
    }
    let limits = ReadLimits::new(ReadOptions { memory_bytes: 1 << 20, ..ReadOptions::default() });
    let error = limits.run(|| of(20_000)).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::TooLarge);
    assert!(error.to_string().contains("a landscape of 20000 triangles would take 2 MiB"), "{error}");
    limits.run(|| of(8000)).unwrap();
    assert_eq!(limits.memory_left(), 1 << 20);
}

#[test]
fn threads_do_not_matter() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| landscape(&LandscapeOptions { triangles: 8000, ..small(5) }).unwrap())
    };
    assert_eq!(on(1), on(5));
}
