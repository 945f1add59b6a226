//! What is finished and cannot be sent to an object store, and worlds there that are replaced.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use fantex_test::skip;

use crate::files;
use crate::objects::{KEYS, LAND, bucket_in, land, serve};

const NO_PYTHON: &str = "no python3, in which the object store is written";

/// A folder for temporary files, and what commands know that use it.
struct Temporary(PathBuf);

impl Temporary {
    fn within(folder: &Path) -> Self {
        let path = folder.join("tmp");
        std::fs::create_dir(&path).unwrap();
        Self(path)
    }

    fn keys(&self) -> Vec<(&'static str, &str)> {
        let mut keys = KEYS.to_vec();
        keys.push(("TMPDIR", self.0.to_str().unwrap()));
        keys
    }

    /// The folders of what was not sent.
    fn unsent(&self) -> Vec<PathBuf> {
        let names = files(&self.0);
        assert!(names.iter().all(|name| name.starts_with("fantex-unsent-")), "{names:?}");
        names.iter().map(|name| self.0.join(name)).collect()
    }

    /// The arguments of the command by which a message says that a file is sent.
    fn command(said: &str) -> Vec<String> {
        let (_, command) = said.split_once("is sent by: fantex ").expect(said);
        command.split_whitespace().map(str::to_owned).collect()
    }
}

fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([name, &child.id().to_string()]).status().unwrap().success());
}

#[test]
fn what_is_finished_and_cannot_be_sent_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = bucket_in(folder.path());
    let Some(store) = serve(&bucket) else { return skip(NO_PYTHON) };
    let temporary = Temporary::within(folder.path());
    let place = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (model, plan, part, here) = (land(folder.path()), place("a.plan"), place("a.part"), place("a.fan"));
    let options =
        ["--source", "solid=landscape", "--texels", "2M", "--format", "float", "--longest-edge", "0"];
    store.json(&[&["plan", model.to_str().unwrap(), "-o", &plan][..], &options].concat());
    store.json(&["bake", &plan, "--shard", "1/1", "-o", &part]);
    store.json(&["merge", &plan, &part, "-o", &here]);
    let expected = std::fs::read(here).unwrap();
    let is_whole = |name: &str| std::fs::read(bucket.join(name)).unwrap() == expected;
    let merge = |target: &str, fault: &str| {
        store.faults(fault);
        let output = store.run(&["merge", &plan, &part, "-o", target], &temporary.keys());
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(said.trim().lines().count(), usize::from(!output.status.success()), "{said}");
        (output.status.code(), said)
    };

    // What is sent leaves nothing.
    assert_eq!(merge("s3://scans/sent.fan", "latency=0").0, Some(0));
    assert!(is_whole("sent.fan") && temporary.unsent().is_empty());

    // The sentence says how it is sent.
    let (code, said) = merge("s3://scans/a b.fan", "refused=1");
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("400 (InvalidDigest); the finished file is kept"), "{said}");
    let unsent = temporary.unsent();
    let [kept] = &unsent[..] else { panic!("{said}") };
    assert_eq!(files(kept), ["a b.fan"]);
    assert!(std::fs::read(kept.join("a b.fan")).unwrap() == expected);
    let shown = kept.join("a b.fan").display().to_string();
    assert!(said.trim().ends_with(&format!("fantex upload '{shown}' -o 's3://scans/a b.fan'")), "{said}");
    let sent = store.json(&["upload", &shown, "-o", "s3://scans/a b.fan"]);
    assert_eq!((&sent["objects"], &sent["bytes"]), (&1.into(), &expected.len().into()), "{sent}");
    assert!(is_whole("a b.fan") && kept.exists());
    std::fs::remove_dir_all(kept).unwrap();

    // So it is where somebody else was faster, and where it is ended or killed.
    store.faults("latency=0.5");
    for name in [None, Some("-INT"), Some("-KILL")] {
        let target = "s3://scans/ended.fan";
        let child = store.command(&["merge", &plan, &part, "-o", target], &temporary.keys()).spawn().unwrap();
        store.wait_for_parts();
        match name {
            Some(name) => signal(&child, name),
            None => std::fs::write(bucket.join("ended.fan"), b"first").unwrap(),
        }
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        let unsent = temporary.unsent();
        let [kept] = &unsent[..] else { panic!("{name:?}: {said}") };
        assert!(std::fs::read(kept.join("ended.fan")).unwrap() == expected, "{name:?}");
        let command = Temporary::command;
        let sends = |said: &str| command(said)[1] == kept.join("ended.fan").to_str().unwrap();
        match name {
            None => {
                assert_eq!(output.status.code(), Some(1), "{said}");
                assert!(said.contains("exists already; use --force") && sends(&said), "{said}");
                std::fs::remove_file(bucket.join("ended.fan")).unwrap();
            }
            Some("-INT") => {
                assert_eq!(output.status.code(), Some(130), "{said}");
                assert!(said.contains("interrupted; the finished file is kept") && sends(&said), "{said}");
            }
            _ => assert_eq!(said, ""),
        }
        assert!(!bucket.join("ended.fan").exists(), "{name:?}");
        std::fs::remove_dir_all(kept).unwrap();
        // Parts of the one that was killed may still be on their way.
        while store.count("now") > 0 {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }
    store.faults("latency=0");

    // What cannot be sent at all.
    let model = model.to_str().unwrap();
    let fails = |code: i32, words: &[&str], arguments: &[&str]| {
        store.fails(code, words, &[&["upload"][..], arguments].concat(), &KEYS);
    };
    fails(2, &["nothing is sent to", "s3://"], &[model, "-o", &place("b.fan")]);
    fails(2, &["is an address"], &["s3://scans/sent.fan", "-o", "s3://scans/b.fan"]);
    fails(1, &["none.fan"], &[&place("none.fan"), "-o", "s3://scans/b.fan"]);
    fails(1, &["is no file", ".fanworld"], &[temporary.0.to_str().unwrap(), "-o", "s3://scans/b.fan"]);
    fails(1, &["s3://scans/sent.fan exists already"], &[model, "-o", "s3://scans/sent.fan"]);
    fails(2, &[".fanworld"], &[model, "-o", "s3://scans/b.fanworld"]);
}

