//! The log: what was painted, in terms that outlive resolution, density and mesh.
//!
//! ```text
//!  strokes/NUMBER         a stroke of a stroke file, as JSON: lengths in world units, places with their normals
//!  strokes/files/HASH.EXT the pictures and fonts that strokes mention
//! ```
//!
//! Both are attachments of the asset, committed with the texels and undone with them. So the log always says how the asset came to
//! look as it does, and can be replayed on another density or cover of the model, or on an edited mesh.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_base::files::{scratch_folder, write_whole};
use fantex_base::{Error, Result, input};
use fantex_store::{Asset, AssetEditor};
use fantex_texture::Image;
use xxhash_rust::xxh3::xxh3_64;

use crate::added::added_channels;
use crate::dab::MIN_ASPECT;
use crate::error::{damaged, malformed, temporary};
use crate::graph::{check_files, found_folder, kept_folder};
use crate::layers::{check_stack, find_folders};
use crate::replay::{place_on, prepare_fill};
use crate::stroke::mesh_length;
use crate::{
    Brush, ChannelSettings, ColorSettings, Dab, DabSettings, FillArea, LookSettings, Paint, PaintColor,
    Painter, ReplaySummary, Size, Stamp, StrokeFile, StrokeSettings, Surface, SurfacePoint, TextureGraph,
    Tool, ToolSettings, Where, replay,
};

pub(crate) const PREFIX: &str = "strokes/";

const FILES: &str = "strokes/files/";

/// Numbers of strokes are less, so that their names, of twelve digits, are in the same order.
pub(crate) const MAX_STROKES: u64 = 1_000_000_000_000;

/// Whether an attachment holds a stroke of the log.
pub(crate) fn is_stroke(name: &str) -> bool {
    name.starts_with(PREFIX) && !name.starts_with(FILES)
}

pub(crate) fn stroke_name(number: u64) -> String {
    format!("{PREFIX}{number:012}")
}

pub(crate) fn file_name(name: &str) -> String {
    format!("{PREFIX}{name}")
}

/// The number of the next stroke.
///
/// # Errors
/// There are strokes with numbers that none has.
pub(crate) fn next_number(editor: &AssetEditor) -> Result<u64> {
    let names = editor.attachment_names_with(PREFIX);
    let numbers = names.iter().filter_map(|name| name.strip_prefix(PREFIX)?.parse::<u64>().ok());
    match numbers.max() {
        None => Ok(0),
        Some(number) if number < MAX_STROKES => Ok(number + 1),
        Some(_) => Err(damaged(editor.asset(), "log of strokes", "its numbers are too large")),
    }
}

/// What a stroke of the log fills, and with what; none where that cannot be told any more.
pub(crate) fn logged_fill(painter: &Painter, number: u64) -> Option<(Paint, FillArea)> {
    let editor = painter.editor();
    let bytes = editor.attachment(&stroke_name(number)).ok()??;
    let mut stroke: StrokeSettings =
        serde_json::from_slice(&bytes).ok().filter(|s: &StrokeSettings| !s.unrecorded)?;
    find_looks(&mut stroke, editor.asset().path()).ok()?;
    let folder = scratch_folder().ok()?;
    for name in editor.attachment_names_with(FILES) {
        let contents = editor.attachment(&name).ok()??;
        save_file(folder.path(), kept_file(&name)?, &contents).ok()?;
    }
    prepare_fill(painter, &stroke, folder.path()).ok()?
}

/// A file of the log, from its attachment's name. None for names that no log has: they would choose where it is written.
fn kept_file(attachment: &str) -> Option<&Path> {
    let name = attachment.strip_prefix(FILES)?;
    let is_plain = !name.contains(['/', '\\', ':']) && Path::new(name).file_name() == Some(name.as_ref());
    let is_hash = |stem: &str| stem.len() == 16 && stem.bytes().all(|byte| byte.is_ascii_hexdigit());
    let is_hashed = name.split_once('.').is_some_and(|(stem, _)| is_hash(stem));
    (is_plain && is_hashed).then(|| Path::new(&attachment[PREFIX.len()..]))
}

