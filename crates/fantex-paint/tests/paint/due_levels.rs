//! Coarser levels that come after the end of a stroke.

use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_paint::{Layer, Painter, Target, dabs_of};
use fantex_store::{PageId, VerifyOptions, verify};
use glam::Vec3;

use crate::{ball, contents, crash, open, red, stroke};

/// Over the ball, each way elsewhere, crossing others.
fn way(turn: usize) -> Vec<Vec3> {
    let at = |i: usize| {
        let angle = 0.25 * i as f32 + 1.3 * turn as f32;
        Vec3::new(angle.cos(), 0.15 * turn as f32 - 0.7, angle.sin())
    };
    (0..7).map(at).collect()
}

/// A stroke that is still open.
fn draw(painter: &mut Painter, target: Target, texels: f32, positions: &[Vec3]) {
    let surface = Arc::clone(painter.surface());
    painter.begin_on(target, "stroke", red(0.6)).unwrap();
    for dab in dabs_of(&surface, &stroke(&surface, texels, positions)) {
        painter.dab(std::slice::from_ref(&dab)).unwrap();
        painter.show().unwrap();
    }
}

/// The bytes of coarser pages.
fn coarser(painter: &Painter) -> Vec<(PageId, Vec<u8>)> {
    contents(painter).0.into_iter().filter(|(id, _)| id.level > 0).collect()
}

/// A ball with something on it, perhaps with a layer that is painted on.
fn with_layer(painter: &mut Painter, has_layer: bool) -> Target {
    if !has_layer {
        return Target::Base;
    }
    let layer = painter.add_layer(Layer::painted("layer")).unwrap();
    draw(painter, Target::Layer(layer), 60.0, &way(3));
    painter.end().unwrap();
    Target::Layer(layer)
}

/// Strokes that cross each other, on the base and on a layer in turn: whether their levels are made at once, in slices between the
/// strokes, or as late as can be, their bytes are the same, and so is what undo leaves.
#[test]
fn levels_are_the_same_whenever_they_are_made() {
    for has_layer in [false, true] {
        let all = [0, 1, 2].map(|_| ball(150_000, BakeFormat::Bc7));
        let [mut at_once, mut sliced, mut late] = [&all[0], &all[1], &all[2]].map(crate::Baked::painter);
        let targets = [&mut at_once, &mut sliced, &mut late].map(|painter| with_layer(painter, has_layer));
        let mut states = vec![contents(&at_once)];
        // More than may owe levels at a time.
        for turn in 0..11 {
            let target = if turn % 3 == 1 { targets[0] } else { Target::Base };
            for painter in [&mut at_once, &mut sliced, &mut late] {
                draw(painter, target, 40.0, &way(turn));
            }
            at_once.end().unwrap();
            sliced.end_in_background().unwrap();
            sliced.poll_levels().unwrap();
            late.end_in_background().unwrap();
            assert_eq!(late.history().done().len(), at_once.history().done().len(), "it is listed at once");
            states.push(contents(&at_once));
        }
        for (painter, baked) in [(&mut sliced, &all[1]), (&mut late, &all[2])] {
            painter.commit().unwrap();
            assert!(contents(painter) == states[11], "layers: {has_layer}");
            assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
            for state in states[..11].iter().rev() {
                assert!(painter.undo().unwrap());
                assert!(contents(painter) == *state, "layers: {has_layer}");
            }
            for state in &states[1..] {
                assert!(painter.redo().unwrap());
                assert!(contents(painter) == *state, "layers: {has_layer}");
            }
        }
    }
}

