//! glTF 2.0 and GLB (Khronos Group, "glTF 2.0 Specification", 2021).
//!
//! ```text
//!  container --> JSON --schema--> Root --+--> buffers --> accessors --+
//!                                        +--> nodes (world transforms) +--> primitives (pose) --> Model
//!                                        +--> materials, images -------+
//! ```
//!
//! Extensions that are read: KHR_mesh_quantization, KHR_draco_mesh_compression, EXT_meshopt_compression and
//! KHR_meshopt_compression, KHR_texture_transform, KHR_materials_unlit, KHR_materials_emissive_strength, EXT_texture_webp, KHR_texture_basisu,
//! EXT_mesh_gpu_instancing. Other material extensions and
//! lights are noted and ignored; any other extension that a file *requires* makes it unreadable.

mod data;
mod draco;
mod meshopt;
mod pose;
mod schema;

use std::cell::OnceCell;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use data::{Buffers, NO_DATA, Reader, Target, resolve};
use draco::Unpacked;
use fantex_base::input::{self, Held};
use fantex_base::{Error, Result, counted};
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3, Mat3, Quat, Vec2, Vec3, Vec4};
use pose::{COLORS, Placement, morph, world_from_bind};
use schema::{Asset, Instancing, Node, Primitive, Root, Versioned};

use crate::counts::there_are;
use crate::load::{SourceFile, pad};
use crate::{AlphaMode, ImageSource, Material, Model, ModelFormat, TextureRef, WrapMode};

/// Loads a glTF or GLB file: the default scene with all its nodes.
pub(super) fn load(file: &SourceFile, format: ModelFormat) -> Result<Model> {
    read(file, format).map_err(|error| match error.path() == Some(file.path) {
        true => error,
        // Also where a file beside it is to blame, which is named after this one.
        false => error.context(file.path.display()).with_path(file.path),
    })
}

fn read(file: &SourceFile, format: ModelFormat) -> Result<Model> {
    let (json, binary) = match format {
        ModelFormat::Glb => data::split(file.bytes)?,
        _ => (file.bytes, None),
    };
    let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
    let root: Root = serde_json::from_slice(json).map_err(|error| {
        // Other versions have other fields.
        let version = serde_json::from_slice(json).map_or(Ok(()), |of: Versioned| check_version(&of.asset));
        let malformed = || Error::malformed(format!("its JSON does not describe a glTF model: {error}"));
        version.err().unwrap_or_else(malformed)
    })?;
    let mut model = Model::default();
    check_version(&root.asset)?;
    check_extensions(&root, &mut model.notes)?;

    let buffers = Buffers::load(&root, file, binary)?;
    let unpacked = root.accessors.iter().map(|_| OnceCell::new()).collect();
    let document = Document { root: &root, buffers, unpacked, file };
    load_materials(&document, &mut model)?;
    let (instances, world_from_node) = mesh_instances(&document, &mut model.notes)?;
    load_all(&document, &instances.meshes, &world_from_node, &mut model)?;
    Ok(model)
}

struct Document<'a> {
    root: &'a Root,
    buffers: Buffers<'a>,
    /// Of each accessor that is compressed, once its primitive was read.
    unpacked: Vec<OnceCell<Unpacked>>,
    file: &'a SourceFile<'a>,
}

/// Follows a reference; `from` says where it stands, for the message.
fn get<'a, T>(
    items: &'a [T],
    index: usize,
    what: &'static str,
    from: impl FnOnce() -> String,
) -> Result<&'a T> {
    items.get(index).ok_or_else(|| {
        let (from, there_are) = (from(), there_are(items.len()));
        Error::malformed(format!("{from} refers to {what} {index}, but {there_are} (counting starts at 0)"))
    })
}

/// Minor versions are compatible by definition.
fn check_version(asset: &Asset) -> Result<()> {
    let version = &asset.version;
    match version.split('.').next() {
        Some("2") => Ok(()),
        _ => Err(Error::unsupported(format!(
            "it is glTF of version {version:?}, but fantex reads 2.0; convert it, for example with gltf-pipeline"
        ))),
    }
}

