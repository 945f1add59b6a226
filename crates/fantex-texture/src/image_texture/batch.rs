//! Look-ups of many points at once: see `filter/batch`.

use std::ops::Range;

use glam::{Vec2, Vec4};

use super::{AlphaUse, Filter, ImageTexture, SampleOptions};
use crate::UvPoint;
use crate::filter::{BLOCK, Colors, LevelPair, Levels, LookUp, Probes, Steps, Workspace, resolve};

/// Fewer points than this are looked up one by one.
const FEW: usize = 4;

impl ImageTexture {
    /// [`ImageTexture::sample`] at many points, several times as fast: whole vectors of look-ups pass each step together, and
    /// none waits for the texels of another. Both differ by at most 1e-4 of the texels' range (but for anisotropic look-ups by 2e-5). The
    /// results are the same on every processor, and however points are distributed over calls of at least four points.
    ///
    /// Vectors are used for bilinear, trilinear and anisotropic look-ups in images of one, three or four 8-bit or 16-bit
    /// channels; others are made one by one.
    ///
    /// # Panics
    /// If `points` and `out` differ in length.
    pub fn sample_all(&self, points: &[UvPoint], options: &SampleOptions, out: &mut [[f32; 4]]) {
        assert_eq!(points.len(), out.len(), "one colour for every point");
        let has_kernel = matches!(options.filter, Filter::Bilinear | Filter::Trilinear | Filter::Anisotropic);
        let levels =
            if has_kernel && points.len() >= FEW { Levels::new(&self.base, &self.coarser) } else { None };
        let Some(levels) = levels else {
            for (point, out) in points.iter().zip(out) {
                *out = self.sample(point.uv, point.steps, options);
            }
            return;
        };
        let alpha = self.texels(options.wrap).alpha;
        let look_up = LookUp { levels: &levels, wrap: options.wrap, alpha };
        match options.filter {
            Filter::Anisotropic => self.anisotropic_all(points, options, &look_up, out),
            _ => self.isotropic_all(points, options, &look_up, out),
        }
    }

    /// One probe per point.
    fn isotropic_all(
        &self,
        points: &[UvPoint],
        options: &SampleOptions,
        look_up: &LookUp<'_>,
        out: &mut [[f32; 4]],
    ) {
        let (mut workspace, mut colors) = (Workspace::new(), Colors::black());
        let (mut probes, mut steps) = (Probes::new(), Steps::new());
        for (points, out) in points.chunks(BLOCK).zip(out.chunks_mut(BLOCK)) {
            probes.place(points.iter().map(|point| point.uv));
            if options.filter == Filter::Trilinear {
                steps.place(points.iter().map(|point| point.steps));
                probes.choose_levels(&steps, self.size_f32(), self.coarser.len());
            }
            let missed = look_up.sums(&probes, &mut workspace, &mut colors);
            if look_up.alpha == AlphaUse::Independent {
                out.copy_from_slice(&colors.0[..out.len()]);
            } else {
                for (out, sum) in out.iter_mut().zip(colors.0) {
                    *out = resolve(Vec4::from_array(sum), look_up.alpha);
                }
            }
            for index in bits(missed) {
                out[index] = self.sample(points[index].uv, points[index].steps, options);
            }
        }
    }

    /// As many probes per point as its footprint asks for; see [`ImageTexture::anisotropic`].
    fn anisotropic_all(
        &self,
        points: &[UvPoint],
        options: &SampleOptions,
        look_up: &LookUp<'_>,
        out: &mut [[f32; 4]],
    ) {
        let mut queue = Queue::new(look_up, self);
        let mut colors = Colors::black();
        for (points, out) in points.chunks(BLOCK).zip(out.chunks_mut(BLOCK)) {
            let mut sums = [Vec4::ZERO; BLOCK];
            let mut shares = [1.0; BLOCK];
            for (index, point) in points.iter().enumerate() {
                let row = self.probe_row(point, options);
                shares[index] = 1.0 / row.count as f32;
                let mut numbers = 0..row.count;
                while !numbers.is_empty() {
                    if queue.probes.len() == BLOCK {
                        queue.flush(&mut colors, &mut sums);
                    }
                    queue.push(index, &row, &mut numbers);
                }
            }
            queue.flush(&mut colors, &mut sums);
            for ((out, sum), share) in out.iter_mut().zip(sums).zip(shares) {
                *out = resolve(sum * share, look_up.alpha);
            }
        }
    }

