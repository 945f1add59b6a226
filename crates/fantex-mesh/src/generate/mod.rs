//! Procedural models: small known shapes and landscapes of any size.

mod landscape;
mod tetrahedra;

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use glam::DVec3;

use crate::{Material, Model};

pub use landscape::{Landscape, LandscapeOptions, landscape};

// Small shapes with known topology, for tests and examples.

/// A unit sphere of `around` meridians (at least 3) and `rings` bands from pole to pole (at least 2).
pub fn uv_sphere(around: u32, rings: u32) -> Model {
    assert!(around >= 3 && rings >= 2, "a sphere needs at least 3 meridians and 2 bands");
    let ring = |j: u32| (0..around).map(move |i| (TAU * f64::from(i) / f64::from(around), j));
    let on_sphere = |(longitude, j): (f64, u32)| {
        let latitude = PI * f64::from(j) / f64::from(rings);
        DVec3::new(latitude.sin() * longitude.cos(), latitude.cos(), -latitude.sin() * longitude.sin())
    };
    let mut positions = vec![DVec3::Y];
    positions.extend((1..rings).flat_map(ring).map(on_sphere));
    positions.push(-DVec3::Y);
    let last = positions.len() as u32 - 1;
    let at = |i: u32, j: u32| match j {
        0 => 0,
        j if j == rings => last,
        j => 1 + (j - 1) * around + i % around,
    };
    let quads = (0..rings).flat_map(|j| (0..around).map(move |i| (i, j)));
    let triangles = quads
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
            [[a, b, c], [a, c, d]]
        })
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect();
    model("uv_sphere", positions, triangles)
}

/// A unit sphere: an icosahedron, every triangle cut into four `level` times (`20 * 4^level` triangles).
pub fn icosphere(level: u32) -> Model {
    let golden = f64::midpoint(1.0, 5.0_f64.sqrt());
    let rectangle = [(-1.0, golden), (1.0, golden), (-1.0, -golden), (1.0, -golden)];
    let mut positions: Vec<DVec3> = rectangle.map(|(x, y)| DVec3::new(x, y, 0.0)).to_vec();
    positions.extend(rectangle.map(|(y, z)| DVec3::new(0.0, y, z)));
    positions.extend(rectangle.map(|(z, x)| DVec3::new(x, 0.0, z)));
    positions.iter_mut().for_each(|p| *p = p.normalize());
    let mut triangles = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..level {
        triangles = quartered(&mut positions, &triangles);
    }
    model("icosphere", positions, triangles)
}

/// Cuts every triangle into four at its edges' midpoints, pushed out onto the unit sphere.
fn quartered(positions: &mut Vec<DVec3>, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut midpoints = BTreeMap::new();
    let mut midpoint = |a: u32, b: u32| {
        *midpoints.entry((a.min(b), a.max(b))).or_insert_with(|| {
            positions.push((positions[a as usize] + positions[b as usize]).normalize());
            positions.len() as u32 - 1
        })
    };
    let quarter = |&[a, b, c]: &[u32; 3]| {
        let [ab, bc, ca] = [midpoint(a, b), midpoint(b, c), midpoint(c, a)];
        [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
    };
    triangles.iter().flat_map(quarter).collect()
}

/// The cube from -1 to 1 with `n` x `n` quadrilaterals per face; faces share vertices along the cube's edges.
pub fn cube(n: u32) -> Model {
    assert!(n >= 1, "a cube's faces need at least one quadrilateral");
    let mut indices = BTreeMap::new();
    let mut positions = Vec::new();
    let mut vertex = |p: [u32; 3]| {
        *indices.entry(p).or_insert_with(|| {
            positions.push(DVec3::from(p.map(|c| 2.0 * f64::from(c) / f64::from(n) - 1.0)));
            positions.len() as u32 - 1
        })
    };
    let mut triangles = Vec::new();
    for (axis, level) in [(0, 0), (0, n), (1, 0), (1, n), (2, 0), (2, n)] {
        for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))) {
            let mut corner = |u: u32, v: u32| {
                let mut p = [level; 3];
                (p[(axis + 1) % 3], p[(axis + 2) % 3]) = (u, v);
                vertex(p)
            };
            let quad = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            let [a, b, c, d] = if level == n { quad } else { [quad[0], quad[3], quad[2], quad[1]] };
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    model("cube", positions, triangles)
}

/// A torus around the y axis with radii 1 and 0.4, `around` x `across` quadrilaterals (each at least 3).
pub fn torus(around: u32, across: u32) -> Model {
    assert!(around >= 3 && across >= 3, "a torus needs at least 3 x 3 quadrilaterals");
    let angle = |i: u32, n: u32| TAU * f64::from(i) / f64::from(n);
    let positions = (0..around * across)
        .map(|v| {
            let (u, w) = (angle(v / across, around), angle(v % across, across));
            let radius = 1.0 + 0.4 * w.cos();
            DVec3::new(radius * u.cos(), 0.4 * w.sin(), -radius * u.sin())
        })
        .collect();
    let at = |i: u32, j: u32| i % around * across + j % across;
    let triangles = (0..around * across)
        .flat_map(|v| {
            let (i, j) = (v / across, v % across);
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    model("torus", positions, triangles)
}

/// The square from -1 to 1 in the plane y = 0, facing up, of `n` x `n` quadrilaterals.
pub fn grid(n: u32) -> Model {
    assert!(n >= 1, "a grid needs at least one quadrilateral");
    let side = n + 1;
    let coordinate = |i: u32| 2.0 * f64::from(i) / f64::from(n) - 1.0;
    let positions =
        (0..side * side).map(|v| DVec3::new(coordinate(v % side), 0.0, coordinate(v / side))).collect();
    let triangles = (0..n * n)
        .flat_map(|q| {
            let v = q / n * side + q % n;
            [[v, v + side, v + side + 1], [v, v + side + 1, v + 1]]
        })
        .collect();
    model("grid", positions, triangles)
}

/// A book: `pages` triangles around one common edge.
pub fn book(pages: u32) -> Model {
    let mut positions = vec![DVec3::NEG_Y, DVec3::Y];
    positions.extend((0..pages).map(|i| {
        let (sin, cos) = (TAU * f64::from(i) / f64::from(pages)).sin_cos();
        DVec3::new(cos, 0.0, sin)
    }));
    model("book", positions, (0..pages).map(|i| [0, 1, 2 + i]).collect())
}

fn model(name: &str, positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Model {
    Model {
        name: name.to_owned(),
        positions,
        triangles,
        materials: vec![Material::default()],
        ..Model::default()
    }
}
