//! What another mesh or asset shows, as a source.

use std::path::Path;

use fantex_bake::{LookSource, Source, TransferOptions, TransferSource, VertexColorSource};
use fantex_base::{ErrorKind, Result};
use fantex_texture::material::LeftOut;

use super::channels::AssetChannels;
use super::materials::{of_transfer, without_textures};
use super::{Baked, Baker, Goal};
use crate::{Asset, Mesh};

impl Baker<'_> {
    /// Bakes another model's look and shape.
    pub(super) fn transfer_model(
        &self,
        detailed: &Mesh,
        cage: Option<f64>,
        goal: &Goal<'_>,
    ) -> Result<Baked> {
        goal.recipe().iter().for_each(|recipe| recipe.borrow_mut().add_mesh("the other model", detailed));
        let (materials, vertices);
        let mut left_out = LeftOut::default();
        let colors: Option<&dyn Source> = if detailed.has_materials() {
            materials = LookSource::of_model(detailed)?;
            left_out.clone_from(materials.left_out());
            Some(&materials)
        } else if detailed.has_vertex_colors() {
            vertices = VertexColorSource::new(detailed)?;
            Some(&vertices)
        } else {
            None
        };
        self.leave_out(&left_out, goal)?;
        let named = |note: &String| format!("{}: {note}", detailed.path().display());
        let lacking = left_out.notes();
        let notes: Vec<String> = detailed.notes().iter().chain(&lacking).map(named).collect();
        let detail = (colors, detailed.has_materials());
        let baked = self.transfer(detailed, detail, detailed.path(), cage, goal)?;
        Ok(Baked { notes: notes.into_iter().chain(baked.notes).collect(), left_out, ..baked })
    }

    /// Bakes what another asset holds, and its shape.
    pub(super) fn transfer_asset(&self, asset: &Asset, cage: Option<f64>, goal: &Goal<'_>) -> Result<Baked> {
        goal.recipe().iter().for_each(|recipe| recipe.borrow_mut().add_asset("the other asset", asset));
        let source = AssetChannels::all_of(asset.shared(), self.options.memory_bytes / 4);
        self.transfer(asset.mesh(), (Some(&source), true), asset.path(), cage, goal)
    }

    /// Bakes the shape of a mesh and a source on it, and says how well the two meshes fit. With the source: whether it is what the mesh's materials show.
    fn transfer(
        &self,
        detailed: &fantex_mesh::Mesh,
        (detail, of_materials): (Option<&dyn Source>, bool),
        path: &Path,
        cage: Option<f64>,
        goal: &Goal<'_>,
    ) -> Result<Baked> {
        let mesh = self.refined(self.mesh, self.cuts(goal), None)?;
        let mesh = if of_materials { of_transfer(&mesh, detailed) } else { without_textures(&mesh) };
        let options = TransferOptions { cage, ..TransferOptions::default() };
        let source = TransferSource::new(&mesh, detailed, detail, &options)?;
        let baked = self.bake(&mesh, &source, None, goal);
        let mut baked = baked.map_err(|error| match error.kind() {
            ErrorKind::Damaged => error.in_file(path),
            _ => error,
        })?;
        let report = source.report();
        // Single points at rims say nothing.
        if report.missed > report.points / 1000 {
            baked.notes.push(format!(
                "{}: {:.1} % of the points found nothing within the cage of {} world units along their normal and took the \
                 nearest point; where that is wrong, give a longer cage",
                path.display(),
                100.0 * report.missed as f64 / report.points as f64,
                in_three_digits(report.cage)
            ));
        }
        Ok(baked)
    }
}

/// A length to three digits, whatever its unit.
fn in_three_digits(length: f64) -> String {
    let power = if length > 0.0 { length.log10().floor() as i32 } else { 0 };
    let decimals = (2 - power).max(0) as usize;
    match power {
        -4..=5 => format!("{length:.decimals$}"),
        _ => format!("{length:.2e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_three_digits_in_every_unit() {
        let said = [0.021, 1.0, 87.83, 4321.4, 8.783e7, 2.5e-9, 0.0].map(in_three_digits);
        assert_eq!(said, ["0.0210", "1.00", "87.8", "4321", "8.78e7", "2.50e-9", "0.00"]);
    }
}
