//! STL, binary and ASCII (3D Systems, "StereoLithography Interface Specification", 1989).
//!
//! Facet normals are ignored: they say no more than the winding does, many exporters leave them zero, and where the
//! two disagree every other program trusts the winding.
//!
//! Colours of binary facets (sRGB, five bits a channel, in the attributes that the format leaves open) are read in both conventions:
//!
//! - Materialise Magics, where the header has `COLOR=` and a colour for the whole: red, green and blue from bit 0 on; bit 15 says that the facet
//!   has the colour of the whole.
//! - VisCAM and SolidView: blue, green and red from bit 0 on; bit 15 says that the facet has a colour. Where some facet has no such bit and still
//!   other bits, they are something else.

use fantex_base::{Error, Place, Result, counted};
use glam::{DVec3, Vec3, Vec3Swizzles, Vec4};

use super::{SourceFile, Words, linear_rgba, parsed_number, shown};
use crate::Model;

const HEADER_BYTES: usize = 84;
const FACET_BYTES: usize = 50;

/// True for content that can only be STL: the ASCII words, or a length that fits the binary facet count exactly.
pub(super) fn looks_like_stl(bytes: &[u8]) -> bool {
    is_ascii(bytes) || (facet_count(bytes).is_some_and(|n| n > 0 && needed_bytes(n) == bytes.len() as u64))
}

/// Loads an STL file. Every facet has its own three positions; nothing is welded here.
pub(super) fn load(file: &SourceFile) -> Result<Model> {
    read(file).map_err(|error| error.in_file(file.path))
}

fn read(file: &SourceFile) -> Result<Model> {
    let count = facet_count(file.bytes);
    let fits_binary = count.is_some_and(|n| n > 0 && needed_bytes(n) == file.bytes.len() as u64);
    // Many binary files begin with the word solid too, so a length that fits comes first.
    if !fits_binary && is_ascii(file.bytes) {
        return Ascii::new(without_mark(file.bytes)).read(file);
    }
    let too_short = || {
        let bytes = counted(file.bytes.len(), "byte");
        Error::malformed(format!(
            "it is neither ASCII STL (it lacks the words solid and facet) nor binary STL (it has {bytes}, fewer than the \
             header's 84)"
        ))
    };
    read_binary(file, count.ok_or_else(too_short)?)
}

/// ASCII STL begins with `solid`, and the words `facet` or `endsolid` follow in the text after it.
fn is_ascii(bytes: &[u8]) -> bool {
    let text = without_mark(bytes).trim_ascii_start();
    let head = &text[..text.len().min(4096)];
    starts_with_word(head, b"solid")
        && !head.contains(&0)
        && [&b"facet"[..], b"endsolid"]
            .iter()
            .any(|word| head.windows(word.len()).any(|w| w.eq_ignore_ascii_case(word)))
}

/// Text without the mark that some editors put before UTF-8.
fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

fn starts_with_word(text: &[u8], word: &[u8]) -> bool {
    text.len() > word.len()
        && text[..word.len()].eq_ignore_ascii_case(word)
        && text[word.len()].is_ascii_whitespace()
}

fn facet_count(bytes: &[u8]) -> Option<u32> {
    let count = bytes.get(HEADER_BYTES - 4..HEADER_BYTES)?;
    Some(u32::from_le_bytes(count.try_into().ok()?))
}

fn needed_bytes(facets: u32) -> u64 {
    HEADER_BYTES as u64 + u64::from(facets) * FACET_BYTES as u64
}

fn read_binary(file: &SourceFile, facets: u32) -> Result<Model> {
    let needed = needed_bytes(facets);
    let Some(body) = file.bytes.get(HEADER_BYTES..usize::try_from(needed).unwrap_or(usize::MAX)) else {
        let (facets, bytes) = (counted(facets, "facet"), file.bytes.len());
        return Err(Error::malformed(format!(
            "its header announces {facets}, which takes {needed} bytes, but the file has {bytes}; it is truncated or not STL"
        )));
    };
    file.check_triangles(facets as usize)?;
    file.check_positions(3 * facets as usize)?;
    let mut positions = Vec::with_capacity(3 * facets as usize);
    let mut attributes = Vec::with_capacity(facets as usize);
    for (row, facet) in body.chunks_exact(FACET_BYTES).enumerate() {
        file.tell(row as u64, (facets as usize - row) * FACET_BYTES);
        // 12 bytes of normal, three corners of three floats, two bytes of attributes.
        let corners: [f32; 9] = bytemuck::pod_read_unaligned(&facet[12..48]);
        let corners = corners.map(|x| f64::from(f32::from_bits(u32::from_le(x.to_bits()))));
        positions.extend(corners.chunks_exact(3).map(DVec3::from_slice));
        attributes.push(u16::from_le_bytes([facet[48], facet[49]]));
    }
    let mut model = soup(positions);
    color(&mut model, &file.bytes[..HEADER_BYTES - 4], &attributes);
    let trailing = file.bytes.len() as u64 - needed;
    if trailing > 0 {
        model.notes.push(format!("ignored {} after the last facet", counted(trailing, "byte")));
    }
    Ok(model)
}

