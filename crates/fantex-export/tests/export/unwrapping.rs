//! How full unwrapped pictures are, and that nothing overlaps in them, by counting texels.

use fantex_bake::NoProgress;
use fantex_base::Random;
use fantex_export::{SplitMesh, UnwrapOptions, Unwrapped, unwrap_triangles};
use fantex_mesh::CleanOptions;
use glam::{DVec2, DVec3, dvec3};

type Triangles = (Vec<DVec3>, Vec<[u32; 3]>);

fn unwrapped((positions, triangles): &Triangles, is_square: bool) -> (SplitMesh, Unwrapped) {
    let options = UnwrapOptions { side: 256, padding: Some(1), is_square };
    unwrap_triangles(positions, triangles, &CleanOptions::default(), &options, &NoProgress).unwrap()
}

/// The share of the picture's texels whose middles lie in a triangle. None lies in two, and all triangles have the same scale along both sides.
fn used(triangles: &Triangles, is_square: bool) -> f64 {
    let (mesh, unwrapped) = unwrapped(triangles, is_square);
    let [columns, rows] = unwrapped.size;
    assert!(u64::from(columns) * u64::from(rows) <= 256 * 256, "{:?}", unwrapped.size);
    assert!(!is_square || columns == rows);
    let size = DVec2::new(columns.into(), rows.into());
    let mut counts = vec![0u32; columns as usize * rows as usize];
    let mut scales: Vec<f64> = Vec::new();
    for (t, vertices) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = vertices.map(|v| mesh.uv[v as usize].as_dvec2() * size);
        let [p, q, r] = triangles.1[t].map(|v| triangles.0[v as usize]);
        scales.extend([
            a.distance(b) / p.distance(q),
            b.distance(c) / q.distance(r),
            c.distance(a) / r.distance(p),
        ]);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        assert!(low.min_element() > 0.0 && (size - high).min_element() > 0.0);
        for (x, y) in
            (low.y as u32..=high.y as u32).flat_map(|y| (low.x as u32..=high.x as u32).map(move |x| (x, y)))
        {
            let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| (to - from).perp_dot(at - from));
            if sides.iter().all(|&side| side > 1e-2) || sides.iter().all(|&side| side < -1e-2) {
                counts[(y * columns + x) as usize] += 1;
            }
        }
    }
    assert!(counts.iter().all(|&count| count <= 1), "triangles overlap");
    let (least, most) =
        scales.iter().fold((f64::MAX, 0.0f64), |(least, most), &s| (least.min(s), most.max(s)));
    assert!(most < 1.01 * least, "scales from {least} to {most}");
    f64::from(counts.iter().sum::<u32>()) / counts.len() as f64
}

/// That more than a share of the picture is used, for each model.
fn assert_used(models: &[(&str, Triangles, f64)], is_square: bool) {
    for (name, model, least) in models {
        let used = used(model, is_square);
        assert!(used > *least, "{name}: {used:.3}");
    }
}

fn block(size: DVec3) -> Triangles {
    let positions = (0..8).map(|i| size * dvec3((i & 1).into(), (i >> 1 & 1).into(), (i >> 2 & 1).into()));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    (positions.collect(), quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

/// Rectangles of these sides, apart from each other; of triangles alone, half of each.
fn loose(sides: &[[f64; 2]], are_triangles: bool) -> Triangles {
    let mut all = Triangles::default();
    for (&[width, height], i) in sides.iter().zip(0u32..) {
        let at = dvec3(0.0, 0.0, 10.0 * f64::from(i));
        all.0.extend(
            [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(|[x, y]| at + dvec3(x, y, 0.0)),
        );
        all.1.push([0, 1, 2].map(|k| 4 * i + k));
        if !are_triangles {
            all.1.push([0, 2, 3].map(|k| 4 * i + k));
        }
    }
    all
}

#[test]
fn few_pieces_fill_a_picture_of_any_shape() {
    let squares = loose(&[[1.0, 1.0]; 2], false);
    let models = [
        ("cube", block(DVec3::ONE), 0.95),
        ("block", block(dvec3(3.0, 2.0, 1.0)), 0.75),
        ("two squares", squares, 0.97),
        ("one rectangle", loose(&[[5.0, 1.0]], false), 0.97),
        ("needle", loose(&[[400.0, 1.0]], false), 0.2),
    ];
    assert_used(&models, false);
}

#[test]
fn few_pieces_fill_a_square_as_far_as_they_can() {
    let models = [
        ("cube", block(DVec3::ONE), 0.63),
        ("two squares", loose(&[[1.0, 1.0]; 2], false), 0.48),
        ("one square", loose(&[[1.0, 1.0]], false), 0.98),
        ("four squares", loose(&[[1.0, 1.0]; 4], false), 0.96),
        // Along the diagonal: 2 * 8 / (8 + 1)^2.
        ("one long rectangle", loose(&[[8.0, 1.0]], false), 0.18),
    ];
    assert_used(&models, true);
}

#[test]
fn random_pieces_lie_apart_in_pictures_of_any_shape() {
    let mut random = Random::new(6);
    for round in 0..6 {
        let sides: Vec<[f64; 2]> =
            (0..1 + 6 * round).map(|_| [0, 1].map(|_| 0.2 + 2.0 * random.unit().powi(2))).collect();
        for are_triangles in [false, true] {
            let model = loose(&sides, are_triangles);
            let [square, any] = [true, false].map(|is_square| used(&model, is_square));
            assert!(
                any > 0.4 && any > 0.97 * square,
                "{} pieces: {any:.3}, in a square {square:.3}",
                sides.len()
            );
        }
    }
}

/// The same on any number of threads.
#[test]
fn pictures_of_any_shape_do_not_depend_on_threads() {
    let model = loose(&[[1.0, 2.0], [3.0, 1.0], [1.5, 1.0], [0.7, 0.9], [2.2, 0.4]], false);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| unwrapped(&model, false))
    };
    assert_eq!(with(1), with(3));
}
