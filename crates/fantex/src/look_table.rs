//! Textures of looks as tables of numbers.

use std::sync::Arc;

use fantex_base::{Error, Result};
use fantex_look::{LookFile, LookImages, ResolveOptions, Resolver};
use fantex_texture::{Filtering, ShadingPoint, Tabulation, Texture, UvPoint};
use glam::{DVec3, Vec2, Vec3, Vec4};

/// A texture of a look that is to become a table, and its name; the only one where none is named.
///
/// # Errors
/// The look has no such texture, or several and none is named; it cannot be made, or depends on the eye.
pub fn look_texture(
    file: &LookFile,
    name: Option<&str>,
    options: ResolveOptions,
) -> Result<(String, Arc<dyn Texture>)> {
    let names: Vec<&String> = file.look().textures.keys().collect();
    let name = match (name, names.as_slice()) {
        (Some(name), _) => name,
        (None, [only]) => only.as_str(),
        (None, _) => {
            let names: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
            let sentence = format!(
                "{} has {} textures; say which with --texture: {}",
                file.path().display(),
                names.len(),
                names.join(", ")
            );
            return Err(Error::invalid(sentence));
        }
    };
    let images = LookImages::default();
    let texture = Resolver::without_model(file, &images, options).texture(name)?;
    if texture.is_view_dependent() {
        let sentence = format!("the texture {name} depends on the eye, and a table has none");
        return Err(Error::invalid(sentence));
    }
    Ok((name.to_owned(), texture))
}

/// A box of object space, and how densely a texture is tabulated in it. Texture coordinates go from 0 to 1 over columns and rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookTable {
    /// Columns, rows and slices.
    pub size: [u32; 3],
    /// Where columns, rows and slices begin. A single slice lies at its z.
    pub from: DVec3,
    /// Where they end.
    pub to: DVec3,
    /// Samples per texel along columns and rows; their mean is the texel.
    pub samples: u32,
    /// Seconds since the start of an animation.
    pub time: f32,
    /// Bytes that a slice may take.
    pub memory_bytes: u64,
}

impl Default for LookTable {
    /// The front of a cube of edge 1, the first row on top: 512 x 512 texels of one sample each, within 1 GiB.
    fn default() -> Self {
        Self {
            size: [512, 512, 1],
            from: DVec3::new(-0.5, 0.5, 0.0),
            to: DVec3::new(0.5, -0.5, 0.0),
            samples: 1,
            time: 0.0,
            memory_bytes: 1 << 30,
        }
    }
}

impl LookTable {
    /// A slice, counted from 0: linear RGBA, row by row.
    ///
    /// # Errors
    /// There is nothing to tabulate, or too much.
    pub fn slice(&self, texture: &dyn Texture, number: u32) -> Result<Vec<[f32; 4]>> {
        let [width, height, slices] = self.size;
        let grid =
            Tabulation { size: [width, height, 1], samples: self.samples, memory_bytes: self.memory_bytes };
        let z = (number as f32 + 0.5) / slices as f32;
        let [across, down, _] = grid.sample_counts();
        // Of what a sample stands for, along columns and rows.
        let side = |texels: u32, samples: u32| 1.0 / (texels as f32 * samples as f32);
        let steps = [Vec2::new(side(width, across), 0.0), Vec2::new(0.0, side(height, down))];
        grid.texels(|[u, v, _]| self.value(texture, Vec3::new(u, v, z), steps).to_array())
    }

    /// `at` is in `0..1` along each axis, and so are the `steps` along columns and rows.
    fn value(&self, texture: &dyn Texture, at: Vec3, steps: [Vec2; 2]) -> Vec4 {
        let [_, _, slices] = self.size;
        let (from, extent) = (self.from.as_vec3(), (self.to - self.from).as_vec3());
        let extent = if slices == 1 { extent * Vec3::new(1.0, 1.0, 0.0) } else { extent };
        texture.evaluate(&ShadingPoint {
            position: from + extent * at,
            position_steps: steps.map(|step| extent * step.extend(0.0)),
            normal: Vec3::Z,
            normal_steps: [Vec3::ZERO; 2],
            uv: &[UvPoint { uv: at.truncate(), steps }],
            vertex_color: Vec4::ONE,
            eye: None,
            time: self.time,
            filtering: Filtering::Area,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How far a sample reaches.
    struct Steps;

    impl Texture for Steps {
        fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
            let [across, down] = at.uv[0].steps;
            Vec4::new(across.x, down.y, 0.0, 1.0)
        }
    }

    #[test]
    fn a_sample_stands_for_its_share_of_a_texel() {
        let steps = |size, samples| {
            let table = LookTable { size, samples, ..LookTable::default() };
            table.slice(&Steps, 0).unwrap()[0]
        };
        assert_eq!(steps([8, 4, 1], 2), [1.0 / 16.0, 1.0 / 8.0, 0.0, 1.0]);
        // Along a single texel there is a single sample.
        assert_eq!(steps([1, 4, 1], 2), [1.0, 1.0 / 8.0, 0.0, 1.0]);
    }
}
