//! What decides a bake's texels, as digests: a plan keeps them, and all who bake its parts compare theirs.

use std::collections::BTreeSet;
use std::fmt;
use std::io::{self, Read};
use std::path::Path;

use fantex_base::{Error, Result, input};
use fantex_mesh::{ImageSource, Material, Mesh};
use xxhash_rust::xxh3::{Xxh3, xxh3_128};

use crate::bytes::{ByteReader, ByteWriter};
use crate::header::{SIGNATURE, Slot, read_slot};
use crate::{Asset, FileSource};

/// What decides texels besides the mesh, the tiles and the channels of a plan: settings, meshes, and what files contain.
///
/// Bakes of one recipe give the same texels. It knows contents and no folders, so that machines may have files elsewhere. The order in which things
/// are added says nothing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recipe {
    /// Names, which stand in messages, and digests.
    entries: BTreeSet<(String, u128)>,
}

/// Bytes of a file that are read at a time.
const READ_BYTES: usize = 1 << 20;

impl Recipe {
    /// Adds a setting, such as `the seed`.
    pub fn add_setting(&mut self, name: &str, value: impl fmt::Debug) {
        self.add(name, xxh3_128(format!("{value:?}").as_bytes()));
    }

    /// Adds a mesh: all but the files of its images, which are [added](Self::add_file) by themselves.
    pub fn add_mesh(&mut self, name: &str, mesh: &Mesh) {
        let mut hash = Xxh3::new();
        put(&mut hash, bytemuck::cast_slice(&mesh.positions));
        put(&mut hash, bytemuck::cast_slice(&mesh.triangles));
        put(&mut hash, bytemuck::cast_slice(&mesh.corners.normals));
        put(&mut hash, bytemuck::cast_slice(&mesh.corners.colors));
        put(&mut hash, bytemuck::cast_slice(&mesh.corners.tangents));
        mesh.corners.uv_sets.iter().for_each(|set| put(&mut hash, bytemuck::cast_slice(set)));
        put(&mut hash, bytemuck::cast_slice(&mesh.triangle_materials));
        put(&mut hash, format!("{:?} {:?}", mesh.world_from_mesh, mesh.undisplaced_bounds).as_bytes());
        for material in &mesh.materials {
            // Places are for messages.
            let material = Material { place: String::new(), ..material.clone() };
            put(&mut hash, format!("{material:?}").as_bytes());
        }
        mesh.images.iter().for_each(|image| put_image(&mut hash, image));
        self.add(name, hash.digest128());
    }

    /// Adds an asset, wherever it lies, by the checksums of its sections, among which the directory has those of all texels.
    pub fn add_asset(&mut self, name: &str, asset: &Asset) {
        self.add(name, digest_of(asset.slot()));
    }

    /// Adds what a file contains, an asset as [`add_asset`](Self::add_asset) does, under its name without folders. `watch` is told of each run of
    /// bytes that was read, and may end that by an error.
    ///
    /// # Errors
    /// The file cannot be read; what `watch` returns.
    pub fn add_file(&mut self, path: &Path, watch: &mut dyn FnMut(u64) -> Result<()>) -> Result<()> {
        let failed = |error: io::Error| Error::reading(path, error);
        let mut file = input::open(path).map_err(failed)?;
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        let (mut hash, mut buffer) = (Xxh3::new(), vec![0; READ_BYTES]);
        let mut is_first = true;
        loop {
            let count = match file.read(&mut buffer) {
                Ok(0) => break,
                Ok(count) => count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(failed(error)),
            };
            let is_asset = std::mem::take(&mut is_first) && buffer[..count].starts_with(&SIGNATURE);
            if let Some((slot, _)) =
                is_asset.then(|| read_slot(&FileSource::open(path).map_err(failed)?)).transpose()?
            {
                self.add(&name, digest_of(&slot));
                return Ok(());
            }
            hash.update(&buffer[..count]);
            watch(count as u64)?;
        }
        self.add(&name, hash.digest128());
        Ok(())
    }

    /// Names of all that two recipes do not share.
    pub fn differences<'a>(&'a self, other: &'a Self) -> Vec<&'a str> {
        let names = self.entries.symmetric_difference(&other.entries).map(|(name, _)| name.as_str());
        BTreeSet::from_iter(names).into_iter().collect()
    }

