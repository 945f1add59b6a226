//! A model becomes an asset beside it, so that there is something to paint on.

use std::path::{Path, PathBuf};

use fantex::bake::{
    BakeOptions, LookSource, Prefilter, Progress, Source, SourceChannel, TexelPoint, VertexColorSource, bake,
};
use fantex::base::Result;
use fantex::budget_texels;
use fantex::cover::{CoverOptions, TexelBudget, build_cover};
use fantex::glam::{Vec3, Vec4};
use fantex::mesh::Mesh;
use fantex::store::ChannelKind;
use serde::{Deserialize, Serialize};

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

/// What a model's asset is to be like.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NewAsset {
    /// Texels; by default as many as the model's textures have, and 8 million where it has none.
    pub texels: Option<u64>,
    /// Channels besides colour, material and those that the model has.
    pub emission: bool,
    pub normal: bool,
    pub height: bool,
}

impl NewAsset {
    /// Kinds of channels that it is to have in any case, with what they are where the model does not say.
    fn channels(&self) -> impl Iterator<Item = (ChannelKind, Vec4)> {
        let black = Vec4::new(0.0, 0.0, 0.0, 1.0);
        let middle = Vec4::new(0.5, 0.5, 0.5, 1.0);
        [
            (true, ChannelKind::OcclusionRoughnessMetallic, PLAIN_MATERIAL),
            (self.emission, ChannelKind::Emission, black),
            // The mesh's own.
            (self.normal, ChannelKind::Normal, Vec4::ZERO),
            (self.height, ChannelKind::Displacement, middle),
        ]
        .into_iter()
        .filter_map(|(is_wanted, kind, value)| is_wanted.then_some((kind, value)))
    }
}

/// The channels that a model says something about, and the texels of its textures where it has any.
///
/// # Errors
/// Its images cannot be read.
pub fn model_texels(mesh: &Mesh) -> Result<(Vec<ChannelKind>, Option<u64>)> {
    let source = LookSource::of_model(mesh)?;
    let kinds = source.channels().iter().map(|channel| channel.kind).collect();
    let budget = source.has_textures().then(|| TexelBudget::PerTriangle(source.density()));
    let texels = budget.map(|budget| budget_texels(mesh, &budget) as u64);
    Ok((kinds, texels))
}

/// Covers a mesh and bakes what it looks like into an asset that has colour and material to paint on.
///
/// # Errors
/// The images of the model cannot be read, or it cannot be covered, baked or written. Nothing is left behind then.
pub fn bake_model(mesh: &Mesh, new: &NewAsset, output: &Path, progress: &dyn Progress) -> Result<()> {
    let total = TexelBudget::Total(new.texels.unwrap_or(TEXELS));
    let write = |budget, source: &dyn Source| write(mesh, budget, source, new, output, progress);
    let says_something = |m: &fantex::mesh::Material| m.base_color != Vec4::ONE || m.emission != Vec3::ZERO;
    let source = LookSource::of_model(mesh)?;
    if source.has_textures() {
        return write(
            new.texels.map_or_else(|| TexelBudget::PerTriangle(source.density()), TexelBudget::Total),
            &source,
        );
    }
    if mesh.materials.iter().any(says_something) {
        return write(total, &source);
    }
    // Materials that say something have taken these in.
    if !mesh.corners.colors.is_empty()
        && let Ok(source) = VertexColorSource::new(mesh)
    {
        return write(total, &source);
    }
    write(total, &Plain)
}

fn write(
    mesh: &Mesh,
    budget: TexelBudget,
    source: &dyn Source,
    new: &NewAsset,
    output: &Path,
    progress: &dyn Progress,
) -> Result<()> {
    let options = CoverOptions { budget, ..CoverOptions::default() };
    let (cover, _) = build_cover(mesh, &options)?;
    bake(mesh, &cover, &WithChannels::of(source, new), output, &BakeOptions::default(), progress)?;
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

/// A source and the channels that it lacks.
struct WithChannels<'a> {
    source: &'a dyn Source,
    channels: Vec<SourceChannel>,
    /// Values of those at the end.
    missing: Vec<(ChannelKind, Vec4)>,
}

impl<'a> WithChannels<'a> {
    fn of(source: &'a dyn Source, new: &NewAsset) -> Self {
        let mut channels = source.channels();
        let is_missing = |kind: ChannelKind| channels.iter().all(|channel| channel.kind != kind);
        let missing: Vec<_> = new.channels().filter(|(kind, _)| is_missing(*kind)).collect();
        channels.extend(missing.iter().map(|(kind, _)| SourceChannel::new(*kind)));
        Self { source, channels, missing }
    }
}

impl Source for WithChannels<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        self.channels.clone()
    }

    fn prefilter(&self) -> Prefilter {
        self.source.prefilter()
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let (known, missing) = values.split_at_mut(self.channels.len() - self.missing.len());
        self.source.evaluate(point, known);
        for (value, (kind, plain)) in missing.iter_mut().zip(&self.missing) {
            *value = if *kind == ChannelKind::Normal { point.normal.extend(0.0) } else { *plain };
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
        let new = NewAsset { texels: Some(20_000), emission: true, normal: true, height: true };
        bake_model(&mesh, &new, &path, &NoProgress).unwrap();
        let asset = Asset::open(&path).unwrap();
        let kinds: Vec<_> = asset.channels().iter().map(|channel| channel.kind).collect();
        let wanted = [
            ChannelKind::BaseColor,
            ChannelKind::OcclusionRoughnessMetallic,
            ChannelKind::Emission,
            ChannelKind::Normal,
            ChannelKind::Displacement,
        ];
        assert_eq!(kinds, wanted);
        assert!(asset.cover().stored_texels(asset.mesh()) < 25_000);
        let flat = Vec4::from(asset.mean(3, 0)).truncate().truncate();
        assert!((flat - 0.5).abs().max_element() < 0.02, "{flat}");
        assert!((asset.mean(4, 0)[0] - 0.5).abs() < 0.02);
        let mean = Vec4::from(asset.mean(1, 0));
        assert!((mean - PLAIN_MATERIAL).abs().max_element() < 0.02, "{mean}");
    }

    /// Red materials take vertex colours in; white ones say nothing.
    #[test]
    fn materials_come_before_vertex_colours() {
        let folder = tempfile::tempdir().unwrap();
        let (mut mesh, _) = clean(torus(24, 12), &CleanOptions::default()).unwrap();
        mesh.corners.colors = vec![Vec4::new(1.0, 1.0, 0.0, 1.0); 3 * mesh.triangles.len()];
        let new = NewAsset { texels: Some(20_000), ..NewAsset::default() };
        let red = Vec4::new(1.0, 0.0, 0.0, 1.0);
        for (color, green) in [(red, 0.0), (Vec4::ONE, 1.0)] {
            mesh.materials =
                vec![fantex::mesh::Material { base_color: color, ..fantex::mesh::Material::default() }];
            let path = folder.path().join(format!("{green}.fan"));
            bake_model(&mesh, &new, &path, &NoProgress).unwrap();
            let mean = Asset::open(&path).unwrap().mean(0, 0);
            assert!((mean[0] - 1.0).abs() < 0.02 && (mean[1] - green).abs() < 0.02, "{mean:?}");
        }
    }
}
