//! `fantex serve`: an asset or a world at an address of this machine, for browsers and for whatever reads ranges.

use std::ops::Range;
use std::path::{Path, PathBuf};

use clap::Args;
use fantex::base::uri_escaped;
use fantex::store::{Asset, ByteSource};
use fantex::stream::read::first_ranges;
use fantex::stream::{open_preview, url_of};
use fantex::{Error, FileKind, Result, World};
use fantex_web::Page;
use serde::Serialize;

use crate::context::Context;
use crate::server::{Content, Server, Site};
use crate::text::{counted, within};

/// Serve an asset or a world to browsers and programs on this machine.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex serve bunny.fan
  fantex serve bunny.fan --port 8080
  fantex serve land.fanworld

A browser shows the asset at the address that is printed (it needs WebGPU), and other programs read it at the address of the file. \
The server is reached from this machine only, sends nothing but what it names, and ends with Ctrl-C. An asset that changes is \
served as it is then; who has the old one open is told so. Of a world the index is served and the assets that it names now.")]
pub(crate) struct ServeArgs {
    /// An asset (.fan) or a world (.fanworld)
    asset: PathBuf,
    /// The port of the address [default: any that is free]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = port)]
    port: Option<u16>,
    /// Let pages at other addresses read the asset (CORS)
    #[arg(long)]
    share: bool,
}

#[derive(Debug, Serialize)]
struct ServeInfo {
    /// Where a browser begins.
    url: String,
    /// The asset, or the index of the world.
    asset_url: String,
}

fn port(text: &str) -> Result<u16, String> {
    within(text, "expected a whole number from 1 to 65535", |port: u16| port > 0)
}

pub(crate) fn run(args: &ServeArgs, context: &Context) -> Result<()> {
    if let Some(url) = url_of(&args.asset) {
        return Err(Error::unsupported(format!("{url} has an address already; give a file of this machine")));
    }
    let mut site = Site::new(args.share);
    // What cannot be shown is refused at once, not by the browser.
    let ranges = if World::is_named(&args.asset) {
        add_assets(&mut site, &args.asset, context)?;
        Vec::new()
    } else {
        FileKind::check_is_asset(&args.asset)?;
        ranges_ahead(&**Asset::open(&args.asset)?.source())
    };
    let name = file_name(&args.asset)?;
    let encoded = uri_escaped(&name);
    site.add(&name, Content::File(args.asset.clone()));
    let title = args.asset.file_stem().and_then(|stem| stem.to_str()).unwrap_or(&name);
    let page = match fantex_web::files() {
        Some(files) => {
            files.iter().for_each(|(name, content)| site.add(name, Content::Bytes((*content).into())));
            Page { title, asset: &encoded, ranges: &ranges, ..Page::default() }.html()
        }
        None => {
            context.note(format!("the page at this address only names the asset: {NO_VIEWER}"));
            plain_page(&name, &encoded)
        }
    };
    site.add("", Content::Bytes(page.into_bytes().into()));
    let port = args.port.unwrap_or(0);
    let cannot = |error: std::io::Error| {
        let place = if port == 0 { String::new() } else { format!(" at port {port}") };
        Error::unavailable(format!("cannot listen{place} on this machine: {error}; ask for another --port"))
    };
    let server = Server::bind(site, port).map_err(cannot)?;
    let url = format!("http://{}/", server.address().map_err(cannot)?);
    let info = ServeInfo { asset_url: format!("{url}{encoded}"), url };
    // From here on Ctrl-C is how the server ends.
    let _deferral = context.defer_interrupt();
    context.print(&info, |info| format!("{}\n", info.url))?;
    context.note(format!("serving {} at {}; Ctrl-C ends it", args.asset.display(), info.asset_url));
    let serving = std::thread::Builder::new().name("fan-listen".into()).spawn(move || server.run());
    serving.map_err(|error| Error::unavailable(format!("cannot start a thread for the server: {error}")))?;
    context.wait_for_interrupt();
    Ok(())
}

/// What a page asks for before its viewer is there; nothing where that is not known.
pub(crate) fn ranges_ahead(asset: &dyn ByteSource) -> Vec<Range<u64>> {
    first_ranges(asset).unwrap_or_default()
}

/// Adds the assets of a world by their names in the index. Those at addresses of their own are read there.
fn add_assets(site: &mut Site, index: &Path, context: &Context) -> Result<()> {
    let world = World::open(index)?;
    world.space_to_show(index)?;
    let mut elsewhere = 0;
    for (node, asset) in world.assets().enumerate() {
        let place = World::place_of(index, asset);
        if url_of(&place).is_some() {
            elsewhere += 1;
            continue;
        }
        let name = path_below(index, asset)?;
        match node < world.objects.len() {
            true => drop(open_preview(&place)?),
            false => drop(World::open_coarse(&place)?),
        }
        site.add(&name, Content::File(place));
    }
    if elsewhere > 0 {
        let assets = counted(elsewhere, "asset");
        context.note(format!(
            "{}: not served, as it is read at an address of its own: {assets}",
            index.display()
        ));
    }
    Ok(())
}

/// Where an asset of a world lies on a server, below the folder of the index.
pub(crate) fn path_below(index: &Path, asset: &str) -> Result<String> {
    World::path_below(asset).ok_or_else(|| {
        let index = index.display();
        Error::unsupported(format!(
            "{index} names {asset}, which does not lie below its folder and so has no address below that of the index; copy it there"
        ))
    })
}

/// Why a page cannot show an asset, and what to do.
pub(crate) const NO_VIEWER: &str = "this program was built without the viewer for browsers; in a copy of its sources, 'cargo xtask web' builds \
                                    the viewer, and then 'cargo build --release' the program with it";

pub(crate) fn file_name(path: &Path) -> Result<String> {
    let name = path.file_name().and_then(|name| name.to_str()).map(str::to_owned);
    name.ok_or_else(|| Error::invalid(format!("the name of {} is no text; rename it", path.display())))
}

/// What a browser is told where there is no viewer for it.
fn plain_page(name: &str, encoded: &str) -> String {
    let name = name.replace('&', "&amp;").replace('<', "&lt;");
    format!(
        "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>{name}</title>\n\
         <p><a href=\"{encoded}\">{name}</a>: give this address to <code>fantex view</code>.\n"
    )
}
