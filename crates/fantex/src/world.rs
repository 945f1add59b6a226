//! Worlds: many assets that are shown together, each near the eye whole, far away by its preview.
//!
//! A world is an index, a small JSON file beside its assets or anywhere above them. It says where each asset lies in the world and how
//! coarse its preview is, so what is far away need not be opened to know that. `docs/worlds.md` describes the file.

use std::io::Write;
use std::path::{Path, PathBuf};

use fantex_base::{Error, Result, files, input};
use fantex_mesh::WorldFromMesh;
use fantex_store::Asset;
use fantex_stream::{read_whole, url_of};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::preview::detail_of;

/// The extension of a world's file name.
pub const WORLD_EXTENSION: &str = "fanworld";

/// Most bytes that an index may have: some hundred thousand objects.
const MOST_BYTES: u64 = 64 << 20;

/// What `format` says.
const FORMAT: &str = "fantex world";

/// The only version.
const VERSION: u32 = 1;

/// An index of assets in one world.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct World {
    /// The assets, in the order of the file.
    pub objects: Vec<WorldObject>,
}

/// An asset in a world, where its own coordinates say.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorldObject {
    /// Its file, relative to the index, or an address.
    pub asset: String,
    /// Length of the file.
    pub bytes: u64,
    /// Triangles.
    pub triangles: u64,
    /// Stored texels at level 0, per channel.
    pub texels: u64,
    /// Corners of its bounding box, world units.
    pub low: [f64; 3],
    /// See [`low`](Self::low).
    pub high: [f64; 3],
    /// Its preview, where it has one; else it is shown whole or not at all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preview: Option<WorldPreview>,
}

/// What an index knows of a preview.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorldPreview {
    /// Triangles.
    pub triangles: u64,
    /// Stored texels at level 0, per channel.
    pub texels: u64,
    /// Length of the finest detail that it shows, world units: that of a texel, or how far it departs from the surface.
    pub detail: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct WorldFile {
    format: String,
    version: u32,
    objects: Vec<WorldObject>,
}

impl World {
    /// Reads an index at a path, or with the feature `http` at an address.
    ///
    /// # Errors
    /// It cannot be read or is no index; an object has a box that is none, or leads out of the index's folder where
    /// [that is not allowed](fantex_base::ReadOptions::allow_outside).
    pub fn open(place: impl AsRef<Path>) -> Result<Self> {
        let place = place.as_ref();
        let bytes = read_whole(place, MOST_BYTES)?;
        let file: WorldFile = serde_json::from_slice(&bytes).map_err(|error| {
            Error::malformed(format!("{} is no world: {error}", place.display())).with_path(place)
        })?;
        let wrong = |what: String| Error::malformed(format!("{}: {what}", place.display())).with_path(place);
        if file.format != FORMAT || file.version != VERSION {
            let WorldFile { format, version, .. } = file;
            return Err(wrong(format!(
                "expected \"{FORMAT}\" of version {VERSION}, not \"{format}\" of version {version}"
            )));
        }
        for (index, object) in file.objects.iter().enumerate() {
            if let Some(defect) = object.defect() {
                return Err(wrong(format!("object {index} ({}) {defect}", object.asset)));
            }
            if url_of(place).is_none() && url_of(Path::new(&object.asset)).is_none() {
                input::check_inside(place, Path::new(&object.asset))?;
            }
        }
        Ok(Self { objects: file.objects })
    }

    /// Writes the index, whole or not at all; one that is there is replaced.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let file = WorldFile { format: FORMAT.into(), version: VERSION, objects: self.objects.clone() };
        let mut text = serde_json::to_vec_pretty(&file)
            .map_err(|error| Error::invalid(format!("the world cannot be written: {error}")))?;
        text.push(b'\n');
        files::write_whole(path, true, |file| file.write_all(&text))
    }

    /// Adds an object, in the place of one with the same asset where there is one: then true.
    pub fn put(&mut self, object: WorldObject) -> bool {
        match self.objects.iter_mut().find(|known| known.asset == object.asset) {
            Some(known) => {
                *known = object;
                true
            }
            None => {
                self.objects.push(object);
                false
            }
        }
    }

    /// How an index names an asset: an address as it is, a file relative to the index's folder, below which it must lie.
    ///
    /// # Errors
    /// The file does not lie below that folder, one of them cannot be found, or the name is not UTF-8.
    pub fn name_of(index: &Path, asset: &Path) -> Result<String> {
        if let Some(url) = url_of(asset) {
            return Ok(url.to_owned());
        }
        let folder = files::folder_of(index);
        let canonical = |path: &Path| path.canonicalize().map_err(|error| Error::reading(path, error));
        let (folder, file) = (canonical(folder)?, canonical(asset)?);
        let below = file.strip_prefix(&folder).map_err(|_| {
            let (asset, folder) = (asset.display(), folder.display());
            Error::unsupported(format!(
                "{asset} does not lie below {folder}, the folder of the index; move one of them, or give an address"
            ))
        })?;
        let names: Option<Vec<&str>> = below.iter().map(|name| name.to_str()).collect();
        names.map(|names| names.join("/")).ok_or_else(|| {
            Error::unsupported(format!("an index cannot name {}: its name is not UTF-8", asset.display()))
        })
    }

    /// Where an object's asset is: a path or an address. `index` is where the world was read.
    pub fn asset_place(index: &Path, object: &WorldObject) -> PathBuf {
        if url_of(Path::new(&object.asset)).is_some() {
            return PathBuf::from(&object.asset);
        }
        match url_of(index) {
            Some(url) => {
                let path = url.split(['?', '#']).next().unwrap_or(url);
                let folder = path.rfind('/').map_or(path, |end| &path[..=end]);
                PathBuf::from(format!("{folder}{}", object.asset))
            }
            None => files::folder_of(index).join(&object.asset),
        }
    }

    /// The mesh space that all objects are drawn in: that of a mesh which fills the same box. None where that is a point.
    pub fn space(&self) -> Option<WorldFromMesh> {
        let [low, high] = self.bounds()?;
        WorldFromMesh::of_box(low, high)
    }

    /// As [`space`](Self::space), for those who want to show something. `index` is where the world was read.
    ///
    /// # Errors
    /// There is no object, or all lie in one point.
    pub fn space_to_show(&self, index: &Path) -> Result<WorldFromMesh> {
        self.space().ok_or_else(|| {
            Error::not_found(format!("there is nothing to show in the world {}", index.display()))
        })
    }

    /// Corners of the bounding box of all objects, world units; none without objects.
    pub fn bounds(&self) -> Option<[DVec3; 2]> {
        let boxes = self.objects.iter().map(|object| [DVec3::from(object.low), DVec3::from(object.high)]);
        boxes.reduce(|[low, high], [l, h]| [low.min(l), high.max(h)])
    }
}

