//! A model's own materials as a source: how many texels they get, and what is said of it.

use std::borrow::Cow;

use fantex_bake::{LookSource, Source};
use fantex_base::{Result, counted, grouped};
use fantex_cover::TexelBudget;
use fantex_store::ChannelKind;
use fantex_texture::material::{MaterialTextures, load_material_textures};

use super::{Baked, Baker, Budget, Goal, budget_texels};

/// More texels than this, which nobody asked for, are worth a note.
pub(super) const MANY_TEXELS: u64 = 64_000_000;

/// A model that shows parts of its images again and again gets no more than so many texels by itself, or twice those of its images.
const REPEATED_TEXELS: u64 = 16_000_000;

/// Small textures get up to [`CRISP_TEXELS`] for each of theirs, as long as these are not more than so many: with one
/// each, turned against theirs, what is a few texels wide would be blurred.
const FEW_TEXELS: f64 = (1 << 18) as f64;

/// Texels for each of an image's whose texels are to appear as squares: edges a quarter as wide as a square look crisp.
const CRISP_TEXELS: f64 = 16.0;

/// What a model's own materials are like.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct OwnLook {
    /// The channels that they give.
    pub channels: Vec<ChannelKind>,
    /// How many texels a bake gets by itself, nearly, where the model has textures.
    pub texels: Option<u64>,
    /// Whether these are fewer than at the density of the textures, as the model shows parts of them again and again.
    pub is_limited: bool,
}

impl Baker<'_> {
    /// What the model's own materials are like, before anything is covered or baked.
    ///
    /// # Errors
    /// An image takes more memory than there is, or a disk fails.
    pub fn own_look(&self) -> Result<OwnLook> {
        let source = LookSource::of_model(self.mesh)?;
        let own = OwnTexels::of(self.mesh, &source);
        Ok(OwnLook {
            channels: source.channels().iter().map(|channel| channel.kind).collect(),
            texels: own.as_ref().map(|own| own.given() as u64),
            is_limited: own.is_some_and(|own| own.given() < own.texels),
        })
    }

    /// Bakes the model's materials.
    pub(super) fn own_materials(&self, goal: &Goal<'_>) -> Result<Baked> {
        let model: &fantex_mesh::Mesh = self.mesh;
        let (textures, left_out) = load_material_textures(model)?;
        let source = LookSource::of_decoded(model, textures.clone());
        let own = OwnTexels::of(model, &source);
        let is_default = self.budget == Budget::Default;
        let share = own.as_ref().filter(|_| is_default).map_or(1.0, OwnTexels::given_share);
        // Before the mesh is cut and covered, which takes its time.
        self.leave_out(&left_out, goal)?;
        let mut notes = if goal.is_part() { Vec::new() } else { left_out.notes() };
        notes.iter().for_each(|note| self.progress.progress.note(note));
        if let (Some(own), false) = (&own, goal.is_part()) {
            notes.extend(self.note_of_squares(&source, own, share));
            if is_default {
                notes.extend(self.note_of_repeats(own));
                notes.extend(self.note_of_many(own.given() as u64));
            }
        }
        let most = own.as_ref().filter(|_| is_default).map(|own| own.most as u64);
        let mut baked = self.textured(model, source, (share, most), textures, goal)?;
        baked.notes.splice(0..0, notes);
        Ok(Baked { left_out, ..baked })
    }

    /// Says that a model gets fewer texels than its images have wherever they are shown, if it does.
    fn note_of_repeats(&self, own: &OwnTexels) -> Option<String> {
        let millions = |texels: f64| (texels / 1e6) as u64;
        let note = format!(
            "the model shows parts of its textures again and again: at their own density these were about {} million texels; it is given \
             about {} million, unless a number of texels or the density of its textures is asked for",
            millions(own.texels),
            millions(own.given())
        );
        let note = Some(note).filter(|_| own.given() < own.texels);
        note.iter().for_each(|note| self.progress.progress.note(note));
        note
    }

    /// Says that texels which are to appear as squares are blended, unless there are enough to hide it. `share`: of their density that
    /// they get where nothing else is asked for.
    fn note_of_squares(&self, source: &LookSource<'_>, own: &OwnTexels, share: f32) -> Option<String> {
        let density = OwnDensity { of_triangles: scaled(&own.density, share), most: None };
        let asked = budget_texels(self.mesh, &self.nominal_budget(self.mesh, Some(&density)));
        let own = own.texels;
        // Whoever gives a rounded number has heard the note.
        let materials = if asked < 0.5 * CRISP_TEXELS * own { source.square_texel_materials() } else { 0 };
        let note = format!(
            "the textures of {} are to appear as squares (nearest filtering), but what is baked is blended between texels: edges of squares \
             are as soft as a texel is wide; about {} texels, {} per texel of the textures, make them crisp",
            counted(materials, "material"),
            grouped(rounded(CRISP_TEXELS * own), ' '),
            CRISP_TEXELS
        );
        let note = Some(note).filter(|_| materials > 0);
        note.iter().for_each(|note| self.progress.progress.note(note));
        note
    }

    /// Says that a number of texels, which nobody asked for, is large, if it is.
    pub(super) fn note_of_many(&self, texels: u64) -> Option<String> {
        let millions = texels / 1_000_000;
        let note = format!(
            "at the density of the model's own textures these are about {millions} million texels; a number of texels may be given instead"
        );
        let note = Some(note).filter(|_| texels > MANY_TEXELS);
        note.iter().for_each(|note| self.progress.progress.note(note));
        note
    }

    /// Cuts a model and bakes its materials. `share`: of the density of the textures, which are those of the source; `most`: texels that it gets
    /// at most.
    fn textured(
        &self,
        model: &fantex_mesh::Mesh,
        source: LookSource<'_>,
        (share, most): (f32, Option<u64>),
        textures: Vec<MaterialTextures>,
        goal: &Goal<'_>,
    ) -> Result<Baked> {
        let cuts = self.cuts(goal);
        let tangents = source.normal_map_tangents();
        let density = |source: &LookSource<'_>| {
            source.has_textures().then(|| OwnDensity { of_triangles: scaled(&source.density(), share), most })
        };
        if cuts.leaves_whole(model, self.tile) {
            return self.bake(model, &source, density(&source), goal);
        }
        // Normal maps were made for the axes of the whole triangles.
        let mut framed = Cow::Borrowed(model);
        if model.corners.tangents.is_empty() && !tangents.is_empty() {
            framed.to_mut().corners.tangents = tangents.to_vec();
        }
        let Cow::Owned(framed) = self.refined(&framed, cuts, density(&source).as_ref())? else {
            return self.bake(model, &source, density(&source), goal);
        };
        let mut cut = framed.clone();
        if model.corners.tangents.is_empty() {
            cut.corners.tangents.clear();
        }
        let source = LookSource::of_decoded(&framed, textures);
        self.bake(&cut, &source, density(&source), goal)
    }
}

