//! The mesh section: geometry, corner attributes and material factors. Images are not part of an asset: its channels hold
//! what they were baked into.

use fantex_base::{Error, Result};
use fantex_mesh::{
    AlphaMode, CornerAttributes, Material, Mesh, Parts, ToonInterpolation, ToonScale, WorldFromMesh,
};
use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::bytes::{ByteReader, ByteWriter, below, check_finite, exactly, limit};
use crate::error::{not_finite, out_of_order, out_of_range, wrong_count};
use crate::limits::{MAX_MATERIALS, MAX_NAME_BYTES, MAX_PARTS, MAX_TRIANGLES, MAX_UV_SETS};

const HAS_NORMALS: u32 = 1;
const HAS_COLORS: u32 = 2;
const HAS_TANGENTS: u32 = 4;
const HAS_TRIANGLE_MATERIALS: u32 = 8;
const HAS_PARTS: u32 = 16;
const ALL_FLAGS: u32 = 31;

const DOUBLE_SIDED: u8 = 1;
const UNLIT: u8 = 2;
const TOON: u8 = 4;

/// Meshes are scaled into -1..1, from a centre that may be a sixteenth off. Areas and volumes of such are no infinities.
const MAX_COORDINATE: f32 = 2.0;

/// What must hold for a mesh. (That no two vertices or triangles coincide is left to `verify`: it costs a sort.)
pub(crate) fn check(mesh: &Mesh) -> Result<()> {
    limit("triangles", mesh.triangles.len(), MAX_TRIANGLES)?;
    limit("vertices", mesh.positions.len(), 3 * mesh.triangles.len())?;
    limit("materials", mesh.materials.len(), MAX_MATERIALS)?;
    limit("texture coordinate sets", mesh.corners.uv_sets.len(), MAX_UV_SETS)?;
    let WorldFromMesh { offset, scale } = mesh.world_from_mesh;
    if !(offset.is_finite() && scale.is_finite() && scale > 0.0) {
        return Err(Error::malformed(format!(
            "the world scale is {scale} and the world offset {offset}, but the scale must be positive, and both finite"
        )));
    }
    check_finite(bytemuck::cast_slice::<Vec3, [f32; 3]>(&mesh.positions), "position of vertex")?;
    if let Some(vertex) = mesh.positions.iter().position(|p| p.abs().max_element() > MAX_COORDINATE) {
        return Err(Error::malformed(format!("the position of vertex {vertex} is beyond {MAX_COORDINATE}")));
    }
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for &vertex in triangle {
            below("vertex of triangle", t, vertex, mesh.positions.len())?;
        }
        let [a, b, c] = *triangle;
        if a == b || b == c || c == a {
            return Err(Error::malformed(format!("triangle {t} uses a vertex more than once")));
        }
    }
    check_attributes(&mesh.corners, 3 * mesh.triangles.len())?;
    check_parts(&mesh.parts, mesh.triangles.len())?;
    check_materials(mesh)
}

fn check_parts(parts: &Parts, triangles: usize) -> Result<()> {
    limit("parts", parts.names.len(), MAX_PARTS)?;
    exactly("parts of triangles", parts.of_triangle.len(), triangles)?;
    for (t, &part) in parts.of_triangle.iter().enumerate() {
        below("part of triangle", t, part, parts.names.len())?;
    }
    Ok(())
}

fn check_attributes(corners: &CornerAttributes, count: usize) -> Result<()> {
    exactly("corner normals", corners.normals.len(), count)?;
    exactly("corner colours", corners.colors.len(), count)?;
    exactly("corner tangents", corners.tangents.len(), count)?;
    check_finite(bytemuck::cast_slice::<Vec3, [f32; 3]>(&corners.normals), "normal of corner")?;
    check_finite(bytemuck::cast_slice::<Vec4, [f32; 4]>(&corners.colors), "colour of corner")?;
    check_finite(bytemuck::cast_slice::<Vec4, [f32; 4]>(&corners.tangents), "tangent of corner")?;
    for uvs in &corners.uv_sets {
        exactly("corner texture coordinates", uvs.len(), count)?;
        check_finite(bytemuck::cast_slice::<Vec2, [f32; 2]>(uvs), "texture coordinates of corner")?;
    }
    Ok(())
}

