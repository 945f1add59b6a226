//! Finding equal elements: for every element that equals an earlier one, the first of its kind.
//!
//! Elements are spread over buckets by their hash, chunk by chunk, and every bucket is then looked through with a small
//! table that stays in the processor's cache. Chunks and buckets run in parallel; a bucket sees its elements in
//! ascending order, so the result does not depend on the number of threads.

use rayon::prelude::*;

/// Elements hashed per parallel task.
const CHUNK: usize = 1 << 16;
/// Elements per bucket aimed at.
const BUCKET: usize = 1 << 12;
/// An unused place of a bucket's table.
const EMPTY: u64 = u64::MAX;

/// An element that equals an earlier one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Repeat {
    /// The later element.
    pub(super) element: u32,
    /// The first element that equals it.
    pub(super) first: u32,
}

/// All elements below `count` that equal an earlier one, ascending. Elements whose `hash` is `None` are left out.
///
/// `same` must be an equivalence, and equal elements must have equal hashes.
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

/// Looks through one bucket with an open-addressing table.
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
}
