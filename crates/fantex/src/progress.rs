//! A progress bar with rate and time left.

use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use fantex::bake::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use crate::interrupt::Interrupt;

/// Shows how far a long operation is, and ends it on Ctrl-C.
pub(crate) struct Bar<'a> {
    bar: ProgressBar,
    /// The most that was reported: threads may report out of order.
    done: AtomicU64,
    interrupt: &'a Interrupt,
}

impl<'a> Bar<'a> {
    /// A bar on standard error, or one that is not drawn. Without a terminal nothing is drawn in any case.
    pub(crate) fn new(label: &str, is_shown: bool, interrupt: &'a Interrupt) -> Self {
        let target =
            if is_shown { ProgressDrawTarget::stderr_with_hz(8) } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(None, target).with_message(label.to_owned());
        if let Ok(style) =
            ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} %  {texels}, {eta} left")
        {
            bar.set_style(style.with_key("texels", write_texels));
        }
        bar.enable_steady_tick(Duration::from_millis(250));
        Self { bar, done: AtomicU64::new(0), interrupt }
    }
}

/// `12.0 of 64.0 M texels, 3.1 M/s`.
fn write_texels(state: &ProgressState, text: &mut dyn Write) {
    let millions = |texels: f64| texels / 1e6;
    let (done, total) = (millions(state.pos() as f64), millions(state.len().unwrap_or(0) as f64));
    let _drawing_cannot_fail =
        write!(text, "{done:.1} of {total:.1} M texels, {:.1} M/s", millions(state.per_sec()));
}

impl Progress for Bar<'_> {
    fn report(&self, done: u64, total: u64) {
        if self.bar.length() != Some(total) {
            self.bar.set_length(total);
        }
        let before = self.done.fetch_max(done, Relaxed);
        self.bar.inc(done.saturating_sub(before));
    }

    fn is_cancelled(&self) -> bool {
        self.interrupt.is_requested()
    }
}

impl Drop for Bar<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
