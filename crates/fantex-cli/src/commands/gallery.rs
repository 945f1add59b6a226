//! `fantex gallery`: one picture, or a few side by side, for every technique, and a page that shows them.
//!
//! ```text
//! gallery/gallery.toml --entries--> looks, each with some keys changed --render--> DIR/NAME-1.png ..
//!                      |----------> commands of the program ------------|          DIR/index.html
//!                      '----------> drawings of the program -----------/
//! ```

mod drawings;
mod formula;

use std::cell::{OnceCell, RefCell};
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use clap::Args;
use fantex::base::files::{scratch_folder, write_whole};
use fantex::base::markup_escaped;
use fantex::look::{LookFile, LookImages};
use fantex::look_scene::{LookScene, MaterialResolver, PictureChanges};
use fantex::texture::Image;
use fantex::{Error, Result};
use fantex_gallery::{CHAPTERS, Catalogue, Entry, Variant, read};
use serde::Serialize;

use crate::commands::export::turntable::Animation;
use crate::context::Context;
use crate::series::Series;
use crate::shipped::Shipped;
use crate::text::{ShownPath, counted};

/// Render one picture for every technique, and a page that explains them.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex gallery -o gallery-pictures
  fantex gallery -o some wood T5 F6

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
    /// Of moving pictures the first one alone
    #[arg(long)]
    still: bool,
}

#[derive(Debug, Serialize)]
struct GalleryInfo {
    page: ShownPath,
    pictures: Vec<ShownPath>,
    seconds: f64,
}

pub(crate) fn run(args: &GalleryArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    let pictures = make(args, context)?;
    let info = GalleryInfo {
        page: args.output.join("index.html").into(),
        pictures: pictures.into_iter().map(ShownPath::from).collect(),
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| {
        let pictures = counted(info.pictures.len() as u64, "picture");
        format!("{pictures} in {:.1} s: {}", info.seconds, info.page.display())
    })
}

fn make(args: &GalleryArgs, context: &Context) -> Result<Vec<PathBuf>> {
    let GalleryArgs { names, output, width, still } = args;
    let shipped = Shipped::open()?;
    let catalogue = Catalogue::read(&shipped.file("gallery"))?;
    let entries = catalogue.select(names).map_err(|error| Error::invalid(error.to_string()))?;
    context.make_folder(output)?;
    let page = output.join("index.html");
    context.check_output(&page)?;
    let gallery = Gallery {
        shipped: &shipped,
        output,
        width: *width,
        is_still: *still,
        context,
        series: RefCell::new(Series::of_files(context, output, "picture", None)),
        terrain: OnceCell::new(),
    };
    let mut finished_entries = Vec::with_capacity(entries.len());
    for (number, entry) in entries.iter().enumerate() {
        context.check_interrupt()?;
        context.note(format!("{} of {}: {}", number + 1, entries.len(), entry.name));
        finished_entries.push(gallery.finish(entry)?);
    }
    write_whole(&page, context.force, |out| out.write_all(html_page(&finished_entries).as_bytes()))?;
    Ok(finished_entries.iter().flat_map(|e| &e.pictures).map(|p| output.join(&p.file)).collect())
}

/// Makes the pictures of entries. `width`: of all pictures; each has its own where it is left out.
struct Gallery<'a> {
    shipped: &'a Shipped,
    output: &'a Path,
    width: Option<u32>,
    /// Of moving pictures the first one is enough.
    is_still: bool,
    context: &'a Context,
    series: RefCell<Series<'a>>,
    terrain: OnceCell<drawings::Baked>,
}