/// How dense a source's own texels are.
pub(super) struct OwnDensity {
    /// Of each triangle, texels per mesh unit.
    pub(super) of_triangles: Vec<f32>,
    /// Texels that are stored at most, margins included.
    pub(super) most: Option<u64>,
}

/// Texels of a model's own textures on it.
struct OwnTexels {
    /// Of each triangle, texels per mesh unit.
    density: Vec<f32>,
    /// In all.
    texels: f64,
    /// What it gets at most by itself.
    most: f64,
}

impl OwnTexels {
    /// None of a model without textures.
    fn of(mesh: &fantex_mesh::Mesh, source: &LookSource<'_>) -> Option<Self> {
        let density = source.has_textures().then(|| source.density())?;
        let texels = budget_texels(mesh, &TexelBudget::PerTriangle(density.clone()));
        let most = REPEATED_TEXELS.max(2 * source.image_texels()) as f64;
        Some(Self { density, texels, most })
    }

    /// How many texels it gets by itself.
    fn given(&self) -> f64 {
        let least = (CRISP_TEXELS * self.texels).min(FEW_TEXELS);
        self.texels.max(least).min(self.most)
    }

    /// Of the density, which may be more than one.
    fn given_share(&self) -> f32 {
        let share = (self.given() / self.texels).sqrt() as f32;
        if share.is_finite() { share } else { 1.0 }
    }
}

/// All densities times a factor.
fn scaled(density: &[f32], factor: f32) -> Vec<f32> {
    density.iter().map(|density| density * factor).collect()
}

/// A count to two digits, not less than it.
fn rounded(count: f64) -> u64 {
    let unit = 10_f64.powi(count.max(10.0).log10() as i32 - 1);
    (unit * (count / unit).ceil()) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_textures_get_more_texels_than_they_have() {
        let own = |texels: f64| OwnTexels { density: Vec::new(), texels, most: 1e6 };
        for (texels, given) in
            [(1e3, 16e3), (16_384.0, 262_144.0), (1e5, 262_144.0), (4e5, 4e5), (1e6, 1e6), (4e6, 1e6)]
        {
            let own = own(texels);
            assert_eq!(own.given(), given);
            assert!((f64::from(own.given_share()).powi(2) * texels / given - 1.0).abs() < 1e-6);
        }
        // Textures of which a point is shown have no density.
        assert_eq!((own(0.0).given(), own(0.0).given_share()), (0.0, 1.0));
    }
}
