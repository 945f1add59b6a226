//! Groups of layers: what they show, how they are made, moved, copied, merged, kept and replayed.

use fantex_bake::BakeFormat;
use fantex_paint::{
    BlendMode, GroupKind, Layer, LayerPlace, MAX_GROUP_DEPTH, Painter, StrokeLog, Target, dissolve_group,
    move_layer, remove_layer, replay,
};
use fantex_store::{Asset, VerifyOptions, verify};
use glam::{DVec3, Vec3, Vec4};

use crate::layers::{LINE, apart, everywhere, paint_on, white};
use crate::{Baked, ball, color_at, contents, red, strokes};

// What groups show, against a composition of premultiplied colours in double precision that knows nothing of the painter's.

#[derive(Clone)]
struct Node {
    opacity: f64,
    mask: Option<f64>,
    is_visible: bool,
    mode: BlendMode,
    what: What,
}

#[derive(Clone)]
enum What {
    Color(DVec3, f64),
    Group(GroupKind, Vec<Node>),
}

/// Premultiplied.
type Premultiplied = (DVec3, f64);

fn by_hand(nodes: &[Node], below: Premultiplied) -> Premultiplied {
    nodes.iter().filter(|node| node.is_visible).fold(below, |below, node| {
        let share = node.opacity * node.mask.unwrap_or(1.0);
        match &node.what {
            What::Group(GroupKind::PassThrough, members) => {
                let above = by_hand(members, below);
                (below.0.lerp(above.0, share), below.1 + (above.1 - below.1) * share)
            }
            What::Group(GroupKind::Isolated, members) => {
                let (color, alpha) = by_hand(members, (DVec3::ZERO, 0.0));
                over(below, (color * share, alpha * share), node.mode)
            }
            What::Color(color, alpha) => over(below, (*color * alpha * share, alpha * share), node.mode),
        }
    })
}

/// "Compositing and Blending Level 1", 9.1.4, 5.1, and 9.1.9 for what erases, premultiplied.
fn over((pb, ab): Premultiplied, (ps, alpha): Premultiplied, mode: BlendMode) -> Premultiplied {
    if alpha == 0.0 {
        return (pb, ab);
    }
    if mode == BlendMode::Erase {
        return (pb * (1.0 - alpha), ab * (1.0 - alpha));
    }
    let (cb, cs) = (if ab > 0.0 { pb / ab } else { DVec3::ZERO }, ps / alpha);
    let blended = match mode {
        BlendMode::Multiply => cb * cs,
        BlendMode::Screen => cb + cs - cb * cs,
        BlendMode::Normal => cs,
        _ => unreachable!("the trees have no other"),
    };
    let color = ps * (1.0 - ab) + blended * (alpha * ab) + pb * (1.0 - alpha);
    (color, alpha + ab - alpha * ab)
}

/// Numbers that look random, 0..1.
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / (1u64 << 31) as f64
    }

    fn nodes(&mut self, count: usize, depth: usize) -> Vec<Node> {
        (0..count).map(|_| self.node(depth)).collect()
    }

    fn node(&mut self, depth: usize) -> Node {
        let what = if depth > 0 && self.roll() < 0.6 {
            let kind = if self.roll() < 0.5 { GroupKind::PassThrough } else { GroupKind::Isolated };
            let count = 1 + (self.roll() * 3.0) as usize;
            What::Group(kind, self.nodes(count, depth - 1))
        } else {
            What::Color(DVec3::new(self.roll(), self.roll(), self.roll()), 0.3 + 0.7 * self.roll())
        };
        let modes = [BlendMode::Normal, BlendMode::Multiply, BlendMode::Screen, BlendMode::Erase];
        Node {
            opacity: if self.roll() < 0.4 { 1.0 } else { self.roll() },
            mask: (self.roll() < 0.3).then(|| self.roll()),
            is_visible: self.roll() < 0.85,
            mode: modes[(self.roll() * 4.0) as usize],
            what,
        }
    }
}

