//! Exports for other programs.

use std::path::Path;

use fantex::bake::NoProgress;
use fantex::mesh::generate::torus;
use fantex::mesh::{CleanOptions, clean};
use fantex::texture::{Image, Samples};
use fantex_app::export::{ExportSettings, Preset, export};
use fantex_app::paint::{NewAsset, bake_model};

fn texels(path: &Path) -> (usize, Vec<u8>) {
    let image = Image::load(path).unwrap();
    let Samples::U8(samples) = image.samples else { panic!("not 8 bits") };
    (image.channels as usize, samples)
}

#[test]
fn presets_write_what_programs_want() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (mesh, _) = clean(torus(24, 12), &CleanOptions::default()).unwrap();
    let new = NewAsset { texels: Some(20_000), normal: true, ..NewAsset::default() };
    bake_model(&mesh, &new, &at("torus.fan"), &NoProgress).unwrap();
    let run = |preset: Preset, name: &str| {
        let settings = ExportSettings { preset, side: Some(256), points_down: preset.points_down() };
        let files = export(&at("torus.fan"), &at(name), &settings, &NoProgress).unwrap();
        files
            .into_iter()
            .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
            .collect::<Vec<_>>()
    };
    assert_eq!(run(Preset::Gltf, "one.glb"), ["one.glb"]);
    let files = run(Preset::Blender, "b.gltf");
    assert!(
        files.iter().any(|name| name == "b.gltf") && files.iter().any(|name| name.ends_with(".png")),
        "{files:?}"
    );
    let files = run(Preset::Unreal, "u.glb");
    assert_eq!(files, ["u.glb", "u_BaseColor.png", "u_Normal.png", "u_ORM.png"]);
    let files = run(Preset::Unity, "y.glb");
    assert_eq!(
        files,
        ["y.glb", "y_BaseMap.png", "y_Normal.png", "y_MetallicSmoothness.png", "y_Occlusion.png"]
    );

    let ((channels, down), (_, up)) = (texels(&at("u_Normal.png")), texels(&at("y_Normal.png")));
    let turned =
        down.chunks(channels).zip(up.chunks(channels)).all(|(d, u)| d[0] == u[0] && d[1] == 255 - u[1]);
    assert!(turned && down.len() == 256 * 256 * channels);
    // Not metallic, roughness 0.6, wherever there is surface.
    let (channels, both) = texels(&at("y_MetallicSmoothness.png"));
    assert_eq!(channels, 4);
    let count = both.chunks(4).filter(|p| p[0] <= 2 && p[3].abs_diff(102) <= 3).count();
    assert!(count > 256 * 256 / 3, "{count}");
    assert!(!at("y_MetallicSmoothness.part.png").exists());
}
