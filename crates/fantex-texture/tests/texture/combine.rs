//! Textures made of textures.

use std::sync::Arc;

use fantex_texture::combine::{
    Binary, Channel, Clamp, Combine, CombineMode, Contours, Factor, Field, Layer, LayerMode, Layers, Mix,
    Operation, RampTexture, Remap, Swizzle, TextureUse,
};
use fantex_texture::coordinates::Parameter;
use fantex_texture::look::Slot;
use fantex_texture::{Color, ColorRamp, RampInterpolation, ShadingPoint, Texture, UvPoint};
use glam::{Vec2, Vec3, Vec4};

use crate::common::{assert_close, shading_point};

const T: Vec4 = Vec4::new(0.2, 0.4, 0.8, 0.25);
const F: Vec4 = Vec4::new(1.0, 0.5, 0.25, 0.5);
const C: Vec4 = Vec4::new(0.0, 1.0, 2.0, 1.0);

fn at() -> ShadingPoint<'static> {
    shading_point(Vec3::new(1.0, 2.0, 3.0), Vec3::Y)
}

fn slot(texture: impl Texture + 'static) -> Slot {
    Slot::Texture(Arc::new(texture))
}

fn assert_value(texture: &dyn Texture, expected: Vec4, what: &str) {
    assert_close(texture.evaluate(&at()).to_array(), expected.to_array(), 1e-5, what);
}

#[test]
fn environment_modes_are_those_of_opengl() {
    let combined =
        |mode| Combine { mode, texture: Slot::Constant(T), fragment: Slot::Constant(F), constant: Color(C) };
    let expect = |mode, expected| assert_value(&combined(mode), expected, &format!("{mode:?}"));
    expect(CombineMode::Replace, T);
    expect(CombineMode::Modulate, Vec4::new(0.2, 0.2, 0.2, 0.125));
    expect(CombineMode::Decal, Vec4::new(0.8, 0.475, 0.3875, 0.5));
    expect(CombineMode::Blend, Vec4::new(0.8, 0.7, 1.65, 0.125));
}

#[test]
fn layers_cover_by_alpha_mask_and_opacity() {
    let red = Vec4::new(1.0, 0.0, 0.0, 1.0);
    let blue = Vec4::new(0.0, 0.0, 1.0, 1.0);
    let layers = |layer: Layer, base| Layers { base: Slot::Constant(base), layers: vec![layer] };
    let over = Layer::over(Slot::Constant(red));
    assert_value(&layers(over.clone(), blue), red, "an opaque layer");
    let half = Layer { opacity: Slot::number(0.5), mask: Slot::number(0.5), ..over.clone() };
    assert_value(&layers(half.clone(), blue), Vec4::new(0.25, 0.0, 0.75, 1.0), "a quarter");
    // The colour of what is not there does not count.
    assert_value(&layers(half, Vec4::Z), red.truncate().extend(0.25), "over nothing");
    assert_value(&layers(Layer { mask: Slot::number(0.0), ..over.clone() }, blue), blue, "masked out");
    let tinted = Layer { mode: LayerMode::Modulate, opacity: Slot::number(0.5), ..over };
    assert_value(&layers(tinted, Vec4::ONE), Vec4::new(1.0, 0.5, 0.5, 1.0), "modulated");
    assert_value(&Layers { base: Slot::Constant(F), layers: Vec::new() }, F, "no layer");
}

