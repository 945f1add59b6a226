//! Stencils and slides through a camera, symmetric fills and stickers, tilted pens, looks that move with the asset.

use std::path::Path;
use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_base::{ReadLimits, ReadOptions};
use fantex_paint::{PaintOptions, Painter, StrokeLog, replay};
use fantex_store::{Asset, PageCache, VerifyOptions, verify};
use fantex_texture::Image;
use glam::{Vec3, Vec4};

use crate::{Baked, ball, color_at, contents, cover, data_folder, loaded, plate, run, sample, strokes};

fn certified(baked: &Baked, text: &str) -> Painter {
    let painter = run(baked, text);
    assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    painter
}

/// Left half white, right half black, opaque; with `alpha` the right half is transparent instead.
fn save_halves(folder: &Path, name: &str, alpha: bool) {
    let texel = |i: usize| {
        let is_left = i % 64 < 32;
        let light = if is_left { 1.0 } else { 0.0 };
        if alpha { [1.0, 0.5, 0.0, light] } else { [light, light, light, 1.0] }
    };
    let texels: Vec<[f32; 4]> = (0..64 * 64).map(texel).collect();
    let image = if alpha {
        Image::from_linear_rgba(64, 64, &texels)
    } else {
        Image::from_linear_rgb(64, 64, &texels)
    };
    image.save(folder.join(name)).unwrap();
}

const CAMERA: &str =
    r#""projection": { "eye": [0, 0, 5], "target": [0, 0, 0], "lens": { "parallel": 3.0 } }"#;

/// A broad stroke over the front of the ball, from left to right, and the same from behind.
fn swipe(stencil: &str, camera: &str) -> String {
    format!(
        r#"{{ "label": "swipe", "brush": {{ "size": {{ "world": 1.2 }}, "hardness": 1, "spacing": 0.05 }}, {camera}, {stencil},
            "channels": [{{ "kind": "base_color", "color": {{ "linear": [1, 0, 0, 1] }} }}],
            "samples": [{{ "at": {{ "position": [-1, 0, 0.2] }} }}, {{ "at": {{ "position": [0, 0, 1] }} }},
                        {{ "at": {{ "position": [1, 0, 0.2] }} }}, {{ "at": {{ "position": [0, 0, -1] }} }}] }}"#
    )
}

#[test]
fn pictures_of_many_strokes_are_held_once() {
    let baked = ball(10_000, BakeFormat::Rgba8);
    let shape = Image::from_linear_rgb(128, 128, &[[1.0; 4]; 128 * 128]);
    shape.save(baked.folder.path().join("shape.png")).unwrap();
    let text = format!(
        r#"{{ "brush": {{ "size": {{ "texels": 9 }}, "stamp": "shape.png" }}, {CAMERA}, "stencil": {{ "image": "shape.png" }},
            "channels": [{{ "kind": "base_color", "color": {{ "image": "shape.png" }} }}],
            "samples": [{{ "at": {{ "position": [0, 0, 1] }} }}] }}"#
    );
    let file = strokes(&vec![text; 16].join(","));
    let mut painter = baked.painter();
    // Each time anew they would take 12 MB.
    let options = ReadOptions { memory_bytes: 4 << 20, ..ReadOptions::default() };
    let replayed = ReadLimits::new(options).run(|| replay(&mut painter, &file, baked.folder.path())).unwrap();
    assert_eq!((replayed.strokes, replayed.untouching.len()), (16, 0));
}

/// A stroke over the rim of a thin plate: white over black, seen from above.
fn rim(more: &str) -> String {
    format!(
        r#"{{ "brush": {{ "size": {{ "world": 0.8 }}, "hardness": 1 }}, {more}
            "channels": [{{ "kind": "base_color", "color": {{ "linear": [1, 0, 0, 1] }} }}],
            "samples": [{{ "at": {{ "position": [0.87, 0.001, -0.42] }} }}, {{ "at": {{ "position": [0.88, 0.001, 0.43] }} }}] }}"#
    )
}

