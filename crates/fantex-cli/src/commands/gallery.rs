//! `fantex gallery`: one picture, or a few side by side, for every technique, and a page that shows them.
//!
//! ```text
//! gallery/gallery.toml --entries--> looks, each with some keys changed --render--> DIR/NAME-1.png ..
//!                      '----------> drawings of the program -----------/           DIR/index.html
//! ```

mod drawings;

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use fantex::Error;
use fantex::look::LookFile;
use fantex::look_scene::{LookScene, PictureChanges, Wardrobe};
use fantex::texture::Image;
use fantex::texture::look::{LookImages, ResolveOptions};
use serde::{Deserialize, Serialize};

use crate::commands::export::turntable::Animation;
use crate::context::Context;
use crate::error::CliError;
use crate::text::counted;

/// Render one picture for every technique, and a page that explains them.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex gallery -o gallery-pictures
  fantex gallery -o some wood T5 L6

Open index.html in the folder with a browser. Names are those of entries (wood) or of rows of the feature list (T5).")]
pub(crate) struct GalleryArgs {
    /// Entries or rows; all where none is given
    names: Vec<String>,
    /// Folder for the pictures and the page
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Width of all pictures in pixels; as their looks say by default
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(16..=8192))]
    width: Option<u32>,
}

#[derive(Debug, Serialize)]
struct GalleryInfo {
    page: PathBuf,
    pictures: Vec<PathBuf>,
    seconds: f64,
}

/// Runs the command.
pub(crate) fn run(args: &GalleryArgs, context: &Context) -> Result<(), CliError> {
    let started = Instant::now();
    let pictures = make(args, context)?;
    let info = GalleryInfo {
        page: args.output.join("index.html"),
        pictures,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| {
        let pictures = counted(info.pictures.len() as u64, "picture");
        format!("{pictures} in {:.1} s: {}", info.seconds, info.page.display())
    })
}

/// The folder with the catalogue and the looks, in this folder or beside the program.
const FOLDER: &str = "gallery";

/// Makes the pictures and the page; returns the pictures' paths.
fn make(args: &GalleryArgs, context: &Context) -> Result<Vec<PathBuf>, CliError> {
    let GalleryArgs { names, output, width } = args;
    let folder = folder()?;
    let catalogue = Catalogue::read(&folder)?;
    let entries = catalogue.select(names)?;
    context.make_folder(output)?;
    let artist = Artist { folder: &folder, output, width: *width, context };
    let mut exhibits = Vec::with_capacity(entries.len());
    for (number, entry) in entries.iter().enumerate() {
        context.check_interrupt()?;
        context.note(format!("{} of {}: {}", number + 1, entries.len(), entry.name));
        exhibits.push(artist.exhibit(entry)?);
    }
    let page = output.join("index.html");
    std::fs::write(&page, html_page(&exhibits))
        .map_err(|error| Error::writing(&page, error))?;
    Ok(exhibits.iter().flat_map(|e| &e.pictures).map(|p| output.join(&p.file)).collect())
}

fn folder() -> Result<PathBuf, CatalogueError> {
    let built = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(FOLDER);
    let found = [PathBuf::from(FOLDER), built].into_iter().find(|f| f.join("gallery.toml").is_file());
    found.ok_or(CatalogueError::Missing { path: Path::new(FOLDER).join("gallery.toml") })
}

/// Makes the pictures of entries.
struct Artist<'a> {
    folder: &'a Path,
    output: &'a Path,
    width: Option<u32>,
    context: &'a Context,
}