#[test]
fn arithmetic_is_what_it_says() {
    let input = || Slot::Constant(F);
    assert_value(&Swizzle::select(input(), Channel::Green), Vec4::new(0.5, 0.5, 0.5, 1.0), "green");
    let channels = [Channel::Luminance, Channel::Zero, Channel::One, Channel::Alpha];
    let luminance = 0.2126 + 0.5 * 0.7152 + 0.25 * 0.0722;
    assert_value(&Swizzle { input: input(), channels }, Vec4::new(luminance, 0.0, 1.0, 0.5), "swizzle");
    let texture: Arc<dyn Texture> = Arc::new(F);
    let inverted = TextureUse { factor: Factor::Number(-1.0), offset: 1.0, ..TextureUse::plain(texture) };
    assert_value(&inverted, Vec4::new(0.0, 0.5, 0.75, 0.5), "invert");
    let blue = TextureUse { channel: Some(Channel::Blue), ..inverted };
    assert_value(&blue, Vec4::new(0.75, 0.75, 0.75, 1.0), "one channel");
    let binary = |operation| Binary { operation, a: Slot::Constant(T), b: Slot::Constant(F) };
    assert_value(&binary(Operation::Add), Vec4::new(1.2, 0.9, 1.05, 0.25), "add");
    assert_value(&binary(Operation::Subtract), Vec4::new(-0.8, -0.1, 0.55, 0.25), "subtract");
    assert_value(&binary(Operation::Multiply), T * F, "multiply");
    assert_value(&binary(Operation::Minimum), Vec4::new(0.2, 0.4, 0.25, 0.25), "minimum");
    assert_value(&binary(Operation::Maximum), Vec4::new(1.0, 0.5, 0.8, 0.25), "maximum");
    assert_value(&binary(Operation::Divide), Vec4::new(0.2, 0.8, 3.2, 0.25), "divide");
    let of = |operation, a: [f32; 3], b: f32| {
        let [x, y, z] = a;
        Binary { operation, a: Slot::Constant(Vec4::new(x, y, z, 1.0)), b: Slot::Constant(Vec4::splat(b)) }
    };
    let numbers = [7.25, -0.75, 2.5];
    assert_value(&of(Operation::Modulo, numbers, 2.0), Vec4::new(1.25, 1.25, 0.5, 1.0), "modulo");
    assert_value(&of(Operation::Modulo, numbers, 0.0), Vec4::new(7.25, -0.75, 2.5, 1.0), "modulo 0");
    assert_value(&of(Operation::Divide, numbers, 0.0), Vec4::W, "divide by 0");
    assert_value(&of(Operation::Round, numbers, 0.0), Vec4::new(7.0, -1.0, 3.0, 1.0), "round");
    assert_value(&of(Operation::Floor, numbers, 0.0), Vec4::new(7.0, -1.0, 2.0, 1.0), "floor");
    assert_value(&of(Operation::Fract, numbers, 0.0), Vec4::new(0.25, 0.25, 0.5, 1.0), "fract");
    let clamp = Clamp { input: input(), low: 0.3, high: 0.6 };
    assert_value(&clamp, Vec4::new(0.6, 0.5, 0.3, 0.5), "clamp");
    let remap = Remap { input: input(), from: [0.5, 0.0], to: [10.0, 20.0], clamp: true };
    assert_value(&remap, Vec4::new(10.0, 10.0, 15.0, 0.5), "remap");
    assert_value(&Remap { clamp: false, ..remap }, Vec4::new(0.0, 10.0, 15.0, 0.5), "remap beyond");
    let mix =
        |share| Mix { a: Slot::Constant(Vec4::W), b: Slot::Constant(Vec4::ONE), mask: Slot::number(share) };
    assert_value(&mix(0.25), Vec4::new(0.25, 0.25, 0.25, 1.0), "mix");
    assert_value(&mix(7.0), Vec4::ONE, "mix beyond");
    assert!(Remap { input: input(), from: [1.0, 1.0], to: [0.0, 1.0], clamp: true }.check().is_err());
    assert!(Clamp { input: input(), low: 1.0, high: 0.0 }.check().is_err());
}

