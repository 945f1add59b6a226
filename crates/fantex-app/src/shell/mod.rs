//! The window: brings together the viewer's state, the panels and the GPU, and does what only it can do.
//!
//! A device may be lost at any time: a driver is updated, a card is unplugged. Everything that was made with it is worth nothing
//! then, the window's own contents included. So the window ends and another one, with another device, goes on with the
//! `Workspace`.

use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use clap::Parser;
use eframe::egui::{TextureId, ViewportCommand};
use eframe::{egui, egui_wgpu, wgpu};
use fantex::base::text::parse_number;
use fantex::base::{Error, Result};
use fantex::gpu::Gpu;
use fantex::texture::Image;
use workspace::{Answer, Start, Workspace};

use crate::document::Place;
use crate::panels::{AtlasTexture, Textures};
use crate::scene_view::{SceneView, preparer};
use crate::session::Session;
use crate::settings::{Settings, WindowSettings, home_folder};
use crate::viewer::{PictureSize, Request};
use crate::{panels, theme};

mod driver;
mod strip;
mod workspace;

/// Width and height in points that the window does not fall below.
const MIN_WINDOW_POINTS: [f32; 2] = [480.0, 320.0];

/// How often a window is tried to be opened where the last one has lost its device, and seconds between the tries.
const REOPENING: (u32, u64) = (5, 1);

/// Runs the viewer until its window is closed.
pub fn run(arguments: Arguments) -> ExitCode {
    if arguments.notices {
        // A reader that has closed standard output wants no more.
        drop(std::io::stdout().write_all(fantex_assets::NOTICES.as_bytes()));
        return ExitCode::SUCCESS;
    }
    let session = match arguments.session.as_deref().map(Session::load).transpose() {
        Ok(session) => session,
        Err(error) => return failed(&error),
    };
    if let Some(Err(error)) = arguments.file.as_ref().map(|file| Place::parse(file).check()) {
        return failed(&error);
    }
    let settings_file = arguments.settings_file();
    let (settings, problem) = settings_file.as_deref().map_or((Settings::default(), None), Settings::load);
    let mut size = arguments.size;
    let mut workspace = Workspace::new(Start { arguments, settings, settings_file, problem, session });
    let mut tries = 0;
    loop {
        let options = native_options(&workspace, size.take());
        let kept = &mut workspace;
        let open: eframe::AppCreator<'_> = Box::new(move |context| {
            let shell = Shell::new(context, kept).ok_or("the window has no GPU")?;
            Ok(Box::new(shell))
        });
        match eframe::run_native("fantex", options, open) {
            Ok(()) => tries = 0,
            // A driver that is being replaced comes back after a while.
            Err(_) if workspace.lost.is_some() && tries < REOPENING.0 => {
                tries += 1;
                std::thread::sleep(Duration::from_secs(REOPENING.1));
            }
            Err(error) => {
                workspace.finish();
                return no_window(&error);
            }
        }
        if !workspace.takes_another_window() {
            break;
        }
    }
    workspace.finish();
    match (workspace.failure, workspace.lost) {
        (Some(failure), _) => failed(&failure),
        (None, Some(reason)) => failed(&fantex::gpu::device_lost(&reason)),
        (None, None) => ExitCode::SUCCESS,
    }
}

fn no_window(error: &eframe::Error) -> ExitCode {
    eprintln!(
        "fantex-app: cannot open a window: {}; a display and a Vulkan, Metal or DirectX 12 driver are needed \
         ('fantex render' makes pictures without them)",
        why_no_window(error)
    );
    ExitCode::FAILURE
}

/// In words of our own: those of the window system name source files of the machine that the program was built on.
fn why_no_window(error: &eframe::Error) -> String {
    match error {
        eframe::Error::AppCreation(error) => error.to_string(),
        eframe::Error::Winit(_) | eframe::Error::WinitEventLoop(_) => {
            "no window system answers (on Linux, DISPLAY or WAYLAND_DISPLAY must name one that runs)".into()
        }
        _ => "no graphics driver can draw into one".into(),
    }
}

