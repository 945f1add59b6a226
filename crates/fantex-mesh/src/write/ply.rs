//! Binary little-endian PLY.

use std::io::{self, Write};

use super::{WriteGeometry, fits_single_precision, srgb_bytes};

/// Positions are floats where these hold them exactly, doubles else; colours are four sRGB bytes.
pub(super) fn write(geometry: &WriteGeometry, out: &mut impl Write) -> io::Result<()> {
    let is_single = fits_single_precision(geometry.positions);
    write_header(geometry, is_single, out)?;
    for (index, position) in geometry.positions.iter().enumerate() {
        for coordinate in position.to_array() {
            match is_single {
                true => out.write_all(&(coordinate as f32).to_le_bytes())?,
                false => out.write_all(&coordinate.to_le_bytes())?,
            }
        }
        if let Some(colors) = geometry.colors {
            out.write_all(&srgb_bytes(colors[index]))?;
        }
    }
    for triangle in geometry.triangles {
        let mut row = [3; 13];
        for (bytes, index) in row[1..].as_chunks_mut::<4>().0.iter_mut().zip(triangle) {
            *bytes = index.to_le_bytes();
        }
        out.write_all(&row)?;
    }
    Ok(())
}

fn write_header(geometry: &WriteGeometry, is_single: bool, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {}", geometry.positions.len())?;
    let scalar = if is_single { "float" } else { "double" };
    for axis in ["x", "y", "z"] {
        writeln!(out, "property {scalar} {axis}")?;
    }
    if geometry.colors.is_some() {
        for channel in ["red", "green", "blue", "alpha"] {
            writeln!(out, "property uchar {channel}")?;
        }
    }
    // Many readers know signed indices only; larger ones need the unsigned type.
    let index = if geometry.positions.len() <= i32::MAX as usize { "int" } else { "uint" };
    writeln!(out, "element face {}", geometry.triangles.len())?;
    writeln!(out, "property list uchar {index} vertex_indices\nend_header")
}
