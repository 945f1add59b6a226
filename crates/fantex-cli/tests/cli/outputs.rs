//! All outputs on disks that are full or fail: exit code 1, one sentence, what was there is there, nothing else.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::documented::check_keys;
use crate::{bottle, fantex, stderr, succeeds, write};

/// A command, where `IN` stands for a folder with what it reads, and `OUT` for one with what it writes.
struct Case<'a> {
    arguments: &'a str,
    /// Whether its files belong together, or there is one only: then all stay as they were.
    is_whole: bool,
}

const fn whole(arguments: &str) -> Case<'_> {
    Case { arguments, is_whole: true }
}

const fn each(arguments: &str) -> Case<'_> {
    Case { arguments, is_whole: false }
}

/// Every kind of file that a command writes.
const CASES: [Case<'_>; 33] = [
    whole("bake IN/cube.ply -o OUT/a.fan --texels 4k"),
    whole("plan IN/cube.ply -o OUT/a.plan --texels 4k"),
    whole("bake IN/bottle.plan --shard 2/2 -o OUT/a.part"),
    whole("merge IN/bottle.plan IN/1.part IN/2.part -o OUT/a.fan"),
    whole("render IN/cube.ply -o OUT/a.png --size 64x48"),
    whole("render IN/cube.ply -o OUT/a.exr --size 64x48"),
    each("compare IN/cube.ply IN/bottle.fan -o OUT --views 1 --size 32x24"),
    each("info IN/cube.ply --picture OUT/cover"),
    whole("export IN/bottle.fan -o OUT/a.glb --size 64"),
    whole("export IN/bottle.fan -o OUT/a.gltf --size 64 --textures png+ktx2"),
    whole("export IN/bottle.fan -o OUT/a.png --channel base-color --size 64"),
    whole("export IN/bottle.fan -o OUT/a.exr --channel base-color --size 64"),
    whole("export IN/bottle.fan -o OUT/a.ktx2 --channel base-color --size 64"),
    whole("export IN/bottle.fan -o OUT/a.glb --fans"),
    whole("export IN/bottle.fan -o OUT/a.usda --fans"),
    whole("export IN/bottle.fan -o OUT/a.gltf --fans --shader godot,hlsl"),
    whole("export IN/bottle.fan -o OUT/turn.png --turntable 2 --size 32x24"),
    each("export IN/bottle.fan -o OUT --turntable 2 --size 32x24"),
    whole("generate landscape -o OUT/a.ply --triangles 500"),
    whole("generate landscape -o OUT/a.obj --triangles 500"),
    whole("generate landscape -o OUT/a.glb --triangles 500"),
    whole("generate landscape -o OUT/a.fan --triangles 500 --texels 4k"),
    each("generate photographs IN/cube.ply -o OUT --count 2 --size 32x24"),
    whole("image IN/a.png -o OUT/a.png --size 16x16"),
    whole("warp IN/a.png -o OUT/a.png --map affine --size 30x30 --corners 10,0 30,10 0,20"),
    whole("table IN/look.toml -o OUT/a.png --size 16x16"),
    whole("table IN/look.toml -o OUT/a.exr --depth float --size 16x16"),
    each("table IN/look.toml -o OUT --size 16x16 --slices 2"),
    each("gallery wood -o OUT --width 32"),
    whole("paint IN/bottle.fan --replay IN/strokes.json -o OUT/a.fan"),
    each("paint IN/painted.fan --export-log OUT/strokes.json"),
    whole("split IN/bottle.fan -o OUT --triangles 5k --preview-triangles 1k --preview-texels 9k"),
    each("demo -o OUT --triangles 500 --texels 4k"),
];

const LOOK: &str = "\
[textures.wood]
kind = 'wood'
[materials.wood]
base_color = 'wood'
";

const STROKES: &str = r#"{ "version": 1, "strokes": [{ "brush": { "size": { "world": 0.1 }, "stamp": "a.png" },
    "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.1] } }],
    "samples": [{ "at": { "position": [0, 0.1, 0.2] } }] }] }"#;

