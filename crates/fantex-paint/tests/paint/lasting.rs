//! What was painted lasts: strokes that nobody ended, bases of hidden layers, histories that are not kept, lists that are damaged.

use std::io;
use std::path::PathBuf;
use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_base::{Error, ErrorKind};
use fantex_paint::{
    ColorFill, FillArea, GraphFill, Layer, LayerPlace, PaintOptions, Painter, StrokeLog, Target,
    TextureGraph, dabs_of, replay, without_room,
};
use fantex_store::{AssetEditor, EditOptions, VerifyOptions, verify};
use fantex_texture::Image;
use glam::{Vec3, Vec4};

use crate::layers::{LINE, everywhere, paint_on};
use crate::{
    Baked, Contents, ball, contents, crash, fine_ball, open, paint_stroke, red, slices, start, stroke,
    strokes,
};

fn finest((pages, _): &Contents) -> Vec<Vec<u8>> {
    pages.iter().filter(|(id, _)| id.level == 0).map(|(_, bytes)| bytes.clone()).collect()
}

/// Half of a stroke that stays open.
fn begin_stroke(painter: &mut Painter, target: Target) {
    let surface = Arc::clone(painter.surface());
    painter.begin_on(target, "half", red(0.7)).unwrap();
    let dabs = dabs_of(&surface, &stroke(&surface, 40.0, &LINE));
    painter.dab(&dabs[..dabs.len() / 2]).unwrap();
}

#[test]
fn a_stroke_that_nobody_ends_is_a_step_after_a_crash() {
    for format in [BakeFormat::Bc7, BakeFormat::Rgba8] {
        for kind in 0..3 {
            let baked = ball(80_000, format);
            let (mut painter, _) = start(&baked);
            let target = match kind {
                0 => Target::Base,
                1 => Target::Layer(painter.add_layer(Layer::painted("paint")).unwrap()),
                _ => Target::Mask(painter.add_layer(Layer::fill("fill", &[Vec4::ONE; 2])).unwrap()),
            };
            // What is undone does not fit what is painted then.
            let line = stroke(painter.surface(), 40.0, &LINE);
            paint_stroke(&mut painter, red(0.3), &line);
            assert!(painter.undo().unwrap());
            painter.commit().unwrap();
            let (before, steps) = (contents(&painter), painter.history().done().len());
            begin_stroke(&mut painter, target);
            // Each commit replaces what the one before has kept.
            painter.commit().unwrap();
            painter.dab(&dabs_of(painter.surface(), &stroke(painter.surface(), 40.0, &[-Vec3::X]))).unwrap();
            painter.commit().unwrap();
            let seen = contents(&painter);
            assert!(seen != before, "{format:?}, {kind}");

            let mut painter = crash(painter, &baked);
            assert!(finest(&contents(&painter)) == finest(&seen), "{format:?}, {kind}");
            assert_eq!(painter.history().done().len(), steps + 1);
            assert_eq!(painter.history().done()[steps].label, "half");
            assert!(painter.history().undone().is_empty());
            let after = contents(&painter);
            assert!(painter.undo().unwrap());
            assert!(contents(&painter) == before, "{format:?}, {kind}");
            assert!(painter.redo().unwrap());
            assert!(contents(&painter) == after, "{format:?}, {kind}");
            painter.commit().unwrap();
            drop(painter);
            assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
            let log = StrokeLog::of(open(&baked).editor().asset()).unwrap();
            assert_eq!(log.strokes.strokes.last().unwrap().label, "half");
        }
    }
}