fn failed(error: &dyn std::fmt::Display) -> ExitCode {
    eprintln!("fantex-app: {error}");
    ExitCode::FAILURE
}

/// `size` is that of the window in points; as it was without.
fn native_options(workspace: &Workspace, size: Option<[f32; 2]>) -> eframe::NativeOptions {
    let window: &WindowSettings = &workspace.viewer.settings.window;
    let mut viewport = egui::ViewportBuilder::default()
        .with_app_id("fantex")
        .with_title("fantex")
        .with_inner_size(size.unwrap_or(window.size))
        .with_min_inner_size(MIN_WINDOW_POINTS)
        .with_maximized(window.is_maximized && size.is_none())
        .with_drag_and_drop(true);
    if let Some(position) = window.position {
        viewport = viewport.with_position(position);
    }
    let mut setup = egui_wgpu::WgpuSetupCreateNew::without_display_handle();
    setup.instance_descriptor.backends = wgpu::Backends::PRIMARY;
    setup.device_descriptor = Arc::new(Gpu::wanted_device_descriptor);
    eframe::NativeOptions {
        viewport,
        wgpu_options: egui_wgpu::WgpuConfiguration { wgpu_setup: setup.into(), ..Default::default() },
        // The viewer has a settings file of its own; without a place nothing else is kept either.
        persist_window: false,
        persistence_path: Some(
            workspace
                .settings_file
                .as_ref()
                .map_or_else(std::env::temp_dir, |file| file.with_extension("ron")),
        ),
        ..Default::default()
    }
}

/// The window.
struct Shell<'a> {
    workspace: &'a mut Workspace,
    scene: SceneView,
    render_state: egui_wgpu::RenderState,
    scene_texture: Option<TextureId>,
    kept_texture: Option<TextureId>,
    atlas: AtlasTexture,
    /// Faults of the GPU that nobody asked for.
    gpu_errors: Receiver<String>,
    last_frame: f64,
    title: String,
}

