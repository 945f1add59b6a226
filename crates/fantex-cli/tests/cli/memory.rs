//! Peak memory of every command: at most `--memory` and a constant.

use std::fmt::Write as _;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};

use crate::{bottle, data, fantex, succeeds, write};

/// What a command may take beside `--memory`: the program, threads, the mesh with its cover (up to 400 bytes for each of 300 000
/// triangles), tables of decoders and encoders.
const BESIDE_MIB: u64 = 192;

/// Commands as in `outputs.rs`, and the least budget in MiB that does not refuse them.
const CASES: [(&str, u64); 39] = [
    ("info IN/land.ply", 128),
    ("info IN/bottle.fan", 128),
    ("bake MODEL -o OUT/a.fan --texels 8M", 128),
    ("bake MODEL -o OUT/a.fan --texels 32M --format rgba8", 128),
    ("bake IN/land.ply -o OUT/a.fan --source solid=landscape --texels 16M", 128),
    ("bake IN/land.ply -o OUT/a.fan --source image=IN/big.png,mapping=sphere --texels 4M", 512),
    ("bake IN/land.ply -o OUT/a.fan --look IN/tables.toml --texels 1M", 128),
    ("bake IN/land.ply -o OUT/a.fan --source mesh=MODEL,cage=0.1 --texels 1M", 128),
    ("plan MODEL -o OUT/a.plan --texels 8M", 128),
    ("bake IN/bottle.plan --shard 1/2 -o OUT/a.part", 128),
    ("merge IN/bottle.plan IN/1.part IN/2.part -o OUT/a.fan", 128),
    ("verify IN/bottle.fan", 128),
    ("verify IN/land.fan", 128),
    ("render MODEL -o OUT/a.png --size 1920x1080", 512),
    ("render IN/land.fan -o OUT/a.png --size 1920x1080", 128),
    ("render IN/bottle.fan -o OUT/a.exr --size 4096x4096", 2048),
    ("render IN/land.ply --look IN/tables.toml -o OUT/a.png", 128),
    ("compare MODEL IN/bottle.fan --views 1", 128),
    ("export IN/bottle.fan -o OUT/a.glb --size 4096", 128),
    ("export IN/bottle.fan -o OUT/a.ktx2 --channel base-color --size 4096", 128),
    ("export IN/bottle.fan -o OUT/a.exr --channel base-color --size 4096", 2048),
    ("export IN/bottle.fan -o OUT/a.glb --fans", 128),
    ("export IN/bottle.fan -o OUT/a.png --turntable 2 --size 1024x1024", 128),
    ("generate landscape -o OUT/a.ply --triangles 300k", 128),
    ("generate landscape -o OUT/a.fan --triangles 300k --texels 4M", 128),
    ("generate photographs MODEL -o OUT --count 2 --size 2048x2048", 128),
    ("image IN/big.png -o OUT/a.png --size 4000x4000", 2048),
    ("warp IN/big.png -o OUT/a.png --map affine --size 3000x3000 --corners 0,0 3000,0 0,3000", 512),
    ("table IN/tables.toml --texture b -o OUT/a.png --size 2048x2048", 512),
    ("table IN/tables.toml --texture b -o OUT/a.exr --depth float --size 2048x2048", 512),
    ("gallery wood -o OUT", 128),
    ("paint IN/bottle.fan --replay IN/strokes.json -o OUT/a.fan", 128),
    ("paint IN/land.fan --replay IN/strokes.json -o OUT/a.fan", 128),
    ("simplify IN/land.ply -o OUT/a.ply --triangles 20k", 128),
    ("bake IN/land.ply -o OUT/a.fan --source mesh=IN/land.fan,cage=0.1 --texels 1M", 128),
    ("preview IN/land.fan", 128),
    ("split IN/land.fan -o OUT --triangles 50k", 128),
    ("demo -o OUT --triangles 50k --texels 2M", 512),
    ("bench sample MODEL", 128),
];

const TABLES: &str = "\
[textures.wood]
kind = 'wood'
[textures.a]
kind = 'table'
texture = 'wood'
size = 128
[textures.b]
kind = 'table'
texture = 'a'
size = 160
[materials.wood]
base_color = 'b'
";

const STROKES: &str = r#"{ "version": 1, "strokes": [{ "brush": { "size": { "world": 0.1 } },
    "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.1] } }],
    "samples": [{ "at": { "position": [0, 0.1, 0.05] } }, { "at": { "position": [0, 0, 0.05] } }] }] }"#;

struct Folder(tempfile::TempDir);

impl Folder {
    fn path(&self, word: &str) -> PathBuf {
        match word.split_once('/') {
            Some(("IN", name)) => self.0.path().join(name),
            Some(("OUT", name)) => self.0.path().join("out").join(name),
            _ if word == "OUT" => self.0.path().join("out"),
            _ if word == "MODEL" => bottle(),
            _ => word.into(),
        }
    }

    /// Exit code, the last line of errors, and the peak of memory in MiB.
    fn measure(&self, arguments: &str, memory: &str) -> (i32, String, u64) {
        let mut command = fantex();
        command.args(["--force", "--quiet", "--threads", "8", "--memory", memory]);
        for word in arguments.split(' ') {
            match word.split_once("=IN/").or(word.split_once("=MODEL")) {
                Some((key, rest)) if word.contains("=IN/") => {
                    command.arg(format!("{key}={}", self.0.path().join(rest).display()))
                }
                Some((key, rest)) => command.arg(format!("{key}={}{rest}", bottle().display())),
                None => command.arg(self.path(word)),
            };
        }
        let peak = peak_of(&mut command, &self.0.path().join("errors"));
        let errors = std::fs::read_to_string(self.0.path().join("errors")).unwrap();
        (peak.0, errors.lines().last().unwrap_or_default().to_owned(), peak.1)
    }
}

