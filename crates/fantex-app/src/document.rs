//! Models and assets that are open, and what is worth telling about them.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU16, Ordering::Relaxed};

use fantex::bake::Progress;
use fantex::base::files::folder_of;
use fantex::base::{Error, Result};
use fantex::cover::{Cover, GroupKind};
use fantex::gpu::ModelSpace;
use fantex::mesh::{
    AlphaMode, CleanOptions, CleanReport, LoadOptions, Material, Mesh, WorldFromMesh, clean, load,
};
use fantex::paint::{PaintOptions, Painter};
use fantex::scene::world_bounds;
use fantex::store::{Asset, ChannelKind, cover_level_count};
use fantex::stream::{open_asset, url_of};
use fantex::{FileKind, World, WorldObject};

use crate::camera::SceneScale;
use crate::paint::{Answer, Exchange, Made, Question, asset_beside, asset_of_model};
use crate::text::{bytes_text, grouped, short_number};

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    File(PathBuf),
    /// An address: `https://...`, `s3://...` ([`url_of`](fantex::stream::url_of)).
    Url(String),
}

impl Place {
    /// What was typed.
    pub fn parse(text: impl AsRef<OsStr>) -> Self {
        let path = Path::new(text.as_ref());
        url_of(path).map_or_else(|| Self::File(path.to_owned()), |url| Self::Url(url.to_owned()))
    }

    /// Whether both are the same file or address, however a file is spelled.
    pub fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::File(path), Self::File(other)) => real_path(path) == real_path(other),
            _ => self == other,
        }
    }

    /// The asset that is painted on where this is, which may not be there yet.
    pub fn painted(&self) -> Self {
        match self {
            Self::File(path) if matches!(FileKind::of(path), Ok(FileKind::Model)) => {
                Self::File(asset_beside(path))
            }
            place => place.clone(),
        }
    }

    /// Its last part, for titles.
    pub fn name(&self) -> String {
        match self {
            Self::File(path) => path
                .file_name()
                .map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned()),
            Self::Url(url) => {
                let path = url.split(['?', '#']).next().unwrap_or(url).trim_end_matches('/');
                path.rsplit('/').next().unwrap_or(path).to_owned()
            }
        }
    }
}

/// A file's real path, where links and dots lead. The file need not be there.
fn real_path(path: &Path) -> PathBuf {
    let beside = || Some(folder_of(path).canonicalize().ok()?.join(path.file_name()?));
    path.canonicalize().ok().or_else(beside).unwrap_or_else(|| path.to_owned())
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::File(path) => path.display().fmt(f),
            Self::Url(url) => f.write_str(url),
        }
    }
}

#[derive(Clone, Debug)]
pub enum Content {
    Model(Arc<Mesh>),
    Asset(Arc<Asset>),
    World(Arc<WorldContent>),
}

/// An index of assets, and what stands for them where a mesh is asked for.
#[derive(Debug)]
pub struct WorldContent {
    /// Where it was read.
    pub index: PathBuf,
    pub world: Arc<World>,
    /// The objects' boxes.
    pub boxes: Arc<Mesh>,
}

