//! Where textures are looked up.

use std::sync::Arc;

use fantex_base::Aabb;
use fantex_texture::Scale;
use fantex_texture::combine::Field;
use fantex_texture::coordinates::{
    Coordinates, ImageLookup, InSpace, NormalAxes, Parameter, Place, Projective, SpaceMatrix, TextureMatrix,
    TextureMatrixOptions,
};
use fantex_texture::look::Slot;
use fantex_texture::{
    Dependence, Filter, Filtering, Image, ImageTexture, OMap, Placement, SMap, SampleOptions, ShadingPoint,
    ShapeKind, Texture, TriplanarMap, TwoPartMapping, UvPoint, Wrap,
};
use glam::{Mat3, Mat4, Vec2, Vec3, Vec4};

use crate::common::{Random, assert_close, shading_point, texture};

fn matrices() -> Vec<TextureMatrix> {
    let options = [
        TextureMatrixOptions::default(),
        TextureMatrixOptions {
            pivot: Vec2::splat(0.5),
            scale: Scale::Two([2.0, -3.0]),
            rotation: 30.0,
            translation: Vec2::new(0.1, 0.7),
            scale_per_second: 1.5,
            rotation_per_second: 90.0,
            translation_per_second: Vec2::new(-0.2, 0.4),
            ..TextureMatrixOptions::default()
        },
        TextureMatrixOptions {
            matrix: Some(Projective(Mat3::from_cols(
                Vec3::new(1.0, 0.2, 0.3),
                Vec3::new(-0.1, 1.0, -0.2),
                Vec3::new(0.0, 0.3, 1.0),
            ))),
            ..TextureMatrixOptions::default()
        },
    ];
    options.map(|options| TextureMatrix::new(options).expect("the numbers are in range")).to_vec()
}

#[test]
fn texture_matrices_transform_footprints_by_their_derivative() {
    let mut random = Random::new(21);
    for matrix in matrices() {
        for _ in 0..200 {
            let [u, v, du, dv] = std::array::from_fn(|_| random.unit());
            let (uv, step, time) = (Vec2::new(u, v), Vec2::new(du, dv) * 1e-2, 2.0 * random.unit());
            let map = |uv| matrix.apply(&UvPoint { uv, steps: [step, Vec2::ZERO] }, time);
            let expected = map(uv + 0.5 * step).uv - map(uv - 0.5 * step).uv;
            let got = map(uv).steps;
            assert!((got[0] - expected).length() < 1e-5, "{} against {expected}", got[0]);
            assert_eq!(got[1], Vec2::ZERO);
        }
    }
}

#[test]
fn texture_matrices_move_with_time() {
    let [_, moving, _] = matrices().try_into().unwrap();
    assert!(moving.is_animated());
    let at = |time| moving.apply(&UvPoint { uv: Vec2::splat(0.5), steps: [Vec2::X; 2] }, time);
    // The pivot is only translated.
    assert!((at(0.0).uv - Vec2::new(0.6, 1.2)).length() < 1e-6);
    assert!((at(2.0).uv - Vec2::new(0.2, 2.0)).length() < 1e-6);
    // A step along u is scaled by 2 * 1.5^2 and turned by 30 + 180 degrees.
    let expected = 4.5 * Vec2::from_angle(210_f32.to_radians());
    assert!((at(2.0).steps[0] - expected).length() < 1e-5, "{}", at(2.0).steps[0]);
}

#[test]
fn space_matrices_transform_footprints_by_their_derivative() {
    let matrix = Mat4::from_cols_array(&[1., 0., 0., 0.1, 0., 1., 0.5, 0., 0., 0., 2., 0.2, 0.3, 0., 0., 1.]);
    let matrix = SpaceMatrix::new(matrix).unwrap().moving(Vec3::new(0.0, 90.0, 20.0), Vec3::X).unwrap();
    let mut random = Random::new(22);
    for _ in 0..200 {
        let at = ShadingPoint {
            position_steps: [random.vector() * 1e-2, random.vector() * 1e-2],
            time: random.unit(),
            ..shading_point(random.vector(), Vec3::Y)
        };
        let beside = |a: f32| at.shifted(a, 0.0, |point| matrix.apply(point).position);
        let expected = beside(0.5) - beside(-0.5);
        assert!((matrix.apply(&at).steps[0] - expected).length() < 1e-5);
    }
    let height = InSpace {
        input: Slot::Texture(Arc::new(Parameter::default())),
        matrix,
        normal_axes: NormalAxes::Object,
    };
    assert!(height.is_animated() && !height.is_view_dependent());
    let at = shading_point(Vec3::new(0.3, 0.4, 0.5), Vec3::Y);
    assert_eq!(height.evaluate(&at).x, matrix.apply(&at).position.y);
}

