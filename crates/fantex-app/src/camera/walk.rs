//! Walking: gravity holds the walker at eye height over the ground, low steps are climbed, walls stop.
//!
//! The walker is a vertical line from feet to eyes. It moves in steps shorter than itself is thick; each step is first
//! shortened or turned along walls (rays at knee and chest), then asks for the ground below its end. Ground may be a step
//! higher or lower; if it lies deeper the walker falls, and where there is none at all (beyond the model's border) it does not
//! go. So it never falls through a surface, however long a frame takes.

use std::sync::Arc;

use fantex::SurfacePoint;
use fantex::glam::DVec3;
use fantex::mesh::{Mesh, OpposedTriangles, RayHit, TriangleBvh};

use crate::camera::{CameraRig, MoveInput, SceneScale};

/// Shares of the eye height.
const RADIUS: f64 = 0.2;
const STEP_UP: f64 = 0.4;
const STEP_DOWN: f64 = 0.5;
/// Heights of the rays that find walls.
const WALL_RAY_HEIGHTS: [f64; 2] = [0.45, 0.9];
/// Eye heights per second.
const SPEED: f64 = 1.8;
/// Eye heights per second squared; 9.81 m/s2 for someone of 1.7 m.
const GRAVITY: f64 = 5.8;
/// Eye heights per second.
const MAX_FALL_SPEED: f64 = 40.0;
/// Upward part of the normal of the steepest slope that is climbed (55 degrees).
const MIN_NORMAL_Y: f64 = 0.57;
/// Seconds in which the eyes follow most of the way to a change of the feet.
const SOFTNESS_SECONDS: f64 = 0.07;
/// Most steps of a frame; a frame that asks for more is cut.
const MAX_STEPS: usize = 256;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Walker {
    /// World units from feet to eyes, positive.
    pub eye_height: f64,
    /// Factor of the usual speed.
    pub speed: f64,
    feet: DVec3,
    /// World units per second, upwards.
    falling: f64,
    /// Height of the eyes over where they should be; decays.
    lag: f64,
    /// Whether the feet have been set.
    is_placed: bool,
    /// Whether they were to be, and there is no ground below or above.
    is_lost: bool,
}

impl Default for Walker {
    fn default() -> Self {
        Self::new(SceneScale::default().eye_height())
    }
}

impl Walker {
    pub fn new(eye_height: f64) -> Self {
        Self {
            eye_height,
            speed: 1.0,
            feet: DVec3::ZERO,
            falling: 0.0,
            lag: 0.0,
            is_placed: false,
            is_lost: false,
        }
    }

    /// Forgets where it stood: the next step starts from the camera.
    pub fn leave(&mut self) {
        (self.is_placed, self.is_lost) = (false, false);
    }

    /// Whether there is no ground to stand on below or above the camera.
    pub fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// Moves for a frame. Returns whether the picture may still change without any movement: while falling or settling.
    pub fn step(
        &mut self,
        rig: &mut CameraRig,
        movement: &MoveInput,
        ground: &dyn Ground,
        seconds: f64,
    ) -> bool {
        self.is_lost = !self.is_placed && !self.place(rig, ground);
        if self.is_lost {
            return false;
        }
        let height = self.eye_height;
        let before = self.feet;
        let way =
            movement.horizontal(rig) * (SPEED * height * self.speed * movement.speed_factor() * seconds);
        let steps = ((way.length() / (RADIUS * height)).ceil() as usize).clamp(1, MAX_STEPS);
        let part = (way / steps as f64).clamp_length_max(RADIUS * height);
        let mut is_falling = false;
        for _ in 0..steps {
            self.advance(part, ground);
            is_falling = self.settle(ground, seconds / steps as f64);
        }
        if !is_falling {
            self.lag += before.y - self.feet.y;
        }
        self.lag *= (-seconds / SOFTNESS_SECONDS).exp();
        if self.lag.abs() < 1e-4 * height {
            self.lag = 0.0;
        }
        rig.eye = self.feet + DVec3::Y * (height + self.lag);
        is_falling || self.lag != 0.0 || !movement.is_none()
    }

    /// Puts the feet below the camera. Where nothing is below, the highest ground at the place counts; without any ground
    /// nothing happens.
    fn place(&mut self, rig: &CameraRig, ground: &dyn Ground) -> bool {
        let below = ground.first(rig.eye, DVec3::NEG_Y, f64::INFINITY).map(|hit| rig.eye.y - hit.distance);
        let found = below.or_else(|| {
            // From underneath: up through the last surface.
            let mut top = None;
            let mut from = rig.eye;
            for _ in 0..64 {
                let Some(hit) = ground.first(from, DVec3::Y, f64::INFINITY) else { break };
                from.y += hit.distance;
                top = Some(from.y);
                from.y += 1e-3 * self.eye_height;
            }
            top
        });
        let Some(y) = found else { return false };
        self.feet = rig.eye.with_y(y.max(rig.eye.y - self.eye_height));
        self.falling = 0.0;
        self.lag = rig.eye.y - (self.feet.y + self.eye_height);
        self.is_placed = true;
        true
    }

