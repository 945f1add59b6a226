//! `fantex info`: what is in a file, and for a model the cover that it would get.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Instant;

use clap::Args;
use fantex::cover::{Cover, CoverStats, Percentiles, pack};
use fantex::look::LookFile;
use fantex::look::data::{FileName, Look};
use fantex::look::look_of_model;
use fantex::store::{Asset, PREVIEW};
use fantex::{Baker, Covered, Error, FileKind, LongestEdge, Mesh, Progress, Result, smallest_tiles_note};
use serde::Serialize;

use super::world::print_world;
use crate::context::Context;
use crate::cover_pictures;
use crate::scene::{Input, ReadArgs};
use crate::text::{Count, ShownPath, Table, bend, grouped, megabytes, over_budget, positive, whole};

/// Show what is in a model, an asset, a world or a look, and the cover that a model would get.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex info bunny.ply --texels 5.59M
  fantex info bunny.ply --json --picture out/bunny
  fantex info bunny.fan
  fantex info scene.toml
  fantex info bottle.gltf --look > bottle.toml

With --look, the model's own materials are printed as a look, which 'fantex render MODEL --look' and 'fantex bake MODEL --look' take.")]
pub(crate) struct InfoArgs {
    /// A model (.glb .gltf .obj .ply .stl), an asset (.fan) or a world (.fanworld), also at an https://, s3://, gs:// or az:// address, or a look (.toml)
    file: PathBuf,
    /// Print the model's own materials as a look
    #[arg(long, conflicts_with_all = ["texels", "density", "tile", "longest_edge", "hard_edges", "picture", "weld"])]
    look: bool,
    #[command(flatten)]
    cover: CoverArgs,
    /// Draw the cover, the projection directions and the packed texture: a folder, or the start of the files' names
    #[arg(long, value_name = "DIR|PREFIX")]
    picture: Option<PathBuf>,
    #[command(flatten)]
    read: ReadArgs,
}

/// How a model is covered.
#[derive(Args, Clone, Debug)]
pub(crate) struct CoverArgs {
    /// Texels in all, e.g. 64k or 4M (1k = 1000) [default: the density of the model's textures, more where they are small; 4M without]
    #[arg(long, value_name = "N", allow_negative_numbers = true, conflicts_with = "density")]
    pub(crate) texels: Option<Count>,
    /// Texels per world unit of length, everywhere
    #[arg(long, value_name = "D", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) density: Option<f64>,
    /// Longest side of a tile of several fans in texels; 0 gives every fan its own tile. A surface that
    /// 512 or more would tear into many pieces gets up to eight times as much [default: 1024]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole::<u32>)]
    pub(crate) tile: Option<u32>,
    /// Cut triangles at bends until their edges are at most so many texels long; auto: as far as it makes textures sharper, which it does on
    /// models of few large triangles. 0 and --tile 0 leave them whole [default: auto]
    #[arg(long, value_name = "N|auto")]
    pub(crate) longest_edge: Option<LongestEdgeArg>,
    /// Cut the texture at edges whose two triangles' normals differ by at least so many degrees, e.g. 60 for those of boxes: sharper on models
    /// of flat faces, and not continuous there [default: continuous everywhere]
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, value_parser = bend)]
    pub(crate) hard_edges: Option<f32>,
}

/// `auto` or texels.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LongestEdgeArg(pub(crate) LongestEdge);

impl FromStr for LongestEdgeArg {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "auto" => Ok(Self(LongestEdge::Automatic)),
            _ => match text.parse() {
                Ok(texels) => Ok(Self(LongestEdge::Texels(texels))),
                Err(_) => Err("expected a number of texels or auto".into()),
            },
        }
    }
}

