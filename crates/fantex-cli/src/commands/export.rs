//! `fantex export`: assets for programs that know no fans.

pub(super) mod turntable;
mod web;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::{Args, ValueEnum};
use fantex::base::percent;
use fantex::export::{
    ChannelMap, Depth, ExportOptions, ExportSummary, FanFileOptions, FanSheetOptions, ShaderLanguage,
    SheetPictures, UvChoice, export_channels, export_fans, export_model,
};
use fantex::store::Asset;
use fantex::texture::Filter;
use fantex::{
    Error, ErrorKind, FileKind, ModelKind, Result, World, export_world, export_world_fans, model_notes,
    stand_in_note,
};
use serde::Serialize;

use crate::context::Context;
use crate::scene::{FILTERS, SurroundingsArgs, open_asset, open_model, size};
use crate::text::{Choices, ShownPath, counted, megabytes, one_of, whole};

/// Export an asset or a world for other programs: a model with texture coordinates, single channels, a turntable.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex export bottle.fan -o bottle.glb
  fantex export bottle.fan -o bottle.gltf --size 4096 --textures png+ktx2
  fantex export bottle.fan -o bottle-fans.usda --fans
  fantex export bottle.fan -o bottle-fans.usda --fans --textures exr
  fantex export bottle.fan -o bottle-fans.gltf --fans --shader godot
  fantex export bottle.fan -o bottle.glb --uv source
  fantex export bottle.fan -o normal.png --channel normal --depth 16
  fantex export bottle.fan -o bottle.png --channel base-color,normal,orm
  fantex export bottle.fan -o turn.png --turntable 48 --size 640x640
  fantex export bottle.fan -o pictures --turntable 120
  fantex export bottle.fan -o page --web --title \"A bottle\" --credits \"by Ada, CC BY 4.0\"
  fantex export land.fanworld -o land.glb

A .glb has its pictures inside; a .gltf has a .bin and PNG files beside it. A single channel becomes .png, .exr or \
.ktx2 and lies as in the model. A turntable becomes one animated PNG (.png) or numbered pictures in a folder. \
A world becomes one model: a node for each of its assets, with pictures of its own (--size is the side of each). \
A page (--web) is a folder for any web server that sends ranges of files; browsers show it by WebGPU. \
Padding keeps foreign texels away from every piece at each level at which a texel covers up to --padding texels.")]
pub(crate) struct ExportArgs {
    /// An asset (.fan) or a world (.fanworld), also at an https://, s3://, gs:// or az:// address
    asset: PathBuf,
    /// What to write: .glb or .gltf; with --channel .png, .exr or .ktx2; with --turntable .png or a folder; with --web a folder
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Texture coordinates: a packing of its own, or those of the model that was baked
    #[arg(long, value_enum, default_value_t)]
    uv: UvArg,
    /// The model whose texture coordinates are used, if the asset has kept none; it must have the asset's triangles
    #[arg(long, value_name = "MODEL", conflicts_with = "turntable")]
    model: Option<PathBuf>,
    /// Side of the pictures, a power of two [default: the asset's density]; or WxH of a turntable's [default: 800x600]
    #[arg(long, value_name = "N|WxH", allow_negative_numbers = true, value_parser = picture_size)]
    size: Option<PictureSize>,
    /// The largest side that is taken by default, or of a sheet with --fans
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 8192, value_parser = whole::<u32>, conflicts_with_all = ["size", "turntable", "web"])]
    max_size: u32,
    /// Texels around each piece of an own packing, a power of two [default: a 128th of the side, 2 to 16; with --fans 4]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole::<u32>)]
    padding: Option<u32>,
    /// The pictures of a model; KTX2 (BC7, BC5, all levels, zstd) and OpenEXR files (linear half floats) come beside it
    #[arg(long, value_parser = one_of(&TEXTURES), default_value = "png", conflicts_with_all = ["channel", "turntable"])]
    textures: SheetPictures,
    /// Write the fans themselves: sheets of tiles and three coordinates per corner, for shaders that blend them; .glb, .gltf,
    /// or .usda with a MaterialX file and pictures beside it
    #[arg(long, conflicts_with_all = ["channel", "turntable", "uv", "model", "size"])]
    fans: bool,
    /// Write a shader that blends fans beside the model, too; several with commas
    #[arg(long, value_name = "LANGUAGE", value_parser = one_of(&SHADERS), value_delimiter = ',', requires = "fans")]
    shader: Vec<ShaderLanguage>,
    /// Write a page that shows the asset or the world in a browser
    #[arg(long, conflicts_with_all = ["channel", "turntable", "fans", "uv", "model", "size", "padding", "textures"])]
    web: bool,
    /// What the page is called [default: the asset's name]
    #[arg(long, requires = "web")]
    title: Option<String>,
    /// Who made what it shows, and under which licence
    #[arg(long, requires = "web", default_value = "", hide_default_value = true)]
    credits: String,
    /// Where the folder will be on the web, so that links to it have a preview (https://...)
    #[arg(long, value_name = "URL", requires = "web", default_value = "", hide_default_value = true)]
    base_url: String,
    /// Write channels alone; several with commas, as NAME-CHANNEL beside the output
    #[arg(long, value_parser = one_of(&CHANNELS), value_delimiter = ',', conflicts_with = "turntable")]
    channel: Vec<ChannelMap>,
    /// Bits per sample of a channel's PNG
    #[arg(long, value_parser = one_of(&DEPTHS), default_value = "8", requires = "channel")]
    depth: Depth,
    /// Number of pictures around the model
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=3600))]
    turntable: Option<u32>,
    /// Seconds of a whole turn of an animated PNG, at most 1000 [default: 4]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, requires = "turntable", value_parser = turntable::whole_turn)]
    seconds: Option<f64>,
    /// Samples per pixel of a turntable, 1 to 64
    #[arg(
        long,
        value_name = "N",
        allow_negative_numbers = true,
        default_value_t = 8,
        requires = "turntable"
    )]
    samples: u32,
    /// How a turntable's textures are filtered
    #[arg(long, value_parser = one_of(&FILTERS), default_value = "anisotropic", requires = "turntable")]
    filter: Filter,
    #[command(flatten)]
    surroundings: SurroundingsArgs,
}