/// They would be looked for part by part, or listed and never read again.
#[test]
fn unfinished_steps_that_cannot_be_there_are_damage() {
    const KEPT: &str = "history/unfinished";
    let (stroke, step) = (ball(20_000, BakeFormat::Rgba8), ball(20_000, BakeFormat::Rgba8));
    let (mut painter, _) = start(&stroke);
    begin_stroke(&mut painter, Target::Base);
    painter.commit().unwrap();
    drop(painter);
    let (mut painter, _) = start(&step);
    assert!(painter.start_undo().unwrap());
    painter.commit().unwrap();
    drop(painter);
    for (baked, kind, key, value) in [
        (&stroke, "Stroke", "/step/id", 7_000_000_u64),
        (&stroke, "Stroke", "/step/parts", u64::from(u32::MAX)),
        (&step, "Step", "/step/id", 7_000_000),
        (&step, "Step", "/step/parts", u64::from(u32::MAX)),
        (&step, "Step", "/left/end", u64::from(u32::MAX)),
        (&step, "Step", "/count", u64::from(u32::MAX)),
    ] {
        let mut editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
        let whole = editor.attachment(KEPT).unwrap().unwrap();
        let mut kept: serde_json::Value = serde_json::from_slice(&whole).unwrap();
        *kept.pointer_mut(&format!("/{kind}{key}")).unwrap() = value.into();
        editor.attach(KEPT, kept.to_string().into_bytes()).unwrap();
        editor.commit().unwrap();
        drop(editor);
        let error = Painter::open(&baked.path, &PaintOptions::default()).err().unwrap().to_string();
        assert!(error.contains("its unfinished step cannot be there"), "{kind}{key}: {error}");
        let mut editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
        editor.attach(KEPT, whole).unwrap();
        editor.commit().unwrap();
    }
    assert!(
        [&stroke, &step]
            .into_iter()
            .all(|baked| Painter::open(&baked.path, &PaintOptions::default()).is_ok())
    );
}

#[test]
fn a_stroke_without_a_history_that_nobody_ends_forgets_the_one_before() {
    let baked = ball(80_000, BakeFormat::Bc7);
    drop(start(&baked));
    let options = PaintOptions { history: false, ..PaintOptions::default() };
    let mut painter = Painter::open(&baked.path, &options).unwrap();
    begin_stroke(&mut painter, Target::Base);
    painter.commit().unwrap();
    let mut painter = crash(painter, &baked);
    assert!(!painter.undo().unwrap() && painter.history().undone().is_empty());
}

/// What commits keep of it leaves no trace.
#[test]
fn a_stroke_that_ends_after_commits_is_as_one_without() {
    let [committed, whole] = [0, 1].map(|_| ball(80_000, BakeFormat::Bc7));
    let states = [&committed, &whole].map(|baked| {
        let (mut painter, before) = start(baked);
        begin_stroke(&mut painter, Target::Base);
        if std::ptr::eq(baked, &raw const committed) {
            painter.commit().unwrap();
        }
        painter.end().unwrap();
        painter.commit().unwrap();
        let mut names = painter.editor().attachment_names();
        // Steps have other numbers.
        names.retain(|name| !name.starts_with("history/"));
        let after = contents(&painter);
        let parts = painter.editor().attachment_names().len() - names.len();
        assert!(painter.undo().unwrap());
        assert!(contents(&painter) == before);
        (after, names, parts)
    });
    assert!(states[0] == states[1]);
    // Given up instead.
    let baked = ball(80_000, BakeFormat::Bc7);
    let (mut painter, before) = start(&baked);
    let names = painter.editor().attachment_names();
    begin_stroke(&mut painter, Target::Base);
    painter.commit().unwrap();
    painter.abandon().unwrap();
    painter.commit().unwrap();
    assert!(contents(&painter) == before && painter.editor().attachment_names() == names);
}

/// Another layer has put the page aside; that nothing of it shows does not make the base this stroke's.
#[test]
fn strokes_beside_a_hidden_layer_leave_its_base_alone() {
    for format in [BakeFormat::Bc7, BakeFormat::Rgba8] {
        let baked = ball(60_000, format);
        let mut painter = baked.painter();
        let base = contents(&painter);
        let hidden = painter.add_layer(Layer::painted("hidden")).unwrap();
        paint_on(&mut painter, Target::Layer(hidden), red(1.0), &LINE);
        let painted = contents(&painter);
        painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
        let other = painter.add_layer(Layer::painted("other")).unwrap();
        paint_on(&mut painter, Target::Layer(other), red(0.5), &LINE);
        assert!(painter.undo().unwrap());
        begin_stroke(&mut painter, Target::Layer(other));
        painter.show().unwrap();
        painter.abandon().unwrap();
        assert!(contents(&painter) == base, "{format:?}");
        painter.edit_layers("show", |layers| layers[0].visible = true).unwrap();
        assert!(finest(&contents(&painter)) == finest(&painted), "{format:?}");
        painter.edit_layers("remove", |layers| layers.clear()).unwrap();
        assert!(contents(&painter) == base, "{format:?}");
    }
}

