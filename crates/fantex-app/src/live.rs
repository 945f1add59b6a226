//! A look that is being worked on: its picture follows the file, and numbers that are changed in the window.
//!
//! ```text
//!  file, sliders --> text --Wanted--> thread: LookFile, LookScene --Report--> picture (coarse, then sharp), or what is wrong
//! ```
//!
//! The renderer is that of the processor, which has all that looks can say.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

use fantex::base::random::{DEFAULT_SEED, folded_seed};
use fantex::base::{Error, Result, input};
use fantex::look::{LookFile, LookImages, LookNumber, ResolveOptions};
use fantex::look_scene::{GivenModel, LookScene, MaterialResolver, PictureChanges};
use fantex::mesh::{CleanOptions, LoadOptions, clean, load};
use fantex::render::StopSignal;
use fantex::scene::Camera;
use fantex::texture::{Image, Samples};

use crate::camera::SceneScale;
use crate::settings::write_whole;

/// Seconds between two looks at the file.
const CHECK_SECONDS: f64 = 0.25;

/// Coarse pictures come first: sides of their pixels, and samples.
const PASSES: [(u32, u32); 3] = [(6, 1), (2, 1), (1, 4)];

/// What is to be shown.
#[derive(Clone, Debug, PartialEq)]
struct Wanted {
    text: Arc<str>,
    /// Files that the look mentions are read anew where it is another one.
    reading: u64,
    /// That of the look until there is one.
    camera: Option<Camera>,
    size: [u32; 2],
}

#[derive(Default)]
struct Shared {
    wishes: Mutex<Wishes>,
    changed: Condvar,
}

#[derive(Default)]
struct Wishes {
    wanted: Option<Wanted>,
    is_over: bool,
    /// Stops what is drawn of what is wanted, once something else is.
    stop: StopSignal,
}