fn save_file(folder: &Path, path: &Path, contents: &[u8]) -> std::io::Result<()> {
    let path = folder.join(path);
    path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
    std::fs::write(path, contents)
}

/// Contents of files that strokes mention, by the paths that they name.
pub type LoadedFiles = BTreeMap<PathBuf, Arc<[u8]>>;

/// The strokes of an asset, with the files that they mention.
#[derive(Clone, Debug, PartialEq)]
pub struct StrokeLog {
    /// In the order in which they were painted; what was undone is not among them.
    pub strokes: StrokeFile,
    /// Paths relative to the stroke file, and contents.
    files: Vec<(PathBuf, Vec<u8>)>,
}

impl StrokeLog {
    /// Reads the log of an asset; empty where nothing was painted.
    ///
    /// # Errors
    /// An attachment cannot be read, or is no stroke.
    pub fn of(asset: &Asset) -> Result<Self> {
        let damaged = || {
            let path = asset.path();
            let sentence =
                format!("the log of strokes of {} is damaged; its texels are not affected", path.display());
            Error::damaged(sentence).with_path(path)
        };
        let names = asset.attachment_names().map_err(|_| damaged())?;
        let (mut strokes, mut files) = (Vec::new(), Vec::new());
        for name in names {
            if !name.starts_with(PREFIX) {
                continue;
            }
            let bytes = asset.attachment(name).ok().flatten().ok_or_else(damaged)?;
            if name.starts_with(FILES) {
                files.push((kept_file(name).ok_or_else(damaged)?.to_owned(), bytes));
            } else {
                let mut stroke: StrokeSettings = serde_json::from_slice(&bytes).map_err(|_| damaged())?;
                find_looks(&mut stroke, asset.path())?;
                if stroke.lacks_places() {
                    // All its samples missed the surface: what is left to do is to make its layer.
                    stroke.channels.clear();
                }
                strokes.push(stroke);
            }
        }
        let add_channels = added_channels(asset)?;
        Ok(Self { strokes: StrokeFile { version: 1, add_channels, strokes }, files })
    }

    /// Writes a stroke file that can be replayed, and beside it the folder `files` with what it mentions.
    ///
    /// # Errors
    /// The system refuses.
    pub fn save(&self, path: &Path) -> Result<()> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let text = serde_json::to_string_pretty(&self.strokes).map_err(malformed)?;
        for (name, bytes) in &self.files {
            let path = folder.join(name);
            let made = path.parent().map_or(Ok(()), std::fs::create_dir_all);
            made.map_err(|source| Error::writing(&path, source))?;
            write_whole(&path, true, |out| out.write_all(bytes))?;
        }
        write_whole(path, true, |out| out.write_all(text.as_bytes()))
    }

    /// Paints all strokes onto another asset, by their places in the world. Commits nothing.
    ///
    /// # Errors
    /// As [`replay`], and where no temporary folder can be made for the files.
    pub fn replay(&self, painter: &mut Painter) -> Result<ReplaySummary> {
        let folder = scratch_folder()?;
        let saved = self.files.iter().try_for_each(|(path, bytes)| save_file(folder.path(), path, bytes));
        saved.map_err(temporary)?;
        replay(painter, &self.strokes, folder.path())
    }
}

// From what was painted to what is written down.

#[derive(Clone, Debug)]
pub(crate) enum Recording {
    /// It came with its settings.
    Settings(Box<Portable>),
    /// It came as dabs.
    Dabs(Vec<DabSettings>, Option<Arc<Stamp>>),
    /// Something about it cannot be said in a stroke file.
    Lost,
}

