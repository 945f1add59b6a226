//! A model becomes an asset beside it, so that there is something to paint on.

use std::path::{Path, PathBuf};

use fantex::bake::Progress;
use fantex::base::Result;
use fantex::glam::Vec4;
use fantex::store::{Asset, ChannelKind};
use fantex::{Baker, LongestEdge, Mesh, Source};
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
    /// Texels; by default as many as a bake of the model's textures has, and 8 million where it has none.
    pub texels: Option<u64>,
    /// Channels besides colour, material and those that the model has.
    pub emission: bool,
    pub normal: bool,
    pub height: bool,
    /// Degrees from which on edges are hard: see [`Baker::hard_edges`].
    pub hard_edges: Option<f32>,
}

impl NewAsset {
    /// With the channels of an asset, too, and its hard edges unless others are chosen.
    pub(super) fn like(self, asset: &Asset) -> Self {
        let has = |kind| asset.channel_of_kind(kind).is_some();
        Self {
            emission: self.emission || has(ChannelKind::Emission),
            normal: self.normal || has(ChannelKind::Normal),
            height: self.height || has(ChannelKind::Displacement),
            hard_edges: self.hard_edges.or(asset.cover().hard_edges),
            ..self
        }
    }

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

/// Bakes what a mesh looks like into an asset that has colour and material to paint on. Returns what the user should know, a sentence each.
///
/// # Errors
/// The images of the model cannot be read, or it cannot be covered, baked or written; nobody waits for it any more. Nothing is left
/// behind then.
pub fn bake_model(
    mesh: &Mesh,
    new: &NewAsset,
    output: &Path,
    progress: &dyn Progress,
) -> Result<Vec<String>> {
    let grey = || Source::function(|_| Vec4::new(GREY, GREY, GREY, 1.0));
    let baker = Baker::new(mesh)
        .source(Source::of_model(mesh).unwrap_or_else(grey))
        .default_texels(TEXELS)
        // For what is painted on the grey, too.
        .longest_edge(LongestEdge::Automatic)
        .progress(progress);
    let baker = new.channels().fold(baker, |baker, (kind, value)| baker.channel(kind, value));
    let baker = match new.texels {
        Some(texels) => baker.texels(texels),
        None => baker,
    };
    let baker = match new.hard_edges {
        Some(degrees) => baker.hard_edges(degrees),
        None => baker,
    };
    Ok(baker.write(output)?.notes)
}

#[cfg(test)]
mod tests {
    use fantex::bake::NoProgress;
    use fantex::mesh::Material;
    use fantex::mesh::generate::{cube, torus};

    use super::*;

    #[test]
    fn plain_models_get_colour_and_material() {
        let folder = tempfile::tempdir().unwrap();
        let path = asset_beside(&folder.path().join("torus.ply"));
        assert!(path.ends_with("torus.fan"));
        let mesh = Mesh::from_model(torus(24, 12), "torus").unwrap();
        let new =
            NewAsset { texels: Some(20_000), emission: true, normal: true, height: true, hard_edges: None };
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
        let mut model = torus(24, 12);
        model.corners.colors = vec![Vec4::new(1.0, 1.0, 0.0, 1.0); 3 * model.triangles.len()];
        let new = NewAsset { texels: Some(20_000), ..NewAsset::default() };
        let red = Vec4::new(1.0, 0.0, 0.0, 1.0);
        for (color, green) in [(red, 0.0), (Vec4::ONE, 1.0)] {
            model.materials = vec![Material { base_color: color, ..Material::default() }];
            let mesh = Mesh::from_model(model.clone(), "torus").unwrap();
            let path = folder.path().join(format!("{green}.fan"));
            bake_model(&mesh, &new, &path, &NoProgress).unwrap();
            let mean = Asset::open(&path).unwrap().mean(0, 0);
            assert!((mean[0] - 1.0).abs() < 0.02 && (mean[1] - green).abs() < 0.02, "{mean:?}");
        }
    }

    /// A material without textures has factors, whose place the channels take.
    #[test]
    fn channels_that_a_model_lacks_hold_what_its_material_says() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("torus.fan");
        let emission = fantex::glam::Vec3::new(0.5, 0.0, 0.0);
        let gold = Material { metallic: 1.0, roughness: 0.2, emission, ..Material::default() };
        let model = fantex::mesh::Model { materials: vec![gold], ..torus(24, 12) };
        let mesh = Mesh::from_model(model, "torus").unwrap();
        let new = NewAsset { texels: Some(20_000), emission: true, ..NewAsset::default() };
        bake_model(&mesh, &new, &path, &NoProgress).unwrap();
        let asset = Asset::open(&path).unwrap();
        for (kind, wanted) in [
            (ChannelKind::OcclusionRoughnessMetallic, Vec4::new(1.0, 0.2, 1.0, 1.0)),
            (ChannelKind::Emission, Vec4::new(0.5, 0.0, 0.0, 1.0)),
        ] {
            let mean = Vec4::from(asset.mean(asset.channel_of_kind(kind).unwrap(), 0));
            assert!((mean - wanted).abs().max_element() < 0.02, "{kind:?}: {mean}");
        }
    }

    #[test]
    fn large_triangles_are_cut_as_in_any_bake() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = Mesh::from_model(cube(1), "cube").unwrap();
        let new = NewAsset { texels: Some(50_000), ..NewAsset::default() };
        let [painted, baked] = ["painted.fan", "baked.fan"].map(|name| folder.path().join(name));
        let notes = bake_model(&mesh, &new, &painted, &NoProgress).unwrap();
        assert!(notes.iter().any(|note| note.contains("12 triangles were cut into")), "{notes:?}");
        Baker::new(&mesh).source(Source::solid("wood")).texels(50_000).write(&baked).unwrap();
        let [painted, baked] = [painted, baked].map(|path| Asset::open(&path).unwrap());
        assert!(painted.mesh().triangles.len() > 100);
        assert_eq!(painted.mesh().triangles, baked.mesh().triangles);
        assert_eq!(painted.cover().groups, baked.cover().groups);
    }
}
