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
//! The format is described byte by byte in `docs/format.md`. No function of this crate trusts a file: lengths, offsets,
//! counts and extents are checked against the [`limits`] before anything is allocated.

mod bytes;
mod cache;
mod channel;
mod cover_section;
mod decode;
mod directory;
mod edit;
mod encode;
mod encoder_print;
mod error;
mod header;
mod layout;
pub mod limits;
mod mesh_section;
mod packing;
mod reader;
mod sampler;
mod source;
mod verify;
mod writer;

pub use cache::*;
pub use channel::*;
pub use decode::{decode, decode_plain};
pub use edit::*;
pub use encode::*;
pub use error::{io_cause, is_disk_full, write_error};
pub use layout::*;
pub use reader::*;
pub use sampler::*;
pub use source::*;
pub use verify::*;
pub use writer::*;