impl Gallery<'_> {
    fn finish<'e>(&self, entry: &'e Entry) -> Result<FinishedEntry<'e>> {
        match (&entry.look, &entry.drawn_by) {
            (Some(look), _) => self.by_look(entry, look),
            (None, Some(drawing)) => self.by_program(entry, drawing),
            (None, None) => self.by_commands(entry),
        }
    }

    fn by_look<'e>(&self, entry: &'e Entry, look: &str) -> Result<FinishedEntry<'e>> {
        let path = self.shipped.file("gallery").join(look);
        let text = read(&path)?;
        let original: toml::Table =
            toml::from_str(&text).map_err(|error| Error::malformed(error.to_string()).in_file(&path))?;
        let images = LookImages::default();
        let mut pictures = Vec::new();
        for (index, variant) in entry.variants().iter().enumerate() {
            let file = self.file_name(entry, index);
            let changed = variant.apply(&entry.name, original.clone())?;
            let text = if variant.set.is_empty() { text.clone() } else { changed.to_string() };
            self.render(&LookFile::parse(&text, &path)?, &images, &self.output.join(&file))?;
            pictures.push(finished(file, variant));
        }
        Ok(FinishedEntry { entry, pictures, listing: Some(("The look", text)) })
    }

    /// Runs the entry's commands in a folder of their own and takes the pictures that they write.
    fn by_commands<'e>(&self, entry: &'e Entry) -> Result<FinishedEntry<'e>> {
        let folder = scratch_folder()?;
        let mut transcript = String::new();
        for command in &entry.commands {
            self.context.check_interrupt()?;
            push(&mut transcript, format_args!("$ fantex {command}\n{}", self.run(command, folder.path())?));
        }
        let mut pictures = Vec::new();
        for (index, variant) in entry.pictures.iter().enumerate() {
            let made = folder.path().join(variant.file.as_deref().ok_or_else(|| nothing_to_draw(entry))?);
            let file = self.file_name(entry, index);
            let target = self.output.join(&file);
            let image = Image::load(&made)?;
            if self.width.is_some_and(|width| width < image.width) {
                self.save(&[self.reduced(image)?], 1.0, &target)?;
            } else {
                self.context.check_output(&target)?;
                self.series.borrow_mut().write(&target, || {
                    std::fs::copy(&made, &target).map(drop).map_err(|error| Error::writing(&target, error))
                })?;
            }
            pictures.push(finished(file, variant));
        }
        Ok(FinishedEntry { entry, pictures, listing: Some(("The commands", transcript)) })
    }

    /// Runs this program; what it prints.
    fn run(&self, command: &str, folder: &Path) -> Result<String> {
        let failed = |why: String| {
            Error::unavailable(format!("the gallery's command 'fantex {command}' failed: {why}"))
        };
        let program = std::env::current_exe().map_err(|error| failed(error.to_string()))?;
        let mut run = Command::new(program);
        run.current_dir(folder).stdin(Stdio::null()).arg("--quiet");
        run.arg(format!("--memory={}", self.context.memory_bytes));
        run.arg(format!("--threads={}", rayon::current_num_threads()));
        if !command.split_whitespace().any(|word| word == "--seed") {
            run.arg(format!("--seed={}", self.context.seed));
        }
        let mut is_size = false;
        for word in command.split_whitespace() {
            run.arg(if is_size { self.narrowed(word) } else { self.shipped_path(word)? });
            is_size = word == "--size";
        }
        let output = run.output().map_err(|error| failed(error.to_string()))?;
        if !output.status.success() {
            return Err(failed(String::from_utf8_lossy(&output.stderr).trim().to_owned()));
        }
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }

    /// A picture's size in the width that is wanted.
    fn narrowed(&self, size: &str) -> String {
        match (self.width, crate::scene::size(size)) {
            (Some(width), Ok([w, h])) => format!("{width}x{}", (width * h / w).max(1)),
            _ => size.to_owned(),
        }
    }

    /// Names of shipped files become paths.
    fn shipped_path(&self, word: &str) -> Result<String> {
        let start = ["assets/", "gallery/"].into_iter().find_map(|folder| {
            let start = word.find(folder)?;
            (start == 0 || word[..start].ends_with('=')).then_some(start)
        });
        let Some(start) = start else { return Ok(word.to_owned()) };
        let (before, name) = word.split_at(start);
        let path = self.shipped.file("");
        let path = std::path::absolute(if path.as_os_str().is_empty() { Path::new(".") } else { &path });
        let path = path.map_err(|error| Error::reading(Path::new(name), error))?;
        Ok(format!("{before}{}", path.join(name).display()))
    }

    /// One picture, or an animated one.
    fn render(&self, file: &LookFile, images: &LookImages, target: &Path) -> Result<()> {
        let size = self.width.map(|width| {
            let [w, h] = file.look().picture.size.map(|side| side.0);
            [width, (u64::from(width) * u64::from(h)).div_ceil(u64::from(w)) as u32]
        });
        let resolver = MaterialResolver { file, images, options: self.context.resolve_options() };
        let scene = LookScene::new(resolver, None, PictureChanges { size, ..PictureChanges::default() })?;
        let mut times = scene.times();
        if self.is_still {
            times.truncate(1);
        }
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

    fn by_program<'e>(&self, entry: &'e Entry, drawing: &str) -> Result<FinishedEntry<'e>> {
        let draw = drawings::by_name(drawing).ok_or_else(|| nothing_to_draw(entry))?;
        let drawn = draw(self)?;
        let mut pictures = Vec::new();
        for (index, (caption, image)) in drawn.into_iter().enumerate() {
            let file = self.file_name(entry, index);
            self.save(&[image], 1.0, &self.output.join(&file))?;
            pictures.push(finished(file, &Variant { caption, ..Variant::default() }));
        }
        let commands: String = entry.commands.iter().map(|c| format!("$ fantex {c}\n")).collect();
        let listing = drawings::code_of(drawing)
            .map_or(("To see the same", commands), |code| ("The program", code.to_owned()));
        Ok(FinishedEntry { entry, pictures, listing: Some(listing) })
    }

    fn file_name(&self, entry: &Entry, index: usize) -> String {
        format!("{}-{}.png", entry.name, index + 1)
    }

    fn save(&self, frames: &[Image], frames_per_second: f64, target: &Path) -> Result<()> {
        self.context.check_output(target)?;
        self.series.borrow_mut().write(target, || match frames {
            [image] => image.save(target),
            _ => {
                let mut animation =
                    Animation::new(target, &frames[0], frames.len() as u32, frames_per_second)?;
                frames.iter().try_for_each(|frame| animation.add(frame))?;
                animation.finish()
            }
        })
    }
}