/// The end of a stroke does not wait, however large it is, and whether or not layers lie over it.
#[test]
fn the_end_of_a_stroke_leaves_its_levels() {
    for has_layer in [false, true] {
        let baked = ball(200_000, BakeFormat::Bc7);
        let mut painter = baked.painter();
        with_layer(&mut painter, has_layer);
        let before = coarser(&painter);
        draw(&mut painter, Target::Base, 250.0, &way(3));
        let summary = painter.end_in_background().unwrap();
        assert!(summary.pages > 20 && summary.coarser_pages == 0, "{summary:?}");
        assert!(coarser(&painter) == before, "nothing is made yet");
        assert_eq!(painter.poll_levels().unwrap(), None, "it takes several slices");
        let changed = loop {
            if let Some(changed) = painter.poll_levels().unwrap() {
                break changed;
            }
        };
        assert!(changed.iter().all(|id| id.level > 0) && changed.is_sorted());
        let after = coarser(&painter);
        assert!(after != before);
        type Page = (PageId, Vec<u8>);
        let is_told = |(now, then): (&Page, &Page)| now.1 == then.1 || changed.binary_search(&now.0).is_ok();
        assert!(after.iter().zip(&before).all(is_told));
        assert_eq!(painter.poll_levels().unwrap(), Some(Vec::new()), "each is told once");
    }
}

/// A stroke waits for the levels of the tiles that it paints on, and for no others.
#[test]
fn the_next_stroke_waits_for_its_own_tiles() {
    let [baked, other] = [0, 1].map(|_| ball(400_000, BakeFormat::Bc7));
    let [mut painter, mut at_once] = [baked.painter(), other.painter()];
    let (here, there) = ([Vec3::X, Vec3::new(0.9, 0.3, 0.0)], [Vec3::NEG_X, Vec3::new(-0.9, 0.3, 0.0)]);
    let before = coarser(&painter);
    draw(&mut painter, Target::Base, 30.0, &here);
    painter.end_in_background().unwrap();
    draw(&mut painter, Target::Base, 30.0, &there);
    assert!(coarser(&painter) == before, "elsewhere");
    painter.end_in_background().unwrap();
    assert!(coarser(&painter) == before);
    draw(&mut painter, Target::Base, 30.0, &here);
    assert!(coarser(&painter) != before, "in the same place");
    // What is taken away leaves what the others owe.
    painter.abandon().unwrap();
    painter.finish_levels().unwrap();
    for positions in [here, there] {
        draw(&mut at_once, Target::Base, 30.0, &positions);
        at_once.end().unwrap();
    }
    assert!(contents(&painter) == contents(&at_once));
    assert_eq!(painter.history().done().len(), 2);
}

/// What is not committed is gone after a crash, levels that are due included; what is committed has them all.
#[test]
fn a_crash_leaves_what_was_committed() {
    let baked = ball(200_000, BakeFormat::Bc7);
    let mut painter = open(&baked);
    let before = contents(&painter);
    for turn in 0..4 {
        draw(&mut painter, Target::Base, 60.0, &way(turn));
        painter.end_in_background().unwrap();
    }
    let mut painter = crash(painter, &baked);
    assert!(contents(&painter) == before);
    assert!(painter.history().done().is_empty());
    for turn in 0..4 {
        draw(&mut painter, Target::Base, 60.0, &way(turn));
        painter.end_in_background().unwrap();
        if turn == 1 {
            // In the middle of the next stroke, as a window does.
            draw(&mut painter, Target::Base, 60.0, &way(8));
            painter.commit().unwrap();
            painter.abandon().unwrap();
            painter.commit().unwrap();
        }
    }
    let mut painter = crash(painter, &baked);
    assert_eq!(painter.history().done().len(), 2);
    while painter.undo().unwrap() {}
    assert!(contents(&painter) == before);
}

/// Without a history there are no steps, and the levels come all the same.
#[test]
fn levels_come_without_a_history() {
    let [with, without] = [true, false].map(|history| {
        let baked = ball(100_000, BakeFormat::Bc7);
        let options = fantex_paint::PaintOptions { history, ..fantex_paint::PaintOptions::default() };
        let mut painter = Painter::open(&baked.path, &options).unwrap();
        for turn in 0..3 {
            draw(&mut painter, Target::Base, 40.0, &way(turn));
            painter.end_in_background().unwrap();
        }
        painter.commit().unwrap();
        contents(&painter)
    });
    assert!(with == without);
}
