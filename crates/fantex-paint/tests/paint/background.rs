//! Coarser levels beside the painting, and painting on a full disk.

use std::sync::Arc;

use crate::common::{Baked, cleaned, contents, cover, red, stroke};
use fantex_bake::BakeFormat;
use fantex_mesh::generate;
use fantex_paint::{PaintError, PaintOptions, Painter, dabs_of};
use fantex_store::{EditError, VerifyOptions, verify};
use glam::Vec3;

fn ball(texels: u64) -> Baked {
    let mesh = cleaned(generate::icosphere(4));
    Baked::new(&mesh, &cover(&mesh, 64, texels), BakeFormat::Bc7)
}

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
    let [at_once, beside] = [0, 1].map(|_| ball(200_000));
    let [mut a, mut b] = [at_once.painter(), beside.painter()];
    let mut states = vec![contents(&a)];
    for turn in 0..4 {
        draw(&mut a, turn);
        a.end().unwrap();
        draw(&mut b, turn);
        let summary = b.end_in_background().unwrap();
        assert!(summary.pages > 3, "{summary:?}");
        if turn == 1 {
            // Ask until they are there, as a window does.
            let changed = loop {
                if let Some(changed) = b.poll_levels().unwrap() {
                    break changed;
                }
                std::thread::yield_now();
            };
            assert!(changed.iter().all(|id| id.level > 0) && !changed.is_empty());
            assert!(contents(&a) == contents(&b));
        }
        states.push(contents(&a));
    }
    // A commit waits.
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
    let [free, full] = [0, 1].map(|_| ball(200_000));
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
    let refused = b.commit();
    assert!(matches!(refused, Err(PaintError::Edit(EditError::Full { .. }))), "{refused:?}");
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
    let [free, full] = [0, 1].map(|_| ball(200_000));
    let options = PaintOptions { memory_bytes: 400 << 10, history: true };
    let [mut a, mut b] = [&free, &full].map(|baked| Painter::open(&baked.path, &options).unwrap());
    b.limit_file(Some(std::fs::metadata(&full.path).unwrap().len()));
    let tools = [
        Tool::Clone { offset: Vec3::new(0.3, 0.2, 0.0), reach: 0.2 },
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
    assert!(matches!(b.commit(), Err(PaintError::Edit(EditError::Full { .. }))));
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
