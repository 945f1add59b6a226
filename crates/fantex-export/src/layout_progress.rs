//! What is told of the work on a layout of charts.

use fantex_bake::Progress;
use fantex_mesh::Mesh;

/// How far the work on texture coordinates is, as a step of its own in texels of the surface.
pub(crate) struct LayoutProgress<'a> {
    progress: &'a dyn Progress,
    texels: u64,
}

impl<'a> LayoutProgress<'a> {
    /// The share of the time that has gone, for a scan of a million triangles, once one direction sees each chart,
    pub(crate) const PROJECTED: f64 = 0.15;
    /// once unions begin,
    pub(crate) const RELAXED: f64 = 0.3;
    /// once there are no more unions,
    pub(crate) const UNITED: f64 = 0.8;
    /// once charts are ready to be packed.
    pub(crate) const CUT: f64 = 0.9;

    /// Begins the step.
    pub(crate) fn new(mesh: &Mesh, texels_per_unit: f32, progress: &'a dyn Progress) -> Self {
        let texels = mesh.area() * f64::from(texels_per_unit).powi(2);
        let begun = Self { progress, texels: (texels as u64).max(1) };
        begun.reach(0.0);
        begun
    }

    /// So much is done, 0 to 1.
    pub(crate) fn reach(&self, share: f64) {
        if !self.is_cancelled() {
            self.progress.report((share * self.texels as f64) as u64, self.texels);
        }
    }

    /// Who is told.
    pub(crate) fn progress(&self) -> &'a dyn Progress {
        self.progress
    }

    pub(crate) fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}
