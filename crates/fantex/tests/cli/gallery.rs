//! The gallery: every entry is drawn, looks as it did, and stands on the page.

use std::fs;
use std::path::Path;

use fantex_texture::{Depth, Image, Samples};

use crate::support::{fails, files, json, succeeds, workspace};

/// Width of the goldens, as `cargo xtask goldens` draws them.
const WIDTH: &str = "120";
/// Mean difference per channel of 255: other processors round and encode blocks a little differently.
const MEAN_TOLERANCE: f64 = 1.0;
/// A pixel that differs by more, in any channel of 255, counts as wrong; at an outline rounding can turn one over.
const PIXEL_TOLERANCE: u8 = 24;
/// Share of wrong pixels that is let through.
const WRONG_SHARE: f64 = 0.01;

#[test]
fn every_picture_looks_like_its_golden() {
    let folder = tempfile::tempdir().unwrap();
    let info = json(&[&"gallery", &"-o", &folder.path(), &"--width", &WIDTH]);
    let page = fs::read_to_string(folder.path().join("index.html")).unwrap();
    let goldens = workspace().join("gallery/goldens");
    let mut drawn = Vec::new();
    for picture in info["pictures"].as_array().unwrap() {
        let path = Path::new(picture.as_str().unwrap());
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        assert!(page.contains(&format!("src=\"{name}\"")), "the page shows {name}");
        compare(&name, &bytes(path), &bytes(&goldens.join(&name)));
        drawn.push(name);
    }
    drawn.sort();
    assert_eq!(drawn, files(&goldens), "pictures without a golden, or goldens without a picture");
}

/// Rows of pixels, four bytes each. An animation's first picture.
fn bytes(path: &Path) -> ([u32; 2], Vec<u8>) {
    let image =
        Image::load(path).unwrap_or_else(|error| panic!("{error}; draw goldens with cargo xtask goldens"));
    let image = image.converted(Depth::U8, image.space);
    let channels = usize::from(image.channels);
    let Samples::U8(samples) = image.samples else { panic!("converted to bytes") };
    (
        [image.width, image.height],
        samples.chunks(channels).flat_map(|p| [p[0], p[1 % channels], p[2 % channels]]).collect(),
    )
}

fn compare(name: &str, (size, drawn): &([u32; 2], Vec<u8>), (golden_size, golden): &([u32; 2], Vec<u8>)) {
    assert_eq!(size, golden_size, "{name}");
    let differences: Vec<u8> = drawn.iter().zip(golden).map(|(a, b)| a.abs_diff(*b)).collect();
    let mean = differences.iter().map(|&d| f64::from(d)).sum::<f64>() / differences.len() as f64;
    let wrong = differences.chunks(3).filter(|p| p.iter().any(|&d| d > PIXEL_TOLERANCE)).count();
    let share = wrong as f64 / (differences.len() / 3) as f64;
    assert!(
        mean <= MEAN_TOLERANCE && share <= WRONG_SHARE,
        "{name}: mean difference {mean:.2}, {share:.4} of the pixels wrong"
    );
}

#[test]
fn entries_are_drawn_by_name_and_by_row() {
    let folder = tempfile::tempdir().unwrap();
    succeeds(&[&"gallery", &"-o", &folder.path(), &"--width", &"32", &"sines", &"T8"]);
    let made = files(folder.path());
    assert_eq!(
        made,
        ["index.html", "sines-1.png", "wraps-1.png", "wraps-2.png", "wraps-3.png", "wraps-4.png"]
    );
    fails(1, &["no picture 'nonsense'", "sines"], &[&"gallery", &"-o", &folder.path(), &"nonsense"]);
}
