//! Cut-outs seen from afar: painting keeps their coverage at every level.

use std::sync::Arc;

use fantex_bake::{
    BakeFormat, BakeOptions, Fit, NoProgress, Prefilter, Source, SourceChannel, TexelPoint, bake,
};
use fantex_cover::{CoverOptions, MAX_BLOCK_SIDE, TexelBudget, build_cover};
use fantex_mesh::{AlphaMode, Material, Mesh, generate};
use fantex_paint::{
    Brush, ChannelPaint, FillArea, Layer, Paint, PaintColor, Painter, Sample, Size, Stroke, Symmetry, Target,
    Tool, dabs_of,
};
use fantex_store::{ChannelKind, VerifyOptions, group_pages, is_disk_full, verify};
use glam::{Vec2, Vec3, Vec4};

use crate::layers::paint_on;
use crate::{Baked, cleaned, contents, cover, open, red, sample};

/// Holes along each side of the grid, and their share of the surface: about ten texels apart, and half as wide.
const HOLES: u32 = 24;
const OPEN: f32 = std::f32::consts::PI * 0.25 * 0.25;

/// A grid of 2 x 2 whose triangles take alpha so, by turns.
fn grid(n: u32, alphas: &[AlphaMode]) -> Mesh {
    let mut mesh = cleaned(generate::grid(n));
    mesh.materials = alphas.iter().map(|&alpha| Material { alpha, ..Material::default() }).collect();
    mesh.triangle_materials =
        (0..mesh.triangles.len()).map(|triangle| (triangle % alphas.len()) as u32).collect();
    mesh
}

fn fence(alpha: AlphaMode) -> Baked {
    fence_of(&[alpha])
}

fn fence_of(alphas: &[AlphaMode]) -> Baked {
    let mesh = grid(8, alphas);
    Baked::new(&mesh, &cover(&mesh, 128, 60_000), BakeFormat::Float)
}

fn hole() -> Paint {
    let channels = vec![ChannelPaint::new(0, PaintColor::Constant(Vec4::ONE))];
    Paint { tool: Tool::Opacity { to: 0.0 }, opacity: 1.0, channels, stencil: None, sight: None }
}

/// Holes on a square lattice, as a stroke that is open.
fn begin_holes(painter: &mut Painter) {
    let surface = Arc::clone(painter.surface());
    painter.begin("holes", hole()).unwrap();
    let brush = Brush { size: Size::World(1.0 / HOLES as f32), hardness: 1.0, ..Brush::default() };
    let at = |i: u32| 2.0 * (i as f32 + 0.5) / HOLES as f32 - 1.0;
    for i in 0..HOLES * HOLES {
        let position = Vec3::new(at(i % HOLES), 0.0, at(i / HOLES));
        let samples = vec![Sample::at(surface.nearest(position, f32::INFINITY).unwrap())];
        let (brush, symmetry) = (brush.clone(), Symmetry::None);
        let stroke = Stroke { brush, stamp: None, samples, line: false, symmetry };
        painter.dab(&dabs_of(&surface, &stroke)).unwrap();
    }
}

fn punch_holes(painter: &mut Painter) {
    begin_holes(painter);
    painter.end().unwrap();
}

/// The share of the surface whose alpha is at least a half at a level.
fn covered(baked: &Baked, level: u32) -> f32 {
    covered_where(baked, level, 0.5, |_| true)
}

/// The share of some triangles whose alpha reaches a threshold at a level.
fn covered_where(baked: &Baked, level: u32, threshold: f32, counts: impl Fn(usize) -> bool) -> f32 {
    const STEPS: u32 = 23;
    let cache = baked.cache();
    let (mut there, mut all) = (0.0, 0.0);
    for triangle in (0..cache.asset().mesh().triangles.len()).filter(|&triangle| counts(triangle)) {
        for i in 0..STEPS {
            for j in 0..STEPS - i {
                let [a, b] = [i, j].map(|n| (n as f32 + 1.0 / 3.0) / STEPS as f32);
                let alpha = sample(&cache, 0, level, triangle, Vec3::new(a, b, 1.0 - a - b)).0.w;
                there += f32::from(u8::from(alpha >= threshold));
                all += 1.0;
            }
        }
    }
    there / all
}

