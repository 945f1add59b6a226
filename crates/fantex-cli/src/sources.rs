//! What to bake, as the command line says it.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use fantex::photos::CameraFrame;
use fantex::texture::color::linear_from_srgb8_table;
use fantex::texture::{SOLID_NAMES, unknown_solid};
use fantex::{Error, MappingKind, Mesh, PhotoSet, Source};

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum SourceArg {
    Uv,
    Vertex,
    Image {
        path: PathBuf,
        /// How it is laid over the model.
        mapping: MappingKind,
    },
    /// A solid recipe, one of [`SOLID_NAMES`].
    Solid(String),
    Look(PathBuf),
    Mesh {
        path: PathBuf,
        /// How far its surface is looked for, world units; measured where it is not given.
        cage: Option<f64>,
    },
    Photos(PhotosArg),
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PhotosArg {
    /// A sparse model of COLMAP, a folder with one, or a `transforms.json`.
    pub(crate) path: PathBuf,
    /// Where the photographs are, if not beside it.
    pub(crate) images: Option<PathBuf>,
    /// In which coordinates the cameras are taken.
    pub(crate) frame: CameraFrame,
    /// Bring the photographs to one exposure.
    pub(crate) exposure: bool,
    /// sRGB bytes of what no photograph sees; its surroundings' colours where it is not given.
    pub(crate) unseen: Option<[u8; 3]>,
}

const SOURCE_SYNTAX: &str =
    "expected uv, vertex, image=PATH,mapping=NAME, solid=NAME, mesh=PATH, photos=PATH or look=PATH";

const PHOTOS_SYNTAX: &str = "photographs need a path, behind which images=FOLDER, frame=file|original, exposure=on|off and \
                             unseen=spread|RRGGBB may stand: photos=scan/sparse/0,images=scan/images";

const MESH_SYNTAX: &str = "another model needs a path, and its cage is a length above 0 in world units: mesh=PATH or \
                           mesh=PATH,cage=0.05";

const IMAGE_SYNTAX: &str =
    "an image needs a path and a mapping: image=PATH,mapping=planar|box|cylinder|sphere|triplanar";

impl FromStr for SourceArg {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        match text.split_once('=') {
            None if text == "uv" => Ok(Self::Uv),
            None if text == "vertex" => Ok(Self::Vertex),
            Some(("solid", name)) if SOLID_NAMES.contains(&name) => Ok(Self::Solid(name.to_owned())),
            Some(("solid", name)) => Err(unknown_solid(name)),
            Some(("look", path)) if !path.is_empty() => Ok(Self::Look(path.into())),
            Some(("mesh", rest)) => {
                let (path, cage) = match rest.rsplit_once(",cage=") {
                    None => (rest, None),
                    Some((path, cage)) => {
                        let cage = cage.parse().ok().filter(|cage: &f64| cage.is_finite() && *cage > 0.0);
                        (path, Some(cage.ok_or_else(|| Error::invalid(MESH_SYNTAX))?))
                    }
                };
                if path.is_empty() {
                    return Err(Error::invalid(MESH_SYNTAX));
                }
                Ok(Self::Mesh { path: path.into(), cage })
            }
            Some(("photos", rest)) => Ok(Self::Photos(rest.parse()?)),
            Some(("image", rest)) => {
                // A path may hold commas, the mapping's name does not.
                let (path, mapping) =
                    rest.rsplit_once(",mapping=").ok_or_else(|| Error::invalid(IMAGE_SYNTAX))?;
                if path.is_empty() {
                    return Err(Error::invalid(IMAGE_SYNTAX));
                }
                Ok(Self::Image { path: path.into(), mapping: mapping.parse()? })
            }
            _ => Err(Error::invalid(SOURCE_SYNTAX)),
        }
    }
}

impl fmt::Display for SourceArg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Uv => f.write_str("uv"),
            Self::Vertex => f.write_str("vertex"),
            Self::Image { path, mapping } => write!(f, "image={},mapping={}", path.display(), mapping.name()),
            Self::Solid(name) => write!(f, "solid={name}"),
            Self::Look(path) => write!(f, "look={}", path.display()),
            Self::Mesh { path, cage: None } => write!(f, "mesh={}", path.display()),
            Self::Mesh { path, cage: Some(cage) } => write!(f, "mesh={},cage={cage}", path.display()),
            Self::Photos(photos) => write!(f, "photos={photos}"),
        }
    }
}

impl FromStr for PhotosArg {
    type Err = Error;

