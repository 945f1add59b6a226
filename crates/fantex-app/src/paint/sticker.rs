//! Texts and pictures that are laid onto the surface.

use std::sync::Arc;

use fantex_paint::{DEFAULT_FONT, Decal, Picture, SurfacePoint, TextError, draw_text};
use fantex_texture::{Image, LoadImageError};

use super::{PaintSettings, StickerKind};

/// There is nothing to lay.
#[derive(Debug, thiserror::Error)]
pub(super) enum StickerError {
    /// The text cannot be drawn.
    #[error(transparent)]
    Text(#[from] TextError),
    /// The picture cannot be read.
    #[error(transparent)]
    Image(#[from] LoadImageError),
    /// No text was written.
    #[error("There is no text: write one in the panel at the left.")]
    NoText,
    /// No picture was chosen.
    #[error("There is no picture: choose one in the panel at the left.")]
    NoPicture,
}

/// What is laid around a point, to be read from where the surface's normals point, or from behind. `line`: the distance of a text's lines, or the length of a picture's longer side, mesh units.
pub(super) fn sticker(
    settings: &PaintSettings,
    center: SurfacePoint,
    line: f32,
    is_behind: bool,
) -> Result<Decal, StickerError> {
    let (shape, size) = match settings.sticker {
        StickerKind::Text if settings.text.trim().is_empty() => return Err(StickerError::NoText),
        StickerKind::Text => {
            let text = draw_text(&settings.text, DEFAULT_FONT)?;
            (text.picture, text.lines * line)
        }
        StickerKind::Picture => {
            let path = settings.picture.as_ref().ok_or(StickerError::NoPicture)?;
            (Picture::new(&Image::load(path)?), line)
        }
    };
    // Surfaces are wound either way: what is laid is right for whoever looks at them.
    let turn = if is_behind { -1.0 } else { 1.0 };
    let angle = turn * settings.sticker_degrees.to_radians();
    Ok(Decal { center, size, angle, shape: Arc::new(shape), mirrored: is_behind })
}

/// Length of a text's longer side in distances of lines.
pub(super) fn text_lines(text: &str) -> f32 {
    draw_text(text, DEFAULT_FONT).map_or(1.0, |drawn| drawn.lines)
}
