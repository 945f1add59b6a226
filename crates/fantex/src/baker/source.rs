//! What is baked.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use fantex_bake::{LookSource, MappedImageSource, Prefilter, SolidSource, TexelPoint, VertexColorSource};
use fantex_base::random::folded_seed;
use fantex_base::{Error, Result};
use fantex_mesh::ObjectSpace;
use fantex_texture::{Image, ImageTexture, MappingKind, Wrap, solid_by_name};
use glam::Vec4;

#[cfg(feature = "photos")]
use super::PhotoSet;
use crate::{Asset, Mesh};

/// What is baked.
pub struct Source<'a>(pub(super) Kind<'a>);

pub(super) enum Kind<'a> {
    OwnMaterials,
    VertexColors,
    Image(PathBuf, MappingKind),
    Solid(String),
    Look(PathBuf),
    Mesh {
        path: PathBuf,
        cage: Option<f64>,
    },
    Loaded(&'a Mesh, Option<f64>),
    Asset(&'a Asset, Option<f64>),
    #[cfg(feature = "photos")]
    Photos(PhotoSet),
    Function(Box<dyn Fn(&TexelPoint) -> Vec4 + Sync + 'a>),
    Custom(&'a dyn fantex_bake::Source),
}

impl<'a> Source<'a> {
    /// The model's own materials: colours, textures and all other channels.
    pub fn own_materials() -> Self {
        Self(Kind::OwnMaterials)
    }

    /// The model's vertex colours.
    pub fn vertex_colors() -> Self {
        Self(Kind::VertexColors)
    }

    /// What a model offers by itself: its materials (which take its vertex colours in), else its vertex colours.
    pub fn of_model(mesh: &Mesh) -> Option<Self> {
        match (mesh.has_materials(), mesh.has_vertex_colors()) {
            (true, _) => Some(Self::own_materials()),
            (false, true) => Some(Self::vertex_colors()),
            (false, false) => None,
        }
    }

    /// An image, laid over the model.
    pub fn image(path: impl Into<PathBuf>, mapping: MappingKind) -> Self {
        Self(Kind::Image(path.into(), mapping))
    }

    /// A solid recipe, one of [`SOLID_NAMES`](fantex_texture::SOLID_NAMES): `"marble"`, `"wood"` ...
    pub fn solid(name: impl Into<String>) -> Self {
        Self(Kind::Solid(name.into()))
    }

    /// The materials, displacements and, if it says so, the light of a look (`.toml`).
    pub fn look(path: impl Into<PathBuf>) -> Self {
        Self(Kind::Look(path.into()))
    }

    /// Another, more detailed model: its materials or vertex colours, and its normals. Or an asset: all that it holds.
    pub fn mesh(path: impl Into<PathBuf>) -> Self {
        Self(Kind::Mesh { path: path.into(), cage: None })
    }

    /// As [`mesh`](Self::mesh), looking for its surface no farther than `cage` world units.
    pub fn mesh_within(path: impl Into<PathBuf>, cage: f64) -> Self {
        Self(Kind::Mesh { path: path.into(), cage: Some(cage) })
    }

    /// As [`mesh`](Self::mesh), of a model in memory; `cage` as in [`mesh_within`](Self::mesh_within).
    pub fn loaded_mesh(mesh: &'a Mesh, cage: Option<f64>) -> Self {
        Self(Kind::Loaded(mesh, cage))
    }

    /// As [`mesh`](Self::mesh), of an asset that is open; `cage` as in [`mesh_within`](Self::mesh_within).
    pub fn asset(asset: &'a Asset, cage: Option<f64>) -> Self {
        Self(Kind::Asset(asset, cage))
    }

    /// Photographs with cameras.
    #[cfg(feature = "photos")]
    pub fn photos(photos: PhotoSet) -> Self {
        Self(Kind::Photos(photos))
    }

    /// A closure that gives the linear base colour and opacity at a point of the surface.
    pub fn function(color: impl Fn(&TexelPoint) -> Vec4 + Sync + 'a) -> Self {
        Self(Kind::Function(Box::new(color)))
    }

    /// The source as a function on a mesh's surface: what pictures of an asset are compared with.
    ///
    /// # Errors
    /// The mesh has no such colours, a file or an image of its materials cannot be read; or it is a look, a mesh or photographs, which can only be baked.
    pub fn evaluator<'m>(
        &'m self,
        mesh: &'m fantex_mesh::Mesh,
        seed: u64,
    ) -> Result<Box<dyn fantex_bake::Source + 'm>> {
        self.0.evaluator(mesh, seed)
    }

    /// Any source with any channels.
    pub fn custom(source: &'a dyn fantex_bake::Source) -> Self {
        Self(Kind::Custom(source))
    }
}

impl Kind<'_> {
    pub(super) fn evaluator<'m>(
        &'m self,
        mesh: &'m fantex_mesh::Mesh,
        seed: u64,
    ) -> Result<Box<dyn fantex_bake::Source + 'm>> {
        Ok(match self {
            Self::OwnMaterials => {
                let source = LookSource::of_model(mesh)?;
                source.left_out().check()?;
                Box::new(source)
            }
            Self::VertexColors => Box::new(VertexColorSource::new(mesh)?),
            Self::Image(path, mapping) => {
                let texture = ImageTexture::new(Arc::new(Image::load(path)?));
                let mapping = mapping.fit(ObjectSpace::of(mesh).bounds());
                Box::new(MappedImageSource::new(mesh, texture, mapping, [Wrap::Repeat; 2]))
            }
            Self::Solid(name) => {
                let solid = solid_by_name(name, ObjectSpace::of(mesh).bounds(), folded_seed(seed))?;
                Box::new(SolidSource::new(mesh, solid))
            }
            Self::Function(color) => Box::new(FunctionSource(color.as_ref())),
            Self::Custom(_) | Self::Look(_) | Self::Mesh { .. } | Self::Loaded(..) | Self::Asset(..) => {
                return Err(only_baked());
            }
            #[cfg(feature = "photos")]
            Self::Photos(_) => return Err(only_baked()),
        })
    }
}

fn only_baked() -> Error {
    Error::invalid("looks, other models and photographs can only be baked; give another source here")
}

impl fmt::Debug for Source<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Kind::OwnMaterials => f.write_str("own materials"),
            Kind::VertexColors => f.write_str("vertex colours"),
            Kind::Image(path, mapping) => write!(f, "image {}, {}", path.display(), mapping.name()),
            Kind::Solid(name) => write!(f, "solid {name}"),
            Kind::Look(path) => write!(f, "look {}", path.display()),
            Kind::Mesh { path, .. } => write!(f, "mesh {}", path.display()),
            Kind::Loaded(mesh, _) => write!(f, "mesh {}", mesh.path().display()),
            Kind::Asset(asset, _) => write!(f, "mesh {}", asset.path().display()),
            #[cfg(feature = "photos")]
            Kind::Photos(photos) => write!(f, "photographs {}", photos.path.display()),
            Kind::Function(_) => f.write_str("function"),
            Kind::Custom(_) => f.write_str("custom source"),
        }
    }
}

/// A closure as a source of base colour.
struct FunctionSource<'f>(&'f (dyn Fn(&TexelPoint) -> Vec4 + Sync));

impl fantex_bake::Source for FunctionSource<'_> {
    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        values[0] = (self.0)(point);
    }
}
