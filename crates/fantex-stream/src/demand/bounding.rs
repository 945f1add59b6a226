//! Bounds of pages that are not known yet, taken by several threads at once.
//!
//! An update goes in rounds. What is known of the tiles that wait tells what they want and which grids and bounds come next, the coarsest
//! pages of a tile first; of these as many are taken as there is work left for, and carried out in parallel. So what an update does is decided
//! before threads begin, and does not depend on how many there are: an update may do what [`THREADS`] of them do in its time, on every machine.

use std::sync::LazyLock;

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::bounds::{Lens, Slack};
use super::paged::{BoundingResult, BoundingTask, PagesWanted};
use super::{Demand, DemandSurface};

/// Threads for which work is counted. In WebAssembly there is one.
const THREADS: usize = if cfg!(target_arch = "wasm32") { 1 } else { 4 };

/// Tiles whose pages are bounded at once; the next ones wait for their turn.
const MAX_OPEN_TILES: usize = 64;

/// Work from which on it pays to wake threads, in units of a group's bounds.
const MIN_SHARED_WORK: usize = 1 << 9;
/// Tiles from which on it does.
const MIN_SHARED_TILES: usize = 8;

impl Demand {
    /// Takes bounds for the tiles that wait for them as long as there is work left, and something in every update, so that all of them are
    /// taken in the end. The work is exceeded by less than a task.
    pub(super) fn bound_pages(&mut self, surface: &mut DemandSurface, lens: &Lens, changed: &mut Vec<u32>) {
        let mut left = self.left * THREADS;
        let mut is_owed_one = true;
        while !self.waiting.is_empty() {
            let open: Vec<(u32, Slack)> =
                self.waiting.iter().take(MAX_OPEN_TILES).map(|(&group, &slack)| (group, slack)).collect();
            self.work.paged += open.len() as u32;
            let (mut tasks, mut work) = (Vec::new(), 0);
            for (&(group, slack), wanted) in open.iter().zip(self.look_at_all(surface, lens, &open)) {
                left = left.saturating_sub(wanted.looked_at);
                for (task, task_work) in surface.tasks(group, &wanted.unbounded) {
                    let is_owed = is_owed_one && tasks.is_empty();
                    if work >= left && !is_owed {
                        break;
                    }
                    tasks.push((group, task));
                    work += task_work;
                }
                self.take_pages(group, slack, wanted, changed);
            }
            if tasks.is_empty() && left == 0 {
                break;
            }
            is_owed_one &= tasks.is_empty();
            surface.carry_out_all(&tasks, work);
            left = left.saturating_sub(work);
        }
        self.left = left / THREADS;
    }

    fn look_at_all(&self, surface: &DemandSurface, lens: &Lens, tiles: &[(u32, Slack)]) -> Vec<PagesWanted> {
        let look =
            |&(group, slack): &(u32, Slack)| surface.pages_wanted(group, (lens, slack), self.pages(group));
        if tiles.len() < MIN_SHARED_TILES {
            return tiles.iter().map(look).collect();
        }
        in_parallel(|| tiles.par_iter().map(look).collect())
    }
}

impl DemandSurface {
    /// What comes next for the bounds of pages of a large tile, and the work of each task.
    fn tasks<'a>(
        &'a self,
        group: u32,
        unbounded: &'a [u32],
    ) -> impl Iterator<Item = (BoundingTask, usize)> + 'a {
        let tile = self.paged.get(&group).into_iter();
        tile.flat_map(move |tile| tile.tasks(self.shapes.of(group), unbounded))
    }

    /// Carries out tasks, which take `work` together.
    fn carry_out_all(&mut self, tasks: &[(u32, BoundingTask)], work: usize) {
        let carry_out = |&(group, task): &(u32, BoundingTask)| {
            let tile = self.paged.get(&group)?;
            Some((group, tile.carry_out(&*self.geometry, self.shapes.of(group), task)))
        };
        let results: Vec<(u32, BoundingResult)> = if work < MIN_SHARED_WORK {
            tasks.iter().filter_map(carry_out).collect()
        } else {
            in_parallel(|| tasks.par_iter().with_max_len(1).filter_map(carry_out).collect())
        };
        for (group, result) in results {
            if let Some(tile) = self.paged.get_mut(&group) {
                tile.keep(result);
            }
        }
    }
}

/// Runs what rayon splits up on threads of its own: others may be at work for longer than a frame lasts.
fn in_parallel<T: Send>(run: impl FnOnce() -> T + Send) -> T {
    static POOL: LazyLock<Option<ThreadPool>> = LazyLock::new(|| {
        let cores = std::thread::available_parallelism().map_or(1, |cores| cores.get());
        let threads = ThreadPoolBuilder::new().num_threads(cores.min(THREADS));
        threads.thread_name(|index| format!("fan-bound-{index}")).build().ok()
    });
    match &*POOL {
        Some(pool) => pool.install(run),
        None => run(),
    }
}
