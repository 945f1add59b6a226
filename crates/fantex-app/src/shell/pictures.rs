//! Pictures on their way into files.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};

use eframe::egui::{ColorImage, Context, ScreenshotCallback, ViewportCommand};
use fantex_texture::{ColorSpace, Image, Samples};

use crate::job::{Job, JobState};
use crate::scene_view::CaptureError;
use crate::viewer::Wake;

/// What became of writing a picture.
type Written = Result<(), CaptureError>;

/// Writes pictures in the background.
pub(super) struct PictureFiles {
    jobs: Vec<(PathBuf, Job<Written>)>,
    windows: Receiver<(PathBuf, Image)>,
    window_sender: Sender<(PathBuf, Image)>,
    windows_due: usize,
    done: Vec<(PathBuf, Written)>,
    wake: Wake,
}

impl PictureFiles {
    pub(super) fn new(wake: Wake) -> Self {
        let (window_sender, windows) = channel();
        Self { jobs: Vec::new(), windows, window_sender, windows_due: 0, done: Vec::new(), wake }
    }

    /// Takes a picture of the whole window with the next frame.
    pub(super) fn take_window(&mut self, ctx: &Context, path: PathBuf) {
        let (sender, wake) = (self.window_sender.clone(), self.wake.clone());
        self.windows_due += 1;
        let callback = ScreenshotCallback::new(move |picture| {
            // The window may be closing: then nobody waits for it.
            sender.send((path, image_of(&picture))).ok();
            wake();
        });
        ctx.send_viewport_cmd(ViewportCommand::Screenshot(callback));
    }

    /// The window is gone: nobody will take pictures of it that are not taken yet.
    pub(super) fn forget_windows(&mut self) {
        (self.window_sender, self.windows) = channel();
        self.windows_due = 0;
    }

    /// Writes a picture.
    pub(super) fn save(&mut self, path: PathBuf, image: Result<Image, CaptureError>) {
        let (to, wake) = (path.clone(), self.wake.clone());
        let work = move || {
            if let Some(folder) = to.parent().filter(|folder| !folder.as_os_str().is_empty()) {
                // Where this fails the picture's own error says more.
                std::fs::create_dir_all(folder).ok();
            }
            Ok(image?.save(&to)?)
        };
        match Job::spawn("picture", move || wake(), work) {
            Ok(job) => self.jobs.push((path, job)),
            Err(_) => self.done.push((path.clone(), Err(CaptureError::Lost { path }))),
        }
    }

    /// What has been written since the last call, or why not.
    pub(super) fn poll(&mut self) -> Vec<(PathBuf, Written)> {
        let arrived: Vec<_> = self.windows.try_iter().collect();
        for (path, image) in arrived {
            self.windows_due -= 1;
            self.save(path, Ok(image));
        }
        let done = &mut self.done;
        self.jobs.retain(|(path, job)| {
            let written = match job.poll() {
                JobState::Running => return true,
                JobState::Done(written) => written,
                JobState::Lost => Err(CaptureError::Lost { path: path.clone() }),
            };
            done.push((path.clone(), written));
            false
        });
        std::mem::take(done)
    }

    /// Pictures that are not in their files yet.
    pub(super) fn due(&self) -> usize {
        self.jobs.len() + self.windows_due + self.done.len()
    }
}

/// The window's picture, without alpha.
fn image_of(picture: &ColorImage) -> Image {
    let [width, height] = picture.size.map(|n| n as u32);
    let samples = Samples::U8(picture.pixels.iter().flat_map(|c| [c.r(), c.g(), c.b()]).collect());
    Image { width, height, channels: 3, space: ColorSpace::Srgb, samples }
}
