//! Splits patches into connected components.
//!
//! Where normals are rough, cutting by normals leaves patches in many pieces, half of them single fans. Each connected piece
//! becomes a patch; fragments go to the neighbour with the longest common border whose direction sees them well (all but the smallest only
//! where it lies nearly all around), before anything is laid flat. That gives fewer groups, more density and less foreshortening than
//! when `merge` judges all of them.

use glam::Vec3;
use rayon::prelude::*;

use crate::cone::Cone;
use crate::fan_shape::{FanShape, Layout};
use crate::merge::sum_by_name;
use crate::partition::FanSet;

/// Pieces of at most so many texels look for a neighbour to join: one that lies nearly all around, as blocks along the rim of a hole would be
/// stored twice.
const FRAGMENT_TEXELS: f32 = 400.0;

/// The share of a fragment's border along the neighbour that lies nearly all around.
const MIN_HELD_SHARE: f32 = 0.6;

/// Fragments of at most so many texels, one block of a tile, join any neighbour. Its rectangle hardly grows for them.
const BLOCK_TEXELS: f32 = 16.0;

/// Fragments whose neighbours are fragments, too, may find one in a later round.
const ROUNDS: usize = 3;

/// Place of fans that share no patch with others.
const ALONE: u32 = u32::MAX;

/// The seed of fans that were not visited yet.
const UNSEEN: u32 = u32::MAX;

/// Separates patches into connected pieces, through triangles.
pub(crate) struct Connector<'a> {
    fans: FanSet<'a>,
    /// Where in the order each fan is; `ALONE` for fans that are not projected. May be out of date for fans that are not
    /// looked at, so a place counts only where the order names the fan.
    places: Vec<u32>,
}

impl<'a> Connector<'a> {
    pub(crate) fn new(fans: FanSet<'a>) -> Self {
        let place = |shape: &FanShape| if shape.layout == Layout::Projected { 0 } else { ALONE };
        Self { fans, places: fans.shapes.iter().map(place).collect() }
    }

    /// Reorders each of the patches, which lie one after the other in `order` from `start` on, by connected pieces; returns
    /// the pieces' lengths.
    pub(crate) fn separate(&mut self, order: &mut [u32], start: usize, lengths: &[u32]) -> Vec<u32> {
        let end = start + lengths.iter().sum::<u32>() as usize;
        self.note_places(&order[start..end], start);
        let seeds = self.seeds(order, start, lengths);
        let (sorted, lengths) = sorted_by_seed(&order[start..end], &seeds, start as u32);
        order[start..end].copy_from_slice(&sorted);
        lengths
    }

    /// All fans by connected pieces of the patches, which lie one after the other in `order`, with the pieces' lengths.
    /// Fragments went to a neighbour whose direction their triangles' normals face with a cosine of at least `facing`.
    pub(crate) fn connect(&mut self, order: &[u32], lengths: &[u32], facing: f32) -> (Vec<u32>, Vec<u32>) {
        self.note_places(order, 0);
        let mut seeds = self.seeds(order, 0, lengths);
        let pieces = self.pieces(order, lengths, &seeds);
        self.absorb(order, &mut seeds, &pieces, facing);
        sorted_by_seed(order, &seeds, 0)
    }

    fn note_places(&mut self, order: &[u32], start: usize) {
        for (place, &fan) in (start as u32..).zip(order) {
            let noted = &mut self.places[fan as usize];
            if *noted != ALONE {
                *noted = place;
            }
        }
    }

    /// For every fan of the patches the place of the first fan of its connected piece.
    fn seeds(&self, order: &[u32], start: usize, lengths: &[u32]) -> Vec<u32> {
        let mut seeds = vec![UNSEEN; lengths.iter().sum::<u32>() as usize];
        let patches = split(&mut seeds, lengths, start as u32);
        patches.into_par_iter().for_each_init(Vec::new, |stack, (first, seeds)| {
            for i in 0..seeds.len() {
                if seeds[i] == UNSEEN {
                    self.flood(order, first, first + i as u32, seeds, stack);
                }
            }
        });
        seeds
    }

    /// Marks the piece of the fan at place `seed` in a patch that begins at place `first`.
    fn flood(&self, order: &[u32], first: u32, seed: u32, seeds: &mut [u32], stack: &mut Vec<u32>) {
        seeds[(seed - first) as usize] = seed;
        if self.places[order[seed as usize] as usize] == ALONE {
            return;
        }
        stack.push(seed);
        while let Some(at) = stack.pop() {
            self.for_neighbours(order[at as usize], |fan, place| {
                let index = place.wrapping_sub(first) as usize;
                if index < seeds.len() && seeds[index] == UNSEEN && order[place as usize] == fan {
                    seeds[index] = seed;
                    stack.push(place);
                }
            });
        }
    }

    /// The fans around a fan's ring, with their places.
    #[inline]
    fn for_neighbours(&self, fan: u32, mut visit: impl FnMut(u32, u32)) {
        let fans = &self.fans.surface.fans;
        let corners = fans.corners(fan as usize);
        let mut visit = |fan: u32| visit(fan, self.places[fan as usize]);
        for corner in corners {
            visit(fans.of_triangle(corner.triangle())[corner.slots()[1]]);
        }
        if !fans.is_closed(fan as usize)
            && let Some(last) = corners.last()
        {
            visit(fans.of_triangle(last.triangle())[last.slots()[2]]);
        }
    }

