//! Verification compares detail levels: whatever was painted, hidden and taken back passes, and paint that stays behind does not.

use std::sync::Arc;

use fantex_bake::{BakeFormat, BakeOptions, NoProgress, Prefilter, Source, SourceChannel, TexelPoint, bake};
use fantex_base::Random;
use fantex_mesh::{AlphaMode, Material, Mesh, generate};
use fantex_paint::{
    BlendMode, ChannelPaint, FillArea, Layer, Paint, PaintColor, Painter, Target, Tool, dabs_of,
};
use fantex_store::{AssetEditor, ChannelKind, EditOptions, VerifyOptions, VerifyReport, verify};
use glam::{Vec3, Vec4};

use crate::layers::{LINE, everywhere, paint_on, white};
use crate::{Baked, ball, cleaned, contents, cover, red, stroke};

const FORMATS: [BakeFormat; 4] = [BakeFormat::Rgba8, BakeFormat::Bc7, BakeFormat::Bc1, BakeFormat::Float];

fn with_texels(baked: &Baked) -> VerifyReport {
    verify(&baked.path, &VerifyOptions { texels: true, ..VerifyOptions::default() }).unwrap()
}

#[track_caller]
fn assert_passes(what: &str, baked: &Baked) {
    let report = with_texels(baked);
    assert!(report.ok, "{what}: {report:?}");
    assert!(report.texels.unwrap().compared > 1000, "{what}");
}

/// Every texel has a colour and a roughness of its own.
struct Grain;

impl Source for Grain {
    fn channels(&self) -> Vec<SourceChannel> {
        [ChannelKind::BaseColor, ChannelKind::OcclusionRoughnessMetallic].map(SourceChannel::new).to_vec()
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Box
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let mut random = Random::of_seeds(point.position.to_array().map(|x| u64::from(x.to_bits())));
        for value in values {
            *value = Vec3::from([0; 3].map(|_: i32| random.unit() as f32)).extend(1.0);
        }
    }
}

fn grained(mesh: &Mesh, texels: u64, format: BakeFormat) -> Baked {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let options = BakeOptions { format, ..BakeOptions::default() };
    bake(mesh, &cover(mesh, 64, texels), &Grain, &path, &options, &NoProgress).unwrap();
    Baked { path, folder }
}

/// Strokes on the base and on layers, and layers that are hidden, shown, mixed, deleted and taken back.
#[test]
fn painted_assets_pass() {
    for format in FORMATS {
        let grained = grained(&cleaned(generate::icosphere(3)), 60_000, format);
        for (name, baked) in [("waves", ball(60_000, format)), ("grain", grained)] {
            let mut painter = baked.painter();
            let check = |painter: &mut Painter, step: &str| {
                painter.commit().unwrap();
                assert_passes(&format!("{format:?}, {name}, {step}"), &baked);
            };
            paint_on(&mut painter, Target::Base, red(0.5), &[Vec3::Y, Vec3::X]);
            check(&mut painter, "a stroke");
            let layer = painter.add_layer(Layer::painted("paint")).unwrap();
            paint_on(&mut painter, Target::Layer(layer), red(1.0), &LINE);
            check(&mut painter, "a layer");
            let fill = painter.add_layer(Layer::fill("fill", &[Vec4::new(0.0, 0.4, 0.1, 1.0)])).unwrap();
            paint_on(&mut painter, Target::Mask(fill), white(), &[Vec3::Y, Vec3::new(0.6, 0.6, 0.5)]);
            check(&mut painter, "a fill");
            painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
            check(&mut painter, "hidden");
            paint_on(&mut painter, Target::Base, red(0.8), &[Vec3::Z, Vec3::X]);
            painter.edit_layers("show", |layers| layers[0].visible = true).unwrap();
            check(&mut painter, "shown");
            painter.edit_layers("fade", |layers| layers[1].opacity = 0.3).unwrap();
            painter.add_layer(everywhere(Vec4::new(0.1, 0.4, 0.1, 1.0))).unwrap();
            check(&mut painter, "everywhere");
            painter.edit_layers("remove", |layers| layers.retain(|other| other.id() == layer)).unwrap();
            check(&mut painter, "removed");
            painter.edit_layers("remove all", Vec::clear).unwrap();
            check(&mut painter, "all removed");
            while painter.undo().unwrap() {}
            check(&mut painter, "undone");
        }
    }
}

