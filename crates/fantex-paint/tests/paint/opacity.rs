//! Opacity that is painted without colour.

use std::path::Path;
use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_mesh::AlphaMode;
use fantex_paint::{
    BlendMode, ChannelPaint, GroupKind, Layer, LayerPlace, Paint, PaintColor, Painter, StrokeLog, Target,
    Tool, ToolSettings, dabs_of, dissolve_group, move_layer, replay,
};
use fantex_store::{Asset, AssetEditor, ChannelKind, EditOptions, PageId, VerifyOptions, verify};
use glam::{Vec3, Vec4};

use crate::{ball, contents, red, stroke, strokes};

const LINE: [Vec3; 2] = [Vec3::X, Vec3::new(0.6, 0.6, 0.5)];

fn opacity(to: f32) -> Paint {
    let channels = vec![ChannelPaint::new(0, PaintColor::Constant(Vec4::ONE))];
    Paint { tool: Tool::Opacity { to }, opacity: 1.0, channels, stencil: None, sight: None }
}

fn paint_on(painter: &mut Painter, target: Target, paint: Paint) {
    let surface = Arc::clone(painter.surface());
    painter.begin_on(target, "opacity", paint).unwrap();
    painter.dab(&dabs_of(&surface, &stroke(&surface, 60.0, &LINE))).unwrap();
    painter.end().unwrap();
}

fn pick(painter: &mut Painter, position: Vec3) -> Vec4 {
    let point = painter.surface().nearest(position.normalize(), 1.0).unwrap();
    painter.pick(0, point).unwrap()
}

/// It goes down and up again, in all formats that keep alpha, and colours stay; so does all that is not covered.
#[test]
fn opacity_goes_down_and_up_and_colours_stay() {
    for (format, tolerance) in
        [(BakeFormat::Bc7, 0.04), (BakeFormat::Rgba8, 0.003), (BakeFormat::Float, 1e-6)]
    {
        let baked = ball(40_000, format);
        let mut painter = baked.painter();
        let before = contents(&painter);
        let [there, beside] = [LINE[0], -Vec3::X].map(|position| pick(&mut painter, position));
        assert!(there.w > 0.99);
        for to in [0.25, 0.0, 0.75, 1.0] {
            paint_on(&mut painter, Target::Base, opacity(to));
            let found = pick(&mut painter, LINE[0]);
            assert!((found.w - to).abs() < 0.01, "{format:?} {to}: {found}");
            let change = (found - there).truncate().abs().max_element();
            assert!(change < tolerance, "{format:?} {to}: {found} {there}");
            assert_eq!(pick(&mut painter, -Vec3::X), beside, "{format:?} {to}");
        }
        let after = contents(&painter);
        while painter.undo().unwrap() {}
        assert!(contents(&painter) == before, "{format:?}");
        while painter.redo().unwrap() {}
        assert!(contents(&painter) == after, "{format:?}");
        painter.commit().unwrap();
        drop(painter);
        assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    }
}

