//! The gallery's page: `index.html`, one file without scripts.

use std::fmt::Write;

use super::catalogue::{CHAPTERS, Entry};

/// An entry with its finished pictures.
pub(super) struct Exhibit<'e> {
    pub(super) entry: &'e Entry,
    pub(super) pictures: Vec<Exposed>,
    /// The text of the look that made them, if one did.
    pub(super) look: Option<String>,
}

/// A finished picture.
pub(super) struct Exposed {
    /// Relative to the page.
    pub(super) file: String,
    pub(super) caption: String,
    /// What was changed in the look for this picture, as TOML.
    pub(super) changes: String,
}

const STYLE: &str = "\
body{margin:0 auto;max-width:78rem;padding:1rem 2rem 4rem;font:16px/1.5 system-ui,sans-serif;color:#222;background:#fafafa}
h1{font-weight:600}h2{margin-top:3rem;border-bottom:1px solid #ccc}h3{margin:2.2rem 0 .3rem}
nav a{margin-right:1rem}.row{font:600 .75rem system-ui;background:#246;color:#fff;border-radius:.3rem;padding:.1rem .4rem;margin-right:.3rem}
.pictures{display:flex;flex-wrap:wrap;gap:.8rem}figure{margin:0;flex:1 1 15rem;max-width:40rem}
img{width:100%;height:auto;display:block;border-radius:.3rem;background:#ddd}figcaption{font-size:.9rem;color:#444}
pre{background:#eee;padding:.6rem .8rem;border-radius:.3rem;overflow-x:auto;font-size:.85rem}
@media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}figcaption{color:#aaa}pre{background:#262626}a{color:#8bf}}";

/// The page's text.
pub(super) fn page(exhibits: &[Exhibit]) -> String {
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>fantex: the gallery</title>\n<style>{STYLE}</style>\n<h1>fantex: the gallery</h1>\n\
         <p>Every technique of the toolbox, each made by the look beneath its pictures. A look is a TOML file: \
         <code>fantex render LOOK.toml -o picture.png</code> renders it, \
         <code>fantex bake MODEL --look LOOK.toml -o asset.fan</code> puts it into seamless tiles.</p>\n<nav>"
    );
    for (letter, title, _) in CHAPTERS {
        push(&mut html, format_args!("<a href=\"#{letter}\">{title}</a>"));
    }
    html.push_str("</nav>\n");
    for (letter, title, _) in CHAPTERS {
        let chapter = || exhibits.iter().filter(|e| chapter_of(e.entry) == Some(letter));
        if chapter().next().is_none() {
            continue;
        }
        push(&mut html, format_args!("<h2 id=\"{letter}\">{title}</h2>\n"));
        chapter().for_each(|exhibit| section(&mut html, exhibit));
    }
    html.push_str("</html>\n");
    html
}

/// The chapter of an entry's first row.
fn chapter_of(entry: &Entry) -> Option<char> {
    entry.rows.first()?.chars().next()
}

fn section(html: &mut String, exhibit: &Exhibit) {
    let Entry { name, rows, title, idea, formula, .. } = exhibit.entry;
    push(html, format_args!("<section id=\"{}\">\n<h3>", escaped(name)));
    for row in rows {
        push(html, format_args!("<span class=\"row\">{}</span>", escaped(row)));
    }
    push(html, format_args!("{}</h3>\n<p>{}</p>\n", escaped(title), escaped(idea)));
    push(html, format_args!("<pre>{}</pre>\n<div class=\"pictures\">\n", escaped(formula.trim())));
    for Exposed { file, caption, .. } in &exhibit.pictures {
        let alternative = if caption.is_empty() { title } else { caption };
        push(
            html,
            format_args!(
                "<figure><a href=\"{0}\"><img src=\"{0}\" alt=\"{1}\" loading=\"lazy\"></a>\
                 <figcaption>{2}</figcaption></figure>\n",
                escaped(file),
                escaped(alternative),
                escaped(caption)
            ),
        );
    }
    html.push_str("</div>\n");
    if let Some(look) = &exhibit.look {
        push(html, format_args!("<details><summary>The look</summary>\n<pre>{}</pre>\n", escaped(look)));
        for Exposed { caption, changes, .. } in exhibit.pictures.iter().filter(|p| !p.changes.is_empty()) {
            push(html, format_args!("<p>{}:</p>\n<pre>{}</pre>\n", escaped(caption), escaped(changes)));
        }
        html.push_str("</details>\n");
    }
    html.push_str("</section>\n");
}

fn push(html: &mut String, text: std::fmt::Arguments) {
    html.write_fmt(text).unwrap_or_else(|_| unreachable!("writing to a string cannot fail"));
}

/// Text as HTML.
fn escaped(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut html, c| {
        match c {
            '&' => html.push_str("&amp;"),
            '<' => html.push_str("&lt;"),
            '>' => html.push_str("&gt;"),
            '"' => html.push_str("&quot;"),
            c => html.push(c),
        }
        html
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped() {
        assert_eq!(escaped("a < b & \"c\""), "a &lt; b &amp; &quot;c&quot;");
    }

    #[test]
    fn entries_appear_in_their_chapter_with_look_and_changes() {
        let entry = Entry {
            name: "filters".to_owned(),
            rows: vec!["T9".to_owned()],
            title: "Filters".to_owned(),
            idea: "Near & far.".to_owned(),
            formula: "c = mean".to_owned(),
            look: Some("filters.toml".to_owned()),
            drawn_by: None,
            pictures: Vec::new(),
        };
        let picture = |caption: &str| Exposed {
            file: format!("{caption}.png"),
            caption: caption.to_owned(),
            changes: "filter = \"nearest\"".to_owned(),
        };
        let pictures = vec![picture("nearest"), picture("bilinear")];
        let html = page(&[Exhibit { entry: &entry, pictures, look: Some("[camera]".to_owned()) }]);
        assert!(html.contains("<h2 id=\"T\">") && !html.contains("<h2 id=\"M\">"));
        assert!(html.contains("Near &amp; far.") && html.contains("src=\"bilinear.png\""));
        assert_eq!(html.matches("filter = &quot;nearest&quot;").count(), 2);
    }
}
