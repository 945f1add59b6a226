//! Shaders, joined from files.
//!
//! WGSL has no includes, so a module is the concatenation of its parts: [`compose`]. What a part states is visible in all
//! others of the module, so names are unique over all files of `shaders/`.

/// Group 0 of frames, records of lamps and shadow maps, offsets from the eye.
pub const FRAME: &str = include_str!("shaders/frame.wgsl");

/// Light from the surroundings. Needs [`FRAME`].
pub const ENVIRONMENT: &str = include_str!("shaders/environment.wgsl");

/// Light from lamps, shadows, `SurfacePoint`. Needs [`FRAME`].
pub const LAMPS: &str = include_str!("shaders/lamps.wgsl");

/// `MaterialSample` and `shade`. Needs [`FRAME`], [`ENVIRONMENT`] and [`LAMPS`].
pub const SHADING: &str = include_str!("shaders/shading.wgsl");

/// Group 0 of shadow maps. Stands alone.
pub const CASTER: &str = include_str!("shaders/caster.wgsl");

/// The texture function: `tile_sample`, `fan_weights`, `fan_mesh_normal`. Needs [`SURFACE`]; group 1 is
/// [`FanModel::texture_group`](crate::FanModel::texture_group).
pub const FAN: [&str; 4] =
    [FAN_LOOKUP, FAN_GEOMETRY, include_str!("shaders/fan_finish.wgsl"), include_str!("shaders/fan.wgsl")];

/// What shaders of surfaces begin with.
pub const SURFACE: [&str; 4] = [FRAME, ENVIRONMENT, LAMPS, SHADING];

pub(crate) const SKY: &str = include_str!("shaders/sky.wgsl");
pub(crate) const TONE: &str = include_str!("shaders/tone.wgsl");
pub(crate) const LINES: &str = include_str!("shaders/lines.wgsl");
pub(crate) const UV_MATERIAL: &str = include_str!("shaders/uv_material.wgsl");
pub(crate) const UV: &str = include_str!("shaders/uv.wgsl");
pub(crate) const FAN_LOOKUP: &str = include_str!("shaders/fan_lookup.wgsl");
pub(crate) const FAN_GEOMETRY: &str = include_str!("shaders/fan_geometry.wgsl");
pub(crate) const FAN_COLORS: &str = include_str!("shaders/fan_colors.wgsl");
pub(crate) const FAN_ATLAS: &str = include_str!("shaders/fan_atlas.wgsl");
pub(crate) const FAN_CASTER: &str = include_str!("shaders/fan_caster.wgsl");
pub(crate) const UV_CASTER: &str = include_str!("shaders/uv_caster.wgsl");

/// The source of a module.
pub fn compose(parts: &[&str]) -> String {
    parts.concat()
}

/// The source of a surface's module: [`SURFACE`] and its own parts.
pub fn compose_surface(parts: &[&str]) -> String {
    compose(&[&SURFACE[..], parts].concat())
}

/// A module of the device.
pub fn module(device: &wgpu::Device, label: &str, source: &str) -> wgpu::ShaderModule {
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    })
}

/// All modules of this crate by name, for checks.
pub fn all() -> Vec<(&'static str, String)> {
    vec![
        ("sky", compose(&[FRAME, ENVIRONMENT, SKY])),
        ("tone", compose(&[FRAME, TONE])),
        ("lines", compose(&[FRAME, LINES])),
        ("uv", compose_surface(&[UV_MATERIAL, UV])),
        ("fan", compose_surface(&FAN)),
        ("fan_colors", compose_surface(&[FAN_LOOKUP, FAN_GEOMETRY, FAN_COLORS])),
        ("fan_atlas", FAN_ATLAS.to_owned()),
        ("fan_caster", compose(&[CASTER, FAN_LOOKUP, FAN_GEOMETRY, FAN_CASTER])),
        ("uv_caster", compose(&[CASTER, UV_MATERIAL, UV_CASTER])),
    ]
}

#[cfg(test)]
pub(crate) mod layout_check {
    //! Whether records are laid out as shaders read them.

    use wgpu::naga::{TypeInner, front::wgsl};

    use super::all;

    /// Names and offsets of a record's members.
    macro_rules! fields {
        ($record:ty: $($field:ident),* $(,)?) => {
            &[$((stringify!($field), std::mem::offset_of!($record, $field))),*]
        };
    }
    pub(crate) use fields;

    /// Compares size and offsets of a record with those of a struct of a module. Members that begin with `pad` need no
    /// counterpart.
    #[track_caller]
    pub(crate) fn assert_same_layout(module: &str, name: &str, size: usize, fields: &[(&str, usize)]) {
        let (_, source) = all().into_iter().find(|(label, _)| *label == module).unwrap();
        let parsed = wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(&source)));
        let (_, ty) = parsed.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).unwrap();
        let TypeInner::Struct { members, span } = &ty.inner else { panic!("{name} is no struct") };
        let shader: Vec<_> = members
            .iter()
            .map(|m| (m.name.as_deref().unwrap(), m.offset as usize))
            .filter(|(name, _)| !name.starts_with("pad"))
            .collect();
        assert_eq!(shader, fields, "members of {name}");
        assert_eq!(*span as usize, size, "size of {name}");
    }
}
