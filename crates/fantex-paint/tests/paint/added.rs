//! Channels that an asset is given while it is painted on.

use std::path::Path;
use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_paint::{
    BlendMode, ChannelPaint, KindName, Layer, Paint, PaintColor, Painter, StrokeFile, StrokeLog, Target,
    Tool, dabs_of, replay,
};
use fantex_store::{Asset, AssetEditor, ChannelKind, EditOptions, VerifyOptions, verify};
use glam::{Vec3, Vec4};

use crate::{Contents, ball, contents, red, stroke};

const LINE: [Vec3; 3] = [Vec3::X, Vec3::new(0.6, 0.6, 0.5), Vec3::Z];

/// Channels of the assets of these tests before some are added.
const KNOWN: usize = 2;

const ADDED: [ChannelKind; 2] = [ChannelKind::Normal, ChannelKind::Emission];

fn paint_on(painter: &mut Painter, target: Target, paint: Paint) {
    let surface = Arc::clone(painter.surface());
    painter.begin_on(target, "test", paint).unwrap();
    painter.dab(&dabs_of(&surface, &stroke(&surface, 50.0, &LINE))).unwrap();
    painter.end().unwrap();
}

fn glow() -> Paint {
    let color = PaintColor::Constant(Vec4::new(0.2, 0.9, 0.1, 1.0));
    Paint {
        tool: Tool::Paint(BlendMode::Normal),
        opacity: 1.0,
        channels: vec![ChannelPaint::new(KNOWN + 1, color)],
        stencil: None,
        sight: None,
    }
}

/// The same of the first channels alone.
fn of_known((pages, means): &Contents, channels: usize) -> Contents {
    let pages = pages.chunks(channels).flat_map(|page| page[..KNOWN].to_vec());
    (pages.collect(), means.chunks(channels).flat_map(|means| means[..KNOWN].to_vec()).collect())
}

fn show(painter: &mut Painter, is_shown: bool) {
    painter.edit_layers("show", |layers| layers[0].visible = is_shown).unwrap();
}

/// A layer with paint, and paint under it, in a baked ball.
fn painted(painter: &mut Painter) -> u64 {
    let layer = painter.add_layer(Layer::painted("paint")).unwrap();
    paint_on(painter, Target::Layer(layer), red(1.0));
    paint_on(painter, Target::Base, red(0.3));
    layer
}

/// What is there stays; what is painted on the new channels is undone, hidden and shown like anything else, also across the
/// addition, and after a restart.
#[test]
fn added_channels_are_painted_hidden_undone_and_replayed() {
    for format in [BakeFormat::Bc7, BakeFormat::Rgba8] {
        let baked = ball(40_000, format);
        let mut painter = baked.painter();
        let base = contents(&painter);
        let layer = painted(&mut painter);
        let before = contents(&painter);
        painter.add_channels(&[ChannelKind::BaseColor, ADDED[0], ADDED[1], ADDED[0]]).unwrap();
        let kinds: Vec<_> = painter.editor().asset().channels().iter().map(|channel| channel.kind).collect();
        assert_eq!(kinds[KNOWN..], ADDED);
        let count = kinds.len();
        let plain = contents(&painter);
        assert!(of_known(&plain, count) == before, "{format:?}");
        assert_eq!(painter.history().done().len(), 3, "adding is no step");
        paint_on(&mut painter, Target::Layer(layer), glow());
        let glowing = contents(&painter);
        assert!(glowing != plain && of_known(&glowing, count) == before);
        // Back beyond the addition and forth again.
        while painter.undo().unwrap() {}
        assert!(of_known(&contents(&painter), count) == base, "{format:?}");
        while painter.redo().unwrap() {}
        assert!(contents(&painter) == glowing, "{format:?}");
        painter.commit().unwrap();
        drop(painter);
        assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
        let mut painter = baked.painter();
        assert!(contents(&painter) == glowing);
        show(&mut painter, false);
        let hidden = contents(&painter);
        let new = |contents: &Contents| -> Vec<_> {
            contents.0.chunks(count).flat_map(|page| page[KNOWN..].to_vec()).collect()
        };
        assert!(new(&hidden) == new(&plain), "hidden paint leaves nothing: {format:?}");
        show(&mut painter, true);
        let finest = |contents: &Contents| -> Vec<_> {
            contents.0.iter().filter(|(id, _)| id.level == 0).map(|(_, bytes)| bytes.clone()).collect()
        };
        assert!(finest(&contents(&painter)) == finest(&glowing));
        painter.commit().unwrap();
        // The log brings its channels along.
        let log = StrokeLog::of(painter.editor().asset()).unwrap();
        assert_eq!(log.strokes.add_channels, ADDED.map(KindName));
        let other = ball(40_000, format);
        let mut again = other.painter();
        log.replay(&mut again).unwrap();
        let channels = |painter: &Painter| painter.editor().asset().channels().to_vec();
        assert_eq!(channels(&again), channels(&painter));
        // Places in the log are those of the world, so texels may differ by what rounding makes of them.
        for position in [LINE[0], LINE[1], LINE[2], -Vec3::X] {
            let point = painter.surface().nearest(position.normalize(), 1.0).unwrap();
            let [ours, theirs] = [&mut painter, &mut again].map(|painter| painter.pick_all(point).unwrap());
            for (a, b) in ours.iter().zip(&theirs) {
                assert!((*a - *b).abs().max_element() < 0.02, "{format:?} {position}: {ours:?} {theirs:?}");
            }
            assert_eq!(ours[KNOWN + 1].y > 0.5, position.x >= 0.0, "{position}: {ours:?}");
        }
    }
}

