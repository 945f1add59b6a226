//! Cutting patches whose projection overlaps itself.

use std::collections::BTreeMap;

use fantex_mesh::Mesh;
use glam::{IVec2, Vec2};

use super::join::Patch;
use super::{Chart, facet_normal};

/// Triangles that the common direction sees worse than this get charts of their own.
const LEAST_FACING: f32 = 0.2;

/// Cells along the longer side of a patch in which overlaps are looked for, at most.
const MOST_CELLS: f32 = 4096.0;

/// How much a triangle is shrunk before its cells are taken, so that neighbours never meet: share of a cell.
const SHRINK: f32 = 1e-3;

/// The charts of a patch: mostly one.
pub(super) fn charts_of(mesh: &Mesh, patch: Patch, texels_per_unit: f32) -> Vec<Chart> {
    let mut charts = Vec::new();
    let (mut rest, hidden): (Vec<u32>, Vec<u32>) = patch
        .triangles
        .into_iter()
        .partition(|&t| facet_normal(mesh, t as usize).dot(patch.direction) >= LEAST_FACING);
    while !rest.is_empty() {
        let chart = Chart::new(mesh, rest, patch.direction);
        let taken = without_overlap(mesh, &chart, texels_per_unit);
        if taken.len() == chart.triangles.len() {
            charts.push(chart);
            break;
        }
        rest = Vec::with_capacity(chart.triangles.len() - taken.len());
        let mut taken_iter = taken.iter().peekable();
        for t in chart.triangles {
            if taken_iter.next_if_eq(&&t).is_none() {
                rest.push(t);
            }
        }
        charts.push(Chart::new(mesh, taken, patch.direction));
    }
    charts.extend(hidden.into_iter().map(|t| Chart::new(mesh, vec![t], facet_normal(mesh, t as usize))));
    charts
}

/// Triangles, ascending, that share no cell; taken in the order in which they hang together, so that what is left over hangs
/// together as well.
fn without_overlap(mesh: &Mesh, chart: &Chart, texels_per_unit: f32) -> Vec<u32> {
    let longest = chart.extent.max_element();
    let cells_per_unit = texels_per_unit.min(MOST_CELLS / longest.max(f32::MIN_POSITIVE));
    let width = (chart.extent.x * cells_per_unit) as usize + 2;
    let height = (chart.extent.y * cells_per_unit) as usize + 2;
    let mut is_taken = vec![0u64; (width * height).div_ceil(64)];
    let mut accepted = Vec::with_capacity(chart.triangles.len());
    let mut cells = Vec::new();
    for t in connected_order(mesh, &chart.triangles) {
        cells.clear();
        let corners = chart.corners(mesh, t).map(|q| q * cells_per_unit);
        visit_cells(corners, |cell| cells.push(cell.y as usize * width + cell.x as usize));
        if cells.iter().all(|&c| is_taken[c / 64] >> (c % 64) & 1 == 0) {
            cells.iter().for_each(|&c| is_taken[c / 64] |= 1 << (c % 64));
            accepted.push(t);
        }
    }
    accepted.sort_unstable();
    accepted
}

/// The triangles, each after one that it shares a vertex with, as far as they hang together.
fn connected_order(mesh: &Mesh, triangles: &[u32]) -> Vec<u32> {
    let mut around: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (i, &t) in (0u32..).zip(triangles) {
        mesh.triangles[t as usize].iter().for_each(|&v| around.entry(v).or_default().push(i));
    }
    let mut order = Vec::with_capacity(triangles.len());
    let mut is_seen = vec![false; triangles.len()];
    for start in 0..triangles.len() {
        if std::mem::replace(&mut is_seen[start], true) {
            continue;
        }
        let mut next = order.len();
        order.push(start as u32);
        while next < order.len() {
            let t = triangles[order[next] as usize];
            next += 1;
            for v in mesh.triangles[t as usize] {
                // A vertex' triangles are needed once.
                for i in around.get_mut(&v).map(std::mem::take).unwrap_or_default() {
                    if !std::mem::replace(&mut is_seen[i as usize], true) {
                        order.push(i);
                    }
                }
            }
        }
    }
    order.into_iter().map(|i| triangles[i as usize]).collect()
}

/// Visits the cells whose middles lie inside a triangle (in cells, not negative), not on its border.
fn visit_cells(corners: [Vec2; 3], mut visit: impl FnMut(IVec2)) {
    let [a, b, c] = corners;
    let area = (b - a).perp_dot(c - a);
    if area.abs() < 1e-9 {
        return;
    }
    let sides =
        [[b, c], [c, a], [a, b]].map(|[from, to]| (from, (to - from).normalize_or_zero() * area.signum()));
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let (first, last) = ((low - 0.5).ceil().max(Vec2::ZERO).as_ivec2(), (high - 0.5).floor().as_ivec2());
    for y in first.y..=last.y {
        for x in first.x..=last.x {
            let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            if sides.iter().all(|(from, along)| along.perp_dot(p - *from) > SHRINK) {
                visit(IVec2::new(x, y));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// A strip that winds one and a half times around the z axis, slowly rising: it overlaps itself seen from above.
    fn helix() -> Mesh {
        let steps = 48;
        let mut mesh = Mesh::default();
        for i in 0..=steps {
            let angle = i as f32 / 32.0 * std::f32::consts::TAU;
            let z = i as f32 * 0.005;
            for radius in [0.4, 0.9] {
                mesh.positions.push(Vec3::new(radius * angle.cos(), radius * angle.sin(), z));
            }
        }
        for i in 0..steps {
            mesh.triangles.extend([[2 * i, 2 * i + 1, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 2]]);
        }
        mesh
    }

    #[test]
    fn a_winding_strip_is_cut_where_it_comes_round() {
        let mesh = helix();
        let all: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
        let charts = charts_of(&mesh, Patch { triangles: all.clone(), direction: Vec3::Z }, 200.0);
        assert_eq!(charts.len(), 2);
        let mut triangles: Vec<u32> = charts.iter().flat_map(|c| c.triangles.clone()).collect();
        triangles.sort_unstable();
        assert_eq!(triangles, all);
    }

    #[test]
    fn neighbours_share_no_cell() {
        let mut count = vec![0; 100];
        for corners in [[[0.0, 0.0], [9.3, 0.0], [9.3, 9.3]], [[0.0, 0.0], [9.3, 9.3], [0.0, 9.3]]] {
            visit_cells(corners.map(Vec2::from), |c| count[(c.y * 10 + c.x) as usize] += 1);
        }
        assert!(count.iter().all(|&n| n <= 1));
        assert!(count.iter().sum::<i32>() > 70);
    }
}
