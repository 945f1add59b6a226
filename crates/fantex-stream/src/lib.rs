//! Streaming of fan tiles from an asset into a small atlas, without a graphics type in it.
//!
//! ```text
//!  StreamView --demand--> level and urgency per tile --residency--> wanted parcels, places in the atlas
//!                                                          |                ^
//!                                                 request, cancel      LoadedParcel
//!                                                          v                |
//!                                                       ParcelLoader (reads, checks, unpacks, decodes)
//!                                                          |
//!                                   FrameChanges: uploads and page-table entries for whoever owns the atlas
//! ```
//!
//! Who decides what: *demand* knows geometry only, *residency* knows the atlas' space only, the *loader* knows files and
//! threads only. Each is a module with a small interface, so that the whole is simulated and tested without a GPU.
//!
//! In WebAssembly there are neither files nor threads: reads are tasks of the page ([`read::task_reader`]), and the loader works in slices of
//! the caller's time ([`ClusterLoader::without_threads`]).
//!
//! What moves is a [`Parcel`]: a page of a tile, or a coarse level of up to 32 neighbouring tiles. The [`PageTable`] that shaders read
//! knows pages only. What of a parcel is stored is its [`Outline`]; outlines interlock in the atlas.

#![cfg_attr(target_arch = "wasm32", allow(dead_code, reason = "used by what reads files"))]

mod atlas;
mod camera_path;
mod cluster_loader;
mod coarse;
mod complete;
mod demand;
#[cfg(not(target_arch = "wasm32"))]
mod disk_speed;
pub mod drawing;
mod loader;
mod objects;
mod outline;
mod parcel;
pub mod read;
mod residency;
mod retry_timer;
mod shape;
mod sharing;
mod stream_view;
mod streamer;
#[cfg(feature = "http")]
mod upload;
mod world;

pub use atlas::*;
pub use camera_path::*;
pub use cluster_loader::*;
pub use coarse::*;
pub use complete::complete_atlas;
pub use demand::{DemandWork, Detail, PageDemand};
#[cfg(not(target_arch = "wasm32"))]
pub use disk_speed::*;
pub use loader::*;
pub use objects::*;
pub use outline::*;
pub use parcel::*;
#[cfg(not(target_arch = "wasm32"))]
pub use read::{open_asset, open_preview, open_source, read_whole};
pub use read::{open_fetched, url_of};
pub use residency::{FrameWork, ParcelCount, RequestLimits, WORK_COSTS, WORK_KINDS};
pub use retry_timer::*;
pub use sharing::*;
pub use stream_view::StreamView;
pub use streamer::*;
#[cfg(feature = "http")]
pub use upload::{Assembled, ObjectTarget, Replace, SharedRun};
pub use world::*;
