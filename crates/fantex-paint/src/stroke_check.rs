//! Refuses strokes of a file whose values mean nothing: a sentence names the key, its value and what is allowed.

use std::fmt;
use std::ops::RangeInclusive;

use fantex_base::{Error, Result};

use crate::{Brush, ColorSettings, FillSettings, Layer, MaskMeasure, Size, StrokeSettings, ToolSettings};

/// Shares: how much of something.
const SHARE: RangeInclusive<f32> = 0.0..=1.0;

/// Angles between triangles, degrees.
const BENDS: RangeInclusive<f32> = 0.0..=180.0;

impl StrokeSettings {
    /// Refuses values that mean nothing.
    pub(crate) fn check(&self) -> Result<()> {
        self.symmetry.check()?;
        check_brush(&self.brush)?;
        self.check_tool()?;
        self.check_colors()?;
        self.check_layers()?;
        self.check_places()?;
        if self.lacks_places() {
            return Err(Error::invalid(
                "`samples` is [], but must name at least one place; only a fill of \"whole\" and a stroke with `dabs` need none",
            ));
        }
        Ok(())
    }

    /// Whether it has something to paint, but nowhere.
    pub(crate) fn lacks_places(&self) -> bool {
        let needs_places = self.fill != Some(FillSettings::Whole) && self.set_layers.is_none();
        needs_places && !self.channels.is_empty() && self.samples.is_empty() && self.dabs.is_empty()
    }

    fn check_tool(&self) -> Result<()> {
        match self.tool {
            ToolSettings::Opacity(to) => within("tool.opacity", to, SHARE)?,
            ToolSettings::Smudge { strength } => within("tool.smudge.strength", strength, SHARE)?,
            _ => {}
        }
        match self.fill {
            Some(FillSettings::Angle(degrees)) => within("fill.angle", degrees, BENDS)?,
            Some(FillSettings::Color(fill)) => {
                not_negative("fill.color.tolerance", fill.tolerance)?;
                not_negative("fill.color.softness", fill.softness)?;
            }
            _ => {}
        }
        let decal = self.decal.as_ref().map(|decal| ("decal.size", decal.size));
        let text = self.text.as_ref().map(|text| ("text.size", text.size));
        decal.into_iter().chain(text).try_for_each(|(key, size)| has_length(key, size))
    }

    fn check_colors(&self) -> Result<()> {
        self.channels.iter().enumerate().try_for_each(|(index, channel)| match channel.color {
            ColorSettings::Linear([.., alpha]) => {
                within(format_args!("channels[{index}].color.linear[3]"), alpha, SHARE)
            }
            _ => Ok(()),
        })
    }

    fn check_layers(&self) -> Result<()> {
        if self.set_layers.is_none() && !self.layer_moves.is_empty() {
            return Err(Error::invalid(
                "`layer_moves` says what is copied and merged where `set_layers` replaces the layers; without that it does nothing",
            ));
        }
        if let Some(layer) = &self.layer {
            within("layer.opacity", layer.opacity, SHARE)?;
            let outside = layer.fill.as_ref().and_then(|fill| fill.outside);
            outside.map_or(Ok(()), |outside| within("layer.fill.outside", outside, SHARE))?;
        }
        let mut layers = self.set_layers.iter().flatten().enumerate();
        layers.try_for_each(|(index, layer)| check_layer(format_args!("set_layers[{index}]"), layer))
    }

    fn check_places(&self) -> Result<()> {
        for (index, sample) in self.samples.iter().enumerate() {
            within(format_args!("samples[{index}].pressure"), sample.pressure, SHARE)?;
        }
        for (index, dab) in self.dabs.iter().enumerate() {
            not_negative(format_args!("dabs[{index}].radius"), dab.radius)?;
            within(format_args!("dabs[{index}].hardness"), dab.hardness, SHARE)?;
            within(format_args!("dabs[{index}].flow"), dab.flow, SHARE)?;
            let is_aspect = dab.aspect > 0.0 && dab.aspect <= 1.0;
            allowed(is_aspect, format_args!("dabs[{index}].aspect"), dab.aspect, "above 0 and at most 1")?;
        }
        Ok(())
    }
}

fn check_brush(brush: &Brush) -> Result<()> {
    within("brush.smoothing", brush.smoothing, SHARE)?;
    within("brush.pressure.size", brush.pressure.size, SHARE)?;
    within("brush.pressure.flow", brush.pressure.flow, SHARE)?;
    not_negative("brush.jitter.position", brush.jitter.position)?;
    within("brush.jitter.size", brush.jitter.size, SHARE)?;
    within("brush.jitter.flow", brush.jitter.flow, SHARE)
}

/// Refuses a layer whose values mean nothing. `key`: of the layer.
pub(crate) fn check_layer(key: impl fmt::Display, layer: &Layer) -> Result<()> {
    within(format_args!("{key}.opacity"), layer.opacity, SHARE)?;
    if let Some(outside) = layer.mask {
        within(format_args!("{key}.mask"), outside, SHARE)?;
    }
    match layer.mask_source.map(|source| source.by) {
        Some(MaskMeasure::Height { axis }) => {
            check_axis(format_args!("{key}.mask_source.by.height.axis"), axis)
        }
        Some(MaskMeasure::Slope { axis }) => {
            check_axis(format_args!("{key}.mask_source.by.slope.axis"), axis)
        }
        _ => Ok(()),
    }
}

/// Refuses what is no axis.
pub(crate) fn check_axis(key: impl fmt::Display, axis: usize) -> Result<()> {
    allowed(axis <= 2, key, axis, "0 (x), 1 (y) or 2 (z)")
}

fn within(key: impl fmt::Display, value: f32, range: RangeInclusive<f32>) -> Result<()> {
    let (low, high) = (range.start(), range.end());
    allowed(range.contains(&value), key, value, format_args!("{low} to {high}"))
}

fn not_negative(key: impl fmt::Display, value: f32) -> Result<()> {
    allowed(value >= 0.0 && value.is_finite(), key, value, "finite and at least 0")
}

fn has_length(key: &str, size: Size) -> Result<()> {
    let (Size::Texels(length) | Size::World(length)) = size;
    allowed(length > 0.0 && length.is_finite(), key, length, "finite and above 0")
}

/// `what` says what is allowed.
fn allowed(
    is_allowed: bool,
    key: impl fmt::Display,
    value: impl fmt::Display,
    what: impl fmt::Display,
) -> Result<()> {
    let sentence = || format!("`{key}` is {value}, but must be {what}");
    if is_allowed { Ok(()) } else { Err(Error::invalid(sentence())) }
}
