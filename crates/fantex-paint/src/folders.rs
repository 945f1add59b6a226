//! Folders of looks as an asset keeps them: relative to the asset where they lie with it, so that both can be moved together.

use std::path::{Component, Path, PathBuf};

/// Folders above the asset's own within which a look counts as lying with the asset.
const FOLDERS_UP: usize = 1;

/// The folder as it is kept in an asset: relative, with slashes, where it lies in the asset's folder or in the one above that;
/// else absolute.
pub(crate) fn kept_folder(asset: &Path, folder: &Path) -> PathBuf {
    let folder = absolute(folder);
    for (up, base) in home(asset).ancestors().take(1 + FOLDERS_UP).enumerate() {
        // Everything lies below the root.
        if base.parent().is_none() {
            break;
        }
        let Ok(rest) = folder.strip_prefix(base) else { continue };
        let down = rest.components().map(Component::as_os_str).map(|name| name.to_string_lossy());
        let parts: Vec<_> = std::iter::repeat_n("..".into(), up).chain(down).collect();
        return if parts.is_empty() { PathBuf::from(".") } else { PathBuf::from(parts.join("/")) };
    }
    folder
}

/// The folder that was kept, absolute.
pub(crate) fn found_folder(asset: &Path, kept: &Path) -> PathBuf {
    if kept == Path::new(".") { home(asset) } else { home(asset).join(kept) }
}

/// The folder of an asset.
fn home(asset: &Path) -> PathBuf {
    absolute(asset).parent().map(Path::to_owned).unwrap_or_default()
}

fn absolute(path: &Path) -> PathBuf {
    if path.as_os_str().is_empty() {
        return std::env::current_dir().unwrap_or_default();
    }
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_move_with_the_asset() {
        let root = std::env::temp_dir();
        let at = |path: &str| root.join("project").join(path);
        for (folder, kept) in [("assets", "."), ("assets/looks/a", "looks/a"), ("looks", "../looks")] {
            assert_eq!(kept_folder(&at("assets/a.fan"), &at(folder)), PathBuf::from(kept));
            assert_eq!(
                kept_folder(&at("assets/a.fan"), &found_folder(&at("assets/a.fan"), Path::new(kept))),
                PathBuf::from(kept)
            );
        }
        let moved = root.join("elsewhere/assets/a.fan");
        assert_eq!(found_folder(&moved, Path::new("looks")), root.join("elsewhere/assets/looks"));
        let far = root.join("other");
        assert_eq!(kept_folder(&at("assets/deep/a.fan"), &far), far, "not with the asset");
        assert_eq!(found_folder(&moved, &far), far);
    }
}