/// Where texture coordinates come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum UvArg {
    /// An own packing of few large pieces
    #[default]
    Atlas,
    /// The model's
    Source,
}

const CHANNELS: Choices<ChannelMap, 10> = [
    ("base-color", "Colour, with opacity where something shows through", ChannelMap::BaseColor),
    ("opacity", "Opacity alone", ChannelMap::Opacity),
    ("normal", "Normals in tangent space, +y up", ChannelMap::Normal),
    ("orm", "Red = occlusion, green = roughness, blue = metallic", ChannelMap::OcclusionRoughnessMetallic),
    ("occlusion", "Occlusion alone", ChannelMap::Occlusion),
    ("roughness", "Roughness alone", ChannelMap::Roughness),
    ("metallic", "Metallic alone", ChannelMap::Metallic),
    ("emission", "Emitted light", ChannelMap::Emission),
    ("displacement", "Height", ChannelMap::Displacement),
    ("light", "Light that arrives", ChannelMap::Light),
];

const DEPTHS: Choices<Depth, 2> = [("8", "Eight bits", Depth::Eight), ("16", "Sixteen bits", Depth::Sixteen)];

const SHADERS: Choices<ShaderLanguage, 4> = [
    ("glsl", "Functions in GLSL", ShaderLanguage::Glsl),
    ("wgsl", "Functions in WGSL", ShaderLanguage::Wgsl),
    ("hlsl", "Functions in HLSL", ShaderLanguage::Hlsl),
    ("godot", "A spatial shader for Godot 4", ShaderLanguage::Godot),
];

const TEXTURES: Choices<SheetPictures, 4> = [
    ("png", "PNG, which every program reads", SheetPictures::Png),
    ("png+ktx2", "PNG, and the same pictures as KTX2 files for engines", SheetPictures::PngAndKtx2),
    ("png+exr", "PNG, and the sheets of --fans as OpenEXR files", SheetPictures::PngAndExr),
    ("exr", "The sheets of --fans as OpenEXR files, which a .usda refers to", SheetPictures::Exr),
];

/// A side, or width and height.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PictureSize {
    Side(u32),
    WidthHeight([u32; 2]),
}

