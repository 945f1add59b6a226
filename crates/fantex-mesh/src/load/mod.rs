//! Loading model files: glTF, GLB, OBJ with MTL, PLY and STL.
//!
//! ```text
//!  path --read--> bytes --detect--> format --gltf | obj | ply | stl--> Model
//! ```
//!
//! Nothing in a file is trusted: every index, count, offset and length is checked before it is used and before
//! anything is allocated for it, so that a damaged or hostile file ends in one clear error.
//!
//! A part without normals is shaded smooth with creases, as [`shading_normals`](crate::shading_normals) does for a whole mesh without:
//! also where another part of the file has normals, and also in glTF, which asks for flat ones. Scans come without normals, and facets
//! would show on them.

mod gltf;
mod missing;
mod mtl;
mod obj;
mod ply;
mod polygon;
mod stl;

use std::fmt;
use std::io::Read;
use std::ops::Deref;
use std::path::{Component, Path, PathBuf};

use fantex_base::input::{self, Held};
use fantex_base::srgb::linear_from_srgb;
use fantex_base::{Error, ErrorKind, Result, counted};
use glam::{Vec2, Vec3, Vec4};
pub use polygon::cut_polygons;
use rayon::prelude::*;

use crate::Model;

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

/// Memory of a triangle and of a position, with what is worked out from them: corners, normals, texture coordinates, the
/// triangles beside it.
const TRIANGLE_BYTES: u64 = 64;
const POSITION_BYTES: u64 = 24;

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
/// Where the file has normals for some of its parts only, the others get those that they would be
/// [shaded](crate::shading_normals) with alone: smooth ones with creases. So a part looks the same whatever else is in its file. Where
/// only some parts have tangents, the others get those of their normal map's coordinates.
///
/// ```no_run
/// use fantex_mesh::{LoadOptions, load};
///
/// let model = load("bottle.glb".as_ref(), &LoadOptions::default())?;
/// println!("{}: {} triangles", model.name, model.triangles.len());
/// for note in &model.notes {
///     eprintln!("note: {note}");
/// }
/// # Ok::<(), fantex_base::Error>(())
/// ```
///
/// # Errors
/// What the file, the place in it and what was expected there are. A model without a single triangle
/// is an error too.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Model> {
    load_watched(path, options, &|_, _| {})
}

/// As [`load`], and tells now and then how many bytes of how many are understood. Of glTF only the beginning and the end are told.
///
/// # Errors
/// As [`load`].
pub fn load_watched(path: &Path, options: &LoadOptions, watch: &dyn Fn(u64, u64)) -> Result<Model> {
    if path.is_dir() {
        return Err(about(path, ErrorKind::Unsupported, "is a folder; name a model file in it"));
    }
    load_bytes_watched(path, &read_file(path, &options.limits)?, options, watch)
}

/// Loads a model whose file is in memory already. `path` is where it lies or would lie: its extension and folder count
/// as for [`load`], and messages name it.
///
/// # Errors
/// As [`load`].
pub fn load_bytes(path: &Path, bytes: &[u8], options: &LoadOptions) -> Result<Model> {
    load_bytes_watched(path, bytes, options, &|_, _| {})
}

fn load_bytes_watched(
    path: &Path,
    bytes: &[u8],
    options: &LoadOptions,
    watch: &dyn Fn(u64, u64),
) -> Result<Model> {
    let (format, note) = detect(path, bytes)?;
    let file = SourceFile { path, bytes, limits: options.limits, watch };
    file.tell(0, bytes.len());
    let mut model = match format {
        ModelFormat::Gltf | ModelFormat::Glb => gltf::load(&file, format)?,
        ModelFormat::Obj => obj::load(&file)?,
        ModelFormat::Ply => ply::load(&file)?,
        ModelFormat::Stl => stl::load(&file)?,
    };
    finish(&mut model).map_err(|error| error.in_file(path))?;
    file.tell(0, 0);
    if model.triangles.is_empty() {
        let positions = counted(model.positions.len(), "position");
        let notes = model.notes.join("; ");
        let notes = if notes.is_empty() { notes } else { format!(" ({notes})") };
        let sentence = format!("holds no triangles, only {positions}{notes}");
        return Err(about(path, ErrorKind::Malformed, sentence));
    }
    model.name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    model.notes.splice(0..0, note);
    Ok(model)
}

