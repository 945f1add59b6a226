//! Finding equal elements: for every element that equals an earlier one, the first of its kind.
//!
//! Elements are spread over buckets by their hash, chunk by chunk, and every bucket is then looked through with a small
//! table that stays in the processor's cache. Chunks and buckets run in parallel; a bucket sees its elements in
//! ascending order, so the result does not depend on the number of threads.

use std::collections::{HashMap, HashSet};

use glam::{DVec3, I64Vec3, Vec3};
use rayon::prelude::*;

const CHUNK: usize = 1 << 16;
const BUCKET: usize = 1 << 12;
/// An unused place of a bucket's table.
const EMPTY: u64 = u64::MAX;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Repeat {
    pub(super) element: u32,
    /// The first element that equals it.
    pub(super) first: u32,
}

/// All elements below `count` that equal an earlier one, ascending. Elements whose `hash` is `None` are left out.
///
/// `same` must be an equivalence, and equal elements must have equal hashes. Of a tolerance, which is none, every element that equals an earlier one
/// which does not repeat another is found, as far as their hashes are equal.
pub(super) fn repeats(
    count: usize,
    hash: impl Fn(usize) -> Option<u64> + Sync,
    same: impl Fn(u32, u32) -> bool + Sync,
) -> Vec<Repeat> {
    let bucket_bits = (count / BUCKET).next_power_of_two().trailing_zeros().min(12);
    let chunks: Vec<Chunk> = (0..count.div_ceil(CHUNK))
        .into_par_iter()
        .map(|c| Chunk::new(c * CHUNK..count.min((c + 1) * CHUNK), bucket_bits, &hash))
        .collect();
    let mut found: Vec<Repeat> = (0..1_usize << bucket_bits)
        .into_par_iter()
        .map_init(Vec::new, |table, bucket| search(bucket, &chunks, table, &same))
        .flatten_iter()
        .collect();
    found.par_sort_unstable();
    found
}

