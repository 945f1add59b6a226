//! Work in slices: layers on all pages and long steps, interrupted, given up, and taken up again after a crash.

use std::path::Path;
use std::sync::Arc;
#[cfg(unix)]
use std::time::Instant;

use fantex_bake::BakeFormat;
use fantex_paint::{
    ChannelPaint, ColorFill, FillArea, GraphFill, Layer, LayerPlace, Paint, PaintColor, PaintOptions,
    Painter, Picture, PicturePlace, Projection, ProjectionView, StrokeFile, StrokeSettings, Symmetry, Target,
    TextureGraph, dabs_of,
};
use fantex_store::{VerifyOptions, is_disk_full, verify};
use fantex_texture::Image;
use glam::{Vec3, Vec4};

use crate::{
    Baked, Contents, ball, contents, cover, crash, fine_ball, open, paint_stroke, plate, red, slices, start,
    stroke,
};

fn wood() -> Layer {
    let look = "[textures.plank]\nkind = \"wood\"\nseed = 3\n".to_owned();
    let graph = TextureGraph { look, folder: std::env::temp_dir() };
    Layer::graph("wood", GraphFill { graph, textures: vec![Some("plank".to_owned())] })
}

#[test]
fn a_fill_that_is_interrupted_goes_on_and_is_one_step() {
    let [whole, cut] = [0, 1].map(|_| fine_ball(1_000_000));
    let (mut at_once, before) = start(&whole);
    at_once.add_layer(wood()).unwrap();
    let after = contents(&at_once);
    assert!(after != before);

    let (mut painter, _) = start(&cut);
    painter.start_add_layer(wood(), LayerPlace::Top).unwrap();
    // What is seen comes first.
    painter.prefer_groups(|group| -(group as f32));
    for _ in 0..2 {
        slices(&mut painter, 2);
        let share = painter.work_progress().unwrap().share;
        assert!(share > 0.0 && share < 1.0, "{share}");
        painter.commit().unwrap();
        // More, which is lost.
        slices(&mut painter, 1);
        painter = crash(painter, &cut);
        assert!(painter.has_work() && painter.layers().len() == 1);
        assert_eq!(painter.history().done().len(), 1, "the step is not there before it is whole");
    }
    painter.finish_work().unwrap();
    assert!(contents(&painter) == after);
    painter.commit().unwrap();
    painter = crash(painter, &cut);
    assert!(!painter.has_work());
    assert_eq!(painter.history().done().len(), 2);

    // Undo, interrupted as well.
    assert!(painter.start_undo().unwrap());
    slices(&mut painter, 2);
    painter.commit().unwrap();
    slices(&mut painter, 1);
    painter = crash(painter, &cut);
    let progress = painter.work_progress().unwrap();
    assert!(progress.is_undo && progress.label == "add layer", "{progress:?}");
    painter.finish_work().unwrap();
    assert!(contents(&painter) == before && painter.layers().is_empty());
    assert!(painter.redo().unwrap());
    assert!(contents(&painter) == after && painter.layers().len() == 1);
    painter.commit().unwrap();
    assert!(verify(&cut.path, &VerifyOptions::default()).unwrap().ok);
}

#[test]
fn what_is_given_up_leaves_nothing_behind() {
    let baked = fine_ball(1_000_000);
    let (mut painter, before) = start(&baked);
    painter.start_add_layer(wood(), LayerPlace::Top).unwrap();
    slices(&mut painter, 5);
    painter.commit().unwrap();
    let mut painter = crash(painter, &baked);
    painter.cancel_work().unwrap();
    painter.finish_work().unwrap();
    assert!(contents(&painter) == before && painter.layers().is_empty());
    assert_eq!((painter.history().done().len(), painter.history().undone().len()), (1, 0));
    // An undo that is given up is no undo.
    painter.add_layer(wood()).unwrap();
    let after = contents(&painter);
    assert!(painter.start_undo().unwrap());
    slices(&mut painter, 1);
    painter.cancel_work().unwrap();
    painter.finish_work().unwrap();
    assert!(contents(&painter) == after);
    assert_eq!((painter.history().done().len(), painter.layers().len()), (2, 1));
    // A stroke finishes what is under way.
    painter.start_edit_layers("half", |layers| layers[0].opacity = 0.5).unwrap();
    let line = stroke(painter.surface(), 20.0, &[Vec3::Y]);
    paint_stroke(&mut painter, red(0.9), &line);
    assert!(!painter.has_work());
    assert_eq!(painter.history().done().len(), 4);
    painter.commit().unwrap();
    assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
}