/// Adds the nodes on top of a group, or of all.
fn add(painter: &mut Painter, nodes: &[Node], group: Option<u64>) {
    for node in nodes {
        let mut layer = match &node.what {
            What::Color(color, alpha) => everywhere(color.as_vec3().extend(*alpha as f32)),
            What::Group(kind, _) => Layer::group("group", *kind),
        };
        (layer.opacity, layer.visible, layer.blend) = (node.opacity as f32, node.is_visible, node.mode);
        layer.mask = node.mask.map(|mask| mask as f32);
        let place = group.map_or(LayerPlace::Top, LayerPlace::Into);
        let id = painter.start_add_layer(layer, place).unwrap();
        painter.finish_work().unwrap();
        if let What::Group(_, members) = &node.what {
            add(painter, members, Some(id));
        }
    }
}

#[test]
fn groups_show_what_a_composition_by_hand_shows() {
    let places = [Vec3::X, Vec3::new(0.4, -0.7, 0.2), Vec3::NEG_Z];
    for seed in 1..=16 {
        let baked = ball(4_000, BakeFormat::Float);
        let mut painter = baked.painter();
        let values = |painter: &mut Painter| {
            painter.commit().unwrap();
            let cache = baked.cache();
            places.map(|place| color_at(&cache, painter, place))
        };
        let before = values(&mut painter);
        let nodes = Dice(seed).nodes(3, 3);
        add(&mut painter, &nodes, None);
        for (found, base) in values(&mut painter).into_iter().zip(before) {
            let (color, alpha) = by_hand(&nodes, (base.truncate().as_dvec3(), 1.0));
            let expected = color.as_vec3().extend(alpha as f32);
            let found = (found.truncate() * found.w).extend(found.w);
            assert!((found - expected).abs().max_element() < 2e-5, "seed {seed}: {found} {expected}");
        }
        assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok, "seed {seed}");
    }
}

/// Roughness alone is painted in a group: occlusion and metallic stay, as without a group.
#[test]
fn components_are_composed_in_groups_as_without() {
    for kind in [GroupKind::PassThrough, GroupKind::Isolated] {
        let baked = ball(20_000, BakeFormat::Float);
        let mut painter = baked.painter();
        let base = contents(&painter);
        let layer = painter.add_layer(Layer::painted("rough")).unwrap();
        let mut paint = red(0.7);
        paint.channels[1].components = [false, true, false];
        paint_on(&mut painter, Target::Layer(layer), paint, &LINE);
        painter.commit().unwrap();
        let alone = baked.folder.path().join("alone.fan");
        std::fs::copy(&baked.path, &alone).unwrap();
        let alone = Painter::open(&alone, &Default::default()).unwrap();
        let group = painter.group_layers("group", kind, &[layer]).unwrap();
        assert!(apart(&painter, &alone) < 1e-6, "{kind:?}");
        painter.edit_layers("hide", |layers| layers[1].visible = false).unwrap();
        assert!(contents(&painter) == base);
        painter.edit_layers("show", |layers| layers[1].visible = true).unwrap();
        painter.merge_group(group).unwrap();
        assert!(apart(&painter, &alone) < 2e-3, "{kind:?}");
    }
}

fn listed(painter: &Painter) -> Vec<(String, Option<u64>)> {
    painter.layers().iter().map(|layer| (layer.name.clone(), layer.parent)).collect()
}

/// Layers `a` and `b`, painted; both in a group with a mask that is painted on.
fn grouped(baked: &Baked) -> (Painter, [u64; 3]) {
    let mut painter = baked.painter();
    let a = painter.add_layer(Layer::painted("a")).unwrap();
    paint_on(&mut painter, Target::Layer(a), red(1.0), &LINE);
    let b = painter.add_layer(everywhere(Vec4::new(0.1, 0.5, 0.2, 0.6))).unwrap();
    painter.edit_layers("blend", |layers| layers[1].blend = BlendMode::Multiply).unwrap();
    let group = painter.group_layers("both", GroupKind::Isolated, &[b, a]).unwrap();
    painter.edit_layers("mask", |layers| layers[2].mask = Some(0.0)).unwrap();
    paint_on(&mut painter, Target::Mask(group), white(), &[Vec3::X, Vec3::Y]);
    (painter, [a, b, group])
}

