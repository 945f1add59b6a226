//! From texels that have arrived to uploads.

use fantex_store::{PageError, PageId};

use super::{Flight, Residency};
use crate::{FrameChanges, LoadedPage, PageLoader, PageTexels, PageUpload};

/// Frames after which a page that is not needed makes room for one that is fetched ahead: about as many as it is fetched
/// ahead. (With four times as many, a camera that flew on after a cut found no room for what it foresaw.)
const AHEAD_AGE: u32 = 15;

/// Pages that are placed in a sixtieth of a second, at most. Each takes about a microsecond, however small it is.
const PAGES_PER_FRAME: usize = 1 << 12;

/// The loader is asked for so large a part of a frame's bytes at a time: pages may be tiny, and then are many.
const POLLS_PER_FRAME: usize = 16;

impl Residency {
    /// Takes what has arrived and gives it places, until `max_bytes` are uploaded (at least one page, if there is any).
    pub(crate) fn arrive(&mut self, max_bytes: usize, loader: &mut dyn PageLoader) -> FrameChanges {
        let mut frame = Arrivals {
            changes: FrameChanges::default(),
            bytes: 0,
            max_bytes,
            max_pages: self.pace.times(PAGES_PER_FRAME),
            stuck: Vec::new(),
        };
        self.settle(&mut frame);
        while !frame.is_full() {
            let loaded = loader.poll((max_bytes / POLLS_PER_FRAME).clamp(1, max_bytes - frame.bytes));
            if loaded.is_empty() {
                break;
            }
            for page in loaded {
                self.take_in(page, &mut frame);
            }
            self.settle(&mut frame);
        }
        if !frame.stuck.is_empty() {
            // With another bias on its way less is needed soon.
            if self.exact_backlog == 0 {
                self.pressure.squeeze();
            }
            self.ready.extend(frame.stuck);
        }
        self.uploaded_bytes += frame.bytes as u64;
        frame.changes
    }

    fn take_in(&mut self, loaded: LoadedPage, frame: &mut Arrivals) {
        let LoadedPage { page, texels } = loaded;
        let index = self.pool.index(page);
        // What was cancelled in the meantime is not wanted any more.
        if !matches!(self.flight(index), Flight::Asked | Flight::Ahead) {
            return;
        }
        match texels {
            Err(error) => {
                self.set_flight(page, index, Flight::None);
                self.give_up(page, index, error);
            }
            Ok(texels) => match self.pool.entry(index).place() {
                Some(place) => {
                    self.set_flight(page, index, Flight::None);
                    frame.upload(PageUpload { page, place, texels });
                }
                None => {
                    self.set_flight(page, index, Flight::Waiting);
                    self.waiting.insert(index, (page, texels));
                    self.ready.push_back(index);
                }
            },
        }
    }

    /// A page cannot be read: nobody waits for it any longer.
    fn give_up(&mut self, page: PageId, index: u32, error: PageError) {
        let is_new = self.damaged.insert(page, error).is_none();
        // What is resident has the texels from before it was to be read again.
        if self.pool.is_resident(index) {
            return;
        }
        if is_new && self.pool.is_needed(index) {
            self.count_missing(page.group, false);
        }
        self.pool.add_hole(index);
        self.wake_under(page);
    }

    /// Pages that have waited for one over them look again.
    fn wake_under(&mut self, page: PageId) {
        let Self { pool, ready, flights, .. } = self;
        pool.for_each_under(page, &mut |index| {
            if flights[index as usize] == Flight::Waiting {
                ready.push_back(index);
            }
        });
    }

    /// Gives places to pages whose coarser ones are resident.
    fn settle(&mut self, frame: &mut Arrivals) {
        while !frame.is_full() {
            let Some(index) = self.ready.pop_front() else { return };
            if self.flight(index) == Flight::Waiting
                && let Some(&(page, _)) = self.waiting.get(&index)
            {
                self.settle_page(page, index, frame);
            }
        }
    }

    fn settle_page(&mut self, page: PageId, index: u32, frame: &mut Arrivals) {
        let is_needed = self.pool.is_needed(index);
        if let Some(missing) = self.pool.blocker(page) {
            // It becomes ready when that one is placed.
            if self.flight(missing) == Flight::None && !is_needed {
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
                self.wake_under(page);
            }
            None if is_needed => frame.stuck.push(index),
            None => {
                self.drop_waiting(page, index);
            }
        }
    }

    fn drop_waiting(&mut self, page: PageId, index: u32) -> Option<PageTexels> {
        self.set_flight(page, index, Flight::None);
        self.waiting.remove(&index).map(|(_, texels)| texels)
    }
}

/// What arrives in one frame.
struct Arrivals {
    changes: FrameChanges,
    /// Of the uploads.
    bytes: usize,
    max_bytes: usize,
    max_pages: usize,
    /// Needed pages without room.
    stuck: Vec<u32>,
}

impl Arrivals {
    fn is_full(&self) -> bool {
        self.bytes >= self.max_bytes || self.changes.uploads.len() >= self.max_pages
    }

    fn upload(&mut self, upload: PageUpload) {
        self.bytes += upload.texels.bytes();
        self.changes.uploads.push(upload);
    }
}
