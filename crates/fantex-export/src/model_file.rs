//! The files that are written.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::File;
use std::io;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use fantex_base::files::{exists, persist_all, temporary_file};
use fantex_base::{Error, Result};
use fantex_mesh::{AlphaMode, GlbHeader, Material, Mesh};
use glam::{DVec3, Vec2, Vec3, Vec4};
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
use serde_json::{Value, json};
use tempfile::NamedTempFile;

use crate::export::{ChannelMap, Map};

// ---- glTF 2.0: one buffer with the geometry, a mesh per part with a primitive per material, one picture per map and page.

pub(crate) struct Document<'a> {
    pub(crate) name: &'a str,
    /// Names of the parts; without any there is one of the name above.
    pub(crate) parts: &'a [String],
    pub(crate) geometry: &'a Geometry,
    pub(crate) materials: &'a [Material],
    /// What the pictures of each page show, in their order.
    pub(crate) maps: &'a [Map],
    /// Whether coordinates leave 0..1.
    pub(crate) repeats: bool,
    /// The width of the blend band where coordinates are those of fans. Normals are in object space then, which glTF has no place for.
    pub(crate) delta: Option<f32>,
}

pub(crate) struct ImageFile {
    /// The name of the file beside a .gltf; the picture's name inside a .glb.
    pub(crate) name: String,
    pub(crate) file: File,
    pub(crate) bytes: u64,
}

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
    let mut binary_bytes = document.geometry.byte_count();
    let mut offsets = Vec::with_capacity(images.len());
    for image in images.iter() {
        offsets.push(binary_bytes);
        binary_bytes += image.bytes.next_multiple_of(4);
    }
    let json = document.json(images, &Place::Inside(&offsets), binary_bytes).to_string();
    let header = GlbHeader::new(json, binary_bytes)?;
    let write = || {
        let mut out = BufWriter::with_capacity(1 << 20, out);
        header.write(&mut out)?;
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
    let bytes = document.geometry.byte_count();
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
        let materials: Vec<Value> = self
            .geometry
            .looks()
            .into_iter()
            .map(|(material, page)| self.material_json(material, page))
            .collect();
        let mut used: Vec<&str> = materials
            .iter()
            .filter_map(|m| m.get("extensions")?.as_object())
            .flat_map(|e| e.keys().map(String::as_str))
            .collect();
        used.sort_unstable();
        used.dedup();
        let buffer_uri = match place {
            Place::Inside(_) => None,
            Place::Beside(name) => Some(uri(name)),
        };
        let translation = Some(self.geometry.translation).filter(|&t| t != DVec3::ZERO).map(|t| t.to_array());
        // A node and a mesh for each part.
        let parts: Vec<&[(usize, Value)]> = primitives.chunk_by(|a, b| a.0 == b.0).collect();
        let name =
            |part: usize| self.parts.get(part).filter(|name| !name.is_empty()).map_or(self.name, |name| name);
        let node = |(mesh, part): (usize, &&[(usize, Value)])| {
            object(json!({ "name": name(part[0].0), "mesh": mesh, "translation": translation }))
        };
        let nodes: Vec<Value> = parts.iter().enumerate().map(node).collect();
        let mesh = |part: &&[(usize, Value)]| {
            let primitives: Vec<&Value> = part.iter().map(|(_, primitive)| primitive).collect();
            let extras = self.delta.map(|delta| json!({ "fantexDelta": delta }));
            object(json!({ "name": name(part[0].0), "primitives": primitives, "extras": extras }))
        };
        let wrap = if self.repeats { REPEAT } else { CLAMP_TO_EDGE };
        let texture = |source: usize| json!({ "source": source, "sampler": 0 });
        let sampler = json!({
            "magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": wrap, "wrapT": wrap,
        });
        let has_images = !images.is_empty();
        object(json!({
            "asset": { "version": "2.0", "generator": "fantex" },
            "scene": 0,
            "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
            "nodes": nodes,
            "meshes": parts.iter().map(mesh).collect::<Vec<_>>(),
            "materials": materials,
            "buffers": [object(json!({ "byteLength": binary_bytes, "uri": buffer_uri }))],
            "bufferViews": views,
            "accessors": accessors,
            "extensionsUsed": (!used.is_empty()).then_some(used),
            "images": has_images.then_some(image_json),
            "textures": has_images.then(|| (0..images.len()).map(texture).collect::<Vec<_>>()),
            "samplers": has_images.then_some([sampler]),
        }))
    }

    /// Views, accessors, and primitives with their parts.
    fn geometry_json(&self) -> (Vec<Value>, Vec<Value>, Vec<(usize, Value)>) {
        let geometry = self.geometry;
        let (mut views, mut accessors, mut offset) = (Vec::new(), Vec::new(), 0);
        let attributes = geometry.attributes();
        for (_, _, stride) in &attributes {
            let bytes = stride * geometry.positions.len() as u64;
            views.push(json!({
                "buffer": 0, "byteOffset": offset, "byteLength": bytes, "byteStride": stride, "target": ARRAY_BUFFER,
            }));
            offset += bytes;
        }
        let index_view = views.len();
        views.push(json!({
            "buffer": 0, "byteOffset": offset, "byteLength": 12 * geometry.triangle_count(), "target": ELEMENT_ARRAY_BUFFER,
        }));
        let (mut primitives, mut first) = (Vec::new(), 0);
        let looks = geometry.looks();
        for Primitive { part, material, page, vertices, triangles } in &geometry.primitives {
            let look = looks.binary_search(&(*material, *page)).unwrap_or_default();
            let positions = &geometry.positions[vertices.clone()];
            let (low, high) = positions
                .iter()
                .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)));
            let start = accessors.len();
            let mut own = json!({});
            for (view, (name, kind, stride)) in attributes.iter().enumerate() {
                own[name] = accessors.len().into();
                accessors.push(json!({
                    "bufferView": view, "byteOffset": stride * vertices.start as u64, "componentType": FLOAT,
                    "count": vertices.len(), "type": kind,
                }));
            }
            accessors[start]["min"] = json!(low.to_array());
            accessors[start]["max"] = json!(high.to_array());
            let primitive = json!({
                "attributes": own, "indices": accessors.len(), "material": look, "mode": 4,
            });
            primitives.push((*part, primitive));
            accessors.push(json!({
                "bufferView": index_view, "byteOffset": 12 * first, "componentType": UNSIGNED_INT,
                "count": 3 * triangles.len(), "type": "SCALAR",
            }));
            first += triangles.len();
        }
        (views, accessors, primitives)
    }

    /// A material with the pictures of a page: these where the asset has a channel, its factors elsewhere.
    fn material_json(&self, material: usize, page: usize) -> Value {
        let default_material = Material::default();
        let material = self.materials.get(material).unwrap_or(&default_material);
        let texture = |kind: ChannelMap| {
            let map = self.maps.iter().position(|m| m.kind == kind)?;
            Some(json!({ "index": page * self.maps.len() + map }))
        };
        let normal = texture(ChannelMap::Normal);
        // In object space, so no program that knows no fans may take them for its own.
        let extras = self.delta.map(|delta| {
            let picture = normal.as_ref().map(|texture| texture["index"].clone());
            object(json!({ "fantexDelta": delta, "fantexObjectNormalTexture": picture }))
        });
        let (orm, color) = (texture(ChannelMap::OcclusionRoughnessMetallic), texture(ChannelMap::BaseColor));
        let factor = |factor: f32| orm.is_none().then(|| factor.clamp(0.0, 1.0));
        let base_color = material.base_color.clamp(Vec4::ZERO, Vec4::ONE);
        let emission = self.maps.iter().find(|m| m.kind == ChannelMap::Emission);
        let light = emission.map_or(material.emission, |map| Vec3::splat(map.scale)).max(Vec3::ZERO);
        let strength = light.max_element().max(1.0);
        let (alpha_mode, cutoff) = match material.alpha {
            AlphaMode::Opaque => (None, None),
            AlphaMode::Mask(cutoff) => (Some("MASK"), Some(cutoff.max(0.0))),
            AlphaMode::Blend => (Some("BLEND"), None),
        };
        let extensions = object(json!({
            "KHR_materials_emissive_strength":
                (strength > 1.0).then(|| json!({ "emissiveStrength": strength })),
            "KHR_materials_unlit": material.unlit.then(|| json!({})),
        }));
        object(json!({
            "pbrMetallicRoughness": object(json!({
                "metallicRoughnessTexture": orm,
                "metallicFactor": factor(material.metallic),
                "roughnessFactor": factor(material.roughness),
                "baseColorFactor": color.is_none().then(|| base_color.to_array()),
                "baseColorTexture": color,
            })),
            "doubleSided": material.double_sided,
            "name": (!material.name.is_empty()).then_some(&material.name),
            "occlusionTexture": orm,
            "normalTexture": normal.filter(|_| self.delta.is_none()),
            "emissiveFactor": (light != Vec3::ZERO).then(|| (light / strength).to_array()),
            "emissiveTexture": texture(ChannelMap::Emission),
            "alphaMode": alpha_mode,
            "alphaCutoff": cutoff,
            "extensions": extensions.as_object().filter(|e| !e.is_empty()),
            "extras": extras,
        }))
    }
}

