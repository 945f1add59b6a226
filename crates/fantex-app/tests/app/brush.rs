//! Brush, colours, textures, stencil, cursor and symmetry.

use std::sync::Arc;

use fantex::base::Aabb;
use fantex::cover::{CoverOptions, build_cover};
use fantex::glam::{DVec2, DVec3};
use fantex::mesh::generate::{icosphere, torus};
use fantex::mesh::{CleanOptions, Model, clean};
use fantex::paint::{PicturePlace, Size, Surface, Symmetry, Tip};
use fantex_app::camera::{CameraRig, ViewPreset};
use fantex_app::paint::{
    BrushSettings, ChosenTexture, ColorSource, Colors, Cursor, Presets, SOLIDS, Section, SizeUnit,
    StencilSettings, SymmetryKind, SymmetrySettings, TIPS, TextureChoice, Viewpoint, parse_hex,
    plane_outline, preview_stroke, text_hex,
};
use fantex_app::settings::Settings;

#[test]
fn pixels_become_world_units_where_the_stroke_begins() {
    let settings = BrushSettings { size: 50.0, ..BrushSettings::default() };
    assert_eq!(settings.brush(0.02, 0).size, Size::World(1.0));
    let settings = BrushSettings { unit: SizeUnit::Texels, ..settings };
    assert_eq!(settings.brush(0.02, 0).size, Size::Texels(50.0));
}

#[test]
fn sizes_stay_within_bounds() {
    let mut settings = BrushSettings::default();
    settings.change_size(1000.0);
    assert_eq!(settings.size, BrushSettings::SIZE[1]);
    settings.change_size(-1000.0);
    assert_eq!(settings.size, BrushSettings::SIZE[0]);
    settings.change_hardness(20.0);
    assert_eq!(settings.hardness, 1.0);
    settings.unit = SizeUnit::World;
    settings.change_size(1e6);
    assert_eq!(settings.size, BrushSettings::WORLD_SIZE[1]);
    settings.change_size(-1e6);
    assert_eq!(settings.size, BrushSettings::WORLD_SIZE[0]);
}

/// JSON holds no such name; all the rest is not to be lost for that.
#[cfg(unix)]
#[test]
fn stamps_whose_names_are_no_text_are_not_remembered() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().unwrap();
    let [brushes, file] = ["brushes.json", "settings.json"].map(|name| folder.path().join(name));
    let stamp = std::path::PathBuf::from(std::ffi::OsStr::from_bytes(b"caf\xe9.png"));
    let brush = BrushSettings { name: "Mine".into(), stamp: Some(stamp), ..BrushSettings::default() };
    let mut presets = Presets::default();
    presets.save(&brushes).unwrap();
    presets.keep(&brush);
    assert!(presets.save(&brushes).is_err());
    assert_eq!(Presets::load(&brushes).unwrap(), Presets::default());
    let mut settings = Settings::default();
    settings.paint.brush = brush;
    settings.save(&file).unwrap();
    let (again, problem) = Settings::load(&file);
    assert!(problem.is_none());
    assert_eq!((again.paint.brush.name.as_str(), again.paint.brush.stamp), ("Mine", None));
}

#[test]
fn presets_come_back_from_the_disk() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brushes.json");
    let mut presets = Presets::load(&path).unwrap();
    assert_eq!(presets, Presets::default());
    presets.keep(&BrushSettings { name: "Mine".into(), size: 7.0, ..BrushSettings::default() });
    presets.keep(&BrushSettings { name: "Mine".into(), size: 9.0, ..BrushSettings::default() });
    presets.save(&path).unwrap();
    let again = Presets::load(&path).unwrap();
    assert_eq!(again, presets);
    assert_eq!(again.brushes.iter().filter(|b| b.name == "Mine").map(|b| b.size).collect::<Vec<_>>(), [9.0]);
    std::fs::write(&path, "{").unwrap();
    assert!(Presets::load(&path).unwrap_err().to_string().contains("set aside"));
    let aside = folder.path().join("brushes.damaged.json");
    assert!(!path.exists() && std::fs::read_to_string(aside).unwrap() == "{");
}

