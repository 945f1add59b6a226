//! Models, images and volumes that the gallery shows. Where they come from stands in `LICENSES.md`.

/// Files of this folder as `(path in the workspace, content)`.
macro_rules! files {
    ($($name:literal)*) => { &[$((concat!("assets/", $name), include_bytes!($name))),*] };
}

/// Path in the workspace and content of every file.
pub const FILES: &[(&str, &[u8])] = files![
    "LICENSE-VTKData.txt"
    "LICENSES-MIT.txt"
    "LICENSES.md"
    "images/Ryfjallet_cubemap.png"
    "images/brick.png"
    "images/coffee.jpg"
    "images/earth-height.png"
    "images/earth-night.jpg"
    "images/earth.jpg"
    "images/forest.exr"
    "images/grass.png"
    "images/gravel.png"
    "images/rock-color.jpg"
    "images/rock-height.png"
    "images/rock-normal.png"
    "images/rocket.jpg"
    "images/uv_checker_bw.png"
    "models/CornellBox.glb"
    "models/mount-st-helens.ply"
    "models/spot.obj"
    "models/spot_texture.png"
    "models/suzanne.ply"
    "models/teapot.stl"
    "volumes/HeadMRVolume.mhd"
    "volumes/HeadMRVolume.raw"
];

#[cfg(test)]
mod tests {
    use std::path::Path;

    #[test]
    fn every_file_is_listed() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut names = Vec::new();
        for sub in ["", "images", "models", "volumes"] {
            for entry in folder.join(sub).read_dir().unwrap() {
                let path = entry.unwrap().path();
                let is_own = path.extension().is_some_and(|e| e == "rs") || path.ends_with("Cargo.toml");
                if path.is_file() && !is_own {
                    let name = path.strip_prefix(folder).unwrap().display().to_string();
                    names.push(format!("assets/{name}"));
                }
            }
        }
        names.sort();
        let mut listed: Vec<&str> = super::FILES.iter().map(|(name, _)| *name).collect();
        listed.sort_unstable();
        assert_eq!(listed, names);
    }
}
