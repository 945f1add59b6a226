//! Previews: small assets inside assets, which viewers far away show until the rest is there.
//!
//! A preview is a whole asset, of a coarse mesh that has been given the look and the normals of the fine one, so whatever shows assets
//! shows it. It is the attachment [`PREVIEW`](fantex_store::PREVIEW).

use std::path::Path;
use std::sync::Arc;

use fantex_bake::{
    AssetSource, BakeOptions, NoProgress, Progress, Source, TransferOptions, TransferSource, bake,
};
use fantex_base::files::scratch_folder;
use fantex_base::{Error, ErrorKind, Result};
use fantex_cover::{CoverOptions, TexelBudget, build_cover_while};
use fantex_mesh::{
    CleanOptions, Edges, Mesh, Model, VertexCorners, clean, corner_angle, shading_normals, simplified_keeping,
};
use fantex_store::{Asset, AssetEditor, Damage, EditOptions, PREVIEW, PageCache, io_cause, is_disk_full};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// How large a preview is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PreviewOptions {
    /// Triangles, about.
    pub triangles: usize,
    /// Stored texels at level 0, per channel. Where nothing is said, 100 000, or a quarter of the asset's where that is less.
    pub texels: Option<u64>,
    /// Vertices at edges of a single triangle stay, with their normals, so that previews of assets that meet there fit together, and to the
    /// assets. There may be more triangles for it.
    pub keeps_borders: bool,
    /// Bytes that decoded tiles and texels in work may take while it is made.
    pub memory_bytes: u64,
    /// Fail, and change nothing, where coarser texels stand in for damaged ones.
    pub strict: bool,
}

impl Default for PreviewOptions {
    /// 5000 triangles and up to 100 000 texels: some 200 to 700 kB. Borders are simplified, too. 512 MiB. Damage is allowed.
    fn default() -> Self {
        Self { triangles: 5000, texels: None, keeps_borders: false, memory_bytes: 512 << 20, strict: false }
    }
}

/// Texels of a preview or a coarse asset, where no number is asked for.
pub(crate) const DEFAULT_TEXELS: u64 = 100_000;

impl PreviewOptions {
    /// Texels that a preview of an asset gets.
    fn texels_for(&self, asset: &Asset) -> u64 {
        self.texels.unwrap_or_else(|| DEFAULT_TEXELS.min(quarter_of_texels(asset)))
    }

    /// The mesh of a preview of an asset.
    fn coarse_mesh(&self, asset: &Asset) -> Result<Mesh> {
        let kept = if self.keeps_borders { border_vertices(asset.mesh()) } else { Vec::new() };
        coarse_mesh(asset.mesh(), self.triangles, &kept)
    }

    /// As [`coarse_mesh`](Self::coarse_mesh), if a preview with it is worth its bytes: [simplified](is_worth_it), or of an asset that has
    /// many times the texels of a preview.
    #[cfg(feature = "http")]
    fn coarse_mesh_worth_it(&self, asset: &Asset) -> Result<Option<Mesh>> {
        let coarse = self.coarse_mesh(asset)?;
        let has_many_texels = quarter_of_texels(asset) >= DEFAULT_TEXELS;
        let is_worth_it = is_worth_it(&coarse, asset.mesh(), None)
            && (has_many_texels || is_simplified(&coarse, asset.mesh()));
        Ok(is_worth_it.then_some(coarse))
    }
}

fn quarter_of_texels(asset: &Asset) -> u64 {
    (asset.cover().stored_texels(asset.mesh()) / 4).max(1)
}

/// Triangles of a preview that is worth its bytes in any case.
const SMALL_TRIANGLES: usize = 5000;

/// Whether a coarse mesh is worth it: it is small, or about as small as somebody has asked for, or has less than two thirds of the triangles of the
/// fine one. Some surfaces can hardly be simplified.
pub(crate) fn is_worth_it(coarse: &Mesh, fine: &Mesh, asked: Option<usize>) -> bool {
    let most = asked.map_or(SMALL_TRIANGLES, |asked| SMALL_TRIANGLES.max(asked.saturating_mul(2)));
    coarse.triangles.len() <= most || is_simplified(coarse, fine)
}

/// Whether a coarse mesh has less than two thirds of the triangles of the fine one.
fn is_simplified(coarse: &Mesh, fine: &Mesh) -> bool {
    3 * coarse.triangles.len() < 2 * fine.triangles.len()
}

/// A preview.
#[derive(Clone, Debug)]
pub struct Preview {
    /// The `.fan` file that it is.
    pub bytes: Vec<u8>,
    /// Triangles.
    pub triangles: u64,
    /// Stored texels at level 0, per channel.
    pub texels: u64,
    /// Texels of the asset that could not be read, so that coarser ones stood in.
    pub damage: Damage,
}