impl<'a> Shell<'a> {
    /// Nothing where the window is not drawn by wgpu.
    fn new(context: &eframe::CreationContext<'_>, workspace: &'a mut Workspace) -> Option<Self> {
        let render_state = context.wgpu_render_state.clone()?;
        theme::apply(&context.egui_ctx);
        workspace.open_window.set(&context.egui_ctx);
        let gpu = Arc::new(Gpu::from_parts(
            &render_state.adapter,
            render_state.device.clone(),
            render_state.queue.clone(),
        ));
        let (sender, gpu_errors) = channel();
        let sender = Mutex::new(sender);
        render_state.device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            // The window may be closing: then nobody wants to know.
            sender.lock().unwrap_or_else(PoisonError::into_inner).send(error.to_string()).ok();
        }));
        let seconds = workspace.tick();
        let viewer = &mut workspace.viewer;
        viewer.adapter = adapter_text(&gpu);
        viewer.draw_with(preparer(gpu.clone()));
        if let Some(reason) = workspace.lost.take() {
            let text =
                format!("The GPU device was lost ({reason}); the window was opened again with another.");
            viewer.notices.warning(text);
        }
        if let Some(place) = workspace.to_open.take() {
            viewer.open_or_fail(place);
        }
        if workspace.is_unwatched {
            context.egui_ctx.add_plugin(strip::Strip::default());
        }
        Some(Self {
            scene: SceneView::new(gpu),
            render_state,
            scene_texture: None,
            kept_texture: None,
            atlas: AtlasTexture::default(),
            gpu_errors,
            last_frame: seconds,
            title: String::new(),
            workspace,
        })
    }

    /// Checks whether the device is lost; then nothing more is drawn, and the window ends.
    fn check_device(&mut self, ctx: &egui::Context) -> bool {
        if self.workspace.lost.is_none()
            && let Some(reason) = self.scene.gpu().lost()
        {
            let viewer = &mut self.workspace.viewer;
            for error in self.scene.abandon_captures() {
                viewer.notices.error(error.to_string());
            }
            self.workspace.lose(&reason);
        }
        if self.workspace.lost.is_some() {
            ctx.send_viewport_cmd(ViewportCommand::Close);
            // What is drawn would be copied into buffers that a lost device does not give.
            ctx.graphics_mut(|graphics| *graphics = Default::default());
        }
        self.workspace.lost.is_none()
    }

    fn dropped_files(&mut self, ctx: &egui::Context) {
        let dropped = ctx.input(|i| i.raw.dropped_files.iter().map(|file| file.path().to_owned()).collect());
        self.workspace.viewer.take_first_dropped(dropped);
    }

    /// A picture of the clipboard; not while something is typed.
    fn pasted_pictures(&mut self, ctx: &egui::Context) {
        if ctx.text_edit_focused() {
            return;
        }
        let is_picture = |event: &egui::Event| match event {
            egui::Event::PasteImage(image) => Some(Arc::clone(image)),
            _ => None,
        };
        if let Some(image) = ctx.input(|i| i.events.iter().find_map(is_picture)) {
            let texels = image.pixels.iter().flat_map(|color| color.to_srgba_unmultiplied());
            self.workspace.viewer.take_pasted(image.size.map(|n| n as u32), texels.collect());
        }
    }

    fn requests(&mut self, ctx: &egui::Context) {
        for request in self.workspace.viewer.take_requests() {
            match request {
                #[cfg(feature = "test-steps")]
                Request::LoseDevice => {
                    self.render_state.device.destroy();
                    // It is told to be lost when its work is done.
                    self.render_state.device.poll(wgpu::PollType::wait_indefinitely()).ok();
                }
                Request::Quit => ctx.send_viewport_cmd(ViewportCommand::Close),
                Request::Picture { path, size } if self.workspace.viewer.live.is_some() => {
                    self.save_look(path, size);
                    ctx.request_repaint();
                }
                Request::Picture { path, size } => {
                    let size = match size {
                        PictureSize::Pixels(size) => size,
                        PictureSize::Times(times) => {
                            self.workspace.viewer.scene_pixels.map(|n| n.saturating_mul(times))
                        }
                    };
                    if let Err(error) = self.scene.capture(&self.workspace.viewer, size, path.clone()) {
                        self.workspace.pictures.refuse(path, error);
                        ctx.request_repaint();
                    }
                }
                Request::WindowPicture(path) => self.workspace.pictures.take_window(ctx, path),
                Request::Dialog(dialog) => self.workspace.dialogs.ask(dialog, &self.workspace.viewer.stem()),
            }
        }
    }

    /// Writes the picture of a look, which there is as large as on the screen only.
    fn save_look(&mut self, path: PathBuf, size: PictureSize) {
        let Workspace { viewer, pictures, .. } = &mut *self.workspace;
        let Some(picture) = viewer.live.as_ref().and_then(|live| live.picture.clone()) else {
            let error = Error::unavailable("there is no picture of the look yet");
            return pictures.refuse(path, error);
        };
        let is_shown = match size {
            PictureSize::Times(times) => times == 1,
            PictureSize::Pixels(size) => size == [picture.width, picture.height],
        };
        if is_shown {
            pictures.save(path, Ok(Image::clone(&picture)));
        } else {
            let words =
                "the picture of a look is as large as on the screen: 'fantex render' draws larger ones";
            pictures.refuse(path, Error::unsupported(words));
        }
    }

    fn answers(&mut self) {
        let Workspace { dialogs, viewer, .. } = &mut *self.workspace;
        for (dialog, answer) in dialogs.poll() {
            match answer {
                Answer::Chosen(path) => viewer.take_file(dialog, path),
                Answer::Cancelled => {}
                Answer::NotShown => viewer.go_on_without(dialog),
            }
        }
    }

    /// Streams and draws the scene.
    fn draw(&mut self) {
        if let Some(model) = self.workspace.viewer.new_model.take() {
            for error in self.scene.set_model(model) {
                let path = error.path().map(PathBuf::from).unwrap_or_default();
                self.workspace.pictures.refuse(path, error);
            }
            self.workspace.viewer.kept = None;
            self.workspace.viewer.pacing.lost();
        }
        if self.scene.gpu().lost().is_some() {
            return;
        }
        let mut refused = self.gpu_errors.try_iter();
        if let Some(first) = refused.next() {
            // The others mostly follow from it.
            let words: Vec<&str> = first.split_whitespace().take(60).collect();
            self.workspace.viewer.notices.error(format!("The GPU refused an operation: {}", words.join(" ")));
            refused.chain([first]).for_each(|error| eprintln!("fantex-app: {error}"));
        }
        self.workspace.viewer.notice_changes();
        if let Err(error) = self.scene.update(&mut self.workspace.viewer) {
            self.scene.abandon_picture(&mut self.workspace.viewer);
            if self.scene.gpu().lost().is_none() {
                self.workspace.viewer.notices.error(format!("{error}."));
            }
        }
        if self.scene.gpu().lost().is_some() {
            return;
        }
        self.register_textures();
    }

    /// Tells egui about the textures that it shows.
    fn register_textures(&mut self) {
        let shown = self.scene.shown();
        register(&self.render_state, &mut self.scene_texture, shown);
        register(&self.render_state, &mut self.kept_texture, self.scene.kept());
        let is_shown = self.workspace.viewer.settings.panels.has_atlas;
        let picture =
            if is_shown { self.scene.atlas(self.atlas.channel, self.workspace.viewer.now()) } else { None };
        if let Some(picture) = &picture {
            self.atlas.extent = picture.extent;
        }
        let shown = picture.map(|picture| (picture.view, picture.is_new));
        register(&self.render_state, &mut self.atlas.id, shown);
    }

    /// Asks for the next frame where something goes on.
    fn wake(&self, ctx: &egui::Context, goes_on: bool) {
        if goes_on {
            ctx.request_repaint();
        } else if !self.scene.is_settled() || self.scene.captures_due() > 0 {
            ctx.request_repaint_after_secs(0.016);
        } else if !self.workspace.viewer.pacing.is_settled() && self.workspace.viewer.document.is_some() {
            let wake =
                self.workspace.viewer.pacing.wake_in(self.workspace.viewer.now()).unwrap_or(0.008).max(0.004);
            ctx.request_repaint_after_secs(wake as f32);
        } else if self.workspace.viewer.settings.panels.has_atlas && self.scene.is_atlas_stale() {
            ctx.request_repaint_after_secs(0.1);
        } else if self.scene.will_retry() {
            ctx.request_repaint_after_secs(1.0);
        }
    }

    fn remember_window(&mut self, ctx: &egui::Context) {
        let window = &mut self.workspace.viewer.settings.window;
        // A window is opened by points that are not zoomed.
        let zoom = ctx.zoom_factor();
        ctx.input(|i| {
            let info = i.viewport();
            window.is_maximized = info.maximized.unwrap_or(false);
            if window.is_maximized || info.minimized == Some(true) {
                return;
            }
            if let Some(inner) = info.inner_rect.filter(|r| r.width() >= 100.0 && r.height() >= 100.0) {
                window.size = (inner.size() * zoom).into();
            }
            let position = info.outer_rect.map(|outer| (outer.min.to_vec2() * zoom).into());
            window.position = position.or(window.position);
        });
    }

    fn show_title(&mut self, ctx: &egui::Context) {
        let viewer = &self.workspace.viewer;
        let title = match viewer.shown_name() {
            Some(name) if viewer.painting.is_some() => format!("{name} – fantex paint"),
            Some(name) => format!("{name} – fantex"),
            None => "fantex".to_owned(),
        };
        if title != self.title {
            ctx.send_viewport_cmd(ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }

    /// Pictures that have become ready are written. Sessions fail where one cannot be.
    fn save_pictures(&mut self, ctx: &egui::Context) {
        for captured in self.scene.poll_captures() {
            self.workspace.pictures.save(captured.path, captured.image);
        }
        for (path, result) in self.workspace.pictures.poll() {
            self.workspace.viewer.forget_picture(&path);
            match result {
                // A session knows. Messages would lie over its next picture of the window, and under its pointer.
                Ok(()) if self.workspace.driver.is_some() => {}
                Ok(()) => self.workspace.viewer.notices.info(format!("Saved {}", path.display())),
                Err(error) if self.workspace.driver.is_some() => self.fail(ctx, error.to_string()),
                Err(error) => self.workspace.viewer.notices.error(error.to_string()),
            }
        }
    }

    /// Lets the session do its next step.
    fn drive(&mut self, ctx: &egui::Context) {
        let Some(driver) = &mut self.workspace.driver else { return };
        let is_sharp = match &self.workspace.viewer.live {
            Some(live) => live.is_settled(),
            None => self.scene.is_settled() && self.workspace.viewer.pacing.is_settled(),
        };
        let pictures_due = self.scene.captures_due() + self.workspace.pictures.due();
        match driver.step(ctx, &mut self.workspace.viewer, is_sharp, pictures_due) {
            Ok(true) => {}
            Ok(false) => {
                self.workspace.driver = None;
                self.workspace.is_ending = true;
                ctx.send_viewport_cmd(ViewportCommand::Close);
            }
            Err(error) => {
                self.fail(ctx, error.to_string());
            }
        }
    }

    /// Ends the program with a sentence for who started it.
    fn fail(&mut self, ctx: &egui::Context, failure: String) {
        self.workspace.failure = Some(failure);
        self.workspace.driver = None;
        self.workspace.is_ending = true;
        ctx.send_viewport_cmd(ViewportCommand::Close);
    }
}

impl eframe::App for Shell<'_> {
    fn logic(&mut self, ctx: &egui::Context, _frame: &mut eframe::Frame) {
        self.workspace.tick();
        if !self.check_device(ctx) {
            return;
        }
        self.workspace.viewer.poll();
        if let Some(failure) = self.workspace.viewer.failure.take() {
            self.fail(ctx, failure);
        }
        if self.workspace.viewer.take_quit() || self.workspace.is_asked_to_end() {
            ctx.send_viewport_cmd(ViewportCommand::Close);
        }
        let is_closing = ctx.input(|i| i.viewport().close_requested()) && !self.workspace.is_ending;
        if is_closing && !self.workspace.viewer.may_close() {
            ctx.send_viewport_cmd(ViewportCommand::CancelClose);
        }
        self.answers();
        self.save_pictures(ctx);
        self.drive(ctx);
        if let Some(driver) = &self.workspace.driver {
            driver.wake(ctx);
        }
    }

    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        let ctx = ui.ctx().clone();
        let seconds = self.workspace.tick();
        if !self.check_device(&ctx) {
            return;
        }
        ctx.with_plugin(|strip: &mut strip::Strip| {
            strip.is_lifted = self.workspace.pictures.is_window_due();
        });
        let step = seconds - std::mem::replace(&mut self.last_frame, seconds);
        self.workspace.viewer.keys(&ctx);
        self.dropped_files(&ctx);
        self.pasted_pictures(&ctx);
        let textures = Textures { scene: self.scene_texture, kept: self.kept_texture, atlas: self.atlas };
        let shown = panels::show(ui, &mut self.workspace.viewer, &textures);
        if let Some(channel) = shown.atlas_channel {
            self.atlas.channel = channel;
        }
        let goes_on = self.workspace.viewer.navigate(&shown.input, step);
        self.draw();
        self.requests(&ctx);
        self.remember_window(&ctx);
        self.show_title(&ctx);
        self.wake(&ctx, goes_on);
        self.check_device(&ctx);
    }

    fn raw_input_hook(&mut self, _ctx: &egui::Context, raw_input: &mut egui::RawInput) {
        if let Some(driver) = &mut self.workspace.driver {
            driver.inject(raw_input);
        }
    }

    fn persist_egui_memory(&self) -> bool {
        false
    }
}

