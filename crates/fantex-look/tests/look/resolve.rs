//! Looks resolved: values of textures and materials.

use std::cell::Cell;
use std::path::Path;
use std::sync::Arc;

use fantex_look::{LookFile, LookImages, ResolveOptions, Resolver};
use fantex_mesh::{CleanOptions, Mesh, clean, generate};
use fantex_texture::environment::{EnvironmentForm, EnvironmentMap};
use fantex_texture::look::{LightingModel, LookMaterial, Opacity, Relief, Slot};
use fantex_texture::{ColorSpace, Depth, Filtering, Image, ShadingPoint, UvPoint};
use glam::{Vec2, Vec3, Vec4};

fn cube() -> Mesh {
    clean(generate::cube(1), &CleanOptions::default()).unwrap().0
}

fn file(text: &str) -> LookFile {
    LookFile::parse(text, Path::new("/no/where/look.toml")).unwrap()
}

fn at(position: Vec3, time: f32, uv: &[UvPoint]) -> ShadingPoint<'_> {
    ShadingPoint {
        position,
        position_steps: [Vec3::X * 1e-4, Vec3::Y * 1e-4],
        normal: Vec3::Z,
        normal_steps: [Vec3::ZERO; 2],
        uv,
        vertex_color: Vec4::new(0.1, 0.2, 0.3, 1.0),
        eye: Some(Vec3::new(0.6, 0.0, 0.8).into()),
        time,
        filtering: Filtering::Own,
    }
}

/// The value of the texture `t` at a point.
fn value(text: &str, position: Vec3, time: f32) -> Vec4 {
    let (file, mesh, images) = (file(text), cube(), LookImages::default());
    let mut resolver = Resolver::new(&file, &mesh, &images, ResolveOptions::default());
    let uv = [UvPoint { uv: Vec2::new(0.25, 0.75), steps: [Vec2::ZERO; 2] }];
    resolver.texture("t").unwrap().evaluate(&at(position, time, &uv))
}

#[track_caller]
fn close(a: Vec4, b: [f32; 4]) {
    assert!((a - Vec4::from_array(b)).abs().max_element() < 1e-5, "{a} against {b:?}");
}

const COLOR: &str = "[textures.c]\nkind = \"color\"\ncolor = [0.2, 0.4, 0.6, 0.5]\n";

#[test]
fn inputs_select_scale_and_shift() {
    let remap = |input: &str| format!("{COLOR}[textures.t]\nkind = \"remap\"\ninput = {input}\n");
    close(value(&remap("\"c\""), Vec3::ZERO, 0.0), [0.2, 0.4, 0.6, 0.5]);
    close(value(&remap("\"c.g\""), Vec3::ZERO, 0.0), [0.4, 0.4, 0.4, 1.0]);
    close(value(&remap("0.25"), Vec3::ZERO, 0.0), [0.25, 0.25, 0.25, 1.0]);
    close(value(&remap("\"#ff0000\""), Vec3::ZERO, 0.0), [1.0, 0.0, 0.0, 1.0]);
    let table = "{ texture = \"c\", channel = \"b\", factor = 0.5, offset = 0.1 }";
    close(value(&remap(table), Vec3::ZERO, 0.0), [0.4, 0.4, 0.4, 1.0]);
    let tint = "{ texture = \"c\", factor = [2, 1, 0, 1] }";
    close(value(&remap(tint), Vec3::ZERO, 0.0), [0.4, 0.4, 0.0, 0.5]);
}

#[test]
fn textures_combine() {
    let combine = |mode: &str| {
        format!(
            "{COLOR}[textures.t]\nkind = \"combine\"\nmode = \"{mode}\"\ntexture = \"c\"\nfragment = [1, 0.5, 0]\n"
        )
    };
    close(value(&combine("replace"), Vec3::ZERO, 0.0), [0.2, 0.4, 0.6, 0.5]);
    close(value(&combine("modulate"), Vec3::ZERO, 0.0), [0.2, 0.2, 0.0, 0.5]);
    close(value(&combine("decal"), Vec3::ZERO, 0.0), [0.6, 0.45, 0.3, 1.0]);
    let math = format!("{COLOR}[textures.t]\nkind = \"math\"\noperation = \"maximum\"\na = \"c\"\nb = 0.5\n");
    close(value(&math, Vec3::ZERO, 0.0), [0.5, 0.5, 0.6, 0.5]);
}

