//! How many bytes an edit writes: the table in `runs.rs`.

use super::common::{block_channels, encoded_page, fan_cover, pages, sheet, write};
use super::output::{Operation, recorded_editor};
use super::script::Dice;
use crate::PageId;
use crate::edit::runs::RunPacking;

#[test]
#[ignore = "prints figures"]
fn write_amplification() {
    for run_bytes in [16 << 10, 64 << 10, 256 << 10] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.fan");
        let mesh = sheet(24);
        let cover = fan_cover(&mesh, |_| [64, 64]);
        let channels = &block_channels()[..1];
        write(&path, &mesh, &cover, channels, 100).unwrap();
        let (mut editor, plan) = recorded_editor(&path);
        editor.packing = RunPacking { run_bytes, zstd_level: 1 };
        let all: Vec<PageId> = pages(&cover).filter(|id| id.level == 0).collect();
        let mut dice = Dice(1);
        let used_before = editor.asset().used_bytes();
        for round in 0..2 {
            plan.lock().unwrap().log.clear();
            let mut changed = 0;
            for k in 0..9 {
                // Each first edit finds a cluster of its own (64 pages), each second one a run of the first.
                let id = all[k * 64 + if round == 0 { 0 } else { dice.below(64) }];
                let bytes = encoded_page(&cover, channels, id).channels[0].clone();
                changed += zstd::bulk::compress(&bytes, 1).unwrap().len();
                editor.replace(id, 0, bytes).unwrap();
                editor.commit().unwrap();
            }
            let written: usize = plan.lock().unwrap().log.iter().map(bytes_of).sum();
            eprintln!("runs of {run_bytes}, round {round}: {:.1}", written as f64 / changed as f64);
        }
        let ranges: u64 =
            editor.asset().cluster_ranges(0).iter().map(|r| (r.end - r.start).next_multiple_of(4096)).sum();
        eprintln!(
            "runs of {run_bytes}: {} used before, {} now, padded level 0 {ranges}",
            used_before,
            editor.asset().used_bytes()
        );
    }
}

fn bytes_of(operation: &Operation) -> usize {
    match operation {
        Operation::Write(_, bytes) => bytes.len().next_multiple_of(4096),
        _ => 0,
    }
}
