//! Pictures: what they show beside their subject, what differs between two, and arrays of their pixels.

use std::path::{Path, PathBuf};

use fantex::glam::Vec3;
use fantex::mesh::{ImageSource, Mesh as Geometry};
use fantex::render::{FanSurface, LookSurface, RenderOptions, Surface, render};
use fantex::scene::{Background, Camera, FilterOptions, Lights, Picture};
use fantex::texture::compare::{Comparison, compare as compare_images, compare_where};
use fantex::texture::material::read_image;
use fantex::texture::{ColorSpace, Filter, Image, Samples};
use fantex::{Error, ModelPicture, Progress, Surroundings, ViewComparison, World, frame_world};
use numpy::{
    Element, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods, ToPyArray,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyDict};

use crate::asset::Asset;
use crate::mesh::Mesh;
use crate::options::{optional, word};
use crate::watch::{exception, heard, watched};

/// Eye, target, up, opening angle in degrees.
type CameraParts = ([f64; 3], [f64; 3], [f64; 3], f64);

/// Rows, columns, RGBA of 8 bits in sRGB; and what is to be known, a sentence each.
pub(crate) type Rendered<'py> = (Bound<'py, PyArray3<u8>>, Vec<String>);

const FILTERS: [(&str, Filter); 7] = [
    ("nearest", Filter::Nearest),
    ("bilinear", Filter::Bilinear),
    ("bicubic", Filter::Bicubic),
    ("bicubic-mipmaps", Filter::BicubicMipmaps),
    ("trilinear", Filter::Trilinear),
    ("anisotropic", Filter::Anisotropic),
    ("ewa", Filter::Ewa),
];

/// A picture to be taken: everything but its subject. What was not said is none.
pub(crate) struct View {
    pub(crate) size: Option<[u32; 2]>,
    pub(crate) samples: Option<u32>,
    pub(crate) camera: Option<Camera>,
    pub(crate) filter: Option<Filter>,
    pub(crate) is_transparent: bool,
    /// Direction.
    sun: Option<Vec3>,
    environment: Option<Environment>,
}

struct Environment {
    /// A picture, or [`Surroundings::SKY`].
    path: PathBuf,
    strength: f32,
    rotation_degrees: f32,
}

impl View {
    pub(crate) fn new(options: &Bound<'_, PyDict>) -> PyResult<Self> {
        let camera = optional::<CameraParts>(options, "camera")?;
        let camera = camera.map(|(eye, target, up, fov_degrees)| Camera {
            eye: eye.into(),
            target: target.into(),
            up: up.into(),
            fov_degrees,
        });
        let strength: f32 = optional(options, "environment_strength")?.unwrap_or(1.0);
        let rotation_degrees: f32 = optional(options, "environment_rotation")?.unwrap_or(0.0);
        if !(strength.is_finite() && strength >= 0.0 && rotation_degrees.is_finite()) {
            return Err(PyValueError::new_err(format!(
                "environment_strength is {strength} and environment_rotation {rotation_degrees}; both must be finite, and the strength not negative"
            )));
        }
        let path: Option<PathBuf> = optional(options, "environment")?;
        Ok(Self {
            size: optional(options, "size")?,
            samples: optional(options, "samples")?,
            camera,
            filter: word(options, "filter", &FILTERS)?,
            is_transparent: optional(options, "transparent")?.unwrap_or(false),
            sun: optional::<[f32; 3]>(options, "light")?.map(Vec3::from),
            environment: path.map(|path| Environment { path, strength, rotation_degrees }),
        })
    }

    /// Columns and rows.
    pub(crate) fn size(&self) -> [u32; 2] {
        self.size.unwrap_or([960, 540])
    }

    pub(crate) fn filter(&self) -> FilterOptions {
        FilterOptions { filter: self.filter.unwrap_or(Filter::Anisotropic), ..FilterOptions::default() }
    }

    /// The camera that was given, or the one that shows a mesh whole.
    pub(crate) fn camera(&self, mesh: &Geometry) -> Camera {
        self.camera.unwrap_or_else(|| Camera::framing_mesh(mesh, Camera::THREE_QUARTER, self.aspect()))
    }

    /// The camera that was given, or the one that shows a world whole, which was read at `place`.
    pub(crate) fn camera_of_world(&self, place: &Path, world: &World) -> fantex::Result<Camera> {
        let (from, fov) = (Camera::THREE_QUARTER, Camera::FRAMING_FOV_DEGREES);
        self.camera.map_or_else(|| frame_world(place, world, from, self.aspect(), fov), Ok)
    }

    fn aspect(&self) -> f64 {
        let [width, height] = self.size();
        f64::from(width) / f64::from(height.max(1))
    }

