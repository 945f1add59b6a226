//! The files that are written.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::io::{BufWriter, Seek, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use fantex_base::files::{exists, folder_of, persist_all, temporary_file};
use fantex_base::{Error, Result, uri_escaped};
use fantex_mesh::{AlphaMode, GlbHeader, Material, Mesh};
use glam::{DVec3, Vec2, Vec3, Vec4};
use serde_json::{Value, json};
use tempfile::TempPath;

use crate::export::{ChannelMap, Map};
use crate::vertex_copies::VertexCopies;

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

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const LINEAR: u32 = 9729;
const LINEAR_MIPMAP_LINEAR: u32 = 9987;
const CLAMP_TO_EDGE: u32 = 33071;
const REPEAT: u32 = 10497;

/// A model on its way: what was added so far, as JSON, and the bytes of its buffer.
pub(crate) struct Gltf {
    output: PathBuf,
    stem: String,
    /// Pictures are inside; else they and the buffer lie beside it.
    is_binary: bool,
    /// With a name, what is added are objects, children of a node of this name; else the parts of one asset.
    root: Option<String>,
    /// Of a `.glb` an unnamed file. Made with the first asset.
    buffer: Option<BufWriter<File>>,
    buffer_bytes: u64,
    top_nodes: Vec<usize>,
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    images: Vec<Value>,
    /// One for each picture.
    textures: Vec<Value>,
    /// How coordinates wrap, one for each sampler.
    wraps: Vec<u32>,
}

impl Gltf {
    /// Nothing yet; none where the output is neither `.glb` nor `.gltf`. With `root`, each asset that is added becomes a child of a node of
    /// that name.
    pub(crate) fn new(output: &Path, root: Option<&str>) -> Option<Self> {
        let is_binary = match extension(output).as_str() {
            "glb" => true,
            "gltf" => false,
            _ => return None,
        };
        Some(Self {
            output: output.to_owned(),
            stem: stem_of(output),
            is_binary,
            root: root.map(str::to_owned),
            buffer: None,
            buffer_bytes: 0,
            top_nodes: Vec::new(),
            nodes: Vec::new(),
            meshes: Vec::new(),
            materials: Vec::new(),
            views: Vec::new(),
            accessors: Vec::new(),
            images: Vec::new(),
            textures: Vec::new(),
            wraps: Vec::new(),
        })
    }

    pub(crate) fn is_binary(&self) -> bool {
        self.is_binary
    }

    /// Adds an asset. Its pictures are written already: each has the name of its file beside a .gltf, without an extension, or goes into a
    /// .glb.
    ///
    /// # Errors
    /// It cannot be written, or what was added exceeds what a `.glb` holds.
    pub(crate) fn add(
        &mut self,
        document: &Document<'_>,
        images: Vec<(String, Option<File>)>,
        outputs: &mut Outputs,
    ) -> Result<()> {
        let mut buffer = self.take_buffer(outputs)?;
        let first_picture = self.images.len();
        self.add_nodes(document);
        let looks = document.geometry.looks().into_iter();
        let materials = looks.map(|(material, page)| document.material_json(material, page, first_picture));
        self.materials.extend(materials);
        self.buffer_bytes += document.geometry.byte_count();
        let written = document.geometry.write(&mut buffer);
        written
            .and_then(|()| self.add_images(images, document.repeats, &mut buffer))
            .map_err(|source| Error::writing(&self.output, source))?;
        self.buffer = Some(buffer);
        match self.is_binary && self.buffer_bytes > u64::from(u32::MAX) {
            true => Err(self.too_large(self.buffer_bytes)),
            false => Ok(()),
        }
    }

    /// Writes what is left: of a `.glb` all, else the text.
    ///
    /// # Errors
    /// It cannot be written, or is larger than a `.glb` may be.
    pub(crate) fn finish(mut self, outputs: &mut Outputs) -> Result<()> {
        if let Some(root) = self.root.take() {
            self.nodes.push(json!({ "name": root, "children": self.top_nodes }));
            self.top_nodes = vec![self.nodes.len() - 1];
        }
        let buffer = self.take_buffer(outputs)?;
        let failed = |source| Error::writing(&self.output, source);
        let mut buffer = buffer.into_inner().map_err(|error| failed(error.into_error()))?;
        let json = self.json();
        let file = outputs.create(&self.output)?;
        let mut out = BufWriter::with_capacity(1 << 20, file);
        if !self.is_binary {
            let written = serde_json::to_writer_pretty(&mut out, &json).map_err(io::Error::from);
            return written.and_then(|()| out.write_all(b"\n")).and_then(|()| out.flush()).map_err(failed);
        }
        let header = GlbHeader::new(json.to_string(), self.buffer_bytes);
        let header = header.map_err(|bytes| self.too_large(bytes))?;
        let mut write = || {
            header.write(&mut out)?;
            buffer.rewind()?;
            io::copy(&mut buffer, &mut out)?;
            out.flush()
        };
        write().map_err(failed)
    }