// Fills in slices: interrupted, given up, taken up again after a crash; and what a history of them takes.

/// A stroke of a file, as it is recorded.
fn settings(text: &str) -> StrokeSettings {
    let file: StrokeFile =
        serde_json::from_str(&format!(r#"{{ "version": 1, "strokes": [{text}] }}"#)).unwrap();
    file.strokes.into_iter().next().unwrap()
}

/// A few tiles of dozens of pages.
fn sheet() -> Baked {
    let mesh = plate(4, 0.1);
    Baked::new(&mesh, &cover(&mesh, 2048, 6_000_000), BakeFormat::Rgba8)
}

/// Begins to fill everything half.
fn start_half(painter: &mut Painter) {
    let text = r#"{ "label": "fill", "fill": "whole", "brush": { "opacity": 0.5 }, "channels": [
        { "kind": "base_color", "color": { "linear": [0.9, 0.05, 0.05, 1] } },
        { "kind": "occlusion_roughness_metallic", "color": { "linear": [1, 0.1, 1, 1] } }] }"#;
    painter.begin("fill", red(0.5)).unwrap();
    painter.record(settings(text), Path::new("")).unwrap();
    painter.start_fill(FillArea::Everything).unwrap();
}

/// Begins to project a picture from the front, whose right half shows nothing.
fn start_projection(painter: &mut Painter, folder: &Path) {
    let path = folder.join("slide.exr");
    let texel = |i: usize| [1.0, 0.5, 0.0, if i % 64 < 32 { 1.0 } else { 0.0 }];
    Image::from_linear_rgba(64, 64, &(0..64 * 64).map(texel).collect::<Vec<_>>()).save(&path).unwrap();
    let text = r#"{ "label": "project", "fill": "whole",
        "projection": { "eye": [0, 0, 5], "target": [0, 0, 0], "lens": { "parallel": 3.0 } },
        "stencil": { "image": "slide.exr", "by": "alpha" },
        "channels": [{ "kind": "base_color", "color": { "image": "slide.exr" } }] }"#;
    let surface = Arc::clone(painter.surface());
    let view = ProjectionView {
        eye: [0.0, 0.0, 5.0],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        lens: fantex_paint::Lens::Parallel(3.0),
        place: PicturePlace::default(),
    };
    let picture = Arc::new(Picture::new(&Image::load(&path).unwrap()).unwrap());
    let thrown = Arc::new(Projection::new(&surface, &view, picture).unwrap());
    let paint = Paint {
        channels: vec![ChannelPaint::new(0, PaintColor::Projected(Arc::clone(&thrown)))],
        stencil: Some(Arc::clone(&thrown)),
        ..red(1.0)
    };
    painter.begin("project", paint).unwrap();
    painter.record(settings(text), folder).unwrap();
    painter.start_fill(FillArea::Triangles(thrown.triangles(&surface))).unwrap();
}

/// Begun, interrupted twice by crashes and ended, it is the same as without them, and one step.
fn goes_on(bakes: [Baked; 2], slices_at_a_time: usize, begin: impl Fn(&mut Painter, &Path)) {
    let [whole, cut] = bakes;
    let (mut at_once, before) = start(&whole);
    begin(&mut at_once, whole.folder.path());
    at_once.finish_work().unwrap();
    let after = contents(&at_once);
    assert!(after != before);

    let (mut painter, _) = start(&cut);
    begin(&mut painter, cut.folder.path());
    painter.prefer_groups(|group| -(group as f32));
    for _ in 0..2 {
        slices(&mut painter, slices_at_a_time);
        let share = painter.work_progress().unwrap().share;
        assert!(share > 0.0 && share < 1.0, "{share}");
        painter.commit().unwrap();
        // More, which is lost.
        slices(&mut painter, 1);
        painter = crash(painter, &cut);
        assert!(painter.has_work());
        assert!((painter.work_progress().unwrap().share - share).abs() < 1e-6, "it goes on from there");
        assert_eq!(painter.history().done().len(), 1, "the step is not there before it is whole");
    }
    painter.finish_work().unwrap();
    assert!(contents(&painter) == after);
    painter.commit().unwrap();
    painter = crash(painter, &cut);
    assert!(!painter.has_work());
    assert_eq!(painter.history().done().len(), 2);
    assert!(painter.undo().unwrap());
    assert!(contents(&painter) == before);
    assert!(painter.redo().unwrap());
    assert!(contents(&painter) == after);
}