/// Holes of five texels are finer than a texel from level 3 on, where the mean of alpha has none.
#[test]
fn painted_holes_keep_their_coverage_at_every_level() {
    for threshold in [0.5, 0.3] {
        let baked = fence(AlphaMode::Mask(threshold));
        let mut painter = baked.painter();
        let before = contents(&painter);
        punch_holes(&mut painter);
        let after = contents(&painter);
        painter.commit().unwrap();
        if threshold == 0.5 {
            let first = covered(&baked, 0);
            assert!((first - (1.0 - OPEN)).abs() < 0.06, "{first}");
            for level in 1..4 {
                let found = covered(&baked, level);
                assert!((found - first).abs() < 0.06, "level {level}: {found} of {first}");
            }
        }
        // As in a bake, the mean of a tile is about to pass.
        let asset = painter.editor().asset();
        let groups = 0..asset.cover().groups.len() as u32;
        assert!(groups.clone().any(|group| asset.mean(0, group)[3] > threshold));
        let near = groups.clone().filter(|&group| (asset.mean(0, group)[3] - threshold).abs() < 0.003);
        assert!(2 * near.count() > groups.len(), "{threshold}");
        assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
        while painter.undo().unwrap() {}
        assert!(contents(&painter) == before);
        while painter.redo().unwrap() {}
        assert!(contents(&painter) == after);
        // Made later they are the same.
        let again = fence(AlphaMode::Mask(threshold));
        let mut painter = again.painter();
        begin_holes(&mut painter);
        painter.end_in_background().unwrap();
        painter.finish_levels().unwrap();
        assert!(contents(&painter) == after);
    }
}

/// In the mean of alpha the holes close.
#[test]
fn other_materials_hold_the_mean() {
    use AlphaMode::{Blend, Opaque};
    for alphas in [&[Opaque][..], &[Blend], &[Blend, Opaque]] {
        let baked = fence_of(alphas);
        let mut painter = baked.painter();
        punch_holes(&mut painter);
        painter.commit().unwrap();
        assert!(covered(&baked, 3) > 0.97, "{alphas:?}");
    }
}

/// Where one tile shows several materials, each cut-out keeps its own coverage.
#[test]
fn materials_of_one_tile_keep_their_own_coverage() {
    use AlphaMode::{Blend, Mask, Opaque};
    let is_right = |mesh: &Mesh, triangle: usize| {
        let [a, b, c] = mesh.triangle_positions(triangle);
        a.x + b.x + c.x > 0.0
    };
    for (alphas, by_turns) in [
        ([Mask(0.5), Mask(0.3)], false),
        ([Mask(0.4), Blend], false),
        ([Mask(0.5), Opaque], false),
        // Opaque texels take the scale of those beside them.
        ([Mask(0.5), Opaque], true),
    ] {
        let mut mesh = grid(8, &alphas);
        if !by_turns {
            let sides = (0..mesh.triangles.len()).map(|triangle| u32::from(is_right(&mesh, triangle)));
            mesh.triangle_materials = sides.collect();
        }
        let cover = cover(&mesh, 256, 60_000);
        assert_eq!(cover.groups.len(), 1);
        let baked = Baked::new(&mesh, &cover, BakeFormat::Float);
        let mut painter = baked.painter();
        punch_holes(&mut painter);
        painter.commit().unwrap();
        for (material, alpha) in (0..).zip(alphas) {
            let AlphaMode::Mask(threshold) = alpha else { continue };
            let share = |level: u32| {
                covered_where(&baked, level, threshold, |triangle| {
                    mesh.triangle_materials[triangle] == material
                })
            };
            let first = share(0);
            assert!((first - (1.0 - OPEN)).abs() < 0.06, "{alpha:?} of {alphas:?}: {first}");
            // Where materials alternate, a triangle has eight texels of level 3, most of them at its border: 0.64 of 0.81 are covered there.
            let end = if by_turns { 3 } else { 4 };
            for level in 1..end {
                let found = share(level);
                assert!(
                    (found - first).abs() < 0.07,
                    "{alpha:?} of {alphas:?}, by turns {by_turns}, level {level}: {found} of {first}"
                );
            }
        }
        assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    }
}

