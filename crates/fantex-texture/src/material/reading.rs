//! Reading the images of models, and what becomes of those that cannot be read.

use std::collections::BTreeMap;
use std::error::Error as _;
use std::io;

use fantex_base::{Error, ErrorKind, ReadLimits, Result, counted, were};
use fantex_mesh::{ImageSource, Material, Mesh, TextureRef};
use rayon::prelude::*;

use super::{ImageUse, channels};
use crate::{AlphaUse, ColorSpace};

/// Images of a model that are missing or broken, so that its materials are shown without them: the errors that tell of each.
#[derive(Clone, Debug, Default)]
pub struct LeftOut(Vec<Error>);

impl LeftOut {
    /// Of a model without all its images, most sentences.
    const MAX_NOTES: usize = 8;

    /// What was left out and why, a sentence each; of many the first, and a sentence on the others.
    pub fn notes(&self) -> Vec<String> {
        let (told, others) = self.0.split_at(self.0.len().min(Self::MAX_NOTES));
        let others = (!others.is_empty()).then(|| {
            let (more, were) = (counted(others.len(), "more texture"), were(others.len()));
            format!("{more} {were} left out, for such reasons")
        });
        told.iter().map(|error| format!("a texture was left out: {error}")).chain(others).collect()
    }

    /// Refuses a model that is not whole.
    ///
    /// # Errors
    /// The first of its images that cannot be read, and why.
    pub fn check(&self) -> Result<()> {
        self.0.first().map_or(Ok(()), |error| Err(error.clone()))
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// Adds what others lack.
    pub fn extend(&mut self, others: Self) {
        self.0.extend(others.0);
    }
}

/// A material in messages: its name and the place in the model file where it names the image, or else its own, as far as there are any.
fn label(mesh: &Mesh, index: usize, image: usize) -> String {
    let Material { name, place, .. } = &mesh.materials[index];
    match (name.as_str(), mesh.image_places.get(image).unwrap_or(place).as_str()) {
        ("", "") => format!("material {index}"),
        ("", place) => place.to_owned(),
        (name, "") => format!("material {name:?}"),
        (name, place) => format!("material {name:?} ({place})"),
    }
}

/// What kept an image from being read, with the channel and the material that want it, and what to do where its file is missing.
fn unreadable(channel: &str, label: &str, cause: Error) -> Error {
    let advice = match cause.kind() {
        ErrorKind::NotFound => "; put the file there, or correct its name in the model",
        _ => "",
    };
    let mut error = Error::new(cause.kind(), format!("the {channel} of {label}: {cause}{advice}"));
    if let Some(path) = cause.path() {
        error = error.with_path(path);
    }
    error.with_source(cause)
}

/// Images with the ways in which they are used; none where one is left out.
pub type UsedImages<T> = Vec<(ImageUse, Option<T>)>;

/// Reads the images of all textures of a mesh's materials that are `usable`, each once per way of use, in parallel. Those that are missing
/// or broken are none, and [left out](LeftOut); of images packed of several, only the channels of those. The material and the channel in
/// a message are the first ones that use the image so; kind and path are those of what failed.
///
/// # Errors
/// An image takes more memory than there is, or a disk fails; where that is so of several, the one with the lowest index.
pub fn read_used_images<T: Send>(
    mesh: &Mesh,
    usable: impl Fn(&TextureRef) -> bool,
    read: impl Fn(&ImageSource, ImageUse) -> Result<T> + Sync,
) -> Result<(UsedImages<T>, LeftOut)> {
    let limits = ReadLimits::current();
    let loaded: Vec<_> = used_images(mesh, usable)
        .into_par_iter()
        .map(|(used, index, channel)| {
            let failed = |cause| unreadable(channel, &label(mesh, index, used.image), cause);
            let read = |source: &ImageSource| limits.run(|| read(source, used));
            let (image, causes) = read_sound(&mesh.images[used.image], read).map_err(failed)?;
            Ok((used, image, Vec::from_iter(causes.into_iter().map(failed))))
        })
        .collect();
    let (mut images, mut left_out) = (Vec::new(), LeftOut::default());
    // Not collected as one result in parallel: which of several errors that gives is left to chance.
    for image in loaded {
        let (used, image, errors) = image?;
        images.push((used, image));
        left_out.0.extend(errors);
    }
    Ok((images, left_out))
}

/// Reads an image, of a packed one what is sound, and tells what is not.
fn read_sound<T>(
    source: &ImageSource,
    read: impl Fn(&ImageSource) -> Result<T>,
) -> Result<(Option<T>, Vec<Error>)> {
    let cause = match read(source) {
        Ok(image) => return Ok((Some(image), Vec::new())),
        Err(error) => of_image(error)?,
    };
    let ImageSource::Packed(packed) = source else { return Ok((None, vec![cause])) };
    let mut sound = packed.clone();
    let mut causes = Vec::new();
    for index in 0..sound.channels.len() {
        let Some(channel) = &sound.channels[index] else { continue };
        let source = channel.source.clone();
        if let Err(error) = read(&source) {
            causes.push(of_image(error)?);
            sound.channels.iter_mut().for_each(|channel| drop(channel.take_if(|c| c.source == source)));
        }
    }
    let image = match sound.channels.iter().all(Option::is_none) {
        true => None,
        false => Some(read(&ImageSource::Packed(sound))?),
    };
    Ok((image, causes))
}

/// An error that lies in an image: without it, there is all else.
///
/// # Errors
/// It is one of the machine, which may have more memory or a sound disk the next time.
fn of_image(error: Error) -> Result<Error> {
    use io::ErrorKind::{InvalidFilename, InvalidInput, IsADirectory, NotADirectory, PermissionDenied};
    let is_refused = |error: &io::Error| {
        [InvalidFilename, InvalidInput, IsADirectory, NotADirectory, PermissionDenied].contains(&error.kind())
    };
    let lies_in_image = match error.kind() {
        ErrorKind::NotFound | ErrorKind::Malformed | ErrorKind::Unsupported => true,
        ErrorKind::Io => error.source().and_then(|cause| cause.downcast_ref()).is_some_and(is_refused),
        _ => false,
    };
    if lies_in_image { Ok(error) } else { Err(error) }
}

/// Images of textures that are `usable`, each once per way of use, with the first material and channel that use it so; in order of their
/// numbers.
pub(super) fn used_images(
    mesh: &Mesh,
    usable: impl Fn(&TextureRef) -> bool,
) -> Vec<(ImageUse, usize, &'static str)> {
    let mut wanted = BTreeMap::new();
    for (index, material) in mesh.materials.iter().enumerate() {
        for (channel, texture, space) in channels(material).into_array() {
            if let Some(texture) = texture.filter(|t| t.image < mesh.images.len() && usable(t)) {
                let used = ImageUse::of(material, texture, space);
                let key = (used.image, space == ColorSpace::Srgb, used.alpha == AlphaUse::Coverage);
                wanted.entry(key).or_insert((used, index, channel));
            }
        }
    }
    wanted.into_values().collect()
}
