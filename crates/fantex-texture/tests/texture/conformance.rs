//! The reference renders of OpenImageIO's test suite.
//!
//! Their rules for levels and probes differ from those of `Filter::Anisotropic` and `Filter::Trilinear`: levels are blended in
//! proportion to the filter's width rather than to its logarithm, probes have Gaussian weights over twice the difference of
//! the axes (the wider, the longer the ellipse), widths are those along s and t, cubics are B-splines, and the levels of the
//! files are sharper than means. The renders are reproduced with these rules from this crate's look-ups in the single
//! levels, which shows that nothing else differs; what the crate's own filters make of the same set-up is measured beside it.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::Arc;

use fantex_texture::{
    ColorSpace, Filter, Image, ImageTexture, SampleOptions, Samples, Wrap, filter::FootprintAxes,
};
use glam::{Mat3, Vec2, Vec3};

use crate::common::data_folder;

/// Numbers as they are stored, without any decoding.
fn load(folder: &Path, name: &str) -> Image {
    Image::load_as(folder.join(name), ColorSpace::Linear).unwrap_or_else(|error| panic!("{error}"))
}

fn rgb(texel: [f32; 4]) -> Vec3 {
    Vec3::new(texel[0], texel[1], texel[2])
}

/// The levels of a texture file, each looked up by itself.
struct Levels(Vec<ImageTexture>);

impl Levels {
    fn open(path: &Path) -> Self {
        Self(Self::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())))
    }

    fn read(path: &Path) -> Result<Vec<ImageTexture>, tiff::TiffError> {
        let mut decoder = tiff::decoder::Decoder::new(BufReader::new(File::open(path)?))?;
        let mut levels = Vec::new();
        loop {
            let (width, height) = decoder.dimensions()?;
            let tiff::decoder::DecodingResult::U8(samples) = decoder.read_image()? else {
                panic!("bytes are expected")
            };
            let channels = (samples.len() / (width * height) as usize) as u8;
            let samples = Samples::U8(samples);
            let image = Image { width, height, channels, space: ColorSpace::Linear, samples };
            levels.push(ImageTexture::new(Arc::new(image)));
            if !decoder.more_images() {
                return Ok(levels);
            }
            decoder.next_image()?;
        }
    }

    /// Texels along a row of level 0.
    fn side(&self) -> f32 {
        self.0[0].size()[0] as f32
    }

    /// A look-up in the two levels for a filter of this width (in texels of level 0).
    fn blended(&self, width: f32, look_up: impl Fn(usize) -> Vec3) -> Vec3 {
        let last = self.0.len() - 1;
        let coarse = (width.max(1e-9).log2().ceil().max(0.0) as usize).min(last);
        if coarse == 0 {
            return look_up(0);
        }
        let share = (2.0 * width / (coarse as f32).exp2() - 1.0).clamp(0.0, 1.0);
        look_up(coarse - 1).lerp(look_up(coarse), share)
    }

    /// Probes with Gaussian weights; the footprint is measured along s and t, whatever the texture's proportions.
    fn probed(&self, steps: [Vec2; 2], look_up: impl Fn(usize, Vec2) -> Vec3) -> Vec3 {
        let FootprintAxes { direction, major, minor } = FootprintAxes::new(steps[0], steps[1]);
        let probes = ((2.0 * (major / minor).clamp(1.0, 32.0) - 1.0) as u32).max(1);
        let half = major - minor;
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for probe in 0..probes {
            let place = 2.0 * (probe as f32 + 0.5) / probes as f32 - 1.0;
            let along = place * half;
            let weight = if probes == 1 { 1.0 } else { (-2.0 * (0.5 * place * major / half).powi(2)).exp() };
            sum += weight * self.blended(minor * self.side(), |level| look_up(level, direction * along));
            total += weight;
        }
        sum / total
    }

    fn look_up(&self, level: usize, uv: Vec2, filter: Filter, wrap: Wrap) -> Vec3 {
        let options = SampleOptions { wrap: [wrap; 2], filter, ..SampleOptions::default() };
        rgb(self.0[level].sample(uv, [Vec2::ZERO; 2], &options))
    }

    /// The cubic B-spline of the texels, from look-ups at their centres.
    fn b_spline(&self, level: usize, uv: Vec2, wrap: Wrap) -> Vec3 {
        let size = Vec2::from(self.0[level].size().map(|n| n as f32));
        let position = uv * size - 0.5;
        let (base, share) = (position.floor(), position - position.floor());
        let weights = |t: f32| {
            let s = 1.0 - t;
            let inner = |t: f32| (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0;
            [s * s * s / 6.0, inner(t), inner(s), t * t * t / 6.0]
        };
        let (across, down) = (weights(share.x), weights(share.y));
        let mut sum = Vec3::ZERO;
        for (row, down) in down.into_iter().enumerate() {
            for (column, across) in across.into_iter().enumerate() {
                let texel = base + Vec2::new(column as f32, row as f32) - 1.0;
                let center = (texel + 0.5) / size;
                sum += self.look_up(level, center, Filter::Nearest, wrap) * (across * down);
            }
        }
        sum
    }
}