impl Recording {
    /// Adds dabs that `tool` has painted with, where they are not known from the settings.
    pub(crate) fn add_dabs(&mut self, surface: &Surface, tool: &Tool, dabs: &[Dab]) {
        let (known, stamp) = match self {
            Self::Dabs(known, stamp) => (known, stamp),
            Self::Settings(portable) => {
                if portable.gathers_dabs {
                    portable.name_source(surface, tool, dabs);
                    portable.stroke.dabs.extend(dabs.iter().map(|dab| settings_of_dab(surface, dab)));
                }
                return;
            }
            Self::Lost => return,
        };
        for dab in dabs {
            if known.is_empty() {
                *stamp = dab.stamp.clone();
            }
            let is_same = match (&*stamp, &dab.stamp) {
                (None, None) => true,
                (Some(a), Some(b)) => Arc::ptr_eq(a, b),
                _ => false,
            };
            if !is_same {
                *self = Self::Lost;
                return;
            }
            known.push(settings_of_dab(surface, dab));
        }
    }

    /// What is neither in the settings nor made of dabs is lost.
    pub(crate) fn lose(&mut self) {
        if matches!(self, Self::Dabs(..)) {
            *self = Self::Lost;
        }
    }
}

fn settings_of_dab(surface: &Surface, dab: &Dab) -> DabSettings {
    DabSettings {
        at: place_of(surface, dab.center),
        radius: (f64::from(dab.radius) * surface.mesh().world_from_mesh.scale) as f32,
        // What stroke files allow. Painting takes hardness and aspect so, too.
        hardness: dab.hardness.clamp(0.0, 1.0),
        flow: dab.flow.clamp(0.0, 1.0),
        angle: dab.angle,
        mirrored: dab.mirrored,
        aspect: dab.aspect.clamp(MIN_ASPECT, 1.0),
        across_gaps: dab.across_gaps,
        copy: dab.copy,
    }
}

/// A point as it is written down.
fn place_of(surface: &Surface, point: SurfacePoint) -> Where {
    let world_from_mesh = surface.mesh().world_from_mesh;
    let position = world_from_mesh.point(surface.position(point).as_vec3()).to_array();
    Where::Surface { position, normal: surface.outer_normal(point.triangle).as_vec3().to_array() }
}

/// A stroke in terms that fit any asset of the model, with the files that it mentions.
#[derive(Clone, Debug)]
pub(crate) struct Portable {
    pub(crate) stroke: StrokeSettings,
    pub(crate) files: Vec<(String, Vec<u8>)>,
    /// It says how, but not where: that comes as dabs.
    gathers_dabs: bool,
}

impl Portable {
    /// From the settings of a stroke file in a folder. `loaded` holds files that need not be read again.
    pub(crate) fn new(
        surface: &Surface,
        settings: StrokeSettings,
        folder: &Path,
        loaded: &LoadedFiles,
        asset: &Path,
    ) -> Result<Self> {
        let mut writer = Writer { surface, folder, loaded, asset, files: Vec::new() };
        let gathers_dabs = settings.samples.is_empty() && settings.dabs.is_empty() && settings.fill.is_none();
        let stroke = writer.stroke(settings)?;
        Ok(Self { stroke, files: writer.files, gathers_dabs })
    }

    /// Says where a clone copies from, once its first dab is known: a replay counts from that, not from the pen, which jitter
    /// may have moved it away from.
    fn name_source(&mut self, surface: &Surface, tool: &Tool, dabs: &[Dab]) {
        if let (Tool::Clone { offset, .. }, ToolSettings::Clone { from }) = (tool, &mut self.stroke.tool)
            && self.stroke.dabs.is_empty()
            && let Some(first) = dabs.first()
        {
            let source = surface.position(first.center).as_vec3() + *offset;
            *from = surface.mesh().world_from_mesh.point(source).to_array();
        }
    }
}

/// Refuses a stroke of a file, or of an asset's log, that mentions files outside the folder of that.
pub(crate) fn check_named(stroke: &StrokeSettings, owner: &Path) -> Result<()> {
    let stencil = stroke.stencil.as_ref().map(|stencil| &stencil.image);
    let decal = stroke.decal.as_ref().and_then(|decal| decal.shape.as_ref());
    let font = stroke.text.as_ref().and_then(|text| text.font.as_ref());
    let colors = stroke.channels.iter().filter_map(|channel| match &channel.color {
        ColorSettings::Image(path) | ColorSettings::Texture { look: LookSettings::File(path), .. } => {
            Some(path)
        }
        _ => None,
    });
    let named = [stroke.brush.stamp.as_ref(), stencil, decal, font].into_iter().flatten().chain(colors);
    named.into_iter().try_for_each(|path| input::check_inside(owner, path))
}