fn picture_size(text: &str) -> Result<PictureSize> {
    let side = text.parse().ok().filter(|&n: &u32| n > 0).map(PictureSize::Side);
    side.or_else(|| size(text).ok().map(PictureSize::WidthHeight)).ok_or_else(|| {
        Error::invalid("expected a side such as 2048, or for a turntable width x height such as 800x600")
    })
}

#[derive(Debug, Serialize)]
struct FileInfo {
    path: ShownPath,
    bytes: u64,
}

#[derive(Debug, Serialize)]
struct ExportInfo {
    output: ShownPath,
    /// Assets of a world; left out for one asset.
    #[serde(skip_serializing_if = "Option::is_none")]
    objects: Option<usize>,
    /// Tiles of fans instead of an atlas.
    fans: bool,
    #[serde(flatten)]
    model: ModelInfo,
    seconds: f64,
}

/// A model with pictures, or pictures alone.
#[derive(Debug, Serialize)]
pub(crate) struct ModelInfo {
    files: Vec<FileInfo>,
    /// Longer sides of the pictures in texels, one per page.
    sizes: Vec<u32>,
    /// Columns and rows of the pictures, one pair per page.
    extents: Vec<[u32; 2]>,
    channels: Vec<&'static str>,
    /// Pieces of an own packing.
    charts: usize,
    padding: u32,
    /// Share of the texels that lie on the surface.
    used_share: f64,
    /// Share of those that several triangles claim.
    overlapping_share: f64,
    /// Texels per length relative to the asset's.
    density_share: f64,
    texels: u64,
    triangles: u64,
    vertices: usize,
}

impl ModelInfo {
    pub(crate) fn new(summary: &ExportSummary) -> Self {
        Self {
            files: summary
                .files
                .iter()
                .map(|(path, bytes)| FileInfo { path: path.into(), bytes: *bytes })
                .collect(),
            sizes: summary.sizes.iter().map(|[columns, rows]| *columns.max(rows)).collect(),
            extents: summary.sizes.clone(),
            channels: summary.maps.iter().map(|m| m.name()).collect(),
            charts: summary.charts,
            padding: summary.padding,
            used_share: summary.used_share,
            overlapping_share: summary.overlapping_share,
            density_share: summary.density_share,
            texels: summary.texels,
            triangles: summary.triangles,
            vertices: summary.vertices,
        }
    }

    /// Of all files.
    pub(crate) fn bytes(&self) -> u64 {
        self.files.iter().map(|file| file.bytes).sum()
    }

    /// What it is; `piece`: what its charts are called.
    pub(crate) fn text(&self, piece: &str) -> String {
        let bytes = self.bytes();
        let pieces = match self.charts {
            0 => "the model's coordinates".to_owned(),
            charts => format!("{}, padding {}", counted(charts as u64, piece), self.padding),
        };
        format!(
            "{} texels ({} % used; {pieces}), {}, {} in {}",
            sizes(&self.extents),
            percent(self.used_share),
            counted(self.triangles, "triangle"),
            megabytes(bytes),
            counted(self.files.len() as u64, "file")
        )
    }

    /// The files besides the output, a line each.
    pub(crate) fn others(&self, output: &Path) -> String {
        let others = self.files.iter().filter(|f| *f.path != *output);
        others.map(|file| format!("  {} {}\n", file.path.display(), megabytes(file.bytes))).collect()
    }
}

pub(crate) fn run(args: &ExportArgs, context: &Context) -> Result<()> {
    if let Some(count) = args.turntable {
        return turntable::run(args, count, context);
    }
    refuse_options_of_turntables(args)?;
    if args.web {
        return web::run(args, context);
    }
    check_options(args)?;
    let side = side_of_pictures(args)?;
    let started = Instant::now();
    let input = Input::open(args)?;
    for output in outputs(args) {
        context.check_output_of(&output, &args.asset)?;
    }
    let model = args.model.as_deref().map(|path| open_model(path, context)).transpose()?;
    let options = ExportOptions {
        uv: match (&model, args.uv) {
            (Some(model), _) => UvChoice::OfModel(model),
            (None, UvArg::Source) => UvChoice::OfAsset,
            (None, UvArg::Atlas) => UvChoice::Atlas,
        },
        side,
        largest_side: args.max_size,
        texels: None,
        padding: args.padding,
        with_ktx2: args.textures == SheetPictures::PngAndKtx2,
        force: context.force,
        strict: context.strict,
        memory_bytes: context.memory_bytes,
    };
    let exported = {
        let _deferral = context.defer_interrupt();
        write(&input, args, &options, context)
    };
    let summary = exported.map_err(|error| match error.kind() {
        ErrorKind::Damaged => error.in_file(&args.asset),
        _ => error,
    })?;
    let kind = ModelKind::Exported { fans: args.fans, padding: args.padding };
    model_notes(&args.output, &summary, kind).iter().for_each(|note| context.note(note));
    if let Some((tiles, first)) = &summary.damage {
        context.report_damage(stand_in_note(&args.asset, *tiles, first))?;
    }
    let seconds = started.elapsed().as_secs_f64();
    context.print(&info(args, &input, &summary, seconds), text)
}