impl CoverArgs {
    /// The first option that is given.
    pub(crate) fn given(&self) -> Option<&'static str> {
        let given = [
            ("--texels", self.texels.is_some()),
            ("--density", self.density.is_some()),
            ("--tile", self.tile.is_some()),
            ("--longest-edge", self.longest_edge.is_some()),
            ("--hard-edges", self.hard_edges.is_some()),
        ];
        given.into_iter().find(|(_, is_given)| *is_given).map(|(option, _)| option)
    }

    /// Whether texels or a density were asked for.
    fn has_budget(&self) -> bool {
        self.texels.is_some() || self.density.is_some()
    }

    /// A baker with these texels, limits of tiles and edges, and hard edges.
    pub(crate) fn given_to<'m>(&self, mut baker: Baker<'m>) -> Baker<'m> {
        if let Some(Count(texels)) = self.texels {
            baker = baker.texels(texels);
        }
        if let Some(density) = self.density {
            baker = baker.density(density);
        }
        if let Some(tile) = self.tile {
            baker = baker.tile(tile);
        }
        if let Some(LongestEdgeArg(longest_edge)) = self.longest_edge {
            baker = baker.longest_edge(longest_edge);
        }
        if let Some(degrees) = self.hard_edges {
            baker = baker.hard_edges(degrees);
        }
        baker
    }
}

#[derive(Debug, Serialize)]
struct Stretch {
    p1: f32,
    median: f32,
    p99: f32,
}

impl From<Percentiles> for Stretch {
    fn from(p: Percentiles) -> Self {
        Self { p1: p.p1, median: p.median, p99: p.p99 }
    }
}

#[derive(Debug, Serialize)]
struct Seconds {
    load: f64,
    clean: f64,
    cover: f64,
}

/// The virtual texture: all tiles on one sheet.
#[derive(Debug, Serialize)]
struct Sheet {
    width: u32,
    height: u32,
    /// Share of the sheet that tiles cover.
    fill: f64,
}

impl Sheet {
    fn of(cover: &Cover) -> Self {
        let extents: Vec<_> = cover.groups.iter().map(|g| g.extent).collect();
        let packing = pack(&extents);
        Self { width: packing.width, height: packing.height, fill: packing.fill(&extents) }
    }
}

#[derive(Debug, Serialize)]
struct ModelInfo {
    kind: &'static str,
    triangles: u64,
    /// Those of the mesh that is covered.
    triangles_cut: u64,
    vertices: u64,
    components: u64,
    boundary_edges: u64,
    nonmanifold_edges: u64,
    nonmanifold_vertices: u64,
    genus: Option<u64>,
    fans: u64,
    fans_projected: u64,
    fans_unfolded: u64,
    fans_split: u64,
    fans_folding: u64,
    groups: u64,
    tiles: u64,
    /// Stored: in blocks that something reads.
    texels: u64,
    /// Where a number was asked for. Many small tiles may hold more.
    texels_asked: Option<u64>,
    /// Of the tiles' rectangles.
    tile_texels: u64,
    density_share: f64,
    worst_share: f64,
    gap_share: f64,
    margin_share: f64,
    overlap_share: f64,
    loss_db: f64,
    texels_per_ideal_texel: f64,
    lookups_per_sample: f64,
    stretch: Stretch,
    density_spread: Stretch,
    sheet: Sheet,
    seconds: Seconds,
    report: Vec<String>,
    pictures: Vec<ShownPath>,
}

#[derive(Debug, Serialize)]
struct ChannelInfo {
    kind: String,
    format: String,
    srgb: bool,
}

#[derive(Debug, Serialize)]
struct AssetInfo {
    kind: &'static str,
    triangles: u64,
    vertices: u64,
    groups: u64,
    tiles: u64,
    groups_projected: u64,
    groups_unfolded: u64,
    texels: u64,
    tile_texels: u64,
    bytes: u64,
    levels: u32,
    clusters: u64,
    /// Degrees from which on edges were cut for the texture, where that was asked for.
    hard_edges: Option<f32>,
    /// Of its preview, where there is one.
    preview_bytes: Option<u64>,
    channels: Vec<ChannelInfo>,
    sheet: Sheet,
    pictures: Vec<ShownPath>,
}