/// The normal as a colour.
#[derive(Debug)]
struct Normals;

impl Texture for Normals {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        at.normal.extend(1.0)
    }

    fn depends_on(&self, _: Dependence) -> bool {
        false
    }
}

/// Models may be 1e-18 to 1e18 units large.
#[test]
fn patterns_of_all_sizes_have_their_place() {
    for radius in [1e-18, 1e-16, 1e-13, 1.0, 1e13, 1e18_f32] {
        let matrix = Place { rotate: [30.0, 0.0, 0.0], ..Place::default() }.matrix(radius).unwrap();
        let normals =
            InSpace { input: Slot::Texture(Arc::new(Normals)), matrix, normal_axes: NormalAxes::Texture };
        let position = Vec3::new(0.0, radius, 0.0);
        let at = shading_point(position, Vec3::Y);
        // Turned back by 30 degrees.
        let expected = Vec3::new(0.0, 0.75_f32.sqrt(), -0.5);
        assert!(matrix.apply(&at).position.abs_diff_eq(expected, 1e-6), "{radius}");
        assert!(normals.evaluate(&at).truncate().abs_diff_eq(expected, 1e-6), "{radius}");
    }
}

#[test]
fn matrices_out_of_range_are_refused() {
    let default = TextureMatrixOptions::default();
    let refused = |options| TextureMatrix::new(options).unwrap_err();
    for options in [
        TextureMatrixOptions { scale: Scale::Two([0.0, 1.0]), ..default },
        TextureMatrixOptions { rotation: f32::NAN, ..default },
        TextureMatrixOptions { scale_per_second: -1.0, ..default },
        TextureMatrixOptions {
            matrix: Some(Projective(Mat3::from_diagonal(Vec3::new(1.0, 1.0, 0.0)))),
            ..default
        },
    ] {
        assert!(refused(options).to_string().contains("must be finite"), "{options:?}");
    }
    let collapsed = SpaceMatrix::new(Mat4::from_scale(Vec3::new(1.0, 1.0, 0.0))).unwrap_err();
    assert!(collapsed.to_string().ends_with("it must have an inverse"));
    assert!(SpaceMatrix::default().moving(Vec3::NAN, Vec3::ZERO).is_err());
}

/// Models may show one column of an image everywhere.
#[test]
fn texture_matrices_need_no_inverse() {
    let squeezed = Mat3::from_diagonal(Vec3::new(1.0, 0.0, 1.0));
    let options = TextureMatrixOptions { matrix: Some(Projective(squeezed)), ..Default::default() };
    let point = UvPoint { uv: Vec2::new(0.25, 0.75), steps: [Vec2::X, Vec2::Y] };
    let expected = UvPoint { uv: Vec2::new(0.25, 0.0), steps: [Vec2::X, Vec2::ZERO] };
    assert_eq!(TextureMatrix::new(options).unwrap().apply(&point, 0.0), expected);
}

