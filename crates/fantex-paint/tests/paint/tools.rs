//! Smudge, fill by colour, eyedropper, decals, texts, projections, texture graphs.

use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_mesh::generate;
use fantex_paint::{
    BlendMode, ChannelPaint, ColorFill, FillArea, FillSettings, Paint, PaintColor, Painter, Tool, dabs_of,
    fill_triangles,
};
use fantex_store::{PageCache, VerifyOptions, verify};
use fantex_texture::Image;
use glam::{Vec3, Vec4};

use crate::{
    Baked, Contents, ball, cleaned, color_at, contents, cover, paint_stroke, plate, red, run, sample, stroke,
};

/// Tiles agree within so many steps of 8 bits nearly wherever they overlap, at all levels the certificate holds.
fn check(baked: &Baked, steps: f32) {
    let (overlaps, apart) = compare_tiles(baked, steps, |_| true);
    assert!(overlaps > 100 && apart * 200 <= overlaps, "{apart} of {overlaps} differ");
}

/// How many places in overlaps of tiles were compared, of those that are meant, and in how many tiles differ by more than so many steps.
/// The certificate holds.
fn compare_tiles(baked: &Baked, steps: f32, is_meant: impl Fn(Vec3) -> bool) -> (usize, usize) {
    let report = verify(&baked.path, &VerifyOptions::default()).unwrap();
    assert!(report.ok && report.continuity.largest_jump < 1.0 / 255.0, "{report:?}");
    let cache = baked.cache();
    let (mut overlaps, mut apart) = (0, 0);
    let mesh = cache.asset().mesh();
    for triangle in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.triangle_positions(triangle);
        for lambda in [Vec3::new(0.5, 0.5, 0.0), Vec3::new(0.1, 0.46, 0.44), Vec3::splat(1.0 / 3.0)] {
            let (value, parts) = sample(&cache, 0, 0, triangle, lambda);
            if parts.len() > 1 && is_meant(a * lambda.x + b * lambda.y + c * lambda.z) {
                let worst = parts.iter().map(|part| (*part - value).abs().max_element()).fold(0.0, f32::max);
                overlaps += 1;
                apart += usize::from(worst > steps / 255.0);
            }
        }
    }
    (overlaps, apart)
}

#[test]
fn smudge_drags_colour_along_and_tiles_agree() {
    let baked = ball(300_000, BakeFormat::Float);
    let mut painter = baked.painter();
    let mut dot = stroke(painter.surface(), 60.0, &[Vec3::X]);
    dot.brush.hardness = 0.6;
    paint_stroke(&mut painter, red(1.0), &dot);
    painter.commit().unwrap();
    let before = baked.cache();
    let way: Vec<Vec3> =
        (0..9).map(|i| Vec3::new((0.06 * i as f32).cos(), 0.0, (0.06 * i as f32).sin())).collect();
    let drag = |painter: &mut Painter, strength| {
        let mut smudge = red(1.0);
        smudge.tool = Tool::Smudge { strength };
        let line = stroke(painter.surface(), 40.0, &way);
        paint_stroke(painter, smudge, &line);
        painter.commit().unwrap();
    };
    drag(&mut painter, 0.9);
    let after = baked.cache();
    let redness = |cache: &PageCache, at: Vec3| {
        let color = color_at(cache, &painter, at);
        color.x - 0.5 * (color.y + color.z)
    };
    let beyond = Vec3::new(0.25f32.cos(), 0.0, 0.25f32.sin());
    assert!(redness(&before, beyond) < 0.3);
    assert!(redness(&after, beyond) > redness(&before, beyond) + 0.2, "colour was dragged out of the dot");
    let aside = Vec3::new(0.25f32.cos(), 0.4, 0.25f32.sin());
    assert!(color_at(&before, &painter, aside) == color_at(&after, &painter, aside));
    check(&baked, 1.5);
    // Without strength nothing moves.
    assert!(painter.undo().unwrap());
    painter.commit().unwrap();
    drag(&mut painter, 0.0);
    let still = baked.cache();
    for i in 0..30 {
        let at = Vec3::new((0.02 * i as f32).cos(), 0.02, (0.02 * i as f32).sin());
        let (a, b) = (color_at(&before, &painter, at), color_at(&still, &painter, at));
        assert!((a - b).abs().max_element() < 0.02, "{a} {b}");
    }
}