impl Artist<'_> {
    fn exhibit<'e>(&self, entry: &'e Entry) -> Result<Exhibit<'e>, CliError> {
        match (&entry.look, &entry.drawn_by) {
            (Some(look), _) => self.by_look(entry, look),
            (None, Some(drawing)) => self.by_program(entry, drawing),
            (None, None) => Err(CatalogueError::NothingToDraw { entry: entry.name.clone() }.into()),
        }
    }

    fn by_look<'e>(&self, entry: &'e Entry, look: &str) -> Result<Exhibit<'e>, CliError> {
        let path = self.folder.join(look);
        let text = read(&path)?;
        let original: toml::Table =
            toml::from_str(&text).map_err(|source| CatalogueError::Parse { path: path.clone(), source })?;
        let mut pictures = Vec::new();
        for (index, variant) in entry.variants().iter().enumerate() {
            let file = self.file_name(entry, index);
            let changed = variant.apply(&entry.name, original.clone())?;
            let text = if variant.set.is_empty() { text.clone() } else { changed.to_string() };
            self.render(&LookFile::parse(&text, &path)?, &self.output.join(&file))?;
            pictures.push(exposed(file, variant));
        }
        Ok(Exhibit { entry, pictures, look: Some(text) })
    }

    /// One picture, or an animated one.
    fn render(&self, file: &LookFile, target: &Path) -> Result<(), CliError> {
        let size = self.width.map(|width| {
            let [w, h] = file.look().picture.size.map(|side| side.0);
            [width, (u64::from(width) * u64::from(h)).div_ceil(u64::from(w)) as u32]
        });
        let images = LookImages::default();
        let options = ResolveOptions { memory_bytes: self.context.memory_bytes, ..ResolveOptions::default() };
        let wardrobe = Wardrobe { file, images: &images, options };
        let scene = LookScene::new(wardrobe, None, PictureChanges { size, ..PictureChanges::default() })?;
        let times = scene.times();
        let mut frames = Vec::with_capacity(times.len());
        for &time in &times {
            self.context.check_interrupt()?;
            frames.push(scene.render(time)?.picture.to_srgb_image());
        }
        let frames_per_second = file
            .look()
            .picture
            .frames
            .as_ref()
            .map_or(1.0, |f| f64::from(f.count) / (f.to - f.from).max(1e-3));
        self.save(&frames, frames_per_second, target)
    }

    fn by_program<'e>(&self, entry: &'e Entry, drawing: &str) -> Result<Exhibit<'e>, CliError> {
        let unknown = || CatalogueError::NothingToDraw { entry: entry.name.clone() };
        let draw = drawings::by_name(drawing).ok_or_else(unknown)?;
        let drawn = draw(&drawings::Studio { width: self.width, context: self.context })?;
        let mut pictures = Vec::new();
        for (index, (caption, image)) in drawn.into_iter().enumerate() {
            let file = self.file_name(entry, index);
            self.save(&[image], 1.0, &self.output.join(&file))?;
            pictures.push(exposed(file, &Variant { caption, ..Variant::default() }));
        }
        Ok(Exhibit { entry, pictures, look: None })
    }

    fn file_name(&self, entry: &Entry, index: usize) -> String {
        format!("{}-{}.png", entry.name, index + 1)
    }

    fn save(&self, frames: &[Image], frames_per_second: f64, target: &Path) -> Result<(), CliError> {
        self.context.check_output(target)?;
        let _deferral = self.context.defer_interrupt();
        match frames {
            [image] => Ok(image.save(target)?),
            _ => {
                let mut animation =
                    Animation::new(target, &frames[0], frames.len() as u32, frames_per_second)?;
                frames.iter().try_for_each(|frame| animation.add(frame))?;
                animation.finish()
            }
        }
    }
}

fn exposed(file: String, variant: &Variant) -> Exposed {
    let changes = variant.set.iter().map(|(key, value)| format!("{key} = {value}\n")).collect();
    Exposed { file, caption: variant.caption.clone(), changes }
}

/// The rows of the feature list, by chapter.
const CHAPTERS: [(char, &str, u32); 5] = [
    ('F', "Fan texturing", 13),
    ('T', "Textures as functions", 10),
    ('M', "Mappings", 8),
    ('L', "What a texture drives", 13),
    ('E', "Environment", 4),
];