/// Refuses options that only turntables have.
fn refuse_options_of_turntables(args: &ExportArgs) -> Result<()> {
    let of_turntables = [
        ("--environment", args.surroundings.is_given()),
        ("--background", args.surroundings.has_background()),
    ];
    if let Some((option, _)) = of_turntables.iter().find(|(_, is_given)| *is_given) {
        return Err(Error::invalid(format!(
            "{option} belongs to a turntable; give --turntable, too, or leave it out"
        )));
    }
    Ok(())
}

/// Refuses options that do not go together, or with the output's kind.
fn check_options(args: &ExportArgs) -> Result<()> {
    if args.padding.is_some() && (args.uv == UvArg::Source || args.model.is_some()) {
        return Err(Error::invalid(
            "--padding is of a packing of its own, and the model's texture coordinates stay as they are; leave it out",
        ));
    }
    if args.depth != Depth::Eight && !has_extension(&args.output, "png") {
        return Err(Error::invalid(format!(
            "--depth says how many bits a .png has, and {} is none; leave it out",
            args.output.display()
        )));
    }
    let is_picture = ["png", "exr", "ktx2"].iter().any(|e| has_extension(&args.output, e));
    if args.channel.is_empty() && is_picture {
        return Err(Error::invalid(format!(
            "{} is a picture: say which with --channel base-color, normal, orm ..., or make a --turntable; a model is .glb or .gltf",
            args.output.display()
        )));
    }
    if args.channel.is_empty() && !args.fans {
        check_model_kind(&args.output)?;
    }
    if !args.fans && matches!(args.textures, SheetPictures::PngAndExr | SheetPictures::Exr) {
        return Err(Error::invalid(
            "--textures has exr for the sheets of --fans alone; write channels of an atlas with --channel and an .exr file",
        ));
    }
    Ok(())
}

/// The side that was asked for.
fn side_of_pictures(args: &ExportArgs) -> Result<Option<u32>> {
    match args.size {
        Some(PictureSize::WidthHeight([width, height])) => Err(Error::invalid(format!(
            "{width}x{height} is a turntable's size; the pictures of a model are square: give one number, such as --size 2048"
        ))),
        Some(PictureSize::Side(side)) => Ok(Some(side)),
        None => Ok(None),
    }
}

/// Writes the files of an export.
fn write(
    input: &Input,
    args: &ExportArgs,
    options: &ExportOptions<'_>,
    context: &Context,
) -> Result<ExportSummary> {
    let progress = context.progress("export");
    match (input, &args.channel[..]) {
        (Input::Asset(asset), []) if args.fans => {
            export_fans(asset, &args.output, &fan_options(args, context), &progress)
        }
        (Input::Asset(asset), []) => export_model(asset, &args.output, options, &progress),
        (Input::World(world), _) if args.fans => {
            let fans = fan_options(args, context);
            export_world_fans(&args.asset, world, &args.output, &fans, &progress)
        }
        (Input::World(world), _) => export_world(&args.asset, world, &args.output, options, &progress),
        (Input::Asset(asset), kinds) => {
            let files = outputs(args);
            let channels: Vec<(ChannelMap, &Path)> =
                kinds.iter().copied().zip(files.iter().map(PathBuf::as_path)).collect();
            export_channels(asset, &channels, args.depth, options, &progress)
        }
    }
}

