//! Orbits, flights, walks and recorded paths.

use std::sync::Arc;

use fantex::glam::{DMat3, DVec2, DVec3};
use fantex::mesh::generate::torus;
use fantex::mesh::{CleanOptions, clean};
use fantex::scene::Camera;
use fantex::stream::CameraPath;
use fantex_app::camera::{
    CameraRig, FlyMotion, Ground, GroundHit, MeshGround, MoveInput, PathRecorder, SceneScale, ViewPreset,
    Walker, load_path, save_path,
};

#[test]
fn a_rig_shows_what_its_camera_shows() {
    let camera = Camera {
        eye: DVec3::new(3.0, 2.0, -5.0),
        target: DVec3::new(0.5, -1.0, 4.0),
        up: DVec3::Y,
        fov_degrees: 50.0,
    };
    let again = CameraRig::of_camera(&camera).camera();
    assert!((again.target - camera.target).length() < 1e-12, "{again:?}");
    assert!((again.eye - camera.eye).length() < 1e-12);
    assert!(again.up.y > 0.9 && again.up.dot(again.target - again.eye).abs() < 1e-9);
}

#[test]
fn axes_are_orthonormal_and_right_handed() {
    for (yaw, pitch) in [(0.0, 0.0), (1.0, 0.5), (4.0, -1.5), (6.0, 1.56)] {
        let rig = CameraRig { yaw, pitch, ..CameraRig::default() };
        let axes = rig.axes();
        assert!((axes.determinant() - 1.0).abs() < 1e-12);
        assert!((axes.transpose() * axes).abs_diff_eq(DMat3::IDENTITY, 1e-12));
    }
}

#[test]
fn rays_go_through_the_picture_the_right_way_round() {
    let rig = CameraRig::default();
    assert!((rig.ray(DVec2::splat(0.5), 1.6) - DVec3::NEG_Z).length() < 1e-12);
    assert!(rig.ray(DVec2::new(1.0, 0.5), 1.6).x > 0.0, "the right border is on the right");
    assert!(rig.ray(DVec2::new(0.5, 0.0), 1.6).y > 0.0, "the first row is above");
}

#[test]
fn looking_straight_down_stays_upright() {
    let mut rig = CameraRig::default();
    rig.look(0.3, -10.0);
    assert!(rig.is_sound() && rig.axes().y_axis.y > 0.0);
}

#[test]
fn eyes_are_at_a_height_that_suits_the_scene() {
    let height = |diagonal| SceneScale { center: DVec3::ZERO, diagonal }.eye_height();
    assert_eq!(height(2000.0), 1.7);
    assert!(height(0.2) < 0.01 && height(1e6) > 100.0);
}

const SCENE: SceneScale = SceneScale { center: DVec3::ZERO, diagonal: 2.0 };

fn rig() -> CameraRig {
    let mut rig = CameraRig { eye: DVec3::new(1.0, 2.0, 5.0), distance: 4.0, ..CameraRig::default() };
    rig.look(0.4, -0.3);
    rig
}

/// Where in the picture a point is, 0..1 along its sides.
fn seen(rig: &CameraRig, point: DVec3, aspect: f64) -> DVec2 {
    let p = rig.axes().transpose() * (point - rig.eye);
    let half = (rig.fov_degrees.to_radians() * 0.5).tan();
    DVec2::new(p.x / -p.z / half / aspect, -p.y / -p.z / half) * 0.5 + 0.5
}

#[test]
fn orbits_keep_pivot_and_distance() {
    let mut rig = rig();
    let pivot = rig.pivot();
    for drag in [DVec2::new(0.3, 0.1), DVec2::new(-2.0, 1.0), DVec2::new(0.0, -9.0)] {
        rig.orbit(drag);
        assert!((rig.pivot() - pivot).length() < 1e-9);
        assert!(((rig.eye - pivot).length() - 4.0).abs() < 1e-9);
        assert!(rig.axes().y_axis.y > 0.0, "up is kept");
    }
}

