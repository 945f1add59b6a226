//! One mesh many times below one node (EXT_mesh_gpu_instancing).

use glam::{DAffine3, DQuat, DVec3, Quat, Vec3};

use super::accessor::Reader;
use super::scene::affine;
use super::schema::{Instancing, Primitive};
use super::{Document, Error, GltfProblem, get};

/// The extension's name.
pub(super) const EXTENSION: &str = "EXT_mesh_gpu_instancing";

/// Where the instances of `mesh` stand below a node. What an instance is not given is the identity's, and attributes of the file's own
/// (a colour, a number) are left alone.
pub(super) fn node_from_instances(
    document: &Document,
    node: usize,
    mesh: usize,
    instancing: &Instancing,
) -> Result<Vec<DAffine3>, Error> {
    let mut counts = Vec::new();
    for name in ["TRANSLATION", "ROTATION", "SCALE"] {
        if let Some(&index) = instancing.attributes.get(name) {
            let from = || format!("{name} of the instances of node {node}");
            counts.push((name, get(&document.root.accessors, index, "accessor", from)?.count));
        }
    }
    let Some(&first) = counts.first() else { return Ok(vec![DAffine3::IDENTITY]) };
    if let Some(&other) = counts.iter().find(|(_, count)| *count != first.1) {
        return Err(GltfProblem::InstanceCount { node, counts: [first, other] }.into());
    }
    check_triangles(document, mesh, first.1)?;
    let translations = read::<3>(document, instancing, "TRANSLATION", "three floats")?;
    let rotations = read::<4>(document, instancing, "ROTATION", "four floats or normalised integers")?;
    let scales = read::<3>(document, instancing, "SCALE", "three floats")?;
    let vector = |values: &Option<Vec<[f32; 3]>>, index: usize, default| {
        values.as_ref().map_or(default, |values| Vec3::from(values[index]).as_dvec3())
    };
    let turn =
        |index: usize| rotations.as_ref().map_or(DQuat::IDENTITY, |r| Quat::from_array(r[index]).as_dquat());
    let placed = (0..first.1).map(|index| {
        affine(vector(&translations, index, DVec3::ZERO), turn(index), vector(&scales, index, DVec3::ONE))
    });
    Ok(placed.collect())
}

fn read<const N: usize>(
    document: &Document,
    instancing: &Instancing,
    name: &str,
    expected: &'static str,
) -> Result<Option<Vec<[f32; N]>>, GltfProblem> {
    let Some(&accessor) = instancing.attributes.get(name) else { return Ok(None) };
    Reader::new(document, accessor, name)?.read_floats(name, expected, false).map(Some)
}

/// Refuses more triangles than the limit before a list of instances is made: a few letters of JSON can ask for any number of them.
fn check_triangles(document: &Document, mesh: usize, count: usize) -> Result<(), Error> {
    let accessors = &document.root.accessors;
    let corners = |primitive: &Primitive| {
        let accessor = primitive.indices.or_else(|| primitive.attributes.get("POSITION").copied());
        accessor.and_then(|index| accessors.get(index)).map_or(0, |accessor| accessor.count)
    };
    let primitives = &document.root.meshes[mesh].primitives;
    let of_mesh = primitives.iter().fold(0usize, |sum, primitive| sum.saturating_add(corners(primitive) / 3));
    // What has no triangle counts as one, as it takes its place in the list.
    document.file.check_triangles(count.saturating_mul(of_mesh.max(1)))?;
    Ok(())
}
