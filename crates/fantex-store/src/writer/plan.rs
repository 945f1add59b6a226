//! Plans: assets without texels, which several processes bake in parts.

use std::ops::Range;
use std::path::{Path, PathBuf};

use fantex_base::{Error, Result, are};
use fantex_cover::{Cover, Group};
use fantex_mesh::Mesh;
use xxhash_rust::xxh3::Xxh3;

use super::{NewFile, Recipe, check_contents, pack_section};
use crate::bytes::ByteReader;
use crate::encoder_print::encoder_fingerprint;
use crate::error::damaged;
use crate::header::{FLAG_BARE_PLAN, FLAG_PLAN, Sections, read_any_slot};
use crate::{ByteSource, Channel, FileSource, Replacement, channel, cover_section, mesh_section};

/// Everything of an asset but its texels.
///
/// A file has the layout of an asset without clusters, the flag of plans, and, in place of the directory, a fingerprint of the block
/// encoders, the recipe and `about`.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Where it lies: a path or an address.
    pub path: PathBuf,
    /// The asset's mesh.
    pub mesh: Mesh,
    /// The asset's tiles.
    pub cover: Cover,
    /// The asset's channels.
    pub channels: Vec<Channel>,
    /// What else decides its texels.
    pub recipe: Recipe,
    /// What its writer noted, for whoever bakes.
    pub about: Vec<u8>,
    /// Of the block encoders of the processor that planned.
    pub(super) encoders: u64,
    /// Of the contents but `about`: only parts that have the same are merged.
    pub(super) identity: u128,
}

impl Plan {
    /// Writes a plan, whole or not at all; returns its length in bytes.
    ///
    /// # Errors
    /// The file exists and is not to be overwritten or is being edited, cannot be written, or the contents break a rule of the format.
    pub fn write(
        path: &Path,
        force: bool,
        mesh: &Mesh,
        cover: &Cover,
        channels: &[Channel],
        recipe: &Recipe,
        about: &[u8],
    ) -> Result<u64> {
        check_contents(path, force, mesh, cover, channels)?;
        let replacement = Replacement::begin(path, force)?;
        let notes = [&encoders_of(channels)?.to_le_bytes()[..], &recipe.encode(), about].concat();
        let write = || {
            let mut file = NewFile::create(path, 1, 0)?;
            file.slot.flags = FLAG_PLAN;
            file.contents(mesh, cover, channels)?;
            let (stored, record) = pack_section(&notes)?;
            file.section(3, &stored, record)?;
            file.seal(None)
        };
        let (file, bytes) = write().map_err(|source| Error::writing(path, source))?;
        replacement.finish(file.into_temp_path())?;
        Ok(bytes)
    }

    /// Reads a plan.
    ///
    /// # Errors
    /// The file cannot be read, is no plan, or is damaged.
    pub fn open(path: &Path) -> Result<Self> {
        Self::open_source(&FileSource::open(path).map_err(|error| Error::reading(path, error))?)
    }

    /// Reads a plan that may lie anywhere.
    ///
    /// # Errors
    /// The source cannot be read, is no plan, or is damaged.
    pub fn open_source(source: &dyn ByteSource) -> Result<Self> {
        let path = source.location();
        let (slot, _) = read_any_slot(source)?;
        if slot.flags == FLAG_BARE_PLAN {
            let sentence = format!(
                "{} is a plan that does not say what its texels are made of; plan anew with this program, and bake all parts",
                path.display()
            );
            return Err(Error::unsupported(sentence).with_path(path));
        }
        if slot.flags != FLAG_PLAN {
            let sentence = format!("{} is an asset, and no plan", path.display());
            return Err(Error::invalid(sentence).with_path(path));
        }
        let mut sections = Sections::read(source, &slot)?;
        let _held = sections.reserve_unpacked()?;
        let [channels, cover, mesh, notes] = [0, 1, 2, 3].map(|index| sections.unpack(index));
        let (channel_bytes, cover_bytes, mesh_bytes, notes) = (channels?, cover?, mesh?, notes?);
        let wrong = |error: Error| damaged(path, error);
        let mut rest = ByteReader::new(&notes);
        let encoders = rest.u64("the fingerprint of the block encoders").map_err(wrong)?;
        let recipe = Recipe::decode(&mut rest).map_err(wrong)?;
        let (noted, about) = notes.split_at(notes.len() - rest.remaining());
        let mesh = mesh_section::decode(ByteReader::new(&mesh_bytes)).map_err(wrong)?;
        let cover = cover_section::decode(&cover_bytes, &mesh.triangles).map_err(wrong)?;
        let cover = Cover { hard_edges: slot.hard_edges, ..cover };
        let channels = channel::decode_channels(&channel_bytes).map_err(wrong)?;
        let identity = identity(&[&channel_bytes, &cover_bytes, &mesh_bytes, noted]);
        let about = about.to_vec();
        Ok(Self { path: path.to_owned(), mesh, cover, channels, recipe, about, encoders, identity })
    }

