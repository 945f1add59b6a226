//! Levels that hold an environment as rough surfaces reflect it.
//!
//! Every texel is a sum over the whole sphere. What lies far from the lobe's middle, where the lobe changes slowly, counts
//! in lumps: the texels of the map are the leaves of a tree, and a node stands for all below it as soon as it is small beside
//! the lobe and its distance (J. Barnes and P. Hut, "A hierarchical O(N log N) force-calculation algorithm", 1986). A lump of
//! light lies where its light does, so a sun stays at its place however large the node that it is in.

use std::f32::consts::PI;

use arrayvec::ArrayVec;
use glam::{Vec2, Vec3, Vec3A};
use rayon::prelude::*;

use super::level::Level;
use super::{ChartPoint, CubeFace, EnvironmentForm, EnvironmentMap};

/// Least width of a leaf, radians: a sixth of the narrowest lobe's.
const MIN_RADIANS: f32 = 0.005;

/// Most of a node's width beside the lobe's and the distance from its middle.
const MAX_WIDTH: f32 = 0.4;

/// Most of a node's width, radians: the cosine changes over the hemisphere, however wide the lobe is.
const MAX_RADIANS: f32 = 0.25;

/// Least side of cubes that are made of other maps.
const MIN_CUBE_SIDE: u32 = 16;

/// A node's light.
#[derive(Clone, Copy, Default)]
struct Lump {
    /// Unit direction of the solid angle's middle.
    middle: Vec3,
    /// Unit direction of the light's middle.
    light: Vec3,
    steradians: f32,
    /// Radiance times solid angle, linear RGB.
    power: Vec3,
}

impl Lump {
    fn of_all(lumps: &[Self]) -> Self {
        let mut sum = Self::default();
        for lump in lumps {
            sum.middle += lump.middle * lump.steradians;
            sum.light += lump.light * lump.power.element_sum();
            sum.steradians += lump.steradians;
            sum.power += lump.power;
        }
        sum.middle = sum.middle.normalize_or_zero();
        sum.light = sum.light.normalize_or(sum.middle);
        sum
    }
}

/// The nodes that lie equally far from the leaves, chart by chart and row by row.
struct Generation {
    charts: usize,
    /// Columns and rows of a chart.
    size: [usize; 2],
    /// The widest node, radians.
    width: f32,
    lumps: Vec<Lump>,
}

impl Generation {
    fn leaves(level: &Level) -> Self {
        let (charts, size) = (level.form.charts(), level.size.map(|n| n as usize));
        let lump = |chart, x, y| {
            let middle = level.form.direction(ChartPoint { chart, uv: level.texel_uv(x, y) });
            let steradians = level.form.texel_steradians(level.size, x, y);
            let power = Vec3::from(level.texel(chart, x, y)) * steradians;
            Lump { middle, light: middle, steradians, power }
        };
        let [columns, rows] = size;
        let row = |row| (0..columns as i32).map(move |x| lump(row / rows, x, (row % rows) as i32));
        let lumps = (0..charts * rows).into_par_iter().flat_map_iter(row).collect();
        Self { charts, size, width: width(level), lumps }
    }

    /// Nodes with up to four of these as children each.
    fn parents(&self) -> Self {
        let [columns, rows] = self.size.map(|n| n.div_ceil(2));
        let lump = |node| {
            let mut lumps = ArrayVec::<_, 4>::new();
            self.for_children(node, [columns, rows], |child| lumps.push(self.lumps[child]));
            Lump::of_all(&lumps)
        };
        let lumps = (0..self.charts * columns * rows).into_par_iter().map(lump).collect();
        Self { charts: self.charts, size: [columns, rows], width: 2.0 * self.width, lumps }
    }

    /// Those below a node of the generation above, whose charts have `columns` and `rows`.
    #[inline]
    fn for_children(&self, node: usize, [columns, rows]: [usize; 2], mut visit: impl FnMut(usize)) {
        let (chart, y, x) = (node / (columns * rows), node / columns % rows, node % columns);
        for y in 2 * y..(2 * y + 2).min(self.size[1]) {
            for x in 2 * x..(2 * x + 2).min(self.size[0]) {
                visit((chart * self.size[1] + y) * self.size[0] + x);
            }
        }
    }

    /// For which blocks of a radius these nodes are visited, and stand for all below them.
    fn bounds(&self, radius: f32, alpha: f32) -> Bounds {
        // Directions turn by twice the angle of the facets.
        let distance = self.width / MAX_WIDTH - 2.0 * alpha;
        let whole = if self.width > MAX_RADIANS {
            f32::NEG_INFINITY
        } else if distance > 0.0 {
            let least = distance + radius;
            1.0 - 0.5 * least * least
        } else {
            f32::INFINITY
        };
        // Half a diagonal is less than three quarters of the width.
        Bounds { horizon: -(radius + 0.75 * self.width), whole }
    }
}

/// Of a generation, cosines between a node's middle and a block's.
#[derive(Clone, Copy)]
struct Bounds {
    /// Nodes below this are below the horizons of all normals.
    horizon: f32,
    /// Nodes up to this stand for all below them.
    whole: f32,
}

/// Enough to halve the largest map down to one texel.
const MAX_GENERATIONS: usize = 32;

/// The widest texel of a cube's or sphere's level, radians.
fn width(level: &Level) -> f32 {
    match level.form {
        EnvironmentForm::Sphere => PI / level.size[1] as f32,
        _ => 2.0 / level.size[0] as f32,
    }
}

/// The light of an environment as a tree.
pub(super) struct LightTree {
    /// Leaves first.
    generations: Vec<Generation>,
}

