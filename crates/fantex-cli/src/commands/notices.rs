//! `fantex notices`: licences of what the program is made of.

use clap::Args;
use fantex::Result;
use serde::Serialize;

use crate::context::Context;

/// Print the licences of all that fantex is made of: crates, fonts, models, images
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex notices > NOTICES.txt")]
pub(crate) struct NoticesArgs {}

#[derive(Serialize)]
struct Notices {
    notices: &'static str,
}

pub(crate) fn run(context: &Context) -> Result<()> {
    context.print(&Notices { notices: fantex_assets::NOTICES }, |result| result.notices.to_owned())
}
