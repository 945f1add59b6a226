//! What can be opened, and what is told of it.

use fantex_app::document::{Document, Fact, OpenProgress, Place, bytes_text, grouped, short_number};

#[test]
fn places_are_files_or_addresses() {
    assert_eq!(Place::parse("HTTPS://a.b/c.fan?x=1"), Place::Url("HTTPS://a.b/c.fan?x=1".into()));
    assert_eq!(Place::parse("https://a.b/c.fan?x=1").name(), "c.fan");
    assert_eq!(Place::parse("models/a.glb").name(), "a.glb");
    assert_eq!(Place::parse("http.glb"), Place::File("http.glb".into()));
}

#[test]
fn numbers_are_readable() {
    assert_eq!(grouped(1_234_567), "1\u{a0}234\u{a0}567");
    assert_eq!(grouped(12), "12");
    assert_eq!(bytes_text(64.0 * 1024.0 * 1024.0), "64.0 MiB");
    assert_eq!(bytes_text(12.0), "12 B");
    assert_eq!(short_number(0.012_345), "0.0123");
    assert_eq!(short_number(12_345.6), "12\u{a0}346");
    assert_eq!(short_number(-1e6), "-1\u{a0}000\u{a0}000");
    assert_eq!(short_number(999.4), "999");
    assert_eq!(short_number(1.5e9), "1.50e9");
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
