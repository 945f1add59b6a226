//! From the lamps of a scene to the light that arrives at a point.

use fantex_base::Result;
use fantex_mesh::Mesh;
use fantex_scene::{
    AmbientLight, ConeFalloff, Cookie, Falloff, LampView, Light, LightKind, Lights, Projector, SpotLight,
    projector_view,
};
use glam::{DVec3, Vec2, Vec3};

use crate::primitive::reserve_drawing;
use crate::shadow::{Receiver, ShadowMaps, ShadowPlan};
use crate::{Hit, Lens, RenderOptions, Surface};

/// The lights of a scene, in mesh space and with their shadow maps.
#[derive(Debug)]
pub(crate) struct PreparedLights<'a> {
    pub(crate) ambient: &'a AmbientLight,
    lamps: Vec<Lamp<'a>>,
    /// The lamps, if all are of this kind and the surroundings are two colours.
    distant: Option<Vec<DistantLamp>>,
    are_local: bool,
    world_per_mesh: f32,
    time: f32,
}

#[derive(Debug)]
struct Lamp<'a> {
    source: Source<'a>,
    color: Vec3,
    shadow: Option<ShadowMaps>,
}

/// A lamp infinitely far away, without shadow.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DistantLamp {
    /// A unit vector.
    pub(crate) to_light: Vec3,
    /// Linear RGB.
    pub(crate) color: Vec3,
}

impl DistantLamp {
    fn of(lamp: &Lamp<'_>) -> Option<Self> {
        match (&lamp.source, &lamp.shadow) {
            (&Source::Directional { to_light }, None) => Some(Self { to_light, color: lamp.color }),
            _ => None,
        }
    }
}

/// Mesh space.
#[derive(Debug)]
enum Source<'a> {
    /// A unit vector.
    Directional {
        to_light: Vec3,
    },
    Point {
        position: Vec3,
        falloff: Falloff,
    },
    Spot {
        position: Vec3,
        light: &'a SpotLight,
        cone: ConeFalloff,
    },
    Projector {
        view: LampView,
        projector: &'a Projector,
    },
}

#[derive(Clone, Copy, Debug)]
struct LitPoint {
    /// Mesh space.
    position: Vec3,
    receiver: Receiver,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Illumination<'a> {
    pub(crate) ambient: &'a AmbientLight,
    lights: &'a PreparedLights<'a>,
    point: Option<LitPoint>,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Incoming {
    /// Unit vector.
    pub(crate) to_light: Vec3,
    /// Linear RGB, without shadow.
    pub(crate) color: Vec3,
    /// Share that no shadow takes away, 0..1.
    pub(crate) visibility: f32,
}

impl<'a> PreparedLights<'a> {
    /// Prepares lights that passed [`check_lamps`](crate::render::check_lamps) for a mesh and draws their shadow maps; prepares no
    /// lamps for pictures that show no light.
    ///
    /// # Errors
    /// Shadow maps take more memory than is left.
    pub(crate) fn new(
        lights: &'a Lights,
        mesh: &Mesh,
        surface: &dyn Surface,
        options: &RenderOptions,
    ) -> Result<Self> {
        let shining = if options.shading.is_lit() { &lights.lamps[..] } else { &[] };
        // What is too large is refused before the first map is drawn.
        let plan = |(index, light)| ShadowPlan::new(index, light, mesh, surface);
        let plans = shining.iter().enumerate().map(plan).collect::<Result<Vec<_>>>()?;
        let _drawing = plans.iter().any(Option::is_some).then(|| reserve_drawing(mesh)).transpose()?;
        let lamp = |(light, plan): (&'a Light, Option<ShadowPlan>)| Lamp {
            source: Source::new(&light.kind, mesh),
            color: light.color,
            shadow: plan.map(|plan| plan.draw(mesh, surface)),
        };
        let lamps: Vec<Lamp> = shining.iter().zip(plans).map(lamp).collect();
        let is_local =
            |lamp: &Lamp| lamp.shadow.is_some() || !matches!(lamp.source, Source::Directional { .. });
        let is_plain = lights.ambient.environment.is_none();
        Ok(Self {
            ambient: &lights.ambient,
            distant: if is_plain { lamps.iter().map(DistantLamp::of).collect() } else { None },
            are_local: lamps.iter().any(is_local),
            lamps,
            world_per_mesh: mesh.world_from_mesh.scale as f32,
            time: options.time,
        })
    }

    /// The lamps, if all are infinitely far away and cast no shadow, and the surroundings are two colours: then the light is
    /// the same everywhere.
    pub(crate) fn distant(&self) -> Option<&[DistantLamp]> {
        self.distant.as_deref()
    }

