//! Pictures of the scene on their way from the graphics memory to a file.

use std::path::{Path, PathBuf};

use eframe::wgpu;
use fantex::base::{Error, ErrorKind, Result};
use fantex::gpu::{Gpu, Readback};
use fantex::texture::{ColorSpace, Image, Samples};

/// A picture that is being drawn and copied.
#[derive(Debug)]
pub struct Capturing {
    path: PathBuf,
    texture: wgpu::Texture,
    readback: Readback,
}

#[derive(Debug)]
pub struct Captured {
    pub path: PathBuf,
    pub image: Result<Image>,
}

/// What was drawn for a file could not be read back.
pub(crate) fn lost_picture(path: &Path) -> Error {
    let message = format!("the picture for {} could not be read from the graphics memory", path.display());
    Error::new(ErrorKind::Unavailable, message).with_path(path)
}

impl Capturing {
    /// Somewhere to draw.
    pub(super) fn new(gpu: &Gpu, size: [u32; 2], path: PathBuf) -> Result<Self> {
        let most = gpu.limits().max_texture_dimension_2d;
        let [width, height] = size;
        if size.contains(&0) || size.iter().any(|&n| n > most) {
            return Err(Error::invalid(format!(
                "a picture of {width}x{height} pixels cannot be taken; its sides must have 1 to {most} pixels"
            )));
        }
        let texture = super::target(gpu, "picture for a file", size, wgpu::TextureUsages::COPY_SRC);
        let readback = Readback::new(gpu, &texture)?;
        Ok(Self { path, texture, readback })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn view(&self) -> wgpu::TextureView {
        self.texture.create_view(&Default::default())
    }

    /// Submits what draws the picture, and its way into main memory.
    pub(super) fn submit(self, gpu: &Gpu, mut encoder: wgpu::CommandEncoder) -> Self {
        self.readback.record(&mut encoder, &self.texture);
        gpu.queue.submit([encoder.finish()]);
        self.readback.begin();
        self
    }

    /// Whether [`Capturing::finish`] has something to read, or never will.
    pub(super) fn is_ready(&self) -> bool {
        self.readback.is_ready()
    }

    /// The error where the device is gone.
    pub(super) fn into_lost(self) -> Error {
        lost_picture(&self.path)
    }

    /// The error where something else is shown before it was taken.
    pub(super) fn into_left(self) -> Error {
        let path = self.path;
        let message = format!("the picture for {} was not taken: its scene was left before", path.display());
        Error::new(ErrorKind::Unavailable, message).with_path(path)
    }

    /// The picture, without alpha.
    pub(super) fn finish(self) -> Captured {
        let mut samples = Vec::new();
        let rgb =
            |row: &[u8]| samples.extend(row.chunks_exact(4).flat_map(|texel| [texel[0], texel[1], texel[2]]));
        let read = self.readback.rows(rgb);
        let (width, height) = (self.texture.width(), self.texture.height());
        let image = read.map_err(|_| lost_picture(&self.path)).map(|()| Image {
            width,
            height,
            channels: 3,
            space: ColorSpace::Srgb,
            samples: Samples::U8(samples),
        });
        Captured { path: self.path, image }
    }
}