/// A model file in memory, with where it came from and what it may hold.
#[derive(Clone, Copy)]
pub(crate) struct SourceFile<'a> {
    pub(crate) path: &'a Path,
    pub(crate) bytes: &'a [u8],
    pub(crate) limits: LoadLimits,
    pub(crate) watch: &'a dyn Fn(u64, u64),
}

/// Rows, lines or facets between two times that progress is told.
const TOLD_EVERY: u64 = 1 << 16;

impl SourceFile<'_> {
    /// Tells that a row begins, of a given number, and so many bytes are left, now and then.
    pub(crate) fn tell(&self, row: u64, left: usize) {
        if row.is_multiple_of(TOLD_EVERY) {
            let length = self.bytes.len() as u64;
            (self.watch)(length.saturating_sub(left as u64), length);
        }
    }

    pub(crate) fn check_triangles(&self, count: usize) -> Result<()> {
        self.check("triangles", count, self.limits.max_triangles, TRIANGLE_BYTES)
    }

    pub(crate) fn check_positions(&self, count: usize) -> Result<()> {
        self.check("positions", count, self.limits.max_positions, POSITION_BYTES)
    }

    fn check(&self, what: &str, count: usize, limit: usize, bytes: u64) -> Result<()> {
        if count <= limit {
            let sentence = format_args!("{} with {count} {what}", self.path.display());
            return input::reserve(sentence, (count as u64).saturating_mul(bytes)).map(drop);
        }
        let sentence = format!("has {count} {what}, more than the limit of {limit}");
        Err(about(self.path, ErrorKind::TooLarge, sentence))
    }
}

/// An error whose sentence begins with the file.
pub(crate) fn about(path: &Path, kind: ErrorKind, rest: impl fmt::Display) -> Error {
    Error::new(kind, format!("{} {rest}", path.display())).with_path(path)
}

/// Bytes that count against the budget of memory as long as they are there.
struct HeldBytes {
    bytes: Vec<u8>,
    _held: Held,
}

impl Deref for HeldBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes
    }
}

/// Reads a whole regular file of at most `max_file_bytes`.
fn read_file(path: &Path, limits: &LoadLimits) -> Result<HeldBytes> {
    let failed = |source| Error::reading(path, source);
    let file = input::open(path).map_err(failed)?;
    let metadata = file.metadata().map_err(failed)?;
    let held = input::reserve(path.display(), metadata.len()).map_err(|error| error.with_path(path))?;
    let too_large = |bytes| {
        let limit = limits.max_file_bytes;
        about(
            path,
            ErrorKind::TooLarge,
            format!("has {}, more than the limit of {limit}", counted(bytes, "byte")),
        )
    };
    if metadata.len() > limits.max_file_bytes {
        return Err(too_large(metadata.len()));
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(metadata.len() as usize + 1).map_err(|_| {
        let bytes = counted(metadata.len(), "byte");
        about(path, ErrorKind::TooLarge, format!("has {bytes}, more than there is memory for"))
    })?;
    // A growing file may hold more than its metadata says, so the limit is enforced here as well.
    file.take(limits.max_file_bytes.saturating_add(1)).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > limits.max_file_bytes {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(HeldBytes { bytes, _held: held })
}

// Which format a file is in.

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

    /// Extension, name with its article.
    fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Gltf => ("gltf", "a glTF"),
            Self::Glb => ("glb", "a GLB"),
            Self::Obj => ("obj", "an OBJ"),
            Self::Ply => ("ply", "a PLY"),
            Self::Stl => ("stl", "an STL"),
        }
    }

    /// The usual extension, lower case, without a dot.
    pub fn extension(self) -> &'static str {
        self.words().0
    }

    /// The format that a path's extension names, in upper or lower case.
    pub fn from_extension(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?;
        Self::ALL.into_iter().find(|format| format.extension().eq_ignore_ascii_case(extension))
    }

    fn with_article(self) -> &'static str {
        self.words().1
    }
}