/// Opacity that is painted, of materials that take it in all ways.
#[test]
fn painted_cut_outs_pass() {
    for format in FORMATS {
        for alpha in [AlphaMode::Mask(0.5), AlphaMode::Mask(0.3), AlphaMode::Blend, AlphaMode::Opaque] {
            let mut mesh = cleaned(generate::grid(8));
            mesh.materials = vec![Material { alpha, ..Material::default() }];
            mesh.triangle_materials = vec![0; mesh.triangles.len()];
            let baked = grained(&mesh, 60_000, format);
            let mut painter = baked.painter();
            let channels = vec![ChannelPaint::new(0, PaintColor::Constant(Vec4::ONE))];
            let tool = Tool::Opacity { to: 0.0 };
            let hole = || Paint {
                tool: tool.clone(),
                opacity: 1.0,
                channels: channels.clone(),
                stencil: None,
                sight: None,
            };
            let line = [Vec3::new(-0.6, 0.0, -0.5), Vec3::new(0.6, 0.0, 0.2)];
            paint_on(&mut painter, Target::Base, hole(), &line);
            paint_on(&mut painter, Target::Base, hole(), &[Vec3::new(-0.3, 0.0, 0.7)]);
            let layer = painter.add_layer(Layer::painted("patch")).unwrap();
            paint_on(&mut painter, Target::Layer(layer), red(1.0), &[Vec3::ZERO, Vec3::new(0.3, 0.0, 0.5)]);
            painter.commit().unwrap();
            assert_passes(&format!("{format:?}, {alpha:?}, painted"), &baked);
            painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
            painter.commit().unwrap();
            assert_passes(&format!("{format:?}, {alpha:?}, hidden"), &baked);
            painter.edit_layers("delete", Vec::clear).unwrap();
            for other in [AlphaMode::Mask(0.4), AlphaMode::Blend] {
                painter.set_alpha_mode(other).unwrap();
                assert_passes(&format!("{format:?}, {alpha:?}, then {other:?}"), &baked);
            }
        }
    }
}

/// Heights, and the normals that they bend, in channels that are added.
#[test]
fn painted_relief_passes() {
    for format in [BakeFormat::Rgba8, BakeFormat::Bc7] {
        let baked = ball(60_000, format);
        let mut painter = baked.painter();
        painter.add_channels(&[ChannelKind::Normal, ChannelKind::Displacement]).unwrap();
        assert_passes("added", &baked);
        let raised = Paint {
            tool: Tool::Paint(BlendMode::Normal),
            opacity: 1.0,
            channels: vec![ChannelPaint::new(3, PaintColor::Constant(Vec3::splat(0.8).extend(1.0)))],
            stencil: None,
            sight: None,
        };
        let surface = Arc::clone(painter.surface());
        let layer = painter.add_layer(Layer::painted("relief")).unwrap();
        painter.begin_on(Target::Layer(layer), "raise", raised).unwrap();
        painter.dab(&dabs_of(&surface, &stroke(&surface, 90.0, &LINE))).unwrap();
        painter.end().unwrap();
        painter.commit().unwrap();
        assert_passes("raised", &baked);
        painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
        painter.commit().unwrap();
        assert_passes("hidden", &baked);
    }
}

/// One colour everywhere, on all levels.
#[test]
fn a_fill_of_everything_passes() {
    for format in FORMATS {
        let baked = grained(&cleaned(generate::icosphere(3)), 60_000, format);
        let mut painter = baked.painter();
        painter.begin("fill", red(1.0)).unwrap();
        painter.fill(FillArea::Everything).unwrap();
        painter.commit().unwrap();
        assert_passes(&format!("{format:?}"), &baked);
    }
}

/// A layer is hidden, and the texels of a level still show it.
#[test]
fn paint_of_hidden_layers_that_stays_is_found() {
    for format in [BakeFormat::Rgba8, BakeFormat::Bc7] {
        for level in 0..2 {
            let baked = ball(60_000, format);
            let mut painter = baked.painter();
            let layer = painter.add_layer(Layer::painted("paint")).unwrap();
            paint_on(&mut painter, Target::Layer(layer), red(1.0), &LINE);
            let (painted, _) = contents(&painter);
            painter.edit_layers("hide", |layers| layers[0].visible = false).unwrap();
            painter.commit().unwrap();
            drop(painter);
            assert_passes("hidden", &baked);
            let mut editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
            // All channels of a page after each other.
            let channels = editor.asset().channels().len();
            let mut count = 0;
            for (id, bytes) in painted.into_iter().step_by(channels).filter(|(id, _)| id.level == level) {
                if editor.read_page_raw(0, id).unwrap() != bytes {
                    editor.replace(id, 0, bytes).unwrap();
                    count += 1;
                }
            }
            assert!(count > 0);
            editor.commit().unwrap();
            drop(editor);
            let report = with_texels(&baked);
            assert!(report.continuity.largest_jump < 1e-4, "edges say nothing of it");
            let texels = report.texels.unwrap();
            assert!(!report.ok && texels.contradictions > 10, "{format:?}, level {level}: {texels:?}");
            assert!(texels.first.iter().all(|sentence| sentence.starts_with("base colour of tile ")));
        }
    }
}
