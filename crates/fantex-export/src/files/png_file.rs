//! PNG, row by row.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

use fantex_texture::color::{srgb8_from_linear, srgb16_from_linear, unorm8, unorm16};
use png::{BitDepth, ColorType, Encoder, SrgbRenderingIntent, StreamWriter};
use rayon::prelude::*;

use crate::error::ExportError;
use crate::maps::{Components, Map};
use crate::texels::RowSink;

/// Bits per sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Depth {
    /// Eight.
    #[default]
    Eight,
    /// Sixteen.
    Sixteen,
}

/// Writes a map as PNG.
pub(crate) struct PngSink {
    path: PathBuf,
    writer: Option<StreamWriter<'static, BufWriter<File>>>,
    map: Map,
    depth: Depth,
}

impl PngSink {
    /// Begins a square picture in `file`; `path` is what errors name.
    pub(crate) fn new(
        file: File,
        path: PathBuf,
        side: u32,
        map: Map,
        depth: Depth,
    ) -> Result<Self, ExportError> {
        let mut encoder = Encoder::new(BufWriter::with_capacity(1 << 20, file), side, side);
        encoder.set_color(match map.components {
            Components::One(_) => ColorType::Grayscale,
            Components::Rgb => ColorType::Rgb,
            Components::Rgba => ColorType::Rgba,
        });
        encoder.set_depth(if depth == Depth::Eight { BitDepth::Eight } else { BitDepth::Sixteen });
        if map.is_srgb {
            encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
        }
        let writer = encoder.write_header().and_then(png::Writer::into_stream_writer);
        match writer {
            Ok(writer) => Ok(Self { path, writer: Some(writer), map, depth }),
            Err(error) => Err(ExportError::Write { path, source: error.into() }),
        }
    }
}

impl RowSink for PngSink {
    fn rows(&mut self, values: &[[f32; 4]]) -> Result<(), ExportError> {
        let Self { map, depth, .. } = *self;
        let bytes: Vec<Vec<u8>> = values.par_chunks(1 << 14).map(|v| samples(v, &map, depth)).collect();
        let Some(writer) = &mut self.writer else { return Ok(()) };
        bytes
            .iter()
            .try_for_each(|bytes| writer.write_all(bytes))
            .map_err(|source| ExportError::Write { path: self.path.clone(), source })
    }

    fn finish(&mut self) -> Result<(), ExportError> {
        let Some(writer) = self.writer.take() else { return Ok(()) };
        writer.finish().map_err(|error| ExportError::Write { path: self.path.clone(), source: error.into() })
    }
}

/// The numbers of texels as PNG stores them.
fn samples(values: &[[f32; 4]], map: &Map, depth: Depth) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(values.len() * map.components.count() * 2);
    let mut put = |value: f32, is_color: bool| match (depth, is_color && map.is_srgb) {
        (Depth::Eight, true) => bytes.push(srgb8_from_linear(value)),
        (Depth::Eight, false) => bytes.push(unorm8(value)),
        (Depth::Sixteen, true) => bytes.extend(srgb16_from_linear(value).to_be_bytes()),
        (Depth::Sixteen, false) => bytes.extend(unorm16(value).to_be_bytes()),
    };
    for value in values {
        match map.components {
            Components::One(k) => put(value[k], true),
            Components::Rgb => value[..3].iter().for_each(|&v| put(v, true)),
            Components::Rgba => (0..4).for_each(|k| put(value[k], k < 3)),
        }
    }
    bytes
}
