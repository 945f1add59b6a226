//! When a view is sharp after a cut.

use crate::{Parcel, Streamer};

/// Waits until what a view needed when the camera cut to it has come.
///
/// A camera that goes on moving after the cut needs other parcels in every frame, and one that becomes needed now is there in
/// the next frame at the earliest, unless it was foreseen. So a frame that lacks nothing at all may be far off although all that
/// the cut uncovered came at once. What is awaited is what the view lacked at the cut; what the camera has left behind
/// since then is awaited no longer, nor what cannot be read.
#[derive(Clone, Debug, Default)]
pub struct CutWatch {
    awaited: Vec<Parcel>,
    is_known: bool,
}

impl CutWatch {
    /// To be updated from the cut's own frame on.
    pub fn new() -> Self {
        Self::default()
    }

    /// Looks at a streamer after its update; whether all visible tiles have the levels that the cut asked of them. Costs
    /// next to nothing per frame but one look at all groups: parcels are looked at until the first that is missing.
    pub fn update(&mut self, streamer: &Streamer) -> bool {
        if !self.is_known && !streamer.has_backlog() {
            self.awaited = streamer.missing();
            self.is_known = true;
        }
        while self.awaited.pop_if(|parcel| !streamer.is_missing(*parcel)).is_some() {}
        self.is_known && self.awaited.is_empty()
    }

    /// Parcels that are still awaited, and some that have come meanwhile.
    pub fn awaited(&self) -> &[Parcel] {
        &self.awaited
    }
}
