//! The state before a stroke, for tools that read what is seen: it must not change under them.

use std::sync::Arc;

use fantex_store::{EditError, PageCache};

use super::painter::Painter;
use crate::PaintError;

impl Painter {
    /// The asset as it is seen now, to stay so while the stroke is open. A commit gives such a state. Where the disk is full
    /// the changes in memory are looked through instead, and nothing is written before the stroke ends.
    pub(crate) fn state_before(&mut self) -> Result<PageCache, PaintError> {
        let budget = self.options.memory_bytes / 8;
        match self.commit() {
            Ok(_) => Ok(PageCache::new(Arc::clone(self.editor.asset()), budget)),
            Err(PaintError::Edit(EditError::Full { .. })) => {
                self.room.hold();
                Ok(PageCache::of_snapshot(self.editor.snapshot(), budget))
            }
            Err(error) => Err(error),
        }
    }
}
