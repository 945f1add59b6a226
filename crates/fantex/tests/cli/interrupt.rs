//! Ctrl-C.

#![cfg(unix)]

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::support::{bottle, fantex, files};

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
