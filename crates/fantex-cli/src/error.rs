//! Why a command ended without its result. Each message is one sentence.

use std::io;
use std::path::PathBuf;

use fantex::{bake, export, look, look_scene, paint, photos, render, store, texture};

use crate::context::{EXIT_INTERRUPTED, INTERRUPTED};

/// A command's failure.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CliError {
    #[error(transparent)]
    Library(#[from] fantex::base::Error),
    #[error(transparent)]
    Bake(bake::BakeError),
    #[error(transparent)]
    Open(#[from] store::OpenError),
    #[error(transparent)]
    Encode(#[from] store::EncodeError),
    #[error(transparent)]
    Render(#[from] render::RenderError),
    #[error(transparent)]
    LoadImage(#[from] texture::LoadImageError),
    #[error(transparent)]
    MaterialImage(#[from] texture::material::MaterialImageError),
    #[error(transparent)]
    ReadCameras(Box<photos::ReadCamerasError>),
    #[error(transparent)]
    WriteCameras(#[from] photos::WriteCamerasError),
    #[error(transparent)]
    Photos(Box<photos::PhotoError>),
    #[error(transparent)]
    LoadEnvironment(#[from] texture::environment::LoadEnvironmentError),
    #[error(transparent)]
    Sky(#[from] texture::environment::SkyError),
    #[error(transparent)]
    SaveImage(#[from] texture::SaveImageError),
    #[error(transparent)]
    Compare(#[from] texture::compare::CompareError),
    #[error(transparent)]
    UnknownSolid(#[from] texture::UnknownSolid),
    #[error(transparent)]
    Look(#[from] look::LookError),
    #[error("{}: {problem}", path.display())]
    LookContent { path: PathBuf, problem: look::LookProblem },
    #[error(transparent)]
    LookScene(#[from] look_scene::LookSceneError),
    #[error(transparent)]
    LookBake(#[from] look_scene::LookBakeError),
    #[error(transparent)]
    Transfer(#[from] bake::TransferError),
    #[error(transparent)]
    NoVertexColors(#[from] bake::NoVertexColors),
    #[error("cannot start the threads that were asked for: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    #[error(transparent)]
    Gallery(#[from] crate::commands::gallery::CatalogueError),
    #[error(transparent)]
    PlaneMap(#[from] texture::warp::PlaneMapError),
    #[error(transparent)]
    Warp(#[from] texture::warp::WarpError),
    #[error(transparent)]
    Paint(#[from] paint::PaintError),
    #[error(transparent)]
    Replay(#[from] paint::ReplayError),
    #[error(transparent)]
    Export(export::ExportError),
    #[error(
        "{} is a picture: say which with --channel base-color, normal, orm ..., or make a --turntable; a model is .glb or .gltf",
        path.display()
    )]
    WhichPicture { path: PathBuf },
    #[error(
        "{size} is a turntable's size; the pictures of a model are square: give one number, such as --size 2048"
    )]
    NotSquare { size: crate::scene::SizeArg },
    #[error("{option} belongs to a turntable; give --turntable, too, or leave it out")]
    TurntableOption { option: &'static str },
    #[error("{option} have no meaning for a turntable; leave them out")]
    NoTurntableOption { option: &'static str },
    #[error(transparent)]
    LightMap(#[from] bake::LightMapError),
    #[error(
        "{} is a model and has no texels: leave out --texels, --density and --tile, or write an asset (.fan)",
        path.display()
    )]
    TexelsOfModel { path: PathBuf },
    #[error("{} is no camera path: {source}", path.display())]
    CameraPath { path: PathBuf, source: serde_json::Error },
    #[error("{} holds no keyframes; record at least one", path.display())]
    EmptyCameraPath { path: PathBuf },
    #[error("cannot listen to Ctrl-C: {0}")]
    Signals(#[from] ctrlc::Error),
    #[error("cannot write the result as JSON: {0}")]
    Json(#[from] serde_json::Error),
    #[error("cannot write to standard output: {0}")]
    Print(io::Error),
    /// Whoever read standard output has seen enough.
    #[error("standard output was closed")]
    OutputClosed,
    #[error("cannot make a temporary folder: {0}")]
    TemporaryFolder(io::Error),
    #[error("cannot read {}: {source}", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("cannot write {}: {source}", path.display())]
    Write { path: PathBuf, source: io::Error },
    #[error("{} is what is read; give what is written another name", path.display())]
    OutputIsInput { path: PathBuf },
    #[error("{} exists already; use --force to overwrite it", path.display())]
    Exists { path: PathBuf },
    #[error("cannot write {}: it is a folder", path.display())]
    OutputIsFolder { path: PathBuf },
    #[error("cannot write {}: it is no ordinary file; give another name", path.display())]
    OutputIsNoFile { path: PathBuf },
    #[error("cannot write {}: there is no folder {}", path.display(), folder.display())]
    NoFolder { path: PathBuf, folder: PathBuf },
    #[error("cannot make the folder {}: {source}", folder.display())]
    MakeFolder { folder: PathBuf, source: io::Error },
    #[error("cannot find {} in this folder or beside the program; run the demo in the project's folder", path.display())]
    DemoModel { path: PathBuf },
    #[error(
        "{} is an asset, already baked; give the model (.glb .gltf .obj .ply .stl) that it was baked from",
        path.display()
    )]
    AssetInsteadOfModel { path: PathBuf },
    #[error("{} is a look; give a model (.glb .gltf .obj .ply .stl) or an asset (.fan)", path.display())]
    LookInstead { path: PathBuf },
    #[error("{} is no model, and only models have materials that are printed as a look", path.display())]
    NoMaterials { path: PathBuf },
    #[error("{} is not an asset; give a .fan file, for example one that 'fantex bake' has written", path.display())]
    ModelInsteadOfAsset { path: PathBuf },
    #[error(
        "{} has neither textures nor colours to bake; give --source image=PATH,mapping=box or --source solid=wood",
        path.display()
    )]
    NothingToBake { path: PathBuf },
    #[error("{} has no textures and no colours of its materials; leave --source uv out, or give --source vertex, image=... or solid=...", path.display())]
    NoTextures { path: PathBuf },
    #[error("{option} has no meaning for an asset: {} has its cover already", path.display())]
    NotForAssets { option: &'static str, path: PathBuf },
    #[error("{} is a look, which has its lamps and surroundings itself; leave {option} out", path.display())]
    NotForLooks { option: &'static str, path: PathBuf },
    #[error("looks, other models and photographs are baked by 'fantex bake'; give another source here")]
    OnlyBaked,
    #[error("--match takes the density of textures, and {source_name} has none; give --texels or --density")]
    NothingToMatch { source_name: String },
    #[error(
        "the viewer fantex-app is neither beside this program nor on the search path; build it with \
         'cargo build --release -p fantex-app'"
    )]
    NoViewer,
    #[error("cannot start the viewer {}: {source}", path.display())]
    StartViewer { path: PathBuf, source: io::Error },
    #[error("the viewer ended unexpectedly ({status})")]
    Viewer { status: std::process::ExitStatus },
    /// Not to be told once more.
    #[error("the viewer has said what was wrong")]
    ViewerFailed { exit_code: u8 },
    #[error("{} did not pass: {reason}", path.display())]
    NotVerified { path: PathBuf, reason: String },
    #[error("{INTERRUPTED}")]
    Interrupted,
}

impl CliError {
    /// 1 where the input or the system is at fault, 2 where the command line is.
    pub(crate) fn exit_code(&self) -> u8 {
        match self {
            Self::Interrupted => EXIT_INTERRUPTED,
            Self::ViewerFailed { exit_code } => *exit_code,
            Self::NothingToBake { .. }
            | Self::NoTextures { .. }
            | Self::NotForAssets { .. }
            | Self::NotForLooks { .. }
            | Self::OnlyBaked
            | Self::TexelsOfModel { .. }
            | Self::WhichPicture { .. }
            | Self::Export(
                export::ExportError::Side { .. }
                | export::ExportError::Padding { .. }
                | export::ExportError::UnknownKind { .. },
            )
            | Self::NotSquare { .. }
            | Self::TurntableOption { .. }
            | Self::NoTurntableOption { .. }
            | Self::NothingToMatch { .. } => 2,
            _ => 1,
        }
    }
}

impl From<export::ExportError> for CliError {
    fn from(error: export::ExportError) -> Self {
        match error {
            export::ExportError::Cancelled => Self::Interrupted,
            error => Self::Export(error),
        }
    }
}

impl From<photos::PhotoError> for CliError {
    fn from(error: photos::PhotoError) -> Self {
        match error {
            photos::PhotoError::Cancelled => Self::Interrupted,
            error => Self::Photos(Box::new(error)),
        }
    }
}

impl From<photos::ReadCamerasError> for CliError {
    fn from(error: photos::ReadCamerasError) -> Self {
        Self::ReadCameras(Box::new(error))
    }
}

impl From<bake::BakeError> for CliError {
    fn from(error: bake::BakeError) -> Self {
        match error {
            bake::BakeError::Cancelled => Self::Interrupted,
            error => Self::Bake(error),
        }
    }
}