impl LightTree {
    pub(super) fn new(map: &EnvironmentMap) -> Self {
        // Texels of discs are of many shapes, and those of tiny maps too few: a normal might see none.
        let is_made_cube = map.form().is_disc() || width(map.level(0)) > MAX_RADIANS;
        let cube =
            is_made_cube.then(|| map.converted(EnvironmentForm::Cube, map.side_as_cube().max(MIN_CUBE_SIDE)));
        let map = cube.as_ref().unwrap_or(map);
        let last = map.level_count() - 1;
        let finest = (0..=last).find(|&level| width(map.level(level)) >= MIN_RADIANS).unwrap_or(last);
        let mut generations = vec![Generation::leaves(map.level(finest))];
        while let Some(below) = generations.last().filter(|below| below.size != [1, 1]) {
            generations.push(below.parents());
        }
        Self { generations }
    }

    /// What GGX surfaces of slope `alpha` reflect that are seen along their normal; a cube of at least `side` texels along a
    /// face.
    pub(super) fn reflected(&self, side: u32, alpha: f32) -> Level {
        let side = side.next_multiple_of(Block::COLUMNS.max(Block::ROWS) as u32);
        let columns = side as usize;
        let mut texels = vec![Vec3A::ZERO; CubeFace::ALL.len() * columns * columns];
        texels.par_chunks_exact_mut(Block::ROWS * columns).enumerate().for_each(|(band, rows)| {
            let first_row = band * Block::ROWS;
            for column in (0..columns).step_by(Block::COLUMNS) {
                let block = Block::new(columns, first_row, column);
                for (lane, color) in self.gather(&block, alpha).into_iter().enumerate() {
                    rows[lane / Block::COLUMNS * columns + column + lane % Block::COLUMNS] = color;
                }
            }
        });
        Level::new(EnvironmentForm::Cube, [side; 2], &texels)
    }

    /// The light that each normal of a block gathers.
    fn gather(&self, block: &Block, alpha: f32) -> [Vec3A; LANES] {
        let bounds: ArrayVec<Bounds, MAX_GENERATIONS> =
            self.generations.iter().map(|nodes| nodes.bounds(block.radius, alpha)).collect();
        let mut sums = Sums::default();
        let top = self.generations.len() - 1;
        for root in 0..self.generations[top].lumps.len() {
            self.add(top, root, block, (&bounds, alpha * alpha), &mut sums);
        }
        let [red, green, blue] = sums.light;
        std::array::from_fn(|lane| Vec3A::new(red[lane], green[lane], blue[lane]) / sums.weight[lane])
    }

    /// Adds a node, or those below it where it is too large.
    fn add(
        &self,
        generation: usize,
        node: usize,
        block: &Block,
        (bounds, alpha2): (&[Bounds], f32),
        sums: &mut Sums,
    ) {
        let nodes = &self.generations[generation];
        let lump = &nodes.lumps[node];
        let cosine = lump.middle.dot(block.middle);
        if cosine < bounds[generation].horizon {
            return;
        }
        if generation == 0 || cosine <= bounds[generation].whole {
            sums.add(lump, &block.normals, alpha2);
            return;
        }
        self.generations[generation - 1].for_children(node, nodes.size, |child| {
            self.add(generation - 1, child, block, (bounds, alpha2), sums);
        });
    }
}

/// Texels that are worked out side by side.
const LANES: usize = 16;

/// Neighbours of one face, which see the same nodes.
struct Block {
    normals: [[f32; LANES]; 3],
    middle: Vec3,
    /// Longest distance of a normal from the middle.
    radius: f32,
}

impl Block {
    const COLUMNS: usize = 4;
    const ROWS: usize = LANES / Self::COLUMNS;

    /// From a row of all faces one below the other, and a column.
    fn new(side: usize, first_row: usize, first_column: usize) -> Self {
        let (chart, first_row) = (first_row / side, first_row % side);
        let normals: [Vec3; LANES] = std::array::from_fn(|lane| {
            let (x, y) = (first_column + lane % Self::COLUMNS, first_row + lane / Self::COLUMNS);
            let uv = (Vec2::new(x as f32, y as f32) + 0.5) / side as f32;
            EnvironmentForm::Cube.direction(ChartPoint { chart, uv })
        });
        let middle = normals.iter().sum::<Vec3>().normalize();
        let radius = normals.iter().map(|normal| normal.distance(middle)).fold(0.0, f32::max);
        Self { normals: [0, 1, 2].map(|axis| normals.map(|normal| normal[axis])), middle, radius }
    }
}

#[derive(Default)]
struct Sums {
    light: [[f32; LANES]; 3],
    weight: [f32; LANES],
}

impl Sums {
    /// Adds a node's light, and what light of radiance 1 from all of it would be.
    fn add(&mut self, lump: &Lump, normals: &[[f32; LANES]; 3], alpha2: f32) {
        let light = weights(lump.light, normals, alpha2);
        // As in all leaves.
        let is_in_middle = lump.light == lump.middle;
        let weight = if is_in_middle { light } else { weights(lump.middle, normals, alpha2) };
        for lane in 0..LANES {
            (0..3).for_each(|channel| self.light[channel][lane] += light[lane] * lump.power[channel]);
            self.weight[lane] += weight[lane] * lump.steradians;
        }
    }
}

/// The facets' density times the cosine, without its constant factor, for light from a direction.
#[inline]
fn weights(light: Vec3, [x, y, z]: &[[f32; LANES]; 3], alpha2: f32) -> [f32; LANES] {
    let mut weights = [0.0; LANES];
    for lane in 0..LANES {
        let cosine = light.x * x[lane] + light.y * y[lane] + light.z * z[lane];
        // The half vector's squared sine.
        let sine2 = 0.5 - 0.5 * cosine;
        let d = sine2 + alpha2 * (1.0 - sine2);
        weights[lane] = cosine.max(0.0) / (d * d);
    }
    weights
}
