//! MTL material libraries ("Alias/WaveFront Material (.mtl) File Format", 1995), with the physically based additions
//! `Pr Pm map_Pr map_Pm norm` that current exporters write. Without `-imfchan`, `map_Pr` is read from green and `map_Pm` from blue: that is glTF's
//! packing where both are one image, and any channel of a grey one.
//!
//! Colours (`Kd`, `Ke`) are taken as sRGB, like vertex colours and textures. A black `Kd` beside `map_Kd`, which exporters write that have no
//! factor, counts as white. `Tr 1` without `d`, which MeshLab writes for what is opaque, counts as opaque. What follows `map_Bump` is a [`BumpImage`]. What metallic-roughness cannot express is left out with a note, and so are
//! changes of a map's brightness and contrast (`-mm`).

use std::collections::{HashMap, HashSet};
use std::error::Error as _;
use std::path::{Path, PathBuf};

use fantex_base::{Error, Result};
use glam::{Mat3, Vec2, Vec3};

use super::obj::{at_line, line_end, not_a_number, number, too_few_numbers, words};
use crate::load::{SourceFile, linear_rgba, locate, read_file, relative_path, shown};
use crate::{
    AlphaMode, BumpImage, ImageChannel, ImageSource, Material, PackedChannel, PackedImage, TextureRef,
    WrapMode,
};

#[derive(Default)]
pub(super) struct Library {
    pub(super) materials: Vec<Material>,
    /// Index into `materials`.
    pub(super) of_name: HashMap<String, usize>,
    pub(super) images: Vec<ImageSource>,
    /// Where each image is first named.
    pub(super) image_places: Vec<String>,
    /// Index into `images`.
    of_path: HashMap<PathBuf, usize>,
    /// Index into `images`, of those made of channels of others.
    of_channels: HashMap<[Option<(usize, ImageChannel)>; 4], usize>,
    /// Index into `images`, of bump maps by the image that they are made of.
    of_bump: HashMap<(usize, [WrapMode; 2]), usize>,
    pub(super) notes: Vec<String>,
}

/// Reads the libraries that exist; a missing one is noted.
///
/// # Errors
/// A library that exists but is broken, with its own path and line.
pub(super) fn load_libraries(file: &SourceFile, names: &[String]) -> Result<Library> {
    let mut library = Library::default();
    let mut done = HashSet::new();
    for name in names.iter().flat_map(|written| library_names(file, written)) {
        let Some(relative) = relative_path(name) else { continue };
        let path = match locate(file.path, &relative) {
            Ok(path) => path,
            Err(error) => {
                library.notes.push(error.to_string());
                continue;
            }
        };
        if !done.insert(path.clone()) {
            continue;
        }
        match read_file(&path, &file.limits) {
            Ok(bytes) => Reader::new(&path, &mut library).read(&bytes)?,
            Err(error) => match error.source() {
                Some(why) => library.notes.push(format!("the material file {name} cannot be read: {why}")),
                None => return Err(error),
            },
        }
    }
    Ok(library)
}

/// The files that `mtllib` names: one, which may have spaces in its name, or several with spaces between.
fn library_names<'a>(file: &SourceFile, written: &'a str) -> Vec<&'a str> {
    let is_there = |name: &str| {
        let path = relative_path(name).and_then(|relative| locate(file.path, &relative).ok());
        path.is_some_and(|path| path.is_file())
    };
    let several: Vec<&str> = written.split_ascii_whitespace().collect();
    if is_there(written) || !several.iter().any(|name| is_there(name)) { vec![written] } else { several }
}

struct Reader<'a> {
    path: &'a Path,
    library: &'a mut Library,
    line: usize,
    current: Option<Pending>,
}