#[test]
fn a_fill_of_everything_goes_on_after_a_crash() {
    goes_on([fine_ball(750_000), fine_ball(750_000)], 3, |painter, _| start_half(painter));
}

/// Half is laid over each page once, though the crash is in the middle of a tile.
#[test]
fn a_fill_of_large_tiles_goes_on_page_by_page() {
    goes_on([sheet(), sheet()], 1, |painter, _| start_half(painter));
}

#[test]
fn a_projection_goes_on_after_a_crash() {
    goes_on([fine_ball(750_000), fine_ball(750_000)], 3, start_projection);
}

#[test]
fn what_is_given_up_leaves_the_asset_as_it_was() {
    for baked in [fine_ball(750_000), sheet()] {
        let (mut painter, before) = start(&baked);
        let names = painter.editor().attachment_names();
        start_half(&mut painter);
        slices(&mut painter, 2);
        assert!(contents(&painter) != before);
        // Whether or not somebody else takes it up in between.
        painter.commit().unwrap();
        let mut painter = crash(painter, &baked);
        painter.cancel_work().unwrap();
        painter.finish_work().unwrap();
        assert!(contents(&painter) == before);
        assert_eq!((painter.history().done().len(), painter.history().undone().len()), (1, 0));
        painter.commit().unwrap();
        assert_eq!(painter.editor().attachment_names(), names, "neither log nor history knows of it");
        start_projection(&mut painter, baked.folder.path());
        painter.cancel_work().unwrap();
        painter.finish_work().unwrap();
        assert!(contents(&painter) == before);
        // The step before is still the one that is taken back.
        assert!(painter.undo().unwrap() && painter.history().done().is_empty());
    }
}

/// What a fill by colour compares is what was seen before it, which a crash takes away.
#[test]
fn a_fill_by_colour_is_taken_back_after_a_crash() {
    let baked = fine_ball(750_000);
    let (mut painter, before) = start(&baked);
    let point = painter.surface().nearest(Vec3::NEG_Y, f32::INFINITY).unwrap();
    let fill = ColorFill { tolerance: 2.0, softness: 0.1, connected: false };
    painter.begin("fill", red(0.5)).unwrap();
    painter.start_fill(FillArea::Color { channel: 0, starts: vec![point], fill }).unwrap();
    slices(&mut painter, 2);
    painter.commit().unwrap();
    slices(&mut painter, 1);
    let mut painter = crash(painter, &baked);
    assert!(painter.work_progress().is_some_and(|work| work.is_undo));
    painter.finish_work().unwrap();
    assert!(contents(&painter) == before);
    assert_eq!(painter.history().done().len(), 1);
}

/// What dabs have covered counts, too, once.
#[test]
fn a_fill_takes_the_dabs_before_it_along() {
    let baked = fine_ball(750_000);
    let mut painter = open(&baked);
    let surface = Arc::clone(painter.surface());
    let dabs = fantex_paint::dabs_of(&surface, &stroke(&surface, 60.0, &[Vec3::X, Vec3::Y]));
    let near_z = surface.nearest(Vec3::Z, f32::INFINITY).unwrap().triangle;
    painter.begin("both", red(1.0)).unwrap();
    painter.dab(&dabs).unwrap();
    painter.show().unwrap();
    let summary = painter.fill(FillArea::Triangles(vec![near_z])).unwrap();
    assert!(summary.dabs == dabs.len() && summary.pages > 3 && summary.coarser_pages > 0, "{summary:?}");
    assert_eq!(painter.history().done().len(), 1);
    for at in [Vec3::X, Vec3::Y] {
        let point = surface.nearest(at, f32::INFINITY).unwrap();
        let color = painter.pick(0, point).unwrap();
        assert!(color.distance(Vec4::new(0.9, 0.05, 0.05, 1.0)) < 0.1, "{color}");
    }
    assert!(painter.undo().unwrap() && !painter.undo().unwrap());
}