fn check_extensions(root: &Root, notes: &mut Vec<String>) -> Result<()> {
    const READ: [&str; 11] = [
        "KHR_mesh_quantization",
        "KHR_draco_mesh_compression",
        "EXT_meshopt_compression",
        "KHR_meshopt_compression",
        "KHR_texture_transform",
        "KHR_materials_unlit",
        "KHR_materials_emissive_strength",
        "KHR_materials_pbrSpecularGlossiness",
        "EXT_texture_webp",
        "KHR_texture_basisu",
        INSTANCING,
    ];
    // These change how light acts, not what the surface is; without them the model is still the model.
    let is_ignorable = |name: &str| {
        name.starts_with("KHR_materials_") || name.starts_with("KHR_lights_") || name.starts_with("KHR_xmp")
    };
    let unread = root.extensions_required.iter().filter(|name| !READ.contains(&name.as_str()));
    let (ignorable, fatal): (Vec<_>, Vec<_>) = unread.cloned().partition(|name| is_ignorable(name));
    if !fatal.is_empty() {
        let fatal = fatal.join(", ");
        let sentence = format!("it requires {fatal}, which fantex does not read; export it without");
        return Err(Error::unsupported(sentence));
    }
    let is_unread = |name: &&String| name.starts_with("KHR_materials_") && !READ.contains(&name.as_str());
    let mut ignored: Vec<String> = root.extensions_used.iter().filter(is_unread).cloned().collect();
    ignored.extend(ignorable);
    ignored.sort_unstable();
    ignored.dedup();
    if !ignored.is_empty() {
        let with_users: Vec<_> = ignored.iter().map(|name| with_users(root, name)).collect();
        notes.push(format!("extensions that fantex does not read were ignored: {}", with_users.join(", ")));
    }
    Ok(())
}

/// An extension with the materials that have it, the first few by name.
fn with_users(root: &Root, extension: &str) -> String {
    const NAMED: usize = 3;
    let has_it = |material: &&schema::Material| material.extensions.others.contains_key(extension);
    let users: Vec<_> = root.materials.iter().filter(has_it).map(|material| &material.name).collect();
    let names: Vec<_> = users.iter().take(NAMED).map(|name| format!("{name:?}")).collect();
    match users.len() {
        0 => extension.to_owned(),
        1 => format!("{extension} (of material {})", names[0]),
        2..=NAMED => format!("{extension} (of materials {})", names.join(", ")),
        count => format!("{extension} (of materials {} and {} more)", names.join(", "), count - NAMED),
    }
}

// The node hierarchy: which meshes stand where.

/// A mesh at its place.
struct MeshInstance {
    node: usize,
    mesh: usize,
    world_from_mesh: DAffine3,
}

#[derive(Default)]
struct MeshInstances {
    meshes: Vec<MeshInstance>,
    /// The memory of those that stand in lists.
    held: Vec<Held>,
}

/// Walks the default scene depth first, children in their order.
/// Also tells where the nodes stand.
fn mesh_instances(
    document: &Document,
    notes: &mut Vec<String>,
) -> Result<(MeshInstances, Vec<Option<DAffine3>>)> {
    let nodes = &document.root.nodes;
    let roots = scene_roots(document, notes)?;
    let mut reached = vec![None; nodes.len()];
    let mut instances = MeshInstances::default();
    let mut pending: Vec<(usize, DAffine3)> =
        roots.into_iter().rev().map(|root| (root, DAffine3::IDENTITY)).collect();
    while let Some((index, world_from_parent)) = pending.pop() {
        let node = get(nodes, index, "node", || "the node hierarchy".to_owned())?;
        let world_from_node = world_from_parent * parent_from_node(node);
        if reached[index].replace(world_from_node).is_some() {
            let sentence = format!("node {index} is reached twice; nodes must form a tree");
            return Err(Error::malformed(sentence));
        }
        if let Some(mesh) = node.mesh {
            get(&document.root.meshes, mesh, "mesh", || format!("node {index}"))?;
            match &node.extensions.instancing {
                None => instances.meshes.push(MeshInstance {
                    node: index,
                    mesh,
                    world_from_mesh: world_from_node,
                }),
                Some(instancing) => {
                    let placed = node_from_instances(document, index, mesh, instancing, &mut instances.held)?;
                    let in_world = |node_from_mesh| MeshInstance {
                        node: index,
                        mesh,
                        world_from_mesh: world_from_node * node_from_mesh,
                    };
                    instances.meshes.extend(placed.into_iter().map(in_world));
                }
            }
        }
        pending.extend(node.children.iter().rev().map(|&child| (child, world_from_node)));
    }
    Ok((instances, reached))
}

