//! A model's own materials as looks.

use std::path::Path;

use fantex_base::ErrorKind;
use fantex_look::{LookFile, LookImages, ResolveOptions, look_of_model, materials_of_model};
use fantex_mesh::{
    AlphaMode, CleanOptions, ImageSource, Material, Mesh, TextureRef, ToonInterpolation, ToonScale, WrapMode,
    clean, generate,
};
use fantex_texture::look::{LightingModel, LookMaterial, NormalSpace, Opacity, Relief, Slot, TangentSpace};
use fantex_texture::material::LeftOut;
use fantex_texture::{Filtering, Image, ShadingPoint, Texture, UvPoint};
use glam::{Mat3, Vec2, Vec3, Vec4};

const TEXEL: Vec4 = Vec4::new(0.25, 0.5, 0.75, 0.5);

/// A cube with one material that uses one small image for everything.
fn model(folder: &Path) -> Mesh {
    let path = folder.join("texels.exr");
    Image::from_linear_rgba(2, 2, &[TEXEL.to_array(); 4]).save(&path).unwrap();
    let mut mesh = clean(generate::cube(1), &CleanOptions::default()).unwrap().0;
    let corners = 3 * mesh.triangles.len();
    mesh.corners.uv_sets = vec![vec![Vec2::splat(0.5); corners]];
    mesh.corners.colors = vec![Vec4::new(0.5, 1.0, 0.5, 1.0); corners];
    mesh.images = vec![ImageSource::File(path)];
    let texture = || {
        Some(TextureRef {
            image: 0,
            uv_set: 0,
            uv_transform: Mat3::IDENTITY,
            wrap: [WrapMode::Repeat; 2],
            nearest: false,
        })
    };
    mesh.materials = vec![Material {
        name: "paint".into(),
        base_color: Vec4::new(0.5, 0.25, 1.0, 1.0),
        base_color_texture: texture(),
        metallic: 0.5,
        roughness: 0.25,
        metallic_roughness_texture: texture(),
        occlusion_strength: 0.5,
        occlusion_texture: texture(),
        emission: Vec3::new(2.0, 0.0, 1.0),
        emission_texture: texture(),
        normal_texture: texture(),
        normal_scale: 0.7,
        alpha: AlphaMode::Mask(0.3),
        unlit: true,
        toon: Some(ToonScale {
            stops: vec![(0.0, Vec3::ZERO), (0.5, Vec3::ONE)],
            interpolation: ToonInterpolation::Constant,
        }),
        ..Material::default()
    }];
    mesh
}

fn materials(mesh: &Mesh) -> (Vec<LookMaterial>, LeftOut) {
    let options = ResolveOptions::default();
    materials_of_model(mesh, Path::new("model.gltf"), &LookImages::default(), options).unwrap()
}

fn value(slot: &Slot) -> Vec4 {
    let uv = [UvPoint { uv: Vec2::splat(0.5), steps: [Vec2::ZERO; 2] }];
    slot.evaluate(&ShadingPoint {
        position: Vec3::ZERO,
        position_steps: [Vec3::ZERO; 2],
        normal: Vec3::Z,
        normal_steps: [Vec3::ZERO; 2],
        uv: &uv,
        vertex_color: Vec4::new(0.5, 1.0, 0.5, 1.0),
        eye: None,
        time: 0.0,
        filtering: Filtering::Own,
    })
}

#[track_caller]
fn close(slot: &Slot, expected: Vec4) {
    let got = value(slot);
    assert!((got - expected).abs().max_element() < 1e-3, "{got} against {expected}");
}

