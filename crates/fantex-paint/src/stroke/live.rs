//! Strokes whose samples come one after the other, from a hand.

use super::{Brush, Sample, Spacer, Symmetry, Way, mesh_length};
use crate::{Dab, Surface};

/// A stroke that is being drawn. Its dabs are those of [`dabs_of`](crate::dabs_of), though copies take turns.
#[derive(Clone, Debug)]
pub struct LiveStroke {
    brush: Brush,
    symmetry: Symmetry,
    /// Mesh units.
    diameter: f32,
    /// Per copy.
    ways: Vec<Way>,
}

impl LiveStroke {
    /// Begins a stroke; dabs come with its samples.
    pub fn new(surface: &Surface, brush: Brush, symmetry: Symmetry) -> Self {
        let ways = vec![Way::new(&brush); symmetry.count() as usize];
        Self { diameter: mesh_length(surface, brush.size), ways, brush, symmetry }
    }

    /// The pen leaves the surface: the next sample begins anew.
    pub fn lift(&mut self) {
        self.ways.iter_mut().for_each(|way| way.last = None);
    }

    /// The dabs up to a sample. With the last one (`is_end`) a smoothed stroke catches up.
    pub fn go_to(&mut self, surface: &Surface, sample: &Sample, is_end: bool) -> Vec<Dab> {
        let mut dabs = Vec::new();
        let reach = 0.5 * self.diameter;
        for (k, way) in (0u32..).zip(&mut self.ways) {
            let sample = if k == 0 { Some(*sample) } else { self.symmetry.moved(surface, sample, k, reach) };
            match sample {
                Some(sample) => {
                    let mut spacer =
                        Spacer { surface, brush: &self.brush, diameter: self.diameter, way: way.clone() };
                    spacer.go_to(&sample, is_end, &mut dabs);
                    *way = spacer.way;
                }
                // No surface there: what comes after is a stroke of its own.
                None => *way = Way::new(&self.brush),
            }
        }
        dabs
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use fantex_cover::{CoverOptions, build_cover};
    use fantex_mesh::generate::torus;
    use fantex_mesh::{CleanOptions, clean};
    use glam::Vec3;

    use super::*;
    use crate::{Stroke, SurfacePoint, dabs_of};

    #[test]
    fn samples_one_by_one_give_the_dabs_of_the_whole_stroke() {
        let (mesh, _) = clean(torus(32, 16), &CleanOptions::default()).unwrap();
        let (cover, _) = build_cover(&mesh, &CoverOptions::default()).unwrap();
        let surface = Surface::new(Arc::new(mesh), Arc::new(cover));
        let point = |triangle| SurfacePoint { triangle, lambda: Vec3::splat(1.0 / 3.0) };
        let samples: Vec<Sample> = [0, 3, 9, 14].map(|t| Sample::at(point(t))).into();
        let brush = Brush { smoothing: 0.4, ..Brush::default() };
        for symmetry in [Symmetry::None, Symmetry::Mirror { axis: 0, offset: 0.0 }] {
            let mut live = LiveStroke::new(&surface, brush.clone(), symmetry);
            let mut found = Vec::new();
            for (k, sample) in samples.iter().enumerate() {
                found.extend(live.go_to(&surface, sample, k + 1 == samples.len()));
            }
            let stroke = Stroke { brush: brush.clone(), samples: samples.clone(), line: false, symmetry };
            let whole = dabs_of(&surface, &stroke);
            let key = |dab: &crate::Dab| (dab.center.triangle, dab.center.lambda.x.to_bits());
            let sorted = |dabs: &[crate::Dab]| {
                let mut keys: Vec<_> = dabs.iter().map(key).collect();
                keys.sort_unstable();
                keys
            };
            assert!(whole.len() > 4);
            assert_eq!(sorted(&found), sorted(&whole));
        }
    }
}