/// The base that lies under the layers is in the asset once, not in the history as well.
#[test]
fn the_history_of_a_layer_over_everything_keeps_no_bases() {
    let baked = fine_ball(750_000);
    let (mut painter, before) = start(&baked);
    let bytes = |painter: &Painter, prefix: &str| -> usize {
        let names = painter.editor().attachment_names();
        let kept = names.iter().filter(|name| name.starts_with(prefix));
        kept.map(|name| painter.editor().attachment(name).unwrap().unwrap().len()).sum()
    };
    let earlier = bytes(&painter, "history/");
    let mut layer = Layer::fill("hidden", &[Vec4::ONE; 2]);
    (layer.mask, layer.visible) = (None, false);
    let id = painter.add_layer(layer).unwrap();
    let bases = bytes(&painter, "layers/base/");
    let finest: usize = before.0.iter().filter(|(id, _)| id.level == 0).map(|(_, bytes)| bytes.len()).sum();
    assert_eq!(bases, finest);
    let history = bytes(&painter, "history/") - earlier;
    assert!(history < bases / 100, "{history} bytes for {bases}");
    assert!(painter.undo().unwrap());
    assert!(bytes(&painter, "layers/base/") == 0 && contents(&painter) == before);
    assert!(painter.redo().unwrap());
    assert_eq!(bytes(&painter, "layers/base/"), bases);
    // And they are right: over them the layer shows, without it they do.
    painter.edit_layers("show", |layers| layers[0].visible = true).unwrap();
    assert!(contents(&painter) != before);
    painter.commit().unwrap();
    let mut painter = crash(painter, &baked);
    painter.edit_layers("delete", |layers| layers.retain(|layer| layer.id() != id)).unwrap();
    // (Coarser levels are not those of the bake any more, but made from these.)
    let finest = |contents: &Contents| -> Vec<_> {
        contents.0.iter().filter(|(id, _)| id.level == 0).cloned().collect()
    };
    assert!(finest(&contents(&painter)) == finest(&before));
    // A stroke on a layer puts bases aside as well.
    let top = painter.add_layer(Layer::painted("top")).unwrap();
    for _ in 0..3 {
        assert!(painter.undo().unwrap());
    }
    assert!(painter.undo().unwrap() && bytes(&painter, "layers/base/") == 0);
    let id = painter.add_layer(Layer::painted("own")).unwrap();
    assert!(id <= top);
    let line = stroke(painter.surface(), 40.0, &[Vec3::NEG_Y, Vec3::NEG_X]);
    painter.begin_on(Target::Layer(id), "on it", red(0.9)).unwrap();
    painter.dab(&fantex_paint::dabs_of(&Arc::clone(painter.surface()), &line)).unwrap();
    painter.end().unwrap();
    let (painted, kept) = (contents(&painter), bytes(&painter, "layers/base/"));
    assert!(kept > 0);
    assert!(painter.undo().unwrap() && bytes(&painter, "layers/base/") == 0 && contents(&painter) == before);
    assert!(painter.redo().unwrap() && contents(&painter) == painted);
    assert_eq!(bytes(&painter, "layers/base/"), kept);
}