#[test]
fn a_dozen_brushes_are_textured_and_look_so() {
    let presets = Presets::default().brushes;
    let textured: Vec<&BrushSettings> = presets.iter().filter(|brush| brush.tip.is_some()).collect();
    assert!(presets.len() >= 18 && textured.len() == Tip::ALL.len(), "{}", presets.len());
    for tip in Tip::ALL {
        assert!(textured.iter().any(|brush| brush.tip == Some(tip)), "{tip:?} has a brush");
        assert!(TIPS.iter().any(|(one, _)| *one == Some(tip)), "{tip:?} can be chosen");
    }
    let names: std::collections::BTreeSet<_> = presets.iter().map(|brush| &brush.name).collect();
    assert_eq!(names.len(), presets.len(), "names are there once");
    let looks: Vec<_> = textured.iter().map(|brush| preview_stroke(brush, 240, 90)).collect();
    for (i, look) in looks.iter().enumerate() {
        let name = &textured[i].name;
        assert!(look.iter().sum::<f32>() > 50.0, "{name} is seen");
        assert!(look.iter().all(|c| (0.0..=1.0).contains(c)), "{name}");
        let round = preview_stroke(&BrushSettings { tip: None, ..textured[i].clone() }, 240, 90);
        assert!(*look != round && looks[..i].iter().all(|other| other != look), "{name}");
        assert_eq!(*look, preview_stroke(textured[i], 240, 90), "{name} looks the same each time");
    }
}

/// Files of older versions get the brushes that they do not know; what was deleted stays so.
#[test]
fn new_brushes_of_the_program_come_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brushes.json");
    let mine = BrushSettings { name: "Chalk".into(), size: 3.0, ..BrushSettings::default() };
    let brush = serde_json::to_string(&mine).unwrap();
    std::fs::write(&path, format!("{{\"brushes\":[{brush}]}}")).unwrap();
    let mut presets = Presets::load(&path).unwrap();
    assert_eq!(presets.brushes[0], mine, "the user's own brush goes before one of the same name");
    assert_eq!(presets.brushes.iter().filter(|brush| brush.name == "Chalk").count(), 1);
    assert_eq!(presets.brushes.len(), Presets::default().brushes.len());
    presets.brushes.retain(|brush| brush.name != "Sponge");
    presets.save(&path).unwrap();
    let again = Presets::load(&path).unwrap();
    assert_eq!(again, presets);
    assert!(again.brushes.iter().all(|brush| brush.name != "Sponge"));
    // Until they are asked for.
    assert!(again.lacks_own());
    presets.restore();
    assert!(!presets.lacks_own() && presets.brushes[0] == mine);
    assert_eq!(presets.brushes.len(), Presets::default().brushes.len());
}

#[test]
fn the_preview_shows_opacity_and_size() {
    let sum = |brush: &BrushSettings| preview_stroke(brush, 200, 60).iter().sum::<f32>();
    let brush = BrushSettings { size: 12.0, hardness: 1.0, ..BrushSettings::default() };
    let whole = sum(&brush);
    assert!(whole > 500.0, "{whole}");
    let fainter = sum(&BrushSettings { opacity: 0.5, ..brush.clone() });
    assert!((fainter / whole - 0.5).abs() < 1e-3);
    assert!(sum(&BrushSettings { size: 24.0, ..brush.clone() }) > 1.5 * whole);
    assert!(preview_stroke(&brush, 200, 60).iter().all(|c| (0.0..=1.0).contains(c)));
}

#[test]
fn hexadecimal_colours_are_read_as_they_are_written() {
    for color in [[0, 0, 0], [255, 128, 3], [0xd8, 0x45, 0x2e]] {
        assert_eq!(parse_hex(&text_hex(color)), Some(color));
    }
    assert_eq!(parse_hex("f80"), Some([255, 136, 0]));
    assert_eq!(parse_hex("#12345"), None);
    assert_eq!(parse_hex("red"), None);
}

#[test]
fn recent_colours_are_each_there_once_the_last_one_first() {
    let mut colors = Colors::default();
    for n in 0..40u8 {
        colors.foreground = [n % 20, 0, 0];
        colors.used();
    }
    assert_eq!(colors.recent.len(), 16);
    assert_eq!(colors.recent[0], [19, 0, 0]);
    colors.foreground = [10, 0, 0];
    colors.used();
    assert_eq!((colors.recent[0], colors.recent[1]), ([10, 0, 0], [19, 0, 0]));
}