/// On a layer it hides what was painted there, brings it back, and shows nothing where nothing was painted.
#[test]
fn on_layers_erased_colours_come_back() {
    let baked = ball(40_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let base = pick(&mut painter, LINE[0]);
    let layer = painter.add_layer(Layer::painted("paint")).unwrap();
    paint_on(&mut painter, Target::Layer(layer), opacity(1.0));
    assert_eq!(pick(&mut painter, LINE[0]), base, "nothing was painted there");
    paint_on(&mut painter, Target::Layer(layer), red(1.0));
    let painted = pick(&mut painter, LINE[0]);
    assert!(painted.x > 0.85);
    paint_on(&mut painter, Target::Layer(layer), opacity(0.0));
    assert_eq!(pick(&mut painter, LINE[0]), base);
    paint_on(&mut painter, Target::Layer(layer), opacity(1.0));
    assert!((pick(&mut painter, LINE[0]) - painted).abs().max_element() < 0.01);
}

#[test]
fn strokes_of_opacity_are_logged_and_replayed() {
    let text = r#"{"label": "hole", "tool": {"opacity": 0.2}, "brush": {"size": {"texels": 60}},
        "channels": [{"kind": "base_color"}], "samples": [{"at": {"position": [1, 0, 0]}}]}"#;
    let [one, other] = [(); 2].map(|()| ball(30_000, BakeFormat::Rgba8));
    let mut painter = one.painter();
    replay(&mut painter, &strokes(text), Path::new("")).unwrap();
    assert!((pick(&mut painter, Vec3::X).w - 0.2).abs() < 0.01);
    // Dabs without settings are told, too.
    paint_on(&mut painter, Target::Base, opacity(0.5));
    painter.commit().unwrap();
    let log = StrokeLog::of(painter.editor().asset()).unwrap();
    let tools: Vec<_> = log.strokes.strokes.iter().map(|stroke| stroke.tool).collect();
    assert_eq!(tools, [ToolSettings::Opacity(0.2), ToolSettings::Opacity(0.5)]);
    let mut again = other.painter();
    log.replay(&mut again).unwrap();
    for position in [Vec3::X, LINE[1], -Vec3::X] {
        let [ours, theirs] = [&mut painter, &mut again].map(|painter| pick(painter, position));
        assert!((ours - theirs).abs().max_element() < 0.02, "{position}: {ours} {theirs}");
    }
    let wrong = text.replace("base_color", "occlusion_roughness_metallic");
    let error = replay(&mut again, &strokes(&wrong), Path::new("")).unwrap_err().to_string();
    assert!(error.contains("only the base colour's can be painted"), "{error}");
    let masked = text.replace(r#""label": "hole""#, r#""layer": {"name": "a", "mask": true}"#);
    let error = replay(&mut again, &strokes(&masked), Path::new("")).unwrap_err().to_string();
    assert!(error.contains("a mask has no opacity"), "{error}");
}

/// Materials that ignore alpha are told to show it by the editor; nothing else changes.
#[test]
fn materials_show_painted_opacity_once_they_are_told() {
    let baked = ball(20_000, BakeFormat::Bc7);
    let mut painter = baked.painter();
    paint_on(&mut painter, Target::Base, opacity(0.0));
    painter.commit().unwrap();
    let before = contents(&painter);
    drop(painter);
    let modes = |path: &Path| -> Vec<AlphaMode> {
        Asset::open(path).unwrap().mesh().materials.iter().map(|material| material.alpha).collect()
    };
    assert!(modes(&baked.path).iter().all(|mode| *mode == AlphaMode::Opaque));
    for mode in [AlphaMode::Mask(0.5), AlphaMode::Blend, AlphaMode::Opaque] {
        let mut editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
        editor.set_alpha_mode(mode).unwrap();
        drop(editor);
        let found = modes(&baked.path);
        assert!(!found.is_empty() && found.iter().all(|found| *found == mode), "{found:?}");
        assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
        let painter = baked.painter();
        assert!(contents(&painter) == before);
        assert_eq!(painter.history().done().len(), 1);
        assert_eq!(painter.editor().asset().channel_of_kind(ChannelKind::BaseColor), Some(0));
    }
}

/// Pages of level 0 with their bytes, in both channels.
fn finest(painter: &Painter) -> Vec<(PageId, Vec<u8>)> {
    contents(painter).0.into_iter().filter(|(id, _)| id.level == 0).collect()
}

/// Layers that erase, by hand: alpha is that below times one minus what they cover, and colours and other channels stay.
#[test]
fn layers_that_erase_take_opacity_from_what_lies_below() {
    let baked = ball(40_000, BakeFormat::Float);
    let mut painter = baked.painter();
    let [there, beside] = [LINE[0], -Vec3::X].map(|position| pick(&mut painter, position));
    let base = contents(&painter);
    let below = painter.add_layer(Layer::painted("below")).unwrap();
    paint_on(&mut painter, Target::Layer(below), red(0.5));
    let painted = pick(&mut painter, LINE[0]);
    let with_below = finest(&painter);
    let mut layer = Layer::painted("holes");
    layer.blend = BlendMode::Erase;
    let holes = painter.add_layer(layer).unwrap();
    paint_on(&mut painter, Target::Layer(holes), red(0.8));
    let expect = |painter: &mut Painter, color: Vec4, alpha: f32| {
        let found = pick(painter, LINE[0]);
        assert!((found - color.with_w(alpha)).abs().max_element() < 2e-3, "{found} {color} {alpha}");
        assert_eq!(pick(painter, -Vec3::X), beside);
    };
    let edit = |painter: &mut Painter, change: fn(&mut Vec<Layer>)| {
        painter.edit_layers("edit", change).unwrap();
    };
    expect(&mut painter, painted, 0.2);
    edit(&mut painter, |layers| layers[1].opacity = 0.5);
    expect(&mut painter, painted, 0.6);
    edit(&mut painter, |layers| layers[1].mask = Some(0.25));
    expect(&mut painter, painted, 0.9);
    edit(&mut painter, |layers| (layers[1].opacity, layers[1].mask) = (1.0, None));
    // Roughness and the like stay: in them the layer shows nothing.
    let pages = finest(&painter).into_iter().zip(&with_below);
    assert!(pages.skip(1).step_by(2).all(|(after, before)| after == *before));
    // Alone in a group that blends on its own there is nothing below it; one that lets it pass, or erases itself, does as it does.
    let group = painter.group_layers("group", GroupKind::Isolated, &[holes]).unwrap();
    assert!(finest(&painter) == with_below);
    edit(&mut painter, |layers| layers[2].blend = BlendMode::Erase);
    edit(&mut painter, |layers| layers[1].blend = BlendMode::Normal);
    expect(&mut painter, painted, 0.2);
    painter.edit_layers("free", |layers| dissolve_group(layers, group)).unwrap();
    edit(&mut painter, |layers| layers[1].blend = BlendMode::Erase);
    painter.group_layers("group", GroupKind::PassThrough, &[holes]).unwrap();
    expect(&mut painter, painted, 0.2);
    edit(&mut painter, |layers| layers[2].opacity = 0.5);
    expect(&mut painter, painted, 0.6);
    // Under the other layer it erases what lies under that.
    painter.edit_layers("under", |layers| move_layer(layers, below, LayerPlace::Top)).unwrap();
    let alpha = 0.5 + 0.6 * 0.5;
    let color = (Vec3::new(0.9, 0.05, 0.05) * 0.5 + there.truncate() * (0.6 * 0.5)) / alpha;
    expect(&mut painter, color.extend(1.0), alpha);
    // Gone without a trace.
    edit(&mut painter, |layers| layers.iter_mut().for_each(|layer| layer.visible = false));
    assert!(contents(&painter) == base);
    while painter.undo().unwrap() {}
    assert!(contents(&painter) == base);
    painter.commit().unwrap();
    drop(painter);
    assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
}

/// Layers that erase, merged, leave of what lies below them what both leave; other layers do not become holes, nor holes paint.
#[test]
fn merged_layers_that_erase_erase_what_both_do() {
    let baked = ball(40_000, BakeFormat::Float);
    let mut painter = baked.painter();
    let places = [LINE[0], LINE[1], -Vec3::X, Vec3::Z];
    let seen = |painter: &mut Painter| places.map(|place| pick(painter, place));
    let base = seen(&mut painter);
    let add = |painter: &mut Painter, name: &str, blend: BlendMode, opacity: f32| {
        let mut layer = Layer::painted(name);
        layer.blend = blend;
        let layer = painter.add_layer(layer).unwrap();
        paint_on(painter, Target::Layer(layer), red(opacity));
        layer
    };
    let one = add(&mut painter, "one", BlendMode::Erase, 0.8);
    let other = add(&mut painter, "other", BlendMode::Erase, 0.5);
    painter.edit_layers("fade", |layers| layers[1].opacity = 0.5).unwrap();
    let expect = |painter: &mut Painter, alpha: f32, expected: &[Vec4]| {
        let found = seen(painter);
        assert!((found[0] - base[0].with_w(alpha)).abs().max_element() < 2e-3, "{} {alpha}", found[0]);
        for (found, expected) in found.iter().zip(expected) {
            assert!((*found - *expected).abs().max_element() < 2e-3, "{found} {expected}");
        }
    };
    let (before, two) = (seen(&mut painter), contents(&painter));
    expect(&mut painter, 0.2 * 0.75, &before);
    painter.merge_layer_down(other).unwrap();
    assert!(painter.layers().len() == 1 && painter.layers()[0].erases());
    expect(&mut painter, 0.2 * 0.75, &before);
    assert!(painter.undo().unwrap());
    assert!(contents(&painter) == two);
    // As a group that lets pass through, and one in another.
    let inner = painter.group_layers("inner", GroupKind::PassThrough, &[other]).unwrap();
    let outer = painter.group_layers("outer", GroupKind::PassThrough, &[one, inner]).unwrap();
    painter.edit_layers("fade", |layers| layers[3].opacity = 0.5).unwrap();
    let before = seen(&mut painter);
    expect(&mut painter, 0.5 + 0.5 * 0.2 * 0.75, &before);
    painter.merge_group(outer).unwrap();
    assert!(painter.layers().len() == 1 && painter.layers()[0].erases());
    expect(&mut painter, 0.5 + 0.5 * 0.2 * 0.75, &before);
    // Paint does not go into holes.
    let paint = add(&mut painter, "paint", BlendMode::Normal, 1.0);
    let before = contents(&painter);
    let refused = painter.merge_layer_down(paint).unwrap_err().to_string();
    assert!(
        refused.contains("\"outer\" erases") && refused.contains("one layer cannot do both"),
        "{refused}"
    );
    assert!(contents(&painter) == before && painter.layers().len() == 2);
}

#[test]
fn layers_that_erase_come_from_stroke_files_and_logs() {
    let stroke = |tool: &str, blend: &str| {
        format!(
            r#"{{"layer": {{"name": "holes", "blend": "{blend}"}}, "tool": {tool}, "brush": {{"size": {{"texels": 60}}}},
            "channels": [{{"kind": "base_color", "color": {{"srgb": [1, 1, 1]}}}}], "samples": [{{"at": {{"position": [1, 0, 0]}}}}]}}"#
        )
    };
    let [one, other] = [(); 2].map(|()| ball(30_000, BakeFormat::Rgba8));
    let mut painter = one.painter();
    replay(&mut painter, &strokes(&stroke(r#"{"paint": "normal"}"#, "erase")), Path::new("")).unwrap();
    assert!(painter.layers()[0].erases());
    assert!(pick(&mut painter, Vec3::X).w < 0.01);
    painter.commit().unwrap();
    let log = StrokeLog::of(painter.editor().asset()).unwrap();
    let mut again = other.painter();
    log.replay(&mut again).unwrap();
    assert!(again.layers() == painter.layers());
    assert!(pick(&mut again, Vec3::X).w < 0.01);
    let brush = stroke(r#"{"paint": "erase"}"#, "normal");
    let error = replay(&mut again, &strokes(&brush), Path::new("")).unwrap_err().to_string();
    assert!(error.contains("only layers blend as \"erase\""), "{error}");
}
