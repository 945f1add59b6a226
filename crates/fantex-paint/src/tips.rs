//! Tips: shapes of a dab that come with the program, made by these functions.
//!
//! Each is a function of a place of the brush, -1..1 along both axes, and of integer hashes; arithmetic and roots only, and rounded to
//! bytes, so that a tip is the same on every machine. All are empty from the rim on: no border shows, however a dab is turned and how
//! large it is.

use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

/// A shape of the dab that comes with the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tip {
    /// Ends of many hairs, which draw streaks.
    Bristle,
    /// Rough ground under a soft stick.
    Chalk,
    /// Streaks, as of a stick that is laid flat.
    Charcoal,
    /// Large pores.
    Sponge,
    /// Threads of a cloth.
    Canvas,
    /// Fine grains.
    Grain,
    /// Parallel lines.
    Hatch,
    /// Drops of different sizes.
    Splatter,
    /// Soft billows.
    Cloud,
    /// Fields between cracks.
    Cracks,
    /// A leaf with its veins.
    Leaf,
    /// Teeth side by side, which draw hairs and grass.
    Rake,
}

impl Tip {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::Bristle,
        Self::Chalk,
        Self::Charcoal,
        Self::Sponge,
        Self::Canvas,
        Self::Grain,
        Self::Hatch,
        Self::Splatter,
        Self::Cloud,
        Self::Cracks,
        Self::Leaf,
        Self::Rake,
    ];

    /// Columns, and rows, of its picture.
    pub const SIDE: usize = 128;

    /// Coverage 0..1 of its texels, row by row from the top.
    pub fn texels(self) -> &'static [f32] {
        static MADE: [OnceLock<Vec<f32>>; Tip::ALL.len()] = [const { OnceLock::new() }; Tip::ALL.len()];
        MADE[self as usize].get_or_init(|| {
            let place = |texel: usize| (texel as f32 + 0.5) * (2.0 / Self::SIDE as f32) - 1.0;
            let texel = |i: usize| {
                let coverage = self.at(place(i % Self::SIDE), -place(i / Self::SIDE)).clamp(0.0, 1.0);
                (coverage * 255.0).round() / 255.0
            };
            (0..Self::SIDE * Self::SIDE).map(texel).collect()
        })
    }

    /// Coverage at a place: x to the right, y upwards.
    fn at(self, x: f32, y: f32) -> f32 {
        let radius = (x * x + y * y).sqrt();
        let rim = 1.0 - rise(0.7, 0.97, radius);
        // The outline of what is torn off.
        let torn = 1.0 - rise(0.55, 0.9, radius + 0.35 * (noise(5.0 * x, 5.0 * y, 91) - 0.5));
        let shape = match self {
            Self::Bristle => dots(8.5 * x, 8.5 * y, 0.85, [0.22, 0.5], 1),
            Self::Chalk => torn * rise(0.4, 0.62, fractal(11.0 * x, 11.0 * y, 3, 2)),
            Self::Charcoal => torn * rise(0.42, 0.66, fractal(5.0 * x, 21.0 * y, 3, 3)),
            Self::Sponge => {
                let pores = dots(4.0 * x, 4.0 * y, 0.8, [0.25, 0.55], 4);
                torn * (1.0 - pores) * rise(0.22, 0.5, fractal(9.0 * x, 9.0 * y, 3, 5))
            }
            Self::Canvas => weave(7.0 * x, 7.0 * y),
            Self::Grain => rise(0.5, 0.66, fractal(24.0 * x, 24.0 * y, 2, 6)),
            Self::Hatch => {
                let lines = tooth(4.5 * y + 0.35 * noise(3.0 * x, 3.0 * y, 7));
                rise(0.45, 0.7, lines) * (0.45 + 0.55 * rise(0.3, 0.5, noise(13.0 * x, 13.0 * y, 8)))
            }
            Self::Splatter => {
                let large = dots(2.6 * x, 2.6 * y, 0.5, [0.18, 0.48], 9);
                large.max(dots(6.0 * x, 6.0 * y, 0.4, [0.12, 0.4], 10))
            }
            Self::Cloud => {
                rise(0.2, 0.85, fractal(2.6 * x, 2.6 * y, 4, 11)) * (1.0 - radius * radius).max(0.0)
            }
            Self::Cracks => rise(0.05, 0.16, cracks(4.0 * x, 4.0 * y, 12)),
            Self::Leaf => leaf(x, y),
            Self::Rake => {
                let strength = 0.5 + 0.5 * hash((6.0 * x).floor() as i32, 0, 13);
                strength * rise(0.35, 0.7, tooth(6.0 * x)) * (1.0 - rise(0.06, 0.16, y.abs()))
            }
        };
        shape * rim
    }
}

/// 0 up to one number, 1 from another on, smooth between.
fn rise(from: f32, to: f32, x: f32) -> f32 {
    let s = ((x - from) / (to - from)).clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}

