//! Strokes onto baked assets.

use std::sync::Arc;

use fantex_bake::{BakeFormat, BakeOptions, NoProgress, Prefilter, Source, SourceChannel, TexelPoint, bake};
use fantex_mesh::{generate, shading_normals};
use fantex_paint::{
    ChannelPaint, FillArea, FillSettings, Layer, MaskMeasure, Paint, PaintColor, PaintOptions, Painter, Size,
    StrokeFile, StrokeLog, Symmetry, Target, Tool, dabs_of, fill_triangles, replay,
};
use fantex_store::{
    Asset, AssetEditor, ChannelKind, EditOptions, JUMP_BOUND, PageCache, TileId, TileSource, TileTexels,
    VerifyOptions, verify,
};
use fantex_texture::Image;
use glam::{Vec3, Vec4};

use crate::{
    Baked, ball, cleaned, contents, cover, data_folder, loaded, paint_stroke, plate, red, run, sample,
    stroke, strokes,
};

/// Over the ball, through many tiles.
fn arc() -> Vec<Vec3> {
    (0..9).map(|i| Vec3::new((0.25 * i as f32).cos(), 0.5, (0.25 * i as f32).sin())).collect()
}

#[test]
fn tiles_agree_under_a_stroke_and_the_certificate_holds() {
    let baked = ball(300_000, BakeFormat::Float);
    let mut painter = baked.painter();
    let arc = stroke(painter.surface(), 60.0, &arc());
    paint_stroke(&mut painter, red(1.0), &arc);
    painter.commit().unwrap();
    let report = verify(&baked.path, &VerifyOptions::default()).unwrap();
    assert!(report.ok && report.continuity.largest_jump <= JUMP_BOUND, "{report:?}");
    let cache = baked.cache();
    let mesh = cache.asset().mesh();
    let (mut overlaps, mut red, mut worst) = (0, 0, 0.0f32);
    for triangle in 0..mesh.triangles.len() {
        for lambda in [Vec3::new(0.5, 0.5, 0.0), Vec3::new(0.1, 0.46, 0.44), Vec3::splat(1.0 / 3.0)] {
            let (value, parts) = sample(&cache, 0, 0, triangle, lambda);
            red += u32::from(value.x > 0.8);
            for part in &parts {
                overlaps += u32::from(parts.len() > 1);
                worst = worst.max((*part - value).abs().max_element());
            }
        }
    }
    assert!(overlaps > 500 && red > 100, "{overlaps} {red}");
    assert!(worst < 1.0 / 255.0, "{worst}");
}

#[test]
fn a_stroke_covers_at_most_its_opacity() {
    let baked = ball(60_000, BakeFormat::Float);
    let mut painter = baked.painter();
    let mut back_and_forth = arc();
    back_and_forth.extend(arc().into_iter().rev());
    let arc = stroke(painter.surface(), 40.0, &back_and_forth);
    let before = contents(&painter);
    paint_stroke(&mut painter, red(0.5), &arc);
    let editor = painter.editor();
    let mut most = 0.0f32;
    for (i, (id, old)) in before.0.iter().enumerate() {
        if i % 2 == 0 && id.level == 0 {
            let old = editor.asset().decode_page_raw(0, *id, old).unwrap();
            let new = editor.read_page(0, *id).unwrap();
            for (old, new) in old.rgba.iter().zip(&new.rgba) {
                let (old, new) = (Vec4::from(*old), Vec4::from(*new));
                most = most.max((new.x - old.x) / (0.9 - old.x));
            }
        }
    }
    assert!((0.499..0.5001).contains(&most), "{most}");
}

#[test]
fn undo_gives_back_every_byte_and_survives_a_restart() {
    for format in [BakeFormat::Bc7, BakeFormat::Rgba8] {
        let baked = ball(80_000, format);
        let mut painter = baked.painter();
        let mut states = vec![contents(&painter)];
        for turn in 0..3 {
            let moved: Vec<Vec3> = arc().iter().map(|p| p.with_y(0.4 * turn as f32 - 0.5)).collect();
            let arc = stroke(painter.surface(), 30.0, &moved);
            paint_stroke(&mut painter, red(0.8), &arc);
            states.push(contents(&painter));
        }
        assert!(states.windows(2).all(|pair| pair[0] != pair[1]));
        painter.commit().unwrap();
        drop(painter);
        let mut painter = baked.painter();
        assert_eq!(painter.history().done().len(), 3);
        for state in states[..3].iter().rev() {
            assert!(painter.undo().unwrap());
            assert!(contents(&painter) == *state, "{format:?}");
        }
        assert!(!painter.undo().unwrap());
        painter.commit().unwrap();
        drop(painter);
        let mut painter = baked.painter();
        for state in &states[1..] {
            assert!(painter.redo().unwrap());
            assert!(contents(&painter) == *state, "{format:?}");
        }
        assert!(!painter.redo().unwrap());
        // A new stroke ends what could be redone.
        assert!(painter.undo().unwrap());
        let arc = stroke(painter.surface(), 30.0, &arc());
        paint_stroke(&mut painter, red(0.3), &arc);
        assert!(!painter.redo().unwrap());
    }
}