impl Preview {
    /// Makes the preview of an asset.
    ///
    /// # Errors
    /// Nothing is left of its mesh at so few triangles; too few texels; texels are damaged (if strict); there is no room for a temporary file of
    /// the preview's size.
    pub fn of(asset: &Arc<Asset>, options: &PreviewOptions) -> Result<Self> {
        Self::of_coarse(asset, &options.coarse_mesh(asset)?, options, &NoProgress)
    }

    /// As [`of`](Self::of), with its [mesh](coarse_mesh). Of `progress` only cancellation counts.
    pub(crate) fn of_coarse(
        asset: &Arc<Asset>,
        coarse: &Mesh,
        options: &PreviewOptions,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let cache_bytes = usize::try_from(options.memory_bytes / 2).unwrap_or(usize::MAX);
        let detail = AssetSource::new(&PageCache::new(Arc::clone(asset), cache_bytes));
        let folder = scratch_folder()?;
        let path = folder.path().join("preview.fan");
        let shape = CoarseShape {
            mesh: coarse,
            texels: options.texels_for(asset),
            hard_edges: asset.cover().hard_edges,
        };
        let texels = write_coarse(&shape, (asset.mesh(), &detail), options, &path, progress)?;
        let bytes = std::fs::read(&path).map_err(|error| Error::reading(&path, error))?;
        Ok(Self { bytes, triangles: coarse.triangles.len() as u64, texels, damage: detail.damage() })
    }

    /// Makes the preview of an asset and puts it there, in the place of one that it has. Nobody else can change the asset meanwhile.
    ///
    /// # Errors
    /// As [`of`](Self::of); the asset cannot be changed: somebody else does, or the disk is full.
    pub fn add_to(path: &Path, options: &PreviewOptions) -> Result<Self> {
        Self::add_to_watched(path, options, &NoProgress)
    }

    /// As [`add_to`](Self::add_to). Of `progress` only cancellation counts.
    fn add_to_watched(path: &Path, options: &PreviewOptions, progress: &dyn Progress) -> Result<Self> {
        let mut editor = AssetEditor::open(path, &EditOptions::default())?;
        let coarse = options.coarse_mesh(editor.asset())?;
        Self::put_into(&mut editor, &coarse, options, progress)
    }

    /// Makes the preview of an asset that is open, with its mesh, and puts it there.
    fn put_into(
        editor: &mut AssetEditor,
        coarse: &Mesh,
        options: &PreviewOptions,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let preview = Self::of_coarse(editor.asset(), coarse, options, progress)?;
        if progress.is_cancelled() {
            return Err(Error::cancelled("the preview was cancelled"));
        }
        preview.attach(editor)?;
        Ok(preview)
    }

    /// As [`add_to`](Self::add_to), of an asset at a path or in a store. `fetching` and `sending` count the bytes of what lies in a store, and either
    /// may end the work.
    ///
    /// # Errors
    /// As [`add_to`](Self::add_to) and [`change`](crate::addresses::change); somebody wants to stop.
    #[cfg(feature = "http")]
    pub fn add_at(
        place: &Path,
        options: &PreviewOptions,
        [fetching, sending]: [&dyn Progress; 2],
    ) -> Result<Self> {
        crate::addresses::change(place, [fetching, sending], |file| {
            Self::add_to_watched(file, options, fetching)
        })
    }

    /// As [`add_at`](Self::add_at), unless it would hardly be smaller than the asset, because the mesh can hardly be simplified and
    /// there are too many triangles or few texels. Then there is none, and the asset stays as it is.
    ///
    /// # Errors
    /// As [`add_at`](Self::add_at).
    #[cfg(feature = "http")]
    pub fn add_at_if_smaller(
        place: &Path,
        options: &PreviewOptions,
        [fetching, sending]: [&dyn Progress; 2],
    ) -> Result<Option<Self>> {
        // An object that stays as it is need not be put back.
        if crate::addresses::is_object(place)
            && options.coarse_mesh_worth_it(&fantex_stream::open_asset(place)?)?.is_none()
        {
            return Ok(None);
        }
        crate::addresses::change(place, [fetching, sending], |file| {
            let mut editor = AssetEditor::open(file, &EditOptions::default())?;
            let Some(coarse) = options.coarse_mesh_worth_it(editor.asset())? else { return Ok(None) };
            Self::put_into(&mut editor, &coarse, options, fetching).map(Some)
        })
    }

    /// Puts it into an asset and commits.
    pub(crate) fn attach(&self, editor: &mut AssetEditor) -> Result<()> {
        editor.attach(PREVIEW, self.bytes.clone())?;
        commit(editor)
    }

    /// Takes the preview out of an asset; false where there is none.
    ///
    /// # Errors
    /// The asset cannot be changed: somebody else does, or the disk is full.
    pub fn remove_from(path: &Path) -> Result<bool> {
        let mut editor = AssetEditor::open(path, &EditOptions::default())?;
        let is_there = editor.has_attachment(PREVIEW);
        editor.detach(PREVIEW);
        commit(&mut editor)?;
        Ok(is_there)
    }