/// A material with what is decided only when all its lines are known.
#[derive(Default)]
struct Pending {
    material: Material,
    /// Where `map_d`, `map_Pr` and `map_Pm` are, and the channels that `-imfchan` says.
    opacity: Option<ScalarMap>,
    roughness: Option<ScalarMap>,
    metalness: Option<ScalarMap>,
    has_emission_factor: bool,
    /// `Pr` says it directly, `Ns` only approximates.
    has_roughness: bool,
    /// `d` counts where both are given: some programs write `Tr` with the meaning of `d`.
    has_dissolve: bool,
    skipped: Vec<&'static str>,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path, library: &'a mut Library) -> Self {
        Self { path, library, line: 0, current: None }
    }

    fn read(mut self, bytes: &[u8]) -> Result<()> {
        let line_end = line_end(bytes);
        for line in bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).split(|&b| b == line_end) {
            self.line += 1;
            self.read_line(line.trim_ascii()).map_err(|error| at_line(error, self.line, self.path))?;
        }
        self.end_material();
        Ok(())
    }

    /// Where the reader is, for messages.
    fn place(&self) -> String {
        format!("line {} of {}", self.line, self.path.file_name().unwrap_or_default().to_string_lossy())
    }

    fn read_line(&mut self, line: &[u8]) -> Result<()> {
        let keyword = &line[..line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len())];
        let arguments = line[keyword.len()..].trim_ascii();
        if keyword.is_empty() || keyword[0] == b'#' {
            return Ok(());
        }
        if keyword == b"newmtl" {
            self.end_material();
            let name = String::from_utf8_lossy(arguments).into_owned();
            let material = Material { name, place: self.place(), ..Material::default() };
            self.current = Some(Pending { material, ..Pending::default() });
            return Ok(());
        }
        let Some(mut pending) = self.current.take() else {
            let keyword = shown(keyword);
            return Err(Error::malformed(format!("{keyword} stands before the first newmtl")));
        };
        let result = self.read_property(&mut pending, &keyword.to_ascii_lowercase(), arguments);
        self.current = Some(pending);
        result
    }

    fn read_property(&mut self, pending: &mut Pending, keyword: &[u8], arguments: &[u8]) -> Result<()> {
        let material = &mut pending.material;
        match keyword {
            // Spectral curves and CIE XYZ: no exporter writes them, and they are no numbers that could be read as RGB.
            b"kd" | b"ke" if arguments.starts_with(b"spectral") || arguments.starts_with(b"xyz") => {
                pending.skipped.push("a spectral colour");
            }
            b"kd" => {
                let alpha = material.base_color.w;
                material.base_color = color("Kd", arguments)?.extend(alpha);
            }
            b"ke" => {
                material.emission = color("Ke", arguments)?;
                pending.has_emission_factor = true;
            }
            b"d" => {
                material.base_color.w = scalar("d", arguments)?;
                pending.has_dissolve = true;
            }
            b"tr" => {
                let transparency = scalar("Tr", arguments)?;
                if !pending.has_dissolve {
                    material.base_color.w = 1.0 - transparency;
                }
            }
            b"pr" => {
                material.roughness = scalar("Pr", arguments)?.clamp(0.0, 1.0);
                pending.has_roughness = true;
            }
            b"pm" => material.metallic = scalar("Pm", arguments)?.clamp(0.0, 1.0),
            b"ns" => {
                let exponent = scalar("Ns", arguments)?.max(0.0);
                if !pending.has_roughness {
                    // m = 2 / roughness^4 - 2 for Blinn-Phong with perceptual roughness (B. Karis 2013).
                    material.roughness = (2.0 / (exponent + 2.0)).powf(0.25);
                }
            }
            b"map_kd" => material.base_color_texture = self.texture(arguments).map(|t| t.texture),
            b"map_ke" => material.emission_texture = self.texture(arguments).map(|t| t.texture),
            b"norm" | b"map_norm" | b"map_bump" | b"bump" => {
                self.read_normal_map(pending, keyword, arguments)
            }
            b"map_d" => pending.opacity = self.scalar_map(arguments),
            b"map_pr" => pending.roughness = self.scalar_map(arguments),
            b"map_pm" => pending.metalness = self.scalar_map(arguments),
            // Exporters write zeros for what a material does not have.
            b"ps" if scalar("Ps", arguments)? > 0.0 => pending.skipped.push("sheen (Ps)"),
            b"pc" if scalar("Pc", arguments)? > 0.0 => pending.skipped.push("clearcoat (Pc)"),
            b"aniso" if scalar("aniso", arguments)? != 0.0 => pending.skipped.push("aniso"),
            b"map_ps" => pending.skipped.push("map_Ps"),
            b"map_pc" => pending.skipped.push("map_Pc"),
            b"map_ks" => pending.skipped.push("map_Ks"),
            b"map_ns" => pending.skipped.push("map_Ns"),
            b"disp" => pending.skipped.push("disp"),
            b"decal" => pending.skipped.push("decal"),
            _ => {}
        }
        Ok(())
    }

    /// Exporters write tangent-space normal maps after `map_Bump` too; heights are told apart when the image is decoded.
    fn read_normal_map(&mut self, pending: &mut Pending, keyword: &[u8], arguments: &[u8]) {
        let Some(mut parsed) = self.texture(arguments) else { return };
        let is_bump = !keyword.ends_with(b"norm");
        if is_bump && pending.material.normal_texture.is_some() {
            return;
        }
        if is_bump {
            let name = &pending.material.name;
            self.library.notes.push(format!(
                "the bump map of material {name:?} is read as heights where it is grey, else as a normal map"
            ));
            parsed.texture.image = self.bump(&parsed.texture);
        }
        pending.material.normal_scale = parsed.bump_scale;
        pending.material.normal_texture = Some(parsed.texture);
    }

    fn end_material(&mut self) {
        let Some(mut pending) = self.current.take() else { return };
        let Material { name, base_color, base_color_texture, .. } = &mut pending.material;
        if base_color.w == 0.0 && !pending.has_dissolve {
            base_color.w = 1.0;
            self.library.notes.push(format!(
                "material {name:?}: Tr 1 would hide it, and was taken as opaque, as MeshLab means it"
            ));
        }
        if base_color_texture.is_some() && base_color.truncate() == Vec3::ZERO {
            *base_color = Vec3::ONE.extend(base_color.w);
            self.library.notes.push(format!(
                "material {name:?}: Kd is black, which would hide map_Kd, and was taken as white"
            ));
        }
        if pending.material.emission_texture.is_some() && !pending.has_emission_factor {
            pending.material.emission = Vec3::ONE;
        }
        if let Some(opacity) = pending.opacity.take() {
            self.add_opacity(&mut pending, opacity);
        }
        if pending.material.base_color.w < 1.0 {
            pending.material.alpha = AlphaMode::Blend;
        }
        self.add_surface(&mut pending);
        if !pending.skipped.is_empty() {
            let (name, list) = (&pending.material.name, pending.skipped.join(", "));
            self.library.notes.push(format!(
                "material {name:?}: {list} has no place in metallic-roughness and was left out"
            ));
        }
        let materials = &mut self.library.materials;
        // A later definition of the same name counts.
        self.library.of_name.insert(pending.material.name.clone(), materials.len());
        materials.push(pending.material);
    }

    /// The alpha of the base colour.
    fn add_opacity(&mut self, pending: &mut Pending, opacity: ScalarMap) {
        let material = &mut pending.material;
        let base = material.base_color_texture.clone();
        let is_its_alpha = |base: &TextureRef| {
            base.image == opacity.texture.image && matches!(opacity.channel, None | Some(ImageChannel::Alpha))
        };
        if base.as_ref().is_some_and(is_its_alpha) {
            material.alpha = AlphaMode::Blend;
            return;
        }
        if base.as_ref().is_some_and(|base| !lies_alike(base, &opacity.texture)) {
            pending.skipped.push("map_d with other options than map_Kd");
            return;
        }
        let color = base.as_ref().map(|base| base.image);
        let color = |channel| color.map(|image| (image, channel));
        let alpha = (opacity.texture.image, opacity.channel.unwrap_or(ImageChannel::Opacity));
        let channels =
            [color(ImageChannel::Red), color(ImageChannel::Green), color(ImageChannel::Blue), Some(alpha)];
        let image = self.packed(channels);
        material.base_color_texture = Some(TextureRef { image, ..base.unwrap_or(opacity.texture) });
        material.alpha = AlphaMode::Blend;
    }

    /// Roughness in green and metalness in blue of one texture; a map stands for its number.
    fn add_surface(&mut self, pending: &mut Pending) {
        let material = &mut pending.material;
        let roughness = pending.roughness.take();
        let mut metalness = pending.metalness.take();
        if let (Some(first), Some(second)) = (&roughness, &metalness)
            && !lies_alike(&first.texture, &second.texture)
        {
            pending.skipped.push("map_Pm with other options than map_Pr");
            metalness = None;
        }
        let place = |map: &Option<ScalarMap>, usual| {
            map.as_ref().map(|map| (map.texture.image, map.channel.unwrap_or(usual)))
        };
        let green = place(&roughness, ImageChannel::Green);
        let blue = place(&metalness, ImageChannel::Blue);
        let Some(texture) = roughness.as_ref().or(metalness.as_ref()).map(|map| map.texture.clone()) else {
            return;
        };
        let is_usual = green.is_some_and(|(image, channel)| {
            channel == ImageChannel::Green
                && blue.map_or(material.metallic == 0.0, |blue| blue == (image, ImageChannel::Blue))
        });
        let image = if is_usual { texture.image } else { self.packed([None, green, blue, None]) };
        if green.is_some() {
            material.roughness = 1.0;
        }
        if blue.is_some() {
            material.metallic = 1.0;
        }
        material.metallic_roughness_texture = Some(TextureRef { image, ..texture });
    }

    /// An image of channels of others.
    fn packed(&mut self, channels: [Option<(usize, ImageChannel)>; 4]) -> usize {
        let Library { images, image_places, of_channels, .. } = &mut *self.library;
        *of_channels.entry(channels).or_insert_with(|| {
            let mut parts: Vec<usize> = channels.iter().flatten().map(|&(image, _)| image).collect();
            parts.dedup();
            let places: Vec<&str> = parts.into_iter().map(|image| image_places[image].as_str()).collect();
            let place = places.join(" and ");
            image_places.push(place);
            let channels = channels.map(|of| {
                let (image, channel) = of?;
                Some(PackedChannel { source: images[image].clone(), channel })
            });
            images.push(ImageSource::Packed(Box::new(PackedImage { channels })));
            images.len() - 1
        })
    }

    /// The image of a texture as a bump map.
    fn bump(&mut self, texture: &TextureRef) -> usize {
        let Library { images, image_places, of_bump, .. } = &mut *self.library;
        *of_bump.entry((texture.image, texture.wrap)).or_insert_with(|| {
            image_places.push(image_places[texture.image].clone());
            let source = images[texture.image].clone();
            images.push(ImageSource::Bump(Box::new(BumpImage { source, wrap: texture.wrap })));
            images.len() - 1
        })
    }

    fn scalar_map(&mut self, arguments: &[u8]) -> Option<ScalarMap> {
        self.texture(arguments).map(|ParsedTexture { texture, channel, .. }| ScalarMap { texture, channel })
    }

    /// Reads `-option values ... file name`; None without a file name.
    fn texture(&mut self, arguments: &[u8]) -> Option<ParsedTexture> {
        let text = String::from_utf8_lossy(arguments).into_owned();
        let options = MapOptions::parse(&text);
        if options.levels != [0.0, 1.0] {
            let [base, gain] = options.levels;
            let place = self.place();
            self.library.notes.push(format!(
                "{place}: \"-mm {base} {gain}\", which changes the numbers of the map, was left out; change the image itself"
            ));
        }
        let path = locate(self.path, &relative_path(options.file_name)?);
        let path = path.map_err(|error| self.library.notes.push(error.to_string())).ok()?;
        let wrap = if options.clamp { WrapMode::Clamp } else { WrapMode::Repeat };
        let texture = TextureRef {
            image: self.image(path),
            uv_set: 0,
            uv_transform: options.uv_transform(),
            wrap: [wrap; 2],
            nearest: false,
        };
        Some(ParsedTexture { texture, bump_scale: options.bump_scale, channel: options.channel })
    }

    fn image(&mut self, path: PathBuf) -> usize {
        let place = self.place();
        let Library { images, image_places, of_path, .. } = &mut *self.library;
        *of_path.entry(path).or_insert_with_key(|path| {
            image_places.push(place);
            images.push(ImageSource::File(path.clone()));
            images.len() - 1
        })
    }
}

