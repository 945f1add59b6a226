//! Writing model files.
