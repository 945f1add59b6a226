//! Verifying assets: structure, checksums and the continuity certificate.

use std::path::Path;

use crate::OpenError;

/// A jump of the texture function across an edge up to this passes: two orders below one 8-bit step, so that nothing
/// shows; floating-point rounding stays below it.
pub const JUMP_BOUND: f32 = 1e-4;

/// How to verify.
#[derive(Clone, Debug)]
pub struct VerifyOptions {
    /// Bytes of decoded pages to keep.
    pub memory_bytes: usize,
}

impl Default for VerifyOptions {
    /// 256 MiB.
    fn default() -> Self {
        Self { memory_bytes: 256 << 20 }
    }
}

/// Continuity of the texture function across edges.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Continuity {
    /// Largest difference of any channel between the two triangles of an edge, stored units.
    pub largest_jump: f32,
    /// Edges compared.
    pub edges: u64,
    /// Levels compared (the mixed ones count once each).
    pub levels: u32,
    /// Pairs of values compared.
    pub samples: u64,
    /// Edges left out.
    pub exempt_edges: u64,
}

/// What verification found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VerifyReport {
    /// No damage, no jump above [`JUMP_BOUND`].
    pub ok: bool,
    /// Tile levels with damage.
    pub damaged_tiles: u64,
    /// The certificate.
    pub continuity: Continuity,
    /// Detail levels of the tile with the most.
    pub levels: u32,
    /// Length of the file.
    pub bytes: u64,
}

/// Opens and verifies an asset on the current rayon pool.
pub fn verify(path: &Path, options: &VerifyOptions) -> Result<VerifyReport, OpenError> {
    let _ = (path, options);
    todo!()
}