/// A triangle wave of period 1: 0 at whole numbers, 1 between.
fn tooth(x: f32) -> f32 {
    1.0 - (2.0 * (x - x.floor()) - 1.0).abs()
}

/// A number 0..1 of a cell.
fn hash(x: i32, y: i32, seed: u32) -> f32 {
    let mut h = (x as u32).wrapping_mul(0x8da6_b343)
        ^ (y as u32).wrapping_mul(0xd816_3841)
        ^ seed.wrapping_mul(0xcb1a_b31f);
    // Two rounds of a multiplicative mix (C. Wellons, "lowbias32").
    h ^= h >> 16;
    h = h.wrapping_mul(0x21f0_aaad);
    h ^= h >> 15;
    h = h.wrapping_mul(0x735a_2d97);
    h ^= h >> 15;
    (h >> 8) as f32 / (1u32 << 24) as f32
}

/// Smooth noise 0..1 with a number for each corner of a grid of side 1.
fn noise(x: f32, y: f32, seed: u32) -> f32 {
    let (column, row) = (x.floor(), y.floor());
    let (sx, sy) = (rise(0.0, 1.0, x - column), rise(0.0, 1.0, y - row));
    let at = |dx: i32, dy: i32| hash(column as i32 + dx, row as i32 + dy, seed);
    let below = at(0, 0) + (at(1, 0) - at(0, 0)) * sx;
    let above = at(0, 1) + (at(1, 1) - at(0, 1)) * sx;
    below + (above - below) * sy
}

/// The sum of octaves of noise, 0..1: each is twice as fine and half as strong.
fn fractal(x: f32, y: f32, octaves: u32, seed: u32) -> f32 {
    let (mut sum, mut total) = (0.0, 0.0);
    for octave in 0..octaves {
        let (scale, weight) = ((1u32 << octave) as f32, 1.0 / (1u32 << octave) as f32);
        sum += weight * noise(scale * x, scale * y, seed.wrapping_add(31 * octave));
        total += weight;
    }
    sum / total
}

/// The points of the cells around a place, one for each cell.
fn points_around(x: f32, y: f32, seed: u32) -> impl Iterator<Item = ([i32; 2], f32)> {
    let (column, row) = (x.floor() as i32, y.floor() as i32);
    (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| [column + dx, row + dy])).map(move |cell| {
        let [cx, cy] = cell;
        let at = [hash(cx, cy, seed), hash(cx, cy, seed.wrapping_add(101))];
        let (dx, dy) = (cx as f32 + at[0] - x, cy as f32 + at[1] - y);
        (cell, (dx * dx + dy * dy).sqrt())
    })
}

/// Discs of radii within a range, in a share of the cells of a grid of side 1.
fn dots(x: f32, y: f32, share: f32, [low, high]: [f32; 2], seed: u32) -> f32 {
    let disc = |([cx, cy], distance): ([i32; 2], f32)| {
        if hash(cx, cy, seed.wrapping_add(202)) > share {
            return 0.0;
        }
        let radius = low + (high - low) * hash(cx, cy, seed.wrapping_add(303));
        let strength = 0.55 + 0.45 * hash(cx, cy, seed.wrapping_add(404));
        strength * (1.0 - rise(0.6 * radius, radius, distance))
    };
    points_around(x, y, seed).map(disc).fold(0.0, f32::max)
}

/// How much farther the second nearest point of the cells is than the nearest one.
fn cracks(x: f32, y: f32, seed: u32) -> f32 {
    let (mut first, mut second) = (f32::INFINITY, f32::INFINITY);
    for (_, distance) in points_around(x, y, seed) {
        second = second.min(distance.max(first));
        first = first.min(distance);
    }
    second - first
}

/// Threads that lie over and under each other.
fn weave(x: f32, y: f32) -> f32 {
    let is_over = (x.floor() as i32 + y.floor() as i32).rem_euclid(2) == 0;
    let (over, along) = if is_over { (tooth(y), tooth(x)) } else { (tooth(x), tooth(y)) };
    rise(0.12, 0.55, over) * (0.35 + 0.65 * rise(0.0, 0.7, along))
}

/// A leaf along the x axis.
fn leaf(x: f32, y: f32) -> f32 {
    let along = (x + 0.85) / 1.7;
    if !(0.0..=1.0).contains(&along) {
        return 0.0;
    }
    // Widest before its middle, pointed at both ends.
    let width = 1.55 * along * (1.0 - along) * (1.25 - 0.5 * along);
    let inside = 1.0 - rise(width - 0.06, width, y.abs());
    let rib = 1.0 - rise(0.012, 0.04, y.abs());
    let veins = rise(0.78, 0.95, tooth(5.5 * (x - 0.8 * y.abs())));
    inside * (1.0 - 0.75 * rib) * (1.0 - 0.5 * veins)
}
