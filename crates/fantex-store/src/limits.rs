//! What a `.fan` file may hold at most. Readers refuse more before they allocate; writers refuse to write it.

/// Material channels of an asset.
pub const MAX_CHANNELS: usize = 16;
/// Side of a tile at level 0, texels.
pub const MAX_TILE_SIDE: u32 = fantex_cover::MAX_EXTENT;
/// Triangles of a mesh. Corner indices `3 * triangle + k` must fit into 32 bits.
pub const MAX_TRIANGLES: usize = 1 << 30;
/// Texture coordinate sets of a mesh.
pub const MAX_UV_SETS: usize = 8;
/// Materials of a mesh.
pub const MAX_MATERIALS: usize = 1 << 20;
/// Parts of a mesh.
pub const MAX_PARTS: usize = 1 << 20;
/// Bytes of a name of a material or a part.
pub const MAX_NAME_BYTES: usize = 1 << 12;
/// Bytes that a section may unpack to, per byte stored, beyond [`SECTION_RATIO_FREE`]: so a small file never claims much
/// memory. Writers lengthen what packs better (a flat regular grid may) by a skippable frame.
pub const MAX_SECTION_RATIO: u64 = 1024;
/// Bytes that any section may unpack to.
pub const SECTION_RATIO_FREE: u64 = 1 << 20;
/// Base-2 logarithm of the window of a section's zstd frame in bytes.
pub const MAX_WINDOW_LOG: u32 = 23;
/// Bytes of a cluster before packing: a page of 16 channels of 16 bytes per texel, and some.
pub const MAX_CLUSTER_BYTES: u64 = 1 << 25;
/// Attachments of an asset.
pub const MAX_ATTACHMENTS: usize = 1 << 24;
/// Bytes of an attachment's name.
pub const MAX_ATTACHMENT_NAME_BYTES: usize = 255;
/// Bytes of an attachment before packing.
pub const MAX_ATTACHMENT_BYTES: u64 = 1 << 30;
