//! Photographs as a source.

use std::path::PathBuf;

use fantex_bake::{BakeOptions, Progress};
use fantex_base::files::folder_of;
use fantex_base::{Error, ErrorKind, Result, counted};
use fantex_photos::{CameraFrame, PhotoOptions, PhotoSource, read_cameras};
use glam::Vec3;

use super::materials::of_photographs;
use super::own_materials::OwnDensity;
use super::{Baked, Baker, Budget, Goal};

/// Photographs of a model, with their cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotoSet {
    /// A sparse model of COLMAP, a folder with one, or a `transforms.json`.
    pub path: PathBuf,
    /// Where the photographs are, if not beside it.
    pub images: Option<PathBuf>,
    /// In which coordinates the cameras are taken.
    pub frame: CameraFrame,
    /// Keep the exposure of every photograph instead of bringing them to a common one.
    pub keep_exposure: bool,
    /// Linear colour of what no photograph sees; its surroundings' colours where it is not given.
    pub unseen: Option<Vec3>,
}

/// Ends a bake when photographs cannot be read back from their scratch file.
struct UntilFailure<'a> {
    progress: &'a dyn Progress,
    source: &'a PhotoSource<'a>,
}

impl Progress for UntilFailure<'_> {
    fn report(&self, done: u64, total: u64) {
        self.progress.report(done, total);
    }

    fn prepare(&self, word: &'static str, share: f32) {
        self.progress.prepare(word, share);
    }

    fn note(&self, sentence: &str) {
        self.progress.note(sentence);
    }

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled() || self.source.failure().is_some()
    }
}

impl Baker<'_> {
    /// Bakes photographs, and says what they do not show.
    pub(super) fn photographs(
        &self,
        mut mesh: fantex_mesh::Mesh,
        photos: &PhotoSet,
        goal: &Goal<'_>,
    ) -> Result<Baked> {
        of_photographs(&mut mesh);
        let mesh = &mesh;

        let photographs = read_cameras(&photos.path, photos.images.as_deref(), photos.frame)?;
        let texel_size = match self.budget {
            Budget::Matching => None,
            Budget::Density(density) => Some((1.0 / (density * mesh.world_from_mesh.scale)) as f32),
            Budget::Texels(texels) => Some((mesh.area() / texels.max(1) as f64).sqrt() as f32),
            Budget::Default => Some((mesh.area() / self.default_texels.max(1) as f64).sqrt() as f32),
        };
        let options = PhotoOptions {
            memory_bytes: self.options.memory_bytes,
            scratch: folder_of(goal.path()).to_owned(),
            exposure: !photos.keep_exposure,
            unseen: photos.unseen,
            texel_size,
        };
        let source = PhotoSource::new(mesh, &photographs, &options, self.progress.progress)?;
        let report = source.report();
        let mut notes = Vec::new();
        if report.used < report.photographs {
            let unused = report.photographs - report.used;
            let photographs = counted(report.photographs as u64, "photograph");
            notes.push(format!("of {photographs}, {unused} without the model"));
        }
        if report.unseen_share >= 0.0005 {
            let share = 100.0 * report.unseen_share;
            notes.push(format!("no photograph sees {share:.1} % of the surface"));
        }
        let density = || OwnDensity { of_triangles: source.density(), most: None };
        let density = (self.budget == Budget::Matching).then(density);
        let progress = UntilFailure { progress: self.progress.progress, source: &source };
        // The other half holds photographs.
        let options = BakeOptions { memory_bytes: self.options.memory_bytes / 2, ..self.options.clone() };
        let baker = Baker {
            source: None,
            channels: self.channels.clone(),
            options,
            progress: self.progress.followed_by(&progress),
            ..*self
        };
        let baked = baker.bake(mesh, &source, density, goal);
        if let Some(error) = source.failure() {
            let folder = folder_of(goal.path()).display();
            return Err(Error::new(ErrorKind::Io, format!("cannot keep photographs in {folder}: {error}")));
        }
        Ok(Baked { notes, photos: Some(report.clone()), ..baked? })
    }
}