/// Tells egui about a texture (`shown`: and whether it is another one than before), or that there is none.
fn register(
    state: &egui_wgpu::RenderState,
    id: &mut Option<TextureId>,
    shown: Option<(&wgpu::TextureView, bool)>,
) {
    let (device, filter) = (&state.device, wgpu::FilterMode::Linear);
    let mut renderer = state.renderer.write();
    match (shown, *id) {
        (Some((view, true)), Some(id)) => {
            renderer.update_egui_texture_from_wgpu_texture(device, view, filter, id);
        }
        (Some((view, _)), None) => *id = Some(renderer.register_native_texture(device, view, filter)),
        (Some((_, false)), Some(_)) | (None, None) => {}
        (None, Some(known)) => {
            renderer.free_texture(&known);
            *id = None;
        }
    }
}

fn adapter_text(gpu: &Gpu) -> String {
    let info = gpu.info();
    // Drivers append their version in brackets.
    let name = info.name.split(" (").next().unwrap_or(&info.name);
    if info.is_software { format!("{name} (software)") } else { name.to_owned() }
}

/// Shows models and fan-textured assets, and paints on them.
#[derive(Clone, Debug, Parser)]
#[command(
    name = "fantex-app",
    version,
    max_term_width = 110,
    after_help = "\
Example:
  fantex-app bunny.fan
  fantex-app bottle.glb --size 1920x1080
  fantex-app oak.toml --on chair.glb