/// The suite's oblique view of the plane, with forward differences of one pixel.
fn warped(x: u32, y: u32) -> (Vec2, [Vec2; 2]) {
    let (sin, cos) = 25_f32.to_radians().sin_cos();
    // Row vectors there, column vectors here: transposed.
    let perspective = Mat3::from_cols_array(&[2.0, 0.0, 0.0, 0.0, 0.8, -0.55, 0.0, 0.0, 1.0]);
    let rotation = Mat3::from_cols_array(&[cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0]);
    let translation = Mat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.75, 0.25, 1.0]);
    let scale = Mat3::from_diagonal(Vec3::new(0.3, 0.3, 1.0));
    let uv_from_pixel = (scale * translation * rotation * perspective).inverse();
    let at = |x: f32, y: f32| {
        let p = uv_from_pixel * Vec3::new((x + 0.5) / 512.0, (y + 0.5) / 512.0, 1.0);
        p.truncate() / p.z
    };
    let (x, y) = (x as f32, y as f32);
    let uv = at(x, y);
    (uv, [at(x + 1.0, y) - uv, at(x, y + 1.0) - uv])
}

/// Share of the pixels that are off by more than `hard` in a channel, and the root mean square of all differences.
fn difference(reference: &Image, hard: f32, mut pixel: impl FnMut(u32, u32) -> Vec3) -> (f64, f64) {
    let (mut over, mut squares) = (0_u32, 0.0_f64);
    for y in 0..reference.height {
        for x in 0..reference.width {
            let error = (pixel(x, y) - rgb(reference.linear_texel(x, y))).abs();
            over += u32::from(error.max_element() > hard);
            squares += f64::from(error.length_squared()) / 3.0;
        }
    }
    let count = f64::from(reference.width * reference.height);
    (f64::from(over) / count, (squares / count).sqrt())
}

#[test]
fn oblique_views_are_reproduced() {
    let Some(folder) = data_folder("conformance/oiio") else { return };
    let levels = Levels::open(&folder.join("grid.tx"));
    // The suite allows 2 % of nearest look-ups, where a rounding chooses another texel, and nothing else.
    for (name, filter, hard, most) in [
        ("texture-interp-closest.tif", Filter::Nearest, 0.032, 0.02),
        ("texture-interp-bilinear.tif", Filter::Bilinear, 0.02, 0.0001),
    ] {
        let (over, rms) = difference(&load(&folder, name), hard, |x, y| {
            let (uv, steps) = warped(x, y);
            levels.probed(steps, |level, along| levels.look_up(level, uv + along, filter, Wrap::Repeat))
        });
        eprintln!("{name}: {:.2} % of the pixels off by more than {hard}, rms {rms:.4}", 100.0 * over);
        assert!(over < most && rms < 0.005, "{name}: {over}, {rms}");
    }
    let name = "texture-mip-trilinear.tif";
    let (over, rms) = difference(&load(&folder, name), 0.02, |x, y| {
        let (uv, steps) = warped(x, y);
        // The larger of the changes of s and of t, not the longer axis.
        let width = steps[0].abs().max(steps[1].abs()).max_element() * levels.side();
        levels.blended(width, |level| levels.look_up(level, uv, Filter::Bilinear, Wrap::Repeat))
    });
    eprintln!("{name}: {:.2} % of the pixels off by more than 0.02, rms {rms:.4}", 100.0 * over);
    assert!(over < 0.001 && rms < 0.002, "{name}: {over}, {rms}");
}

/// With this crate's own levels and rules, the same views differ by a few percent of the contrast.
#[test]
fn own_filters_stay_near_the_references() {
    let Some(folder) = data_folder("conformance/oiio") else { return };
    let texture = ImageTexture::new(Arc::new(load(&folder, "grid.tx")));
    for (name, filter, most) in [
        ("texture-interp-bilinear.tif", Filter::Anisotropic, 0.025),
        ("texture-mip-trilinear.tif", Filter::Trilinear, 0.042),
    ] {
        let options = SampleOptions { filter, max_anisotropy: 32.0, ..SampleOptions::default() };
        let (over, rms) = difference(&load(&folder, name), 0.02, |x, y| {
            let (uv, steps) = warped(x, y);
            rgb(texture.sample(uv, steps, &options))
        });
        eprintln!("{name} by {filter:?}: {:.1} % off by more than 0.02, rms {rms:.4}", 100.0 * over);
        assert!(rms < most, "{name}: rms {rms}");
    }
}