#[test]
fn fields_say_where_a_point_is() {
    let field = |kind: &str| format!("[textures.t]\nkind = \"{kind}\"\n");
    let p = Vec3::new(0.5, -1.0, 1.0);
    close(value(&field("height"), p, 0.0), [0.0, 0.0, 0.0, 1.0]);
    close(value(&field("height"), -p, 0.0), [1.0, 1.0, 1.0, 1.0]);
    close(value(&field("position"), p, 0.0), [0.75, 0.0, 1.0, 1.0]);
    close(value(&field("uv"), p, 0.0), [0.25, 0.75, 0.0, 1.0]);
    close(value(&field("facing"), p, 0.0), [0.8, 0.8, 0.8, 1.0]);
    close(value(&field("time"), p, 2.5), [2.5, 2.5, 2.5, 1.0]);
    close(value(&field("vertex_color"), p, 0.0), [0.1, 0.2, 0.3, 1.0]);
    let distance = |keys: &str| field("distance") + keys;
    close(value(&distance("center = [0.5, 2, 1]\n"), p, 0.0), [3.0, 3.0, 3.0, 1.0]);
    let from_axis = distance("center = [-2.5, 9, -3]\naxis = [0, -2, 0]\n");
    close(value(&from_axis, p, 0.0), [5.0, 5.0, 5.0, 1.0]);
}

#[test]
fn places_move_scale_and_animate_patterns() {
    let checker = |place: &str| {
        format!(
            "[textures.t]\nkind = \"checker\"\ncell = 1\neven = [1, 1, 1]\nodd = [0, 0, 0]\nplace = {{ unit = \"world\"{place} }}\n"
        )
    };
    let is_even =
        |place: &str, x: f32, time: f32| value(&checker(place), Vec3::new(x, 0.5, 0.5), time).x > 0.5;
    assert!(is_even("", 0.5, 0.0) && !is_even("", 1.5, 0.0));
    assert!(is_even(", scale = 2", 1.5, 0.0) && !is_even(", scale = 2", 2.5, 0.0));
    assert!(is_even(", center = [1, 0, 0]", 1.5, 0.0) && !is_even(", center = [1, 0, 0]", 0.5, 0.0));
    // After a second the pattern has moved by one cell.
    assert!(is_even(", move = [1, 0, 0]", 1.5, 1.0) && !is_even(", move = [1, 0, 0]", 0.5, 1.0));
}

#[test]
fn what_is_placed_anew_keeps_the_unit_of_the_world() {
    let waves = |place: &str, x: f32| {
        let text = format!(
            "[textures.waves]\nkind = \"sines\"\nwaves = [{{ length = 3.7 }}]\nplace = {{ unit = \"world\" }}\n\
             [textures.t]\nkind = \"placed\"\ntexture = \"waves\"\n{place}\n"
        );
        value(&text, Vec3::X * x, 0.0).x
    };
    let expected = waves("", 1.0);
    for (place, x) in [("place = {}", 1.0), ("place = { center = [0.5, 0, 0] }", 1.5)] {
        assert!((waves(place, x) - expected).abs() < 1e-5, "{place}");
    }
    assert!((waves("place = { unit = \"model\" }", 1.0) - expected).abs() > 0.01);
}

/// Faces of bricks and cubes are those of the placed pattern, whichever way the surface lies in the object.
#[test]
fn placed_walls_turn_with_their_place() {
    for pattern in ["kind = \"brick\"\nrelief = true", "kind = \"brick\"", "kind = \"checker\""] {
        let text = format!(
            "[textures.floor]\n{pattern}\nplace = {{ unit = \"world\", rotate = [90, 0, 0] }}\n\
             [textures.wall]\n{pattern}\nplace = {{ unit = \"world\" }}\n"
        );
        let (file, mesh, images) = (file(&text), cube(), LookImages::default());
        let mut resolver = Resolver::new(&file, &mesh, &images, ResolveOptions::default());
        let (floor, wall) = (resolver.texture("floor").unwrap(), resolver.texture("wall").unwrap());
        for (x, y) in [(0.15, 0.05), (0.296, 0.06), (0.1, 0.095), (0.52, 0.31), (0.29, 0.099)] {
            for (z, width) in [(0.04, 1e-4), (0.125, 0.05), (0.145, 0.02)] {
                let on_wall = ShadingPoint {
                    position_steps: [Vec3::X * width, Vec3::Y * width],
                    ..at(Vec3::new(x, y, z), 0.0, &[])
                };
                let on_floor = ShadingPoint {
                    position_steps: [Vec3::X * width, Vec3::Z * width],
                    normal: Vec3::Y,
                    ..at(Vec3::new(x, -z, y), 0.0, &[])
                };
                let (expected, found) = (wall.evaluate(&on_wall), floor.evaluate(&on_floor));
                let off = (expected - found).abs().max_element();
                assert!(off < 1e-3, "{pattern} at {x}, {y}, {z}: {found} instead of {expected}");
            }
        }
    }
}