    fn add(&mut self, name: &str, digest: u128) {
        self.entries.insert((name.to_owned(), digest));
    }

    pub(super) fn encode(&self) -> Vec<u8> {
        let mut out = ByteWriter::default();
        out.u32(self.entries.len() as u32);
        for (name, digest) in &self.entries {
            out.u32(name.len() as u32);
            out.put(name.as_bytes());
            out.put(&digest.to_le_bytes());
        }
        out.bytes
    }

    pub(super) fn decode(input: &mut ByteReader<'_>) -> Result<Self> {
        let mut entries = BTreeSet::new();
        for _ in 0..input.u32("the recipe")? {
            let length = input.u32("the recipe")? as usize;
            let name = String::from_utf8_lossy(&input.take(length, "the recipe")?).into_owned();
            let digest = [input.u64("the recipe")?, input.u64("the recipe")?].map(u128::from);
            entries.insert((name, digest[0] | digest[1] << 64));
        }
        Ok(Self { entries })
    }
}

fn digest_of(slot: &Slot) -> u128 {
    xxh3_128(bytemuck::cast_slice(&slot.sections.map(|section| section.checksum)))
}

/// With the length, so that no byte can change its place unseen.
fn put(hash: &mut Xxh3, bytes: &[u8]) {
    hash.update(&(bytes.len() as u64).to_le_bytes());
    hash.update(bytes);
}

fn put_image(hash: &mut Xxh3, image: &ImageSource) {
    match image {
        ImageSource::File(_) => put(hash, b"file"),
        ImageSource::Embedded { bytes, .. } => put(hash, bytes),
        ImageSource::Packed(packed) => {
            for channel in &packed.channels {
                put(hash, format!("{:?}", channel.as_ref().map(|channel| channel.channel)).as_bytes());
                channel.iter().for_each(|channel| put_image(hash, &channel.source));
            }
        }
        ImageSource::Bump(bump) => {
            put(hash, format!("{:?}", bump.wrap).as_bytes());
            put_image(hash, &bump.source);
        }
    }
}

#[cfg(test)]
mod tests {
    use fantex_base::ErrorKind;
    use fantex_mesh::generate::cube;
    use fantex_mesh::{CleanOptions, clean};
    use glam::Vec4;

    use super::*;

    #[test]
    fn recipes_know_contents_and_name_what_differs() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("elsewhere")).unwrap();
        let (mut mesh, _) = clean(cube(1), &CleanOptions::default()).unwrap();
        let recipe_of = |mesh: &Mesh, seed: u64, picture: &Path, bytes: &[u8]| {
            std::fs::write(picture, bytes).unwrap();
            let mut recipe = Recipe::default();
            recipe.add_mesh("the model", mesh);
            recipe.add_setting("the seed", seed);
            let mut read = 0;
            let mut watch = |count| {
                read += count;
                Ok(())
            };
            recipe.add_file(picture, &mut watch).unwrap();
            assert_eq!(read, bytes.len() as u64);
            recipe
        };
        let long = vec![7; READ_BYTES + 1];
        let planned = recipe_of(&mesh, 1, &at("a.png"), &long);
        let mut stored = planned.encode();
        assert_eq!(Recipe::decode(&mut ByteReader::new(&stored)).unwrap(), planned);
        stored.pop();
        Recipe::decode(&mut ByteReader::new(&stored)).unwrap_err();
        let same = recipe_of(&mesh, 1, &at("elsewhere/a.png"), &long);
        assert_eq!(same, planned);
        let shorter = recipe_of(&mesh, 2, &at("a.png"), &long[1..]);
        assert_eq!(shorter.differences(&planned), ["a.png", "the seed"]);
        mesh.materials[0].place = "line 1".to_owned();
        assert_eq!(recipe_of(&mesh, 1, &at("a.png"), &long), planned);
        mesh.materials[0].base_color = Vec4::ZERO;
        assert_eq!(recipe_of(&mesh, 1, &at("a.png"), &long).differences(&planned), ["the model"]);
        let ended = Recipe::default().add_file(&at("a.png"), &mut |_| Err(Error::cancelled("ended")));
        assert_eq!(ended.unwrap_err().kind(), ErrorKind::Cancelled);
    }
}
