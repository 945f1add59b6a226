//! The seam between what decides and what reads.

use std::sync::Arc;

use fantex_store::PageError;

use crate::Parcel;

/// Texels of a parcel in the formats of the atlas.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParcelTexels {
    /// Columns and rows, multiples of 4.
    pub extent: [u32; 2],
    /// Per channel of the asset: rows of blocks, or of texels, from v = 0, without padding. What lies between the pages of a
    /// bundle is anything.
    pub channels: Vec<Arc<[u8]>>,
}

impl ParcelTexels {
    /// Bytes of all channels.
    pub fn bytes(&self) -> usize {
        self.channels.iter().map(|channel| channel.len()).sum()
    }
}

/// A parcel that has arrived, or never will.
#[derive(Clone, Debug)]
pub struct LoadedParcel {
    /// Which.
    pub parcel: Parcel,
    /// Its texels, or what was wrong. A bundle of which one page cannot be read is an error.
    pub texels: Result<ParcelTexels, PageError>,
}

/// Brings parcels from wherever they are, many at a time, in the background. Pages of one cluster are read together.
pub trait ParcelLoader: Send {
    /// Asks for a parcel. The greater `urgency` (any finite number), the earlier it comes. Asking for one that has been asked
    /// for and has not arrived changes its urgency.
    fn request(&mut self, parcel: Parcel, urgency: f32);

    /// [`ParcelLoader::request`] of several parcels, in order.
    fn request_all(&mut self, parcels: &[(Parcel, f32)]) {
        for &(parcel, urgency) in parcels {
            self.request(parcel, urgency);
        }
    }

    /// The parcel is no longer wanted: it does not arrive any more unless it is asked for again. No effect on one that has
    /// not been asked for.
    fn cancel(&mut self, parcel: Parcel);

    /// [`ParcelLoader::cancel`] of several parcels, in order.
    fn cancel_all(&mut self, parcels: &[Parcel]) {
        for &parcel in parcels {
            self.cancel(parcel);
        }
    }

    /// Parcels that have arrived or failed since the last call, the most urgent first, at least one if there is any, no more
    /// than make up `max_bytes`. Does not wait, and may bring nothing now and then although there is something.
    fn poll(&mut self, max_bytes: usize) -> Vec<LoadedParcel>;

    /// Parcels that were asked for and have neither arrived (in [`ParcelLoader::poll`]) nor been cancelled.
    fn pending(&self) -> usize;
}