/// All entries, in the order of the page.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Catalogue {
    #[serde(rename = "entry")]
    entries: Vec<Entry>,
}

/// One technique.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    /// Names the pictures' files and the entry on the command line.
    name: String,
    /// Rows of the feature list that it shows.
    rows: Vec<String>,
    title: String,
    /// What is to be seen, and why.
    idea: String,
    /// How it is computed.
    formula: String,
    /// The look, a file beside the catalogue.
    look: Option<String>,
    /// Pictures that no look can make: the name of what draws them.
    drawn_by: Option<String>,
    /// Side by side; one picture of the look as it is where there is none.
    #[serde(default, rename = "picture")]
    pictures: Vec<Variant>,
}

/// A picture of an entry's look with some keys changed.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Variant {
    /// What distinguishes it from its neighbours.
    #[serde(default)]
    caption: String,
    /// New values by key path, such as `textures.photo.filter` or `light.0.strength`.
    #[serde(default)]
    set: toml::Table,
}

/// Why there is no gallery.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CatalogueError {
    #[error(
        "cannot find {} in this folder or beside the program; run the gallery in the project's folder",
        path.display()
    )]
    Missing { path: PathBuf },
    #[error("cannot read {}: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{} is no catalogue of a gallery: {source}", path.display())]
    Parse { path: PathBuf, source: toml::de::Error },
    #[error("there is no picture '{name}' in the gallery; there are {}", known.join(", "))]
    UnknownName { name: String, known: Vec<String> },
    #[error("the gallery's entry '{entry}' changes '{key}' of its look, which has no such table or list")]
    UnknownKey { entry: String, key: String },
    #[error("the gallery's entry '{entry}' has neither a look nor a drawing that is known")]
    NothingToDraw { entry: String },
    #[error("the gallery's entry '{entry}' names the row '{row}', which is not in the feature list")]
    UnknownRow { entry: String, row: String },
}

impl Catalogue {
    /// Reads `gallery.toml` in a folder.
    fn read(folder: &Path) -> Result<Self, CatalogueError> {
        let path = folder.join("gallery.toml");
        let text = read(&path)?;
        let catalogue: Self =
            toml::from_str(&text).map_err(|source| CatalogueError::Parse { path, source })?;
        for entry in &catalogue.entries {
            if let Some(row) = entry.rows.iter().find(|row| !is_row(row)) {
                return Err(CatalogueError::UnknownRow { entry: entry.name.clone(), row: row.clone() });
            }
        }
        Ok(catalogue)
    }

    /// The entries of these names, all where there are none.
    fn select(&self, names: &[String]) -> Result<Vec<&Entry>, CatalogueError> {
        let known = || self.entries.iter().map(|e| e.name.clone()).collect();
        if let Some(name) = names.iter().find(|name| !self.entries.iter().any(|e| e.is_called(name))) {
            return Err(CatalogueError::UnknownName { name: name.clone(), known: known() });
        }
        let wanted = |e: &&Entry| names.is_empty() || names.iter().any(|name| e.is_called(name));
        Ok(self.entries.iter().filter(wanted).collect())
    }
}

impl Entry {
    /// True for the entry's name and for each of its rows.
    fn is_called(&self, name: &str) -> bool {
        self.name == name || self.rows.iter().any(|row| row == name)
    }

    /// The pictures side by side, at least one.
    fn variants(&self) -> Vec<Variant> {
        if self.pictures.is_empty() { vec![Variant::default()] } else { self.pictures.clone() }
    }
}