#[test]
fn only_what_is_seen_is_painted() {
    // Thinner than a texel: what is hidden is behind something that is nearly as near.
    let mesh = plate(20, 0.002);
    let above = r#""projection": { "eye": [0, 3, 0], "target": [0, 0, 0], "up": [0, 0, -1], "lens": { "parallel": 3.0 } }, "only_seen": 80,"#;
    for (more, is_behind) in [("", true), (above, false)] {
        let baked = Baked::new(&mesh, &cover(&mesh, 64, 40_000), BakeFormat::Float);
        let painter = certified(&baked, &rim(more));
        let cache = baked.cache();
        let redness = |origin: Vec3, direction: Vec3| {
            let point = painter.surface().hit(origin, direction).unwrap();
            sample(&cache, 0, 0, point.triangle as usize, point.lambda).0.x
        };
        for (x, z) in [(0.8, 0.0), (0.9, 0.3), (0.75, -0.2)] {
            let (front, back) =
                (redness(Vec3::new(x, 1.0, z), Vec3::NEG_Y), redness(Vec3::new(x, -1.0, z), Vec3::Y));
            assert!(front > 0.97, "{more} {x} {z}: {front}");
            assert_eq!(back > 0.97, is_behind, "{more} {x} {z}: {back}");
            assert!(is_behind || back < 0.5, "{x} {z}: {back}");
        }
        // What is logged paints the same.
        let again = Baked::new(&mesh, &cover(&mesh, 64, 40_000), BakeFormat::Float);
        let mut replayed = again.painter();
        StrokeLog::of(painter.editor().asset()).unwrap().replay(&mut replayed).unwrap();
        assert!(contents(&replayed) == contents(&painter));
    }
}

#[test]
fn what_is_turned_away_too_far_is_not_painted_and_mirrored_strokes_are_seen_mirrored() {
    let baked = ball(200_000, BakeFormat::Float);
    let camera = CAMERA.replace("[0, 0, 5]", "[5, 0, 0]");
    let text = format!(
        r#"{{ "brush": {{ "size": {{ "world": 1.9 }}, "hardness": 1 }}, {camera}, "only_seen": 45, "symmetry": {{ "mirror": {{ "axis": 0 }} }},
            "channels": [{{ "kind": "base_color", "color": {{ "linear": [1, 0, 0, 1] }} }}],
            "samples": [{{ "at": {{ "position": [1, 0, 0] }} }}] }}"#
    );
    let mut painter = certified(&baked, &text);
    let (before, after) = (ball(200_000, BakeFormat::Float).cache(), baked.cache());
    for side in [1.0, -1.0] {
        let at = |degrees: f32| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let p = Vec3::new(side * cos, sin, 0.0);
            (color_at(&after, &painter, p), color_at(&before, &painter, p))
        };
        let (painted, was) = at(20.0);
        assert!(painted.distance(Vec4::new(1.0, 0.0, 0.0, 1.0)) < 0.02, "{side}: {painted} {was}");
        let (fading, was) = at(42.0);
        assert!(fading.distance(was) > 0.02 && fading.y > 0.02, "it fades out: {fading} {was}");
        let (stays, was) = at(49.0);
        assert!(stays.distance(was) < 0.01, "{stays} {was}");
    }
    for (wrong, says) in [("\"only_seen\": 0", "above 0"), ("\"only_seen\": 91", "at most 90")] {
        let file = strokes(&text.replace("\"only_seen\": 45", wrong));
        let told = replay(&mut painter, &file, baked.folder.path()).unwrap_err().to_string();
        assert!(told.contains(says), "{told}");
    }
    let file = strokes(&text.replace(&camera, "\"line\": false"));
    let told = replay(&mut painter, &file, baked.folder.path()).unwrap_err().to_string();
    assert!(told.contains("there is no camera"), "{told}");
}

