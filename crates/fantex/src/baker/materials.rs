//! Which materials an asset has beside its tiles. What is in a channel of the tiles is read there; the rest is what the materials of the asset's
//! mesh say: what alpha means, sides, unlit, toon scales, and the factors of what has no channel.
//!
//! | source | materials |
//! |---|---|
//! | the model's own materials | the model's, as they are |
//! | colours from elsewhere: images, solids, closures, vertex colours | the model's without what its textures scale: [`without_textures`] |
//! | another model or asset | what the other one's materials have in common: [`of_transfer`] |
//! | photographs | names and sides: `of_photographs` |
//! | a look | the look's: [`of_look`] |
//!
//! The mesh of an asset, onto which something else is baked, has [`without_tiles`].

use std::borrow::Cow;
use std::sync::Arc;

use fantex_bake::baked_materials;
use fantex_mesh::{AlphaMode, Material, Mesh};
use fantex_store::{Asset, ChannelKind};
use fantex_texture::look::LookMaterial;
use glam::{Vec3, Vec4};

/// What a glTF primitive without a material has: metal, though nobody said so.
fn is_unsaid(material: &Material) -> bool {
    let unsaid = Material { metallic: 1.0, roughness: 1.0, double_sided: false, ..Material::default() };
    *material == unsaid
}

/// Whether a material says more than "white".
pub(crate) fn says_something(material: &Material) -> bool {
    let Material { base_color, metallic, roughness, emission, alpha, unlit, .. } = material;
    let plain = Material::default();
    let is_colored = (*base_color, *emission) != (plain.base_color, plain.emission);
    // Of a material from a file only: what stands for none says nothing by its factors.
    let is_of_file = !material.place.is_empty();
    let finish = (*metallic, *roughness, *alpha, *unlit);
    is_colored || is_of_file && finish != (plain.metallic, plain.roughness, plain.alpha, plain.unlit)
}

/// For colours from elsewhere: factors that were meant to scale a texture of the model say nothing by themselves. (A white glow, for example, would
/// cover the source's colours.)
pub(crate) fn without_textures(mesh: &Mesh) -> Cow<'_, Mesh> {
    let is_changed =
        |m: &Material| m.emission_texture.is_some() || m.metallic_roughness_texture.is_some() || is_unsaid(m);
    if !mesh.materials.iter().any(is_changed) {
        return Cow::Borrowed(mesh);
    }
    let mut mesh = mesh.clone();
    let plain = Material::default();
    for material in &mut mesh.materials {
        let is_unsaid = is_unsaid(material);
        if material.emission_texture.take().is_some() {
            material.emission = plain.emission;
        }
        if material.metallic_roughness_texture.take().is_some() || is_unsaid {
            (material.metallic, material.roughness) = (plain.metallic, plain.roughness);
        }
    }
    Cow::Owned(mesh)
}

/// The materials of an asset without what is in its tiles, whose factors say nothing by themselves.
pub(crate) fn without_tiles(asset: &Asset) -> Vec<Material> {
    let has_surface = asset.channels().iter().any(|c| c.kind == ChannelKind::OcclusionRoughnessMetallic);
    let plain = Material::default();
    let without = |material: &Material| {
        let material = Material { base_color: Vec4::ONE, emission: Vec3::ZERO, ..material.clone() };
        match has_surface {
            true => Material { metallic: plain.metallic, roughness: plain.roughness, ..material },
            false => material,
        }
    };
    asset.mesh().materials.iter().map(without).collect()
}

/// Photographs show the finished look: what the model's own materials would add to it, such as a glow, goes.
#[cfg(feature = "photos")]
pub(crate) fn of_photographs(mesh: &mut Mesh) {
    for material in &mut mesh.materials {
        let (name, double_sided) = (std::mem::take(&mut material.name), material.double_sided);
        *material = Material { name, double_sided, ..Material::default() };
    }
    mesh.images.clear();
}

/// Those of a look. With its light what is baked is the finished picture.
pub(crate) fn of_look(look: &[Arc<LookMaterial>], is_lit: bool) -> Vec<Material> {
    let mut materials = baked_materials(look);
    if is_lit {
        materials.iter_mut().for_each(|m| (m.unlit, m.emission) = (true, Vec3::ZERO));
    }
    materials
}

