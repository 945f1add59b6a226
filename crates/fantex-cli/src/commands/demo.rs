//! `fantex demo`: the whole path, on a generated landscape and on a model with textures.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use fantex::base::numbered;
use fantex::mesh::Mesh;
use fantex::mesh::generate::{LandscapeOptions, landscape};
use fantex::render::{Camera, FanSurface, FilterOptions, LookSurface, RenderOptions, Surface};
use fantex::store::{Asset, PageCache, VerifyOptions, verify};
use fantex::{Baker, Result, Source, not_verified};
use glam::DVec3;
use serde::Serialize;

use crate::commands::compare::{Subject, mean_psnr_db};
use crate::commands::generate::write_landscape;
use crate::commands::render::save;
use crate::context::Context;
use crate::scene::{aspect, open_model, photograph, source_surface};
use crate::shipped::Shipped;
use crate::text::{Count, ShownPath, columns, grouped};

/// Generate, bake, verify, render and compare: the tour of the README, in under a minute.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex demo
  fantex demo -o somewhere --triangles 2M --texels 64M

Without -o the folder out/demo is used, and what an earlier demo left in it is overwritten.")]
pub(crate) struct DemoArgs {
    /// Folder for everything that is made [default: out/demo]
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Triangles of the landscape
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "300k")]
    triangles: Count,
    /// Texels of the landscape
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "12M")]
    texels: Count,
}

/// The model with textures that comes with fantex.
const BOTTLE: &str = "assets/WaterBottle/WaterBottle.gltf";
/// Cameras of the comparison.
const VIEWS: usize = 4;

#[derive(Debug, Serialize)]
struct Part {
    name: &'static str,
    triangles: u64,
    texels: u64,
    channels: u64,
    bytes: u64,
    /// From the mesh to the finished asset.
    seconds: f64,
    largest_jump: f32,
    /// Mean over some views, against the original.
    psnr_db: f64,
}

#[derive(Debug, Default, Serialize)]
struct DemoInfo {
    folder: ShownPath,
    parts: Vec<Part>,
    models: Vec<ShownPath>,
    assets: Vec<ShownPath>,
    pictures: Vec<ShownPath>,
    seconds: f64,
}

pub(crate) fn run(args: &DemoArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    let folder = args.output.clone().unwrap_or_else(|| PathBuf::from("out/demo"));
    let shipped = Shipped::open()?;
    let bottle = open_model(&shipped.file(BOTTLE), context)?;
    context.make_folder(&folder)?;
    let mut demo = Demo {
        context,
        force: context.force || args.output.is_none(),
        info: DemoInfo { folder: folder.into(), ..DemoInfo::default() },
    };
    demo.landscape(args)?;
    demo.bottle(&bottle)?;
    demo.info.seconds = started.elapsed().as_secs_f64();
    context.print(&demo.info, text)
}

struct Demo<'a> {
    context: &'a Context,
    force: bool,
    info: DemoInfo,
}

/// A mesh and what is baked onto it.
struct Subtask<'a> {
    name: &'static str,
    mesh: &'a fantex::Mesh,
    source: fn() -> Source<'static>,
    texels: Option<u64>,
    camera: Camera,
}

