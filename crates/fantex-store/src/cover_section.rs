//! The cover section.

use fantex_base::{Error, Result};
use fantex_cover::{Cover, Frame, Group, GroupKind, UnfoldedCorner};
use fantex_mesh::check_hard_edges;
use glam::{Vec2, Vec3};

use crate::bytes::{ByteReader, ByteWriter, below, check_finite, limit};
use crate::error::{not_finite, out_of_order, wrong_count};
use crate::limits::{MAX_TILE_SIDE, MAX_TRIANGLES};
use crate::unfolded_places;

/// What must hold for a cover of a mesh of `triangles` triangles.
pub(crate) fn check(cover: &Cover, triangles: usize) -> Result<()> {
    parameter(
        "delta",
        cover.delta,
        cover.delta > 0.0 && cover.delta <= 1.0 / 3.0 + 1e-6,
        "0 < delta <= 1/3",
    )?;
    parameter("density", cover.density, cover.density > 0.0 && cover.density.is_finite(), "density > 0")?;
    cover.hard_edges.map_or(Ok(()), check_hard_edges)?;
    check_groups(cover, triangles)?;
    check_unfolded(cover)
}

/// Every corner has a group that there is.
fn check_groups(cover: &Cover, triangles: usize) -> Result<()> {
    if cover.corner_groups.len() != triangles {
        return Err(wrong_count(
            "triangles in the cover",
            triangles as u64,
            cover.corner_groups.len() as u64,
        ));
    }
    limit("groups", cover.groups.len(), 3 * triangles)?;
    for (t, groups) in cover.corner_groups.iter().enumerate() {
        for &group in groups {
            below("group of triangle", t, group, cover.groups.len())?;
        }
    }
    for (g, group) in cover.groups.iter().enumerate() {
        check_group(g, group)?;
    }
    Ok(())
}

fn parameter(what: &'static str, value: f32, ok: bool, range: &'static str) -> Result<()> {
    if ok { Ok(()) } else { Err(Error::malformed(format!("{what} is {value}, but must lie within {range}"))) }
}

fn check_group(index: usize, group: &Group) -> Result<()> {
    let fits = |&n: &u32| n > 0 && n.is_multiple_of(4) && n <= MAX_TILE_SIDE;
    if !group.extent.iter().all(fits) {
        let [columns, rows] = group.extent;
        return Err(Error::malformed(format!(
            "group {index} has a tile of {columns}x{rows} texels; both sides must be multiples of 4 up to {MAX_TILE_SIDE}"
        )));
    }
    match check_finite(&[map_floats(group)], "tile map of group") {
        Err(_) => Err(not_finite("tile map of group", index)),
        Ok(()) => Ok(()),
    }
}

/// Exactly the corners whose group is unfolded have coordinates, and corners of a triangle in the same group have the same.
fn check_unfolded(cover: &Cover) -> Result<()> {
    let is_unfolded = |group: u32| cover.groups[group as usize].kind == GroupKind::Unfolded;
    for (i, entry) in cover.unfolded.iter().enumerate() {
        if i > 0 && cover.unfolded[i - 1].corner >= entry.corner {
            return Err(out_of_order("unfolded corner", i));
        }
        below("unfolded corner", i, entry.corner, 3 * cover.corner_groups.len())?;
        if !is_unfolded(cover.corner_groups[entry.corner as usize / 3][entry.corner as usize % 3]) {
            return Err(Error::malformed(format!(
                "corner {} has unfolded coordinates, but its group is projected",
                entry.corner
            )));
        }
        if !entry.uv.iter().all(|uv| uv.is_finite()) {
            return Err(not_finite("unfolded corner", i));
        }
        let group = |entry: &UnfoldedCorner| {
            let triangle = entry.corner / 3;
            (triangle, cover.corner_groups[triangle as usize][entry.corner as usize % 3])
        };
        let mut others = cover.unfolded[i.saturating_sub(2)..i].iter();
        if let Some(other) = others.find(|&other| group(other) == group(entry) && other.uv != entry.uv) {
            return Err(Error::malformed(format!(
                "corners {} and {} of a triangle are in one unfolded group, but have different coordinates",
                other.corner, entry.corner
            )));
        }
    }
    let due = cover.corner_groups.iter().flatten().filter(|&&g| is_unfolded(g)).count();
    if due != cover.unfolded.len() {
        return Err(wrong_count("unfolded corners", due as u64, cover.unfolded.len() as u64));
    }
    Ok(())
}

/// Frame and scale of a group in the order of the file.
fn map_floats(group: &Group) -> [f32; 13] {
    let Frame { origin: o, direction: d, x_axis: x } = group.frame;
    let (s, t) = (group.uv_scale, group.uv_offset);
    [o.x, o.y, o.z, d.x, d.y, d.z, x.x, x.y, x.z, s.x, s.y, t.x, t.y]
}

/// Bits of the last byte: fans end at creases.
const CREASED: u8 = 1;

/// Triangles continue each other by angle.
const PAIRED_BY_ANGLE: u8 = 2;

/// Coordinates of corners follow, packed, of unfolded groups without corners in the list before.
const PACKED: u8 = 4;