F1 shows keys and mouse."
)]
pub struct Arguments {
    /// A model (.glb .gltf .obj .ply .stl), an asset (.fan, also at an https://, s3://, gs:// or az:// address) or a look (.toml)
    pub file: Option<OsString>,
    /// Paint on it: a model becomes an asset beside it first
    #[arg(long)]
    pub paint: bool,
    /// The model that a look (.toml) is shown on, where it names none
    #[arg(long, value_name = "MODEL")]
    pub on: Option<PathBuf>,
    /// Memory for pages while painting, such as 512M or 1.5G
    #[arg(long, value_name = "SIZE", value_parser = memory_size)]
    pub memory: Option<usize>,
    /// Let models and layers name files outside their folders
    #[arg(long)]
    pub allow_outside: bool,
    /// Print the licences of all that fantex is made of
    #[arg(long)]
    pub notices: bool,
    /// Steps that drive the viewer by itself (see docs/viewer.md); ends with exit code 1 where one fails
    #[arg(long, value_name = "JSON")]
    pub session: Option<PathBuf>,
    /// Where settings are kept; in the user's folder by default, nowhere in sessions
    #[arg(long, value_name = "JSON")]
    pub settings: Option<PathBuf>,
    /// Width and height of the window in points; as it was by default
    #[arg(long, value_name = "WxH", value_parser = window_size)]
    pub size: Option<[f32; 2]>,
    /// Where pictures are saved; in the user's pictures by default
    #[arg(long, value_name = "FOLDER")]
    pub pictures: Option<PathBuf>,
}

