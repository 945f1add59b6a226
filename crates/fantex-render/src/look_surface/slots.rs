//! The values of all slots of a material.

use fantex_texture::ShadingPoint;
use fantex_texture::look::{LookMaterial, Slot};
use glam::Vec4;

/// One `T` for every slot of a material that the shading reads at every point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slots<T> {
    pub(super) base_color: T,
    pub(super) metallic: T,
    pub(super) roughness: T,
    pub(super) occlusion: T,
    pub(super) ambient: T,
    pub(super) specular: T,
    pub(super) shininess: Option<T>,
    pub(super) emission: T,
    pub(super) reflection: T,
    pub(super) light_map: Option<T>,
    pub(super) modulate: Option<T>,
}

impl<T> Slots<T> {
    /// What `of` gives for each.
    pub(super) fn new(material: &LookMaterial, mut of: impl FnMut(&Slot) -> T) -> Self {
        Self {
            base_color: of(&material.base_color),
            metallic: of(&material.metallic),
            roughness: of(&material.roughness),
            occlusion: of(&material.occlusion),
            ambient: of(&material.ambient),
            specular: of(&material.specular),
            shininess: material.shininess.as_ref().map(&mut of),
            emission: of(&material.emission),
            reflection: of(&material.reflection),
            light_map: material.light_map.as_ref().map(&mut of),
            modulate: material.modulate.as_ref().map(&mut of),
        }
    }
}

/// The values of a slot at many points.
#[derive(Debug)]
pub(super) enum Column {
    Same(Vec4),
    Each(Vec<Vec4>),
}

impl Column {
    pub(super) fn new(slot: &Slot, at: &[ShadingPoint<'_>]) -> Self {
        match slot {
            Slot::Constant(value) => Self::Same(*value),
            Slot::Texture(texture) => {
                let mut values = vec![Vec4::ZERO; at.len()];
                texture.evaluate_all(at, &mut values);
                Self::Each(values)
            }
        }
    }

    fn value(&self, index: usize) -> Vec4 {
        match self {
            Self::Same(value) => *value,
            Self::Each(values) => values[index],
        }
    }
}

impl Slots<Column> {
    /// The values at one of the points.
    pub(super) fn at(&self, index: usize) -> Slots<Vec4> {
        let value = |column: &Column| column.value(index);
        Slots {
            base_color: value(&self.base_color),
            metallic: value(&self.metallic),
            roughness: value(&self.roughness),
            occlusion: value(&self.occlusion),
            ambient: value(&self.ambient),
            specular: value(&self.specular),
            shininess: self.shininess.as_ref().map(value),
            emission: value(&self.emission),
            reflection: value(&self.reflection),
            light_map: self.light_map.as_ref().map(value),
            modulate: self.modulate.as_ref().map(value),
        }
    }
}