/// Pages that cannot be read for a while are filled later, once, together with what dabs have gathered on them.
#[cfg(unix)]
#[test]
fn a_fill_that_fails_keeps_what_dabs_have_gathered() {
    let [whole, hurt] = [0, 1].map(|_| ball(100_000, BakeFormat::Rgba8));
    let [mut at_once, mut painter] = [&whole, &hurt].map(Baked::painter);
    for painter in [&mut at_once, &mut painter] {
        let surface = Arc::clone(painter.surface());
        // On a tile that is filled first.
        let groups = &surface.cover().corner_groups;
        let triangle = groups.iter().position(|groups| groups.contains(&0)).unwrap();
        let [a, b, c] = surface.mesh().triangle_positions(triangle);
        painter.begin("fill", red(0.5)).unwrap();
        painter.dab(&dabs_of(&surface, &stroke(&surface, 20.0, &[(a + b + c) / 3.0]))).unwrap();
        painter.show().unwrap();
        painter.start_fill(FillArea::Everything).unwrap();
    }
    at_once.finish_work().unwrap();
    let bytes = std::fs::read(&hurt.path).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(&hurt.path).unwrap();
    let put = |bytes: &[u8]| std::os::unix::fs::FileExt::write_all_at(&file, bytes, 0).unwrap();
    put(&vec![0; bytes.len()]);
    assert!(painter.work_on(Instant::now()).is_err());
    put(&bytes);
    painter.finish_work().unwrap();
    assert!(contents(&painter) == contents(&at_once));
}

/// Where the pages under a tile's coarser levels do not fit into memory together, the levels are the same.
#[test]
fn levels_of_large_tiles_need_little_memory() {
    let mesh = plate(4, 0.1);
    let cover = cover(&mesh, 1024, 450_000);
    assert!(cover.groups.iter().any(|group| group.texels() > 1 << 16));
    let [ample, short] = [64 << 20, 200 << 10].map(|memory_bytes| {
        let baked = Baked::new(&mesh, &cover, BakeFormat::Rgba8);
        let mut painter = Painter::open(&baked.path, &PaintOptions { memory_bytes, history: true }).unwrap();
        let line = stroke(painter.surface(), 40.0, &[Vec3::X, Vec3::Z]);
        paint_stroke(&mut painter, red(0.9), &line);
        start_half(&mut painter);
        painter.finish_work().unwrap();
        contents(&painter)
    });
    assert!(ample == short);
}

// Coarser levels after the end of a stroke, and painting on a full disk.

/// Over the ball, each stroke elsewhere, crossing the others.
fn way(turn: usize) -> Vec<Vec3> {
    let at = |i: usize| {
        let angle = 0.25 * i as f32 + turn as f32;
        Vec3::new(angle.cos(), 0.3 * turn as f32 - 0.4, angle.sin())
    };
    (0..9).map(at).collect()
}

fn draw(painter: &mut Painter, turn: usize) {
    let surface = Arc::clone(painter.surface());
    painter.begin("stroke", red(0.2 + 0.2 * turn as f32)).unwrap();
    for dab in dabs_of(&surface, &stroke(&surface, 40.0, &way(turn))) {
        painter.dab(std::slice::from_ref(&dab)).unwrap();
        painter.show().unwrap();
    }
}

#[test]
fn levels_in_the_background_are_the_same() {
    let [at_once, beside] = [0, 1].map(|_| ball(200_000, BakeFormat::Bc7));
    let [mut a, mut b] = [at_once.painter(), beside.painter()];
    let mut states = vec![contents(&a)];
    for turn in 0..4 {
        draw(&mut a, turn);
        a.end().unwrap();
        draw(&mut b, turn);
        let summary = b.end_in_background().unwrap();
        assert!(summary.pages > 3, "{summary:?}");
        if turn == 1 {
            // Slice by slice, as a window does.
            let changed = loop {
                if let Some(changed) = b.poll_levels().unwrap() {
                    break changed;
                }
            };
            assert!(changed.iter().all(|id| id.level > 0) && !changed.is_empty());
            assert!(contents(&a) == contents(&b));
        }
        states.push(contents(&a));
    }
    // A commit makes what is left.
    b.commit().unwrap();
    assert!(contents(&a) == contents(&b));
    assert!(verify(&beside.path, &VerifyOptions::default()).unwrap().ok);
    for state in states[..4].iter().rev() {
        assert!(b.undo().unwrap());
        assert!(contents(&b) == *state);
    }
    // So does undo.
    draw(&mut b, 2);
    b.end_in_background().unwrap();
    assert!(b.undo().unwrap());
    assert!(contents(&b) == states[0]);
}

