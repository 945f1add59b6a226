//! What can be opened, and what is told of it.

use std::path::Path;

use fantex::mesh::generate::torus;
use fantex::mesh::{Model, WriteGeometry, write_model};
use fantex::paint::{PaintOptions, Painter, StrokeLog, replay};
use fantex::store::{Asset, ChannelKind};
use fantex::texture::{ColorSpace, Image, Samples};
use fantex_app::document::{Document, Fact, ForPainting, OpenProgress, Place};
use fantex_app::paint::{Answer, NewAsset, Question};

#[test]
fn places_are_files_or_addresses() {
    assert_eq!(Place::parse("HTTPS://a.b/c.fan?x=1"), Place::Url("HTTPS://a.b/c.fan?x=1".into()));
    assert_eq!(Place::parse("https://a.b/c.fan?x=1").name(), "c.fan");
    assert_eq!(Place::parse("models/a.glb").name(), "a.glb");
    assert_eq!(Place::parse("http.glb"), Place::File("http.glb".into()));
}

#[test]
fn what_cannot_be_opened_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        Place::File(path)
    };
    let message = |place: &Place| Document::open(place, &OpenProgress::default()).unwrap_err().to_string();
    assert!(message(&file("look.toml", b"")).contains("is a look"));
    assert!(message(&file("a.fan", b"nonsense")).contains("not a .fan asset"));
    assert!(message(&file("a.glb", b"nonsense")).contains("a.glb"));
    assert!(message(&Place::File(folder.path().join("none.obj"))).contains("cannot read"));
    assert!(message(&Place::File(folder.path().into())).contains("folder"));
    assert!(message(&Place::parse("https://example.org/a.glb")).contains("download it first"));
}

#[test]
fn opening_can_be_cancelled() {
    let progress = OpenProgress::default();
    progress.cancel();
    let error = Document::open(&Place::parse("none.obj"), &progress).unwrap_err();
    assert!(error.is_cancelled());
}

#[test]
fn models_tell_their_facts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("triangle.obj");
    std::fs::write(&path, "v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let document = Document::open(&Place::File(path), &OpenProgress::default()).unwrap();
    assert_eq!(document.model_facts[0], Fact { name: "Triangles", value: "1".into() });
    assert_eq!(document.model_facts[2].value, "2.00 × 1.00 × 0");
    assert!(document.cover_facts.is_empty());
}

/// Tiled walls show the same texels thousands of times.
#[test]
fn a_model_that_repeats_its_textures_is_offered_what_a_bake_would_give() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let image = Image {
        width: 64,
        height: 64,
        channels: 1,
        space: ColorSpace::Linear,
        samples: Samples::U8((0..64 * 64).map(|i| (i * 5) as u8).collect()),
    };
    image.save(at("brick.png")).unwrap();
    std::fs::write(at("wall.mtl"), "newmtl a\nmap_Kd brick.png\n").unwrap();
    for (repeats, texels, is_limited) in [(160, 16_000_000, true), (50, 10_240_000, false)] {
        let wall = format!(
            "mtllib wall.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt {repeats} 0\nvt {repeats} {repeats}\nvt 0 {repeats}\n\
             usemtl a\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
        );
        std::fs::write(at("wall.obj"), wall).unwrap();
        let place = Place::File(at("wall.obj"));
        let opened = Document::open_for_painting(&place, 64 << 20, None, None, &OpenProgress::default());
        let Ok(ForPainting::Question(Question::New { look, .. })) = opened else {
            panic!("nothing is asked")
        };
        assert_eq!(look.is_limited, is_limited, "{look:?}");
        assert!(look.texels.unwrap().abs_diff(texels) < texels / 100, "{look:?}");
    }
}

pub(crate) fn save_torus(path: &Path, rings: u32, force: bool) {
    save_shape(path, &torus(rings, rings / 2), force);
}

/// The shape of a model, without colours.
pub(crate) fn save_shape(path: &Path, model: &Model, force: bool) {
    let geometry = WriteGeometry { positions: &model.positions, triangles: &model.triangles, colors: None };
    write_model(path, &geometry, force).unwrap();
}

