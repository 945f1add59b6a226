//! What is remembered and chosen: settings, light, display, keys.

use std::path::PathBuf;

use eframe::egui::{Key, Modifiers};
use fantex::glam::DVec2;
use fantex::texture::Filter;
use fantex_app::camera::CameraMode;
use fantex_app::command::{Command, command_of, parse_keys, shortcuts};
use fantex_app::display::{DisplaySettings, Overlay};
use fantex_app::light::{LightPreset, LightSettings, MapKey, Surroundings};
use fantex_app::paint::paint_shortcuts;
use fantex_app::settings::{Settings, Tab, next_free, write_whole};

fn file(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("settings.json");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

#[test]
fn settings_come_back() {
    let (_folder, path) = file("{}");
    let mut settings = Settings::default();
    settings.camera.mode = CameraMode::Walk;
    settings.panels.tab = Tab::Light;
    settings.remember("a.glb");
    settings.save(&path).unwrap();
    let (again, problem) = Settings::load(&path);
    assert_eq!(again, settings);
    assert!(problem.is_none());
}

#[test]
fn a_first_start_has_no_file_and_no_problem() {
    let folder = tempfile::tempdir().unwrap();
    let (settings, problem) = Settings::load(&folder.path().join("none.json"));
    assert_eq!(settings, Settings::default());
    assert!(problem.is_none());
}

#[test]
fn damaged_settings_are_set_aside_and_reported() {
    for text in ["{\"camera\":", "[1]", "\0\0\0", "{\"camera\":{\"mode\":\"swim\"}}"] {
        let (_folder, path) = file(text);
        let (settings, problem) = Settings::load(&path);
        assert_eq!(settings, Settings::default());
        let problem = problem.unwrap().to_string();
        let aside = path.with_extension("damaged.json");
        assert!(problem.contains(&aside.display().to_string()), "{text}: {problem}");
        assert_eq!(std::fs::read_to_string(aside).unwrap(), text);
        assert!(!path.exists());
    }
}

#[test]
fn nonsense_numbers_are_brought_into_range() {
    let (_folder, path) = file(
        r#"{"window":{"size":[0,1e30]},"camera":{"fov_degrees":-4},"streaming":{"pool_mib":0},"display":{"anisotropy":5},
            "light":{"sun_strength":50,"background_blur":7},"paint":{"brush":{"size":null,"hardness":0.5}}}"#,
    );
    let (settings, problem) = Settings::load(&path);
    assert!(problem.is_none());
    assert_eq!(settings.window.size, [1280.0, 16_384.0]);
    assert_eq!(settings.camera.fov_degrees, 10.0);
    assert_eq!(settings.streaming.pool_mib, 1);
    assert_eq!(settings.display.anisotropy, 8);
    assert_eq!((settings.light.sun_strength, settings.light.background_blur), (10.0, 1.0));
    // An infinite number, as JSON has it.
    assert_eq!((settings.paint.brush.size, settings.paint.brush.hardness), (60.0, 0.5));
}

/// They are `null` in JSON, and all else is kept.
#[test]
fn numbers_that_are_none_do_not_cost_the_other_settings() {
    let (_folder, path) = file("{}");
    let mut settings = Settings::default();
    settings.remember("a.glb");
    let paint = &mut settings.paint;
    (paint.stencil.place.angle, paint.stencil.place.height) = (f64::NAN, 2.0);
    (paint.material.height, paint.sticker_degrees, paint.brush.spacing) =
        (f32::INFINITY, f32::NAN, f32::NEG_INFINITY);
    settings.save(&path).unwrap();
    let (again, problem) = Settings::load(&path);
    assert!(problem.is_none(), "{problem:?}");
    let paint = &mut settings.paint;
    (paint.stencil.place.angle, paint.material.height) = (0.0, 0.5);
    (paint.sticker_degrees, paint.brush.spacing) = (0.0, 0.12);
    assert_eq!(again, settings);
}

