//! Assets, plans, parts and worlds in an object store: one in Python, which checks signatures by itself, and fails as it is told to.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use fantex_test::skip;
use serde_json::Value;

use crate::{COLORED_PLY, fantex, files, json, succeeds, write};

/// Serves a folder as a bucket `scans`.
pub(crate) struct Store {
    child: Child,
    /// Its address.
    pub(crate) server: String,
    /// Where commands look for it, and what it knows who asks by.
    variables: Vec<(&'static str, String)>,
    keys: &'static [(&'static str, &'static str)],
    /// The folder for temporary files of commands: what they finish and cannot send stays there.
    temporary: tempfile::TempDir,
}

/// What commands of these tests get from nobody else.
const FOREIGN: [&str; 14] = [
    "AWS_ACCESS_KEY_ID",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_ENDPOINT_URL",
    "AWS_ENDPOINT_URL_S3",
    "AWS_REGION",
    "AWS_SECRET_ACCESS_KEY",
    "AWS_SESSION_TOKEN",
    "AZURE_ENDPOINT_URL",
    "AZURE_STORAGE_ACCOUNT",
    "AZURE_STORAGE_ACCOUNT_KEY",
    "AZURE_STORAGE_ACCOUNT_NAME",
    "AZURE_STORAGE_KEY",
    "AZURE_STORAGE_SAS_TOKEN",
];

impl Drop for Store {
    fn drop(&mut self) {
        self.child.kill().unwrap_or_default();
        drop(self.child.wait());
    }
}

impl Store {
    /// Starts a server that is written in Python and prints its port; none where there is no Python. `variables` are made of its address.
    pub(crate) fn start(
        program: &str,
        arguments: &[&str],
        keys: &'static [(&'static str, &'static str)],
        variables: impl FnOnce(&str) -> Vec<(&'static str, String)>,
    ) -> Option<Self> {
        let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli").join(program);
        let mut command = Command::new("python3");
        command.arg(program).args(arguments);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().ok()?;
        let mut line = String::new();
        BufReader::new(child.stdout.take()?).read_line(&mut line).ok()?;
        let port: u16 = line.trim().parse().ok()?;
        let server = format!("http://127.0.0.1:{port}");
        let temporary = tempfile::tempdir().ok()?;
        Some(Self { child, variables: variables(&server), server, keys, temporary })
    }

    pub(crate) fn command(&self, arguments: &[&str], keys: &[(&str, &str)]) -> Command {
        let mut command = fantex();
        command.args(arguments);
        for name in FOREIGN {
            command.env_remove(name);
        }
        command.env("AWS_SHARED_CREDENTIALS_FILE", "none").env("TMPDIR", self.temporary.path());
        for (name, value) in &self.variables {
            command.env(name, value);
        }
        command.envs(keys.iter().copied()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    pub(crate) fn run(&self, arguments: &[&str], keys: &[(&str, &str)]) -> Output {
        self.command(arguments, keys).output().unwrap()
    }

    /// Runs the program with the keys and `--json`.
    pub(crate) fn json(&self, arguments: &[&str]) -> Value {
        let output = self.run(&[arguments, &["--json"]].concat(), self.keys);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// Runs the program, which must fail with one sentence that has these words and no signature.
    pub(crate) fn fails(&self, code: i32, words: &[&str], arguments: &[&str], keys: &[(&str, &str)]) {
        let output = self.run(arguments, keys);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
        assert!(words.iter().all(|word| said.contains(word)), "{arguments:?}: {words:?} in: {said}");
        let secrets = ["X-Amz", "sig=", "SharedKey"];
        assert!(!secrets.iter().any(|secret| said.contains(secret)), "{said}");
        assert_eq!(said.trim().lines().count(), 1, "{said}");
    }

    /// What goes wrong from now on (see `object_store.py` and `azure_store.py`).
    pub(crate) fn faults(&self, query: &str) {
        ureq::post(format!("{}/faults?{query}", self.server)).send_empty().unwrap();
    }

    /// A count of what the store has under way.
    pub(crate) fn count(&self, name: &str) -> u64 {
        let mut answer = ureq::get(format!("{}/state", self.server)).call().unwrap();
        let state: Value = serde_json::from_str(&answer.body_mut().read_to_string().unwrap()).unwrap();
        state[name].as_u64().unwrap()
    }

    /// Waits until parts are on their way.
    pub(crate) fn wait_for_parts(&self) {
        let since = Instant::now();
        while self.count("now") == 0 {
            assert!(since.elapsed() < fantex_test::PATIENCE, "nothing is uploaded");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// The keys that the store knows. (Those of Amazon's examples.)
pub(crate) const KEYS: [(&str, &str); 2] = [
    ("AWS_ACCESS_KEY_ID", "AKIAIOSFODNN7EXAMPLE"),
    ("AWS_SECRET_ACCESS_KEY", "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY"),
];

/// None where there is no Python. Everybody may read the object `public.fan`.
pub(crate) fn serve(folder: &Path) -> Option<Store> {
    let arguments = [folder.to_str().unwrap(), "scans", KEYS[0].1, KEYS[1].1, "public.fan"];
    Store::start("object_store.py", &arguments, &KEYS, |server| {
        vec![("AWS_ENDPOINT_URL", server.to_owned()), ("AWS_REGION", "eu-west-1".to_owned())]
    })
}

#[test]
fn an_asset_in_an_object_store_is_read_by_who_may() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = folder.path().join("bucket");
    std::fs::create_dir(&bucket).unwrap();
    let asset = bucket.join("a b.fan");
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"64k"]);
    std::fs::copy(&asset, bucket.join("public.fan")).unwrap();
    let Some(store) = serve(&bucket) else { return skip("no python3, in which the object store is written") };
    let picture = |place: &str, name: &str, keys: &[(&str, &str)]| {
        let out = folder.path().join(name);
        let output = store.run(&["render", place, "--size", "160x120", "-o", out.to_str().unwrap()], keys);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        std::fs::read(out).unwrap()
    };
    let here = picture(asset.to_str().unwrap(), "here.png", &[]);
    assert_eq!(picture("s3://scans/a b.fan", "there.png", &KEYS), here);
    assert_eq!(picture("s3://scans/public.fan", "public.png", &[]), here);
    assert_eq!(store.json(&["verify", "s3://scans/a b.fan"])["ok"], true);

    let refused =
        |place: &str, keys: &[(&str, &str)], words: &[&str]| store.fails(1, words, &["info", place], keys);
    refused("s3://scans/a b.fan", &[], &["s3://scans/a b.fan", "403", "set AWS_ACCESS_KEY_ID"]);
    let wrong = [KEYS[0], ("AWS_SECRET_ACCESS_KEY", "wrong")];
    refused("s3://scans/a b.fan", &wrong, &["403", "check AWS_ACCESS_KEY_ID"]);
    refused("s3://scans/other.fan", &KEYS, &["404"]);
    refused("s3://scans", &KEYS, &["s3://BUCKET/KEY"]);
}

/// A landscape, and the arguments that bake it.
pub(crate) fn land(folder: &Path) -> PathBuf {
    let model = folder.join("land.ply");
    succeeds(&[&"generate", &"landscape", &"-o", &model, &"--triangles", &"20k"]);
    model
}

pub(crate) const LAND: [&str; 4] = ["--source", "solid=landscape", "--texels", "300k"];

pub(crate) fn bucket_in(folder: &Path) -> PathBuf {
    let bucket = folder.join("bucket");
    std::fs::create_dir(&bucket).unwrap();
    bucket
}

/// The arguments that merge parts of a plan in the bucket.
fn merge<'a>(parts: &[&'a str], rest: &[&'a str]) -> Vec<&'a str> {
    [&["merge", "s3://scans/farm/land.plan"][..], parts, rest].concat()
}

#[test]
fn a_farm_that_shares_a_bucket_writes_what_one_machine_does() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = bucket_in(folder.path());
    let Some(store) = serve(&bucket) else { return skip("no python3, in which the object store is written") };
    let (model, here) = (land(folder.path()), folder.path().join("here.fan"));
    let [model, here] = [&model, &here].map(|path| path.to_str().unwrap());
    store.json(&[&["bake", model, "-o", here][..], &LAND].concat());
    store.json(&[&["plan", model, "-o", "s3://scans/farm/land.plan"][..], &LAND].concat());
    let part = |number: usize| format!("s3://scans/farm/{number}.part");
    let parts = [1, 2, 3].map(part);
    let bake = |number: usize, output: &str| {
        let shard = format!("{number}/3");
        store.json(&["bake", "s3://scans/farm/land.plan", "--shard", &shard, "-o", output])
    };
    for number in [3, 1, 2] {
        let made = bake(number, &part(number));
        assert_eq!(made["output"].as_str(), Some(&*part(number)), "{made}");
    }
    let all = parts.each_ref().map(String::as_str);
    let merged = |parts: &[&str], rest: &[&str]| store.json(&merge(parts, rest));
    assert_eq!(merged(&all, &["--check"])["parts"], 3);
    let target = ["-o", "s3://scans/farm/land.fan"];
    let made = merged(&all, &target);
    let expected = std::fs::read(here).unwrap();
    let read = |name: &str| std::fs::read(bucket.join(name)).unwrap();
    assert_eq!(made["bytes"], expected.len());
    assert_eq!(read("farm/land.fan"), expected);
    // A part in a file is that in the bucket.
    let own = folder.path().join("2.part");
    bake(2, own.to_str().unwrap());
    assert_eq!(std::fs::read(own).unwrap(), read("farm/2.part"));

    // What is there stays, unless it may be replaced.
    std::fs::write(bucket.join("farm/land.fan"), b"other").unwrap();
    let fails = |words: &[&str], parts: &[&str], rest: &[&str]| {
        store.fails(1, words, &merge(parts, rest), &KEYS);
    };
    fails(&["s3://scans/farm/land.fan exists already", "--force"], &all, &target);
    store.fails(
        1,
        &["s3://scans/farm/1.part exists already"],
        &["bake", "s3://scans/farm/land.plan", "--shard", "1/3", "-o", "s3://scans/farm/1.part"],
        &KEYS,
    );
    assert_eq!(read("farm/land.fan"), b"other");
    merged(&all, &[target[0], target[1], "--force"]);
    assert_eq!(read("farm/land.fan"), expected);
    fails(&["s3://scans/farm/1.part is what is read"], &all, &["-o", all[0], "--force"]);

    // What is wrong with parts is told by their addresses.
    let check = ["--check"];
    fails(&["is missing (shard 2/3)", "s3://scans/farm/land.plan"], &[all[0], all[2]], &check);
    fails(&["have the same tiles", "s3://scans/farm/3.part"], &[all[0], all[1], all[2], all[2]], &check);
    fails(&["cannot read s3://scans/farm/4.part", "404"], &["s3://scans/farm/4.part"], &check);
    fails(&["s3://scans/farm/land.fan is no part"], &["s3://scans/farm/land.fan"], &check);
    let mut damaged = read("farm/2.part");
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    std::fs::write(bucket.join("farm/damaged.part"), &damaged).unwrap();
    std::fs::write(bucket.join("farm/short.part"), &damaged[..middle]).unwrap();
    for name in ["damaged", "short"] {
        let place = format!("s3://scans/farm/{name}.part");
        fails(&[&place, "bake it anew"], &[all[0], &place, all[2]], &check);
    }
    store.json(&["plan", model, "-o", "s3://scans/farm/other.plan", "--texels", "100k", LAND[0], LAND[1]]);
    store.json(&["bake", "s3://scans/farm/other.plan", "--shard", "2/3", "-o", "s3://scans/farm/other.part"]);
    fails(
        &["s3://scans/farm/other.part belongs to another plan"],
        &[all[0], "s3://scans/farm/other.part"],
        &check,
    );
    assert_eq!(store.count("uploads"), 0);
}

/// A store that holds parts and asset copies most texels itself; whatever it does not do, the bytes are the same.
#[test]
fn a_store_puts_an_asset_together_of_its_parts() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = bucket_in(folder.path());
    let Some(store) = serve(&bucket) else { return skip("no python3, in which the object store is written") };
    let (model, here) = (land(folder.path()), folder.path().join("here.fan"));
    let plan = "s3://scans/farm/land.plan";
    let options =
        ["--source", "solid=landscape", "--texels", "8M", "--format", "float", "--longest-edge", "0"];
    store.json(&[&["plan", model.to_str().unwrap(), "-o", plan][..], &options].concat());
    let parts = ["s3://scans/farm/1 of 2.part", "s3://scans/farm/2 of 2.part"];
    for (shard, part) in ["1/2", "2/2"].into_iter().zip(parts) {
        store.json(&["bake", plan, "--shard", shard, "-o", part]);
    }
    let local = |place: &str| bucket.join(place.strip_prefix("s3://scans/").unwrap());
    let files = [plan, parts[0], parts[1]].map(local);
    let [own_plan, first, second] = files.each_ref().map(|path| path.to_str().unwrap());
    store.json(&["merge", own_plan, first, second, "-o", here.to_str().unwrap()]);
    let expected = std::fs::read(here).unwrap();
    let length = expected.len() as u64;
    let counts = || ["received", "given", "copied"].map(|name| store.count(name));
    let is_whole = |name: &str| std::fs::read(bucket.join(name)).unwrap() == expected;
    // Merges, and gives what came, went out and was copied.
    let put = |name: &str| {
        let before = counts();
        let made = store.json(&merge(&parts, &["-o", &format!("s3://scans/{name}")]));
        assert!(is_whole(name), "{name}");
        assert_eq!(store.count("uploads"), 0, "{name}");
        let moved: Vec<u64> = counts().iter().zip(before).map(|(after, before)| after - before).collect();
        assert_eq!(made["copied_bytes"], moved[2], "{made}");
        (moved[2], moved)
    };

    let (copied, moved) = put("copied.fan");
    assert!(copied > length / 2, "{copied} of {length} bytes");
    assert_eq!(moved[0], length - copied, "{moved:?}");
    assert!(moved[1] < length / 2, "{moved:?}");
    // What passes is tried again; an answer may be lost.
    store.faults("busy=2&broken=1&lost=1");
    assert_eq!(put("busy.fan").0, copied);
    // The store has lost the upload to something else that was done to the object: everything is copied anew.
    store.faults("disputed=1");
    let before = store.count("copied");
    let made = store.json(&merge(&parts, &["-o", "s3://scans/disputed.fan"]));
    assert!(is_whole("disputed.fan"));
    assert_eq!((&made["copied_bytes"], store.count("copied") - before), (&copied.into(), 2 * copied));

    // Stores that copy nothing, or take what cannot be copied for something else, are sent all bytes.
    for fault in ["uncopied", "deaf", "uniform", "whole"] {
        store.faults(&format!("{fault}=1"));
        let name = format!("{fault}.fan");
        let target = format!("s3://scans/{name}");
        let output = store.run(&merge(&parts, &["-o", &target]), &KEYS);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success() && said.contains("copies no ranges of objects"), "{fault}: {said}");
        assert!(is_whole(&name), "{fault}");
        assert_eq!(store.count("uploads"), 0, "{fault}");
        store.faults(&format!("{fault}=0"));
    }

    // What is there stays, and what is whole is looked at before.
    let fails = |words: &[&str], rest: &[&str]| store.fails(1, words, &merge(&parts, rest), &KEYS);
    fails(&["copied.fan exists already"], &["-o", "s3://scans/copied.fan"]);
    let whole = std::fs::read(&files[1]).unwrap();
    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 1;
    std::fs::write(&files[1], damaged).unwrap();
    fails(&["1 of 2.part is damaged", "bake it anew"], &["--check"]);
    std::fs::write(&files[1], &whole).unwrap();

    // A part that is another one suddenly.
    store.faults("changed=1");
    fails(&["s3://scans/farm/", "changed"], &["-o", "s3://scans/changed.fan"]);
    assert!(!bucket.join("changed.fan").exists());
    assert_eq!(store.count("uploads"), 0);
}

#[test]
fn an_upload_that_fails_leaves_no_object() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = bucket_in(folder.path());
    let Some(store) = serve(&bucket) else { return skip("no python3, in which the object store is written") };
    let place = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (model, plan, part, here) = (land(folder.path()), place("a.plan"), place("a.part"), place("a.fan"));
    let model = model.to_str().unwrap();
    let options =
        ["--source", "solid=landscape", "--texels", "2M", "--format", "float", "--longest-edge", "0"];
    store.json(&[&["plan", model, "-o", &plan][..], &options].concat());
    store.json(&["bake", &plan, "--shard", "1/1", "-o", &part]);
    store.json(&["merge", &plan, &part, "-o", &here]);
    let expected = std::fs::read(here).unwrap();
    assert!(expected.len() > 17 << 20, "three parts are due, {} bytes are there", expected.len());
    let is_there = |name: &str| bucket.join(name).exists();
    let is_whole = |name: &str| std::fs::read(bucket.join(name)).unwrap() == expected;
    let put = |name: &str| {
        store.json(&["merge", &plan, &part, "-o", &format!("s3://scans/{name}")]);
        assert!(is_whole(name), "{name}");
        assert_eq!(store.count("uploads"), 0, "{name}");
    };
    let fails = |words: &[&str], name: &str| {
        let target = format!("s3://scans/{name}");
        store.fails(1, &[words, &[&*target]].concat(), &["merge", &plan, &part, "-o", &target], &KEYS);
        assert_eq!(store.count("uploads"), 0, "{name}");
    };

