//! What bakes say: before long work begins, and where they cannot begin. What is said of models.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use std::path::{Path, PathBuf};
use std::sync::Mutex;

#[cfg(feature = "export")]
use fantex::export::{ChannelMap, ExportSummary};
use fantex::store::Plan;
use fantex::{Baker, ErrorKind, LongestEdge, Mesh, NoProgress, Progress, Source};
#[cfg(feature = "export")]
use fantex::{ModelKind, model_notes};
use fantex_mesh::{LoadOptions, generate, load};
use fantex_texture::{ColorSpace, Image, Samples};
use glam::{Mat3, Vec2};

/// Texels along a side of the texture.
const SIDE: u32 = 64;

/// A square on which a texture is repeated so many times along both sides.
fn tiled(folder: &Path, repeats: u32) -> PathBuf {
    let image = Image {
        width: SIDE,
        height: SIDE,
        channels: 3,
        space: ColorSpace::Linear,
        samples: Samples::U16((0..SIDE * SIDE * 3).map(|i| (i * 5) as u16).collect()),
    };
    square(folder, &image, repeats)
}

/// A square that shows an image so many times along both sides.
fn square(folder: &Path, image: &Image, repeats: u32) -> PathBuf {
    image.save(folder.join("color.png")).unwrap();
    std::fs::write(folder.join("square.mtl"), "newmtl a\nmap_Kd color.png\n").unwrap();
    let square = format!(
        "mtllib square.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt {repeats} 0\nvt {repeats} {repeats}\nvt 0 {repeats}\n\
         usemtl a\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    );
    let path = folder.join("square.obj");
    std::fs::write(&path, square).unwrap();
    path
}

/// What a bake says, in order. Ends it with the first note.
#[derive(Default)]
struct UpToNote(Mutex<Vec<String>>);

impl Progress for UpToNote {
    fn report(&self, _: u64, _: u64) {
        self.0.lock().unwrap().push("report".into());
    }

    fn note(&self, sentence: &str) {
        self.0.lock().unwrap().push(sentence.into());
    }

    fn is_cancelled(&self) -> bool {
        !self.0.lock().unwrap().is_empty()
    }
}

#[test]
fn many_texels_that_nobody_asked_for_are_told_of_before_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let (width, height) = (16_384, 4096);
    let samples = Samples::U8(vec![100; width as usize * height as usize]);
    let image = Image { width, height, channels: 1, space: ColorSpace::Linear, samples };
    let mesh = Mesh::load(square(folder.path(), &image, 1)).unwrap();
    let path = folder.path().join("square.fan");
    let is_many = |note: &String| note.contains("about 67 million texels");
    for is_plan in [false, true] {
        let heard = UpToNote::default();
        let baker = Baker::new(&mesh).progress(&heard);
        let outcome = if is_plan { baker.write_plan(&path, b"") } else { baker.write(&path) };
        assert!(outcome.unwrap_err().is_cancelled());
        let heard = heard.0.into_inner().unwrap();
        assert!(heard.len() == 1 && is_many(&heard[0]), "{heard:?}");
        assert!(!path.exists());
    }
    // For those who listen to nothing.
    let baked = Baker::new(&mesh).progress(&NoProgress).write_plan(&path, b"").unwrap();
    assert_eq!(baked.notes.iter().filter(|note| is_many(note)).count(), 1, "{:?}", baked.notes);
    let asked_for = Baker::new(&mesh).texels(100_000_000).overwrite(true).write_plan(&path, b"").unwrap();
    assert!(!asked_for.notes.iter().any(|note| note.contains("million texels")), "{:?}", asked_for.notes);
}

