//! Worlds: many assets that are shown together, each near the eye whole, far away by its preview.
//!
//! A world is an index, a small JSON file beside its assets or anywhere above them. It says where each asset lies in the world and how
//! coarse its preview is, so what is far away need not be opened to know that. [Coarse assets](WorldCoarse) stand for several. `docs/worlds.md`
//! describes the file.

use std::io::Write;
use std::path::{Path, PathBuf};

use fantex_base::{Aabb, Error, Result, files, input, json_problem, uri_escaped};
#[cfg(not(target_arch = "wasm32"))]
use fantex_base::{ReadLimits, ReadOptions};
use fantex_mesh::{Mesh, TriangleBvh, WorldFromMesh};
use fantex_store::Asset;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{SurfaceSamples, ViewObject, ViewPreview, WorldCoarse, url_of};

/// The extension of a world's file name.
pub const WORLD_EXTENSION: &str = "fanworld";

/// Most bytes that an index may have: some hundred thousand objects.
pub const MAX_INDEX_BYTES: u64 = 64 << 20;

/// What `format` says.
const FORMAT: &str = "fantex world";

/// The version of an index without coarse assets, and that of one with them.
const VERSIONS: [u32; 2] = [1, 2];

/// Memory that a triangle of an open object takes: mesh, cover and what demand knows of it, in main and in graphics memory. (Of landscapes
/// of 0.5 and 1.9 M triangles in the viewer, on a software adapter: 637.)
const TRIANGLE_BYTES: u64 = 640;

/// What else an open object takes: its threads, their buffers, what is cached of its texels.
const OBJECT_BYTES: u64 = 1 << 20;

/// What a triangle of a preview takes, of which only what is drawn is kept.
const PREVIEW_TRIANGLE_BYTES: u64 = 256;

/// Texels of a preview take so many bytes each, in all channels.
const PREVIEW_TEXEL_BYTES: u64 = 4;

/// An index of assets in one world.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct World {
    /// The assets, in the order of the file.
    pub objects: Vec<WorldObject>,
    /// What stands for several of them from afar, in the order of the file.
    pub coarse: Vec<WorldCoarse>,
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
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    coarse: Vec<WorldCoarse>,
}

