//! Pictures of a source, without an asset between: what it gives at the points of texels.

use std::borrow::Cow;

use fantex_bake::{
    Prefilter, Progress, Source, SourceChannel, TexelPoint, TrianglePlane, clear_what_is_no_number,
    mesh_under,
};
use fantex_mesh::Mesh;
use fantex_store::ChannelKind;
use glam::{Vec3, Vec4};

use crate::ChannelMap;
use crate::export::{Map, told};
use crate::layout::Page;
use crate::surface::{Frames, Surface, TriangleFrames, lambda_steps};
use crate::texels::{Region, Values};

/// A source on a mesh.
pub(crate) struct SourceSurface<'a> {
    mesh: Cow<'a, Mesh>,
    source: &'a dyn Source,
    channels: Vec<SourceChannel>,
    texels_per_unit: f32,
    /// About the mean of each channel.
    means: Vec<[f32; 4]>,
}

/// Points that a source is asked for at a time.
const POINTS: usize = 256;

/// Triangles whose middles the mean is taken of.
const SAMPLES: usize = 1024;

impl<'a> SourceSurface<'a> {
    pub(crate) fn new(mesh: &'a Mesh, source: &'a dyn Source, texels_per_unit: f32) -> Self {
        let mesh = mesh_under(mesh, source);
        let channels = source.channels();
        let means = means(&mesh, source, channels.len());
        Self { mesh, source, channels, texels_per_unit, means }
    }
}

/// Of the middles of some triangles.
fn means(mesh: &Mesh, source: &dyn Source, channels: usize) -> Vec<[f32; 4]> {
    // Normals of all vertices would take longer than all the rest.
    let plane = |triangle| TrianglePlane::new(mesh, &[], triangle, [Vec3::ZERO; 2]);
    let middle = |triangle| plane(triangle).point(Vec3::splat(1.0 / 3.0));
    let step = mesh.triangles.len().div_ceil(SAMPLES).max(1);
    let points: Vec<TexelPoint> = (0..mesh.triangles.len()).step_by(step).map(middle).collect();
    let mut values = vec![Vec4::ZERO; points.len() * channels];
    source.evaluate_all(&points, &mut values);
    clear_what_is_no_number(&mut values);
    let mean = |channel: usize| {
        let sum: Vec4 = values.iter().skip(channel).step_by(channels).sum();
        (sum / points.len().max(1) as f32).to_array()
    };
    (0..channels).map(mean).collect()
}

impl Surface for SourceSurface<'_> {
    fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    fn texels_per_unit(&self) -> f32 {
        self.texels_per_unit
    }

    fn channels(&self) -> Vec<ChannelKind> {
        self.channels.iter().map(|channel| channel.kind).collect()
    }

    fn map(&self, kind: ChannelMap) -> Option<Map> {
        let channel = self.channels.iter().position(|channel| channel.kind == kind.channel())?;
        Some(Map::new(kind, channel, &self.mesh.materials, self.means[channel]))
    }

    fn prefilter(&self) -> Prefilter {
        self.source.prefilter()
    }

    fn values(&self, page: &Page, region: &Region, maps: &[Map], frames: &Frames<'_>) -> Vec<Values> {
        let mut all: Vec<Values> = maps.iter().map(|_| vec![[0.0; 4]; region.point_count()]).collect();
        let mut block = Block::default();
        let has_normals = maps.iter().any(Map::has_normals);
        region.for_each_triangle(page, |placed, points| {
            let steps = lambda_steps(placed.corners);
            let plane = TrianglePlane::new(&self.mesh, frames.normals, placed.triangle as usize, steps);
            if has_normals {
                block.frames.push(frames.of_triangle(&self.mesh, placed, steps));
            }
            for &(number, lambda) in points {
                block.points.push(plane.point(lambda));
                block.numbers.push((number, block.frames.len().saturating_sub(1)));
                if block.points.len() == POINTS {
                    block.hand_on(self, maps, &mut all);
                }
            }
        });
        block.hand_on(self, maps, &mut all);
        all
    }

    fn largest(&self, map: &Map, _: &dyn Progress) -> Option<f32> {
        (!self.channels[map.channel].exceeds_one || map.kind != ChannelMap::Emission).then_some(1.0)
    }

    fn damage(&self) -> Option<(u64, String)> {
        told(&self.source.damage())
    }
}

/// Points that are evaluated together.
#[derive(Default)]
struct Block {
    points: Vec<TexelPoint>,
    /// Of each point its number in the region and the index of its frames.
    numbers: Vec<(usize, usize)>,
    /// Of the triangles, where normals are wanted; the last one's may be of points to come.
    frames: Vec<TriangleFrames>,
    values: Vec<Vec4>,
}

impl Block {
    /// Evaluates the source, puts what it gives where it belongs, and begins anew.
    fn hand_on(&mut self, surface: &SourceSurface<'_>, maps: &[Map], all: &mut [Values]) {
        // Sources seldom expect to be asked for nothing.
        if self.points.is_empty() {
            return;
        }
        let channels = &surface.channels;
        self.values.clear();
        self.values.resize(self.points.len() * channels.len(), Vec4::ZERO);
        surface.source.evaluate_all(&self.points, &mut self.values);
        clear_what_is_no_number(&mut self.values);
        let values = self.values.chunks_exact(channels.len());
        for ((point, &(number, frames)), values) in self.points.iter().zip(&self.numbers).zip(values) {
            for (map, all) in maps.iter().zip(&mut *all) {
                let value = values[map.channel];
                all[number] = if map.has_normals() {
                    self.frames[frames].texel(value.truncate(), point.at.lambda).to_array()
                } else if channels[map.channel].has_alpha {
                    (value / map.scale).to_array()
                } else {
                    (value.truncate() / map.scale).extend(1.0).to_array()
                };
            }
        }
        self.points.clear();
        self.numbers.clear();
        let last = self.frames.pop();
        self.frames.clear();
        self.frames.extend(last);
    }
}