/// Only tiles that a stroke touches are made anew.
#[test]
fn tiles_beside_the_stroke_keep_their_bytes() {
    let baked = fence(AlphaMode::Mask(0.5));
    let mut painter = baked.painter();
    punch_holes(&mut painter);
    let before = contents(&painter);
    paint_on(&mut painter, Target::Base, hole(), &[Vec3::new(0.9, 0.0, 0.9)]);
    let after = contents(&painter);
    let groups = |level_0: bool| {
        let pages = before.0.iter().zip(&after.0).filter(|(a, b)| (a.0.level == 0) == level_0 && a != b);
        let mut groups: Vec<u32> = pages.map(|(a, _)| a.0.group).collect();
        groups.dedup();
        groups
    };
    let touched = groups(true);
    assert!(groups(false).iter().all(|group| touched.contains(group)));
    assert!(touched.len() < painter.editor().asset().cover().groups.len());
}

/// Opaque discs on a square lattice.
struct Discs;

impl Source for Discs {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::BaseColor, has_alpha: true, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let place = Vec2::new(point.position.x, point.position.z) * 18.0;
        let distance = (place - place.floor() - 0.5).length();
        let color = Vec3::new(0.2 + 0.1 * point.position.x, 0.6, 0.1);
        values[0] = color.extend(f32::from(u8::from(distance < 0.3)));
    }
}

/// Discs in one tile of so many texels along each side.
fn discs(mesh: &Mesh, side: u32, fit: Fit) -> Baked {
    let budget = TexelBudget::Total(u64::from(side).pow(2));
    let options = CoverOptions { budget, tile: 2048, ..CoverOptions::default() };
    let (cover, _) = build_cover(mesh, &options).unwrap();
    assert_eq!(cover.groups.len(), 1);
    assert_eq!(cover.groups[0].extent.iter().any(|&n| n > MAX_BLOCK_SIDE), side > MAX_BLOCK_SIDE);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let options = BakeOptions { format: BakeFormat::Float, fit, ..BakeOptions::default() };
    bake(mesh, &cover, &Discs, &path, &options, &NoProgress).unwrap();
    Baked { path, folder }
}

/// A cut-out with an opaque square in its middle, away from the blocks at the tile's ends.
fn with_opaque_middle() -> Mesh {
    let mut mesh = grid(3, &[AlphaMode::Mask(0.4), AlphaMode::Opaque]);
    let is_in_middle = |triangle: usize| {
        let [a, b, c] = mesh.triangle_positions(triangle);
        let center = (a + b + c) / 3.0;
        center.x.abs() < 0.3 && center.z.abs() < 0.3
    };
    mesh.triangle_materials = (0..mesh.triangles.len()).map(|t| u32::from(is_in_middle(t))).collect();
    assert_eq!(mesh.triangle_materials.iter().sum::<u32>(), 2);
    mesh
}

/// Where painting makes the coarser levels of a baked tile anew, they are those that the bake made: of a cut-out, of one that shows
/// something opaque or other cut-outs, too, and of tiles that are cut into blocks.
#[test]
fn painted_levels_are_those_of_a_bake() {
    use AlphaMode::{Blend, Mask};
    for side in [200, 1300] {
        for mesh in [grid(3, &[Mask(0.4)]), with_opaque_middle(), grid(3, &[Mask(0.4), Mask(0.7), Blend])] {
            assert_levels_of_a_bake(&mesh, side);
        }
    }
}

fn assert_levels_of_a_bake(mesh: &Mesh, side: u32) {
    let baked = discs(mesh, side, Fit::Point);
    let mut painter = baked.painter();
    let texels = |painter: &Painter| -> Vec<_> {
        let editor = painter.editor();
        let ids = group_pages(0, &editor.asset().cover().groups[0]);
        ids.map(|id| (id, editor.read_page(0, id).unwrap().rgba)).collect()
    };
    let before = texels(&painter);
    // A stroke everywhere that changes no texel of level 0.
    let channels = vec![ChannelPaint::new(0, PaintColor::Constant(Vec4::ONE))];
    painter.begin("nothing", Paint { opacity: 0.0, channels, ..red(0.0) }).unwrap();
    painter.fill(FillArea::Everything).unwrap();
    for ((id, before), (_, after)) in before.iter().zip(texels(&painter)) {
        for (texel, (a, b)) in before.iter().zip(after).enumerate() {
            let difference = (Vec4::from(*a) - Vec4::from(b)).abs().max_element();
            assert!(difference < 1e-5, "side {side}, page {id}, texel {texel}: {a:?} {b:?}");
        }
    }
    let levels = before.iter().map(|(id, _)| id.level).max().unwrap();
    assert!(levels >= 4);
}

