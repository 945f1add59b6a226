//! Coarser levels of a step, at once or beside the painting.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use fantex_store::{EditorSnapshot, PageId};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::levels::{CoarserLevels, Dirty, LevelJob, dirty_levels, pages_read};
use super::texel_page::TexelPages;
use crate::{PaintError, Surface};

/// Groups whose levels are worked on at a time.
pub(crate) const GROUP_BATCH: usize = 64;

/// What the levels of some groups become.
pub(crate) type LevelResults = Vec<(u32, CoarserLevels)>;

/// Groups whose coarser levels are due.
#[derive(Debug)]
pub(crate) struct LevelWork {
    pub(crate) surface: Arc<Surface>,
    /// All pages as they are after the step.
    pub(crate) pages: EditorSnapshot,
    pub(crate) groups: Vec<(u32, Dirty)>,
    pub(crate) channels: Vec<usize>,
    /// Of texel maps.
    pub(crate) budget_bytes: usize,
}

impl LevelWork {
    /// Does the work, in parallel; results in the order of the groups.
    pub(crate) fn run(&self, maps: &mut TexelPages) -> Result<LevelResults, PaintError> {
        let mut results = Vec::with_capacity(self.groups.len());
        for batch in self.groups.chunks(GROUP_BATCH) {
            results.extend(self.run_batch(batch, maps)?);
        }
        Ok(results)
    }

    fn run_batch(&self, groups: &[(u32, Dirty)], maps: &mut TexelPages) -> Result<LevelResults, PaintError> {
        let surface = &*self.surface;
        let jobs: Vec<(u32, Vec<Dirty>)> = groups
            .par_iter()
            .map(|(group, dirty)| (*group, dirty_levels(surface, *group, dirty.clone())))
            .collect();
        let ids: Vec<PageId> =
            jobs.iter().flat_map(|(group, levels)| pages_read(surface, *group, levels)).collect();
        let maps = maps.get(surface, &ids, self.budget_bytes);
        let maps: BTreeMap<_, _> = ids.into_iter().zip(maps).collect();
        jobs.par_iter()
            .map(|(group, levels)| {
                let mut result = CoarserLevels::default();
                for &channel in &self.channels {
                    let (group, pages) = (*group, &self.pages);
                    LevelJob { surface, pages, group, channel, maps: &maps }.run(levels, &mut result)?;
                }
                Ok((*group, result))
            })
            .collect()
    }
}

/// Work that another thread does.
#[derive(Debug)]
pub(crate) struct LevelsUnderway(Receiver<Result<LevelResults, PaintError>>);

impl LevelsUnderway {
    /// Hands work to the thread for levels: one for all painters, so that dabs keep theirs. Gives it back where there is no
    /// such thread.
    pub(crate) fn start(work: LevelWork, maps: &Arc<Mutex<TexelPages>>) -> Result<Self, LevelWork> {
        static POOL: OnceLock<Option<ThreadPool>> = OnceLock::new();
        let name = |_| "paint levels".to_owned();
        let pool =
            POOL.get_or_init(|| ThreadPoolBuilder::new().num_threads(1).thread_name(name).build().ok());
        let Some(pool) = pool else { return Err(work) };
        let (sender, receiver) = channel();
        let maps = Arc::clone(maps);
        pool.spawn(move || {
            let results = work.run(&mut maps.lock().unwrap_or_else(PoisonError::into_inner));
            // The snapshot goes before the results are known.
            drop(work);
            // A painter that is gone needs no levels.
            drop(sender.send(results));
        });
        Ok(Self(receiver))
    }

    /// The results, if they are there.
    pub(crate) fn poll(self) -> Result<Result<LevelResults, PaintError>, Self> {
        match self.0.try_recv() {
            Ok(results) => Ok(results),
            Err(TryRecvError::Empty) => Err(self),
            Err(TryRecvError::Disconnected) => Ok(Err(PaintError::LevelsLost)),
        }
    }

    /// Waits for the results.
    pub(crate) fn wait(self) -> Result<LevelResults, PaintError> {
        self.0.recv().unwrap_or(Err(PaintError::LevelsLost))
    }
}