#[test]
fn fields_say_what_the_surface_is() {
    let number = |parameter: Parameter| parameter.evaluate(&at()).x;
    assert_eq!(number(Parameter::default()), 2.0);
    assert_eq!(number(Parameter::Along { origin: Vec3::X, direction: 2.0 * Vec3::Z }), 6.0);
    assert_eq!(number(Parameter::Distance { center: Vec3::new(1.0, 2.0, -1.0) }), 4.0);
    // However long the axis' direction is, and wherever along it the point lies.
    let center = Vec3::new(-2.0, 7.0, -1.0);
    assert_eq!(number(Parameter::AxisDistance { center, direction: 3.0 * Vec3::Y }), 5.0);
    assert_eq!(number(Parameter::AxisDistance { center: Vec3::Z, direction: Vec3::new(1.0, 2.0, 2.0) }), 0.0);
    assert!((number(Parameter::Slope { up: Vec3::Z }) - 90.0).abs() < 1e-4);
    assert_eq!(number(Parameter::Slope { up: 2.0 * Vec3::Y }), 0.0);
    assert_eq!(number(Parameter::Facing), 1.0);
    assert!(Parameter::Facing.is_view_dependent() && Parameter::Time.is_animated());
    assert_value(&Field::Normal, Vec4::new(0.5, 1.0, 0.5, 1.0), "normal");
    let position = Field::Position { min: Vec3::ZERO, max: Vec3::splat(4.0) };
    assert_value(&position, Vec4::new(0.25, 0.5, 0.75, 1.0), "position");
    assert_value(&Field::Uv { set: 3 }, Vec4::W, "no such set");
    assert!(Field::Position { min: Vec3::ZERO, max: Vec3::X }.check().is_err());
    assert!(Parameter::Slope { up: Vec3::ZERO }.check().is_err());
    assert!(Parameter::AxisDistance { center, direction: Vec3::ZERO }.check().is_err());
}

#[test]
fn parameters_change_as_their_steps_say() {
    let uv = [UvPoint { uv: Vec2::new(0.2, 0.6), steps: [Vec2::new(0.01, 0.02), Vec2::new(0.03, -0.01)] }];
    let n = Vec3::new(0.5, 0.6, 0.62).normalize();
    let (right, down) = n.any_orthonormal_pair();
    let steps = [right * 0.01, down * 0.02];
    let eye = Some(Vec3::new(0.1, 0.9, 0.3).normalize().into());
    let at = ShadingPoint { uv: &uv, position_steps: steps, normal_steps: steps, eye, ..shading_point(n, n) };
    for parameter in [
        Parameter::Along { origin: Vec3::ONE, direction: Vec3::new(1.0, 2.0, -0.5) },
        Parameter::Distance { center: Vec3::X },
        Parameter::AxisDistance { center: Vec3::X, direction: Vec3::new(1.0, 2.0, -0.5) },
        Parameter::Slope { up: Vec3::Y },
        Parameter::Facing,
        Parameter::U { set: 0 },
        Parameter::V { set: 0 },
        Parameter::U { set: 1 },
        Parameter::Time,
    ] {
        let value = |a: f32, b: f32| at.shifted(a, b, |point| parameter.value(point));
        let expected = [value(0.5, 0.0) - value(-0.5, 0.0), value(0.0, 0.5) - value(0.0, -0.5)];
        for (got, expected) in parameter.steps(&at).into_iter().zip(expected) {
            assert!((got - expected).abs() < 1e-5, "{parameter:?}: {got} against {expected}");
        }
    }
}

/// A point of a slope that rises by `rise` from pixel to pixel to the right.
fn slope_point(height: f32, rise: f32) -> ShadingPoint<'static> {
    ShadingPoint {
        position_steps: [Vec3::new(1.0, rise, 0.0), Vec3::Z],
        ..shading_point(Vec3::new(0.0, height, 0.0), Vec3::Y)
    }
}

#[test]
fn ramps_are_averaged_over_the_footprint() {
    let stops = vec![(0.0, Vec4::W), (1.0, Vec4::ONE), (1.0, Vec4::W), (2.0, Vec4::ONE)];
    let ramp = ColorRamp::new(stops, RampInterpolation::Constant).unwrap();
    let colored = RampTexture { input: slot(Parameter::default()), channel: Channel::Red, ramp };
    // Black below 2 and white above: the edge pixel is grey by its share.
    for (height, expected) in [(1.0, 0.0), (1.95, 0.25), (2.0, 0.5), (2.05, 0.75), (2.2, 1.0)] {
        let got = colored.evaluate(&slope_point(height, 0.2)).x;
        assert!((got - expected).abs() < 1e-5, "{got} at {height}");
    }
    assert_eq!(colored.evaluate(&slope_point(2.01, 0.0)).x, 1.0);
}

