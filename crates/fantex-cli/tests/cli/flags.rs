//! Flags that a command does not act upon are refused; files that are there, and what is being painted on them, stay.

use std::ffi::OsStr;

use fantex::store::WriterLock;

use crate::{COLORED_PLY, fails, files, succeeds, write};

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
    let commands: [&[&dyn AsRef<OsStr>]; 3] = [
        &[&"bake", &model, &"--texels", &"2k"],
        &[&"merge", &plan, &part],
        &[&"paint", &other, &"--alpha", &"blend"],
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
