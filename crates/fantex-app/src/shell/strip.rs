//! A strip of the window instead of the whole: software adapters spend most of their time on pixels, and of some sessions nobody looks at them.

use std::time::{Duration, Instant};

use eframe::egui::{Context, FullOutput, Plugin, Rect, vec2};

/// Height of what is drawn, points.
const STRIP_POINTS: f32 = 24.0;

/// How long a frame takes at least. Steps count frames where something beside the window goes on, which must not depend on how
/// quickly a strip is drawn.
const FRAME_TIME: Duration = Duration::from_millis(33);

/// Draws the window's middle rows only, unless told otherwise. All that is drawn in them is submitted as ever.
#[derive(Debug, Default)]
pub(super) struct Strip {
    /// Whether the next frames are drawn as a whole: a picture of the window is due.
    pub(super) is_lifted: bool,
    /// When the last frame ended.
    last: Option<Instant>,
}

impl Plugin for Strip {
    fn debug_name(&self) -> &'static str {
        "strip"
    }

    fn output_hook(&mut self, ctx: &Context, output: &mut FullOutput) {
        if !self.is_lifted {
            let window = ctx.content_rect();
            let strip = Rect::from_center_size(window.center(), vec2(window.width(), STRIP_POINTS));
            for shape in &mut output.shapes {
                shape.clip_rect = shape.clip_rect.intersect(strip);
            }
        }
        let taken = self.last.map_or(FRAME_TIME, |last| last.elapsed());
        std::thread::sleep(FRAME_TIME.saturating_sub(taken));
        self.last = Some(Instant::now());
    }
}
