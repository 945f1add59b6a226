//! Textures as paint: solids by their names, and any texture of a look.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex::base::{Error, Result, input};
use fantex::glam::{Vec2, Vec3, Vec4};
use fantex::paint::{DEFAULT_FONT, LookSettings, Picture, Surface, TextureGraph, draw_text, note_of_missing};
use fantex::texture::{ColorSpace, Filtering, Image, SOLID_NAMES, Samples, ShadingPoint, Texture, UvPoint};
use serde::{Deserialize, Serialize};

use crate::paint::files::load_image;
use crate::paint::{FileState, LoadedFile, PaintSettings, PictureUse, StickerKind};

pub const SOLIDS: [&str; 9] = SOLID_NAMES;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorSource {
    #[default]
    Color,
    /// A solid: a pattern in space, as if the model were cut from it.
    Solid,
    Look,
}

impl ColorSource {
    pub const ALL: [(Self, &'static str); 3] =
        [(Self::Color, "Colour"), (Self::Solid, "Pattern"), (Self::Look, "Look")];
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TextureChoice {
    pub source: ColorSource,
    pub solid: String,
    pub seed: u32,
    /// Size of the pattern; 1 fits the model.
    pub scale: f32,
    pub look: Option<PathBuf>,
    /// The name of its texture; the first one where it is empty.
    pub name: String,
}

impl Default for TextureChoice {
    fn default() -> Self {
        Self {
            source: ColorSource::Color,
            solid: "wood".into(),
            seed: 1,
            scale: 1.0,
            look: None,
            name: String::new(),
        }
    }
}

impl TextureChoice {
    /// The graph and the name of the texture in it; none where a colour is painted with.
    ///
    /// # Errors
    /// There is no look, or it cannot be read.
    pub fn graph(&self) -> Result<Option<(TextureGraph, String)>> {
        match self.source {
            ColorSource::Color => Ok(None),
            ColorSource::Solid => {
                Ok(Some((TextureGraph { look: self.solid_look(), folder: PathBuf::new() }, SOLID.into())))
            }
            ColorSource::Look => {
                let path = self.look.clone().ok_or_else(|| {
                    Error::not_found("No look is chosen: choose its file in the panel at the right.")
                })?;
                let look = input::read_text(&path).map_err(|error| error.context("the look"))?;
                let folder = path.parent().unwrap_or(Path::new("")).to_owned();
                let folder = std::path::absolute(&folder).unwrap_or(folder);
                let graph = TextureGraph { look, folder };
                let names = graph.names()?;
                let chosen = names.iter().find(|name| **name == self.name).or(names.first());
                let name = chosen.cloned().ok_or_else(|| {
                    Error::not_found(format!("the look {} has no textures", path.display()))
                })?;
                Ok(Some((graph, name)))
            }
        }
    }

    /// Of the look's file, where it is painted with; what the look mentions in turn is not looked at.
    pub fn file_state(&self) -> FileState {
        let look = self.look.as_deref().filter(|_| self.source == ColorSource::Look);
        look.map(FileState::of).unwrap_or_default()
    }

    /// A look with the solid alone.
    fn solid_look(&self) -> String {
        let known = SOLIDS.into_iter().find(|name| *name == self.solid).unwrap_or("wood");
        let is_random = !matches!(known, "checker" | "rings");
        let seed = if is_random { format!("seed = {}\n", self.seed) } else { String::new() };
        let scale = f64::from(self.scale.clamp(1e-3, 1e3));
        format!("[textures.{SOLID}]\nkind = \"{known}\"\n{seed}place = {{ scale = {scale:.6} }}\n")
    }
}

/// The name of a solid's texture in its look.
const SOLID: &str = "pattern";

#[derive(Clone)]
pub struct ChosenTexture {
    pub graph: TextureGraph,
    pub name: String,
    pub texture: Arc<dyn Texture>,
}

impl std::fmt::Debug for ChosenTexture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ChosenTexture").field("name", &self.name).finish_non_exhaustive()
    }
}

impl ChosenTexture {
    /// Makes the texture that is chosen; none where a colour is.
    ///
    /// # Errors
    /// The solid is not known, or the look or a texture of it cannot be made.
    pub fn make(choice: &TextureChoice, surface: &Surface) -> Result<Option<Self>> {
        let Some((graph, name)) = choice.graph()? else { return Ok(None) };
        let texture = graph.texture(surface, &name)?;
        Ok(Some(Self { graph, name, texture }))
    }

