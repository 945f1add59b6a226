//! Which pieces may lie in a rectangle: a grid of cells over all of them.

use glam::DVec2;

use super::trapezoids::Piece;

/// About as many cells as pieces, each with the pieces whose boxes touch it (compressed rows).
#[derive(Clone, Debug, Default)]
pub(super) struct Grid {
    low: DVec2,
    /// Cells per unit.
    scale: DVec2,
    columns: usize,
    rows: usize,
    starts: Vec<u32>,
    pieces: Vec<u32>,
}

/// Lower and upper corner of a box around points.
pub(super) fn bounds(points: &[DVec2]) -> [DVec2; 2] {
    points.iter().fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], &p| [low.min(p), high.max(p)])
}

impl Grid {
    pub(super) fn new(pieces: &[Piece]) -> Self {
        if pieces.is_empty() {
            return Self::default();
        }
        let all: Vec<DVec2> = pieces.iter().flatten().copied().collect();
        let [low, high] = bounds(&all);
        let size = (high - low).max(DVec2::splat(1e-12));
        // Cells are about square.
        let cell = (size.x * size.y / pieces.len() as f64).sqrt();
        let along = |length: f64| ((length / cell).ceil() as usize).clamp(1, 4096);
        let (columns, rows) = (along(size.x), along(size.y));
        let scale = DVec2::new(columns as f64, rows as f64) / size;
        let mut grid =
            Self { low, scale, columns, rows, starts: vec![0; columns * rows + 1], pieces: Vec::new() };
        for piece in pieces {
            grid.cells(bounds(piece)).for_each(|cell| grid.starts[cell + 1] += 1);
        }
        for cell in 0..columns * rows {
            grid.starts[cell + 1] += grid.starts[cell];
        }
        let mut next = grid.starts.clone();
        grid.pieces = vec![0; next[columns * rows] as usize];
        for (index, piece) in (0..).zip(pieces) {
            for cell in grid.cells(bounds(piece)) {
                grid.pieces[next[cell] as usize] = index;
                next[cell] += 1;
            }
        }
        grid
    }

    /// Numbers of the cells that a box touches.
    fn cells(&self, [low, high]: [DVec2; 2]) -> impl Iterator<Item = usize> + use<> {
        let (columns, rows) = (self.columns, self.rows);
        let cell = |p: DVec2| ((p - self.low) * self.scale).floor();
        let (first, last) = (cell(low), cell(high));
        let outside = last.x < 0.0 || last.y < 0.0 || first.x > columns as f64 || first.y > rows as f64;
        let range = move |first: f64, last: f64, count: usize| {
            let most = count.saturating_sub(1);
            if outside || count == 0 {
                return 0..0;
            }
            (first.max(0.0) as usize).min(most)..(last.max(0.0) as usize).min(most) + 1
        };
        let column_range = range(first.x, last.x, columns);
        range(first.y, last.y, rows).flat_map(move |row| column_range.clone().map(move |c| row * columns + c))
    }

    /// The pieces whose cells a box touches, each once.
    pub(super) fn pieces_in(&self, bounds: [DVec2; 2]) -> Vec<u32> {
        let of_cell = |cell: usize| &self.pieces[self.starts[cell] as usize..self.starts[cell + 1] as usize];
        let mut found: Vec<u32> = self.cells(bounds).flat_map(of_cell).copied().collect();
        found.sort_unstable();
        found.dedup();
        found
    }
}