#[test]
fn contour_lines_cover_what_they_should() {
    let lines = || Contours::new(slot(Parameter::default()), 1.0);
    let wide = |width| Contours { width: Some(width), ..lines() };
    let pixels = |pixels| Contours { pixels, ..lines() };
    // On a slope of 0.05 per pixel, lines of two pixels are 0.1 wide: the mean over many pixels is a tenth line.
    for (lines, rise) in [(pixels(2.0), 0.05), (wide(0.1), 0.05), (wide(0.1), 3.7)] {
        let mean: f32 =
            (0..2000).map(|i| lines.evaluate(&slope_point(0.01 * i as f32, rise)).x).sum::<f32>() / 2000.0;
        assert!((mean - 0.9).abs() < 2e-3, "{lines:?}: {mean}");
    }
    let lines = pixels(2.0);
    assert_close(
        lines.evaluate(&slope_point(3.0, 0.05)).to_array(),
        [0.0, 0.0, 0.0, 1.0],
        1e-5,
        "on the line",
    );
    assert_close(
        lines.evaluate(&slope_point(3.05, 0.05)).to_array(),
        [0.5, 0.5, 0.5, 1.0],
        1e-3,
        "on its edge",
    );
    assert_close(lines.evaluate(&slope_point(3.5, 0.05)).to_array(), [1.0; 4], 1e-5, "between");
    assert_close(lines.evaluate(&slope_point(3.5, 5.0)).to_array(), [0.0, 0.0, 0.0, 1.0], 1e-5, "too dense");
    assert!(Contours::new(Slot::number(0.0), 0.0).check().is_err());
    assert!(Contours::new(Slot::number(0.0), f32::NAN).check().is_err());
    assert!(pixels(-1.0).check().is_err());
}

#[test]
fn dependencies_are_inherited() {
    let facing = || slot(Parameter::Facing);
    let time = || slot(Parameter::Time);
    let base = || Slot::number(1.0);
    let layers = Layers { base: base(), layers: vec![Layer { mask: facing(), ..Layer::over(time()) }] };
    assert!(layers.is_view_dependent() && layers.is_animated());
    let contours = Contours { over: facing(), ..Contours::new(base(), 1.0) };
    assert!(contours.is_view_dependent() && !contours.is_animated());
    let mix = Mix { a: base(), b: base(), mask: time() };
    assert!(!mix.is_view_dependent() && mix.is_animated());
}

mod color_ramp {
    use fantex_mesh::{ToonInterpolation, ToonScale};
    use fantex_texture::{ColorRamp, RampInterpolation};
    use glam::Vec4;

    #[test]
    fn ramps_pass_through_their_stops_and_hold_their_ends() {
        let stops = vec![(-1.0, Vec4::ZERO), (1.0, Vec4::ONE), (1.0, Vec4::X), (3.0, Vec4::Y)];
        let ramp = ColorRamp::new(stops, RampInterpolation::Linear).unwrap();
        assert_eq!(ramp.color(-5.0), Vec4::ZERO);
        assert_eq!(ramp.color(0.0), Vec4::splat(0.5));
        assert_eq!(ramp.color(1.0), Vec4::X);
        assert_eq!(ramp.color(9.0), Vec4::Y);
        assert_eq!(ramp.color(f32::NAN), Vec4::ZERO);
    }

