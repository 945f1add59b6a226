//! Changing assets in place, safely.
//!
//! ```text
//!  replace, set_mean, attach      commit
//!  ------------------------>  1. changed clusters, attachments, directory -> free space or the file's end
//!      kept in memory         2. made durable
//!      (flush: step 1 early)  3. the header slot that does not count <- generation + 1
//!                             4. made durable
//! ```
//!
//! - *Nothing that a header slot names is ever overwritten*, so a crash at any moment leaves a committed state: the old
//!   one up to step 3, the new one after it. A torn slot fails its checksum and leaves the other one.
//! - *A reader keeps its generation.* Space that a commit supersedes is reused only when neither slot names it (after the
//!   second next commit), no [`Asset`] that this editor handed out is older, and no other reader has the file open (see
//!   `lock.rs`). Until then the file grows.
//! - *A failed commit loses nothing.* Changes stay with the editor, the space taken is given back, and the commit can be
//!   tried again. If it fails at step 3 or 4 the new generation may or may not be on the disk; both are whole, and the next
//!   attempt takes another number.
//!
//! One file holds one subject: `editor.rs` the changes and reading them, `commit.rs` the steps above, `runs.rs` what is rewritten,
//! `space.rs` where to, `lock.rs` who may, `compact.rs` the fresh copy.

mod commit;
mod compact;
mod editor;
mod error;
pub(crate) mod lock;
mod output;
mod runs;
mod space;
#[cfg(test)]
mod tests;
mod view;

pub use commit::CommitSummary;
pub use compact::CompactSummary;
pub use editor::{AssetEditor, EditOptions};
pub use error::EditError;
pub use view::EditorSnapshot;