#[test]
fn the_last_file_is_the_first_of_the_recent_ones() {
    let mut settings = Settings::default();
    (0..20).for_each(|i| settings.remember(&format!("{i}.glb")));
    settings.remember("15.glb");
    assert_eq!(settings.recent[..3], ["15.glb", "19.glb", "18.glb"]);
    assert_eq!(settings.recent.len(), 12);
}

#[test]
fn folders_are_made_and_files_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a/b/c.txt");
    write_whole(&path, b"first").unwrap();
    write_whole(&path, b"second").unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), b"second");
    assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "no rest is left");
}

#[test]
fn failures_name_the_file() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("file"), b"").unwrap();
    let error = write_whole(&folder.path().join("file/below"), b"").unwrap_err();
    assert!(error.to_string().contains("below"));
}

/// Files of settings and looks may lie elsewhere, with a link where they are looked for.
#[cfg(unix)]
#[test]
fn links_and_permissions_stay() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let folder = tempfile::tempdir().unwrap();
    let [file, link] = ["file", "link"].map(|name| folder.path().join(name));
    std::fs::write(&file, b"first").unwrap();
    std::fs::set_permissions(&file, PermissionsExt::from_mode(0o640)).unwrap();
    symlink("file", &link).unwrap();
    write_whole(&link, b"second").unwrap();
    assert!(link.is_symlink());
    assert_eq!(std::fs::read(&file).unwrap(), b"second");
    assert_eq!(file.metadata().unwrap().permissions().mode() & 0o777, 0o640);
}

#[test]
fn names_count_up() {
    let folder = tempfile::tempdir().unwrap();
    let first = next_free(folder.path(), "bunny", "png", &[]);
    assert!(first.ends_with("bunny-001.png"));
    std::fs::write(first, b"").unwrap();
    assert!(next_free(folder.path(), "bunny", "png", &[]).ends_with("bunny-002.png"));
}

#[test]
fn the_default_sun_is_over_the_left_shoulder() {
    let to_sun = LightSettings::default().to_sun();
    assert!(to_sun.x < -0.3 && to_sun.y > 0.5 && to_sun.z > 0.3, "{to_sun}");
    assert!((to_sun.length() - 1.0).abs() < 1e-6);
}

#[test]
fn dragging_turns_the_sun_the_way_of_the_hand() {
    let mut light = LightSettings { sun_azimuth: 0.0, ..LightSettings::default() };
    let before = light.to_sun();
    light.drag_sun(DVec2::new(0.1, -0.1));
    let after = light.to_sun();
    assert!(after.x > before.x && after.y > before.y, "{before} {after}");
    light.drag_sun(DVec2::new(55.0, 99.0));
    assert!(light.sun_elevation == -90.0 && (0.0..360.0).contains(&light.sun_azimuth));
}

#[test]
fn the_sky_is_made_anew_where_the_sun_moves() {
    let mut light = LightSettings { surroundings: Surroundings::Sky, ..LightSettings::default() };
    let first = light.map_key().unwrap();
    assert_eq!(light.map_key().unwrap(), first);
    light.drag_sun(DVec2::new(0.05, 0.0));
    assert_ne!(light.map_key().unwrap(), first);
    light.sun_elevation = -40.0;
    let map = light.map_key().unwrap().make().unwrap();
    assert!(map.sun_color.is_some());
    assert!(light.lights(Some(&map)).defect().is_none());
}

#[test]
fn missing_pictures_are_named() {
    let error = MapKey::File("no/such/sky.hdr".into()).make().unwrap_err();
    assert!(error.to_string().contains("sky.hdr"));
}

#[test]
fn presets_differ() {
    let usual = LightSettings::default();
    let all = LightPreset::ALL.map(|(preset, _)| preset);
    for preset in all {
        let light = preset.light(&usual);
        let found: Vec<_> = all.into_iter().filter(|other| other.is_in(&light)).collect();
        assert_eq!(found, [preset]);
    }
}

