//! What takes long: done in slices between other orders, told of, given up, and begun with what is seen.

use std::cmp::Ordering;
use std::time::Instant;

use fantex_paint::PaintError;
use glam::DVec2;

use super::{Order, Report, SLICE, Viewpoint, Worker};

impl Worker {
    /// Orders that had to wait, as long as nothing goes on that takes long.
    pub(super) fn act_on_waiting(&mut self) {
        while !self.is_working()
            && let Some(order) = self.waiting.pop_front()
        {
            self.check(|worker| worker.act(order));
        }
    }

    /// Whether commits are to be few.
    pub(super) fn is_drawing(&self) -> bool {
        self.stroke.is_some() || self.is_working()
    }

    /// Whether something goes on that takes long.
    pub(super) fn is_working(&self) -> bool {
        self.painter.has_work() && !self.is_stuck
    }

    /// Goes on with what takes long, and tells how far it is.
    pub(super) fn work_on(&mut self) {
        if self.is_working() {
            // Before the first slice, too.
            self.tell_progress();
            match self.painter.work_on(Instant::now() + SLICE) {
                Ok(true) => self.tell_state(),
                Ok(false) => {}
                Err(error) => {
                    self.tell(Report::Failed(error.to_string()));
                    self.give_up();
                }
            }
        }
        self.tell_progress();
    }

    fn tell_progress(&mut self) {
        let progress = self.painter.work_progress().filter(|_| !self.is_stuck);
        let share = progress.as_ref().map(|progress| (progress.share * 1000.0) as u32);
        if share != self.told_share {
            self.told_share = share;
            self.tell(Report::Work(progress));
            (self.wake)();
        }
    }

    /// Takes back what takes long, after it has failed.
    fn give_up(&mut self) {
        let before = self.painter.work_progress().map(|progress| progress.is_undo);
        let given_up = self.painter.cancel_work();
        let after = self.painter.work_progress().map(|progress| progress.is_undo);
        self.is_stuck = given_up.is_err() || (before == after && before.is_some());
    }

    /// Lets what is seen from somewhere come first, the nearest first.
    pub(super) fn look_from(&mut self, view: &Viewpoint) {
        let surface = self.painter.surface().clone();
        let place = surface.mesh().world_from_mesh;
        self.painter.prefer_groups(|group| {
            let Some(triangle) = surface.triangle_of_group(group) else { return f32::NEG_INFINITY };
            let [a, b, c] = surface.mesh().triangle_positions(triangle as usize);
            let point = place.point((a + b + c) / 3.0);
            let is_seen = view
                .project(point)
                .is_some_and(|at| at.cmpge(DVec2::splat(-0.05)).all() && at.cmple(DVec2::splat(1.05)).all());
            let facing = surface.outer_normal(triangle).dot(view.rig.eye - point) > 0.0;
            let nearness = -((point - view.rig.eye).length() / place.scale) as f32;
            // Mesh units are about the model's size: what is seen is nearer than anything else.
            nearness - if is_seen { 0.0 } else { 1e4 } - if facing { 0.0 } else { 1e3 }
        });
    }

    pub(super) fn go_to_step(&mut self, count: usize) -> Result<(), PaintError> {
        self.stroke = None;
        self.painter.end()?;
        let done = self.painter.history().done().len();
        let is_started = match done.cmp(&count) {
            Ordering::Greater => self.painter.start_undo()?,
            Ordering::Less => self.painter.start_redo()?,
            Ordering::Equal => false,
        };
        if is_started {
            // And on from there.
            self.waiting.push_front(Order::GoTo(count));
        }
        self.tell_state();
        Ok(())
    }
}

/// Whether an order waits until what takes long is done.
pub(super) fn must_wait(order: &Order) -> bool {
    !matches!(
        order,
        Order::Pages
            | Order::Release(_)
            | Order::Look(_)
            | Order::GiveUp
            | Order::Commit
            | Order::Pick(_)
            | Order::Close
    )
}
