//! The command line.

use std::path::PathBuf;

use clap::Parser;

use crate::session::{Session, SessionError};

/// Shows models and fan-textured assets, and paints on them.
#[derive(Clone, Debug, Parser)]
#[command(
    name = "fantex-app",
    version,
    max_term_width = 110,
    after_help = "\
Example:
  fantex-app bunny.fan
  fantex-app bottle.glb --size 1920x1080

F1 shows keys and mouse."
)]
pub struct Arguments {
    /// A model (.glb .gltf .obj .ply .stl) or an asset (.fan); an asset may be at an http:// or https:// address
    pub file: Option<String>,
    /// Paint on it: a model becomes an asset beside it first
    #[arg(long)]
    pub(super) paint: bool,
    /// Memory for pages while painting, such as 512M (KiB, MiB, GiB: K, M, G)
    #[arg(long, value_name = "SIZE", value_parser = memory_size)]
    pub(super) memory: Option<usize>,
    /// Steps that drive the viewer by itself (see docs/viewer.md); ends with exit code 1 where one fails
    #[arg(long, value_name = "JSON")]
    session: Option<PathBuf>,
    /// Where settings are kept; in the user's folder by default, nowhere in sessions
    #[arg(long, value_name = "JSON")]
    settings: Option<PathBuf>,
    /// Width and height of the window in points; as it was by default
    #[arg(long, value_name = "WxH", value_parser = window_size)]
    size: Option<[f32; 2]>,
    /// Where pictures are saved; in the user's pictures by default
    #[arg(long, value_name = "FOLDER")]
    pictures: Option<PathBuf>,
}

/// A text is no size of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected width x height in points, such as 1280x800")]
struct WindowSizeError;

fn window_size(text: &str) -> Result<[f32; 2], WindowSizeError> {
    let (width, height) = text.split_once(['x', 'X']).ok_or(WindowSizeError)?;
    let side = |s: &str| s.parse::<u16>().ok().filter(|&n| n > 0).map(f32::from).ok_or(WindowSizeError);
    Ok([side(width)?, side(height)?])
}

/// A text is no size of memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected at least 16M: a whole number of bytes, or one with K, M or G behind it")]
struct MemorySizeError;

/// Less than that is too little for a dab.
const LEAST_MEMORY: usize = 16 << 20;

fn memory_size(text: &str) -> Result<usize, MemorySizeError> {
    let units = [('K', 10), ('M', 20), ('G', 30)];
    let found = units.into_iter().find_map(|(unit, shift)| Some((text.strip_suffix(unit)?, shift)));
    let (digits, shift) = found.unwrap_or((text, 0));
    let count = digits.parse::<usize>().ok();
    let bytes = count.and_then(|count| count.checked_mul(1usize << shift));
    bytes.filter(|&bytes| bytes >= LEAST_MEMORY).ok_or(MemorySizeError)
}

impl Arguments {
    /// The session, where one is to be driven.
    pub(super) fn session(&self) -> Result<Option<Session>, SessionError> {
        self.session.as_deref().map(Session::load).transpose()
    }

    /// Where settings are read and written; sessions begin and end with the usual ones unless they name a file.
    pub(super) fn settings_file(&self) -> Option<PathBuf> {
        let usual = || eframe::storage_dir("fantex").map(|folder| folder.join("viewer.json"));
        self.settings.clone().or_else(|| if self.session.is_some() { None } else { usual() })
    }

    /// The window's size, where one is asked for.
    pub(super) fn window_size(&self) -> Option<[f32; 2]> {
        self.size
    }

    /// Where pictures are saved.
    pub(super) fn picture_folder(&self) -> PathBuf {
        let home = std::env::var_os("HOME").or_else(|| std::env::var_os("USERPROFILE"));
        let pictures = home.map(|home| PathBuf::from(home).join("Pictures")).filter(|folder| folder.is_dir());
        let here = || std::env::current_dir().unwrap_or_default();
        self.pictures.clone().or(pictures).unwrap_or_else(here)
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_arguments_are_consistent() {
        Arguments::command().debug_assert();
        let arguments = Arguments::parse_from(["fantex-app", "a.fan", "--size", "800x600"]);
        assert_eq!(arguments.size, Some([800.0, 600.0]));
        assert!(Arguments::try_parse_from(["fantex-app", "--size", "8"]).is_err());
        for (text, bytes) in [("512M", Some(512 << 20)), ("16777216", Some(16 << 20)), ("2G", Some(2 << 30))]
        {
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
}