#[test]
fn looked_up_images_keep_their_filters() {
    let checker = Arc::new(texture(8, 8, 4, |x, y| [((x + y) % 2) as f32, 0.0, 0.0, 1.0]));
    let uv = [UvPoint { uv: Vec2::new(0.12, 0.3), steps: [Vec2::X * 0.01, Vec2::Y * 0.01] }];
    let at = ShadingPoint { uv: &uv, ..shading_point(Vec3::ZERO, Vec3::Y) };
    let smooth = ImageLookup::new(Arc::clone(&checker));
    let squares = ImageLookup { square_texels: true, ..smooth.clone() };
    let sampled = checker.sample(uv[0].uv, uv[0].steps, &SampleOptions::default());
    assert_close(smooth.evaluate(&at).to_array(), sampled, 0.0, "smooth");
    assert!((0.1..0.9).contains(&sampled[0]));
    assert_close(squares.evaluate(&at).to_array(), [0.0, 0.0, 0.0, 1.0], 0.0, "squares");
    // From afar both are the same.
    let far = [UvPoint { steps: [Vec2::X, Vec2::Y], ..uv[0] }];
    let from_afar = ShadingPoint { uv: &far, ..at };
    assert_eq!(squares.evaluate(&from_afar), smooth.evaluate(&from_afar));
    let area = ShadingPoint { filtering: Filtering::Area, ..at };
    let exact = checker.sample_area(uv[0].uv, uv[0].steps, [Wrap::Repeat; 2]);
    assert_close(smooth.evaluate(&area).to_array(), exact, 0.0, "area");
    assert_close(squares.evaluate(&area).to_array(), [0.0, 0.0, 0.0, 1.0], 1e-6, "area of squares");
    // The spline of Catmull and Rom through 1, -1, 1, ... is 1 - 6 t^2 + 4 t^3 from a 1 on: here its mean over 0.8 and 0.4 texels.
    let texel = Vec2::new(0.46, 1.625);
    let edges = [Vec2::X * 0.1, Vec2::Y * 0.05];
    let wide = [UvPoint { uv: (texel + 0.5) / 8.0, steps: edges }];
    let wide = ShadingPoint { uv: &wide, ..area };
    let mean = |t: f32, width: f32| {
        let integral = |t: f32| t - 2.0 * t.powi(3) + t.powi(4);
        (integral(t + 0.5 * width) - integral(t - 0.5 * width)) / width
    };
    let cubic = 0.5 + 0.5 * mean(0.46, 0.8) * mean(0.625, 0.4);
    for filter in [Filter::Bicubic, Filter::BicubicMipmaps] {
        let lookup = ImageLookup { options: SampleOptions { filter, ..smooth.options }, ..smooth.clone() };
        assert_close(lookup.evaluate(&wide).to_array(), [cubic, 0.0, 0.0, 1.0], 1e-5, "area of a cubic");
        let mut values = [Vec4::NAN; 5];
        lookup.evaluate_all(&[wide; 5], &mut values);
        assert_eq!(values, [lookup.evaluate(&wide); 5]);
    }
    // Without texture coordinates the corner is looked up.
    let none = ShadingPoint { uv: &[], ..at };
    assert!(smooth.evaluate(&none).is_finite());
}

#[test]
fn projected_images_grow_with_distance() {
    // An eye at the origin that looks along +z: u = x / z, v = y / z.
    let matrix = Mat4::from_cols(Vec4::X, Vec4::Y, Vec4::new(0.0, 0.0, 0.0, 1.0), Vec4::Z);
    let matrix = SpaceMatrix::new(matrix).unwrap();
    for distance in [1.0, 2.0, 5.0] {
        let at = ShadingPoint {
            position_steps: [Vec3::X * 0.1, Vec3::Z],
            ..shading_point(Vec3::new(0.3, 0.6, 1.0) * distance, Vec3::NEG_Z)
        };
        Coordinates::Projected(matrix).evaluate(&at, |point| {
            assert!((point.uv - Vec2::new(0.3, 0.6)).length() < 1e-6);
            assert!((point.steps[0] - Vec2::X * 0.1 / distance).length() < 1e-6);
            assert!((point.steps[1] + Vec2::new(0.3, 0.6) / distance).length() < 1e-6);
            Vec4::ONE
        });
    }
}