/// Names and contents of a world's files.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    files(folder).into_iter().map(|name| (name.clone(), std::fs::read(folder.join(name)).unwrap())).collect()
}

/// Sets a flag when it goes.
struct Stop<'a>(&'a AtomicBool);

impl Drop for Stop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Relaxed);
    }
}

/// Looks, until it is told to stop, whether there is an index at every moment, and all that it names.
fn watch(there: &Path, stops: &AtomicBool) {
    let index = there.join("land.fanworld");
    let assets = |text: &[u8]| -> Vec<String> {
        let index: serde_json::Value = serde_json::from_slice(text).unwrap();
        let objects = index["objects"].as_array().unwrap();
        objects.iter().map(|object| object["asset"].as_str().unwrap().to_owned()).collect()
    };
    while !stops.load(Relaxed) {
        let text = std::fs::read(&index).expect("there is an index");
        let missing = assets(&text).into_iter().find(|asset| !there.join(asset).exists());
        // It may go once there is another index.
        let is_old = || std::fs::read(&index).unwrap() != text;
        assert!(missing.as_ref().is_none_or(|_| is_old()), "{missing:?}");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
}

#[test]
fn a_world_in_a_bucket_is_replaced_at_once_or_stays() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = bucket_in(folder.path());
    let Some(store) = serve(&bucket) else { return skip(NO_PYTHON) };
    let temporary = Temporary::within(folder.path());
    let (model, asset) = (land(folder.path()), folder.path().join("land.fan"));
    let [model, asset] = [&model, &asset].map(|path| path.to_str().unwrap());
    store.json(&[&["bake", model, "-o", asset][..], &LAND].concat());
    let (there, index) = (bucket.join("land"), "s3://scans/land/land.fanworld");
    let split = |triangles: &'static str| {
        ["split", asset, "-o", "s3://scans/land", "--no-previews", "--force", "--triangles", triangles]
    };
    let passes = || store.json(&["verify", index])["ok"] == true;
    let names = |sectors: u64, generation: &str| {
        let mut names: Vec<String> =
            (1..=sectors).map(|number| format!("sector-{number:04}{generation}.fan")).collect();
        names.insert(0, "land.fanworld".to_owned());
        names
    };
    let first = store.json(&split("5k"))["sectors"].as_u64().unwrap();
    assert_eq!(files(&there), names(first, ""));
    let before = contents(&there);

    // Whatever fails on the way, the old world is there as it was, and the new one is kept.
    let second =
        store.json(&["split", asset, "-o", &format!("{asset}-12k"), "--no-previews", "--triangles", "12k"]);
    let second = second["sectors"].as_u64().unwrap();
    assert!(first > second, "{first} {second}");
    let mut said = String::new();
    for spared in [0, 1, second] {
        store.faults(&format!("spared={spared}&denied=1"));
        let output = store.run(&split("12k"), &temporary.keys());
        said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains("403 Forbidden (ExpiredToken)") && said.trim().lines().count() == 1, "{said}");
        assert!(contents(&there) == before, "{spared}: {:?}", files(&there));
    }
    let unsent = temporary.unsent();
    let [_, _, kept] = &unsent[..] else { panic!("{unsent:?}") };
    assert_eq!(files(&kept.join("world")), names(second, ""));
    let command = Temporary::command(&said);
    assert_eq!(command.last().map(String::as_str), Some("--force"), "{command:?}");
    let command: Vec<&str> = command.iter().map(String::as_str).collect();
    store.faults("spared=0&denied=0");
    let sent = store.json(&command);
    assert_eq!(sent["objects"], second + 1);
    assert_eq!(files(&there), names(second, "-2"));
    assert!(passes());

    // Readers find a world at every moment; two who write at once do not get into each other's way.
    store.faults("latency=0.02");
    let stops = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let stop = Stop(&stops);
        let watching = scope.spawn(|| watch(&there, &stops));
        store.json(&split("5k"));
        assert_eq!(files(&there), names(first, ""));
        let both = ["5k", "12k"].map(|triangles| store.command(&split(triangles), &KEYS).spawn().unwrap());
        for child in both {
            let output = child.wait_with_output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        }
        drop(stop);
        watching.join().unwrap();
    });
    store.faults("latency=0");
    let objects = store.json(&["info", index])["objects"].as_u64().unwrap();
    assert_eq!(files(&there).len() as u64, objects + 1, "{:?}", files(&there));
    assert!(passes());

    // What cannot be removed is named; later worlds lie beside it.
    let old = files(&there);
    store.faults("stuck=1");
    let made = store.json(&split("5k"));
    let notes = made["notes"].as_array().unwrap();
    assert_eq!(notes.len(), 1, "{made}");
    let left = old.iter().filter(|name| name.starts_with("sector"));
    assert!(left.clone().all(|name| notes[0].as_str().unwrap().contains(name.as_str())), "{made}");
    assert!(passes() && left.clone().all(|name| there.join(name).exists()));
    store.json(&split("12k"));
    assert_eq!(files(&there).len() as u64, second + 1 + left.count() as u64);
    assert!(passes());

    // Without --force nothing is replaced, and worlds of other assets are not sent as a whole.
    let kept = kept.join("world/land.fanworld");
    let kept = kept.to_str().unwrap();
    store.fails(1, &["land.fanworld exists already"], &["upload", kept, "-o", index], &KEYS);
    let town = folder.path().join("town.fanworld");
    let town = town.to_str().unwrap();
    store.json(&["world", town, asset]);
    store.fails(1, &["land.fan", "fantex world"], &["upload", town, "-o", "s3://scans/town.fanworld"], &KEYS);
}