    /// Whether this is the mesh, and these are the channels, that were planned.
    pub fn is_of(&self, mesh: &Mesh, channels: &[Channel]) -> bool {
        let sections = [
            channel::encode_channels(channels),
            cover_section::encode(&self.cover, &self.mesh.triangles),
            mesh_section::encode(mesh),
            [&self.encoders.to_le_bytes()[..], &self.recipe.encode()].concat(),
        ];
        identity(&sections.each_ref().map(Vec::as_slice)) == self.identity
    }

    /// Refuses to bake something else than was planned.
    ///
    /// # Errors
    /// The recipe is another one; the message says in what.
    pub fn check_recipe(&self, recipe: &Recipe) -> Result<()> {
        const MAX_NAMED: usize = 3;
        let names = recipe.differences(&self.recipe);
        if names.is_empty() {
            return Ok(());
        }
        let others = match names.len().saturating_sub(MAX_NAMED) {
            0 => String::new(),
            count => format!(" and {count} more"),
        };
        let (named, are) = (&names[..names.len().min(MAX_NAMED)], are(names.len()));
        Err(Error::invalid(format!(
            "{}{others} {are} not what {} was made for; plan anew and bake all parts, or bake what was planned",
            named.join(", "),
            self.path.display()
        )))
    }

    /// Whether this processor's block encoders write the bytes that those of the processor that planned do.
    ///
    /// # Errors
    /// They do not.
    pub(super) fn check_encoders(&self) -> Result<()> {
        if self.encoders == encoders_of(&self.channels)? {
            return Ok(());
        }
        Err(Error::unsupported(format!(
            "{} was made on a processor whose block encoders give other bytes than this one's; plan and bake on one kind of processor, or \
             bake uncompressed texels (--format rgba8), which are the same on all",
            self.path.display()
        )))
    }

    /// The groups of shard `number` of `count`, counted from 1: runs with as many texels each as whole groups allow.
    ///
    /// # Errors
    /// There is no such shard.
    pub fn shard(&self, number: u32, count: u32) -> Result<Range<u32>> {
        if !(1..=count).contains(&number) {
            return Err(Error::invalid(format!(
                "there is no shard {number} of {count}; give 1/{count} to {count}/{count}"
            )));
        }
        let total = self.cover.texels();
        let start_of = |shard: u32| {
            let before = (u128::from(total) * u128::from(shard) / u128::from(count)) as u64;
            let mut sum = 0;
            let is_before = |group: &&Group| {
                let starts = sum;
                sum += group.texels();
                starts < before
            };
            self.cover.groups.iter().take_while(is_before).count() as u32
        };
        let end = if number == count { self.cover.groups.len() as u32 } else { start_of(number) };
        Ok(start_of(number - 1).min(end)..end)
    }
}

fn encoders_of(channels: &[Channel]) -> Result<u64> {
    let formats: Vec<_> = channels.iter().map(|channel| channel.format).collect();
    encoder_fingerprint(&formats)
}

fn identity(sections: &[&[u8]]) -> u128 {
    let mut hash = Xxh3::new();
    for section in sections {
        hash.update(&(section.len() as u64).to_le_bytes());
        hash.update(section);
    }
    hash.digest128()
}

