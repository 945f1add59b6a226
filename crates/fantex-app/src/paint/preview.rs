//! A stroke of the brush on a sheet, for the brush panel.

use super::BrushSettings;

/// Coverage 0..1 of a wave-like stroke on a sheet of `width` by `height` pixels, row by row. Pressure rises and falls. The brush is
/// shown at most so large that the wave can be seen.
pub fn preview_stroke(brush: &BrushSettings, width: usize, height: usize) -> Vec<f32> {
    let mut sheet = vec![0.0f32; width * height];
    let diameter = brush.size.clamp(2.0, 0.5 * height as f32);
    let margin = 0.5 * diameter + 6.0;
    let at = |t: f32| {
        let x = margin + t * (width as f32 - 2.0 * margin).max(1.0);
        let y =
            0.5 * height as f32 - (t * std::f32::consts::TAU).sin() * (0.5 * height as f32 - margin).max(0.0);
        [x, y]
    };
    let mut random = 0x2545_f491_4f6c_dd1du64 ^ 1;
    let mut draw = || {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        (random >> 40) as f32 / (1u64 << 24) as f32
    };
    let (mut t, mut due, mut last) = (0.0f32, 0.0f32, at(0.0));
    while t <= 1.0 {
        let here = at(t);
        due -= (here[0] - last[0]).hypot(here[1] - last[1]);
        last = here;
        if due <= 0.0 {
            let pressure = (t * std::f32::consts::PI).sin();
            let lowered = |response: f32| 1.0 - response.clamp(0.0, 1.0) * (1.0 - pressure);
            let [turn, out, smaller, fainter] = [draw(), draw(), draw(), draw()];
            let size = diameter * lowered(brush.pressure.size);
            let shift = brush.jitter.position * 0.5 * size * out;
            let (sin, cos) = (turn * std::f32::consts::TAU).sin_cos();
            let dab = Dab {
                center: [here[0] + shift * cos, here[1] + shift * sin],
                radius: 0.5 * size * (1.0 - brush.jitter.size.clamp(0.0, 1.0) * smaller),
                hardness: brush.hardness,
                flow: brush.flow
                    * lowered(brush.pressure.flow)
                    * (1.0 - brush.jitter.flow.clamp(0.0, 1.0) * fainter),
            };
            dab.add(&mut sheet, width, height);
            due += (brush.spacing * size).max(0.5);
        }
        t += 0.5 / width as f32;
    }
    sheet.iter_mut().for_each(|coverage| *coverage *= brush.opacity);
    sheet
}

struct Dab {
    center: [f32; 2],
    radius: f32,
    hardness: f32,
    flow: f32,
}

impl Dab {
    /// As on the surface: full within the hard part, then fading smoothly.
    fn add(&self, sheet: &mut [f32], width: usize, height: usize) {
        let end = self.radius.max(0.5) + 0.5;
        let start = (self.radius * self.hardness.clamp(0.0, 1.0)).min(end - 1.0).max(0.0);
        let range = |center: f32, most: usize| {
            ((center - end).max(0.0) as usize)..((center + end + 1.0).max(0.0) as usize).min(most)
        };
        for y in range(self.center[1], height) {
            for x in range(self.center[0], width) {
                let distance = (x as f32 + 0.5 - self.center[0]).hypot(y as f32 + 0.5 - self.center[1]);
                if distance < end {
                    let s = ((distance - start) / (end - start)).max(0.0);
                    let coverage = &mut sheet[y * width + x];
                    *coverage += self.flow * (1.0 - s * s * (3.0 - 2.0 * s)) * (1.0 - *coverage);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_preview_shows_opacity_and_size() {
        let sum = |brush: &BrushSettings| preview_stroke(brush, 200, 60).iter().sum::<f32>();
        let brush = BrushSettings { size: 12.0, hardness: 1.0, ..BrushSettings::default() };
        let whole = sum(&brush);
        assert!(whole > 500.0, "{whole}");
        let fainter = sum(&BrushSettings { opacity: 0.5, ..brush.clone() });
        assert!((fainter / whole - 0.5).abs() < 1e-3);
        assert!(sum(&BrushSettings { size: 24.0, ..brush.clone() }) > 1.5 * whole);
        assert!(preview_stroke(&brush, 200, 60).iter().all(|c| (0.0..=1.0).contains(c)));
    }
}
