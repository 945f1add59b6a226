//! The sRGB transfer curve (IEC 61966-2-1) between encoded and linear-light values.
//!
//! Eight-bit values are decoded by a table of 256 floats and encoded by a table over the exponent and the leading mantissa
//! bits of the float, which leaves one comparison: both are exact, i.e. equal to rounding the formula.

use std::sync::LazyLock;

/// Linear-light value of an sRGB-encoded one, both in `[0,1]`. Outside, the curve is continued (mirrored below 0).
pub fn linear_from_srgb(encoded: f32) -> f32 {
    let magnitude = encoded.abs();
    let linear =
        if magnitude <= 0.04045 { magnitude / 12.92 } else { ((magnitude + 0.055) / 1.055).powf(2.4) };
    linear.copysign(encoded)
}

/// sRGB-encoded value of a linear-light one, both in `[0,1]`. Outside, the curve is continued (mirrored below 0).
pub fn srgb_from_linear(linear: f32) -> f32 {
    let magnitude = linear.abs();
    let encoded =
        if magnitude <= 0.003_130_8 { magnitude * 12.92 } else { 1.055 * magnitude.powf(1.0 / 2.4) - 0.055 };
    encoded.copysign(linear)
}

/// The same curve in double precision, from which the tables are made.
fn linear_from_srgb_f64(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Linear light of all 256 sRGB-encoded bytes.
pub fn linear_from_srgb8_table() -> &'static [f32; 256] {
    static TABLE: LazyLock<[f32; 256]> =
        LazyLock::new(|| std::array::from_fn(|code| linear_from_srgb_f64(code as f64 / 255.0) as f32));
    &TABLE
}

/// Linear light of all 65 536 sRGB-encoded 16-bit values.
pub fn linear_from_srgb16_table() -> &'static [f32] {
    static TABLE: LazyLock<Vec<f32>> =
        LazyLock::new(|| (0..65536).map(|code| linear_from_srgb_f64(code as f64 / 65535.0) as f32).collect());
    &TABLE
}

/// `code / 255` of all 256 bytes.
#[inline]
pub fn unit_from_u8_table() -> &'static [f32; 256] {
    static TABLE: [f32; 256] = {
        let mut table = [0.0; 256];
        let mut code = 0;
        while code < 256 {
            table[code] = code as f32 / 255.0;
            code += 1;
        }
        table
    };
    &TABLE
}

/// The encoder's tables: a float's exponent and seven mantissa bits give the code at the start of its bucket; at most one
/// rounding threshold lies inside a bucket (a code spans at least 1/106 of its value, a bucket at most 1/128).
struct Srgb8Encoder {
    code_of_bucket: [u8; ENCODER_BUCKETS],
    /// `threshold[c]` is the smallest linear value that rounds to code `c`.
    threshold: [f32; 257],
}

const ENCODER_MANTISSA_BITS: u32 = 7;
const ENCODER_SHIFT: u32 = 23 - ENCODER_MANTISSA_BITS;
/// 2^-13 is below the smallest threshold, 0.5 / 255 / 12.92 = 1.52e-4 = 2^-12.68.
const ENCODER_SMALLEST: f32 = 1.0 / 8192.0;
/// Of the smallest value, and the last one, in which 1 is.
const ENCODER_FIRST_BUCKET: u32 = ENCODER_SMALLEST.to_bits() >> ENCODER_SHIFT;
const ENCODER_BUCKETS: usize = ((1.0_f32.to_bits() >> ENCODER_SHIFT) - ENCODER_FIRST_BUCKET + 1) as usize;

impl Srgb8Encoder {
    fn new() -> Self {
        let mut threshold = [f32::INFINITY; 257];
        for (code, value) in threshold[..256].iter_mut().enumerate() {
            *value = linear_from_srgb_f64((code as f64 - 0.5).max(0.0) / 255.0) as f32;
        }
        let code_of_bucket = std::array::from_fn(|bucket| {
            let start = f32::from_bits((ENCODER_FIRST_BUCKET + bucket as u32) << ENCODER_SHIFT);
            (threshold[..256].partition_point(|&t| t <= start) - 1) as u8
        });
        Self { code_of_bucket, threshold }
    }

    #[inline]
    fn code(&self, linear: f32) -> u8 {
        // What is no number, too, becomes the smallest value, whose code is 0.
        let linear = if linear > ENCODER_SMALLEST { linear.min(1.0) } else { ENCODER_SMALLEST };
        let code = self.code_of_bucket[((linear.to_bits() >> ENCODER_SHIFT) - ENCODER_FIRST_BUCKET) as usize];
        code + u8::from(linear >= self.threshold[usize::from(code) + 1])
    }
}

static ENCODER: LazyLock<Srgb8Encoder> = LazyLock::new(Srgb8Encoder::new);

/// The sRGB byte nearest to a linear-light value; values outside `[0,1]` are clamped, NaN gives 0.
#[inline]
pub fn srgb8_from_linear(linear: f32) -> u8 {
    ENCODER.code(linear)
}

/// [`srgb8_from_linear`] for many values.
#[inline]
pub fn srgb8_encoder() -> impl Fn(f32) -> u8 + Copy {
    let encoder: &'static Srgb8Encoder = &ENCODER;
    move |linear| encoder.code(linear)
}

/// The 16-bit sRGB value nearest to a linear-light value, clamped to `[0,1]`; NaN gives 0.
pub fn srgb16_from_linear(linear: f32) -> u16 {
    unorm16(srgb_from_linear(linear))
}

/// The byte nearest to `255 * value`, clamped; NaN gives 0.
#[inline]
pub fn unorm8(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// The 16-bit number nearest to `65535 * value`, clamped; NaN gives 0.
pub fn unorm16(value: f32) -> u16 {
    (value.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16
}
