//! What is open is left: not before it is saved, and not while something of it is in no file, unless that is asked for again.

use std::path::PathBuf;

use crate::paint::{Leave, Painting, SaveState};
use crate::viewer::opening::Wanted;
use crate::viewer::{Exporting, Request, Viewer};

/// Who is told what is lost and asks again within this time, means it.
const WARNED_SECONDS: f64 = 10.0;

/// What waits until what is painted on is saved.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Departure {
    Quit,
    Close,
    Open(Box<Wanted>),
}

/// The user was told what is lost by a departure.
#[derive(Clone, Debug)]
pub(super) struct Warned {
    departure: Departure,
    /// When, seconds.
    at: f64,
    text: String,
}

impl Departure {
    /// What loses something all the same.
    fn again(&self) -> &'static str {
        match self {
            Self::Quit | Self::Close => "Close again",
            Self::Open(_) => "Do that again",
        }
    }
}

impl Viewer {
    /// Whether the window may close. Where something is being saved, closing is asked for ([`Request::Quit`]) once it is.
    pub fn may_close(&mut self) -> bool {
        self.may_leave(Departure::Quit)
    }

    /// Asks for the window to close, once that loses nothing.
    fn ask_quit(&mut self) {
        if self.may_close() {
            self.request(Request::Quit);
        }
    }

    /// Closes what is open, once that loses nothing.
    pub(super) fn ask_close(&mut self) {
        if self.may_leave(Departure::Close) {
            self.close();
        }
    }

    /// Whether what is open may be left at once. Else the departure is told why, or comes by itself once all is saved.
    pub(super) fn may_leave(&mut self, departure: Departure) -> bool {
        self.departure = None;
        let unwritten = if departure == Departure::Quit { self.unwritten() } else { None };
        match self.loss() {
            Leave::Waits => {
                self.departure = Some(departure);
                false
            }
            Leave::Loses(reason) => self.may_lose(&reason, departure),
            Leave::Free => unwritten.is_none_or(|reason| self.may_lose(&reason, departure)),
        }
    }

    /// Whether what was opened may take the place of what is open. Else it waits, or is given up, which is told.
    pub(super) fn may_be_replaced(&mut self, wanted: Wanted) -> bool {
        match self.loss() {
            Leave::Free => true,
            Leave::Waits => false,
            Leave::Loses(reason) => {
                let may = self.may_lose(&reason, Departure::Open(Box::new(wanted)));
                if !may {
                    self.cancel_opening();
                }
                may
            }
        }
    }

    /// Goes on with what has waited for being saved.
    pub(super) fn poll_leaving(&mut self) {
        let is_failed = |painting: &Painting| matches!(painting.save, SaveState::Failed(_));
        let is_lost = self.painting.as_ref().is_some_and(is_failed) || self.changed_look().is_some();
        if !is_lost
            && self.unwritten().is_none()
            && let Some(warned) = self.warned.take()
        {
            self.notices.take_back(&warned.text);
        }
        match self.departure.take() {
            None => {}
            Some(Departure::Quit) => self.ask_quit(),
            Some(Departure::Close) => self.ask_close(),
            Some(Departure::Open(wanted)) => self.begin(*wanted),
        }
    }

    /// What is open stays.
    pub(super) fn cancel_leaving(&mut self) {
        self.departure = None;
        if let Some(painting) = &mut self.painting {
            painting.stay();
        }
    }

    fn loss(&mut self) -> Leave {
        match self.painting.as_mut().map(Painting::leave) {
            None | Some(Leave::Free) => self.changed_look().map_or(Leave::Free, Leave::Loses),
            Some(leave) => leave,
        }
    }

    /// What ends with the program before it is written.
    fn unwritten(&self) -> Option<String> {
        let picture = self.named_pictures.first().map(PathBuf::as_path);
        let path = self.exporting.as_ref().and_then(Exporting::written_to).or(picture)?;
        Some(format!("{} is still being written.", path.display()))
    }

    /// What of a look is not in its file.
    fn changed_look(&self) -> Option<String> {
        let live = self.live.as_ref().filter(|live| live.is_changed())?;
        let name = live.path().file_name().unwrap_or_default().to_string_lossy();
        Some(format!("What was changed of {name} is not saved."))
    }

    /// Writes what was changed of a look into its file.
    pub fn save_look(&mut self) {
        let Some(live) = &mut self.live else { return };
        let path = live.path().display().to_string();
        if !live.is_changed() {
            return self.notices.info(format!("{path} has all that is shown."));
        }
        match live.save() {
            Ok(()) => self.notices.info(format!("Saved {path}.")),
            Err(error) => self.notices.error(error.to_string()),
        }
    }

    /// Tells what a departure loses; true where that was told before.
    fn may_lose(&mut self, reason: &str, departure: Departure) -> bool {
        let now = self.now();
        let is_told = |warned: &Warned| warned.departure == departure && now - warned.at < WARNED_SECONDS;
        if self.warned.as_ref().is_some_and(is_told) {
            return true;
        }
        let (reason, again) = (reason.trim_end_matches('.'), departure.again());
        let text = format!("{reason}. {again} to lose what is not saved.");
        if let Some(before) = &self.warned {
            self.notices.take_back(&before.text);
        }
        self.notices.error(text.clone());
        self.warned = Some(Warned { departure, at: now, text });
        false
    }
}