    #[test]
    fn toon_scales_are_ramps() {
        let stops = vec![(0.0, Vec4::W), (0.3, Vec4::splat(0.5).with_w(1.0)), (0.3, Vec4::ONE)];
        for interpolation in
            [RampInterpolation::Linear, RampInterpolation::Smooth, RampInterpolation::Constant]
        {
            let ramp = ColorRamp::new(stops.clone(), interpolation).unwrap();
            assert_eq!(ColorRamp::of_toon_scale(&ramp.toon_scale()), Some(ramp));
        }
        let many = (0..100).map(|i| (i as f32 * 0.02 - 1.0, Vec4::splat(i as f32).with_w(1.0))).collect();
        let many = ColorRamp::new(many, RampInterpolation::Linear).unwrap();
        let sampled = ColorRamp::of_toon_scale(&many.toon_scale()).unwrap();
        assert!((sampled.color(0.123).x - many.color(0.123).x).abs() < 1e-3);
        let empty = ToonScale { stops: Vec::new(), interpolation: ToonInterpolation::Linear };
        assert_eq!(ColorRamp::of_toon_scale(&empty), None);
    }

    #[test]
    fn means_equal_sums_of_many_colours() {
        let stops =
            vec![(-1.0, Vec4::ZERO), (1.0, Vec4::ONE), (1.0, Vec4::X), (3.0, Vec4::new(0.5, 2.0, -1.0, 0.2))];
        for interpolation in
            [RampInterpolation::Linear, RampInterpolation::Smooth, RampInterpolation::Constant]
        {
            let ramp = ColorRamp::new(stops.clone(), interpolation).unwrap();
            for (from, to) in [(-3.0, 5.0), (-0.5, 0.25), (0.9, 1.1), (2.5, 0.0), (4.0, 5.0), (-9.0, -1.0)] {
                let count = 20_000;
                let sum: Vec4 = (0..count)
                    .map(|i| ramp.color(from + (to - from) * (i as f32 + 0.5) / count as f32))
                    .sum();
                let error = (ramp.mean(from, to) - sum / count as f32).abs().max_element();
                assert!(error < 2e-4, "{interpolation:?} from {from} to {to}: off by {error}");
            }
            let close = ramp.mean(0.3, 0.3 + 1e-6) - ramp.color(0.3);
            assert!(close.abs().max_element() < 1e-5, "{interpolation:?}: {close}");
            assert_eq!(ramp.mean(0.5, 0.5), ramp.color(0.5));
            assert!(ramp.mean(f32::NEG_INFINITY, f32::INFINITY).is_finite());
            assert!(ramp.mean(f32::NAN, 1.0).is_finite());
        }
    }

    #[test]
    fn stops_out_of_order_are_refused() {
        let refused = |stops| ColorRamp::new(stops, RampInterpolation::Linear).unwrap_err().to_string();
        assert!(refused(Vec::new()).contains("at least one stop"));
        let stops = vec![(1.0, Vec4::ZERO), (0.0, Vec4::ONE)];
        assert!(refused(stops).contains("stop 2 of a colour ramp is at 0"));
    }
}

mod frames {
    use fantex_texture::look::Slot;
    use fantex_texture::{FrameTexture, FrameWrap};

    #[test]
    fn mistakes_are_named() {
        let new = |frames: Vec<(f32, Slot)>, duration| {
            FrameTexture::new(frames, duration, FrameWrap::Repeat, true).unwrap_err().to_string()
        };
        let slot = || Slot::number(0.0);
        assert!(new(vec![], 1.0).contains("at least one frame"));
        assert!(new(vec![(f32::NAN, slot())], 1.0).contains("the time of a frame"));
        assert!(new(vec![(0.0, slot())], 0.0).contains("the duration"));
        let swapped = new(vec![(1.0, slot()), (0.0, slot())], 1.0);
        assert!(swapped.starts_with("frame 1 starts at 0 s"), "{swapped}");
        assert!(new(vec![(0.0, slot()), (2.0, slot())], 1.0).contains("ends before the last frame"));
        assert!(FrameTexture::with_rate(vec![slot()], -1.0, FrameWrap::Hold, true).is_err());
    }
}