#[test]
fn every_step_with_groups_is_undone_kept_and_replayed() {
    let baked = ball(30_000, BakeFormat::Bc7);
    let mut painter = baked.painter();
    let mut states = vec![(contents(&painter), painter.layers().to_vec())];
    let mut note = |painter: &Painter| states.push((contents(painter), painter.layers().to_vec()));
    let a = painter.add_layer(Layer::painted("a")).unwrap();
    paint_on(&mut painter, Target::Layer(a), red(1.0), &LINE);
    note(&painter);
    let plain = contents(&painter);
    let group = painter.group_layers("group", GroupKind::PassThrough, &[a]).unwrap();
    assert!(contents(&painter) == plain, "a group that passes everything through changes nothing");
    note(&painter);
    painter.edit_layers("fade", |layers| layers[1].opacity = 0.5).unwrap();
    assert!(contents(&painter) != plain);
    note(&painter);
    painter.edit_layers("mask", |layers| layers[1].mask = Some(0.0)).unwrap();
    paint_on(&mut painter, Target::Mask(group), white(), &[Vec3::X]);
    note(&painter);
    let b = painter.add_layer(everywhere(Vec4::new(0.1, 0.5, 0.2, 0.6))).unwrap();
    painter.edit_layers("into", |layers| move_layer(layers, b, LayerPlace::Into(group))).unwrap();
    note(&painter);
    let outer = painter.group_layers("outer", GroupKind::Isolated, &[group, a]).unwrap();
    let expected = [("a", Some(group)), ("fill", Some(group)), ("group", Some(outer)), ("outer", None)];
    assert_eq!(listed(&painter), expected.map(|(name, parent)| (name.to_owned(), parent)));
    note(&painter);
    painter.edit_layers("ungroup", |layers| dissolve_group(layers, group)).unwrap();
    note(&painter);
    painter.edit_layers("delete", |layers| remove_layer(layers, outer)).unwrap();
    assert!(painter.layers().is_empty() && contents(&painter) == states[0].0);
    let log = |painter: &mut Painter| {
        painter.commit().unwrap();
        StrokeLog::of(&Asset::open(&baked.path).unwrap()).unwrap()
    };
    assert!(painter.undo().unwrap());
    let (seen, layers) = states.last().unwrap();
    assert!(contents(&painter) == *seen && painter.layers() == *layers);
    let log = log(&mut painter);
    // Kept over a restart.
    drop(painter);
    let mut painter = baked.painter();
    assert!(painter.layers() == *layers);
    // The log makes the same on another bake.
    let again = ball(30_000, BakeFormat::Bc7);
    let mut replayed = again.painter();
    log.replay(&mut replayed).unwrap();
    assert!(replayed.layers() == *layers && contents(&replayed) == *seen);
    for state in states[..states.len() - 1].iter().rev() {
        while painter.layers() != state.1 || contents(&painter) != state.0 {
            assert!(painter.undo().unwrap(), "back to {:?}", state.1);
        }
    }
    while painter.redo().unwrap() {}
    assert!(painter.layers().is_empty());
}