/// The program ends between the new channels and what is kept under the layers.
#[test]
fn an_addition_that_was_cut_off_is_finished() {
    let baked = ball(30_000, BakeFormat::Bc7);
    let mut painter = baked.painter();
    let layer = painted(&mut painter);
    painter.commit().unwrap();
    drop(painter);
    let mut editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
    editor.attach("channels/adding", br#"["normal","emission"]"#.to_vec()).unwrap();
    editor.add_channels(&ADDED).unwrap();
    drop(editor);
    let mut painter = baked.painter();
    assert!(!painter.editor().has_attachment("channels/adding"));
    let plain = contents(&painter);
    paint_on(&mut painter, Target::Layer(layer), glow());
    painter.undo().unwrap();
    assert!(contents(&painter) == plain);
    painter.redo().unwrap();
    let count = painter.editor().asset().channels().len();
    painter.edit_layers("delete", Vec::clear).unwrap();
    let emission = |contents: &Contents| -> Vec<_> {
        contents.0.chunks(count).map(|page| page[KNOWN + 1].clone()).collect()
    };
    assert!(emission(&contents(&painter)) == emission(&plain));
}

#[test]
fn stroke_files_add_channels_and_what_cannot_be_added_is_named() {
    let baked = ball(20_000, BakeFormat::Bc7);
    let mut painter = baked.painter();
    let text = r#"{"version": 1, "add_channels": ["displacement"], "strokes": [{
        "channels": [{"kind": "displacement", "color": {"linear": [0.8, 0.8, 0.8, 1]}}],
        "samples": [{"at": {"position": [1, 0, 0]}}]}]}"#;
    let file: StrokeFile = serde_json::from_str(text).unwrap();
    assert_eq!(replay(&mut painter, &file, Path::new("")).unwrap().strokes, 1);
    let asset = Arc::clone(painter.editor().asset());
    let height = asset.channel_of_kind(ChannelKind::Displacement).unwrap();
    let point = painter.surface().nearest(Vec3::X, 1.0).unwrap();
    let picked = painter.pick(height, point).unwrap();
    assert!((picked.x - 0.8).abs() < 0.01, "{picked}");
    painter.commit().unwrap();
    let error = painter.add_channels(&[ChannelKind::Light]).unwrap_err().to_string();
    assert!(error.contains("only a bake makes one of light"), "{error}");
    drop(painter);
    assert!(!Asset::open(&baked.path).unwrap().attachment_names().unwrap().contains(&"channels/adding"));
}
