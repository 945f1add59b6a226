//! Drawing the small pictures anew that guard the gallery.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::shell::{Failure, cargo, root, run as run_command};

const WIDTH: &str = "320";

/// Replaces all goldens by what a program draws, or the one that is built here. Tolerances stay.
pub(crate) fn run(program: Option<&str>) -> Result<(), Failure> {
    let folder = root().join("gallery/goldens");
    let failed = |error: std::io::Error| Failure::new(format!("cannot write {}: {error}", folder.display()));
    for path in pictures(&folder).map_err(failed)? {
        fs::remove_file(&path).map_err(failed)?;
    }
    let target = folder.display().to_string();
    let arguments = ["gallery", "-o", &target, "--force", "--width", WIDTH];
    match program {
        Some(program) => run_command(Command::new(program).args(arguments))?,
        None => cargo(&[&["run", "--release", "--"], &arguments[..]].concat())?,
    }
    fs::remove_file(folder.join("index.html")).map_err(failed)?;
    for path in pictures(&folder).map_err(failed)? {
        let picture = fs::read(&path).map_err(failed)?;
        fs::write(&path, first_frame(&picture)).map_err(failed)?;
    }
    eprintln!("now: cargo run --release -p fantex-bench --example gallery_faults");
    Ok(())
}

fn pictures(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let paths: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|file| Ok(file?.path())).collect::<std::io::Result<_>>()?;
    Ok(paths
        .into_iter()
        .filter(|path| path.extension().is_some_and(|extension| extension == "png"))
        .collect())
}

/// A PNG without the chunks that animate it.
fn first_frame(png: &[u8]) -> Vec<u8> {
    let (signature, mut rest) = png.split_at(8.min(png.len()));
    let mut still = signature.to_vec();
    while let Some((length, kind)) = rest.first_chunk::<8>().map(|head| head.split_at(4)) {
        let length = u32::from_be_bytes([length[0], length[1], length[2], length[3]]) as usize;
        // Length, kind, content, checksum.
        let (chunk, later) = rest.split_at((length + 12).min(rest.len()));
        if !matches!(kind, b"acTL" | b"fcTL" | b"fdAT") {
            still.extend_from_slice(chunk);
        }
        rest = later;
    }
    still
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_first_frame_is_kept() {
        let chunk = |kind: &[u8], content: &[u8]| {
            [&(content.len() as u32).to_be_bytes(), kind, content, b"csum"].concat()
        };
        let png = [b"signed..".to_vec(), chunk(b"acTL", b"12"), chunk(b"IDAT", b"345"), chunk(b"fdAT", b"6")]
            .concat();
        assert_eq!(first_frame(&png), [b"signed..".to_vec(), chunk(b"IDAT", b"345")].concat());
    }
}
