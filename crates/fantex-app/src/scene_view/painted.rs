//! Pages that have just been painted on, on their way into the atlas.

use std::collections::HashMap;
use std::sync::Arc;

use fantex_cover::Cover;
use fantex_mesh::Mesh;
use fantex_store::{Asset, PageId};
use fantex_stream::{FrameChanges, Geometry, PageTable, ParcelUpload, TableEntry};

use crate::paint::Exchange;

/// Mesh and cover of an asset whose texels change.
pub(super) struct PaintedGeometry {
    mesh: Arc<Mesh>,
    cover: Arc<Cover>,
}

impl PaintedGeometry {
    pub(super) fn of(asset: &Asset) -> Self {
        Self { mesh: asset.shared_mesh(), cover: asset.shared_cover() }
    }
}

impl Geometry for PaintedGeometry {
    fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    fn cover(&self) -> &Cover {
        &self.cover
    }
}

/// Knows where resident pages lie, and brings what was painted there.
#[derive(Debug)]
pub(super) struct PaintedPages {
    exchange: Arc<Exchange>,
    /// Entries of the page table that are not absent.
    entries: HashMap<u32, TableEntry>,
}

impl PaintedPages {
    pub(super) fn new(exchange: Arc<Exchange>) -> Self {
        Self { exchange, entries: HashMap::new() }
    }

    /// Takes over what the streamer has done.
    pub(super) fn follow(&mut self, changes: &FrameChanges) {
        for change in &changes.entries {
            if change.entry == TableEntry::ABSENT {
                self.entries.remove(&change.index);
            } else {
                self.entries.insert(change.index, change.entry);
            }
        }
    }

    /// What was painted since the last call: uploads of resident pages, and pages whose texels have to be asked for.
    pub(super) fn take(&mut self, table: &PageTable, cover: &Cover) -> (FrameChanges, Vec<PageId>) {
        let (fresh, mut stale) = self.exchange.take_fresh();
        let mut changes = FrameChanges::default();
        for (page, texels) in fresh {
            let entry = self.entries.get(&table.index(cover, page));
            match entry.and_then(|entry| entry.place()) {
                Some(place) => changes.uploads.push(ParcelUpload { parcel: page.into(), place, texels }),
                // It may be on its way, as it was.
                None => stale.push(page),
            }
        }
        (changes, stale)
    }

    /// Another state of the file that pages are loaded from.
    pub(super) fn take_asset(&self) -> Option<Arc<Asset>> {
        self.exchange.take_asset()
    }

    /// Whether there is nothing to take.
    pub(super) fn is_settled(&self) -> bool {
        self.exchange.is_empty()
    }
}
