//! Flags that a command does not act upon are refused; files that are there, and what is being painted on them, stay.

use std::ffi::OsStr;
use std::path::Path;

use fantex::store::WriterLock;

use crate::{COLORED_PLY, fails, files, succeeds, write};

/// Runs a command, split at spaces, in whose words `IN/` stands for a folder.
fn refused(folder: &Path, words: &[&str], command: &str) {
    let path = |word: &str| match word.strip_prefix("IN/") {
        Some(name) => folder.join(name).into_os_string(),
        None => word.into(),
    };
    let arguments: Vec<_> = command.split(' ').map(path).collect();
    let arguments: Vec<&dyn AsRef<OsStr>> = arguments.iter().map(|a| a as &dyn AsRef<OsStr>).collect();
    fails(2, words, &arguments);
}

#[test]
fn flags_without_an_effect_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "a.ply", COLORED_PLY);
    write(folder.path(), "look.toml", "[picture]\nbackground = \"#000000\"\n");
    for (words, command) in [
        (["--output", "a window paints on"], "paint IN/a.fan -o IN/b.fan"),
        (["--no-history", "a window paints on"], "paint IN/a.fan --no-history"),
        (["--no-history", "--export-log"], "paint IN/a.fan --no-history --export-log IN/b.json"),
        (["--shard", "--format"], "bake IN/a.plan --shard 1/2 -o IN/1.part --format bc1"),
        (["--shard", "--fit"], "bake IN/a.plan --shard 1/2 -o IN/1.part --fit box"),
        (["--shard", "--quality"], "bake IN/a.plan --shard 1/2 -o IN/1.part --quality basic"),
        (["--seed", "in the plan"], "bake IN/a.plan --shard 1/2 -o IN/1.part --seed 3"),
        (["--seed", "in the plan"], "--seed 1 bake IN/a.plan --shard 1/2 -o IN/1.part"),
        (["--json", "a window"], "--json view IN/a.ply"),
        (["--quiet", "a window"], "--quiet view IN/a.ply"),
        (["--strict", "a window"], "--strict view IN/a.ply"),
        (["--force", "a window"], "paint IN/a.ply --force"),
        (["--seed", "a window"], "paint IN/a.ply --seed 1"),
        (["--quality", "BC7"], "bake IN/a.ply -o IN/a.fan --format bc1 --quality basic"),
        (["--quality", "BC7"], "generate landscape -o IN/a.fan --format rgba8 --quality basic"),
        (["--format", "no texels"], "generate landscape -o IN/b.ply --format bc1"),
        (["--longest-edge", "no texels"], "generate landscape -o IN/b.ply --longest-edge 16"),
        (["--hard-edges", "no texels"], "generate landscape -o IN/b.ply --hard-edges 60"),
        (["--hard-edges", "0 to 180 degrees"], "bake IN/a.ply -o IN/a.fan --hard-edges 200"),
        (["--hard-edges", "0 to 180 degrees"], "plan IN/a.ply -o IN/a.plan --hard-edges=-1"),
        (["--hard-edges", "0 to 180 degrees"], "bench fidelity IN/a.ply --hard-edges nan"),
        (["--shard", "--hard-edges"], "bake IN/a.plan --shard 1/2 -o IN/1.part --hard-edges 60"),
        (["--picture", "look"], "info IN/look.toml --picture IN/p"),
        (["--texels", "look"], "info IN/look.toml --texels 4k"),
        (["--max-size", "--size"], "export IN/a.fan -o IN/b.glb --size 64 --max-size 64"),
        (["--max-size", "--web"], "export IN/a.fan -o IN/b --web --max-size 64"),
        (["--max-size", "--turntable"], "export IN/a.fan -o IN/b --turntable 2 --max-size 64"),
        (["--seconds", "animated"], "export IN/a.fan -o IN/b --turntable 2 --seconds 2"),
        (["--seconds", "at most 1000"], "export IN/a.fan -o IN/b.png --turntable 2 --seconds 1e9"),
        (["--environment", "--turntable"], "export IN/a.fan -o IN/b --web --environment sky"),
        (["--background", "--turntable"], "export IN/a.fan -o IN/b.glb --background transparent"),
        (["--padding", "texture coordinates"], "export IN/a.fan -o IN/b.glb --uv source --padding 4"),
        (["--depth", ".png"], "export IN/a.fan -o IN/b.exr --channel base-color --depth 16"),
        (
            ["--background-blur", "--background"],
            "render IN/a.ply -o IN/a.png --environment sky --background gradient --background-blur 0.5",
        ),
        (["floating-point", "--depth"], "image IN/a.exr -o IN/b.png --size 8x8 --depth float"),
        (["floating-point", "--depth"], "table IN/look.toml -o IN/a.exr --depth 16"),
        (["--pool", "asset"], "render IN/a.ply -o IN/a.png --gpu --pool 64M"),
        (["--color-space", "linear"], "table IN/look.toml -o IN/a.exr --depth float --color-space srgb"),
        (["--triangles", "[MODEL]"], "bench cover IN/a.ply --triangles 5k"),
    ] {
        refused(folder.path(), &words, command);
    }
    assert_eq!(files(folder.path()), ["a.ply", "look.toml"]);
}