#[test]
fn zoom_keeps_what_is_under_the_cursor() {
    let mut rig = rig();
    let cursor = DVec2::new(0.2, 0.7);
    let point = rig.point_under(cursor, 1.6, Some(3.0));
    assert!((seen(&rig, point, 1.6) - cursor).length() < 1e-9);
    rig.zoom_to(point, 0.5, &SCENE);
    assert!((seen(&rig, point, 1.6) - cursor).length() < 1e-9, "{}", seen(&rig, point, 1.6));
    assert!((rig.eye.distance(point) - 1.5).abs() < 1e-9);
}

#[test]
fn zoom_has_limits_and_comes_back_from_them() {
    let mut rig = rig();
    for _ in 0..1000 {
        rig.zoom_to(DVec3::ZERO, 0.5, &SCENE);
    }
    assert!(rig.is_sound() && rig.distance >= 1e-6);
    for _ in 0..1000 {
        rig.zoom_to(DVec3::ZERO, 2.0, &SCENE);
    }
    assert!(rig.is_sound() && rig.distance <= 101.0);
}

#[test]
fn panning_moves_the_pivot_with_the_hand() {
    let mut rig = rig();
    let point = rig.pivot();
    rig.pan(DVec2::new(0.25, -0.125));
    let moved = seen(&rig, point, 1.0) - 0.5;
    assert!((moved - DVec2::new(0.25, -0.125)).length() < 1e-9, "{moved}");
}

const WIDE_SCENE: SceneScale = SceneScale { center: DVec3::ZERO, diagonal: 10.0 };

fn flown(seconds: f64, frames: u32) -> DVec3 {
    let (mut rig, mut motion) = (CameraRig::default(), FlyMotion::default());
    let movement = MoveInput { forward: 1.0, ..MoveInput::default() };
    for _ in 0..frames {
        assert!(motion.step(&mut rig, &movement, &WIDE_SCENE, seconds / f64::from(frames)));
    }
    rig.eye
}

#[test]
fn the_way_does_not_depend_on_the_frame_rate() {
    assert!((flown(1.0, 10) - flown(1.0, 1000)).length() < 1e-9);
    let way = (flown(2.0, 60) - CameraRig::default().eye).length();
    assert!((3.5..4.0).contains(&way), "two units per second, and a soft start: {way}");
}

#[test]
fn flight_comes_to_rest() {
    let (mut rig, mut motion) = (CameraRig::default(), FlyMotion::default());
    motion.step(&mut rig, &MoveInput { right: 1.0, ..MoveInput::default() }, &WIDE_SCENE, 1.0);
    let steps =
        (0..200).take_while(|_| motion.step(&mut rig, &MoveInput::default(), &WIDE_SCENE, 0.02)).count();
    assert!((5..100).contains(&steps), "{steps}");
}

#[test]
fn speed_stays_within_its_range() {
    let mut motion = FlyMotion::default();
    motion.change_speed(1e4);
    assert_eq!(motion.speed, FlyMotion::SPEEDS[1]);
    motion.change_speed(-1e4);
    assert_eq!(motion.speed, FlyMotion::SPEEDS[0]);
}

#[test]
fn walking_wishes_follow_the_horizon() {
    let mut rig = CameraRig::default();
    rig.look(0.7, -1.5);
    let movement = MoveInput { forward: 1.0, ..MoveInput::default() }.horizontal(&rig);
    assert!(movement.y == 0.0 && (movement.length() - 1.0).abs() < 1e-9);
    assert!(movement.dot(rig.forward()) > 0.0);
}

#[test]
fn every_side_is_seen_upright() {
    let (mesh, _) = clean(torus(32, 16), &CleanOptions::default()).unwrap();
    for (preset, _) in ViewPreset::ALL {
        let rig = preset.rig(&mesh, 1.5);
        assert!(rig.is_sound());
        assert!(rig.forward().dot(-preset.direction().normalize()) > 0.999, "{preset:?}");
    }
    let top = ViewPreset::Top.rig(&mesh, 1.5);
    assert!(top.axes().y_axis.dot(DVec3::NEG_Z) > 0.99, "the front is below: {}", top.axes().y_axis);
}

