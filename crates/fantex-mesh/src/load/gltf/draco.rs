//! Primitives compressed by Draco (Khronos Group, "KHR_draco_mesh_compression", 2017). The crate `draco-core` decodes them: Rust without
//! `unsafe`, with limits on what is decoded.

use std::fmt::Display;

use draco_core::{DataType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute, PointIndex};
use fantex_base::input::{self, Held};
use fantex_base::{Error, Result};

use super::data::Component;
use super::schema::{Draco, Primitive};
use super::{Document, get};

/// The elements of an accessor, as they were decompressed.
pub(super) struct Unpacked {
    /// Little-endian numbers without gaps.
    pub(super) bytes: Vec<u8>,
    pub(super) component: Component,
    /// Numbers of an element.
    pub(super) width: usize,
    _held: Held,
}

/// Fills in the accessors of a primitive that is there in compressed form only.
pub(super) fn unpack(document: &Document, primitive: &Primitive, label: &str) -> Result<()> {
    let has_data = |index: usize| {
        let accessor = document.root.accessors.get(index);
        accessor.is_none_or(|a| a.buffer_view.is_some() || a.sparse.is_some())
    };
    let Some(draco) = &primitive.extensions.draco else { return Ok(()) };
    if primitive.attributes.get("POSITION").is_none_or(|&positions| has_data(positions)) {
        return Ok(());
    }
    let is_unpacked = |index: usize| document.unpacked.get(index).is_some_and(|cell| cell.get().is_some());
    let mut unpacked = draco.attributes.keys().filter_map(|name| primitive.attributes.get(name));
    if primitive.indices.is_some_and(is_unpacked) && unpacked.all(|&index| is_unpacked(index)) {
        // Its mesh stands in the scene more than once.
        return Ok(());
    }
    let damaged = |why: String| Error::malformed(format!("{label}: its Draco data are damaged: {why}"));
    let mesh = decode(document, draco, label)?;
    let fill = |index: usize, unpacked: Unpacked| {
        get(&document.unpacked, index, "accessor", || label.to_owned())?.get_or_init(|| unpacked);
        Ok(())
    };
    let held = |count: usize, size| input::reserve(label, (count * size) as u64);
    match primitive.indices {
        Some(indices) => {
            let corners = || mesh.faces().iter().flatten();
            let held = held(mesh.num_faces(), 12)?;
            let bytes = corners().flat_map(|point| point.0.to_le_bytes()).collect();
            fill(indices, Unpacked { bytes, component: Component::U32, width: 1, _held: held })?;
        }
        None => {
            return Err(Error::malformed(format!(
                "{label}: compressed triangles need an accessor for indices"
            )));
        }
    }
    for (name, &id) in &draco.attributes {
        let Some(&index) = primitive.attributes.get(name) else { continue };
        let attribute =
            mesh.attribute_by_unique_id(id).ok_or_else(|| damaged(format!("no attribute {id}")))?;
        let component = match attribute.data_type() {
            DataType::Int8 => Component::I8,
            DataType::Uint8 => Component::U8,
            DataType::Int16 => Component::I16,
            DataType::Uint16 => Component::U16,
            DataType::Uint32 => Component::U32,
            DataType::Float32 => Component::F32,
            // Other kinds, which glTF does not have, serve nothing that is read.
            _ => continue,
        };
        let width = usize::from(attribute.num_components());
        let held = held(mesh.num_points(), width * component.size())?;
        let bytes = values(attribute, mesh.num_points(), width * component.size());
        let bytes = bytes.ok_or_else(|| damaged(format!("{name} lacks values")))?;
        fill(index, Unpacked { bytes, component, width, _held: held })?;
    }
    Ok(())
}

fn decode(document: &Document, draco: &Draco, label: &str) -> Result<Mesh> {
    let bytes = document.buffers.view(draco.buffer_view, || label.to_owned())?;
    let limits = &document.file.limits;
    let limits = DecodeLimits::default()
        .with_max_points(limits.max_positions as u64)
        .with_max_faces(limits.max_triangles as u64)
        .with_max_decoded_bytes(input::memory_left());
    let decoded = input::guarded(|| {
        let mut mesh = Mesh::new();
        MeshDecoder::new()
            .decode(&mut DecoderBuffer::new(bytes).with_limits(limits), &mut mesh)
            .map(|()| mesh)
    });
    let unread = |why: &dyn Display| Error::malformed(format!("{label}: its Draco data are not read: {why}"));
    decoded.ok_or_else(|| unread(&"they are damaged"))?.map_err(|error| unread(&error))
}

/// Of all points, where each has one.
fn values(attribute: &PointAttribute, points: usize, size: usize) -> Option<Vec<u8>> {
    let data = attribute.buffer().data();
    let stride = usize::try_from(attribute.byte_stride()).ok()?;
    let mut values = Vec::with_capacity(points * size);
    for point in 0..points as u32 {
        let start = (attribute.mapped_index(PointIndex(point)).0 as usize).checked_mul(stride)?;
        values.extend_from_slice(data.get(start..start.checked_add(size)?)?);
    }
    Some(values)
}
