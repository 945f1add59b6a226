//! `fantex paint`: strokes onto an asset.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::Args;
use fantex::addresses::{change_copy, change_into, is_object};
use fantex::bake::NoProgress;
use fantex::base::input::{ReadLimits, ReadOptions};
use fantex::mesh::AlphaMode;
use fantex::paint::{
    PaintOptions, Painter, ReplaySummary, StrokeFile, StrokeLog, note_of_missing, replay, without_room,
};
use fantex::store::{ChannelKind, MAX_GAPS, MAX_GAPS_COPIED, io_cause};
use fantex::{Error, ErrorKind, Result};
use serde::Serialize;

use super::view;
use crate::context::{Context, Deferral};
use crate::scene::{check_asset_name, check_extension, open_asset, report_damage, size};
use crate::text::{Choices, ShownPath, counted, megabytes, one_of};

/// Paint on a model or an asset, in a window or by a file of strokes.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex paint statue.fan
  fantex paint bottle.glb --size 1600x1000
  fantex paint statue.fan --replay strokes.json -o painted.fan
  fantex paint denser.fan --replay-log painted.fan
  fantex paint painted.fan --export-log strokes.json
  fantex paint statue.fan --add-channel emission,normal -o richer.fan
  fantex paint richer.fan --remove-channel emission
  fantex paint fence.fan --replay holes.json --alpha cut-out

Without --replay a window is opened. A model becomes an asset beside it first (bottle.fan), which is painted on; what is \
painted is saved all the time, in the asset itself, and every step can be undone. To keep an asset as it is, paint on a copy of its file.

With --replay strokes are applied without a window. Without -o the asset itself is changed, safely: it holds either all \
strokes or none. Where some of the work must be durable before the rest (blur, smudge and clone after another stroke or on a layer, fills by \
colour, channels, --alpha), a copy is changed that then takes the asset's place: that needs room for the copy. Strokes are given by positions in the model's coordinates, so that a file fits any asset of the model. An \
asset keeps a log of what was painted on it, which fits other densities, other covers, and edited meshes.

With --add-channel the asset is first given channels that it does not have. They show what was seen without them: the model's \
materials, its own normals, a middle height.

With --remove-channel channels are first taken out, with all that was baked and painted in them, on the base and on layers. \
That cannot be undone. Without height normals lose the relief of layers, and the history goes.

With --alpha painted opacity is seen: materials of models often ignore it.")]
pub(crate) struct PaintArgs {
    /// An asset (.fan); without --replay also a model (.glb .gltf .obj .ply .stl)
    asset: PathBuf,
    /// Strokes (.json) to apply
    #[arg(long, value_name = "STROKES")]
    replay: Option<PathBuf>,
    /// Another asset, whose log of strokes to apply
    #[arg(long, value_name = "ASSET", conflicts_with = "replay")]
    replay_log: Option<PathBuf>,
    /// Write the log of the asset as a stroke file (.json), with the pictures that it mentions in the folder 'files' beside it
    #[arg(long, value_name = "STROKES", conflicts_with_all = ["replay", "replay_log", "output"])]
    export_log: Option<PathBuf>,
    /// Channels to give the asset, if it does not have them
    #[arg(long, value_name = "CHANNEL", value_delimiter = ',', value_parser = one_of(&ADDED), conflicts_with = "export_log")]
    add_channel: Vec<ChannelKind>,
    /// Channels to take out of the asset, with what they hold, before others are added
    #[arg(long, value_name = "CHANNEL", value_delimiter = ',', value_parser = one_of(&REMOVED), conflicts_with = "export_log")]
    remove_channel: Vec<ChannelKind>,
    /// What all materials of the asset make of the opacity of the base colour
    #[arg(long, value_name = "MODE", value_parser = one_of(&ALPHA_MODES), conflicts_with = "export_log")]
    alpha: Option<AlphaMode>,
    /// The asset to write; without it the given one is changed. Space that is free in the given file is not copied. A window paints on the given one alone
    #[arg(short, long, value_name = "ASSET")]
    output: Option<PathBuf>,
    /// Width and height of the window in points; as it was by default
    #[arg(long, value_name = "WxH", value_parser = size, conflicts_with_all = ["replay", "replay_log", "export_log", "add_channel", "remove_channel", "alpha"])]
    size: Option<[u32; 2]>,
    /// Keep nothing that undoes the strokes, and forget what undoes earlier ones; a file of which more than half is free then is written anew, without gaps. Not in a window
    #[arg(long, conflicts_with = "export_log")]
    no_history: bool,
}

impl PaintArgs {
    /// Whether something changes besides what strokes do.
    fn changes_asset(&self) -> bool {
        !self.add_channel.is_empty() || !self.remove_channel.is_empty() || self.alpha.is_some()
    }
}