    /// What the pieces of all patches sum up to, at the places of their seeds.
    fn pieces(&self, order: &[u32], lengths: &[u32], seeds: &[u32]) -> Vec<Piece> {
        let mut pieces = vec![Piece::default(); order.len()];
        split(&mut pieces, lengths, 0).into_par_iter().for_each(|(first, pieces)| {
            for at in first as usize..first as usize + pieces.len() {
                let fan = order[at];
                let piece = &mut pieces[(seeds[at] - first) as usize];
                piece.add(&self.fans.shapes[fan as usize], self.fans.density(fan));
            }
        });
        pieces
    }

    /// Gives every fragment that finds one the seed of a larger piece.
    fn absorb(&self, order: &[u32], seeds: &mut [u32], pieces: &[Piece], facing: f32) {
        let of_fragment = |&(seed, _): &(u32, u32)| pieces[seed as usize].is_fragment();
        let places = (0..seeds.len() as u32).into_par_iter().with_min_len(1 << 12);
        let mut members: Vec<(u32, u32)> =
            places.map(|at| (seeds[at as usize], at)).filter(of_fragment).collect();
        members.par_sort_unstable();
        let mut fragments: Vec<&[(u32, u32)]> = members.chunk_by(|a, b| a.0 == b.0).collect();
        for _ in 0..ROUNDS {
            let targets: Vec<Option<u32>> = fragments
                .par_iter()
                .with_min_len(64)
                .map_init(Vec::new, |borders, fragment| {
                    let all = self.longest_borders(order, seeds, pieces, fragment, borders);
                    let joins_any = pieces[fragment[0].0 as usize].texels <= BLOCK_TEXELS;
                    let least = if joins_any { 0.0 } else { MIN_HELD_SHARE * all as f32 };
                    let mut long = borders.iter().filter(|border| border.1 as f32 >= least);
                    let found = long.find(|&&(seed, _)| {
                        self.sees(pieces[seed as usize].axis.normalize_or_zero(), order, fragment, facing)
                    });
                    found.map(|&(seed, _)| seed)
                })
                .collect();
            let mut targets = targets.into_iter();
            fragments.retain(|fragment| {
                let target = targets.next().flatten();
                for &(_, at) in target.iter().flat_map(|_| fragment.iter()) {
                    seeds[at as usize] = target.unwrap_or(UNSEEN);
                }
                target.is_none()
            });
        }
    }

    /// The pieces around a fragment that are none themselves, as `(seed, length of the common border)`, the longest first. Returns the length of
    /// the border with all pieces.
    fn longest_borders(
        &self,
        order: &[u32],
        seeds: &[u32],
        pieces: &[Piece],
        fragment: &[(u32, u32)],
        borders: &mut Vec<(u32, u32)>,
    ) -> u32 {
        borders.clear();
        let mut all = 0;
        for &(_, at) in fragment {
            self.for_neighbours(order[at as usize], |_, place| {
                all += u32::from(place == ALONE || seeds[place as usize] != seeds[at as usize]);
                if place != ALONE && !pieces[seeds[place as usize] as usize].is_fragment() {
                    borders.push((seeds[place as usize], 1));
                }
            });
        }
        sum_by_name(borders);
        borders.sort_unstable_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
        all
    }

    /// True where every triangle around a fragment's fans faces a direction well enough.
    fn sees(&self, direction: Vec3, order: &[u32], fragment: &[(u32, u32)], facing: f32) -> bool {
        fragment.iter().all(|&(_, at)| {
            let fan = order[at as usize] as usize;
            self.places[fan] != ALONE && farthest_cosine(self.fans.shapes[fan].cone, direction) >= facing
        })
    }
}

/// Consecutive parts of such lengths, each with its place in a whole that begins at `first`.
fn split<'s, T>(mut rest: &'s mut [T], lengths: &[u32], mut first: u32) -> Vec<(u32, &'s mut [T])> {
    let mut parts = Vec::with_capacity(lengths.len());
    for &length in lengths {
        let (part, tail) = rest.split_at_mut(length as usize);
        parts.push((first, part));
        (rest, first) = (tail, first + length);
    }
    parts
}

/// Sums over the fans of a connected piece.
#[derive(Clone, Copy, Default)]
struct Piece {
    axis: Vec3,
    texels: f32,
}

impl Piece {
    fn add(&mut self, fan: &FanShape, density: f32) {
        self.axis += fan.axis * fan.area;
        self.texels += fan.area * density * density;
    }

    fn is_fragment(&self) -> bool {
        self.texels <= FRAGMENT_TEXELS
    }
}

/// The cosine between a direction and the member of a cone that lies farthest from it.
fn farthest_cosine(Cone { axis, cos }: Cone, direction: Vec3) -> f32 {
    let between = axis.dot(direction);
    let sines = ((1.0 - between * between).max(0.0) * (1.0 - cos * cos).max(0.0)).sqrt();
    between * cos - sines
}

/// Fans stable-sorted by seed, and the number of fans of each seed, ascending. Seeds count from `first`.
fn sorted_by_seed(fans: &[u32], seeds: &[u32], first: u32) -> (Vec<u32>, Vec<u32>) {
    let mut ends = vec![0_u32; fans.len()];
    for &seed in seeds {
        ends[(seed - first) as usize] += 1;
    }
    let lengths: Vec<u32> = ends.iter().copied().filter(|&n| n > 0).collect();
    let mut sum = 0;
    for end in &mut ends {
        sum += std::mem::replace(end, sum);
    }
    let mut sorted = vec![0; fans.len()];
    for (&fan, &seed) in fans.iter().zip(seeds) {
        let end = &mut ends[(seed - first) as usize];
        sorted[*end as usize] = fan;
        *end += 1;
    }
    (sorted, lengths)
}