impl fmt::Display for ModelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.with_article().split_once(' ').map_or("", |(_, name)| name))
    }
}

/// The format of a file, by its content where that is recognisable, else by its extension; and a note where the two disagree.
fn detect(path: &Path, bytes: &[u8]) -> Result<(ModelFormat, Option<String>)> {
    if bytes.is_empty() {
        return Err(about(path, ErrorKind::Malformed, "is empty"));
    }
    let named = ModelFormat::from_extension(path);
    if let Some(format) = format_from_content(bytes, named) {
        let note = named.filter(|&n| n != format && !is_gltf_pair(n, format)).map(|n| {
            format!(
                "the file is named like {} file, but its content is {format} and was read as such",
                n.with_article()
            )
        });
        return Ok((format, note));
    }
    if let Some(found) = foreign_kind(bytes) {
        let sentence =
            format!("is {found}, not a model that fantex reads; convert it to glTF, GLB, OBJ, PLY or STL");
        return Err(about(path, ErrorKind::Unsupported, sentence));
    }
    let format = match named {
        Some(named) => check_content(path, bytes, named)?,
        None if looks_like_obj(bytes) => ModelFormat::Obj,
        None => {
            let sentence = "is in no format that fantex knows: its content does not tell, and its extension is none of \
                            .gltf, .glb, .obj, .ply, .stl";
            return Err(about(path, ErrorKind::Unsupported, sentence));
        }
    };
    Ok((format, None))
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
fn check_content(path: &Path, bytes: &[u8], named: ModelFormat) -> Result<ModelFormat> {
    let expected = match named {
        ModelFormat::Glb => "a GLB file begins with the letters glTF",
        ModelFormat::Gltf => "a glTF file begins with {",
        ModelFormat::Ply => "a PLY file begins with a line ply",
        ModelFormat::Obj if bytes[..bytes.len().min(4096)].contains(&0) => "an OBJ file is text",
        ModelFormat::Obj | ModelFormat::Stl => return Ok(named),
    };
    let named = named.with_article();
    let sentence = format!("is named like {named} file, but its content is not: {expected}");
    Err(about(path, ErrorKind::Malformed, sentence))
}

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
        (b"PK\x03\x04", "a ZIP archive (perhaps 3MF, or USDZ, which `python -m fantex.usd` converts)"),
        (b"\x1f\x8b", "a gzip archive"),
        (b"Kaydara FBX", "an FBX file"),
        (b"BLENDER", "a Blender file"),
        (b"PXR-USDC", "a USD file (which `python -m fantex.usd` converts)"),
        (b"#usda", "a USD file (which `python -m fantex.usd` converts)"),
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

/// The words of a text, and on which line the last one is.
struct Words<'a> {
    rest: &'a [u8],
    /// From 1.
    line: usize,
}

impl<'a> Words<'a> {
    /// The next run of bytes that are not white space.
    fn next(&mut self) -> Option<&'a [u8]> {
        let start = self.rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(self.rest.len());
        self.line += self.rest[..start].iter().filter(|&&b| b == b'\n').count();
        let text = &self.rest[start..];
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        self.rest = &text[end..];
        (end > 0).then_some(&text[..end])
    }
}

/// A piece of a file for a message, shortened.
fn shown(word: &[u8]) -> String {
    String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned()
}

fn parsed<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// Rust's own parser rounds correctly and takes "nan" and "inf", which cleaning deals with. Programs for Windows write "1.#IND",
/// "-1.#QNAN00", "1.#INF" and "-nan(ind)".
fn parsed_number(word: &[u8]) -> Option<f64> {
    parsed(word).or_else(|| {
        let unsigned = word.strip_prefix(b"-").unwrap_or(word).to_ascii_lowercase();
        if unsigned.starts_with(b"1.#inf") {
            return Some(f64::INFINITY);
        }
        let is_nan = [&b"1.#ind"[..], b"1.#qnan", b"1.#snan", b"nan("];
        is_nan.iter().any(|start| unsigned.starts_with(start)).then_some(f64::NAN)
    })
}