/// Makes the folders of looks that are kept in an asset absolute.
///
/// # Errors
/// The stroke mentions files that do not lie with the asset, and that is not allowed.
fn find_looks(stroke: &mut StrokeSettings, asset: &Path) -> Result<()> {
    check_named(stroke, asset)?;
    let fill = stroke.layer.as_mut().and_then(|layer| layer.fill.as_mut());
    let of_colors = stroke.channels.iter_mut().filter_map(|channel| match &mut channel.color {
        ColorSettings::Texture { look, .. } => Some(look),
        _ => None,
    });
    for look in of_colors.chain(fill.map(|fill| &mut fill.look)) {
        let LookSettings::Inline { text, folder } = look else {
            let sentence = format!("the log of {} names the file of a look", asset.display());
            return Err(Error::malformed(sentence));
        };
        *folder = found_folder(asset, folder);
        check_files(&TextureGraph { look: text.clone(), folder: folder.clone() }, asset)?;
    }
    stroke.set_layers.as_mut().map_or(Ok(()), |layers| {
        find_folders(layers, asset);
        check_stack(layers, asset)
    })
}

/// Puts a recording into such terms.
pub(crate) fn portable(
    surface: &Surface,
    asset: &Asset,
    paint: &Paint,
    recording: Recording,
) -> Result<Portable> {
    let lost = || Portable {
        stroke: StrokeSettings { unrecorded: true, ..StrokeSettings::default() },
        files: Vec::new(),
        gathers_dabs: false,
    };
    Ok(match recording {
        Recording::Settings(portable) => *portable,
        Recording::Dabs(dabs, stamp) => {
            let Some((tool, channels)) = settings_of(surface, asset, paint) else { return Ok(lost()) };
            let mut files = Vec::new();
            let mut brush = Brush { opacity: paint.opacity, ..Brush::default() };
            if let Some(stamp) = stamp {
                let bytes = picture_of(&stamp)?;
                let name = hashed_name(&bytes, "exr");
                brush.stamp = Some(PathBuf::from(&name));
                files.push((name, bytes));
            }
            Portable {
                stroke: StrokeSettings { brush, tool, channels, dabs, ..StrokeSettings::default() },
                files,
                gathers_dabs: false,
            }
        }
        Recording::Lost => lost(),
    })
}

/// A paint's settings; none where they cannot be said.
fn settings_of(
    surface: &Surface,
    asset: &Asset,
    paint: &Paint,
) -> Option<(ToolSettings, Vec<ChannelSettings>)> {
    if matches!(paint.tool, Tool::Clone { .. }) {
        // Where it starts is not known any more.
        return None;
    }
    let mut channels = Vec::with_capacity(paint.channels.len());
    for painted in paint.channels.iter().filter(|painted| !matches!(painted.color, PaintColor::Relief)) {
        let color = match &painted.color {
            PaintColor::Constant(color) => ColorSettings::Linear(color.to_array()),
            _ if paint.tool.reads_surface() => ColorSettings::default(),
            _ => return None,
        };
        let kind = asset.channels()[painted.channel].kind;
        channels.push(ChannelSettings { kind, color, components: painted.components });
    }
    Some((ToolSettings::of(&paint.tool, surface), channels))
}

struct Writer<'a> {
    surface: &'a Surface,
    folder: &'a Path,
    loaded: &'a LoadedFiles,
    asset: &'a Path,
    files: Vec<(String, Vec<u8>)>,
}