#[cfg(test)]
mod tests {
    use fantex_base::files::persist;
    use fantex_cover::{CoverOptions, build_cover};
    use fantex_mesh::generate::cube;
    use fantex_mesh::{CleanOptions, clean};

    use super::*;
    use crate::{ChannelKind, TexelFormat};

    #[test]
    fn plans_of_other_encoders_are_refused_where_texels_are_compressed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.plan");
        let (mesh, _) = clean(cube(1), &CleanOptions::default()).unwrap();
        let (cover, _) = build_cover(&mesh, &CoverOptions::default()).unwrap();
        for (format, is_compressed) in [(TexelFormat::Bc1, true), (TexelFormat::Rgba8, false)] {
            let channels = [Channel { kind: ChannelKind::BaseColor, format, srgb: true }];
            Plan::write(&path, true, &mesh, &cover, &channels, &Recipe::default(), b"notes").unwrap();
            let mut plan = Plan::open(&path).unwrap();
            assert_eq!(plan.about, b"notes");
            assert_eq!(plan.encoders != 0, is_compressed);
            plan.check_encoders().unwrap();
            plan.encoders ^= 1;
            let sentence = plan.check_encoders().unwrap_err().to_string();
            assert!(sentence.contains("a.plan was made on a processor whose block encoders"), "{sentence}");
        }
    }

    #[test]
    fn plans_have_the_identity_of_their_recipe_and_refuse_others() {
        let folder = tempfile::tempdir().unwrap();
        let (mesh, _) = clean(cube(1), &CleanOptions::default()).unwrap();
        let (cover, _) = build_cover(&mesh, &CoverOptions::default()).unwrap();
        let channels = [Channel { kind: ChannelKind::BaseColor, format: TexelFormat::Rgba8, srgb: true }];
        let recipe = |settings: &[(&str, u32)]| {
            let mut recipe = Recipe::default();
            settings.iter().for_each(|(name, value)| recipe.add_setting(name, value));
            recipe
        };
        let planned = |name: &str, recipe: &Recipe, about: &[u8]| {
            let path = folder.path().join(name);
            Plan::write(&path, false, &mesh, &cover, &channels, recipe, about).unwrap();
            Plan::open(&path).unwrap()
        };
        let wood = recipe(&[("the seed", 1), ("wood.png", 1)]);
        let plan = planned("a.plan", &wood, b"");
        assert_eq!(plan.recipe, wood);
        assert!(plan.is_of(&mesh, &channels));
        plan.check_recipe(&wood).unwrap();
        assert_eq!(planned("b.plan", &wood, b"another note").identity, plan.identity);
        let other = recipe(&[("the seed", 1), ("wood.png", 2)]);
        assert_ne!(planned("c.plan", &other, b"").identity, plan.identity);
        let sentence = plan.check_recipe(&other).unwrap_err().to_string();
        assert!(
            sentence.starts_with("wood.png is not what ") && sentence.contains("plan anew"),
            "{sentence}"
        );
        let more = recipe(&[("a", 1), ("b", 1), ("c", 1), ("d", 1), ("the seed", 1), ("wood.png", 1)]);
        let sentence = plan.check_recipe(&more).unwrap_err().to_string();
        assert!(sentence.starts_with("a, b, c and 1 more are not what "), "{sentence}");
        // One without a recipe is no damaged one.
        let path = folder.path().join("bare.plan");
        let mut file = NewFile::create(&path, 1, 0).unwrap();
        file.slot.flags = FLAG_BARE_PLAN;
        file.contents(&mesh, &cover, &channels).unwrap();
        let (stored, record) = pack_section(&[0; 8]).unwrap();
        file.section(3, &stored, record).unwrap();
        let (file, _) = file.seal(None).unwrap();
        persist(file.into_temp_path(), &path, false).unwrap();
        let sentence = Plan::open(&path).unwrap_err().to_string();
        assert!(sentence.contains("plan anew with this program"), "{sentence}");
        let sentence = crate::Asset::open(&path).unwrap_err().to_string();
        assert!(sentence.contains("is a plan, which has no texels"), "{sentence}");
    }
}