struct ParsedTexture {
    texture: TextureRef,
    bump_scale: f32,
    channel: Option<ImageChannel>,
}

/// A map that gives one number.
struct ScalarMap {
    texture: TextureRef,
    channel: Option<ImageChannel>,
}

/// Whether two textures show a point of the surface at the same place of their images.
fn lies_alike(a: &TextureRef, b: &TextureRef) -> bool {
    (a.uv_set, a.uv_transform, a.wrap) == (b.uv_set, b.uv_transform, b.wrap)
}

struct MapOptions<'a> {
    offset: Vec2,
    scale: Vec2,
    clamp: bool,
    bump_scale: f32,
    /// What `-mm` adds to the numbers of the map, and multiplies them by.
    levels: [f32; 2],
    /// `-imfchan`, except for the depth that no picture has.
    channel: Option<ImageChannel>,
    file_name: &'a str,
}

impl<'a> MapOptions<'a> {
    /// File names may hold spaces, so everything after the last option is the name.
    fn parse(text: &'a str) -> Self {
        let mut options = Self {
            offset: Vec2::ZERO,
            scale: Vec2::ONE,
            clamp: false,
            bump_scale: 1.0,
            levels: [0.0, 1.0],
            channel: None,
            file_name: text,
        };
        while let Some((name, mut rest)) =
            next_word(options.file_name).filter(|(word, _)| word.starts_with('-'))
        {
            match name.to_ascii_lowercase().as_str() {
                "-o" => options.offset = take_vector(&mut rest, Vec2::ZERO),
                "-s" => options.scale = take_vector(&mut rest, Vec2::ONE),
                "-t" => _ = take_vector(&mut rest, Vec2::ZERO),
                "-mm" => {
                    options.levels = [0.0, 1.0].map(|usual| take_number(&mut rest).unwrap_or(usual));
                }
                "-bm" => options.bump_scale = take_number(&mut rest).unwrap_or(1.0),
                "-boost" | "-texres" => _ = take_number(&mut rest),
                "-clamp" => {
                    options.clamp = take_word(&mut rest).is_some_and(|w| w.eq_ignore_ascii_case("on"))
                }
                "-imfchan" => options.channel = take_word(&mut rest).and_then(channel),
                "-blendu" | "-blendv" | "-cc" | "-type" => _ = take_word(&mut rest),
                // A file name that begins with a hyphen.
                _ => break,
            }
            options.file_name = rest;
        }
        options
    }

