//! Welding: vertices at the same place become one.

use std::collections::HashMap;

use glam::{DVec3, IVec3, Vec3};

use super::first::{Repeat, repeats, scramble};

/// Vertices (among the used ones) at exactly the position of an earlier one.
pub(super) fn coinciding(positions: &[Vec3], used: impl Fn(usize) -> bool + Sync) -> Vec<Repeat> {
    repeats(
        positions.len(),
        |i| used(i).then(|| scramble(positions[i].to_array().map(f32::to_bits))),
        |a, b| positions[a as usize] == positions[b as usize],
    )
}

/// Vertices (among the used ones) no further than `distance` mesh units from an earlier vertex that was not welded
/// itself; each goes to the nearest such vertex, among equally near ones to the first.
///
/// Greedy, in vertex order, over a grid of cells as wide as the distance: welded vertices never drag others along, so
/// nothing moves by more than `distance`.
pub(super) fn within(positions: &[Vec3], used: impl Fn(usize) -> bool, distance: f64) -> Vec<Repeat> {
    // A cell index must fit 32 bits; below that the grid is coarser than the distance, which costs time only.
    let cell = distance.max(1.0 / f64::from(1 << 28));
    let mut kept: HashMap<IVec3, Vec<u32>> = HashMap::new();
    let mut found = Vec::new();
    for (i, p) in positions.iter().enumerate().filter(|&(i, _)| used(i)) {
        let home = (p.as_dvec3() / cell).floor().as_ivec3();
        let nearest = neighbourhood(home)
            .filter_map(|cell| kept.get(&cell))
            .flatten()
            .map(|&k| (p.as_dvec3().distance(positions[k as usize].as_dvec3()), k))
            .filter(|&(d, _)| d <= distance)
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        match nearest {
            Some((_, first)) => found.push(Repeat { element: i as u32, first }),
            None => kept.entry(home).or_default().push(i as u32),
        }
    }
    found
}

/// The 27 cells around and including `home`.
fn neighbourhood(home: IVec3) -> impl Iterator<Item = IVec3> {
    (0..27).map(move |i| home + IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1))
}

/// The tolerance in mesh units for a world-space distance.
pub(super) fn mesh_distance(world_distance: f64, world_per_mesh: f64) -> f64 {
    // Wider than the whole box is as good as everything.
    (world_distance / world_per_mesh).min(DVec3::splat(2.0).length())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_equal_positions_coincide() {
        let a = Vec3::new(0.1, 0.2, 0.3);
        let one_ulp = Vec3::new(f32::from_bits(a.x.to_bits() + 1), a.y, a.z);
        let found = coinciding(&[a, one_ulp, a, Vec3::ZERO, one_ulp], |i| i != 4);
        assert_eq!(found, [Repeat { element: 2, first: 0 }]);
    }

    #[test]
    fn a_tolerance_welds_across_cell_borders_but_does_not_chain() {
        let row: Vec<Vec3> = (0..10).map(|i| Vec3::new(0.01 * i as f32 - 0.05, 0.0, 0.0)).collect();
        let found = within(&row, |_| true, 0.0125);
        let firsts: Vec<(u32, u32)> = found.iter().map(|r| (r.element, r.first)).collect();
        assert_eq!(firsts, [(1, 0), (3, 2), (5, 4), (7, 6), (9, 8)]);
        assert!(within(&row, |_| true, 0.0).is_empty());
        assert_eq!(within(&[row[0], row[0]], |_| true, 0.0).len(), 1);
    }
}