#[test]
fn only_pages_under_the_brush_change() {
    let baked = ball(200_000, BakeFormat::Bc7);
    let mut painter = baked.painter();
    let before = contents(&painter);
    let dot = stroke(painter.surface(), 20.0, &[Vec3::new(0.1, 1.0, 0.2)]);
    let surface = Arc::clone(painter.surface());
    painter.begin("dot", red(1.0)).unwrap();
    painter.dab(&dabs_of(&surface, &dot)).unwrap();
    let shown = painter.show().unwrap();
    let summary = painter.end().unwrap();
    assert_eq!((summary.dabs, summary.pages), (1, shown.len()));
    let after = contents(&painter);
    let changed: Vec<_> = before.0.iter().zip(&after.0).filter(|(a, b)| a != b).map(|(a, _)| a.0).collect();
    assert!(!changed.is_empty() && changed.len() <= 6 * 2 * shown.len(), "{changed:?}");
    assert!(changed.iter().all(|id| shown.iter().any(|page| page.group == id.group)));
    // Blocks away from the dab keep their bytes.
    let page = before.0.iter().zip(&after.0).find(|(a, b)| a != b && a.0.level == 0).unwrap();
    let same = page.0.1.chunks(16).zip(page.1.1.chunks(16)).filter(|(a, b)| a == b).count();
    assert!(same > 0);
}

/// What the screen shows dab by dab is what a replay gives at once.
#[test]
fn showing_every_dab_changes_nothing() {
    let [a, b] = [0, 1].map(|_| ball(100_000, BakeFormat::Bc7));
    let [mut every, mut once] = [a.painter(), b.painter()];
    let surface = Arc::clone(every.surface());
    let mut line = stroke(&surface, 40.0, &arc());
    line.brush.flow = 0.3;
    let dabs = dabs_of(&surface, &line);
    every.begin("stroke", red(0.8)).unwrap();
    for dab in &dabs {
        every.dab(std::slice::from_ref(dab)).unwrap();
        every.show().unwrap();
    }
    every.end().unwrap();
    paint_stroke(&mut once, red(0.8), &line);
    assert!(contents(&every) == contents(&once));
}

#[test]
fn paint_stays_on_its_side_of_a_plate() {
    let mesh = plate(12, 0.002);
    let baked = Baked::new(&mesh, &cover(&mesh, 64, 100_000), BakeFormat::Float);
    let before = baked.cache();
    let mut painter = baked.painter();
    let line = stroke(painter.surface(), 40.0, &[Vec3::new(-0.4, 0.1, 0.0), Vec3::new(0.4, 0.1, 0.1)]);
    paint_stroke(&mut painter, red(1.0), &line);
    painter.commit().unwrap();
    let after = baked.cache();
    let mesh = after.asset().mesh();
    let mut painted = 0;
    for triangle in 0..mesh.triangles.len() {
        let lambda = Vec3::splat(1.0 / 3.0);
        let [old, new] = [&before, &after].map(|cache| sample(cache, 0, 0, triangle, lambda).0);
        let is_top = painter.surface().facet_normal(triangle as u32).y > 0.5;
        painted += u32::from(is_top && old.distance(new) > 0.1);
        assert!(is_top || old == new, "the other side of triangle {triangle} changed");
    }
    assert!(painted > 10, "{painted}");
}

#[test]
fn a_fill_reaches_all_levels_and_means() {
    let mesh = cleaned(generate::icosphere(3));
    for (tile, texels) in [(64, 40_000), (0, 40_000), (512, 1_500_000)] {
        let baked = Baked::new(&mesh, &cover(&mesh, tile, texels), BakeFormat::Rgba8);
        let mut painter = baked.painter();
        let start = painter.surface().nearest(Vec3::X, f32::INFINITY).unwrap();
        let all = fill_triangles(painter.surface(), start, FillSettings::Connected);
        assert_eq!(all.len(), mesh.triangles.len());
        painter.begin("fill", red(1.0)).unwrap();
        painter.fill(FillArea::Triangles(all)).unwrap();
        painter.commit().unwrap();
        let cache = baked.cache();
        let levels = cache.asset().level_count();
        for triangle in (0..mesh.triangles.len()).step_by(7) {
            for level in 0..levels {
                let (value, _) = sample(&cache, 0, level, triangle, Vec3::new(0.2, 0.3, 0.5));
                let expected = Vec4::new(0.9, 0.05, 0.05, 1.0);
                assert!((value - expected).abs().max_element() < 0.005, "level {level}: {value}");
            }
        }
        let mean = Vec4::from(cache.asset().mean(1, 0));
        assert!((mean - Vec4::new(1.0, 0.1, 1.0, 1.0)).abs().max_element() < 0.005, "{mean}");
        let with_texels = VerifyOptions { texels: true, ..VerifyOptions::default() };
        assert!(verify(&baked.path, &with_texels).unwrap().ok);
    }
}

#[test]
fn a_fill_by_angle_ends_at_edges() {
    let mesh = cleaned(generate::cube(4));
    let baked = Baked::new(&mesh, &cover(&mesh, 64, 20_000), BakeFormat::Rgba8);
    let painter = baked.painter();
    let start = painter.surface().hit(Vec3::new(0.1, 2.0, 0.1), Vec3::NEG_Y).unwrap();
    let face = fill_triangles(painter.surface(), start, FillSettings::Angle(30.0));
    assert_eq!(face.len(), mesh.triangles.len() / 6);
    assert!(face.iter().all(|&t| painter.surface().facet_normal(t).y > 0.9));
}

