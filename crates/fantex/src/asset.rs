//! Baked assets, open for reading.

use std::ops::Deref;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use fantex_base::Result;
use fantex_mesh::{SurfacePoint, TriangleBvh};
use fantex_store::{PageCache, Sampler};
use fantex_texture::FilterOptions;
use glam::DVec3;

/// A `.fan` asset. It dereferences to [`fantex_store::Asset`], which reads single pages, and clones share one open file.
#[derive(Clone, Debug)]
pub struct Asset {
    asset: Arc<fantex_store::Asset>,
    /// For the nearest point; made when it is first asked for.
    rays: Arc<OnceLock<TriangleBvh>>,
}

impl Asset {
    /// Opens a file, or with the feature `http` an `http://` or `https://` address.
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
