//! Writing geometry as PLY, OBJ or GLB.
//!
//! The file appears whole or not at all: it is written under a temporary name in its own folder, made durable and then
//! renamed.

use std::io::{self, Write};
use std::path::Path;

use fantex_base::files::{exists, write_whole};
use fantex_base::srgb::srgb_from_linear;
use fantex_base::{Error, ErrorKind, Result, counted};
use glam::{DVec3, Vec3, Vec4};

use crate::ModelFormat;
use crate::counts::there_are;
use crate::load::about;

/// Geometry to write.
#[derive(Clone, Copy, Debug)]
pub struct WriteGeometry<'a> {
    /// World-space positions, finite.
    pub positions: &'a [DVec3],
    /// Indices into `positions`, counter-clockwise seen from outside.
    pub triangles: &'a [[u32; 3]],
    /// Linear RGBA per position (0..1), or None. PLY and OBJ store sRGB, PLY in 8 bits, OBJ without alpha.
    pub colors: Option<&'a [Vec4]>,
}

/// The format in which [`write_model`] writes a file of this name.
///
/// # Errors
/// The extension names none that is written.
pub fn written_format(path: &Path) -> Result<ModelFormat> {
    let format = ModelFormat::from_extension(path);
    let format = format.filter(|f| matches!(f, ModelFormat::Ply | ModelFormat::Obj | ModelFormat::Glb));
    format.ok_or_else(|| {
        let sentence = "names no format that fantex writes models in; use .ply, .obj or .glb";
        about(path, ErrorKind::Unsupported, sentence)
    })
}

/// Writes geometry in the format that the extension names: `.ply` (binary little-endian), `.obj` or `.glb`.
/// An existing file is replaced only with `force`.
///
/// # Errors
/// Where geometry cannot be written so, the file exists, or the system refuses; an existing file is then unchanged.
pub fn write_model(path: &Path, geometry: &WriteGeometry, force: bool) -> Result<()> {
    let format = written_format(path)?;
    check(path, format, geometry)?;
    if !force && path.exists() {
        return Err(exists(path));
    }
    let container = match format {
        ModelFormat::Glb => {
            let too_large = |bytes| {
                let why = format!("the model takes {bytes} bytes, but a GLB file holds 4 GiB; use .ply");
                refused(path, ErrorKind::TooLarge, why)
            };
            Some(glb_layout(geometry).map_err(too_large)?)
        }
        _ => None,
    };
    write_whole(path, force, |out| match (&container, format) {
        (Some((origin, header)), _) => write_glb(geometry, *origin, header, out),
        (None, ModelFormat::Ply) => write_ply(geometry, out),
        (None, _) => write_obj(geometry, out),
    })
}

fn refused(path: &Path, kind: ErrorKind, why: String) -> Error {
    about(path, kind, format!("was not written: {why}"))
}

fn check(path: &Path, format: ModelFormat, geometry: &WriteGeometry) -> Result<()> {
    let invalid = |why: String| refused(path, ErrorKind::InvalidArgument, why);
    let count = geometry.positions.len();
    if geometry.triangles.is_empty() {
        return Err(invalid("there are no triangles".to_owned()));
    }
    if let Some(index) = geometry.positions.iter().position(|p| !p.is_finite()) {
        return Err(invalid(format!("position {index} is not finite")));
    }
    let is_bad = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= count);
    if let Some(triangle) = geometry.triangles.iter().position(is_bad) {
        let index = geometry.triangles[triangle].into_iter().max().unwrap_or_default();
        let there_are = there_are(count);
        let sentence = format!("triangle {triangle} refers to position {index}, but {there_are}");
        return Err(invalid(sentence));
    }
    if format == ModelFormat::Glb {
        let origin = glb_origin(geometry);
        let is_beyond = |p: &DVec3| !(*p - origin).as_vec3().is_finite();
        if let Some(index) = geometry.positions.iter().position(is_beyond) {
            let why = format!("position {index} exceeds the single precision of a GLB file; use .ply");
            return Err(invalid(why));
        }
    }
    match geometry.colors {
        Some(colors) if colors.len() != count => {
            let (colors, positions) = (counted(colors.len(), "colour"), counted(count, "position"));
            Err(invalid(format!("it has {colors} for {positions}")))
        }
        _ => Ok(()),
    }
}