#[test]
fn every_kind_of_coordinates_gives_a_value() {
    let gradient = Arc::new(texture(64, 64, 4, |x, y| [x as f32 / 64.0, y as f32 / 64.0, 0.5, 1.0]));
    let bounds = Aabb { min: Vec3::NEG_ONE, max: Vec3::ONE };
    let s_map = SMap::new(ShapeKind::Sphere.fit(bounds), &Placement::default()).unwrap();
    let kinds = [
        Coordinates::default(),
        Coordinates::Surface(s_map),
        Coordinates::TwoPart(TwoPartMapping { s_map, o_map: OMap::Reflection }),
        Coordinates::Triplanar(TriplanarMap::fit(bounds)),
        Coordinates::Projected(SpaceMatrix::default()),
        Coordinates::Parameter(Parameter::Slope { up: Vec3::Y }),
    ];
    let uv = [UvPoint { uv: Vec2::new(0.2, 0.6), steps: [Vec2::X * 0.01, Vec2::Y * 0.01] }];
    let n = Vec3::new(0.5, 0.6, 0.62).normalize();
    let (right, down) = n.any_orthonormal_pair();
    let at = ShadingPoint {
        uv: &uv,
        position_steps: [right * 0.01, down * 0.01],
        normal_steps: [right * 0.01, down * 0.01],
        ..shading_point(n, n)
    };
    for coordinates in kinds {
        coordinates.check().unwrap();
        for filter in Filter::ALL {
            let options = SampleOptions { filter, ..SampleOptions::default() };
            let lookup = ImageLookup {
                coordinates: coordinates.clone(),
                options,
                ..ImageLookup::new(Arc::clone(&gradient))
            };
            for filtering in [Filtering::Own, Filtering::Area] {
                let value = lookup.evaluate(&ShadingPoint { filtering, ..at });
                assert!(
                    value.is_finite() && (value.z - 0.5).abs() < 0.1,
                    "{coordinates:?} {filter:?}: {value}"
                );
            }
            let is_reflection = matches!(coordinates, Coordinates::TwoPart(_));
            assert_eq!(lookup.is_view_dependent(), is_reflection);
        }
    }
    // A point on the horizon of a projective matrix is still a colour.
    let matrix = Mat3::from_cols(Vec3::X, Vec3::Y, Vec3::new(0.0, 0.0, -0.2))
        + Mat3::from_cols(Vec3::Z, Vec3::ZERO, Vec3::ZERO);
    let matrix =
        TextureMatrix::new(TextureMatrixOptions { matrix: Some(Projective(matrix)), ..Default::default() })
            .unwrap();
    for filter in [Filter::Bicubic, Filter::Ewa, Filter::Anisotropic] {
        let options = SampleOptions { filter, ..SampleOptions::default() };
        let lookup = ImageLookup { matrix, options, ..ImageLookup::new(Arc::clone(&gradient)) };
        for filtering in [Filtering::Own, Filtering::Area] {
            assert!(
                lookup.evaluate(&ShadingPoint { filtering, ..at }).is_finite(),
                "{filter:?} on the horizon"
            );
        }
    }
}

#[test]
fn no_number_stops_a_look_up() {
    let gradient = Arc::new(texture(16, 8, 4, |x, y| [x as f32 / 16.0, y as f32 / 8.0, 0.5, 1.0]));
    let mut random = Random::new(25);
    let mut accepted = 0;
    for _ in 0..20_000 {
        // Any bits: huge, tiny, infinite and NaN among them.
        let mut any = || match random.bits() % 4 {
            0 => f32::from_bits(random.bits() as u32),
            1 => 0.0,
            _ => 2.0 * random.unit() - 1.0,
        };
        let mut any2 = || Vec2::new(any(), any());
        let (uv, steps, scale, translation) = (any2(), [any2(), any2()], any2(), any2());
        let matrix = Mat3::from_cols(any2().extend(1.0), any2().extend(-0.5), any2().extend(0.7));
        let scale = Scale::Two(scale.as_dvec2().to_array());
        let matrix = Some(Projective(matrix));
        let options = TextureMatrixOptions { matrix, scale, translation, ..TextureMatrixOptions::default() };
        let Ok(matrix) = TextureMatrix::new(options) else { continue };
        accepted += 1;
        let set = [UvPoint { uv, steps }];
        let at = ShadingPoint { uv: &set, ..shading_point(Vec3::ZERO, Vec3::Y) };
        let filter = Filter::ALL[accepted % Filter::ALL.len()];
        let wrap = [[Wrap::Repeat, Wrap::Mirror], [Wrap::Clamp, Wrap::Border]][accepted % 2];
        let options = SampleOptions { filter, wrap, ..SampleOptions::default() };
        let lookup = ImageLookup { matrix, options, ..ImageLookup::new(Arc::clone(&gradient)) };
        for filtering in [Filtering::Own, Filtering::Area] {
            std::hint::black_box(lookup.evaluate(&ShadingPoint { filtering, ..at }));
        }
    }
    assert!(accepted > 500, "only {accepted} matrices were accepted");
}