    /// As [`remove_from`](Self::remove_from), of an asset at a path or in a store, as [`add_at`](Self::add_at) takes it.
    ///
    /// # Errors
    /// As [`remove_from`](Self::remove_from) and [`change`](crate::addresses::change).
    #[cfg(feature = "http")]
    pub fn remove_at(place: &Path, transfers: [&dyn Progress; 2]) -> Result<bool> {
        // An object without a preview need not be put back.
        let is_there = !crate::addresses::is_object(place)
            || fantex_stream::open_asset(place)?.attachment_bytes(PREVIEW)?.is_some();
        Ok(is_there && crate::addresses::change(place, transfers, Self::remove_from)?)
    }
}

/// Commits what an editor holds that nobody keeps to try again.
fn commit(editor: &mut AssetEditor) -> Result<()> {
    let path = editor.asset().path().to_owned();
    editor.commit().map(drop).map_err(|error| match io_cause(&error).filter(|_| is_disk_full(&error)) {
        Some(cause) => {
            let shown = path.display();
            let sentence = format!("no space is left for {shown}: {cause}; make room, then try again");
            Error::new(ErrorKind::Io, sentence).with_path(path)
        }
        None => error,
    })
}

/// The mesh of a coarse asset, and how it is covered.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CoarseShape<'a> {
    pub(crate) mesh: &'a Mesh,
    /// Per channel, about.
    pub(crate) texels: u64,
    /// As of what it looks like: see [`CoverOptions::hard_edges`].
    pub(crate) hard_edges: Option<f32>,
}

/// Writes the asset of a coarse mesh that looks like a fine one, of which a source is given. Returns how many texels it has. Bakes take half of the
/// memory that the options allow; of `progress` only cancellation counts.
pub(crate) fn write_coarse(
    &CoarseShape { mesh: coarse, texels, hard_edges }: &CoarseShape<'_>,
    (fine, detail): (&Mesh, &dyn Source),
    options: &PreviewOptions,
    path: &Path,
    progress: &dyn Progress,
) -> Result<u64> {
    let source = TransferSource::new(coarse, fine, Some(detail), &TransferOptions::default())?;
    let budget = TexelBudget::Total(texels);
    let cover_options = CoverOptions { budget, hard_edges, ..CoverOptions::default() };
    let (cover, _) = build_cover_while(coarse, &cover_options, &|_| !progress.is_cancelled())?;
    let bake_options = BakeOptions {
        memory_bytes: options.memory_bytes / 2,
        strict: options.strict,
        ..BakeOptions::default()
    };
    let baked = bake(coarse, &cover, &source, path, &bake_options, &CancelOnly(progress))?;
    Ok(baked.texels)
}

/// Passes on that somebody wants to stop, and nothing else.
pub(crate) struct CancelOnly<'a>(pub(crate) &'a dyn Progress);

impl Progress for CancelOnly<'_> {
    fn report(&self, _done: u64, _total: u64) {}

    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

/// The vertices at edges of a single triangle, ascending.
pub(crate) fn border_vertices(mesh: &Mesh) -> Vec<u32> {
    let edges = Edges::of(&mesh.triangles);
    let borders = edges.iter().filter(|edge| edge.triangle_count() == 1);
    let mut vertices: Vec<u32> = borders.flat_map(|edge| edge.vertices()).collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

/// About so many triangles. Where vertices are kept, it lies in the mesh space of the fine mesh, so that they stay where they are to the
/// last bit, and has the normals that the fine mesh has at its vertices.
pub(crate) fn coarse_mesh(fine: &Mesh, triangles: usize, kept: &[u32]) -> Result<Mesh> {
    let mut model = simplified_keeping(fine, triangles, kept)?;
    let mut options = CleanOptions::default();
    if !kept.is_empty() {
        options.world_from_mesh = Some(fine.world_from_mesh);
        model.corners.normals = normals_of_fine(fine, &model);
    }
    Ok(clean(model, &options)?.0)
}

/// For each corner of a model with vertices of the fine mesh the mean, by their angles, of the fine shading normals there that face as its
/// triangle does (a leaf has two sides), or of all where none do.
fn normals_of_fine(fine: &Mesh, coarse: &Model) -> Vec<Vec3> {
    let normals = shading_normals(fine);
    let corners = VertexCorners::of(&fine.triangles, fine.positions.len());
    let of_triangle = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|v| fine.positions[v as usize].as_dvec3());
        let facet = (b - a).cross(c - a).normalize_or_zero();
        triangle.map(|vertex| {
            let at_vertex = corners.at(vertex as usize).iter();
            let weighted = |&corner: &u32| normals[corner as usize].as_dvec3() * corner_angle(fine, corner);
            let alike = at_vertex.clone().map(weighted).filter(|normal| normal.dot(facet) > 0.0);
            let mean = alike.sum::<DVec3>().try_normalize();
            let mean = mean.or_else(|| at_vertex.map(weighted).sum::<DVec3>().try_normalize());
            mean.unwrap_or(facet).as_vec3()
        })
    };
    coarse.triangles.par_iter().flat_map_iter(of_triangle).collect()
}