    /// The probes of an anisotropic look-up.
    fn probe_row(&self, point: &UvPoint, options: &SampleOptions) -> ProbeRow {
        let axes = self.axes(point.steps);
        let width = axes.limited_minor(options.max_anisotropy).max(1.0);
        let probes = (axes.major / width).ceil();
        let LevelPair { fine, share, .. } = self.levels_for(width * width);
        if probes.is_nan() || probes <= 1.0 {
            return ProbeRow { first: point.uv, step: Vec2::ZERO, count: 1, fine: fine as u32, share };
        }
        let span = self.in_uv(axes.direction * axes.major);
        let step = span / probes;
        let first = point.uv + 0.5 * (step - span);
        ProbeRow { first, step, count: probes as u32, fine: fine as u32, share }
    }
}

/// Equal trilinear probes along a footprint's longer axis.
struct ProbeRow {
    first: Vec2,
    step: Vec2,
    count: u32,
    fine: u32,
    share: f32,
}

/// Probes of several look-ups, that together fill blocks.
struct Queue<'a> {
    look_up: &'a LookUp<'a>,
    texture: &'a ImageTexture,
    probes: Probes,
    /// The look-up of every probe.
    targets: [u8; BLOCK],
    workspace: Workspace,
}

impl<'a> Queue<'a> {
    fn new(look_up: &'a LookUp<'a>, texture: &'a ImageTexture) -> Self {
        Self { look_up, texture, probes: Probes::new(), targets: [0; BLOCK], workspace: Workspace::new() }
    }

    /// Takes as many probes from a row as there is room for.
    fn push(&mut self, target: usize, row: &ProbeRow, numbers: &mut Range<u32>) {
        let (used, room) = (self.probes.len(), (BLOCK - self.probes.len()) as u32);
        let end = numbers.end.min(numbers.start.saturating_add(room));
        self.probes.push_row([row.first, row.step], numbers.start..end, row.fine, row.share);
        self.targets[used..self.probes.len()].fill(target as u8);
        numbers.start = end;
    }

    /// Looks up all probes and adds each to the sum of its look-up.
    fn flush(&mut self, colors: &mut Colors, sums: &mut [Vec4; BLOCK]) {
        let missed = self.look_up.sums(&self.probes, &mut self.workspace, colors);
        for index in bits(missed) {
            let (at, fine, share) = self.probes.at(index);
            let value = self.texture.between_levels(at, fine as usize, share, self.look_up);
            colors.0[index] = value.to_array();
        }
        for (color, &target) in colors.0[..self.probes.len()].iter().zip(&self.targets) {
            sums[usize::from(target)] += Vec4::from_array(*color);
        }
        self.probes.clear();
    }
}

impl ImageTexture {
    /// A probe by the scalar path.
    fn between_levels(&self, at: Vec2, fine: usize, share: f32, look_up: &LookUp<'_>) -> Vec4 {
        let texels = self.texels(look_up.wrap);
        let coarse = (fine + 1).min(self.coarser.len());
        self.blended(at, texels, look_up.wrap, LevelPair { fine, coarse, share })
    }
}

/// Indices of the set bits, ascending.
fn bits(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let index = mask.trailing_zeros() as usize;
        let has_bit = mask != 0;
        mask &= mask.wrapping_sub(1);
        has_bit.then_some(index)
    })
}
