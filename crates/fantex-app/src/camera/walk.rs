//! Walking: gravity holds the walker at eye height over the ground, low steps are climbed, walls stop.
//!
//! The walker is a vertical line from feet to eyes. It moves in steps shorter than itself is thick; each step is first
//! shortened or turned along walls (rays at knee and chest), then asks for the ground below its end. Ground may be a step
//! higher or lower; if it lies deeper the walker falls, and where there is none at all (beyond the model's border) it does not
//! go. So it never falls through a surface, however long a frame takes.

use std::sync::Arc;

use fantex::glam::DVec3;
use fantex::mesh::{Mesh, TriangleBvh};
use fantex::store::Asset;

use crate::camera::{CameraRig, Wish};

/// Shares of the eye height.
const RADIUS: f64 = 0.2;
const STEP_UP: f64 = 0.4;
const STEP_DOWN: f64 = 0.5;
/// Where walls are felt.
const FEELERS: [f64; 2] = [0.45, 0.9];
/// Eye heights per second.
const SPEED: f64 = 1.8;
/// Eye heights per second squared; 9.81 m/s2 for someone of 1.7 m.
const GRAVITY: f64 = 5.8;
/// Fastest fall.
const TERMINAL: f64 = 40.0;
/// Upward part of the normal of the steepest slope that is climbed: 55 degrees.
const STEEPEST: f64 = 0.57;
/// Seconds in which the eyes follow most of the way to a change of the feet.
const SOFTNESS_SECONDS: f64 = 0.07;
/// Most steps of a frame; a frame that asks for more is cut.
const MAX_STEPS: usize = 256;

/// Someone who walks in the scene.
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

impl Walker {
    /// A walker who has not been put anywhere.
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

