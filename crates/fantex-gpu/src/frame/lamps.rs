//! Lamps as shaders want them.

use fantex_mesh::WorldFromMesh;
use fantex_scene::{Falloff, LampView, Lens, Light, LightKind, Projector, SpotLight, projector_view};
use glam::{DVec3, Vec3};

use super::records::LampRecord;

/// The records of lamps that have no defect, without their shadow maps. Slides are numbered in the order of the projectors.
pub(super) fn lamp_records(lamps: &[Light], space: &WorldFromMesh) -> Vec<LampRecord> {
    let mut slides = 0..;
    lamps
        .iter()
        .map(|light| {
            let record = LampRecord { color: light.color, ..of_kind(&light.kind, space) };
            let is_projector = matches!(light.kind, LightKind::Projector(_));
            LampRecord { slide: if is_projector { slides.next().unwrap_or(0) } else { 0 }, ..record }
        })
        .collect()
}

fn of_kind(kind: &LightKind, space: &WorldFromMesh) -> LampRecord {
    match kind {
        LightKind::Directional { to_light } => {
            LampRecord { kind: 0, direction: to_light.normalize_or(Vec3::Y), ..LampRecord::default() }
        }
        LightKind::Point { position, falloff } => placed(1, *position, falloff, space),
        LightKind::Spot(light) => spot(light, space),
        LightKind::Projector(light) => projector(light, space),
    }
}

fn placed(kind: u32, position: DVec3, falloff: &Falloff, space: &WorldFromMesh) -> LampRecord {
    let [inverse_reference, inverse_range] = match *falloff {
        Falloff::None => [0.0; 2],
        Falloff::InverseSquare { reference, range } => {
            [1.0 / reference, range.map_or(0.0, |range| 1.0 / range)].map(|v| v as f32)
        }
    };
    let position = space.inverse_point(position);
    LampRecord { kind, position, inverse_reference, inverse_range, ..LampRecord::default() }
}

fn spot(light: &SpotLight, space: &WorldFromMesh) -> LampRecord {
    let [inner, outer] = [light.inner_degrees, light.outer_degrees].map(|a| a.to_radians().cos());
    LampRecord {
        direction: light.direction.normalize_or(Vec3::NEG_Y),
        cosine_outer: outer,
        inverse_cosine_range: 1.0 / (inner - outer).max(1e-4),
        ..placed(2, light.position, &light.falloff, space)
    }
}

fn projector(light: &Projector, space: &WorldFromMesh) -> LampRecord {
    let kind = match light.lens {
        Lens::Perspective { .. } => 3,
        Lens::Orthographic { .. } => 4,
    };
    let view: LampView = projector_view(light, space);
    LampRecord {
        direction: view.forward().as_vec3(),
        slide_from_mesh: view.matrix().as_mat4(),
        ..placed(kind, light.position, &light.falloff, space)
    }
}
