//! Sets of directions, coarse and of constant size.

use glam::{Vec2, Vec2Swizzles, Vec3};

/// Cells along a side of the octahedral map (Q. Meyer et al., "On Floating-Point Normal Vectors", 2010): a cell is within 8 degrees of its middle.
const CELLS: usize = 32;

/// Which cells of the sphere a piece's normals fall into. What one projection can show is decided by the extreme normals, and
/// they survive joining without looking at triangles again.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct NormalSet([u64; CELLS * CELLS / 64]);

impl NormalSet {
    pub(super) fn insert(&mut self, normal: Vec3) {
        let n = normal / normal.abs().element_sum().max(f32::MIN_POSITIVE);
        let mut p = n.truncate();
        if n.z < 0.0 {
            p = folded(p);
        }
        let cell = |c: f32| ((c * 0.5 + 0.5) * CELLS as f32).clamp(0.0, CELLS as f32 - 1.0) as usize;
        let index = cell(p.y) * CELLS + cell(p.x);
        self.0[index / 64] |= 1 << (index % 64);
    }

    pub(super) fn union(&self, other: &Self) -> Self {
        let mut union = *self;
        union.0.iter_mut().zip(&other.0).for_each(|(a, b)| *a |= b);
        union
    }

    /// The least cosine between a unit direction and the middles of the cells.
    pub(super) fn least_cosine(&self, direction: Vec3) -> f32 {
        let mut least = 1.0f32;
        for (word, &bits) in self.0.iter().enumerate() {
            let mut bits = bits;
            while bits != 0 {
                let index = 64 * word + bits.trailing_zeros() as usize;
                least = least.min(direction.dot(middle(index)));
                bits &= bits - 1;
            }
        }
        least
    }
}

/// The lower half of the octahedron is folded outwards.
fn folded(p: Vec2) -> Vec2 {
    (1.0 - p.yx().abs()) * Vec2::ONE.copysign(p)
}

/// The direction in the middle of a cell.
fn middle(index: usize) -> Vec3 {
    let coordinate = |cell: usize| (cell as f32 + 0.5) / CELLS as f32 * 2.0 - 1.0;
    let p = Vec2::new(coordinate(index % CELLS), coordinate(index / CELLS));
    let z = 1.0 - p.x.abs() - p.y.abs();
    let p = if z < 0.0 { folded(p) } else { p };
    p.extend(z).normalize_or(Vec3::Z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_knows_its_normals_to_a_few_degrees() {
        for i in 0..1000 {
            let angle = i as f32;
            let z = (i as f32 / 500.0) - 1.0;
            let r = (1.0 - z * z).max(0.0).sqrt();
            let normal = Vec3::new(r * angle.cos(), r * angle.sin(), z);
            let mut set = NormalSet::default();
            set.insert(normal);
            let off = set.least_cosine(normal).acos().to_degrees();
            assert!(off < 8.0, "{normal}: {off} degrees");
        }
    }
}