impl Writer<'_> {
    fn stroke(&mut self, mut stroke: StrokeSettings) -> Result<StrokeSettings> {
        self.length(&mut stroke.brush.size);
        if let ToolSettings::Blur { radius } = &mut stroke.tool {
            self.length(radius);
        }
        stroke.brush.stamp.iter_mut().try_for_each(|path| self.file(path))?;
        for channel in &mut stroke.channels {
            match &mut channel.color {
                ColorSettings::Image(path) => self.file(path)?,
                ColorSettings::Texture { look, .. } => self.look(look)?,
                _ => {}
            }
        }
        if let Some(stencil) = &mut stroke.stencil {
            self.file(&mut stencil.image)?;
        }
        if let Some(decal) = &mut stroke.decal {
            self.length(&mut decal.size);
            decal.shape.iter_mut().try_for_each(|path| self.file(path))?;
        }
        if let Some(text) = &mut stroke.text {
            self.length(&mut text.size);
            text.font.iter_mut().try_for_each(|path| self.file(path))?;
        }
        if let Some(fill) = stroke.layer.as_mut().and_then(|layer| layer.fill.as_mut()) {
            self.look(&mut fill.look)?;
        }
        let surface = self.surface;
        stroke.samples.retain_mut(|sample| {
            let point = place_on(surface, sample.at);
            point.map(|point| sample.at = place_of(surface, point)).is_some()
        });
        Ok(stroke)
    }

    /// In world units.
    fn length(&self, size: &mut Size) {
        let scale = self.surface.mesh().world_from_mesh.scale;
        *size = Size::World((f64::from(mesh_length(self.surface, *size)) * scale) as f32);
    }

    /// Takes a file along under the hash of its contents.
    fn file(&mut self, path: &mut PathBuf) -> Result<()> {
        let bytes = match self.loaded.get(path) {
            Some(bytes) => bytes.to_vec(),
            None => read(&self.folder.join(&*path))?,
        };
        let name = hashed_name(&bytes, kept_extension(path));
        *path = PathBuf::from(&name);
        self.files.push((name, bytes));
        Ok(())
    }

    /// Takes a look's text along; what it mentions stays where it is, and is found from the asset.
    fn look(&mut self, look: &mut LookSettings) -> Result<()> {
        let (text, folder) = match look {
            LookSettings::File(path) => {
                let path = self.folder.join(path);
                let text = String::from_utf8_lossy(&read(&path)?).into_owned();
                (text, path.parent().unwrap_or(Path::new("")).to_owned())
            }
            LookSettings::Inline { text, folder } => (std::mem::take(text), self.folder.join(folder)),
        };
        *look = LookSettings::Inline { text, folder: kept_folder(self.asset, &folder) };
        Ok(())
    }
}

fn read(path: &Path) -> Result<Vec<u8>> {
    input::read(path).map_err(|error| error.context("the log of strokes"))
}

/// The extension under which a file is kept: its own where that is plain, so that the log [takes](kept_file) the name.
fn kept_extension(path: &Path) -> &str {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let is_plain =
        (1..=16).contains(&extension.len()) && extension.bytes().all(|byte| byte.is_ascii_alphanumeric());
    if is_plain { extension } else { "bin" }
}

fn hashed_name(bytes: &[u8], extension: &str) -> String {
    format!("files/{:016x}.{extension}", xxh3_64(bytes))
}

/// A stamp as a picture file.
fn picture_of(stamp: &Stamp) -> Result<Vec<u8>> {
    let ([width, height], coverage) = stamp.texels();
    let texels: Vec<[f32; 4]> = coverage.iter().map(|&a| [1.0, 1.0, 1.0, a]).collect();
    let folder = scratch_folder()?;
    let path = folder.path().join("stamp.exr");
    let image = Image::from_linear_rgba(width as u32, height as u32, &texels);
    image.save(&path).map_err(malformed)?;
    std::fs::read(path).map_err(temporary)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_any_name_are_kept_under_names_that_the_log_takes() {
        for (path, extension) in
            [("a/b.png", "png"), ("b.TTF", "TTF"), ("b", "bin"), ("b.12:30", "bin"), ("b.c d", "bin")]
        {
            assert_eq!(kept_extension(Path::new(path)), extension);
            let name = file_name(&hashed_name(b"contents", extension));
            assert!(kept_file(&name).is_some(), "{name}");
        }
    }
}