    /// Moves for a frame. Returns whether the picture may still change without any wish: while falling or settling.
    pub fn step(&mut self, rig: &mut CameraRig, wish: &Wish, ground: &dyn Ground, seconds: f64) -> bool {
        self.is_lost = !self.is_placed && !self.place(rig, ground);
        if self.is_lost {
            return false;
        }
        let height = self.eye_height;
        let before = self.feet;
        let way = wish.horizontal(rig) * (SPEED * height * self.speed * wish.haste() * seconds);
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
        is_falling || self.lag != 0.0 || !wish.is_none()
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
                let is_steep = hit.normal.y < STEEPEST && rise > 0.05 * height;
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
        FEELERS.iter().find_map(|&share| {
            let origin = self.feet + DVec3::Y * (share * self.eye_height);
            let hit = ground.first(origin, direction, reach)?;
            let is_wall = hit.normal.y.abs() < STEEPEST && hit.normal.dot(way) < 0.0;
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
        self.falling = (self.falling - GRAVITY * height * seconds).max(-TERMINAL * height);
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
    owner: MeshOwner,
    tree: TriangleBvh,
}

#[derive(Debug)]
enum MeshOwner {
    Model(Arc<Mesh>),
    Asset(Arc<Asset>),
}

impl MeshOwner {
    fn mesh(&self) -> &Mesh {
        match self {
            Self::Model(mesh) => mesh,
            Self::Asset(asset) => asset.mesh(),
        }
    }
}

impl MeshGround {
    /// Builds the tree of a model: two seconds for a million triangles, so in the background.
    pub fn of_model(mesh: Arc<Mesh>) -> Self {
        Self::new(MeshOwner::Model(mesh))
    }

    /// As [`MeshGround::of_model`], of an asset.
    pub fn of_asset(asset: Arc<Asset>) -> Self {
        Self::new(MeshOwner::Asset(asset))
    }

    fn new(owner: MeshOwner) -> Self {
        Self { tree: TriangleBvh::new(owner.mesh()), owner }
    }
}

impl Ground for MeshGround {
    fn first(&self, origin: DVec3, direction: DVec3, reach: f64) -> Option<GroundHit> {
        let mesh = self.owner.mesh();
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

#[cfg(test)]
mod tests {
    use fantex::mesh::generate::torus;
    use fantex::mesh::{CleanOptions, clean};

    use super::*;
    use crate::camera::GroundHit;

    /// A height field over a square, steps and walls included, marched finely.
    struct Field<F: Fn(f64, f64) -> f64>(F);

    const HALF: f64 = 20.0;

    impl<F: Fn(f64, f64) -> f64> Ground for Field<F> {
        fn first(&self, origin: DVec3, direction: DVec3, reach: f64) -> Option<GroundHit> {
            let height = |p: DVec3| (p.x.abs() <= HALF && p.z.abs() <= HALF).then(|| (self.0)(p.x, p.z));
            if direction == DVec3::NEG_Y {
                let distance = origin.y - height(origin)?;
                let slope = |step: DVec3| {
                    (height(origin + step).unwrap_or(0.0) - height(origin - step).unwrap_or(0.0)) / 2e-3
                };
                let normal = DVec3::new(-slope(DVec3::X * 1e-3), 1.0, -slope(DVec3::Z * 1e-3)).normalize();
                return (0.0..=reach).contains(&distance).then_some(GroundHit { distance, normal });
            }
            let is_under = |t: f64| {
                let p = origin + direction * t;
                height(p).is_some_and(|h| p.y < h)
            };
            let step = 2e-3;
            let count = (reach.min(50.0) / step) as usize;
            let t = (1..=count).map(|i| i as f64 * step).find(|&t| is_under(t))?;
            Some(GroundHit { distance: t, normal: -direction })
        }
    }

    fn walk(
        field: impl Fn(f64, f64) -> f64,
        wish: Wish,
        seconds: f64,
        frame: f64,
    ) -> (Vec<DVec3>, CameraRig) {
        let mut rig = CameraRig { eye: DVec3::new(0.0, 3.0, 0.0), ..CameraRig::default() };
        let ground = Field(field);
        let mut walker = Walker::new(1.7);
        // Land first.
        for _ in 0..300 {
            walker.step(&mut rig, &Wish::default(), &ground, 0.02);
        }
        let frames = (seconds / frame) as usize;
        let eyes = (0..frames)
            .map(|_| {
                walker.step(&mut rig, &wish, &ground, frame);
                rig.eye
            })
            .collect();
        (eyes, rig)
    }

    const FORWARD: Wish = Wish { right: 0.0, up: 0.0, forward: 1.0, fast: false };

    #[test]
    fn gravity_brings_the_eyes_to_their_height() {
        let (_, rig) = walk(|_, _| 0.5, Wish::default(), 0.1, 0.02);
        assert!((rig.eye.y - 2.2).abs() < 1e-3, "{}", rig.eye.y);
    }

    #[test]
    fn hills_are_followed_at_eye_height() {
        let hills = |x: f64, z: f64| (x * 0.5).sin() * 0.6 + (z * 0.4).cos();
        let (eyes, _) = walk(hills, FORWARD, 4.0, 0.02);
        for eye in &eyes {
            let over = eye.y - hills(eye.x, eye.z);
            assert!((over - 1.7).abs() < 0.35, "{over} at {eye}");
        }
        assert!(eyes.last().unwrap().z < -8.0, "no ground covered: {:?}", eyes.last());
    }

    #[test]
    fn low_steps_are_climbed_and_walls_stop() {
        let step = |height: f64| move |_: f64, z: f64| if z < -3.0 { height } else { 0.0 };
        let (_, over) = walk(step(0.4), FORWARD, 3.0, 0.02);
        assert!(over.eye.z < -6.0 && (over.eye.y - 2.1).abs() < 0.05, "{}", over.eye);
        let (_, before) = walk(step(3.0), FORWARD, 3.0, 0.02);
        assert!(before.eye.z > -3.0 && before.eye.y < 2.0, "{}", before.eye);
    }

    #[test]
    fn long_frames_do_not_fall_through_or_leave_the_border() {
        let (_, rig) = walk(|_, z| z * 0.05, Wish { fast: true, ..FORWARD }, 30.0, 0.5);
        assert!(rig.eye.z >= -HALF - 1e-6, "{}", rig.eye);
        assert!((rig.eye.y - rig.eye.z * 0.05 - 1.7).abs() < 0.1, "{}", rig.eye);
    }

    #[test]
    fn cliffs_are_fallen_down_not_through() {
        let cliff = |_: f64, z: f64| if z < -2.0 { -12.0 } else { 0.0 };
        let (eyes, rig) = walk(cliff, FORWARD, 4.0, 0.02);
        assert!((rig.eye.y + 10.3).abs() < 0.05, "{}", rig.eye);
        assert!(eyes.iter().all(|e| e.y >= -10.4));
        assert!(eyes.iter().filter(|e| (-9.0..0.0).contains(&e.y)).count() > 5, "a fall takes time");
    }

    #[test]
    fn without_ground_nobody_stands() {
        let mut rig = CameraRig { eye: DVec3::new(9.0 * HALF, 3.0, 0.0), ..CameraRig::default() };
        let before = rig;
        let mut walker = Walker::new(1.7);
        struct Nothing;
        impl Ground for Nothing {
            fn first(&self, _: DVec3, _: DVec3, _: f64) -> Option<GroundHit> {
                None
            }
        }
        assert!(!walker.is_lost());
        assert!(!walker.step(&mut rig, &FORWARD, &Nothing, 0.1));
        assert!(walker.is_lost() && rig == before);
        walker.leave();
        assert!(!walker.is_lost());
    }

    #[test]
    fn someone_below_the_ground_is_put_on_it() {
        let mut rig = CameraRig { eye: DVec3::new(1.0, -5.0, 1.0), ..CameraRig::default() };
        struct Slab;
        impl Ground for Slab {
            fn first(&self, origin: DVec3, direction: DVec3, reach: f64) -> Option<GroundHit> {
                let distance = -origin.y / direction.y;
                (distance > 0.0 && distance <= reach)
                    .then_some(GroundHit { distance, normal: DVec3::Y * -direction.y.signum() })
            }
        }
        let mut walker = Walker::new(1.7);
        for _ in 0..300 {
            walker.step(&mut rig, &Wish::default(), &Slab, 0.02);
        }
        assert!((rig.eye.y - 1.7).abs() < 1e-3, "{}", rig.eye);
    }

    #[test]
    fn hits_are_in_world_units() {
        let mut model = torus(48, 24);
        for p in &mut model.positions {
            *p = *p * 100.0 + DVec3::new(5000.0, -300.0, 20.0);
        }
        let (mesh, _) = clean(model, &CleanOptions::default()).unwrap();
        let ground = MeshGround::of_model(Arc::new(mesh));
        // On the circle in the middle of the tube, whose radius is the torus' smaller one.
        let above = DVec3::new(5100.0, 0.0, 20.0);
        let hit = ground.first(above, DVec3::NEG_Y, 1e4).unwrap();
        let tube = 300.0 - hit.distance;
        assert!((20.0..60.0).contains(&tube), "{hit:?}");
        assert!(hit.normal.y > 0.9);
        assert_eq!(ground.first(above, DVec3::NEG_Y, 100.0), None, "beyond the reach");
    }
}
