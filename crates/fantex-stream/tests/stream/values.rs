//! Places in the atlas, camera paths, addresses.

use std::path::Path;

use fantex_stream::{AtlasPlace, CameraPath, TableEntry, url_of};
use glam::DVec3;

#[test]
fn entries_keep_places() {
    assert_eq!(TableEntry::ABSENT.place(), None);
    for place in [
        AtlasPlace { layer: 0, x: 0, y: 0 },
        AtlasPlace { layer: 127, x: 16380, y: 4 },
        AtlasPlace { layer: 5, x: 4, y: 16380 },
    ] {
        assert_eq!(TableEntry::at(place).place(), Some(place));
    }
}

#[test]
fn paths_pass_their_keyframes_and_jump_at_cuts() {
    let path = CameraPath::random_walk(DVec3::ZERO, 2.0, 5, 3.0);
    for keyframe in &path.keyframes {
        let there = path.at(keyframe.seconds).unwrap();
        assert!(DVec3::from(there.eye).distance(keyframe.eye.into()) < 1e-9);
    }
    let cuts = CameraPath::cuts(DVec3::ZERO, &[2.0, 3.0], 1.0);
    assert_eq!(cuts.cuts_seconds(), [0.0, 1.0]);
    assert_eq!(cuts.at(0.9995).unwrap().eye, cuts.keyframes[0].eye);
    assert_eq!(cuts.at(1.0).unwrap().eye, cuts.keyframes[2].eye);
    assert_eq!(CameraPath::default().at(1.0), None);
}

#[test]
fn paths_are_recorded_as_text() {
    let path = CameraPath::fly(DVec3::ONE, DVec3::new(1.0, 1.0, -3.0), 2.0);
    let text = serde_json::to_string(&path).unwrap();
    assert_eq!(serde_json::from_str::<CameraPath>(&text).unwrap(), path);
}

#[test]
fn urls_are_told_from_paths() {
    assert_eq!(url_of(Path::new("https://example.org/a.fan")), Some("https://example.org/a.fan"));
    assert!(url_of(Path::new("HTTP://example.org/a.fan")).is_some());
    for path in ["a.fan", "/tmp/http/a.fan", "http:/a.fan", "C:\\a.fan", "ftp://example.org/a.fan"] {
        assert_eq!(url_of(Path::new(path)), None, "{path}");
    }
}
