//! Drawing the small pictures anew that guard the gallery.

use std::fs;
use std::process::Command;

use crate::shell::{Failure, cargo, root, run as run_command};

const WIDTH: &str = "320";

/// Replaces all goldens by what a program draws, or the one that is built here.
pub(crate) fn run(program: Option<&str>) -> Result<(), Failure> {
    let folder = root().join("gallery/goldens");
    let failed = |error: std::io::Error| Failure::new(format!("cannot write {}: {error}", folder.display()));
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(failed)?;
    }
    let target = folder.display().to_string();
    let arguments = ["gallery", "-o", &target, "--width", WIDTH];
    match program {
        Some(program) => run_command(Command::new(program).args(arguments))?,
        None => cargo(&[&["run", "--release", "--"], &arguments[..]].concat())?,
    }
    fs::remove_file(folder.join("index.html")).map_err(failed)?;
    for file in fs::read_dir(&folder).map_err(failed)? {
        let path = file.map_err(failed)?.path();
        let picture = fs::read(&path).map_err(failed)?;
        fs::write(&path, first_frame(&picture)).map_err(failed)?;
    }
    eprintln!("now: cargo run --release -p fantex-bench --example gallery_faults");
    Ok(())
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
