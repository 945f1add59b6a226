//! The files of a page with the viewer in it.

use std::ops::Range;

use fantex_base::markup_escaped;

/// Name and content.
pub type File = (&'static str, &'static [u8]);

/// What the page needs beside its own text, an asset and a picture; none where this program was built without the viewer (see
/// `cargo xtask web`).
pub fn files() -> Option<&'static [File]> {
    #[cfg(has_viewer)]
    return Some(&[
        ("viewer.js", include_bytes!("../page/viewer.js")),
        ("fantex_web.js", include_bytes!("../built/fantex_web.js")),
        ("fantex_web_bg.wasm", include_bytes!("../built/fantex_web_bg.wasm")),
    ]);
    #[cfg(not(has_viewer))]
    None
}

/// What a page says about an asset.
#[derive(Clone, Copy, Debug, Default)]
pub struct Page<'a> {
    /// What the asset is called.
    pub title: &'a str,
    /// Who made it, and what may be done with it; nothing where empty.
    pub credits: &'a str,
    /// The asset's address, as seen from the page.
    pub asset: &'a str,
    /// Bytes of the asset that the page asks for at once, before the viewer is there; where they are not those that the viewer asks for first,
    /// they are fetched in vain.
    pub ranges: &'a [Range<u64>],
    /// Address of the folder, with the slash at its end, for previews of links: most services take whole addresses only.
    pub base: &'a str,
}

impl Page<'_> {
    /// The page, `index.html`.
    pub fn html(&self) -> String {
        let credits = match self.credits {
            "" => String::new(),
            credits => format!(" \u{2013} {}", markup_escaped(credits)),
        };
        let range = |range: &Range<u64>| format!("{}-{}", range.start, range.end.saturating_sub(1));
        let ranges: Vec<String> = self.ranges.iter().map(range).collect();
        let description = if self.credits.is_empty() { self.title } else { self.credits };
        let fields = [
            ("title", markup_escaped(self.title)),
            ("description", markup_escaped(description)),
            ("credits", credits),
            ("asset", markup_escaped(self.asset)),
            ("ranges", ranges.join(" ")),
            ("base", markup_escaped(self.base)),
        ];
        let mut html = String::new();
        let mut rest = include_str!("../page/index.html");
        // In one pass: what is filled in is not searched for fields.
        while let Some((before, after)) = rest.split_once("{{") {
            let (name, after) = after.split_once("}}").unwrap_or_default();
            html += before;
            html += fields.iter().find(|(field, _)| *field == name).map_or("", |(_, text)| text);
            rest = after;
        }
        html + rest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_hold_what_they_are_told_and_no_more() {
        let title = "A \"vase\" <script>alert(1)</script> & {{base}}";
        let ranges = &[0..65_536, 70_000..70_001];
        let page =
            Page { title, credits: "by Åsa", asset: "a%20b.fan", ranges, base: "https://a.org/x/" }.html();
        assert!(page.contains(
            "<title>A &quot;vase&quot; &lt;script&gt;alert(1)&lt;/script&gt; &amp; {{base}}</title>"
        ));
        assert!(page.contains(r#"data-asset="a%20b.fan" data-ranges="0-65535 70000-70000""#));
        assert!(page.contains(r#"content="https://a.org/x/preview.png""#));
        assert!(page.contains("\u{2013} by Åsa</footer>"));
        assert_eq!(page.matches("<script").count(), 1);
        let plain = Page { title: "x", ..Page::default() }.html();
        assert!(plain.contains("<footer>x</footer>") && !plain.contains("{{"), "{plain}");
    }

    /// The page asks for what the viewer would ask for.
    #[test]
    fn requests_of_the_page_last_as_long_and_are_as_large_as_those_of_the_viewer() {
        let constant = |source: &str, name: &str| {
            let (_, declaration) = source.split_once(&format!("const {name}")).unwrap();
            declaration.split(['=', ';']).nth(1).unwrap().trim().to_owned()
        };
        let [page, viewer] =
            [include_str!("../page/viewer.js"), include_str!("../../fantex-stream/src/read/browser.rs")];
        for name in ["MAX_REQUEST_MILLISECONDS", "MAX_REQUEST_BYTES"] {
            assert_eq!(constant(page, name), constant(viewer, name));
        }
    }
}