    /// Options are looked for from the end: a path may hold commas.
    fn from_str(text: &str) -> Result<Self, Error> {
        let mut photos = Self {
            path: PathBuf::new(),
            images: None,
            frame: CameraFrame::OfFile,
            exposure: true,
            unseen: None,
        };
        let mut rest = text;
        while let Some((before, key, value)) = last_option(rest) {
            match (key, value) {
                ("images", folder) if !folder.is_empty() => photos.images = Some(folder.into()),
                ("frame", "file") => photos.frame = CameraFrame::OfFile,
                ("frame", "original") => photos.frame = CameraFrame::Original,
                ("exposure", "on") => photos.exposure = true,
                ("exposure", "off") => photos.exposure = false,
                ("unseen", "spread") => photos.unseen = None,
                ("unseen", color) => {
                    photos.unseen = Some(srgb_bytes(color).ok_or_else(|| Error::invalid(PHOTOS_SYNTAX))?);
                }
                _ => return Err(Error::invalid(PHOTOS_SYNTAX)),
            }
            rest = before;
        }
        if rest.is_empty() {
            return Err(Error::invalid(PHOTOS_SYNTAX));
        }
        photos.path = rest.into();
        Ok(photos)
    }
}

/// What stands before the last option of photographs, its key and its value.
fn last_option(text: &str) -> Option<(&str, &str, &str)> {
    let options = ["images", "frame", "exposure", "unseen"].into_iter().filter_map(|key| {
        let (before, value) = text.rsplit_once(&format!(",{key}="))?;
        Some((before, key, value))
    });
    options.max_by_key(|(before, ..)| before.len())
}

/// `ff8000`.
fn srgb_bytes(text: &str) -> Option<[u8; 3]> {
    let is_color = text.len() == 6 && text.bytes().all(|b| b.is_ascii_hexdigit());
    let number = u32::from_str_radix(text, 16).ok().filter(|_| is_color)?;
    let [_, r, g, b] = number.to_be_bytes();
    Some([r, g, b])
}

impl fmt::Display for PhotosArg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        if let Some(images) = &self.images {
            write!(f, ",images={}", images.display())?;
        }
        if self.frame == CameraFrame::Original {
            f.write_str(",frame=original")?;
        }
        if !self.exposure {
            f.write_str(",exposure=off")?;
        }
        match self.unseen {
            Some([r, g, b]) => write!(f, ",unseen={r:02x}{g:02x}{b:02x}"),
            None => Ok(()),
        }
    }
}

impl SourceArg {
    /// What a model offers by itself.
    pub(crate) fn of_model(mesh: &Mesh) -> Result<Self, Error> {
        match (mesh.has_materials(), mesh.has_vertex_colors()) {
            (true, _) => Ok(Self::Uv),
            (false, true) => Ok(Self::Vertex),
            (false, false) => Err(Error::invalid(format!(
                "{} has neither textures nor colours to bake; give --source image=PATH,mapping=box or --source solid=wood",
                mesh.path().display()
            ))),
        }
    }

    pub(crate) fn source(&self) -> Source<'static> {
        match self {
            Self::Uv => Source::own_materials(),
            Self::Vertex => Source::vertex_colors(),
            Self::Image { path, mapping } => Source::image(path, *mapping),
            Self::Solid(name) => Source::solid(name),
            Self::Look(path) => Source::look(path),
            Self::Mesh { path, cage: None } => Source::mesh(path),
            Self::Mesh { path, cage: Some(cage) } => Source::mesh_within(path, *cage),
            Self::Photos(photos) => Source::photos(PhotoSet {
                path: photos.path.clone(),
                images: photos.images.clone(),
                frame: photos.frame,
                keep_exposure: !photos.exposure,
                unseen: photos
                    .unseen
                    .map(|bytes| bytes.map(|b| linear_from_srgb8_table()[usize::from(b)]).into()),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_parse_and_print_alike() {
        for text in [
            "uv",
            "vertex",
            "image=a,b=c.png,mapping=sphere",
            "solid=wood",
            "look=a/b.toml",
            "mesh=a,b.ply",
            "mesh=a.ply,cage=0.25",
            "photos=a,b/transforms.json",
            "photos=scan/sparse/0,images=a, b,exposure=off,unseen=ff8000",
            "photos=scan,frame=original,exposure=off",
        ] {
            assert_eq!(text.parse::<SourceArg>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn mistakes_are_named() {
        let message = |text: &str| text.parse::<SourceArg>().unwrap_err().to_string();
        assert!(message("solid=cheese").contains("'cheese' is no solid"));
        assert!(message("image=a.png,mapping=fold").contains("'fold' is no mapping"));
        assert!(message("image=a.png").contains("mapping="));
        assert!(message("image=,mapping=box").contains("needs a path"));
        assert!(message("uvs").contains("expected uv"));
        assert!(message("mesh=").contains("needs a path"));
        assert!(message("mesh=a.ply,cage=-1").contains("length above 0"));
        for wrong in [
            "",
            ",images=b",
            "a,images=",
            "a,exposure=maybe",
            "a,frame=mine",
            "a,unseen=red",
            "a,unseen=ff80000",
        ] {
            assert!(message(&format!("photos={wrong}")).contains("photographs need a path"), "{wrong}");
        }
        let spread = "photos=a,exposure=on,unseen=spread".parse::<SourceArg>().unwrap();
        assert_eq!(spread.to_string(), "photos=a");
    }
}