fn check_materials(mesh: &Mesh) -> Result<()> {
    if !mesh.triangle_materials.is_empty() && mesh.triangle_materials.len() != mesh.triangles.len() {
        return Err(wrong_count(
            "materials of triangles",
            mesh.triangles.len() as u64,
            mesh.triangle_materials.len() as u64,
        ));
    }
    for (t, &material) in mesh.triangle_materials.iter().enumerate() {
        below("material of triangle", t, material, mesh.materials.len())?;
    }
    for (index, m) in mesh.materials.iter().enumerate() {
        let cutoff = if let AlphaMode::Mask(cutoff) = m.alpha { cutoff } else { 0.0 };
        let scalars = [m.metallic, m.roughness, m.normal_scale, m.occlusion_strength, cutoff];
        if !(m.base_color.is_finite() && m.emission.is_finite() && scalars.iter().all(|x| x.is_finite())) {
            return Err(not_finite("a factor of material", index));
        }
        if let Some(scale) = &m.toon {
            check_toon(index, scale)?;
        }
    }
    Ok(())
}

/// 1 to [`ToonScale::MAX_STOPS`] stops that ascend.
fn check_toon(index: usize, scale: &ToonScale) -> Result<()> {
    limit("stops of a toon scale", scale.stops.len(), ToonScale::MAX_STOPS)?;
    if scale.stops.is_empty() {
        return Err(wrong_count("stops of a toon scale", 1, 0));
    }
    if !scale.stops.iter().all(|(at, color)| at.is_finite() && color.is_finite()) {
        return Err(not_finite("the toon scale of material", index));
    }
    if !scale.stops.is_sorted_by(|a, b| a.0 <= b.0) {
        return Err(out_of_order("the toon scale of material", index));
    }
    Ok(())
}

/// Colours of corners are left out: what a bake took from them is in its texels, and of a scan they would be most of the section.
pub(crate) fn encode(mesh: &Mesh) -> Vec<u8> {
    let corners = &mesh.corners;
    let mut out = ByteWriter::default();
    out.u32(mesh.positions.len() as u32);
    out.u32(mesh.triangles.len() as u32);
    let flag = |present: bool, flag: u32| if present { flag } else { 0 };
    out.u32(
        flag(!corners.normals.is_empty(), HAS_NORMALS)
            | flag(!corners.tangents.is_empty(), HAS_TANGENTS)
            | flag(!mesh.triangle_materials.is_empty(), HAS_TRIANGLE_MATERIALS)
            | flag(!mesh.parts.names.is_empty(), HAS_PARTS),
    );
    // A set without coordinates is not stored.
    let uv_sets = corners.uv_sets.iter().filter(|uvs| !uvs.is_empty());
    out.u32(uv_sets.clone().count() as u32);
    out.u32(mesh.materials.len() as u32);
    let WorldFromMesh { offset, scale } = mesh.world_from_mesh;
    [offset.x, offset.y, offset.z, scale].into_iter().for_each(|x| out.f64(x));
    out.words(mesh.triangles.iter().copied());
    out.floats(mesh.positions.iter().map(Vec3::to_array));
    out.floats(corners.normals.iter().map(Vec3::to_array));
    out.floats(corners.tangents.iter().map(Vec4::to_array));
    uv_sets.for_each(|uvs| out.floats(uvs.iter().map(Vec2::to_array)));
    out.words(mesh.triangle_materials.iter().map(|&m| [m]));
    mesh.materials.iter().for_each(|m| encode_material(m, &mut out));
    let Parts { names, of_triangle } = &mesh.parts;
    if !names.is_empty() {
        out.u32(names.len() as u32);
        names.iter().for_each(|name| encode_name(name, &mut out));
        out.u32(u32::from(!of_triangle.is_empty()));
        out.words(of_triangle.iter().map(|&part| [part]));
    }
    out.bytes
}

/// A longer name is cut.
fn encode_name(name: &str, out: &mut ByteWriter) {
    let name = &name[..name.floor_char_boundary(MAX_NAME_BYTES)];
    out.u32(name.len() as u32);
    out.put(name.as_bytes());
}

fn decode_name(kind: &str, index: usize, input: &mut ByteReader<'_>) -> Result<String> {
    let length = input.count(MAX_NAME_BYTES, "bytes in a name")?;
    let name = input.take(length, "a name")?;
    std::str::from_utf8(&name)
        .map(str::to_owned)
        .map_err(|_| Error::malformed(format!("the name of {kind} {index} is not valid UTF-8")))
}