    /// Written for coordinates with v upwards, `uv' = scale * uv + offset`; ours run downwards on both sides:
    /// `1 - (scale * (1 - v) + offset) = scale * v + 1 - scale - offset`.
    fn uv_transform(&self) -> Mat3 {
        let translation = Vec2::new(self.offset.x, 1.0 - self.scale.y - self.offset.y);
        Mat3::from_translation(translation) * Mat3::from_scale(self.scale)
    }
}

fn channel(name: &str) -> Option<ImageChannel> {
    match name.to_ascii_lowercase().as_str() {
        "r" => Some(ImageChannel::Red),
        "g" => Some(ImageChannel::Green),
        "b" => Some(ImageChannel::Blue),
        "m" => Some(ImageChannel::Alpha),
        "l" => Some(ImageChannel::Luminance),
        _ => None,
    }
}

fn next_word(text: &str) -> Option<(&str, &str)> {
    let text = text.trim_start();
    let end = text.find(char::is_whitespace).unwrap_or(text.len());
    (end > 0).then(|| text.split_at(end))
}

fn take_word<'a>(rest: &mut &'a str) -> Option<&'a str> {
    let (word, after) = next_word(rest)?;
    *rest = after;
    Some(word)
}

fn take_number(rest: &mut &str) -> Option<f32> {
    let (word, after) = next_word(rest)?;
    let value = word.parse().ok().filter(|x: &f32| x.is_finite())?;
    *rest = after;
    Some(value)
}

