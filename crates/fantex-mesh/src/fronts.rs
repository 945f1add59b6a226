//! Double-sided parts as one sheet while a mesh is made coarser: of each pair of triangles with the same vertices in opposite order
//! one stands for both.
//!
//! What looks at edges sees two triangles at each edge of such a part, at its rim, too, and takes it for closed. With the fronts alone
//! the rim is a border, and what becomes of the fronts becomes of the backs.

use crate::adjacency::OpposedTriangles;

/// Triangles without the backs of pairs.
#[derive(Debug, Default)]
pub(crate) struct Fronts {
    /// Those without a back, then the front of each pair. Fronts continue each other where just two pairs meet.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// The vertices that both kinds have. Fronts have copies of them, numbered from the count of the mesh's vertices on, so that each
    /// triangle tells its kind by any of its vertices.
    pub(crate) shared: Vec<u32>,
    /// Per vertex, and then per copy, whether fronts have it. Empty where there are no pairs.
    is_of_front: Vec<bool>,
    pairs: usize,
}

impl Fronts {
    /// Of triangles of a mesh with so many vertices.
    pub(crate) fn of(triangles: &[[u32; 3]], vertex_count: usize) -> Self {
        let opposed = OpposedTriangles::of(triangles);
        let (pairs, mut singles) = split(triangles, &opposed);
        if pairs.is_empty() {
            return Self { triangles: singles, ..Self::default() };
        }
        let fronts = oriented(&pairs);
        let mut is_of_front = vec![false; vertex_count];
        fronts.as_flattened().iter().for_each(|&vertex| is_of_front[vertex as usize] = true);
        let mut copies = vec![None; vertex_count];
        let mut shared = Vec::new();
        for &vertex in singles.as_flattened() {
            if is_of_front[vertex as usize] {
                copies[vertex as usize] = Some((vertex_count + shared.len()) as u32);
                is_of_front[vertex as usize] = false;
                shared.push(vertex);
            }
        }
        is_of_front.resize(vertex_count + shared.len(), true);
        let copied = |vertex: u32| copies[vertex as usize].unwrap_or(vertex);
        singles.extend(fronts.iter().map(|front| front.map(copied)));
        Self { triangles: singles, shared, is_of_front, pairs: pairs.len() }
    }

    /// How many triangles these are with their backs.
    pub(crate) fn count_with_backs(&self, triangles: &[[u32; 3]]) -> usize {
        triangles.len() + triangles.iter().filter(|&&[vertex, ..]| self.is_front(vertex)).count()
    }

    /// Whether some triangles have backs and others have none.
    pub(crate) fn is_mixed(&self) -> bool {
        self.pairs > 0 && self.pairs < self.triangles.len()
    }

    /// Some of the triangles, or made of their vertices: with their backs, and with the vertices of the mesh.
    pub(crate) fn with_backs(&self, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
        let count = self.is_of_front.len() - self.shared.len();
        let original = |vertex: u32| match (vertex as usize).checked_sub(count) {
            Some(copy) if self.pairs > 0 => self.shared[copy],
            _ => vertex,
        };
        let fronts = triangles.iter().map(|triangle| triangle.map(original));
        let backs = triangles.iter().filter(|&&[vertex, ..]| self.is_front(vertex));
        fronts.chain(backs.map(|&[a, b, c]| [a, c, b].map(original))).collect()
    }

    fn is_front(&self, vertex: u32) -> bool {
        self.is_of_front.get(vertex as usize).copied().unwrap_or(false)
    }
}

/// The first triangle of each pair, and the triangles that are in none.
fn split(triangles: &[[u32; 3]], opposed: &OpposedTriangles) -> (Vec<[u32; 3]>, Vec<[u32; 3]>) {
    let (mut candidates, mut singles) = (Vec::new(), Vec::new());
    for (index, &triangle) in triangles.iter().enumerate() {
        if opposed.contains(index) {
            let mut key = triangle;
            key.sort_unstable();
            candidates.push((key, index));
        } else {
            singles.push(triangle);
        }
    }
    candidates.sort_unstable();
    let mut pairs = Vec::new();
    for alike in candidates.chunk_by(|a, b| a.0 == b.0) {
        match *alike {
            [(_, first), _] => pairs.push(first),
            _ => singles.extend(alike.iter().map(|&(_, index)| triangles[index])),
        }
    }
    pairs.sort_unstable();
    (pairs.into_iter().map(|index| triangles[index]).collect(), singles)
}

