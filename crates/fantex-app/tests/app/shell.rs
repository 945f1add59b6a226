//! The program's arguments.

use clap::{CommandFactory, Parser};
use fantex_app::shell::Arguments;

#[test]
fn the_arguments_are_consistent() {
    Arguments::command().debug_assert();
    let arguments = Arguments::parse_from(["fantex-app", "a.fan", "--size", "800x600"]);
    assert_eq!(arguments.size, Some([800.0, 600.0]));
    assert!(Arguments::try_parse_from(["fantex-app", "--size", "8"]).is_err());
    for (text, bytes) in [
        ("512M", Some(512 << 20)),
        ("16777216", Some(16 << 20)),
        ("2G", Some(2 << 30)),
        ("1.5g", Some(3 << 29)),
    ] {
        assert_eq!(Arguments::parse_from(["fantex-app", "--memory", text]).memory, bytes);
    }
    for text in ["1K", "x", "99999999999G"] {
        assert!(Arguments::try_parse_from(["fantex-app", "--memory", text]).is_err(), "{text}");
    }
}

#[test]
fn sessions_leave_the_user_s_settings_alone() {
    let arguments = Arguments::parse_from(["fantex-app", "--session", "s.json"]);
    assert_eq!(arguments.settings_file(), None);
    let arguments = Arguments::parse_from(["fantex-app", "--session", "s.json", "--settings", "t.json"]);
    assert_eq!(arguments.settings_file(), Some("t.json".into()));
}