#[test]
fn symmetric_strokes_have_their_copies() {
    let baked = ball(60_000, BakeFormat::Rgba8);
    let painter = baked.painter();
    let surface = painter.surface();
    let mut line = stroke(surface, 20.0, &arc()[..3]);
    let one = dabs_of(surface, &line);
    line.symmetry = Symmetry::Mirror { axis: 0, offset: 0.0 };
    let two = dabs_of(surface, &line);
    assert_eq!(two.len(), 2 * one.len());
    for (a, b) in two[..one.len()].iter().zip(&two[one.len()..]) {
        let [p, q] = [a, b].map(|dab| surface.position(dab.center));
        assert!((p.x + q.x).abs() < 0.01 && (p.y - q.y).abs() < 0.01 && (p.z - q.z).abs() < 0.01, "{p} {q}");
    }
    line.symmetry = Symmetry::Radial { axis: 1, center: [0.0; 3], count: 5 };
    let five = dabs_of(surface, &line);
    assert!(five.len().abs_diff(5 * one.len()) <= 5, "{} {}", five.len(), one.len());
}

#[test]
fn dabs_are_evenly_spaced_along_the_surface() {
    let baked = ball(60_000, BakeFormat::Rgba8);
    let painter = baked.painter();
    let surface = painter.surface();
    let mut line = stroke(surface, 20.0, &arc());
    line.brush.spacing = 0.25;
    let dabs = dabs_of(surface, &line);
    let spacing = 5.0 / f64::from(surface.cover().density);
    assert!(dabs.len() > 20);
    for pair in dabs.windows(2) {
        let [p, q] = [0, 1].map(|k| surface.position(pair[k].center));
        assert!((p.distance(q) / spacing - 1.0).abs() < 0.05, "{}", p.distance(q) / spacing);
    }
    // Jitter moves them, the same way every time.
    line.brush.jitter.position = 0.5;
    line.brush.size = Size::World(0.05);
    let moved = dabs_of(surface, &line);
    let again = dabs_of(surface, &line);
    assert!(moved.iter().zip(&again).all(|(a, b)| a.center == b.center));
    line.brush.seed = 9;
    assert!(moved.iter().zip(&dabs_of(surface, &line)).any(|(a, b)| a.center != b.center));
}

const STROKES: &str = r#"{
  "version": 1,
  "strokes": [
    { "label": "line", "brush": { "size": { "texels": 30 }, "flow": 0.4, "jitter": { "position": 0.3, "size": 0.5 } },
      "channels": [{ "kind": "base_color", "color": { "srgb": [0.1, 0.3, 0.9] } },
                   { "kind": "occlusion_roughness_metallic", "color": { "linear": [1, 0.2, 0, 1] } }],
      "samples": [{ "at": { "position": [1, 0, 0] } }, { "at": { "position": [0, 1, 0] }, "pressure": 0.4 },
                  { "at": { "position": [-1, 0.2, 0.3] } }] },
    { "label": "marble", "brush": { "size": { "world": 0.5 } }, "tool": { "paint": "multiply" },
      "layer": { "name": "stones", "blend": "overlay", "opacity": 0.7 },
      "channels": [{ "kind": "base_color", "color": { "solid": { "name": "marble" } } }],
      "samples": [{ "at": { "ray": { "origin": [0, 0, 9], "direction": [0, 0, -1] } } }] },
    { "label": "cap", "fill": { "angle": 12 }, "tool": { "paint": "screen" },
      "channels": [{ "kind": "base_color", "color": { "linear": [0.0, 0.2, 0.0, 1.0] } }],
      "samples": [{ "at": { "position": [0, -1, 0] } }] }
  ]
}"#;

#[test]
fn a_replay_is_the_same_on_any_number_of_threads_and_in_any_memory() {
    let file: StrokeFile = serde_json::from_str(STROKES).unwrap();
    let baked = ball(150_000, BakeFormat::Bc7);
    let mut results = Vec::new();
    for (threads, memory_bytes) in [(1, 512 << 20), (4, 512 << 20), (2, 600 << 10)] {
        let path = baked.folder.path().join("copy.fan");
        std::fs::copy(&baked.path, &path).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (summary, texels) = pool.install(|| {
            let options = PaintOptions { memory_bytes, history: true };
            let mut painter = Painter::open(&path, &options).unwrap();
            let summary = replay(&mut painter, &file, baked.folder.path()).unwrap();
            painter.commit().unwrap();
            (summary, contents(&painter))
        });
        assert_eq!(summary.strokes, 3);
        assert!(summary.dabs > 20 && summary.pages > 10, "{summary:?}");
        assert!(verify(&path, &VerifyOptions::default()).unwrap().ok);
        results.push((std::fs::read(&path).unwrap(), texels));
    }
    assert!(results[0].0 == results[1].0, "the files differ");
    assert!(results[0].1 == results[2].1, "texels differ");
}

#[test]
fn strokes_that_touch_nothing_are_listed() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let beside = STROKES.replace("\"origin\": [0, 0, 9]", "\"origin\": [0, 5, 9]");
    let file: StrokeFile = serde_json::from_str(&beside).unwrap();
    let summary = replay(&mut painter, &file, baked.folder.path()).unwrap();
    assert_eq!((summary.strokes, summary.missed_samples), (3, 1));
    assert_eq!(summary.untouching, [(1, "marble".to_owned())]);
}

