//! Coarse assets of a world: each stands for several objects, or for several finer ones of its kind, so that what is far takes a few of them.
//!
//! ```text
//!  coarse   .--------- 5 ---------.         drawn instead of 3 and 4, or of all objects
//!           3                     4         3 instead of 0 and 1
//!  objects  0  1                  2
//! ```
//!
//! *Nodes* are the objects and, numbered after them, the coarse assets. Each is part of one coarse asset at most.

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use fantex_base::{Error, Result};
use fantex_mesh::{Mesh, WorldFromMesh};
use fantex_store::{Asset, BytesSource};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::world::{distance, preview_bytes, texel_side};
use crate::{SurfaceSamples, ViewObject, ViewPreview, World, WorldObject};

/// Most bytes that a coarse asset may have: it is read whole.
pub const MAX_COARSE_BYTES: u64 = 256 << 20;

/// Most levels of coarse assets above each other.
const MAX_LEVELS: usize = 32;

/// A small asset that is shown from afar in the place of several objects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorldCoarse {
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
    /// Length of the finest detail that it shows, world units: that of a texel, or how far it may depart from the surface.
    pub detail: f64,
    /// The assets of the objects, and of the finer coarse assets, that it stands for.
    pub parts: Vec<String>,
}

impl WorldCoarse {
    /// What an index says of an open asset. `finer` is what its parts show, as one mesh, and `finer_detail` the longest of their details, world
    /// units. The asset's own is the mean side of a texel, or, where that is longer, `finer_detail` and the largest distance of a vertex of `finer`
    /// (of 100 000, spread evenly) to the asset's surface together.
    pub fn of(
        name: impl Into<String>,
        asset: &Asset,
        parts: Vec<String>,
        finer: &Mesh,
        finer_detail: f64,
    ) -> Self {
        let mesh = asset.mesh();
        let (bounds, texels) = (mesh.bounds(), asset.cover().stored_texels(mesh));
        Self {
            asset: name.into(),
            bytes: asset.file_bytes(),
            triangles: mesh.triangles.len() as u64,
            texels,
            low: mesh.world_from_mesh.point(bounds.min).into(),
            high: mesh.world_from_mesh.point(bounds.max).into(),
            detail: texel_side(mesh, texels).max(finer_detail + distance(finer, mesh)),
            parts,
        }
    }

    pub(crate) fn view_object(&self, space: &WorldFromMesh, parts: Vec<usize>) -> ViewObject {
        ViewObject {
            bounds: [self.low, self.high].map(|corner| space.inverse_point(DVec3::from(corner))),
            surface: SurfaceSamples::default(),
            whole_bytes: 0,
            preview: Some(ViewPreview {
                bytes: preview_bytes(self.triangles, self.texels),
                detail: (self.detail / space.scale) as f32,
            }),
            parts,
        }
    }
}

impl World {
    /// The names of all assets: those of the objects, then those of the coarse assets.
    pub fn assets(&self) -> impl Iterator<Item = &str> {
        let coarse = self.coarse.iter().map(|coarse| coarse.asset.as_str());
        self.objects.iter().map(|object| object.asset.as_str()).chain(coarse)
    }

    /// Gives all assets other names.
    pub fn rename_assets(&mut self, name: impl Fn(&str) -> String) {
        let coarse = self.coarse.iter_mut();
        let of_coarse = coarse.flat_map(|coarse| coarse.parts.iter_mut().chain([&mut coarse.asset]));
        let of_objects = self.objects.iter_mut().map(|object| &mut object.asset);
        of_objects.chain(of_coarse).for_each(|asset| *asset = name(asset));
    }

    /// For each coarse asset its parts: objects by their numbers, coarse assets by theirs plus the number of objects.
    ///
    /// # Errors
    /// One has no parts, or parts that are not there, that are there twice, or for which another one stands; some stand for each other, or lie
    /// more than 32 levels deep.
    pub fn parts(&self) -> Result<Vec<Vec<usize>>> {
        let (mut numbers, mut repeated) = (HashMap::new(), HashSet::new());
        for (number, asset) in self.assets().enumerate() {
            if numbers.insert(asset, number).is_some() {
                repeated.insert(asset);
            }
        }
        let first = self.objects.len();
        let mut is_part = vec![false; first + self.coarse.len()];
        let mut parts = Vec::with_capacity(self.coarse.len());
        for coarse in &self.coarse {
            let wrong = |what: String| {
                Error::malformed(format!("the coarse asset {} stands for {what}", coarse.asset))
            };
            if coarse.parts.is_empty() {
                return Err(wrong("nothing".into()));
            }
            let mut own = Vec::with_capacity(coarse.parts.len());
            for part in &coarse.parts {
                let Some(&number) = numbers.get(part.as_str()) else {
                    return Err(wrong(format!("{part}, which is not in the world")));
                };
                if repeated.contains(part.as_str()) {
                    return Err(wrong(format!("{part}, which is in the world twice")));
                }
                if std::mem::replace(&mut is_part[number], true) {
                    return Err(wrong(format!("{part}, which has been named before")));
                }
                own.push(number);
            }
            parts.push(own);
        }
        // From those on top, level by level. What stands for itself is never reached.
        let mut level: Vec<usize> = (first..is_part.len()).filter(|&node| !is_part[node]).collect();
        let mut reached = 0;
        for _ in 0..MAX_LEVELS {
            reached += level.len();
            let below = level.iter().flat_map(|&node| &parts[node - first]);
            level = below.copied().filter(|&node| node >= first).collect();
        }
        if reached < self.coarse.len() {
            return Err(Error::malformed(format!(
                "coarse assets stand for each other, or lie more than {MAX_LEVELS} levels deep"
            )));
        }
        Ok(parts)
    }

