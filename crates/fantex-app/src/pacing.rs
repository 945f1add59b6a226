//! When a picture of the scene is drawn, and how large: only when something has changed, one at a time, smaller while the camera
//! moves if frames take long.

/// Seconds that a frame may take while something moves.
const WANTED_SECONDS: f64 = 1.0 / 30.0;

/// Seconds without movement after which the picture is drawn in full.
const REST_SECONDS: f64 = 0.15;

/// Scales of the sides of a moving picture.
const SCALES: [f32; 5] = [1.0, 0.75, 0.6, 0.45, 0.3];

#[derive(Clone, Debug, Default)]
pub struct Pacing {
    /// Something has changed since the last picture.
    is_stale: bool,
    is_drawing: bool,
    /// When something moved for the last time, seconds.
    moved: Option<f64>,
    /// Scale of the last picture.
    scale: f32,
    /// Index of the scale for moving pictures.
    moving: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Draw {
    /// Nothing: what is shown is right, or a picture is being drawn.
    Nothing,
    /// A picture with sides this many times those on the screen.
    Scaled(f32),
}

impl Pacing {
    /// Something has changed that does not move: a switch, a texture that has arrived.
    pub fn changed(&mut self) {
        self.is_stale = true;
    }

    /// The camera or the light has moved.
    pub fn moved(&mut self, seconds: f64) {
        self.is_stale = true;
        self.moved = Some(seconds);
    }

    /// What to draw at a time. `is_adaptive` allows smaller pictures. After [`Draw::Scaled`] a picture counts as being drawn.
    pub fn next(&mut self, seconds: f64, is_adaptive: bool) -> Draw {
        if self.is_drawing {
            return Draw::Nothing;
        }
        let is_moving = self.is_moving(seconds);
        if !is_moving {
            self.moved = None;
        }
        let scale = if is_moving && is_adaptive { SCALES[self.moving] } else { 1.0 };
        let is_coarse = self.scale < scale;
        if !(self.is_stale || is_coarse) {
            return Draw::Nothing;
        }
        self.is_stale = false;
        self.is_drawing = true;
        self.scale = scale;
        Draw::Scaled(scale)
    }

    /// The picture is done. `seconds` is how long it took.
    pub fn drawn(&mut self, seconds: f64) {
        self.is_drawing = false;
        // Time goes with the area; a part of it does not, so one step at a time.
        let area = |i: usize| f64::from(SCALES[i]).powi(2);
        let now = SCALES.iter().position(|&s| s == self.scale).unwrap_or(0);
        if seconds > WANTED_SECONDS && now + 1 < SCALES.len() {
            self.moving = self.moving.max(now + 1);
        } else if now == self.moving && now > 0 {
            let finer = seconds * area(now - 1) / area(now);
            if finer < 0.8 * WANTED_SECONDS {
                self.moving = now - 1;
            }
        }
    }

    /// A picture that was begun will never be done.
    pub fn lost(&mut self) {
        self.is_drawing = false;
        self.is_stale = true;
    }

    /// Whether the camera or the light moved a moment ago.
    pub fn is_moving(&self, seconds: f64) -> bool {
        self.moved.is_some_and(|moved| seconds - moved < REST_SECONDS)
    }

    /// Whether what is shown is the whole truth: drawn in full, after the last change.
    pub fn is_settled(&self) -> bool {
        !self.is_stale && !self.is_drawing && self.scale == 1.0
    }

    /// Seconds until [`Pacing::next`] should be asked again although nothing happens; nothing if never.
    pub fn wake_in(&self, seconds: f64) -> Option<f64> {
        let rest = self.moved.map(|moved| (moved + REST_SECONDS - seconds).max(0.0));
        if self.is_stale && !self.is_drawing { Some(0.0) } else { rest.filter(|_| self.scale < 1.0) }
    }
}