/// A square in 2048 triangles, and tetrahedra above it that are hardly larger than a texel.
#[test]
fn texels_that_pieces_take_are_told_of() {
    let square = generate::grid(32);
    let mut positions: Vec<[f64; 3]> = square.positions.iter().map(|p| p.to_array()).collect();
    let mut triangles = square.triangles;
    for i in 0..150 {
        let first = positions.len() as u32;
        let [x, z] = [i % 15, i / 15].map(|place| f64::from(place) / 15.0);
        positions.extend([[x, 0.5, z], [x + 3e-3, 0.5, z], [x, 0.503, z], [x, 0.5, z + 3e-3]]);
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        triangles.extend(faces.map(|face| face.map(|corner| first + corner)));
    }
    let mesh = Mesh::from_triangles(&positions, &triangles).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let notes = |texels: u64, tile: u32| {
        let path = folder.path().join("pieces.fan");
        let baker = Baker::new(&mesh).source(Source::solid("wood")).texels(texels).tile(tile);
        baker.overwrite(true).write(path).unwrap().notes
    };
    let told = notes(40_000, 256);
    assert!(
        told.iter().any(|note| note.starts_with("24 % of the texels are in 600 tiles of 4 x 4")),
        "{told:?}"
    );
    for (texels, tile) in [(400_000, 256), (40_000, 0)] {
        let others = notes(texels, tile);
        assert!(!others.iter().any(|note| note.contains("4 x 4")), "{others:?}");
    }
}

/// Words and shares of what comes before texels, and reports of these.
#[derive(Default)]
struct Heard(Mutex<(Vec<f32>, Vec<[u64; 2]>)>);

impl Progress for Heard {
    fn report(&self, done: u64, total: u64) {
        self.0.lock().unwrap().1.push([done, total]);
    }

    fn prepare(&self, word: &'static str, share: f32) {
        let mut heard = self.0.lock().unwrap();
        assert!(word == "covering" && heard.1.is_empty(), "{word}");
        heard.0.push(share);
    }
}

/// The covers that are tried, and the last one, are one step, which only ever goes on.
#[test]
fn a_bake_tells_how_much_of_its_model_is_covered() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torus.fan");
    let mesh = Mesh::from_model(fantex_mesh::generate::torus(40, 26), "torus").unwrap();
    let whole = LongestEdge::Texels(0);
    let baker = || Baker::new(&mesh).source(Source::solid("wood")).texels(60_000).overwrite(true);
    for (longest_edge, is_plan) in [(whole, true), (whole, false), (LongestEdge::Automatic, true)] {
        let heard = Heard::default();
        let baker = baker().longest_edge(longest_edge).progress(&heard);
        if is_plan { baker.write_plan(&path, b"") } else { baker.write(&path) }.unwrap();
        let (shares, reports) = heard.0.into_inner().unwrap();
        assert!(shares.len() > 10 && shares[0] == 0.0 && shares[shares.len() - 1] == 1.0, "{shares:?}");
        assert!(shares.windows(2).all(|pair| pair[0] < pair[1]), "{shares:?}");
        assert_eq!(reports.is_empty(), is_plan);
    }
    // So does covering alone, of a model without colours as well.
    for longest_edge in [whole, LongestEdge::Automatic] {
        let heard = Heard::default();
        let baker = Baker::new(&mesh).texels(60_000).longest_edge(longest_edge);
        let covered = baker.progress(&heard).cover_shape().unwrap();
        assert_eq!(covered.texels_asked, Some(60_000));
        assert!(longest_edge != whole || covered.mesh.triangles == mesh.triangles);
        let (shares, reports) = heard.0.into_inner().unwrap();
        assert!(shares.len() > 10 && shares[0] == 0.0 && shares[shares.len() - 1] == 1.0, "{shares:?}");
        assert!(shares.windows(2).all(|pair| pair[0] < pair[1]) && reports.is_empty(), "{shares:?}");
    }
    // Whoever knows no such steps hears of thousandths first.
    #[derive(Default)]
    struct Reports(Mutex<Vec<[u64; 2]>>);
    impl Progress for Reports {
        fn report(&self, done: u64, total: u64) {
            self.0.lock().unwrap().push([done, total]);
        }
    }
    let heard = Reports::default();
    baker().longest_edge(whole).progress(&heard).write(&path).unwrap();
    let reports = heard.0.into_inner().unwrap();
    let covered = reports.iter().position(|report| *report == [1000, 1000]).unwrap();
    assert!(reports[..covered].windows(2).all(|pair| pair[0] < pair[1] && pair[0][1] == 1000));
    assert!(reports[0] == [0, 1000] && reports[covered + 1][0] == 0, "{reports:?}");
}

