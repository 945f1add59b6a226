//! Files and addresses on their way to the screen.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex::FileKind;
use fantex::base::{Error, Result, counted};

use crate::camera::{CameraMode, ViewPreset, Walker};
use crate::document::{ChannelChange, Document, ForPainting, OpenProgress, PAINTER_SHARE, Place, Stage};
use crate::job::{Job, JobState};
use crate::live::LiveLook;
use crate::paint::{Answer, NewAsset, Painting, Question};
use crate::scene_view::{PrepareScene, SceneModel};
use crate::viewer::Viewer;
use crate::viewer::leaving::Departure;

/// What is to be opened, and how.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Wanted {
    place: Place,
    /// Whether it is to be painted on.
    paints: bool,
    answer: Option<Answer>,
    /// What becomes of its channels.
    change: Option<ChannelChange>,
    /// Whether the camera stays where it is.
    keeps_camera: bool,
    /// Whether there is nothing else to show: where it fails, the program does.
    is_all: bool,
}

#[derive(Debug)]
pub struct Opening {
    wanted: Wanted,
    progress: Arc<OpenProgress>,
    job: Job<Result<Loaded>>,
    /// The job's result, until it may take the place of what is open.
    loaded: Option<Result<Loaded>>,
}

impl Opening {
    pub fn place(&self) -> &Place {
        &self.wanted.place
    }

    pub fn stage(&self) -> Stage {
        self.progress.stage()
    }

    /// How much of the stage is done, 0..1, where that is known.
    pub fn share(&self) -> Option<f32> {
        self.progress.share()
    }

    pub fn seconds(&self) -> f64 {
        self.job.seconds()
    }
}

#[derive(Debug)]
enum Loaded {
    Document(Box<Document>, Option<SceneModel>, Option<Box<Painting>>),
    Question(Question),
}

/// Something that is asked before a model is painted on.
#[derive(Clone, Debug)]
pub struct Asked {
    pub place: Place,
    pub question: Question,
    /// What is chosen so far.
    pub new: NewAsset,
    wanted: Wanted,
}

impl Viewer {
    /// Draws with another GPU from now on. What was brought to the one before is gone, so the document is brought anew, in
    /// the background; everything else goes on as it is.
    pub fn draw_with(&mut self, prepare: PrepareScene) {
        self.prepare = Some(prepare.clone());
        self.new_model = None;
        self.pacing.lost();
        if let Some(opening) = &self.opening {
            let wanted = opening.wanted.clone();
            self.begin_at_once(wanted);
        }
        let Some(document) = self.document.clone() else { return };
        let streaming = self.settings.streaming;
        match Job::spawn("move", self.waker(), move || prepare(&document, streaming, &|_| {})) {
            Ok(job) => self.moving = Some(job),
            Err(error) => self.notices.error(format!("cannot start a thread to draw again: {error}")),
        }
    }

    /// Whether something is on its way to the screen.
    pub fn is_opening(&self) -> bool {
        self.opening.is_some() || self.departure.is_some() || self.moving.is_some()
    }

    /// Begins to open a file or address. What is being opened is given up.
    pub fn open(&mut self, text: &str) {
        self.begin_opening(Place::parse(text), false);
    }

    /// The same for a file that was chosen.
    pub fn open_file(&mut self, path: PathBuf) {
        self.begin_opening(Place::File(path), false);
    }

    /// Takes the first of the files that were dropped onto the window at once, as [`take_dropped`](Self::take_dropped), and says so of the others.
    pub fn take_first_dropped(&mut self, files: Vec<PathBuf>) {
        let count = files.len();
        let Some(first) = files.into_iter().next() else { return };
        if count > 1 {
            let (files, name) = (counted(count, "file"), first.display());
            self.notices.info(format!("Of {files} that were dropped, {name} is taken: a window shows one."));
        }
        self.take_dropped(first);
    }

    /// As [`open_file`](Self::open_file), for what the program was started with: where it cannot be opened there is a [`failure`](Self::failure).
    pub fn open_or_fail(&mut self, place: Place) {
        let wanted = self.wanted(place, false);
        self.begin(Wanted { is_all: true, ..wanted });
    }

    pub(super) fn begin_opening(&mut self, place: Place, keeps_camera: bool) {
        let wanted = self.wanted(place, keeps_camera);
        self.begin(wanted);
    }

    /// Opens what is painted on once more, with other channels.
    pub(super) fn begin_change(&mut self, place: Place, change: ChannelChange) {
        let wanted = self.wanted(place, true);
        self.begin(Wanted { change: Some(change), ..wanted });
    }