#[test]
fn strokes_go_on_beyond_gaps() {
    // Two tiles of a floor, a hair apart.
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for x in [-1.0, 0.004] {
        let first = positions.len() as u32;
        positions.extend(
            [[0.0, -0.5], [0.996, -0.5], [0.0, 0.5], [0.996, 0.5]]
                .map(|[dx, z]| glam::DVec3::new(x + dx, 0.0, z)),
        );
        triangles.extend([[0, 2, 1], [1, 2, 3]].map(|t: [u32; 3]| t.map(|v| first + v)));
    }
    let mesh = crate::mesh_of(positions, triangles);
    let baked = Baked::new(&mesh, &cover(&mesh, 64, 40_000), BakeFormat::Float);
    // From one tile to the other between two samples: with dabs all the way, and whole on both sides.
    let text = r#"{ "brush": { "size": { "world": 0.2 }, "hardness": 1, "across_gaps": true },
        "channels": [{ "kind": "base_color", "color": { "linear": [1, 0, 0, 1] } }],
        "samples": [{ "at": { "position": [-0.6, 0, 0] } }, { "at": { "position": [0.6, 0, 0] } }] }"#;
    let share = |baked: &Baked| {
        let (cache, surface) = (baked.cache(), baked.painter().surface().clone());
        let is_red = |x: f32, z: f32| {
            let point = surface.hit(Vec3::new(x, 1.0, z), Vec3::NEG_Y).unwrap();
            sample(&cache, 0, 0, point.triangle as usize, point.lambda).0.x > 0.97
        };
        let xs = (-55i8..=55).filter(|x| *x != 0).map(|x| f32::from(x) / 100.0);
        let all: Vec<bool> = xs.flat_map(|x| [-0.08, 0.0, 0.08].map(|z| is_red(x, z))).collect();
        all.iter().filter(|red| **red).count() as f32 / all.len() as f32
    };
    certified(&baked, text);
    assert_eq!(share(&baked), 1.0);
    let without = Baked::new(&mesh, &cover(&mesh, 64, 40_000), BakeFormat::Float);
    certified(&without, &text.replace("\"across_gaps\": true", "\"across_gaps\": false"));
    assert!(share(&without) < 0.5, "{}", share(&without));
}

