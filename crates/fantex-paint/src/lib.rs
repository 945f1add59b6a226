//! Painting on the surface of a model, into its asset.
//!
//! ```text
//!  samples --stroke--> dabs --tile_paint--> pages of all tiles and levels --AssetEditor--> asset.fan
//!            spaced along      the same function of the surface                copy-on-write, undo in the history
//!            the surface       in every tile that shows it
//! ```
//!
//! | module | what |
//! |---|---|
//! | `surface` | the mesh with the adjacency that painting needs |
//! | `stroke`, `symmetry` | brush, samples, copies on the other sides; from them evenly spaced dabs |
//! | `tips` | shapes of dabs that come with the program |
//! | `region`, `open_edges`, `dab` | which part of the surface a dab covers, by distance along it (across gaps, too), and how far |
//! | `fill` | which triangles, and which texels, a fill takes |
//! | `picture`, `projection`, `graph` | stickers and texts, pictures through a camera, textures of looks |
//! | `texel_page`, `cover` | which texels a dab covers, and how far |
//! | `paint`, `composite`, `smudge` | what covered texels become |
//! | `stroke_page` | what a stroke has gathered on each page |
//! | `levels`, `cut_outs`, `due_levels` | coarser levels, at once or after the end of a stroke |
//! | `painter`, `steps`, `kept_stroke` | the [`Painter`]: an open stroke; how it ends, what it leaves in the history, what commits keep of it before |
//! | `room` | what a full disk means for changes in memory |
//! | `layers`, `layer_stack` | layers over the base, flattened into the asset's texels |
//! | `layer_groups`, `layer_moves` | layers in groups; copies, merges, what layers hold |
//! | `relief` | painted height bends the normals |
//! | `added`, `removed` | channels that an asset is given, or loses, while it is painted on |
//! | `mask_source` | masks from the shape of the model |
//! | `history` | undo and redo, kept in the asset |
//! | `stroke_file`, `stroke_check`, `replay`, `log` | strokes from a file; strokes of an asset, for other densities and meshes |
//! | `work` | long jobs on large assets, in slices |
//!
//! Everything is a function of its input only, on any number of threads. There is no window in this crate.

mod added;
mod base_levels;
mod composite;
mod cover;
mod cut_outs;
mod dab;
mod due_levels;
mod error;
mod fill;
mod graph;
mod history;
mod kept_stroke;
mod layer_groups;
mod layer_moves;
mod layer_stack;
mod layers;
mod levels;
mod log;
mod mask_source;
mod open_edges;
mod paint;
mod painter;
mod picture;
mod projection;
mod region;
mod relief;
mod removed;
mod replay;
mod room;
mod smudge;
mod steps;
mod stroke;
mod stroke_check;
mod stroke_file;
mod stroke_page;
mod stroke_preview;
mod surface;
mod symmetry;
mod texel_page;
mod tips;
mod work;

pub use dab::{Dab, Stamp, is_shaped_by_alpha};
pub use error::without_room;
pub use fantex_mesh::SurfacePoint;
pub use fill::{ColorFill, FillArea, fill_triangles, fill_triangles_with};
pub use graph::{GraphFill, TextureGraph};
pub use history::{History, HistoryStep};
pub use layer_groups::{
    GroupKind, LayerPlace, MAX_GROUP_DEPTH, dissolve_group, groups_around, layer_below, move_layer,
    remove_layer,
};
pub use layer_moves::LayerMove;
pub use layers::{Layer, LayerContent, Target};
pub use log::{LoadedFiles, StrokeLog};
pub use mask_source::{MaskMeasure, MaskSource};
pub use paint::{BlendMode, ChannelPaint, Paint, PaintColor, SMUDGE_SPACING, Tool};
pub use painter::{PaintOptions, Painter, StrokeSummary};
pub use picture::{DEFAULT_FONT, Decal, Picture, TextPicture, draw_text, note_of_missing};
pub use projection::{Lens, PicturePlace, Projection, ProjectionView, Sight};
pub use region::{Region, RegionTriangle};
pub use relief::HEIGHT_RANGE;
pub use replay::{ReplaySummary, replay};
pub use stroke::{Brush, Jitter, LiveStroke, PressureResponse, Sample, Size, Stroke, dabs_of};
pub use stroke_file::{
    ChannelSettings, ColorSettings, DabSettings, DecalSettings, FillLayerSettings, FillSettings,
    FillTextureSettings, KindName, LayerSettings, LookSettings, SampleSettings, StencilBy, StencilSettings,
    StrokeFile, StrokeSettings, TextSettings, ToolSettings, Where,
};
pub use stroke_preview::PreviewPage;
pub use surface::Surface;
pub use symmetry::Symmetry;
pub use tips::Tip;
pub use work::WorkProgress;