#[test]
fn a_full_disk_costs_nothing_but_memory() {
    let [free, full] = [0, 1].map(|_| ball(200_000, BakeFormat::Bc7));
    // So little memory that changes go to the file during a stroke.
    let options = PaintOptions { memory_bytes: 400 << 10, history: true };
    let [mut a, mut b] = [&free, &full].map(|baked| Painter::open(&baked.path, &options).unwrap());
    let before = std::fs::read(&full.path).unwrap();
    b.limit_file(Some(before.len() as u64));
    for turn in 0..3 {
        draw(&mut a, turn);
        a.end().unwrap();
        draw(&mut b, turn);
        b.end().unwrap();
    }
    assert!(!a.is_disk_full() && b.is_disk_full(), "it says so");
    assert!(contents(&a) == contents(&b), "painting goes on");
    let refused = b.commit().unwrap_err();
    assert!(is_disk_full(&refused), "{refused:?}");
    // What is on the disk is the last committed state.
    assert!(verify(&full.path, &VerifyOptions::default()).unwrap().ok);
    assert!(b.undo().unwrap() && b.redo().unwrap() && b.is_disk_full());
    b.limit_file(None);
    b.commit().unwrap();
    a.commit().unwrap();
    assert!(!b.is_disk_full());
    assert!(contents(&a) == contents(&b));
    drop((a, b));
    let [mut a, mut b] = [free.painter(), full.painter()];
    assert!(contents(&a) == contents(&b), "nothing is lost");
    assert_eq!(b.history().done().len(), 3);
    for painter in [&mut a, &mut b] {
        assert!(painter.undo().unwrap());
    }
    assert!(contents(&a) == contents(&b));
    assert!(verify(&full.path, &VerifyOptions::default()).unwrap().ok);
}

#[test]
fn tools_that_read_the_surface_work_on_a_full_disk() {
    use fantex_paint::{ColorFill, FillArea, Tool};
    let [free, full] = [0, 1].map(|_| ball(200_000, BakeFormat::Bc7));
    let options = PaintOptions { memory_bytes: 400 << 10, history: true };
    let [mut a, mut b] = [&free, &full].map(|baked| Painter::open(&baked.path, &options).unwrap());
    b.limit_file(Some(std::fs::metadata(&full.path).unwrap().len()));
    let tools = [
        Tool::Clone { offset: Vec3::new(0.3, 0.2, 0.0), reach: 0.2, symmetry: Symmetry::None },
        Tool::Blur { radius: 0.05 },
        Tool::Smudge { strength: 0.7 },
    ];
    for painter in [&mut a, &mut b] {
        draw(painter, 0);
        painter.end().unwrap();
        for (turn, tool) in tools.iter().enumerate() {
            let surface = Arc::clone(painter.surface());
            let paint = fantex_paint::Paint { tool: tool.clone(), ..red(0.9) };
            painter.begin("reads", paint).unwrap();
            for dab in dabs_of(&surface, &stroke(&surface, 40.0, &way(turn))) {
                painter.dab(std::slice::from_ref(&dab)).unwrap();
                painter.show().unwrap();
            }
            // As a window tries while a stroke goes on.
            drop(painter.commit());
            painter.end().unwrap();
        }
        let start = painter.surface().nearest(Vec3::X, f32::INFINITY).unwrap();
        painter.begin("fill", red(0.5)).unwrap();
        let fill = ColorFill { tolerance: 0.2, ..ColorFill::default() };
        painter.fill(FillArea::Color { channel: 0, starts: vec![start], fill }).unwrap();
    }
    assert!(b.is_disk_full() && !a.is_disk_full());
    assert!(contents(&a) == contents(&b), "what they read is what is seen");
    assert!(is_disk_full(&b.commit().unwrap_err()));
    b.limit_file(None);
    b.commit().unwrap();
    a.commit().unwrap();
    drop((a, b));
    let [mut a, mut b] = [free.painter(), full.painter()];
    assert!(contents(&a) == contents(&b), "nothing is lost");
    for _ in 0..5 {
        assert!(a.undo().unwrap() && b.undo().unwrap());
    }
    assert!(contents(&a) == contents(&b));
    b.commit().unwrap();
    assert!(verify(&full.path, &VerifyOptions::default()).unwrap().ok);
}