const REMOVED: Choices<ChannelKind, 7> = [
    ("base-color", "Colour, with opacity", ChannelKind::BaseColor),
    ("orm", "Occlusion, roughness, metallic", ChannelKind::OcclusionRoughnessMetallic),
    ("emission", "Emitted light", ChannelKind::Emission),
    ("normal", "Normals", ChannelKind::Normal),
    ("displacement", "Height", ChannelKind::Displacement),
    ("light", "Baked light", ChannelKind::Light),
    ("anisotropy", "Directions of stretched highlights", ChannelKind::Anisotropy),
];

/// All but those that only a bake makes.
const ADDED: Choices<ChannelKind, 5> = [REMOVED[0], REMOVED[1], REMOVED[2], REMOVED[3], REMOVED[4]];

const ALPHA_MODES: Choices<AlphaMode, 3> = [
    ("opaque", "Nothing: it is not seen", AlphaMode::Opaque),
    ("cut-out", "What has less than half is not there", AlphaMode::Mask(0.5)),
    ("blend", "What lies behind is seen through it", AlphaMode::Blend),
];

enum Strokes {
    /// Only channels and materials are changed.
    None,
    File {
        file: StrokeFile,
        path: PathBuf,
    },
    Log {
        log: StrokeLog,
        asset: PathBuf,
    },
}

impl Strokes {
    fn of_file(path: &Path) -> Result<Self> {
        Ok(Self::File { file: StrokeFile::load(path)?, path: path.to_owned() })
    }

    fn logged_in(asset: &Path) -> Result<Self> {
        Ok(Self::Log { log: StrokeLog::of(&*open_asset(asset)?)?, asset: asset.to_owned() })
    }

    /// Whether some of it is durable before all of it is done.
    fn commit_between(&self) -> bool {
        match self {
            Self::None => false,
            Self::File { file, .. } => file.commits_between(),
            Self::Log { log, .. } => log.strokes.commits_between(),
        }
    }

    fn replay(&self, painter: &mut Painter) -> fantex::Result<ReplaySummary> {
        let (replayed, place) = match self {
            Self::None => return Ok(ReplaySummary::default()),
            Self::File { file, path } => {
                (replay(painter, file, path.parent().unwrap_or(Path::new("."))), path)
            }
            Self::Log { log, asset } => (log.replay(painter), asset),
        };
        // The library sees arguments in strokes; here they stand in a file.
        replayed.map_err(|error| match error.kind() {
            ErrorKind::InvalidArgument => Error::malformed(error.to_string()).in_file(place),
            _ => error,
        })
    }
}

#[derive(Debug, Serialize)]
struct ExportInfo {
    output: ShownPath,
    strokes: usize,
    unrecorded: usize,
}

#[derive(Debug, Serialize)]
struct PaintInfo {
    output: ShownPath,
    strokes: usize,
    dabs: usize,
    pages: usize,
    missed_samples: usize,
    unrecorded: usize,
    /// Characters of texts that their fonts lack.
    missing_characters: String,
    /// Numbers, as messages about stroke files have them, and labels of strokes that change no texel.
    #[serde(skip)]
    untouching: Vec<(usize, String)>,
    generation: u64,
    bytes: u64,
    seconds: f64,
}

pub(crate) fn run(args: &PaintArgs, context: &Context) -> Result<ExitCode> {
    let started = Instant::now();
    if let Some(output) = &args.export_log {
        check_extension(output, "a stroke file", "json", "")?;
        export(&args.asset, output, context)?;
        return Ok(ExitCode::SUCCESS);
    }
    args.output.as_ref().map_or(Ok(()), |output| check_asset_name(output, ""))?;
    // Opening says what is wrong with files of other kinds.
    let opens = || {
        // What is changed in place is not protected as an input.
        let protect_inputs = args.output.is_some() && ReadLimits::current().options().protect_inputs;
        let options = ReadOptions { protect_inputs, ..*ReadLimits::current().options() };
        let asset = ReadLimits::new(options).run(|| open_asset(&args.asset))?;
        // Before there is a copy, so that messages name the asset.
        asset.removable_channels(&args.remove_channel).map(drop)
    };
    let strokes = match (&args.replay, &args.replay_log) {
        (None, None) if args.changes_asset() => opens().map(|()| Strokes::None)?,
        (None, None) => return open_window(args, context),
        (Some(path), _) => opens().and_then(|()| Strokes::of_file(path))?,
        (None, Some(other)) => opens().and_then(|()| Strokes::logged_in(other))?,
    };
    let (mut info, _ending) = match &args.output {
        None if args.changes_asset() || strokes.commit_between() => {
            let paint = |copy: &Path| paint(copy, &strokes, args, context);
            let changed = change_copy(&args.asset, [&context.step("copying", "MB"), &NoProgress], paint);
            let (info, ending) = changed.map_err(|error| without_room(error, &args.asset))?;
            (PaintInfo { output: (&args.asset).into(), ..info }, ending)
        }
        None => {
            let painted = paint(&args.asset, &strokes, args, context);
            painted.map_err(|error| without_room(error, &args.asset))?
        }
        Some(output) => {
            context.check_output(output)?;
            let paint = |copy: &Path| paint(copy, &strokes, args, context);
            let copying = context.step("copying", "MB");
            let (info, ending) = change_into(&args.asset, output, context.force, &copying, paint)?;
            (PaintInfo { output: output.into(), ..info }, ending)
        }
    };
    note_of_missing(&info.missing_characters).iter().for_each(|note| context.note(note));
    for (number, label) in &info.untouching {
        context.note(format!("stroke '{label}' (number {number}) touches nothing; numbers begin with 0"));
    }
    info.seconds = started.elapsed().as_secs_f64();
    context.print(&info, |info| {
        format!(
            "{}: {}, {}, {}, {:.1} s{}",
            info.output.display(),
            counted(info.strokes as u64, "stroke"),
            counted(info.dabs as u64, "dab"),
            megabytes(info.bytes),
            info.seconds,
            missing(info.unrecorded)
        )
    })?;
    Ok(ExitCode::SUCCESS)
}

