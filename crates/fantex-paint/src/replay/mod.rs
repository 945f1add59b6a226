//! Strokes from a file: the same picture on every run, on any number of threads, on any asset of the model.
//!
//! Samples are given by where they lie in the world, so a file fits any resolution, cover or repair of the model that it
//! was recorded on. The format is that of [`StrokeFile`], as JSON:
//!
//! ```json
//! {
//!   "version": 1,
//!   "strokes": [{
//!     "label": "red line",
//!     "brush": { "size": { "texels": 40 }, "hardness": 0.3, "opacity": 0.8, "flow": 0.5, "spacing": 0.1 },
//!     "tool": { "paint": "normal" },
//!     "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.1] } }],
//!     "samples": [{ "at": { "position": [0.1, 0.2, 0.3] } }, { "at": { "position": [0.2, 0.2, 0.3] }, "pressure": 0.5 }]
//!   }]
//! }
//! ```

mod color;
mod file;
mod prepare;
mod run;

pub use file::{
    BrushSettings, ChannelKindName, ChannelSettings, ColorSettings, DabSettings, DecalSettings,
    FillLayerSettings, FillSettings, FillTextureSettings, LayerSettings, LookSettings, ProjectionSettings,
    SampleSettings, StencilBy, StencilSettings, StrokeFile, StrokeSettings, TextSettings, ToolSettings,
    Where,
};
pub(crate) use prepare::place_on;
pub(crate) use run::prepare_fill;
pub use run::{ReplayError, ReplaySummary, replay};
