//! Messages between the window and the paint thread.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::mpsc::Sender;

use fantex::glam::Vec4;
use fantex::paint::{
    Brush, Decal, FillSettings, Layer, LayerPlace, LoadedFiles, Paint, Sample, Stamp, StrokeSettings,
    SurfacePoint, Symmetry, Target, WorkProgress,
};
use fantex::store::Asset;
use fantex::stream::ParcelLoader;

use crate::paint::{Alone, Thumbnail, Viewpoint};
use crate::viewer::HandedOver;

/// A change of all layers.
pub type LayerChange = Box<dyn FnOnce(&mut Vec<Layer>) + Send>;

/// What a stroke starts with.
#[derive(Clone, Debug)]
pub struct StrokeStart {
    pub label: String,
    pub target: Target,
    pub paint: Paint,
    pub brush: Brush,
    pub stamp: Option<Arc<Stamp>>,
    pub symmetry: Symmetry,
    /// The same for the log.
    pub recorded: StrokeSettings,
    /// Files that it mentions, as they were when they were loaded.
    pub files: LoadedFiles,
}

pub enum Order {
    Begin(Box<StrokeStart>, Sample),
    Move(Vec<Sample>),
    /// The pen has left the surface; the stroke goes on where it comes back.
    Lift,
    /// End the stroke, at a sample where one is still to be reached.
    End(Option<Sample>),
    /// Fill, from a point where there is one, with `StrokeStart` without its brush.
    Fill(Box<StrokeStart>, Option<SurfacePoint>, FillSettings),
    /// Show a picture on the surface, for `StrokeStart` without its brush, instead of one that is shown so. A text is to stay readable
    /// in mirror images.
    Place(Box<StrokeStart>, Decal, bool),
    /// Apply it.
    Apply,
    /// Take it away.
    TakeAway,
    /// It is seen from here: what takes long begins with what is seen.
    Look(Viewpoint),
    GiveUp,
    /// Put a layer at a place.
    AddLayer(Box<Layer>, LayerPlace),
    DuplicateLayer(u64),
    MergeLayer(u64),
    /// Put a layer into a new group of this name.
    GroupLayer(u64, String),
    MergeGroup(u64),
    /// Fold a group in the list, or unfold it.
    Collapse(u64, bool),
    /// Move a layer; instead of the last such step where a drag goes on.
    MoveLayer {
        id: u64,
        place: LayerPlace,
        goes_on: bool,
    },
    /// Show something instead of the base colour, or no longer.
    SeeAlone(Option<Alone>),
    EditLayers(&'static str, LayerChange),
    /// Take back steps or do them again until so many are done.
    GoTo(usize),
    Undo,
    Redo,
    /// Tell the values at a point, to paint with.
    Pick(SurfacePoint),
    /// Tell them, to be shown.
    Probe(SurfacePoint),
    /// Answer requests for pages.
    Pages,
    /// Drop a loader, which may take a while.
    Release(Box<dyn ParcelLoader>),
    Commit,
    /// Commit all but what is not applied, and tell [`Report::MayLeave`] where nothing is left to write.
    Leave,
    /// Commit, and hand over the asset as it is then, to be copied; where its file is gone, the one that is open.
    HandOver(Sender<HandedOver>),
    /// What was handed over is in another file.
    Copied,
    /// Commit and end.
    Close,
}

#[derive(Clone, Debug)]
pub enum Report {
    State(Box<Snapshot>),
    /// The number of the layer that was added.
    Added(u64),
    /// A picture of what a layer or a mask holds.
    Thumbnail(Target, Thumbnail),
    /// Values per channel, as they are stored: colours linear.
    Picked(Vec<Vec4>),
    /// The same of a point that was asked for to be shown; nothing where they cannot be read.
    Probed(SurfacePoint, Vec<Vec4>),
    /// How far something is that takes long; none where nothing does.
    Work(Option<WorkProgress>),
    Save(SaveState),
    /// All is in the file that was done before [`Order::Leave`].
    MayLeave,
    /// A newer state of the file.
    Newer(Arc<Asset>),
    Failed(String),
}

#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    /// From the bottom to the top.
    pub layers: Vec<Layer>,
    /// Groups that are folded in the list, by number.
    pub collapsed: BTreeSet<u64>,
    /// Steps that are done but too old to be listed.
    pub older: usize,
    /// Names of steps that are done, the oldest first.
    pub done: Vec<String>,
    /// Names of steps that were taken back, the next one to be done again last.
    pub undone: Vec<String>,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub enum SaveState {
    #[default]
    Saved,
    Changed,
    Saving,
    /// It cannot be written; painting goes on in memory.
    Failed(String),
}

/// What becomes of what is painted where it is left.
#[derive(Clone, Debug, PartialEq)]
pub enum Leave {
    /// Nothing is lost.
    Free,
    /// It is being saved for that.
    Waits,
    /// It cannot be saved: one sentence.
    Loses(String),
}