#[test]
fn blur_without_width_is_reproduced() {
    let Some(folder) = data_folder("conformance/oiio") else { return };
    let levels = Levels::open(&folder.join("grid.tx"));
    let (over, rms) = difference(&load(&folder, "texture-width0blur.tif"), 0.02, |x, y| {
        let uv = (Vec2::new(x as f32, y as f32) + 0.5) / 256.0;
        // A tenth of the image in all directions, and nothing of the pixel's own size: magnified, so cubic.
        levels.blended(0.1 * levels.side(), |level| levels.b_spline(level, uv, Wrap::Clamp))
    });
    eprintln!("texture-width0blur.tif: {:.2} % off by more than 0.02, rms {rms:.4}", 100.0 * over);
    assert!(over < 0.001 && rms < 0.005, "{over}, {rms}");
}

/// Four times as tall as wide in texels, and four times as often across: the reference measures its footprint in s and t,
/// this crate in texels, so the shapes of the filters differ. Level 0 is magnified by cubics there.
#[test]
fn skinny_textures_are_reproduced() {
    let Some(folder) = data_folder("conformance/oiio") else { return };
    let levels = Levels::open(&folder.join("vertgrid.tx"));
    let reference = load(&folder, "texture-skinny.exr");
    let scaled = |x: u32, y: u32| {
        let (uv, steps) = warped(x, y);
        let scale = Vec2::new(4.0, 1.0);
        (uv * scale, steps.map(|step| step * scale))
    };
    let (over, rms) = difference(&reference, 0.013, |x, y| {
        let (uv, steps) = scaled(x, y);
        levels.probed(steps, |level, along| match level {
            0 => levels.b_spline(level, uv + along, Wrap::Repeat),
            _ => levels.look_up(level, uv + along, Filter::Bilinear, Wrap::Repeat),
        })
    });
    eprintln!("texture-skinny.exr: {:.2} % off by more than 0.013, rms {rms:.4}", 100.0 * over);
    let options =
        SampleOptions { filter: Filter::Anisotropic, max_anisotropy: 32.0, ..SampleOptions::default() };
    let (own_over, own_rms) = difference(&reference, 0.013, |x, y| {
        let (uv, steps) = scaled(x, y);
        rgb(levels.0[0].sample(uv, steps, &options))
    });
    eprintln!("  by Anisotropic: {:.2} %, rms {own_rms:.4}", 100.0 * own_over);
    // What is left lies at the horizon, beyond 32 probes' worth of anisotropy.
    assert!(over < 0.0005 && rms < 0.001, "{over}, {rms}");
    assert!(own_rms < 0.12, "{own_rms}");
}

/// At texel centres, a cubic of Catmull and Rom gives the texels, a B-spline their mean with weights 1, 4, 1 along each
/// axis. With that done by hand, both references follow from `Filter::Bicubic`.
#[test]
fn cubics_differ_by_the_spline_alone() {
    let Some(folder) = data_folder("conformance/oiio") else { return };
    let options =
        |wrap| SampleOptions { wrap: [wrap; 2], filter: Filter::Bicubic, ..SampleOptions::default() };
    let smoothed = |texture: &ImageTexture, uv: Vec2, wrap: Wrap| {
        let texel = 1.0 / texture.size()[0] as f32;
        let mut sum = Vec3::ZERO;
        for (dy, down) in [(-1.0, 1.0), (0.0, 4.0), (1.0, 1.0)] {
            for (dx, across) in [(-1.0, 1.0), (0.0, 4.0), (1.0, 1.0)] {
                let beside = texture.sample(uv + Vec2::new(dx, dy) * texel, [Vec2::ZERO; 2], &options(wrap));
                sum += rgb(beside) * (down * across / 36.0);
            }
        }
        sum
    };
    // The files hold half floats: an error of 2^-12 below 1.
    let ramp = ImageTexture::new(Arc::new(load(&folder, "ramp.exr")));
    let (over, rms) = difference(&load(&folder, "texture-derivs.exr"), 3e-4, |x, y| {
        smoothed(&ramp, (Vec2::new(x as f32, y as f32) + 0.5) / 128.0, Wrap::Clamp)
    });
    eprintln!("texture-derivs.exr: {:.2} % off by more than 3e-4, rms {rms:.6}", 100.0 * over);
    assert_eq!(over, 0.0, "rms {rms}");
    // Black, red, green and white in the corners.
    let corners: Vec<[f32; 4]> = (0..64 * 64)
        .map(|i| {
            let [s, t] = [i % 64, i / 64].map(|k| k as f32 / 63.0);
            [s, t, s * t, 1.0]
        })
        .collect();
    let corners = ImageTexture::new(Arc::new(Image::from_linear_rgb(64, 64, &corners)));
    let (over, rms) = difference(&load(&folder, "texture-flipt.exr"), 5e-4, |x, y| {
        let uv = (Vec2::new(x as f32, y as f32) + 0.5) / 64.0;
        smoothed(&corners, Vec2::new(uv.x, 1.0 - uv.y), Wrap::Repeat)
    });
    eprintln!("texture-flipt.exr: {:.2} % off by more than 5e-4, rms {rms:.6}", 100.0 * over);
    assert_eq!(over, 0.0, "rms {rms}");
}
