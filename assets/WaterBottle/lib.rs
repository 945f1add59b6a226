//! The model with textures that the demo bakes.

/// Files of this folder as `(path in the workspace, content)`.
macro_rules! files {
    ($($name:literal)*) => { &[$((concat!("assets/WaterBottle/", $name), include_bytes!($name))),*] };
}

/// Path in the workspace and content of every file.
pub const FILES: &[(&str, &[u8])] = files![
    "LICENSE.md"
    "WaterBottle.bin"
    "WaterBottle.gltf"
    "WaterBottle_baseColor.png"
    "WaterBottle_emissive.png"
    "WaterBottle_normal.png"
    "WaterBottle_occlusionRoughnessMetallic.png"
];

#[cfg(test)]
mod tests {
    use std::path::Path;

    #[test]
    fn every_file_is_listed() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut names = Vec::new();
        for sub in [""] {
            for entry in folder.join(sub).read_dir().unwrap() {
                let path = entry.unwrap().path();
                let is_own = path.extension().is_some_and(|e| e == "rs") || path.ends_with("Cargo.toml");
                if path.is_file() && !is_own {
                    let name = path.strip_prefix(folder).unwrap().display().to_string();
                    names.push(format!("assets/WaterBottle/{name}"));
                }
            }
        }
        names.sort();
        let mut listed: Vec<&str> = super::FILES.iter().map(|(name, _)| *name).collect();
        listed.sort_unstable();
        assert_eq!(listed, names);
    }
}
