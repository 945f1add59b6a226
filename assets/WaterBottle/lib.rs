//! The model with textures that the demo bakes.

/// Path in the workspace and content of every file.
pub const FILES: &[(&str, &[u8])] = fantex_base::files![
    "assets/WaterBottle/":
    "LICENSE.md"
    "WaterBottle.bin"
    "WaterBottle.gltf"
    "WaterBottle_baseColor.png"
    "WaterBottle_emissive.png"
    "WaterBottle_normal.png"
    "WaterBottle_occlusionRoughnessMetallic.png"
];
