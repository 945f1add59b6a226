//! The seam between what decides and what reads.

use std::sync::Arc;

use fantex_store::{PageError, PageId};

/// Texels of one page in the formats of the atlas.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageTexels {
    /// Columns and rows, multiples of 4.
    pub extent: [u32; 2],
    /// Per channel of the asset: rows of blocks, or of texels, from v = 0, without padding.
    pub channels: Vec<Arc<[u8]>>,
}

impl PageTexels {
    /// Bytes of all channels.
    pub fn bytes(&self) -> usize {
        self.channels.iter().map(|channel| channel.len()).sum()
    }
}

/// A page that has arrived, or never will.
#[derive(Clone, Debug)]
pub struct LoadedPage {
    /// Which.
    pub page: PageId,
    /// Its texels, or what was wrong.
    pub texels: Result<PageTexels, PageError>,
}

/// Brings pages from wherever they are, many at a time, in the background. Pages of one cluster are read together.
pub trait PageLoader: Send {
    /// Asks for a page. The greater `urgency` (any finite number), the earlier it comes. Asking for a page that has been asked
    /// for and has not arrived changes its urgency.
    fn request(&mut self, page: PageId, urgency: f32);

    /// [`PageLoader::request`] of several pages, in order.
    fn request_all(&mut self, pages: &[(PageId, f32)]) {
        for &(page, urgency) in pages {
            self.request(page, urgency);
        }
    }

    /// The page is no longer wanted: it does not arrive any more unless it is asked for again. No effect on a page that has
    /// not been asked for.
    fn cancel(&mut self, page: PageId);

    /// [`PageLoader::cancel`] of several pages, in order.
    fn cancel_all(&mut self, pages: &[PageId]) {
        for &page in pages {
            self.cancel(page);
        }
    }

    /// Pages that have arrived or failed since the last call, the most urgent first, at least one if there is any, no more
    /// than make up `max_bytes`. Does not wait.
    fn poll(&mut self, max_bytes: usize) -> Vec<LoadedPage>;

    /// Pages that were asked for and have neither arrived (in [`PageLoader::poll`]) nor been cancelled.
    fn pending(&self) -> usize;
}
