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
//! | `stroke` | brush, samples, symmetry; from them evenly spaced dabs |
//! | `dab` | which part of the surface a dab covers, by distance along it |
//! | `tile_paint` | coverage, texels, smudging, coarser levels (at once or beside the painting); the [`Painter`] |
//! | `fill`, `color_fill` | which triangles, and which texels, a fill takes |
//! | `picture`, `decal`, `text`, `projection` | pictures on the surface |
//! | `graph` | textures of looks |
//! | `layers` | layers over the base, flattened into the asset's texels |
//! | `history` | undo and redo, kept in the asset |
//! | `replay` | strokes from a file |
//! | `log` | strokes of an asset, for other densities and meshes |
//! | `work` | what takes long on large assets, in slices |
//!
//! Everything is a function of its input only, on any number of threads. There is no window in this crate.

mod blend;
mod color_fill;
mod dab;
mod decal;
mod error;
mod fill;
mod folders;
mod graph;
mod history;
mod layers;
mod log;
mod paint;
mod picture;
mod projection;
mod replay;
mod stamp;
mod stroke;
mod surface;
mod text;
mod tile_paint;
mod work;

pub use blend::BlendMode;
pub use color_fill::ColorFill;
pub use dab::{Dab, Region, RegionTriangle};
pub use decal::Decal;
pub use error::PaintError;
pub use fill::{FillArea, FillScope, fill_starts, fill_triangles, fill_triangles_with};
pub use graph::{GraphError, TextureGraph};
pub use history::{History, HistoryStep};
pub use layers::{GraphFill, Layer, LayerContent, Target};
pub use log::StrokeLog;
pub use paint::{ChannelPaint, Paint, PaintColor, SMUDGE_SPACING, Tool};
pub use picture::Picture;
pub use projection::{Lens, PicturePlace, Projection, ProjectionView};
pub use replay::*;
pub use stamp::Stamp;
pub use stroke::{Brush, Jitter, LiveStroke, PressureResponse, Sample, Size, Stroke, Symmetry, dabs_of};
pub use surface::{Surface, SurfacePoint};
pub use text::{DEFAULT_FONT, TextError, TextPicture, draw_text};
pub use tile_paint::{PaintOptions, Painter, PreviewPage, StrokeSummary};
pub use work::WorkProgress;