/// One to three numbers `u v w`; those left out have the default.
fn take_vector(rest: &mut &str, default: Vec2) -> Vec2 {
    let x = take_number(rest);
    let y = x.and_then(|_| take_number(rest));
    _ = y.and_then(|_| take_number(rest));
    Vec2::new(x.unwrap_or(default.x), y.unwrap_or(default.y))
}

/// Up to three numbers of an sRGB colour, as linear light; one number is a grey.
fn color(keyword: &str, arguments: &[u8]) -> Result<Vec3> {
    let mut numbers = words(arguments).take(3).map(number);
    let r = numbers.next().ok_or_else(|| too_few_numbers(keyword, 1, 0))??;
    let g = numbers.next().transpose()?.unwrap_or(r);
    let b = numbers.next().transpose()?.unwrap_or(g);
    let encoded = glam::DVec3::new(r, g, b).as_vec3();
    Ok(linear_rgba(encoded.max(Vec3::ZERO), 1.0).truncate())
}

fn scalar(keyword: &str, arguments: &[u8]) -> Result<f32> {
    // `d -halo 0.5` is allowed.
    let word = words(arguments).find(|word| !word.starts_with(b"-halo"));
    let word = word.ok_or_else(|| too_few_numbers(keyword, 1, 0))?;
    let value = number(word)? as f32;
    if value.is_finite() { Ok(value) } else { Err(not_a_number(word)) }
}
