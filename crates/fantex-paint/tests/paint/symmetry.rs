//! Symmetric strokes: what copies do is what the stroke does, moved.

use std::f32::consts::FRAC_PI_2;
use std::path::Path;
use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_base::Random;
use fantex_mesh::{Mesh, generate};
use fantex_paint::{
    Brush, ChannelPaint, Dab, Jitter, LiveStroke, Paint, PaintColor, PressureResponse, Sample, Size, Stamp,
    Stroke, StrokeLog, StrokeSettings, Surface, SurfacePoint, Symmetry, Tip, Tool, ToolSettings, dabs_of,
};
use fantex_store::Asset;
use glam::{DVec3, Vec3, Vec4};

use crate::{Baked, cleaned, color_at, cover, mesh_of, run};

/// The square from -1 to 1 in x and y, seen from +z: its tangent axes are x and y.
fn square() -> Mesh {
    let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
    mesh_of(corners.map(DVec3::from).to_vec(), vec![[0, 1, 2], [0, 2, 3]])
}

fn surface_of(mesh: Mesh) -> Surface {
    let cover = cover(&mesh, 64, 100_000);
    Surface::new(Arc::new(mesh), Arc::new(cover))
}

fn at(surface: &Surface, x: f32, y: f32) -> Sample {
    Sample::at(surface.nearest(Vec3::new(x, y, 0.0), f32::INFINITY).unwrap())
}

fn drawn(brush: Brush, samples: Vec<Sample>, symmetry: Symmetry) -> Stroke {
    Stroke { brush, stamp: None, samples, line: false, symmetry }
}

const MIRROR: Symmetry = Symmetry::Mirror { axis: 0, offset: 0.0 };

/// Two angles are the same but for whole turns.
fn are_same(a: f32, b: f32) -> bool {
    ((a - b) * 0.5).sin().abs() < 1e-4
}

/// In a mirror a picture that is turned counter-clockwise is turned clockwise; around an axis all turn with it.
#[test]
fn dabs_of_copies_are_turned_as_their_places_are() {
    let surface = surface_of(square());
    let brush = Brush { size: Size::World(0.2), angle: 40.0, follow_tilt: true, ..Brush::default() };
    let leaning = Sample { tilt: [0.3, 0.4], ..at(&surface, 0.5, 0.2) };
    let angle = 40f32.to_radians() + (0.4f32).atan2(0.3);
    let two = dabs_of(&surface, &drawn(brush.clone(), vec![leaning], MIRROR));
    let [dab, copy] = two.as_slice() else { panic!("{two:?}") };
    assert!(are_same(dab.angle, angle) && are_same(copy.angle, -angle), "{} {}", dab.angle, copy.angle);
    assert_eq!([dab.mirrored, copy.mirrored], [false, true]);
    assert_eq!([dab.copy, copy.copy], [0, 1]);
    assert_eq!(dab.aspect.to_bits(), copy.aspect.to_bits());
    let radial = Symmetry::Radial { axis: 2, center: [0.0; 3], count: 4 };
    let four = dabs_of(&surface, &drawn(brush, vec![leaning], radial));
    assert_eq!(four.len(), 4);
    for (k, dab) in four.iter().enumerate() {
        assert!(are_same(dab.angle, angle + k as f32 * FRAC_PI_2), "{k}: {}", dab.angle);
        assert!(!dab.mirrored && dab.copy == k as u32);
    }
}

#[test]
fn jitter_of_copies_is_moved_with_them() {
    let surface = surface_of(square());
    let jitter = Jitter { position: 1.5, size: 0.8, flow: 0.5, angle: 2.0 };
    let brush = Brush { size: Size::World(0.1), spacing: 0.9, jitter, seed: 3, ..Brush::default() };
    let samples = vec![at(&surface, 0.4, -0.5), at(&surface, 0.4, 0.5)];
    let dabs = dabs_of(&surface, &drawn(brush, samples, MIRROR));
    let (own, copied) = dabs.split_at(dabs.len() / 2);
    assert!(own.len() > 8 && own.len() == copied.len());
    for (dab, copy) in own.iter().zip(copied) {
        let [p, q] = [dab, copy].map(|dab| surface.position(dab.center));
        assert!((p * DVec3::new(-1.0, 1.0, 1.0)).distance(q) < 1e-4, "{p} {q}");
        assert!((dab.radius - copy.radius).abs() < 1e-6 && (dab.flow - copy.flow).abs() < 1e-6);
        assert!(are_same(dab.angle, -copy.angle));
    }
    assert!(own.iter().any(|dab| (surface.position(dab.center).x - 0.4).abs() > 0.02), "there is jitter");
}