/// Contents by path, of all files below a folder.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in folder.read_dir().unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => found.extend(contents(&path)),
            false => drop(found.insert(path.clone(), std::fs::read(&path).unwrap())),
        }
    }
    found
}

struct Bench {
    folder: tempfile::TempDir,
    disk: PathBuf,
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let bench = Self { disk: crate::example("libfaulty_disk.so"), folder };
        ["in", "out", "tmp"].iter().for_each(|name| std::fs::create_dir(bench.path(name)).unwrap());
        let inputs = bench.path("in");
        write(&inputs, "cube.ply", crate::COLORED_PLY);
        write(&inputs, "look.toml", LOOK);
        write(&inputs, "strokes.json", STROKES);
        succeeds(&[&"render", &inputs.join("cube.ply"), &"-o", &inputs.join("a.png"), &"--size", &"40x40"]);
        let asset = inputs.join("bottle.fan");
        succeeds(&[&"bake", &bottle(), &"-o", &asset, &"--texels", &"10k"]);
        let (plan, part) = (inputs.join("bottle.plan"), |n: u32| inputs.join(format!("{n}.part")));
        succeeds(&[&"plan", &bottle(), &"-o", &plan, &"--texels", &"10k"]);
        succeeds(&[&"bake", &plan, &"--shard", &"1/2", &"-o", &part(1)]);
        succeeds(&[&"bake", &plan, &"--shard", &"2/2", &"-o", &part(2)]);
        let replay = [&"--replay" as &dyn AsRef<_>, &inputs.join("strokes.json")];
        succeeds(&[&"paint", &asset, replay[0], replay[1], &"-o", &inputs.join("painted.fan")]);
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, case: &Case<'_>, fault: &str) -> Output {
        let words = case.arguments.split(' ').map(|word| match word.split_once('/') {
            _ if word == "OUT" => self.path("out"),
            Some(("IN", name)) => self.path("in").join(name),
            Some(("OUT", name)) => self.path("out").join(name),
            _ => word.into(),
        });
        let mut command = fantex();
        command.args(["--force", "--quiet"]).args(words).env("TMPDIR", self.path("tmp"));
        if !fault.is_empty() {
            command.env("LD_PRELOAD", &self.disk).env("FAULTY_FOLDER", self.path("out"));
        }
        command.env("FAULTY", fault).output().unwrap()
    }

    /// Runs a command on a disk that fails at each of some calls, until there are no more calls.
    fn attack(&self, case: &Case<'_>, numbers: impl Iterator<Item = u64> + Clone) {
        let out = self.path("out");
        std::fs::remove_dir_all(&out).unwrap();
        std::fs::create_dir(&out).unwrap();
        let output = self.run(&Case { arguments: &format!("{} --json", case.arguments), ..*case }, "");
        assert!(output.status.success(), "{}: {}", case.arguments, stderr(&output));
        let words: Vec<&str> = case.arguments.split(' ').collect();
        check_keys(&words, &serde_json::from_slice(&output.stdout).unwrap());
        let names: Vec<PathBuf> = contents(&out).into_keys().collect();
        assert!(!names.is_empty(), "{}", case.arguments);
        // Other files of the same names, and nothing else.
        let put_old = || {
            std::fs::remove_dir_all(&out).unwrap();
            for path in &names {
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, "old").unwrap();
            }
        };
        put_old();
        let output = self.run(case, "");
        assert!(output.status.success(), "{}", stderr(&output));
        // Those of a world have other names than those of the world whose place it takes.
        let new = contents(&out);
        for kind in ["full", "write", "sync"] {
            let mut failures = 0;
            for number in numbers.clone() {
                put_old();
                let fault = format!("{kind}:{number}");
                let output = self.run(case, &fault);
                let about = format!("{} {fault}: {}", case.arguments, stderr(&output));
                if output.status.success() {
                    assert!(contents(&out) == new, "{about}");
                    break;
                }
                failures += 1;
                assert_eq!(output.status.code(), Some(1), "{about}");
                let errors = stderr(&output);
                assert!(errors.starts_with("fantex: ") && errors.lines().count() == 1, "{about}");
                assert!(output.stdout.is_empty(), "{about}");
                let found = contents(&out);
                assert!(names.iter().all(|path| found.contains_key(path)), "{about}: {:?}", found.keys());
                for (path, bytes) in found {
                    // A folder's sync comes after the name.
                    let may_be_new = kind == "sync" || !case.is_whole;
                    let is_old = names.contains(&path) && bytes == b"old";
                    assert!(is_old || may_be_new && new.get(&path) == Some(&bytes), "{about}: {path:?}");
                }
                assert!(contents(&self.path("tmp")).is_empty(), "{about}");
            }
            assert!(failures > 0, "{}: {kind} is not noticed", case.arguments);
        }
    }

    /// Where only the folder cannot be made durable, the index is there, and so is what it names.
    fn leave_worlds_whole(&self) {
        let (model, asset) = (self.path("in").join("cube.ply"), self.path("in").join("near.fan"));
        succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"4k"]);
        succeeds(&[&"preview", &asset, &"--triangles", &"4", &"--texels", &"1k"]);
        let case = whole("world OUT/w.fanworld OUT/a.fan OUT/b.fan --make-coarse");
        let (out, mut with_index) = (self.path("out"), 0);
        // The first two are those of the coarse asset.
        for number in 3.. {
            std::fs::remove_dir_all(&out).unwrap();
            std::fs::create_dir(&out).unwrap();
            for name in ["a.fan", "b.fan"] {
                std::fs::copy(&asset, out.join(name)).unwrap();
            }
            let output = self.run(&case, &format!("sync:{number}"));
            let index = out.join("w.fanworld");
            if index.exists() {
                with_index += 1;
                succeeds(&[&"verify", &index]);
            }
            if output.status.success() {
                break;
            }
        }
        assert!(with_index > 1, "the folder of the index was made durable");
    }

    /// Ends a command at each of its first syncs: it has done nothing, or all and says so.
    fn interrupt(&self, case: &Case<'_>, syncs: u64) {
        let out = self.path("out");
        let run = |fault: &str| {
            std::fs::remove_dir_all(&out).unwrap();
            std::fs::create_dir(&out).unwrap();
            let output = self.run(case, fault);
            (output.status.code(), contents(&out), format!("{} {fault}: {}", case.arguments, stderr(&output)))
        };
        let (_, all, _) = run("");
        for number in 1..=syncs {
            let (code, found, about) = run(&format!("stop:{number}"));
            match code {
                Some(130) => assert!(found.is_empty(), "{about}: {:?}", found.keys()),
                _ => assert!(code == Some(0) && found == all, "{about}"),
            }
            assert!(contents(&self.path("tmp")).is_empty(), "{about}");
        }
    }
}

#[test]
fn no_output_is_lost_where_the_first_write_fails() {
    let bench = Bench::new();
    // The demo takes as long as all others, and its files are written as those of the commands that it is made of.
    let cases = CASES.iter().filter(|case| !case.arguments.starts_with("demo"));
    cases.for_each(|case| bench.attack(case, 1..2));
    bench.interrupt(&whole("paint IN/bottle.fan --replay IN/strokes.json -o OUT/a.fan"), 5);
    bench.leave_worlds_whole();
}

/// Encoders of PNG write the end of the file when they are dropped.
#[test]
fn no_picture_loses_its_end() {
    let case = whole("export IN/bottle.fan -o OUT/a.png --channel base-color --size 64");
    Bench::new().attack(&case, 1..);
}

#[test]
#[ignore = "hundreds of runs"]
fn no_output_is_lost_on_a_disk_that_fails() {
    let bench = Bench::new();
    // Each of the first calls, then about every fourth.
    let numbers = std::iter::successors(Some(1), |n| Some(n + 1 + n / 4));
    CASES.iter().for_each(|case| bench.attack(case, numbers.clone()));
}