#[test]
fn a_page_of_the_same_name_stays() {
    let folder = tempfile::tempdir().unwrap();
    let page = write(folder.path(), "index.html", "mine");
    fails(
        1,
        &["index.html exists already"],
        &[&"gallery", &"wood", &"--width", &"16", &"-o", &folder.path()],
    );
    assert_eq!(files(folder.path()), ["index.html"]);
    assert_eq!(std::fs::read_to_string(&page).unwrap(), "mine");
}

#[test]
fn what_is_painted_on_an_asset_does_not_go_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "a.ply", COLORED_PLY);
    let at = |name: &str| folder.path().join(name);
    let [asset, other, plan, part] = ["a.fan", "b.fan", "a.plan", "1.part"].map(at);
    let size: [&dyn AsRef<OsStr>; 2] = [&"--texels", &"2k"];
    succeeds(&[&[&"bake" as &dyn AsRef<OsStr>, &model, &"-o", &asset][..], &size].concat());
    std::fs::copy(&asset, &other).unwrap();
    succeeds(&[&[&"plan" as &dyn AsRef<OsStr>, &model, &"-o", &plan][..], &size].concat());
    succeeds(&[&"bake", &plan, &"--shard", &"1/1", &"-o", &part]);
    let before = (files(folder.path()), std::fs::read(&asset).unwrap());
    let commands: [&[&dyn AsRef<OsStr>]; 5] = [
        &[&"bake", &model, &"--texels", &"2k"],
        &[&"merge", &plan, &part],
        &[&"paint", &other, &"--alpha", &"blend"],
        &[&"plan", &model, &"--texels", &"2k"],
        &[&"bake", &plan, &"--shard", &"1/1"],
    ];
    let lock = WriterLock::acquire(&asset).unwrap();
    for command in commands {
        let forced: [&dyn AsRef<OsStr>; 3] = [&"--force", &"-o", &asset];
        fails(1, &["a.fan is being edited by another program"], &[command, &forced].concat());
    }
    drop(lock);
    assert!(before == (files(folder.path()), std::fs::read(&asset).unwrap()));
    for command in commands {
        succeeds(&[command, &[&"--force", &"-o", &asset]].concat());
    }
    assert_eq!(files(folder.path()), before.0);
}

/// JSON is UTF-8, and what is written has its name.
#[cfg(target_os = "linux")]
#[test]
fn names_need_not_be_utf8() {
    use std::os::unix::ffi::OsStrExt;

    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join(OsStr::from_bytes(b"caf\xe9"));
    std::fs::create_dir(&inside).unwrap();
    let model = write(&inside, "a.ply", COLORED_PLY);
    let at = |name: &[u8]| inside.join(OsStr::from_bytes(name));
    let [asset, mesh, picture] = [&b"\xe9.fan"[..], b"\xe9.ply", b"\xe9.png"].map(at);
    let plain = write(folder.path(), "a.ply", COLORED_PLY);
    let (part, merged) = (at(b"\xe9.part"), at(b"\xe9-2.fan"));
    let words = [&"plan" as &dyn AsRef<OsStr>, &plain, &"--texels", &"2k", &"-o"];
    // A plan notes its arguments as text.
    fails(2, &["not UTF-8"], &[&words[..], &[&at(b"\xe9.plan")]].concat());
    let mut planned = crate::fantex();
    planned.current_dir(&inside).args(words.iter().map(|word| word.as_ref())).arg("a.plan");
    let output = planned.output().unwrap();
    let sentence = crate::stderr(&output);
    assert!(output.status.code() == Some(2) && sentence.contains("the folder"), "{sentence}");
    let plan = folder.path().join("a.plan");
    succeeds(&[&words[..], &[&plan]].concat());
    let commands: [(&Path, &[&dyn AsRef<OsStr>]); 6] = [
        (&part, &[&"bake", &plan, &"--shard", &"1/1"]),
        (&merged, &[&"merge", &plan, &part]),
        (&asset, &[&"bake", &model, &"--texels", &"2k"]),
        (&mesh, &[&"simplify", &model, &"--triangles", &"4"]),
        (&picture, &[&"render", &model, &"--size", &"32x24"]),
        (&picture, &[&"export", &asset, &"--channel", &"base-color,opacity", &"--size", &"64", &"--force"]),
    ];
    for (output, command) in commands {
        let info = crate::json(&[command, &[&"-o", &output]].concat());
        assert_eq!(info["output"], output.display().to_string());
    }
    let written = [&asset, &mesh, &picture, &at(b"\xe9-base-color.png"), &at(b"\xe9-opacity.png")];
    assert!(written.iter().all(|path| path.exists()), "{:?}", files(&inside));
}
