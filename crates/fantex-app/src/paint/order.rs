//! What the window and the painter's thread tell each other.

use std::sync::Arc;

use fantex_paint::{
    Brush, Decal, FillSettings, Layer, Paint, Sample, StrokeSettings, SurfacePoint, Symmetry, Target,
    WorkProgress,
};
use fantex_store::Asset;
use fantex_stream::ParcelLoader;
use glam::Vec4;

use super::Viewpoint;

/// A change of all layers.
pub type LayerChange = Box<dyn FnOnce(&mut Vec<Layer>) + Send>;

/// What a stroke starts with.
#[derive(Clone, Debug)]
pub struct StrokeStart {
    /// Its name in the history.
    pub label: String,
    /// What it paints on.
    pub target: Target,
    /// What it paints.
    pub paint: Paint,
    /// With what.
    pub brush: Brush,
    /// Copies.
    pub symmetry: Symmetry,
    /// The same for the log.
    pub recorded: StrokeSettings,
}

/// What the painter is to do.
pub enum Order {
    /// Begin a stroke at a sample.
    Begin(Box<StrokeStart>, Sample),
    /// Go on to samples.
    Move(Vec<Sample>),
    /// The pen has left the surface; the stroke goes on where it comes back.
    Lift,
    /// End the stroke, at a sample where one is still to be reached.
    End(Option<Sample>),
    /// Fill, from a point where there is one, with `StrokeStart` without its brush.
    Fill(Box<StrokeStart>, Option<SurfacePoint>, FillSettings),
    /// Lay a picture onto the surface, for `StrokeStart` without its brush. A text is to stay readable in mirror images.
    Lay(Box<StrokeStart>, Decal, bool),
    /// It is seen from here: what takes long begins with what is seen.
    Look(Viewpoint),
    /// Give up what takes long.
    GiveUp,
    /// Put a layer above another, or on top.
    AddLayer(Box<Layer>, Option<u64>),
    /// Change layers, under a name in the history.
    EditLayers(&'static str, LayerChange),
    /// Take back steps or do them again until so many are done.
    GoTo(usize),
    /// One step back.
    Undo,
    /// One step forth.
    Redo,
    /// Tell the values at a point.
    Pick(SurfacePoint),
    /// Answer requests for pages.
    Pages,
    /// Drop a loader, which may take a while.
    Release(Box<dyn ParcelLoader>),
    /// Commit now.
    Commit,
    /// Commit and end.
    Close,
}

/// What the painter tells.
#[derive(Clone, Debug)]
pub enum Report {
    /// Layers or history have changed.
    State(Box<Snapshot>),
    /// The number of the layer that was added.
    Added(u64),
    /// Linear values per channel.
    Picked(Vec<Vec4>),
    /// How far something is that takes long; none where nothing does.
    Work(Option<WorkProgress>),
    /// What became of saving.
    Save(SaveState),
    /// A newer state of the file.
    Newer(Arc<Asset>),
    /// Something failed: one sentence.
    Failed(String),
}

/// Layers and history.
#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    /// From the bottom to the top.
    pub layers: Vec<Layer>,
    /// Steps that are done but too old to be listed.
    pub older: usize,
    /// Names of steps that are done, the oldest first.
    pub done: Vec<String>,
    /// Names of steps that were taken back, the next one to be done again last.
    pub undone: Vec<String>,
}

/// Whether what was painted is in the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum SaveState {
    /// All of it.
    #[default]
    Saved,
    /// There are changes, which will be in a moment.
    Changed,
    /// It is being written.
    Saving,
    /// It cannot be written; painting goes on in memory.
    Failed(String),
}
