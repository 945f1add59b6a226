//! Fan-textured models: geometry, atlas and texture function on the GPU.

pub(crate) mod atlas;
pub(crate) mod geometry;
pub(crate) mod tables;
pub(crate) mod upload;