#[test]
fn landscapes_keep_the_slope_of_the_object() {
    let text = |rotate: &str| {
        format!("[textures.t]\nkind = \"landscape\"\nplace = {{ unit = \"world\"{rotate} }}\n")
    };
    // The origin lies in the same place of the pattern.
    close(
        value(&text(", rotate = [90, 0, 0]"), Vec3::ZERO, 0.0),
        value(&text(""), Vec3::ZERO, 0.0).to_array(),
    );
}

#[test]
fn thresholds_apply_to_masks_of_the_model() {
    let opacity = |keys: &str, model: Opacity| {
        let file = file(&format!("[materials.m]\nfrom = \"model\"\n{keys}"));
        let (mesh, images) = (cube(), LookImages::default());
        let mut resolver = Resolver::new(&file, &mesh, &images, ResolveOptions::default());
        let base = LookMaterial { opacity: model, ..LookMaterial::default() };
        resolver.material("m", &base).unwrap().opacity
    };
    let cutoff = |keys: &str, model: Opacity| match opacity(keys, model) {
        Opacity::Mask { threshold } => Some(threshold),
        Opacity::Opaque | Opacity::Blend => None,
    };
    let mask = || Opacity::Mask { threshold: 0.3 };
    assert_eq!(cutoff("", mask()), Some(0.3));
    assert_eq!(cutoff("threshold = 0.7\n", mask()), Some(0.7));
    assert_eq!(cutoff("opacity = \"mask\"\n", mask()), Some(0.3));
    assert_eq!(cutoff("opacity = \"mask\"\n", Opacity::Blend), Some(0.5));
    assert_eq!(cutoff("opacity = \"mask\"\nthreshold = 0.7\n", Opacity::Opaque), Some(0.7));
    assert_eq!(cutoff("threshold = 0.7\n", Opacity::Opaque), None);
}

#[test]
fn materials_take_what_is_said_and_keep_the_rest() {
    let text = "[materials.m]\nfrom = \"model\"\nroughness = 0.25\nlighting = \"blinn_phong\"\nopacity = \"mask\"\n\
                threshold = 0.75\nbump = { texture = \"n\", height = 0.5 }\n[textures.n]\nkind = \"noise\"\n";
    let (file, mesh, images) = (file(text), cube(), LookImages::default());
    let mut resolver = Resolver::new(&file, &mesh, &images, ResolveOptions::default());
    let own = LookMaterial { metallic: Slot::number(0.5), ..LookMaterial::default() };
    let material = resolver.material("m", &own).unwrap();
    assert_eq!(material.lighting, LightingModel::BlinnPhong);
    let point = at(Vec3::ZERO, 0.0, &[]);
    assert_eq!(material.roughness.evaluate_number(&point), 0.25);
    assert_eq!(material.metallic.evaluate_number(&point), 0.5);
    assert!(matches!(material.opacity, Opacity::Mask { threshold } if threshold == 0.75));
    assert!(matches!(material.relief.as_slice(), [Relief::Bump { height, .. }] if *height == 0.5));
}