#[test]
fn a_fill_by_colour_takes_what_looks_alike_and_hangs_together() {
    let baked = ball(200_000, BakeFormat::Float);
    let mut painter = baked.painter();
    // A white ball with two red dots.
    let flat = |color: Vec4| Paint {
        tool: Tool::Paint(BlendMode::Normal),
        opacity: 1.0,
        channels: vec![ChannelPaint::new(0, PaintColor::Constant(color))],
        stencil: None,
        sight: None,
    };
    let surface = Arc::clone(painter.surface());
    let start = surface.nearest(Vec3::X, f32::INFINITY).unwrap();
    painter.begin("white", flat(Vec4::ONE)).unwrap();
    painter.fill(FillArea::Everything).unwrap();
    let diameter = 60.0;
    for at in [Vec3::X, Vec3::Z] {
        let mut dot = stroke(&surface, diameter, &[at]);
        dot.brush.hardness = 1.0;
        paint_stroke(&mut painter, red(1.0), &dot);
    }
    // Filters mix the colours at the dots' hard edges, in each tile in its own way.
    let density = painter.editor().asset().cover().density;
    let is_plain = |place: Vec3| {
        [Vec3::X, Vec3::Z].iter().all(|dot| (place.distance(*dot) * density - diameter / 2.0).abs() > 4.0)
    };
    let green = Vec4::new(0.0, 1.0, 0.0, 1.0);
    for (connected, other_is_green) in [(true, false), (false, true)] {
        painter.begin("green", flat(green)).unwrap();
        let fill = ColorFill { connected, ..ColorFill::default() };
        painter.fill(FillArea::Color { channel: 0, starts: vec![start], fill }).unwrap();
        painter.commit().unwrap();
        let cache = baked.cache();
        assert!(color_at(&cache, &painter, Vec3::X).distance(green) < 0.01);
        assert_eq!(color_at(&cache, &painter, Vec3::Z).distance(green) < 0.01, other_is_green);
        assert!(color_at(&cache, &painter, Vec3::Y).distance(Vec4::ONE) < 0.01, "white stays");
        let (overlaps, apart) = compare_tiles(&baked, 0.5, is_plain);
        assert!(overlaps > 1000 && apart == 0, "{apart} of {overlaps} differ");
        painter.undo().unwrap();
    }
    // The white is one piece around both dots.
    let white = surface.nearest(Vec3::NEG_Y, f32::INFINITY).unwrap();
    painter.begin("green", flat(green)).unwrap();
    let fill = ColorFill::default();
    painter.fill(FillArea::Color { channel: 0, starts: vec![white], fill }).unwrap();
    painter.commit().unwrap();
    let cache = baked.cache();
    for i in 0..400 {
        let t = i as f32;
        let at = Vec3::new(
            (2.4 * t).sin() * (1.0 - (t / 200.0 - 1.0).powi(2)).sqrt(),
            t / 200.0 - 1.0,
            (2.4 * t).cos(),
        );
        let at = at.normalize();
        let is_in_dot = [Vec3::X, Vec3::Z].iter().any(|dot| at.distance(*dot) * density < diameter / 2.0);
        let expected = if is_in_dot { Vec4::new(0.9, 0.05, 0.05, 1.0) } else { green };
        let color = color_at(&cache, &painter, at);
        assert!(!is_plain(at) || color.distance(expected) < 0.01, "{color} at {at}");
    }
}

#[test]
fn fills_of_triangles_end_where_they_should() {
    // A thin plate: whole is all, by angle one side; two balls would be two parts.
    let mesh = plate(6, 0.02);
    let surface = fantex_paint::Surface::new(Arc::new(mesh.clone()), Arc::new(cover(&mesh, 64, 4000)));
    let top = surface.hit(Vec3::new(0.1, 1.0, 0.1), Vec3::NEG_Y).unwrap();
    let count = |scope| fill_triangles(&surface, top, scope).len();
    assert_eq!(count(FillSettings::Whole), mesh.triangles.len());
    assert_eq!(count(FillSettings::Connected), mesh.triangles.len());
    assert_eq!(count(FillSettings::Angle(10.0)), 2 * 6 * 6);
}