/// Opens the window, which paints on the asset itself.
fn open_window(args: &PaintArgs, context: &Context) -> Result<ExitCode> {
    let of_strokes = [("--output", args.output.is_some()), ("--no-history", args.no_history)];
    if let Some((option, _)) = of_strokes.into_iter().find(|(_, is_given)| *is_given) {
        let asset = args.asset.display();
        return Err(Error::invalid(format!(
            "{option} is for strokes without a window (--replay), and a window paints on {asset} itself, with a history: leave it out, or \
             paint on a copy of the file"
        )));
    }
    let mut arguments = vec!["--paint".into(), args.asset.clone().into()];
    arguments.extend(args.size.map(|[width, height]| format!("--size={width}x{height}").into()));
    view::start(&arguments, Some(context.memory_bytes), context)
}

fn missing(unrecorded: usize) -> String {
    match unrecorded {
        0 => String::new(),
        count => format!("; without {} that could not be recorded", counted(count as u64, "stroke")),
    }
}

fn export(asset: &Path, output: &Path, context: &Context) -> Result<()> {
    let log = StrokeLog::of(&*open_asset(asset)?)?;
    context.check_output_of(output, asset)?;
    let _deferral = context.defer_interrupt();
    log.save(output)?;
    let strokes = &log.strokes.strokes;
    let unrecorded = strokes.iter().filter(|stroke| stroke.unrecorded).count();
    let info = ExportInfo { output: output.into(), strokes: strokes.len() - unrecorded, unrecorded };
    context.print(&info, |info| {
        let strokes = counted(info.strokes as u64, "stroke");
        format!("{}: {strokes}{}", info.output.display(), missing(info.unrecorded))
    })
}

/// Paints on a file. Until the deferral is dropped Ctrl-C ends nothing: what is painted then only gets its place, which nobody should take for
/// interrupted work and paint again.
fn paint<'a>(
    asset: &Path,
    strokes: &Strokes,
    args: &PaintArgs,
    context: &'a Context,
) -> Result<(PaintInfo, Option<Deferral<'a>>)> {
    let options = PaintOptions { memory_bytes: context.memory_bytes as usize, history: !args.no_history };
    let mut painter = Painter::open(asset, &options)?;
    if let Some(alpha) = args.alpha {
        painter.set_alpha_mode(alpha)?;
    }
    painter.remove_channels(&args.remove_channel)?;
    painter.add_channels(&args.add_channel)?;
    let summary = strokes.replay(&mut painter)?;
    report_damage(&args.asset, painter.damage(), context)?;
    let mut ending = Some(context.defer_interrupt());
    painter.commit()?;
    if args.no_history && !context.is_interrupted() {
        ending = None;
        if asset == args.asset {
            context.set_remains("the strokes were painted".to_owned());
        }
        let most = if args.output.is_some() { MAX_GAPS_COPIED } else { MAX_GAPS };
        // What was painted is there without that, too.
        if let Err(error) = painter.close_gaps(most) {
            let why = io_cause(&error).map_or_else(|| error.to_string(), ToString::to_string);
            context.note(format!("{} keeps the space that is free in it: {why}", args.asset.display()));
        }
    }
    let ending = ending.or_else(|| Some(context.defer_interrupt()));
    // What goes into a store may take long.
    let ending = ending.filter(|_| !is_object(&args.asset));
    let committed = painter.editor().asset();
    let info = PaintInfo {
        output: asset.into(),
        strokes: summary.strokes,
        dabs: summary.dabs,
        pages: summary.pages,
        missed_samples: summary.missed_samples,
        unrecorded: summary.unrecorded,
        missing_characters: summary.missing_characters,
        untouching: summary.untouching,
        generation: committed.generation(),
        bytes: committed.file_bytes(),
        seconds: 0.0,
    };
    Ok((info, ending))
}
