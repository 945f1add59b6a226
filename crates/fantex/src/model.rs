//! Models, ready to be covered and baked.

use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use fantex_bake::{NoProgress, Progress};
use fantex_base::{Error, Result};
use fantex_mesh::{
    CleanOptions, CleanReport, CornerOrigins, LoadOptions, Model, clean_watched, load_watched, simplified,
};

use crate::baker::materials::{says_something, without_tiles};
use crate::{Asset, FileKind};

/// A triangle mesh, loaded and cleaned: welded, without duplicates, in mesh space, with its materials.
///
/// It dereferences to [`fantex_mesh::Mesh`], which holds the geometry.
#[derive(Clone, Debug)]
pub struct Mesh {
    mesh: fantex_mesh::Mesh,
    path: PathBuf,
    report: CleanReport,
    origins: CornerOrigins,
    notes: Vec<String>,
    load_time: Duration,
    clean_time: Duration,
    /// Of the asset that it is the mesh of: see [`Baker::hard_edges`](crate::Baker::hard_edges).
    hard_edges: Option<f32>,
}

/// Reading smaller files takes no time worth telling.
const LONG_BYTES: u64 = 4 << 20;

impl Mesh {
    /// Reads a model (`.glb .gltf .obj .ply .stl`) and cleans it.
    ///
    /// # Errors
    /// The file cannot be read, is malformed or too large, or nothing is left of it after cleaning.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        Self::load_with(path, &CleanOptions::default())
    }

    /// As [`load`](Self::load), cleaned as the options say.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn load_with(path: impl AsRef<Path>, options: &CleanOptions) -> Result<Self> {
        Self::load_watched(path, options, &NoProgress)
    }

    /// As [`load_with`](Self::load_with). `progress` hears of files that take a while, first bytes of their length, then of "cleaning".
    ///
    /// # Errors
    /// As [`load`](Self::load). It cannot be ended.
    pub fn load_watched(
        path: impl AsRef<Path>,
        options: &CleanOptions,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let path = path.as_ref();
        let is_long = path.metadata().is_ok_and(|found| found.len() >= LONG_BYTES);
        let progress = if is_long { progress } else { &NoProgress };
        let started = Instant::now();
        let model = load_watched(path, &LoadOptions::default(), &|done, total| progress.report(done, total))?;
        let load_time = started.elapsed();
        let mesh = Self::cleaned(model, path, options, progress)?;
        Ok(Self { load_time, ..mesh })
    }

    /// Cleans a model that was made otherwise. `path` names it in messages; the files of its materials are named by the model.
    ///
    /// # Errors
    /// Nothing is left after cleaning, or an index is out of range.
    pub fn from_model(model: Model, path: impl AsRef<Path>) -> Result<Self> {
        Self::from_model_with(model, path, &CleanOptions::default())
    }

    /// As [`from_model`](Self::from_model), cleaned as the options say.
    ///
    /// # Errors
    /// As [`from_model`](Self::from_model).
    pub fn from_model_with(model: Model, path: impl AsRef<Path>, options: &CleanOptions) -> Result<Self> {
        Self::cleaned(model, path.as_ref(), options, &NoProgress)
    }

    fn cleaned(
        mut model: Model,
        path: &Path,
        options: &CleanOptions,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let started = Instant::now();
        // Errors name the file as it was given.
        model.name = path.display().to_string();
        let mut notes = model.notes.clone();
        let (mesh, report, origins) =
            clean_watched(model, options, &|share| progress.prepare("cleaning", share))?;
        notes.extend(report.lines());
        Ok(Self {
            mesh,
            path: path.into(),
            report,
            origins,
            notes,
            load_time: Duration::ZERO,
            clean_time: started.elapsed(),
            hard_edges: None,
        })
    }

    /// Cleans plain triangles: positions in world units, counter-clockwise vertex indices.
    ///
    /// # Errors
    /// Nothing is left after cleaning, or an index is out of range.
    pub fn from_triangles(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Self> {
        let positions = positions.iter().map(|&p| p.into()).collect();
        Self::from_model(Model { positions, triangles: triangles.to_vec(), ..Model::default() }, "mesh")
    }

    /// A model as [`load`](Self::load) reads it, or the mesh of an asset at a path or an address, as [`of_asset`](Self::of_asset) takes it.
    ///
    /// # Errors
    /// As [`load`](Self::load) and [`Asset::open`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_with(path, &CleanOptions::default())
    }

    /// As [`open`](Self::open), a model cleaned as the options say.
    ///
    /// # Errors
    /// As [`open`](Self::open); an asset, whose mesh was cleaned before it was baked, is not cleaned again.
    pub fn open_with(path: impl AsRef<Path>, options: &CleanOptions) -> Result<Self> {
        Self::open_watched(path, options, &NoProgress)
    }

    /// As [`open_with`](Self::open_with); of models `progress` hears as of [`load_watched`](Self::load_watched).
    ///
    /// # Errors
    /// As [`open_with`](Self::open_with).
    pub fn open_watched(
        path: impl AsRef<Path>,
        options: &CleanOptions,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let path = path.as_ref();
        match FileKind::of(path)? {
            FileKind::Asset if *options != CleanOptions::default() => Err(Error::invalid(format!(
                "--weld is for models, and {} is an asset, whose mesh is as it was baked; leave it out",
                path.display()
            ))),
            FileKind::Asset => Ok(Self::of_asset(&Asset::open(path)?)),
            FileKind::World => Err(FileKind::world_instead(path)),
            FileKind::Model | FileKind::Look => Self::load_watched(path, options, progress),
        }
    }

    /// The mesh of an asset: its triangles and the names of its materials and parts, without what is baked. To bake something else
    /// onto it, or to make it coarser.
    pub fn of_asset(asset: &Asset) -> Self {
        let mut mesh = asset.mesh().clone();
        mesh.materials = without_tiles(asset.shared());
        mesh.corners.colors.clear();
        Self {
            mesh,
            path: asset.path().into(),
            report: CleanReport::default(),
            origins: CornerOrigins::default(),
            notes: Vec::new(),
            load_time: Duration::ZERO,
            clean_time: Duration::ZERO,
            hard_edges: asset.cover().hard_edges,
        }
    }

    /// The same shape with about so many triangles, without texture coordinates, colours and normals: to bake this one
    /// [onto it](crate::Source::loaded_mesh).
    ///
    /// # Errors
    /// Nothing is left at so few triangles.
    pub fn simplified(&self, triangles: usize) -> Result<Self> {
        Self::from_model(simplified(&self.mesh, triangles)?, &self.path)
    }

    /// The angle of the hard edges of the asset that it is [the mesh of](Self::of_asset).
    pub(crate) fn hard_edges(&self) -> Option<f32> {
        self.hard_edges
    }

    /// What cleaning did, and the topology of the result.
    pub fn report(&self) -> &CleanReport {
        &self.report
    }

    /// Which corner of the model each corner was.
    pub fn origins(&self) -> &CornerOrigins {
        &self.origins
    }

    /// What the loader noticed and what cleaning did, a sentence each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How long loading took.
    pub fn load_time(&self) -> Duration {
        self.load_time
    }

    /// How long cleaning took.
    pub fn clean_time(&self) -> Duration {
        self.clean_time
    }

    /// The same with materials that all take alpha so: see [`set_alpha_mode`](fantex_mesh::Mesh::set_alpha_mode).
    #[must_use]
    pub fn with_alpha_mode(&self, alpha: fantex_mesh::AlphaMode) -> Self {
        let mut mesh = self.clone();
        mesh.mesh.set_alpha_mode(alpha);
        mesh
    }

    /// The geometry alone.
    pub fn into_inner(self) -> fantex_mesh::Mesh {
        self.mesh
    }

    /// Whether the materials say more than "white": by textures, colours or light of their own, or, in a file, by how metallic or rough they are, what
    /// alpha means, or that they are unlit.
    pub fn has_materials(&self) -> bool {
        self.has_textures() || self.mesh.materials.iter().any(says_something)
    }

    /// Whether the model has colours at its vertices.
    pub fn has_vertex_colors(&self) -> bool {
        !self.mesh.corners.colors.is_empty()
    }

    /// Whether a material uses an image and the mesh has the coordinates for it.
    fn has_textures(&self) -> bool {
        self.mesh.materials.iter().any(|m| {
            let textures = [
                &m.base_color_texture,
                &m.metallic_roughness_texture,
                &m.normal_texture,
                &m.occlusion_texture,
                &m.emission_texture,
            ];
            let has_uv = |set: usize| self.mesh.corners.uv_sets.get(set).is_some_and(|s| !s.is_empty());
            textures.into_iter().flatten().any(|texture| has_uv(texture.uv_set))
        })
    }
}

impl Deref for Mesh {
    type Target = fantex_mesh::Mesh;

    fn deref(&self) -> &fantex_mesh::Mesh {
        &self.mesh
    }
}