fn fits_single_precision(positions: &[DVec3]) -> bool {
    positions.iter().all(|p| p.as_vec3().as_dvec3() == *p)
}

/// sRGB bytes of a linear colour; alpha stays linear.
fn srgb_bytes(color: Vec4) -> [u8; 4] {
    let [r, g, b, a] = color.to_array();
    let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
    [byte(srgb_from_linear(r)), byte(srgb_from_linear(g)), byte(srgb_from_linear(b)), byte(a)]
}

// Binary glTF.

/// A binary glTF file up to its binary data: header, JSON chunk, header of the binary chunk.
#[derive(Clone, Debug)]
pub struct GlbHeader {
    /// Padded.
    json: String,
    binary_bytes: u32,
    file_bytes: u32,
}

impl GlbHeader {
    /// Of a JSON text and the length of the binary data, a multiple of 4.
    ///
    /// # Errors
    /// The file's length in bytes, where that exceeds the 4 GiB that the format can hold.
    pub fn new(mut json: String, binary_bytes: u64) -> Result<Self, u64> {
        json.extend(std::iter::repeat_n(' ', json.len().wrapping_neg() % 4));
        // A header of 12 bytes and two chunks with headers of 8.
        let bytes = 28 + json.len() as u64 + binary_bytes;
        let file_bytes = u32::try_from(bytes).map_err(|_| bytes)?;
        Ok(Self { json, binary_bytes: binary_bytes as u32, file_bytes })
    }

    /// Writes it; the binary data follow.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        out.write_all(b"glTF")?;
        for word in [2, self.file_bytes, self.json.len() as u32] {
            out.write_all(&word.to_le_bytes())?;
        }
        out.write_all(b"JSON")?;
        out.write_all(self.json.as_bytes())?;
        out.write_all(&self.binary_bytes.to_le_bytes())?;
        out.write_all(b"BIN\0")
    }
}

/// The origin of the positions. glTF positions are floats. Where these are too coarse, they are taken relative to the centre of the
/// bounding box, which becomes the node's translation. It is not finite where the box is too large for that.
fn glb_origin(geometry: &WriteGeometry) -> DVec3 {
    if fits_single_precision(geometry.positions) {
        return DVec3::ZERO;
    }
    let positions = geometry.positions.iter();
    let (low, high) = positions.fold((DVec3::MAX, DVec3::MIN), |(low, high), &p| (low.min(p), high.max(p)));
    low + (high - low) * 0.5
}

/// The origin of the positions, and what comes before the binary data; fails with the file's size in bytes if that exceeds 4 GiB.
fn glb_layout(geometry: &WriteGeometry) -> Result<(DVec3, GlbHeader), u64> {
    let origin = glb_origin(geometry);
    let vertices = geometry.positions.len() as u64;
    let color_bytes = if geometry.colors.is_some() { 16 * vertices } else { 0 };
    let sections = [12 * vertices, color_bytes, 12 * geometry.triangles.len() as u64];
    let json = describe(geometry, origin, sections);
    Ok((origin, GlbHeader::new(json, sections.iter().sum())?))
}

/// The JSON text. Binary data are positions, colours, indices, in this order.
fn describe(geometry: &WriteGeometry, origin: DVec3, [positions, colors, indices]: [u64; 3]) -> String {
    let vertices = geometry.positions.len();
    let local = geometry.positions.iter().map(|p| (*p - origin).as_vec3());
    let (low, high) = local.fold((Vec3::MAX, Vec3::MIN), |(low, high), p| (low.min(p), high.max(p)));
    let mut attributes = serde_json::json!({ "POSITION": 0 });
    let mut views = vec![serde_json::json!({ "buffer": 0, "byteLength": positions, "target": 34962 })];
    let mut accessors = vec![serde_json::json!({
        "bufferView": 0, "componentType": 5126, "count": vertices, "type": "VEC3",
        "min": low.to_array(), "max": high.to_array(),
    })];
    if geometry.colors.is_some() {
        attributes["COLOR_0"] = 1.into();
        views.push(serde_json::json!({
            "buffer": 0, "byteOffset": positions, "byteLength": colors, "target": 34962,
        }));
        accessors.push(serde_json::json!({
            "bufferView": 1, "componentType": 5126, "count": vertices, "type": "VEC4",
        }));
    }
    views.push(serde_json::json!({
        "buffer": 0, "byteOffset": positions + colors, "byteLength": indices, "target": 34963,
    }));
    accessors.push(serde_json::json!({
        "bufferView": views.len() - 1, "componentType": 5125, "count": 3 * geometry.triangles.len(), "type": "SCALAR",
    }));
    let document = serde_json::json!({
        "asset": { "version": "2.0", "generator": "fantex" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "translation": origin.to_array() }],
        "meshes": [{ "primitives": [{ "attributes": attributes, "indices": accessors.len() - 1, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 0.9 } }],
        "buffers": [{ "byteLength": positions + colors + indices }],
        "bufferViews": views,
        "accessors": accessors,
    });
    document.to_string()
}

