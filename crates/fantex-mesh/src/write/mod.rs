//! Writing geometry as PLY, OBJ or GLB.
//!
//! The file appears whole or not at all: it is written under a temporary name in its own folder, made durable and then
//! renamed.

mod glb;
mod obj;
mod ply;

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec4};

use crate::ModelFormat;

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

/// Why a model could not be written. Each message is one sentence; nothing is left behind.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// Something of that name is there already.
    #[error("{} exists already; use --force to overwrite it", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The extension names no format that fantex writes geometry in.
    #[error("{} names no format that fantex writes models in; use .ply, .obj or .glb", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// No triangle at all.
    #[error("{} was not written: there are no triangles", path.display())]
    NoTriangles {
        /// The file.
        path: PathBuf,
    },
    /// A triangle refers to a position that is not there.
    #[error("{} was not written: triangle {triangle} refers to position {index}, but there are {count}", path.display())]
    Index {
        /// The file.
        path: PathBuf,
        /// The triangle, from 0.
        triangle: usize,
        /// The index.
        index: u32,
        /// Number of positions.
        count: usize,
    },
    /// A position that is not a number.
    #[error("{} was not written: position {index} is not finite", path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// The position, from 0.
        index: usize,
    },
    /// Not one colour per position.
    #[error("{} was not written: there are {colors} colours for {positions} positions", path.display())]
    ColorCount {
        /// The file.
        path: PathBuf,
        /// Number of colours.
        colors: usize,
        /// Number of positions.
        positions: usize,
    },
    /// More than the format can hold.
    #[error("{} was not written: the model takes {bytes} bytes, but a GLB file holds 4 GiB; use .ply", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Bytes it would take.
        bytes: u64,
    },
    /// The operating system refused.
    #[error("cannot write {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
}

/// Writes geometry in the format that the extension names: `.ply` (binary little-endian), `.obj` or `.glb`.
/// An existing file is replaced only with `force`.
///
/// # Errors
///
/// See [`WriteError`]; an existing file is then unchanged.
pub fn write_model(path: &Path, geometry: &WriteGeometry, force: bool) -> Result<(), WriteError> {
    let format = ModelFormat::from_extension(path);
    let format = format.filter(|f| matches!(f, ModelFormat::Ply | ModelFormat::Obj | ModelFormat::Glb));
    let format = format.ok_or_else(|| WriteError::UnknownFormat { path: path.into() })?;
    check(path, geometry)?;
    if !force && path.exists() {
        return Err(WriteError::Exists { path: path.into() });
    }
    let container = match format {
        ModelFormat::Glb => Some(
            glb::Layout::new(geometry).map_err(|bytes| WriteError::TooLarge { path: path.into(), bytes })?,
        ),
        _ => None,
    };
    write_atomically(path, force, |out| match (&container, format) {
        (Some(layout), _) => glb::write(geometry, layout, out),
        (None, ModelFormat::Ply) => ply::write(geometry, out),
        (None, _) => obj::write(geometry, out),
    })
}

fn check(path: &Path, geometry: &WriteGeometry) -> Result<(), WriteError> {
    let count = geometry.positions.len();
    if geometry.triangles.is_empty() {
        return Err(WriteError::NoTriangles { path: path.into() });
    }
    if let Some(index) = geometry.positions.iter().position(|p| !p.is_finite()) {
        return Err(WriteError::NotFinite { path: path.into(), index });
    }
    let is_bad = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= count);
    if let Some(triangle) = geometry.triangles.iter().position(is_bad) {
        let index = geometry.triangles[triangle].into_iter().max().unwrap_or_default();
        return Err(WriteError::Index { path: path.into(), triangle, index, count });
    }
    match geometry.colors {
        Some(colors) if colors.len() != count => {
            Err(WriteError::ColorCount { path: path.into(), colors: colors.len(), positions: count })
        }
        _ => Ok(()),
    }
}

fn write_atomically(
    path: &Path,
    force: bool,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<(), WriteError> {
    let failed = |source| WriteError::Io { path: path.into(), source };
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let temporary = temporary_file(folder).map_err(failed)?;
    let mut out = BufWriter::with_capacity(1 << 20, temporary.as_file());
    write(&mut out).and_then(|()| out.flush()).map_err(failed)?;
    drop(out);
    temporary.as_file().sync_all().map_err(failed)?;
    let persisted = if force { temporary.persist(path) } else { temporary.persist_noclobber(path) };
    match persisted {
        Ok(_) => Ok(()),
        Err(error) if error.error.kind() == io::ErrorKind::AlreadyExists => {
            Err(WriteError::Exists { path: path.into() })
        }
        Err(error) => Err(failed(error.error)),
    }
}

/// A new file with the permissions that any new file gets (temporary files are private by default).
fn temporary_file(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    let builder = {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666))
    };
    builder.prefix(".fantex-").tempfile_in(folder)
}

/// True if single precision holds all positions exactly.
fn fits_single_precision(positions: &[DVec3]) -> bool {
    positions.iter().all(|p| p.as_vec3().as_dvec3() == *p)
}

/// sRGB bytes of a linear colour; alpha stays linear.
fn srgb_bytes(color: Vec4) -> [u8; 4] {
    let [r, g, b, a] = color.to_array();
    let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
    [
        byte(crate::load::srgb_from_linear(r)),
        byte(crate::load::srgb_from_linear(g)),
        byte(crate::load::srgb_from_linear(b)),
        byte(a),
    ]
}