/// Root nodes of the default scene; without scenes all nodes without a parent.
fn scene_roots(document: &Document, notes: &mut Vec<String>) -> Result<Vec<usize>> {
    let root = document.root;
    if root.scene.is_none() && root.scenes.is_empty() {
        let mut is_child = vec![false; root.nodes.len()];
        for &child in root.nodes.iter().flat_map(|node| &node.children) {
            get(&root.nodes, child, "node", || "the node hierarchy".to_owned())?;
            is_child[child] = true;
        }
        return Ok((0..root.nodes.len()).filter(|&node| !is_child[node]).collect());
    }
    let index = root.scene.unwrap_or(0);
    let scene = get(&root.scenes, index, "scene", || "the file".to_owned())?;
    if root.scenes.len() > 1 {
        notes.push(format!("only scene {index} of {} was loaded", root.scenes.len()));
    }
    Ok(scene.nodes.clone())
}

fn parent_from_node(node: &Node) -> DAffine3 {
    if let Some(matrix) = &node.matrix {
        return DAffine3::from_mat4(DMat4::from_cols_array(matrix));
    }
    affine(
        node.translation.map_or(DVec3::ZERO, DVec3::from),
        node.rotation.map_or(DQuat::IDENTITY, DQuat::from_array),
        node.scale.map_or(DVec3::ONE, DVec3::from),
    )
}

/// Scale first, then rotation, then translation.
fn affine(translation: DVec3, rotation: DQuat, scale: DVec3) -> DAffine3 {
    // Exporters write rotations with few digits; a zero one means none.
    let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
    DAffine3::from_scale_rotation_translation(scale, rotation, translation)
}

// One mesh many times below one node (EXT_mesh_gpu_instancing).

const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// Bytes that an instance takes: in two lists, and what its place is read from (three, four and three floats).
const INSTANCE_BYTES: u64 = (size_of::<DAffine3>() + size_of::<MeshInstance>() + 40) as u64;

/// Where the instances of `mesh` stand below a node. What an instance is not given is the identity's, and attributes of the file's own
/// (a colour, a number) are left alone. Of a mesh without triangles there is one, for what is to be said of it.
fn node_from_instances(
    document: &Document,
    node: usize,
    mesh: usize,
    instancing: &Instancing,
    held: &mut Vec<Held>,
) -> Result<Vec<DAffine3>> {
    let mut counts = Vec::new();
    for name in ["TRANSLATION", "ROTATION", "SCALE"] {
        if let Some(&index) = instancing.attributes.get(name) {
            let from = || format!("{name} of the instances of node {node}");
            counts.push((name, get(&document.root.accessors, index, "accessor", from)?.count));
        }
    }
    let Some(&first) = counts.first() else { return Ok(vec![DAffine3::IDENTITY]) };
    if let Some(other) = counts.iter().find(|(_, count)| *count != first.1) {
        return Err(Error::malformed(format!(
            "node {node} has {} of {} for its instances, but {} of {}",
            counted(first.1, "value"),
            first.0,
            other.1,
            other.0
        )));
    }
    let triangles = triangles_about(document, mesh);
    if triangles == 0 {
        return Ok(vec![DAffine3::IDENTITY]);
    }
    // Before a list of instances is made: a few letters of JSON can ask for any number of them.
    document.file.check_triangles(first.1.saturating_mul(triangles))?;
    let instances = format_args!("{} instances of node {node}", first.1);
    held.push(input::reserve(instances, (first.1 as u64).saturating_mul(INSTANCE_BYTES))?);
    let translations = read_per_instance::<3>(document, instancing, "TRANSLATION", "three floats")?;
    let rotations =
        read_per_instance::<4>(document, instancing, "ROTATION", "four floats or normalised integers")?;
    let scales = read_per_instance::<3>(document, instancing, "SCALE", "three floats")?;
    let vector = |values: &Option<Vec<[f32; 3]>>, index: usize, default| {
        values.as_ref().map_or(default, |values| Vec3::from(values[index]).as_dvec3())
    };
    let turn =
        |index: usize| rotations.as_ref().map_or(DQuat::IDENTITY, |r| Quat::from_array(r[index]).as_dquat());
    let placed = (0..first.1).map(|index| {
        affine(vector(&translations, index, DVec3::ZERO), turn(index), vector(&scales, index, DVec3::ONE))
    });
    Ok(placed.collect())
}

fn read_per_instance<const N: usize>(
    document: &Document,
    instancing: &Instancing,
    name: &str,
    expected: &'static str,
) -> Result<Option<Vec<[f32; N]>>> {
    let Some(&accessor) = instancing.attributes.get(name) else { return Ok(None) };
    Reader::new(document, accessor, name)?.read_floats(name, expected, false).map(Some)
}

