//! Properties of cleaning that hold for any triangle soup.

use crate::common::{check, soup};
use fantex_mesh::{CleanOptions, CleanReport, Mesh, Model, clean};
use glam::Vec4;
use proptest::prelude::*;

/// Soups on a small grid, so that coinciding vertices, collinear corners and repeated triangles are common; every corner
/// carries a colour that tells its position in the model.
fn any_model() -> impl Strategy<Value = Model> {
    let coordinate = prop_oneof![6 => (0..4_i32).prop_map(f64::from), 1 => Just(-0.0), 1 => Just(f64::NAN)];
    let position = [coordinate.clone(), coordinate.clone(), coordinate];
    (prop::collection::vec(position, 3..60), prop::collection::vec(any::<[u16; 3]>(), 1..150)).prop_map(
        |(positions, raw)| {
            let count = positions.len() as u32;
            let triangles: Vec<_> = raw.iter().map(|t| t.map(|v| u32::from(v) % count)).collect();
            let mut model = soup(positions, triangles);
            let color = |&v: &u32| model.positions[v as usize].as_vec3().extend(1.0);
            model.corners.colors = model.triangles.iter().flatten().map(color).collect();
            model
        },
    )
}

/// The mesh as a model again.
fn model_of(mesh: &Mesh) -> Model {
    Model {
        positions: mesh.positions.iter().map(|&p| mesh.world_from_mesh.point(p)).collect(),
        triangles: mesh.triangles.clone(),
        corners: mesh.corners.clone(),
        ..Model::default()
    }
}

fn on_threads(threads: usize, model: Model) -> Option<(Mesh, CleanReport)> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok()?;
    pool.install(|| clean(model, &CleanOptions::default()).ok())
}

proptest! {
    #[test]
    fn promises_hold_and_attributes_stay_with_their_corners(model in any_model()) {
        if let Ok((mesh, report)) = clean(model, &CleanOptions::default()) {
            check(&mesh, &report);
            for (corner, &v) in mesh.triangles.iter().flatten().enumerate() {
                let world: Vec4 = mesh.world_from_mesh.point(mesh.positions[v as usize]).as_vec3().extend(1.0);
                prop_assert_eq!(mesh.corners.colors[corner], world);
            }
        }
    }

    #[test]
    fn cleaning_twice_changes_nothing_more(model in any_model()) {
        if let Ok((once, first)) = clean(model, &CleanOptions::default()) {
            let (twice, second) = clean(model_of(&once), &CleanOptions::default()).unwrap();
            prop_assert_eq!(&twice.triangles, &once.triangles);
            prop_assert_eq!(&twice.corners, &once.corners);
            prop_assert_eq!(model_of(&twice).positions, model_of(&once).positions);
            prop_assert_eq!(second.topology, first.topology);
            prop_assert_eq!(second.triangles_flipped, 0);
        }
    }

    #[test]
    fn the_order_of_triangles_does_not_change_the_counts(model in any_model()) {
        let mut reversed = model.clone();
        reversed.triangles.reverse();
        reversed.corners = Default::default();
        let (a, b) = (clean(model, &CleanOptions::default()), clean(reversed, &CleanOptions::default()));
        prop_assert_eq!(a.is_ok(), b.is_ok());
        if let (Ok((_, a)), Ok((_, b))) = (a, b) {
            prop_assert_eq!(a.triangles_duplicate, b.triangles_duplicate);
            prop_assert_eq!(a.double_sided_pairs, b.double_sided_pairs);
            prop_assert_eq!(a.non_orientable_components, b.non_orientable_components);
            prop_assert_eq!(a.topology.edges, b.topology.edges);
            prop_assert_eq!(a.topology.components, b.topology.components);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn the_number_of_threads_does_not_matter(model in any_model()) {
        let same_on_one = on_threads(1, model.clone());
        prop_assert_eq!(same_on_one.is_some(), clean(model.clone(), &CleanOptions::default()).is_ok());
        prop_assert_eq!(same_on_one, on_threads(7, model));
    }
}

#[test]
fn large_soups_do_not_depend_on_threads_either() {
    let mut state = 7_u32;
    let mut random = |n: u32| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) % n
    };
    let positions: Vec<[f64; 3]> = (0..200_000).map(|_| [(); 3].map(|()| f64::from(random(40)))).collect();
    let triangles: Vec<[u32; 3]> = (0..300_000).map(|_| [(); 3].map(|()| random(200_000))).collect();
    let model = soup(positions, triangles);
    let one = on_threads(1, model.clone());
    assert!(one.is_some() && one == on_threads(6, model));
}