/// Hidden layers give back the bytes of the base at all levels, and shown ones come back.
#[test]
fn layers_over_cut_outs_go_without_a_trace() {
    let baked = fence(AlphaMode::Mask(0.5));
    let mut painter = baked.painter();
    punch_holes(&mut painter);
    let base = contents(&painter);
    let layer = painter.add_layer(Layer::painted("patch")).unwrap();
    let line = [Vec3::new(-0.6, 0.0, -0.5), Vec3::new(0.6, 0.0, 0.2)];
    let mut paint = red(1.0);
    paint.channels.truncate(1);
    paint_on(&mut painter, Target::Layer(layer), paint, &line);
    let shown = contents(&painter);
    assert!(shown != base);
    let show = |painter: &mut Painter, opacity: f32| {
        painter.edit_layers("fade", |layers| layers[0].opacity = opacity).unwrap();
        contents(painter)
    };
    assert!(show(&mut painter, 0.0) == base);
    assert!(show(&mut painter, 0.6) != shown);
    assert!(show(&mut painter, 1.0) == shown);
    // Below it, too, the base keeps its coverage: once the layer is gone, it is as if it had never been there.
    paint_on(&mut painter, Target::Base, hole(), &line);
    painter.edit_layers("delete", Vec::clear).unwrap();
    let with_layer = contents(&painter);
    let alone = fence(AlphaMode::Mask(0.5));
    let mut other = alone.painter();
    punch_holes(&mut other);
    paint_on(&mut other, Target::Base, hole(), &line);
    assert!(contents(&other) == with_layer);
    while painter.undo().unwrap() {}
    assert!(contents(&painter) == contents(&fence(AlphaMode::Mask(0.5)).painter()));
}

/// The same of layers over different blocks of a large tile, whose first levels are made block by block: what is shown does not depend on
/// which of them were shown before, nor on how much memory there is.
#[test]
fn layers_over_blocks_of_a_cut_out_go_without_a_trace() {
    // Levels of a fitted bake are not those that painting makes of it.
    let baked = discs(&grid(3, &[AlphaMode::Mask(0.4)]), 1300, Fit::Sharp);
    let alone = Baked { path: baked.folder.path().join("alone.fan"), folder: tempfile::tempdir().unwrap() };
    std::fs::copy(&baked.path, &alone.path).unwrap();
    let mut painter = baked.painter();
    let base = contents(&painter);
    let [one, two] = [Vec3::new(0.9, 0.0, 0.9), Vec3::new(-0.9, 0.0, -0.9)];
    let paint_layer = |painter: &mut Painter, place: Vec3| {
        let layer = painter.add_layer(Layer::painted("patch")).unwrap();
        let mut paint = red(1.0);
        paint.channels.truncate(1);
        paint_on(painter, Target::Layer(layer), paint, &[place]);
        contents(painter)
    };
    let with_one = paint_layer(&mut painter, one);
    let with_both = paint_layer(&mut painter, two);
    let show = |painter: &mut Painter, shown: [bool; 2]| {
        let change = |layers: &mut Vec<Layer>| {
            layers.iter_mut().zip(shown).for_each(|(layer, is_shown)| layer.visible = is_shown);
        };
        painter.edit_layers("show", change).unwrap();
        contents(painter)
    };
    assert!(with_one != base && with_both != with_one);
    assert!(show(&mut painter, [true, false]) == with_one);
    assert!(show(&mut painter, [false, false]) == base);
    let with_two = show(&mut painter, [false, true]);
    assert!(show(&mut painter, [true, true]) == with_both);
    assert!(show(&mut painter, [false, true]) == with_two);
    assert!(show(&mut painter, [true, true]) == with_both);
    // What is painted below them is there when they are gone, as if they had never been.
    let line = [one, Vec3::new(0.9, 0.0, -0.9)];
    paint_on(&mut painter, Target::Base, hole(), &line);
    painter.edit_layers("delete", Vec::clear).unwrap();
    let mut other = open(&alone);
    paint_on(&mut other, Target::Base, hole(), &line);
    assert!(contents(&painter) == contents(&other));
    while painter.undo().unwrap() {}
    assert!(contents(&painter) == base);
}

