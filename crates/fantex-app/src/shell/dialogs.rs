//! File dialogs. They are shown by the system and waited for on threads of their own.

use std::path::PathBuf;

use rfd::AsyncFileDialog;

use crate::job::{Job, JobState};
use crate::viewer::{Request, Wake};

/// A dialog that is gone after so few seconds was never shown.
const SHOWN_SECONDS: f64 = 0.25;

/// What the user chose.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Answer {
    Open(PathBuf),
    Surroundings(PathBuf),
    Stamp(PathBuf),
    Sticker(PathBuf),
    Stencil(PathBuf),
    Look(PathBuf),
    LoadPath(PathBuf),
    SavePath(PathBuf),
    /// There are no dialogs.
    Unavailable,
}

/// Dialogs that are open.
pub(super) struct Dialogs {
    open: Vec<(Request, Job<Option<PathBuf>>)>,
    wake: Wake,
}

impl Dialogs {
    pub(super) fn new(wake: Wake) -> Self {
        Self { open: Vec::new(), wake }
    }

    /// Shows a dialog; one of a kind at a time. `stem` is the start of suggested names.
    pub(super) fn ask(&mut self, request: Request, stem: &str) {
        if self.open.iter().any(|(open, _)| *open == request) {
            return;
        }
        let dialog = AsyncFileDialog::new();
        let models: &[&str] = &["glb", "gltf", "obj", "ply", "stl", "fan"];
        let pictures: &[&str] = &["hdr", "exr", "png", "jpg", "jpeg", "tif", "tiff", "webp"];
        let path_name = format!("{stem}-path.json");
        let chosen: std::pin::Pin<Box<dyn Future<Output = Option<rfd::FileHandle>> + Send>> = match request {
            Request::OpenDialog => Box::pin(
                dialog
                    .set_title("Open a model or an asset")
                    .add_filter("Models and assets", models)
                    .pick_file(),
            ),
            Request::SurroundingsDialog => {
                Box::pin(dialog.set_title("Choose surroundings").add_filter("Pictures", pictures).pick_file())
            }
            Request::StickerDialog => {
                Box::pin(dialog.set_title("Choose a picture").add_filter("Pictures", pictures).pick_file())
            }
            Request::StencilDialog => Box::pin(
                dialog
                    .set_title("Choose a picture over the view")
                    .add_filter("Pictures", pictures)
                    .pick_file(),
            ),
            Request::LookDialog => {
                Box::pin(dialog.set_title("Choose a look").add_filter("Looks", &["toml"]).pick_file())
            }
            Request::StampDialog => {
                Box::pin(dialog.set_title("Choose a stamp").add_filter("Pictures", pictures).pick_file())
            }
            Request::LoadPathDialog => Box::pin(
                dialog.set_title("Load a camera path").add_filter("Camera paths", &["json"]).pick_file(),
            ),
            Request::SavePathDialog => {
                Box::pin(dialog.set_title("Save the camera path").set_file_name(path_name).save_file())
            }
            _ => return,
        };
        let wake = self.wake.clone();
        let work = move || pollster::block_on(chosen).map(|handle| handle.path().to_owned());
        if let Ok(job) = Job::spawn("dialog", move || wake(), work) {
            self.open.push((request, job));
        }
    }

    /// What was chosen since the last call.
    pub(super) fn poll(&mut self) -> Vec<Answer> {
        let mut answers = Vec::new();
        self.open.retain(|(request, job)| {
            let chosen = match job.poll() {
                JobState::Running => return true,
                JobState::Done(chosen) => chosen,
                JobState::Lost => None,
            };
            match chosen {
                Some(path) => answers.push(answer(request, path)),
                None if job.seconds() < SHOWN_SECONDS => answers.push(Answer::Unavailable),
                None => {}
            }
            false
        });
        answers
    }
}

fn answer(request: &Request, path: PathBuf) -> Answer {
    match request {
        Request::SurroundingsDialog => Answer::Surroundings(path),
        Request::StampDialog => Answer::Stamp(path),
        Request::StickerDialog => Answer::Sticker(path),
        Request::StencilDialog => Answer::Stencil(path),
        Request::LookDialog => Answer::Look(path),
        Request::LoadPathDialog => Answer::LoadPath(path),
        Request::SavePathDialog => Answer::SavePath(path),
        _ => Answer::Open(path),
    }
}