    fn wanted(&self, place: Place, keeps_camera: bool) -> Wanted {
        let answer = (!self.asks).then(|| Answer::New(NewAsset::default()));
        Wanted { place, paints: self.paints, answer, change: None, keeps_camera, is_all: false }
    }

    /// Goes on with what was asked; without an answer nothing is opened.
    pub fn answer(&mut self, answer: Option<Answer>) {
        match (&self.asked, answer) {
            (Some(asked), Some(answer)) => {
                let wanted = Wanted { answer: Some(answer), ..asked.wanted.clone() };
                self.begin(wanted);
            }
            (Some(_), None) => {
                self.asked = None;
                self.stay();
            }
            (None, _) => {}
        }
    }

    /// Shows a look, and follows its file.
    fn open_look(&mut self, path: &Path, is_all: bool) {
        self.cancel_opening();
        match LiveLook::open(path, self.look_model.clone(), self.waker()) {
            Ok(live) => {
                self.close();
                self.settings.camera.mode = CameraMode::Orbit;
                self.remember(&Place::File(path.to_owned()));
                self.live = Some(live);
            }
            Err(error) => {
                self.fail_opening(error.to_string(), is_all);
                self.stay();
            }
        }
    }

    /// Begins to open something, once that loses nothing.
    pub(super) fn begin(&mut self, wanted: Wanted) {
        if self.may_leave(Departure::Open(Box::new(wanted.clone()))) {
            self.begin_at_once(wanted);
        }
    }

    fn begin_at_once(&mut self, wanted: Wanted) {
        self.asked = None;
        self.removal = None;
        self.departure = None;
        self.paints = wanted.paints;
        if let Some(painting) = &mut self.painting {
            painting.stay();
        }
        let place = wanted.place.clone();
        if let Place::File(path) = &place
            && !wanted.paints
            && matches!(FileKind::of(path), Ok(FileKind::Look))
        {
            return self.open_look(path, wanted.is_all);
        }
        // Those that are given up may still keep the file for themselves, and nobody waits for others.
        let (before, others): (Vec<_>, Vec<_>) =
            self.given_up.drain(..).chain(self.opening.take()).partition(|opening| {
                opening.progress.cancel();
                wanted.paints && opening.wanted.paints && opening.place().painted().is_same(&place.painted())
            });
        self.given_up = others;
        let progress = Arc::new(OpenProgress::default());
        let (for_thread, from, prepare) = (progress.clone(), place.clone(), self.prepare.clone());
        let streaming = self.settings.streaming;
        // Only one writer can have an asset open; it ends with its last commit.
        let is_same = self.document.as_ref().is_some_and(|document| document.place.is_same(&place.painted()));
        let leaving = if is_same || !wanted.paints { self.painting.take() } else { None };
        let (brushes_file, wake) = (self.brushes_file.clone(), self.waker());
        let (memory, Wanted { paints, answer, change, .. }) = (self.paint_memory_bytes, wanted.clone());
        let work = move || {
            drop(leaving);
            before.into_iter().for_each(|opening| drop(opening.job.wait()));
            let (mut document, painting) = if paints {
                let (mut document, painter) = match Document::open_for_painting(
                    &from,
                    memory,
                    answer.as_ref(),
                    change.as_ref(),
                    &for_thread,
                )? {
                    ForPainting::Ready(ready) => *ready,
                    ForPainting::Question(question) => return Ok(Loaded::Question(question)),
                };
                let path = painter.editor().asset().path().to_owned();
                let painting = Painting::new(painter, brushes_file, Arc::new(wake)).map_err(|source| {
                    let path = path.display();
                    Error::unavailable(format!("cannot start a thread to paint on {path}: {source}"))
                })?;
                document.exchange = Some(painting.exchange().clone());
                (document, Some(Box::new(painting)))
            } else {
                (Document::open(&from, &for_thread)?, None)
            };
            for_thread.enter(Stage::Preparing)?;
            let progress = for_thread.part(if painting.is_some() { PAINTER_SHARE } else { 0.0 }, 1.0);
            let model = prepare.map(|prepare| prepare(&document, streaming, &progress)).transpose()?;
            document.notes.extend(model.iter().flat_map(SceneModel::notes));
            // Those who gave up meanwhile do not want it.
            for_thread.enter(Stage::Preparing)?;
            Ok(Loaded::Document(Box::new(document), model, painting))
        };
        match Job::spawn("open", self.waker(), work) {
            Ok(job) => self.opening = Some(Opening { wanted, progress, job, loaded: None }),
            Err(error) => {
                self.notices.error(format!("cannot start a thread to open {place}: {error}"));
                self.stay();
            }
        }
    }

    /// Gives up what is being opened.
    pub fn cancel_opening(&mut self) {
        if let Some(opening) = self.opening.take() {
            opening.progress.cancel();
            // Until it ends it may keep its file for itself.
            self.given_up.push(opening);
            self.stay();
        }
    }