    /// One step along the horizon, as far as walls, steep slopes and the model's border allow.
    fn advance(&mut self, way: DVec3, ground: &dyn Ground) {
        let way = self.along_walls(way, ground);
        if way == DVec3::ZERO {
            return;
        }
        let height = self.eye_height;
        let probe = self.feet + way + DVec3::Y * (STEP_UP * height);
        match ground.first(probe, DVec3::NEG_Y, f64::INFINITY) {
            // Beyond the border of the model.
            None => {}
            Some(hit) => {
                let rise = STEP_UP * height - hit.distance;
                let is_steep = hit.normal.y < MIN_NORMAL_Y && rise > 0.05 * height;
                // A slope as steep as that is a wall if it goes on; a step's edge does not.
                if !(is_steep && rise > way.length() * 1.5) {
                    self.feet += way;
                }
            }
        }
    }

    /// What walls leave of a way: the part along the first wall, and again for a corner of two.
    fn along_walls(&self, way: DVec3, ground: &dyn Ground) -> DVec3 {
        let mut way = way;
        for _ in 0..2 {
            let Some(normal) = self.wall(way, ground) else { return way };
            way -= normal * way.dot(normal).min(0.0);
        }
        if self.wall(way, ground).is_some() { DVec3::ZERO } else { way }
    }

    /// Horizontal unit normal of a wall in the way.
    fn wall(&self, way: DVec3, ground: &dyn Ground) -> Option<DVec3> {
        let direction = way.try_normalize()?;
        let reach = way.length() + RADIUS * self.eye_height;
        WALL_RAY_HEIGHTS.iter().find_map(|&share| {
            let origin = self.feet + DVec3::Y * (share * self.eye_height);
            let hit = ground.first(origin, direction, reach)?;
            let is_wall = hit.normal.y.abs() < MIN_NORMAL_Y && hit.normal.dot(way) < 0.0;
            is_wall.then(|| hit.normal.with_y(0.0).normalize_or(-direction))
        })
    }

    /// Stands on the ground or falls towards it. Returns whether it falls.
    fn settle(&mut self, ground: &dyn Ground, seconds: f64) -> bool {
        let height = self.eye_height;
        let probe = self.feet + DVec3::Y * (STEP_UP * height);
        let Some(hit) = ground.first(probe, DVec3::NEG_Y, f64::INFINITY) else {
            self.falling = 0.0;
            return false;
        };
        let floor = probe.y - hit.distance;
        let gap = self.feet.y - floor;
        if gap <= 0.0 || (self.falling == 0.0 && gap <= STEP_DOWN * height) {
            self.feet.y = floor;
            self.falling = 0.0;
            return false;
        }
        self.falling = (self.falling - GRAVITY * height * seconds).max(-MAX_FALL_SPEED * height);
        self.feet.y = (self.feet.y + self.falling * seconds).max(floor);
        if self.feet.y == floor {
            self.falling = 0.0;
        }
        self.falling != 0.0
    }
}

/// Where a ray meets the scene. World space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundHit {
    /// World units along the ray.
    pub distance: f64,
    /// Unit normal of the surface, towards where the ray comes from.
    pub normal: DVec3,
}

/// A scene that can be asked for the first thing on a ray.
pub trait Ground {
    /// The first surface, from either side, at most `reach` world units along a unit direction. World space.
    fn first(&self, origin: DVec3, direction: DVec3, reach: f64) -> Option<GroundHit>;
}

/// A mesh and the tree of its triangles.
#[derive(Debug)]
pub struct MeshGround {
    mesh: Arc<Mesh>,
    tree: TriangleBvh,
    opposed: OpposedTriangles,
}

impl MeshGround {
    /// Builds the tree: two seconds for a million triangles, so in the background.
    pub fn new(mesh: Arc<Mesh>) -> Self {
        let opposed = OpposedTriangles::of(&mesh.triangles);
        Self { tree: TriangleBvh::new(&mesh), opposed, mesh }
    }

    /// The first point on a ray in world space; of two sides of a leaf that which is seen.
    pub fn point(&self, origin: DVec3, direction: DVec3) -> Option<SurfacePoint> {
        let is_seen = |hit: &RayHit| {
            let triangle = hit.point.index();
            !self.opposed.contains(triangle) || self.mesh.facet_normal(triangle).dot(direction) <= 0.0
        };
        let origin = self.mesh.world_from_mesh.inverse_point(origin);
        let hit = self.tree.first_hit_where(origin, direction.as_vec3(), f32::INFINITY, is_seen);
        hit.map(|hit| hit.point)
    }
}

impl Ground for MeshGround {
    fn first(&self, origin: DVec3, direction: DVec3, reach: f64) -> Option<GroundHit> {
        let mesh = &self.mesh;
        let place = mesh.world_from_mesh;
        // Axes of both spaces agree; lengths differ by the scale.
        let hit = self.tree.first_hit(
            place.inverse_point(origin),
            direction.as_vec3(),
            (reach / place.scale) as f32,
        )?;
        let [a, b, c] = mesh.triangle_positions(hit.point.index()).map(|p| p.as_dvec3());
        let normal = (b - a).cross(c - a).normalize_or(-direction);
        let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
        Some(GroundHit { distance: f64::from(hit.distance) * place.scale, normal })
    }
}