impl World {
    /// Whether a path or an address names an index: it ends with [`.fanworld`](WORLD_EXTENSION), in any case of letters.
    pub fn is_named(place: &Path) -> bool {
        let path = url_of(place).map_or(place, |url| Path::new(url.split(['?', '#']).next().unwrap_or(url)));
        path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(WORLD_EXTENSION))
    }

    /// Reads an index at a path, or with the feature `http` at an address.
    ///
    /// # Errors
    /// It cannot be read, or those of [`parse`](Self::parse).
    #[cfg(not(target_arch = "wasm32"))]
    pub fn open(place: impl AsRef<Path>) -> Result<Self> {
        let place = place.as_ref();
        Self::parse(place, &crate::read_whole(place, MAX_INDEX_BYTES)?)
    }

    /// Reads an index that is to be changed or replaced: unlike what is [opened](Self::open) it may be [overwritten](input::check_output).
    ///
    /// # Errors
    /// As [`open`](Self::open).
    #[cfg(not(target_arch = "wasm32"))]
    pub fn open_to_change(place: impl AsRef<Path>) -> Result<Self> {
        let options = ReadOptions { protect_inputs: false, ..*ReadLimits::current().options() };
        ReadLimits::new(options).run(|| Self::open(place))
    }

    /// An index that was read at a path or an address.
    ///
    /// # Errors
    /// It is no index; an object has a box that is none, or leads out of the index's folder where
    /// [that is not allowed](fantex_base::ReadOptions::allow_outside); coarse assets have [no parts that they can have](Self::parts).
    pub fn parse(place: &Path, bytes: &[u8]) -> Result<Self> {
        let file = serde_json::from_slice::<WorldFile>(bytes);
        let WorldFile { format, version, objects, coarse } = file.map_err(|error| {
            let problem =
                json_problem(bytes, &error).context(format_args!("{} is no world", place.display()));
            problem.with_path(place).with_source(error)
        })?;
        let wrong = |what: String| Error::malformed(format!("{}: {what}", place.display())).with_path(place);
        let [plain, with_coarse] = VERSIONS;
        if format != FORMAT || !VERSIONS.contains(&version) {
            return Err(wrong(format!(
                "expected \"{FORMAT}\" of version {plain} or {with_coarse}, not \"{format}\" of version {version}"
            )));
        }
        if version == plain && !coarse.is_empty() {
            return Err(wrong(format!(
                "coarse assets are there from version {with_coarse} on, not in {plain}"
            )));
        }
        for (index, object) in objects.iter().enumerate() {
            if let Some(defect) = object.defect() {
                return Err(wrong(format!("object {} ({}) {defect}", index + 1, object.asset)));
            }
        }
        for (index, coarse) in coarse.iter().enumerate() {
            let WorldCoarse { asset, low, high, detail, .. } = coarse;
            if let Some(defect) = defect(asset, [*low, *high], Some(*detail)) {
                return Err(wrong(format!("coarse asset {index} ({asset}) {defect}")));
            }
        }
        let world = Self { objects, coarse };
        if url_of(place).is_none() {
            for asset in world.assets().map(Path::new).filter(|asset| url_of(asset).is_none()) {
                input::check_inside(place, asset)?;
            }
        }
        world.parts().map_err(|error| wrong(error.to_string()))?;
        Ok(world)
    }

    /// Writes the index, whole or not at all; one that is there is replaced.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = self.to_bytes()?;
        files::write_whole(path, true, |file| file.write_all(&text))
    }

    /// The index as a file.
    ///
    /// # Errors
    /// A number is none that the file can hold.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let file = WorldFile {
            format: FORMAT.into(),
            version: VERSIONS[usize::from(!self.coarse.is_empty())],
            objects: self.objects.clone(),
            coarse: self.coarse.clone(),
        };
        let mut text = serde_json::to_vec_pretty(&file)
            .map_err(|error| Error::invalid(format!("the world cannot be written: {error}")))?;
        text.push(b'\n');
        Ok(text)
    }

    /// How an index names an asset: a file relative to the index's folder, below which it must lie; an address as it is, or relative to an index in
    /// the same object store, where it lies below that.
    ///
    /// # Errors
    /// The file does not lie below that folder, or the index lies at an address; one of them cannot be found; a name on the way is not UTF-8 or is
    /// none on every system.
    pub fn name_of(index: &Path, asset: &Path) -> Result<String> {
        if let Some(url) = url_of(asset) {
            let folder = url_of(index).and_then(|index| Some(&index[..=index.rfind('/')?]));
            let is_object = url.get(..4).is_some_and(|start| !start.eq_ignore_ascii_case("http"));
            let below = folder.filter(|_| is_object).and_then(|folder| url.strip_prefix(folder));
            // Not a key such as `a//b.fan`: names on a way are tidied up, which would lead to another object.
            let below = below.filter(|below| Self::path_below(below).as_deref() == Some(*below));
            return Ok(below.unwrap_or(url).to_owned());
        }
        if let Some(index) = url_of(index) {
            let asset = asset.display();
            return Err(Error::unsupported(format!(
                "{asset} lies on this machine, where those who read {index} do not find it; give an address"
            )));
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
        let names = names.filter(|names| names.iter().all(|name| is_portable(name)));
        names.map(|names| names.join("/")).ok_or_else(|| {
            let asset = asset.display();
            Error::unsupported(format!(
                "an index cannot name {asset}: names must be UTF-8, without \\ and :, to be names on every system; rename it"
            ))
        })
    }

    /// Where an object's asset is: see [`place_of`](Self::place_of).
    pub fn asset_place(index: &Path, object: &WorldObject) -> PathBuf {
        Self::place_of(index, &object.asset)
    }

    /// Where an asset is that an index names: a path or an address. `index` is where the world was read. On web servers the names are encoded.
    pub fn place_of(index: &Path, asset: &str) -> PathBuf {
        if url_of(Path::new(asset)).is_some() {
            return PathBuf::from(asset);
        }
        let asset = Self::path_below(asset).unwrap_or_else(|| asset.to_owned());
        match url_of(index) {
            Some(url) => {
                let path = url.split(['?', '#']).next().unwrap_or(url);
                let folder = path.rfind('/').map_or(path, |end| &path[..=end]);
                let is_http = folder.get(..4).is_some_and(|start| start.eq_ignore_ascii_case("http"));
                let asset = if is_http { uri_escaped(&asset) } else { asset };
                PathBuf::from(format!("{folder}{asset}"))
            }
            None => files::folder_of(index).join(asset),
        }
    }

    /// The names on the way from the index's folder to the file of an asset that an index names, with `/` between them; none for an address, for
    /// what does not lie below that folder, and for names that mean something else on other systems.
    pub fn path_below(asset: &str) -> Option<String> {
        if url_of(Path::new(asset)).is_some() || asset.starts_with('/') {
            return None;
        }
        let mut names: Vec<&str> = Vec::new();
        for name in asset.split('/') {
            match name {
                "" | "." => {}
                ".." => {
                    names.pop()?;
                }
                name if is_portable(name) => names.push(name),
                _ => return None,
            }
        }
        (!names.is_empty()).then(|| names.join("/"))
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

    /// The objects and the coarse assets as seen in the space that they are drawn in, of whose surfaces nothing is known.
    ///
    /// # Errors
    /// As [`parts`](Self::parts).
    pub fn view_objects(&self, space: &WorldFromMesh) -> Result<Vec<ViewObject>> {
        let coarse = self.coarse.iter().zip(self.parts()?);
        let coarse = coarse.map(|(coarse, parts)| coarse.view_object(space, parts));
        Ok(self.objects.iter().map(|object| object.view_object(space)).chain(coarse).collect())
    }

    /// Opens the preview of an asset at a path or an address whose world says that it has one.
    ///
    /// # Errors
    /// It cannot be read, or there is none.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn open_preview(place: &Path) -> Result<Asset> {
        crate::open_preview(place)?.ok_or_else(|| Self::no_preview(place))
    }

    /// The error of an asset without a preview whose world says that it has one.
    pub fn no_preview(place: &Path) -> Error {
        Error::not_found(format!("{} has no preview, although its world says so", place.display()))
    }

    /// Corners of the bounding box of all objects, world units; none without objects.
    pub fn bounds(&self) -> Option<[DVec3; 2]> {
        let boxes = self.objects.iter().map(|object| [DVec3::from(object.low), DVec3::from(object.high)]);
        boxes.reduce(|[low, high], [l, h]| [low.min(l), high.max(h)])
    }
}

