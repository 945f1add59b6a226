//! Camera paths: recorded by a viewer, or generated.

use std::f64::consts::TAU;

use fantex_base::Random;
use fantex_mesh::WorldFromMesh;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::StreamView;

/// Where the camera is at one moment, world space.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraKeyframe {
    /// Since the path's beginning, ascending.
    pub seconds: f64,
    /// The pinhole.
    pub eye: [f64; 3],
    /// A point in the middle of the picture.
    pub target: [f64; 3],
    /// Points upwards in the picture.
    pub up: [f64; 3],
    /// Vertical opening angle, degrees.
    pub fov_degrees: f64,
    /// The camera jumps here; it does not move here from the keyframe before.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_cut: bool,
}

/// Time of the last keyframe of a path in a file, at most: a day.
pub const MAX_PATH_SECONDS: f64 = 86_400.0;

/// A camera's way through the world.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraPath {
    /// In order of time; `keys` in files.
    #[serde(rename = "keys", alias = "keyframes")]
    pub keyframes: Vec<CameraKeyframe>,
}

impl CameraPath {
    /// Seconds from the beginning to the last keyframe.
    pub fn duration_seconds(&self) -> f64 {
        self.keyframes.last().map_or(0.0, |k| k.seconds)
    }

    /// The moments of the cuts, the beginning among them.
    pub fn cuts_seconds(&self) -> Vec<f64> {
        let is_cut = |&(i, k): &(usize, &CameraKeyframe)| i == 0 || k.is_cut;
        self.keyframes.iter().enumerate().filter(is_cut).map(|(_, k)| k.seconds).collect()
    }

    /// The camera at a moment, by cubic interpolation between cuts (Catmull and Rom, "A class of local interpolating
    /// splines", 1974, with differences over uneven times); `None` for a path without keyframes.
    pub fn at(&self, seconds: f64) -> Option<CameraKeyframe> {
        let next = self.keyframes.partition_point(|k| k.seconds <= seconds);
        if next == 0 {
            return self.keyframes.first().map(|k| CameraKeyframe { seconds, ..*k });
        }
        let from = self.keyframes[next - 1];
        let Some(to) = self.keyframes.get(next).filter(|k| !k.is_cut) else {
            return Some(CameraKeyframe { seconds, ..from });
        };
        let before = if next >= 2 && !from.is_cut { self.keyframes[next - 2] } else { from };
        let after = self.keyframes.get(next + 1).filter(|k| !k.is_cut).unwrap_or(to);
        let span = to.seconds - from.seconds;
        let t = if span > 0.0 { (seconds - from.seconds) / span } else { 0.0 };
        let vector = |of: fn(&CameraKeyframe) -> [f64; 3]| {
            let [p0, p1, p2, p3] = [&before, &from, to, after].map(|k| DVec3::from(of(k)));
            let slope = |a: DVec3, b: DVec3, seconds: f64| {
                if seconds > 0.0 { (b - a) / seconds } else { DVec3::ZERO }
            };
            let leaving = slope(p0, p2, to.seconds - before.seconds) * span;
            let arriving = slope(p1, p3, after.seconds - from.seconds) * span;
            let (t2, t3) = (t * t, t * t * t);
            let p = p1 * (2.0 * t3 - 3.0 * t2 + 1.0)
                + leaving * (t3 - 2.0 * t2 + t)
                + p2 * (3.0 * t2 - 2.0 * t3)
                + arriving * (t3 - t2);
            p.to_array()
        };
        Some(CameraKeyframe {
            seconds,
            eye: vector(|k| k.eye),
            target: vector(|k| k.target),
            up: vector(|k| k.up),
            fov_degrees: from.fov_degrees + t * (to.fov_degrees - from.fov_degrees),
            is_cut: false,
        })
    }

    /// Once around a point, at a distance and a height above it.
    pub fn orbit(center: DVec3, distance: f64, height: f64, seconds: f64) -> Self {
        let keyframe = |i: u32| {
            let turn = f64::from(i) / 32.0;
            let (sin, cos) = (TAU * turn).sin_cos();
            let eye = center + DVec3::new(distance * sin, height, distance * cos);
            CameraKeyframe::looking(seconds * turn, eye, center)
        };
        Self { keyframes: (0..=32).map(keyframe).collect() }
    }

    /// Straight from one point to another, looking ahead and a little down.
    pub fn fly(from: DVec3, to: DVec3, seconds: f64) -> Self {
        let ahead = (to - from).normalize_or(DVec3::NEG_Z) - DVec3::Y * 0.2;
        let keyframe = |i: u32| {
            let t = f64::from(i) / 16.0;
            let eye = from.lerp(to, t);
            CameraKeyframe::looking(seconds * t, eye, eye + ahead)
        };
        Self { keyframes: (0..=16).map(keyframe).collect() }
    }

    /// Stands for a while at each of several points around a centre, and jumps between them.
    pub fn cuts(center: DVec3, distances: &[f64], seconds_each: f64) -> Self {
        let mut keyframes = Vec::new();
        for (i, &distance) in (0u32..).zip(distances) {
            // Golden angles: no two views are alike.
            let (sin, cos) = (f64::from(i) * 2.399_963).sin_cos();
            let eye = center + DVec3::new(sin, 0.5, cos).normalize() * distance;
            let begin = f64::from(i) * seconds_each;
            let first = CameraKeyframe { is_cut: true, ..CameraKeyframe::looking(begin, eye, center) };
            keyframes.push(first);
            keyframes.push(CameraKeyframe { seconds: begin + seconds_each * 0.999, is_cut: false, ..first });
        }
        Self { keyframes }
    }

    /// A restless camera in a ball: the same for the same seed.
    pub fn random_walk(center: DVec3, radius: f64, seed: u64, seconds: f64) -> Self {
        let mut random = Random::new(seed);
        let mut next = || random.unit() * 2.0 - 1.0;
        let mut point = || DVec3::new(next(), next(), next());
        let count = (seconds * 2.0).ceil().max(1.0) as u32;
        let keyframe = |i: u32| {
            let eye = center + point() * radius;
            let target = center + point() * radius * 0.3;
            CameraKeyframe::looking(seconds * f64::from(i) / f64::from(count), eye, target)
        };
        Self { keyframes: (0..=count).map(keyframe).collect() }
    }
}

impl CameraKeyframe {
    /// A camera with y up and an opening angle of 50 degrees.
    pub fn looking(seconds: f64, eye: DVec3, target: DVec3) -> Self {
        let (eye, target) = (eye.to_array(), target.to_array());
        Self { seconds, eye, target, up: [0.0, 1.0, 0.0], fov_degrees: 50.0, is_cut: false }
    }

    /// What the camera sees of a mesh in a picture of `size` pixels; `None` for a picture without any.
    pub fn view(&self, world_from_mesh: &WorldFromMesh, size: [u32; 2]) -> Option<StreamView> {
        if size.contains(&0) {
            return None;
        }
        let (eye, target, up) = (DVec3::from(self.eye), DVec3::from(self.target), DVec3::from(self.up));
        let back = (eye - target).try_normalize().unwrap_or(DVec3::Z);
        let right = up.cross(back).try_normalize().unwrap_or_else(|| back.any_orthonormal_vector());
        let axes = DMat3::from_cols(right, back.cross(right), back);
        Some(StreamView::in_world(world_from_mesh, eye, axes, self.fov_degrees, size))
    }
}
