//! Pictures that are laid onto the surface: decals, texts, slides of a projection.

use std::collections::HashSet;
use std::sync::Arc;

use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};
use fantex_base::input::{Held, guarded, reserve};
use fantex_base::{Error, Result};
use fantex_cover::TexelTriangle;
use fantex_mesh::interpolate;
use fantex_texture::Image;
use fantex_texture::filter::halved_level;
use glam::{DVec3, Vec2, Vec3, Vec4, Vec4Swizzles};

use crate::composite::{PaintContext, tangent_from_picture};
use crate::cover::{Patch, TexelUnder, Touch};
use crate::dab::{Chart, coverage_of, share_of, tangent_axes};
use crate::texel_page::TexelPage;
use crate::{PaintColor, Region, RegionTriangle, Surface, SurfacePoint, Symmetry};

/// A picture with coarser versions of itself, so that a texel sees the mean of what it covers.
///
/// Coordinates: x to the right and y upwards, -1..1 over the picture's longer side, the origin in the middle.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Finest first.
    levels: Vec<Level>,
    _held: Held,
}

impl PartialEq for Picture {
    fn eq(&self, other: &Self) -> bool {
        self.levels == other.levels
    }
}

/// Bytes of a texel with its share of the coarser levels.
const TEXEL_BYTES: u64 = (size_of::<Vec4>() * 4).div_ceil(3) as u64;

/// Linear RGBA, multiplied by alpha.
#[derive(Clone, Debug, PartialEq)]
struct Level {
    extent: [usize; 2],
    texels: Vec<Vec4>,
}

impl Picture {
    /// From an image.
    ///
    /// # Errors
    /// The budget of memory for input does not allow it.
    pub fn new(image: &Image) -> Result<Self> {
        let texel = |x, y| Vec4::from_array(image.linear_texel(x, y));
        let texels = (0..image.height).flat_map(|y| (0..image.width).map(move |x| texel(x, y)));
        Self::from_texels([image.width as usize, image.height as usize], texels)
    }

    /// The shape of an image in white: its alpha, or, where it has none, its brightness.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn shape(image: &Image) -> Result<Self> {
        Self::from_coverage([image.width as usize, image.height as usize], &coverage_of(image))
    }

    /// A shape in white: coverage 0..1, row-major from the top, as many as `extent` has texels.
    fn from_coverage(extent: [usize; 2], coverage: &[f32]) -> Result<Self> {
        Self::from_texels(extent, coverage.iter().map(|&a| Vec4::new(1.0, 1.0, 1.0, a)))
    }

    /// Straight alpha.
    fn from_texels([width, height]: [usize; 2], texels: impl Iterator<Item = Vec4>) -> Result<Self> {
        let what = format_args!("a picture of {width} x {height} texels");
        let _held = reserve(what, (width as u64 * height as u64).saturating_mul(TEXEL_BYTES))?;
        let premultiplied = |texel: Vec4| {
            let alpha = share_of(texel.w);
            (texel.xyz() * alpha).extend(alpha)
        };
        let (extent, texels) = ([width, height], texels.map(premultiplied).collect());
        let mut levels = vec![Level { extent, texels }];
        while let Some(coarser) = levels.last().and_then(Level::halved) {
            levels.push(coarser);
        }
        Ok(Self { levels, _held })
    }

    /// Columns and rows.
    pub fn extent(&self) -> [usize; 2] {
        self.levels[0].extent
    }

    /// The mean over a square of side `width` at a place: linear RGBA, multiplied by alpha. Transparent outside.
    pub(crate) fn at(&self, place: Vec2, width: f32) -> Vec4 {
        let [columns, rows] = self.extent();
        let half = 0.5 * columns.max(rows) as f32;
        let texel = Vec2::new(place.x * half + 0.5 * columns as f32, 0.5 * rows as f32 - place.y * half);
        let level = (width * half).max(1.0).log2().min((self.levels.len() - 1) as f32);
        let (fine, share) = (level.floor(), level.fract());
        let value = |level: f32| self.levels[level as usize].at(texel * (-level).exp2());
        if share == 0.0 { value(fine) } else { value(fine).lerp(value(fine + 1.0), share) }
    }

    /// A distance from the middle beyond which a square of side `width` sees nothing of it: the corner, and the borders of the two levels that
    /// are mixed, each of which ends at most one and a half of its texels beyond the picture.
    fn reach(&self, width: f32) -> f32 {
        let [columns, rows] = self.extent().map(|n| n as f32);
        let longer = columns.max(rows);
        let border = 3.0 * width.max(2.0 / longer);
        (columns / longer + border).hypot(rows / longer + border)
    }

    /// The colour of [`at`](Self::at) without its alpha: opaque; black where there is none.
    pub(crate) fn color(&self, place: Vec2, width: f32) -> Vec4 {
        let value = self.at(place, width);
        if value.w > 0.0 { (value.xyz() / value.w).extend(1.0) } else { Vec4::W }
    }
}