fn encode_material(m: &Material, out: &mut ByteWriter) {
    encode_name(&m.name, out);
    out.f32s(&m.base_color.to_array());
    out.f32s(&[m.metallic, m.roughness, m.normal_scale, m.occlusion_strength]);
    out.f32s(&m.emission.to_array());
    let (alpha, cutoff) = match m.alpha.of_asset() {
        AlphaMode::Opaque => (0, 0.0),
        AlphaMode::Mask(cutoff) => (1, cutoff),
        AlphaMode::Blend => (2, 0.0),
    };
    out.f32s(&[cutoff]);
    out.u8(alpha);
    let flag = |is_set: bool, flag: u8| if is_set { flag } else { 0 };
    out.u8(flag(m.double_sided, DOUBLE_SIDED) | flag(m.unlit, UNLIT) | flag(m.toon.is_some(), TOON));
    out.put(&[0; 2]);
    if let Some(scale) = &m.toon {
        encode_toon(scale, out);
    }
}

fn encode_toon(scale: &ToonScale, out: &mut ByteWriter) {
    out.u8(scale.stops.len() as u8);
    out.u8(match scale.interpolation {
        ToonInterpolation::Linear => 0,
        ToonInterpolation::Smooth => 1,
        ToonInterpolation::Constant => 2,
    });
    out.put(&[0; 2]);
    for (at, color) in &scale.stops {
        out.f32s(&[*at, color.x, color.y, color.z]);
    }
}

pub(crate) fn decode(mut input: ByteReader<'_>) -> Result<Mesh> {
    let triangle_limit = MAX_TRIANGLES;
    let vertices = input.count(3 * triangle_limit, "vertices")?;
    let triangles = input.count(triangle_limit, "triangles")?;
    let flags = input.u32("the mesh flags")?;
    below("mesh flags", 0, flags, ALL_FLAGS as usize + 1)?;
    let uv_sets = input.count(MAX_UV_SETS, "texture coordinate sets")?;
    let materials = input.count(MAX_MATERIALS, "materials")?;
    let offset = DVec3::new(
        input.f64("the world offset")?,
        input.f64("the world offset")?,
        input.f64("the world offset")?,
    );
    let world_from_mesh = WorldFromMesh { offset, scale: input.f64("the world scale")? };
    let count = |flag: u32, count: usize| if flags & flag != 0 { count } else { 0 };
    let mesh = Mesh {
        triangles: input.words(triangles, "triangles")?,
        positions: vectors(input.floats(vertices, "position of vertex")?),
        corners: CornerAttributes {
            normals: vectors(input.floats(count(HAS_NORMALS, 3 * triangles), "normal of corner")?),
            colors: vectors(input.floats(count(HAS_COLORS, 3 * triangles), "colour of corner")?),
            tangents: vectors(input.floats(count(HAS_TANGENTS, 3 * triangles), "tangent of corner")?),
            uv_sets: (0..uv_sets)
                .map(|_| Ok(vectors(input.floats(3 * triangles, "texture coordinates of corner")?)))
                .collect::<Result<_>>()?,
        },
        triangle_materials: input
            .words::<1>(count(HAS_TRIANGLE_MATERIALS, triangles), "materials of triangles")?
            .into_iter()
            .map(|[m]| m)
            .collect(),
        materials: (0..materials).map(|i| decode_material(i, &mut input)).collect::<Result<_, _>>()?,
        images: Vec::new(),
        image_places: Vec::new(),
        parts: if flags & HAS_PARTS != 0 { decode_parts(triangles, &mut input)? } else { Parts::default() },
        world_from_mesh,
        undisplaced_bounds: None,
    };
    input.end()?;
    check(&mesh)?;
    Ok(mesh)
}

fn decode_parts(triangles: usize, input: &mut ByteReader<'_>) -> Result<Parts> {
    let count = input.count(MAX_PARTS, "parts")?;
    let names = (0..count).map(|i| decode_name("part", i, input)).collect::<Result<_>>()?;
    let has_list = input.u32("the parts of triangles")?;
    below("the parts of triangles", 0, has_list, 2)?;
    let of_triangle = input.words::<1>(has_list as usize * triangles, "parts of triangles")?;
    Ok(Parts { names, of_triangle: of_triangle.into_iter().map(|[part]| part).collect() })
}

fn vectors<A, V: From<A>>(arrays: Vec<A>) -> Vec<V> {
    arrays.into_iter().map(V::from).collect()
}