    store.faults("latency=0.1");
    put("late.fan");
    assert!(store.count("parts") >= 3);
    assert!((2..=4).contains(&store.count("most_at_once")), "{}", store.count("most_at_once"));
    store.faults("latency=0");

    // What passes is tried again.
    store.faults("busy=2&broken=1");
    put("busy.fan");
    // The object was there, and nobody heard of it.
    store.faults("lost=1");
    put("lost.fan");
    store.faults("lost=1");
    store.json(&[&["plan", model, "-o", "s3://scans/lost.plan"][..], &options].concat());
    // Something else was done to it at that moment: that does not say that it is there.
    for disputed in [1, 2] {
        store.faults(&format!("disputed={disputed}"));
        store.json(&[&["plan", model, "-o", &format!("s3://scans/{disputed}.plan")][..], &options].concat());
    }
    let parts = store.count("parts");
    store.faults("disputed=1");
    put("disputed.fan");
    assert!(store.count("parts") - parts >= 6, "all parts are sent again");
    store.faults("disputed=1000");
    fails(&["409 (ConditionalRequestConflict)", "run the command again"], "always.fan");
    store.faults("disputed=0");

    // What does not pass leaves nothing, and can be done again.
    store.faults("refused=1");
    fails(&["400 (InvalidDigest)"], "refused.fan");
    assert!(!is_there("refused.fan"));
    put("refused.fan");

