//! Ctrl-C.

#![cfg(unix)]

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::support::{bottle, fantex, files, succeeds};

#[test]
fn an_interrupted_bake_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let asset = folder.path().join("out.fan");
    let mut bake = fantex()
        .arg("bake")
        .arg(bottle())
        .args(["--source", "solid=marble", "--texels", "200M", "-o"])
        .arg(&asset)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The temporary file appears once the bake has begun.
    let deadline = Instant::now() + Duration::from_secs(120);
    while files(folder.path()).is_empty() {
        assert!(bake.try_wait().unwrap().is_none(), "the bake ended before it could be interrupted");
        assert!(Instant::now() < deadline, "the bake did not begin");
        std::thread::sleep(Duration::from_millis(20));
    }
    let sent = Command::new("kill").args(["-INT", &bake.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let output = bake.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(errors.contains("interrupted; no unfinished file was left behind"), "{errors}");
    assert!(files(folder.path()).is_empty(), "{:?}", files(folder.path()));
}

#[test]
fn an_interrupted_export_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let asset = folder.path().join("bottle.fan");
    succeeds(&[&"bake", &bottle(), &"-o", &asset, &"--texels", &"64k"]);
    let output_folder = folder.path().join("out");
    std::fs::create_dir(&output_folder).unwrap();
    let mut export = fantex()
        .arg("export")
        .arg(&asset)
        .args(["--channel", "base-color", "--size", "16384", "-o"])
        .arg(output_folder.join("out.png"))
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let deadline = Instant::now() + Duration::from_secs(120);
    while files(&output_folder).is_empty() {
        assert!(export.try_wait().unwrap().is_none(), "the export ended before it could be interrupted");
        assert!(Instant::now() < deadline, "the export did not begin");
        std::thread::sleep(Duration::from_millis(20));
    }
    let sent = Command::new("kill").args(["-INT", &export.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let output = export.wait_with_output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{errors}");
    assert!(files(&output_folder).is_empty(), "{:?}", files(&output_folder));
}