/// Runs a program; its exit code, and the peak of its memory in MiB.
#[expect(
    unsafe_code,
    clippy::zombie_processes,
    reason = "only the system's wait tells a child's peak of memory"
)]
fn peak_of(command: &mut std::process::Command, errors: &Path) -> (i32, u64) {
    let errors = std::fs::File::create(errors).unwrap();
    let child = command.stdout(std::process::Stdio::null()).stderr(errors).process_group(0).spawn().unwrap();
    let mut status = 0;
    // SAFETY: plain numbers, for which zeros are values.
    let mut usage: libc::rusage = unsafe { std::mem::zeroed() };
    // SAFETY: both places are there to be written to; the child is not waited for elsewhere.
    let waited = unsafe { libc::wait4(child.id() as i32, &raw mut status, 0, &raw mut usage) };
    assert_eq!(waited, child.id() as i32);
    assert!(libc::WIFEXITED(status), "ended by a signal: {command:?}");
    (libc::WEXITSTATUS(status), usage.ru_maxrss as u64 / 1024)
}

fn prepared() -> Folder {
    let folder = Folder(tempfile::tempdir().unwrap());
    let path = |name: &str| folder.0.path().join(name);
    std::fs::create_dir(path("out")).unwrap();
    write(folder.0.path(), "tables.toml", TABLES);
    write(folder.0.path(), "strokes.json", STROKES);
    succeeds(&[&"generate", &"landscape", &"-o", &path("land.ply"), &"--triangles", &"300k"]);
    let texels = [&"--texels" as &dyn AsRef<std::ffi::OsStr>, &"8M"];
    succeeds(&[&"bake", &bottle(), &"-o", &path("bottle.fan"), texels[0], texels[1]]);
    succeeds(&[&"plan", &bottle(), &"-o", &path("bottle.plan"), texels[0], texels[1]]);
    for (shard, part) in [("1/2", "1.part"), ("2/2", "2.part")] {
        succeeds(&[&"bake", &path("bottle.plan"), &"--shard", &shard, &"-o", &path(part)]);
    }
    let solid = [&"--source" as &dyn AsRef<std::ffi::OsStr>, &"solid=landscape", &"--format", &"bc1"];
    succeeds(&[
        &"bake",
        &path("land.ply"),
        &"-o",
        &path("land.fan"),
        solid[0],
        solid[1],
        solid[2],
        solid[3],
        texels[0],
        &"32M",
    ]);
    let photo = crate::workspace().join("assets/images/rock-color.jpg");
    succeeds(&[&"image", &photo, &"-o", &path("big.png"), &"--size", &"5000x5000"]);
    folder
}

#[test]
#[ignore = "minutes"]
fn no_command_takes_more_memory_than_it_may() {
    let folder = prepared();
    let mut table = String::new();
    let mut broken = Vec::new();
    for (arguments, least) in CASES {
        write!(table, "| `{arguments}` |").unwrap();
        for mib in [128, 512, 2048] {
            let (code, errors, peak) = folder.measure(arguments, &format!("{mib}M"));
            match code {
                0 => write!(table, " {peak} |").unwrap(),
                _ => write!(table, " refused, {peak} |").unwrap(),
            }
            let is_refused = code == 1 && errors.contains("--memory");
            let is_expected = if mib < least { is_refused } else { code == 0 };
            if !is_expected || peak > mib + BESIDE_MIB {
                broken.push(format!("{arguments} --memory {mib}M: {code}, {peak} MiB, {errors}"));
            }
        }
        table.push('\n');
    }
    eprintln!("{table}");
    assert!(broken.is_empty(), "{broken:#?}");
}

/// Models of others: refused or within the budget, whatever they are.
#[test]
#[ignore = "minutes"]
fn no_model_takes_more_memory_than_it_may() {
    let Some(data) = data() else { return };
    let folder = Folder(tempfile::tempdir().unwrap());
    std::fs::create_dir(folder.0.path().join("out")).unwrap();
    let mut paths: Vec<PathBuf> = ["meshes", "meshes/broken", "meshes/bunny", "meshes/spot"]
        .iter()
        .filter_map(|name| data.join(name).read_dir().ok())
        .flat_map(|entries| entries.map(|entry| entry.unwrap().path()))
        .filter(|path| {
            path.extension().is_some_and(|e| ["ply", "obj", "glb", "gltf", "stl"].iter().any(|x| e == *x))
        })
        .collect();
    paths.sort();
    assert!(!paths.is_empty());
    for path in paths {
        std::fs::create_dir_all(folder.0.path().join("out")).unwrap();
        for arguments in
            ["info", "bake -o OUT/a.fan --source solid=marble --texels 2M", "render -o OUT/a.png"]
        {
            let (command, rest) = arguments.split_once(' ').unwrap_or((arguments, "--json"));
            let arguments = format!("{command} {} {rest}", path.display());
            let (code, errors, peak) = folder.measure(&arguments, "128M");
            assert!(code <= 1 && peak <= 128 + BESIDE_MIB, "{arguments}: {code}, {peak} MiB, {errors}");
        }
    }
}