#[test]
fn every_channel_of_a_material_is_translated() {
    let folder = tempfile::tempdir().unwrap();
    let material = &materials(&model(folder.path())).0[0];
    // Factor, vertex colour and texel.
    close(&material.base_color, Vec4::new(0.0625, 0.125, 0.375, 0.5));
    assert!((value(&material.metallic).x - 0.375).abs() < 1e-3);
    assert!((value(&material.roughness).x - 0.125).abs() < 1e-3);
    assert!((value(&material.occlusion).x - 0.625).abs() < 1e-3);
    assert!((value(&material.emission).truncate() - Vec3::new(0.5, 0.0, 0.75)).abs().max_element() < 1e-3);
    assert!(matches!(material.relief.as_slice(), [Relief::Normal { scale, .. }] if *scale == 0.7));
    assert!(matches!(material.opacity, Opacity::Mask { threshold } if threshold == 0.3));
    assert_eq!(material.lighting, LightingModel::Unlit);
    assert_eq!(material.toon.as_ref().unwrap().color(0.6), Vec4::ONE);
}

#[test]
fn materials_may_collapse_their_coordinates() {
    let folder = tempfile::tempdir().unwrap();
    let mut mesh = model(folder.path());
    let collapsed = Mat3::from_diagonal(Vec3::new(0.0, 1.0, 1.0));
    mesh.materials[0].base_color_texture.as_mut().unwrap().uv_transform = collapsed;
    close(&materials(&mesh).0[0].base_color, Vec4::new(0.0625, 0.125, 0.375, 0.5));
}

#[test]
fn normal_maps_lie_in_the_transformed_coordinates() {
    let folder = tempfile::tempdir().unwrap();
    let mut mesh = model(folder.path());
    let transform = Mat3::from_angle(1.0);
    mesh.materials[0].normal_texture.as_mut().unwrap().uv_transform = transform;
    let expected = TangentSpace { uv_set: 0, uv_transform: transform, of_model: true };
    let material = &materials(&mesh).0[0];
    assert!(
        matches!(material.relief.as_slice(), [Relief::Normal { space: NormalSpace::Tangent(space), .. }] if *space == expected)
    );
}

#[test]
fn uses_of_one_image_share_its_texture() {
    let folder = tempfile::tempdir().unwrap();
    let material = &materials(&model(folder.path())).0[0];
    let [metallic, roughness, occlusion] = [&material.metallic, &material.roughness, &material.occlusion]
        .map(|slot| match slot {
            Slot::Texture(texture) => texture.as_use().unwrap(),
            Slot::Constant(value) => panic!("{value}"),
        });
    let address = |texture: &dyn Texture| std::ptr::from_ref(texture).cast::<()>();
    assert_eq!(address(&*metallic.texture), address(&*roughness.texture));
    assert_eq!(address(&*metallic.texture), address(&*occlusion.texture));
}

#[test]
fn a_translated_look_is_a_look() {
    let folder = tempfile::tempdir().unwrap();
    let translated = look_of_model(&model(folder.path()));
    let text = translated.look.to_toml().unwrap();
    let file = LookFile::parse(&text, Path::new("look.toml")).unwrap();
    assert_eq!(file.look(), &translated.look, "{text}");
}

/// Factors stay, a normal map goes, and what is to glow in some places glows in none.
#[test]
fn a_missing_image_is_left_out_and_named_with_its_material() {
    let folder = tempfile::tempdir().unwrap();
    let mut mesh = model(folder.path());
    mesh.images = vec![ImageSource::File(folder.path().join("gone.png"))];
    let (materials, left_out) = materials(&mesh);
    let notes = left_out.notes();
    assert!(notes[0].contains("of material \"paint\"") && notes[0].contains("gone.png"), "{notes:?}");
    assert_eq!(left_out.check().unwrap_err().kind(), ErrorKind::NotFound);
    let material = &materials[0];
    assert!(material.relief.is_empty());
    close(&material.base_color, Vec4::new(0.25, 0.25, 0.5, 1.0));
    assert_eq!([&material.roughness, &material.occlusion].map(|slot| value(slot).x), [0.25, 1.0]);
    assert_eq!(value(&material.emission).truncate(), Vec3::ZERO);
}
