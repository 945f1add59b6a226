//! Channels that are taken out of an asset that was painted on.

use std::path::Path;
use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_paint::{
    BlendMode, ChannelPaint, Layer, Paint, PaintColor, PaintOptions, Painter, StrokeLog, Target, Tool,
    dabs_of, replay,
};
use fantex_store::{Asset, ChannelKind, VerifyOptions, verify};
use glam::{Vec3, Vec4};

use crate::{Contents, ball, contents, red, stroke, strokes};

const LINE: [Vec3; 3] = [Vec3::X, Vec3::new(0.6, 0.6, 0.5), Vec3::Z];

/// Channels of the assets of these tests, once some are added.
const KINDS: [ChannelKind; 4] = [
    ChannelKind::BaseColor,
    ChannelKind::OcclusionRoughnessMetallic,
    ChannelKind::Normal,
    ChannelKind::Emission,
];

const EMISSION: usize = 3;

fn paint_on(painter: &mut Painter, target: Target, paint: Paint, line: &[Vec3]) {
    let surface = Arc::clone(painter.surface());
    painter.begin_on(target, "test", paint).unwrap();
    painter.dab(&dabs_of(&surface, &stroke(&surface, 50.0, line))).unwrap();
    painter.end().unwrap();
}

fn of_channel(channel: usize, color: Vec4) -> Paint {
    let channels = vec![ChannelPaint::new(channel, PaintColor::Constant(color))];
    Paint { tool: Tool::Paint(BlendMode::Normal), opacity: 1.0, channels, stencil: None, sight: None }
}

fn glow() -> Paint {
    of_channel(EMISSION, Vec4::new(0.2, 0.9, 0.1, 1.0))
}

/// Roughness alone.
fn rough() -> Paint {
    let mut paint = of_channel(1, Vec4::new(0.0, 0.9, 0.0, 1.0));
    paint.channels[0].components = [false, true, false];
    paint
}

/// The same of some of so many channels.
fn of_channels((pages, means): &Contents, count: usize, kept: &[usize]) -> Contents {
    let pages = pages.chunks(count).flat_map(|page| kept.iter().map(|&c| page[c].clone()));
    (pages.collect(), means.chunks(count).flat_map(|means| kept.iter().map(|&c| means[c])).collect())
}

fn finest((pages, _): &Contents) -> Vec<Vec<u8>> {
    pages.iter().filter(|(id, _)| id.level == 0).map(|(_, bytes)| bytes.clone()).collect()
}

fn show(painter: &mut Painter, is_shown: bool) {
    painter.edit_layers("show", |layers| layers[0].visible = is_shown).unwrap();
}