impl Level {
    /// Half as many columns and rows; none below one texel.
    fn halved(&self) -> Option<Self> {
        let [width, height] = self.extent;
        if width <= 1 && height <= 1 {
            return None;
        }
        let extent = [width.div_ceil(2), height.div_ceil(2)];
        let mean = |[a, b, c, d]: [Vec4; 4]| (a + b + c + d) * 0.25;
        // A picture of odd extent is continued by nothing.
        Some(Self { extent, texels: halved_level(width, &self.texels, Vec4::ZERO, mean) })
    }

    /// Bilinear, at a place in texels of this level; transparent outside, with a border that fades over a texel.
    fn at(&self, place: Vec2) -> Vec4 {
        let corner = (place - 0.5).floor();
        let f = place - 0.5 - corner;
        let texel = |dx: f32, dy: f32| {
            let (x, y) = (corner.x + dx, corner.y + dy);
            let inside = x >= 0.0 && y >= 0.0 && x < self.extent[0] as f32 && y < self.extent[1] as f32;
            if inside { self.texels[y as usize * self.extent[0] + x as usize] } else { Vec4::ZERO }
        };
        let upper = texel(0.0, 0.0).lerp(texel(1.0, 0.0), f.x);
        upper.lerp(texel(0.0, 1.0).lerp(texel(1.0, 1.0), f.x), f.y)
    }
}

// Pictures at a place of the surface: stickers, texts.

/// A picture that lies on the surface around a point and follows it.
#[derive(Clone, Debug)]
pub struct Decal {
    /// Its middle.
    pub center: SurfacePoint,
    /// Length of its longer side, mesh units along the surface.
    pub size: f32,
    /// Radians, counter-clockwise on the surface; 0 is upright.
    pub angle: f32,
    /// Its alpha says where it covers. Colours are those of the channels.
    pub shape: Arc<Picture>,
    /// Left and right are changed, of the shape and of colours that are pictures.
    pub mirrored: bool,
    /// Which copy of a symmetric stroke's decal it is; 0 is the decal itself. Clones copy from another place for each.
    pub copy: u32,
}

impl Decal {
    /// The decal and its copies on the other sides of the model, turned as symmetry turns them. Mirror images are mirrored,
    /// unless they are to be `readable`. Copies that find no surface within half the decal's size are left out.
    pub fn copies(&self, surface: &Surface, symmetry: &Symmetry, readable: bool) -> Vec<Self> {
        let places = symmetry.places(surface, self.center, 0.5 * self.size);
        let [right, _] = turned_axes(surface, self.center, self.angle);
        let copies = (0u32..).zip(places).filter_map(|(k, place)| {
            let center = place?;
            if k == 0 {
                return Some(self.clone());
            }
            let normal = surface.outer_normal(center.triangle);
            let angle = symmetry.moved_angle(symmetry.moved_direction(right, k), normal, k);
            let mirrored = self.mirrored != (symmetry.is_mirrored(k) && !readable);
            Some(Self { center, angle, mirrored, copy: k, ..self.clone() })
        });
        copies.collect()
    }

