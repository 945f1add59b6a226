//! Wavefront OBJ.

use std::io::{self, Write};

use super::WriteGeometry;
use crate::load::srgb_from_linear;

/// Coordinates in the fewest digits that read back exactly; colours as three sRGB numbers after them.
pub(super) fn write(geometry: &WriteGeometry, out: &mut impl Write) -> io::Result<()> {
    for (index, position) in geometry.positions.iter().enumerate() {
        write!(out, "v")?;
        for coordinate in position.to_array() {
            let single = coordinate as f32;
            match f64::from(single) == coordinate {
                true => write!(out, " {single}")?,
                false => write!(out, " {coordinate}")?,
            }
        }
        if let Some(colors) = geometry.colors {
            let [r, g, b] = colors[index].truncate().to_array().map(|x| srgb_from_linear(x.clamp(0.0, 1.0)));
            write!(out, " {r:.5} {g:.5} {b:.5}")?;
        }
        writeln!(out)?;
    }
    for triangle in geometry.triangles {
        let [a, b, c] = triangle.map(|v| u64::from(v) + 1);
        writeln!(out, "f {a} {b} {c}")?;
    }
    Ok(())
}