/// What stays is what it was, byte for byte, also before and after steps of the history, and below and with the layers.
#[test]
fn what_was_painted_in_other_channels_stays() {
    for (format, removed) in
        [(BakeFormat::Bc7, vec![3]), (BakeFormat::Rgba8, vec![0]), (BakeFormat::Bc7, vec![1, 3])]
    {
        let baked = ball(40_000, format);
        let mut painter = baked.painter();
        painter.add_channels(&KINDS[2..]).unwrap();
        let kept: Vec<usize> = (0..KINDS.len()).filter(|channel| !removed.contains(channel)).collect();
        let kept_of = |contents: &Contents| of_channels(contents, KINDS.len(), &kept);
        let mut states = vec![kept_of(&contents(&painter))];
        let layer = painter.add_layer(Layer::painted("paint")).unwrap();
        let targets = [Target::Layer(layer), Target::Base];
        for (target, paint) in
            targets.into_iter().flat_map(|target| [red(0.8), glow(), rough()].map(|p| (target, p)))
        {
            let line = if target == Target::Base { &LINE[..2] } else { &LINE[1..] };
            paint_on(&mut painter, target, paint, line);
            states.push(kept_of(&contents(&painter)));
        }
        states.dedup_by(|a, b| a == b);
        painter.commit().unwrap();
        let copy = baked.folder.path().join("copy.fan");
        std::fs::copy(&baked.path, &copy).unwrap();
        let mut beside = Painter::open(&copy, &PaintOptions::default()).unwrap();
        show(&mut beside, false);
        let hidden = kept_of(&contents(&beside));
        let before = painter.history().done().len();
        let kinds: Vec<ChannelKind> = removed.iter().map(|&channel| KINDS[channel]).collect();
        painter.remove_channels(&kinds).unwrap();
        let channels: Vec<_> =
            painter.editor().asset().channels().iter().map(|channel| channel.kind).collect();
        assert_eq!(channels, kept.iter().map(|&channel| KINDS[channel]).collect::<Vec<_>>());
        let last = states.last().unwrap().clone();
        assert!(contents(&painter) == last, "{format:?} {removed:?}");
        // Steps that painted nothing else are gone.
        let only = match removed.as_slice() {
            [0] => 0,
            [3] => 2,
            _ => 4,
        };
        assert_eq!(painter.history().done().len(), before - only, "{removed:?}");
        let mut seen = vec![contents(&painter)];
        while painter.undo().unwrap() {
            seen.push(contents(&painter));
        }
        seen.dedup_by(|a, b| a == b);
        seen.reverse();
        assert!(seen == states, "{format:?} {removed:?}: {} {}", seen.len(), states.len());
        while painter.redo().unwrap() {}
        assert!(contents(&painter) == last, "{format:?} {removed:?}");
        painter.commit().unwrap();
        drop(painter);
        assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
        let mut painter = baked.painter();
        assert!(contents(&painter) == last);
        show(&mut painter, false);
        assert!(contents(&painter) == hidden, "{format:?} {removed:?}");
        show(&mut painter, true);
        assert!(finest(&contents(&painter)) == finest(&last), "{format:?} {removed:?}");
        // The log fits an asset that never had them.
        let other = ball(40_000, format);
        let log = StrokeLog::of(painter.editor().asset()).unwrap();
        log.replay(&mut other.painter()).unwrap();
        // What is added again is as the model has it.
        painter.add_channels(&kinds).unwrap();
        show(&mut painter, false);
        let count = painter.editor().asset().channels().len();
        let first: Vec<usize> = (0..kept.len()).collect();
        assert!(of_channels(&contents(&painter), count, &first) == hidden, "{format:?} {removed:?}");
    }
}

/// A step that painted nothing else goes even where it was the first on a layer. What it put aside as the base comes and goes with the
/// next step, if there is one.
#[test]
fn steps_that_put_the_base_aside_go() {
    for (is_painted_over, on_base, undone) in [(false, false, 0), (true, true, 0), (true, false, 2)] {
        let baked = ball(8_000, BakeFormat::Rgba8);
        let mut painter = baked.painter();
        painter.add_channels(&KINDS[2..]).unwrap();
        let kept_of = |painter: &Painter| of_channels(&contents(painter), KINDS.len(), &[0, 1, 2]);
        let untouched = kept_of(&painter);
        paint_on(&mut painter, Target::Base, red(0.8), &LINE);
        let layer = painter.add_layer(Layer::painted("paint")).unwrap();
        paint_on(&mut painter, Target::Layer(layer), glow(), &LINE);
        if is_painted_over {
            let target = if on_base { Target::Base } else { Target::Layer(layer) };
            paint_on(&mut painter, target, red(0.5), &LINE[1..]);
        }
        let last = kept_of(&painter);
        (0..undone).for_each(|_| assert!(painter.undo().unwrap()));
        painter.remove_channels(&KINDS[EMISSION..]).unwrap();
        while painter.redo().unwrap() {}
        assert!(contents(&painter) == last);
        assert_eq!(painter.history().done().len(), 2 + usize::from(is_painted_over));
        while painter.undo().unwrap() {}
        assert!(contents(&painter) == untouched);
        let names = painter.editor().attachment_names();
        assert!(names.iter().all(|name| !name.starts_with("layers/base/")), "{names:?}");
        while painter.redo().unwrap() {}
        assert!(contents(&painter) == last);
        painter.edit_layers("remove", |layers| layers.clear()).unwrap();
        while painter.undo().unwrap() {}
        assert!(contents(&painter) == untouched);
    }
}