    /// Where the picture's right and upright direction point at its middle, as it lies there: unit vectors of mesh space.
    pub fn axes(&self, surface: &Surface) -> [DVec3; 2] {
        let [right, up] = turned_axes(surface, self.center, self.angle);
        [if self.mirrored { -right } else { right }, up]
    }
}

/// Where a picture's right and upright direction point around a point, mesh space.
fn turned_axes(surface: &Surface, point: SurfacePoint, angle: f32) -> [DVec3; 2] {
    let (x, y) = tangent_axes(surface.outer_normal(point.triangle));
    let (sin, cos) = f64::from(angle).sin_cos();
    [x * cos + y * sin, y * cos - x * sin]
}

/// A decal with the part of the surface that it covers.
pub(crate) struct PlacedDecal<'a> {
    surface: &'a Surface,
    region: Region,
    chart: Chart,
    shape: &'a Picture,
    copy: u32,
    /// Coordinates of the picture per mesh unit, to the right and upwards.
    scale: Vec2,
    context: &'a PaintContext<'a>,
}

impl<'a> PlacedDecal<'a> {
    pub(crate) fn new(surface: &'a Surface, decal: &'a Decal, context: &'a PaintContext<'a>) -> Self {
        let half = (0.5 * decal.size).max(0.5 / surface.cover().density);
        let [columns, rows] = decal.shape.extent().map(|n| n as f32);
        let longer = columns.max(rows);
        // Half the diagonal, and a texel for the border.
        let reach = half * (columns / longer).hypot(rows / longer) + 1.5 / surface.cover().density;
        let region = Region::grow(surface, decal.center, reach * 1.05);
        let axes = turned_axes(surface, decal.center, decal.angle);
        let chart = Chart::unfold(surface, &region, decal.center, axes);
        let scale = Vec2::new(if decal.mirrored { -1.0 } else { 1.0 }, 1.0) / half;
        let (shape, copy) = (&*decal.shape, decal.copy);
        Self { surface, region, chart, shape, copy, scale, context }
    }

    /// Where the picture's right and upright direction point on a triangle, mesh space.
    fn axes(&self, triangle: &TexelTriangle, index: usize) -> [Vec3; 2] {
        let Some([a, b, c]) = self.chart.triangle(index) else { return [Vec3::ZERO; 2] };
        let [p, q, r] = self.surface.mesh().triangle_positions(triangle.triangle as usize);
        let area = (b - a).perp_dot(c - a);
        let right = ((q - p) * (c - a).y - (r - p) * (b - a).y) / area;
        let up = ((r - p) * (b - a).x - (q - p) * (c - a).x) / area;
        [right * self.scale.x, up].map(|axis| axis.normalize_or_zero())
    }

    /// Side of a texel in coordinates of the picture.
    fn texel_width(&self, triangle: &TexelTriangle, index: usize) -> f32 {
        let Some([a, b, c]) = self.chart.triangle(index) else { return 0.0 };
        let step = |lambda: Vec3| interpolate([a, b, c], lambda).length_squared();
        (0.5 * (step(triangle.steps[0]) + step(triangle.steps[1]))).sqrt() * self.scale.y
    }
}

impl Touch for PlacedDecal<'_> {
    fn region(&self) -> &Region {
        &self.region
    }

    fn texels(&self, index: usize, shown: &TexelTriangle) -> Option<[Vec2; 2]> {
        let in_plane = RegionTriangle::in_plane(shown.triangle, self.chart.triangle(index)?);
        let reach = self.shape.reach(self.texel_width(shown, index)) / self.scale.y;
        in_plane.texels_within(reach, shown)
    }
}