/// How many triangles a mesh has, of corners that are not shared as in strips; 0 only if it has none.
fn triangles_about(document: &Document, mesh: usize) -> usize {
    let accessors = &document.root.accessors;
    let corners = |primitive: &Primitive| {
        let accessor = primitive.indices.or_else(|| primitive.attributes.get("POSITION").copied());
        accessor.and_then(|index| accessors.get(index)).map_or(0, |accessor| accessor.count)
    };
    let primitives = &document.root.meshes[mesh].primitives;
    primitives.iter().fold(0usize, |sum, primitive| sum.saturating_add(corners(primitive) / 3))
}

// Primitives: from accessors to triangles with corner attributes.

/// More sets than this are not read: a set's number must not decide how much is allocated.
const MAX_UV_SETS: usize = 8;

fn load_all(
    document: &Document,
    instances: &[MeshInstance],
    world_from_node: &[Option<DAffine3>],
    model: &mut Model,
) -> Result<()> {
    let mut loader =
        Loader { document, model, default_material: None, last_node: None, skipped: Skipped::default() };
    let mut is_loaded = vec![false; document.root.meshes.len()];
    // Of skins that were met: world from mesh for each joint.
    let mut skins: Vec<Option<Option<Vec<DAffine3>>>> = vec![None; document.root.skins.len()];
    let mut unposed = 0;
    for MeshInstance { node, mesh: number, world_from_mesh } in instances {
        let said_so_far = (loader.skipped, loader.model.notes.len());
        let mesh = &document.root.meshes[*number];
        let shown = &document.root.nodes[*node];
        let mut pose =
            Pose { world_from_mesh, joints: &[], weights: shown.weights.as_ref().unwrap_or(&mesh.weights) };
        if let Some(skin) = shown.skin {
            get(&document.root.skins, skin, "skin", || format!("node {node}"))?;
            if skins[skin].is_none() {
                skins[skin] = Some(world_from_bind(document, skin, world_from_node)?);
            }
            let joints = skins[skin].as_ref().and_then(Option::as_deref);
            unposed += usize::from(joints.is_none());
            pose.joints = joints.unwrap_or_default();
        }
        for (index, primitive) in mesh.primitives.iter().enumerate() {
            let label = format!("primitive {index} of mesh {number}");
            loader.load(primitive, &label, &pose)?;
        }
        loader.name_part(*node, mesh);
        // What is to be said of a mesh is said once, however often it stands in the world.
        if std::mem::replace(&mut is_loaded[*number], true) {
            loader.skipped = said_so_far.0;
            loader.model.notes.truncate(said_so_far.1);
        }
    }
    if unposed > 0 {
        let meshes = counted(unposed, "skinned mesh");
        loader.model.notes.push(format!("read {meshes} as modelled, whose joints are not in the scene"));
    }
    loader.finish();
    Ok(())
}

/// How a node shows its mesh.
struct Pose<'a> {
    world_from_mesh: &'a DAffine3,
    /// World from mesh for each joint; none without a skin, else the transform above has no say.
    joints: &'a [DAffine3],
    /// Of the morph targets.
    weights: &'a [f64],
}

#[derive(Clone, Copy, Default)]
struct Skipped {
    points_or_lines: usize,
    without_positions: usize,
}

struct Loader<'a, 'm> {
    document: &'a Document<'a>,
    model: &'m mut Model,
    /// Index of the material for primitives without one, once needed.
    default_material: Option<u32>,
    /// The node whose meshes were loaded last: its instances are one part.
    last_node: Option<usize>,
    skipped: Skipped,
}

#[derive(Clone, Copy)]
enum Mode {
    List,
    Strip,
    Fan,
}

impl Loader<'_, '_> {
    fn finish(self) {
        let notes = &mut self.model.notes;
        let Skipped { points_or_lines, without_positions } = self.skipped;
        for (count, kind) in
            [(points_or_lines, "of points or lines"), (without_positions, "without positions")]
        {
            if count > 0 {
                notes.push(format!("skipped {} {kind}", counted(count, "primitive")));
            }
        }
        // One material everywhere needs no list.
        if self.model.materials.len() <= 1 {
            self.model.triangle_materials.clear();
        }
    }

    /// All triangles that no part has yet are those of a node.
    fn name_part(&mut self, node: usize, mesh: &schema::Mesh) {
        let Model { parts, triangles, .. } = &mut *self.model;
        if self.last_node.replace(node) != Some(node) {
            let name = &self.document.root.nodes[node].name;
            parts.names.push(if name.is_empty() { &mesh.name } else { name }.clone());
        }
        parts.of_triangle.resize(triangles.len(), parts.names.len() as u32 - 1);
    }

