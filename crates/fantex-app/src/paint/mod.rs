//! Painting: the same window, with an asset that is being changed.
//!
//! ```text
//!  pen events --Painting--> orders --> worker thread, which owns the Painter --> asset.fan, committed every two seconds
//!                (rays to the surface)           |
//!  atlas <-- uploads <-- FanScene <-- Exchange <-'  texels of changed pages, answers to requests for such pages
//! ```
//!
//! The thread that draws never touches the file: it sends orders, and takes what the worker has put into the
//! [`Exchange`]. Pages that have changed since the file was opened are answered by the worker, all others by the usual loader.

mod bake;
mod brush;
mod channels;
mod colors;
mod cursor;
mod exchange;
mod keys;
mod layers;
mod order;
mod painting;
mod pen;
mod presets;
mod preview;
mod record;
mod section;
mod settings;
mod stencil;
mod sticker;
mod symmetry;
#[cfg(test)]
pub(crate) mod tests;
mod texels;
mod texture;
mod tool;
mod worker;

pub use bake::{BakeForPainting, asset_beside, bake_model};
pub use brush::{BrushSettings, SizeUnit, blend_label};
pub use channels::{ChannelSwitches, Material};
pub use colors::{Colors, PALETTES, parse_hex, text_hex};
pub use cursor::{Cursor, Ring};
pub use exchange::{Exchange, PaintLoader};
pub use keys::{PaintCommand, paint_shortcuts};
pub use layers::LayerAction;
pub use order::{LayerChange, Order, Report, SaveState, Snapshot, StrokeStart};
pub use painting::Painting;
pub use pen::{PenEvent, PenPhase, Viewpoint};
pub use presets::{Presets, PresetsError};
pub use preview::preview_stroke;
pub use section::Section;
pub use settings::PaintSettings;
pub use stencil::{StencilPicture, StencilSettings, StencilUse};
pub use symmetry::{SymmetryKind, SymmetrySettings, plane_outline};
pub use texture::{ChosenTexture, ColorSource, SOLIDS, TextureChoice, TextureChoiceError};
pub use tool::{FillReach, PaintTool, StickerKind};
pub use worker::PaintThread;
