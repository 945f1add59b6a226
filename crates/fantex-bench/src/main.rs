//! Benchmarks of fantex that only its developers need: covers, images, noise, block encoders, pictures of a million triangles,
//! the first picture of an asset far away.
//!
//! `cargo run --release -p fantex-bench -- [covers|images|noise|encode|terrain|remote ...] [--json]`

mod covers;
mod images;
mod noise;
mod remote;
mod terrain;

use std::error::Error;
use std::process::ExitCode;
use std::time::Instant;

use fantex::base::random::nth_random;
use fantex::store::{PageTexels, Quality, TexelFormat, TexelSlice, encode_many};

type Measured = Result<Vec<Row>, Box<dyn Error>>;

type Subject = fn() -> Measured;

const SUBJECTS: [(&str, Subject); 6] = [
    ("covers", covers::rows),
    ("images", images::rows),
    ("noise", noise::rows),
    ("encode", encode),
    ("terrain", terrain::rows),
    ("remote", remote::rows),
];

const SEED: u64 = 1;

/// Repetitions of quick measurements; the fastest counts.
const REPETITIONS: usize = 3;

#[derive(Clone, Debug)]
struct Row {
    name: String,
    value: f64,
    unit: &'static str,
    /// The same measured for the usual way of doing it, where there is one.
    peer: Option<f64>,
}

impl Row {
    fn new(name: impl Into<String>, value: f64, unit: &'static str) -> Self {
        Self { name: name.into(), value, unit, peer: None }
    }

    fn beside(self, peer: Option<f64>) -> Self {
        Self { peer, ..self }
    }

    fn ratio(&self) -> Option<f64> {
        self.peer.map(|peer| self.value / peer)
    }

    fn json(&self) -> serde_json::Value {
        let Self { name, value, unit, peer } = self;
        serde_json::json!({ "name": name, "value": value, "unit": unit, "peer": peer, "ratio": self.ratio() })
    }
}

fn main() -> ExitCode {
    let mut names: Vec<String> = std::env::args().skip(1).collect();
    let is_json = names.iter().any(|name| name == "--json");
    names.retain(|name| name != "--json");
    if let Some(unknown) = names.iter().find(|name| !SUBJECTS.iter().any(|(known, _)| known == name)) {
        let known: Vec<&str> = SUBJECTS.iter().map(|(name, _)| *name).collect();
        eprintln!("there is no benchmark '{unknown}'; there are {}", known.join(", "));
        return ExitCode::from(2);
    }
    let mut rows = Vec::new();
    for (name, measure) in SUBJECTS {
        if names.is_empty() || names.iter().any(|wanted| wanted == name) {
            match measure() {
                Ok(measured) => rows.extend(measured),
                Err(error) => {
                    eprintln!("{name}: {error}");
                    return ExitCode::FAILURE;
                }
            }
        }
    }
    if is_json {
        println!("{}", serde_json::json!({ "rows": rows.iter().map(Row::json).collect::<Vec<_>>() }));
        return ExitCode::SUCCESS;
    }
    let number = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.3}"));
    for row in &rows {
        let Row { name, value, unit, peer } = row;
        println!("{name:<60} {value:>10.3} {unit:<12} {:>10} {:>7}", number(*peer), number(row.ratio()));
    }
    ExitCode::SUCCESS
}

/// Seconds of the fastest repetition.
fn fastest<T, E>(mut work: impl FnMut() -> Result<T, E>) -> Result<f64, E> {
    let mut best = f64::INFINITY;
    for _ in 0..REPETITIONS {
        let started = Instant::now();
        work()?;
        best = best.min(started.elapsed().as_secs_f64());
    }
    Ok(best)
}

/// Block encoders on a noisy gradient, all threads.
fn encode() -> Measured {
    const SIDE: u32 = 256;
    const TILES: u64 = 64;
    let tile: Vec<[u8; 4]> = (0..SIDE * SIDE)
        .map(|i| {
            let [x, y] = [i % SIDE, i / SIDE];
            let noise = ((24 * (nth_random(SEED, u64::from(i)) >> 40)) >> 24) as u32;
            [(x / 2 + noise) as u8, (y / 2 + noise) as u8, ((x + y) / 4 + noise) as u8, 255]
        })
        .collect();
    let formats = [
        ("encode bc1", TexelFormat::Bc1, Quality::UltraFast),
        ("encode bc4", TexelFormat::Bc4, Quality::UltraFast),
        ("encode bc5", TexelFormat::Bc5, Quality::UltraFast),
        ("encode bc7, ultra-fast", TexelFormat::Bc7, Quality::UltraFast),
        ("encode bc7, very-fast", TexelFormat::Bc7, Quality::VeryFast),
        ("encode bc7, basic", TexelFormat::Bc7, Quality::Basic),
    ];
    let tiles: Vec<_> = (0..TILES)
        .map(|_| PageTexels { extent: [SIDE; 2], texels: TexelSlice::U8(&tile), read: None })
        .collect();
    let texels = TILES as f64 * f64::from(SIDE * SIDE);
    formats
        .into_iter()
        .map(|(name, format, quality)| {
            let seconds = fastest(|| encode_many(format, quality, &tiles))?;
            Ok(Row::new(name, texels / seconds / 1e6, "M texels/s"))
        })
        .collect()
}
