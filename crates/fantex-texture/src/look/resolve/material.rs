//! Materials.

use std::sync::Arc;

use fantex_look::data::{
    AnisotropyTable, ColorUseName, DifferenceName, Input, LightingName, MaterialBase, MaterialTable,
    NormalMapTable, NormalSpaceName, OpacityName,
};
use fantex_look::{Key, LookProblem};

use super::convert;
use super::{Made, Resolver};
use crate::Texture;
use crate::look::{
    Anisotropy, ColorUse, Difference, LightingModel, LookMaterial, NormalSpace, Opacity, Relief, Slot,
};

impl Resolver<'_> {
    /// The material of a name. `base` is the one that the model has at the place, for materials that start from it.
    ///
    /// # Errors
    ///
    /// There is no such material, or one of its textures cannot be made.
    pub fn material(&mut self, name: &str, base: &LookMaterial) -> Made<LookMaterial> {
        let Some(table) = self.file.look().materials.get(name) else {
            let known = self.file.look().materials.keys().cloned().collect();
            let problem =
                LookProblem::Undefined { what: "material", name: name.to_owned(), nearest: None, known };
            return self.refuse(&Key::default(), problem);
        };
        self.material_of(table, &Key::of(["materials", name]), base)
    }

    fn material_of(&mut self, table: &MaterialTable, key: &Key, base: &LookMaterial) -> Made<LookMaterial> {
        let mut material = match table.from {
            MaterialBase::Default => LookMaterial::default(),
            MaterialBase::Model => base.clone(),
        };
        self.slots(table, key, &mut material)?;
        if let Some(lighting) = table.lighting {
            material.lighting = match lighting {
                LightingName::MetallicRoughness => LightingModel::MetallicRoughness,
                LightingName::BlinnPhong => LightingModel::BlinnPhong,
                LightingName::Unlit => LightingModel::Unlit,
            };
        }
        if let Some(color_use) = table.color_use {
            material.color_use = match color_use {
                ColorUseName::APriori => ColorUse::APriori,
                ColorUseName::Modulate => ColorUse::Modulate,
                ColorUseName::Replace => ColorUse::Replace,
            };
        }
        if let Some(opacity) = table.opacity {
            material.opacity = match opacity {
                OpacityName::Opaque => Opacity::Opaque,
                OpacityName::Mask => Opacity::Mask { threshold: table.threshold as f32 },
                OpacityName::Blend => Opacity::Blend,
            };
        }
        if let Some(toon) = &table.toon {
            let ramp = convert::ramp(&toon.stops, toon.interpolation);
            material.toon = Some(Arc::new(self.accept(&key.name("toon").name("stops"), ramp)?));
        }
        if let Some(anisotropy) = &table.anisotropy {
            material.anisotropy = Some(self.anisotropy(anisotropy, &key.name("anisotropy"))?);
        }
        material.double_sided = table.double_sided.unwrap_or(material.double_sided);
        self.relief(table, key, &mut material.relief)?;
        Ok(material)
    }

    fn slots(&mut self, table: &MaterialTable, key: &Key, material: &mut LookMaterial) -> Made<()> {
        let slots: [(&str, &Option<Input>, &mut Slot); 9] = [
            ("base_color", &table.base_color, &mut material.base_color),
            ("alpha", &table.alpha, &mut material.alpha),
            ("metallic", &table.metallic, &mut material.metallic),
            ("roughness", &table.roughness, &mut material.roughness),
            ("occlusion", &table.occlusion, &mut material.occlusion),
            ("ambient", &table.ambient, &mut material.ambient),
            ("specular", &table.specular, &mut material.specular),
            ("emission", &table.emission, &mut material.emission),
            ("reflection", &table.reflection, &mut material.reflection),
        ];
        for (name, input, slot) in slots {
            if let Some(input) = input {
                *slot = self.input(input, &key.name(name))?;
            }
        }
        let optional: [(&str, &Option<Input>, &mut Option<Slot>); 3] = [
            ("shininess", &table.shininess, &mut material.shininess),
            ("light_map", &table.light_map, &mut material.light_map),
            ("modulate", &table.modulate, &mut material.modulate),
        ];
        for (name, input, slot) in optional {
            if let Some(input) = input {
                *slot = Some(self.input(input, &key.name(name))?);
            }
        }
        Ok(())
    }

    /// What bends the normal: a normal map replaces the model's, bumps are added to what there is.
    fn relief(&mut self, table: &MaterialTable, key: &Key, relief: &mut Vec<Relief>) -> Made<()> {
        if let Some(map) = &table.normal_map {
            relief.retain(|r| !matches!(r, Relief::Normal { .. }));
            relief.insert(0, self.normal_map(map, &key.name("normal_map"))?);
        }
        if let Some(bump) = &table.bump {
            relief.push(Relief::Bump {
                texture: self.relief_texture(&bump.texture, &key.name("bump"))?,
                height: bump.height as f32,
                difference: match bump.difference {
                    DifferenceName::Forward => Difference::Forward,
                    DifferenceName::Backward => Difference::Backward,
                    DifferenceName::Central => Difference::Central,
                },
            });
        }
        if let Some(derivatives) = &table.derivatives {
            relief.push(Relief::Derivatives {
                texture: self.relief_texture(&derivatives.texture, &key.name("derivatives"))?,
                uv_set: derivatives.set as usize,
                height: derivatives.height as f32,
                range: derivatives.range as f32,
            });
        }
        Ok(())
    }

    fn normal_map(&mut self, table: &NormalMapTable, key: &Key) -> Made<Relief> {
        Ok(Relief::Normal {
            texture: self.relief_texture(&table.texture, key)?,
            scale: table.scale as f32,
            space: match table.space {
                NormalSpaceName::Tangent => NormalSpace::Tangent { uv_set: table.set as usize },
                NormalSpaceName::Object => NormalSpace::Object,
            },
        })
    }

    fn relief_texture(&mut self, input: &Input, key: &Key) -> Made<Arc<dyn Texture>> {
        Ok(match self.input(input, &key.name("texture"))? {
            Slot::Constant(value) => Arc::new(value),
            Slot::Texture(texture) => texture,
        })
    }

    fn anisotropy(&mut self, table: &AnisotropyTable, key: &Key) -> Made<Anisotropy> {
        Ok(Anisotropy {
            strength: self.input(&table.strength, &key.name("strength"))?,
            direction: self.input(&table.direction, &key.name("direction"))?,
            uv_set: table.set as usize,
        })
    }

    /// The height texture of a material's displacement, if it has one: red, times `height`, in world units.
    ///
    /// # Errors
    ///
    /// The texture cannot be made.
    pub fn displacement(&mut self, name: &str) -> Made<Option<Slot>> {
        let file = self.file;
        let table = file.look().materials.get(name).and_then(|m| m.displacement.as_ref());
        let key = Key::of(["materials", name, "displacement", "texture"]);
        table.map(|table| self.input(&table.texture, &key)).transpose()
    }
}