fn window_size(text: &str) -> Result<[f32; 2], &'static str> {
    let expected = "expected width x height in points, such as 1280x800";
    let (width, height) = text.split_once(['x', 'X']).ok_or(expected)?;
    let side = |s: &str| s.parse::<u16>().ok().filter(|&n| n > 0).map(f32::from).ok_or(expected);
    Ok([side(width)?, side(height)?])
}

/// Less than that is too little for a dab.
const MIN_MEMORY: usize = 16 << 20;

fn memory_size(text: &str) -> Result<usize> {
    let bytes = parse_number(text, 1024)?;
    let bytes = usize::try_from(bytes).ok().filter(|&bytes| bytes >= MIN_MEMORY);
    bytes.ok_or_else(|| Error::invalid("expected at least 16M, and no more than a machine can have"))
}

impl Arguments {
    /// Where settings are read and written; sessions begin and end with the usual ones unless they name a file.
    pub fn settings_file(&self) -> Option<PathBuf> {
        let usual = || eframe::storage_dir("fantex").map(|folder| folder.join("viewer.json"));
        self.settings.clone().or_else(|| if self.session.is_some() { None } else { usual() })
    }

    /// Where pictures are saved.
    fn picture_folder(&self) -> PathBuf {
        let pictures = home_folder().map(|home| home.join("Pictures")).filter(|folder| folder.is_dir());
        let here = || std::env::current_dir().unwrap_or_default();
        self.pictures.clone().or(pictures).unwrap_or_else(here)
    }
}