    fn load(&mut self, primitive: &Primitive, label: &str, pose: &Pose) -> Result<()> {
        let mode = match primitive.mode.unwrap_or(4) {
            0..=3 => {
                self.skipped.points_or_lines += 1;
                return Ok(());
            }
            4 => Mode::List,
            5 => Mode::Strip,
            6 => Mode::Fan,
            mode => {
                let sentence = format!("{label} has the unknown mode {mode}; modes are 0 to 6");
                return Err(Error::malformed(sentence));
            }
        };
        let Some(&positions) = primitive.attributes.get("POSITION") else {
            self.skipped.without_positions += 1;
            return Ok(());
        };
        draco::unpack(self.document, primitive, label)?;
        let positions = Reader::new(self.document, positions, label)?;
        let file = self.document.file;
        let first_position = self.model.positions.len();
        file.check_positions(first_position + positions.count())?;

        let triangles = self.read_triangles(primitive, label, mode, positions.count())?;
        let placement = match pose.joints {
            [] => Placement::Rigid(*pose.world_from_mesh),
            joints => Placement::skinned(self.document, primitive, label, joints, positions.count())?,
        };
        let is_mirrored = positions.count() > 0 && placement.at(0).matrix3.determinant() < 0.0;
        let triangles =
            triangles.into_iter().map(|[a, b, c]| if is_mirrored { [a, c, b] } else { [a, b, c] });
        let triangles: Vec<[u32; 3]> = triangles.collect();
        file.check_triangles(self.model.triangles.len() + triangles.len())?;

        let mut positions: Vec<[f32; 3]> =
            positions.read_floats("POSITION", "three floats or integers", false)?;
        morph(self.document, (primitive, label), pose.weights, "POSITION", &mut positions)?;
        let world = |(i, p): (usize, &[f32; 3])| placement.at(i).transform_point3(Vec3::from(*p).as_dvec3());
        self.model.positions.extend(positions.iter().enumerate().map(world));

        let attributes = Attributes { primitive, label, count: positions.len(), triangles: &triangles };
        self.append_attributes(&attributes, &placement, pose.weights, is_mirrored)?;
        let offset = first_position as u32;
        self.model.triangles.extend(triangles.iter().map(|t| t.map(|v| v + offset)));
        let material = self.material_of(primitive, label)?;
        self.model.triangle_materials.resize(self.model.triangles.len(), material);
        Ok(())
    }

    /// Vertex triples, each within `count`.
    fn read_triangles(
        &mut self,
        primitive: &Primitive,
        label: &str,
        mode: Mode,
        count: usize,
    ) -> Result<Vec<[u32; 3]>> {
        let indices: Vec<u32> = match primitive.indices {
            Some(accessor) => Reader::new(self.document, accessor, label)?.read_indices("indices")?,
            None => (0..count as u32).collect(),
        };
        if let Some(&index) = indices.iter().find(|&&index| index as usize >= count) {
            return Err(Error::malformed(format!(
                "{label} refers to vertex {index}, but it has {count} (counting starts at 0)"
            )));
        }
        let (lists, rest) = indices.as_chunks::<3>();
        Ok(match mode {
            Mode::List => {
                if !rest.is_empty() {
                    let rest = counted(rest.len(), "index");
                    self.model.notes.push(format!("{label}: ignored {rest} after the last whole triangle"));
                }
                lists.to_vec()
            }
            Mode::Strip => strip(&indices),
            Mode::Fan => fan(&indices),
        })
    }

    fn material_of(&mut self, primitive: &Primitive, label: &str) -> Result<u32> {
        if let Some(material) = primitive.material {
            get(&self.document.root.materials, material, "material", || label.to_owned())?;
            return Ok(material as u32);
        }
        let materials = &mut self.model.materials;
        Ok(*self.default_material.get_or_insert_with(|| {
            materials.push(default_material());
            materials.len() as u32 - 1
        }))
    }