#[test]
fn keys_go_round_all_overlays() {
    let mut display = DisplaySettings::default();
    for (overlay, _) in Overlay::ALL {
        assert_eq!(display.overlay, overlay);
        display.step_overlay(1);
    }
    assert_eq!(display.overlay, Overlay::None);
    display.step_overlay(-1);
    assert_eq!(display.overlay, Overlay::BlendBands);
}

#[test]
fn exposure_is_in_stops() {
    let mut display = DisplaySettings::default();
    display.change_exposure(2.0);
    assert_eq!(display.exposure(), 4.0);
    display.change_exposure(99.0);
    assert_eq!(display.exposure_stops, 8.0);
}

#[test]
fn without_anisotropy_the_filter_is_trilinear() {
    let display = DisplaySettings { anisotropy: 1, ..DisplaySettings::default() };
    assert_eq!(display.filter().filter, Filter::Trilinear);
}

#[test]
fn no_key_has_two_meanings() {
    let all = shortcuts();
    for (i, a) in all.iter().enumerate() {
        for b in &all[..i] {
            assert!(!(a.key == b.key && a.modifiers == b.modifiers), "{} and {}", a.text, b.text);
            assert_ne!(a.command, b.command, "one key per command");
        }
    }
}

#[test]
fn movement_keys_are_no_commands() {
    for key in [Key::W, Key::A, Key::S, Key::D, Key::Q, Key::E] {
        assert_eq!(command_of(false, Modifiers::NONE, key), None, "{key:?} moves the camera");
    }
}

#[test]
fn keys_are_found_as_they_are_written() {
    for shortcut in shortcuts() {
        let (modifiers, key) = parse_keys(&shortcut.keys().replace(' ', "")).unwrap();
        assert_eq!(command_of(false, modifiers, key), Some(shortcut.command));
    }
    assert_eq!(parse_keys("Ctrl+Nonsense"), None);
    assert_eq!(parse_keys("Hyper+A"), None);
    assert_eq!(command_of(false, Modifiers::NONE, Key::Questionmark), Some(Command::ToggleHelp));
    assert_eq!(command_of(false, Modifiers::ALT, Key::O), None);
}

#[test]
fn no_key_of_the_painter_has_two_meanings() {
    let all = paint_shortcuts();
    for (i, a) in all.iter().enumerate() {
        assert!(all[..i].iter().all(|b| !(a.key == b.key && a.modifiers == b.modifiers)), "{}", a.text);
        let (modifiers, key) = parse_keys(&a.keys().replace(' ', "")).unwrap();
        assert_eq!(command_of(true, modifiers, key).as_ref(), Some(&a.command));
    }
}

#[test]
fn the_viewer_s_keys_stay_where_painting_needs_none() {
    let help = command_of(true, Modifiers::NONE, Key::F1);
    assert_eq!(help, Some(Command::ToggleHelp));
    assert_eq!(command_of(false, Modifiers::NONE, Key::X), Some(Command::ToggleShadows));
}

#[test]
fn memory_for_geometry_is_brought_into_range() {
    let (_folder, path) = file(r#"{"streaming":{"geometry_mib":0}}"#);
    assert_eq!(Settings::load(&path).0.streaming.geometry_mib, 16);
}

/// What comes later does not hide what failed.
#[test]
fn errors_outlast_other_messages() {
    let mut notices = fantex_app::notices::Notices::default();
    notices.error("The disk is full.");
    (0..9).for_each(|n| notices.info(format!("Saved {n}")));
    let shown: Vec<String> = notices.shown().map(|notice| notice.text.clone()).collect();
    assert_eq!(shown, ["The disk is full.", "Saved 6", "Saved 7", "Saved 8"]);
    (0..4).for_each(|n| notices.error(format!("Error {n}")));
    notices.info("Saved");
    let shown: Vec<String> = notices.shown().map(|notice| notice.text.clone()).collect();
    assert_eq!(shown, ["Error 1", "Error 2", "Error 3", "Saved"]);
}