/// Cards of leaves and tiled walls show the same texels thousands of times.
#[test]
fn textures_that_repeat_get_a_number_of_texels_that_a_user_would_choose() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("square.fan");
    let plan = |repeats: u32, is_matched: bool| {
        let mesh = Mesh::load(tiled(folder.path(), repeats)).unwrap();
        let baker = Baker::new(&mesh).overwrite(true);
        let baker = if is_matched { baker.matching() } else { baker };
        let look = baker.own_look().unwrap();
        assert_eq!(look.is_limited, repeats == 160, "{look:?}");
        let baked = baker.write_plan(&path, b"").unwrap();
        let expected = look.texels.unwrap();
        assert!(is_matched || baked.cover.texels.abs_diff(expected) < expected / 2, "{look:?}");
        (baked.cover.texels, baked.notes)
    };
    // 64 x 160 texels along a side.
    let (texels, notes) = plan(160, false);
    assert!((15_000_000..=16_000_000).contains(&texels), "{texels}");
    let told = "at their own density these were about 104 million texels; it is given about 16 million";
    assert_eq!(notes.iter().filter(|note| note.contains(told)).count(), 1, "{notes:?}");
    // Whoever asks for it gets it.
    let (texels, notes) = plan(160, true);
    assert!(texels > 90_000_000 && notes.is_empty(), "{texels} {notes:?}");
    // Few texels may be shown as often as they like.
    let (texels, notes) = plan(50, false);
    assert!((9_000_000..14_000_000).contains(&texels) && notes.is_empty(), "{texels} {notes:?}");
}

#[test]
fn a_texture_that_is_not_there_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = Mesh::load(tiled(folder.path(), 1)).unwrap();
    let image = folder.path().join("color.png");
    let kept = std::fs::read(&image).unwrap();
    std::fs::remove_file(&image).unwrap();
    let place = |name: &str| folder.path().join(name);
    let baked = Baker::new(&mesh).texels(1000).write(place("square.fan")).unwrap();
    let note = &baked.notes[0];
    assert!(note.contains("color.png") && note.contains("put the file there"), "{note}");
    // Said before the work begins.
    let heard = UpToNote::default();
    Baker::new(&mesh).texels(1000).progress(&heard).write(place("ended.fan")).unwrap_err();
    assert_eq!(heard.0.lock().unwrap()[0], *note);
    let strict = Baker::new(&mesh).texels(1000).strict(true);
    let error = strict.write(place("strict.fan")).unwrap_err();
    assert_eq!((error.kind(), error.path()), (ErrorKind::NotFound, Some(&*image)));
    assert!(!place("strict.fan").exists());
    // Onto another model, and as a look that starts from the model's materials.
    let detailed = Baker::new(&mesh).texels(1000).source(Source::mesh(place("square.obj")));
    let notes = detailed.write(place("mesh.fan")).unwrap().notes;
    assert!(notes.iter().any(|note| note.contains("square.obj: a texture was left out")), "{notes:?}");
    std::fs::write(place("a.toml"), "[materials.a]\nfrom = \"model\"\nroughness = 0.5\n").unwrap();
    let look = || Baker::new(&mesh).texels(1000).source(Source::look(place("a.toml")));
    let notes = look().write(place("look.fan")).unwrap().notes;
    assert!(notes[0].contains("color.png"), "{notes:?}");
    look().strict(true).write(place("strict.fan")).unwrap_err();
    // Parts are baked without it, or all with it.
    let plan = |name: &str| {
        Baker::new(&mesh).texels(1000).write_plan(place(name), b"").unwrap();
        Plan::open(&place(name)).unwrap()
    };
    let part = |plan: &Plan, name: &str| {
        Baker::new(&mesh).texels(1000).write_part(plan, 1, 1, place(name)).map(|baked| baked.notes)
    };
    let without = plan("without.plan");
    assert!(part(&without, "a.part").unwrap().is_empty());
    std::fs::write(&image, kept).unwrap();
    let refused = part(&without, "b.part").unwrap_err().to_string();
    assert!(refused.contains("color.png") && refused.contains("plan anew"), "{refused}");
    let with = plan("with.plan");
    std::fs::remove_file(&image).unwrap();
    let refused = part(&with, "c.part").unwrap_err().to_string();
    assert!(refused.contains("color.png") && refused.contains("plan anew"), "{refused}");
}