    /// For the log of strokes.
    pub(crate) fn look(&self) -> LookSettings {
        LookSettings::Inline { text: self.graph.look.clone(), folder: self.graph.folder.clone() }
    }

    /// A picture of it in a slanting cut through the model's middle, where trunks show rings and layers show: sRGB, row-major.
    pub fn preview(&self, surface: &Surface, [width, height]: [usize; 2]) -> Vec<[u8; 3]> {
        let positions = surface.mesh().positions.iter().map(|p| surface.space().point(*p));
        let radius = positions.map(Vec3::length).fold(0.0, f32::max);
        let step = 2.0 * radius / width.max(1) as f32;
        let up = Vec3::new(0.0, 0.6, -0.8);
        let texel = |x: usize, y: usize| {
            let at = Vec2::new(x as f32 + 0.5 - 0.5 * width as f32, 0.5 * height as f32 - y as f32 - 0.5);
            let uv = Vec2::new(at.x, -at.y) / width as f32 + 0.5;
            let share = 1.0 / width as f32;
            let uv = UvPoint { uv, steps: [Vec2::X * share, Vec2::Y * share] };
            let value = self.texture.evaluate(&ShadingPoint {
                position: (Vec3::X * at.x + up * at.y) * step,
                position_steps: [Vec3::X * step, -up * step],
                normal: Vec3::X.cross(up),
                normal_steps: [Vec3::ZERO; 2],
                uv: &[uv],
                vertex_color: Vec4::ONE,
                eye: None,
                time: 0.0,
                filtering: Filtering::Area,
            });
            value
                .truncate()
                .to_array()
                .map(|c| (fantex::texture::color::srgb_from_linear(c.clamp(0.0, 1.0)) * 255.0).round() as u8)
        };
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| texel(x, y)).collect()
    }
}

// Texts and pictures that are laid onto the surface.

/// What is laid onto the surface.
#[derive(Clone, Debug)]
pub(crate) struct StickerShape {
    pub(crate) picture: Arc<Picture>,
    /// Length of its longer side in distances of a text's lines; 1 of a picture.
    pub(crate) lines: f32,
    /// What the user should know of it.
    pub(crate) note: Option<String>,
    /// The picture's.
    pub(crate) file: Option<LoadedFile>,
}

/// The text or picture that is chosen, drawn or read.
pub(crate) fn sticker_shape(settings: &PaintSettings) -> Result<StickerShape> {
    let (picture, lines, note, file) = match settings.sticker {
        StickerKind::Text if settings.text.trim().is_empty() => {
            return Err(Error::invalid("There is no text: write one in the panel at the left."));
        }
        StickerKind::Text => {
            let text = draw_text(&settings.text, DEFAULT_FONT)?;
            (text.picture, text.lines, note_of_missing(&text.missing), None)
        }
        StickerKind::Picture => {
            let path = settings
                .picture
                .as_ref()
                .ok_or_else(|| Error::invalid("There is no picture: choose one in the panel at the left."))?;
            let (file, image) = load_image(path)?;
            // Normals and heights are numbers, not colours.
            let is_color =
                settings.picture_use == PictureUse::Color || matches!(image.samples, Samples::F32(_));
            let image = if is_color { image } else { Image { space: ColorSpace::Linear, ..image } };
            (Picture::new(&image)?, 1.0, None, Some(file))
        }
    };
    Ok(StickerShape { picture: Arc::new(picture), lines, note, file })
}