fn decode_material(index: usize, input: &mut ByteReader<'_>) -> Result<Material> {
    let what = "a material";
    let name = decode_name("material", index, input)?;
    let base_color = Vec4::from(input.f32s(what)?);
    let [metallic, roughness, normal_scale, occlusion_strength] = input.f32s(what)?;
    let emission = Vec3::from(input.f32s(what)?);
    let cutoff = input.f32(what)?;
    let alpha = match input.u8(what)? {
        0 => AlphaMode::Opaque,
        1 => AlphaMode::Mask(cutoff),
        2 => AlphaMode::Blend,
        code => {
            let value = u64::from(code);
            return Err(out_of_range("alpha mode of material", index, value, 3));
        }
    };
    let flags = input.u8(what)?;
    below("flags of material", index, u32::from(flags), usize::from(DOUBLE_SIDED | UNLIT | TOON) + 1)?;
    input.take(2, what)?;
    let toon = if flags & TOON != 0 { Some(decode_toon(index, input)?) } else { None };
    Ok(Material {
        name,
        base_color,
        metallic,
        roughness,
        normal_scale,
        occlusion_strength,
        emission,
        alpha,
        double_sided: flags & DOUBLE_SIDED != 0,
        unlit: flags & UNLIT != 0,
        toon,
        ..Material::default()
    })
}

fn decode_toon(index: usize, input: &mut ByteReader<'_>) -> Result<ToonScale> {
    let what = "a toon scale";
    let count = input.u8(what)?;
    let interpolation = match input.u8(what)? {
        0 => ToonInterpolation::Linear,
        1 => ToonInterpolation::Smooth,
        2 => ToonInterpolation::Constant,
        code => {
            let value = u64::from(code);
            return Err(out_of_range("toon scale of material", index, value, 3));
        }
    };
    input.take(2, what)?;
    let stop = |_| input.f32s(what).map(|[at, r, g, b]| (at, Vec3::new(r, g, b)));
    Ok(ToonScale { stops: (0..count).map(stop).collect::<Result<_, _>>()?, interpolation })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With a cutoff of 1 decoded texels would be holes.
    #[test]
    fn opaque_texels_pass_every_cutoff_that_they_passed() {
        let texels: Vec<[u8; 4]> =
            (0..64 * 64).map(|i: u32| [(i * 7) as u8, (i / 3) as u8, 90, 255]).collect();
        let extent = [64; 2];
        let blocks = crate::TexelFormat::Bc7;
        let bytes = crate::encode(blocks, crate::Quality::UltraFast, extent, crate::TexelSlice::U8(&texels));
        let decoded = crate::decode(blocks, extent, &bytes.unwrap()).unwrap();
        let least = decoded.iter().map(|texel| texel[3]).fold(1.0, f32::min);
        assert!(least < 1.0, "blocks keep alpha: no cutoff need be lowered");
        let stored = |cutoff: f32| {
            let mut out = ByteWriter::default();
            encode_material(&Material { alpha: AlphaMode::Mask(cutoff), ..Material::default() }, &mut out);
            match decode_material(0, &mut ByteReader::new(&out.bytes)).unwrap().alpha {
                AlphaMode::Mask(cutoff) => cutoff,
                alpha => panic!("{alpha:?}"),
            }
        };
        assert!(stored(1.0) < least && stored(0.9999) < least);
        assert_eq!([0.0, 0.5, 0.98, 1.001].map(stored), [0.0, 0.5, 0.98, 1.001]);
    }

    #[test]
    fn colors_of_corners_that_others_wrote_are_read() {
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            triangles: vec![[0, 1, 2]],
            corners: CornerAttributes { normals: vec![Vec3::Z; 3], ..CornerAttributes::default() },
            materials: vec![Material::default()],
            ..Mesh::default()
        };
        let colors = [Vec4::ONE, Vec4::new(0.25, 0.5, 2.0, 0.0), Vec4::W];
        let mut bytes = encode(&mesh);
        bytes[8] |= HAS_COLORS as u8;
        let mut section = ByteWriter::default();
        section.floats(colors.iter().map(Vec4::to_array));
        // After the counts and the place, triangles, positions and normals.
        let at = 52 + 4 * (3 + 9 + 9);
        bytes.splice(at..at, section.bytes);
        assert_eq!(decode(ByteReader::new(&bytes)).unwrap().corners.colors, colors);
    }
}