impl WorldObject {
    /// The corners of its bounding box, world units.
    pub fn corners(&self) -> [DVec3; 8] {
        Aabb { min: DVec3::from(self.low), max: DVec3::from(self.high) }.corners()
    }

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
                detail: texel_side(preview.mesh(), texels).max(distance(mesh, preview.mesh())),
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

    fn view_object(&self, space: &WorldFromMesh) -> ViewObject {
        let preview = self.preview.map(|preview| ViewPreview {
            bytes: preview_bytes(preview.triangles, preview.texels),
            detail: (preview.detail / space.scale) as f32,
        });
        ViewObject {
            bounds: [self.low, self.high].map(|corner| space.inverse_point(DVec3::from(corner))),
            surface: SurfaceSamples::default(),
            whole_bytes: self.triangles.saturating_mul(TRIANGLE_BYTES).saturating_add(OBJECT_BYTES),
            preview,
            parts: Vec::new(),
        }
    }

    fn defect(&self) -> Option<&'static str> {
        defect(&self.asset, [self.low, self.high], self.preview.map(|preview| preview.detail))
    }
}

/// Whether a name is one on every system: on some `\` parts names, and `:` follows that of a drive.
fn is_portable(name: &str) -> bool {
    !name.contains(['\\', ':'])
}

/// What is wrong with what an index says of an asset: with its name, its box, or the detail of what stands for it.
fn defect(asset: &str, corners: [[f64; 3]; 2], detail: Option<f64>) -> Option<&'static str> {
    if asset.is_empty() {
        return Some("names no file");
    }
    let [low, high] = corners.map(DVec3::from);
    if !(low.is_finite() && high.is_finite() && low.cmple(high).all()) {
        return Some("has a low corner that is not below its high one");
    }
    let is_length = |detail: f64| detail.is_finite() && detail > 0.0;
    (!detail.is_none_or(is_length)).then_some("has a preview, or is one, whose detail is no positive length")
}

/// Memory that a preview or a coarse asset takes.
pub(crate) fn preview_bytes(triangles: u64, texels: u64) -> u64 {
    let texels = texels.saturating_mul(PREVIEW_TEXEL_BYTES);
    triangles.saturating_mul(PREVIEW_TRIANGLE_BYTES).saturating_add(texels)
}

/// Vertices at which the distance between a mesh and its preview is measured, at most.
const MAX_PROBES: usize = 100_000;

/// The mean side of a texel, world units.
pub(crate) fn texel_side(mesh: &Mesh, texels: u64) -> f64 {
    mesh.world_from_mesh.scale * (mesh.area() / texels.max(1) as f64).sqrt()
}