#[test]
fn a_stroke_is_laid_on_through_its_stencil() {
    let baked = ball(200_000, BakeFormat::Float);
    save_halves(baked.folder.path(), "halves.exr", false);
    let before = baked.cache();
    let painter = certified(&baked, &swipe(r#""stencil": { "image": "halves.exr" }"#, CAMERA));
    let after = baked.cache();
    let is_red =
        |p: Vec3| color_at(&after, &painter, p.normalize()).distance(Vec4::new(1.0, 0.0, 0.0, 1.0)) < 0.02;
    let stays =
        |p: Vec3| color_at(&after, &painter, p.normalize()) == color_at(&before, &painter, p.normalize());
    assert!(is_red(Vec3::new(-0.4, 0.1, 0.9)) && is_red(Vec3::new(-0.1, -0.2, 1.0)));
    assert!(
        stays(Vec3::new(0.4, 0.1, 0.9)) && stays(Vec3::new(0.1, -0.2, 1.0)),
        "black lets nothing through"
    );
    assert!(stays(Vec3::new(-0.2, 0.0, -1.0)), "what the camera does not see stays");

    // The picture moved to the right by half the view's height, and turned over: other parts pass.
    let place =
        r#""lens": { "parallel": 3.0 }, "place": { "center": [0.5, 0], "height": 0.5, "angle": 180 }"#;
    let camera = CAMERA.replace(r#""lens": { "parallel": 3.0 }"#, place);
    let moved = ball(200_000, BakeFormat::Float);
    save_halves(moved.folder.path(), "halves.exr", false);
    let painter = certified(&moved, &swipe(r#""stencil": { "image": "halves.exr" }"#, &camera));
    let cache = moved.cache();
    // The plate is 1.5 wide around x = 0.75 and white in its right half.
    let red = |x: f32| color_at(&cache, &painter, Vec3::new(x, 0.05, (1.0 - x * x).sqrt())).x > 0.9;
    assert!(!red(-0.3) && !red(0.3) && !red(0.65) && red(0.85));
}

#[test]
fn a_slide_is_painted_with_the_brush_or_at_once() {
    let [brushed, projected] = [0, 1].map(|_| ball(200_000, BakeFormat::Float));
    let colors = |fill: &str| {
        let text = swipe(r#""stencil": { "image": "slide.exr", "by": "alpha" }"#, CAMERA);
        let text = text.replace(r#"{ "linear": [1, 0, 0, 1] }"#, r#"{ "image": "slide.exr" }"#);
        text.replace(r#""label": "swipe""#, &format!(r#""label": "slide"{fill}"#))
    };
    for (baked, fill) in [(&brushed, ""), (&projected, r#", "fill": "whole""#)] {
        save_halves(baked.folder.path(), "slide.exr", true);
        let before = baked.cache();
        let painter = certified(baked, &colors(fill));
        let after = baked.cache();
        let left = color_at(&after, &painter, Vec3::new(-0.4, 0.1, 0.9).normalize());
        assert!(left.distance(Vec4::new(1.0, 0.5, 0.0, 1.0)) < 0.02, "{left}");
        for p in [Vec3::new(0.4, 0.1, 0.9), Vec3::new(-0.4, 0.1, -0.9)] {
            assert_eq!(color_at(&after, &painter, p.normalize()), color_at(&before, &painter, p.normalize()));
        }
        // Beyond the brush only the projection reaches.
        let above = color_at(&after, &painter, Vec3::new(-0.3, 0.8, 0.52));
        assert_eq!(above.distance(Vec4::new(1.0, 0.5, 0.0, 1.0)) < 0.02, !fill.is_empty(), "{above}");
    }
    // Logged with its picture, it is the same again on another density.
    let log = StrokeLog::of(&Asset::open(&projected.path).unwrap()).unwrap();
    let again = ball(400_000, BakeFormat::Float);
    let mut painter = again.painter();
    assert_eq!(log.replay(&mut painter).unwrap().unrecorded, 0);
    painter.commit().unwrap();
    let left = color_at(&again.cache(), &painter, Vec3::new(-0.4, 0.1, 0.9).normalize());
    assert!(left.distance(Vec4::new(1.0, 0.5, 0.0, 1.0)) < 0.02, "{left}");
}

#[test]
fn stencils_are_the_same_on_any_number_of_threads_and_with_little_memory() {
    let text = swipe(r#""stencil": { "image": "halves.exr" }"#, CAMERA);
    let mut found = Vec::new();
    for (threads, memory) in [(1, 512 << 20), (3, 512 << 20), (2, 1 << 20)] {
        let baked = ball(300_000, BakeFormat::Bc7);
        save_halves(baked.folder.path(), "halves.exr", false);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        found.push(pool.install(|| {
            let options = PaintOptions { memory_bytes: memory, history: true };
            let mut painter = Painter::open(&baked.path, &options).unwrap();
            replay(&mut painter, &strokes(&text), baked.folder.path()).unwrap();
            contents(&painter)
        }));
    }
    assert!(found[0] == found[1], "threads");
    assert!(found[0] == found[2], "memory");
}

#[test]
fn fills_and_stickers_have_mirror_images() {
    let baked = ball(300_000, BakeFormat::Float);
    save_halves(baked.folder.path(), "flag.exr", true);
    let before = baked.cache();
    // A mirrored picture; its opaque half is at the left.
    let painter = certified(
        &baked,
        r#"{ "decal": { "size": { "world": 0.5 } }, "symmetry": { "mirror": { "axis": 0 } },
             "channels": [{ "kind": "base_color", "color": { "image": "flag.exr" } }],
             "samples": [{ "at": { "position": [0.6, 0, 0.8] } }] }"#,
    );
    let after = baked.cache();
    let painted = |x: f32, y: f32| {
        let at = Vec3::new(x, y, (1.0 - x * x - y * y).sqrt());
        color_at(&before, &painter, at).distance(color_at(&after, &painter, at)) > 0.1
    };
    for (x, is_painted) in [(0.5, true), (0.7, false)] {
        assert_eq!((painted(x, 0.05), painted(-x, 0.05)), (is_painted, is_painted), "{x}");
    }
    drop(painter);

    // A text stays readable: an F has its bars at the right on both sides.
    let baked = ball(300_000, BakeFormat::Float);
    let before = baked.cache();
    let painter = certified(
        &baked,
        r#"{ "text": { "text": "F", "size": { "world": 0.7 } }, "symmetry": { "mirror": { "axis": 0 } },
             "channels": [{ "kind": "base_color", "color": { "linear": [1, 0, 1, 1] } }],
             "samples": [{ "at": { "position": [0.6, 0, 0.8] } }] }"#,
    );
    let after = baked.cache();
    let painter = &painter;
    // Horizontal balance of the ink around a middle, along the surface.
    let balance = |middle: f32| {
        let mut sum = 0.0;
        for i in 0..60 {
            for j in 0..60 {
                let (a, b) = ((i as f32 - 29.5) / 120.0, (j as f32 - 29.5) / 120.0);
                let angle = middle.atan2((1.0 - middle * middle).sqrt()) + a;
                let at = Vec3::new(angle.sin(), b, angle.cos()).normalize();
                let ink = color_at(&before, painter, at).distance(color_at(&after, painter, at));
                // Above the middle there are bars at the right, below there is the stem alone.
                sum += ink * a * if b > 0.0 { 1.0 } else { -1.0 };
            }
        }
        sum
    };
    let (right, left) = (balance(0.6), balance(-0.6));
    assert!(right > 0.05 && left > 0.05, "{right} {left}");

    drop(after);

    // A fill by colour takes what looks alike around each start: four white dots.
    let baked = ball(200_000, BakeFormat::Float);
    let dots = r#"{ "brush": { "size": { "world": 0.4 }, "hardness": 1 }, "symmetry": { "radial": { "axis": 1, "count": 4 } },
             "channels": [{ "kind": "base_color", "color": { "linear": [1, 1, 1, 1] } }],
             "samples": [{ "at": { "position": [0.6, 0.1, 0.8] } }] }"#;
    let fill = dots
        .replace(r#""brush""#, r#""fill": { "color": {} }, "brush""#)
        .replace("[1, 1, 1, 1]", "[0, 1, 0, 1]");
    let painter = certified(&baked, &format!("{dots}, {fill}"));
    let cache = baked.cache();
    for [x, z] in [[0.6, 0.8], [0.8, -0.6], [-0.6, -0.8], [-0.8, 0.6]] {
        let color = color_at(&cache, &painter, Vec3::new(x, 0.1, z));
        assert!(color.distance(Vec4::new(0.0, 1.0, 0.0, 1.0)) < 0.02, "{x} {z}: {color}");
    }
}

#[test]
fn fills_of_triangles_start_on_all_sides() {
    use fantex_paint::{FillSettings, Surface, Symmetry, fill_triangles, fill_triangles_with};
    let mesh = plate(6, 0.4);
    let surface = Surface::new(Arc::new(mesh.clone()), Arc::new(cover(&mesh, 64, 4000)));
    let side = surface.hit(Vec3::new(5.0, 0.0, 0.05), Vec3::NEG_X).unwrap();
    let scope = FillSettings::Angle(20.0);
    let one = fill_triangles(&surface, side, scope);
    let mirrored = fill_triangles_with(&surface, side, scope, &Symmetry::Mirror { axis: 0, offset: 0.0 });
    let radial = Symmetry::Radial { axis: 1, center: [0.0; 3], count: 4 };
    let around = fill_triangles_with(&surface, side, scope, &radial);
    assert_eq!([mirrored.len(), around.len()], [2 * one.len(), 4 * one.len()]);
    assert!(one.iter().all(|t| around.binary_search(t).is_ok()));
}

#[test]
fn a_tilted_pen_leaves_ellipses() {
    let dot = |tilt: &str| {
        let baked = ball(300_000, BakeFormat::Float);
        let before = baked.cache();
        let painter = certified(
            &baked,
            &format!(
                r#"{{ "brush": {{ "size": {{ "world": 0.5 }}, "hardness": 1, "follow_tilt": true }},
                     "channels": [{{ "kind": "base_color", "color": {{ "linear": [1, 0, 1, 1] }} }}],
                     "samples": [{{ "at": {{ "position": [0, 0, 1] }}, "tilt": {tilt} }}] }}"#
            ),
        );
        let after = baked.cache();
        [Vec3::X, Vec3::Y].map(|axis| {
            let is_painted = |i: &i32| {
                let at = (Vec3::Z + axis * (*i as f32 * 0.005)).normalize();
                color_at(&before, &painter, at).distance(color_at(&after, &painter, at)) > 0.3
            };
            (-80..80).filter(is_painted).count() as f32 * 0.005
        })
    };
    let upright = dot("[0, 0]");
    assert!((upright[0] - 0.5).abs() < 0.04 && (upright[1] - 0.5).abs() < 0.04, "{upright:?}");
    // 60 degrees: half as wide as long, along the lean.
    let [along, across] = dot("[1.0472, 0]");
    assert!((along - 0.5).abs() < 0.04 && (across - 0.25).abs() < 0.04, "{along} {across}");
    let [across, along] = dot("[0, 1.0472]");
    assert!((along - 0.5).abs() < 0.04 && (across - 0.25).abs() < 0.04, "{along} {across}");
}

#[test]
fn looks_are_found_where_asset_and_look_have_moved_to() {
    let baked = ball(60_000, BakeFormat::Float);
    let folder = baked.folder.path();
    std::fs::create_dir(folder.join("looks")).unwrap();
    save_halves(folder, "looks/picture.exr", false);
    let look = "[textures.halves]\nkind = \"image\"\nimage = \"picture.exr\"\ncoordinates = \"box\"\n";
    std::fs::write(folder.join("looks/a.toml"), look).unwrap();
    let texture = r#"{ "texture": { "look": { "file": "looks/a.toml" }, "name": "halves" } }"#;
    let layer = r#"{ "layer": { "name": "all", "fill": { "look": { "file": "looks/a.toml" },
        "textures": [{ "kind": "base_color", "texture": "halves" }] } } }"#;
    let stroke = format!(
        r#"{{ "brush": {{ "size": {{ "world": 0.5 }} }}, "channels": [{{ "kind": "base_color", "color": {texture} }}],
            "samples": [{{ "at": {{ "position": [0, 0, 1] }} }}] }}, {layer}"#
    );
    let painter = certified(&baked, &stroke);
    let painted = contents(&painter);
    drop(painter);
    // Both move together.
    let elsewhere = tempfile::tempdir().unwrap();
    let moved = elsewhere.path().join("a.fan");
    std::fs::rename(&baked.path, &moved).unwrap();
    std::fs::create_dir(elsewhere.path().join("looks")).unwrap();
    std::fs::rename(folder.join("looks/picture.exr"), elsewhere.path().join("looks/picture.exr")).unwrap();
    let log = || StrokeLog::of(&Asset::open(&moved).unwrap()).unwrap();
    let again = ball(60_000, BakeFormat::Float);
    let mut painter = again.painter();
    log().replay(&mut painter).unwrap();
    assert!(contents(&painter) == painted);
    drop(painter);
    // The layer is shown again, too.
    let mut painter = Painter::open(&moved, &PaintOptions::default()).unwrap();
    painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
    painter.edit_layers("show", |layers| layers[0].visible = true).unwrap();
    drop(painter);
    // Where it is not found, it is said what and where.
    std::fs::remove_dir_all(elsewhere.path().join("looks")).unwrap();
    let refused = log().replay(&mut again.painter()).unwrap_err().to_string();
    let wanted = elsewhere.path().join("looks");
    assert!(refused.contains("halves") && refused.contains(&*wanted.to_string_lossy()), "{refused}");
    assert!(refused.contains("move asset and look together"), "{refused}");
}

#[test]
fn a_stencil_on_the_bunny_stays_on_what_is_seen() {
    let Some(folder) = data_folder() else { return };
    let mesh = loaded(&folder, "meshes/bunny/stanford_bunny.ply");
    let baked = Baked::new(&mesh, &cover(&mesh, 64, 1 << 19), BakeFormat::Bc7);
    save_halves(baked.folder.path(), "slide.exr", true);
    let before = baked.cache();
    let place = mesh.world_from_mesh;
    let [eye, target] = [Vec3::new(0.0, 0.2, 4.0), Vec3::ZERO].map(|p| place.point(p).to_array());
    let text = format!(
        r#"{{ "fill": "whole", "projection": {{ "eye": {eye:?}, "target": {target:?}, "lens": {{ "perspective": 40 }} }},
            "stencil": {{ "image": "slide.exr", "by": "alpha" }},
            "channels": [{{ "kind": "base_color", "color": {{ "image": "slide.exr" }} }}], "samples": [] }}"#
    );
    let painter = certified(&baked, &text);
    let after = baked.cache();
    let (mut seen, mut hidden) = (0, 0);
    for triangle in (0..mesh.triangles.len()).step_by(37) {
        let lambda = Vec3::splat(1.0 / 3.0);
        let value = |cache: &PageCache| sample(cache, 0, 0, triangle, lambda).0;
        if value(&before).distance(value(&after)) < 0.05 {
            continue;
        }
        let [a, b, c] = mesh.triangle_positions(triangle);
        let (point, from) = ((a + b + c) / 3.0, Vec3::new(0.0, 0.2, 4.0));
        let hit = painter.surface().hit(from, (point - from).normalize()).unwrap();
        let is_seen = painter.surface().position(hit).as_vec3().distance(point) < 0.02;
        (seen, hidden) = (seen + usize::from(is_seen), hidden + usize::from(!is_seen));
    }
    assert!(seen > 100 && hidden * 100 <= seen, "{seen} {hidden}");
}