/// Texels of 64 x 64 on two triangles, as a glTF's sampler may ask for them.
#[test]
fn textures_of_squares_are_told_of_unless_there_are_texels_enough() {
    let folder = tempfile::tempdir().unwrap();
    let path = tiled(folder.path(), 1);
    let notes = |nearest: bool, shown: f32, texels: u64| {
        let mut model = load(&path, &LoadOptions::default()).unwrap();
        for texture in model.materials.iter_mut().filter_map(|material| material.base_color_texture.as_mut())
        {
            texture.nearest = nearest;
            texture.uv_transform = Mat3::from_scale(Vec2::splat(shown));
        }
        let mesh = Mesh::from_model(model, &path).unwrap();
        let baker = Baker::new(&mesh).texels(texels).overwrite(true);
        baker.write_plan(folder.path().join("square.fan"), b"").unwrap().notes
    };
    let is_told = |notes: &[String]| notes.iter().any(|note| note.contains("are to appear as squares"));
    let told = notes(true, 1.0, 4096);
    assert!(is_told(&told) && told.iter().any(|note| note.contains("about 66 000 texels")), "{told:?}");
    assert!(!is_told(&notes(false, 1.0, 4096)));
    assert!(!is_told(&notes(true, 1.0, 66_000)));
    // Half of one texel, as of a palette.
    assert!(!is_told(&notes(true, 0.5 / SIDE as f32, 1)));
}

/// The squares of such lengths are infinite.
#[test]
fn positions_at_the_end_of_single_precision_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("far.obj");
    let far = f32::MAX;
    std::fs::write(&model, format!("v {far} 0 0\nv -{far} {far} 0\nv 0 -{far} {far}\nf 1 2 3\n")).unwrap();
    let mesh = Mesh::load(&model).unwrap();
    let path = folder.path().join("far.fan");
    let error = Baker::new(&mesh).source(Source::solid("wood")).texels(1000).write(&path).unwrap_err();
    let expected = "the model is about 3e38 units large, and textures are evaluated on 1e-18 to 1e18; scale it, or remove stray vertices";
    assert_eq!(error.to_string(), expected);
    let look = folder.path().join("marble.toml");
    let text = "[textures.a]\nkind = \"marble\"\n[materials.a]\nbase_color = \"a\"\n";
    std::fs::write(&look, text).unwrap();
    let error = Baker::new(&mesh).source(Source::look(&look)).texels(1000).write(&path).unwrap_err();
    assert_eq!(error.to_string(), expected);
    assert!(!path.exists());
}

#[test]
fn looks_are_baked_on_models_of_all_sizes() {
    let folder = tempfile::tempdir().unwrap();
    let look = folder.path().join("marble.toml");
    let text = "[textures.a]\nkind = \"marble\"\n[materials.a]\nbase_color = \"a\"\n";
    std::fs::write(&look, text).unwrap();
    for half in [1e-16, 1e13] {
        let model = folder.path().join("cube.obj");
        std::fs::write(&model, cube(0, 0.0, half, false)).unwrap();
        let mesh = Mesh::load(&model).unwrap();
        let path = folder.path().join("cube.fan");
        let baker = Baker::new(&mesh).source(Source::look(&look)).texels(1000);
        baker.overwrite(true).write(&path).unwrap();
    }
}

/// A cube with its fronts outside or inside, around a middle on the x axis.
fn cube(from: u32, middle: f64, half: f64, is_inward: bool) -> String {
    let mut text = String::new();
    for corner in 0..8 {
        let at = |axis: u32| if corner >> axis & 1 == 0 { -half } else { half };
        text += &format!("v {} {} {}\n", middle + at(0), at(1), at(2));
    }
    for quad in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
        let corners = if is_inward { [quad[3], quad[2], quad[1], quad[0]] } else { quad };
        let [a, b, c, d] = corners.map(|corner| from + corner + 1);
        text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
    }
    text
}

