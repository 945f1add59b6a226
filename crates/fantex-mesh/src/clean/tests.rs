use super::*;
use glam::DVec3;

/// Wall-clock of the steps on a 2 M-triangle grid; prints figures.
#[test]
#[ignore = "a measurement, run in release mode"]
fn speed() {
    for n in [224, 316, 707, 1000] {
        let side = n + 1;
        let positions: Vec<DVec3> = (0..side * side)
            .map(|i| {
                let (x, y) = (f64::from(i % side), f64::from(i / side));
                DVec3::new(x, y, (x * 0.05).sin() * 20.0 * (y * 0.07).cos())
            })
            .collect();
        let triangles: Vec<[u32; 3]> = (0..n * n)
            .flat_map(|i| {
                let v = i / n * side + i % n;
                [[v, v + 1, v + side + 1], [v, v + side + 1, v + side]]
            })
            .collect();
        for _ in 0..3 {
            let model =
                Model { positions: positions.clone(), triangles: triangles.clone(), ..Model::default() };
            let start = std::time::Instant::now();
            let (mesh, report) = clean(model, &CleanOptions::default()).unwrap();
            eprintln!("{} triangles: {:?} {report:?}", mesh.triangles.len(), start.elapsed());
        }
    }
}