#[derive(Clone, Debug)]
pub struct Document {
    pub place: Place,
    pub content: Content,
    pub scale: SceneScale,
    /// What was noticed when it was opened: one sentence each.
    pub notes: Vec<String>,
    pub model_facts: Vec<Fact>,
    /// Names and values for the cover panel; none for models.
    pub cover_facts: Vec<Fact>,
    pub channels: Vec<ChannelFact>,
    /// Where its painter leaves pages that have changed, where there is one.
    pub exchange: Option<Arc<Exchange>>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fact {
    pub name: &'static str,
    pub value: String,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChannelFact {
    pub kind: &'static str,
    pub format: String,
}

/// The error of what was given up.
pub fn cancelled() -> Error {
    Error::cancelled("opening was cancelled")
}

/// A look has no geometry of its own that is shown here.
fn is_look_error(path: &Path) -> Error {
    let sentence =
        format!("{} is a look; open a model (.glb .gltf .obj .ply .stl) or an asset (.fan)", path.display());
    Error::unsupported(sentence).with_path(path)
}

/// What becomes of an asset's channels before it is painted on.
#[derive(Clone, Debug, PartialEq)]
pub enum ChannelChange {
    Add(Vec<ChannelKind>),
    Remove(Vec<ChannelKind>),
    /// What its materials make of alpha.
    Alpha(AlphaMode),
}

impl ChannelChange {
    /// Opens an asset to paint on, with this change. Where it cannot be made, the asset shows what it showed, and the reason comes back,
    /// too.
    fn open(
        &self,
        path: &Path,
        options: &PaintOptions,
        progress: &OpenProgress,
    ) -> Result<(Painter, Result<()>)> {
        let mut painter = Painter::open_with_progress(path, options, &progress.part(0.0, 0.3))?;
        let made = match self {
            Self::Add(kinds) => painter.add_channels(kinds),
            Self::Remove(kinds) => painter.remove_channels(kinds),
            Self::Alpha(mode) => painter.set_alpha_mode(*mode),
        };
        Ok((painter, made))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Stage {
    Reading,
    Cleaning,
    Covering,
    Baking,
    Channels,
    Preparing,
}

impl Stage {
    pub const ALL: [(Self, &'static str); 6] = [
        (Self::Reading, "Reading"),
        (Self::Cleaning, "Cleaning the mesh"),
        (Self::Covering, "Covering the mesh"),
        (Self::Baking, "Making an asset to paint on"),
        (Self::Channels, "Changing channels"),
        (Self::Preparing, "Preparing textures"),
    ];
}

/// Share of the preparation of what is painted on that its painter takes; the rest is the graphics card's.
pub const PAINTER_SHARE: f32 = 0.6;

/// The thread that opens and the one that shows talk through this.
#[derive(Debug, Default)]
pub struct OpenProgress {
    stage: AtomicU8,
    /// Of the stage, per mille.
    share: AtomicU16,
    is_cancelled: AtomicBool,
}

impl Progress for OpenProgress {
    fn report(&self, done: u64, total: u64) {
        if self.stage() == Stage::Covering {
            self.stage.store(Stage::Baking as u8, Relaxed);
        }
        self.share.store((done.saturating_mul(1000) / total.max(1)).min(1000) as u16, Relaxed);
    }

    fn prepare(&self, _: &'static str, share: f32) {
        self.stage.store(Stage::Covering as u8, Relaxed);
        self.share.store((1000.0 * share) as u16, Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Relaxed)
    }
}

impl OpenProgress {
    pub fn stage(&self) -> Stage {
        Stage::ALL[usize::from(self.stage.load(Relaxed))].0
    }

    /// How much of the stage is done, 0..1; none where that is not known.
    pub fn share(&self) -> Option<f32> {
        matches!(self.stage(), Stage::Covering | Stage::Baking | Stage::Preparing).then(|| self.counted())
    }

    /// What takes the shares of a part of the stage, which goes from one share of it to another.
    pub fn part(&self, from: f32, to: f32) -> impl Fn(f32) + Sync {
        move |share| {
            let of_stage = from + (to - from) * share.clamp(0.0, 1.0);
            // Threads may tell theirs in any order.
            self.share.fetch_max((1000.0 * of_stage) as u16, Relaxed);
        }
    }

    /// How much of what is counted is done, 0..1.
    pub fn counted(&self) -> f32 {
        f32::from(self.share.load(Relaxed)) / 1000.0
    }

    /// Begins a stage.
    ///
    /// # Errors
    /// The user does not want it any more ([`Error::is_cancelled`]).
    pub fn enter(&self, stage: Stage) -> Result<()> {
        if self.stage.swap(stage as u8, Relaxed) != stage as u8 {
            self.share.store(0, Relaxed);
        }
        if self.is_cancelled.load(Relaxed) { Err(cancelled()) } else { Ok(()) }
    }

    /// The user does not want it any more: opening ends with its current stage.
    pub fn cancel(&self) {
        self.is_cancelled.store(true, Relaxed);
    }
}

impl Place {
    /// Whether something can be read there that may be shown: what can be told at once, before a window is opened for it. Addresses
    /// are not asked.
    ///
    /// # Errors
    /// One sentence for the user.
    pub fn check(&self) -> Result<()> {
        match self {
            Self::File(path) => {
                FileKind::of(path)?;
                std::fs::metadata(path).map(drop).map_err(|source| Error::reading(path, source))
            }
            Self::Url(_) => Ok(()),
        }
    }
}

impl Document {
    /// Opens a model or an asset.
    ///
    /// # Errors
    /// One sentence for the user.
    pub fn open(place: &Place, progress: &OpenProgress) -> Result<Self> {
        progress.enter(Stage::Reading)?;
        match place {
            Place::Url(url) if FileKind::of(Path::new(url))? == FileKind::World => {
                Self::open_world(place, Path::new(url))
            }
            Place::Url(url) if !is_asset_url(url) => {
                let sentence =
                    format!("{url} is no asset (.fan): models are opened from files; download it first");
                Err(Error::unsupported(sentence))
            }
            Place::Url(url) => Ok(Self::of_asset(place.clone(), Arc::new(open_asset(Path::new(url))?))),
            Place::File(path) => match FileKind::of(path)? {
                FileKind::Look => Err(is_look_error(path)),
                FileKind::World => Self::open_world(place, path),
                FileKind::Asset => Ok(Self::of_asset(place.clone(), Arc::new(Asset::open(path)?))),
                FileKind::Model => {
                    let model = load(path, &LoadOptions::default())?;
                    progress.enter(Stage::Cleaning)?;
                    let mut notes = model.notes.clone();
                    let (mesh, report) = clean(model, &CleanOptions::default())?;
                    notes.extend(report.lines());
                    Ok(Self::of_model(place.clone(), Arc::new(mesh), &report, notes))
                }
            },
        }
    }

    /// Opens an asset to paint on it. A model becomes an asset beside it first, unless that is there already; without an answer to
    /// how, that is asked. Takes no longer for more texels, unless channels are to be added or removed.
    ///
    /// # Errors
    /// One sentence for the user.
    pub fn open_for_painting(
        place: &Place,
        memory_bytes: usize,
        answer: Option<&Answer>,
        change: Option<&ChannelChange>,
        progress: &OpenProgress,
    ) -> Result<ForPainting> {
        progress.enter(Stage::Reading)?;
        let mut notes = Vec::new();
        let path = match place {
            Place::Url(url) => {
                let sentence = format!("{url} can only be looked at: download it to paint on it");
                return Err(Error::unsupported(sentence));
            }
            Place::File(path) => match FileKind::of(path)? {
                FileKind::Look => return Err(is_look_error(path)),
                FileKind::World => {
                    let sentence = format!(
                        "{place} is a world, which can only be looked at: paint on the asset that it was split from and split \
                         that again, or, in a world of separate objects, on one of its assets"
                    );
                    return Err(Error::unsupported(sentence).with_path(path));
                }
                FileKind::Asset => path.clone(),
                FileKind::Model => match asset_of_model(path, answer, memory_bytes, progress, &mut notes)? {
                    Made::Asset(path) => path,
                    Made::Question(question) => return Ok(ForPainting::Question(question)),
                },
            },
        };
        let options = PaintOptions { memory_bytes, history: true };
        progress.enter(if change.is_some() { Stage::Channels } else { Stage::Preparing })?;
        let mut painter = match change {
            None => Painter::open_with_progress(&path, &options, &progress.part(0.0, PAINTER_SHARE))?,
            Some(change) => {
                let (painter, made) = change.open(&path, &options, progress)?;
                notes.extend(made.err().map(|error| error.to_string()));
                progress.enter(Stage::Preparing)?;
                progress.part(0.0, PAINTER_SHARE)(1.0);
                painter
            }
        };
        if painter.editor().has_changes() {
            // Of a step that an earlier painter has left. Where it cannot be written, the painter tries again, and tells.
            painter.commit().ok();
        }
        let asset = painter.editor().asset().clone();
        let document = Self { notes, ..Self::of_asset(Place::File(path), asset) };
        Ok(ForPainting::Ready(Box::new((document, painter))))
    }

    /// Opens the index of a world. Its assets are opened as they are seen.
    fn open_world(place: &Place, index: &Path) -> Result<Self> {
        let world = World::open(index)?;
        let space = world.space_to_show(index)?;
        let boxes = Arc::new(box_mesh(&world, space));
        let bounds = world_bounds(&boxes);
        let [x, y, z] = (bounds.max - bounds.min).to_array().map(short_number);
        let total = |of: fn(&WorldObject) -> u64| world.objects.iter().map(of).sum::<u64>();
        let previews = world.objects.iter().filter(|object| object.preview.is_some()).count();
        let model_facts = vec![
            fact("Objects", grouped(world.objects.len() as u64)),
            fact("Previews", grouped(previews as u64)),
            fact("Coarse assets", grouped(world.coarse.len() as u64)),
            fact("Triangles", grouped(total(|object| object.triangles))),
            fact("Texels", grouped(total(|object| object.texels))),
            fact("Extent", format!("{x} × {y} × {z}")),
            fact("Files", bytes_text(total(|object| object.bytes) as f64)),
        ];
        let content = WorldContent { index: index.to_owned(), world: Arc::new(world), boxes };
        Ok(Self {
            place: place.clone(),
            scale: SceneScale::of(&bounds),
            content: Content::World(Arc::new(content)),
            notes: Vec::new(),
            model_facts,
            cover_facts: Vec::new(),
            channels: Vec::new(),
            exchange: None,
        })
    }

    pub fn of_model(place: Place, mesh: Arc<Mesh>, report: &CleanReport, notes: Vec<String>) -> Self {
        let mut model_facts = mesh_facts(&mesh);
        let textures = mesh.images.len();
        model_facts.push(fact("Materials", grouped(mesh.materials.len() as u64)));
        model_facts
            .push(fact("Textures", if textures == 0 { "none".into() } else { grouped(textures as u64) }));
        model_facts.push(fact("UV sets", grouped(mesh.corners.uv_sets.len() as u64)));
        model_facts.push(fact("Components", grouped(report.topology.components)));
        Self {
            place,
            scale: SceneScale::of(&world_bounds(&mesh)),
            content: Content::Model(mesh),
            notes,
            model_facts,
            cover_facts: Vec::new(),
            channels: Vec::new(),
            exchange: None,
        }
    }

    pub fn of_asset(place: Place, asset: Arc<Asset>) -> Self {
        let mesh = asset.mesh();
        let cover = asset.cover();
        let channels = asset
            .channels()
            .iter()
            .map(|channel| ChannelFact {
                kind: kind_label(channel.kind),
                format: format!("{:?}{}", channel.format, if channel.srgb { ", sRGB" } else { "" })
                    .to_uppercase(),
            })
            .map(|fact| ChannelFact { format: fact.format.replace("SRGB", "sRGB"), ..fact })
            .collect();
        let mut model_facts = mesh_facts(mesh);
        model_facts.push(fact("File", bytes_text(asset.file_bytes() as f64)));
        Self {
            scale: SceneScale::of(&world_bounds(mesh)),
            notes: Vec::new(),
            model_facts,
            cover_facts: cover_facts(cover, asset.mesh()),
            channels,
            place,
            content: Content::Asset(asset),
            exchange: None,
        }
    }

    pub fn mesh(&self) -> &Mesh {
        match &self.content {
            Content::Model(mesh) => mesh,
            Content::Asset(asset) => asset.mesh(),
            Content::World(content) => &content.boxes,
        }
    }

    /// The same, to share.
    pub fn shared_mesh(&self) -> Arc<Mesh> {
        match &self.content {
            Content::Model(mesh) => mesh.clone(),
            Content::Asset(asset) => asset.shared_mesh(),
            Content::World(content) => content.boxes.clone(),
        }
    }

    /// Whether it is made of fans, which are streamed.
    pub fn is_streamed(&self) -> bool {
        !matches!(self.content, Content::Model(_))
    }

    pub fn asset(&self) -> Option<&Arc<Asset>> {
        match &self.content {
            Content::Asset(asset) => Some(asset),
            Content::Model(_) | Content::World(_) => None,
        }
    }
}

/// What was opened to paint on it, or what has to be answered first.
#[derive(Debug)]
pub enum ForPainting {
    Ready(Box<(Document, Painter)>),
    Question(Question),
}

fn fact(name: &'static str, value: String) -> Fact {
    Fact { name, value }
}

/// The boxes of all objects.
fn box_mesh(world: &World, space: WorldFromMesh) -> Mesh {
    let boxes: Vec<_> = world
        .objects
        .iter()
        .map(|object| [object.low, object.high].map(|corner| space.inverse_point(corner.into())))
        .collect();
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let of_box = |first: u32| {
        let triangles = sides.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
        triangles.map(move |triangle| triangle.map(|corner: u32| first + corner))
    };
    Mesh {
        positions: ModelSpace::of_boxes(space, &boxes).points.to_vec(),
        triangles: (0..boxes.len() as u32).flat_map(|index| of_box(8 * index)).collect(),
        materials: vec![Material::default()],
        world_from_mesh: space,
        ..Mesh::default()
    }
}

fn mesh_facts(mesh: &Mesh) -> Vec<Fact> {
    let bounds = world_bounds(mesh);
    let [x, y, z] = (bounds.max - bounds.min).to_array().map(short_number);
    vec![
        fact("Triangles", grouped(mesh.triangles.len() as u64)),
        fact("Vertices", grouped(mesh.positions.len() as u64)),
        fact("Extent", format!("{x} × {y} × {z}")),
    ]
}

fn cover_facts(cover: &Cover, mesh: &Mesh) -> Vec<Fact> {
    let unfolded = cover.groups.iter().filter(|group| group.kind == GroupKind::Unfolded).count();
    let (mut least, mut most) = (u32::MAX, 0);
    for group in &cover.groups {
        least = least.min(group.extent[0].min(group.extent[1]));
        most = most.max(group.extent[0].max(group.extent[1]));
    }
    let mut facts = vec![
        fact("Groups (tiles)", grouped(cover.groups.len() as u64)),
        fact("Unfolded fans", grouped(unfolded as u64)),
        fact("Texels", grouped(cover.stored_texels(mesh))),
    ];
    if !cover.groups.is_empty() {
        facts.push(fact("Tile sides", format!("{least} to {most} texels")));
    }
    facts.push(fact("Levels", cover_level_count(cover).to_string()));
    facts.push(fact("Density", format!("{} texels per mesh unit", short_number(f64::from(cover.density)))));
    facts.push(fact("Blend band", format!("{:.3}", cover.delta)));
    facts
}

fn kind_label(kind: ChannelKind) -> &'static str {
    match kind {
        ChannelKind::BaseColor => "Base colour",
        ChannelKind::Normal => "Normal",
        ChannelKind::OcclusionRoughnessMetallic => "Occl. / rough. / metal",
        ChannelKind::Emission => "Emission",
        ChannelKind::Displacement => "Displacement",
        ChannelKind::Light => "Light",
        ChannelKind::Anisotropy => "Anisotropy",
    }
}

/// False for addresses of models; all others may be assets.
fn is_asset_url(url: &str) -> bool {
    let name = Place::Url(url.to_owned()).name().to_ascii_lowercase();
    ![".glb", ".gltf", ".obj", ".ply", ".stl", ".toml"].iter().any(|extension| name.ends_with(extension))
}