#[test]
fn normal_maps_are_of_unit_length() {
    let folder = tempfile::tempdir().unwrap();
    let normals = [Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.0, -0.28, 0.96)];
    // As a lossy file may have left them.
    let texels = [normals[0] * 0.7, normals[1] * 0.9].map(|n| (n * 0.5 + 0.5).extend(1.0).to_array());
    let picture = Image::from_linear_rgb(2, 1, &texels).converted(Depth::U8, ColorSpace::Linear);
    picture.save(folder.path().join("n.png")).unwrap();
    let text = "[materials.m]\nnormal_map = { texture = \"n\" }\nbase_color = \"n\"\n\
                [textures.n]\nkind = \"image\"\nimage = \"n.png\"\ncolor_space = \"linear\"\nfilter = \"nearest\"\n";
    let file = LookFile::parse(text, &folder.path().join("look.toml")).unwrap();
    let (mesh, images) = (cube(), LookImages::default());
    let mut resolver = Resolver::new(&file, &mesh, &images, ResolveOptions::default());
    let material = resolver.material("m", &LookMaterial::default()).unwrap();
    let [Relief::Normal { texture, .. }] = material.relief.as_slice() else {
        panic!("{:?}", material.relief)
    };
    for (expected, u) in normals.into_iter().zip([0.25, 0.75]) {
        let uv = [UvPoint { uv: Vec2::new(u, 0.5), steps: [Vec2::ZERO; 2] }];
        let point = at(Vec3::ZERO, 0.0, &uv);
        let texel = texture.evaluate(&point).truncate() * 2.0 - 1.0;
        assert!((texel - expected).length() < 0.02 && (texel.length() - 1.0).abs() < 0.007, "{texel}");
        // The picture itself is what it was.
        let color = material.base_color.evaluate(&point).truncate() * 2.0 - 1.0;
        assert!(color.length() < 0.92, "{color}");
    }
}

#[test]
fn what_cannot_be_made_is_named_with_its_line() {
    let refused = |text: &str, part: &str| {
        let (file, mesh, images) = (file(text), cube(), LookImages::default());
        let mut resolver = Resolver::new(&file, &mesh, &images, ResolveOptions::default());
        let message =
            file.look().textures.keys().find_map(|name| resolver.texture(name).err()).unwrap().to_string();
        assert!(message.starts_with("/no/where/look.toml:") && message.contains(part), "{message}");
    };
    refused("[textures.a]\nkind = \"image\"\nimage = \"gone.png\"\n", "look.toml:3: textures.a.image: ");
    refused("[textures.a]\nkind = \"image\"\n", "one of the keys image and model_image is needed");
    refused("[textures.a]\nkind = \"image\"\nmodel_image = 3\n", "there is no image 3");
    refused("[textures.a]\nkind = \"image\"\nimage = \"a\"\nmodel_image = 3\n", "exclude each other");
    let ramp =
        "[textures.a]\nkind = \"ramp\"\ninput = 0\nstops = [{ at = 1, color = 1 }, { at = 0, color = 1 }]\n";
    let ramp = ramp.replace("color = 1", "color = \"#ffffff\"");
    refused(&ramp, "look.toml:4: textures.a.stops: ");
    let wave = "[textures.a]\nkind = \"sines\"\nwaves = [{ direction = [0, 0, 0] }]\n";
    refused(wave, "look.toml:3: textures.a.waves[1].direction: ");
    let matrix = "[textures.t]\nkind = \"remap\"\ninput = 1\nfrom = [2, 2]\n";
    refused(matrix, "look.toml:1: textures.t: ");
}

#[test]
fn volumes_are_read_and_bounded_by_the_memory() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("v.raw"), [0, 255, 0, 255, 0, 255, 0, 255]).unwrap();
    let text = "[textures.t]\nkind = \"volume\"\nraw = \"v.raw\"\nsize = [2, 2, 2]\n\
                [textures.n]\nkind = \"noise\"\n[textures.a]\nkind = \"table\"\ntexture = \"n\"\nsize = 64\n";
    let file = LookFile::parse(text, &folder.path().join("look.toml")).unwrap();
    let (mesh, images) = (cube(), LookImages::default());
    let mut resolver = Resolver::new(&file, &mesh, &images, ResolveOptions::default());
    // Two voxels along x, over two units of the model's radius.
    let volume = resolver.texture("t").unwrap();
    let [left, right] = [-0.9, 0.9].map(|x| volume.evaluate(&at(Vec3::new(x, 0.0, 0.0), 0.0, &[])).x);
    assert!(left < 0.1 && right > 0.9, "{left} {right}");
    let (noise, table) = (resolver.texture("n").unwrap(), resolver.texture("a").unwrap());
    let p = at(Vec3::new(0.31, -0.2, 0.44), 0.0, &[]);
    assert!((noise.evaluate(&p) - table.evaluate(&p)).abs().max_element() < 0.1);
    let tight = ResolveOptions { memory_bytes: 1000, ..ResolveOptions::default() };
    let mut resolver = Resolver::new(&file, &mesh, &images, tight);
    let message = resolver.texture("a").unwrap_err().to_string();
    assert!(message.contains("look.toml:10: textures.a.size: ") && message.contains("1000"), "{message}");
}