/// A black square with what strokes paint on it.
fn black(strokes: &str) -> (Baked, fantex_paint::Painter) {
    let mesh = square();
    let baked = Baked::new(&mesh, &cover(&mesh, 64, 250_000), BakeFormat::Float);
    let fill =
        r#"{ "fill": "whole", "channels": [{ "kind": "base_color", "color": { "linear": [0, 0, 0, 1] } }] }"#;
    let painter = run(&baked, &format!("{fill}, {strokes}"));
    (baked, painter)
}

const LEAF: &str = r#"{ "brush": { "size": { "world": 0.8 }, "tip": "leaf", "angle": 40, "hardness": 1 },
    "channels": [{ "kind": "base_color", "color": { "linear": [1, 1, 1, 1] } }],
    "samples": [{ "at": { "position": [0.5, 0.2, 0] } }], "symmetry": SYMMETRY }"#;

/// Red in a grid of places around (0.5, 0.2), and in the same places as `moved` has them.
fn pairs(baked: &Baked, painter: &fantex_paint::Painter, moved: impl Fn(Vec3) -> Vec3) -> Vec<[f32; 2]> {
    let cache = baked.cache();
    let places = (0..40 * 40).map(|i| {
        let [x, y] = [i % 40, i / 40].map(|k| (k as f32 - 19.5) / 50.0);
        Vec3::new(0.5 + x, 0.2 + y, 0.0)
    });
    places.map(|place| [place, moved(place)].map(|place| color_at(&cache, painter, place).x)).collect()
}

