use std::collections::HashMap;

use super::*;

fn small(seed: u64) -> LandscapeOptions {
    LandscapeOptions { triangles: 40_000, seed, ..LandscapeOptions::default() }
}

#[test]
fn a_landscape_is_one_watertight_oriented_solid_of_the_size_asked_for() {
    for seed in 0..4 {
        let land = landscape(&small(seed));
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
    let land = landscape(&LandscapeOptions { irregularity: 1.0, ..small(3) });
    let (genus, count) = (land.genus, land.triangles.len());
    let (mesh, report) = crate::clean(land.into(), &crate::CleanOptions::default()).unwrap();
    assert_eq!(report.lines(), Vec::<String>::new());
    assert_eq!((report.topology.genus(), mesh.triangles.len()), (Some(genus), count));
}

#[test]
fn tunnels_and_arches_are_built_and_add_handles() {
    let with = World::new(&small(1), 6.0);
    let without = World::new(&LandscapeOptions { tunnels: 0, arches: 0, ..small(1) }, 6.0);
    assert!(with.density.tunnels.len() >= 2 && !with.density.arches.is_empty());
    let genus = |world: World| {
        let surface = world.surface();
        world.finish(surface, &small(1)).genus
    };
    let tubes = (with.density.tunnels.len() + with.density.arches.len()) as u64;
    let (with, without) = (genus(with), genus(without));
    assert!(with >= without + tubes / 2, "{without} handles, {with} with {tubes} tubes");
}

#[test]
fn the_ground_overhangs() {
    let land = landscape(&small(2));
    let facing_down = land.triangles.iter().filter(|t| {
        let [a, b, c] = t.map(|v| land.positions[v as usize]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        normal.y < -0.2 && a.y > FLOOR + 15.0
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
        let land = landscape(&options);
        assert!((500..6000).contains(&land.triangles.len()), "{options:?}: {}", land.triangles.len());
        assert_eq!(land.components, 1);
    }
}

#[test]
fn threads_do_not_matter() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| landscape(&LandscapeOptions { triangles: 8000, ..small(5) }))
    };
    assert_eq!(on(1), on(5));
}

/// Prints figures; run with `--release -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
fn speed() {
    for triangles in [100_000, 500_000, 2_000_000] {
        let start = std::time::Instant::now();
        let land = landscape(&LandscapeOptions { triangles, ..LandscapeOptions::default() });
        let (made, made_secs) = (land.triangles.len(), start.elapsed().as_secs_f64());
        let model = land.into();
        let start = std::time::Instant::now();
        let cleaned = crate::clean(model, &crate::CleanOptions::default());
        eprintln!(
            "{made} triangles: made in {made_secs:.2} s, cleaned in {:.3} s",
            start.elapsed().as_secs_f64()
        );
        assert!(cleaned.is_ok());
    }
}
