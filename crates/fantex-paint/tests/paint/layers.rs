//! Layers: what everybody sees is what they make together.

use std::sync::Arc;

use crate::common::{Baked, cleaned, contents, cover, red, sample, stroke};
use fantex_bake::BakeFormat;
use fantex_mesh::generate;
use fantex_paint::{
    BlendMode, ChannelPaint, Layer, Paint, PaintColor, PaintError, Painter, Target, Tool, dabs_of,
};
use fantex_store::{VerifyOptions, verify};
use glam::{Vec3, Vec4};

fn ball(format: BakeFormat) -> Baked {
    let mesh = cleaned(generate::icosphere(4));
    Baked::new(&mesh, &cover(&mesh, 64, 60_000), format)
}

fn paint_on(painter: &mut Painter, target: Target, paint: Paint, positions: &[Vec3]) {
    let surface = Arc::clone(painter.surface());
    painter.begin_on(target, "test", paint).unwrap();
    painter.dab(&dabs_of(&surface, &stroke(&surface, 50.0, positions))).unwrap();
    painter.end().unwrap();
}

const LINE: [Vec3; 3] = [Vec3::X, Vec3::new(0.6, 0.6, 0.5), Vec3::Z];

fn white() -> Paint {
    let color = PaintColor::Constant(Vec4::ONE);
    Paint {
        tool: Tool::Paint(BlendMode::Normal),
        opacity: 1.0,
        channels: vec![ChannelPaint { channel: 0, color }],
        stencil: None,
    }
}

#[test]
fn hidden_layers_give_back_the_base_and_shown_ones_come_back() {
    for format in [BakeFormat::Bc7, BakeFormat::Rgba8] {
        let baked = ball(format);
        let mut painter = baked.painter();
        let base = contents(&painter).0;
        let layer = painter.add_layer(Layer::painted("paint")).unwrap();
        assert!(contents(&painter).0 == base, "an empty layer shows nothing");
        paint_on(&mut painter, Target::Layer(layer), red(1.0), &LINE);
        let painted = contents(&painter).0;
        assert!(painted != base);
        painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
        let finest = |pages: &[(fantex_store::PageId, Vec<u8>)]| -> Vec<Vec<u8>> {
            pages.iter().filter(|(id, _)| id.level == 0).map(|(_, bytes)| bytes.clone()).collect()
        };
        assert!(finest(&contents(&painter).0) == finest(&base), "{format:?}");
        painter.commit().unwrap();
        drop(painter);
        let mut painter = baked.painter();
        assert_eq!(painter.layers().len(), 1);
        painter.edit_layers("show", |layers| layers[0].visible = true).unwrap();
        assert!(finest(&contents(&painter).0) == finest(&painted), "{format:?}");
        painter.commit().unwrap();
        assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    }
}

#[test]
fn every_step_can_be_undone() {
    let baked = ball(BakeFormat::Bc7);
    let mut painter = baked.painter();
    let mut states = vec![(contents(&painter), painter.layers().to_vec())];
    let mut note = |painter: &Painter| states.push((contents(painter), painter.layers().to_vec()));
    let first = painter.add_layer(Layer::painted("first")).unwrap();
    note(&painter);
    paint_on(&mut painter, Target::Layer(first), red(1.0), &LINE);
    note(&painter);
    let fill = painter.add_layer(Layer::fill("fill", &[Vec4::new(0.0, 0.4, 0.1, 1.0)])).unwrap();
    note(&painter);
    paint_on(&mut painter, Target::Mask(fill), white(), &[Vec3::Y, Vec3::X]);
    note(&painter);
    paint_on(&mut painter, Target::Base, red(0.5), &[Vec3::Y, Vec3::Z]);
    note(&painter);
    painter
        .edit_layers("blend", |layers| {
            layers.swap(0, 1);
            layers[0].blend = BlendMode::Multiply;
            layers[1].opacity = 0.4;
        })
        .unwrap();
    note(&painter);
    painter.edit_layers("remove", |layers| layers.retain(|layer| layer.id() != first)).unwrap();
    note(&painter);
    assert!(states.windows(2).all(|pair| pair[0] != pair[1]));
    painter.commit().unwrap();
    for state in states[..states.len() - 1].iter().rev() {
        assert!(painter.undo().unwrap());
        assert!(painter.layers() == state.1);
        assert!(contents(&painter) == state.0, "undo to {:?}", state.1);
    }
    assert!(!painter.undo().unwrap());
    for state in &states[1..] {
        assert!(painter.redo().unwrap());
        assert!((contents(&painter), painter.layers().to_vec()) == *state);
    }
}

#[test]
fn the_flattened_value_is_the_formula() {
    let baked = ball(BakeFormat::Float);
    let mut painter = baked.painter();
    let place = painter.surface().nearest(Vec3::X, f32::INFINITY).unwrap();
    let value = |baked: &Baked| sample(&baked.cache(), 0, 0, place.triangle as usize, place.lambda).0;
    let base = value(&baked);
    let id = painter.add_layer(Layer::painted("multiply")).unwrap();
    paint_on(&mut painter, Target::Layer(id), red(1.0), &[Vec3::X]);
    painter
        .edit_layers("multiply", |layers| {
            layers[0].blend = BlendMode::Multiply;
            layers[0].opacity = 0.5;
        })
        .unwrap();
    painter.commit().unwrap();
    let expected = BlendMode::Multiply.compose(base, Vec4::new(0.9, 0.05, 0.05, 1.0), 0.5);
    let found = value(&baked);
    assert!((found - expected).abs().max_element() < 2e-3, "{found} {expected}");
    // A channel that the layer leaves out stays as it was.
    painter.edit_layers("channels", |layers| layers[0].channels = vec![false, true]).unwrap();
    painter.commit().unwrap();
    assert!((value(&baked) - base).abs().max_element() < 1e-6);
    assert!(matches!(painter.begin_on(Target::Layer(77), "x", red(1.0)), Err(PaintError::NoLayer(77))));
}
