//! Binary glTF.

use std::io::{self, Write};

use glam::{DVec3, Vec3};

use super::{WriteGeometry, fits_single_precision};

/// Where everything lies in the file.
pub(super) struct Layout {
    /// glTF positions are floats. Where these are too coarse, they are taken relative to this point, which becomes the
    /// node's translation.
    origin: DVec3,
    /// The JSON chunk, padded.
    json: String,
    binary_bytes: u32,
    file_bytes: u32,
}

impl Layout {
    /// Lays a file out; fails with its size in bytes if that exceeds 4 GiB.
    pub(super) fn new(geometry: &WriteGeometry) -> Result<Self, u64> {
        let origin = match fits_single_precision(geometry.positions) {
            true => DVec3::ZERO,
            false => centre(geometry.positions),
        };
        let vertices = geometry.positions.len() as u64;
        let position_bytes = 12 * vertices;
        let color_bytes = if geometry.colors.is_some() { 16 * vertices } else { 0 };
        let index_bytes = 12 * geometry.triangles.len() as u64;
        let binary_bytes = position_bytes + color_bytes + index_bytes;
        let mut json = describe(geometry, origin, [position_bytes, color_bytes, index_bytes]);
        json.extend(std::iter::repeat_n(' ', json.len().wrapping_neg() % 4));
        // A header of 12 bytes and two chunks with headers of 8.
        let bytes = 28 + json.len() as u64 + binary_bytes;
        let file_bytes = u32::try_from(bytes).map_err(|_| bytes)?;
        Ok(Self { origin, json, binary_bytes: binary_bytes as u32, file_bytes })
    }

    fn position(&self, world: DVec3) -> Vec3 {
        (world - self.origin).as_vec3()
    }
}

/// Centre of the bounding box.
fn centre(positions: &[DVec3]) -> DVec3 {
    let low = positions.iter().copied().fold(DVec3::MAX, DVec3::min);
    let high = positions.iter().copied().fold(DVec3::MIN, DVec3::max);
    low + (high - low) * 0.5
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

/// Writes header, JSON chunk and binary chunk.
pub(super) fn write(geometry: &WriteGeometry, layout: &Layout, out: &mut impl Write) -> io::Result<()> {
    out.write_all(b"glTF")?;
    out.write_all(&2u32.to_le_bytes())?;
    out.write_all(&layout.file_bytes.to_le_bytes())?;
    out.write_all(&(layout.json.len() as u32).to_le_bytes())?;
    out.write_all(b"JSON")?;
    out.write_all(layout.json.as_bytes())?;
    out.write_all(&layout.binary_bytes.to_le_bytes())?;
    out.write_all(b"BIN\0")?;
    for position in geometry.positions {
        write_floats(&layout.position(*position).to_array(), out)?;
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
