//! The gallery's pictures beside their goldens, and what it ships.

use std::fs;
use std::path::Path;

use fantex::texture::{Depth, Image, Samples};

use crate::{fails, files, json, succeeds, workspace};

/// Width of the goldens, as `cargo xtask goldens` draws them.
const WIDTH: &str = "320";

#[test]
fn every_picture_looks_like_its_golden() {
    let folder = tempfile::tempdir().unwrap();
    let info = json(&[&"gallery", &"-o", &folder.path(), &"--width", &WIDTH, &"--still"]);
    let page = fs::read_to_string(folder.path().join("index.html")).unwrap();
    let goldens = workspace().join("gallery/goldens");
    // A third of what leaving out any feature of the look changes: see the example gallery_faults of fantex-bench.
    let tolerances = fs::read_to_string(goldens.join("tolerances.toml")).unwrap();
    let tolerances: toml::Table = toml::from_str(&tolerances).unwrap();
    let mut drawn = vec!["tolerances.toml".to_owned()];
    let mut wrong = Vec::new();
    for picture in info["pictures"].as_array().unwrap() {
        let path = Path::new(picture.as_str().unwrap());
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        assert!(page.contains(&format!("src=\"{name}\"")), "the page shows {name}");
        let tolerance = tolerances[name.trim_end_matches(".png")].as_float().unwrap();
        let difference = mean_difference(&bytes(path), &bytes(&goldens.join(&name)));
        if difference > tolerance {
            wrong.push(format!("{name}: mean difference {difference:.3}, tolerance {tolerance}"));
        }
        drawn.push(name);
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    drawn.sort();
    assert_eq!(drawn, files(&goldens), "pictures without a golden, or goldens without a picture");
}

/// Pictures that show the same on purpose: an exported model looks like its asset, an asset like its model.
const ALIKE: [[&str; 2]; 2] = [["export-1", "export-2"], ["commands-1", "commands-2"]];

/// What tells pictures of an entry apart can be seen: per channel of 255, in the mean.
const MIN_DIFFERENCE: f64 = 0.3;

#[test]
fn pictures_of_an_entry_differ() {
    let goldens = workspace().join("gallery/goldens");
    let catalogue = fantex_gallery::Catalogue::read(&workspace().join("gallery")).unwrap();
    for entry in &catalogue.entries {
        let drawn = (1..).map(|number| format!("{}-{number}", entry.name));
        let names = drawn.take_while(|name| goldens.join(format!("{name}.png")).exists());
        let pictures: Vec<_> =
            names.map(|name| (bytes(&goldens.join(format!("{name}.png"))), name)).collect();
        for (i, (picture, name)) in pictures.iter().enumerate() {
            for (other_picture, other) in &pictures[i + 1..] {
                let difference = mean_difference(picture, other_picture);
                let is_meant = ALIKE.contains(&[name.as_str(), other.as_str()]);
                assert!(difference > MIN_DIFFERENCE || is_meant, "{name} and {other}: {difference:.3}");
            }
        }
    }
}

/// Rows of pixels, three bytes each. An animation's first picture.
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

/// Per channel of 255; infinite for pictures of other sizes.
fn mean_difference((size, a): &([u32; 2], Vec<u8>), (other_size, b): &([u32; 2], Vec<u8>)) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
    if size == other_size { sum / a.len() as f64 } else { f64::INFINITY }
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
    fails(2, &["no picture 'nonsense'", "sines"], &[&"gallery", &"-o", &folder.path(), &"nonsense"]);
}

#[test]
fn every_file_that_travels_in_the_program_is_listed() {
    let groups = [
        ("gallery", vec![""], fantex_gallery::FILES),
        ("assets", vec!["", "images", "models", "volumes"], fantex_assets::FILES),
        ("assets/WaterBottle", vec![""], fantex_bottle::FILES),
    ];
    for (folder, parts, files) in groups {
        let paths = parts.iter().flat_map(|part| workspace().join(folder).join(part).read_dir().unwrap());
        // The notices are a constant of their own.
        let is_own = |path: &Path| {
            path.extension().is_some_and(|e| e == "rs")
                || ["Cargo.toml", "NOTICES.txt"].iter().any(|name| path.ends_with(name))
        };
        let paths = paths.map(|entry| entry.unwrap().path()).filter(|path| path.is_file() && !is_own(path));
        let mut names: Vec<String> =
            paths.map(|path| path.strip_prefix(workspace()).unwrap().display().to_string()).collect();
        names.sort();
        let mut listed: Vec<&str> = files.iter().map(|(name, _)| *name).collect();
        listed.sort_unstable();
        assert_eq!(listed, names);
    }
}
