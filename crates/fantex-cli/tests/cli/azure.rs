//! Assets, plans, parts and worlds in Azure's Blob Storage: one in Python, which checks signatures by itself, and fails as it is told to.

use std::path::Path;
use std::process::Command;

use fantex_test::skip;

use crate::objects::{LAND, Store, assert_split_into_bucket, bucket_in, land};
use crate::{COLORED_PLY, files, succeeds, write};

/// The key of the account that emulators have.
const KEY: [(&str, &str); 1] = [(
    "AZURE_STORAGE_ACCOUNT_KEY",
    "Eby8vdM02xNOcqFlqUwJPLlmEtlCDXJ1OUzFT50uSRZ6IFsuFq2UVErCz4I6tq/K1SZFPTOtr/KBHBeksoGMGw==",
)];

/// A token, encoded as in addresses.
const TOKEN: [(&str, &str); 1] =
    [("AZURE_STORAGE_SAS_TOKEN", "sv=2020-10-02&sr=c&sp=rwd&sig=ab%2Bcd%2Fe%3D")];

const NO_PYTHON: &str = "no python3, in which the blob service is written";

/// None where there is no Python. Everybody may read the blob `public.fan`.
fn serve(folder: &Path) -> Option<Store> {
    let account = "devstoreaccount1";
    let arguments = [folder.to_str().unwrap(), "scans", account, KEY[0].1, TOKEN[0].1, "public.fan"];
    Store::start("azure_store.py", &arguments, &KEY, |server| {
        vec![("AZURE_ENDPOINT_URL", format!("{server}/{account}"))]
    })
}

#[test]
fn a_blob_is_read_by_who_may() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = bucket_in(folder.path());
    let asset = bucket.join("a b.fan");
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"64k"]);
    std::fs::copy(&asset, bucket.join("public.fan")).unwrap();
    let Some(store) = serve(&bucket) else { return skip(NO_PYTHON) };
    let picture = |place: &str, name: &str, keys: &[(&str, &str)]| {
        let out = folder.path().join(name);
        let output = store.run(&["render", place, "--size", "160x120", "-o", out.to_str().unwrap()], keys);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        std::fs::read(out).unwrap()
    };
    let here = picture(asset.to_str().unwrap(), "here.png", &[]);
    let place = "az://scans/a b.fan";
    assert_eq!(picture(place, "key.png", &KEY), here);
    assert_eq!(picture(place, "token.png", &TOKEN), here);
    assert_eq!(picture("AZ://scans/public.fan", "public.png", &[]), here);
    assert_eq!(store.json(&["verify", place])["ok"], true);

    let refused =
        |place: &str, keys: &[(&str, &str)], words: &[&str]| store.fails(1, words, &["info", place], keys);
    refused(place, &[], &[place, "409", "set AZURE_STORAGE_SAS_TOKEN or AZURE_STORAGE_ACCOUNT_KEY"]);
    let wrong_key = [("AZURE_STORAGE_ACCOUNT_KEY", "d3Jvbmc=")];
    refused(place, &wrong_key, &[place, "403", "check AZURE_STORAGE_ACCOUNT, AZURE_STORAGE_ACCOUNT_KEY"]);
    let wrong_token = [("AZURE_STORAGE_SAS_TOKEN", "?sv=2020-10-02&sig=wrong")];
    refused(place, &wrong_token, &[place, "403", "check AZURE_STORAGE_SAS_TOKEN"]);
    refused("az://scans/other.fan", &KEY, &["404"]);
    refused("az://scans", &KEY, &["az://CONTAINER/BLOB"]);
}

