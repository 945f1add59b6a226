//! A model becomes an asset beside it, so that there is something to paint on.

use std::path::{Path, PathBuf};

use fantex::bake::{
    BakeOptions, LookSource, Prefilter, Progress, Source, SourceChannel, TexelPoint, VertexColorSource, bake,
};
use fantex::base::Result;
use fantex::cover::{CoverOptions, TexelBudget, build_cover};
use fantex::glam::{Vec3, Vec4};
use fantex::mesh::Mesh;
use fantex::store::ChannelKind;

/// Texels of a model whose own textures say nothing about how many it needs: with them a screen is filled sharply from nearby.
const TEXELS: u64 = 8_000_000;

/// Linear grey of models without any colour.
const GREY: f32 = 0.5;

/// Occlusion, roughness and metallic of models that do not say.
const PLAIN_MATERIAL: Vec4 = Vec4::new(1.0, 0.6, 0.0, 1.0);

/// Where a model's asset lies: beside it, with the same name.
pub fn asset_beside(model: &Path) -> PathBuf {
    model.with_extension("fan")
}

/// Covers a mesh and bakes what it looks like into an asset that has colour and material to paint on.
///
/// # Errors
/// The images of the model cannot be read, or it cannot be covered, baked or written. Nothing is left behind then.
pub fn bake_model(mesh: &Mesh, output: &Path, progress: &dyn Progress) -> Result<()> {
    if !mesh.corners.colors.is_empty()
        && let Ok(source) = VertexColorSource::new(mesh)
    {
        return write(mesh, TexelBudget::Total(TEXELS), &source, output, progress);
    }
    let says_something = |m: &fantex::mesh::Material| m.base_color != Vec4::ONE || m.emission != Vec3::ZERO;
    let source = LookSource::of_model(mesh)?;
    if source.has_textures() {
        return write(mesh, TexelBudget::PerTriangle(source.density()), &source, output, progress);
    }
    if mesh.materials.iter().any(says_something) {
        return write(mesh, TexelBudget::Total(TEXELS), &source, output, progress);
    }
    write(mesh, TexelBudget::Total(TEXELS), &Plain, output, progress)
}

fn write(
    mesh: &Mesh,
    budget: TexelBudget,
    source: &dyn Source,
    output: &Path,
    progress: &dyn Progress,
) -> Result<()> {
    let options = CoverOptions { budget, ..CoverOptions::default() };
    let (cover, _) = build_cover(mesh, &options)?;
    bake(mesh, &cover, &WithMaterial::of(source), output, &BakeOptions::default(), progress)?;
    Ok(())
}

struct Plain;

impl Source for Plain {
    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, _point: &TexelPoint, values: &mut [Vec4]) {
        values[0] = Vec4::new(GREY, GREY, GREY, 1.0);
    }
}

/// A source and, where it has none, a material.
struct WithMaterial<'a> {
    source: &'a dyn Source,
    channels: Vec<SourceChannel>,
    is_missing: bool,
}

impl<'a> WithMaterial<'a> {
    fn of(source: &'a dyn Source) -> Self {
        let kind = ChannelKind::OcclusionRoughnessMetallic;
        let mut channels = source.channels();
        let is_missing = channels.iter().all(|channel| channel.kind != kind);
        if is_missing {
            channels.push(SourceChannel::new(kind));
        }
        Self { source, channels, is_missing }
    }
}

impl Source for WithMaterial<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        self.channels.clone()
    }

    fn prefilter(&self) -> Prefilter {
        self.source.prefilter()
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        if let (true, Some((last, rest))) = (self.is_missing, values.split_last_mut()) {
            self.source.evaluate(point, rest);
            *last = PLAIN_MATERIAL;
        } else {
            self.source.evaluate(point, values);
        }
    }
}

#[cfg(test)]
mod tests {
    use fantex::bake::NoProgress;
    use fantex::mesh::generate::torus;
    use fantex::mesh::{CleanOptions, clean};
    use fantex::store::Asset;

    use super::*;

    #[test]
    fn plain_models_get_colour_and_material() {
        let folder = tempfile::tempdir().unwrap();
        let path = asset_beside(&folder.path().join("torus.ply"));
        assert!(path.ends_with("torus.fan"));
        let (mesh, _) = clean(torus(24, 12), &CleanOptions::default()).unwrap();
        write(&mesh, TexelBudget::Total(20_000), &Plain, &path, &NoProgress).unwrap();
        let asset = Asset::open(&path).unwrap();
        let kinds: Vec<_> = asset.channels().iter().map(|channel| channel.kind).collect();
        assert_eq!(kinds, [ChannelKind::BaseColor, ChannelKind::OcclusionRoughnessMetallic]);
        let mean = Vec4::from(asset.mean(1, 0));
        assert!((mean - PLAIN_MATERIAL).abs().max_element() < 0.02, "{mean}");
    }
}