/// A black and white edge, blurred by a tenth of the image: the ramp's mean square width is that of the footprint, 0.1 / sqrt(12) on each
/// axis, as a box has it, and the mean stays.
#[test]
fn blurred_images_have_the_blurs_width() {
    let side = 256;
    let texels = (0..side * side).map(|i| if i % side < side / 2 { 0.0 } else { 1.0 }).collect();
    let image = Arc::new(ImageTexture::new(Arc::new(Image::from_linear(side, side, 1, texels))));
    for filter in [Filter::Trilinear, Filter::Anisotropic, Filter::Ewa] {
        let options = SampleOptions { filter, wrap: [Wrap::Clamp; 2], ..SampleOptions::default() };
        let lookup = |blur| ImageLookup { blur, options, ..ImageLookup::new(Arc::clone(&image)) };
        let (sharp, soft) = (lookup(0.0), lookup(0.1));
        let value = |texture: &ImageLookup, u: f32| {
            let steps = [Vec2::new(1e-4, 0.0), Vec2::new(0.0, 1e-4)];
            let uv = [UvPoint { uv: Vec2::new(u, 0.5), steps }];
            texture
                .evaluate(&ShadingPoint {
                    position: Vec3::ZERO,
                    position_steps: [Vec3::X, Vec3::Y],
                    normal: Vec3::Z,
                    normal_steps: [Vec3::ZERO; 2],
                    uv: &uv,
                    vertex_color: Vec4::ONE,
                    eye: None,
                    time: 0.0,
                    filtering: Filtering::Own,
                })
                .x
        };
        assert!((value(&soft, 0.5) - 0.5).abs() < 0.03);
        assert!(value(&sharp, 0.49) < 0.01 && value(&sharp, 0.51) > 0.99);
        // The derivative of the ramp is the blur's own profile.
        let points: Vec<f32> = (0..=400).map(|i| 0.3 + 0.001 * i as f32).collect();
        let weights: Vec<f32> = points.windows(2).map(|p| value(&soft, p[1]) - value(&soft, p[0])).collect();
        let total: f32 = weights.iter().sum();
        let spread =
            points.iter().zip(&weights).map(|(u, w)| (u + 0.0005 - 0.5).powi(2) * w).sum::<f32>() / total;
        let width = (12.0 * spread).sqrt();
        assert!((0.08..0.18).contains(&width) && total > 0.98, "{filter:?}: {width}, {total}");
    }
}

/// What another place in a set of texture coordinates changes says that it depends on that set, and nothing else does.
#[test]
fn textures_tell_which_texture_coordinates_they_depend_on() {
    let ramp = (0..256).map(|i| i as f32 / 255.0).collect();
    let image = Arc::new(ImageTexture::new(Arc::new(Image::from_linear(16, 16, 1, ramp))));
    let lookup = |coordinates| ImageLookup { coordinates, ..ImageLookup::new(Arc::clone(&image)) };
    let within = |input: Arc<dyn Texture>| InSpace {
        input: Slot::Texture(input),
        matrix: SpaceMatrix::new(Mat4::from_scale(Vec3::splat(2.0))).unwrap(),
        normal_axes: NormalAxes::Object,
    };
    let textures: [(Arc<dyn Texture>, Option<usize>); 8] = [
        (Arc::new(lookup(Coordinates::Uv { set: 1 })), Some(1)),
        (Arc::new(within(Arc::new(lookup(Coordinates::default())))), Some(0)),
        (Arc::new(lookup(Coordinates::Parameter(Parameter::U { set: 1 }))), Some(1)),
        (Arc::new(Parameter::V { set: 0 }), Some(0)),
        (Arc::new(within(Arc::new(Field::Uv { set: 1 }))), Some(1)),
        (Arc::new(Field::Normal), None),
        (Arc::new(Parameter::Slope { up: Vec3::Y }), None),
        (Arc::new(lookup(Coordinates::Projected(SpaceMatrix::new(Mat4::IDENTITY).unwrap()))), None),
    ];
    let sets = [Vec2::new(0.2, 0.3), Vec2::new(0.6, 0.1)].map(|uv| UvPoint { uv, steps: [Vec2::ZERO; 2] });
    let at = ShadingPoint { uv: &sets, ..shading_point(Vec3::new(0.3, 0.4, 0.0), Vec3::Z) };
    for (number, (texture, wanted)) in textures.iter().enumerate() {
        for set in 0..2 {
            let mut moved = sets;
            moved[set].uv += Vec2::splat(0.25);
            let differs = texture.evaluate(&ShadingPoint { uv: &moved, ..at }) != texture.evaluate(&at);
            assert_eq!(differs, *wanted == Some(set), "{number}, set {set}");
            assert_eq!(texture.depends_on(Dependence::Uv(set)), differs, "{number}, set {set}");
        }
    }
}
