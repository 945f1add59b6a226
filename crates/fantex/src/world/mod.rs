//! Worlds: indexes of assets that are shown together, and what is done with all of these.
//!
//! ```text
//!  one large asset --split--> sectors, coarse assets --.
//!                                                       index.fanworld --> scene, framing, export, check
//!  assets baked one by one --change--> coarse assets --'        '--store_folder--> an object store
//! ```
//!
//! The index itself, and which assets a view needs, is [`fantex_stream::World`].

#[cfg(feature = "http")]
mod change;
mod check;
mod coarse;
#[cfg(feature = "export")]
mod export;
mod framing;
mod joined;
mod scene;
mod split;
#[cfg(feature = "http")]
mod store_folder;

#[cfg(feature = "http")]
pub use change::{WorldChange, WorldChanged, change_world};
pub use check::{ObjectReport, WorldReport, verify_world};
#[cfg(feature = "export")]
pub use export::{export_world, export_world_fans};
pub use framing::frame_world;
pub use scene::{WorldScene, WorldSurface};
pub use split::{SectorPreviews, Split, SplitOptions, split};
#[cfg(feature = "http")]
pub use store_folder::StoreFolder;
