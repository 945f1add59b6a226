//! The sections of a file: mesh, cover, channels and directory, each encoded to bytes and back, and what must hold in them.

pub(crate) mod attachments;
pub(crate) mod channels;
pub(crate) mod cover;
pub(crate) mod directory;
pub(crate) mod mesh;