#[test]
fn strokes_without_a_history_forget_the_one_before() {
    let baked = ball(60_000, BakeFormat::Bc7);
    let (mut painter, _) = start(&baked);
    let line = stroke(painter.surface(), 40.0, &LINE);
    paint_stroke(&mut painter, red(0.4), &line);
    painter.undo().unwrap();
    painter.commit().unwrap();
    drop(painter);
    let options = PaintOptions { history: false, ..PaintOptions::default() };
    let mut painter = Painter::open(&baked.path, &options).unwrap();
    assert_eq!((painter.history().done().len(), painter.history().undone().len()), (1, 1));
    paint_stroke(&mut painter, red(0.6), &line);
    painter.commit().unwrap();
    let after = contents(&painter);
    drop(painter);
    let mut painter = baked.painter();
    assert!(!painter.undo().unwrap() && !painter.redo().unwrap());
    assert!(contents(&painter) == after);
    assert!(!painter.editor().attachment_names().iter().any(|name| name.starts_with("history/")));
}

/// The painter goes on in the file that is written anew.
#[test]
fn space_of_a_forgotten_history_is_given_back() {
    let baked = ball(80_000, BakeFormat::Bc7);
    drop(start(&baked));
    let options = PaintOptions { history: false, ..PaintOptions::default() };
    let mut painter = Painter::open(&baked.path, &options).unwrap();
    let line = stroke(painter.surface(), 40.0, &LINE);
    paint_stroke(&mut painter, red(0.6), &line);
    assert!(!painter.close_gaps(1.0).unwrap() && !painter.editor().has_changes());
    let (before, bytes) = (contents(&painter), std::fs::metadata(&baked.path).unwrap().len());
    assert!(painter.close_gaps(0.01).unwrap());
    let closed = std::fs::metadata(&baked.path).unwrap().len();
    assert!(closed < bytes && contents(&painter) == before, "{bytes} {closed}");
    assert!(!painter.close_gaps(painter.editor().asset().gap_share()).unwrap());
    paint_stroke(&mut painter, red(0.2), &line);
    painter.commit().unwrap();
    let after = contents(&painter);
    assert!(after != before);
    drop(painter);
    assert!(contents(&open(&baked)) == after && verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
}

/// Who drops the painter is not told that its changes can be committed later.
#[test]
fn a_full_disk_is_told_of_as_somebody_can_act_on_it() {
    let baked = ball(20_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    painter.limit_file(Some(1));
    let line = stroke(painter.surface(), 40.0, &LINE);
    paint_stroke(&mut painter, red(0.6), &line);
    let error = without_room(painter.commit().unwrap_err(), &baked.path).to_string();
    assert!(error.contains("a.fan") && error.contains("make room, then apply the strokes again"), "{error}");
    assert!(!error.contains("commit"), "{error}");
    let other = without_room(Error::invalid("another"), &baked.path);
    assert_eq!(other.to_string(), "another");
    // The disk of temporary files is another one, and has no path of the asset's.
    let full = io::Error::from(io::ErrorKind::StorageFull);
    let elsewhere = Error::new(ErrorKind::Io, "cannot keep pages").with_source(full);
    assert_eq!(without_room(elsewhere, &baked.path).to_string(), "cannot keep pages");
}

/// Who replays strokes knows from the file whether some of them are durable before all are.
#[test]
fn strokes_that_read_the_surface_commit_what_is_before_them() {
    let stroke = |tool: &str, more: &str| {
        format!(
            r#"{{"tool": {tool}, {more} "channels": [{{"kind": "base_color"}}], "samples": [{{"at": {{"position": [1, 0, 0]}}}}]}}"#
        )
    };
    let paint = stroke(r#"{"paint": "normal"}"#, "");
    let layer = r#""layer": {"name": "soft"},"#;
    for tool in [
        r#"{"blur": {"radius": {"texels": 4}}}"#,
        r#"{"smudge": {"strength": 0.5}}"#,
        r#"{"clone": {"from": [0, 1, 0]}}"#,
    ] {
        let reads = stroke(tool, "");
        for (text, commits) in [
            (reads.clone(), false),
            (format!("{reads}, {paint}"), false),
            (format!("{paint}, {reads}"), true),
            (stroke(tool, layer), true),
        ] {
            let (baked, file) = (ball(20_000, BakeFormat::Rgba8), strokes(&text));
            let mut painter = baked.painter();
            replay(&mut painter, &file, baked.folder.path()).unwrap();
            let has_committed = painter.editor().asset().generation() > 1;
            assert_eq!((file.commits_between(), has_committed), (commits, commits), "{text}");
            assert!(painter.commit().unwrap().generation > 1);
        }
    }
}

/// A number that comes back is that of another layer.
#[test]
fn what_was_painted_on_deleted_layers_does_not_come_back_with_their_numbers() {
    let baked = ball(20_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let base = contents(&painter);
    let layer = painter.add_layer(Layer::painted("dirt")).unwrap();
    let stack = painter.layers().to_vec();
    paint_on(&mut painter, Target::Layer(layer), red(1.0), &LINE);
    let painted = contents(&painter);
    painter.edit_layers("delete", Vec::clear).unwrap();
    painter.set_layers("set", stack, &[]).unwrap();
    assert_eq!(painter.layers()[0].id(), layer);
    assert!(painted != base && contents(&painter) == base);
    assert!(painter.undo().unwrap() && painter.undo().unwrap());
    assert!(finest(&contents(&painter)) == finest(&painted));
    assert!(painter.redo().unwrap() && painter.redo().unwrap());
    assert!(contents(&painter) == base);
}

#[test]
fn without_a_history_what_was_painted_on_deleted_layers_goes() {
    let baked = ball(20_000, BakeFormat::Rgba8);
    let options = PaintOptions { history: false, ..PaintOptions::default() };
    let is_painted = |painter: &Painter, layer: u64| {
        let prefix = format!("layers/{layer:010}/");
        painter.editor().attachment_names().iter().any(|name| name.starts_with(&prefix))
    };
    let mut painter = baked.painter();
    let layers: Vec<u64> = ["first", "second"]
        .map(|name| painter.add_layer(Layer::painted(name)).unwrap())
        .into_iter()
        .inspect(|&layer| paint_on(&mut painter, Target::Layer(layer), red(1.0), &LINE))
        .collect();
    painter.edit_layers("delete", |stack| stack.truncate(1)).unwrap();
    assert!(layers.iter().all(|&layer| is_painted(&painter, layer)), "it can be undone");
    painter.commit().unwrap();
    drop(painter);
    // With the history goes what only it could bring back.
    let mut painter = Painter::open(&baked.path, &options).unwrap();
    paint_on(&mut painter, Target::Base, red(0.5), &LINE);
    assert_eq!(layers.iter().map(|&layer| is_painted(&painter, layer)).collect::<Vec<_>>(), [true, false]);
    painter.edit_layers("delete", Vec::clear).unwrap();
    assert!(!layers.iter().any(|&layer| is_painted(&painter, layer)));
}

#[test]
fn strokes_that_are_done_again_keep_their_place_in_the_log() {
    let baked = ball(60_000, BakeFormat::Rgba8);
    let draw = |painter: &mut Painter, label: &str, opacity: f32| {
        let surface = Arc::clone(painter.surface());
        painter.begin(label, red(opacity)).unwrap();
        painter.dab(&dabs_of(&surface, &stroke(&surface, 40.0, &LINE))).unwrap();
        painter.end().unwrap();
    };
    let mut painter = baked.painter();
    draw(&mut painter, "first", 0.3);
    painter.undo().unwrap();
    painter.commit().unwrap();
    drop(painter);
    let mut painter = baked.painter();
    painter.redo().unwrap();
    draw(&mut painter, "second", 0.4);
    painter.commit().unwrap();
    let log = StrokeLog::of(painter.editor().asset()).unwrap();
    let labels: Vec<&str> = log.strokes.strokes.iter().map(|stroke| stroke.label.as_str()).collect();
    assert_eq!(labels, ["first", "second"]);
}

/// A ring of groups would be followed for ever.
#[test]
fn layers_whose_numbers_repeat_are_damage() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    for _ in 0..2 {
        painter.add_layer(everywhere(Vec4::ONE)).unwrap();
    }
    painter.commit().unwrap();
    drop(painter);
    let mut editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
    let index = String::from_utf8(editor.attachment("layers/index").unwrap().unwrap()).unwrap();
    let repeated = index.replace("\"id\":1", "\"id\":0");
    assert_ne!(index, repeated);
    editor.attach("layers/index", repeated.into_bytes()).unwrap();
    editor.commit().unwrap();
    drop(editor);
    let error = Painter::open(&baked.path, &PaintOptions::default()).err().unwrap().to_string();
    assert!(error.contains("the layers of") && error.contains("their numbers repeat"), "{error}");
}

#[test]
fn layers_with_numbers_that_could_not_be_read_again_are_refused() {
    for id in [1_u64 << 48, u64::MAX] {
        let baked = ball(10_000, BakeFormat::Rgba8);
        let mut painter = baked.painter();
        painter.add_layer(everywhere(Vec4::ONE)).unwrap();
        let before = contents(&painter);
        let mut layers = painter.layers().to_vec();
        let text = serde_json::to_string(&layers).unwrap().replace("\"id\":0", &format!("\"id\":{id}"));
        layers = serde_json::from_str(&text).unwrap();
        assert_eq!(layers[0].id(), id);
        let set =
            format!(r#"{{ "label": "set", "set_layers": {} }}"#, serde_json::to_string(&layers).unwrap());
        let error = replay(&mut painter, &strokes(&set), baked.folder.path()).err().unwrap().to_string();
        assert!(error.contains(&format!("the layer number {id} is too large")), "{error}");
        assert!(contents(&painter) == before);
        painter.commit().unwrap();
        drop(painter);
        assert_eq!(baked.painter().layers().len(), 1);
    }
}

/// The next layer would take the number of one that is there; or a layer would show more than all of itself.
#[test]
fn layers_that_no_painter_writes_are_damage() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    painter.add_layer(Layer::fill("fill", &[Vec4::ONE; 2])).unwrap();
    type Change = fn(&mut Layer);
    let changes: [(&str, Change); 3] = [
        ("opacity", |layer| layer.opacity = 1.5),
        ("opacity", |layer| layer.opacity = f32::NAN),
        ("mask", |layer| layer.mask = Some(-0.5)),
    ];
    for (key, change) in changes {
        let error = painter.edit_layers("edit", |layers| change(&mut layers[0])).unwrap_err().to_string();
        assert!(error.contains(&format!("`layers[0].{key}` is")) && error.contains("0 to 1"), "{error}");
    }
    painter.commit().unwrap();
    drop(painter);
    let index = || {
        let editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
        String::from_utf8(editor.attachment("layers/index").unwrap().unwrap()).unwrap()
    };
    let whole = index();
    for (from, to, sentence) in [
        (r#""next_id":1"#, r#""next_id":0"#, "the number of the next one is not above theirs"),
        (r#""opacity":1.0"#, r#""opacity":1e38"#, "`layers[0].opacity` is 1"),
        (r#""mask":0.0"#, r#""mask":-5"#, "`layers[0].mask` is -5, but must be 0 to 1"),
    ] {
        let changed = whole.replace(from, to);
        assert_ne!(whole, changed);
        put(&baked, "layers/index", changed.as_bytes());
        let error = Painter::open(&baked.path, &PaintOptions::default()).err().unwrap();
        let kind = error.kind();
        let error = error.to_string();
        assert!(kind == ErrorKind::Damaged && error.contains("the layers of"), "{error}");
        assert!(error.contains(sentence), "{error}");
    }
    put(&baked, "layers/index", whole.as_bytes());
    assert_eq!(baked.painter().layers().len(), 1);
}

/// Puts an attachment into an asset that is not open.
fn put(baked: &Baked, name: &str, contents: &[u8]) {
    let mut editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
    editor.attach(name, contents.to_vec()).unwrap();
    editor.commit().unwrap();
}

#[test]
fn logs_with_numbers_that_cannot_go_on_are_damage() {
    for number in ["18446744073709551615", "1000000000000"] {
        let baked = ball(10_000, BakeFormat::Rgba8);
        put(&baked, &format!("strokes/{number}"), b"{}");
        let error = Painter::open(&baked.path, &PaintOptions::default()).err().unwrap().to_string();
        assert!(
            error.contains("the log of strokes of") && error.contains("its numbers are too large"),
            "{error}"
        );
    }
}

/// Whatever cannot be logged leaves nothing behind.
#[test]
fn what_a_full_log_does_not_take_is_not_done() {
    let baked = ball(40_000, BakeFormat::Rgba8);
    let before = contents(&baked.painter());
    put(&baked, "strokes/999999999999", b"{}");
    let mut painter = baked.painter();
    let names = |painter: &Painter| {
        let mut names = painter.editor().attachment_names();
        names.retain(|name| name != "history/index");
        names
    };
    let is_refused = |refused: fantex_base::Result<()>| {
        let error = refused.unwrap_err().to_string();
        assert!(error.contains("numbers go up to 999999999999"), "{error}");
    };
    // Dabs that are shown already are taken back.
    begin_stroke(&mut painter, Target::Base);
    assert!(!painter.show().unwrap().is_empty());
    is_refused(painter.start_fill(FillArea::Everything));
    assert!(!painter.has_work() && contents(&painter) == before);
    // So are layers.
    is_refused(painter.add_layer(Layer::painted("layer")).map(drop));
    assert!(painter.layers().is_empty());
    painter.finish_work().unwrap();
    assert!(painter.layers().is_empty() && contents(&painter) == before);
    assert!(painter.history().done().is_empty());
    painter.commit().unwrap();
    assert_eq!(names(&painter), ["strokes/999999999999"]);
    assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
}

/// A channel that is not there is found out when dabs are shown already.
#[test]
fn a_fill_that_cannot_begin_takes_its_dabs_back() {
    for target in 0..2 {
        let baked = ball(40_000, BakeFormat::Rgba8);
        let (mut painter, _) = start(&baked);
        let layer = painter.add_layer(Layer::painted("layer")).unwrap();
        painter.commit().unwrap();
        let (before, names) = (contents(&painter), painter.editor().attachment_names());
        begin_stroke(&mut painter, [Target::Base, Target::Layer(layer)][target]);
        painter.commit().unwrap();
        assert!(contents(&painter) != before);
        let starts = vec![painter.surface().nearest(Vec3::X, f32::INFINITY).unwrap()];
        let area = FillArea::Color { channel: 9, starts, fill: ColorFill::default() };
        let error = painter.fill(area).unwrap_err().to_string();
        assert!(error.contains("there is no channel 9"), "{error}");
        assert!(contents(&painter) == before);
        painter.end().unwrap();
        painter.commit().unwrap();
        assert!(contents(&painter) == before && painter.history().done().len() == 2);
        assert_eq!(painter.editor().attachment_names(), names);
    }
}

/// The step before is not taken for the one that failed.
#[cfg(unix)]
#[test]
fn layers_whose_merging_fails_stay() {
    let baked = ball(60_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let [_, upper] = ["lower", "upper"].map(|name| {
        let id = painter.add_layer(Layer::painted(name)).unwrap();
        paint_on(&mut painter, Target::Layer(id), red(0.5), &LINE);
        id
    });
    painter.commit().unwrap();
    let before = contents(&painter);
    let bytes = std::fs::read(&baked.path).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(&baked.path).unwrap();
    let put = |bytes: &[u8]| std::os::unix::fs::FileExt::write_all_at(&file, bytes, 0).unwrap();
    put(&vec![0; bytes.len()]);
    assert!(painter.merge_layer_down(upper).is_err());
    put(&bytes);
    assert_eq!(painter.layers().len(), 2);
    painter.finish_work().unwrap();
    assert!(painter.layers().len() == 2 && painter.history().done().len() == 4);
    assert!(contents(&painter) == before);
    painter.merge_layer_down(upper).unwrap();
    assert_eq!(painter.layers().len(), 1);
    assert!(painter.undo().unwrap());
    assert!(contents(&painter) == before && painter.layers().len() == 2);
}

#[test]
fn too_many_layers_are_refused() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    painter.add_layer(Layer::painted("a")).unwrap();
    let text = serde_json::to_string(&painter.layers()[0]).unwrap();
    let numbered = |id: usize| text.replace("\"id\":0", &format!("\"id\":{id}"));
    let layers: Vec<Layer> = (0..4097).map(|id| serde_json::from_str(&numbered(id)).unwrap()).collect();
    let error = painter.set_layers("set", layers, &[]).unwrap_err().to_string();
    assert!(error.contains("there are 4097 layers, but an asset has 4096 at most"), "{error}");
    assert_eq!(painter.layers().len(), 1);
}

/// A layer that shows a picture beside the asset.
fn picture_layer(baked: &Baked) -> (Layer, PathBuf) {
    let picture = baked.folder.path().join("picture.png");
    Image::from_linear_rgba(4, 4, &[[0.5; 4]; 16]).save(&picture).unwrap();
    let look = "[textures.picture]\nkind = \"image\"\nimage = \"picture.png\"\n".to_owned();
    let graph = TextureGraph { look, folder: baked.folder.path().to_owned() };
    let fill = GraphFill { graph, textures: vec![Some("picture".to_owned())] };
    (Layer::graph("picture", fill), picture)
}

/// A texture that was being evaluated and cannot be read any more keeps nobody from opening the asset.
#[test]
fn layers_whose_pictures_are_gone_are_as_they_were() {
    let baked = fine_ball(1_000_000);
    let (mut painter, before) = start(&baked);
    let (layer, picture) = picture_layer(&baked);
    painter.start_add_layer(layer, LayerPlace::Top).unwrap();
    slices(&mut painter, 2);
    painter.commit().unwrap();
    drop(painter);
    std::fs::remove_file(&picture).unwrap();
    let mut painter = open(&baked);
    assert!(painter.has_work());
    painter.finish_work().unwrap();
    assert!(contents(&painter) == before && painter.layers().is_empty());
}

/// Without a history nothing says how they were: they are shown again once they are hidden or corrected.
#[test]
fn layers_without_a_history_whose_pictures_are_gone_can_be_hidden() {
    let baked = ball(200_000, BakeFormat::Rgba8);
    let options = PaintOptions { history: false, ..PaintOptions::default() };
    let mut painter = Painter::open(&baked.path, &options).unwrap();
    let before = contents(&painter);
    let (layer, picture) = picture_layer(&baked);
    painter.start_add_layer(layer, LayerPlace::Top).unwrap();
    slices(&mut painter, 2);
    painter.commit().unwrap();
    drop(painter);
    std::fs::remove_file(&picture).unwrap();
    let mut painter = Painter::open(&baked.path, &options).unwrap();
    assert!(contents(&painter) != before);
    let error = painter.begin("stroke", red(0.5)).unwrap_err().to_string();
    assert!(error.contains("the layer \"picture\" cannot be shown"), "{error}");
    painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
    assert!(finest(&contents(&painter)) == finest(&before));
}

/// So does one under which a fill was interrupted: the fill is taken back.
#[test]
fn fills_under_layers_whose_pictures_are_gone_are_taken_back() {
    let baked = ball(200_000, BakeFormat::Rgba8);
    let (mut painter, _) = start(&baked);
    let (mut layer, picture) = picture_layer(&baked);
    layer.opacity = 0.5;
    painter.add_layer(layer).unwrap();
    painter.commit().unwrap();
    let before = contents(&painter);
    let fill = r#"{ "fill": "whole", "channels": [{ "kind": "base_color", "color": { "linear": [0.9, 0.05, 0.05, 1] } }] }"#;
    painter.begin("fill", red(0.5)).unwrap();
    painter.record(strokes(fill).strokes.remove(0), baked.folder.path()).unwrap();
    painter.start_fill(FillArea::Everything).unwrap();
    slices(&mut painter, 2);
    painter.commit().unwrap();
    assert!(contents(&painter) != before);
    drop(painter);
    std::fs::remove_file(&picture).unwrap();
    let mut painter = open(&baked);
    assert!(painter.work_progress().is_some_and(|work| work.is_undo && work.label == "fill"));
    painter.finish_work().unwrap();
    assert!(contents(&painter) == before);
    assert_eq!((painter.history().done().len(), painter.layers().len()), (2, 1));
    painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
    paint_on(&mut painter, Target::Base, red(0.5), &LINE);
}
