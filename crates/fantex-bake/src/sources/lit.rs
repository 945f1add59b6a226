//! The finished picture of a surface: its light, multiplied with its colour.

use fantex_store::ChannelKind;
use glam::{Vec3, Vec4};

use crate::{LightMapSource, Prefilter, Source, SourceChannel, SurfacePoint};

/// Light as base colour, with the colour and the alpha of another source, or alone.
#[derive(Debug)]
pub struct LitSource<'a> {
    light: LightMapSource<'a>,
    colors: Option<Colors<'a>>,
}

/// A source that gives base colours.
struct Colors<'a> {
    source: &'a dyn Source,
    channels: usize,
    base_color: usize,
    emission: Option<usize>,
    has_alpha: bool,
}

impl std::fmt::Debug for Colors<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Colors").field("channels", &self.channels).finish_non_exhaustive()
    }
}

impl<'a> LitSource<'a> {
    /// The light, and what it falls on: without a source, or with one that has no base colour, the light alone.
    pub fn new(light: LightMapSource<'a>, source: Option<&'a dyn Source>) -> Self {
        let colors = source.and_then(|source| {
            let channels = source.channels();
            let position = |kind: ChannelKind| channels.iter().position(|c| c.kind == kind);
            let base_color = position(ChannelKind::BaseColor)?;
            Some(Colors {
                source,
                channels: channels.len(),
                base_color,
                emission: position(ChannelKind::Emission),
                has_alpha: channels[base_color].has_alpha,
            })
        });
        Self { light, colors }
    }

    /// The light, for its noise.
    pub fn light(&self) -> &LightMapSource<'a> {
        &self.light
    }
}

impl Source for LitSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        let has_alpha = self.colors.as_ref().is_some_and(|colors| colors.has_alpha);
        vec![SourceChannel { kind: ChannelKind::BaseColor, has_alpha, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Box
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        let lambda = point.lambda.clamp(Vec3::ZERO, Vec3::ONE);
        let lambda = lambda / lambda.element_sum().max(f32::MIN_POSITIVE);
        let light = self.light.illumination(point.triangle, lambda, point.lambda_steps).value;
        let (color, emission) = self.colors.as_ref().map_or((Vec4::ONE, Vec3::ZERO), |colors| {
            let mut all = vec![Vec4::ZERO; colors.channels];
            colors.source.evaluate(point, &mut all);
            (all[colors.base_color], colors.emission.map_or(Vec3::ZERO, |c| all[c].truncate()))
        });
        values[0] = (color.truncate() * light + emission).extend(color.w);
    }
}
