//! Animated PNG.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use fantex::texture::{Image, Samples};
use tempfile::NamedTempFile;

use crate::error::CliError;

/// An animated PNG that is being written, picture by picture, and repeats for ever; programs that know none show its first
/// picture. Whoever holds one holds a deferral of interrupts, too, since dropping it removes the unfinished file.
pub(crate) struct Animation {
    file: NamedTempFile,
    writer: png::Writer<BufWriter<File>>,
    target: PathBuf,
}

impl Animation {
    /// Begins a file of `count` pictures of the size of `first`.
    pub(crate) fn new(
        target: &Path,
        first: &Image,
        count: u32,
        frames_per_second: f64,
    ) -> Result<Self, CliError> {
        let failed = |source| CliError::Write { path: target.into(), source };
        let folder =
            target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut builder = tempfile::Builder::new();
        // Temporary files are private by default.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let file = builder.prefix(".fantex-").tempfile_in(folder).map_err(failed)?;
        let copy = file.as_file().try_clone().map_err(failed)?;
        let writer = header(first, count, frames_per_second, copy).map_err(|error| failed(error.into()))?;
        Ok(Self { file, writer, target: target.into() })
    }

    /// Adds a picture: 8 bits, of the first one's size.
    pub(crate) fn add(&mut self, image: &Image) -> Result<(), CliError> {
        let Samples::U8(bytes) = &image.samples else { return Ok(()) };
        let failed =
            |error: png::EncodingError| CliError::Write { path: self.target.clone(), source: error.into() };
        self.writer.write_image_data(bytes).map_err(failed)
    }

    /// Gives the file its name.
    pub(crate) fn finish(self) -> Result<(), CliError> {
        let Self { file, writer, target } = self;
        let named = |file: NamedTempFile| file.persist(&target).map(drop).map_err(|error| error.error);
        let finished = writer.finish().map_err(io::Error::from).and_then(|()| named(file));
        finished.map_err(|source| CliError::Write { path: target.clone(), source })
    }
}

fn header(
    first: &Image,
    count: u32,
    frames_per_second: f64,
    file: File,
) -> Result<png::Writer<BufWriter<File>>, png::EncodingError> {
    let mut encoder = png::Encoder::new(BufWriter::new(file), first.width, first.height);
    encoder.set_color(if first.channels == 4 { png::ColorType::Rgba } else { png::ColorType::Rgb });
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_animated(count, 0)?;
    encoder.set_frame_delay(1000, (1000.0 * frames_per_second).round().clamp(1.0, 60_000.0) as u16)?;
    encoder.write_header()
}
