//! How long a dab and an undo take: `cargo test --release -p fantex-paint --test paint speed -- --ignored --nocapture`.

use std::sync::Arc;
use std::time::Instant;

use crate::{Baked, cleaned, cover, red, stroke};
use fantex_bake::BakeFormat;
use fantex_mesh::generate;
use fantex_paint::dabs_of;
use glam::Vec3;

fn percentile(mut times: Vec<f64>, share: f64) -> f64 {
    times.sort_by(f64::total_cmp);
    times[((times.len() - 1) as f64 * share) as usize]
}

#[test]
#[ignore = "prints figures"]
fn dabs_of_200_texels_on_a_million_triangles() {
    let started = Instant::now();
    let mesh = cleaned(generate::torus(1000, 500));
    eprintln!("{} triangles, {:.1} s", mesh.triangles.len(), started.elapsed().as_secs_f64());
    let baked = Baked::new(&mesh, &cover(&mesh, 64, 16 << 20), BakeFormat::Bc7);
    eprintln!("baked after {:.1} s", started.elapsed().as_secs_f64());
    let opened = Instant::now();
    let mut painter = baked.painter();
    eprintln!("opened in {:.2} s", opened.elapsed().as_secs_f64());
    let surface = Arc::clone(painter.surface());
    let path: Vec<Vec3> =
        (0..60).map(|i| Vec3::new((0.05 * i as f32).cos(), 0.3, (0.05 * i as f32).sin())).collect();
    let dabs = dabs_of(&surface, &stroke(&surface, 200.0, &path));
    painter.begin("stroke", red(0.9)).unwrap();
    let (mut times, mut shares) = (Vec::new(), [0.0; 2]);
    for dab in &dabs {
        let started = Instant::now();
        painter.dab(std::slice::from_ref(dab)).unwrap();
        shares[0] += started.elapsed().as_secs_f64();
        painter.show().unwrap();
        let time = started.elapsed().as_secs_f64();
        shares[1] += time;
        times.push(1e3 * time);
    }
    eprintln!(
        "{} dabs: median {:.1} ms, p99 {:.1} ms, least {:.1} ms, {:.0} % of it coverage",
        dabs.len(),
        percentile(times.clone(), 0.5),
        percentile(times.clone(), 0.99),
        percentile(times, 0.0),
        100.0 * shares[0] / shares[1]
    );
    for (name, step) in [("end", 0), ("undo", 1), ("redo", 2), ("commit", 3)] {
        let started = Instant::now();
        match step {
            0 => drop(painter.end().unwrap()),
            1 => drop(painter.undo().unwrap()),
            2 => drop(painter.redo().unwrap()),
            _ => drop(painter.commit().unwrap()),
        }
        eprintln!("{name}: {:.1} ms", 1e3 * started.elapsed().as_secs_f64());
    }
}