/// For a coarse mesh that is given what the materials of a detailed one show: where these have no channel, they are alike ([`AssetChannels`](super::channels::AssetChannels) sees to it),
/// and the coarse mesh gets what they have in common. A coarse mesh with the very materials of the detailed one keeps them.
pub(crate) fn of_transfer<'m>(coarse: &'m Mesh, detailed: &Mesh) -> Cow<'m, Mesh> {
    if coarse.materials == detailed.materials {
        return Cow::Borrowed(coarse);
    }
    let common = common(&used_materials(detailed));
    let mut mesh = coarse.clone();
    for material in &mut mesh.materials {
        let (name, place) = (std::mem::take(&mut material.name), std::mem::take(&mut material.place));
        *material = Material { name, place, ..common.clone() };
    }
    Cow::Owned(mesh)
}

/// The materials that a mesh's triangles have.
pub(super) fn used_materials(mesh: &Mesh) -> Vec<&Material> {
    let mut is_used = vec![false; mesh.materials.len()];
    for triangle in 0..mesh.triangles.len() {
        if let Some(is_used) = is_used.get_mut(mesh.material_of(triangle)) {
            *is_used = true;
        }
    }
    mesh.materials.iter().zip(is_used).filter_map(|(material, is_used)| is_used.then_some(material)).collect()
}

/// One material in the place of several. Their textures are in the tiles.
fn common(materials: &[&Material]) -> Material {
    let Some(first) = materials.first() else { return Material::default() };
    Material {
        base_color: first.base_color,
        metallic: first.metallic,
        roughness: first.roughness,
        emission: first.emission,
        alpha: materials.iter().map(|m| m.alpha).fold(AlphaMode::Opaque, joint_alpha),
        double_sided: materials.iter().any(|m| m.double_sided),
        unlit: materials.iter().all(|m| m.unlit),
        toon: first.toon.clone().filter(|_| materials.iter().all(|m| m.toon == first.toon)),
        ..Material::default()
    }
}

/// What alpha means where it means either: opaque parts have an alpha of one.
fn joint_alpha(a: AlphaMode, b: AlphaMode) -> AlphaMode {
    match (a, b) {
        (AlphaMode::Blend, _) | (_, AlphaMode::Blend) => AlphaMode::Blend,
        (AlphaMode::Mask(a), AlphaMode::Mask(b)) => AlphaMode::Mask(a.min(b)),
        (AlphaMode::Opaque, other) | (other, AlphaMode::Opaque) => other,
    }
}

#[cfg(test)]
mod tests {
    use fantex_base::Result;
    use fantex_mesh::generate::icosphere;

    use super::*;
    use crate::Baker;

    /// A ball; its upper half has the last material.
    fn ball(subdivisions: u32, materials: &[Material]) -> crate::Mesh {
        let mut model = icosphere(subdivisions);
        let is_upper = |t: &[u32; 3]| t.iter().all(|&v| model.positions[v as usize].y > 0.0);
        let last = materials.len() as u32 - 1;
        model.triangle_materials =
            model.triangles.iter().map(|t| if is_upper(t) { last } else { 0 }).collect();
        model.materials = materials.to_vec();
        crate::Mesh::from_model(model, "ball").unwrap()
    }

    /// As files have them.
    fn metal(roughness: f32) -> Material {
        let place = "material 0".to_owned();
        Material { place, metallic: 1.0, roughness, double_sided: false, ..Material::default() }
    }

    /// What a model without materials has that is read from glTF.
    fn unsaid() -> Material {
        Material { metallic: 1.0, roughness: 1.0, double_sided: false, ..Material::default() }
    }

    fn baked(mesh: &crate::Mesh, source: crate::Source<'_>) -> Result<crate::Asset> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ball.fan");
        Baker::new(mesh).source(source).texels(4000).write(&path)?;
        crate::Asset::open(&path)
    }

    fn has(asset: &crate::Asset, kind: ChannelKind) -> bool {
        asset.channels().iter().any(|channel| channel.kind == kind)
    }

    fn grey<'a>() -> crate::Source<'a> {
        crate::Source::function(|_| Vec4::splat(0.5))
    }

