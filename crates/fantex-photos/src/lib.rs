//! Photographs with cameras as a source of colour, the way scanned things get theirs.
//!
//! ```text
//!  cameras.txt, .bin, transforms.json --read_cameras--> Photograph(s)
//!                                                           |
//!  image files --Pyramid: levels in pages--.                |
//!  mesh --SightMap: depths, clearance------+--> View <------'     survey: each photograph is read once
//!                                               |
//!      probes: what every View sees --> gains (exposure), fill (what no photograph sees), clusters (which Views matter where)
//!                                               |
//!                                          PhotoSource: a Source for bake()
//! ```
//!
//! Per point, photographs count by how well they see it (`view.rs`), all factors being continuous; those that are far from the best
//! do not count (`blend.rs`). Photographs are decoded once and kept as pages, in memory or in a scratch file (`pyramid.rs`), no finer
//! than texels are. [`CaptureScene`] takes photographs of a model, for sets with known answers.

mod blend;
mod cameras;
mod lens;
mod pyramid;
mod sight;
mod source;
mod survey;
mod view;

pub use cameras::*;
pub use lens::*;
pub use source::*;
pub use view::*;
