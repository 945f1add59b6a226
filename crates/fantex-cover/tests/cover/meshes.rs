//! Covers of known shapes, of shipped models and of random soups keep every promise of a cover.

use crate::common::{cleaned, covered, data_folder, generated, loaded, model, options};
use fantex_cover::TexelBudget;
use fantex_mesh::{CleanOptions, clean};
use glam::DVec3;
use proptest::prelude::*;

#[test]
fn generated_shapes_with_one_fan_per_tile() {
    for (name, mesh) in generated() {
        for budget in [TexelBudget::Total(200_000), TexelBudget::Density(5.0), TexelBudget::Density(150.0)] {
            covered(name, &mesh, &options(0, budget));
        }
    }
}

#[test]
fn generated_shapes_in_groups() {
    for (name, mesh) in generated() {
        for tile in [16, 64, 256] {
            for budget in
                [TexelBudget::Total(60_000), TexelBudget::Total(1 << 20), TexelBudget::Density(20.0)]
            {
                covered(name, &mesh, &options(tile, budget));
            }
        }
    }
}

#[test]
fn density_fields() {
    for (name, mesh) in generated() {
        let field: Vec<f32> =
            mesh.triangles.iter().map(|t| 10.0 + 200.0 * mesh.positions[t[0] as usize].x.abs()).collect();
        for tile in [0, 64] {
            covered(name, &mesh, &options(tile, TexelBudget::PerTriangle(field.clone())));
        }
    }
}

#[test]
fn wide_and_narrow_bands() {
    for (name, mesh) in generated() {
        for delta in [1.0 / 3.0, 0.2, 1e-3] {
            for tile in [0, 64] {
                let options =
                    fantex_cover::CoverOptions { delta, ..options(tile, TexelBudget::Total(100_000)) };
                covered(name, &mesh, &options);
            }
        }
    }
}

#[test]
fn shipped_models() {
    let Some(folder) = data_folder() else { return };
    let table = std::fs::read_to_string(folder.join("MESHES.tsv")).unwrap();
    for row in table.lines().skip(1) {
        let name = row.split('\t').next().unwrap();
        let mesh = loaded(&folder, name);
        for (tile, texels) in [(0, 4 << 20), (128, 1 << 20), (64, 4 << 20)] {
            // The largest one once is enough.
            if mesh.triangles.len() < 40_000 || tile == 64 {
                covered(name, &mesh, &options(tile, TexelBudget::Total(texels)));
            }
        }
    }
}

/// Few positions and many triangles: books, bow-ties, twins, folds.
fn soup() -> impl Strategy<Value = (Vec<DVec3>, Vec<[u32; 3]>)> {
    let coordinate = || (-8i32..=8).prop_map(|x| f64::from(x) / 8.0);
    prop::collection::vec([coordinate(), coordinate(), coordinate()], 4..14).prop_flat_map(|positions| {
        let n = positions.len() as u32;
        let positions: Vec<DVec3> = positions.into_iter().map(DVec3::from).collect();
        (Just(positions), prop::collection::vec([0..n, 0..n, 0..n], 1..40))
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn random_soups((positions, triangles) in soup(), tile in prop::sample::select(vec![0u32, 16, 64]), texels in 1u64..100_000) {
        if let Ok((mesh, _)) = clean(model(positions, triangles), &CleanOptions::default()) {
            covered("soup", &mesh, &options(tile, TexelBudget::Total(texels)));
        }
    }

    /// A sheet over a grid with random heights: steep folds, but a manifold.
    #[test]
    fn crumpled_sheets(heights in prop::collection::vec(-2.0f64..2.0, 64), tile in prop::sample::select(vec![0u32, 32, 128])) {
        let positions =
            heights.iter().enumerate().map(|(i, &h)| DVec3::new((i % 8) as f64, (i / 8) as f64, h)).collect();
        let triangles = (0..49u32)
            .flat_map(|q| {
                let v = q / 7 * 8 + q % 7;
                [[v, v + 1, v + 9], [v, v + 9, v + 8]]
            })
            .collect();
        let mesh = cleaned(model(positions, triangles));
        covered("sheet", &mesh, &options(tile, TexelBudget::Total(50_000)));
    }
}
