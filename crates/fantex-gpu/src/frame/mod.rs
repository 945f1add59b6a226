//! What a frame is lit by and seen from, as shaders want it.

mod environment;
mod lamps;
mod layout;
mod records;
mod shadow_maps;
mod slides;
mod state;
mod targets;
mod view;

pub use layout::FrameLayout;
pub use view::View;

pub(crate) use layout::{DEPTH_FORMAT, LIGHT_FORMAT};
pub(crate) use records::LinesRecord;
pub(crate) use state::{FrameInputs, FrameState};
pub(crate) use targets::Targets;