fn surface() -> Surface {
    let (mesh, _) = clean(torus(24, 12), &CleanOptions::default()).unwrap();
    let (cover, _) = build_cover(&mesh, &CoverOptions::default()).unwrap();
    Surface::new(Arc::new(mesh), Arc::new(cover))
}

#[test]
fn every_solid_can_be_painted_with_and_is_seen_in_its_preview() {
    let surface = surface();
    for solid in SOLIDS {
        let choice = TextureChoice { source: ColorSource::Solid, solid: solid.into(), ..Default::default() };
        let made = ChosenTexture::make(&choice, &surface).unwrap().unwrap();
        let picture = made.preview(&surface, [40, 20]);
        let colors: std::collections::BTreeSet<_> = picture.iter().collect();
        assert!(picture.len() == 800 && colors.len() > 1, "{solid}: {}", colors.len());
        let smaller = TextureChoice { scale: 0.3, ..choice };
        let smaller = ChosenTexture::make(&smaller, &surface).unwrap().unwrap();
        assert!(smaller.preview(&surface, [40, 20]) != picture, "{solid}");
    }
    assert!(ChosenTexture::make(&TextureChoice::default(), &surface).unwrap().is_none());
}

#[test]
fn looks_are_read_and_what_is_wrong_is_said() {
    let (surface, folder) = (surface(), tempfile::tempdir().unwrap());
    let choice = TextureChoice { source: ColorSource::Look, ..Default::default() };
    let refused = |choice: &TextureChoice| ChosenTexture::make(choice, &surface).unwrap_err().to_string();
    assert!(refused(&choice).contains("choose its file"));
    let path = folder.path().join("a.toml");
    let choice = TextureChoice { look: Some(path.clone()), ..choice };
    assert!(refused(&choice).contains("a.toml"));
    std::fs::write(
        &path,
        "[textures.b]\nkind = \"rock\"\n[textures.a]\nkind = \"color\"\ncolor = [1, 0, 0]\n",
    )
    .unwrap();
    let first = ChosenTexture::make(&choice, &surface).unwrap().unwrap();
    assert_eq!((first.name.as_str(), first.preview(&surface, [2, 2])), ("a", vec![[255, 0, 0]; 4]));
    let named = TextureChoice { name: "b".into(), ..choice };
    assert_eq!(ChosenTexture::make(&named, &surface).unwrap().unwrap().name, "b");
}

#[test]
fn a_picture_is_fitted_moved_and_turned() {
    let mut stencil = StencilSettings::default();
    stencil.fit([3.0, 1.5]);
    assert_eq!(stencil.place.height, 0.5);
    let corners = stencil.corners(3.0);
    assert!((corners[0] - DVec2::new(-1.5, 0.5)).length() < 1e-12, "the whole width: {corners:?}");
    stencil.turn(270.0);
    assert_eq!(stencil.place.angle, -90.0);
    assert!((stencil.corners(3.0)[0] - DVec2::new(0.5, 1.5)).length() < 1e-12);
    stencil.shift(DVec2::new(0.25, -0.5));
    stencil.scale(1e9);
    assert_eq!((stencil.place.center, stencil.place.height), ([0.25, -0.5], 20.0));
    stencil.reset();
    assert_eq!(stencil.place, PicturePlace::default());
}

#[test]
fn what_a_ray_meets_is_seen_where_it_started() {
    let view = Viewpoint {
        rig: CameraRig { yaw: 0.4, pitch: -0.2, ..CameraRig::default() },
        pixels: [800, 500],
        pixels_per_point: 1.0,
    };
    for at in [DVec2::new(0.5, 0.5), DVec2::new(0.1, 0.8), DVec2::new(0.95, 0.03)] {
        let point = view.rig.eye + 7.0 * view.rig.ray(at, view.aspect());
        assert!((view.project(point).unwrap() - at).length() < 1e-9);
    }
    assert_eq!(view.project(view.rig.eye - view.rig.forward()), None);
    let middle = view.rig.eye + 4.0 * view.rig.forward();
    let beside = middle + view.rig.axes().y_axis * view.world_per_pixel(middle);
    let moved = (view.project(beside).unwrap() - view.project(middle).unwrap()) * 500.0;
    assert!((moved.length() - 1.0).abs() < 1e-9);
}

