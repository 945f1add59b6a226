//! Blend modes, and strokes that come sample by sample.

use std::sync::Arc;

use fantex_cover::{CoverOptions, build_cover};
use fantex_mesh::generate::torus;
use fantex_paint::{
    BlendMode, Brush, Dab, LiveStroke, Sample, Stroke, Surface, SurfacePoint, Symmetry, dabs_of,
};
use glam::{Vec3, Vec4};

use crate::cleaned;

/// Values worked out by hand from the recommendation's formulas.
#[test]
fn modes_give_what_the_recommendation_says() {
    let (cb, cs) = (Vec3::new(0.2, 0.5, 0.8), Vec3::new(0.6, 0.25, 1.0));
    let expected = [
        (BlendMode::Normal, [0.6, 0.25, 1.0]),
        (BlendMode::Multiply, [0.12, 0.125, 0.8]),
        (BlendMode::Screen, [0.68, 0.625, 1.0]),
        (BlendMode::Overlay, [0.24, 0.25, 1.0]),
        (BlendMode::Darken, [0.2, 0.25, 0.8]),
        (BlendMode::Lighten, [0.6, 0.5, 1.0]),
        (BlendMode::ColorDodge, [0.5, 2.0 / 3.0, 1.0]),
        (BlendMode::ColorBurn, [0.0, 0.0, 0.8]),
        (BlendMode::HardLight, [0.36, 0.25, 1.0]),
        (BlendMode::Difference, [0.4, 0.25, 0.2]),
        (BlendMode::Exclusion, [0.56, 0.5, 0.2]),
        (BlendMode::Add, [0.8, 0.75, 1.8]),
    ];
    for (mode, value) in expected {
        let found = mode.blend(cb, cs);
        assert!((found - Vec3::from(value)).abs().max_element() < 1e-6, "{mode:?} {found}");
    }
    let luminosity = |c: Vec3| c.dot(Vec3::new(0.3, 0.59, 0.11));
    let color = BlendMode::Color.blend(cb, cs);
    assert!((luminosity(color) - luminosity(cb)).abs() < 1e-5);
    let hue = BlendMode::Hue.blend(Vec3::splat(0.4), cs);
    assert!((hue - 0.4).abs().max_element() < 1e-6, "grey has no saturation to give");
}

#[test]
fn compositing_follows_porter_and_duff() {
    let (backdrop, source) = (Vec4::new(0.1, 0.2, 0.3, 1.0), Vec4::new(1.0, 0.5, 0.0, 1.0));
    for mode in BlendMode::ALL {
        assert_eq!(mode.compose(backdrop, source, 0.0), backdrop);
        if mode == BlendMode::Erase {
            continue;
        }
        let clear = mode.compose(Vec4::ZERO, source, 0.5);
        assert!((clear - Vec4::new(1.0, 0.5, 0.0, 0.5)).abs().max_element() < 1e-6, "{mode:?}");
    }
    let half = BlendMode::Normal.compose(backdrop, source, 0.5);
    assert!((half - Vec4::new(0.55, 0.35, 0.15, 1.0)).abs().max_element() < 1e-6);
    // Destination out.
    let faint = Vec4::new(0.1, 0.2, 0.3, 0.8);
    let erased = BlendMode::Erase.compose(faint, source.with_w(0.5), 0.5);
    assert!((erased - faint.with_w(0.6)).abs().max_element() < 1e-6, "{erased}");
    assert_eq!(BlendMode::Erase.compose(faint, source, 1.0), faint.with_w(0.0));
}

#[test]
fn samples_one_by_one_give_the_dabs_of_the_whole_stroke() {
    let mesh = cleaned(torus(32, 16));
    let cover = build_cover(&mesh, &CoverOptions::default()).unwrap().0;
    let surface = Surface::new(Arc::new(mesh), Arc::new(cover));
    let point = |triangle| SurfacePoint { triangle, lambda: Vec3::splat(1.0 / 3.0) };
    let samples: Vec<Sample> = [0, 3, 9, 14].map(|t| Sample::at(point(t))).into();
    let brush = Brush { smoothing: 0.4, ..Brush::default() };
    for symmetry in [Symmetry::None, Symmetry::Mirror { axis: 0, offset: 0.0 }] {
        let mut live = LiveStroke::new(&surface, brush.clone(), None, symmetry);
        let mut found = Vec::new();
        for (k, sample) in samples.iter().enumerate() {
            found.extend(live.go_to(&surface, sample, k + 1 == samples.len()));
        }
        let (brush, samples) = (brush.clone(), samples.clone());
        let stroke = Stroke { brush, stamp: None, samples, line: false, symmetry };
        let whole = dabs_of(&surface, &stroke);
        let key = |dab: &Dab| (dab.center.triangle, dab.center.lambda.x.to_bits());
        let sorted = |dabs: &[Dab]| {
            let mut keys: Vec<_> = dabs.iter().map(key).collect();
            keys.sort_unstable();
            keys
        };
        assert!(whole.len() > 4);
        assert_eq!(sorted(&found), sorted(&whole));
    }
}