#[test]
fn a_farm_that_shares_a_container_writes_what_one_machine_does() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = bucket_in(folder.path());
    let Some(store) = serve(&bucket) else { return skip(NO_PYTHON) };
    let (model, here) = (land(folder.path()), folder.path().join("here.fan"));
    let [model, here] = [&model, &here].map(|path| path.to_str().unwrap());
    store.json(&[&["bake", model, "-o", here][..], &LAND].concat());
    let plan = "az://scans/farm/land.plan";
    store.json(&[&["plan", model, "-o", plan][..], &LAND].concat());
    let parts = ["az://scans/farm/1.part", "az://scans/farm/2.part"];
    for (part, shard) in parts.into_iter().zip(["1/2", "2/2"]) {
        let made = store.json(&["bake", plan, "--shard", shard, "-o", part]);
        assert_eq!(made["output"].as_str(), Some(part), "{made}");
    }
    let target = "az://scans/farm/land.fan";
    let merge = ["merge", plan, parts[0], parts[1], "-o", target];
    let made = store.json(&merge);
    let expected = std::fs::read(here).unwrap();
    let result = bucket.join("farm/land.fan");
    assert_eq!(made["bytes"], expected.len());
    assert!(std::fs::read(&result).unwrap() == expected);

    // What is there stays, unless it may be replaced.
    std::fs::write(&result, b"other").unwrap();
    store.fails(1, &["az://scans/farm/land.fan exists already", "--force"], &merge, &KEY);
    assert_eq!(std::fs::read(&result).unwrap(), b"other");
    let output = store.run(&[&merge[..], &["--force"]].concat(), &TOKEN);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(std::fs::read(&result).unwrap() == expected);
    assert_eq!(store.count("uploads"), 0);
}

#[test]
fn an_upload_of_blocks_that_fails_leaves_no_blob() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = bucket_in(folder.path());
    let Some(store) = serve(&bucket) else { return skip(NO_PYTHON) };
    let place = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (model, plan, part, here) = (land(folder.path()), place("a.plan"), place("a.part"), place("a.fan"));
    let model = model.to_str().unwrap();
    let options =
        ["--source", "solid=landscape", "--texels", "2M", "--format", "float", "--longest-edge", "0"];
    store.json(&[&["plan", model, "-o", &plan][..], &options].concat());
    store.json(&["bake", &plan, "--shard", "1/1", "-o", &part]);
    store.json(&["merge", &plan, &part, "-o", &here]);
    let expected = std::fs::read(here).unwrap();
    assert!(expected.len() > 17 << 20, "three blocks are due, {} bytes are there", expected.len());
    let is_there = |name: &str| bucket.join(name).exists();
    let address = |name: &str| format!("az://scans/{name}");
    let put = |name: &str, rest: &[&str]| {
        store.json(&[&["merge", &plan, &part, "-o", &address(name)][..], rest].concat());
        assert!(std::fs::read(bucket.join(name)).unwrap() == expected, "{name}");
    };
    let fails = |words: &[&str], name: &str, rest: &[&str]| {
        let target = address(name);
        let arguments = [&["merge", &plan, &part, "-o", &target][..], rest].concat();
        store.fails(1, &[words, &[&*target]].concat(), &arguments, &KEY);
    };

    store.faults("latency=0.1");
    put("late.fan", &[]);
    assert!(store.count("parts") >= 3);
    assert!((2..=4).contains(&store.count("most_at_once")), "{}", store.count("most_at_once"));
    store.faults("latency=0");

    // What passes is tried again.
    store.faults("busy=2&broken=1");
    put("busy.fan", &[]);
    // The blob was there, and nobody heard of it.
    store.faults("lost=1");
    put("lost.fan", &[]);
    store.faults("lost=1");
    store.json(&[&["plan", model, "-o", "az://scans/lost.plan"][..], &options].concat());
    assert_eq!(store.count("uploads"), 0);

    // What does not pass leaves nothing that is seen, and can be done again.
    store.faults("refused=1");
    fails(&["400 (Md5Mismatch)"], "refused.fan", &[]);
    assert!(!is_there("refused.fan"));
    assert_eq!(store.count("uploads"), 1);
    store.fails(1, &["404"], &["info", &address("refused.fan")], &KEY);
    put("refused.fan", &[]);
    assert_eq!(store.count("uploads"), 0);

    // Another upload has ended, and its blob is gone again.
    store.faults("overtaken=1");
    fails(&["400 (InvalidBlockList)", "another upload to it has ended"], "overtaken.fan", &[]);
    assert!(!is_there("overtaken.fan"));
    put("overtaken.fan", &[]);

    // Somebody else is faster, for blobs of several blocks and of one request.
    store.faults("raced=1");
    fails(&["exists already"], "raced.fan", &[]);
    assert_eq!(std::fs::read(bucket.join("raced.fan")).unwrap(), b"first");
    store.faults("raced=1");
    let small = ["plan", model, "-o", "az://scans/raced.plan"];
    store.fails(1, &["az://scans/raced.plan exists already"], &[&small[..], &options].concat(), &KEY);
    assert_eq!(std::fs::read(bucket.join("raced.plan")).unwrap(), b"first");

    // A conflict that is about something else is named.
    store.faults("leased=1");
    fails(&["412 (LeaseIdMissing)"], "late.fan", &["--force"]);
    store.faults("leased=0");
    put("late.fan", &["--force"]);
    let block = format!(
        "{}/devstoreaccount1/scans/other.fan?comp=block&blockid=YQ%3D%3D&{}",
        store.server, TOKEN[0].1
    );
    ureq::put(block).send("block").unwrap();
    fails(&["400 (InvalidBlobOrBlock)", "another program has begun to write it"], "other.fan", &[]);
    assert!(!is_there("other.fan"));

    // Ctrl-C.
    if cfg!(unix) {
        store.faults("latency=0.5");
        let arguments = ["merge", &plan, &part, "-o", "az://scans/ended.fan"];
        let child = store.command(&arguments, &KEY).spawn().unwrap();
        store.wait_for_parts();
        let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(130), "{said}");
        assert!(!is_there("ended.fan"));
    }
}