/// A JSON object without the members that are null.
fn object(mut value: Value) -> Value {
    if let Value::Object(members) = &mut value {
        members.retain(|_, member| !member.is_null());
    }
    value
}

/// Bytes of a name that a URI must escape: all but unreserved characters.
const ESCAPED: AsciiSet = NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');

fn uri(name: &str) -> String {
    utf8_percent_encode(name, &ESCAPED).to_string()
}

// ---- Vertices as files want them: one index for position, normal, tangent and all coordinates.

/// The mesh with its coordinates, split where attributes differ.
#[derive(Clone, Debug, Default)]
pub(crate) struct Geometry {
    /// World units, relative to `translation`.
    pub(crate) positions: Vec<Vec3>,
    /// Unit.
    pub(crate) normals: Vec<Vec3>,
    /// Unit, handedness in w; empty where none are needed.
    pub(crate) tangents: Vec<Vec4>,
    /// Sets of texture coordinates, origin top left.
    pub(crate) uv: Vec<Vec<Vec2>>,
    /// One for each material and page of each part that has triangles, by part. Their vertices follow one another.
    pub(crate) primitives: Vec<Primitive>,
    /// Zero unless single precision is too coarse for the world's coordinates.
    pub(crate) translation: DVec3,
}

/// What has one material and one page of pictures in one part.
#[derive(Clone, Debug)]
pub(crate) struct Primitive {
    pub(crate) part: usize,
    pub(crate) material: usize,
    pub(crate) page: usize,
    pub(crate) vertices: Range<usize>,
    /// Counter-clockwise seen from outside; relative to the first vertex.
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Geometry {
    /// `normals` has an entry per corner; `tangents` too, or is empty. `uv` gives a corner's coordinates in each set, `page` a triangle's
    /// pictures.
    pub(crate) fn new<const SETS: usize>(
        mesh: &Mesh,
        normals: &[Vec3],
        tangents: &[Vec4],
        uv: impl Fn(usize) -> [Vec2; SETS],
        page: impl Fn(usize) -> usize,
    ) -> Self {
        let world = |v: usize| mesh.world_from_mesh.point(mesh.positions[v]);
        let is_exact = (0..mesh.positions.len()).all(|v| world(v).as_vec3().as_dvec3() == world(v));
        let translation = if is_exact { DVec3::ZERO } else { mesh.world_from_mesh.offset };
        let mut geometry = Self { translation, uv: vec![Vec::new(); SETS], ..Self::default() };
        let attributes = |corner: usize| {
            let tangent = tangents.get(corner).copied().unwrap_or_default();
            let normal = normals[corner].to_array().map(f32::to_bits);
            (
                normal,
                tangent.to_array().map(f32::to_bits),
                uv(corner).map(|uv| uv.to_array().map(f32::to_bits)),
            )
        };
        let mut by_kind: BTreeMap<(usize, usize, usize), Vec<usize>> = BTreeMap::new();
        for t in 0..mesh.triangles.len() {
            by_kind.entry((mesh.parts.of(t), mesh.material_of(t), page(t))).or_default().push(t);
        }
        for ((part, material, page), own) in by_kind {
            let start = geometry.positions.len();
            let mut known = HashMap::new();
            let mut vertex = |corner: usize| {
                let v = mesh.triangles[corner / 3][corner % 3];
                *known.entry((v, attributes(corner))).or_insert_with(|| {
                    geometry.positions.push((world(v as usize) - translation).as_vec3());
                    geometry.normals.push(normals[corner]);
                    geometry.tangents.extend(tangents.get(corner));
                    geometry.uv.iter_mut().zip(uv(corner)).for_each(|(set, uv)| set.push(uv));
                    (geometry.positions.len() - 1 - start) as u32
                })
            };
            let triangles = own.into_iter().map(|t| [0, 1, 2].map(|k| vertex(3 * t + k))).collect();
            let vertices = start..geometry.positions.len();
            geometry.primitives.push(Primitive { part, material, page, vertices, triangles });
        }
        geometry
    }

    /// Materials and pages that have triangles together, ascending.
    pub(crate) fn looks(&self) -> Vec<(usize, usize)> {
        let used: BTreeSet<_> = self.primitives.iter().map(|p| (p.material, p.page)).collect();
        used.into_iter().collect()
    }

    pub(crate) fn triangle_count(&self) -> u64 {
        self.primitives.iter().map(|primitive| primitive.triangles.len() as u64).sum()
    }

    /// Name, type and bytes per vertex of each section of the binary buffer, in order; indices follow. None is empty.
    fn attributes(&self) -> Vec<(String, &'static str, u64)> {
        let mut attributes = vec![("POSITION".to_owned(), "VEC3", 12), ("NORMAL".to_owned(), "VEC3", 12)];
        if !self.tangents.is_empty() {
            attributes.push(("TANGENT".to_owned(), "VEC4", 16));
        }
        attributes.extend((0..self.uv.len()).map(|set| (format!("TEXCOORD_{set}"), "VEC2", 8)));
        attributes
    }

    /// Bytes of the binary buffer.
    fn byte_count(&self) -> u64 {
        let per_vertex: u64 = self.attributes().iter().map(|(_, _, stride)| stride).sum();
        per_vertex * self.positions.len() as u64 + 12 * self.triangle_count()
    }

    pub(crate) fn write(&self, out: &mut impl std::io::Write) -> std::io::Result<()> {
        write_floats(self.positions.iter().map(Vec3::to_array), out)?;
        write_floats(self.normals.iter().map(Vec3::to_array), out)?;
        write_floats(self.tangents.iter().map(Vec4::to_array), out)?;
        self.uv.iter().try_for_each(|set| write_floats(set.iter().map(Vec2::to_array), out))?;
        let indices = self.primitives.iter().flat_map(|primitive| primitive.triangles.as_flattened());
        indices.copied().try_for_each(|i| out.write_all(&i.to_le_bytes()))
    }
}

fn write_floats<const N: usize>(
    vectors: impl Iterator<Item = [f32; N]>,
    out: &mut impl std::io::Write,
) -> std::io::Result<()> {
    vectors.flatten().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}

// ---- Files that appear together, whole, or not at all.

/// Files under temporary names beside their places. Dropping them removes them.
#[derive(Debug)]
pub(crate) struct Outputs {
    force: bool,
    files: Vec<(NamedTempFile, PathBuf)>,
}

impl Outputs {
    /// Nothing yet. With `force`, files that exist are replaced.
    pub(crate) fn new(force: bool) -> Self {
        Self { force, files: Vec::new() }
    }