#[test]
fn without_height_normals_lose_the_relief_of_layers() {
    let kinds = [ChannelKind::Normal, ChannelKind::Displacement];
    let raised = |height| of_channel(3, Vec4::new(height, height, height, 1.0));
    for both in [false, true] {
        let baked = ball(40_000, BakeFormat::Bc7);
        let mut painter = baked.painter();
        painter.add_channels(&kinds).unwrap();
        paint_on(&mut painter, Target::Base, raised(0.9), &LINE[..2]);
        let based = contents(&painter);
        let layer = painter.add_layer(Layer::painted("relief")).unwrap();
        paint_on(&mut painter, Target::Layer(layer), raised(0.1), &LINE[1..]);
        assert!(contents(&painter) != based);
        painter.remove_channels(if both { &kinds } else { &kinds[1..] }).unwrap();
        let kept: &[usize] = if both { &[0, 1] } else { &[0, 1, 2] };
        assert!(contents(&painter) == of_channels(&based, 4, kept), "{both}");
        assert_eq!(
            painter.history().done().is_empty(),
            !both,
            "relief went with the normals, or the history did"
        );
        assert!(both || !painter.undo().unwrap());
        painter.edit_layers("fade", |layers| layers[0].opacity = 0.5).unwrap();
        assert!(contents(&painter) == of_channels(&based, 4, kept), "{both}");
        painter.commit().unwrap();
        drop(painter);
        assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    }
}

#[test]
fn the_log_says_nothing_of_removed_channels() {
    let baked = ball(20_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    painter.add_channels(&[ChannelKind::Emission]).unwrap();
    let color = |kind: &str| format!(r#"{{"kind": "{kind}", "color": {{"srgb": [0.9, 0.8, 0.1]}}}}"#);
    let (base, glow) = (color("base_color"), color("emission"));
    let at = r#""samples": [{"at": {"position": [1, 0, 0]}}]"#;
    let file = strokes(&format!(
        r#"{{"label": "both", "channels": [{glow}, {base}], {at}}},
        {{"label": "glow", "channels": [{glow}], {at}}},
        {{"label": "mask", "channels": [{glow}], "layer": {{"name": "a", "mask": true}}, {at}}},
        {{"label": "fill", "channels": [{glow}, {base}], "fill": {{"color": {{"tolerance": 0.1, "softness": 0.1, "connected": true}}}}, {at}}}"#
    ));
    replay(&mut painter, &file, Path::new("")).unwrap();
    painter.remove_channels(&[ChannelKind::Emission]).unwrap();
    let asset = Arc::clone(painter.editor().asset());
    let log = StrokeLog::of(&asset).unwrap();
    assert!(log.strokes.add_channels.is_empty());
    let painted: Vec<_> = log.strokes.strokes.iter().filter(|stroke| stroke.set_layers.is_none()).collect();
    let labels: Vec<&str> = painted.iter().map(|stroke| stroke.label.as_str()).collect();
    assert_eq!(labels, ["both", "mask", "fill"]);
    assert!(painted.iter().all(|stroke| stroke.channels.len() == 1));
    assert!(painted.iter().all(|stroke| stroke.channels[0].kind == ChannelKind::BaseColor));
    assert_eq!(painted.iter().map(|stroke| stroke.unrecorded).collect::<Vec<_>>(), [false, false, true]);
    let other = ball(20_000, BakeFormat::Rgba8);
    let mut again = other.painter();
    log.replay(&mut again).unwrap();
    assert_eq!(again.layers().len(), 1);
}

#[test]
fn what_cannot_be_removed_is_named_and_stays() {
    let baked = ball(20_000, BakeFormat::Bc7);
    let mut painter = baked.painter();
    paint_on(&mut painter, Target::Base, red(1.0), &LINE);
    painter.commit().unwrap();
    let before = std::fs::read(&baked.path).unwrap();
    let refused = |painter: &mut Painter, kinds: &[ChannelKind], expected: &str| {
        let error = painter.remove_channels(kinds).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("a.fan"), "{error}");
    };
    refused(&mut painter, &KINDS[3..], "channel emission");
    refused(&mut painter, &KINDS[..2], "it has no other channel");
    painter.remove_channels(&[]).unwrap();
    assert!(std::fs::read(&baked.path).unwrap() == before);
    assert_eq!(Asset::open(&baked.path).unwrap().channels().len(), 2);
}