    fn append_attributes(
        &mut self,
        attributes: &Attributes,
        placement: &Placement,
        weights: &[f64],
        is_mirrored: bool,
    ) -> Result<()> {
        let before = 3 * self.model.triangles.len();
        let document = self.document;
        let corners = &mut self.model.corners;
        let of = (attributes.primitive, attributes.label);
        if let Some(mut normals) =
            attributes.read::<3>(document, "NORMAL", "three floats or integers", false)?
        {
            morph(document, of, weights, "NORMAL", &mut normals)?;
            let normals: Vec<Vec3> = match placement {
                Placement::Rigid(world_from_mesh) => {
                    let world = normal_transform(world_from_mesh);
                    normals.into_iter().map(|n| turned(&world, Vec3::from(n))).collect()
                }
                Placement::Skinned { of_vertex, .. } => {
                    let world = |(n, of): ([f32; 3], &DAffine3)| turned(&normal_transform(of), Vec3::from(n));
                    normals.into_iter().zip(of_vertex).map(world).collect()
                }
            };
            pad(&mut corners.normals, before, Vec3::ZERO);
            attributes.spread(&normals, &mut corners.normals);
        }
        if let Some(mut tangents) =
            attributes.read::<4>(document, "TANGENT", "four floats or integers", false)?
        {
            morph(document, of, weights, "TANGENT", &mut tangents)?;
            // The bitangent is w * cross(normal, tangent), and a mirror turns cross products round.
            let sign = if is_mirrored { -1.0 } else { 1.0 };
            let world = |(i, [x, y, z, w]): (usize, [f32; 4])| {
                turned(&placement.at(i).matrix3, Vec3::new(x, y, z)).extend(sign * w)
            };
            let tangents: Vec<Vec4> = tangents.into_iter().enumerate().map(world).collect();
            pad(&mut corners.tangents, before, Vec4::ZERO);
            attributes.spread(&tangents, &mut corners.tangents);
        }
        if let Some(colors) = attributes.read_colors(document, weights)? {
            pad(&mut corners.colors, before, Vec4::ONE);
            attributes.spread(&colors, &mut corners.colors);
        }
        for set in 0..MAX_UV_SETS {
            let name = format!("TEXCOORD_{set}");
            let Some(mut uvs) = attributes.read::<2>(document, &name, "two floats or integers", false)?
            else {
                continue;
            };
            morph(document, of, weights, &name, &mut uvs)?;
            let uvs: Vec<Vec2> = uvs.into_iter().map(Vec2::from).collect();
            pad(&mut corners.uv_sets, set + 1, Vec::new());
            pad(&mut corners.uv_sets[set], before, Vec2::ZERO);
            attributes.spread(&uvs, &mut corners.uv_sets[set]);
        }
        Ok(())
    }
}

struct Attributes<'a> {
    primitive: &'a Primitive,
    label: &'a str,
    /// Number of positions, which all attributes must match.
    count: usize,
    triangles: &'a [[u32; 3]],
}

impl Attributes<'_> {
    fn reader<'a>(&self, document: &'a Document, name: &str) -> Result<Option<Reader<'a>>> {
        let Some(&accessor) = self.primitive.attributes.get(name) else { return Ok(None) };
        let reader = Reader::new(document, accessor, self.label)?;
        if reader.count() != self.count {
            return Err(Error::malformed(format!(
                "{} has {}, but {} of {name}",
                self.label,
                counted(self.count, "position"),
                counted(reader.count(), "value")
            )));
        }
        Ok(Some(reader))
    }

    fn read<const N: usize>(
        &self,
        document: &Document,
        name: &str,
        expected: &'static str,
        always_normalized: bool,
    ) -> Result<Option<Vec<[f32; N]>>> {
        let reader = self.reader(document, name)?;
        reader.map(|reader| reader.read_floats(name, expected, always_normalized)).transpose()
    }

    /// Linear RGBA from three or four numbers; integers are always fractions.
    fn read_colors(&self, document: &Document, weights: &[f64]) -> Result<Option<Vec<Vec4>>> {
        let Some(reader) = self.reader(document, "COLOR_0")? else { return Ok(None) };
        let opaque = |rgb| Vec3::from(rgb).extend(1.0);
        Ok(Some(match reader.width {
            3 => self.morphed_colors(document, &reader, weights)?.into_iter().map(opaque).collect(),
            _ => self.morphed_colors(document, &reader, weights)?.into_iter().map(Vec4::from_array).collect(),
        }))
    }

    fn morphed_colors<const N: usize>(
        &self,
        document: &Document,
        reader: &Reader,
        weights: &[f64],
    ) -> Result<Vec<[f32; N]>> {
        let mut colors = reader.read_floats("COLOR_0", COLORS, true)?;
        morph(document, (self.primitive, self.label), weights, "COLOR_0", &mut colors)?;
        Ok(colors)
    }

    /// From one value per vertex to one per corner.
    fn spread<T: Copy>(&self, of_vertex: &[T], of_corner: &mut Vec<T>) {
        of_corner.extend(self.triangles.iter().flatten().map(|&v| of_vertex[v as usize]));
    }
}

/// Every other triangle of a strip is turned round to keep the orientation.
fn strip(indices: &[u32]) -> Vec<[u32; 3]> {
    let triangle = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
    indices.windows(3).enumerate().map(triangle).collect()
}

