//! Sources to tiles.
