//! Crashes between and within any two writes.
//!
//! The disk keeps what was written before the last sync. Of what came after, each write may be there, missing or torn,
//! independently of the others.

use std::collections::BTreeMap;
use std::path::Path;

use super::output::{Operation, recorded_editor};
use super::script::{Dice, State, assert_whole, change, seen_by, small_asset};

/// The bytes on the disk.
#[derive(Clone)]
struct Disk(Vec<u8>);

impl Disk {
    fn write(&mut self, offset: u64, bytes: &[u8]) {
        let end = offset as usize + bytes.len();
        if self.0.len() < end {
            self.0.resize(end, 0);
        }
        self.0[offset as usize..end].copy_from_slice(bytes);
    }

    /// Does a call as a crash leaves it: `fate` 0 as asked, 1 not at all, 2 torn.
    fn apply(&mut self, operation: &Operation, fate: usize, dice: &mut Dice) {
        match (operation, fate) {
            (_, 1) | (Operation::Sync, _) => {}
            (Operation::Write(offset, bytes), 0) => self.write(*offset, bytes),
            (Operation::Write(offset, bytes), _) => {
                // Sectors of 64 bytes (smaller than any real one), each by itself.
                for (k, sector) in bytes.chunks(64).enumerate() {
                    if dice.below(2) == 0 {
                        self.write(offset + 64 * k as u64, sector);
                    }
                }
            }
            (Operation::SetLen(length), _) => self.0.resize(*length as usize, 0),
        }
    }
}

/// Opens a crashed disk's asset and compares it with what was committed.
fn check(disk: &Disk, path: &Path, states: &BTreeMap<u64, State>, acknowledged: u64) -> u64 {
    std::fs::write(path, &disk.0).unwrap();
    let (generation, state) = State::open(path);
    assert!(generation >= acknowledged, "generation {generation} after {acknowledged} was acknowledged");
    assert!(Some(&state) == states.get(&generation), "generation {generation} is not what was committed");
    generation
}

#[test]
fn after_a_crash_at_any_write_a_committed_state_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_asset(folder.path());
    let mut durable = Disk(std::fs::read(&path).unwrap());
    let (first, mut state) = State::open(&path);
    let mut states = BTreeMap::from([(first, state.clone())]);
    let (mut editor, plan) = recorded_editor(&path);
    let mut dice = Dice(7);
    // Calls that belong to commits, and the generation that was acknowledged before each of them.
    let mut acknowledged = Vec::new();
    for round in 0..14 {
        let before = editor.asset().generation();
        change(&mut editor, &mut state, &mut dice);
        if round % 3 == 2 {
            editor.flush().unwrap();
            change(&mut editor, &mut state, &mut dice);
        }
        assert!(seen_by(&editor).unwrap() == state);
        let generation = editor.commit().unwrap().generation;
        states.insert(generation, state.clone());
        acknowledged.resize(plan.lock().unwrap().log.len(), before);
    }
    assert_eq!(State::open(&path), (15, state));
    assert_whole(&path);

    let log = plan.lock().unwrap().log.clone();
    let crashed = folder.path().join("crashed.fan");
    let mut unsynced: Vec<&Operation> = Vec::new();
    let mut newer = 0;
    for (operation, &known) in log.iter().zip(&acknowledged) {
        unsynced.push(operation);
        for variant in 0..6 {
            let mut disk = durable.clone();
            for (k, operation) in unsynced.iter().enumerate() {
                let last = k + 1 == unsynced.len();
                let fate = match variant {
                    0 => 0,
                    1 => usize::from(!last),
                    2 => {
                        if last {
                            2
                        } else {
                            0
                        }
                    }
                    _ => dice.below(3),
                };
                disk.apply(operation, fate, &mut dice);
            }
            newer += u32::from(check(&disk, &crashed, &states, known) > known);
        }
        if matches!(operation, Operation::Sync) {
            unsynced.drain(..).for_each(|operation| durable.apply(operation, 0, &mut dice));
        }
    }
    assert!(log.len() > 100 && newer > 20, "{} calls, {newer} crashes after the switch", log.len());
}
