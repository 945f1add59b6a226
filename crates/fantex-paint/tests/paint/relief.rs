//! Height that is painted shows in the normals.

use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_base::Random;
use fantex_paint::{
    BlendMode, ChannelPaint, HEIGHT_RANGE, Layer, Paint, PaintColor, Painter, StrokeLog, SurfacePoint,
    Target, Tool, dabs_of,
};
use fantex_store::{ChannelKind, Footprint, Sampler, VerifyOptions, verify};
use fantex_texture::FilterOptions;
use glam::{Vec3, Vec4};

use crate::{Baked, ball, contents, stroke};

const LINE: [Vec3; 3] = [Vec3::X, Vec3::new(0.6, 0.6, 0.5), Vec3::Z];

const ADDED: [ChannelKind; 2] = [ChannelKind::Normal, ChannelKind::Displacement];

/// Of assets of these tests.
const NORMAL: usize = 2;
const HEIGHT: usize = 3;

fn raised(height: f32) -> Paint {
    let color = PaintColor::Constant(Vec4::new(height, height, height, 1.0));
    Paint {
        tool: Tool::Paint(BlendMode::Normal),
        opacity: 1.0,
        channels: vec![ChannelPaint::new(HEIGHT, color)],
        stencil: None,
        sight: None,
    }
}

fn paint_on(painter: &mut Painter, target: Target, paint: Paint, line: &[Vec3]) {
    let surface = Arc::clone(painter.surface());
    painter.begin_on(target, "test", paint).unwrap();
    painter.dab(&dabs_of(&surface, &stroke(&surface, 90.0, line))).unwrap();
    painter.end().unwrap();
}

/// The normals of an asset beside those that its heights say: the facet turned by differences of the height along the surface. Returns the
/// largest slope, and the root of the mean square of the error.
fn slopes_and_error(baked: &Baked) -> (f32, f32) {
    let cache = baked.cache();
    let sampler = Sampler::of_cache(&cache, FilterOptions::default());
    let mesh = sampler.mesh().clone();
    let surface = fantex_paint::Surface::of(cache.asset());
    let range = HEIGHT_RANGE * mesh.bounds().extent().length();
    let step = 2.0 / sampler.cover().density;
    let height = |position: Vec3| {
        let point = surface.nearest(position, 1.0).unwrap();
        sampler.sample(ChannelKind::Displacement, point, Footprint::NONE).unwrap().x
    };
    let mut random = Random::new(3);
    let (mut largest, mut sum, mut count) = (0.0f32, 0.0, 0);
    for _ in 0..20_000 {
        let triangle = random.below(mesh.triangles.len() as u64) as u32;
        let [a, b] = [random.unit() as f32, random.unit() as f32];
        let [a, b] = if a + b > 1.0 { [1.0 - a, 1.0 - b] } else { [a, b] };
        let point = SurfacePoint { triangle, lambda: Vec3::new(a, b, 1.0 - a - b) };
        let position = surface.position(point).as_vec3();
        let normal = sampler.vertex_normal(point);
        let x_axis = normal.any_orthonormal_vector();
        let axes = [x_axis, normal.cross(x_axis)];
        let slope = axes.map(|axis| {
            (height(position + axis * step) - height(position - axis * step)) / (2.0 * step) * range
        });
        let steepness = slope[0].hypot(slope[1]);
        if steepness < 1e-3 {
            continue;
        }
        let found = sampler.sample(ChannelKind::Normal, point, Footprint::NONE).unwrap().truncate();
        let expected = (normal - axes[0] * slope[0] - axes[1] * slope[1]).normalize();
        largest = largest.max(steepness);
        sum += (found.normalize() - expected).length_squared();
        count += 1;
    }
    assert!(count > 500, "{count}");
    (largest, (sum / count as f32).sqrt())
}

