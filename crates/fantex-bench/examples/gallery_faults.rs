//! How much every picture of the gallery changes when a feature of its look is left out: what the tolerances of the goldens are made
//! from. A tolerance is a third of the smallest change that can be seen, so that no feature can be lost unnoticed.
//!
//! ```text
//! cargo run --release -p fantex-bench --example gallery_faults -- [NAME ...]
//! ```
//!
//! Prints each picture's faults with the mean difference per channel of 255, and writes `gallery/goldens/tolerances.toml` where no name
//! is given. Pictures that no look draws keep what stands there: their faults are put into `drawings.rs` of `fantex-cli` by hand.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;

use fantex::look::LookFile;
use fantex::look::{LookImages, ResolveOptions};
use fantex::look_scene::{LookScene, MaterialResolver, PictureChanges};
use fantex::texture::{Depth, Image, Samples};
use fantex_gallery::{Catalogue, Entry, read};

/// Width of the pictures that faults are tried on; means hardly depend on it.
const WIDTH: u32 = 107;

/// Changes below this mean difference cannot be seen: the feature is not what the picture shows.
const MIN_CHANGE: f64 = 0.06;

/// No picture needs a larger tolerance; the other bound is what processors may differ by.
const TOLERANCES: std::ops::RangeInclusive<f64> = 0.02..=0.5;

/// Parts of a look whose keys are features; those of cameras, objects and picture sizes are none.
const FEATURES: [&str; 4] = ["materials", "textures", "light", "environment"];

fn main() -> Result<(), Box<dyn Error>> {
    let names: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new("gallery");
    let catalogue = Catalogue::read(folder)?;
    let file = folder.join("goldens/tolerances.toml");
    let mut tolerances: BTreeMap<String, f64> = toml::from_str(&read(&file)?)?;
    for entry in catalogue.select(&names)? {
        if let Some(look) = &entry.look {
            try_faults(entry, &folder.join(look), &mut tolerances)?;
        }
    }
    if names.is_empty() {
        let lines: String = tolerances.iter().map(|(name, value)| format!("{name} = {value:.3}\n")).collect();
        let head = "# Mean difference per channel of 255 that is let through, by picture; see the example gallery_faults.\n";
        std::fs::write(file, format!("{head}{lines}"))?;
    }
    Ok(())
}

fn try_faults(
    entry: &Entry,
    path: &Path,
    tolerances: &mut BTreeMap<String, f64>,
) -> Result<(), Box<dyn Error>> {
    let original: toml::Table = toml::from_str(&read(path)?)?;
    for (index, variant) in entry.variants().iter().enumerate() {
        let name = format!("{}-{}", entry.name, index + 1);
        let look = variant.apply(&entry.name, original.clone())?;
        let right = picture(&look, path)?;
        let mut smallest = f64::INFINITY;
        for fault in faults(&look) {
            // Without a key that must be there, there is no picture.
            let Ok(wrong) = picture(&without(&look, &fault), path) else { continue };
            let change = difference(&wrong, &right);
            let is_seen = change >= MIN_CHANGE;
            println!(
                "{name:<24} {:<48} {change:8.3}{}",
                fault.join("."),
                if is_seen { "" } else { "  not seen" }
            );
            if is_seen {
                smallest = smallest.min(change);
            }
        }
        let tolerance = (smallest / 3.0).clamp(*TOLERANCES.start(), *TOLERANCES.end());
        println!("{name:<24} tolerance {tolerance:.3}");
        tolerances.insert(name, tolerance);
    }
    Ok(())
}

/// Key paths of everything that can be left out: materials' and textures' keys, lights and their keys, the environment.
fn faults(look: &toml::Table) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for part in FEATURES {
        match look.get(part) {
            Some(toml::Value::Table(table)) if part == "environment" => {
                found.push(vec![part.to_owned()]);
                found.extend(table.keys().map(|key| vec![part.to_owned(), key.clone()]));
            }
            Some(toml::Value::Table(table)) => {
                for (name, value) in table {
                    let keys =
                        value.as_table().into_iter().flat_map(toml::Table::keys).filter(|key| *key != "kind");
                    found.extend(keys.map(|key| vec![part.to_owned(), name.clone(), key.clone()]));
                }
            }
            Some(toml::Value::Array(items)) => {
                for (index, value) in items.iter().enumerate() {
                    found.push(vec![part.to_owned(), index.to_string()]);
                    let keys =
                        value.as_table().into_iter().flat_map(toml::Table::keys).filter(|key| *key != "kind");
                    found.extend(keys.map(|key| vec![part.to_owned(), index.to_string(), key.clone()]));
                }
            }
            _ => {}
        }
    }
    found
}

/// The look without what a key path names.
fn without(look: &toml::Table, path: &[String]) -> toml::Table {
    let mut look = look.clone();
    match path {
        [part] => {
            look.remove(part);
        }
        [part, name, rest @ ..] => match (look.get_mut(part), rest) {
            (Some(toml::Value::Table(table)), []) => {
                table.remove(name);
            }
            (Some(toml::Value::Table(table)), [key, ..]) => {
                if let Some(toml::Value::Table(table)) = table.get_mut(name) {
                    table.remove(key);
                }
            }
            (Some(toml::Value::Array(items)), _) => {
                let index = name.parse().unwrap_or(usize::MAX);
                match (items.get_mut(index), rest) {
                    (Some(toml::Value::Table(table)), [key, ..]) => {
                        table.remove(key);
                    }
                    (Some(_), []) => {
                        items.remove(index);
                    }
                    _ => {}
                }
            }
            _ => {}
        },
        [] => {}
    }
    look
}

/// The look's first picture, as `fantex gallery` draws it.
fn picture(look: &toml::Table, path: &Path) -> Result<Vec<u8>, Box<dyn Error>> {
    let file = LookFile::parse(&look.to_string(), path)?;
    let [w, h] = file.look().picture.size.map(|side| side.0);
    let size = Some([WIDTH, (u64::from(WIDTH) * u64::from(h)).div_ceil(u64::from(w)) as u32]);
    let images = LookImages::default();
    let resolver = MaterialResolver { file: &file, images: &images, options: ResolveOptions::default() };
    let scene = LookScene::new(resolver, None, PictureChanges { size, ..PictureChanges::default() })?;
    let time = scene.times().first().copied().unwrap_or(0.0);
    Ok(bytes(scene.render(time)?.picture.to_srgb_image()))
}

/// Red, green and blue of all pixels.
fn bytes(image: Image) -> Vec<u8> {
    let image = image.converted(Depth::U8, image.space);
    let channels = usize::from(image.channels);
    let Samples::U8(samples) = image.samples else { return Vec::new() };
    samples.chunks(channels).flat_map(|p| [p[0], p[1 % channels], p[2 % channels]]).collect()
}

/// Mean difference per channel of 255.
fn difference(a: &[u8], b: &[u8]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
    if a.len() == b.len() { sum / a.len().max(1) as f64 } else { f64::INFINITY }
}
