//! Which format a file is in.

use std::fmt;
use std::path::Path;

use super::{LoadError, stl};

/// The model formats that fantex reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ModelFormat {
    /// glTF 2.0, JSON.
    Gltf,
    /// glTF 2.0, binary container.
    Glb,
    /// Wavefront OBJ with MTL.
    Obj,
    /// Stanford PLY.
    Ply,
    /// Stereolithography, binary or ASCII.
    Stl,
}

impl ModelFormat {
    /// All formats.
    pub const ALL: [Self; 5] = [Self::Gltf, Self::Glb, Self::Obj, Self::Ply, Self::Stl];

    /// The usual extension, lower case, without a dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Gltf => "gltf",
            Self::Glb => "glb",
            Self::Obj => "obj",
            Self::Ply => "ply",
            Self::Stl => "stl",
        }
    }

    /// The format that a path's extension names, in upper or lower case.
    pub fn from_extension(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?;
        Self::ALL.into_iter().find(|format| format.extension().eq_ignore_ascii_case(extension))
    }

    pub(crate) fn with_article(self) -> &'static str {
        match self {
            Self::Gltf => "a glTF",
            Self::Glb => "a GLB",
            Self::Obj => "an OBJ",
            Self::Ply => "a PLY",
            Self::Stl => "an STL",
        }
    }
}

impl fmt::Display for ModelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Gltf => "glTF",
            Self::Glb => "GLB",
            Self::Obj => "OBJ",
            Self::Ply => "PLY",
            Self::Stl => "STL",
        })
    }
}

/// What [`detect`] found.
pub(super) struct Detected {
    pub(super) format: ModelFormat,
    /// Set where the extension names another format than the content.
    pub(super) note: Option<String>,
}

/// Names the format of a file: by its content where that is recognisable, else by its extension.
pub(super) fn detect(path: &Path, bytes: &[u8]) -> Result<Detected, LoadError> {
    if bytes.is_empty() {
        return Err(LoadError::Empty { path: path.into() });
    }
    let named = ModelFormat::from_extension(path);
    if let Some(format) = format_from_content(bytes, named) {
        let note = named.filter(|&n| n != format && !is_gltf_pair(n, format)).map(|n| {
            format!(
                "the file is named like {} file, but its content is {format} and was read as such",
                n.with_article()
            )
        });
        return Ok(Detected { format, note });
    }
    if let Some(found) = foreign_kind(bytes) {
        return Err(LoadError::NotAModel { path: path.into(), found });
    }
    let format = match named {
        Some(named) => check_content(path, bytes, named)?,
        None if looks_like_obj(bytes) => ModelFormat::Obj,
        None => return Err(LoadError::UnknownFormat { path: path.into() }),
    };
    Ok(Detected { format, note: None })
}

/// GLB in a `.gltf` file and the reverse are so common that they deserve no note.
fn is_gltf_pair(a: ModelFormat, b: ModelFormat) -> bool {
    let gltf = [ModelFormat::Gltf, ModelFormat::Glb];
    gltf.contains(&a) && gltf.contains(&b)
}

fn format_from_content(bytes: &[u8], named: Option<ModelFormat>) -> Option<ModelFormat> {
    if bytes.starts_with(b"glTF") {
        return Some(ModelFormat::Glb);
    }
    if let [b'p', b'l', b'y', next, ..] = bytes
        && next.is_ascii_whitespace()
    {
        return Some(ModelFormat::Ply);
    }
    if first_character(bytes) == Some(b'{') {
        return Some(ModelFormat::Gltf);
    }
    // An OBJ file may hold the words of an ASCII STL file in its comments, and any length by chance.
    let may_be_stl = named != Some(ModelFormat::Obj) || bytes[..bytes.len().min(84)].contains(&0);
    (may_be_stl && stl::looks_like_stl(bytes)).then_some(ModelFormat::Stl)
}

/// The extension decides only where the content does not contradict it.
fn check_content(path: &Path, bytes: &[u8], named: ModelFormat) -> Result<ModelFormat, LoadError> {
    let expected = match named {
        ModelFormat::Glb => "a GLB file begins with the letters glTF",
        ModelFormat::Gltf => "a glTF file begins with {",
        ModelFormat::Ply => "a PLY file begins with a line ply",
        ModelFormat::Obj if bytes[..bytes.len().min(4096)].contains(&0) => "an OBJ file is text",
        ModelFormat::Obj | ModelFormat::Stl => return Ok(named),
    };
    Err(LoadError::Mislabelled { path: path.into(), named, expected })
}

/// The first byte after a byte order mark and white space.
fn first_character(bytes: &[u8]) -> Option<u8> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    text.iter().copied().find(|b| !b.is_ascii_whitespace())
}

/// Kinds of files that are mistaken for models, by their first bytes.
fn foreign_kind(bytes: &[u8]) -> Option<&'static str> {
    const KINDS: [(&[u8], &str); 17] = [
        (b"\x89PNG", "a PNG image"),
        (b"\xff\xd8\xff", "a JPEG image"),
        (b"GIF8", "a GIF image"),
        (b"DDS ", "a DDS image"),
        (b"\xabKTX", "a KTX image"),
        (b"\x76\x2f\x31\x01", "an OpenEXR image"),
        (b"#?RADIANCE", "a Radiance HDR image"),
        (b"II*\0", "a TIFF image"),
        (b"MM\0*", "a TIFF image"),
        (b"RIFF", "a RIFF (WebP or sound) file"),
        (b"PK\x03\x04", "a ZIP archive (perhaps 3MF or USDZ)"),
        (b"\x1f\x8b", "a gzip archive"),
        (b"Kaydara FBX", "an FBX file"),
        (b"BLENDER", "a Blender file"),
        (b"PXR-USDC", "a USD file"),
        (b"#usda", "a USD file"),
        (b"%PDF", "a PDF document"),
    ];
    let by_magic = KINDS.iter().find(|(magic, _)| bytes.starts_with(magic)).map(|&(_, kind)| kind);
    by_magic.or_else(|| (first_character(bytes) == Some(b'<')).then_some("an XML or HTML document"))
}

/// True where the first line that is neither empty nor a comment begins with a word that OBJ files begin with.
fn looks_like_obj(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(64 << 10)];
    head.split(|&b| b == b'\n')
        .map(|line| line.trim_ascii())
        .find(|line| !line.is_empty() && !line.starts_with(b"#"))
        .and_then(|line| line.split(u8::is_ascii_whitespace).next())
        .is_some_and(|word| [&b"v"[..], b"vt", b"vn", b"o", b"g", b"mtllib", b"usemtl"].contains(&word))
}