    #[test]
    fn a_coarse_model_gets_what_has_no_channel_of_the_detailed_one() {
        let glow = Vec3::new(0.25, 0.0, 0.0);
        let fine = ball(2, &[Material { emission: glow, unlit: true, ..metal(0.25) }]);
        let coarse = ball(1, &[Material { name: "coarse".into(), ..unsaid() }]);
        let asset = baked(&coarse, crate::Source::loaded_mesh(&fine, None)).unwrap();
        assert!(!has(&asset, ChannelKind::OcclusionRoughnessMetallic) && !has(&asset, ChannelKind::Emission));
        let material = &asset.mesh().materials[0];
        assert_eq!((material.metallic, material.roughness, material.emission), (1.0, 0.25, glow));
        assert_eq!((material.name.as_str(), material.unlit, material.double_sided), ("coarse", true, false));
        // Of an asset, as well.
        let again = baked(&coarse, crate::Source::asset(&asset, None)).unwrap();
        assert_eq!(again.mesh().materials, asset.mesh().materials);
    }

    #[test]
    fn cut_outs_stay_cut_out_on_a_coarse_mesh() {
        let with = |alpha| Material { alpha, ..metal(0.5) };
        let coarse = ball(1, &[unsaid()]);
        for (modes, expected) in [
            ([AlphaMode::Opaque; 2], AlphaMode::Opaque),
            ([AlphaMode::Opaque, AlphaMode::Mask(0.25)], AlphaMode::Mask(0.25)),
            ([AlphaMode::Mask(0.75), AlphaMode::Mask(0.25)], AlphaMode::Mask(0.25)),
            ([AlphaMode::Blend, AlphaMode::Mask(0.25)], AlphaMode::Blend),
        ] {
            let fine = ball(1, &modes.map(with));
            assert_eq!(of_transfer(&coarse, &fine).materials[0].alpha, expected);
            // With the materials of the detailed mesh each part keeps its own.
            assert_eq!(of_transfer(&fine, &fine).materials, fine.materials);
        }
    }

    #[test]
    fn materials_of_an_asset_that_differ_become_a_channel() {
        let fine = baked(&ball(2, &[metal(0.25), metal(0.75)]), grey()).unwrap();
        assert!(!has(&fine, ChannelKind::OcclusionRoughnessMetallic));
        let coarse = ball(1, &[unsaid()]);
        let asset = baked(&coarse, crate::Source::asset(&fine, None)).unwrap();
        assert!(has(&asset, ChannelKind::OcclusionRoughnessMetallic) && !has(&asset, ChannelKind::Emission));
        let sampler = asset.sampler(1 << 20);
        for (y, expected) in [(-1.0, 0.25), (1.0, 0.75)] {
            let point = asset.nearest_point([0.0, y, 0.0]).unwrap();
            let kind = ChannelKind::OcclusionRoughnessMetallic;
            let value = sampler.sample(kind, point, crate::Footprint::NONE).unwrap();
            assert!((value.y - expected).abs() < 0.02 && value.z > 0.98, "{value}");
        }
        // What lies in the tiles does not stay behind when something else is baked onto the mesh.
        let mesh = crate::Mesh::of_asset(&asset);
        let plain = Material::default();
        assert!(
            mesh.materials.iter().all(|m| (m.metallic, m.roughness) == (plain.metallic, plain.roughness))
        );
        assert!(!mesh.has_materials());
        // What is in no channel does.
        assert_eq!(crate::Mesh::of_asset(&fine).materials[1].roughness, 0.75);
    }

    #[test]
    fn colours_from_elsewhere_make_no_metal_that_nobody_asked_for() {
        let [none, said] = [unsaid(), metal(1.0)].map(|material| ball(1, &[material]));
        let material = &without_textures(&none).materials[0];
        let plain = Material::default();
        assert_eq!((material.metallic, material.roughness), (plain.metallic, plain.roughness));
        assert!(!material.double_sided);
        assert_eq!(without_textures(&said).materials, said.materials);
    }

    #[test]
    fn white_materials_of_files_count_unless_they_are_plain() {
        let plain = Material { place: "line 1".into(), ..Material::default() };
        let of = |material: &Material| ball(1, std::slice::from_ref(material)).has_materials();
        assert!(of(&metal(0.25)) && !of(&plain) && !of(&unsaid()));
        assert!(of(&Material { unlit: true, ..plain.clone() }));
        assert!(of(&Material { alpha: AlphaMode::Blend, ..plain }));
    }
}