/// Of a cover of triangles of these vertices.
pub(crate) fn encode(cover: &Cover, triangles: &[[u32; 3]]) -> Vec<u8> {
    let listed_groups = unfolded_places::listed_groups(cover);
    let packed = unfolded_places::encode(cover, &listed_groups, triangles);
    let is_listed = |entry: &&UnfoldedCorner| {
        let group = unfolded_places::group_of(cover, entry.corner);
        packed.is_none() || group.is_some_and(|group| listed_groups[group as usize])
    };
    let listed: Vec<&UnfoldedCorner> = cover.unfolded.iter().filter(is_listed).collect();
    let mut out = ByteWriter::default();
    out.f32s(&[cover.delta, cover.density]);
    out.u32(cover.corner_groups.len() as u32);
    out.u32(cover.groups.len() as u32);
    out.u32(listed.len() as u32);
    out.words(cover.corner_groups.iter().copied());
    for group in &cover.groups {
        out.u8(match group.kind {
            GroupKind::Projected => 0,
            GroupKind::Unfolded => 1,
        });
    }
    out.words(cover.groups.iter().map(|g| g.extent));
    out.floats(cover.groups.iter().map(map_floats));
    out.words(listed.iter().map(|u| [u.corner]));
    out.floats(listed.iter().map(|u| {
        let [a, b, c] = u.uv;
        [a.x, a.y, b.x, b.y, c.x, c.y]
    }));
    let mark = |is_set: bool, bit: u8| if is_set { bit } else { 0 };
    let marks = mark(cover.is_creased, CREASED)
        | mark(cover.is_paired_by_angle, PAIRED_BY_ANGLE)
        | mark(packed.is_some(), PACKED);
    if marks != 0 {
        out.u8(marks);
    }
    out.put(&packed.unwrap_or_default());
    out.bytes
}

/// Of a cover of triangles of these vertices.
pub(crate) fn decode(bytes: &[u8], mesh_triangles: &[[u32; 3]]) -> Result<Cover> {
    let mut input = ByteReader::new(bytes);
    let delta = input.f32("delta")?;
    let density = input.f32("the density")?;
    let triangles = input.count(MAX_TRIANGLES, "triangles")?;
    let groups = input.count(3 * triangles, "groups")?;
    let unfolded = input.count(3 * triangles, "unfolded corners")?;
    let corner_groups = input.words(triangles, "the groups of triangles")?;
    let kinds = input.take(groups, "the kinds of groups")?;
    let extents = input.words::<2>(groups, "the extents of groups")?;
    let maps = input.floats::<13>(groups, "tile map of group")?;
    let corners = input.words::<1>(unfolded, "unfolded corners")?;
    // Before a table of them is made.
    for (i, &[corner]) in corners.iter().enumerate() {
        below("unfolded corner", i, corner, 3 * triangles)?;
    }
    let coordinates = input.floats::<6>(unfolded, "unfolded corner")?;
    let marks = if input.remaining() > 0 { input.u8("the marks of the cover")? } else { 0 };
    if marks & !(CREASED | PAIRED_BY_ANGLE | PACKED) != 0 {
        return Err(Error::malformed(format!("the cover ends with unknown marks: {marks}")));
    }
    let mut cover = Cover {
        delta,
        density,
        is_creased: marks & CREASED != 0,
        // The header says it.
        hard_edges: None,
        is_paired_by_angle: marks & PAIRED_BY_ANGLE != 0,
        corner_groups,
        groups: kinds
            .iter()
            .zip(&extents)
            .zip(&maps)
            .enumerate()
            .map(|(index, ((&kind, &extent), map))| group_from(index, kind, extent, map))
            .collect::<Result<_, _>>()?,
        unfolded: corners
            .into_iter()
            .zip(coordinates)
            .map(|([corner], [ax, ay, bx, by, cx, cy])| UnfoldedCorner {
                corner,
                uv: [Vec2::new(ax, ay), Vec2::new(bx, by), Vec2::new(cx, cy)],
            })
            .collect(),
    };
    if marks & PACKED != 0 {
        check_groups(&cover, mesh_triangles.len())?;
        cover.unfolded = unfolded_places::decode(&mut input, &cover, mesh_triangles)?.into();
    }
    input.end()?;
    check(&cover, mesh_triangles.len())?;
    Ok(cover)
}

fn group_from(index: usize, kind: u8, extent: [u32; 2], map: &[f32; 13]) -> Result<Group> {
    below("kind of group", index, u32::from(kind), 2)?;
    let [ox, oy, oz, dx, dy, dz, xx, xy, xz, sx, sy, tx, ty] = *map;
    Ok(Group {
        kind: if kind == 0 { GroupKind::Projected } else { GroupKind::Unfolded },
        frame: Frame {
            origin: Vec3::new(ox, oy, oz),
            direction: Vec3::new(dx, dy, dz),
            x_axis: Vec3::new(xx, xy, xz),
        },
        uv_scale: Vec2::new(sx, sy),
        uv_offset: Vec2::new(tx, ty),
        extent,
    })
}