/// The largest distance of a vertex of a mesh (of 100 000, spread evenly) to the surface of a coarser one, world units.
pub(crate) fn distance(fine: &Mesh, coarse: &Mesh) -> f64 {
    let surface = TriangleBvh::new(coarse);
    let step = fine.positions.len().div_ceil(MAX_PROBES).max(1);
    let probes: Vec<Vec3> = fine.positions.iter().copied().step_by(step).collect();
    let distance = |&p: &Vec3| {
        let p = coarse.world_from_mesh.inverse_point(fine.world_from_mesh.point(p));
        surface.nearest_point(p, f32::INFINITY).map_or(0.0, |nearest| nearest.distance)
    };
    let farthest = probes.par_iter().map(distance).reduce(|| 0.0, f32::max);
    coarse.world_from_mesh.scale * f64::from(farthest)
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
        let objects = vec![object("b.fan"), WorldObject { preview: None, ..object("c/d.fan") }];
        let world = World { objects, ..World::default() };
        world.write(&path).unwrap();
        assert_eq!(World::open(&path).unwrap(), world);
        assert_eq!(World::asset_place(&path, &world.objects[1]), folder.path().join("c/d.fan"));
        assert_eq!(world.bounds(), Some([[0.0, -1.0, 0.5], [1.0, 1.0, 0.5]].map(DVec3::from)));
    }

    #[test]
    fn assets_lie_relative_to_an_address() {
        let at = |index: &str, asset| World::asset_place(Path::new(index), &object(asset));
        assert_eq!(at("https://a.b/c/d.fanworld?x=/1", "e.fan"), Path::new("https://a.b/c/e.fan"));
        assert_eq!(at("s3://bucket/d.fanworld", "e/f g.fan"), Path::new("s3://bucket/e/f g.fan"));
        let encoded = Path::new("http://a.b/c/e%20f/%C3%BC%25.fan");
        assert_eq!(at("http://a.b/c/d.fanworld", "./e f/x/../\u{fc}%.fan"), encoded);
        assert_eq!(at("d.fanworld", "https://x.y/e.fan"), Path::new("https://x.y/e.fan"));
    }

    #[test]
    fn names_of_objects_in_a_store_lead_back_to_them() {
        let index = Path::new("s3://bucket/land/d.fanworld");
        for (asset, name) in [
            ("s3://bucket/land/e/f.fan", "e/f.fan"),
            ("s3://bucket/land/e//f.fan", "s3://bucket/land/e//f.fan"),
            ("s3://bucket/land//f.fan", "s3://bucket/land//f.fan"),
            ("s3://bucket/land/e:f.fan", "s3://bucket/land/e:f.fan"),
            ("s3://bucket/g.fan", "s3://bucket/g.fan"),
            ("https://a.b/land/f.fan", "https://a.b/land/f.fan"),
        ] {
            let found = World::name_of(index, Path::new(asset)).unwrap();
            assert_eq!(found, name);
            assert_eq!(World::place_of(index, &found).to_str(), Some(asset));
        }
    }

    #[test]
    fn what_lies_below_the_index_is_told_from_what_does_not() {
        let below = World::path_below;
        for (asset, path) in [("a.fan", "a.fan"), ("./b//c.fan", "b/c.fan"), ("b/../c.fan", "c.fan")] {
            assert_eq!(below(asset).as_deref(), Some(path), "{asset}");
        }
        for asset in [
            "../a.fan",
            "b/../../a.fan",
            "/etc/a.fan",
            "https://a.b/c.fan",
            "s3://a/b.fan",
            "az://a/b.fan",
            ".",
            "b/..",
            r"..\a.fan",
            r"C:\a.fan",
            "C:a.fan",
        ] {
            assert_eq!(below(asset), None, "{asset}");
        }
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
        refused("", "is no world: line 1, column 0: the file ends too early");
        refused("{\n\"objects\": [{\"asset\": 3}]}", "line 2, column 23: expected a text, found 3");
        refused(r#"{"format": "fantex world", "version": 3, "objects": []}"#, "of version 3");
        let coarse = r#"{"asset": "c.fan", "bytes": 1, "triangles": 1, "texels": 1, "low": [0, 0, 0], "high": [1, 1, 1],
            "detail": 1, "parts": ["b.fan"]}"#;
        let text =
            format!(r#"{{"format": "fantex world", "version": 1, "objects": [], "coarse": [{coarse}]}}"#);
        refused(&text, "from version 2 on");
        let outside = World { objects: vec![object("../b.fan")], ..World::default() };
        outside.write(&path).unwrap();
        assert!(World::open(&path).unwrap_err().to_string().contains("outside"));
        let mut empty = object("b.fan");
        empty.high[0] = -1.0;
        World { objects: vec![empty], ..World::default() }.write(&path).unwrap();
        assert!(World::open(&path).unwrap_err().to_string().contains("low corner"));
    }
}
