//! Coarser levels.
//!
//! A texel of the next level is the mean of those it covers, weighted by the solid angle that each subtends, so that the
//! light of the whole map is the same at every level. Sides are halved and rounded down; where a side is odd, a texel of
//! the next level covers parts of texels, which count by their share.

use glam::Vec3A;
use rayon::prelude::*;

use super::level::Level;

/// The next coarser level, or nothing below one texel per chart.
pub(super) fn halve(fine: &Level) -> Option<Level> {
    if fine.size == [1, 1] {
        return None;
    }
    let size = fine.size.map(|n| (n / 2).max(1));
    let [columns, rows] = [0, 1].map(|axis| spans(fine.size[axis], size[axis]));
    let row_count = size[1] as usize;
    let inner: Vec<Vec3A> = (0..fine.form.charts() * row_count)
        .into_par_iter()
        .flat_map_iter(|row| {
            let (chart, row_span) = (row / row_count, &rows[row % row_count]);
            columns.iter().map(move |column_span| mean(fine, chart, column_span, row_span))
        })
        .collect();
    Some(Level::new(fine.form, size, &inner))
}

/// The fine texels under a coarse one along one axis, with the share of each.
type Span = Vec<(i32, f32)>;

fn spans(fine: u32, coarse: u32) -> Vec<Span> {
    // In units of 1 / coarse of a fine texel everything is a whole number.
    let [fine, coarse] = [u64::from(fine), u64::from(coarse)];
    (0..coarse)
        .map(|i| {
            let (begin, end) = (i * fine, (i + 1) * fine);
            (begin / coarse..end.div_ceil(coarse))
                .map(|texel| {
                    let covered = ((texel + 1) * coarse).min(end) - (texel * coarse).max(begin);
                    (texel as i32, covered as f32 / coarse as f32)
                })
                .collect()
        })
        .collect()
}

fn mean(fine: &Level, chart: usize, columns: &Span, rows: &Span) -> Vec3A {
    let (mut sum, mut weights) = (Vec3A::ZERO, 0.0);
    for &(y, row_share) in rows {
        for &(x, column_share) in columns {
            let uv = fine.texel_uv(x, y);
            if fine.form.is_inside(uv) {
                let weight = row_share * column_share * fine.form.texel_steradians(fine.size, x, y);
                sum += fine.texel(chart, x, y) * weight;
                weights += weight;
            }
        }
    }
    // A coarse texel may lie outside a disc with all it covers; it is not its own then, and will be filled.
    if weights > 0.0 { sum / weights } else { Vec3A::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_share_all_texels_out() {
        for (fine, coarse) in [(8, 4), (7, 3), (5, 2), (3, 1), (1, 1), (101, 50)] {
            let spans = spans(fine, coarse);
            let mut total = vec![0.0; fine as usize];
            for span in &spans {
                let width: f32 = span.iter().map(|s| s.1).sum();
                assert!((width - fine as f32 / coarse as f32).abs() < 1e-4);
                span.iter().for_each(|&(texel, share)| total[texel as usize] += share);
            }
            assert!(total.iter().all(|t: &f32| (t - 1.0).abs() < 1e-4), "{fine} to {coarse}: {total:?}");
        }
    }
}