    fn options(&self) -> RenderOptions {
        let [width, height] = self.size();
        let defaults = RenderOptions::default();
        RenderOptions {
            width,
            height,
            samples: self.samples.unwrap_or(defaults.samples),
            background: match (self.is_transparent, &self.environment) {
                (true, _) => Background::Transparent,
                (false, Some(_)) => Background::Environment { blur: 0.0 },
                (false, None) => defaults.background,
            },
            ..defaults
        }
    }

    /// Takes the picture of a mesh with a surface.
    pub(crate) fn take(
        &self,
        mesh: &Geometry,
        surface: &dyn Surface,
        camera: &Camera,
    ) -> fantex::Result<Picture> {
        let mut lights = self.sun.map_or_else(|| Lights::behind(camera), Lights::sun);
        if let Some(Environment { path, strength, rotation_degrees }) = &self.environment {
            let mut surroundings = Surroundings::load(path, self.sun)?;
            surroundings.light.strength = *strength;
            surroundings.light.rotation_degrees = *rotation_degrees;
            surroundings.shine(&mut lights, self.sun.is_some());
        }
        Ok(render(mesh, surface, camera, &lights, &self.options())?.picture)
    }
}

/// A picture as Python gets it.
pub(crate) fn rendered<'py>(
    py: Python<'py>,
    picture: &Picture,
    notes: Vec<String>,
) -> PyResult<Rendered<'py>> {
    let [height, width] = [picture.height, picture.width].map(|n| n as usize);
    let image = picture.to_srgb_image();
    let rgba: Vec<u8> = match image.samples {
        Samples::U8(rgb) if image.channels == 3 => {
            rgb.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect()
        }
        Samples::U8(rgba) => rgba,
        _ => Vec::new(),
    };
    Ok((rgba.to_pyarray(py).reshape([height, width, 4])?, notes))
}

/// A picture of 8 bits per sample as a PNG file: grey, RGB or RGBA.
#[pyfunction]
pub(crate) fn encode_png<'py>(
    py: Python<'py>,
    picture: PyReadonlyArray3<'py, u8>,
) -> PyResult<Bound<'py, PyBytes>> {
    let (width, height, channels) = extents(&picture)?;
    let image = Image {
        width,
        height,
        channels,
        space: ColorSpace::Srgb,
        samples: Samples::U8(picture.as_array().iter().copied().collect()),
    };
    let bytes = py.detach(|| image.encoded("picture.png")).map_err(exception)?;
    Ok(PyBytes::new(py, &bytes))
}

/// The texels of an encoded image, rows, columns and RGBA: colours as linear light where its integers are sRGB, else as they are. `label` names
/// it in messages.
#[pyfunction]
pub(crate) fn decode_image<'py>(
    py: Python<'py>,
    bytes: PyBackedBytes,
    label: &str,
    is_srgb: bool,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let source = ImageSource::Embedded { label: label.to_owned(), bytes: bytes.as_ref().into() };
    let space = if is_srgb { ColorSpace::Srgb } else { ColorSpace::Linear };
    let image = watched(py, None, |_| read_image(&source, space))?;
    let [height, width] = [image.height, image.width].map(|n| n as usize);
    let texels = py.detach(|| -> Vec<[f32; 4]> {
        (0..image.height)
            .flat_map(|y| (0..image.width).map(move |x| (x, y)))
            .map(|(x, y)| image.linear_texel(x, y))
            .collect()
    });
    texels.as_flattened().to_pyarray(py).reshape([height, width, 4])
}

/// Columns, rows and channels of an array that is a picture.
fn extents<T: Element>(picture: &PyReadonlyArray3<'_, T>) -> PyResult<(u32, u32, u8)> {
    let [height, width, channels] = *picture.shape() else {
        return Err(PyValueError::new_err("a picture has rows, columns and channels"));
    };
    if !(1..=4).contains(&channels) || width == 0 || height == 0 {
        let shape = format!("({height}, {width}, {channels})");
        return Err(PyValueError::new_err(format!("a picture has the shape (h, w, 1 to 4), not {shape}")));
    }
    Ok((width as u32, height as u32, channels as u8))
}

/// A picture of linear floats.
fn linear_image(picture: &PyReadonlyArray3<'_, f32>) -> PyResult<Image> {
    let (width, height, channels) = extents(picture)?;
    Ok(Image::from_linear(width, height, channels, picture.as_array().iter().copied().collect()))
}

/// How much two pictures of linear floats differ: PSNR, SSIM, FLIP; over the pixels that count, where these are given.
#[pyfunction]
pub(crate) fn compare_pictures(
    py: Python<'_>,
    reference: PyReadonlyArray3<'_, f32>,
    test: PyReadonlyArray3<'_, f32>,
    counts: Option<PyReadonlyArray2<'_, bool>>,
) -> PyResult<(f64, f64, f64)> {
    let (reference, test) = (linear_image(&reference)?, linear_image(&test)?);
    let counts: Option<Vec<bool>> = counts.map(|counts| counts.as_array().iter().copied().collect());
    let found = watched(py, None, |_| match &counts {
        Some(counts) => compare_where(&reference, &test, counts),
        None => compare_images(&reference, &test),
    })?;
    Ok((found.psnr_db, found.ssim, found.flip))
}

