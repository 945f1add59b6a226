//! A picture over the view: a stencil to paint through, or a slide to project onto the model.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex::base::Result;
use fantex::glam::DVec2;
use fantex::paint::{
    Lens, Picture, PicturePlace, Projection, ProjectionView, StencilBy, Surface, is_shaped_by_alpha,
};
use fantex::texture::Image;
use serde::{Deserialize, Serialize};

use crate::paint::files::load_image;
use crate::paint::{LoadedFile, Viewpoint};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StencilUse {
    /// The brush paints through it: through its alpha, or its brightness where it has none.
    #[default]
    Mask,
    Colors,
}

impl StencilUse {
    pub const ALL: [(Self, &'static str); 2] = [(Self::Mask, "Stencil"), (Self::Colors, "Its colours")];
}

/// A picture over the view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StencilSettings {
    pub is_on: bool,
    pub image: Option<PathBuf>,
    pub paints: StencilUse,
    /// How much of it is seen over the scene, 0..1. (What is painted does not depend on it.)
    pub opacity: f32,
    pub place: PicturePlace,
    /// Whether the pointer moves it instead of painting.
    #[serde(skip)]
    pub is_adjusted: bool,
}

impl Default for StencilSettings {
    fn default() -> Self {
        Self {
            is_on: false,
            image: None,
            paints: StencilUse::Mask,
            opacity: 0.5,
            place: PicturePlace::default(),
            is_adjusted: false,
        }
    }
}

impl StencilSettings {
    /// Least and most height of the picture, in heights of the view.
    pub const HEIGHTS: [f64; 2] = [0.02, 20.0];

    /// As high or as wide as the view, in its middle; `aspects` are width by height of picture and view.
    pub fn fit(&mut self, [picture, view]: [f64; 2]) {
        self.place.center = [0.0; 2];
        self.place.angle = 0.0;
        self.place.height = (view / picture.max(1e-6)).min(1.0);
    }

    /// Upright, from the lower to the upper border.
    pub fn reset(&mut self) {
        self.place = PicturePlace::default();
    }

    /// Moves it in half heights of the view, upwards positive.
    pub fn shift(&mut self, by: DVec2) {
        let center = DVec2::from(self.place.center) + by;
        self.place.center = center.clamp(DVec2::splat(-50.0), DVec2::splat(50.0)).to_array();
    }

    pub fn scale(&mut self, by: f64) {
        let [least, most] = Self::HEIGHTS;
        self.place.height = (self.place.height * by).clamp(least, most);
    }

    /// Turns it counter-clockwise.
    pub fn turn(&mut self, degrees: f64) {
        self.place.angle = (self.place.angle + degrees + 180.0).rem_euclid(360.0) - 180.0;
    }

    /// Its corners in the view, from the upper left one clockwise: half heights of the view from its middle, upwards positive.
    pub fn corners(&self, aspect: f64) -> [DVec2; 4] {
        let half = DVec2::new(aspect, 1.0) * self.place.height;
        let turn = DVec2::from_angle(self.place.angle.to_radians());
        [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
            .map(|(x, y)| DVec2::from(self.place.center) + turn.rotate(half * DVec2::new(x, y)))
    }
}

/// The picture, read.
#[derive(Clone, Debug)]
pub struct StencilPicture {
    file: LoadedFile,
    image: Image,
    /// In white: what is painted through.
    shape: Arc<Picture>,
    colors: Arc<Picture>,
}

impl StencilPicture {
    /// Reads a picture.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn load(path: &Path) -> Result<Self> {
        let (file, image) = load_image(path)?;
        let (shape, colors) = (Arc::new(Picture::shape(&image)?), Arc::new(Picture::new(&image)?));
        Ok(Self { file, image, shape, colors })
    }

    pub fn path(&self) -> &Path {
        &self.file.path
    }

    pub(crate) fn file(&self) -> &LoadedFile {
        &self.file
    }

    pub fn aspect(&self) -> f64 {
        f64::from(self.image.width) / f64::from(self.image.height.max(1))
    }

    /// For the screen: at most so many pixels wide and high; sRGB with straight alpha, row-major. Where it is a stencil without
    /// alpha, its brightness is its alpha.
    pub fn pixels(&self, most: u32, paints: StencilUse) -> ([usize; 2], Vec<[u8; 4]>) {
        let every = self.image.width.max(self.image.height).div_ceil(most.max(1)).max(1);
        let extent = [self.image.width, self.image.height].map(|n| n.div_ceil(every));
        let is_mask = paints == StencilUse::Mask && !is_shaped_by_alpha(&self.image);
        let pixel = |x: u32, y: u32| {
            let [r, g, b, a] = self.image.linear_texel(x, y);
            let byte =
                |c: f32| (fantex::texture::color::srgb_from_linear(c.clamp(0.0, 1.0)) * 255.0).round() as u8;
            // Luminance (ITU-R BT.709).
            let a = if is_mask { 0.2126 * r + 0.7152 * g + 0.0722 * b } else { a };
            [byte(r), byte(g), byte(b), (a.clamp(0.0, 1.0) * 255.0).round() as u8]
        };
        let places = (0..extent[1]).flat_map(|y| (0..extent[0]).map(move |x| (x * every, y * every)));
        (extent.map(|n| n as usize), places.map(|(x, y)| pixel(x, y)).collect())
    }

    /// What a stroke is laid on through, as seen now; with the colours that it paints, where these are the picture's.
    pub(crate) fn projections(
        &self,
        settings: &StencilSettings,
        surface: &Surface,
        view: &Viewpoint,
    ) -> Option<(Arc<Projection>, Option<Arc<Projection>>)> {
        let view = projection_view(view, settings.place);
        let through = |picture: &Arc<Picture>| Projection::new(surface, &view, picture.clone()).map(Arc::new);
        Some(match settings.paints {
            StencilUse::Mask => (through(&self.shape)?, None),
            StencilUse::Colors => (through(&self.colors)?, Some(through(&self.colors)?)),
        })
    }
}

/// The camera of a view as the engine knows it.
pub(crate) fn projection_view(view: &Viewpoint, place: PicturePlace) -> ProjectionView {
    let target = view.rig.eye + view.rig.forward() * view.rig.distance;
    ProjectionView {
        eye: view.rig.eye.to_array(),
        target: target.to_array(),
        up: view.rig.axes().y_axis.to_array(),
        lens: Lens::Perspective(view.rig.fov_degrees),
        place,
    }
}

/// How a use of the picture is called in the log.
pub(crate) fn recorded_use(paints: StencilUse) -> StencilBy {
    match paints {
        StencilUse::Mask => StencilBy::Shape,
        StencilUse::Colors => StencilBy::Alpha,
    }
}
