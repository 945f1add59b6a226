//! Outputs that record what is written, and fail on purpose.

use std::io::{Error, ErrorKind, Result};
use std::path::Path;
use std::sync::{Arc, Mutex};

use crate::edit::editor::AssetEditor;
use crate::edit::lock::WriterLock;
use crate::edit::output::{FileOutput, Output};
use crate::edit::runs::RunPacking;

/// One call.
#[derive(Clone, Debug)]
pub(super) enum Operation {
    Write(u64, Vec<u8>),
    SetLen(u64),
    Sync,
}

/// What a recorder has seen and what it shall do.
#[derive(Debug, Default)]
pub(super) struct Plan {
    pub(super) log: Vec<Operation>,
    /// From this call on everything that needs room fails, half done.
    pub(super) fail_from: Option<usize>,
    pub(super) fail_kind: Option<ErrorKind>,
    /// Only this one call fails.
    pub(super) once: bool,
}

impl Plan {
    fn fails(&mut self, operation: Operation) -> Option<Error> {
        let index = self.log.len();
        self.log.push(operation);
        let from = self.fail_from?;
        let fails = if self.once { index == from } else { index >= from };
        fails.then(|| self.fail_kind.unwrap_or(ErrorKind::StorageFull).into())
    }
}

/// Writes to the file as planned.
#[derive(Debug)]
pub(super) struct Recorder {
    file: FileOutput,
    plan: Arc<Mutex<Plan>>,
}

impl Output for Recorder {
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        match self.plan.lock().unwrap().fails(Operation::Write(offset, bytes.to_vec())) {
            Some(error) => {
                self.file.write_at(offset, &bytes[..bytes.len() / 2])?;
                Err(error)
            }
            None => self.file.write_at(offset, bytes),
        }
    }

    fn set_len(&mut self, length: u64) -> Result<()> {
        self.plan.lock().unwrap().fails(Operation::SetLen(length)).map_or(Ok(()), Err)?;
        self.file.set_len(length)
    }

    fn sync(&mut self) -> Result<()> {
        // The tests' crashes are made of the log; nothing needs to reach the disk.
        self.plan.lock().unwrap().fails(Operation::Sync).map_or(Ok(()), Err)
    }
}

/// An editor that writes through a recorder.
pub(super) fn recorded_editor(path: &Path) -> (AssetEditor, Arc<Mutex<Plan>>) {
    let lock = Arc::new(WriterLock::acquire(path).unwrap());
    let file = Arc::new(std::fs::OpenOptions::new().read(true).write(true).open(path).unwrap());
    let plan = Arc::new(Mutex::new(Plan::default()));
    let output = Recorder { file: FileOutput(Arc::clone(&file)), plan: Arc::clone(&plan) };
    // Short runs, so that clusters of a small asset are cut.
    let packing = RunPacking { run_bytes: 4096, zstd_level: 1 };
    (AssetEditor::with_output(path, packing, lock, file, Box::new(output)).unwrap(), plan)
}
