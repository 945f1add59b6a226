//! Where the vertices of unfolded groups lie in their tiles, packed.
//!
//! A group of fans that is laid flat has one place per vertex, nearly always, and a cover has coordinates per corner of each triangle.
//!
//! ```text
//! mentions        group by group, triangle by triangle: corners 0, 1, 2 of every triangle with a corner in the group
//! stored places   those of a vertex's first mention in its group, and of the mentions that are listed as exceptions
//! all others      the place of the vertex's mention before
//! ```
//!
//! Places are whole numbers of [steps](UnfoldedCorner::steps) across the tile. Groups with other coordinates are listed corner by corner instead.

use fantex_base::Result;
use fantex_cover::{Cover, GroupKind, UnfoldedCorner};
use glam::Vec2;

use crate::bytes::{ByteReader, ByteWriter, below};
use crate::error::{out_of_order, wrong_count};

/// Whether the corners of each group are listed, as far as it is unfolded: some coordinate is no whole number of steps.
pub(crate) fn listed_groups(cover: &Cover) -> Vec<bool> {
    let mut listed = vec![false; cover.groups.len()];
    for entry in cover.unfolded.iter() {
        let Some(group) = group_of(cover, entry.corner) else { continue };
        let steps = UnfoldedCorner::steps(cover.groups[group as usize].extent);
        listed[group as usize] |= entry.uv.iter().any(|&at| uv(whole(at, steps), steps) != at);
    }
    listed
}

/// The group of a corner.
pub(crate) fn group_of(cover: &Cover, corner: u32) -> Option<u32> {
    cover.corner_groups.get(corner as usize / 3).map(|groups| groups[corner as usize % 3])
}

/// The packed places of a cover on triangles of these vertices, of its groups that are not listed; `None` where there are none, or a corner of an
/// unfolded group has no coordinates.
pub(crate) fn encode(cover: &Cover, listed: &[bool], triangles: &[[u32; 3]]) -> Option<Vec<u8>> {
    let mentions = Mentions::of(cover, listed);
    if mentions.triangles.is_empty() {
        return None;
    }
    let (mut exceptions, mut stored) = (Vec::new(), Vec::new());
    let mut places: Vec<Vec2> = Vec::new();
    for (first, group) in mentions.groups() {
        let steps = UnfoldedCorner::steps(cover.groups[group[0].group as usize].extent);
        places.clear();
        for triangle in group {
            places.extend(cover.unfolded.find(triangle.corner(cover)?)?.uv);
        }
        for (at, earlier) in earlier_mentions(group, triangles).into_iter().enumerate() {
            let is_as_before = earlier.is_some_and(|earlier| places[earlier] == places[at]);
            if is_as_before {
                continue;
            }
            if earlier.is_some() {
                exceptions.push(u32::try_from(first + at).ok()?);
            }
            stored.push(whole(places[at], steps).map(|n| n as u32));
        }
    }
    let mut out = ByteWriter::default();
    out.u32(stored.len() as u32);
    out.u32(exceptions.len() as u32);
    out.words(exceptions.into_iter().map(|mention| [mention]));
    out.words(stored.into_iter());
    Some(out.bytes)
}