#[test]
fn a_blur_has_no_negative_radius() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let text = STROKES.replace("\"paint\": \"multiply\"", "\"blur\": { \"radius\": { \"texels\": -3 } }");
    let file: StrokeFile = serde_json::from_str(&text).unwrap();
    let message = replay(&mut painter, &file, baked.folder.path()).unwrap_err().to_string();
    assert_eq!(message, "stroke 1: `tool.blur.radius` is -3, but must be at least 0");
    assert!(!painter.editor().has_changes(), "nothing was applied");
}

#[test]
fn mistakes_in_stroke_files_are_named() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let mut wrong = |from: &str, to: &str| {
        let text = STROKES.replacen(from, to, 1);
        assert_ne!(text, STROKES);
        match serde_json::from_str::<StrokeFile>(&text) {
            Ok(file) => replay(&mut painter, &file, baked.folder.path()).unwrap_err().to_string(),
            Err(error) => error.to_string(),
        }
    };
    for (from, to, expected) in [
        ("base_color", "emission", "stroke 0 paints the channel emission, which the asset does not have"),
        (
            "base_color",
            "emission",
            "\"add_channels\": [\"emission\"] in the stroke file or with --add-channel emission",
        ),
        ("base_color", "light", "only a bake makes it"),
        ("occlusion_roughness_metallic", "base_color", "channel base_color twice"),
        ("\"marble\"}", "\"cheese\"}", "cheese"),
        ("\"texels\": 30", "\"texels\": -3", "above 0"),
        ("\"flow\"", "\"flou\"", "unknown field"),
        (
            "\"position\": [1, 0, 0]",
            "\"point\": {\"triangle\": 99999, \"lambda\": [1, 0, 0]}",
            "sample 0 of stroke 0 is no point of the surface: it names triangle 99999, but the mesh has 5120, counted from 0",
        ),
        (
            "\"position\": [1, 0, 0]",
            "\"point\": {\"triangle\": 7, \"lambda\": [1, 0.5, 0]}",
            "its barycentric coordinates in triangle 7, 1, 0.5, 0, must be at least 0 and add up to 1",
        ),
    ] {
        let from = if from.contains('}') { "\"marble\" }" } else { from };
        let to = to.replace("\"cheese\"}", "\"cheese\" }");
        let message = wrong(from, &to);
        assert!(message.contains(expected), "{message}");
    }
    assert!(!painter.editor().has_changes(), "nothing was applied");
}

#[test]
fn only_strokes_that_make_layers_need_no_channels() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let mut replayed = |stroke: &str| {
        replay(&mut painter, &strokes(stroke), baked.folder.path()).map_err(|error| error.to_string())
    };
    let layer = r#""layer": { "name": "a" }"#;
    let samples = r#""samples": [{ "at": { "position": [0, 0, 1] } }]"#;
    for stroke in [
        samples,
        r#""tool": "erase""#,
        r#""fill": "whole""#,
        r#""dabs": [{ "at": { "position": [0, 0, 1] }, "radius": 0.1, "hardness": 1, "flow": 1 }]"#,
        &format!("{layer}, {samples}"),
    ] {
        let message = replayed(&format!("{{ {stroke} }}")).unwrap_err();
        assert!(
            message.starts_with("stroke 0 names no channel") && message.contains("base_color"),
            "{message}"
        );
    }
    for stroke in [layer, r#""set_layers": []"#, r#""unrecorded": true"#] {
        replayed(&format!("{{ {stroke} }}")).unwrap();
    }
}

