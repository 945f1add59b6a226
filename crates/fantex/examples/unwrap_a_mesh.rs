//! Unwraps a mesh: positions and triangles in, texture coordinates out.
//!
//! ```text
//! cargo run -p fantex --features export --example unwrap_a_mesh -- [SIDE]
//! ```

use std::error::Error;

use fantex::Mesh;
use fantex::export::{UnwrapOptions, unwrap_mesh};

fn main() -> Result<(), Box<dyn Error>> {
    // A cube.
    let positions: Vec<[f64; 3]> =
        (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| f64::from(bit) * 2.0 - 1.0)).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles: Vec<[u32; 3]> = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();

    let mesh = Mesh::from_triangles(&positions, &triangles)?;
    let side = std::env::args().nth(1).map_or(Ok(512), |side| side.parse())?;
    let unwrapped = unwrap_mesh(&mesh, &UnwrapOptions { side, ..UnwrapOptions::default() })?;
    println!("{} charts in {side} x {side} texels, padding {}", unwrapped.charts, unwrapped.padding);
    for (triangle, corners) in mesh.triangles.iter().zip(&unwrapped.uv) {
        println!("{triangle:?} {:.3} {:.3} {:.3}", corners[0], corners[1], corners[2]);
    }
    Ok(())
}
