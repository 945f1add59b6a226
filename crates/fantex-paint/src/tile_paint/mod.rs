//! From dabs to stored texels.
//!
//! ```text
//!  dabs --cover--> coverage per texel --composite--> pages of level 0 --levels--> coarser pages, means
//!          (kept for the whole stroke)  (from the bytes before the stroke)
//! ```
//!
//! Every tile that shows a point takes the same function of the surface at its texels, so tiles agree where they overlap
//! and the texture function stays as continuous as the stroke. Coverage is gathered over the stroke and applied to the texels as
//! they were before it: that is what caps a stroke at its opacity, and repeated showing costs no quality.

mod composite;
mod cover;
mod encode;
mod ink;
mod level_work;
mod levels;
mod normals;
mod painter;
mod preview;
mod rect;
mod room;
mod shade;
mod smudge;
mod state;
mod stencil;
mod step;
mod stroke_page;
mod texel_page;

pub(crate) use composite::composite;
pub(crate) use cover::{Patch, TexelUnder, cover_texels, fill_page, for_each_page};
pub(crate) use encode::{copy_blocks, replace_blocks};
pub(crate) use ink::{Ink, look_up, nearest_inside};
pub(crate) use normals::tangent_from_picture;
pub(crate) use painter::OpenStroke;
pub use painter::{PaintOptions, Painter, StrokeSummary};
pub use preview::PreviewPage;
pub(crate) use rect::Rect;
pub(crate) use shade::shade;
pub(crate) use stencil::see_through;
pub(crate) use step::Changes;
pub(crate) use stroke_page::StrokePage;
pub(crate) use texel_page::TexelPage;