    pub(crate) fn at(&'a self, mesh: &Mesh, surface: &dyn Surface, hit: &Hit) -> Illumination<'a> {
        let point = self.are_local.then(|| LitPoint::new(mesh, surface, hit));
        Illumination { ambient: self.ambient, lights: self, point }
    }
}

impl LitPoint {
    fn new(mesh: &Mesh, surface: &dyn Surface, hit: &Hit) -> Self {
        let (position, steps) = hit.interpolate(mesh.triangle_positions(hit.triangle()));
        let side = if hit.front { 1.0 } else { -1.0 };
        let facet_normal = hit.at.facet_normal(mesh) * side;
        let smooth = surface.smooth_point(hit);
        let receiver = Receiver {
            position: position + smooth.map_or(Vec3::ZERO, |s| s.offset),
            steps,
            facet_normal,
            normal: smooth.map_or(facet_normal, |s| s.normal),
        };
        Self { position, receiver }
    }
}

impl Illumination<'_> {
    /// What arrives from every lamp. `normal` is the unit shading normal: lamps below its horizon are listed, but no shadow
    /// is looked up for them.
    pub(crate) fn incoming(&self, normal: Vec3) -> impl Iterator<Item = Incoming> + '_ {
        self.lights.lamps.iter().filter_map(move |lamp| {
            let (to_light, color) = match (&lamp.source, &self.point) {
                (Source::Directional { to_light }, _) => (*to_light, lamp.color),
                (source, Some(point)) => {
                    let (to_light, factor) = source.arriving(point, self.lights)?;
                    (to_light, lamp.color * factor)
                }
                (_, None) => return None,
            };
            let visibility = match (&lamp.shadow, &self.point) {
                (Some(maps), Some(point)) if normal.dot(to_light) > 0.0 && color != Vec3::ZERO => {
                    maps.visibility(&point.receiver, to_light)
                }
                _ => 1.0,
            };
            Some(Incoming { to_light, color, visibility })
        })
    }
}

impl<'a> Source<'a> {
    fn new(kind: &'a LightKind, mesh: &Mesh) -> Self {
        let placed = |p: DVec3| mesh.world_from_mesh.inverse_point(p);
        match kind {
            LightKind::Directional { to_light } => {
                Self::Directional { to_light: to_light.normalize_or(Vec3::Y) }
            }
            LightKind::Point { position, falloff } => {
                Self::Point { position: placed(*position), falloff: *falloff }
            }
            LightKind::Spot(light) => {
                Self::Spot { position: placed(light.position), light, cone: light.cone() }
            }
            LightKind::Projector(projector) => {
                Self::Projector { view: projector_view(projector, &mesh.world_from_mesh), projector }
            }
        }
    }

    /// Unit vector to the lamp and the factor of its colour; nothing where no light goes.
    fn arriving(&self, point: &LitPoint, lights: &PreparedLights) -> Option<(Vec3, Vec3)> {
        let towards = |position: Vec3| {
            let way = position - point.position;
            let distance = f64::from(way.length() * lights.world_per_mesh);
            (way.normalize_or(Vec3::Y), distance)
        };
        match self {
            Self::Directional { to_light } => Some((*to_light, Vec3::ONE)),
            Self::Point { position, falloff } => {
                let (to_light, distance) = towards(*position);
                Some((to_light, Vec3::splat(falloff.factor(distance))))
            }
            Self::Spot { position, light, cone } => {
                let (to_light, distance) = towards(*position);
                let cosine = -to_light.dot(light.direction.normalize_or(Vec3::NEG_Y));
                let factor = cone.share(cosine) * light.falloff.factor(distance);
                (factor > 0.0).then_some((to_light, Vec3::splat(factor)))
            }
            Self::Projector { view, projector } => {
                let cookie = projected(view, &projector.cookie, point, lights.time)?;
                let (to_light, distance) = match projector.lens {
                    Lens::Perspective { .. } => towards(view.origin.as_vec3()),
                    Lens::Orthographic { .. } => {
                        let depth = view.project(point.position).depth;
                        (-view.forward().as_vec3(), depth * f64::from(lights.world_per_mesh))
                    }
                };
                Some((to_light, cookie * projector.falloff.factor(distance)))
            }
        }
    }
}

/// The cookie's light at a point, filtered over the point's footprint.
fn projected(view: &LampView, cookie: &Cookie, point: &LitPoint, time: f32) -> Option<Vec3> {
    let at = view.project(point.position);
    if at.w <= 0.0 || at.depth <= 0.0 {
        return None;
    }
    let (uv, steps) = (at.uv.as_vec2(), point.receiver.steps.map(|step| view.step(&at, step)));
    let share = share_inside(uv, steps);
    if share <= 0.0 {
        return None;
    }
    let value = cookie.color(uv.clamp(Vec2::ZERO, Vec2::ONE), steps, time);
    Some((value.truncate() * (value.w * share)).max(Vec3::ZERO))
}

/// The share of the footprint's bounding box that lies in the unit square.
fn share_inside(uv: Vec2, steps: [Vec2; 2]) -> f32 {
    let half = (0.5 * (steps[0].abs() + steps[1].abs())).max(Vec2::splat(1e-6));
    let (low, high) = ((uv - half).max(Vec2::ZERO), (uv + half).min(Vec2::ONE));
    let inside = ((high - low) / (2.0 * half)).max(Vec2::ZERO);
    inside.x * inside.y
}