// Files that a model names: where they are, and their bytes.

/// A path as written in a file from any system: backslashes separate too; of an absolute path only the name is kept,
/// because it points into the author's computer.
fn relative_path(written: &str) -> Option<PathBuf> {
    let path = written.trim().trim_matches('"').replace('\\', "/");
    let is_absolute = path.starts_with('/') || path.as_bytes().get(1) == Some(&b':');
    let path = if is_absolute { path.rsplit('/').next().unwrap_or_default() } else { &path };
    (!path.is_empty()).then(|| PathBuf::from(path))
}

/// Where a relative path leads that a file names. Models from systems that do not tell upper from lower case name
/// `Textures/Oak.PNG` where `textures/oak.png` lies: a name that is not there stands for the first one that differs
/// in case only. Of a file that is a symbolic link, it counts from the link; what is not there, from where the
/// link leads.
///
/// # Errors
/// It leads out of the file's folder, and that is not [allowed](input::ReadOptions::allow_outside).
fn locate(owner: &Path, relative: &Path) -> Result<PathBuf> {
    input::check_inside(owner, relative)?;
    let beside = |owner: &Path| located(owner.parent().unwrap_or(Path::new("")), relative);
    let found = beside(owner);
    if found.exists() || !owner.is_symlink() {
        return Ok(found);
    }
    let of_target = owner.canonicalize().map(|target| beside(&target));
    Ok(of_target.ok().filter(|path| path.exists()).unwrap_or(found))
}

fn located(folder: &Path, relative: &Path) -> PathBuf {
    let exact = folder.join(relative);
    if exact.exists() {
        return exact;
    }
    let mut found = folder.to_path_buf();
    for component in relative.components() {
        let next = found.join(component);
        found = match component {
            Component::Normal(name) if !next.exists() => {
                match same_but_for_case(&found, &name.to_string_lossy()) {
                    Some(name) => found.join(name),
                    None => return exact,
                }
            }
            _ => next,
        };
    }
    found
}

/// The name in a folder that differs from `name` in upper and lower case only; the first of several.
fn same_but_for_case(folder: &Path, name: &str) -> Option<std::ffi::OsString> {
    // The folder of a plain file name is the current one.
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let name = name.to_lowercase();
    let names = std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.file_name()));
    names.filter(|n| n.to_string_lossy().to_lowercase() == name).min()
}

// What all loaders do with corner attributes: parts of a model that lack one are filled in, and normals and tangents are
// normalised, so that users need not check.

/// Appends to an array of corner attributes that may be missing for earlier corners: `fill` stands in there.
pub(crate) fn pad<T: Clone>(values: &mut Vec<T>, corners: usize, fill: T) {
    if values.len() < corners {
        values.resize(corners, fill);
    }
}

/// Brings all attribute arrays to three entries per triangle (or none). Triangles without any normal, where others have some, get smooth
/// ones; a single normal that is missing, zero or not finite becomes the triangle's own. Tangents that are missing follow the normal
/// map's coordinates, those of triangles without a normal map the first UV set. Colours become white, coordinates zero.
///
/// # Errors
/// There is not enough memory to make normals or tangents.
fn finish(model: &mut Model) -> Result<()> {
    let corners = 3 * model.triangles.len();
    let attributes = &mut model.corners;
    // Programs that have worked out no normals write zeros.
    if attributes.normals.iter().all(|normal| normal.try_normalize().is_none()) {
        attributes.normals.clear();
    }
    pad_if_present(&mut attributes.normals, corners, Vec3::ZERO);
    pad_if_present(&mut attributes.colors, corners, Vec4::ONE);
    pad_if_present(&mut attributes.tangents, corners, Vec4::ZERO);
    attributes.uv_sets.iter_mut().for_each(|set| pad(set, corners, Vec2::ZERO));
    if !model.triangle_materials.is_empty() {
        pad(&mut model.triangle_materials, model.triangles.len(), 0);
    }
    model.parts.simplify();
    if model.materials.is_empty() {
        model.materials.push(crate::Material::default());
    }
    drop_textures_without_coordinates(model);
    missing::smooth_missing_normals(model)?;
    make_normals_unit(model);
    missing::fill_missing_tangents(model)?;
    make_tangents_unit(model);
    Ok(())
}