#[test]
fn tips_of_copies_are_mirrored_and_turned() {
    type Moved = fn(Vec3) -> Vec3;
    let cases: [(&str, Moved); 2] = [
        (r#"{ "mirror": { "axis": 0 } }"#, |p| Vec3::new(-p.x, p.y, 0.0)),
        (r#"{ "radial": { "axis": 2, "count": 4 } }"#, |p| Vec3::new(-p.y, p.x, 0.0)),
    ];
    for (symmetry, moved) in cases {
        let (baked, painter) = black(&LEAF.replace("SYMMETRY", symmetry));
        let found = pairs(&baked, &painter, moved);
        let painted = found.iter().filter(|[own, _]| *own > 0.5).count();
        assert!(painted > 50, "{painted}");
        let apart = found.iter().map(|[a, b]| (a - b).abs()).sum::<f32>();
        // Turned by 80 degrees the same leaf differs in most of its places.
        assert!(apart < 0.1 * painted as f32, "{symmetry}: {apart} {painted}");
    }
}

/// Replays an asset's log on another black square, and compares colours there.
fn assert_replays(baked: &Baked, painter: &fantex_paint::Painter) {
    let log = StrokeLog::of(&Asset::open(&baked.path).unwrap()).unwrap();
    let mesh = square();
    let other = Baked::new(&mesh, &cover(&mesh, 64, 250_000), BakeFormat::Float);
    let mut again = other.painter();
    assert_eq!(log.replay(&mut again).unwrap().unrecorded, 0);
    again.commit().unwrap();
    let (first, second) = (baked.cache(), other.cache());
    for i in 0..50 * 50 {
        let [x, y] = [i % 50, i / 50].map(|k| (k as f32 - 24.5) / 26.0);
        let place = Vec3::new(x, y, 0.0);
        let [a, b] = [color_at(&first, painter, place), color_at(&second, &again, place)];
        assert!(a.distance(b) < 0.05, "{place}: {a} {b}");
    }
}

/// Paints as a window does: it says how, and the dabs come by themselves.
fn paint_recorded(
    painter: &mut fantex_paint::Painter,
    tool: Tool,
    recorded: StrokeSettings,
    stroke: &Stroke,
    folder: &Path,
) {
    let channels = vec![ChannelPaint::new(0, PaintColor::Constant(Vec4::ONE))];
    let surface = Arc::clone(painter.surface());
    let paint = Paint { tool, opacity: 1.0, channels, stencil: None, sight: None };
    painter.begin("recorded", paint).unwrap();
    painter.record(recorded, folder).unwrap();
    painter.dab(&dabs_of(&surface, stroke)).unwrap();
    painter.end().unwrap();
    painter.commit().unwrap();
}

#[test]
fn logged_dabs_are_mirrored() {
    let (baked, mut painter) = black(
        r#"{ "channels": [{ "kind": "base_color" }], "samples": [{ "at": { "position": [0, 0, 0] } }] }"#,
    );
    let brush = Brush { size: Size::World(0.8), angle: 40.0, tip: Some(Tip::Leaf), ..Brush::default() };
    let mut stroke = drawn(brush.clone(), vec![at(painter.surface(), 0.5, 0.2)], MIRROR);
    stroke.stamp = Some(Arc::new(Stamp::of_tip(Tip::Leaf).unwrap()));
    let mut recorded: StrokeSettings = serde_json::from_str(
        r#"{ "channels": [{ "kind": "base_color", "color": { "linear": [1, 1, 1, 1] } }] }"#,
    )
    .unwrap();
    recorded.brush = brush;
    let tool = Tool::Paint(fantex_paint::BlendMode::Normal);
    paint_recorded(&mut painter, tool, recorded, &stroke, baked.folder.path());
    assert_replays(&baked, &painter);
    // Logs from before dabs were mirrored say nothing, and mean that they are not.
    let dab = r#"{ "at": { "position": [0, 0, 0] }, "radius": 1, "hardness": 1, "flow": 1 }"#;
    let dab: fantex_paint::DabSettings = serde_json::from_str(dab).unwrap();
    assert_eq!((dab.mirrored, dab.copy), (false, 0));
}

const DOT: &str = r#"{ "brush": { "size": { "world": 0.2 }, "hardness": 0.9 },
    "channels": [{ "kind": "base_color", "color": { "linear": [1, 0, 0, 1] } }],
    "samples": [{ "at": { "position": [0.7, 0.2, 0] } }], "symmetry": { "mirror": { "axis": 0 } } }"#;

/// What is red where a clone has copied the red dots at (0.7, 0.2) and (-0.7, 0.2) to (0.4, 0.2) and (-0.4, 0.2).
#[track_caller]
fn assert_cloned(baked: &Baked, painter: &fantex_paint::Painter) {
    let cache = baked.cache();
    for (x, red) in [(0.7, 1.0), (0.4, 1.0), (0.1, 0.0), (-0.1, 0.0), (-0.4, 1.0), (-0.7, 1.0)] {
        let found = color_at(&cache, painter, Vec3::new(x, 0.2, 0.0));
        assert!((found.x - red).abs() < 0.02, "{x}: {found}");
    }
}

#[test]
fn each_copy_of_a_clone_copies_from_its_own_side() {
    let clone = r#"{ "brush": { "size": { "world": 0.2 }, "hardness": 0.9 }, "tool": { "clone": { "from": [0.7, 0.2, 0] } },
        "channels": [{ "kind": "base_color" }], "samples": [{ "at": { "position": [0.4, 0.2, 0] } }],
        "symmetry": { "mirror": { "axis": 0 } } }"#;
    let (baked, painter) = black(&format!("{DOT}, {clone}"));
    assert_cloned(&baked, &painter);
    drop(painter);

    // The same by dabs, whose first one jitter has moved.
    let (baked, mut painter) = black(DOT);
    let surface = Arc::clone(painter.surface());
    let jitter = Jitter { position: 0.2, ..Jitter::default() };
    let brush = Brush { size: Size::World(0.2), hardness: 0.9, jitter, ..Brush::default() };
    let size = brush.size;
    let stroke = drawn(brush, vec![at(&surface, 0.4, 0.2)], MIRROR);
    let [from, to] = [Vec3::new(0.7, 0.2, 0.0), Vec3::new(0.4, 0.2, 0.0)];
    let tool = Tool::clone_of(&surface, from, to, size, MIRROR);
    let recorded = StrokeSettings {
        tool: ToolSettings::Clone { from: from.as_dvec3().to_array() },
        channels: vec![serde_json::from_str(r#"{ "kind": "base_color" }"#).unwrap()],
        symmetry: MIRROR,
        brush: Brush { size, ..Brush::default() },
        ..StrokeSettings::default()
    };
    paint_recorded(&mut painter, tool, recorded, &stroke, baked.folder.path());
    assert_cloned(&baked, &painter);
    assert_replays(&baked, &painter);
}

#[test]
fn a_smoothed_stroke_that_leaves_the_model_goes_to_where_it_left() {
    let surface = surface_of(square());
    let brush = Brush { size: Size::World(0.1), smoothing: 0.8, ..Brush::default() };
    let mut live = LiveStroke::new(&surface, brush, None, Symmetry::None);
    let mut dabs = live.go_to(&surface, &at(&surface, 0.0, 0.0), false);
    dabs.extend(live.go_to(&surface, &at(&surface, 0.5, 0.0), false));
    let end = |dabs: &[Dab]| surface.position(dabs.last().unwrap().center).x;
    // A fifth of the way, in steps of a hundredth.
    assert!((end(&dabs) - 0.1).abs() < 0.011, "{}", end(&dabs));
    dabs.extend(live.lift(&surface));
    assert!((end(&dabs) - 0.5).abs() < 0.011, "{}", end(&dabs));
    assert!(live.lift(&surface).is_empty());
    // It goes on where the pen comes back, without a line between.
    let next = live.go_to(&surface, &at(&surface, -0.5, 0.5), false);
    assert_eq!(next.len(), 1);
}

/// Samples of a pen that wanders over a mesh, with runs between which it is lifted.
fn wandering(random: &mut Random, surface: &Surface) -> Vec<Vec<Sample>> {
    let mut place = Vec3::new(0.0, 0.1, 1.0);
    (0..=random.below(3))
        .map(|_| {
            (0..=random.below(6))
                .map(|_| {
                    place += Vec3::from_array([(); 3].map(|()| random.unit() as f32 - 0.5)) * 0.5;
                    let point: SurfacePoint = surface.nearest(place, f32::INFINITY).unwrap();
                    place = surface.position(point).as_vec3();
                    let tilt = [random.unit() as f32, random.unit() as f32];
                    Sample { pressure: random.unit() as f32, tilt, ..Sample::at(point) }
                })
                .collect()
        })
        .collect()
}

#[test]
fn strokes_by_hand_and_as_a_whole_have_the_same_dabs() {
    let surface = surface_of(cleaned(generate::torus(48, 24)));
    let mut random = Random::new(5);
    let symmetries = [
        Symmetry::None,
        MIRROR,
        // Its copies find no surface in places.
        Symmetry::Mirror { axis: 0, offset: 0.15 },
        Symmetry::Radial { axis: 1, center: [0.0; 3], count: 3 },
    ];
    let mut count = 0;
    for round in 0..80 {
        let symmetry = symmetries[round % symmetries.len()];
        let brush = Brush {
            size: Size::World(0.1 + 0.2 * random.unit() as f32),
            spacing: 0.1 + 0.3 * random.unit() as f32,
            smoothing: if random.chance(0.3) { 0.0 } else { random.unit() as f32 },
            jitter: Jitter { position: random.unit() as f32, size: 0.5, flow: 0.5, angle: 1.0 },
            pressure: PressureResponse { size: 0.5, flow: 0.5 },
            follow_tilt: true,
            seed: random.next_u64(),
            ..Brush::default()
        };
        let runs = wandering(&mut random, &surface);
        let mut live = LiveStroke::new(&surface, brush.clone(), None, symmetry);
        let (mut by_hand, mut whole) = (Vec::new(), Vec::new());
        for run in &runs {
            let ends_at_once = random.chance(0.5);
            for (k, sample) in run.iter().enumerate() {
                let is_end = ends_at_once && k + 1 == run.len();
                by_hand.extend(live.go_to(&surface, sample, is_end));
            }
            if random.chance(0.5) {
                by_hand.extend(live.go_to(&surface, run.last().unwrap(), true));
            }
            by_hand.extend(live.lift(&surface));
            whole.extend(dabs_of(&surface, &drawn(brush.clone(), run.clone(), symmetry)));
        }
        let of_copy = |dabs: &[Dab], copy| -> Vec<Dab> {
            dabs.iter().filter(|dab| dab.copy == copy).cloned().collect()
        };
        for copy in 0..3 {
            let [a, b] = [&by_hand, &whole].map(|dabs| of_copy(dabs, copy));
            assert_eq!(a.len(), b.len(), "round {round}, copy {copy}");
            for (a, b) in a.iter().zip(&b) {
                let apart = surface.position(a.center).distance(surface.position(b.center));
                assert!(apart < 1e-3, "round {round}, copy {copy}: {apart}");
                assert!((a.radius - b.radius).abs() < 1e-4 && (a.flow - b.flow).abs() < 1e-3);
                assert_eq!((a.mirrored, a.aspect < 1.0), (b.mirrored, b.aspect < 1.0));
            }
        }
        count += whole.len();
    }
    assert!(count > 2000, "{count}");
}