impl WorldObject {
    /// What an index says of an open asset. `name` is the asset's file relative to the index, or its address.
    ///
    /// # Errors
    /// The asset's preview cannot be read.
    pub fn of(name: impl Into<String>, asset: &Asset) -> Result<Self> {
        let mesh = asset.mesh();
        let bounds = mesh.bounds();
        let preview = Asset::open_preview(&**asset.source())?.map(|preview| {
            let texels = preview.cover().stored_texels(preview.mesh());
            WorldPreview {
                triangles: preview.mesh().triangles.len() as u64,
                texels,
                detail: detail_of(mesh, &preview, texels),
            }
        });
        Ok(Self {
            asset: name.into(),
            bytes: asset.file_bytes(),
            triangles: mesh.triangles.len() as u64,
            texels: asset.cover().stored_texels(mesh),
            low: mesh.world_from_mesh.point(bounds.min).into(),
            high: mesh.world_from_mesh.point(bounds.max).into(),
            preview,
        })
    }

    fn defect(&self) -> Option<&'static str> {
        if self.asset.is_empty() {
            return Some("names no file");
        }
        let [low, high] = [DVec3::from(self.low), DVec3::from(self.high)];
        if !(low.is_finite() && high.is_finite() && low.cmple(high).all()) {
            return Some("has a low corner that is not below its high one");
        }
        let is_length = |detail: f64| detail.is_finite() && detail > 0.0;
        (!self.preview.is_none_or(|preview| is_length(preview.detail)))
            .then_some("has a preview whose detail is no positive length")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(asset: &str) -> WorldObject {
        WorldObject {
            asset: asset.into(),
            bytes: 1,
            triangles: 2,
            texels: 3,
            low: [0.0, -1.0, 0.5],
            high: [1.0, 1.0, 0.5],
            preview: Some(WorldPreview { triangles: 1, texels: 2, detail: 0.25 }),
        }
    }

    #[test]
    fn an_index_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.fanworld");
        let world =
            World { objects: vec![object("b.fan"), WorldObject { preview: None, ..object("c/d.fan") }] };
        world.write(&path).unwrap();
        assert_eq!(World::open(&path).unwrap(), world);
        assert_eq!(World::asset_place(&path, &world.objects[1]), folder.path().join("c/d.fan"));
        assert_eq!(world.bounds(), Some([[0.0, -1.0, 0.5], [1.0, 1.0, 0.5]].map(DVec3::from)));
    }

    #[test]
    fn assets_lie_relative_to_an_address() {
        let at = |index: &str, asset| World::asset_place(Path::new(index), &object(asset));
        assert_eq!(at("https://a.b/c/d.fanworld?x=/1", "e.fan"), Path::new("https://a.b/c/e.fan"));
        assert_eq!(at("s3://bucket/d.fanworld", "e/f.fan"), Path::new("s3://bucket/e/f.fan"));
        assert_eq!(at("d.fanworld", "https://x.y/e.fan"), Path::new("https://x.y/e.fan"));
    }

    #[test]
    fn what_is_no_index_is_refused_with_a_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.fanworld");
        let refused = |text: &str, expected: &str| {
            std::fs::write(&path, text).unwrap();
            let error = World::open(&path).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        refused("", "is no world");
        refused(r#"{"format": "fantex world", "version": 2, "objects": []}"#, "of version 2");
        let outside = World { objects: vec![object("../b.fan")] };
        outside.write(&path).unwrap();
        assert!(World::open(&path).unwrap_err().to_string().contains("outside"));
        let mut empty = object("b.fan");
        empty.high[0] = -1.0;
        World { objects: vec![empty] }.write(&path).unwrap();
        assert!(World::open(&path).unwrap_err().to_string().contains("low corner"));
    }
}
