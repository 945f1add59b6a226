//! Merging the parts of a planned bake, wherever they and the asset lie.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::{Error, Result, input};
use fantex_store::{
    ByteSource, CreateOptions, PartRun, PathSource, Plan, WriteSummary, merge_sources, merge_with_gaps,
};
use fantex_stream::{Assembled, ObjectTarget, Replace, SharedRun, open_source, url_of};

use crate::addresses::{Target, watched};

/// What a merge has written.
#[derive(Clone, Debug)]
pub struct Merged {
    /// The asset.
    pub written: WriteSummary,
    /// Bytes of it that an object store has copied itself.
    pub copied_bytes: u64,
    /// Why the store has copied none although parts and asset lie in it.
    pub note: Option<String>,
}

/// A merge of parts, at paths or addresses in any order, into an asset, or only a look at them.
#[derive(Clone, Copy, Debug)]
pub struct Merge<'a> {
    /// The plan of the bake.
    pub plan: &'a Plan,
    /// All its parts.
    pub parts: &'a [PathBuf],
    /// Whether an asset that is there is overwritten.
    pub force: bool,
}

impl Merge<'_> {
    /// Reads all parts and writes nothing.
    ///
    /// # Errors
    /// As [`merge_sources`].
    pub fn check(&self, progress: &dyn Progress) -> Result<Merged> {
        Ok(Merged { written: self.read_all(None, progress)?, copied_bytes: 0, note: None })
    }

    /// Writes the asset. Where parts and asset lie in one object store that copies ranges of objects, it copies most texels itself. Progress
    /// counts bytes that are read, that the store copies, and that are sent.
    ///
    /// # Errors
    /// As [`merge_sources`], [`ObjectTarget::assemble`] and [`ObjectTarget::put`]; what is there may not be overwritten, or is one of the parts. Then
    /// no asset is written.
    pub fn write(&self, output: &Path, progress: [&dyn Progress; 3]) -> Result<Merged> {
        let [reading, copying, sending] = progress;
        let target = Target::new(output)?;
        // Of files that is known by what is open.
        if target.object().is_some() && self.parts.iter().any(|part| part == output) {
            return Err(input::is_read(output));
        }
        let note = match self.copied(&target, [reading, copying])? {
            Attempt::Done(merged) => return Ok(merged),
            Attempt::NotCopied(note) => note,
        };
        let written = self.read_all(Some(target.file()), reading)?;
        target.finish(&self.replace(), sending)?;
        Ok(Merged { written, copied_bytes: 0, note })
    }

    fn options(&self) -> CreateOptions {
        CreateOptions { force: self.force, ..CreateOptions::default() }
    }

    fn replace(&self) -> Replace {
        if self.force { Replace::Anything } else { Replace::Nothing }
    }

    fn read_all(&self, output: Option<&Path>, progress: &dyn Progress) -> Result<WriteSummary> {
        let source = |part: &PathBuf| -> Result<Arc<dyn ByteSource>> {
            match url_of(part) {
                Some(_) => open_source(part),
                None => Ok(Arc::new(PathSource::new(part))),
            }
        };
        let parts = self.parts.iter().map(source).collect::<Result<Vec<_>>>()?;
        let options = self.options();
        let output = output.map(|path| (path, &options));
        merge_sources(self.plan, &parts, output, &|done, total| watched(progress, done, total))
    }

    /// Has the store of parts and asset copy the texels, if they lie in one that does.
    fn copied(&self, target: &Target<'_>, progress: [&dyn Progress; 2]) -> Result<Attempt> {
        let [reading, copying] = progress;
        let Some(object) = target.object() else { return Ok(Attempt::NotCopied(None)) };
        let sources: Option<Vec<_>> = self.parts.iter().map(|part| object.source_to_copy(part)).collect();
        let Some(sources) = sources else { return Ok(Attempt::NotCopied(None)) };
        let parts: Vec<_> = sources.iter().map(|source| Arc::clone(source) as Arc<dyn ByteSource>).collect();
        let file = target.file();
        let watch = |done, total| watched(reading, done, total);
        let (written, gaps) = merge_with_gaps(self.plan, &parts, file, &self.options(), &watch)?;
        let shared = |PartRun { part, offset, range }| {
            let source = Arc::clone(&sources[part]);
            SharedRun { source, offset, range }
        };
        let runs: Vec<_> = gaps.into_iter().map(shared).collect();
        let watch = |done, total| watched(copying, done, total);
        match object.assemble(file, &runs, &self.replace(), &watch)? {
            Assembled::Done(copied_bytes) => Ok(Attempt::Done(Merged { written, copied_bytes, note: None })),
            Assembled::NotCopied(why) => {
                std::fs::remove_file(file).map_err(|error| Error::writing(file, error))?;
                Ok(Attempt::NotCopied(why.map(|why| not_copied(object, &why))))
            }
        }
    }
}

enum Attempt {
    Done(Merged),
    NotCopied(Option<String>),
}

fn not_copied(object: &ObjectTarget, why: &str) -> String {
    format!(
        "{}: the store copies no ranges of objects ({why}), so all bytes go through this machine",
        object.location().display()
    )
}
