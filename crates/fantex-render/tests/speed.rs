//! How fast a picture of a million triangles is. Run with `--release -- --ignored --nocapture`.

mod common;

use common::{frontal, sheet, triangle_color};
use fantex_render::{Background, FlatShading, FlatSurface, Lights, RenderOptions, render};

#[test]
#[ignore = "measures; run it alone and with optimisation"]
fn a_million_triangles() {
    let mesh = sheet(707, 0.001, 1);
    let surface = FlatSurface::new(&mesh, FlatShading::Faceted, triangle_color);
    for samples in [1, 4, 8] {
        let options =
            RenderOptions { samples, background: Background::Transparent, ..RenderOptions::default() };
        let seen = render(&mesh, &surface, &frontal(1.0, 50.0), &Lights::default(), &options).unwrap();
        let seconds = seen.stats.elapsed.as_secs_f64();
        eprintln!("{samples} samples: {seconds:.3} s, {:?}", seen.stats);
        assert!(seconds < 10.0);
    }
}