#[test]
fn rings_lie_around_the_cursor_and_its_mirror_image() {
    let (mesh, _) = clean(torus(64, 32), &CleanOptions::default()).unwrap();
    let (cover, _) = build_cover(&mesh, &CoverOptions::default()).unwrap();
    let rig = ViewPreset::Top.rig(&mesh, 1.6);
    let surface = Surface::new(Arc::new(mesh), Arc::new(cover));
    let view = Viewpoint { rig, pixels: [800, 500], pixels_per_point: 1.0 };
    // A torus seen from above: on its right side.
    let at = (0..100).map(|k| DVec2::new(0.5 + 0.005 * f64::from(k), 0.5));
    let (at, point) = at.filter_map(|at| Some((at, view.hit(&surface, at)?))).nth(10).unwrap();
    let world = surface.mesh().world_from_mesh.point(surface.position(point).as_vec3());
    let radius = 20.0 * view.world_per_pixel(world);
    let mirror = Symmetry::Mirror { axis: 0, offset: 0.0 };
    let cursor = Cursor::new(&surface, &view, point, radius, 0.5, &mirror);
    assert_eq!(cursor.rings.len(), 2);
    let ring = &cursor.rings[0];
    assert!((ring.middle - at).length() < 1e-3 && !ring.is_hidden);
    let pixels = |p: &DVec2| ((*p - ring.middle) * DVec2::new(800.0, 500.0)).length();
    assert!(ring.outline.iter().all(|p| (8.0..24.0).contains(&pixels(p))), "{:?}", ring.outline);
    let other = &cursor.rings[1];
    assert!((other.middle.x + ring.middle.x - 1.0).abs() < 1e-2, "{:?}", other.middle);
}

#[test]
fn planes_pass_the_centre_unless_moved() {
    let center = DVec3::new(5.0, 1.0, 2.0);
    let settings = SymmetrySettings { kind: SymmetryKind::Mirror, offset: 0.5, ..Default::default() };
    assert_eq!(settings.symmetry(center), Symmetry::Mirror { axis: 0, offset: 5.5 });
    let bounds = Aabb { min: center - 1.0, max: center + 1.0 };
    assert!(plane_outline(&bounds, 0, 5.5).iter().all(|corner| corner.x == 5.5));
}

fn seen(model: Model, preset: ViewPreset) -> (Viewpoint, Vec<Vec<DVec3>>) {
    let (mesh, _) = clean(model, &CleanOptions::default()).unwrap();
    let (cover, _) = build_cover(&mesh, &CoverOptions::default()).unwrap();
    let view = Viewpoint { rig: preset.rig(&mesh, 1.0), pixels: [900, 900], pixels_per_point: 1.0 };
    let surface = Surface::new(Arc::new(mesh), Arc::new(cover));
    let mut section = Section::default();
    section.follow(&surface, 0, 0.0);
    let parts = section.seen(&surface, &view).to_vec();
    (view, parts)
}

#[test]
fn the_line_is_whole_from_silhouette_to_silhouette() {
    let pixels_between = |view: &Viewpoint, a: DVec3, b: DVec3| {
        let [a, b] = [a, b].map(|p| view.project(p).unwrap());
        ((b - a) * 900.0).length()
    };
    // From the front the line goes over the ball once, from above it crosses both sides of a ring.
    for (model, preset, count) in [(icosphere(4), ViewPreset::Front, 1), (torus(64, 32), ViewPreset::Top, 2)]
    {
        let (view, parts) = seen(model, preset);
        assert_eq!(parts.len(), count, "{preset:?}");
        for part in &parts {
            assert!(part.iter().all(|p| p.x.abs() < 1e-6));
            let gaps = part.windows(2).map(|ends| pixels_between(&view, ends[0], ends[1]));
            assert!(gaps.fold(0.0, f64::max) <= 10.0 + 1e-6);
        }
        let longest = parts.iter().map(|part| pixels_between(&view, part[0], part[part.len() - 1]));
        assert!(longest.fold(0.0, f64::max) > 150.0);
    }
}

#[test]
fn rough_ground_does_not_tear_the_line() {
    let mut rough = icosphere(6);
    for p in &mut rough.positions {
        *p *= 1.0 + 0.001 * (180.0 * p.y).sin() * (150.0 * p.z).cos();
    }
    let (_, parts) = seen(rough, ViewPreset::ThreeQuarter);
    assert!(parts.len() <= 2, "{}", parts.len());
}