/// A texture needs coordinates to be looked up with; one that names a set the model lacks is left out. Of materials that no triangle has,
/// which a part of the file may have that was not loaded, there is nothing to say.
fn drop_textures_without_coordinates(model: &mut Model) {
    let sets = model.corners.uv_sets.len();
    let mut is_used = vec![false; model.materials.len()];
    match &model.triangle_materials[..] {
        [] => is_used[0] = true,
        of_triangles => of_triangles.iter().for_each(|&material| is_used[material as usize] = true),
    }
    for (index, material) in model.materials.iter_mut().enumerate() {
        let textures = [
            &mut material.base_color_texture,
            &mut material.metallic_roughness_texture,
            &mut material.normal_texture,
            &mut material.occlusion_texture,
            &mut material.emission_texture,
        ];
        for texture in textures {
            let dropped = texture.take_if(|t| t.uv_set >= sets);
            if let Some(dropped) = dropped.filter(|_| is_used[index]) {
                let set = dropped.uv_set;
                model.notes.push(format!(
                    "material {index}: a texture was left out, because the model has no texture coordinates {set}"
                ));
            }
        }
    }
}

fn pad_if_present<T: Clone>(values: &mut Vec<T>, corners: usize, fill: T) {
    if !values.is_empty() {
        pad(values, corners, fill);
    }
}

fn make_normals_unit(model: &mut Model) {
    let (positions, triangles) = (&model.positions, &model.triangles);
    model.corners.normals.par_chunks_exact_mut(3).zip(triangles).for_each(|(normals, triangle)| {
        for normal in normals {
            *normal = normal.try_normalize().unwrap_or_else(|| {
                let [a, b, c] = triangle.map(|v| positions[v as usize]);
                (b - a).cross(c - a).try_normalize().map_or(Vec3::Z, |n| n.as_vec3())
            });
        }
    });
}

fn make_tangents_unit(model: &mut Model) {
    let mut tangents = std::mem::take(&mut model.corners.tangents);
    tangents.par_chunks_exact_mut(3).enumerate().for_each(|(triangle, tangents)| {
        for (k, tangent) in tangents.iter_mut().enumerate() {
            let handedness = if tangent.w < 0.0 { -1.0 } else { 1.0 };
            *tangent = match tangent.truncate().try_normalize() {
                Some(unit) => unit.extend(handedness),
                None => tangent_from_uv(model, triangle, k),
            };
        }
    });
    model.corners.tangents = tangents;
}

/// The direction in which u grows, orthogonal to the corner's normal. In glTF the bitangent `w * cross(n, t)` points
/// against v, because v runs downwards and normal maps have +y up.
fn tangent_from_uv(model: &Model, triangle: usize, k: usize) -> Vec4 {
    let corner = 3 * triangle + k;
    let [a, b, c] = model.triangles[triangle].map(|v| model.positions[v as usize]);
    let (e1, e2) = ((b - a).as_vec3(), (c - a).as_vec3());
    let normal = match model.corners.normals.get(corner) {
        Some(&normal) => normal,
        None => e1.cross(e2).try_normalize().unwrap_or(Vec3::Z),
    };
    let [d1, d2] = match model.corners.uv_sets.first() {
        Some(uv) => [1, 2].map(|i| uv[3 * triangle + i] - uv[3 * triangle]),
        None => [Vec2::ZERO; 2],
    };
    let determinant = d1.perp_dot(d2);
    let along_u = (e1 * d2.y - e2 * d1.y) * determinant.signum();
    let against_v = (e1 * d2.x - e2 * d1.x) * determinant.signum();
    let tangent = along_u.reject_from_normalized(normal).try_normalize();
    let tangent = tangent.unwrap_or_else(|| normal.any_orthonormal_vector());
    let handedness = if normal.cross(tangent).dot(against_v) < 0.0 { -1.0 } else { 1.0 };
    tangent.extend(handedness)
}