#[test]
fn colours_are_opaque_at_most() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let before = contents(&painter);
    for (alpha, is_allowed) in [("1", true), ("0", true), ("1.5", false), ("-0.5", false)] {
        let color = format!(r#"{{ "linear": [0.2, 0.2, 0.2, {alpha}] }}"#);
        let text =
            format!(r#"{{ "fill": "whole", "channels": [{{ "kind": "base_color", "color": {color} }}] }}"#);
        let replayed = replay(&mut painter, &strokes(&text), baked.folder.path());
        let expected = format!("stroke 0: `channels[0].color.linear[3]` is {alpha}, but must be 0 to 1");
        assert_eq!(
            replayed.map(|_| ()).map_err(|error| error.to_string()),
            match is_allowed {
                true => Ok(()),
                false => Err(expected),
            }
        );
        while painter.undo().unwrap() {}
    }
    // What comes from programs is cut off.
    let line = stroke(painter.surface(), 60.0, &[Vec3::X, Vec3::Y]);
    let with_alpha = |alpha| Paint {
        channels: vec![ChannelPaint::new(0, PaintColor::Constant(Vec4::new(0.2, 0.2, 0.2, alpha)))],
        ..red(1.0)
    };
    let painted = [1.0, 3.0].map(|alpha| {
        paint_stroke(&mut painter, with_alpha(alpha), &line);
        let painted = contents(&painter);
        assert!(painter.undo().unwrap());
        painted
    });
    assert!(painted[0] != before && painted[0] == painted[1]);
}

#[test]
fn values_that_mean_nothing_are_refused() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let mut replayed = |rest: &str| {
        let text = format!(r#"{{ "channels": [{{ "kind": "base_color" }}], {rest} }}"#);
        replay(&mut painter, &strokes(&text), baked.folder.path()).map_err(|error| error.to_string())
    };
    let mut layer = Layer::painted("a");
    layer.mask_source = Some(MaskMeasure::Slope { axis: 4 }.source());
    let layers = format!(r#""set_layers": {}"#, serde_json::to_string(&[layer]).unwrap());
    let somewhere = r#""samples": [{ "at": { "position": [0, 0, 1] } }]"#;
    let not_an_axis = "but must be 0 (x), 1 (y) or 2 (z)";
    for (rest, key, expected) in [
        (r#""symmetry": { "mirror": { "axis": 3 } }"#, "symmetry.mirror.axis` is 3", not_an_axis),
        (r#""symmetry": { "radial": { "axis": 7, "count": 2 } }"#, "symmetry.radial.axis` is 7", not_an_axis),
        (r#""symmetry": { "radial": { "axis": 1, "count": 0 } }"#, "radial.count` is 0", "1 to 256"),
        (r#""symmetry": { "radial": { "axis": 1, "count": 257 } }"#, "radial.count` is 257", "1 to 256"),
        (layers.as_str(), "mask_source.by.slope.axis` is 4", not_an_axis),
    ] {
        let message = replayed(&format!("{rest}, {somewhere}")).unwrap_err();
        assert!(message.starts_with("stroke 0: `") && message.contains(key), "{message}");
        assert!(message.contains(expected), "{message}");
    }
    for (brush, what) in [
        (r#""hardness": 7"#, "hardness is 7"),
        (r#""opacity": -0.5"#, "opacity is -0.5"),
        (r#""flow": 1.5"#, "flow is 1.5"),
    ] {
        let message = replayed(&format!(r#""brush": {{ {brush} }}, {somewhere}"#)).unwrap_err();
        assert!(message.contains(what) && message.contains("from 0 to 1"), "{message}");
    }
    let mut faint = Layer::painted("a");
    faint.opacity = 7.0;
    let faint = format!(r#""set_layers": {}"#, serde_json::to_string(&[faint]).unwrap());
    let dab = |rest: &str| format!(r#""dabs": [{{ "at": {{ "position": [0, 0, 1] }}, {rest} }}]"#);
    let cases = [
        (r#""layer": { "name": "a", "opacity": 7 }"#.to_owned(), "`layer.opacity` is 7, but must be 0 to 1"),
        (
            r#""layer": { "name": "a", "opacity": -3 }"#.to_owned(),
            "`layer.opacity` is -3, but must be 0 to 1",
        ),
        (faint, "`set_layers[0].opacity` is 7, but must be 0 to 1"),
        (
            r#""tool": { "smudge": { "strength": 3 } }"#.to_owned(),
            "`tool.smudge.strength` is 3, but must be 0 to 1",
        ),
        (r#""tool": { "opacity": -1 }"#.to_owned(), "`tool.opacity` is -1, but must be 0 to 1"),
        (r#""fill": { "angle": 400 }"#.to_owned(), "`fill.angle` is 400, but must be 0 to 180"),
        (
            r#""text": { "text": "a", "size": { "world": 0 } }"#.to_owned(),
            "`text.size` is 0, but must be finite and above 0",
        ),
        (r#""brush": { "smoothing": 1.5 }"#.to_owned(), "`brush.smoothing` is 1.5, but must be 0 to 1"),
        (
            dab(r#""radius": -1, "hardness": 1, "flow": 1"#),
            "`dabs[0].radius` is -1, but must be finite and at least 0",
        ),
        (
            dab(r#""radius": 1, "hardness": 1, "flow": 1, "aspect": 0"#),
            "`dabs[0].aspect` is 0, but must be above 0 and at most 1",
        ),
    ];
    for (rest, expected) in cases {
        assert_eq!(replayed(&format!("{rest}, {somewhere}")).unwrap_err(), format!("stroke 0: {expected}"));
    }
    for (moves, expected) in [
        (r#"[{ "copy": [7, 9] }]"#, "there is no layer number 7 to be copied"),
        (r#"[{ "merge": [3, 4] }]"#, "there is no layer number 3 to be merged"),
    ] {
        let message = replayed(&format!(r#""set_layers": [], "layer_moves": {moves}"#)).unwrap_err();
        assert!(message.starts_with("stroke 0") && message.contains(expected), "{message}");
    }
    let message = replayed(&format!(r#""layer_moves": [{{ "copy": [0, 1] }}], {somewhere}"#)).unwrap_err();
    assert!(message.starts_with("stroke 0: `layer_moves`") && message.contains("`set_layers`"), "{message}");
    // The ends of ranges.
    for rest in [
        r#""fill": { "angle": 180 }"#,
        r#""tool": { "smudge": { "strength": 1 } }"#,
        r#""brush": { "smoothing": 1, "jitter": { "position": 3, "size": 1 } }"#,
    ] {
        assert_eq!(replayed(&format!("{rest}, {somewhere}")).unwrap().strokes, 1);
    }
    for rest in [r#""samples": []"#, r#""line": true"#, r#""fill": "connected""#] {
        let message = replayed(rest).unwrap_err();
        assert!(message.contains("stroke 0: `samples` is [], but must name at least one place"), "{message}");
    }
    // These need no sample.
    for rest in [
        r#""fill": "whole", "samples": []"#,
        r#""dabs": [{ "at": { "position": [0, 0, 1] }, "radius": 0.1, "hardness": 1, "flow": 1 }]"#,
    ] {
        assert_eq!(replayed(rest).unwrap().strokes, 1);
    }
}

/// The log has samples where they met the surface, and so none of this stroke.
#[test]
fn a_log_with_a_stroke_that_met_nothing_is_replayed() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let beside = r#"{ "ray": { "origin": [0, 9, 9], "direction": [0, 0, -1] } }"#;
    let stroke = format!(
        r#"{{ "layer": {{ "name": "a" }}, "channels": [{{ "kind": "base_color" }}], "samples": [{{ "at": {beside} }}] }}"#
    );
    drop(run(&baked, &stroke));
    let log = StrokeLog::of(&Asset::open(&baked.path).unwrap()).unwrap();
    assert!(log.strokes.strokes.iter().any(|stroke| stroke.layer.is_some() && stroke.samples.is_empty()));
    let other = ball(10_000, BakeFormat::Rgba8);
    let mut painter = other.painter();
    log.replay(&mut painter).unwrap();
    assert_eq!(painter.layers().len(), 1);
}

/// Each part of a step is looked for by its name: four thousand million of them would take hours.
#[test]
fn a_history_of_steps_that_cannot_be_is_damage() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    for (next_id, parts) in [(1, u32::MAX), (0, 1), (u64::MAX, 1), (u64::MAX - 1, 1)] {
        let step = format!(r#"{{"id":0,"label":"a","parts":{parts}}}"#);
        let index = format!(r#"{{"next_id":{next_id},"done":[],"undone":[{step}]}}"#);
        let mut editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
        editor.attach("history/index", index.into_bytes()).unwrap();
        editor.commit().unwrap();
        drop(editor);
        let error = Painter::open(&baked.path, &PaintOptions::default()).err().unwrap().to_string();
        assert!(
            error.contains("the history of") && error.contains("names steps that cannot be there"),
            "{error}"
        );
    }
}

/// It is taken back as a whole or not at all, whatever in it is damaged.
#[test]
fn a_step_that_is_damaged_changes_nothing() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let mut painter = baked.painter();
    let line = stroke(painter.surface(), 40.0, &arc());
    paint_stroke(&mut painter, red(1.0), &line);
    painter.commit().unwrap();
    drop(painter);
    let editor = || AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
    let names = editor().attachment_names();
    let name = names.iter().find(|name| name.ends_with("/000000")).unwrap();
    let whole = editor().attachment(name).unwrap().unwrap();
    // The records of format.md: an attachment of a foreign name, the mean of a group that is not there, a short page.
    let words = |words: &[u32]| -> Vec<u8> { words.iter().flat_map(|word| word.to_le_bytes()).collect() };
    let foreign = [words(&[2, 3, 0, 1]), b"abcd".to_vec()].concat();
    let mean = words(&[1, 1_000_000, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    let page = [words(&[0, 0, 0, 0, 0, 0, 4]), vec![255; 4]].concat();
    for (record, sentence) in [
        (foreign, "a step changes what is neither layer nor log"),
        (mean, "a step changes a group that does not exist"),
        (page, "a step is of pages of another size"),
    ] {
        let mut editor = editor();
        editor.attach(name, [whole.clone(), record].concat()).unwrap();
        editor.commit().unwrap();
        drop(editor);
        let mut painter = baked.painter();
        let before = contents(&painter);
        let error = painter.undo().unwrap_err().to_string();
        assert!(error.contains(sentence), "{error}");
        assert!(contents(&painter) == before, "{sentence}");
    }
}

#[test]
fn layers_with_numbers_that_cannot_go_on_are_damage() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let mut editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
    let index = format!(r#"{{"next_id":{},"stack":[]}}"#, u64::MAX);
    editor.attach("layers/index", index.into_bytes()).unwrap();
    editor.commit().unwrap();
    drop(editor);
    let error = Painter::open(&baked.path, &PaintOptions::default()).err().unwrap().to_string();
    assert!(error.contains("the layers of") && error.contains("their numbers are too large"), "{error}");
}

#[test]
fn opening_tells_how_far_it_is() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let told = std::cell::RefCell::new(Vec::new());
    let progress = |share: f32| told.borrow_mut().push(share);
    Painter::open_with_progress(&baked.path, &PaintOptions::default(), &progress).unwrap();
    let told = told.borrow();
    let last = told.last().copied().unwrap_or_default();
    assert!(told.len() > 3 && told.is_sorted() && (last - 1.0).abs() < 1e-6, "{told:?}");
}

#[test]
fn a_painted_bunny_is_certified() {
    let Some(folder) = data_folder() else { return };
    let mesh = loaded(&folder, "meshes/bunny/stanford_bunny.ply");
    let baked = Baked::new(&mesh, &cover(&mesh, 64, 1 << 20), BakeFormat::Bc7);
    let mut painter = baked.painter();
    let line = stroke(painter.surface(), 50.0, &[Vec3::new(-0.5, 0.2, 1.0), Vec3::new(0.5, 0.1, 1.0)]);
    paint_stroke(&mut painter, red(0.9), &line);
    painter.commit().unwrap();
    assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
}

/// A red dot on grey; returns the mean of red, and its greatest difference between neighbouring points along a line.
fn profile(baked: &Baked, line: impl Fn(f32) -> Vec3) -> (f32, f32) {
    let cache = baked.cache();
    let surface = fantex_paint::Surface::of(cache.asset());
    let values: Vec<f32> = (0..=200)
        .map(|i| {
            let point = surface.nearest(line(i as f32 / 200.0), f32::INFINITY).unwrap();
            sample(&cache, 0, 0, point.triangle as usize, point.lambda).0.x
        })
        .collect();
    let steepest = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f32::max);
    (values.iter().sum::<f32>() / values.len() as f32, steepest)
}

#[test]
fn blur_softens_and_clone_copies() {
    let baked = ball(200_000, BakeFormat::Float);
    let mut painter = baked.painter();
    let mut dot = stroke(painter.surface(), 40.0, &[Vec3::X]);
    dot.brush.hardness = 1.0;
    paint_stroke(&mut painter, red(1.0), &dot);
    painter.commit().unwrap();
    let through = |t: f32| Vec3::new(1.0, 0.0, 0.4 * (t - 0.5));
    let copied = |t: f32| Vec3::new(0.4 * (t - 0.5), 0.0, 1.0);
    let (mean, steepest) = profile(&baked, through);
    let (bare, _) = profile(&baked, copied);
    let texel = 1.0 / painter.surface().cover().density;

    let mut blur = red(1.0);
    blur.tool = Tool::Blur { radius: 8.0 * texel };
    let wide = stroke(painter.surface(), 120.0, &[Vec3::X]);
    paint_stroke(&mut painter, blur, &wide);
    painter.commit().unwrap();
    let (blurred_mean, blurred) = profile(&baked, through);
    assert!(blurred < 0.5 * steepest && (blurred_mean - mean).abs() < 0.05, "{blurred} {steepest}");

    let start = painter.surface().nearest(Vec3::Z, f32::INFINITY).unwrap();
    let source = painter.surface().nearest(Vec3::X, f32::INFINITY).unwrap();
    let [to, from] = [start, source].map(|p| painter.surface().position(p).as_vec3());
    let mut clone = red(1.0);
    clone.tool = Tool::Clone { offset: from - to, reach: 0.3, symmetry: Symmetry::None };
    let place = stroke(painter.surface(), 80.0, &[Vec3::Z]);
    paint_stroke(&mut painter, clone, &place);
    painter.commit().unwrap();
    let value = painter.pick(0, start).unwrap();
    assert!(value.x > 0.8 && value.y < 0.15, "{value}");
    assert!(profile(&baked, copied).0 > bare + 0.02);
    assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
}

// Normals are moved as directions on the surface, whatever frame their tile has.

/// A flat normal map.
struct Flat;

impl Source for Flat {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::Normal, has_alpha: false, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        values[0] = point.normal.extend(1.0);
    }
}

/// The part of the normal along the surface, mesh space, by each tile that shows a point.
fn tangents(cache: &PageCache, normals: &[Vec3], triangle: usize, lambda: Vec3) -> Vec<Vec3> {
    let (mesh, cover) = (cache.asset().mesh(), cache.asset().cover());
    let corners = [0, 1, 2].map(|k| normals[3 * triangle + k]);
    let normal = (corners[0] * lambda.x + corners[1] * lambda.y + corners[2] * lambda.z).normalize();
    let tangent = |slot: usize| {
        let [a, b, c] = cover.tile_corners(mesh, triangle, slot);
        let uv = a * lambda.x + b * lambda.y + c * lambda.z;
        let group = cover.corner_groups[triangle][slot];
        let [x, y, ..] = cache.tile(0, TileId { group, level: 0 }).bilinear(uv);
        let [x_axis, y_axis] = cover.groups[group as usize].shading_axes(normal);
        x_axis * (2.0 * x - 1.0) + y_axis * (2.0 * y - 1.0)
    };
    cover.weights(triangle, lambda).iter().map(|(slot, _)| tangent(slot)).collect()
}

#[test]
fn tiles_agree_on_normals_that_are_laid_and_moved() {
    let mesh = cleaned(generate::icosphere(4));
    let cover = cover(&mesh, 48, 200_000);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let options = BakeOptions { format: BakeFormat::Float, ..BakeOptions::default() };
    bake(&mesh, &cover, &Flat, &path, &options, &NoProgress).unwrap();
    // Leaning to the right by half.
    let texels = vec![[0.75, 0.5, 1.0, 1.0]; 64];
    Image::from_linear_rgba(8, 8, &texels).save(folder.path().join("lean.exr")).unwrap();
    let text = r#"{ "version": 1, "strokes": [
        { "decal": { "size": { "world": 0.9 } }, "channels": [{ "kind": "normal", "color": { "image": "lean.exr" } }],
          "samples": [{ "at": { "position": [0, 0, 1] } }] },
        { "tool": { "smudge": { "strength": 0.9 } }, "brush": { "size": { "world": 0.4 } }, "channels": [{ "kind": "normal" }],
          "samples": [{ "at": { "position": [0, 0, 1] } }, { "at": { "position": [0.8, 0, 0.6] } }] },
        { "tool": { "blur": { "radius": { "world": 0.02 } } }, "brush": { "size": { "world": 0.6 } },
          "channels": [{ "kind": "normal" }], "samples": [{ "at": { "position": [0, 0.2, 1] } }] }] }"#;
    let file: StrokeFile = serde_json::from_str(text).unwrap();
    let mut painter = Painter::open(&path, &PaintOptions::default()).unwrap();
    replay(&mut painter, &file, folder.path()).unwrap();
    painter.commit().unwrap();
    let cache = PageCache::new(std::sync::Arc::new(Asset::open(&path).unwrap()), 1 << 26);
    let normals = shading_normals(&mesh);
    let (mut overlaps, mut leaning, mut apart) = (0, 0, 0);
    for triangle in 0..mesh.triangles.len() {
        for lambda in [Vec3::new(0.5, 0.5, 0.0), Vec3::new(0.1, 0.46, 0.44), Vec3::splat(1.0 / 3.0)] {
            let [a, b, c] = mesh.triangle_positions(triangle);
            let position = a * lambda.x + b * lambda.y + c * lambda.z;
            let parts = tangents(&cache, &normals, triangle, lambda);
            let inside = position.z > 0.93;
            for part in &parts {
                overlaps += usize::from(parts.len() > 1);
                apart += usize::from(part.distance(parts[0]) > 0.02);
                leaning += usize::from(inside);
                let right = Vec3::new(position.z, 0.0, -position.x).normalize();
                assert!(!inside || part.distance(right * 0.5) < 0.08, "{part} at {position}");
            }
        }
    }
    assert!(overlaps > 500 && leaning > 100, "{overlaps} {leaning}");
    assert!(apart * 50 < overlaps, "{apart} of {overlaps} differ");
    let back = tangents(
        &cache,
        &normals,
        painter.surface().nearest(Vec3::NEG_Z, 1.0).unwrap().triangle as usize,
        Vec3::splat(1.0 / 3.0),
    );
    assert!(back.iter().all(|part| part.length() < 0.01), "the back stays flat: {back:?}");
}

/// Where a stroke begins and ends in vertices and along edges, several triangles lead on.
#[test]
fn strokes_between_vertices_lack_no_dab() {
    let mesh = plate(6, 0.5);
    let baked = Baked::new(&mesh, &cover(&mesh, 1024, 60_000), BakeFormat::Rgba8);
    let painter = baked.painter();
    let surface = painter.surface();
    let mesh = surface.mesh();
    let top = mesh.positions.iter().map(|p| p.y).fold(f32::NEG_INFINITY, f32::max);
    let on_top: Vec<Vec3> = mesh.positions.iter().copied().filter(|p| p.y == top).collect();
    assert_eq!(on_top.len(), 49);
    let mut longest = 0.0_f32;
    for (i, &from) in on_top.iter().enumerate() {
        for &to in &on_top[i + 1..] {
            let dabs = dabs_of(surface, &stroke(surface, 30.0, &[from, to]));
            let spacing = 0.1 * 30.0 / surface.cover().density;
            let expected = from.distance(to) / spacing;
            assert!((dabs.len() as f32 - expected).abs() < 2.0, "{from} {to}: {} of {expected}", dabs.len());
            longest = longest.max(expected);
        }
    }
    assert!(longest > 60.0, "{longest}");
}

/// A stroke that is dropped leaves every byte and attachment as it was, on the base, under layers, on a layer and on a mask.
#[test]
fn an_abandoned_stroke_leaves_nothing() {
    let baked = ball(60_000, BakeFormat::Bc7);
    let mut painter = baked.painter();
    painter.abandon().unwrap();
    let line = [Vec3::X, Vec3::new(0.6, 0.6, 0.5), Vec3::Z];
    let mut targets = vec![Target::Base];
    let attachments = |painter: &Painter| {
        let names = painter.editor().attachment_names();
        names.into_iter().map(|name| painter.editor().attachment(&name).unwrap()).collect::<Vec<_>>()
    };
    for round in 0..4 {
        for &target in &targets {
            let before = (contents(&painter), attachments(&painter), painter.history().done().len());
            let surface = Arc::clone(painter.surface());
            let dabs = dabs_of(&surface, &stroke(&surface, 50.0, &line));
            painter.begin_on(target, "test", red(0.8)).unwrap();
            for dabs in dabs.chunks(4) {
                painter.dab(dabs).unwrap();
                painter.show().unwrap();
            }
            assert!(contents(&painter) != before.0 || matches!(target, Target::Mask(_)), "{target:?}");
            painter.abandon().unwrap();
            let after = (contents(&painter), attachments(&painter), painter.history().done().len());
            assert!(after == before, "round {round}, {target:?}");
        }
        match round {
            0 => targets.push(Target::Layer(painter.add_layer(Layer::painted("layer")).unwrap())),
            1 => {
                let fill = Layer::fill("fill", &[Vec4::ONE, Vec4::ONE]);
                targets.push(Target::Mask(painter.add_layer(fill).unwrap()));
            }
            // Over what is painted already.
            _ => {
                let surface = Arc::clone(painter.surface());
                painter.begin_on(targets[1], "kept", red(0.5)).unwrap();
                painter.dab(&dabs_of(&surface, &stroke(&surface, 40.0, &[Vec3::X, Vec3::Y]))).unwrap();
                painter.end().unwrap();
            }
        }
    }
}
