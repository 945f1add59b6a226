//! Tips: shapes of dabs that come with the program.

use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_paint::{Brush, Sample, Size, Stamp, Stroke, StrokeFile, StrokeLog, Symmetry, Tip, dabs_of};
use fantex_store::Asset;
use glam::Vec3;

use crate::{Baked, Contents, ball, contents, paint_stroke, red, run, strokes};

#[test]
fn tips_have_something_in_them_and_differ() {
    for (i, tip) in Tip::ALL.into_iter().enumerate() {
        let texels = tip.texels();
        assert_eq!(texels.len(), Tip::SIDE * Tip::SIDE);
        assert!(texels.iter().all(|c| (0.0..=1.0).contains(c)), "{tip:?}");
        let mean = texels.iter().sum::<f32>() / texels.len() as f32;
        assert!((0.02..0.8).contains(&mean), "{tip:?} covers {mean}");
        // Textured: neighbours differ by more than those of a soft disc do.
        let change = texels.windows(2).map(|pair| (pair[0] - pair[1]).abs()).sum::<f32>();
        assert!(change / texels.len() as f32 > 0.005, "{tip:?} changes by {change}");
        for other in &Tip::ALL[..i] {
            let apart = texels.iter().zip(other.texels()).map(|(a, b)| (a - b).abs()).sum::<f32>();
            assert!(apart / texels.len() as f32 > 0.03, "{tip:?} is like {other:?}");
        }
    }
}

/// However a dab is turned and how large it is, its border does not show: tips are empty from the rim of the disc on.
#[test]
fn tips_have_no_edges() {
    for tip in Tip::ALL {
        let stamp = Stamp::of_tip(tip).unwrap();
        for step in 0..360u16 {
            let (sin, cos) = f32::from(step).to_radians().sin_cos();
            for radius in [0.99f32, 1.0, 1.1, 1.4, 2.0] {
                assert_eq!(stamp.coverage(radius * cos, radius * sin), 0.0, "{tip:?} at {step} degrees");
            }
            let near = stamp.coverage(0.94 * cos, 0.94 * sin);
            assert!(near < 0.1, "{tip:?} ends sharply at {step} degrees: {near}");
        }
    }
}

/// The same on every machine and in every run: what tips are made of is arithmetic and hashes.
#[test]
fn tips_are_always_the_same() {
    let texels_of = |threads: usize| {
        let each = |_| std::thread::spawn(|| Tip::ALL.map(|tip| tip.texels().to_vec()));
        let all: Vec<_> = (0..threads).map(each).collect();
        all.into_iter().map(|thread| thread.join().unwrap()).collect::<Vec<_>>()
    };
    let all = texels_of(4);
    assert!(all.iter().all(|texels| *texels == all[0]));
    // Steps of a byte.
    assert!(all[0].iter().flatten().all(|c| (c * 255.0).fract().min(1.0 - (c * 255.0).fract()) < 1e-3));
}

/// What a stroke with this tip makes of a ball, which stays as it was.
fn painted(baked: &Baked, tip: Option<Tip>) -> Contents {
    let mut painter = baked.painter();
    let surface = Arc::clone(painter.surface());
    let sample = |p: Vec3| Sample::at(surface.nearest(p, f32::INFINITY).unwrap());
    let line = Stroke {
        brush: Brush { size: Size::Texels(50.0), hardness: 1.0, spacing: 0.4, tip, ..Brush::default() },
        stamp: tip.map(|tip| Arc::new(Stamp::of_tip(tip).unwrap())),
        samples: [Vec3::X, Vec3::new(0.7, 0.7, 0.0), Vec3::Y].map(sample).to_vec(),
        line: false,
        symmetry: Symmetry::None,
    };
    paint_stroke(&mut painter, red(1.0), &line);
    contents(&painter)
}

#[test]
fn strokes_with_different_tips_differ_and_repeat() {
    let baked = ball(60_000, BakeFormat::Rgba8);
    let round = painted(&baked, None);
    let mut all: Vec<Contents> = Vec::new();
    for tip in Tip::ALL {
        let found = painted(&baked, Some(tip));
        assert!(found == painted(&baked, Some(tip)), "{tip:?} is the same each time");
        assert!(found != round && all.iter().all(|other| *other != found), "{tip:?} is like another one");
        all.push(found);
    }
}

const CHALK: &str = r#"{ "label": "chalk", "brush": { "size": { "texels": 60 }, "tip": "chalk", "jitter": { "angle": 3 } },
    "channels": [{ "kind": "base_color", "color": { "linear": [0.9, 0.1, 0.1, 1] } }],
    "samples": [{ "at": { "position": [1, 0, 0] } }, { "at": { "position": [0, 1, 0] } }] }"#;

/// Sum of the differences of bytes.
fn apart(a: &Contents, b: &Contents) -> f64 {
    let pages = a.0.iter().zip(&b.0);
    let bytes = pages.flat_map(|((_, a), (_, b))| a.iter().zip(b));
    bytes.map(|(a, b)| f64::from(a.abs_diff(*b))).sum()
}

#[test]
fn stroke_files_and_logs_name_tips() {
    let file = strokes(CHALK);
    assert_eq!(file.strokes[0].brush.tip, Some(Tip::Chalk));
    let written = serde_json::to_string(&file).unwrap();
    assert!(written.contains(r#""tip":"chalk""#), "{written}");
    assert_eq!(serde_json::from_str::<StrokeFile>(&written).unwrap(), file);
    let [first, second] = [ball(60_000, BakeFormat::Rgba8), ball(60_000, BakeFormat::Rgba8)];
    let chalk = contents(&run(&first, CHALK));
    let round = contents(&run(&ball(60_000, BakeFormat::Rgba8), &CHALK.replace("\"tip\": \"chalk\",", "")));
    assert!(chalk != round, "the tip counts");
    let log = StrokeLog::of(&Asset::open(&first.path).unwrap()).unwrap();
    let mut painter = second.painter();
    assert_eq!(log.replay(&mut painter).unwrap().unrecorded, 0);
    let [again, other] = [&contents(&painter), &round].map(|contents| apart(contents, &chalk));
    assert!(again < 0.05 * other, "the log paints with the tip, too: {again} {other}");
    let refused = serde_json::from_str::<Brush>(r#"{ "tip": "feather" }"#).unwrap_err().to_string();
    assert!(refused.contains("feather") && refused.contains("chalk"), "{refused}");
}

#[test]
fn dabs_carry_their_tip() {
    let baked = ball(60_000, BakeFormat::Rgba8);
    let painter = baked.painter();
    let surface = Arc::clone(painter.surface());
    let at = surface.nearest(Vec3::X, f32::INFINITY).unwrap();
    let stroke = Stroke {
        brush: Brush { tip: Some(Tip::Leaf), ..Brush::default() },
        stamp: Some(Arc::new(Stamp::of_tip(Tip::Leaf).unwrap())),
        samples: vec![Sample::at(at)],
        line: false,
        symmetry: Symmetry::None,
    };
    let dabs = dabs_of(&surface, &stroke);
    assert!(!dabs.is_empty() && dabs.iter().all(|dab| dab.stamp.is_some()));
}
