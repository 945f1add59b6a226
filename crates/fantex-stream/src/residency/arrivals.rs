//! From texels that have arrived to uploads.

use fantex_store::PageId;

use super::Residency;
use crate::{FrameChanges, LoadedPage, PageLoader, PageTexels, PageUpload};

/// Frames after which a page that is not needed makes room for one that is fetched ahead.
const AHEAD_AGE: u32 = 60;

impl Residency {
    /// Takes what has arrived and gives it places, until `max_bytes` are uploaded (at least one page, if there is any).
    pub(crate) fn arrive(&mut self, max_bytes: usize, loader: &mut dyn PageLoader) -> FrameChanges {
        let mut frame = Arrivals { changes: FrameChanges::default(), bytes: 0, max_bytes, stuck: Vec::new() };
        self.settle(&mut frame);
        while frame.bytes < max_bytes {
            let loaded = loader.poll(max_bytes - frame.bytes);
            if loaded.is_empty() {
                break;
            }
            for page in loaded {
                self.take_in(page, &mut frame);
            }
            self.settle(&mut frame);
        }
        if !frame.stuck.is_empty() {
            self.pressure.squeeze();
            self.ready.extend(frame.stuck);
        }
        self.uploaded_bytes += frame.bytes as u64;
        frame.changes
    }

    fn take_in(&mut self, loaded: LoadedPage, frame: &mut Arrivals) {
        let LoadedPage { page, texels } = loaded;
        let index = self.pool.index(page);
        // What was cancelled in the meantime is not wanted any more.
        if self.pending.remove(&index).is_none() {
            return;
        }
        match texels {
            Err(error) => {
                self.in_flight_texels -= self.texels(page);
                self.damaged.insert(page, error);
                self.drop_under(page);
            }
            Ok(texels) => match self.pool.entry(index).place() {
                Some(place) => {
                    self.in_flight_texels -= self.texels(page);
                    frame.upload(PageUpload { page, place, texels });
                }
                None => {
                    self.waiting.insert(index, (page, texels));
                    self.ready.push_back(index);
                }
            },
        }
    }

    /// Pages under a damaged one have no use.
    fn drop_under(&mut self, damaged: PageId) {
        let pages = self.pool.pages_of(damaged.group);
        let on_their_way = self.pending.range(pages.clone()).map(|(&index, pending)| (pending.page, index));
        let arrived = self.waiting.range(pages).map(|(&index, (page, _))| (*page, index));
        let useless: Vec<(PageId, u32)> =
            on_their_way.chain(arrived).filter(|&(page, _)| self.is_blocked(page)).collect();
        for (page, index) in useless {
            self.forget(page, index);
        }
    }

    /// Gives places to pages whose coarser ones are resident.
    fn settle(&mut self, frame: &mut Arrivals) {
        while frame.bytes < frame.max_bytes {
            let Some(index) = self.ready.pop_front() else { return };
            if let Some(&(page, _)) = self.waiting.get(&index) {
                self.settle_page(page, index, frame);
            }
        }
    }

    fn settle_page(&mut self, page: PageId, index: u32, frame: &mut Arrivals) {
        let is_needed = self.pool.is_needed(index);
        let mut coarser = self.pool.coarser(page).map(|p| self.pool.index(p));
        if let Some(missing) = coarser.find(|&i| !self.pool.is_resident(i)) {
            // It becomes ready when that one is placed.
            let comes = self.pending.contains_key(&missing) || self.waiting.contains_key(&missing);
            if !comes && !is_needed {
                self.drop_waiting(page, index);
            }
            return;
        }
        match self.pool.insert(page, index, if is_needed { 0 } else { AHEAD_AGE }) {
            Some(place) => {
                if let Some(texels) = self.drop_waiting(page, index) {
                    frame.upload(PageUpload { page, place, texels });
                }
                if is_needed {
                    self.count_missing(page.group, false);
                }
                let finer = self.pool.finer(page).map(|p| self.pool.index(p));
                self.ready.extend(finer.filter(|i| self.waiting.contains_key(i)));
            }
            None if is_needed => frame.stuck.push(index),
            None => {
                self.drop_waiting(page, index);
            }
        }
    }

    fn drop_waiting(&mut self, page: PageId, index: u32) -> Option<PageTexels> {
        let (_, texels) = self.waiting.remove(&index)?;
        self.in_flight_texels -= self.texels(page);
        Some(texels)
    }
}

/// What arrives in one frame.
struct Arrivals {
    changes: FrameChanges,
    /// Of the uploads.
    bytes: usize,
    max_bytes: usize,
    /// Needed pages without room.
    stuck: Vec<u32>,
}

impl Arrivals {
    fn upload(&mut self, upload: PageUpload) {
        self.bytes += upload.texels.bytes();
        self.changes.uploads.push(upload);
    }
}
