//! The `.fan` asset: format, block codecs, writing, reading, caching, editing, verifying.
//!
//! ```text
//!  Mesh, Cover, Channels --create--> AssetWriter <--write_pages-- EncodedPage <--encode-- texels
//!                                        | finish (fsync, rename)
//!                                        v
//!                 PageCache <--- Asset::open(path) ---> verify
//!                     | tile(channel, group, level)
//!                     v
//!                  Sampler: sample(channel, point of the surface, footprint) -> linear RGBA
//!
//!  AssetEditor::open(path) --replace pages--> commit (copy-on-write, atomic) --> Arc<Asset> of the next generation
//! ```
//!
//! An asset may also lie elsewhere ([`ByteSource`], [`Asset::open_source`]), and its clusters be read by others
//! ([`Asset::cluster_range`], [`Asset::unpack_cluster`]).
//!
//! In WebAssembly there is reading alone: assets are opened, and their clusters unpacked.
//!
//! The format is described byte by byte in `docs/format.md`. No function of this crate trusts a file: lengths, offsets,
//! counts and extents are checked against the [`limits`] before anything is allocated.

#![cfg_attr(target_arch = "wasm32", allow(dead_code, reason = "used by what writes"))]

mod bytes;
#[cfg(not(target_arch = "wasm32"))]
mod cache;
mod channel;
mod cover_section;
mod decode;
mod directory;
#[cfg(not(target_arch = "wasm32"))]
mod edit;
#[cfg(not(target_arch = "wasm32"))]
mod encode;
#[cfg(not(target_arch = "wasm32"))]
mod encoder_print;
mod error;
#[cfg(not(target_arch = "wasm32"))]
mod file_source;
mod header;
mod layout;
pub mod limits;
mod mesh_section;
mod packing;
mod reader;
#[cfg(not(target_arch = "wasm32"))]
mod sampler;
mod source;
#[cfg(not(target_arch = "wasm32"))]
mod texel_bounds;
mod unfolded_places;
#[cfg(not(target_arch = "wasm32"))]
mod verify;
#[cfg(not(target_arch = "wasm32"))]
mod verify_texels;
#[cfg(not(target_arch = "wasm32"))]
mod writer;

#[cfg(not(target_arch = "wasm32"))]
pub use cache::*;
pub use channel::*;
pub use decode::{decode, decode_plain};
#[cfg(not(target_arch = "wasm32"))]
pub use edit::*;
#[cfg(not(target_arch = "wasm32"))]
pub use encode::*;
pub use error::{io_cause, is_disk_full, write_error};
#[cfg(not(target_arch = "wasm32"))]
pub use file_source::*;
pub use layout::*;
pub use reader::*;
#[cfg(not(target_arch = "wasm32"))]
pub use sampler::*;
pub use source::*;
#[cfg(not(target_arch = "wasm32"))]
pub use verify::*;
#[cfg(not(target_arch = "wasm32"))]
pub use verify_texels::TexelReport;
#[cfg(not(target_arch = "wasm32"))]
pub use writer::*;