#[test]
fn what_no_container_takes_is_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = bucket_in(folder.path());
    let Some(store) = serve(&bucket) else { return skip(NO_PYTHON) };
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let model = model.to_str().unwrap();
    let fails = |code: i32, words: &[&str], output: &str, keys: &[(&str, &str)]| {
        store.fails(code, words, &["bake", model, "-o", output, "--texels", "64k"], keys);
    };
    let place = "az://scans/a.fan";
    let wrong = [("AZURE_STORAGE_ACCOUNT_KEY", "d3Jvbmc=")];
    fails(1, &[place, "403", "AuthenticationFailed", "check AZURE_STORAGE_ACCOUNT"], place, &wrong);
    fails(1, &[place, "409", "set AZURE_STORAGE_SAS_TOKEN"], place, &[]);
    fails(1, &["az://other/a.fan", "404", "ContainerNotFound"], "az://other/a.fan", &KEY);
    fails(2, &["az://CONTAINER/BLOB"], "az://scans", &KEY);
    fails(2, &["names a folder"], "az://scans/a/", &KEY);
    let no_key = [("AZURE_STORAGE_ACCOUNT_KEY", "no key")];
    fails(2, &[place, "AZURE_STORAGE_ACCOUNT_KEY is no key"], place, &no_key);
    let nowhere = [KEY[0], ("AZURE_ENDPOINT_URL", "nowhere")];
    fails(2, &[place, "nowhere is no endpoint", "AZURE_ENDPOINT_URL"], place, &nowhere);
    assert!(files(&bucket).is_empty());
}

#[test]
fn worlds_and_previews_are_written_to_containers() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = bucket_in(folder.path());
    let Some(store) = serve(&bucket) else { return skip(NO_PYTHON) };
    let (asset, _) = assert_split_into_bucket(&store, folder.path(), "az");

    std::fs::copy(asset, bucket.join("whole.fan")).unwrap();
    let (index, whole) = ("az://scans/town.fanworld", "az://scans/whole.fan");
    let made = store.json(&["world", index, whole, "az://scans/land/sector-0001-2.fan", "--make-previews"]);
    assert_eq!((&made["added"], &made["previews_made"]), (&2.into(), &1.into()), "{made}");
    assert_eq!(made["assets"], serde_json::json!(["whole.fan", "land/sector-0001-2.fan"]), "{made}");
    assert_eq!(store.json(&["info", index])["objects"], 2);
    assert_eq!(store.json(&["world", index, "--remove", whole])["objects"], 1);
    assert!(store.json(&["info", whole])["preview_bytes"].as_u64().unwrap() > 0);
    store.json(&["preview", whole, "--triangles", "1k", "--texels", "20k"]);
    assert_eq!(store.json(&["verify", whole])["ok"], true);

    // Somebody else changes it meanwhile.
    store.faults("raced=1");
    store.fails(1, &[whole, "was changed by somebody else"], &["preview", whole, "--remove"], &KEY);
    assert_eq!(std::fs::read(bucket.join("whole.fan")).unwrap(), b"first");
}
