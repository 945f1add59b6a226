//! Opacity that is painted without colour.

use std::path::Path;
use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_mesh::AlphaMode;
use fantex_paint::{
    ChannelPaint, Layer, Paint, PaintColor, Painter, StrokeLog, Target, Tool, ToolSettings, dabs_of, replay,
};
use fantex_store::{Asset, AssetEditor, ChannelKind, EditOptions, VerifyOptions, verify};
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

/// Materials that ignore alpha are told to show it; nothing else changes.
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