impl Patch for PlacedDecal<'_> {
    fn at(&self, map: &TexelPage, under: &TexelUnder<'_>, colors: &mut [Vec4]) -> f32 {
        let Some(place) = self.chart.at(under.index, under.point.lambda) else { return 0.0 };
        let (place, width) = (place * self.scale, self.texel_width(under.triangle, under.index));
        let covered = self.shape.at(place, width).w;
        if covered <= 0.0 {
            return 0.0;
        }
        for (color, painted) in colors.iter_mut().zip(&self.context.paint.channels) {
            *color = match &painted.color {
                PaintColor::Image(picture) if self.context.is_tangent(painted) => {
                    tangent_from_picture(picture.color(place, width), self.axes(under.triangle, under.index))
                }
                PaintColor::Image(picture) => picture.color(place, width),
                _ => {
                    let straight =
                        self.context.at(map, under.place, painted, self.copy).unwrap_or(Vec4::ZERO);
                    (straight.truncate() * straight.w).extend(straight.w)
                }
            };
        }
        covered
    }
}

// Texts as pictures.

/// The font of texts that name none: Hack (see `fonts/Hack-Regular.txt` for its licence).
pub const DEFAULT_FONT: &[u8] = include_bytes!("../fonts/Hack-Regular.ttf");

/// Texels between lines, unless the text is too long for that.
const LINE_TEXELS: f32 = 128.0;

/// Texels along the longer side of a text, about, at most.
const MAX_EXTENT: f32 = 8192.0;

/// A text that was drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct TextPicture {
    /// White on nothing.
    pub picture: Picture,
    /// Length of the picture's longer side in distances of lines.
    pub lines: f32,
    /// Characters that the font lacks, each once, in the order of the text: its sign for missing ones stands in their places. See
    /// [`note_of_missing`].
    pub missing: String,
}

/// Characters that a [`note_of_missing`] lists.
const LISTED: usize = 8;

