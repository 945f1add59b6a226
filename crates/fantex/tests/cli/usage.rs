//! Help and wrong command lines.

use crate::support::{COLORED_PLY, CUBE_OBJ, bottle, fails, succeeds, write};

const COMMANDS: [&str; 9] =
    ["info", "bake", "verify", "render", "compare", "export", "generate", "bench", "demo"];

#[test]
fn every_command_explains_itself_with_an_example() {
    for command in COMMANDS {
        let output = succeeds(&[&command, &"--help"]);
        let help = String::from_utf8(output.stdout).unwrap();
        assert!(help.contains(&format!("Example:\n  fantex {command}")), "{help}");
    }
    succeeds(&[&"--version"]);
}

#[test]
fn wrong_command_lines_end_with_two() {
    fails(2, &["Usage"], &[]);
    fails(2, &["unrecognized"], &[&"fold"]);
    fails(2, &["unexpected argument '--fold'"], &[&"info", &"x.ply", &"--fold"]);
    fails(2, &["--texels", "expected a number such as"], &[&"info", &"x.ply", &"--texels", &"lots"]);
    fails(2, &["above zero"], &[&"info", &"x.ply", &"--density", &"-3"]);
    fails(2, &["cannot be used with"], &[&"info", &"x.ply", &"--density", &"3", &"--texels", &"4M"]);
    fails(2, &["--memory"], &[&"info", &"x.ply", &"--memory", &"big"]);
    fails(2, &["--threads"], &[&"info", &"x.ply", &"--threads", &"0"]);
    fails(2, &["'cheese' is no solid"], &[&"bake", &"x.ply", &"-o", &"x.fan", &"--source", &"solid=cheese"]);
    fails(2, &["1280x720"], &[&"render", &"x.ply", &"-o", &"x.png", &"--size", &"big"]);
    fails(2, &["three numbers"], &[&"render", &"x.ply", &"-o", &"x.png", &"--eye", &"1,2"]);
}

#[test]
fn a_source_that_the_model_lacks_is_a_usage_error() {
    let folder = tempfile::tempdir().unwrap();
    let cube = write(folder.path(), "cube.obj", CUBE_OBJ);
    let colored = write(folder.path(), "colored.ply", COLORED_PLY);
    let asset = folder.path().join("x.fan");
    fails(2, &["neither textures nor colours", "--source"], &[&"bake", &cube, &"-o", &asset]);
    fails(2, &["no textures"], &[&"bake", &colored, &"-o", &asset, &"--source", &"uv"]);
    fails(2, &["--match", "vertex"], &[&"bake", &colored, &"-o", &asset, &"--match"]);
    assert!(!asset.exists());
}

#[test]
fn models_and_assets_are_not_mistaken_for_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let asset = folder.path().join("colored.fan");
    succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"4k"]);
    fails(1, &["already baked"], &[&"bake", &asset, &"-o", &folder.path().join("again.fan")]);
    fails(1, &["is not an asset"], &[&"verify", &bottle()]);
    fails(2, &["has its cover already"], &[&"info", &asset, &"--texels", &"4M"]);
    // An asset by another name is still an asset.
    let renamed = folder.path().join("colored.glb");
    std::fs::rename(&asset, &renamed).unwrap();
    succeeds(&[&"verify", &renamed]);
}
