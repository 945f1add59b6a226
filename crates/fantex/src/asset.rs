//! Baked assets, open for reading.

use std::fs::File;
use std::io::{self, Read};
use std::ops::Deref;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use fantex_base::{Error, Result, input};
use fantex_mesh::{SurfacePoint, TriangleBvh};
use fantex_store::{PageCache, Sampler};
use fantex_texture::FilterOptions;
use glam::DVec3;

use crate::World;

/// The [first bytes](first_bytes) of an asset.
pub(crate) const ASSET_START: &[u8; 4] = b"\x89FAN";

/// The first four bytes of a file; of a shorter one all.
pub(crate) fn first_bytes(file: File) -> io::Result<Vec<u8>> {
    let mut start = Vec::with_capacity(4);
    file.take(4).read_to_end(&mut start)?;
    Ok(start)
}

/// What a file is, by its name or its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// Anything else: the loader says what is wrong with it.
    Model,
    /// Named `.fan`, or starting like an asset.
    Asset,
    /// Named `.toml`.
    Look,
    /// Named `.fanworld`: an index of assets.
    World,
}

impl FileKind {
    /// Looks at a file. Those named `.fan`, `.toml` and `.fanworld` are not opened, and what lies at an address is an asset unless it is named
    /// `.fanworld`.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn of(path: &Path) -> Result<Self> {
        if World::is_named(path) {
            return Ok(Self::World);
        }
        if fantex_stream::url_of(path).is_some() {
            return Ok(Self::Asset);
        }
        let extension = path.extension().map(|extension| extension.to_ascii_lowercase());
        match extension.as_ref().and_then(|extension| extension.to_str()) {
            Some("toml") => return Ok(Self::Look),
            Some("fan") => return Ok(Self::Asset),
            _ => {}
        }
        match input::open(path).and_then(first_bytes) {
            // Who opens a part of a planned bake as an asset is told what it is.
            Ok(start) if start == ASSET_START || start == b"FANP" => Ok(Self::Asset),
            Ok(_) => Ok(Self::Model),
            // The loader has a sentence for folders.
            Err(_) if path.is_dir() => Ok(Self::Model),
            Err(error) => Err(Error::reading(path, error)),
        }
    }

    /// Refuses what is no asset, with a sentence that says what to give.
    ///
    /// # Errors
    /// It is something else, or cannot be read.
    pub fn check_is_asset(path: &Path) -> Result<()> {
        match Self::of(path)? {
            Self::Asset => Ok(()),
            Self::Look => Err(Self::look_instead(path)),
            Self::World => Err(Self::world_instead(path)),
            Self::Model => {
                let shown = path.display();
                let sentence = format!(
                    "{shown} is not an asset; give a .fan file, for example one that 'fantex bake' has written"
                );
                Err(Error::unsupported(sentence).with_path(path))
            }
        }
    }

    /// The error of a look where a model or an asset is taken.
    pub fn look_instead(path: &Path) -> Error {
        let shown = path.display();
        let sentence =
            format!("{shown} is a look; give a model (.glb .gltf .obj .ply .stl) or an asset (.fan)");
        Error::unsupported(sentence).with_path(path)
    }

    /// The error of a world where a single asset or model is taken.
    pub fn world_instead(path: &Path) -> Error {
        let shown = path.display();
        let sentence = format!("{shown} is a world, an index of assets; give one of its assets (.fan)");
        Error::unsupported(sentence).with_path(path)
    }
}

/// A `.fan` asset. It dereferences to [`fantex_store::Asset`], which reads single pages, and clones share one open file.
#[derive(Clone, Debug)]
pub struct Asset {
    asset: Arc<fantex_store::Asset>,
    /// For the nearest point; made when it is first asked for.
    rays: Arc<OnceLock<TriangleBvh>>,
}

impl Asset {
    /// Opens a file, or with the feature `http` an `http://`, `https://`, `s3://`, `gs://` or `az://` address.
    ///
    /// # Errors
    /// It cannot be read, is no asset, or is damaged.
    pub fn open(place: impl AsRef<Path>) -> Result<Self> {
        Ok(Arc::new(fantex_stream::open_asset(place.as_ref())?).into())
    }

    /// The asset, to share with caches, streamers and editors.
    pub fn shared(&self) -> &Arc<fantex_store::Asset> {
        &self.asset
    }

    /// Look-ups in the texture function with anisotropic filtering. Decoded tiles take at most so many bytes.
    pub fn sampler(&self, budget_bytes: usize) -> Sampler {
        self.sampler_with(budget_bytes, FilterOptions::default())
    }

    /// As [`sampler`](Self::sampler), with another filter.
    pub fn sampler_with(&self, budget_bytes: usize, filter: FilterOptions) -> Sampler {
        Sampler::of_cache(&PageCache::new(Arc::clone(&self.asset), budget_bytes), filter)
    }

    /// The point of the surface nearest to a point of the world. None where that is not finite.
    pub fn nearest_point(&self, p_world: impl Into<DVec3>) -> Option<SurfacePoint> {
        let mesh = self.asset.mesh();
        let p = mesh.world_from_mesh.inverse_point(p_world.into());
        let rays = self.rays.get_or_init(|| TriangleBvh::new(mesh));
        let nearest = rays.nearest_point(p, f32::INFINITY).filter(|_| p.is_finite())?;
        Some(nearest.point)
    }
}

impl From<Arc<fantex_store::Asset>> for Asset {
    fn from(asset: Arc<fantex_store::Asset>) -> Self {
        Self { asset, rays: Arc::default() }
    }
}

impl Deref for Asset {
    type Target = fantex_store::Asset;

    fn deref(&self) -> &fantex_store::Asset {
        &self.asset
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn worlds_are_told_by_their_names() {
        let kind = |place: &str| FileKind::of(Path::new(place)).unwrap();
        for place in ["a.fanworld", "b/A.FANWORLD", "https://a.b/c.fanworld", "s3://b/c.fanworld?versionId=2"]
        {
            assert_eq!(kind(place), FileKind::World, "{place}");
        }
        for place in ["https://a.b/c.fan", "https://a.b/c?d=.fanworld", "gs://fanworld/c"] {
            assert_eq!(kind(place), FileKind::Asset, "{place}");
        }
    }
}
