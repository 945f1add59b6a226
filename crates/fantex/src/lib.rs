//! The library's front door.
pub use {
    fantex_bake as bake, fantex_cover as cover, fantex_mesh as mesh, fantex_render as render,
    fantex_store as store, fantex_texture as texture,
};
