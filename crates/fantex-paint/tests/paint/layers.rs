//! Layers: what everybody sees is what they make together.

use std::path::Path;
use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_base::ErrorKind;
use fantex_mesh::{Mesh, generate};
use fantex_paint::{
    BlendMode, ChannelPaint, Layer, LayerMove, MaskMeasure, MaskSource, Paint, PaintColor, Painter,
    StrokeFile, StrokeLog, Target, Tool, dabs_of, replay,
};
use fantex_store::{Asset, AssetEditor, EditOptions, PageCache, VerifyOptions, verify};
use fantex_texture::Image;
use glam::{Vec3, Vec4};

use crate::{
    Baked, Contents, ball, cleaned, contents, cover, data_folder, loaded, paint_stroke, red, sample, stroke,
};

pub(crate) fn paint_on(painter: &mut Painter, target: Target, paint: Paint, positions: &[Vec3]) {
    let surface = Arc::clone(painter.surface());
    painter.begin_on(target, "test", paint).unwrap();
    painter.dab(&dabs_of(&surface, &stroke(&surface, 50.0, positions))).unwrap();
    painter.end().unwrap();
}

pub(crate) fn everywhere(color: Vec4) -> Layer {
    let mut layer = Layer::fill("fill", &[color, color]);
    layer.mask = None;
    layer
}

pub(crate) const LINE: [Vec3; 3] = [Vec3::X, Vec3::new(0.6, 0.6, 0.5), Vec3::Z];

pub(crate) fn white() -> Paint {
    let color = PaintColor::Constant(Vec4::ONE);
    Paint {
        tool: Tool::Paint(BlendMode::Normal),
        opacity: 1.0,
        channels: vec![ChannelPaint::new(0, color)],
        stencil: None,
        sight: None,
    }
}

/// Hides and shows a layer; all texels, coarser levels included, are the bytes from before then.
#[test]
fn hidden_layers_give_back_the_base_and_shown_ones_come_back() {
    for format in [BakeFormat::Bc7, BakeFormat::Rgba8] {
        let baked = ball(60_000, format);
        let mut painter = baked.painter();
        let base = contents(&painter);
        let layer = painter.add_layer(Layer::painted("paint")).unwrap();
        assert!(contents(&painter) == base, "an empty layer shows nothing");
        paint_on(&mut painter, Target::Layer(layer), red(1.0), &LINE);
        let painted = contents(&painter);
        assert!(painted != base);
        painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
        assert!(contents(&painter) == base, "{format:?}");
        painter.commit().unwrap();
        drop(painter);
        let mut painter = baked.painter();
        assert_eq!(painter.layers().len(), 1);
        painter.edit_layers("show", |layers| layers[0].visible = true).unwrap();
        let finest = |(pages, _): &Contents| -> Vec<Vec<u8>> {
            pages.iter().filter(|(id, _)| id.level == 0).map(|(_, bytes)| bytes.clone()).collect()
        };
        assert!(finest(&contents(&painter)) == finest(&painted), "{format:?}");
        painter.commit().unwrap();
        assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    }
}