/// Turns triangles over so that two at an edge run along it in opposite directions, as far as the sheet allows this (a Moebius strip does
/// not). Edges of more than two do not count.
fn oriented(sheet: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * sheet.len());
    for (index, triangle) in sheet.iter().enumerate() {
        for k in 0..3 {
            let mut ends = [triangle[k], triangle[(k + 1) % 3]];
            ends.sort_unstable();
            sides.push((ends, index as u32));
        }
    }
    sides.sort_unstable();
    let mut neighbors = vec![[u32::MAX; 3]; sheet.len()];
    for at_edge in sides.chunk_by(|a, b| a.0 == b.0) {
        if let [(ends, one), (_, other)] = *at_edge {
            for (from, to) in [(one, other), (other, one)] {
                let triangle = sheet[from as usize];
                let side = (0..3).find(|&k| !ends.contains(&triangle[(k + 2) % 3]));
                side.iter().for_each(|&k| neighbors[from as usize][k] = to);
            }
        }
    }
    let runs_along = |[a, b, c]: [u32; 3], from: u32, to: u32| [(a, b), (b, c), (c, a)].contains(&(from, to));
    let mut turned = vec![None; sheet.len()];
    let mut open = Vec::new();
    for first in 0..sheet.len() {
        if turned[first].is_none() {
            turned[first] = Some(false);
            open.push(first);
        }
        while let Some(index) = open.pop() {
            let (triangle, is_turned) = (sheet[index], turned[index] == Some(true));
            for k in 0..3 {
                let neighbor = neighbors[index][k] as usize;
                if neighbor < sheet.len() && turned[neighbor].is_none() {
                    let is_same = runs_along(sheet[neighbor], triangle[k], triangle[(k + 1) % 3]);
                    turned[neighbor] = Some(is_same != is_turned);
                    open.push(neighbor);
                }
            }
        }
    }
    let turn = |(&[a, b, c], turned): (&[u32; 3], &Option<bool>)| match turned {
        Some(true) => [a, c, b],
        _ => [a, b, c],
    };
    sheet.iter().zip(&turned).map(turn).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fronts_continue_each_other_and_backs_come_again() {
        // A strip of three triangles with their backs, listed without any order of sides, and a single one beside it.
        let all = [[0, 2, 1], [1, 2, 3], [0, 1, 2], [3, 2, 1], [2, 3, 4], [3, 2, 4], [4, 3, 5]];
        let fronts = Fronts::of(&all, 6);
        assert_eq!(fronts.triangles.len(), 4);
        assert_eq!(fronts.shared, [4, 3]);
        assert!(fronts.is_mixed());
        // Each edge within the strip is passed once in each direction.
        let strip = &fronts.triangles[1..];
        let passes = |from: u32, to: u32| {
            let along = |t: &&[u32; 3]| (0..3).any(|k| t[k] == from && t[(k + 1) % 3] == to);
            strip.iter().filter(along).count()
        };
        let edges: Vec<[u32; 2]> =
            strip.iter().flat_map(|t| (0..3).map(|k| [t[k], t[(k + 1) % 3]])).collect();
        assert!(edges.iter().all(|&[a, b]| passes(a, b) == 1), "{strip:?}");
        assert_eq!(fronts.count_with_backs(&fronts.triangles), 7);
        let canonical = |[a, b, c]: [u32; 3]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min();
        let mut again: Vec<_> = fronts.with_backs(&fronts.triangles).into_iter().map(canonical).collect();
        let mut before: Vec<_> = all.into_iter().map(canonical).collect();
        again.sort_unstable();
        before.sort_unstable();
        assert_eq!(again, before);
    }

    #[test]
    fn without_pairs_all_stays_as_it_is() {
        let all = [[0, 1, 2], [2, 1, 3]];
        let fronts = Fronts::of(&all, 4);
        assert_eq!(fronts.triangles, all);
        assert_eq!(fronts.with_backs(&all), all);
        assert!(!fronts.is_mixed() && fronts.shared.is_empty());
    }
}
