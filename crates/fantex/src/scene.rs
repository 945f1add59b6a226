//! Files as things that can be rendered.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex::bake::{Source, SurfacePoint};
use fantex::mesh::{Mesh, shading_normals};
use fantex::render::{
    Camera, FanSurface, FilterOptions, FlatShading, FlatSurface, Lights, MeshSurface, RenderOptions,
    Rendering, Surface, render,
};
use fantex::store::{Asset, PageCache};
use fantex::texture::Filter;
use glam::{DVec3, Vec3, Vec4};

use crate::context::Context;
use crate::error::CliError;
use crate::input::{CleanModel, Input};
use crate::size::counted;

/// A model or an asset, open.
#[derive(Debug)]
pub(crate) struct Scene {
    path: PathBuf,
    content: Content,
}

#[derive(Debug)]
enum Content {
    Model(Box<CleanModel>),
    Asset(PageCache),
}

impl Scene {
    /// Opens a file. An asset's decoded tiles stay within the common memory budget.
    pub(crate) fn open(path: &Path, context: &Context) -> Result<Self, CliError> {
        let content = match Input::open(path)? {
            Input::Model(model) => {
                model.show_notes(path, context);
                Content::Model(model)
            }
            Input::Look(_) => return Err(CliError::LookInstead { path: path.into() }),
            Input::Asset(asset) => Content::Asset(PageCache::new(asset, context.memory_bytes as usize)),
        };
        Ok(Self { path: path.into(), content })
    }

    /// Its geometry.
    pub(crate) fn mesh(&self) -> &Mesh {
        match &self.content {
            Content::Model(model) => &model.mesh,
            Content::Asset(cache) => cache.asset().mesh(),
        }
    }

    /// The asset, if it is one.
    pub(crate) fn asset(&self) -> Option<&Arc<Asset>> {
        match &self.content {
            Content::Model(_) => None,
            Content::Asset(cache) => Some(cache.asset()),
        }
    }

    /// Its appearance.
    pub(crate) fn surface(&self, filter: FilterOptions) -> Result<Box<dyn Surface + '_>, CliError> {
        Ok(match &self.content {
            Content::Model(model) => Box::new(MeshSurface::load(&model.mesh, filter)?),
            Content::Asset(cache) => Box::new(FanSurface::of_asset(cache, filter)),
        })
    }

    /// Tells the user about tiles that could not be read, after they were looked at.
    pub(crate) fn show_damage(&self, context: &Context) {
        let Content::Asset(cache) = &self.content else { return };
        let damage = cache.damage();
        if let Some((_, page, reason)) = damage.first.first() {
            context.note(format!(
                "{}: coarser texels stand in for {}; the first: {page}: {reason}",
                self.path.display(),
                counted(damage.pages, "damaged tile")
            ));
        }
    }
}

/// The filters of `--filter`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum FilterArg {
    /// The nearest texel
    Nearest,
    /// Four texels, no anti-aliasing
    Bilinear,
    /// Sixteen texels, no anti-aliasing
    Bicubic,
    /// Two detail levels
    Trilinear,
    /// Several trilinear probes along the footprint
    #[default]
    Anisotropic,
    /// Elliptical weighted average, the reference
    Ewa,
}

impl FilterArg {
    /// The renderer's options.
    pub(crate) fn options(self) -> FilterOptions {
        let filter = match self {
            Self::Nearest => Filter::Nearest,
            Self::Bilinear => Filter::Bilinear,
            Self::Bicubic => Filter::Bicubic,
            Self::Trilinear => Filter::Trilinear,
            Self::Anisotropic => Filter::Anisotropic,
            Self::Ewa => Filter::Ewa,
        };
        FilterOptions { filter, ..FilterOptions::default() }
    }
}

/// A surface that asks a bake source itself: the truth that a baked asset is compared with. Base colour only.
pub(crate) fn source_surface<'a>(
    mesh: &'a Mesh,
    source: &'a dyn Source,
) -> FlatSurface<'a, impl Fn(&fantex::render::Hit) -> Vec3 + Sync + 'a> {
    let normals = shading_normals(mesh);
    let channels = source.channels().len();
    FlatSurface::new(mesh, FlatShading::Smooth, move |hit| {
        let corners = mesh.triangle_positions(hit.triangle);
        let along = |l: Vec3| corners[0] * l.x + corners[1] * l.y + corners[2] * l.z;
        let point = SurfacePoint {
            triangle: hit.triangle,
            lambda: hit.lambda,
            lambda_steps: [hit.dlambda_dx, hit.dlambda_dy],
            position: along(hit.lambda),
            position_steps: [along(hit.dlambda_dx), along(hit.dlambda_dy)],
            normal: hit.blend([0, 1, 2].map(|k| normals[3 * hit.triangle + k])).normalize_or(Vec3::Z),
        };
        let mut values = vec![Vec4::ZERO; channels];
        source.evaluate(&point, &mut values);
        values[0].truncate()
    })
}

/// Renders with the sun behind the camera.
pub(crate) fn photograph(
    mesh: &Mesh,
    surface: &dyn Surface,
    camera: &Camera,
    options: &RenderOptions,
) -> Result<Rendering, CliError> {
    Ok(render(mesh, surface, camera, &Lights::behind(camera), options)?)
}

/// The three-quarter view that shows a whole mesh.
pub(crate) fn portrait(mesh: &Mesh, options: &RenderOptions) -> Camera {
    Camera::framing_mesh(mesh, Camera::THREE_QUARTER, aspect(options))
}

/// Width by height.
pub(crate) fn aspect(options: &RenderOptions) -> f64 {
    f64::from(options.width) / f64::from(options.height)
}

/// A point or direction of the command line: `X,Y,Z`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct VectorArg(pub(crate) DVec3);

/// Why a text is no vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected three numbers with commas between them, such as 1,0.5,-2")]
pub(crate) struct VectorError;

impl std::str::FromStr for VectorArg {
    type Err = VectorError;

    fn from_str(text: &str) -> Result<Self, VectorError> {
        let numbers: Vec<f64> =
            text.split(',').map(|n| n.trim().parse().map_err(|_| VectorError)).collect::<Result<_, _>>()?;
        match numbers[..] {
            [x, y, z] if numbers.iter().all(|n| n.is_finite()) => Ok(Self(DVec3::new(x, y, z))),
            _ => Err(VectorError),
        }
    }
}

/// A picture's size on the command line: `1280x720`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SizeArg(pub(crate) [u32; 2]);

/// Why a text is no picture size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected width x height in pixels, such as 1280x720")]
pub(crate) struct PictureSizeError;

impl std::str::FromStr for SizeArg {
    type Err = PictureSizeError;

    fn from_str(text: &str) -> Result<Self, PictureSizeError> {
        let (width, height) = text.split_once(['x', 'X']).ok_or(PictureSizeError)?;
        let side = |s: &str| s.parse().ok().filter(|&n| n > 0).ok_or(PictureSizeError);
        Ok(Self([side(width)?, side(height)?]))
    }
}

impl std::fmt::Display for SizeArg {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.0[0], self.0[1])
    }
}
