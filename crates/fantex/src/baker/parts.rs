//! Bakes in parts, and what decides their texels: all who bake a part have to have the same.

use std::cell::RefCell;
use std::path::Path;

use fantex_base::{ReadLimits, Result};
use fantex_store::{Plan, Recipe};

#[cfg(feature = "photos")]
use super::PhotoSet;
use super::{Baked, Baker, Goal, Kind};

/// More bytes than these take so long to read that it is told.
const MANY_BYTES: u64 = 4 << 30;

impl Baker<'_> {
    /// Writes all but the texels of what [`write`](Self::write) would write, with a note for whoever bakes its parts: [`write_part`](Self::write_part)
    /// in any number of processes, then [`merge_parts`](fantex_store::merge_parts). The plan has a [recipe](Recipe) of all that decides the texels:
    /// settings, the model, and the contents of the files that its source reads, but nothing of closures and custom sources.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_plan(self, path: impl AsRef<Path>, about: &[u8]) -> Result<Baked> {
        self.reach(&Goal::Plan(path.as_ref(), about, &RefCell::default()))
    }

    /// Bakes shard `number` of `count` of a plan, which this baker wrote, or one with the same mesh, source and settings.
    ///
    /// # Errors
    /// As [`write`](Self::write); the plan is of something else, or a file is not what it was; there is no such shard.
    pub fn write_part(self, plan: &Plan, number: u32, count: u32, path: impl AsRef<Path>) -> Result<Baked> {
        self.reach(&Goal::Part(plan, [number, count], path.as_ref(), &RefCell::default()))
    }

    /// Adds what was asked for, and the model.
    pub(super) fn add_settings(&self, kind: &Kind<'_>, recipe: &mut Recipe) {
        let source = match kind {
            Kind::OwnMaterials => "own materials".to_owned(),
            Kind::VertexColors => "vertex colours".to_owned(),
            Kind::Image(_, mapping) => format!("image, {}", mapping.name()),
            Kind::Solid(name) => format!("solid {name}"),
            Kind::Look(_) => "look".to_owned(),
            Kind::Mesh { cage, .. } | Kind::Loaded(_, cage) | Kind::Asset(_, cage) => {
                format!("mesh {cage:?}")
            }
            #[cfg(feature = "photos")]
            Kind::Photos(photos) => {
                let PhotoSet { frame, keep_exposure, unseen, .. } = photos;
                format!("photographs {frame:?} {keep_exposure} {unseen:?}")
            }
            Kind::Function(_) | Kind::Custom(_) => "function".to_owned(),
        };
        recipe.add_setting("the source", source);
        recipe.add_setting("the number of texels", (self.budget, self.default_texels));
        recipe.add_setting("the channels", &self.channels);
        recipe.add_setting("the seed", self.seed);
        recipe.add_setting("the fit", self.options.fit);
        recipe.add_setting("the quality", self.options.quality);
        recipe.add_mesh("the model", self.mesh);
    }

    /// Adds the contents of all files that were opened for the source.
    pub(super) fn add_files(&self, recipe: &mut Recipe) -> Result<()> {
        let files = ReadLimits::current().noted_files();
        let bytes: u64 = files.iter().filter_map(|path| Some(path.metadata().ok()?.len())).sum();
        if bytes > MANY_BYTES {
            let gigabytes = bytes as f64 / 1e9;
            self.progress.progress.note(&format!(
                "what is baked from is read once more, {gigabytes:.1} GB, so that no part is baked from anything else"
            ));
        }
        files.iter().try_for_each(|path| recipe.add_file(path, &mut |_| self.check_cancelled()))
    }
}

impl<'g> Goal<'g> {
    /// Of a plan or a part.
    pub(super) fn recipe(&self) -> Option<&'g RefCell<Recipe>> {
        match self {
            Self::Plan(.., recipe) | Self::Part(.., recipe) => Some(recipe),
            _ => None,
        }
    }
}
