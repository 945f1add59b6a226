//! Room on the disk for changes that memory has none for.

use fantex_base::Result;
use fantex_store::{AssetEditor, CommitSummary, is_disk_full, write_error};

/// Whether the disk took changes when it was last asked.
#[derive(Debug, Default)]
pub(crate) struct Room {
    /// Bytes that were in memory when the disk was full.
    full_at: Option<usize>,
    /// Nothing is to be written: a stroke reads what was written, uncommitted, when it began.
    is_held: bool,
}

impl Room {
    pub(crate) fn is_full(&self) -> bool {
        self.full_at.is_some()
    }

    /// Keeps all changes in memory, until [`let_go`](Self::let_go).
    pub(crate) fn hold(&mut self) {
        self.is_held = true;
    }

    pub(crate) fn let_go(&mut self) {
        self.is_held = false;
    }

    /// Writes changes to the file where they exceed a budget. Where the disk is full they stay in memory, and painting goes on; it
    /// is asked again when an eighth more has come together.
    pub(crate) fn relieve(&mut self, editor: &mut AssetEditor, budget_bytes: usize) -> Result<()> {
        let pending = editor.pending_bytes();
        if self.is_held
            || pending <= budget_bytes
            || self.full_at.is_some_and(|full_at| pending < full_at + full_at / 8)
        {
            return Ok(());
        }
        match editor.flush() {
            Ok(()) => self.full_at = None,
            Err(error) if is_disk_full(&error) => self.full_at = Some(editor.pending_bytes()),
            Err(error) => return Err(error),
        }
        Ok(())
    }

    pub(crate) fn commit(&mut self, editor: &mut AssetEditor) -> Result<CommitSummary> {
        if self.is_held {
            // As it was when the stroke began; when it ends the disk is asked again.
            return Err(write_error(editor.asset().path(), std::io::ErrorKind::StorageFull.into()));
        }
        let committed = editor.commit();
        match &committed {
            Ok(_) => self.full_at = None,
            Err(error) if is_disk_full(error) => self.full_at = Some(editor.pending_bytes()),
            Err(_) => {}
        }
        committed
    }
}