/// Refuses kinds of models that are written in another way, or by another command.
fn check_model_kind(output: &Path) -> Result<()> {
    let is_any = |extensions: &[&str]| extensions.iter().any(|e| has_extension(output, e));
    let how = if is_any(&["usda"]) {
        "a .usda is written with --fans; give it, too, or use .glb or .gltf"
    } else if is_any(&["usd", "usdc", "usdz"]) {
        "USD is written as .usda and with --fans; give both, or use .glb or .gltf"
    } else if is_any(&["obj", "ply", "stl"]) {
        "models with pictures are written as .glb or .gltf; 'fantex simplify' writes a mesh alone as .obj or .ply"
    } else {
        return Ok(());
    };
    Err(Error::invalid(format!("cannot write {}: {how}", output.display())))
}

/// What is exported.
enum Input {
    Asset(Arc<Asset>),
    World(World),
}

impl Input {
    /// Opens it; a world is refused where an option is for one asset.
    fn open(args: &ExportArgs) -> Result<Self> {
        if FileKind::of(&args.asset)? != FileKind::World {
            return Ok(Self::Asset(open_asset(&args.asset)?));
        }
        let of_one = [
            ("--channel", !args.channel.is_empty()),
            ("--model", args.model.is_some()),
            ("--shader", !args.shader.is_empty()),
        ];
        if let Some((option, _)) = of_one.iter().find(|(_, is_given)| *is_given) {
            let path = args.asset.display();
            return Err(Error::invalid(format!(
                "{option} is for one asset, and {path} is a world, an index of assets; leave it out, or give one of its assets (.fan)"
            )));
        }
        Ok(Self::World(World::open(&args.asset)?))
    }
}

fn fan_options(args: &ExportArgs, context: &Context) -> FanFileOptions {
    let sheets = FanSheetOptions {
        gutter: args.padding.unwrap_or(FanSheetOptions::default().gutter),
        largest_side: args.max_size,
        memory_bytes: context.memory_bytes,
    };
    FanFileOptions {
        sheets,
        pictures: args.textures,
        shaders: args.shader.clone(),
        force: context.force,
        strict: context.strict,
    }
}

/// The output, or the files of the channels.
fn outputs(args: &ExportArgs) -> Vec<PathBuf> {
    match &args.channel[..] {
        [] => vec![args.output.clone()],
        kinds => kinds.iter().map(|&kind| channel_file(&args.output, kind, kinds.len())).collect(),
    }
}

/// The file of one of so many channels: several lie beside the output, under its name and theirs.
fn channel_file(output: &Path, kind: ChannelMap, count: usize) -> PathBuf {
    if count == 1 {
        return output.to_owned();
    }
    let mut name = output.file_stem().unwrap_or_default().to_owned();
    name.push(format!("-{}.", kind.name()));
    name.push(output.extension().unwrap_or_default());
    output.with_file_name(name)
}

fn info(args: &ExportArgs, input: &Input, summary: &ExportSummary, seconds: f64) -> ExportInfo {
    ExportInfo {
        output: (&args.output).into(),
        objects: match input {
            Input::Asset(_) => None,
            Input::World(world) => Some(world.objects.len()),
        },
        fans: args.fans,
        model: ModelInfo::new(summary),
        seconds,
    }
}

fn text(info: &ExportInfo) -> String {
    let objects =
        info.objects.map_or_else(String::new, |count| format!("{}, ", counted(count as u64, "object")));
    let model = info.model.text(if info.fans { "tile" } else { "piece" });
    // Several channels are in files of other names than the one that was given.
    let files = &info.model.files;
    let is_output = files.iter().any(|file| file.path == info.output) || files.is_empty();
    let heading = if is_output { info.output.display().to_string() } else { "channels".to_owned() };
    format!("{heading}: {objects}{model}, {:.1} s\n{}", info.seconds, info.model.others(&info.output))
}

/// Sizes that many pictures have are said once.
fn sizes(extents: &[[u32; 2]]) -> String {
    let mut counts: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    extents.iter().for_each(|&extent| *counts.entry(extent).or_default() += 1);
    let size = |[columns, rows]: &[u32; 2]| format!("{columns} x {rows}");
    let sizes: Vec<String> = match extents.len() {
        0..=2 => extents.iter().map(size).collect(),
        _ => counts.iter().map(|(extent, count)| format!("{count} times {}", size(extent))).collect(),
    };
    sizes.join(" and ")
}

pub(crate) fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}
