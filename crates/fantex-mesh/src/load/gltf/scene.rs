//! The node hierarchy: which meshes stand where.

use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::schema::Node;
use super::{Document, Error, GltfProblem, get, instancing};
use crate::counted;

/// A mesh placed in the world.
pub(super) struct MeshInstance {
    pub(super) mesh: usize,
    pub(super) world_from_mesh: DAffine3,
}

/// Walks the default scene depth first, children in their order.
pub(super) fn mesh_instances(
    document: &Document,
    notes: &mut Vec<String>,
) -> Result<Vec<MeshInstance>, Error> {
    let nodes = &document.root.nodes;
    let roots = scene_roots(document, notes)?;
    let mut is_reached = vec![false; nodes.len()];
    let mut instances = Vec::new();
    let mut pending: Vec<(usize, DAffine3)> =
        roots.into_iter().rev().map(|root| (root, DAffine3::IDENTITY)).collect();
    let mut skinned = 0;
    while let Some((index, world_from_parent)) = pending.pop() {
        let node = get(nodes, index, "node", || "the node hierarchy".to_owned())?;
        if std::mem::replace(&mut is_reached[index], true) {
            return Err(GltfProblem::NodeReachedTwice { node: index }.into());
        }
        let world_from_node = world_from_parent * parent_from_node(node);
        if let Some(mesh) = node.mesh {
            get(&document.root.meshes, mesh, "mesh", || format!("node {index}"))?;
            skinned += usize::from(node.skin.is_some());
            match &node.extensions.instancing {
                None => instances.push(MeshInstance { mesh, world_from_mesh: world_from_node }),
                Some(instancing) => {
                    let placed = instancing::node_from_instances(document, index, mesh, instancing)?;
                    instances.extend(placed.into_iter().map(|node_from_mesh| MeshInstance {
                        mesh,
                        world_from_mesh: world_from_node * node_from_mesh,
                    }));
                }
            }
        }
        pending.extend(node.children.iter().rev().map(|&child| (child, world_from_node)));
    }
    if skinned > 0 {
        notes.push(format!("read {} as modelled, without skeleton", counted(skinned, "skinned mesh")));
    }
    Ok(instances)
}

/// Root nodes of the default scene; without scenes all nodes that are nobody's child.
fn scene_roots(document: &Document, notes: &mut Vec<String>) -> Result<Vec<usize>, GltfProblem> {
    let root = document.root;
    if root.scene.is_none() && root.scenes.is_empty() {
        let mut is_child = vec![false; root.nodes.len()];
        for &child in root.nodes.iter().flat_map(|node| &node.children) {
            get(&root.nodes, child, "node", || "the node hierarchy".to_owned())?;
            is_child[child] = true;
        }
        return Ok((0..root.nodes.len()).filter(|&node| !is_child[node]).collect());
    }
    let index = root.scene.unwrap_or(0);
    let scene = get(&root.scenes, index, "scene", || "the file".to_owned())?;
    if root.scenes.len() > 1 {
        notes.push(format!("only scene {index} of {} was loaded", root.scenes.len()));
    }
    Ok(scene.nodes.clone())
}

fn parent_from_node(node: &Node) -> DAffine3 {
    if let Some(matrix) = &node.matrix {
        return DAffine3::from_mat4(DMat4::from_cols_array(matrix));
    }
    affine(
        node.translation.map_or(DVec3::ZERO, DVec3::from),
        node.rotation.map_or(DQuat::IDENTITY, DQuat::from_array),
        node.scale.map_or(DVec3::ONE, DVec3::from),
    )
}

/// Scale first, then rotation, then translation.
pub(super) fn affine(translation: DVec3, rotation: DQuat, scale: DVec3) -> DAffine3 {
    // Exporters write rotations with few digits; a zero one means none.
    let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
    DAffine3::from_scale_rotation_translation(scale, rotation, translation)
}