    /// A file that will be `path`, open for writing, and its temporary path.
    pub(crate) fn create(&mut self, path: &Path) -> Result<(File, PathBuf)> {
        let failed = |source| Error::writing(path, source);
        if !self.force && path.symlink_metadata().is_ok() {
            return Err(exists(path));
        }
        let suffix = path.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
        let file = temporary_file(path, &suffix).map_err(failed)?;
        let opened = (file.as_file().try_clone().map_err(failed)?, file.path().to_owned());
        self.files.push((file, path.into()));
        Ok(opened)
    }

    /// Makes all files durable, then gives them their names, in the order in which they were made. Returns these with
    /// lengths in bytes.
    pub(crate) fn commit(self) -> Result<Vec<(PathBuf, u64)>> {
        // By name: a writer may have put another file there.
        let length = |(file, path): &(NamedTempFile, PathBuf)| {
            let found = std::fs::metadata(file.path()).map_err(|source| Error::writing(path, source))?;
            Ok((path.clone(), found.len()))
        };
        let written = self.files.iter().map(length).collect::<Result<_>>()?;
        let files = self.files.into_iter().map(|(file, path)| (file.into_temp_path(), path));
        persist_all(files.collect(), self.force)?;
        Ok(written)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_uris() {
        assert_eq!(uri("a b#1-\u{e9}.png"), "a%20b%231-%C3%A9.png");
    }
}