/// Colours of 0..1 do not reach this, even where some are overexposed; those of 0..255 do, unless the whole model is black.
const BEYOND_SHARES: f32 = 8.0;

/// Whether the colours of a file are numbers of 0..255.
fn are_bytes(colors: impl Iterator<Item = Vec3>) -> bool {
    let usable = colors.filter(|color| color.is_finite());
    let largest = usable.fold(0.0, |largest: f32, color| largest.max(color.max_element()));
    (BEYOND_SHARES..=255.0).contains(&largest)
}

/// Linear RGBA of an sRGB colour with linear alpha. A colour that is not a number becomes white, so that one broken
/// vertex cannot spread through filters.
pub(crate) fn linear_rgba(rgb_srgb: Vec3, alpha: f32) -> Vec4 {
    let linear = rgb_srgb.to_array().map(linear_from_srgb);
    let color = Vec3::from(linear).extend(alpha);
    if color.is_finite() { color } else { Vec4::ONE }
}

/// A note about colours of a file that are no numbers, which [`linear_rgba`] makes white.
fn broken_colors_note(kind: &str, colors: impl Iterator<Item = bool>) -> Option<String> {
    let broken = colors.filter(|is_finite| !is_finite).count();
    (broken > 0).then(|| format!("made {} white that had no numbers", counted(broken, kind)))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// A unit square's half seen from +z, u to the right, v downwards.
    fn half_square() -> Model {
        Model {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            triangles: vec![[0, 1, 2]],
            corners: crate::CornerAttributes {
                normals: vec![Vec3::Z, Vec3::ZERO, Vec3::NAN],
                uv_sets: vec![vec![Vec2::new(0., 1.), Vec2::new(1., 1.), Vec2::new(0., 0.)]],
                tangents: vec![Vec4::ZERO],
                ..Default::default()
            },
            ..Default::default()
        }
    }

    #[test]
    fn missing_normals_and_tangents_follow_the_triangle() {
        let mut model = half_square();
        finish(&mut model).unwrap();
        assert_eq!(model.corners.normals, [Vec3::Z; 3]);
        assert_eq!(model.corners.tangents, [Vec4::new(1., 0., 0., 1.); 3]);
        assert_eq!(model.materials.len(), 1);
    }

    /// So that they are made smooth, as where a file has none.
    #[test]
    fn normals_that_are_all_zero_are_none() {
        let mut model = half_square();
        model.corners.normals = vec![Vec3::ZERO, Vec3::NAN, Vec3::ZERO];
        finish(&mut model).unwrap();
        assert!(model.corners.normals.is_empty());
    }

    #[test]
    fn mirrored_coordinates_turn_the_handedness() {
        let mut model = half_square();
        for uv in &mut model.corners.uv_sets[0] {
            uv.x = 1.0 - uv.x;
        }
        finish(&mut model).unwrap();
        assert_eq!(model.corners.tangents, [Vec4::new(-1., 0., 0., -1.); 3]);
    }

    #[test]
    fn degenerate_triangles_get_finite_vectors() {
        let mut model = half_square();
        model.positions = vec![DVec3::splat(f64::NAN); 3];
        finish(&mut model).unwrap();
        assert!(model.corners.normals.iter().all(|n| n.is_normalized()));
        assert!(model.corners.tangents.iter().all(|t| t.truncate().is_normalized()));
    }

    #[test]
    fn a_nan_colour_becomes_white() {
        assert_eq!(linear_rgba(Vec3::new(f32::NAN, 0.0, 0.0), 1.0), Vec4::ONE);
    }
}