    // A store that knows no conditions is asked before.
    store.faults("plain=1");
    put("plain.fan");
    fails(&["exists already"], "plain.fan");
    store.faults("plain=0");

    // Somebody else is faster.
    store.faults("latency=0.5");
    let began = |name: &str| {
        let target = format!("s3://scans/{name}");
        let child = store.command(&["merge", &plan, &part, "-o", &target], &KEYS).spawn().unwrap();
        store.wait_for_parts();
        child
    };
    let child = began("raced.fan");
    std::fs::write(bucket.join("raced.fan"), b"first").unwrap();
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("s3://scans/raced.fan exists already"), "{said}");
    assert_eq!(std::fs::read(bucket.join("raced.fan")).unwrap(), b"first");
    assert_eq!(store.count("uploads"), 0);

    // Ctrl-C.
    if cfg!(unix) {
        let child = began("ended.fan");
        let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(130), "{said}");
        assert!(!is_there("ended.fan"));
        assert_eq!(store.count("uploads"), 0);
    }
}

#[test]
fn what_cannot_be_written_is_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = bucket_in(folder.path());
    let Some(store) = serve(&bucket) else { return skip("no python3, in which the object store is written") };
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let model = model.to_str().unwrap();
    let fails = |code: i32, words: &[&str], output: &str, keys: &[(&str, &str)]| {
        store.fails(code, words, &["bake", model, "-o", output, "--texels", "64k"], keys);
    };
    let wrong = [KEYS[0], ("AWS_SECRET_ACCESS_KEY", "wrong")];
    let place = "s3://scans/a.fan";
    fails(1, &[place, "403", "check AWS_ACCESS_KEY_ID", "may write"], place, &wrong);
    fails(1, &[place, "403", "set AWS_ACCESS_KEY_ID"], place, &[]);
    fails(1, &["s3://other/a.fan", "404", "NoSuchBucket"], "s3://other/a.fan", &KEYS);
    let only = "only s3://, gs:// and az://";
    for place in ["https://example.org/a.fan", "abfs://scans/a.fan"] {
        fails(2, &[place, only], place, &KEYS);
    }
    fails(2, &["az://scans/a.fan", "set AZURE_STORAGE_ACCOUNT"], "az://scans/a.fan", &KEYS);
    fails(2, &["s3://BUCKET/KEY"], "s3://scans", &KEYS);
    fails(2, &["names a folder"], "s3://scans/a/", &KEYS);
    let picture = ["render", model, "-o", "s3://scans/a.png", "--size", "64x48"];
    store.fails(2, &["s3://scans/a.png", "writes files"], &picture, &KEYS);
    assert!(files(&bucket).is_empty());

    // Paths may be addresses of files.
    let here = folder.path().join("a b.fan");
    let address = format!("file://{}", here.to_str().unwrap().replace(' ', "%20"));
    if cfg!(unix) {
        store.json(&["bake", &format!("file://{model}"), "-o", &address, "--texels", "64k"]);
        assert_eq!(store.json(&["verify", &address])["ok"], true);
        assert!(here.exists());
    }
}