#[test]
fn framing_keeps_the_direction() {
    let (mesh, _) = clean(torus(32, 16), &CleanOptions::default()).unwrap();
    let mut rig = CameraRig { eye: DVec3::splat(90.0), ..CameraRig::default() };
    rig.look(0.6, -0.4);
    let before = rig.forward();
    rig.frame_all(&mesh, 1.5);
    assert!(rig.forward().dot(before) > 0.999_999);
    assert!(rig.eye.length() < 20.0);
}

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
    movement: MoveInput,
    seconds: f64,
    frame: f64,
) -> (Vec<DVec3>, CameraRig) {
    let mut rig = CameraRig { eye: DVec3::new(0.0, 3.0, 0.0), ..CameraRig::default() };
    let ground = Field(field);
    let mut walker = Walker::new(1.7);
    // Land first.
    for _ in 0..300 {
        walker.step(&mut rig, &MoveInput::default(), &ground, 0.02);
    }
    let frames = (seconds / frame) as usize;
    let eyes = (0..frames)
        .map(|_| {
            walker.step(&mut rig, &movement, &ground, frame);
            rig.eye
        })
        .collect();
    (eyes, rig)
}

const FORWARD: MoveInput = MoveInput { right: 0.0, up: 0.0, forward: 1.0, fast: false };

#[test]
fn gravity_brings_the_eyes_to_their_height() {
    let (_, rig) = walk(|_, _| 0.5, MoveInput::default(), 0.1, 0.02);
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
    let (_, rig) = walk(|_, z| z * 0.05, MoveInput { fast: true, ..FORWARD }, 30.0, 0.5);
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
        walker.step(&mut rig, &MoveInput::default(), &Slab, 0.02);
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
    let ground = MeshGround::new(Arc::new(mesh));
    // On the circle in the middle of the tube, whose radius is the torus' smaller one.
    let above = DVec3::new(5100.0, 0.0, 20.0);
    let hit = ground.first(above, DVec3::NEG_Y, 1e4).unwrap();
    let tube = 300.0 - hit.distance;
    assert!((20.0..60.0).contains(&tube), "{hit:?}");
    assert!(hit.normal.y > 0.9);
    assert_eq!(ground.first(above, DVec3::NEG_Y, 100.0), None, "beyond the reach");
}

fn camera(x: f64) -> Camera {
    Camera { eye: DVec3::new(x, 1.0, 5.0), target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 40.0 }
}

fn recorded() -> CameraPath {
    let mut recorder = PathRecorder::default();
    for frame in 0..=120 {
        let seconds = f64::from(frame) / 60.0;
        recorder.take(seconds, &camera(seconds));
    }
    recorder.finish(2.0, &camera(2.0)).unwrap()
}

#[test]
fn recordings_play_back_as_they_were() {
    let path = recorded();
    assert!((40..80).contains(&path.keyframes.len()), "{}", path.keyframes.len());
    assert_eq!(path.duration_seconds(), 2.0);
    for seconds in [0.0, 0.31, 1.0, 1.999] {
        assert!((path.at(seconds).unwrap().eye[0] - seconds).abs() < 1e-9);
    }
    assert_eq!(path.at(-1.0).unwrap().eye[0], 0.0);
    assert_eq!(path.at(99.0).unwrap().eye[0], 2.0);
}

#[test]
fn files_keep_paths() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("way.json");
    save_path(&recorded(), &file).unwrap();
    assert_eq!(load_path(&file).unwrap(), recorded());
}

#[test]
fn what_is_no_path_is_refused_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("way.json");
    let message = |text: &str| {
        std::fs::write(&file, text).unwrap();
        load_path(&file).unwrap_err().to_string()
    };
    assert!(message("{").contains("no camera path"));
    assert!(message("{\"keys\":[]}").contains("0 camera keys"));
    let key = |seconds: f64, eye: f64| {
        format!(
            "{{\"seconds\":{seconds},\"eye\":[{eye},0,0],\"target\":[0,0,0],\"up\":[0,1,0],\"fov_degrees\":40}}"
        )
    };
    assert!(message(&format!("{{\"keys\":[{},{}]}}", key(1.0, 1.0), key(0.5, 1.0))).contains("key 1"));
    assert!(message(&format!("{{\"keys\":[{}]}}", key(0.0, 0.0))).contains("same point"));
    assert!(load_path(&folder.path().join("none")).unwrap_err().to_string().contains("cannot read"));
}
