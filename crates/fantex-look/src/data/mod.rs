//! A look as its file says it: plain data, not yet resolved.
//!
//! Every type is both the memory of a table and, through `schemars`, the source of its part of the JSON schema: doc comments
//! become descriptions, defaults become defaults. The checks of a file follow that schema.

/// A table of a look: a struct whose keys may all be left out, with the defaults beside them. (Keys that must be there are
/// named by `extend("required" = ...)`, and the checks see to it; their default is never seen.)
macro_rules! table {
    ($(
        $(#[$meta:meta])*
        pub struct $name:ident {
            $($(#[$field_meta:meta])* pub $field:ident: $type:ty = $default:expr,)*
        }
    )*) => {$(
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        #[serde(default, deny_unknown_fields)]
        $(#[$meta])*
        pub struct $name {
            $($(#[$field_meta])* pub $field: $type,)*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }
    )*};
}

/// An option of a look that is one of several texts.
macro_rules! choice {
    ($(
        $(#[$meta:meta])*
        pub enum $name:ident { $($(#[$variant_meta:meta])* $variant:ident,)* }
    )*) => {$(
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        #[serde(rename_all = "snake_case")]
        $(#[$meta])*
        pub enum $name { $($(#[$variant_meta])* $variant,)* }
    )*};
}

mod material;
mod scene;
mod texture;
mod values;

use std::collections::BTreeMap;

pub use material::*;
pub use scene::*;
pub use texture::*;
pub use values::*;

table! {
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