/// Bakes the [`land`] and splits it into a folder and into the store's [bucket](bucket_in), which come to hold the same; fewer sectors take their
/// place by force. Gives the asset and the folder.
pub(crate) fn assert_split_into_bucket(store: &Store, folder: &Path, scheme: &str) -> (PathBuf, PathBuf) {
    let (model, path) = (land(folder), folder.join("land.fan"));
    let [model, asset] = [&model, &path].map(|path| path.to_str().unwrap());
    store.json(&[&["bake", model, "-o", asset][..], &LAND].concat());
    let here = folder.join("here");
    json(&[&"split", &asset, &"-o", &here, &"--triangles", &"5k"]);
    let target = format!("{scheme}://scans/land");
    let index = format!("{target}/land.fanworld");
    let split = ["split", asset, "-o", &target, "--triangles", "5k"];
    assert_eq!(store.json(&split)["index"], index);
    let there = folder.join("bucket/land");
    assert_eq!(files(&there), files(&here));
    for name in files(&here) {
        let [ours, theirs] = [&here, &there].map(|folder| std::fs::read(folder.join(&name)).unwrap());
        assert!(ours == theirs, "{name}");
    }
    assert_eq!(store.json(&["verify", &index])["ok"], true);
    store.fails(1, &[&format!("{index} exists already")], &split, store.keys);
    let slashed = format!("{target}/");
    let fewer = store.json(&["split", asset, "-o", &slashed, "--triangles", "12k", "--force"]);
    assert_eq!(files(&there).len() as u64, fewer["sectors"].as_u64().unwrap() + 1);
    assert!(files(&there).len() < files(&here).len());
    assert_eq!(store.json(&["verify", &index])["ok"], true);
    (path, here)
}