#[test]
fn groups_are_copied_and_merged() {
    let baked = ball(30_000, BakeFormat::Float);
    let (mut painter, [a, _, group]) = grouped(&baked);
    let seen = contents(&painter);
    painter.commit().unwrap();
    let before = baked.folder.path().join("before.fan");
    std::fs::copy(&baked.path, &before).unwrap();
    let before = Painter::open(&before, &Default::default()).unwrap();

    let copy = painter.duplicate_layer(group).unwrap();
    let names: Vec<&str> = painter.layers().iter().map(|layer| layer.name.as_str()).collect();
    assert_eq!(names, ["a", "fill", "both", "a", "fill", "both copy"]);
    assert_eq!(painter.layers()[3].parent, Some(copy));
    // Alone it shows what the original shows; what is painted on its members stays its own.
    painter.edit_layers("hide", |layers| layers[2].visible = false).unwrap();
    assert_eq!(apart(&painter, &before), 0.0);
    let twin = painter.layers()[3].id();
    paint_on(&mut painter, Target::Layer(twin), red(1.0), &[Vec3::NEG_Y]);
    painter.edit_layers("swap", |layers| (layers[2].visible, layers[5].visible) = (true, false)).unwrap();
    assert_eq!(apart(&painter, &before), 0.0);
    (0..4).for_each(|_| assert!(painter.undo().unwrap()));
    assert!(contents(&painter) == seen && painter.layers().len() == 3);

    painter.merge_group(group).unwrap();
    let merged = &painter.layers()[0];
    assert_eq!((painter.layers().len(), merged.id(), merged.mask), (1, group, None));
    let difference = apart(&painter, &before);
    assert!(difference < 2e-3, "{difference}");
    assert!(painter.undo().unwrap());
    assert!(contents(&painter) == seen);

    // A layer onto the group below it.
    let over = painter.add_layer(Layer::painted("over")).unwrap();
    paint_on(&mut painter, Target::Layer(over), red(0.8), &[Vec3::NEG_Y]);
    painter.commit().unwrap();
    let unmerged = baked.folder.path().join("unmerged.fan");
    std::fs::copy(&baked.path, &unmerged).unwrap();
    let unmerged = Painter::open(&unmerged, &Default::default()).unwrap();
    painter.merge_layer_down(over).unwrap();
    assert_eq!(painter.layers().len(), 1);
    assert!(apart(&painter, &unmerged) < 2e-3);
    painter.commit().unwrap();
    assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    assert!(painter.undo().unwrap());
    let refused = painter.merge_layer_down(a).unwrap_err().to_string();
    assert!(refused.contains("below the layer \"a\" is none"), "{refused}");
    assert!(painter.merge_group(a).unwrap_err().to_string().contains("\"a\" is no group"));
    let refused = painter.begin_on(Target::Layer(group), "x", red(1.0)).unwrap_err().to_string();
    assert!(refused.contains("\"both\" is a group of layers"), "{refused}");
    assert!(painter.group_layers("none", GroupKind::Isolated, &[77]).is_err());
}

/// A group's colour is what its members make over nothing.
#[test]
fn what_a_group_holds_is_what_its_members_make() {
    let baked = ball(10_000, BakeFormat::Float);
    let (mut painter, [_, _, group]) = grouped(&baked);
    let places = [Vec3::NEG_X, Vec3::X];
    let points = places.map(|at| painter.surface().nearest(at, f32::INFINITY).unwrap());
    let [plain, painted] = painter.held_at(Target::Layer(group), 0, &points).unwrap()[..] else { panic!() };
    assert!((plain - Vec4::new(0.1, 0.5, 0.2, 0.6)).abs().max_element() < 1e-6, "{plain}");
    let multiplied = Vec3::new(0.9, 0.05, 0.05).lerp(Vec3::new(0.09, 0.025, 0.01), 0.6).extend(1.0);
    assert!((painted - multiplied).abs().max_element() < 1e-3, "{painted} {multiplied}");
}

#[test]
fn folding_is_kept_and_is_no_step() {
    let baked = ball(4_000, BakeFormat::Bc7);
    let (mut painter, [a, _, group]) = grouped(&baked);
    let steps = painter.history().done().len();
    painter.collapse_group(group, true).unwrap();
    painter.collapse_group(a, true).unwrap();
    assert_eq!(painter.history().done().len(), steps);
    painter.commit().unwrap();
    drop(painter);
    let mut painter = baked.painter();
    assert_eq!(painter.collapsed_groups().iter().copied().collect::<Vec<_>>(), [group]);
    while painter.undo().unwrap() {}
    painter.collapse_group(group, false).unwrap();
    assert!(painter.collapsed_groups().is_empty());
}