/// What pictures are compared of.
#[derive(FromPyObject)]
pub(crate) enum Subject {
    Mesh(Py<Mesh>),
    Asset(Py<Asset>),
}

impl Subject {
    fn mesh(&self) -> &Geometry {
        match self {
            Self::Mesh(mesh) => mesh.get().geometry(),
            Self::Asset(asset) => asset.get().asset().mesh(),
        }
    }

    /// What it looks like, and what is to be known of that.
    fn surface(&self, filter: FilterOptions) -> fantex::Result<(Box<dyn Surface + '_>, Vec<String>)> {
        Ok(match self {
            Self::Mesh(mesh) => {
                let surface = LookSurface::of_model(mesh.get().geometry(), filter)?;
                let notes = surface.left_out().notes();
                (Box::new(surface), notes)
            }
            Self::Asset(asset) => (Box::new(FanSurface::of_asset(asset.get().cache(), filter)), Vec::new()),
        })
    }
}

/// Compares pictures of two subjects from cameras around the first; with `notes`, a sentence each.
#[pyfunction]
pub(crate) fn compare<'py>(
    py: Python<'py>,
    a: Subject,
    b: Subject,
    views: u32,
    options: &Bound<'py, PyDict>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let view = View::new(options)?;
    let (found, notes) = watched(py, heard(&progress, "comparing"), |watch| {
        let options = RenderOptions { background: Background::Transparent, ..view.options() };
        let (surface_a, mut notes) = a.surface(view.filter())?;
        let (surface_b, notes_of_b) = b.surface(view.filter())?;
        notes.extend(notes_of_b);
        let cameras = Camera::orbit(a.mesh(), views as usize, view.aspect());
        let mut found = Vec::with_capacity(cameras.len());
        for (number, camera) in (1..).zip(&cameras) {
            if watch.is_cancelled() {
                return Err(Error::cancelled("the comparison was cancelled"));
            }
            let lights = Lights::behind(camera);
            let picture = |mesh: &Geometry, surface: &dyn Surface| {
                render(mesh, surface, camera, &lights, &options)
                    .map(|rendering| ModelPicture::new(&rendering.picture))
            };
            let pictures = [picture(a.mesh(), &*surface_a)?, picture(b.mesh(), &*surface_b)?];
            found.push(ViewComparison::new(&pictures)?);
            watch.report(number, u64::from(views));
        }
        if !found.iter().any(ViewComparison::shows_model) {
            let sentence = "no picture shows either model, so there is nothing to compare; give more views=";
            return Err(Error::not_found(sentence));
        }
        Ok((found, notes))
    })?;
    let shown: Vec<&ViewComparison> = found.iter().filter(|view| view.shows_model()).collect();
    let numbers = |of: fn(&ViewComparison) -> f64| shown.iter().map(move |view| of(view));
    let mean = |of: fn(&ViewComparison) -> f64| numbers(of).sum::<f64>() / shown.len() as f64;
    let least = |of: fn(&ViewComparison) -> f64| numbers(of).fold(f64::INFINITY, f64::min);
    let figures = PyDict::new(py);
    figures.set_item("psnr_db", ViewComparison::mean_db(numbers(|view| view.model.psnr_db)))?;
    figures.set_item("min_psnr_db", least(|view| view.model.psnr_db))?;
    figures.set_item("ssim", mean(|view| view.model.ssim))?;
    figures.set_item("flip", mean(|view| view.model.flip))?;
    figures.set_item("model_share", mean(|view| view.model_share))?;
    figures.set_item("whole_psnr_db", ViewComparison::mean_db(numbers(|view| view.whole_psnr_db)))?;
    figures.set_item("notes", notes)?;
    figures.set_item("views", views)?;
    figures.set_item("empty_views", found.len() - shown.len())?;
    let mut per_view = Vec::with_capacity(found.len());
    for ViewComparison { model: Comparison { psnr_db, ssim, flip }, model_share, whole_psnr_db } in &found {
        let view = PyDict::new(py);
        view.set_item("psnr_db", psnr_db)?;
        view.set_item("ssim", ssim)?;
        view.set_item("flip", flip)?;
        view.set_item("model_share", model_share)?;
        view.set_item("whole_psnr_db", whole_psnr_db)?;
        per_view.push(view);
    }
    figures.set_item("per_view", per_view)?;
    Ok(figures)
}
