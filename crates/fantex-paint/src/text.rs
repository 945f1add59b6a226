//! Texts as pictures.

use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};

use crate::Picture;

/// The font of texts that name none: Hack (see `fonts/Hack-Regular.txt` for its licence).
pub const DEFAULT_FONT: &[u8] = include_bytes!("../fonts/Hack-Regular.ttf");

/// Texels between lines, unless the text is too long for that.
const LINE_TEXELS: f32 = 128.0;

/// Texels along the longer side of a text, about, at most.
const MAX_EXTENT: f32 = 8192.0;

/// A text cannot be drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TextError {
    /// The font is none.
    #[error("the font is neither TrueType nor OpenType; give the path of a .ttf or .otf file")]
    Font,
    /// Nothing to see.
    #[error("the text has no visible characters in this font")]
    Empty,
}

/// A text that was drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct TextPicture {
    /// White on nothing.
    pub picture: Picture,
    /// Length of the picture's longer side in distances of lines.
    pub lines: f32,
}

/// A line of a text: its glyphs with their places from the line's left end, and its width.
struct Line {
    glyphs: Vec<(ab_glyph::GlyphId, f32)>,
    width: f32,
}

/// Draws a text. Lines are centred; neighbouring characters are kerned.
///
/// # Errors
///
/// The font cannot be read, or no character is visible.
pub fn draw_text(text: &str, font: &[u8]) -> Result<TextPicture, TextError> {
    let font = FontRef::try_from_slice(font).map_err(|_| TextError::Font)?;
    let widest = set_lines(text, &font, LINE_TEXELS).iter().map(|line| line.width).fold(0.0, f32::max);
    let count = text.lines().count().max(1) as f32;
    let texels = LINE_TEXELS * (MAX_EXTENT / (widest + LINE_TEXELS).max(count * LINE_TEXELS)).min(1.0);
    let lines = set_lines(text, &font, texels);
    let widest = lines.iter().map(|line| line.width).fold(0.0, f32::max);
    // Half a line beside the text for what hangs over.
    let extent = [(widest + texels).ceil() as usize, (lines.len() as f32 * texels).ceil() as usize];
    let mut coverage = vec![0.0f32; extent[0] * extent[1]];
    let scale = scale_of(&font, texels);
    let ascent = font.as_scaled(scale).ascent();
    for (number, line) in lines.iter().enumerate() {
        let left = 0.5 * (extent[0] as f32 - line.width);
        for &(id, x) in &line.glyphs {
            let glyph = id.with_scale_and_position(scale, point(left + x, number as f32 * texels + ascent));
            let Some(outline) = font.outline_glyph(glyph) else { continue };
            let corner = outline.px_bounds().min;
            outline.draw(|dx, dy, covered| {
                let (x, y) = (corner.x as i64 + i64::from(dx), corner.y as i64 + i64::from(dy));
                if (0..extent[0] as i64).contains(&x) && (0..extent[1] as i64).contains(&y) {
                    let texel = &mut coverage[y as usize * extent[0] + x as usize];
                    *texel = (*texel + covered).min(1.0);
                }
            });
        }
    }
    if coverage.iter().all(|&covered| covered == 0.0) {
        return Err(TextError::Empty);
    }
    let lines = extent[0].max(extent[1]) as f32 / texels;
    Ok(TextPicture { picture: Picture::from_coverage(extent, &coverage), lines })
}

/// The scale at which lines are so many texels apart.
fn scale_of(font: &FontRef<'_>, texels: f32) -> PxScale {
    let unit = font.as_scaled(PxScale::from(1.0));
    let line = (unit.height() + unit.line_gap()).max(1e-3);
    PxScale::from(texels / line)
}

fn set_lines(text: &str, font: &FontRef<'_>, texels: f32) -> Vec<Line> {
    let scaled = font.as_scaled(scale_of(font, texels));
    let set = |line: &str| {
        let (mut glyphs, mut width) = (Vec::new(), 0.0);
        for character in line.chars() {
            let id = scaled.glyph_id(character);
            if let Some(&(before, _)) = glyphs.last() {
                width += scaled.kern(before, id);
            }
            glyphs.push((id, width));
            width += scaled.h_advance(id);
        }
        Line { glyphs, width }
    };
    text.lines().map(set).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    #[test]
    fn a_text_is_as_wide_as_its_letters() {
        let [one, two] = ["I", "IIII\nI"].map(|text| draw_text(text, DEFAULT_FONT).unwrap());
        assert!(two.picture.extent()[0] > 2 * one.picture.extent()[0] - 130, "{:?}", two.picture.extent());
        assert_eq!(two.picture.extent()[1], 2 * one.picture.extent()[1]);
        assert!(one.picture.alpha(Vec2::ZERO, 0.0) > 0.9, "a stem in the middle");
        assert_eq!(one.picture.alpha(Vec2::new(-0.95, 0.0), 0.0), 0.0);
        assert_eq!(draw_text("  ", DEFAULT_FONT), Err(TextError::Empty));
        assert_eq!(draw_text("x", b"no font"), Err(TextError::Font));
        let long = draw_text(&"wide ".repeat(400), DEFAULT_FONT).unwrap();
        assert!(long.picture.extent()[0] <= 8300 && long.lines > 500.0, "{}", long.lines);
    }
}