fn fan(indices: &[u32]) -> Vec<[u32; 3]> {
    let Some((&centre, rim)) = indices.split_first() else { return Vec::new() };
    rim.windows(2).map(|w| [w[0], w[1], centre]).collect()
}

/// Normals follow the inverse transpose. Where there is none (a node flattened to nothing), the result is not finite and
/// the triangle's own normal replaces it later.
fn normal_transform(world_from_mesh: &DAffine3) -> DMat3 {
    world_from_mesh.matrix3.inverse().transpose()
}

/// A direction under a linear map, not normalised.
fn turned(linear: &DMat3, direction: Vec3) -> Vec3 {
    let turned: DVec3 = *linear * direction.as_dvec3();
    turned.normalize_or_zero().as_vec3()
}

// Materials, textures, samplers and images.

fn load_materials(document: &Document, model: &mut Model) -> Result<()> {
    let mut embedded = Embedded::new();
    let images = document.root.images.iter().enumerate();
    model.images = images
        .map(|(index, image)| load_image(document, index, image, &mut embedded))
        .collect::<Result<_, _>>()?;
    for (index, material) in document.root.materials.iter().enumerate() {
        let mut reader = MaterialReader { document, index, notes: &mut model.notes };
        model.materials.push(reader.read(material)?);
    }
    Ok(())
}

/// What primitives without a material have.
fn default_material() -> Material {
    Material { metallic: 1.0, roughness: 1.0, double_sided: false, ..Material::default() }
}

/// Images by where they lie in the buffers: many may name the same bytes, which are kept once.
type Embedded = HashMap<Range<*const u8>, (Arc<[u8]>, Held)>;

fn load_image(
    document: &Document,
    index: usize,
    image: &schema::Image,
    shared: &mut Embedded,
) -> Result<ImageSource> {
    let file_name = document.file.path.file_name().map(|n| n.to_string_lossy()).unwrap_or_default();
    let label = format!("image {index} of {file_name}");
    if let Some(view) = image.buffer_view {
        let found = document.buffers.view(view, || format!("image {index}"))?;
        let place = found.as_ptr_range();
        if let Some((bytes, _)) = shared.get(&place) {
            return Ok(ImageSource::Embedded { label, bytes: Arc::clone(bytes) });
        }
        let held = input::reserve(format_args!("image {index}"), found.len() as u64)?;
        let bytes: Arc<[u8]> = found.into();
        shared.insert(place, (Arc::clone(&bytes), held));
        return Ok(ImageSource::Embedded { label, bytes });
    }
    let target = match &image.uri {
        Some(uri) => resolve(uri, document.file.path),
        None => Err(Error::malformed(NO_DATA)),
    };
    match target.map_err(|error| error.context(format!("image {index}")))? {
        Target::Bytes(bytes) => Ok(ImageSource::Embedded { label, bytes: bytes[..].into() }),
        Target::File(path) => Ok(ImageSource::File(path)),
    }
}

struct MaterialReader<'a> {
    document: &'a Document<'a>,
    index: usize,
    notes: &'a mut Vec<String>,
}