    /// Nothing was opened: what is shown is painted on or not, as it was.
    fn stay(&mut self) {
        self.leave_lost_painting();
        if self.document.is_some() {
            self.paints = self.painting.is_some();
        }
    }

    pub(super) fn poll_moving(&mut self) {
        let result = match self.moving.as_ref().map(Job::poll) {
            None | Some(JobState::Running) => return,
            Some(JobState::Done(result)) => result,
            Some(JobState::Lost) => {
                Err(Error::unavailable("The model could not be drawn again: the program failed on it"))
            }
        };
        self.moving = None;
        match result {
            Ok(model) => self.new_model = Some(Some(model)),
            Err(error) => self.notices.error(format!("{error}.")),
        }
    }

    pub(super) fn poll_opening(&mut self) {
        self.given_up.retain(|opening| matches!(opening.job.poll(), JobState::Running));
        let Some(opening) = &mut self.opening else { return };
        if opening.loaded.is_none() {
            opening.loaded = match opening.job.poll() {
                JobState::Running => return,
                JobState::Done(result) => Some(result),
                JobState::Lost => Some(Err(Error::unavailable(format!(
                    "{} could not be opened: the program failed on it; please report the file",
                    opening.wanted.place
                )))),
            };
        }
        let (replaces, wanted) =
            (matches!(&opening.loaded, Some(Ok(Loaded::Document(..)))), opening.wanted.clone());
        if replaces && !self.may_be_replaced(wanted) {
            return;
        }
        let Some(Opening { wanted, loaded: Some(result), .. }) = self.opening.take() else { return };
        let (keeps_camera, is_all) = (wanted.keeps_camera, wanted.is_all);
        match result {
            Ok(Loaded::Question(question)) => {
                let (place, new) = (wanted.place.clone(), NewAsset::default());
                self.asked = Some(Asked { place, question, new, wanted });
                self.leave_lost_painting();
            }
            Ok(Loaded::Document(document, model, painting)) => {
                self.remember(&wanted.place);
                for note in document.notes.iter().filter(|_| painting.is_some()) {
                    self.notices.info(note.clone());
                }
                self.painting = painting.map(|painting| *painting);
                if let Some(painting) = &mut self.painting {
                    painting.load_presets(&mut self.notices);
                    self.settings.camera.mode = CameraMode::Orbit;
                }
                self.forget_scene();
                self.walker = Walker::new(
                    self.settings.camera.eye_height.unwrap_or_else(|| document.scale.eye_height()),
                );
                self.live = None;
                self.removal = None;
                self.document = Some(*document);
                self.new_model = Some(model);
                if !keeps_camera {
                    self.show(ViewPreset::ThreeQuarter);
                    self.is_unframed = true;
                }
                self.want_ground();
            }
            Err(error) => {
                if !error.is_cancelled() {
                    self.fail_opening(error.to_string(), is_all);
                }
                self.stay();
                if self.document.is_none() && matches!(wanted.answer, Some(Answer::Replay(_))) {
                    // What was to be repeated is there as it was.
                    self.begin(Wanted { answer: Some(Answer::Keep), ..wanted });
                }
            }
        }
    }

    /// Paints on what is open, or goes back to looking at it.
    pub(super) fn toggle_painting(&mut self) {
        let paints = !self.paints;
        match self.document.as_ref().map(|document| document.place.clone()) {
            Some(place) => {
                let wanted = self.wanted(place, true);
                self.begin(Wanted { paints, ..wanted });
            }
            None => self.paints = paints,
        }
    }

    /// Where another file could not be opened, what was painted on is not open any more either.
    pub(super) fn leave_lost_painting(&mut self) {
        if self.painting.is_none()
            && self.document.as_ref().is_some_and(|document| document.exchange.is_some())
        {
            self.document = None;
            self.new_model = Some(None);
            self.forget_scene();
        }
    }

    /// Puts a place at the top of the recent ones, which are text.
    fn remember(&mut self, place: &Place) {
        if let Some(text) = absolute(place) {
            self.settings.remember(&text);
        }
    }

    fn fail_opening(&mut self, reason: String, is_all: bool) {
        if is_all {
            self.failure = Some(reason);
        } else {
            self.notices.error(reason);
        }
    }
}

/// A place that means the same from every folder; none where that is no text.
fn absolute(place: &Place) -> Option<String> {
    match place {
        Place::Url(url) => Some(url.clone()),
        Place::File(path) => {
            let path = std::path::absolute(path).unwrap_or_else(|_| path.clone());
            path.into_os_string().into_string().ok()
        }
    }
}