#[test]
fn tables_have_boxes_of_their_own() {
    let resolved = |keys: &str| {
        let text = format!(
            "[textures.h]\nkind = \"height\"\ndirection = [1, 0, 0]\norigin = [0, 0, 0]\n\
             [textures.a]\nkind = \"table\"\ntexture = \"h\"\nsize = 16\n{keys}\n"
        );
        let (file, images) = (file(&text), LookImages::default());
        let mesh = cube();
        let mut resolver = Resolver::new(&file, &mesh, &images, ResolveOptions::default());
        resolver.texture("a").map_err(|error| error.to_string())
    };
    let value_at =
        |keys: &str, x: f32| resolved(keys).unwrap().evaluate(&at(Vec3::new(x, 3.0, -7.0), 0.0, &[])).x;
    // The values of the box, and outside those of its border, or those of the box again.
    let ends = "min = [2, 2, 2]\nmax = [6, 4, 4]";
    for (x, expected) in [(2.0, 2.0), (3.25, 3.25), (6.0, 6.0), (9.0, 6.0), (-1.0, 2.0)] {
        let found = value_at(ends, x);
        assert!((found - expected).abs() < 1e-3, "at {x}: {found} instead of {expected}");
    }
    let again = format!("{ends}\nwrap = \"repeat\"");
    for (x, expected) in [(3.25, 3.25), (7.25, 3.25), (-0.75, 3.25), (4.0, 4.0)] {
        let found = value_at(&again, x);
        assert!((found - expected).abs() < 1e-3, "at {x}: {found} instead of {expected}");
    }
    let error = resolved("min = [0, 0, 3]\nmax = [1, 1, 1]").unwrap_err();
    assert!(
        error.contains("look.toml:5: textures.a: ") && error.contains("min must lie below max"),
        "{error}"
    );
}

#[test]
fn smooth_tables_reach_the_borders_of_the_model() {
    let text = "[textures.h]\nkind = \"height\"\ndirection = [0.6, 0.8, 0]\norigin = [0, 0, 0]\n\
                [textures.a]\nkind = \"table\"\ntexture = \"h\"\nsize = 8\nsmooth = true\n";
    let (file, images) = (file(text), LookImages::default());
    let mut flat = cube();
    flat.positions.iter_mut().for_each(|p| p.y = 0.0);
    for mesh in [cube(), flat] {
        let reach = fantex_mesh::ObjectSpace::of(&mesh).bounds().max;
        let mut resolver = Resolver::new(&file, &mesh, &images, ResolveOptions::default());
        let (height, table) = (resolver.texture("h").unwrap(), resolver.texture("a").unwrap());
        for share in [-1.0, -0.96, -0.3, 0.5, 0.99] {
            let p = at(reach * Vec3::new(share, share, -share), 0.0, &[]);
            let (expected, found) = (height.evaluate(&p).x, table.evaluate(&p).x);
            assert!((expected - found).abs() < 1e-3, "{share}: {found} instead of {expected}");
        }
    }
}

#[test]
fn surroundings_are_made_once_while_their_name_is_the_same() {
    let (images, made) = (LookImages::default(), Cell::new(0));
    let ask = |name: &str| {
        let even = || {
            made.set(made.get() + 1);
            Ok(Some(EnvironmentMap::from_function(EnvironmentForm::Cube, 4, |_, _| Vec3::ONE)))
        };
        images.environment(name.to_owned(), even).unwrap().unwrap()
    };
    assert!(Arc::ptr_eq(&ask("a"), &ask("a")));
    assert!(!Arc::ptr_eq(&ask("a"), &ask("b")));
    assert_eq!(made.get(), 2);
    assert!(images.environment("c".to_owned(), || Ok(None)).unwrap().is_none());
    ask("b");
    assert_eq!(made.get(), 2, "those of the last name are kept");
}