pub(crate) fn run(args: &InfoArgs, context: &Context) -> Result<()> {
    let of_covers = args.cover.given().or(args.read.weld.map(|_| "--weld"));
    let of_meshes = of_covers.or(args.picture.as_ref().map(|_| "--picture"));
    match Input::open(&args.file, args.read, context)? {
        Input::Model(model) if args.look => print_look_of_model(&model, context),
        Input::Asset(_) | Input::Look(_) | Input::World(_) if args.look => Err(Error::unsupported(format!(
            "{} is no model, and only models have materials that are printed as a look",
            args.file.display()
        ))),
        Input::Look(file) => match of_meshes {
            Some(option) => Err(Error::invalid(format!(
                "{option} has no meaning for a look, which has no mesh: leave it out, or give the model that {} is for",
                args.file.display()
            ))),
            None => print_look(&file, context),
        },
        Input::World(_) if of_meshes.is_some() => Err(FileKind::world_instead(&args.file)),
        Input::World(world) => print_world(&world, &args.file, context),
        Input::Model(model) => {
            let info = of_model(&model, args, context)?;
            context.print(&info, |info| model_text(info, &args.file))
        }
        Input::Asset(asset) => match of_covers {
            Some(option) => Err(Error::invalid(format!(
                "{option} has no meaning for an asset: {} has its cover already",
                args.file.display()
            ))),
            None => {
                let info = of_asset(&asset, args, context)?;
                context.print(&info, |info| asset_text(info, &args.file))
            }
        },
    }
}

/// The cover that a model gets: that of its textures, which have a density of their own, unless texels are asked for. Where they get none,
/// `report` says why, and that for the default number of texels is shown.
fn covered<'m>(
    mesh: &'m Mesh,
    args: &CoverArgs,
    progress: &'m dyn Progress,
    report: &mut Vec<String>,
) -> Result<Covered<'m>> {
    let baker = || args.given_to(Baker::new(mesh)).progress(progress);
    let of_textures = match mesh.has_materials() && !args.has_budget() {
        true => baker().cover().map(Some),
        false => Ok(None),
    };
    let of_textures = of_textures.or_else(|error| match error.is_cancelled() {
        true => Err(error),
        false => {
            report.push(format!(
                "Shown is the cover for 4 million texels, as there is none for its textures: {error}."
            ));
            Ok(None)
        }
    })?;
    match of_textures {
        Some(covered) => Ok(covered),
        None => baker().cover_shape(),
    }
}

fn of_model(mesh: &Mesh, args: &InfoArgs, context: &Context) -> Result<ModelInfo> {
    let started = Instant::now();
    let mut report = mesh.notes().to_vec();
    let progress = context.step("covering", "M texels");
    let Covered { mesh: covered, cover, stats, texels_asked, left_out, .. } =
        covered(mesh, &args.cover, &progress, &mut report)?;
    if context.strict {
        left_out.check()?;
    }
    report.extend(left_out.notes());
    let seconds = Seconds {
        load: mesh.load_time().as_secs_f64(),
        clean: mesh.clean_time().as_secs_f64(),
        cover: started.elapsed().as_secs_f64(),
    };
    let note = over_budget(texels_asked, &stats).or_else(|| smallest_tiles_note(&cover, &stats));
    let CoverStats {
        fans,
        groups,
        texels,
        density_share,
        worst_share,
        gap_share,
        margin_share,
        overlap_share,
        loss_db,
        lookups_per_sample,
        stretch,
        density_spread,
        ..
    } = stats;
    report.extend(note.map(|note| format!("{note}.")));
    let shape = &mesh.report().topology;
    Ok(ModelInfo {
        kind: "model",
        triangles: mesh.triangles.len() as u64,
        triangles_cut: covered.triangles.len() as u64,
        vertices: mesh.positions.len() as u64,
        components: shape.components,
        boundary_edges: shape.edges_boundary,
        nonmanifold_edges: shape.edges_non_manifold,
        nonmanifold_vertices: shape.vertices_non_manifold,
        genus: shape.genus(),
        fans: fans.total,
        fans_projected: fans.projected,
        fans_unfolded: fans.unfolded,
        // Every fan can be laid flat.
        fans_split: 0,
        fans_folding: fans.folding,
        groups,
        tiles: groups,
        texels,
        texels_asked,
        tile_texels: cover.texels(),
        density_share,
        worst_share,
        gap_share,
        margin_share,
        overlap_share,
        loss_db,
        texels_per_ideal_texel: 1.0 / density_share,
        lookups_per_sample,
        stretch: stretch.into(),
        density_spread: density_spread.into(),
        sheet: Sheet::of(&cover),
        seconds,
        report,
        pictures: draw(&covered, &cover, args, context)?,
    })
}