#[test]
fn the_eyedropper_sees_what_is_not_committed() {
    let baked = ball(60_000, BakeFormat::Float);
    let mut painter = baked.painter();
    let point = painter.surface().nearest(Vec3::X, f32::INFINITY).unwrap();
    let generation = painter.editor().asset().generation();
    let dot = stroke(painter.surface(), 40.0, &[Vec3::X]);
    let surface = Arc::clone(painter.surface());
    painter.begin("dot", red(1.0)).unwrap();
    painter.dab(&dabs_of(&surface, &dot)).unwrap();
    let values = painter.pick_all(point).unwrap();
    assert!(values[0].distance(Vec4::new(0.9, 0.05, 0.05, 1.0)) < 0.01, "{values:?}");
    assert!(values[1].distance(Vec4::new(1.0, 0.1, 1.0, 1.0)) < 0.01, "{values:?}");
    assert_eq!(values[0], painter.pick(0, point).unwrap());
    assert_eq!(painter.editor().asset().generation(), generation, "nothing was written");
    assert!(painter.pick(7, point).is_err());
}

/// Left half red, right half green, with a transparent frame.
fn save_flag(baked: &Baked) {
    let texel = |i: usize| {
        let (x, y) = (i % 64, i / 64);
        let framed = x < 4 || y < 4 || x >= 60 || y >= 28;
        let color = if x < 32 { [0.8, 0.0, 0.0] } else { [0.0, 0.8, 0.0] };
        [color[0], color[1], color[2], if framed { 0.0 } else { 1.0 }]
    };
    let texels: Vec<[f32; 4]> = (0..64 * 32).map(texel).collect();
    Image::from_linear_rgba(64, 32, &texels).save(baked.folder.path().join("flag.exr")).unwrap();
}

#[test]
fn a_decal_lies_upright_where_it_is_put() {
    let baked = ball(300_000, BakeFormat::Float);
    save_flag(&baked);
    let before = baked.cache();
    let painter = run(
        &baked,
        r#"{ "label": "flag", "decal": { "size": { "world": 0.8 } },
             "channels": [{ "kind": "base_color", "color": { "image": "flag.exr" } },
                          { "kind": "occlusion_roughness_metallic", "color": { "linear": [1, 0.2, 0, 1] } }],
             "samples": [{ "at": { "position": [0, 0, 1] } }] }"#,
    );
    let after = baked.cache();
    // Seen from +z, x is to the right.
    let at = |x: f32, y: f32| color_at(&after, &painter, Vec3::new(x, y, (1.0 - x * x - y * y).sqrt()));
    assert!(at(-0.15, 0.05).x > 0.7 && at(-0.15, 0.05).y < 0.1, "{}", at(-0.15, 0.05));
    assert!(at(0.15, -0.05).y > 0.7 && at(0.15, -0.05).x < 0.1, "{}", at(0.15, -0.05));
    let frame = Vec3::new(0.0, 0.19, (1.0f32 - 0.19 * 0.19).sqrt());
    assert!(color_at(&before, &painter, frame).distance(color_at(&after, &painter, frame)) < 1e-3);
    let rough = painter.surface().nearest(Vec3::new(0.1, 0.0, 1.0), 1.0).unwrap();
    let value = sample(&after, 1, 0, rough.triangle as usize, rough.lambda).0;
    assert!((value.y - 0.2).abs() < 0.01, "all channels together: {value}");
    check(&baked, 6.0);
}

#[test]
fn a_decal_is_not_mirrored_on_a_mesh_that_is_wound_inwards() {
    let mut model = generate::icosphere(4);
    model.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    let mesh = cleaned(model);
    let baked = Baked::new(&mesh, &cover(&mesh, 64, 100_000), BakeFormat::Float);
    save_flag(&baked);
    let painter = run(
        &baked,
        r#"{ "decal": { "size": { "world": 0.8 } },
             "channels": [{ "kind": "base_color", "color": { "image": "flag.exr" } }],
             "samples": [{ "at": { "position": [0, 0, 1] } }] }"#,
    );
    let left = color_at(&baked.cache(), &painter, Vec3::new(-0.15, 0.05, 0.98).normalize());
    assert!(left.x > 0.7 && left.y < 0.1, "{left}");
}

