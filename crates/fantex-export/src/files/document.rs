//! glTF 2.0: one buffer with the geometry, one mesh with a primitive per material, one picture per map and page.

use std::fs::File;
use std::io::{self, BufWriter, Write};

use fantex_mesh::{AlphaMode, Material};
use glam::Vec3;
use serde_json::{Value, json};

use super::Geometry;
use crate::layout::Layout;
use crate::maps::{ChannelMap, Map};

/// Everything that the JSON text speaks of.
pub(crate) struct Document<'a> {
    /// The model's name.
    pub(crate) name: &'a str,
    pub(crate) geometry: &'a Geometry,
    pub(crate) layout: &'a Layout,
    /// The mesh's materials.
    pub(crate) materials: &'a [Material],
    pub(crate) maps: &'a [Map],
}

/// An encoded picture.
pub(crate) struct ImageFile {
    /// The name of the file beside a .gltf; the picture's name inside a .glb.
    pub(crate) name: String,
    /// Its PNG.
    pub(crate) file: File,
    /// Its length.
    pub(crate) bytes: u64,
}

/// Where pictures and buffer are.
enum Place<'a> {
    /// In the buffer of the file itself, from these offsets on.
    Inside(&'a [u64]),
    /// In files; this one is the buffer.
    Beside(&'a str),
}

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const LINEAR: u32 = 9729;
const LINEAR_MIPMAP_LINEAR: u32 = 9987;
const CLAMP_TO_EDGE: u32 = 33071;
const REPEAT: u32 = 10497;

/// Writes a binary glTF with pictures inside; fails with its size where that exceeds 4 GiB.
pub(crate) fn write_glb(
    document: &Document<'_>,
    images: &mut [ImageFile],
    out: &File,
) -> Result<io::Result<()>, u64> {
    let mut binary_bytes = document.geometry.section_bytes().iter().sum::<u64>();
    let mut offsets = Vec::with_capacity(images.len());
    for image in images.iter() {
        offsets.push(binary_bytes);
        binary_bytes += image.bytes.next_multiple_of(4);
    }
    let mut json = document.json(images, &Place::Inside(&offsets), binary_bytes).to_string();
    json.extend(std::iter::repeat_n(' ', json.len().wrapping_neg() % 4));
    // A header of 12 bytes and two chunks with headers of 8.
    let bytes = 28 + json.len() as u64 + binary_bytes;
    let file_bytes = u32::try_from(bytes).map_err(|_| bytes)?;
    let write = || {
        let mut out = BufWriter::with_capacity(1 << 20, out);
        out.write_all(b"glTF")?;
        for word in [2, file_bytes, json.len() as u32] {
            out.write_all(&word.to_le_bytes())?;
        }
        out.write_all(b"JSON")?;
        out.write_all(json.as_bytes())?;
        out.write_all(&(binary_bytes as u32).to_le_bytes())?;
        out.write_all(b"BIN\0")?;
        document.geometry.write(&mut out)?;
        for image in images {
            io::copy(&mut image.file, &mut out)?;
            out.write_all(&[0; 3][..(image.bytes.wrapping_neg() % 4) as usize])?;
        }
        out.flush()
    };
    Ok(write())
}

/// Writes a glTF text and its buffer; pictures lie beside it already.
pub(crate) fn write_gltf(
    document: &Document<'_>,
    images: &[ImageFile],
    buffer_name: &str,
    text: &File,
    buffer: &File,
) -> io::Result<()> {
    let bytes = document.geometry.section_bytes().iter().sum();
    let json = document.json(images, &Place::Beside(buffer_name), bytes);
    let mut out = BufWriter::new(text);
    serde_json::to_writer_pretty(&mut out, &json)?;
    out.write_all(b"\n")?;
    out.flush()?;
    let mut out = BufWriter::with_capacity(1 << 20, buffer);
    document.geometry.write(&mut out)?;
    out.flush()
}

impl Document<'_> {
    fn json(&self, images: &[ImageFile], place: &Place<'_>, binary_bytes: u64) -> Value {
        let (mut views, accessors, primitives) = self.geometry_json();
        let image_json: Vec<Value> = images
            .iter()
            .enumerate()
            .map(|(i, image)| match place {
                Place::Inside(offsets) => {
                    views.push(json!({ "buffer": 0, "byteOffset": offsets[i], "byteLength": image.bytes }));
                    json!({ "name": image.name, "mimeType": "image/png", "bufferView": views.len() - 1 })
                }
                Place::Beside(_) => json!({ "name": image.name, "uri": uri(&image.name) }),
            })
            .collect();
        let materials: Vec<Value> =
            self.geometry.by_material.iter().map(|(m, _)| self.material_json(*m)).collect();
        let mut used: Vec<&str> = materials
            .iter()
            .filter_map(|m| m.get("extensions")?.as_object())
            .flat_map(|e| e.keys().map(String::as_str))
            .collect();
        used.sort_unstable();
        used.dedup();
        let mut buffer = json!({ "byteLength": binary_bytes });
        if let Place::Beside(name) = place {
            buffer["uri"] = uri(name).into();
        }
        let mut node = json!({ "name": self.name, "mesh": 0 });
        if self.geometry.translation != glam::DVec3::ZERO {
            node["translation"] = json!(self.geometry.translation.to_array());
        }
        let mut document = json!({
            "asset": { "version": "2.0", "generator": "fantex" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [node],
            "meshes": [{ "name": self.name, "primitives": primitives }],
            "materials": materials,
            "buffers": [buffer],
            "bufferViews": views,
            "accessors": accessors,
        });
        if !used.is_empty() {
            document["extensionsUsed"] = json!(used);
        }
        if !images.is_empty() {
            let wrap = if self.layout.repeats { REPEAT } else { CLAMP_TO_EDGE };
            let textures: Vec<Value> =
                (0..images.len()).map(|i| json!({ "source": i, "sampler": 0 })).collect();
            document["images"] = json!(image_json);
            document["textures"] = json!(textures);
            document["samplers"] = json!([{
                "magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": wrap, "wrapT": wrap,
            }]);
        }
        document
    }

    /// Buffer views, accessors and primitives.
    fn geometry_json(&self) -> (Vec<Value>, Vec<Value>, Vec<Value>) {
        let geometry = self.geometry;
        let vertices = geometry.positions.len();
        let (low, high) = geometry
            .positions
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)));
        let names = ["POSITION", "NORMAL", "TANGENT", "TEXCOORD_0"];
        let types = ["VEC3", "VEC3", "VEC4", "VEC2"];
        let sections = geometry.section_bytes();
        let (mut views, mut accessors, mut offset) = (Vec::new(), Vec::new(), 0);
        let mut attributes = json!({});
        for (k, &bytes) in sections[..4].iter().enumerate().filter(|(_, bytes)| **bytes > 0) {
            attributes[names[k]] = accessors.len().into();
            accessors.push(json!({
                "bufferView": views.len(), "componentType": FLOAT, "count": vertices, "type": types[k],
            }));
            views.push(json!({
                "buffer": 0, "byteOffset": offset, "byteLength": bytes, "target": ARRAY_BUFFER,
            }));
            offset += bytes;
        }
        accessors[0]["min"] = json!(low.to_array());
        accessors[0]["max"] = json!(high.to_array());
        let index_view = views.len();
        views.push(json!({
            "buffer": 0, "byteOffset": offset, "byteLength": sections[4], "target": ELEMENT_ARRAY_BUFFER,
        }));
        let (mut primitives, mut first) = (Vec::new(), 0);
        for (material, (_, triangles)) in geometry.by_material.iter().enumerate() {
            primitives.push(json!({
                "attributes": attributes, "indices": accessors.len(), "material": material, "mode": 4,
            }));
            accessors.push(json!({
                "bufferView": index_view, "byteOffset": 12 * first, "componentType": UNSIGNED_INT,
                "count": 3 * triangles.len(), "type": "SCALAR",
            }));
            first += triangles.len();
        }
        (views, accessors, primitives)
    }

    /// A material: pictures where the asset has a channel, its factors elsewhere.
    fn material_json(&self, index: usize) -> Value {
        let default_material = Material::default();
        let material = self.materials.get(index).unwrap_or(&default_material);
        let page = self.layout.page_of_material.get(index).copied().flatten().unwrap_or(0);
        let texture = |kind: ChannelMap| {
            let map = self.maps.iter().position(|m| m.kind == kind)?;
            Some(json!({ "index": page * self.maps.len() + map }))
        };
        let orm = texture(ChannelMap::OcclusionRoughnessMetallic);
        let mut pbr = match &orm {
            Some(orm) => json!({ "metallicRoughnessTexture": orm }),
            None => json!({
                "metallicFactor": material.metallic.clamp(0.0, 1.0),
                "roughnessFactor": material.roughness.clamp(0.0, 1.0),
            }),
        };
        match texture(ChannelMap::BaseColor) {
            Some(texture) => pbr["baseColorTexture"] = texture,
            None => {
                let color = material.base_color.clamp(glam::Vec4::ZERO, glam::Vec4::ONE);
                pbr["baseColorFactor"] = json!(color.to_array());
            }
        }
        let mut value = json!({ "pbrMetallicRoughness": pbr, "doubleSided": material.double_sided });
        if !material.name.is_empty() {
            value["name"] = material.name.as_str().into();
        }
        if let Some(orm) = orm {
            value["occlusionTexture"] = orm;
        }
        if let Some(normal) = texture(ChannelMap::Normal) {
            value["normalTexture"] = normal;
        }
        let emission = self.maps.iter().find(|m| m.kind == ChannelMap::Emission);
        let light = emission.map_or(material.emission, |map| Vec3::splat(map.scale)).max(Vec3::ZERO);
        let strength = light.max_element().max(1.0);
        if light != Vec3::ZERO {
            value["emissiveFactor"] = json!((light / strength).to_array());
        }
        if let Some(texture) = texture(ChannelMap::Emission) {
            value["emissiveTexture"] = texture;
        }
        match material.alpha {
            AlphaMode::Opaque => {}
            AlphaMode::Mask(cutoff) => {
                value["alphaMode"] = "MASK".into();
                value["alphaCutoff"] = cutoff.max(0.0).into();
            }
            AlphaMode::Blend => value["alphaMode"] = "BLEND".into(),
        }
        let mut extensions = json!({});
        if strength > 1.0 {
            extensions["KHR_materials_emissive_strength"] = json!({ "emissiveStrength": strength });
        }
        if material.unlit {
            extensions["KHR_materials_unlit"] = json!({});
        }
        if extensions.as_object().is_some_and(|e| !e.is_empty()) {
            value["extensions"] = extensions;
        }
        value
    }
}

/// A file's name as a relative URI: all but unreserved characters as escaped bytes.
fn uri(name: &str) -> String {
    let mut uri = String::with_capacity(name.len());
    for byte in name.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            uri.push(char::from(byte));
        } else {
            uri.push_str(&format!("%{byte:02X}"));
        }
    }
    uri
}

#[cfg(test)]
mod tests {
    #[test]
    fn names_become_uris() {
        assert_eq!(super::uri("a b#1-\u{e9}.png"), "a%20b%231-%C3%A9.png");
    }
}