fn of_asset(asset: &Asset, args: &InfoArgs, context: &Context) -> Result<AssetInfo> {
    let (mesh, cover) = (asset.mesh(), asset.cover());
    let unfolded =
        cover.groups.iter().filter(|g| g.kind == fantex::cover::GroupKind::Unfolded).count() as u64;
    let groups = cover.groups.len() as u64;
    let channel = |c: &fantex::store::Channel| ChannelInfo {
        kind: format!("{:?}", c.kind),
        format: c.format.to_string(),
        srgb: c.srgb,
    };
    Ok(AssetInfo {
        kind: "asset",
        triangles: mesh.triangles.len() as u64,
        vertices: mesh.positions.len() as u64,
        groups,
        tiles: groups,
        groups_projected: groups - unfolded,
        groups_unfolded: unfolded,
        texels: cover.stored_texels(mesh),
        tile_texels: cover.texels(),
        bytes: asset.file_bytes(),
        levels: asset.level_count(),
        clusters: (0..asset.level_count()).map(|level| asset.cluster_ranges(level).len() as u64).sum(),
        hard_edges: cover.hard_edges,
        preview_bytes: asset.attachment_bytes(PREVIEW).ok().flatten(),
        channels: asset.channels().iter().map(channel).collect(),
        sheet: Sheet::of(cover),
        pictures: draw(mesh, cover, args, context)?,
    })
}

/// Draws the pictures that were asked for and returns their paths.
fn draw(
    mesh: &fantex::mesh::Mesh,
    cover: &Cover,
    args: &InfoArgs,
    context: &Context,
) -> Result<Vec<ShownPath>> {
    match &args.picture {
        Some(target) => {
            Ok(cover_pictures::draw(mesh, cover, target, context)?.into_iter().map(ShownPath::from).collect())
        }
        None => Ok(Vec::new()),
    }
}

fn model_text(info: &ModelInfo, path: &Path) -> String {
    let share = |p: &Stretch| format!("{:.3} / {:.3} / {:.3}", p.p1, p.median, p.p99);
    let genus = info.genus.map_or(String::new(), |genus| format!(", genus {genus}"));
    let mut table = Table::default();
    table
        .row("model", path.display().to_string())
        .row("triangles", grouped(info.triangles))
        .row("  cut into", grouped(info.triangles_cut))
        .row("vertices", grouped(info.vertices))
        .row("components", format!("{}{genus}", grouped(info.components)))
        .row("fans", grouped(info.fans))
        .row("  projected", grouped(info.fans_projected))
        .row("  unfolded", grouped(info.fans_unfolded))
        .row("  seen from no side", grouped(info.fans_folding))
        .row("groups = tiles", grouped(info.groups))
        .row("texels", grouped(info.texels))
        .row("share of ideal density", format!("{:.3}", info.density_share))
        .row("  in the worst direction", format!("{:.3}", info.worst_share))
        .row("texels beside outlines", format!("{:.3}", info.margin_share))
        .row("  read twice", format!("{:.3}", info.overlap_share))
        .row("  left out of rectangles", format!("{:.3}", info.gap_share))
        .row("loss beside ideal texels", format!("{:.2} dB", info.loss_db))
        .row("texels per ideal texel", format!("{:.3}", info.texels_per_ideal_texel))
        .row("look-ups per sample", format!("{:.3}", info.lookups_per_sample))
        .row("stretch, 1 % / median / 99 %", share(&info.stretch))
        .row("density, 1 % / median / 99 %", share(&info.density_spread))
        .row("one sheet", sheet_text(&info.sheet))
        .row(
            "seconds",
            format!(
                "load {:.3}, clean {:.3}, cover {:.3}",
                info.seconds.load, info.seconds.clean, info.seconds.cover
            ),
        );
    table.rows("cleaning", &info.report);
    table.rows("picture", info.pictures.iter().map(|path| shown(path)));
    table.to_text()
}

