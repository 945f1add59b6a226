//! The `.fan` asset: format, block codecs, writing, reading, verifying.

mod channel;
mod reader;
mod writer;

pub use channel::*;
pub use reader::*;
pub use writer::*;