fn finished(file: String, variant: &Variant) -> FinishedPicture {
    let changes = variant.set.iter().map(|(key, value)| format!("{key} = {value}\n")).collect();
    FinishedPicture { file, caption: variant.caption.clone(), changes }
}

fn nothing_to_draw(entry: &Entry) -> Error {
    let entry = &entry.name;
    Error::malformed(format!("the gallery's entry '{entry}' has neither a look nor a drawing that is known"))
}

/// An entry with its finished pictures.
struct FinishedEntry<'e> {
    entry: &'e Entry,
    pictures: Vec<FinishedPicture>,
    /// What made them, or how to see the same: a heading and its text.
    listing: Option<(&'static str, String)>,
}

struct FinishedPicture {
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
math{margin:.3rem 2rem .3rem 0;font-size:1.1rem}
pre{background:#eee;padding:.6rem .8rem;border-radius:.3rem;overflow-x:auto;font-size:.85rem}
@media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}figcaption{color:#aaa}pre{background:#262626}a{color:#8bf}}";

/// The page's text.
fn html_page(finished_entries: &[FinishedEntry]) -> String {
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>fantex: the gallery</title>\n<style>{STYLE}</style>\n<h1>fantex: the gallery</h1>\n\
         <p>Every technique of the toolbox, with the look or the commands that made its pictures. A look is a TOML file: \
         <code>fantex render LOOK.toml -o picture.png</code> renders it, \
         <code>fantex bake MODEL --look LOOK.toml -o asset.fan</code> puts it into seamless tiles.</p>\n<nav>"
    );
    for (letter, title, _) in CHAPTERS {
        push(&mut html, format_args!("<a href=\"#{letter}\">{title}</a>"));
    }
    html.push_str("</nav>\n");
    for (letter, title, _) in CHAPTERS {
        let chapter = || finished_entries.iter().filter(|e| chapter_of(e.entry) == Some(letter));
        if chapter().next().is_none() {
            continue;
        }
        push(&mut html, format_args!("<h2 id=\"{letter}\">{title}</h2>\n"));
        chapter().for_each(|finished_entry| section(&mut html, finished_entry));
    }
    html.push_str("</html>\n");
    html
}

/// The chapter of an entry's first row.
fn chapter_of(entry: &Entry) -> Option<char> {
    entry.rows.first()?.chars().next()
}

fn section(html: &mut String, finished_entry: &FinishedEntry) {
    let Entry { name, rows, title, idea, formula, .. } = finished_entry.entry;
    push(html, format_args!("<section id=\"{}\">\n<h3>", markup_escaped(name)));
    for row in rows {
        push(html, format_args!("<span class=\"row\">{}</span>", markup_escaped(row)));
    }
    push(html, format_args!("{}</h3>\n<p>{}</p>\n", markup_escaped(title), markup_escaped(idea)));
    formula.lines().filter(|line| !line.is_empty()).for_each(|line| html.push_str(&formula::mathml(line)));
    html.push_str("<div class=\"pictures\">\n");
    for FinishedPicture { file, caption, .. } in &finished_entry.pictures {
        let alternative = if caption.is_empty() { title } else { caption };
        push(
            html,
            format_args!(
                "<figure><a href=\"{0}\"><img src=\"{0}\" alt=\"{1}\" loading=\"lazy\"></a>\
                 <figcaption>{2}</figcaption></figure>\n",
                markup_escaped(file),
                markup_escaped(alternative),
                markup_escaped(caption)
            ),
        );
    }
    html.push_str("</div>\n");
    if let Some((heading, text)) = &finished_entry.listing {
        push(
            html,
            format_args!("<details><summary>{heading}</summary>\n<pre>{}</pre>\n", markup_escaped(text)),
        );
        for FinishedPicture { caption, changes, .. } in
            finished_entry.pictures.iter().filter(|p| !p.changes.is_empty())
        {
            push(
                html,
                format_args!("<p>{}:</p>\n<pre>{}</pre>\n", markup_escaped(caption), markup_escaped(changes)),
            );
        }
        html.push_str("</details>\n");
    }
    html.push_str("</section>\n");
}

fn push(html: &mut String, text: std::fmt::Arguments) {
    html.write_fmt(text).unwrap_or_else(|_| unreachable!("writing to a string cannot fail"));
}

#[cfg(test)]
mod tests {
    use super::*;

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
            commands: Vec::new(),
            pictures: Vec::new(),
        };
        let picture = |caption: &str| FinishedPicture {
            file: format!("{caption}.png"),
            caption: caption.to_owned(),
            changes: "filter = \"nearest\"".to_owned(),
        };
        let pictures = vec![picture("nearest"), picture("bilinear")];
        let listing = Some(("The look", "[camera]".to_owned()));
        let html = html_page(&[FinishedEntry { entry: &entry, pictures, listing }]);
        assert!(html.contains("<h2 id=\"T\">") && !html.contains("<h2 id=\"M\">"));
        assert!(html.contains("Near &amp; far.") && html.contains("src=\"bilinear.png\""));
        assert_eq!(html.matches("filter = &quot;nearest&quot;").count(), 2);
    }
}
