//! The pose in which a file shows its meshes: morph targets by their weights, skins by where their joints stand.

use fantex_base::input::{self, Held};
use fantex_base::{Error, Result, counted};
use glam::{DAffine3, DMat3, DMat4, DVec3, Mat4};

use super::data::Reader;
use super::schema::{Node, Primitive, Root};
use super::{Document, get};

/// Morph targets whose weight is not zero; more would be work without end for a few letters of JSON.
const MAX_TARGETS: usize = 256;

/// What colours of vertices are made of.
pub(super) const COLORS: &str = "three or four floats or integers";

/// Where the vertices of a primitive stand.
pub(super) enum Placement {
    /// World from mesh.
    Rigid(DAffine3),
    /// World from mesh, of each vertex.
    Skinned { of_vertex: Vec<DAffine3>, _held: Held },
}

impl Placement {
    /// World from mesh at a vertex.
    pub(super) fn at(&self, vertex: usize) -> &DAffine3 {
        match self {
            Self::Rigid(world_from_mesh) => world_from_mesh,
            Self::Skinned { of_vertex, .. } => &of_vertex[vertex],
        }
    }

    /// That of a primitive whose mesh has a skin: the mean of its joints, by weight (Khronos, "glTF 2.0", 3.7.3.3).
    pub(super) fn skinned(
        document: &Document,
        primitive: &Primitive,
        label: &str,
        world_from_bind: &[DAffine3],
        count: usize,
    ) -> Result<Self> {
        const ZERO: DAffine3 = DAffine3 { matrix3: DMat3::ZERO, translation: DVec3::ZERO };
        // The sums, and four joints and weights at a time.
        let bytes = size_of::<(DAffine3, f64)>() + 2 * size_of::<[f32; 4]>();
        let held = input::reserve(label, (count as u64).saturating_mul(bytes as u64))?;
        let mut sums = vec![(ZERO, 0.0); count];
        for set in 0..2 {
            let names = [format!("JOINTS_{set}"), format!("WEIGHTS_{set}")];
            let [Some(&joints), Some(&weights)] = names.each_ref().map(|name| primitive.attributes.get(name))
            else {
                continue;
            };
            let read = |accessor: usize, name: &str, is_weight: bool| {
                let reader = Reader::new(document, accessor, label)?;
                check_count(label, name, reader.count(), count)?;
                reader.read_floats::<4>(name, "four numbers", is_weight)
            };
            let (joints, weights) = (read(joints, &names[0], false)?, read(weights, &names[1], true)?);
            for ((sum, joints), weights) in sums.iter_mut().zip(joints).zip(weights) {
                for (joint, weight) in joints.into_iter().zip(weights).filter(|(_, weight)| *weight != 0.0) {
                    let bind = world_from_bind.get(joint as usize).ok_or_else(|| {
                        let joints = counted(world_from_bind.len(), "joint");
                        Error::malformed(format!(
                            "{label} refers to joint {joint} of its skin, which has {joints}"
                        ))
                    })?;
                    let weight = f64::from(weight);
                    sum.0.matrix3 += bind.matrix3 * weight;
                    sum.0.translation += bind.translation * weight;
                    sum.1 += weight;
                }
            }
        }
        let first = world_from_bind.first().copied().unwrap_or(DAffine3::IDENTITY);
        let mean = |(sum, total): (DAffine3, f64)| match total > 0.0 {
            true => DAffine3 { matrix3: sum.matrix3 * total.recip(), translation: sum.translation / total },
            false => first,
        };
        Ok(Self::Skinned { of_vertex: sums.into_iter().map(mean).collect(), _held: held })
    }
}

fn check_count(label: &str, name: &str, found: usize, count: usize) -> Result<()> {
    if found == count {
        return Ok(());
    }
    let (count, found) = (counted(count, "position"), counted(found, "value"));
    Err(Error::malformed(format!("{label} has {count}, but {found} of {name}")))
}

/// World from mesh for each joint of a skin, in the pose in which it was bound; none where a joint stands nowhere in the scene.
pub(super) fn world_from_bind(
    document: &Document,
    skin: usize,
    world_from_node: &[Option<DAffine3>],
) -> Result<Option<Vec<DAffine3>>> {
    let Root { skins, nodes, .. } = document.root;
    let name = format!("skin {skin}");
    let skin = get(skins, skin, "skin", || "a node".to_owned())?;
    let mut found = Vec::with_capacity(skin.joints.len());
    for &joint in &skin.joints {
        let _: &Node = get(nodes, joint, "node", || name.clone())?;
        let Some(world_from_joint) = world_from_node[joint] else { return Ok(None) };
        found.push(world_from_joint);
    }
    let Some(accessor) = skin.inverse_bind_matrices else { return Ok(Some(found)) };
    let reader = Reader::new(document, accessor, &name)?;
    if reader.count() < found.len() {
        let (joints, matrices) = (counted(found.len(), "joint"), reader.count());
        return Err(Error::malformed(format!("{name} has {joints}, but {matrices} inverseBindMatrices")));
    }
    document.file.check_positions(reader.count())?;
    let matrices = reader.read_floats::<16>("inverseBindMatrices", "matrices of 4 x 4 floats", false)?;
    for (world_from_joint, joint_from_bind) in found.iter_mut().zip(matrices) {
        let joint_from_bind: DMat4 = Mat4::from_cols_array(&joint_from_bind).as_dmat4();
        *world_from_joint *= DAffine3::from_mat4(joint_from_bind);
    }
    Ok(Some(found))
}

/// Adds the morph targets of an attribute to its values, by their weights. Colours end between 0 and 1.
pub(super) fn morph<const N: usize>(
    document: &Document,
    (primitive, label): (&Primitive, &str),
    weights: &[f64],
    name: &str,
    values: &mut [[f32; N]],
) -> Result<()> {
    let targets = primitive.targets.iter().zip(weights).filter(|(_, weight)| **weight != 0.0);
    if targets.clone().count() > MAX_TARGETS {
        let sentence = format!("{label} has more than {MAX_TARGETS} morph targets that have weights");
        return Err(Error::too_large(sentence));
    }
    let kind = name.split('_').next();
    let mut is_morphed = false;
    for (target, &weight) in targets {
        let Some(&accessor) = target.get(name) else { continue };
        let reader = Reader::new(document, accessor, label)?;
        check_count(label, &format!("the morph target's {name}"), reader.count(), values.len())?;
        let weight = weight as f32;
        match kind {
            Some("TEXCOORD") => {
                add(values, reader.read_floats::<2>(name, "two floats or integers", false)?, weight);
            }
            Some("COLOR") if reader.width == 4 => {
                add(values, reader.read_floats::<4>(name, COLORS, true)?, weight);
            }
            Some("COLOR") => add(values, reader.read_floats::<3>(name, COLORS, true)?, weight),
            _ => add(values, reader.read_floats::<3>(name, "three floats or integers", false)?, weight),
        }
        is_morphed = true;
    }
    if is_morphed && kind == Some("COLOR") {
        values.iter_mut().flatten().for_each(|value| *value = value.clamp(0.0, 1.0));
    }
    Ok(())
}

/// Adds the steps of a morph target to the numbers of an attribute that it has.
fn add<const N: usize, const STEPS: usize>(values: &mut [[f32; N]], steps: Vec<[f32; STEPS]>, weight: f32) {
    for (value, step) in values.iter_mut().zip(steps) {
        value.iter_mut().zip(step).for_each(|(value, step)| *value += weight * step);
    }
}