/// Where the disk is full, neither levels nor materials nor the history change, and later the same can be asked for again.
#[test]
fn changes_of_alpha_that_fail_can_be_repeated() {
    let start = || {
        let baked = fence(AlphaMode::Opaque);
        let mut painter = baked.painter();
        punch_holes(&mut painter);
        paint_on(&mut painter, Target::Base, hole(), &[Vec3::ZERO]);
        assert!(painter.undo().unwrap());
        painter.commit().unwrap();
        (baked, painter)
    };
    let (_baked, mut painter) = start();
    let before = contents(&painter);
    let modes = |painter: &Painter| -> Vec<AlphaMode> {
        painter.editor().asset().mesh().materials.iter().map(|material| material.alpha).collect()
    };
    let steps = |painter: &Painter| (painter.history().done().to_vec(), painter.history().undone().to_vec());
    let known = steps(&painter);
    assert_eq!((known.0.len(), known.1.len()), (1, 1));
    painter.limit_file(Some(0));
    let error = painter.set_alpha_mode(AlphaMode::Mask(0.5)).unwrap_err();
    assert!(is_disk_full(&error), "{error}");
    assert!(contents(&painter) == before);
    assert_eq!(steps(&painter), known);
    assert_eq!(modes(&painter), [AlphaMode::Opaque]);
    assert!(!painter.is_disk_full(), "there is nothing to be written");
    painter.limit_file(None);
    painter.set_alpha_mode(AlphaMode::Mask(0.5)).unwrap();
    let (_other, mut other) = start();
    other.set_alpha_mode(AlphaMode::Mask(0.5)).unwrap();
    assert!(contents(&painter) == contents(&other) && contents(&painter) != before);
    assert_eq!(modes(&painter), [AlphaMode::Mask(0.5)]);
    assert_eq!(painter.history().done().len(), 2);
    assert!(painter.undo().unwrap());
    assert!(contents(&painter) == before);
}

/// Materials that become cut-outs after holes were painted: coarser levels follow, as a step of their own.
#[test]
fn levels_follow_what_materials_make_of_alpha() {
    let baked = fence(AlphaMode::Opaque);
    let mut painter = baked.painter();
    painter.set_alpha_mode(AlphaMode::Mask(0.5)).unwrap();
    assert!(painter.history().done().is_empty(), "there was no opacity to show");
    painter.set_alpha_mode(AlphaMode::Opaque).unwrap();
    punch_holes(&mut painter);
    let before = contents(&painter);
    painter.set_alpha_mode(AlphaMode::Mask(0.5)).unwrap();
    assert_eq!(painter.history().done().len(), 2);
    let first = covered(&baked, 0);
    for level in 1..4 {
        let found = covered(&baked, level);
        assert!((found - first).abs() < 0.06, "level {level}: {found} of {first}");
    }
    // Painted before or after, it is the same.
    let other = fence(AlphaMode::Mask(0.5));
    let mut told = other.painter();
    punch_holes(&mut told);
    told.commit().unwrap();
    let [one, other] = [&baked, &other].map(Baked::cache);
    for triangle in 0..one.asset().mesh().triangles.len() {
        for level in 1..4 {
            let [a, b] =
                [&one, &other].map(|cache| sample(cache, 0, level, triangle, Vec3::splat(1.0 / 3.0)).0);
            assert!((a - b).abs().max_element() < 1e-3, "triangle {triangle}, level {level}: {a} {b}");
        }
    }
    painter.set_alpha_mode(AlphaMode::Blend).unwrap();
    assert!(covered(&baked, 3) > 0.97);
    assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    assert!(painter.undo().unwrap() && painter.undo().unwrap());
    assert!(contents(&painter) == before);
    assert_eq!(painter.editor().asset().mesh().materials[0].alpha, AlphaMode::Blend);
}
