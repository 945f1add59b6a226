//! Plans: assets without texels, which several processes bake in parts.

use std::ops::Range;
use std::path::{Path, PathBuf};

use fantex_base::files::persist;
use fantex_base::{Error, Result};
use fantex_cover::{Cover, Group};
use fantex_mesh::Mesh;
use xxhash_rust::xxh3::Xxh3;

use super::{NewFile, check_contents, pack_section};
use crate::encoder_print::encoder_fingerprint;
use crate::error::damaged;
use crate::header::{FLAG_PLAN, Sections, read_slot_with};
use crate::{ByteSource, Channel, FileSource, channel, cover_section, mesh_section};

/// Everything of an asset but its texels.
///
/// A file has the layout of an asset without clusters, the flag of plans, and, in place of the directory, a fingerprint of the block
/// encoders and `about`.
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
    /// What its writer noted, for whoever bakes.
    pub about: Vec<u8>,
    /// Of the block encoders of the processor that planned.
    pub(super) encoders: u64,
    /// Of the contents but `about`: parts of one plan have the same.
    pub(super) identity: u128,
}

impl Plan {
    /// Writes a plan, whole or not at all; returns its length in bytes.
    ///
    /// # Errors
    /// The file exists and is not to be overwritten, cannot be written, or the contents break a rule of the format.
    pub fn write(
        path: &Path,
        force: bool,
        mesh: &Mesh,
        cover: &Cover,
        channels: &[Channel],
        about: &[u8],
    ) -> Result<u64> {
        check_contents(path, force, mesh, cover, channels)?;
        let mut notes = encoders_of(channels)?.to_le_bytes().to_vec();
        notes.extend_from_slice(about);
        let write = || {
            let mut file = NewFile::create(path, 1, 0)?;
            file.slot.flags = FLAG_PLAN;
            file.contents(mesh, cover, channels)?;
            let (stored, record) = pack_section(&notes)?;
            file.section(3, &stored, record)?;
            file.seal(None)
        };
        let (file, bytes) = write().map_err(|source| Error::writing(path, source))?;
        persist(file.into_temp_path(), path, force)?;
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
        let (slot, _) = read_slot_with(source, &[0, FLAG_PLAN])?;
        if slot.flags != FLAG_PLAN {
            let sentence = format!("{} is an asset, and no plan", path.display());
            return Err(Error::invalid(sentence).with_path(path));
        }
        let sections = Sections::read(source, &slot)?;
        let [channels, cover, mesh, notes] = [0, 1, 2, 3].map(|index| sections.unpack(index));
        let (channel_bytes, cover_bytes, mesh_bytes, notes) = (channels?, cover?, mesh?, notes?);
        let wrong = |error: Error| damaged(path, error);
        let Some((encoders, about)) = notes.split_first_chunk() else {
            return Err(wrong(Error::damaged("what a plan notes begins with 8 bytes on the block encoders")));
        };
        let mesh = mesh_section::decode(&mesh_bytes).map_err(wrong)?;
        let cover = cover_section::decode(&cover_bytes, &mesh.triangles).map_err(wrong)?;
        let channels = channel::decode_channels(&channel_bytes).map_err(wrong)?;
        let identity = identity(&[&channel_bytes, &cover_bytes, &mesh_bytes]);
        let (encoders, about) = (u64::from_le_bytes(*encoders), about.to_vec());
        Ok(Self { path: path.to_owned(), mesh, cover, channels, about, encoders, identity })
    }

    /// Whether this is the mesh, and these are the channels, that were planned.
    pub fn is_of(&self, mesh: &Mesh, channels: &[Channel]) -> bool {
        let sections = [
            channel::encode_channels(channels),
            cover_section::encode(&self.cover, &self.mesh.triangles),
            mesh_section::encode(mesh),
        ];
        identity(&[&sections[0], &sections[1], &sections[2]]) == self.identity
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
            Plan::write(&path, true, &mesh, &cover, &channels, b"notes").unwrap();
            let mut plan = Plan::open(&path).unwrap();
            assert_eq!(plan.about, b"notes");
            assert_eq!(plan.encoders != 0, is_compressed);
            plan.check_encoders().unwrap();
            plan.encoders ^= 1;
            let sentence = plan.check_encoders().unwrap_err().to_string();
            assert!(sentence.contains("a.plan was made on a processor whose block encoders"), "{sentence}");
        }
    }
}