/// The coordinates of all corners of unfolded groups, ascending: those that the cover has are listed. Its groups are known to be below
/// their number.
pub(crate) fn decode(
    input: &mut ByteReader<'_>,
    cover: &Cover,
    triangles: &[[u32; 3]],
) -> Result<Vec<UnfoldedCorner>> {
    let mut listed = vec![false; cover.groups.len()];
    let of_listed = cover.unfolded.iter().filter_map(|entry| group_of(cover, entry.corner));
    of_listed.for_each(|group| listed[group as usize] = true);
    let mentions = Mentions::of(cover, &listed);
    let count = 3 * mentions.triangles.len();
    let stored = input.count(count, "places of unfolded corners")?;
    let exceptions = input.count(count, "places that differ from those before")?;
    let exceptions = input.words::<1>(exceptions, "places that differ from those before")?;
    for (i, &[mention]) in exceptions.iter().enumerate() {
        below("place that differs from those before", i, mention, count)?;
        if i > 0 && exceptions[i - 1] >= exceptions[i] {
            return Err(out_of_order("place that differs from those before", i));
        }
    }
    let stored = input.words::<2>(stored, "places of unfolded corners")?;
    let mut exceptions = exceptions.into_iter().map(|[mention]| mention as usize).peekable();
    let mut next = stored.iter();
    let mut due = 0;
    let mut corners = cover.unfolded.to_vec();
    corners.reserve(mentions.triangles.len());
    let mut places: Vec<Vec2> = Vec::new();
    for (first, group) in mentions.groups() {
        let steps = UnfoldedCorner::steps(cover.groups[group[0].group as usize].extent);
        places.clear();
        for (at, earlier) in earlier_mentions(group, triangles).into_iter().enumerate() {
            let is_exception = exceptions.next_if_eq(&(first + at)).is_some();
            let place = match earlier {
                Some(earlier) if !is_exception => places[earlier],
                _ => {
                    due += 1;
                    next.next().map_or(Vec2::ZERO, |place| uv(place.map(|n| n as i32), steps))
                }
            };
            places.push(place);
        }
        for (triangle, uv) in group.iter().zip(places.chunks_exact(3)) {
            let uv = [uv[0], uv[1], uv[2]];
            let groups = cover.corner_groups[triangle.triangle as usize];
            let own = (0..3).filter(|&k| groups[k as usize] == triangle.group);
            corners.extend(own.map(|k| UnfoldedCorner { corner: 3 * triangle.triangle + k, uv }));
        }
    }
    if due != stored.len() {
        return Err(wrong_count("places of unfolded corners", due as u64, stored.len() as u64));
    }
    corners.sort_unstable_by_key(|entry| entry.corner);
    Ok(corners)
}

/// A triangle with a corner in an unfolded group.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct InGroup {
    group: u32,
    triangle: u32,
}

impl InGroup {
    /// The first of its corners that is in the group.
    fn corner(self, cover: &Cover) -> Option<u32> {
        let slot = cover.corner_groups[self.triangle as usize].iter().position(|&g| g == self.group)?;
        Some(3 * self.triangle + slot as u32)
    }
}

/// All of them, group by group.
struct Mentions {
    triangles: Vec<InGroup>,
}

impl Mentions {
    /// Without those of listed groups.
    fn of(cover: &Cover, listed: &[bool]) -> Self {
        let mut triangles = Vec::new();
        for (&groups, triangle) in cover.corner_groups.iter().zip(0..) {
            let distinct = (0..3).filter(|&k| !groups[..k].contains(&groups[k])).map(|k| groups[k]);
            let unfolded = distinct
                .filter(|&g| cover.groups[g as usize].kind == GroupKind::Unfolded && !listed[g as usize]);
            triangles.extend(unfolded.map(|group| InGroup { group, triangle }));
        }
        triangles.sort_unstable();
        Self { triangles }
    }

    /// Every group with the number of its first mention.
    fn groups(&self) -> impl Iterator<Item = (usize, &[InGroup])> {
        let mut count = 0;
        self.triangles.chunk_by(|a, b| a.group == b.group).map(move |group| {
            let first = count;
            count += 3 * group.len();
            (first, group)
        })
    }
}

/// For each mention of a group the one of the same vertex before it.
fn earlier_mentions(group: &[InGroup], triangles: &[[u32; 3]]) -> Vec<Option<usize>> {
    let vertices = group.iter().flat_map(|triangle| triangles[triangle.triangle as usize]);
    let mut by_vertex: Vec<(u32, usize)> = vertices.zip(0..).collect();
    by_vertex.sort_unstable();
    let mut earlier = vec![None; by_vertex.len()];
    for pair in by_vertex.windows(2) {
        if pair[0].0 == pair[1].0 {
            earlier[pair[1].1] = Some(pair[0].1);
        }
    }
    earlier
}

fn whole(uv: Vec2, steps: Vec2) -> [i32; 2] {
    let whole = uv * steps;
    [whole.x as i32, whole.y as i32]
}

fn uv([x, y]: [i32; 2], steps: Vec2) -> Vec2 {
    Vec2::new(x as f32, y as f32) / steps
}

#[cfg(test)]
mod tests {
    use fantex_base::Random;
    use fantex_cover::{CoverOptions, TexelBudget, build_cover};
    use fantex_mesh::{CleanOptions, Mesh, clean, generate};

    use super::*;
    use crate::cover_section;

