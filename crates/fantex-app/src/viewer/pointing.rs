//! What the pointer is on: found where it moves, read in the background.

use std::sync::Arc;

use fantex::glam::DVec2;
use fantex::store::{ChannelKind, PageCache};

use crate::document::{Content, Document};
use crate::job::{Job, JobState};
use crate::paint::{Alone, Painting};
use crate::readout::{Asked, Spot, Values, is_shown};
use crate::viewer::Viewer;

/// Memory for pages that were pointed at.
const CACHE_BYTES: usize = 16 << 20;

impl Viewer {
    /// Whether it is told what the pointer is on. Worlds and looks have no tiles that could be.
    pub fn has_readout(&self) -> bool {
        let is_readable = |document: &Document| !matches!(document.content, Content::World(_));
        self.settings.panels.has_readout
            && self.live.is_none()
            && self.document.as_ref().is_some_and(is_readable)
    }

    /// Whether the point under the pointer can be found.
    pub fn can_point(&self) -> bool {
        self.painting.is_some() || self.ground.is_some()
    }

    /// The pointer is at a place of the scene, 0..1 along its sides, or beside it.
    pub fn point_at(&mut self, cursor: Option<DVec2>) {
        let spot = cursor.filter(|_| self.has_readout()).and_then(|at| self.spot_under(at));
        self.readout.move_to(spot);
        self.ask_values();
    }

    fn spot_under(&self, at: DVec2) -> Option<Spot> {
        let (document, view) = (self.document.as_ref()?, self.viewpoint());
        let point = match (&self.painting, &self.ground) {
            (Some(painting), _) => view.hit(&painting.surface, at)?,
            (None, Some(ground)) => ground.point(view.rig.eye, view.rig.ray(at, view.aspect()))?,
            (None, None) => return None,
        };
        let cover = document.asset().map(|asset| asset.cover());
        Some(Spot::new(document.mesh(), cover, point, (&view, at), &self.settings.display.filter()))
    }

    /// Asks for the values where the pointer is, unless they are on their way.
    fn ask_values(&mut self) {
        let Some(spot) = self.readout.spot.as_ref().filter(|spot| !spot.tiles.is_empty()) else { return };
        let point = spot.point;
        if let Some(painting) = &mut self.painting {
            return painting.probe(point);
        }
        let Some(asset) = self.document.as_ref().and_then(Document::asset).cloned() else { return };
        let asked = Asked { spot: spot.clone(), finest: self.readout.finest(asset.cover()) };
        if self.readout.job.is_some() || self.readout.asked.as_ref() == Some(&asked) {
            return;
        }
        let known = self.readout.cache.take().filter(|cache| Arc::ptr_eq(cache.asset(), &asset));
        let cache = known.unwrap_or_else(|| PageCache::new(asset, CACHE_BYTES));
        self.readout.cache = Some(cache.clone());
        let (for_thread, filter) = (asked.clone(), self.settings.display.filter());
        let work = move || for_thread.read(&cache, &filter);
        // Without a thread there are no values, which is no harm.
        if let Ok(job) = Job::spawn("readout", self.waker(), work) {
            self.readout.job = Some(job);
            self.readout.asked = Some(asked);
        }
    }

    pub(super) fn poll_readout(&mut self) {
        let state = self.readout.job.as_ref().map(Job::poll);
        match (state, &self.readout.asked) {
            (None | Some(JobState::Running), _) => return,
            (Some(JobState::Done(channels)), Some(asked)) => {
                let (point, since) = (asked.spot.point, self.notices.now);
                self.readout.values = Some(Values { point, channels, since });
            }
            (Some(JobState::Done(_) | JobState::Lost), _) => {}
        }
        self.readout.job = None;
        // The pointer may have gone on.
        self.ask_values();
    }

    /// Where the pointer is and what the shown channels hold there; none beside the model.
    pub fn readout_text(&self) -> Option<(String, String)> {
        let document = self.document.as_ref()?;
        let cover = document.asset().map(|asset| asset.cover());
        let place = self.readout.place(document.mesh(), cover)?;
        Some((place, self.values_text().unwrap_or_default()))
    }

    fn values_text(&self) -> Option<String> {
        let point = self.readout.spot.as_ref()?.point;
        let painted = self.painting.as_ref().map(|painting| painting.probed.as_ref());
        let values = painted.unwrap_or(self.readout.values.as_ref())?;
        if !values.are_of(point, self.now()) {
            return None;
        }
        let asset = self.document.as_ref()?.asset()?;
        let kinds = asset.channels().iter().map(|channel| channel.kind);
        let sees_height = |painting: &Painting| painting.seen_alone == Some(Alone::Height);
        if self.painting.as_ref().is_some_and(sees_height) {
            return Some(values.text(kinds, |kind| kind == ChannelKind::Displacement));
        }
        Some(values.text(kinds, |kind| is_shown(self.settings.display.shading, kind)))
    }
}
