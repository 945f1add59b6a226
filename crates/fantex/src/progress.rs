//! A progress bar with rate and time left.

use std::time::Duration;

use fantex::bake::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::interrupt::Interrupt;

/// Shows how far a long operation is, and ends it on Ctrl-C.
pub(crate) struct Bar<'a> {
    bar: ProgressBar,
    interrupt: &'a Interrupt,
}

impl<'a> Bar<'a> {
    /// A bar on standard error, or one that is not drawn. Without a terminal nothing is drawn in any case.
    pub(crate) fn new(label: &str, is_shown: bool, interrupt: &'a Interrupt) -> Self {
        let target =
            if is_shown { ProgressDrawTarget::stderr_with_hz(8) } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(None, target).with_message(label.to_owned());
        let template =
            "{msg} {wide_bar} {percent:>3} %  {human_pos} of {human_len} texels  {per_sec}  {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(250));
        Self { bar, interrupt }
    }
}

impl Progress for Bar<'_> {
    fn report(&self, done: u64, total: u64) {
        self.bar.set_length(total);
        self.bar.set_position(done);
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