/// Lists without groups are written as ever, and lists from before there were groups are read.
#[test]
fn lists_without_groups_know_nothing_of_them() {
    let baked = ball(4_000, BakeFormat::Bc7);
    let mut painter = baked.painter();
    painter.add_layer(Layer::painted("a")).unwrap();
    let list = painter.editor().attachment("layers/index").unwrap().unwrap();
    let list = String::from_utf8(list).unwrap();
    assert!(!list.contains("parent") && !list.contains("group"), "{list}");
    let old = r#"{"id":0,"name":"a","visible":true,"opacity":1.0,"blend":"normal","channels":[],"content":"painted","mask":null}"#;
    assert_eq!(serde_json::from_str::<Layer>(old).unwrap(), painter.layers()[0]);
}

#[test]
fn stroke_files_make_groups_and_layers_in_them() {
    let baked = ball(10_000, BakeFormat::Float);
    let mut painter = baked.painter();
    let stroke = |layer: &str| {
        format!(
            r#"{{ "layer": {layer}, "fill": "whole", "channels": [{{ "kind": "base_color", "color": {{ "linear": [0.2, 0.4, 0.6, 1] }} }}] }}"#
        )
    };
    let file = [
        r#"{ "layer": { "name": "metal", "group": "isolated", "blend": "multiply", "opacity": 0.5 } }"#
            .to_owned(),
        stroke(r#"{ "name": "rust", "within": "metal" }"#),
        stroke(r#"{ "name": "dirt", "within": "earth" }"#),
    ];
    replay(&mut painter, &strokes(&file.join(",")), baked.folder.path()).unwrap();
    let [metal, earth] = [1, 3].map(|k| painter.layers()[k].id());
    let expected = [("rust", Some(metal)), ("metal", None), ("dirt", Some(earth)), ("earth", None)];
    assert_eq!(listed(&painter), expected.map(|(name, parent)| (name.to_owned(), parent)));
    let group = &painter.layers()[1];
    assert_eq!((group.blend, group.opacity), (BlendMode::Multiply, 0.5));
    assert_eq!(painter.layers()[3].group_kind(), Some(GroupKind::PassThrough));

    let replayed = |text: &str| {
        let other = ball(4_000, BakeFormat::Bc7);
        let result = replay(&mut other.painter(), &strokes(text), other.folder.path());
        result.map_err(|error| error.to_string())
    };
    let refused = |text: String| replayed(&text).unwrap_err();
    let both = format!("{},{}", stroke(r#"{ "name": "a" }"#), stroke(r#"{ "name": "b", "within": "a" }"#));
    let sentence = refused(both);
    assert!(sentence.contains("within \"a\", which is a layer and no group"), "{sentence}");
    let sentence = refused(stroke(r#"{ "name": "a", "group": "pass_through" }"#));
    assert!(sentence.contains("\"a\" is a group of layers"), "{sentence}");
    let named = (0..=MAX_GROUP_DEPTH).map(|n| {
        let within = n.checked_sub(1).map_or(String::new(), |n| format!(r#", "within": "g{n}""#));
        format!(r#"{{ "layer": {{ "name": "g{n}", "group": "pass_through"{within} }} }}"#)
    });
    let mut deep: Vec<String> = named.collect();
    replayed(&deep.join(",")).unwrap();
    deep.push(format!(r#"{{ "layer": {{ "name": "deep", "within": "g{MAX_GROUP_DEPTH}" }} }}"#));
    let sentence = refused(deep.join(","));
    assert!(sentence.contains("16 deep at most"), "{sentence}");
}