impl Variant {
    /// A look's text with the changed values.
    fn apply(&self, entry: &str, look: toml::Table) -> Result<toml::Table, CatalogueError> {
        let mut root = toml::Value::Table(look);
        for (key, value) in &self.set {
            let unknown = || CatalogueError::UnknownKey { entry: entry.to_owned(), key: key.clone() };
            let (parents, last) = key.rsplit_once('.').unwrap_or(("", key));
            let mut steps = parents.split('.').filter(|step| !step.is_empty());
            let place = steps.try_fold(&mut root, child).ok_or_else(unknown)?;
            match place {
                toml::Value::Table(table) => {
                    table.insert(last.to_owned(), value.clone());
                }
                toml::Value::Array(items) => {
                    let index = last.parse::<usize>().ok().filter(|&i| i < items.len());
                    items[index.ok_or_else(unknown)?] = value.clone();
                }
                _ => return Err(unknown()),
            }
        }
        let toml::Value::Table(table) = root else { unreachable!("the root stays a table") };
        Ok(table)
    }
}

/// An entry of a table or a list; tables that are missing are made.
fn child<'v>(value: &'v mut toml::Value, step: &str) -> Option<&'v mut toml::Value> {
    match value {
        toml::Value::Table(table) => {
            Some(table.entry(step).or_insert_with(|| toml::Value::Table(toml::Table::new())))
        }
        toml::Value::Array(items) => items.get_mut(step.parse::<usize>().ok()?),
        _ => None,
    }
}

/// A file's text.
fn read(path: &Path) -> Result<String, CatalogueError> {
    std::fs::read_to_string(path).map_err(|source| CatalogueError::Read { path: path.into(), source })
}

fn is_row(row: &str) -> bool {
    CHAPTERS.iter().any(|&(letter, _, count)| {
        row.strip_prefix(letter).and_then(|n| n.parse::<u32>().ok()).is_some_and(|n| (1..=count).contains(&n))
    })
}

/// An entry with its finished pictures.
struct Exhibit<'e> {
    entry: &'e Entry,
    pictures: Vec<Exposed>,
    /// The text of the look that made them, if one did.
    look: Option<String>,
}

/// A finished picture.
struct Exposed {
    /// Relative to the page.
    file: String,
    caption: String,
    /// What was changed in the look for this picture, as TOML.
    changes: String,
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
fn html_page(exhibits: &[Exhibit]) -> String {
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

    fn changed(look: &str, set: &str) -> Result<toml::Table, CatalogueError> {
        let variant = Variant { caption: String::new(), set: toml::from_str(set).unwrap() };
        variant.apply("test", toml::from_str(look).unwrap())
    }

    #[test]
    fn values_are_changed_by_path() {
        let look = "[a]\nb = 1\n[[light]]\nkind = 'sun'\n";
        let table = changed(look, "'a.b' = 2\n'light.0.strength' = 3\n'c.d' = 4\n").unwrap();
        let expected = "[a]\nb = 2\n[[light]]\nkind = 'sun'\nstrength = 3\n[c]\nd = 4\n";
        assert_eq!(table, toml::from_str::<toml::Table>(expected).unwrap());
    }

    #[test]
    fn paths_that_lead_nowhere_are_refused() {
        for set in ["'light.1.strength' = 3", "'a.b.c' = 1", "'light.x' = 1"] {
            let refused = changed("[a]\nb = 1\n[[light]]\nkind = 'sun'\n", set);
            assert!(matches!(refused, Err(CatalogueError::UnknownKey { .. })), "{set}");
        }
    }

    #[test]
    fn rows_are_those_of_the_feature_list() {
        assert!(is_row("T10") && is_row("F1") && is_row("E4"));
        assert!(!is_row("T11") && !is_row("X1") && !is_row("E") && !is_row(""));
    }

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
        let html = html_page(&[Exhibit { entry: &entry, pictures, look: Some("[camera]".to_owned()) }]);
        assert!(html.contains("<h2 id=\"T\">") && !html.contains("<h2 id=\"M\">"));
        assert!(html.contains("Near &amp; far.") && html.contains("src=\"bilinear.png\""));
        assert_eq!(html.matches("filter = &quot;nearest&quot;").count(), 2);
    }
}
