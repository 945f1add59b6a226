//! Models, images and volumes that the gallery shows. Where they come from stands in `LICENSES.md`.

/// Licences of all that the programs are made of, as they print them.
pub const NOTICES: &str = include_str!("NOTICES.txt");

/// Path in the workspace and content of every file.
pub const FILES: &[(&str, &[u8])] = fantex_base::files![
    "assets/":
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