/// A sentence on characters that a font lacks; none where it lacks none.
pub fn note_of_missing(characters: &str) -> Option<String> {
    let quoted = |character: char| format!("'{}'", character.escape_debug());
    let listed: Vec<String> = characters.chars().take(LISTED).map(quoted).collect();
    let more = match characters.chars().count() - listed.len() {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let sentence =
        format!("the font lacks {}{more}: its sign for missing characters is drawn", listed.join(", "));
    Some(sentence).filter(|_| !listed.is_empty())
}

/// A line of a text: its glyphs with their places from the line's left end, and its width.
struct Line {
    glyphs: Vec<(ab_glyph::GlyphId, f32)>,
    width: f32,
}

/// Texels that all characters may cover together, each counted with those beneath it: four times the largest text.
const MAX_GLYPH_TEXELS: f32 = 4.0 * MAX_EXTENT * MAX_EXTENT;

/// Draws a text. Lines are centred; neighbouring characters are kerned.
///
/// # Errors
/// The font cannot be read or is damaged, no character is visible, or the budget of memory for input does not allow the picture.
pub fn draw_text(text: &str, font: &[u8]) -> Result<TextPicture> {
    guarded(|| draw(text, font))
        .unwrap_or_else(|| Err(Error::malformed("the font is damaged; choose another one")))
}

fn draw(text: &str, font: &[u8]) -> Result<TextPicture> {
    let font = FontRef::try_from_slice(font).map_err(|_| {
        Error::malformed("the font is neither TrueType nor OpenType; give the path of a .ttf or .otf file")
    })?;
    let widest = set_lines(text, &font, LINE_TEXELS).iter().map(|line| line.width).fold(0.0, f32::max);
    let count = text.lines().count().max(1) as f32;
    let texels = LINE_TEXELS * (MAX_EXTENT / (widest + LINE_TEXELS).max(count * LINE_TEXELS)).min(1.0);
    let lines = set_lines(text, &font, texels);
    let widest = lines.iter().map(|line| line.width).fold(0.0, f32::max);
    // Half a line beside the text for what hangs over.
    let extent = [(widest + texels).ceil() as usize, (lines.len() as f32 * texels).ceil() as usize];
    let texel_count = extent[0] as u64 * extent[1] as u64;
    let _held = reserve("the shape of a text", texel_count * size_of::<f32>() as u64)?;
    let mut coverage = vec![0.0f32; extent[0] * extent[1]];
    let mut left_to_cover = MAX_GLYPH_TEXELS;
    let scale = scale_of(&font, texels);
    let ascent = font.as_scaled(scale).ascent();
    for (number, line) in lines.iter().enumerate() {
        let left = 0.5 * (extent[0] as f32 - line.width);
        for &(id, x) in &line.glyphs {
            let glyph = id.with_scale_and_position(scale, point(left + x, number as f32 * texels + ascent));
            let Some(outline) = font.outline_glyph(glyph) else { continue };
            let bounds = outline.px_bounds();
            left_to_cover -= bounds.width() * bounds.height();
            if left_to_cover.is_nan() || left_to_cover < 0.0 {
                return Err(Error::malformed(
                    "the font's characters are far larger than its lines; choose another one",
                ));
            }
            let corner = bounds.min;
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
        return Err(Error::invalid("the text has no visible characters in this font"));
    }
    let lines = extent[0].max(extent[1]) as f32 / texels;
    let mut known = HashSet::new();
    let characters = text.lines().flat_map(str::chars);
    let missing = characters.filter(|&c| font.glyph_id(c).0 == 0 && known.insert(c)).collect();
    Ok(TextPicture { picture: Picture::from_coverage(extent, &coverage)?, lines, missing })
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
    use fantex_base::{ErrorKind, ReadLimits, ReadOptions};
    use glam::Vec2;

    use super::*;

    /// The bytes of a font's table.
    fn table(font: &[u8], name: &[u8; 4]) -> std::ops::Range<usize> {
        let record = font[12..].chunks_exact(16).find(|record| &record[..4] == name).unwrap();
        let [start, length] =
            [8, 12].map(|at| u32::from_be_bytes(record[at..at + 4].try_into().unwrap()) as usize);
        start..start + length
    }

    #[test]
    fn fonts_with_characters_larger_than_lines_are_refused() {
        let mut font = DEFAULT_FONT.to_vec();
        // Lines of two units, characters of 2000, but none wide in its line.
        let widths = table(&font, b"hmtx");
        font[widths].fill(0);
        let lines = [(b"hhea", 4), (b"OS/2", 68)].map(|(name, offset)| table(&font, name).start + offset);
        let numbers = lines.into_iter().flat_map(|at| [(at, 1i16), (at + 2, -1), (at + 4, 0)]);
        for (at, value) in numbers {
            font[at..at + 2].copy_from_slice(&value.to_be_bytes());
        }
        let sentence = draw_text("W", &font).map(drop).unwrap_err().to_string();
        assert!(sentence.contains("far larger than its lines"), "{sentence}");
    }

    #[test]
    fn pictures_and_texts_count_against_the_budget() {
        let options = ReadOptions { memory_bytes: 4 << 20, ..ReadOptions::default() };
        ReadLimits::new(options).run(|| {
            let text = "a line of many\n".repeat(40);
            assert_eq!(draw_text(&text, DEFAULT_FONT).map(drop).unwrap_err().kind(), ErrorKind::TooLarge);
            let image = Image::from_linear_rgba(512, 512, &vec![[1.0; 4]; 1 << 18]);
            assert_eq!(Picture::new(&image).map(drop).unwrap_err().kind(), ErrorKind::TooLarge);
            drop(draw_text("a", DEFAULT_FONT).unwrap());
            assert_eq!(ReadLimits::current().memory_left(), 4 << 20);
        });
    }

    #[test]
    fn far_away_a_picture_is_its_mean() {
        let texels: Vec<[f32; 4]> =
            (0..64).map(|i| [1.0, 0.0, 0.0, if i % 8 < 4 { 1.0 } else { 0.0 }]).collect();
        let picture = Picture::new(&Image::from_linear_rgba(8, 8, &texels)).unwrap();
        assert_eq!(picture.at(Vec2::new(-0.5, 0.3), 0.0).w, 1.0);
        assert_eq!(picture.at(Vec2::new(0.5, 0.3), 0.0).w, 0.0);
        assert_eq!(picture.at(Vec2::new(-0.5, 1.3), 0.0).w, 0.0);
        assert!((picture.at(Vec2::ZERO, 2.0).w - 0.5).abs() < 1e-6);
        assert_eq!(picture.color(Vec2::ZERO, 2.0), Vec4::new(1.0, 0.0, 0.0, 1.0));
    }

    #[test]
    fn alphas_of_floats_are_shares() {
        let texels = [4.0, -1.0, f32::NAN, 0.5].map(|a| [0.5, 0.5, 0.5, a]);
        let picture = Picture::new(&Image::from_linear_rgba(4, 1, &texels)).unwrap();
        assert_eq!(picture.levels[0].texels, [1.0, 0.0, 0.0, 0.5].map(|a| (Vec3::splat(0.5) * a).extend(a)));
    }

    #[test]
    fn odd_extents_keep_their_middle() {
        let texels = vec![[1.0, 1.0, 1.0, 1.0]; 25 * 15];
        let picture = Picture::new(&Image::from_linear_rgba(25, 15, &texels)).unwrap();
        for width in [0.0, 0.08, 0.16] {
            assert!((picture.at(Vec2::ZERO, width).w - 1.0).abs() < 1e-6, "{width}");
        }
        assert_eq!(picture.at(Vec2::new(0.0, 0.8), 0.0).w, 0.0, "above a wide picture there is nothing");
    }

    #[test]
    fn characters_that_the_font_lacks_are_named() {
        let missing = |text: &str| draw_text(text, DEFAULT_FONT).unwrap().missing;
        assert_eq!(missing("Gr\u{fc}\u{df}e\n\u{416}"), "");
        assert_eq!(missing("b\u{6f22}a\u{5b57}\n\u{6f22}"), "\u{6f22}\u{5b57}");
        assert_eq!(note_of_missing(""), None);
        let note = note_of_missing("\u{6f22}\u{5b57}").unwrap();
        assert!(note.starts_with("the font lacks '\u{6f22}', '\u{5b57}': "), "{note}");
        let note = note_of_missing("0123456789").unwrap();
        assert!(note.contains("'6', '7' and 2 more:"), "{note}");
    }

    #[test]
    fn a_text_is_as_wide_as_its_letters() {
        let [one, two] = ["I", "IIII\nI"].map(|text| draw_text(text, DEFAULT_FONT).unwrap());
        assert!(two.picture.extent()[0] > 2 * one.picture.extent()[0] - 130, "{:?}", two.picture.extent());
        assert_eq!(two.picture.extent()[1], 2 * one.picture.extent()[1]);
        assert!(one.picture.at(Vec2::ZERO, 0.0).w > 0.9, "a stem in the middle");
        assert_eq!(one.picture.at(Vec2::new(-0.95, 0.0), 0.0).w, 0.0);
        let kind = |text: &str, font: &[u8]| draw_text(text, font).unwrap_err().kind();
        assert_eq!(kind("  ", DEFAULT_FONT), ErrorKind::InvalidArgument);
        assert_eq!(kind("x", b"no font"), ErrorKind::Malformed);
        let long = draw_text(&"wide ".repeat(400), DEFAULT_FONT).unwrap();
        assert!(long.picture.extent()[0] <= 8300 && long.lines > 500.0, "{}", long.lines);
    }
}
