//! The vectors of the processor.

use std::sync::LazyLock;

use fearless_simd::Level;

/// The widest instructions for vectors that the processor has, found out once.
#[inline]
pub fn vector_level() -> Level {
    static LEVEL: LazyLock<Level> = LazyLock::new(Level::new);
    *LEVEL
}