/// Gives corners the colours of their facets, if these have any.
fn color(model: &mut Model, header: &[u8], attributes: &[u16]) {
    const FLAG: u16 = 1 << 15;
    let colored = attributes.iter().filter(|&&a| a != 0).count();
    let of_whole = magics_color(header);
    if colored == 0 && of_whole.is_none() {
        return;
    }
    // sRGB, that in the lowest bits first.
    let channels = |a: u16| Vec3::from([0, 5, 10].map(|bit| f32::from((a >> bit) & 31) / 31.0));
    let opaque = |color_srgb: Vec3| linear_rgba(color_srgb, 1.0);
    let (convention, colors): (_, Vec<Vec4>) = if let Some(of_whole) = of_whole {
        // Attributes that are all zero would be black: nobody has set them.
        let own = |a: u16| colored > 0 && a & FLAG == 0;
        let of = |&a: &u16| opaque(if own(a) { channels(a) } else { of_whole });
        ("Magics", attributes.iter().map(of).collect())
    } else if attributes.iter().all(|&a| a == 0 || a & FLAG != 0) {
        let of = |&a: &u16| match a & FLAG {
            0 => Vec4::ONE,
            _ => opaque(channels(a).zyx()),
        };
        ("VisCAM", attributes.iter().map(of).collect())
    } else {
        let facets = counted(colored, "facet");
        model.notes.push(format!(
            "ignored the attributes of {facets}, which are not colours as VisCAM or Magics write them"
        ));
        return;
    };
    // All white is no colour.
    if colors.iter().any(|color| *color != Vec4::ONE) {
        model.notes.push(format!("colours of facets were read as {convention} writes them"));
        model.corners.colors = colors.into_iter().flat_map(|color| [color; 3]).collect();
    }
}

/// The colour of the whole in a header of Magics, sRGB. Its opacity, the fourth byte, says nothing in many files.
fn magics_color(header: &[u8]) -> Option<Vec3> {
    const KEY: &[u8] = b"COLOR=";
    let start = header.windows(KEY.len()).position(|word| word == KEY)? + KEY.len();
    let &rgb = header[start..].first_chunk::<3>()?;
    Some(Vec3::from(rgb.map(|byte| f32::from(byte) / 255.0)))
}

fn soup(positions: Vec<DVec3>) -> Model {
    let triangles = (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    Model { positions, triangles, ..Model::default() }
}

/// Reads `solid NAME facet normal X Y Z outer loop vertex X Y Z (3x) endloop endfacet ... endsolid NAME`, repeated.
struct Ascii<'a> {
    words: Words<'a>,
    /// The next word, if it was looked at but not taken.
    peeked: Option<&'a [u8]>,
}

impl<'a> Ascii<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { words: Words { rest: bytes, line: 1 }, peeked: None }
    }

    fn read(mut self, file: &SourceFile) -> Result<Model> {
        let mut positions = Vec::new();
        while self.next_solid()? {
            while self.next_facet()? {
                file.tell(positions.len() as u64 / 3, self.words.rest.len());
                file.check_triangles(positions.len() / 3 + 1)?;
                file.check_positions(positions.len() + 3)?;
                positions.extend(self.facet_corners()?);
            }
        }
        Ok(soup(positions))
    }

    /// Skips to the line after `solid NAME`. False at the end of the file.
    fn next_solid(&mut self) -> Result<bool> {
        match self.word() {
            None => Ok(false),
            Some(word) if word.eq_ignore_ascii_case(b"solid") => {
                self.skip_line();
                Ok(true)
            }
            Some(word) => Err(self.unexpected("solid", word)),
        }
    }

    /// True if a facet follows, false after `endsolid NAME`.
    fn next_facet(&mut self) -> Result<bool> {
        match self.word() {
            Some(word) if word.eq_ignore_ascii_case(b"facet") => Ok(true),
            Some(word) if word.eq_ignore_ascii_case(b"endsolid") => {
                self.skip_line();
                Ok(false)
            }
            word => Err(self.unexpected("facet or endsolid", word.unwrap_or_default())),
        }
    }

    fn facet_corners(&mut self) -> Result<[DVec3; 3]> {
        self.expect(b"normal", "normal")?;
        // The three numbers of the normal, or none of them, in any spelling ("nan", "-nan(ind)").
        while let Some(word) = self.peek()
            && !word.eq_ignore_ascii_case(b"outer")
            && !word.eq_ignore_ascii_case(b"vertex")
            && !word.eq_ignore_ascii_case(b"endfacet")
        {
            self.word();
        }
        self.expect(b"outer", "outer loop")?;
        self.expect(b"loop", "outer loop")?;
        let corners = [self.vertex()?, self.vertex()?, self.vertex()?];
        self.expect(b"endloop", "endloop after three vertices")?;
        self.expect(b"endfacet", "endfacet")?;
        Ok(corners)
    }

    fn vertex(&mut self) -> Result<DVec3> {
        self.expect(b"vertex", "vertex")?;
        Ok(DVec3::new(self.number()?, self.number()?, self.number()?))
    }

    fn number(&mut self) -> Result<f64> {
        let word = self.word().unwrap_or_default();
        parsed_number(word).ok_or_else(|| self.unexpected("a coordinate", word))
    }

    fn expect(&mut self, word: &[u8], expected: &str) -> Result<()> {
        match self.word() {
            Some(found) if found.eq_ignore_ascii_case(word) => Ok(()),
            found => Err(self.unexpected(expected, found.unwrap_or_default())),
        }
    }

    fn unexpected(&self, expected: &str, found: &[u8]) -> Error {
        let found =
            if found.is_empty() { "the end of the file".to_owned() } else { format!("{:?}", shown(found)) };
        let error = Error::malformed(format!("expected {expected}, found {found}"));
        error.at(Place::Line(self.words.line as u64))
    }

    fn peek(&mut self) -> Option<&'a [u8]> {
        if self.peeked.is_none() {
            self.peeked = self.word();
        }
        self.peeked
    }

    fn word(&mut self) -> Option<&'a [u8]> {
        self.peeked.take().or_else(|| self.words.next())
    }

    fn skip_line(&mut self) {
        let rest = &mut self.words.rest;
        // Files of old systems have carriage returns alone.
        let end = rest.iter().position(|&b| b == b'\n' || b == b'\r');
        *rest = &rest[end.unwrap_or(rest.len())..];
    }
}