impl Demo<'_> {
    fn landscape(&mut self, args: &DemoArgs) -> Result<()> {
        let model_path = self.target("landscape.ply")?;
        self.context.note(format!(
            "generating a landscape of {} {}",
            args.triangles,
            numbered(args.triangles.0, "triangle")
        ));
        let options = LandscapeOptions {
            triangles: args.triangles.0,
            seed: self.context.seed,
            ..LandscapeOptions::default()
        };
        let made = landscape(&options)?;
        write_landscape(&made, &model_path, self.force, self.context)?;
        self.info.models.push((&model_path).into());
        let mesh = fantex::Mesh::from_model(made.into(), &model_path)?;
        let source = || Source::solid("landscape");
        let solid = source();
        let solid = solid.evaluator(&mesh, self.context.seed)?;
        let truth = source_surface(&mesh, solid.as_ref());
        let camera = self.camera(&mesh, DVec3::new(0.5, 0.55, 1.0));
        let texels = Some(args.texels.0);
        self.make(&Subtask { name: "landscape", mesh: &mesh, source, texels, camera }, &truth)
    }

    fn bottle(&mut self, mesh: &fantex::Mesh) -> Result<()> {
        let original = LookSurface::of_model(mesh, FilterOptions::default())?;
        let camera = self.camera(mesh, Camera::THREE_QUARTER);
        self.make(
            &Subtask { name: "bottle", mesh, source: Source::own_materials, texels: None, camera },
            &original,
        )
    }

    /// Bakes, verifies, renders and compares.
    fn make(&mut self, task: &Subtask, original: &dyn Surface) -> Result<()> {
        let Subtask { name, mesh, camera, .. } = task;
        let asset_path = self.target(&format!("{name}.fan"))?;
        let mut part = self.bake(task, &asset_path)?;
        self.context.note(format!("verifying {}", asset_path.display()));
        let memory_bytes = self.context.memory_bytes as usize;
        let report = verify(&asset_path, &VerifyOptions { memory_bytes, ..VerifyOptions::default() })?;
        if !report.ok {
            return Err(not_verified(&asset_path, &report));
        }
        part.largest_jump = report.continuity.largest_jump;

        self.context.note(format!("rendering the {name}, baked and original"));
        let cache = PageCache::new(Arc::new(Asset::open(&asset_path)?), memory_bytes);
        let baked = FanSurface::boxed(&cache, FilterOptions::default());
        let options = RenderOptions::default();
        for (suffix, surface) in [("baked", &*baked), ("original", original)] {
            let path = self.target(&format!("{name}-{suffix}.png"))?;
            save(&photograph(mesh, surface, camera, &options)?.picture, &path, self.context)?;
            self.info.pictures.push(path.into());
        }
        let small = RenderOptions { width: 640, height: 480, samples: 4, ..options };
        let cameras = Camera::orbit(mesh, VIEWS, aspect(&small));
        let subjects = [Subject { mesh, surface: original }, Subject { mesh, surface: &*baked }];
        part.psnr_db = mean_psnr_db(subjects, &cameras, &small, self.context)?;
        self.info.assets.push(asset_path.into());
        self.info.parts.push(part);
        Ok(())
    }

    fn bake(&self, task: &Subtask, path: &Path) -> Result<Part> {
        self.context.note(format!("baking {}", path.display()));
        let started = Instant::now();
        let _deferral = self.context.defer_interrupt();
        let progress = self.context.progress(task.name);
        let mut baker = Baker::new(task.mesh)
            .source((task.source)())
            .overwrite(self.force)
            .memory(self.context.memory_bytes)
            .seed(self.context.seed)
            .progress(&progress);
        if let Some(texels) = task.texels {
            baker = baker.texels(texels);
        }
        let summary = baker.write(path)?.summary;
        Ok(Part {
            name: task.name,
            triangles: task.mesh.triangles.len() as u64,
            texels: summary.texels,
            channels: summary.channels.len() as u64,
            bytes: summary.bytes,
            seconds: started.elapsed().as_secs_f64(),
            largest_jump: 0.0,
            psnr_db: 0.0,
        })
    }

    fn camera(&self, mesh: &Mesh, direction: DVec3) -> Camera {
        Camera::framing_mesh(mesh, direction, aspect(&RenderOptions::default()))
    }

    /// A file in the demo's folder that may be written.
    fn target(&self, name: &str) -> Result<PathBuf> {
        let path = self.info.folder.join(name);
        if self.force {
            return Ok(path);
        }
        self.context.check_output(&path).map(|()| path)
    }
}

fn text(info: &DemoInfo) -> String {
    let heading = ["", "triangles", "texels", "channels", "MB", "seconds", "largest jump", "PSNR dB"];
    let mut rows = vec![heading.map(str::to_owned).to_vec()];
    rows.extend(info.parts.iter().map(|part| {
        vec![
            part.name.to_owned(),
            grouped(part.triangles),
            grouped(part.texels),
            part.channels.to_string(),
            format!("{:.1}", part.bytes as f64 / 1e6),
            format!("{:.1}", part.seconds),
            format!("{:.1e}", part.largest_jump),
            format!("{:.1}", part.psnr_db),
        ]
    }));
    let mut text = columns(&rows);
    text.push_str(&format!("\nall in {:.1} s; made:\n", info.seconds));
    for path in info.models.iter().chain(&info.assets).chain(&info.pictures) {
        text.push_str(&format!("  {}\n", path.display()));
    }
    text
}