impl Wishes {
    fn change(&mut self, wanted: Option<Wanted>) {
        self.wanted = wanted;
        std::mem::take(&mut self.stop).give();
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Wishes> {
        self.wishes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until something else is wanted than `shown`; none at the end.
    fn next(&self, shown: Option<&Wanted>) -> Option<Wanted> {
        let is_shown = |wishes: &mut Wishes| !wishes.is_over && wishes.wanted.as_ref() == shown;
        let wishes = self.changed.wait_while(self.lock(), is_shown).unwrap_or_else(PoisonError::into_inner);
        wishes.wanted.clone().filter(|_| !wishes.is_over)
    }

    /// What stops drawing this; none where it is not wanted.
    fn stop(&self, wanted: &Wanted) -> Option<StopSignal> {
        let wishes = self.lock();
        (!wishes.is_over && wishes.wanted.as_ref() == Some(wanted)).then(|| wishes.stop.clone())
    }
}

enum Report {
    /// The look is sound: its camera, what it shows, and what is to be known of that.
    Opened(Arc<str>, Camera, SceneScale, Vec<String>),
    Failed(Arc<str>, String),
    /// sRGB, opaque or not; and whether it is the last one.
    Picture(Wanted, Image, bool),
}

/// A look in the window.
pub struct LiveLook {
    path: PathBuf,
    /// As it is shown.
    text: Arc<str>,
    /// As it is in the file.
    saved: Arc<str>,
    stamp: Option<(SystemTime, u64)>,
    checked: f64,
    reading: u64,
    /// Of the text that was sound last.
    pub numbers: Vec<LookNumber>,
    /// Values in the file, by place: what the sliders' ranges go by.
    pub originals: Vec<f64>,
    /// What is wrong with the text, with its line and key.
    pub error: Option<String>,
    /// What is to be known of the text that was sound last, a sentence each.
    pub notes: Vec<String>,
    /// The file has become another one while something was changed here, which is still to be told.
    pub is_overtaken: bool,
    /// The look's own camera.
    pub camera: Option<Camera>,
    pub scale: SceneScale,
    pub picture: Option<Arc<Image>>,
    shown: Option<(Wanted, bool)>,
    shared: Arc<Shared>,
    reports: Receiver<Report>,
}

impl std::fmt::Debug for LiveLook {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LiveLook").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Drop for LiveLook {
    fn drop(&mut self) {
        let mut wishes = self.shared.lock();
        wishes.is_over = true;
        wishes.change(None);
        drop(wishes);
        self.shared.changed.notify_all();
    }
}

impl LiveLook {
    /// Shows a look, on a model where one is given. `wake` is called when there is something to poll.
    ///
    /// # Errors
    /// The file cannot be read, or there can be no further thread.
    pub fn open(path: &Path, model: Option<PathBuf>, wake: impl Fn() + Send + 'static) -> Result<Self> {
        let text: Arc<str> = input::read_text(path)?.into();
        let shared = Arc::new(Shared::default());
        let (sender, reports) = channel();
        let thread = Painter { path: path.to_owned(), model, shared: shared.clone(), sender };
        let work = move || thread.run(&wake);
        std::thread::Builder::new().name("fantex-look".into()).spawn(work).map_err(|source| {
            Error::unavailable(format!("cannot start a thread to show {}: {source}", path.display()))
        })?;
        let mut live = Self {
            path: path.to_owned(),
            text: text.clone(),
            saved: text,
            stamp: stamp(path),
            checked: 0.0,
            reading: 0,
            numbers: Vec::new(),
            originals: Vec::new(),
            error: None,
            notes: Vec::new(),
            is_overtaken: false,
            camera: None,
            scale: SceneScale::default(),
            picture: None,
            shown: None,
            shared,
            reports,
        };
        live.take_text();
        Ok(live)
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether something was changed here that is not in the file.
    pub fn is_changed(&self) -> bool {
        self.text != self.saved
    }

    /// Whether the picture is the last one of what is wanted, or nothing can be shown.
    pub fn is_settled(&self) -> bool {
        let wanted = self.shared.lock().wanted.clone();
        self.error.is_some()
            || self.shown.as_ref().is_some_and(|(shown, is_last)| *is_last && Some(shown) == wanted.as_ref())
    }

    /// Takes what the thread has done, and looks at the file now and then. Returns the look's camera where it is to be taken.
    pub fn poll(&mut self, seconds: f64) -> Option<Camera> {
        if (seconds - self.checked).abs() >= CHECK_SECONDS {
            self.checked = seconds;
            self.check_file();
        }
        let mut first = None;
        for report in self.reports.try_iter().collect::<Vec<_>>() {
            match report {
                Report::Opened(text, camera, scale, notes) => {
                    if text == self.text {
                        self.error = None;
                    }
                    // The look's camera is taken where it is another one, and stays the user's else.
                    if self.camera != Some(camera) {
                        first = Some(camera);
                    }
                    (self.camera, self.scale, self.notes) = (Some(camera), scale, notes);
                }
                Report::Failed(text, reason) if text == self.text => self.error = Some(reason),
                Report::Failed(..) => {}
                Report::Picture(wanted, image, is_last) => {
                    self.picture = Some(Arc::new(image));
                    self.shown = Some((wanted, is_last));
                }
            }
        }
        first
    }

    /// Says from where it is seen.
    pub fn show(&self, camera: &Camera, size: [u32; 2]) {
        if size.contains(&0) {
            return;
        }
        let camera = self.camera.map(|_| *camera);
        let wanted = Wanted { text: self.text.clone(), reading: self.reading, camera, size };
        let mut wishes = self.shared.lock();
        if wishes.wanted.as_ref() != Some(&wanted) {
            wishes.change(Some(wanted));
            drop(wishes);
            self.shared.changed.notify_all();
        }
    }

    fn check_file(&mut self) {
        let now = stamp(&self.path);
        // While it is being replaced there may be none.
        if now.is_none() || now == self.stamp {
            return;
        }
        self.stamp = now;
        match input::read_text(&self.path) {
            Ok(text) => {
                self.reading += 1;
                let is_kept = self.is_changed();
                self.saved = text.into();
                if is_kept {
                    // What was changed here stays until it is saved or discarded.
                    self.is_overtaken = self.is_changed();
                } else {
                    self.text = self.saved.clone();
                    self.take_text();
                }
            }
            Err(error) => self.error = Some(error.to_string()),
        }
    }

    /// The file's text is another one.
    fn take_text(&mut self) {
        self.read_numbers();
        self.originals = self.numbers.iter().map(|number| number.value).collect();
    }

    fn read_numbers(&mut self) {
        match LookFile::parse(&self.text, &self.path) {
            Ok(file) => {
                self.error = None;
                self.numbers = file.numbers();
            }
            Err(error) => self.error = Some(error.to_string()),
        }
    }

    /// Writes another value in the place of a number; nothing where the text is not sound.
    pub fn set(&mut self, index: usize, value: f64) {
        let Some(number) =
            self.numbers.get(index).filter(|_| self.text.get(self.numbers[index].span.clone()).is_some())
        else {
            return;
        };
        let mut text = self.text.to_string();
        text.replace_range(number.span.clone(), &number_text(value, number.is_whole));
        self.text = text.into();
        self.read_numbers();
    }

    /// As it is in the file.
    pub fn discard(&mut self) {
        self.text = self.saved.clone();
        self.take_text();
    }

    /// Writes what was changed into the file.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn save(&mut self) -> Result<()> {
        write_whole(&self.path, self.text.as_bytes())?;
        self.saved = self.text.clone();
        self.stamp = stamp(&self.path);
        self.originals = self.numbers.iter().map(|number| number.value).collect();
        Ok(())
    }
}

fn stamp(path: &Path) -> Option<(SystemTime, u64)> {
    let data = std::fs::metadata(path).ok()?;
    Some((data.modified().ok()?, data.len()))
}

/// Four digits, as TOML writes a number.
fn number_text(value: f64, is_whole: bool) -> String {
    if is_whole {
        return format!("{}", value.round() as i64);
    }
    let digits = if value == 0.0 { 1 } else { (3 - value.abs().log10().floor() as i32).clamp(1, 30) };
    let text = format!("{value:.0$}", digits as usize);
    let short = text.trim_end_matches('0');
    if short.ends_with('.') { format!("{short}0") } else { short.to_owned() }
}

/// The thread that draws.
struct Painter {
    path: PathBuf,
    model: Option<PathBuf>,
    shared: Arc<Shared>,
    sender: Sender<Report>,
}

impl Painter {
    fn run(&self, wake: &dyn Fn()) {
        let report = |report| {
            // Where nobody listens the window is gone.
            self.sender.send(report).ok();
            wake();
        };
        let (mut images, mut reading, mut given) = (LookImages::default(), 0, None);
        let mut shown: Option<Wanted> = None;
        while let Some(wanted) = self.shared.next(shown.as_ref()) {
            if wanted.reading != reading {
                (images, reading) = (LookImages::default(), wanted.reading);
            }
            if let Err(error) = self.show_text(&wanted, &mut given, &images, &mut shown, &report) {
                report(Report::Failed(wanted.text.clone(), error.to_string()));
                shown = Some(wanted);
            }
        }
    }

    /// Draws a text from everywhere that is wanted, until another one is.
    fn show_text(
        &self,
        first: &Wanted,
        given: &mut Option<GivenModel>,
        images: &LookImages,
        shown: &mut Option<Wanted>,
        report: &dyn Fn(Report),
    ) -> Result<()> {
        let file = LookFile::parse(&first.text, &self.path)?;
        if let (None, Some(path)) = (&given, &self.model) {
            let (mesh, _) = clean(load(path, &LoadOptions::default())?, &CleanOptions::default())?;
            *given = Some(GivenModel { path: path.clone(), mesh });
        }
        // As the command line draws it.
        let options = ResolveOptions { seed: folded_seed(DEFAULT_SEED), ..ResolveOptions::default() };
        let resolver = MaterialResolver { file: &file, images, options };
        let scene = LookScene::new(resolver, given.as_ref(), PictureChanges::default())?;
        let time = scene.times()[0];
        let (camera, bounds) = scene.view(first.size)?;
        report(Report::Opened(first.text.clone(), camera, SceneScale::of(&bounds), scene.notes()));
        let mut wanted = first.clone();
        loop {
            let mut is_whole = false;
            for (k, (side, samples)) in PASSES.into_iter().enumerate() {
                let Some(stop) = self.shared.stop(&wanted) else { break };
                // Who looks around all the time sees the first pictures at least.
                let stop = (k > 0).then_some(stop);
                let size = wanted.size.map(|n| n.div_ceil(side));
                let seen = wanted.camera.unwrap_or(camera);
                let picture = match scene.render_sized(&seen, time, size, samples, stop) {
                    Err(error) if error.is_cancelled() => break,
                    drawn => drawn?.picture,
                };
                is_whole = k + 1 == PASSES.len();
                report(Report::Picture(wanted.clone(), picture.to_srgb_image(), is_whole));
            }
            *shown = is_whole.then(|| wanted.clone());
            match self.shared.next(shown.as_ref()) {
                Some(next) if next.text == wanted.text && next.reading == wanted.reading => wanted = next,
                _ => return Ok(()),
            }
        }
    }
}

/// The pixels of a picture for the screen: RGBA, row-major.
pub fn pixels(image: &Image) -> Vec<[u8; 4]> {
    let Samples::U8(samples) = &image.samples else { return Vec::new() };
    let channels = image.channels as usize;
    // Pictures have three channels, or four.
    samples.chunks_exact(channels.max(3)).map(|p| [p[0], p[1], p[2], 255]).collect()
}
