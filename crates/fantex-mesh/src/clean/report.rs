//! What cleaning found and did.

use super::Topology;
use crate::counted;

/// Counts of everything that cleaning changed or noticed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CleanReport {
    /// Triangles of the model.
    pub triangles_in: u64,
    /// Positions of the model.
    pub vertices_in: u64,
    /// Vertices merged into an earlier one at the same place.
    pub vertices_welded: u64,
    /// Vertices dropped because no remaining triangle uses them.
    pub vertices_isolated: u64,
    /// Triangles dropped because a position is NaN, infinite or beyond 1e100.
    pub triangles_non_finite: u64,
    /// Triangles dropped because they have no area.
    pub triangles_degenerate: u64,
    /// Triangles dropped because an earlier one has the same vertices in the same order.
    pub triangles_duplicate: u64,
    /// Texture coordinates, colours, normals and tangents of corners that are NaN or infinite: replaced by zero, white, or the
    /// triangle's own.
    pub corner_values_non_finite: u64,
    /// Pairs of triangles with the same vertices in opposite order; both are kept.
    pub double_sided_pairs: u64,
    /// Triangles turned round to agree with their neighbours.
    pub triangles_flipped: u64,
    /// Patches that have no consistent orientation (Moebius strips and the like).
    pub non_orientable_components: u64,
    /// The cleaned mesh.
    pub topology: Topology,
}

impl CleanReport {
    /// One sentence for each finding that is not zero.
    pub fn lines(&self) -> Vec<String> {
        let shape = &self.topology;
        let findings = [
            (self.triangles_non_finite, "triangle", "dropped: a position is not a usable number"),
            (self.triangles_degenerate, "triangle", "dropped: no area"),
            (self.triangles_duplicate, "triangle", "dropped: the same vertices as an earlier triangle"),
            (
                self.corner_values_non_finite,
                "corner value",
                "replaced: a texture coordinate, colour or normal is not a usable number",
            ),
            (self.vertices_welded, "vertex", "welded to an earlier vertex at the same place"),
            (self.vertices_isolated, "vertex", "dropped: no triangle uses it"),
            (
                self.double_sided_pairs,
                "double-sided pair",
                "of triangles kept: same vertices, opposite order",
            ),
            (self.triangles_flipped, "triangle", "turned round to agree with the neighbours"),
            (self.non_orientable_components, "patch", "left with a seam: it has no consistent orientation"),
            (shape.edges_inconsistent, "edge", "left between triangles of opposite orientation"),
            (shape.edges_non_manifold, "edge", "shared by more than two triangles"),
            (shape.vertices_non_manifold, "vertex", "whose triangles do not form a single fan"),
            (shape.edges_boundary, "edge", "on the boundary"),
        ];
        let sentence = |(n, noun, fact)| format!("{} {fact}.", counted(n, noun));
        findings.into_iter().filter(|f| f.0 > 0).map(sentence).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clean_mesh_has_nothing_to_say() {
        assert!(CleanReport { triangles_in: 12, vertices_in: 8, ..Default::default() }.lines().is_empty());
    }

    #[test]
    fn findings_are_counted_in_words() {
        let report = CleanReport { vertices_welded: 2, triangles_degenerate: 1, ..Default::default() };
        assert_eq!(
            report.lines(),
            ["1 triangle dropped: no area.", "2 vertices welded to an earlier vertex at the same place."]
        );
    }
}