    fn too_large(&self, bytes: u64) -> Error {
        let path = self.output.display();
        let message =
            format!("{path} would take {bytes} bytes or more, but a GLB file holds 4 GiB; write a .gltf");
        Error::too_large(message).with_path(&self.output)
    }

    /// The buffer, which is made where there is none.
    fn take_buffer(&mut self, outputs: &mut Outputs) -> Result<BufWriter<File>> {
        if let Some(buffer) = self.buffer.take() {
            return Ok(buffer);
        }
        let file = match self.buffer_file() {
            Some(path) => outputs.create(&path)?,
            None => tempfile::tempfile_in(folder_of(&self.output))
                .map_err(|source| Error::writing(&self.output, source))?,
        };
        Ok(BufWriter::with_capacity(1 << 20, file))
    }

    /// The file of the buffer; none of a `.glb`, which holds it.
    pub(crate) fn buffer_file(&self) -> Option<PathBuf> {
        (!self.is_binary).then(|| self.output.with_file_name(self.buffer_name()))
    }

    fn buffer_name(&self) -> String {
        format!("{}.bin", self.stem)
    }

    /// Pictures inside go into the buffer, those beside the model are named.
    fn add_images(
        &mut self,
        images: Vec<(String, Option<File>)>,
        repeats: bool,
        buffer: &mut BufWriter<File>,
    ) -> io::Result<()> {
        let wrap = if repeats { REPEAT } else { CLAMP_TO_EDGE };
        for (name, inside) in images {
            let sampler = self.wraps.iter().position(|&known| known == wrap).unwrap_or(self.wraps.len());
            if sampler == self.wraps.len() {
                self.wraps.push(wrap);
            }
            self.textures.push(json!({ "source": self.images.len(), "sampler": sampler }));
            let Some(mut file) = inside else {
                let name = format!("{name}.png");
                self.images.push(json!({ "name": name, "uri": uri_escaped(&name) }));
                continue;
            };
            let bytes = file.metadata()?.len();
            self.images
                .push(json!({ "name": name, "mimeType": "image/png", "bufferView": self.views.len() }));
            self.views.push(json!({ "buffer": 0, "byteOffset": self.buffer_bytes, "byteLength": bytes }));
            file.rewind()?;
            io::copy(&mut file, buffer)?;
            buffer.write_all(&[0; 3][..(bytes.wrapping_neg() % 4) as usize])?;
            self.buffer_bytes += bytes.next_multiple_of(4);
        }
        Ok(())
    }

    /// A node and a mesh for each part. An object of several parts has a node above theirs.
    fn add_nodes(&mut self, document: &Document<'_>) {
        let primitives = self.add_geometry(document);
        let parts: Vec<&[(usize, Value)]> = primitives.chunk_by(|a, b| a.0 == b.0).collect();
        let translation =
            Some(document.geometry.translation).filter(|&t| t != DVec3::ZERO).map(|t| t.to_array());
        let is_object = self.root.is_some();
        let is_group = is_object && parts.len() != 1;
        if is_group {
            let children: Vec<usize> = (1..=parts.len()).map(|part| self.nodes.len() + part).collect();
            self.top_nodes.push(self.nodes.len());
            self.nodes.push(object(json!({
                "name": document.name, "translation": translation, "children": children,
            })));
        }
        for part in parts {
            let own_name = document.parts.get(part[0].0).filter(|name| !name.is_empty());
            let name = own_name.map_or(document.name, |name| name);
            if !is_group {
                self.top_nodes.push(self.nodes.len());
            }
            self.nodes.push(object(json!({
                "name": if is_object && !is_group { document.name } else { name },
                "mesh": self.meshes.len(),
                "translation": translation.filter(|_| !is_group),
            })));
            let primitives: Vec<&Value> = part.iter().map(|(_, primitive)| primitive).collect();
            let extras = document.delta.map(|delta| json!({ "fantexDelta": delta }));
            self.meshes.push(object(json!({ "name": name, "primitives": primitives, "extras": extras })));
        }
    }

