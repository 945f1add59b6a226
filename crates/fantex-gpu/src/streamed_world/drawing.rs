//! What is drawn of what there is of a world.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use fantex_base::Result;
use fantex_stream::{ObjectState, drawn_objects};
use glam::Vec3;

use super::{Object, StreamedWorld};
use crate::{FanModel, FrameContext, Gpu, Model, ModelSpace};

impl StreamedWorld {
    /// Lists what is drawn, the nearest first. Returns whether that is something else than before.
    pub(super) fn order_drawn(&mut self, eye: Vec3) -> bool {
        let mut drawn = drawn_objects(&self.shapes, &self.roots, |index| self.objects[index].state());
        self.sort_by_distance(&mut drawn, eye);
        let statistics = &mut self.statistics;
        (statistics.whole, statistics.previews, statistics.coarse, statistics.triangles) = (0, 0, 0, 0);
        for &index in &drawn {
            let Some(object) = self.world.objects.get(index) else {
                statistics.coarse += 1;
                statistics.triangles += self.world.coarse[index - self.world.objects.len()].triangles;
                continue;
            };
            match self.objects[index].is_whole_drawn() {
                true => {
                    (statistics.whole, statistics.triangles) =
                        (statistics.whole + 1, statistics.triangles + object.triangles)
                }
                false => {
                    statistics.previews += 1;
                    statistics.triangles += object.preview.map_or(0, |preview| preview.triangles);
                }
            }
        }
        let mut shown: Vec<(usize, bool)> =
            drawn.iter().map(|&index| (index, self.objects[index].is_whole_drawn())).collect();
        shown.sort_unstable();
        let has_changed = shown != self.shown;
        self.revision += u64::from(has_changed);
        (self.drawn, self.shown) = (drawn, shown);
        has_changed
    }

    fn drawn(&self) -> impl DoubleEndedIterator<Item = &FanModel> {
        self.drawn.iter().filter_map(|&index| self.objects[index].drawn())
    }
}

impl Object {
    fn state(&self) -> ObjectState {
        ObjectState { is_there: self.drawn().is_some(), is_divided: self.is_divided }
    }

    fn is_whole_drawn(&self) -> bool {
        self.whole.get().is_some_and(|whole| whole.filling.is_none() || self.preview.get().is_none())
    }

    /// What is drawn of it.
    fn drawn(&self) -> Option<&FanModel> {
        if self.is_whole_drawn() {
            self.whole.get().map(|whole| &whole.streamed.model)
        } else {
            self.preview.get()
        }
    }

    fn drawn_mut(&mut self) -> Option<&mut FanModel> {
        match self.is_whole_drawn() {
            true => self.whole.get_mut().map(|whole| &mut whole.streamed.model),
            false => self.preview.get_mut(),
        }
    }
}

impl Model for StreamedWorld {
    fn space(&self) -> &ModelSpace {
        &self.space
    }

    fn shadow_revision(&self) -> u64 {
        // Models come and go with revisions of their own: sums of them may be the same for others.
        let mut hasher = DefaultHasher::new();
        self.revision.hash(&mut hasher);
        for &(index, _) in &self.shown {
            self.objects[index].drawn().map(Model::shadow_revision).hash(&mut hasher);
        }
        hasher.finish()
    }

    fn prepare(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameContext<'_>,
    ) -> Result<()> {
        for &index in &self.drawn {
            if let Some(model) = self.objects[index].drawn_mut() {
                model.prepare(gpu, encoder, frame)?;
            }
        }
        Ok(())
    }

    fn draw_casters(&self, pass: &mut wgpu::RenderPass<'_>) {
        self.drawn().for_each(|model| model.draw_casters(pass));
    }

    fn draw_opaque(&self, pass: &mut wgpu::RenderPass<'_>) {
        self.drawn().for_each(|model| model.draw_opaque(pass));
    }

    fn draw_layered(&self, pass: &mut wgpu::RenderPass<'_>) {
        self.drawn().rev().for_each(|model| model.draw_layered(pass));
    }
}