#[test]
fn worlds_and_previews_are_written_to_buckets() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = bucket_in(folder.path());
    let Some(store) = serve(&bucket) else { return skip("no python3, in which the object store is written") };
    let (asset, here) = assert_split_into_bucket(&store, folder.path(), "s3");
    let asset = asset.to_str().unwrap();

    // Keys that may not list: the store does not say what is not there.
    store.faults("unlisted=1");
    let own = ["split", asset, "-o", "s3://scans/own", "--triangles", "5k"];
    store.json(&own);
    assert_eq!(files(&bucket.join("own")), files(&here));
    store.fails(1, &["s3://scans/own/land.fanworld exists already"], &own, &KEYS);
    let new = ["split", asset, "-o", "s3://scans/new", "--triangles", "5k", "--force"];
    store.fails(1, &["--force", "403", "s3://scans/new/land.fanworld"], &new, &KEYS);
    assert!(!bucket.join("new").exists());
    store.faults("unlisted=0");

    // An index at an address names assets below it as one in a folder does.
    std::fs::copy(asset, bucket.join("whole.fan")).unwrap();
    let (index, whole) = ("s3://scans/town.fanworld", "s3://scans/whole.fan");
    let made = store.json(&["world", index, whole, "s3://scans/land/sector-0001-2.fan", "--make-previews"]);
    assert_eq!((&made["added"], &made["previews_made"]), (&2.into(), &1.into()), "{made}");
    assert_eq!(made["assets"], serde_json::json!(["whole.fan", "land/sector-0001-2.fan"]), "{made}");
    let far = store.json(&["world", index, "--make-coarse"]);
    assert_eq!((&far["coarse_made"], &far["coarse"]), (&1.into(), &1.into()), "{far}");
    assert!(bucket.join("town-coarse-0001.fan").exists());
    assert_eq!(store.json(&["world", index, "--remove", whole])["objects"], 1);
    assert_eq!(store.json(&["info", index])["objects"], 1);
    store.fails(1, &["land.fan lies on this machine"], &["world", index, asset], &KEYS);

    // A preview is put into an asset there as into one here.
    assert!(store.json(&["info", whole])["preview_bytes"].as_u64().unwrap() > 0);
    store.json(&["preview", whole, "--remove"]);
    assert!(store.json(&["info", whole])["preview_bytes"].is_null());
    store.json(&["preview", whole, "--remove"]);
    let made = store.json(&["preview", whole, "--triangles", "1k", "--texels", "20k"]);
    assert_eq!(json(&[&"info", &bucket.join("whole.fan")])["preview_bytes"], made["bytes"]);
    assert_eq!(store.json(&["verify", whole])["ok"], true);
    store.fails(1, &["s3://scans/none.fan"], &["preview", "s3://scans/none.fan"], &KEYS);
    assert_eq!(store.count("uploads"), 0);
}