    /// Adds views and accessors; returns primitives with their parts. The geometry is what comes next in the buffer, and its materials are
    /// those that come next.
    fn add_geometry(&mut self, document: &Document<'_>) -> Vec<(usize, Value)> {
        let geometry = document.geometry;
        let (first_view, mut offset) = (self.views.len(), self.buffer_bytes);
        let attributes = geometry.attributes();
        for (_, _, stride) in &attributes {
            let bytes = stride * geometry.positions.len() as u64;
            self.views.push(json!({
                "buffer": 0, "byteOffset": offset, "byteLength": bytes, "byteStride": stride, "target": ARRAY_BUFFER,
            }));
            offset += bytes;
        }
        let index_view = self.views.len();
        self.views.push(json!({
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
            let start = self.accessors.len();
            let mut own = json!({});
            for (view, (name, kind, stride)) in attributes.iter().enumerate() {
                own[name] = self.accessors.len().into();
                self.accessors.push(json!({
                    "bufferView": first_view + view, "byteOffset": stride * vertices.start as u64, "componentType": FLOAT,
                    "count": vertices.len(), "type": kind,
                }));
            }
            self.accessors[start]["min"] = json!(low.to_array());
            self.accessors[start]["max"] = json!(high.to_array());
            let primitive = json!({
                "attributes": own, "indices": self.accessors.len(), "material": self.materials.len() + look, "mode": 4,
            });
            primitives.push((*part, primitive));
            self.accessors.push(json!({
                "bufferView": index_view, "byteOffset": 12 * first, "componentType": UNSIGNED_INT,
                "count": 3 * triangles.len(), "type": "SCALAR",
            }));
            first += triangles.len();
        }
        primitives
    }

    fn json(&self) -> Value {
        let mut used: Vec<&str> = self
            .materials
            .iter()
            .filter_map(|m| m.get("extensions")?.as_object())
            .flat_map(|e| e.keys().map(String::as_str))
            .collect();
        used.sort_unstable();
        used.dedup();
        let buffer_uri = (!self.is_binary).then(|| uri_escaped(&self.buffer_name()));
        let sampler = |wrap: &u32| {
            let (near, far) = (LINEAR, LINEAR_MIPMAP_LINEAR);
            json!({ "magFilter": near, "minFilter": far, "wrapS": wrap, "wrapT": wrap })
        };
        let has_images = !self.images.is_empty();
        object(json!({
            "asset": { "version": "2.0", "generator": "fantex" },
            "scene": 0,
            "scenes": [{ "nodes": self.top_nodes }],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "buffers": [object(json!({ "byteLength": self.buffer_bytes, "uri": buffer_uri }))],
            "bufferViews": self.views,
            "accessors": self.accessors,
            "extensionsUsed": (!used.is_empty()).then_some(used),
            "images": has_images.then_some(&self.images),
            "textures": has_images.then_some(&self.textures),
            "samplers": has_images.then(|| self.wraps.iter().map(sampler).collect::<Vec<_>>()),
        }))
    }
}

/// The name of a model without folder and extension.
pub(crate) fn stem_of(output: &Path) -> String {
    output.file_stem().map_or_else(|| "model".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// In lower case.
pub(crate) fn extension(path: &Path) -> String {
    path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

impl Document<'_> {
    /// A material with the pictures of a page: these where the asset has a channel, its factors elsewhere. `first_picture` is the asset's first
    /// among all pictures of the file.
    fn material_json(&self, material: usize, page: usize, first_picture: usize) -> Value {
        let default_material = Material::default();
        let material = self.materials.get(material).unwrap_or(&default_material);
        let texture = |kind: ChannelMap| {
            let map = self.maps.iter().position(|m| m.kind == kind)?;
            Some(json!({ "index": first_picture + page * self.maps.len() + map }))
        };
        let normal = texture(ChannelMap::Normal);
        // Normals are in object space, so no program that knows no fans may take them for its own; for light that arrives glTF has no place.
        let extras = self.delta.map(|delta| {
            let picture = |texture: &Option<Value>| texture.as_ref().map(|texture| texture["index"].clone());
            object(json!({
                "fantexDelta": delta,
                "fantexObjectNormalTexture": picture(&normal),
                "fantexLightTexture": picture(&texture(ChannelMap::Light)),
            }))
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
        // Unlit materials show their colour alone, so their extension excludes the other one.
        let is_bright = strength > 1.0 && !material.unlit;
        let extensions = object(json!({
            "KHR_materials_emissive_strength": is_bright.then(|| json!({ "emissiveStrength": strength })),
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
    /// World units.
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

/// What positions are relative to: nothing where single precision holds the world's coordinates exactly, else the origin of the mesh space.
/// Objects of a world always take the latter: so sectors of one asset, whose mesh space is the same, get equal positions where they meet.
pub(crate) fn translation_of(mesh: &Mesh, is_object: bool) -> DVec3 {
    let is_exact = |p: &Vec3| {
        let world = mesh.world_from_mesh.point(*p);
        world.as_vec3().as_dvec3() == world
    };
    match !is_object && mesh.positions.iter().all(is_exact) {
        true => DVec3::ZERO,
        false => mesh.world_from_mesh.offset,
    }
}

impl Geometry {
    /// `normals` has an entry per corner; `tangents` too, or is empty. `uv` gives a corner's coordinates in each set, `page` a triangle's
    /// pictures. Positions are relative to `translation`, world units.
    pub(crate) fn new<const SETS: usize>(
        mesh: &Mesh,
        translation: DVec3,
        normals: &[Vec3],
        tangents: &[Vec4],
        uv: impl Fn(usize) -> [Vec2; SETS],
        page: impl Fn(usize) -> usize,
    ) -> Self {
        let world = |v: usize| mesh.world_from_mesh.point(mesh.positions[v]);
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
        let mut copies = VertexCopies::new(mesh.positions.len());
        let mut by_kind: BTreeMap<(usize, usize, usize), Vec<usize>> = BTreeMap::new();
        for t in 0..mesh.triangles.len() {
            by_kind.entry((mesh.parts.of(t), mesh.material_of(t), page(t))).or_default().push(t);
        }
        for ((part, material, page), own) in by_kind {
            let start = geometry.positions.len();
            copies.restart();
            let mut vertex = |corner: usize| {
                let v = mesh.triangles[corner / 3][corner % 3];
                let (copy, is_new) = copies.find_or_add(v, attributes(corner));
                if is_new {
                    geometry.positions.push((world(v as usize) - translation).as_vec3());
                    geometry.normals.push(normals[corner]);
                    geometry.tangents.extend(tangents.get(corner));
                    geometry.uv.iter_mut().zip(uv(corner)).for_each(|(set, uv)| set.push(uv));
                }
                copy
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
    files: Vec<(TempPath, PathBuf)>,
}

impl Outputs {
    /// Nothing yet. With `force`, files that exist are replaced.
    pub(crate) fn new(force: bool) -> Self {
        Self { force, files: Vec::new() }
    }

    /// Refuses what exists and is not to be replaced.
    pub(crate) fn check(&self, path: &Path) -> Result<()> {
        match !self.force && path.symlink_metadata().is_ok() {
            true => Err(exists(path)),
            false => Ok(()),
        }
    }

    /// A file that will be `path`, open for writing.
    pub(crate) fn create(&mut self, path: &Path) -> Result<File> {
        self.check(path)?;
        let failed = |source| Error::writing(path, source);
        let suffix = path.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
        let (file, temporary) = temporary_file(path, &suffix).map_err(failed)?.into_parts();
        self.files.push((temporary, path.into()));
        Ok(file)
    }

    /// Makes all files durable, then gives them their names, in the order in which they were made. Returns these with
    /// lengths in bytes.
    pub(crate) fn commit(self) -> Result<Vec<(PathBuf, u64)>> {
        // By name: a writer may have put another file there.
        let length = |(file, path): &(TempPath, PathBuf)| {
            let found = std::fs::metadata(file).map_err(|source| Error::writing(path, source))?;
            Ok((path.clone(), found.len()))
        };
        let written = self.files.iter().map(length).collect::<Result<_>>()?;
        persist_all(self.files, self.force)?;
        Ok(written)
    }
}
