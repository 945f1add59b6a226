//! Writing assets.
