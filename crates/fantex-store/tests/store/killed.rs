//! A writer that is killed at random moments leaves what it had committed.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use fantex_store::{Asset, AssetEditor, EditOptions, VerifyOptions, verify};

use crate::common::{fan_cover, pages, plain_channels, sheet, write};

/// Set for the process that writes: the asset's path.
const CHILD: &str = "FANTEX_TEST_WRITER";

/// How often the writer is killed.
const KILLS: u64 = 200;

/// All pages of channel 3 and the attachment hold the generation's lowest byte.
fn write_generations(path: &Path) {
    let mut editor = AssetEditor::open(path, &EditOptions::default()).unwrap();
    let ids: Vec<_> = pages(editor.asset().cover()).collect();
    loop {
        let next = editor.asset().generation() + 1;
        for &id in &ids {
            let bytes = editor.read_page_raw(3, id).unwrap().len();
            editor.replace(id, 3, vec![next as u8; bytes]).unwrap();
        }
        editor.attach("generation", next.to_le_bytes().repeat(500)).unwrap();
        let generation = editor.commit().unwrap().generation;
        assert_eq!(generation, next);
        let mut out = std::io::stdout().lock();
        writeln!(out, "generation {generation}").unwrap();
        out.flush().unwrap();
    }
}

/// Runs in a process of its own; does nothing otherwise.
#[test]
fn writer() {
    if let Some(path) = std::env::var_os(CHILD) {
        write_generations(Path::new(&path));
    }
}

fn check(path: &Path, acknowledged: u64) -> u64 {
    let asset = Asset::open(path).unwrap();
    let generation = asset.generation();
    assert!(generation >= acknowledged, "{generation} {acknowledged}");
    if generation > 1 {
        for id in pages(asset.cover()) {
            let bytes = asset.read_page_raw(3, id).unwrap();
            assert!(bytes.iter().all(|&b| b == generation as u8), "{id}, generation {generation}");
        }
        let attached = asset.attachment("generation").unwrap().unwrap();
        assert_eq!(attached, generation.to_le_bytes().repeat(500));
    }
    generation
}

#[test]
fn a_killed_writer_leaves_a_committed_state() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("killed.fan");
    let mesh = sheet(2);
    let cover = fan_cover(&mesh, |v| [[64, 48], [260, 8]][v % 2]);
    write(&path, &mesh, &cover, &plain_channels(), 100).unwrap();
    let mut generation = 1;
    let mut longest = 0;
    for kill in 0..KILLS {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "killed::writer", "--nocapture"])
            .env(CHILD, &path)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        // Wait for the first commit, then for a time that differs from kill to kill.
        let mut acknowledged = generation;
        for line in lines.by_ref() {
            if let Some(number) = line.unwrap().strip_prefix("generation ") {
                acknowledged = number.parse().unwrap();
                break;
            }
        }
        std::thread::sleep(Duration::from_micros(kill * 2_654_435 % 9_000));
        child.kill().unwrap();
        child.wait().unwrap();
        for line in lines {
            if let Some(number) = line.unwrap().strip_prefix("generation ") {
                acknowledged = number.parse().unwrap_or(acknowledged);
            }
        }
        generation = check(&path, acknowledged);
        longest = longest.max(std::fs::metadata(&path).unwrap().len());
    }
    assert!(generation > KILLS, "{generation}");
    let report = verify(&path, &VerifyOptions::default()).unwrap();
    assert_eq!((report.damaged_tiles, report.damaged_attachments), (0, 0));
    eprintln!("{KILLS} kills, {generation} generations, {longest} bytes at most");
}