/// On the base and on a layer, in floats, so that nothing is rounded.
#[test]
fn normals_are_those_of_the_painted_height() {
    for is_layered in [false, true] {
        let baked = ball(150_000, BakeFormat::Float);
        let mut painter = baked.painter();
        painter.add_channels(&ADDED).unwrap();
        let target = match is_layered {
            true => Target::Layer(painter.add_layer(Layer::painted("relief")).unwrap()),
            false => Target::Base,
        };
        paint_on(&mut painter, target, raised(1.0), &LINE);
        // Across, and lower: slopes add up.
        paint_on(&mut painter, target, raised(0.2), &[Vec3::new(0.2, 0.9, 0.4), Vec3::new(1.0, 0.1, 0.6)]);
        painter.commit().unwrap();
        drop(painter);
        let (largest, error) = slopes_and_error(&baked);
        assert!(largest > 0.3 && error < 0.04 * largest, "{is_layered}: {largest} {error}");
        assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    }
}

/// In all formats, hidden or undone relief leaves the very bytes that were there; shown and done again it is as it was; the log makes it
/// again.
#[test]
fn relief_is_hidden_undone_and_replayed() {
    for format in [BakeFormat::Bc7, BakeFormat::Rgba8] {
        let baked = ball(50_000, format);
        let mut painter = baked.painter();
        painter.add_channels(&ADDED).unwrap();
        let plain = contents(&painter);
        paint_on(&mut painter, Target::Base, raised(0.9), &LINE[..2]);
        let based = contents(&painter);
        let count = painter.editor().asset().channels().len();
        let differs = |a: &crate::Contents, b: &crate::Contents, channel: usize| {
            a.0.iter().zip(&b.0).skip(channel).step_by(count).any(|(a, b)| a.1 != b.1)
        };
        assert_eq!([0, 1, NORMAL, HEIGHT].map(|c| differs(&plain, &based, c)), [false, false, true, true]);
        let layer = painter.add_layer(Layer::painted("relief")).unwrap();
        paint_on(&mut painter, Target::Layer(layer), raised(0.1), &LINE[1..]);
        let layered = contents(&painter);
        assert!(differs(&based, &layered, NORMAL));
        painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
        assert!(contents(&painter) == based, "{format:?}");
        painter.edit_layers("show", |layers| layers[0].visible = true).unwrap();
        let finest = |contents: &crate::Contents| -> Vec<_> {
            contents.0.iter().filter(|(id, _)| id.level == 0).map(|(_, bytes)| bytes.clone()).collect()
        };
        assert!(finest(&contents(&painter)) == finest(&layered), "{format:?}");
        while painter.undo().unwrap() {}
        assert!(contents(&painter) == plain, "{format:?}");
        while painter.redo().unwrap() {}
        painter.commit().unwrap();
        drop(painter);
        assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
        let mut painter = baked.painter();
        let other = ball(50_000, format);
        let mut again = other.painter();
        let log = StrokeLog::of(painter.editor().asset()).unwrap();
        assert!(log.strokes.strokes.iter().all(|stroke| !stroke.unrecorded && stroke.channels.len() < 2));
        log.replay(&mut again).unwrap();
        for position in LINE {
            let point = painter.surface().nearest(position.normalize(), 1.0).unwrap();
            let [ours, theirs] = [&mut painter, &mut again].map(|painter| painter.pick_all(point).unwrap());
            for (a, b) in ours.iter().zip(&theirs) {
                assert!((*a - *b).abs().max_element() < 0.03, "{format:?} {position}: {ours:?} {theirs:?}");
            }
        }
    }
}

/// Dab by dab, shown in between, a stroke ends as it does at once: what was bent on the way is straight again where it levels out.
#[test]
fn relief_shown_on_the_way_ends_as_the_same() {
    let [one, other] = [(); 2].map(|()| ball(50_000, BakeFormat::Rgba8));
    let [mut at_once, mut shown] = [one.painter(), other.painter()];
    for painter in [&mut at_once, &mut shown] {
        painter.add_channels(&ADDED).unwrap();
    }
    paint_on(&mut at_once, Target::Base, raised(1.0), &LINE);
    let surface = Arc::clone(shown.surface());
    shown.begin("test", raised(1.0)).unwrap();
    for dab in dabs_of(&surface, &stroke(&surface, 90.0, &LINE)) {
        shown.dab(std::slice::from_ref(&dab)).unwrap();
        shown.show().unwrap();
    }
    shown.end().unwrap();
    assert!(contents(&at_once) == contents(&shown));
}