fn write_glb(
    geometry: &WriteGeometry,
    origin: DVec3,
    header: &GlbHeader,
    out: &mut impl Write,
) -> io::Result<()> {
    header.write(out)?;
    for position in geometry.positions {
        write_floats(&(*position - origin).as_vec3().to_array(), out)?;
    }
    for color in geometry.colors.unwrap_or_default() {
        write_floats(&color.to_array(), out)?;
    }
    for index in geometry.triangles.iter().flatten() {
        out.write_all(&index.to_le_bytes())?;
    }
    Ok(())
}

fn write_floats(numbers: &[f32], out: &mut impl Write) -> io::Result<()> {
    numbers.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}

// Wavefront OBJ.

/// Coordinates in the fewest digits that read back exactly; colours as three sRGB numbers after them.
fn write_obj(geometry: &WriteGeometry, out: &mut impl Write) -> io::Result<()> {
    for (index, position) in geometry.positions.iter().enumerate() {
        write!(out, "v")?;
        for coordinate in position.to_array() {
            let single = coordinate as f32;
            match f64::from(single) == coordinate {
                true => write!(out, " {single}")?,
                false => write!(out, " {coordinate}")?,
            }
        }
        if let Some(colors) = geometry.colors {
            let [r, g, b] = colors[index].truncate().to_array().map(|x| srgb_from_linear(x.clamp(0.0, 1.0)));
            write!(out, " {r:.5} {g:.5} {b:.5}")?;
        }
        writeln!(out)?;
    }
    for triangle in geometry.triangles {
        let [a, b, c] = triangle.map(|v| u64::from(v) + 1);
        writeln!(out, "f {a} {b} {c}")?;
    }
    Ok(())
}

// Binary little-endian PLY.

/// Positions are floats where these hold them exactly, doubles else; colours are four sRGB bytes.
fn write_ply(geometry: &WriteGeometry, out: &mut impl Write) -> io::Result<()> {
    let is_single = fits_single_precision(geometry.positions);
    write_header(geometry, is_single, out)?;
    for (index, position) in geometry.positions.iter().enumerate() {
        for coordinate in position.to_array() {
            match is_single {
                true => out.write_all(&(coordinate as f32).to_le_bytes())?,
                false => out.write_all(&coordinate.to_le_bytes())?,
            }
        }
        if let Some(colors) = geometry.colors {
            out.write_all(&srgb_bytes(colors[index]))?;
        }
    }
    for triangle in geometry.triangles {
        let mut row = [3; 13];
        for (bytes, index) in row[1..].as_chunks_mut::<4>().0.iter_mut().zip(triangle) {
            *bytes = index.to_le_bytes();
        }
        out.write_all(&row)?;
    }
    Ok(())
}

fn write_header(geometry: &WriteGeometry, is_single: bool, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {}", geometry.positions.len())?;
    let scalar = if is_single { "float" } else { "double" };
    for axis in ["x", "y", "z"] {
        writeln!(out, "property {scalar} {axis}")?;
    }
    if geometry.colors.is_some() {
        for channel in ["red", "green", "blue", "alpha"] {
            writeln!(out, "property uchar {channel}")?;
        }
    }
    // Many readers know signed indices only; larger ones need the unsigned type.
    let index = if geometry.positions.len() <= i32::MAX as usize { "int" } else { "uint" };
    writeln!(out, "element face {}", geometry.triangles.len())?;
    writeln!(out, "property list uchar {index} vertex_indices\nend_header")
}
