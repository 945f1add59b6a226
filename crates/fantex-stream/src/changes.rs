//! What the owner of the atlas does in one frame.

use crate::{AtlasPlace, Parcel, ParcelTexels, TableEntry};

/// A parcel to copy into the atlas.
#[derive(Debug)]
pub struct ParcelUpload {
    /// Which.
    pub parcel: Parcel,
    /// Where to.
    pub place: AtlasPlace,
    /// Its texels, per channel.
    pub texels: ParcelTexels,
}

/// An entry of the page table that has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableChange {
    /// Index in the [`PageTable`](crate::PageTable).
    pub index: u32,
    /// Its new value.
    pub entry: TableEntry,
}

/// What to do before the next picture, in this order: uploads, then entries. After that no entry names a place that holds
/// anything but its page.
#[derive(Debug, Default)]
pub struct FrameChanges {
    /// Parcels that have arrived. Places may be those of others that left in the same frame.
    pub uploads: Vec<ParcelUpload>,
    /// Entries, ascending by index, each at most once.
    pub entries: Vec<TableChange>,
}
