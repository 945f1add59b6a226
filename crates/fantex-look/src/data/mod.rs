//! A look as its file says it.
//!
//! What needs neither files nor a model is the very type that is evaluated: solids, noise, colour scales, modes, matrices, places. Textures
//! made of others are those of `fantex_texture::combine`, with [`Input`]s in place of textures. The tables here are what needs a
//! file, a name or a model first.
//!
//! Every type is both the memory of a table and, through `schemars`, the source of its part of the JSON schema: doc comments
//! become descriptions, defaults become defaults. The checks of a file follow that schema.

mod material;
mod scene;
mod texture;
mod values;

use std::collections::BTreeMap;

use fantex_base::parameters;

pub use material::*;
pub use scene::*;
pub use texture::*;
pub use values::*;

parameters! {
    /// A look: what textures drive on a model, and how it is shown.
    #[schemars(title = "fantex look")]
    pub struct Look {
        /// Where the picture is taken from; without it, the camera shows the whole scene.
        pub camera: Option<CameraTable> = None,
        /// The picture.
        pub picture: PictureTable = PictureTable::default(),
        /// What surrounds the scene.
        pub environment: Option<EnvironmentTable> = None,
        /// Lamps. Without any lamp and without an environment, a sun stands behind the camera.
        pub light: Vec<LightTable> = Vec::new(),
        /// Textures by name.
        pub textures: BTreeMap<String, TextureTable> = BTreeMap::new(),
        /// Materials by name. Where a look has a single material and no object, it is the model's.
        pub materials: BTreeMap<String, MaterialTable> = BTreeMap::new(),
        /// What is in the scene. Without any, the model of the command line.
        pub object: Vec<ObjectTable> = Vec::new(),
        /// What a bake puts into the tiles.
        pub bake: BakeTable = BakeTable::default(),
    }
}
