//! The texels of a block: what the source says at their points, many points at a time.

use fantex_base::Result;
use fantex_texture::levels::Raster;
use glam::{Vec3, Vec4};

use super::{TileBaker, narrow};
use crate::{Fit, TexelPoint, clear_what_is_no_number};

/// A block whose points are evaluated.
pub(super) struct Evaluation<'a, 'b> {
    baker: &'a TileBaker<'b>,
    group: u32,
    /// Light without its noise, where it is denoised: per texel; none at those that are hidden.
    smooth: Option<Vec<Option<Vec3>>>,
    raster: Raster,
    /// Texels that lie under something.
    hidden: Vec<u32>,
    /// Points that are evaluated at once.
    at_once: usize,
    /// Points that wait, and their texels.
    points: Vec<TexelPoint>,
    texels: Vec<u32>,
    /// Those of all channels for every point.
    values: Vec<Vec4>,
}

impl<'a, 'b> Evaluation<'a, 'b> {
    pub(super) fn new(
        baker: &'a TileBaker<'b>,
        group: u32,
        raster: Raster,
        smooth: Option<Vec<Option<Vec3>>>,
    ) -> Self {
        let at_once = baker.source.points_at_once();
        Self {
            baker,
            group,
            smooth,
            raster,
            hidden: Vec::new(),
            at_once,
            points: Vec::with_capacity(at_once),
            texels: Vec::with_capacity(at_once),
            values: Vec::with_capacity(at_once * baker.plans.len()),
        }
    }

    /// Takes the point of a texel.
    #[inline]
    pub(super) fn add(&mut self, texel: u32, point: TexelPoint) -> Result<()> {
        self.points.push(point);
        self.texels.push(texel);
        match self.texels.len() < self.at_once {
            true => Ok(()),
            false => self.evaluate(),
        }
    }

    /// The texels of all points, and which of them lie under something.
    pub(super) fn finish(mut self) -> Result<(Raster, Vec<u32>)> {
        self.evaluate()?;
        Ok((self.raster, self.hidden))
    }

    /// Evaluates the points that wait.
    fn evaluate(&mut self) -> Result<()> {
        self.baker.meter.check()?;
        let light = self.light()?;
        if self.baker.options.fit == Fit::Point {
            self.points.iter_mut().for_each(narrow);
        }
        self.ask_source(light.as_deref())?;
        clear_what_is_no_number(&mut self.values);
        self.baker.turn_vectors(self.group, &self.points, &mut self.values);
        self.store();
        for (&texel, light) in self.texels.iter().zip(light.iter().flatten()) {
            if light.is_none() {
                self.raster.valid[texel as usize] = false;
                self.hidden.push(texel);
            }
        }
        if self.raster.has_cut_outs() {
            for (&texel, point) in self.texels.iter().zip(&self.points) {
                self.raster.set_alpha_mode(texel as usize, self.baker.alpha_mode(point.at.triangle));
            }
        }
        self.points.clear();
        self.texels.clear();
        Ok(())
    }

    /// Of a source of light, that at the points; none at those that are hidden.
    fn light(&self) -> Result<Option<Vec<Option<Vec3>>>> {
        let Some(light) = self.baker.source.light_map() else { return Ok(None) };
        if let Some(smooth) = &self.smooth {
            return Ok(Some(self.texels.iter().map(|&texel| smooth[texel as usize]).collect()));
        }
        let noisy = self.points.iter().map(|point| light.noisy(point, || self.baker.meter.check()));
        noisy.collect::<Result<_>>().map(Some)
    }

    /// The values at the points, as the source says them.
    fn ask_source(&mut self, light: Option<&[Option<Vec3>]>) -> Result<()> {
        let Self { baker, points, values, .. } = self;
        let (source, channels) = (baker.source, baker.plans.len());
        // Sources that have nothing to say about a point leave zeros, not what was there before.
        values.clear();
        values.resize(points.len() * channels, Vec4::ZERO);
        match light {
            None if source.has_slow_points() => {
                for (point, values) in points.iter().zip(values.chunks_mut(channels)) {
                    baker.meter.check()?;
                    source.evaluate(point, values);
                }
            }
            None => source.evaluate_all(points, values),
            Some(light) => {
                let light: Vec<Vec3> = light.iter().map(|light| light.unwrap_or_default()).collect();
                source.evaluate_lit(points, &light, values);
            }
        }
        Ok(())
    }

    /// Copies the values to their texels.
    fn store(&mut self) {
        let Self { baker, raster, texels, values, .. } = self;
        let channels = baker.plans.len();
        if channels == 1 {
            for (&texel, &value) in texels.iter().zip(values.iter()) {
                (raster.values[texel as usize], raster.valid[texel as usize]) = (value, true);
            }
            return;
        }
        // Texels that follow one another are copied together.
        let mut values = values.as_slice();
        for run in texels.chunk_by(|before, after| before + 1 == *after) {
            let (first, of_run) = (run[0] as usize, run.len() * channels);
            let own;
            (own, values) = values.split_at(of_run);
            raster.values[first * channels..][..of_run].copy_from_slice(own);
            raster.valid[first..][..run.len()].fill(true);
        }
    }
}
