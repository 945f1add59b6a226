//! Painting: the same window, with an asset that is being changed.
//!
//! ```text
//!  pen events --Painting--> orders --> worker thread, which owns the Painter --> asset.fan, committed when the hand rests
//!                (rays to the surface)           |
//!  atlas <-- uploads <-- FanScene <-- Exchange <-'  texels of changed pages, answers to requests for such pages
//! ```
//!
//! The thread that draws never touches the file: it sends orders, and takes what the worker has put into the
//! [`Exchange`]. Pages that have changed since the file was opened are answered by the worker, all others by the usual loader.

mod asset_of_model;
mod bake;
mod brush;
mod colors;
mod cursor;
mod exchange;
mod files;
mod gradient;
mod hand;
mod layer_actions;
mod layer_list;
mod messages;
mod painting;
mod placing;
mod settings;
mod stencil;
mod symmetry;
mod texture;
mod thumbnails;
mod worker;

pub use asset_of_model::{Answer, Made, Question, asset_of_model};
pub use bake::{NewAsset, asset_beside, bake_model};
pub use brush::{BLEND_MODES, BrushSettings, Presets, SizeUnit, TIPS, preview_stroke};
pub use colors::{Colors, PALETTES, color_of_hex, parse_hex, text_hex};
pub(crate) use cursor::degrees_between;
pub use cursor::{Cursor, PenEvent, PenPhase, Ring, Viewpoint};
pub use exchange::{Exchange, PaintLoader};
pub use files::{FileState, LoadedFile};
pub use gradient::{GradientEnd, GradientSettings, GradientShape};
pub use layer_actions::{Alone, LayerAction, LayerDrag};
pub use layer_list::{LayerRow, drop_place, layer_rows};
pub use messages::{LayerChange, Leave, Order, Report, SaveState, Snapshot, StrokeStart};
pub use painting::Painting;
pub use placing::PlacingOutline;
pub use settings::{
    AlphaShown, ChannelSwitches, FillReach, Material, PaintCommand, PaintSettings, PaintTool, PictureUse,
    StickerKind, channel_name, paint_shortcuts,
};
pub use stencil::{StencilPicture, StencilSettings, StencilUse};
pub use symmetry::{Section, SymmetryKind, SymmetrySettings, plane_outline};
pub use texture::{ChosenTexture, ColorSource, SOLIDS, TextureChoice};
pub use thumbnails::{THUMBNAIL, Thumbnail};
pub use worker::PaintThread;