impl MaterialReader<'_> {
    fn read(&mut self, source: &schema::Material) -> Result<Material> {
        let pbr = self.metallic_roughness(source);
        let strength =
            source.extensions.emissive_strength.as_ref().and_then(|e| e.emissive_strength).unwrap_or(1.0);
        let normal_scale = source.normal_texture.as_ref().and_then(|t| t.scale);
        let occlusion_strength = source.occlusion_texture.as_ref().and_then(|t| t.strength);
        Ok(Material {
            name: source.name.clone(),
            place: format!("material {}", self.index),
            base_color: pbr.base_color_factor.map_or(Vec4::ONE, Vec4::from),
            base_color_texture: self.texture(pbr.base_color_texture.as_ref())?,
            metallic: pbr.metallic_factor.unwrap_or(1.0),
            roughness: pbr.roughness_factor.unwrap_or(1.0),
            metallic_roughness_texture: self.texture(pbr.metallic_roughness_texture.as_ref())?,
            normal_texture: self.texture(source.normal_texture.as_ref())?,
            normal_scale: normal_scale.unwrap_or(1.0),
            occlusion_texture: self.texture(source.occlusion_texture.as_ref())?,
            occlusion_strength: occlusion_strength.unwrap_or(1.0),
            emission: Vec3::from(source.emissive_factor) * strength,
            emission_texture: self.texture(source.emissive_texture.as_ref())?,
            alpha: self.alpha(source),
            double_sided: source.double_sided,
            unlit: source.extensions.unlit.is_some(),
            toon: None,
        })
    }

    /// The material's metallic-roughness; where it has none, what there is of its specular-glossiness, in which scans and
    /// purchased models were written before metallic-roughness was common.
    fn metallic_roughness(&mut self, source: &schema::Material) -> schema::MetallicRoughness {
        let own = source.pbr_metallic_roughness.clone();
        let Some(glossy) = source.extensions.specular_glossiness.as_ref().filter(|_| own.is_none()) else {
            return own.unwrap_or_default();
        };
        self.notes.push(format!(
            "material {}: of its specular-glossiness the diffuse colour and the glossiness factor were read",
            self.index
        ));
        schema::MetallicRoughness {
            base_color_factor: glossy.diffuse_factor,
            base_color_texture: glossy.diffuse_texture.clone(),
            metallic_factor: Some(0.0),
            roughness_factor: Some((1.0 - glossy.glossiness_factor.unwrap_or(1.0)).clamp(0.0, 1.0)),
            metallic_roughness_texture: None,
        }
    }

    fn alpha(&mut self, source: &schema::Material) -> AlphaMode {
        match source.alpha_mode.as_deref() {
            None | Some("OPAQUE") => AlphaMode::Opaque,
            Some("MASK") => AlphaMode::Mask(source.alpha_cutoff.unwrap_or(0.5)),
            Some("BLEND") => AlphaMode::Blend,
            Some(other) => {
                self.notes
                    .push(format!("material {}: the unknown alpha mode {other:?} became OPAQUE", self.index));
                AlphaMode::Opaque
            }
        }
    }

    fn texture(&mut self, info: Option<&schema::TextureInfo>) -> Result<Option<TextureRef>> {
        let Some(info) = info else { return Ok(None) };
        let root = self.document.root;
        let from = || format!("material {}", self.index);
        let texture = get(&root.textures, info.index, "texture", from)?;
        let from = || format!("texture {}", info.index);
        let others = [&texture.extensions.webp, &texture.extensions.basisu];
        let source = texture.source.or(others.into_iter().flatten().find_map(|other| other.source));
        let Some(image) = source else {
            let (material, texture) = (self.index, info.index);
            self.notes.push(format!(
                "material {material}: texture {texture} has no image that fantex reads and was left out"
            ));
            return Ok(None);
        };
        get(&root.images, image, "image", from)?;
        let sampler = texture.sampler.map(|s| get(&root.samplers, s, "sampler", from)).transpose()?;
        let transform = info.extensions.transform.as_ref();
        Ok(Some(TextureRef {
            image,
            uv_set: transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord),
            uv_transform: transform.map_or(Mat3::IDENTITY, uv_transform),
            wrap: sampler.map_or([WrapMode::Repeat; 2], |s| [s.wrap_s, s.wrap_t].map(wrap_mode)),
            nearest: sampler.is_some_and(|s| s.mag_filter == Some(9728)),
        }))
    }
}

/// From the numbers that glTF inherited from OpenGL; what is unknown repeats.
fn wrap_mode(code: Option<u64>) -> WrapMode {
    match code {
        Some(33071) => WrapMode::Clamp,
        Some(33648) => WrapMode::Mirror,
        _ => WrapMode::Repeat,
    }
}

/// Scale first, then a rotation that is counter-clockwise to the eye (v runs downwards), then the offset.
fn uv_transform(transform: &schema::TextureTransform) -> Mat3 {
    let (sin, cos) = transform.rotation.sin_cos();
    let rotation = Mat3::from_cols(Vec3::new(cos, -sin, 0.0), Vec3::new(sin, cos, 0.0), Vec3::Z);
    let scale = transform.scale.map_or(Vec2::ONE, Vec2::from);
    Mat3::from_translation(Vec2::from(transform.offset)) * rotation * Mat3::from_scale(scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of the extension's own text: offset (0, 1), a quarter turn and scale one half choose the lower left
    /// quadrant of the image.
    #[test]
    fn a_quarter_turn_chooses_the_lower_left_quadrant() {
        let transform = schema::TextureTransform {
            offset: [0.0, 1.0],
            rotation: std::f32::consts::FRAC_PI_2,
            scale: Some([0.5, 0.5]),
            tex_coord: None,
        };
        let matrix = uv_transform(&transform);
        let centre = matrix.transform_point2(Vec2::splat(0.5));
        assert!((centre - Vec2::new(0.25, 0.75)).length() < 1e-6, "{centre}");
        for corner in [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE] {
            let p = matrix.transform_point2(corner);
            assert!((-1e-6..=0.5 + 1e-6).contains(&p.x) && (0.5 - 1e-6..=1.0 + 1e-6).contains(&p.y), "{p}");
        }
    }
}
