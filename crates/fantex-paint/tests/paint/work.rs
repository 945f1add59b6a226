//! Work in slices: layers on all pages and long steps, interrupted, given up, and taken up again after a crash.

use crate::common::slices::{crash, slices, start};
use crate::common::{Baked, cleaned, contents, cover, paint_stroke, red, stroke};
use fantex_bake::BakeFormat;
use fantex_mesh::generate;
use fantex_paint::{GraphFill, Layer, TextureGraph};
use fantex_store::{VerifyOptions, verify};
use glam::Vec3;

fn ball() -> Baked {
    let mesh = cleaned(generate::icosphere(5));
    Baked::new(&mesh, &cover(&mesh, 64, 2_000_000), BakeFormat::Bc7)
}

fn wood() -> Layer {
    let look = "[textures.plank]\nkind = \"wood\"\nseed = 3\n".to_owned();
    let graph = TextureGraph { look, folder: std::env::temp_dir() };
    Layer::graph("wood", GraphFill { graph, textures: vec![Some("plank".to_owned())] })
}

#[test]
fn a_fill_that_is_interrupted_goes_on_and_is_one_step() {
    let [whole, cut] = [0, 1].map(|_| ball());
    let (mut at_once, before) = start(&whole);
    at_once.add_layer(wood()).unwrap();
    let after = contents(&at_once);
    assert!(after != before);

    let (mut painter, _) = start(&cut);
    painter.start_add_layer(wood(), None).unwrap();
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
    let baked = ball();
    let (mut painter, before) = start(&baked);
    painter.start_add_layer(wood(), None).unwrap();
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