/// An asset of another mesh is never painted on without a word, and its strokes can be repeated on the model's.
#[test]
fn a_model_asks_how_it_becomes_an_asset() {
    let folder = tempfile::tempdir().unwrap();
    let (model, path) = (folder.path().join("torus.ply"), folder.path().join("torus.fan"));
    save_torus(&model, 24, false);
    let open = |answer: Option<Answer>| {
        let place = Place::File(model.clone());
        Document::open_for_painting(&place, 64 << 20, answer.as_ref(), None, &OpenProgress::default())
    };
    let Ok(ForPainting::Question(question)) = open(None) else { panic!("nothing is asked") };
    let channels = [ChannelKind::BaseColor, ChannelKind::OcclusionRoughnessMetallic];
    let Question::New { asset, look } = &question else { panic!("{question:?}") };
    assert!(*asset == path && look.channels.iter().all(|kind| channels.contains(kind)), "{question:?}");
    assert!(look.texels.is_none() && !look.is_limited, "{question:?}");
    assert!(!path.exists());
    let new = NewAsset { texels: Some(30_000), height: true, hard_edges: Some(70.0), ..NewAsset::default() };
    assert!(matches!(open(Some(Answer::New(new.clone()))).unwrap(), ForPainting::Ready(_)));
    let asset = Asset::open(&path).unwrap();
    assert!(asset.channel_of_kind(ChannelKind::Displacement).is_some());
    assert!((20_000..40_000).contains(&asset.cover().stored_texels(asset.mesh())));
    drop(asset);
    let mut painter = Painter::open(&path, &PaintOptions::default()).unwrap();
    let text = r#"{ "version": 1, "strokes": [{ "brush": { "size": { "world": 0.5 }, "hardness": 1 },
        "channels": [{ "kind": "base_color", "color": { "linear": [1, 0, 0, 1] } },
            { "kind": "displacement", "color": { "linear": [1, 1, 1, 1] } }],
        "samples": [{ "at": { "position": [1.4, 0, 0] } }] }] }"#;
    std::fs::write(folder.path().join("strokes.json"), text).unwrap();
    let strokes = fantex::paint::StrokeFile::load(&folder.path().join("strokes.json")).unwrap();
    replay(&mut painter, &strokes, folder.path()).unwrap();
    painter.commit().unwrap();
    drop(painter);
    // The same model again: nothing is asked.
    let Ok(ForPainting::Ready(ready)) = open(None) else { panic!("it is asked again") };
    assert!(ready.0.notes[0].contains("was there already"), "{:?}", ready.0.notes);
    drop(ready);

    save_torus(&model, 32, true);
    let Ok(ForPainting::Question(question)) = open(None) else { panic!("nothing is asked") };
    let Question::Foreign { triangles, strokes: 1, .. } = question else { panic!("{question:?}") };
    assert_eq!(triangles, [32 * 16 * 2, 24 * 12 * 2]);
    let told = open(Some(Answer::New(new.clone()))).unwrap_err().to_string();
    assert!(told.contains("made of another mesh (576 triangles)"), "{told}");
    let Ok(ForPainting::Ready(ready)) = open(Some(Answer::Keep)) else { panic!("it is asked again") };
    assert_eq!(ready.0.mesh().triangles.len(), 576);
    drop(ready);
    // Another program paints on it: all stays as it is.
    let files = || std::fs::read_dir(folder.path()).unwrap().count();
    let (before, other) = (files(), Painter::open(&path, &PaintOptions::default()).unwrap());
    assert!(open(Some(Answer::Replay(new.clone()))).is_err());
    drop(other);
    assert_eq!((Asset::open(&path).unwrap().mesh().triangles.len(), files()), (576, before));
    // It gets the old one's height and hard edges.
    let new = NewAsset { height: false, hard_edges: None, ..new };
    let Ok(ForPainting::Ready(ready)) = open(Some(Answer::Replay(new))) else { panic!("it is asked again") };
    assert_eq!(files(), before + 2, "the old asset and the new one's lock");
    let (document, painter) = *ready;
    assert_eq!(document.mesh().triangles.len(), 1024);
    assert!(document.notes[0].contains("Painted 1 stroke on"), "{:?}", document.notes);
    let old = Asset::open(&folder.path().join("torus-old-001.fan")).unwrap();
    assert_eq!(old.mesh().triangles.len(), 576);
    let asset = painter.editor().asset();
    assert_eq!(StrokeLog::of(asset).unwrap().strokes.strokes.len(), 1);
    assert!(asset.channel_of_kind(ChannelKind::Displacement).is_some());
    assert_eq!([asset.cover(), old.cover()].map(|cover| cover.hard_edges), [Some(70.0); 2]);
}
