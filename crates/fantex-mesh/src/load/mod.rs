//! Loading model files: glTF, GLB, OBJ with MTL, PLY and STL.
//!
//! ```text
//!  path --read--> bytes --detect--> format --gltf | obj | ply | stl--> Model
//! ```
//!
//! Nothing in a file is trusted: every index, count, offset and length is checked before it is used and before
//! anything is allocated for it, so that a damaged or hostile file ends in one clear [`LoadError`].

mod builder;
mod companion;
mod detect;
mod error;
mod gltf;
mod obj;
mod ply;
mod polygon;
mod srgb;
mod stl;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::Model;

pub(crate) use self::srgb::srgb_from_linear;

use self::companion::{locate, read_companion, relative_path};

pub use self::detect::ModelFormat;
pub use self::error::{LoadError, NoteList, Quantity};
pub use self::gltf::{AccessorProblem, BufferProblem, GltfProblem};
pub use self::obj::ObjProblem;
pub use self::ply::PlyProblem;
pub use self::stl::StlProblem;

/// How much a model file may hold. Checked before memory is set aside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoadLimits {
    /// Bytes of one file (the model itself, or a buffer or material file that it names).
    pub max_file_bytes: u64,
    /// Triangles of the whole model, instances counted each.
    pub max_triangles: usize,
    /// Positions of the whole model, instances counted each.
    pub max_positions: usize,
    /// Corners of one polygon. Cutting a concave polygon takes time proportional to the square of this.
    pub max_face_corners: usize,
}

impl Default for LoadLimits {
    /// 16 GiB per file, 2^27 triangles (134 million) and as many positions, 2^14 corners per polygon. Corner indices
    /// (three per triangle) and position indices then fit 32 bits with room to spare.
    fn default() -> Self {
        Self {
            max_file_bytes: 16 << 30,
            max_triangles: 1 << 27,
            max_positions: 1 << 27,
            max_face_corners: 1 << 14,
        }
    }
}

/// How to load a model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// Resource limits.
    pub limits: LoadLimits,
}

/// Loads a model file of any format that fantex knows, recognised by its content first and its extension second.
///
/// Buffers and material files that the model names are read too; images are not opened (see
/// [`ImageSource`](crate::ImageSource)). What was skipped or assumed stands in [`Model::notes`].
///
/// ```no_run
/// use fantex_mesh::{LoadOptions, load};
///
/// let model = load("bottle.glb".as_ref(), &LoadOptions::default())?;
/// println!("{}: {} triangles", model.name, model.triangles.len());
/// for note in &model.notes {
///     eprintln!("note: {note}");
/// }
/// # Ok::<(), fantex_mesh::LoadError>(())
/// ```
///
/// # Errors
///
/// A [`LoadError`] that names the file, the place in it and what was expected there. A model without a single triangle
/// is an error too.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Model, LoadError> {
    load_bytes(path, &read_file(path, &options.limits)?, options)
}

/// Loads a model whose file is in memory already. `path` is where it lies or would lie: its extension and folder count
/// as for [`load`], and messages name it.
///
/// # Errors
///
/// As [`load`].
pub fn load_bytes(path: &Path, bytes: &[u8], options: &LoadOptions) -> Result<Model, LoadError> {
    let detected = detect::detect(path, bytes)?;
    let file = SourceFile { path, bytes, limits: options.limits };
    let mut model = match detected.format {
        ModelFormat::Gltf | ModelFormat::Glb => gltf::load(&file, detected.format)?,
        ModelFormat::Obj => obj::load(&file)?,
        ModelFormat::Ply => ply::load(&file)?,
        ModelFormat::Stl => stl::load(&file)?,
    };
    if model.triangles.is_empty() {
        return Err(LoadError::NoTriangles {
            path: path.into(),
            positions: model.positions.len(),
            notes: NoteList(std::mem::take(&mut model.notes)),
        });
    }
    model.name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    model.notes.splice(0..0, detected.note);
    Ok(model)
}

/// A model file in memory, with where it came from and what it may hold.
#[derive(Clone, Copy)]
pub(crate) struct SourceFile<'a> {
    pub(crate) path: &'a Path,
    pub(crate) bytes: &'a [u8],
    pub(crate) limits: LoadLimits,
}

impl SourceFile<'_> {
    /// The folder that relative paths in the file refer to.
    pub(crate) fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// Refuses more triangles than the limit.
    pub(crate) fn check_triangles(&self, count: usize) -> Result<(), LoadError> {
        self.check(Quantity::Triangles, count, self.limits.max_triangles)
    }

    /// Refuses more positions than the limit.
    pub(crate) fn check_positions(&self, count: usize) -> Result<(), LoadError> {
        self.check(Quantity::Positions, count, self.limits.max_positions)
    }

    fn check(&self, quantity: Quantity, count: usize, limit: usize) -> Result<(), LoadError> {
        if count <= limit {
            return Ok(());
        }
        Err(LoadError::TooMany { path: self.path.into(), quantity, count, limit })
    }
}

/// Reads a whole regular file of at most `max_file_bytes`.
fn read_file(path: &Path, limits: &LoadLimits) -> Result<Vec<u8>, LoadError> {
    let failed = |source| LoadError::Read { path: path.into(), source };
    let file = File::open(path).map_err(failed)?;
    let metadata = file.metadata().map_err(failed)?;
    if metadata.is_dir() {
        return Err(LoadError::Folder { path: path.into() });
    }
    let too_large =
        |bytes| LoadError::FileTooLarge { path: path.into(), bytes, limit: limits.max_file_bytes };
    if metadata.len() > limits.max_file_bytes {
        return Err(too_large(metadata.len()));
    }
    let mut bytes = Vec::new();
    bytes
        .try_reserve_exact(metadata.len() as usize + 1)
        .map_err(|_| LoadError::OutOfMemory { path: path.into(), bytes: metadata.len() })?;
    // A pipe or a growing file may hold more than its metadata says, so the limit is enforced here as well.
    file.take(limits.max_file_bytes.saturating_add(1)).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > limits.max_file_bytes {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(bytes)
}