#[test]
fn parts_that_no_light_reaches_are_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let (model, look) = (folder.path().join("cubes.obj"), folder.path().join("light.toml"));
    let sun = "[[light]]\nkind = \"sun\"\nto_light = [1, 2, 0.5]\n";
    let lamp = "[[light]]\nkind = \"point\"\nposition = [0, 0, 0]\n";
    let told = |cubes: &[String], lights: &str, glow: f32| {
        std::fs::write(&model, cubes.concat()).unwrap();
        let material = format!("[materials.a]\nbase_color = 0.5\nemission = {glow:?}\n");
        std::fs::write(&look, format!("{material}{lights}[bake]\nlight = {{ samples = 4 }}\n")).unwrap();
        let mesh = Mesh::load(&model).unwrap();
        let baker = Baker::new(&mesh).source(Source::look(&look)).texels(1000).overwrite(true);
        let notes = baker.write_plan(folder.path().join("cubes.fan"), b"").unwrap().notes;
        notes.into_iter().find(|note| note.starts_with("no light reaches"))
    };
    let [outward, inward] = [false, true].map(|is_inward| cube(0, 0.0, 1.0, is_inward));
    let beside = |is_inward| cube(8, 5.0, 1.0, is_inward);
    let expected = "no light reaches the fronts of 1 closed part (12 triangles): the model is inside out there; turn these triangles over";
    assert_eq!(told(&[inward.clone(), beside(false)], sun, 0.0).as_deref(), Some(expected));
    let both = told(&[inward.clone(), beside(true)], sun, 0.0).unwrap();
    assert!(both.contains("2 closed parts (24 triangles)"), "{both}");
    assert_eq!(told(&[outward.clone(), beside(false)], sun, 0.0), None);
    // Rooms: with a lamp in them, with something in them, with walls that glow.
    assert_eq!(told(std::slice::from_ref(&inward), lamp, 0.0), None);
    assert_eq!(told(&[inward.clone(), cube(8, 0.0, 0.5, false)], sun, 0.0), None);
    assert_eq!(told(&[inward], sun, 1.0), None);
    // The hollow of a ball.
    assert_eq!(told(&[outward, cube(8, 0.0, 0.5, true)], sun, 0.0), None);
}

/// Pictures with less than was asked for have notes that say how to get it.
#[cfg(feature = "export")]
#[test]
fn models_say_what_they_lack() {
    let summary = ExportSummary {
        sizes: vec![[64; 2]],
        charts: 3,
        padding: 16,
        used_share: 0.5,
        density_share: 0.33,
        cut_off: vec![(ChannelMap::Emission, 8.0)],
        ..ExportSummary::default()
    };
    let notes = |kind| model_notes(Path::new("a.png"), &summary, kind);
    let cut_off = "a.png: emission of up to 8.000 is cut off at 1 in PNG; .exr and .ktx2 hold it";
    let told = notes(ModelKind::Exported { fans: false, padding: Some(64) });
    assert!(told[0].starts_with("a.png: 64 texels a side hold 33 % of the asset's density"), "{told:?}");
    assert_eq!(told[1], cut_off);
    assert!(
        told[2].contains("a padding of 16 texels instead of the 64 asked for") && told.len() == 3,
        "{told:?}"
    );
    assert!(notes(ModelKind::Baked { side: None })[0].contains("33 % of the density that was asked for"));
    // Who asks for a side does not ask for a density.
    assert_eq!(notes(ModelKind::Baked { side: Some(64) }), [cut_off]);
}

/// Only who has asked for the model's coordinates is told to leave them.
#[cfg(feature = "export")]
#[test]
fn notes_on_shared_texels_depend_on_the_layout() {
    let kind = ModelKind::Exported { fans: false, padding: None };
    for (charts, names_the_option) in [(0, true), (3, false)] {
        let summary = ExportSummary {
            charts,
            used_share: 0.5,
            density_share: 1.0,
            overlapping_share: 0.01,
            ..ExportSummary::default()
        };
        let notes = model_notes(Path::new("a.glb"), &summary, kind);
        assert!(notes.len() == 1 && notes[0].contains("1.0 % of the used texels"), "{notes:?}");
        assert_eq!(notes[0].contains("--uv source"), names_the_option, "{notes:?}");
    }
}

#[cfg(feature = "export")]
#[test]
fn channels_without_a_sheet_are_named() {
    use fantex::store::ChannelKind;
    let left_out = [ChannelKind::Displacement, ChannelKind::Anisotropy].to_vec();
    let summary = ExportSummary {
        charts: 3,
        used_share: 0.5,
        density_share: 1.0,
        left_out,
        ..ExportSummary::default()
    };
    let kind = ModelKind::Exported { fans: true, padding: None };
    let notes = model_notes(Path::new("a.usda"), &summary, kind);
    assert!(notes[0].contains("no sheet of the heights; --channel displacement"), "{notes:?}");
    assert_eq!(notes[1..], ["a.usda: stretched highlights are left out"]);
}