    /// Adds an object, in the place of one with the same asset where there is one: then true. If that one was another, coarse assets that stand
    /// for it go, as they show it as it was.
    pub fn put(&mut self, object: WorldObject) -> bool {
        let Some(known) = self.objects.iter_mut().find(|known| known.asset == object.asset) else {
            self.objects.push(object);
            return false;
        };
        if *known != object {
            let asset = object.asset.clone();
            *known = object;
            self.forget_coarse(vec![asset]);
        }
        true
    }

    /// Takes out the objects that `is_it` accepts, and the coarse assets that stand for them. Returns how many objects these were.
    pub fn remove(&mut self, is_it: impl Fn(&WorldObject) -> bool) -> usize {
        let (gone, kept) = std::mem::take(&mut self.objects).into_iter().partition::<Vec<_>, _>(is_it);
        self.objects = kept;
        let count = gone.len();
        self.forget_coarse(gone.into_iter().map(|object| object.asset).collect());
        count
    }

    /// Takes out the coarse assets that stand for these assets, and those that stand for them.
    fn forget_coarse(&mut self, mut assets: Vec<String>) {
        while !assets.is_empty() {
            let stands = |coarse: &WorldCoarse| coarse.parts.iter().any(|part| assets.contains(part));
            let (gone, kept) = std::mem::take(&mut self.coarse).into_iter().partition::<Vec<_>, _>(stands);
            self.coarse = kept;
            assets = gone.into_iter().map(|coarse| coarse.asset).collect();
        }
    }

    /// Opens a coarse asset at a path or an address, all of which is read.
    ///
    /// # Errors
    /// It cannot be read, has more than [`MAX_COARSE_BYTES`], is no asset, or is damaged.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn open_coarse(place: &Path) -> Result<Asset> {
        Self::coarse_from(place, crate::read_whole(place, MAX_COARSE_BYTES)?)
    }

    /// As [`open_coarse`](Self::open_coarse), of the file's bytes.
    ///
    /// # Errors
    /// It is no asset, or is damaged.
    pub fn coarse_from(place: &Path, bytes: Vec<u8>) -> Result<Asset> {
        Asset::open_source(Arc::new(BytesSource::new(place, bytes)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(asset: &str) -> WorldObject {
        WorldObject {
            asset: asset.into(),
            bytes: 1,
            triangles: 1,
            texels: 1,
            low: [0.0; 3],
            high: [1.0; 3],
            preview: None,
        }
    }

    fn coarse(asset: &str, parts: &[&str]) -> WorldCoarse {
        WorldCoarse {
            asset: asset.into(),
            bytes: 1,
            triangles: 1,
            texels: 1,
            low: [0.0; 3],
            high: [1.0; 3],
            detail: 0.5,
            parts: parts.iter().map(|&part| part.to_owned()).collect(),
        }
    }

    /// Five objects, of which two pairs have a coarse asset, and both of these one above them.
    fn tree() -> World {
        World {
            objects: ["a", "b", "c", "d", "e"].map(object).into(),
            coarse: vec![
                coarse("top", &["left", "right"]),
                coarse("left", &["a", "b"]),
                coarse("right", &["c", "d"]),
            ],
        }
    }

    #[test]
    fn parts_are_numbered_and_an_index_keeps_them() {
        let world = tree();
        assert_eq!(world.parts().unwrap(), [vec![6, 7], vec![0, 1], vec![2, 3]]);
        let read = World::parse(Path::new("a.fanworld"), &world.to_bytes().unwrap()).unwrap();
        assert_eq!(read, world);
        let views = world.view_objects(&WorldFromMesh::default()).unwrap();
        assert_eq!(views.len(), 8);
        assert_eq!(views[5].parts, [6, 7]);
        assert!(views[0].parts.is_empty());
    }

    #[test]
    fn what_is_no_tree_is_refused_with_a_sentence() {
        let refused = |coarse: Vec<WorldCoarse>, expected: &str| {
            let world = World { coarse, ..tree() };
            let bytes = world.to_bytes().unwrap();
            let error = World::parse(Path::new("a.fanworld"), &bytes).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains("a.fanworld"), "{error}");
        };
        refused(vec![coarse("x", &[])], "stands for nothing");
        refused(vec![coarse("x", &["z"])], "z, which is not in the world");
        refused(vec![coarse("x", &["a"]), coarse("y", &["a"])], "named before");
        refused(vec![coarse("x", &["a", "a"])], "named before");
        refused(vec![coarse("a", &["b"]), coarse("x", &["a"])], "in the world twice");
        refused(vec![coarse("x", &["y"]), coarse("y", &["x"])], "stand for each other");
        refused(vec![coarse("x", &["x"])], "stand for each other");
        refused(vec![WorldCoarse { detail: 0.0, ..coarse("x", &["a"]) }], "no positive length");
        let chain = (0..40).map(|i| match i {
            0 => coarse("0", &["a"]),
            i => coarse(&i.to_string(), &[(i - 1).to_string().as_str()]),
        });
        refused(chain.collect(), "levels deep");
    }

    #[test]
    fn what_changes_is_no_longer_shown_as_it_was() {
        let mut world = tree();
        assert!(world.put(object("a")));
        assert_eq!(world, tree());
        assert!(world.put(WorldObject { triangles: 2, ..object("a") }));
        assert_eq!(world.coarse, [coarse("right", &["c", "d"])]);
        assert!(!world.put(object("f")));
        assert_eq!(world.remove(|object| object.asset == "e"), 1);
        assert_eq!(world.coarse.len(), 1);
        assert_eq!(world.remove(|object| object.asset == "d"), 1);
        assert!(world.coarse.is_empty());
        assert_eq!(world.remove(|object| object.asset == "d"), 0);
        world.parts().unwrap();
    }
}
