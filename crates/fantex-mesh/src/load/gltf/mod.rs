//! glTF 2.0 and GLB (Khronos Group, "glTF 2.0 Specification", 2021).
//!
//! ```text
//!  container --> JSON --schema--> Root --+--> buffers --> accessors --+
//!                                        +--> nodes (world transforms) +--> primitives --> Model
//!                                        +--> materials, images -------+
//! ```
//!
//! Extensions that are read: KHR_mesh_quantization, KHR_texture_transform, KHR_materials_unlit,
//! KHR_materials_emissive_strength, EXT_texture_webp, EXT_mesh_gpu_instancing. Other material extensions and lights are noted and ignored; any
//! other extension that a file *requires* (compression, most of all) makes it unreadable.

mod accessor;
mod buffers;
mod container;
mod instancing;
mod material;
mod primitive;
mod problem;
mod scene;
mod schema;
mod uri;

use std::path::Path;

use super::{LoadError, LoadLimits, SourceFile, builder};
use crate::{Model, ModelFormat};
use buffers::Buffers;
use schema::Root;

pub use problem::{AccessorProblem, BufferProblem, GltfProblem};

/// Loads a glTF or GLB file: the default scene with all its nodes.
pub(super) fn load(file: &SourceFile, format: ModelFormat) -> Result<Model, LoadError> {
    read(file, format).map_err(|error| match error {
        Error::Problem(problem) => LoadError::Gltf { path: file.path.into(), problem },
        Error::Load(error) => error,
    })
}

/// Errors that know the file's path and those that still have to learn it.
enum Error {
    Problem(GltfProblem),
    Load(LoadError),
}

impl From<GltfProblem> for Error {
    fn from(problem: GltfProblem) -> Self {
        Self::Problem(problem)
    }
}

impl From<LoadError> for Error {
    fn from(error: LoadError) -> Self {
        Self::Load(error)
    }
}

fn read(file: &SourceFile, format: ModelFormat) -> Result<Model, Error> {
    let (json, binary) = match format {
        ModelFormat::Glb => {
            let container = container::split(file.bytes)?;
            (container.json, container.binary)
        }
        _ => (file.bytes, None),
    };
    let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
    let root: Root = serde_json::from_slice(json).map_err(GltfProblem::Json)?;
    let mut model = Model::default();
    check_version(&root)?;
    check_extensions(&root, &mut model.notes)?;

    let buffers = Buffers::load(&root, file, binary)?;
    let document = Document { root: &root, buffers, file };
    material::load(&document, &mut model)?;
    let instances = scene::mesh_instances(&document, &mut model.notes)?;
    primitive::load_all(&document, &instances, &mut model)?;
    builder::finish(&mut model);
    Ok(model)
}

/// A parsed file with its binary data.
struct Document<'a> {
    root: &'a Root,
    buffers: Buffers<'a>,
    file: &'a SourceFile<'a>,
}

impl Document<'_> {
    fn folder(&self) -> &Path {
        self.file.folder()
    }

    fn limits(&self) -> &LoadLimits {
        &self.file.limits
    }
}

/// Follows a reference; `from` says where it stands, for the message.
fn get<'a, T>(
    items: &'a [T],
    index: usize,
    what: &'static str,
    from: impl FnOnce() -> String,
) -> Result<&'a T, GltfProblem> {
    items.get(index).ok_or_else(|| GltfProblem::Index { from: from(), what, index, count: items.len() })
}

/// Minor versions are compatible by definition.
fn check_version(root: &Root) -> Result<(), GltfProblem> {
    let version = &root.asset.version;
    match version.split('.').next() {
        Some("2") => Ok(()),
        _ => Err(GltfProblem::Version { version: version.clone() }),
    }
}

fn check_extensions(root: &Root, notes: &mut Vec<String>) -> Result<(), GltfProblem> {
    const READ: [&str; 7] = [
        "KHR_mesh_quantization",
        "KHR_texture_transform",
        "KHR_materials_unlit",
        "KHR_materials_emissive_strength",
        "KHR_materials_pbrSpecularGlossiness",
        "EXT_texture_webp",
        instancing::EXTENSION,
    ];
    // These change how light acts, not what the surface is; without them the model is still the model.
    let is_ignorable = |name: &str| {
        name.starts_with("KHR_materials_") || name.starts_with("KHR_lights_") || name.starts_with("KHR_xmp")
    };
    let unread = root.extensions_required.iter().filter(|name| !READ.contains(&name.as_str()));
    let (ignorable, fatal): (Vec<_>, Vec<_>) = unread.cloned().partition(|name| is_ignorable(name));
    if !fatal.is_empty() {
        return Err(GltfProblem::RequiredExtensions { extensions: fatal });
    }
    let is_unread = |name: &&String| name.starts_with("KHR_materials_") && !READ.contains(&name.as_str());
    let mut ignored: Vec<String> = root.extensions_used.iter().filter(is_unread).cloned().collect();
    ignored.extend(ignorable);
    ignored.sort_unstable();
    ignored.dedup();
    if !ignored.is_empty() {
        notes.push(format!("extensions that fantex does not read were ignored: {}", ignored.join(", ")));
    }
    Ok(())
}