    /// A crumpled ball: most of its groups are unfolded.
    fn crumpled() -> (Mesh, Cover) {
        let mut model = generate::icosphere(3);
        let mut random = Random::new(3);
        model.positions.iter_mut().for_each(|p| *p *= 0.7 + 0.6 * random.unit());
        let (mesh, _) = clean(model, &CleanOptions::default()).unwrap();
        let options = CoverOptions { budget: TexelBudget::Total(1 << 14), ..CoverOptions::default() };
        let (cover, _) = build_cover(&mesh, &options).unwrap();
        (mesh, cover)
    }

    fn decoded(packed: &[u8], cover: &Cover, mesh: &Mesh) -> Result<Vec<UnfoldedCorner>> {
        let mut input = ByteReader::new(packed);
        let bare = Cover { unfolded: Vec::new().into(), ..cover.clone() };
        let corners = decode(&mut input, &bare, &mesh.triangles)?;
        input.end()?;
        Ok(corners)
    }

    #[test]
    fn packed_places_are_the_coordinates_of_all_corners() {
        let (mesh, cover) = crumpled();
        let packed = encode(&cover, &listed_groups(&cover), &mesh.triangles).unwrap();
        assert_eq!(decoded(&packed, &cover, &mesh).unwrap(), cover.unfolded.to_vec());
        assert!(cover.unfolded.len() > 2000 && packed.len() < 8 * cover.unfolded.len(), "{}", packed.len());
        let bytes = cover_section::encode(&cover, &mesh.triangles);
        assert_eq!(cover_section::decode(&bytes, &mesh.triangles).unwrap(), cover);
    }

    /// Vertices may lie in several places of a group, and coordinates may be any numbers.
    #[test]
    fn covers_of_other_programs_are_kept_as_they_are() {
        let (mesh, mut cover) = crumpled();
        let mut random = Random::new(7);
        for is_whole in [true, false] {
            let mut entries = cover.unfolded.to_vec();
            let moved: Vec<(u32, u32)> = entries
                .iter()
                .filter(|_| random.unit() < 0.05)
                .map(|entry| (entry.corner / 3, group_of(&cover, entry.corner).unwrap()))
                .collect();
            for entry in &mut entries {
                if moved.contains(&(entry.corner / 3, group_of(&cover, entry.corner).unwrap())) {
                    entry.uv[1].x += if is_whole { 0.25 } else { 0.1 };
                }
            }
            cover.unfolded = entries.into();
            let listed = listed_groups(&cover);
            assert_eq!(!listed.contains(&true), is_whole);
            assert!(encode(&cover, &listed, &mesh.triangles).is_some());
            let bytes = cover_section::encode(&cover, &mesh.triangles);
            assert_eq!(cover_section::decode(&bytes, &mesh.triangles).unwrap(), cover);
        }
        let odd = |entry: &UnfoldedCorner| UnfoldedCorner { uv: entry.uv.map(|uv| uv * 0.7), ..*entry };
        cover.unfolded = cover.unfolded.iter().map(odd).collect();
        assert!(encode(&cover, &listed_groups(&cover), &mesh.triangles).is_none());
        let bytes = cover_section::encode(&cover, &mesh.triangles);
        assert_eq!(cover_section::decode(&bytes, &mesh.triangles).unwrap(), cover);
    }

    /// Every byte that changes is either noticed or gives other coordinates; nothing panics.
    #[test]
    fn damaged_places_are_refused() {
        let (mesh, cover) = crumpled();
        let packed = encode(&cover, &listed_groups(&cover), &mesh.triangles).unwrap();
        for length in [0, 4, 7, 8, packed.len() - 1] {
            decoded(&packed[..length], &cover, &mesh).unwrap_err();
        }
        let mut random = Random::new(11);
        for _ in 0..300 {
            let mut damaged = packed.clone();
            let at = random.below(damaged.len() as u64) as usize;
            damaged[at] ^= 1 << random.below(8);
            let read = decoded(&damaged, &cover, &mesh);
            assert!(read.is_err() || read.unwrap() != cover.unfolded.to_vec());
        }
        // How many there are, and how many differ from those before: what follows is read as something else, and is refused as that.
        for (at, sentences) in [(0, ["places of unfolded corners"; 2]), (4, ["place that", "places"])] {
            let mut damaged = packed.clone();
            damaged[at] ^= 1;
            let error = decoded(&damaged, &cover, &mesh).unwrap_err().to_string();
            assert!(sentences.iter().any(|sentence| error.contains(sentence)), "{error}");
        }
    }
}