fn asset_text(info: &AssetInfo, path: &Path) -> String {
    let mut table = Table::default();
    table
        .row("asset", path.display().to_string())
        .row("triangles", grouped(info.triangles))
        .row("vertices", grouped(info.vertices))
        .row("groups = tiles", grouped(info.groups))
        .row("  projected", grouped(info.groups_projected))
        .row("  unfolded", grouped(info.groups_unfolded))
        .row("texels per channel", grouped(info.texels))
        .row("bytes", format!("{} ({})", grouped(info.bytes), megabytes(info.bytes)))
        .row("levels", info.levels.to_string())
        .row("clusters", grouped(info.clusters))
        .row("one sheet", sheet_text(&info.sheet));
    table.rows("hard edges", info.hard_edges.map(|degrees| format!("cut from {degrees} degrees on")));
    table.rows("preview", info.preview_bytes.map(megabytes));
    for channel in &info.channels {
        let encoding = if channel.srgb { "sRGB" } else { "linear" };
        table.row("channel", format!("{}, {}, {encoding}", channel.kind, channel.format));
    }
    table.rows("picture", info.pictures.iter().map(|path| shown(path)));
    table.to_text()
}

fn sheet_text(sheet: &Sheet) -> String {
    format!("{} x {} texels, {:.1} % used", sheet.width, sheet.height, 100.0 * sheet.fill)
}

fn shown(path: &Path) -> String {
    path.display().to_string()
}

#[derive(Debug, Serialize)]
struct LookInfo {
    kind: &'static str,
    file: ShownPath,
    /// Kind of each texture by its name.
    textures: BTreeMap<String, String>,
    materials: Vec<String>,
    objects: u64,
    lights: u64,
    has_environment: bool,
    frames: u32,
    /// Models and assets that the look names.
    models: Vec<ShownPath>,
}

pub(crate) fn print_look(file: &LookFile, context: &Context) -> Result<()> {
    let look = file.look();
    let resolved = |name: &FileName| file.file(name);
    let info = LookInfo {
        kind: "look",
        file: file.path().into(),
        textures: kinds(look),
        materials: look.materials.keys().cloned().collect(),
        objects: look.object.len() as u64,
        lights: look.light.len() as u64,
        has_environment: look.environment.is_some(),
        frames: look.picture.frames.as_ref().map_or(1, |frames| frames.count),
        models: look
            .object
            .iter()
            .filter_map(|object| object.model.as_ref().map(resolved))
            .map(ShownPath::from)
            .collect(),
    };
    context.print(&info, look_text)
}

/// The key `kind` of each texture.
fn kinds(look: &Look) -> BTreeMap<String, String> {
    let kind = |value: serde_json::Value| value["kind"].as_str().unwrap_or_default().to_owned();
    let kind_of = |table| kind(serde_json::to_value(table).unwrap_or_default());
    look.textures.iter().map(|(name, table)| (name.clone(), kind_of(table))).collect()
}

fn look_text(info: &LookInfo) -> String {
    let mut table = Table::default();
    table.row("look", info.file.display().to_string());
    table.rows("texture", info.textures.iter().map(|(name, kind)| format!("{name}: {kind}")));
    table.rows("material", &info.materials);
    table.row("objects", info.objects.to_string()).row("lights", info.lights.to_string());
    table.row("environment", if info.has_environment { "yes" } else { "no" });
    table.row("frames", info.frames.to_string());
    table.rows("model", info.models.iter().map(|path| shown(path)));
    table.to_text()
}

#[derive(Debug, Serialize)]
struct Translation {
    look: Look,
    /// For each material of the model its name in the look.
    materials: Vec<String>,
}

/// Prints a model's own materials as a look.
pub(crate) fn print_look_of_model(model: &Mesh, context: &Context) -> Result<()> {
    let (path, translated) = (model.path(), look_of_model(model));
    let text = translated.look.to_toml();
    let text = text.map_err(|problem| problem.in_file(path))?;
    let head = format!("# The materials of {}, as a look.\n\n", path.display());
    let translation = Translation { look: translated.look, materials: translated.materials };
    context.print(&translation, |_| head + &text)
}
