//! Values of the tables as those of the engine.

use fantex_look::data::{
    Channel as ChannelOfUse, ChannelName, Color, CombineName, Factor, FilterName, OperationName, RampName,
    StopTable, WrapName,
};
use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::color::linear_from_srgb;
use crate::combine::{Channel, CombineMode, Operation};
use crate::{ColorRamp, ColorRampError, Filter, RampInterpolation, Wrap};

/// Linear RGBA of a colour.
pub fn linear_color(color: Color) -> Vec4 {
    match color {
        Color::Srgb([r, g, b, a]) => {
            let light = |byte: u8| linear_from_srgb(f32::from(byte) / 255.0);
            Vec4::new(light(r), light(g), light(b), f32::from(a) / 255.0)
        }
        Color::Linear(numbers) => Vec4::from_array(numbers.map(|n| n as f32)),
    }
}

/// Linear RGB of a colour.
pub fn linear_rgb(color: Color) -> Vec3 {
    linear_color(color).truncate()
}

pub(super) fn factor(factor: Factor) -> Vec4 {
    match factor {
        Factor::Number(number) => Vec3::splat(number as f32).extend(1.0),
        Factor::Color(color) => linear_color(color),
    }
}

pub(super) fn vec2(values: [f64; 2]) -> Vec2 {
    Vec2::from_array(values.map(|v| v as f32))
}

pub(super) fn vec3(values: [f64; 3]) -> Vec3 {
    DVec3::from_array(values).as_vec3()
}

pub(super) fn channel(channel: ChannelOfUse) -> Channel {
    match channel {
        ChannelOfUse::R => Channel::Red,
        ChannelOfUse::G => Channel::Green,
        ChannelOfUse::B => Channel::Blue,
        ChannelOfUse::A => Channel::Alpha,
    }
}

pub(super) fn channel_name(name: ChannelName) -> Channel {
    match name {
        ChannelName::R => Channel::Red,
        ChannelName::G => Channel::Green,
        ChannelName::B => Channel::Blue,
        ChannelName::A => Channel::Alpha,
        ChannelName::Luminance => Channel::Luminance,
        ChannelName::Zero => Channel::Zero,
        ChannelName::One => Channel::One,
    }
}

pub(super) fn filter(name: FilterName) -> Filter {
    match name {
        FilterName::Nearest => Filter::Nearest,
        FilterName::Bilinear => Filter::Bilinear,
        FilterName::Bicubic => Filter::Bicubic,
        FilterName::Trilinear => Filter::Trilinear,
        FilterName::Anisotropic => Filter::Anisotropic,
        FilterName::Ewa => Filter::Ewa,
    }
}

pub(super) fn wrap(name: WrapName) -> Wrap {
    match name {
        WrapName::Repeat => Wrap::Repeat,
        WrapName::Clamp => Wrap::Clamp,
        WrapName::Mirror => Wrap::Mirror,
        WrapName::Border => Wrap::Border,
    }
}

pub(super) fn combine_mode(name: CombineName) -> CombineMode {
    match name {
        CombineName::Replace => CombineMode::Replace,
        CombineName::Modulate => CombineMode::Modulate,
        CombineName::Decal => CombineMode::Decal,
        CombineName::Blend => CombineMode::Blend,
    }
}

pub(super) fn operation(name: OperationName) -> Operation {
    match name {
        OperationName::Add => Operation::Add,
        OperationName::Subtract => Operation::Subtract,
        OperationName::Multiply => Operation::Multiply,
        OperationName::Minimum => Operation::Minimum,
        OperationName::Maximum => Operation::Maximum,
    }
}

pub(super) fn ramp(stops: &[StopTable], interpolation: RampName) -> Result<ColorRamp, ColorRampError> {
    let stops = stops.iter().map(|stop| (stop.at as f32, linear_color(stop.color))).collect();
    let interpolation = match interpolation {
        RampName::Linear => RampInterpolation::Linear,
        RampName::Smooth => RampInterpolation::Smooth,
        RampName::Constant => RampInterpolation::Constant,
    };
    ColorRamp::new(stops, interpolation)
}