/// Scrambles 96 bits into 64: two rounds of multiply and fold.
pub(super) fn scramble([a, b, c]: [u32; 3]) -> u64 {
    let mut h = (u64::from(a) | u64::from(b) << 32).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    h = (h ^ (h >> 32)).wrapping_add(u64::from(c)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    h = (h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h ^ (h >> 32)
}

/// The elements of one chunk, sorted by bucket and ascending within each.
struct Chunk {
    starts: Vec<u32>,
    /// Low half of the hash above, element below.
    entries: Vec<u64>,
}

impl Chunk {
    fn new(elements: std::ops::Range<usize>, bucket_bits: u32, hash: impl Fn(usize) -> Option<u64>) -> Self {
        let bucket_of = |h: u64| ((h >> 32) & ((1 << bucket_bits) - 1)) as usize;
        let hashed: Vec<(u64, u32)> = elements.filter_map(|i| hash(i).map(|h| (h, i as u32))).collect();
        let mut starts = vec![0_u32; (1 << bucket_bits) + 1];
        for &(h, _) in &hashed {
            starts[bucket_of(h) + 1] += 1;
        }
        for b in 1..starts.len() {
            starts[b] += starts[b - 1];
        }
        let mut cursors = starts.clone();
        let mut entries = vec![0; hashed.len()];
        for &(h, element) in &hashed {
            let cursor = &mut cursors[bucket_of(h)];
            entries[*cursor as usize] = h << 32 | u64::from(element);
            *cursor += 1;
        }
        Self { starts, entries }
    }

    fn bucket(&self, bucket: usize) -> &[u64] {
        &self.entries[self.starts[bucket] as usize..self.starts[bucket + 1] as usize]
    }
}

fn search(
    bucket: usize,
    chunks: &[Chunk],
    table: &mut Vec<u64>,
    same: impl Fn(u32, u32) -> bool,
) -> Vec<Repeat> {
    let count: usize = chunks.iter().map(|chunk| chunk.bucket(bucket).len()).sum();
    let places = (2 * count).next_power_of_two();
    table.clear();
    table.resize(places, EMPTY);
    let mut found = Vec::new();
    for &entry in chunks.iter().flat_map(|chunk| chunk.bucket(bucket)) {
        let (tag, element) = (entry >> 32, entry as u32);
        let mut place = tag as usize & (places - 1);
        loop {
            let seen = table[place];
            if seen == EMPTY {
                table[place] = entry;
                break;
            }
            if seen >> 32 == tag && same(seen as u32, element) {
                found.push(Repeat { element, first: seen as u32 });
                break;
            }
            place = (place + 1) & (places - 1);
        }
    }
    found
}

// Triangles that occur more than once.

/// What [`find`] found.
pub(super) struct Duplicates {
    /// Triangles with the same vertices in the same cyclic order as an earlier one, ascending.
    pub(super) repeated: Vec<u32>,
    /// Pairs of triangles with the same vertices in opposite order: a double-sided sheet. Both stay.
    pub(super) double_sided_pairs: u64,
}

/// Finds triangles with the same vertices. `is_disc` tells of vertices whose triangles form a [disc](crate::fans::Disc): those have different vertices.
pub(super) fn find(triangles: &[[u32; 3]], is_disc: impl Fn(u32) -> bool + Sync) -> Duplicates {
    let mut found = Duplicates { repeated: Vec::new(), double_sided_pairs: 0 };
    let mut paired = HashSet::new();
    let key = |t: usize| sorted(triangles[t]);
    let same_vertices = |a: u32, b: u32| key(a as usize) == key(b as usize);
    let may_repeat = |t: usize| !triangles[t].iter().any(|&v| is_disc(v));
    let hash = |t: usize| may_repeat(t).then(|| scramble(key(t)));
    for repeat in repeats(triangles.len(), hash, same_vertices) {
        let (triangle, first) = (triangles[repeat.element as usize], triangles[repeat.first as usize]);
        if smallest_first(triangle) == smallest_first(first) || !paired.insert(repeat.first) {
            found.repeated.push(repeat.element);
        } else {
            found.double_sided_pairs += 1;
        }
    }
    found
}

fn sorted([a, b, c]: [u32; 3]) -> [u32; 3] {
    let (low, high) = (a.min(b), a.max(b));
    [low.min(c), low.max(high.min(c)), high.max(c)]
}

/// Turned so that the smallest index comes first; the cyclic order stays.
fn smallest_first(triangle: [u32; 3]) -> [u32; 3] {
    let mut turned = triangle;
    while turned[0] > turned[1] || turned[0] > turned[2] {
        turned.rotate_left(1);
    }
    turned
}

// Welding: vertices at the same place become one.

/// Coordinates are told apart by steps of this, mesh units, and where single precision is coarser exactly. What double precision leaves of
/// a zero, such as 2.4e-16 of the sine of a full turn, is less.
const PLACE_STEP: f64 = 1.0 / (1_u64 << 44) as f64;

/// From here on single precision has no finer steps.
const PLACE_STEP_MATTERS: f32 = 1.0 / (1_u32 << 20) as f32;

/// Where a vertex is: equal for those that only rounding sets apart.
fn place(position: Vec3) -> Vec3 {
    position.map(|x| match x.abs() < PLACE_STEP_MATTERS {
        // Not minus zero.
        true => ((f64::from(x) / PLACE_STEP).round() * PLACE_STEP) as f32 + 0.0,
        false => x,
    })
}

/// Vertices (among the used ones) at the place of an earlier one.
pub(super) fn coinciding(positions: &[Vec3], used: impl Fn(usize) -> bool + Sync) -> Vec<Repeat> {
    let place = |i: usize| place(positions[i]);
    repeats(
        positions.len(),
        |i| used(i).then(|| scramble(place(i).to_array().map(f32::to_bits))),
        |a, b| place(a as usize) == place(b as usize),
    )
}

/// Vertices (among the used ones) no further than `distance` mesh units from an earlier vertex that was not welded
/// itself; each goes to the nearest such vertex, among equally near ones to the first.
///
/// Greedy, in vertex order, over a grid of cells as wide as the distance: welded vertices never drag others along, so
/// nothing moves by more than `distance`.
pub(super) fn within(positions: &[Vec3], used: impl Fn(usize) -> bool, distance: f64) -> Vec<Repeat> {
    let mut kept: HashMap<I64Vec3, Vec<u32>> = HashMap::new();
    let mut found = Vec::new();
    for (i, p) in positions.iter().enumerate().filter(|&(i, _)| used(i)) {
        let home = cell(*p, distance);
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

/// The narrowest cell, mesh units: its index fits 62 bits, and no two coordinates of mesh space are closer to each other.
const MIN_CELL: f64 = 1.0 / (1_u64 << 60) as f64;

/// The cell of the grid, as wide as a distance, that a point lies in.
fn cell(position: Vec3, distance: f64) -> I64Vec3 {
    (position.as_dvec3() / distance.max(MIN_CELL)).floor().as_i64vec3()
}

fn neighbourhood(home: I64Vec3) -> impl Iterator<Item = I64Vec3> {
    (0..27).map(move |i| home + I64Vec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1))
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
    fn repeats_name_the_first_of_their_kind_in_order() {
        let values: Vec<u32> = (0..300_000).map(|i: u32| i.wrapping_mul(2_654_435_761) % 70_001).collect();
        let found = repeats(
            values.len(),
            |i| Some(scramble([values[i], 0, 0])),
            |a, b| values[a as usize] == values[b as usize],
        );
        let mut first = std::collections::HashMap::new();
        let expected: Vec<Repeat> = (0..values.len() as u32)
            .filter_map(|i| match *first.entry(values[i as usize]).or_insert(i) {
                f if f == i => None,
                f => Some(Repeat { element: i, first: f }),
            })
            .collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn colliding_hashes_are_told_apart_and_none_is_left_out() {
        let values = [1, 2, 1, 2, 3, 1];
        let found = repeats(6, |i| (i != 5).then_some(7), |a, b| values[a as usize] == values[b as usize]);
        assert_eq!(found, [Repeat { element: 2, first: 0 }, Repeat { element: 3, first: 1 }]);
    }

    #[test]
    fn turned_copies_are_repeats_and_reversed_ones_are_opposed() {
        let found = find(&[[5, 3, 9], [3, 9, 5], [9, 3, 5], [5, 9, 3], [1, 2, 3], [9, 5, 3]], |_| false);
        assert_eq!(found.repeated, [1, 3, 5]);
        assert_eq!(found.double_sided_pairs, 1);
    }

    #[test]
    fn sorting_covers_every_order() {
        for t in [[1, 2, 3], [1, 3, 2], [2, 1, 3], [2, 3, 1], [3, 1, 2], [3, 2, 1]] {
            assert_eq!(sorted(t), [1, 2, 3]);
        }
    }

    #[test]
    fn only_equal_positions_coincide() {
        let a = Vec3::new(0.1, 0.2, 0.3);
        let one_ulp = Vec3::new(f32::from_bits(a.x.to_bits() + 1), a.y, a.z);
        let found = coinciding(&[a, one_ulp, a, Vec3::ZERO, one_ulp], |i| i != 4);
        assert_eq!(found, [Repeat { element: 2, first: 0 }]);
    }

    #[test]
    fn places_differ_unless_only_rounding_sets_them_apart() {
        let place = |x: f32| place(Vec3::new(x, 0.5, -x)).x;
        for noise in [2.4e-16_f32, -1e-15, 1e-20, -0.0] {
            assert_eq!(place(noise).to_bits(), 0.0_f32.to_bits(), "{noise}");
        }
        for x in [1e-13_f32, -1e-12, 1e-7, PLACE_STEP_MATTERS.next_down(), 0.3, 1.0] {
            assert_ne!(place(x), place(0.0), "{x}");
        }
        for x in [PLACE_STEP_MATTERS, 1e-3, 0.3, 1.0] {
            assert_eq!((place(x), place(x.next_up())), (x, x.next_up()));
        }
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

    /// Beside vertices that lie far away, all others are close together and the distance is tiny.
    #[test]
    fn cells_are_as_narrow_as_the_smallest_distance() {
        for distance in [1e-3, 1e-9, 1e-12, 1e-15, 2.0 * MIN_CELL] {
            let row: Vec<Vec3> =
                (0..100).map(|i| Vec3::X * (0.75 * distance * f64::from(i)) as f32).collect();
            let mut cells: Vec<I64Vec3> = row.iter().map(|&p| cell(p, distance)).collect();
            cells.dedup();
            assert_eq!(cells.len(), 75, "{distance}");
            // Every vertex that stays takes the next one.
            let firsts: Vec<u32> = within(&row, |_| true, distance).iter().map(|r| r.first).collect();
            assert!(firsts.iter().copied().eq((0..100).step_by(2)), "{distance}: {firsts:?}");
        }
    }
}