#[test]
fn a_text_is_written_with_any_colour() {
    let baked = ball(300_000, BakeFormat::Float);
    let before = baked.cache();
    let painter = run(
        &baked,
        r#"{ "label": "I", "text": { "text": "I", "size": { "world": 0.6 } },
             "channels": [{ "kind": "base_color", "color": { "srgb": [0, 0, 0] } }],
             "samples": [{ "at": { "position": [0, 0, 1] } }] }"#,
    );
    let after = baked.cache();
    let black = |x: f32, y: f32| {
        let at = Vec3::new(x, y, 1.0).normalize();
        color_at(&after, &painter, at).truncate().length()
            < 0.5 * color_at(&before, &painter, at).truncate().length()
    };
    assert!(black(0.0, 0.03), "the stem");
    assert!(!black(0.25, 0.03) && !black(-0.25, 0.03) && !black(0.0, 0.4));
}

#[test]
fn a_projection_stops_at_what_the_camera_sees() {
    let baked = ball(200_000, BakeFormat::Float);
    save_flag(&baked);
    let before = baked.cache();
    let painter = run(
        &baked,
        r#"{ "label": "slide", "fill": "whole",
             "projection": { "eye": [0, 0, 5], "target": [0, 0, 0], "lens": { "parallel": 1.0 } },
             "channels": [{ "kind": "base_color", "color": { "image": "flag.exr" } }],
             "samples": [{ "at": { "position": [0, 0, 1] } }] }"#,
    );
    let after = baked.cache();
    let at = |p: Vec3| color_at(&after, &painter, p.normalize());
    assert!(at(Vec3::new(-0.3, 0.1, 0.95)).x > 0.7 && at(Vec3::new(0.3, 0.1, 0.95)).y > 0.7);
    for untouched in [Vec3::new(-0.3, 0.1, -0.95), Vec3::new(0.0, 0.8, 0.6), Vec3::NEG_Z] {
        assert_eq!(at(untouched), color_at(&before, &painter, untouched.normalize()), "{untouched}");
    }
    check(&baked, 6.0);
}

const LOOK: &str = r##"
[textures.squares]
kind = "checker"
even = "#ff0000"
odd = "#0000ff"
"##;

#[test]
fn brushes_and_fill_layers_take_textures_of_looks() {
    let baked = ball(120_000, BakeFormat::Float);
    std::fs::write(baked.folder.path().join("a.toml"), LOOK).unwrap();
    let stroke = r#"{ "brush": { "size": { "world": 0.5 }, "hardness": 1 },
        "channels": [{ "kind": "base_color", "color": { "texture": { "look": { "file": "a.toml" }, "name": "squares" } } }],
        "samples": [{ "at": { "position": [0, 0, 1] } }] }"#;
    let painter = run(&baked, stroke);
    let cache = baked.cache();
    let color = color_at(&cache, &painter, Vec3::new(0.02, 0.03, 1.0).normalize());
    assert!(color.y < 0.05 && color.x + color.z > 0.5, "{color}");
    drop(painter);

    let fill = |color: &str, blend: &str| {
        let look = LOOK.replace("#ff0000", color).replace('"', "\\\"").replace('\n', "\\n");
        format!(
            r#"{{ "label": "fill", "layer": {{ "name": "fill", "blend": "{blend}",
                 "fill": {{ "look": {{ "inline": {{ "text": "{look}" }} }},
                            "textures": [{{ "kind": "base_color", "texture": "squares" }}] }} }} }}"#
        )
    };
    let mut painter = run(&baked, &fill("#00ff00", "normal"));
    let green = color_at(&baked.cache(), &painter, Vec3::new(0.02, 0.03, -1.0).normalize());
    assert!(green.x < 0.05 && (green.y > 0.9 || green.z > 0.9), "{green}");
    check(&baked, 255.0);
    // The layer is kept with its graph; a changed graph shows at once, and undo brings the old one back.
    painter.commit().unwrap();
    let before = contents(&painter);
    drop(painter);
    let mut painter = run(&baked, &fill("#ffffff", "normal"));
    assert_eq!(painter.layers().len(), 1);
    assert!(contents(&painter) != before);
    painter.undo().unwrap();
    assert!(contents(&painter) == before);
    painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
    painter.edit_layers("show", |layers| layers[0].visible = true).unwrap();
    let finest = |contents: &Contents| -> Vec<Vec<u8>> {
        contents.0.iter().filter(|(id, _)| id.level == 0).map(|(_, bytes)| bytes.clone()).collect()
    };
    assert!(finest(&contents(&painter)) == finest(&before), "evaluated anew, it is the same");
}