/// So do the means of tiles that have no coarser level.
#[test]
fn hidden_layers_give_back_the_means_of_the_smallest_tiles() {
    let mesh = cleaned(generate::icosphere(2));
    let cover = cover(&mesh, 0, 16);
    assert!(cover.groups.iter().all(|group| group.level_count() == 1));
    let baked = Baked::new(&mesh, &cover, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let base = contents(&painter);
    let layer = painter.add_layer(Layer::painted("paint")).unwrap();
    paint_on(&mut painter, Target::Layer(layer), red(1.0), &LINE);
    painter.commit().unwrap();
    assert!(contents(&painter).1 != base.1);
    painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
    painter.commit().unwrap();
    assert!(contents(&painter) == base);
}

#[test]
fn layers_over_paint_on_the_base_give_it_back() {
    let baked = ball(60_000, BakeFormat::Bc7);
    let mut painter = baked.painter();
    let layer = painter.add_layer(Layer::painted("paint")).unwrap();
    let fill = everywhere(Vec4::new(0.1, 0.4, 0.1, 1.0));
    paint_on(&mut painter, Target::Layer(layer), red(1.0), &LINE);
    painter.add_layer(fill.clone()).unwrap();
    paint_on(&mut painter, Target::Base, red(0.5), &[Vec3::Y, Vec3::X]);
    painter.edit_layers("hide", |layers| layers.iter_mut().for_each(|l| l.visible = false)).unwrap();
    let base = contents(&painter);
    let fade = |layer: &mut Layer| (layer.visible, layer.opacity) = (true, 0.5);
    painter.edit_layers("fade", |layers| fade(&mut layers[1])).unwrap();
    assert!(contents(&painter) != base);
    painter.edit_layers("remove", |layers| layers.clear()).unwrap();
    assert!(contents(&painter) == base);
    painter.add_layer(fill).unwrap();
    painter.edit_layers("remove", |layers| layers.clear()).unwrap();
    assert!(contents(&painter) == base);
    while painter.undo().unwrap() {}
    let untouched = ball(60_000, BakeFormat::Bc7);
    assert!(contents(&painter) == contents(&untouched.painter()));
}

/// Under a layer that changes nothing before the base is painted brighter, coarser levels and means of the base are kept all the same.
#[test]
fn layers_without_effect_give_back_what_is_painted_under_them() {
    let [baked, plain] = [0, 1].map(|_| ball(60_000, BakeFormat::Rgba8));
    let (mut painter, mut without) = (baked.painter(), plain.painter());
    let untouched = contents(&painter);
    let mut darken = everywhere(Vec4::new(0.6, 0.6, 0.6, 1.0));
    (darken.blend, darken.channels) = (BlendMode::Darken, vec![true, false]);
    painter.add_layer(darken).unwrap();
    assert!(contents(&painter) == untouched, "it lies over what is darker");
    paint_on(&mut painter, Target::Base, white(), &LINE);
    paint_on(&mut without, Target::Base, white(), &LINE);
    assert!(contents(&painter) != contents(&without));
    painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
    assert!(contents(&painter) == contents(&without));
    while painter.undo().unwrap() {}
    assert!(contents(&painter) == untouched);
    while painter.redo().unwrap() {}
    assert!(contents(&painter) == contents(&without));
}

/// Pages of a layer that one step changes twice are as before when it is taken back.
#[test]
fn two_merges_in_one_step_are_undone() {
    let baked = ball(60_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let ids = ["lowest", "middle", "top"].map(|name| painter.add_layer(Layer::painted(name)).unwrap());
    let paints = [red(1.0), white(), red(0.5)];
    for (&id, paint) in ids.iter().zip(paints) {
        paint_on(&mut painter, Target::Layer(id), paint, &LINE);
    }
    let [lowest, middle, top] = ids;
    let alone = |painter: &mut Painter| {
        let hide = |layer: &mut Layer| layer.visible = layer.id() == lowest;
        painter.edit_layers("alone", |layers| layers.iter_mut().for_each(hide)).unwrap();
        let seen = contents(painter);
        painter.undo().unwrap();
        seen
    };
    let before = alone(&mut painter);
    let stack = painter.layers().iter().filter(|layer| layer.id() == lowest).cloned().collect();
    let moves = [LayerMove::Merge([middle, lowest]), LayerMove::Merge([top, lowest])];
    painter.set_layers("merge all", stack, &moves).unwrap();
    assert!(alone(&mut painter) != before);
    painter.undo().unwrap();
    assert_eq!(painter.layers().len(), 3);
    assert!(alone(&mut painter) == before);
    // Layers that are not there are not merged, and nothing else is done then.
    let refused = painter.set_layers("merge", Vec::new(), &[LayerMove::Merge([99, lowest])]).unwrap_err();
    assert_eq!(refused.to_string(), "there is no layer number 99 to be merged");
    assert_eq!(painter.layers().len(), 3);
}

/// A tile's own value at a point of the surface differs from its neighbours' by no more than the texture varies: a fill layer of
/// the very colours of the base changes nothing on any level.
#[test]
fn coarser_levels_show_the_fill_up_to_the_border() {
    let mesh = cleaned(generate::icosphere(3));
    let baked = Baked::new(&mesh, &cover(&mesh, 64, 40_000), BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let color = Vec4::new(0.5, 0.5, 0.5, 1.0);
    painter.add_layer(everywhere(color)).unwrap();
    painter.commit().unwrap();
    let with_texels = VerifyOptions { texels: true, ..VerifyOptions::default() };
    assert!(verify(&baked.path, &with_texels).unwrap().ok);
    let cache = baked.cache();
    for level in 0..cache.asset().level_count() {
        for triangle in 0..cache.asset().mesh().triangles.len() {
            for step in 0..=10 {
                let s = step as f32 / 10.0;
                for lambda in [Vec3::new(s, 1.0 - s, 0.0), Vec3::new(0.5 * s, 0.5 * s, 1.0 - s)] {
                    let (_, parts) = sample(&cache, 0, level, triangle, lambda);
                    for part in parts {
                        assert!((part - color).abs().max_element() < 0.01, "{level} {triangle} {part}");
                    }
                }
            }
        }
    }
}

#[test]
fn every_step_can_be_undone() {
    let baked = ball(60_000, BakeFormat::Bc7);
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
    let baked = ball(60_000, BakeFormat::Float);
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
    let refused = painter.begin_on(Target::Layer(77), "x", red(1.0)).unwrap_err();
    assert!(refused.to_string().contains("no layer number 77"), "{refused}");
}

// Copies, merges, masks that are made.

/// Largest difference of level 0 texels and the share of them that differ by more than a thousandth.
pub(crate) fn apart(a: &Painter, b: &Painter) -> f32 {
    let mut most = 0.0f32;
    let asset = a.editor().asset();
    for (g, group) in (0u32..).zip(&asset.cover().groups) {
        for id in fantex_store::group_pages(g, group).filter(|id| id.level == 0) {
            for channel in 0..asset.channels().len() {
                let [a, b] = [a, b].map(|painter| painter.editor().read_page(channel, id).unwrap().rgba);
                let texels = a.iter().flatten().zip(b.iter().flatten());
                most = texels.fold(most, |most, (a, b)| most.max((a - b).abs()));
            }
        }
    }
    most
}

#[test]
fn layers_are_copied_and_merged() {
    let baked = ball(60_000, BakeFormat::Float);
    let mut painter = baked.painter();
    let lower = painter.add_layer(Layer::painted("lower")).unwrap();
    paint_on(&mut painter, Target::Layer(lower), red(0.7), &LINE);
    let fill = painter.add_layer(Layer::fill("upper", &[Vec4::new(0.0, 0.4, 0.1, 1.0)])).unwrap();
    paint_on(&mut painter, Target::Mask(fill), white(), &[Vec3::Y, Vec3::new(0.6, 0.6, 0.5), Vec3::X]);
    painter.edit_layers("fade", |layers| layers[1].opacity = 0.6).unwrap();
    let seen = contents(&painter);
    painter.commit().unwrap();
    let copy = baked.folder.path().join("copy.fan");
    std::fs::copy(&baked.path, &copy).unwrap();
    let before = Painter::open(&copy, &Default::default()).unwrap();

    // A copy over the original shows more of it, and the same alone.
    let twin = painter.duplicate_layer(fill).unwrap();
    assert_eq!((painter.layers()[2].id(), painter.layers()[2].name.as_str()), (twin, "upper copy"));
    assert!(contents(&painter) != seen);
    painter.edit_layers("hide", |layers| layers[1].visible = false).unwrap();
    assert_eq!(apart(&painter, &before), 0.0);
    // A stroke on the copy's mask leaves the original's alone.
    paint_on(&mut painter, Target::Mask(twin), white(), &[Vec3::NEG_X]);
    painter.edit_layers("swap", |layers| (layers[1].visible, layers[2].visible) = (true, false)).unwrap();
    assert_eq!(apart(&painter, &before), 0.0);
    (0..4).for_each(|_| assert!(painter.undo().unwrap()));
    assert!(contents(&painter) == seen && painter.layers().len() == 2);

    painter.merge_layer_down(fill).unwrap();
    assert_eq!(painter.layers().len(), 1);
    let merged = &painter.layers()[0];
    assert_eq!((merged.id(), merged.opacity, merged.mask), (lower, 1.0, None));
    // Half floats.
    let difference = apart(&painter, &before);
    assert!(difference < 2e-3, "{difference}");
    painter.commit().unwrap();
    assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    assert!(painter.undo().unwrap());
    assert!(contents(&painter) == seen && painter.layers().len() == 2);
    assert!(painter.redo().unwrap());
    let after = contents(&painter);
    painter.commit().unwrap();

    // The log says how, on the same bake and on another one.
    let log = log_of(&baked.path);
    let again = ball(60_000, BakeFormat::Float);
    let mut replayed = again.painter();
    log.replay(&mut replayed).unwrap();
    assert_eq!(replayed.layers(), painter.layers());
    assert!(apart(&replayed, &painter) < 2e-3);
    replayed.commit().unwrap();
    assert!(verify(&again.path, &VerifyOptions::default()).unwrap().ok);
    assert!(contents(&painter) == after);

    let refused = painter.merge_layer_down(lower).unwrap_err().to_string();
    assert!(refused.contains("below the layer \"lower\" is none"), "{refused}");
    let mut hidden = Layer::painted("over");
    hidden.visible = false;
    let over = painter.add_layer(hidden).unwrap();
    let refused = painter.merge_layer_down(over).unwrap_err().to_string();
    assert!(refused.contains("\"over\" is hidden"), "{refused}");
    assert!(painter.duplicate_layer(99).unwrap_err().to_string().contains("no layer number 99"));
}

#[test]
fn masks_are_inverted_painted_over_what_makes_them_and_forgotten() {
    let baked = ball(60_000, BakeFormat::Float);
    let mut painter = baked.painter();
    let id = painter.add_layer(Layer::fill("snow", &[Vec4::ONE, Vec4::ONE])).unwrap();
    let slope = MaskSource { by: MaskMeasure::Slope { axis: 1 }, from: 0.5, to: 0.25 };
    painter.edit_layers("mask", |layers| layers[0].mask_source = Some(slope)).unwrap();
    let places = [Vec3::Y, Vec3::new(1.0, 1.0, 0.0), Vec3::new(1.0, 0.3, 0.0), Vec3::NEG_Y, Vec3::X];
    let shown = |painter: &mut Painter| -> Vec<f32> {
        let surface = Arc::clone(painter.surface());
        let points = places.map(|p| surface.nearest(p.normalize(), f32::INFINITY).unwrap());
        painter.held_at(Target::Mask(id), 0, &points).unwrap().into_iter().map(|v| v.x).collect()
    };
    // By hand: smoothstep of the angle to the axis over pi.
    let by_hand = |p: Vec3| {
        let s = ((0.5 - p.normalize().y.acos() / std::f32::consts::PI) / 0.25).clamp(0.0, 1.0);
        s * s * (3.0 - 2.0 * s)
    };
    let made = shown(&mut painter);
    for (place, value) in places.iter().zip(&made) {
        assert!((value - by_hand(*place)).abs() < 0.05, "{place} {value} {}", by_hand(*place));
    }
    painter.edit_layers("invert", |layers| layers[0].mask_inverted = true).unwrap();
    let inverted = shown(&mut painter);
    assert!(made.iter().zip(&inverted).all(|(a, b)| (a + b - 1.0).abs() < 1e-3));
    // White shows, inverted or not.
    paint_on(&mut painter, Target::Mask(id), white(), &[Vec3::Y]);
    let painted = shown(&mut painter);
    assert!((painted[0] - 1.0).abs() < 1e-3 && painted[3] == inverted[3], "{painted:?}");
    // What was painted stays where the source changes, and nothing else.
    let noise = MaskMeasure::Noise { scale: 0.1, seed: 3 }.source();
    painter.edit_layers("noise", |layers| layers[0].mask_source = Some(noise)).unwrap();
    assert!((shown(&mut painter)[0] - 1.0).abs() < 1e-3);
    // A page of the mask at any level has the mean of the texels below.
    let page = fantex_store::PageId { group: 0, level: 0, page: [0, 0] };
    let mean = |values: Vec<f32>| values.iter().sum::<f32>() / values.len() as f32;
    let [fine, coarse] = [0, 1].map(|level| fantex_store::PageId { level, ..page });
    let [fine, coarse] = [fine, coarse].map(|page| mean(painter.mask_on_page(id, page).unwrap()));
    assert!((fine - coarse).abs() < 0.05, "{fine} {coarse}");
    // Log, journal and history know all of it.
    painter.commit().unwrap();
    let seen = contents(&painter);
    let again = ball(60_000, BakeFormat::Float);
    let mut replayed = again.painter();
    log_of(&baked.path).replay(&mut replayed).unwrap();
    assert!(contents(&replayed) == seen);
    // A mask that is removed is forgotten; undo brings it back.
    painter
        .edit_layers("remove", |layers| {
            (layers[0].mask, layers[0].mask_source, layers[0].mask_inverted) = (None, None, false);
        })
        .unwrap();
    painter.edit_layers("black", |layers| layers[0].mask = Some(0.0)).unwrap();
    assert_eq!(shown(&mut painter), [0.0; 5]);
    assert!(painter.undo().unwrap() && painter.undo().unwrap());
    assert!(contents(&painter) == seen);
    drop(painter);
    let mut painter = baked.painter();
    assert!((shown(&mut painter)[0] - 1.0).abs() < 1e-3, "also after a restart");
    while painter.undo().unwrap() {}
    assert!(contents(&painter) == contents(&ball(60_000, BakeFormat::Float).painter()));
}

/// Roughness alone, on the base and on layers: what is beside it stays bit by bit, each component has an alpha of its own.
#[test]
fn occlusion_roughness_and_metallic_are_painted_apart() {
    let baked = ball(60_000, BakeFormat::Float);
    let mut painter = baked.painter();
    let place = painter.surface().nearest(Vec3::X, f32::INFINITY).unwrap();
    let part = |components: [bool; 3], value: Vec4, opacity: f32| Paint {
        channels: vec![ChannelPaint { channel: 1, color: PaintColor::Constant(value), components }],
        opacity,
        ..white()
    };
    let seen = |painter: &mut Painter| painter.pick(1, place).unwrap();
    let base = seen(&mut painter);
    let (rough, metal) = ([false, true, false], [false, false, true]);
    let value = Vec4::new(0.11, 0.22, 0.77, 1.0);
    paint_on(&mut painter, Target::Base, part(rough, value, 1.0), &[Vec3::X]);
    let found = seen(&mut painter);
    assert!((found - Vec4::new(base.x, 0.22, base.z, base.w)).abs().max_element() < 1e-6, "{found}");
    painter.undo().unwrap();
    assert_eq!(seen(&mut painter), base);

    // Half of the roughness, then all of the metallic, on one layer.
    let layer = painter.add_layer(Layer::painted("material")).unwrap();
    paint_on(&mut painter, Target::Layer(layer), part(rough, value, 0.5), &[Vec3::X]);
    paint_on(&mut painter, Target::Layer(layer), part(metal, value, 1.0), &[Vec3::X]);
    let found = seen(&mut painter);
    let expected = Vec4::new(base.x, 0.5 * (base.y + 0.22), 0.77, base.w);
    assert!((found - expected).abs().max_element() < 2e-3, "{found} {expected}");
    // Another layer over it: merged, all is as it was.
    let upper = painter.add_layer(Layer::painted("upper")).unwrap();
    paint_on(
        &mut painter,
        Target::Layer(upper),
        part([true, false, false], Vec4::new(0.4, 0.4, 0.4, 1.0), 0.5),
        &[Vec3::X],
    );
    let before = seen(&mut painter);
    assert!((before.x - 0.5 * (base.x + 0.4)).abs() < 2e-3 && before.z == found.z, "{before}");
    painter.merge_layer_down(upper).unwrap();
    assert!((seen(&mut painter) - before).abs().max_element() < 2e-3);
    paint_on(
        &mut painter,
        Target::Layer(layer),
        Paint { tool: Tool::Erase, ..part(metal, value, 1.0) },
        &[Vec3::X],
    );
    let erased = seen(&mut painter);
    let expected = Vec4::new(before.x, before.y, base.z, base.w);
    assert!((erased - expected).abs().max_element() < 2e-3, "{erased} {expected}");
    painter.commit().unwrap();
    assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    // The log says which.
    let again = ball(60_000, BakeFormat::Float);
    let mut replayed = again.painter();
    let log = log_of(&baked.path);
    assert_eq!(log.strokes.strokes[1].channels[0].components, rough);
    log.replay(&mut replayed).unwrap();
    assert!(apart(&replayed, &painter) < 4e-3);
    while painter.undo().unwrap() {}
    assert!(contents(&painter) == contents(&ball(60_000, BakeFormat::Float).painter()));
}

/// Edges, height and slope of a box; what lies in the hole of a ring is hidden more than what lies outside.
#[test]
fn measures_know_edges_and_hollows() {
    let mesh = cleaned(generate::cube(2));
    let baked = Baked::new(&mesh, &cover(&mesh, 64, 60_000), BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let id = painter.add_layer(Layer::fill("edges", &[Vec4::ONE])).unwrap();
    let mut measure = |by: MaskMeasure, at: Vec3| {
        let source = MaskSource { by, from: 0.0, to: 1.0 };
        painter.edit_layers("mask", |layers| layers[0].mask_source = Some(source)).unwrap();
        let half = painter.surface().mesh().bounds().max.x;
        let point = painter.surface().nearest(at * half, f32::INFINITY).unwrap();
        painter.held_at(Target::Mask(id), 0, &[point]).unwrap()[0].x
    };
    let smooth = |s: f32| s * s * (3.0 - 2.0 * s);
    let curvature = MaskMeasure::Curvature { radius: 0.05 };
    let flat = measure(curvature, Vec3::new(1.0, 0.1, 0.2));
    let edge = measure(curvature, Vec3::new(1.0, 0.99, 0.2));
    let corner = measure(curvature, Vec3::new(1.0, 0.99, 0.99));
    assert!((flat - 0.5).abs() < 0.01 && edge > flat + 0.1 && corner > edge + 0.05, "{flat} {edge} {corner}");
    assert!(measure(MaskMeasure::Occlusion { radius: 0.2 }, Vec3::X) < 0.01);
    let low = measure(MaskMeasure::Height { axis: 1 }, Vec3::new(1.0, -0.5, 0.1));
    assert!((low - smooth(0.25)).abs() < 0.02, "{low}");
    // The cube reaches from -1 to 1 in its file.
    let distance = MaskMeasure::Distance { to: [1.0, 1.0, 1.0] };
    let far = measure(distance, Vec3::new(1.0, -0.5, 0.1));
    let expected = (1.5f32 * 1.5 + 0.9 * 0.9).sqrt() / 12.0f32.sqrt();
    assert!((far - smooth(expected)).abs() < 0.02, "{far} {}", smooth(expected));
    assert!(measure(distance, Vec3::ONE) < 0.01);
    assert!((measure(MaskMeasure::Slope { axis: 1 }, Vec3::new(0.3, 1.0, 0.1)) - 0.0).abs() < 0.01);
    assert!((measure(MaskMeasure::Slope { axis: 1 }, Vec3::new(1.0, 0.3, 0.1)) - 0.5).abs() < 0.01);
    let ring = cleaned(generate::torus(48, 24));
    let baked = Baked::new(&ring, &cover(&ring, 64, 60_000), BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let id = painter.add_layer(Layer::fill("dirt", &[Vec4::ONE])).unwrap();
    let by = MaskMeasure::Occlusion { radius: 0.5 };
    let source = Some(MaskSource { by, from: 0.0, to: 1.0 });
    painter.edit_layers("mask", |layers| layers[0].mask_source = source).unwrap();
    let points = [Vec3::ZERO, 9.0 * Vec3::X].map(|p| painter.surface().nearest(p, f32::INFINITY).unwrap());
    let held = painter.held_at(Target::Mask(id), 0, &points).unwrap();
    assert!(held[0].x > held[1].x + 0.05 && held[1].x < 0.01, "{held:?}");
}

// The log of strokes: paint outlives resolution, cover and mesh.

/// A layer without a mask gets one that shows it, whether the stroke on its mask is the first on the layer or not.
#[test]
fn strokes_on_masks_make_them() {
    const PAINTED: &str = r#"{ "layer": { "name": "a" }, "fill": "whole",
        "channels": [{ "kind": "base_color", "color": { "linear": [0.8, 0.3, 0.5, 1] } }] }"#;
    const HIDDEN: &str = r#"{ "layer": { "name": "a", "mask": true }, "fill": "whole",
        "channels": [{ "kind": "base_color", "color": { "linear": [0, 0, 0, 1] } }] }"#;
    let looks = [&[PAINTED, HIDDEN][..], &[HIDDEN, PAINTED], &[]].map(|strokes| {
        let baked = ball(20_000, BakeFormat::Rgba8);
        let text = format!(r#"{{ "version": 1, "strokes": [{}] }}"#, strokes.join(","));
        let file: StrokeFile = serde_json::from_str(&text).unwrap();
        let mut painter = baked.painter();
        replay(&mut painter, &file, baked.folder.path()).unwrap();
        contents(&painter)
    });
    assert!(looks[0] == looks[2] && looks[1] == looks[2]);
    // Those who paint in code add the mask themselves.
    let baked = ball(20_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let layer = painter.add_layer(Layer::painted("a")).unwrap();
    let refused = painter.begin_on(Target::Mask(layer), "mask", white()).unwrap_err();
    assert!(refused.to_string().contains("has no mask"), "{refused}");
}

const LOGGED_STROKES: &str = r##"{ "version": 1, "strokes": [
    { "label": "ground", "fill": "whole", "channels": [{ "kind": "base_color", "color": { "srgb": [0.8, 0.8, 0.7] } }],
      "samples": [{ "at": { "position": [0, 0, 1] } }] },
    { "label": "fill layer", "layer": { "name": "squares", "opacity": 0.8, "fill": {
        "look": { "inline": { "text": "[textures.squares]\nkind = \"checker\"\neven = \"#40c040\"\nodd = \"#c0c0ff\"\n" } },
        "textures": [{ "kind": "base_color", "texture": "squares" }], "outside": 0.0 } } },
    { "label": "mask", "layer": { "name": "squares", "mask": true }, "brush": { "size": { "texels": 60 } },
      "channels": [{ "kind": "base_color", "color": { "srgb": [1, 1, 1] } }],
      "samples": [{ "at": { "position": [0, -0.6, 1] } }, { "at": { "position": [1, -0.6, 0] } }] },
    { "label": "line", "brush": { "size": { "texels": 30 }, "flow": 0.6 },
      "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.1] } },
                   { "kind": "occlusion_roughness_metallic", "color": { "linear": [1, 0.2, 0, 1] } }],
      "samples": [{ "at": { "position": [1, 0, 0] } }, { "at": { "position": [0, 1, 0] }, "pressure": 0.4 },
                  { "at": { "position": [-1, 0.2, 0.3] } }] },
    { "label": "stamp", "brush": { "size": { "texels": 80 }, "stamp": "stamp.png" }, "tool": { "paint": "multiply" },
      "channels": [{ "kind": "base_color", "color": { "srgb": [0.2, 0.2, 0.9] } }],
      "samples": [{ "at": { "ray": { "origin": [0, 0, 9], "direction": [0, 0, -1] } } },
                  { "at": { "ray": { "origin": [0, 5, 9], "direction": [0, 0, -1] } } }] },
    { "label": "smudge", "brush": { "size": { "texels": 40 } }, "tool": { "smudge": { "strength": 0.8 } },
      "channels": [{ "kind": "base_color" }],
      "samples": [{ "at": { "position": [1, 0, 0] } }, { "at": { "position": [1, 0.1, 0.4] } }] },
    { "label": "text", "text": { "text": "fan", "size": { "texels": 80 } },
      "channels": [{ "kind": "base_color", "color": { "srgb": [0, 0, 0] } }],
      "samples": [{ "at": { "position": [0, 0.2, -1] } }] }
] }"##;

fn painted(mesh: &Mesh, tile: u32, texels: u64) -> Baked {
    let baked = Baked::new(mesh, &cover(mesh, tile, texels), BakeFormat::Bc7);
    let texel = |i: usize| [1.0, 1.0, 1.0, if (i % 16 / 4 + i / 64).is_multiple_of(2) { 1.0 } else { 0.0 }];
    let texels: Vec<[f32; 4]> = (0..256).map(texel).collect();
    Image::from_linear_rgba(16, 16, &texels).save(baked.folder.path().join("stamp.png")).unwrap();
    let file: StrokeFile = serde_json::from_str(LOGGED_STROKES).unwrap();
    let mut painter = baked.painter();
    let summary = replay(&mut painter, &file, baked.folder.path()).unwrap();
    assert_eq!(summary.missed_samples, 1);
    painter.commit().unwrap();
    baked
}

fn log_of(path: &Path) -> StrokeLog {
    StrokeLog::of(&Asset::open(path).unwrap()).unwrap()
}

/// Replays the log of one asset onto a bake of another mesh, and compares base colours at the same places of the world: the
/// mean difference, and the share of places that differ by more than a tenth.
fn compare(from: &Baked, mesh: &Mesh, tile: u32, texels: u64) -> (f32, f32) {
    let to = Baked::new(mesh, &cover(mesh, tile, texels), BakeFormat::Bc7);
    let mut painter = to.painter();
    let summary = log_of(&from.path).replay(&mut painter).unwrap();
    assert_eq!((summary.missed_samples, summary.unrecorded), (0, 0));
    painter.commit().unwrap();
    assert!(verify(&to.path, &VerifyOptions::default()).unwrap().ok);
    let (old, new) = (from.cache(), to.cache());
    let surface = Arc::clone(painter.surface());
    let old_mesh = old.asset().mesh();
    let step = (old_mesh.triangles.len() / 4000).max(1);
    let (mut sum, mut apart, mut count) = (0.0, 0, 0);
    for triangle in (0..old_mesh.triangles.len()).step_by(step) {
        let lambda = Vec3::splat(1.0 / 3.0);
        let [a, b, c] = old_mesh.triangle_positions(triangle);
        let world = old_mesh.world_from_mesh.point((a + b + c) / 3.0);
        let at = surface.mesh().world_from_mesh.inverse_point(world);
        let point = surface.nearest(at, f32::INFINITY).unwrap();
        let value = |cache: &PageCache, triangle, lambda| sample(cache, 0, 0, triangle, lambda).0;
        let before: Vec4 = value(&old, triangle, lambda);
        let after = value(&new, point.triangle as usize, point.lambda);
        let difference = (before - after).abs().max_element();
        sum += difference;
        apart += usize::from(difference > 0.1);
        count += 1;
    }
    (sum / count as f32, apart as f32 / count as f32)
}

#[test]
fn a_log_fits_other_densities_covers_and_meshes() {
    let mesh = cleaned(generate::icosphere(5));
    let baked = painted(&mesh, 64, 400_000);
    let log = log_of(&baked.path);
    let labels: Vec<&str> = log.strokes.strokes.iter().map(|stroke| stroke.label.as_str()).collect();
    // The layer is made by a step of its own.
    assert_eq!(labels, ["ground", "add layer", "mask", "line", "stamp", "smudge", "text"]);
    let same = compare(&baked, &mesh, 64, 400_000);
    assert!(same.0 < 1e-3 && same.1 < 0.002, "the same again: {same:?}");
    let denser = compare(&baked, &mesh, 64, 1_000_000);
    assert!(denser.0 < 0.01 && denser.1 < 0.03, "density: {denser:?}");
    let covered = compare(&baked, &mesh, 128, 400_000);
    assert!(covered.0 < 0.01 && covered.1 < 0.02, "another cover: {covered:?}");
    let coarse = compare(&baked, &cleaned(generate::icosphere(4)), 64, 400_000);
    assert!(coarse.0 < 0.015 && coarse.1 < 0.05, "a quarter of the triangles: {coarse:?}");
    let mut bumpy = generate::icosphere(5);
    for p in &mut bumpy.positions {
        *p *= 0.965 + 0.03 * (9.0 * p.x).sin() * (7.0 * p.y).cos();
    }
    let displaced = compare(&baked, &cleaned(bumpy), 64, 400_000);
    assert!(displaced.0 < 0.02 && displaced.1 < 0.06, "displaced: {displaced:?}");
}

#[test]
fn what_is_undone_leaves_the_log() {
    let mesh = cleaned(generate::icosphere(4));
    let baked = Baked::new(&mesh, &cover(&mesh, 64, 60_000), BakeFormat::Bc7);
    let mut painter = baked.painter();
    let line = stroke(painter.surface(), 30.0, &[Vec3::X, Vec3::new(0.6, 0.6, 0.5)]);
    paint_stroke(&mut painter, red(0.8), &line);
    painter.add_layer(Layer::painted("over")).unwrap();
    let count = |painter: &mut fantex_paint::Painter| {
        painter.commit().unwrap();
        log_of(&baked.path).strokes.strokes.len()
    };
    assert_eq!(count(&mut painter), 2);
    painter.undo().unwrap();
    assert_eq!(count(&mut painter), 1);
    painter.redo().unwrap();
    assert_eq!(count(&mut painter), 2);
    painter.undo().unwrap();
    painter.undo().unwrap();
    assert_eq!(count(&mut painter), 0);
    drop(painter);
    let mut painter = baked.painter();
    painter.redo().unwrap();
    assert_eq!(count(&mut painter), 1);
    // What came as dabs is logged as dabs.
    let log = log_of(&baked.path);
    assert!(log.strokes.strokes[0].dabs.len() > 5 && log.strokes.strokes[0].samples.is_empty());
    let again = compare(&baked, &mesh, 64, 60_000);
    assert!(again.0 < 1e-3, "{again:?}");
    let file = baked.folder.path().join("out/strokes.json");
    std::fs::create_dir(file.parent().unwrap()).unwrap();
    log.save(&file).unwrap();
    assert_eq!(StrokeFile::load(&file).unwrap(), log.strokes);
}

#[test]
fn a_painted_bunny_takes_its_paint_along() {
    let Some(folder) = data_folder() else { return };
    let mesh = loaded(&folder, "meshes/bunny/stanford_bunny.ply");
    let baked = Baked::new(&mesh, &cover(&mesh, 64, 1 << 19), BakeFormat::Bc7);
    let mut painter = baked.painter();
    let line = stroke(painter.surface(), 40.0, &[Vec3::new(-0.5, 0.2, 1.0), Vec3::new(0.5, 0.1, 1.0)]);
    paint_stroke(&mut painter, red(0.9), &line);
    painter.commit().unwrap();
    drop(painter);
    let denser = compare(&baked, &mesh, 64, 1 << 20);
    let covered = compare(&baked, &mesh, 96, 1 << 19);
    assert!(denser.0 < 0.01 && covered.0 < 0.01, "{denser:?} {covered:?}");
}

#[test]
fn a_log_does_not_choose_where_its_files_are_written() {
    let baked = ball(2_000, BakeFormat::Rgba8);
    let out = baked.folder.path().join("deep/out");
    std::fs::create_dir_all(&out).unwrap();
    // The last ones might be files that somebody has there.
    for name in
        ["../../up.txt", "..", "", "a/b.txt", "/tmp/fantex-absolute.txt", "c:x", "thesis.txt", "0123.png"]
    {
        let mut editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
        editor.attach(&format!("strokes/files/{name}"), b"text".to_vec()).unwrap();
        editor.commit().unwrap();
        let log = StrokeLog::of(editor.asset());
        assert!(log.is_err_and(|error| error.kind() == ErrorKind::Damaged), "{name}");
        editor.detach(&format!("strokes/files/{name}"));
        editor.commit().unwrap();
    }
    log_of(&baked.path).save(&out.join("log.json")).unwrap();
}
