//! The gallery: one picture, or a few side by side, for every technique, and a page that shows them.
//!
//! ```text
//! gallery/gallery.toml --entries--> looks, each with some keys changed --render--> DIR/NAME-1.png ..
//!                      '----------> drawings of the program -----------/           DIR/index.html
//! ```

mod catalogue;
mod drawings;
mod page;

use std::path::{Path, PathBuf};

use fantex::look::LookFile;
use fantex::look_scene::{LookScene, PictureChanges, Wardrobe};
use fantex::render::Picture;
use fantex::texture::Image;
use fantex::texture::look::{LookImages, ResolveOptions};

use crate::animation::Animation;
use crate::context::Context;
use crate::error::CliError;
use catalogue::{Catalogue, Entry, Variant};
use page::{Exhibit, Exposed};

pub(crate) use catalogue::CatalogueError;

/// The folder with the catalogue and the looks, in this folder or beside the program.
const FOLDER: &str = "gallery";

/// How pictures are made.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct GalleryOptions {
    /// Width of all pictures in pixels; as their looks say where it is left out.
    pub(crate) width: Option<u32>,
}

/// Makes the pictures of some entries (all, where no name is given) and the page. Returns the paths of the pictures.
pub(crate) fn make(
    output: &Path,
    names: &[String],
    options: GalleryOptions,
    context: &Context,
) -> Result<Vec<PathBuf>, CliError> {
    let folder = folder()?;
    let catalogue = Catalogue::read(&folder)?;
    let entries = catalogue.select(names)?;
    context.make_folder(output)?;
    let artist = Artist { folder: &folder, output, options, context };
    let mut exhibits = Vec::with_capacity(entries.len());
    for (number, entry) in entries.iter().enumerate() {
        context.check_interrupt()?;
        context.note(format!("{} of {}: {}", number + 1, entries.len(), entry.name));
        exhibits.push(artist.exhibit(entry)?);
    }
    let page = output.join("index.html");
    std::fs::write(&page, page::page(&exhibits))
        .map_err(|source| CliError::Write { path: page.clone(), source })?;
    Ok(exhibits.iter().flat_map(|e| &e.pictures).map(|p| output.join(&p.file)).collect())
}

fn folder() -> Result<PathBuf, CatalogueError> {
    let built = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(FOLDER);
    let found = [PathBuf::from(FOLDER), built].into_iter().find(|f| f.join("gallery.toml").is_file());
    found.ok_or(CatalogueError::Missing { path: Path::new(FOLDER).join("gallery.toml") })
}

/// Makes the pictures of entries.
struct Artist<'a> {
    folder: &'a Path,
    output: &'a Path,
    options: GalleryOptions,
    context: &'a Context,
}

impl Artist<'_> {
    fn exhibit<'e>(&self, entry: &'e Entry) -> Result<Exhibit<'e>, CliError> {
        match (&entry.look, &entry.drawn_by) {
            (Some(look), _) => self.by_look(entry, look),
            (None, Some(drawing)) => self.by_program(entry, drawing),
            (None, None) => Err(CatalogueError::NothingToDraw { entry: entry.name.clone() }.into()),
        }
    }

    fn by_look<'e>(&self, entry: &'e Entry, look: &str) -> Result<Exhibit<'e>, CliError> {
        let path = self.folder.join(look);
        let text = catalogue::read(&path)?;
        let original: toml::Table =
            toml::from_str(&text).map_err(|source| CatalogueError::Parse { path: path.clone(), source })?;
        let mut pictures = Vec::new();
        for (index, variant) in entry.variants().iter().enumerate() {
            let file = self.file_name(entry, index);
            let changed = variant.apply(&entry.name, original.clone())?;
            let text = if variant.set.is_empty() { text.clone() } else { changed.to_string() };
            self.render(&LookFile::parse(&text, &path)?, &self.output.join(&file))?;
            pictures.push(exposed(file, variant));
        }
        Ok(Exhibit { entry, pictures, look: Some(text) })
    }

    /// One picture, or an animated one.
    fn render(&self, file: &LookFile, target: &Path) -> Result<(), CliError> {
        let size = self.options.width.map(|width| {
            let [w, h] = file.look().picture.size.map(|side| side.0);
            [width, (u64::from(width) * u64::from(h)).div_ceil(u64::from(w)) as u32]
        });
        let images = LookImages::default();
        let options = ResolveOptions { memory_bytes: self.context.memory_bytes, ..ResolveOptions::default() };
        let wardrobe = Wardrobe { file, images: &images, options };
        let scene = LookScene::new(wardrobe, None, PictureChanges { size, ..PictureChanges::default() })?;
        let times = scene.times();
        let mut frames = Vec::with_capacity(times.len());
        for &time in &times {
            self.context.check_interrupt()?;
            frames.push(scene.render(time)?.picture.to_srgb_image());
        }
        let frames_per_second = file
            .look()
            .picture
            .frames
            .as_ref()
            .map_or(1.0, |f| f64::from(f.count) / (f.to - f.from).max(1e-3));
        self.save(&frames, frames_per_second, target)
    }

    fn by_program<'e>(&self, entry: &'e Entry, drawing: &str) -> Result<Exhibit<'e>, CliError> {
        let unknown = || CatalogueError::NothingToDraw { entry: entry.name.clone() };
        let draw = drawings::by_name(drawing).ok_or_else(unknown)?;
        let drawn = draw(&drawings::Studio { width: self.options.width, context: self.context })?;
        let mut pictures = Vec::new();
        for (index, (caption, image)) in drawn.into_iter().enumerate() {
            let file = self.file_name(entry, index);
            self.save(&[image], 1.0, &self.output.join(&file))?;
            pictures.push(exposed(file, &Variant { caption, ..Variant::default() }));
        }
        Ok(Exhibit { entry, pictures, look: None })
    }

    fn file_name(&self, entry: &Entry, index: usize) -> String {
        format!("{}-{}.png", entry.name, index + 1)
    }

    fn save(&self, frames: &[Image], frames_per_second: f64, target: &Path) -> Result<(), CliError> {
        self.context.check_output(target)?;
        let _deferral = self.context.defer_interrupt();
        match frames {
            [image] => Ok(image.save(target)?),
            _ => {
                let mut animation =
                    Animation::new(target, &frames[0], frames.len() as u32, frames_per_second)?;
                frames.iter().try_for_each(|frame| animation.add(frame))?;
                animation.finish()
            }
        }
    }
}

fn exposed(file: String, variant: &Variant) -> Exposed {
    let changes = variant.set.iter().map(|(key, value)| format!("{key} = {value}\n")).collect();
    Exposed { file, caption: variant.caption.clone(), changes }
}

/// A picture as an image of bytes in sRGB.
fn image_of(picture: &Picture) -> Image {
    picture.to_srgb_image()
}
