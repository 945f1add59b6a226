//! BC1 blocks with transparent texels ("punch-through": index 3 is transparent black), which the encoder for opaque
//! blocks does not make.

/// Texels of one 4x4 block, row-major.
type Block = [[u8; 4]; 16];

/// Alpha below this is transparent.
const OPAQUE_FROM: u8 = 128;

/// Re-encodes the blocks of a strip that have transparent texels. `strip`: 4 rows of RGBA texels; `encoded`: 8 bytes per
/// block.
pub(super) fn replace_transparent(strip: &[u8], encoded: &mut [u8]) {
    let (texels, _) = strip.as_chunks::<4>();
    let width = texels.len() / 4;
    for (x, bytes) in encoded.chunks_exact_mut(8).enumerate() {
        let block: Block = std::array::from_fn(|i| texels[i / 4 * width + 4 * x + i % 4]);
        if block.iter().any(|texel| texel[3] < OPAQUE_FROM) {
            bytes.copy_from_slice(&encode(&block));
        }
    }
}

/// Three-colour mode: end points are the corners of the opaque texels' bounding box, on the diagonal along which they
/// spread, ordered so that the first is not the greater one.
fn encode(block: &Block) -> [u8; 8] {
    let opaque = || block.iter().filter(|texel| texel[3] >= OPAQUE_FROM);
    let mut ends = diagonal(opaque()).map(rgb565);
    ends.sort_unstable();
    let [a, b] = ends.map(rgb_from_565);
    let middle = [0, 1, 2].map(|k| (a[k] + b[k]) / 2);
    let mut indices = 0u32;
    for (i, texel) in block.iter().enumerate() {
        let index = if texel[3] < OPAQUE_FROM {
            3
        } else {
            let distances = [a, b, middle].map(|c| squared_distance(texel, c));
            (0..3).min_by_key(|&k| distances[k]).unwrap_or(0) as u32
        };
        indices |= index << (2 * i);
    }
    let mut bytes = [0; 8];
    bytes[..2].copy_from_slice(&ends[0].to_le_bytes());
    bytes[2..4].copy_from_slice(&ends[1].to_le_bytes());
    bytes[4..].copy_from_slice(&indices.to_le_bytes());
    bytes
}

/// The two ends of the texels' spread: green rises from the first to the second, red and blue as they go with green.
fn diagonal<'a>(texels: impl Iterator<Item = &'a [u8; 4]> + Clone) -> [[i32; 3]; 2] {
    let count = texels.clone().count().max(1) as i32;
    let rgb = |texel: &[u8; 4]| [0, 1, 2].map(|k| i32::from(texel[k]));
    let (mut low, mut high, mut sum) = ([255; 3], [0; 3], [0; 3]);
    for texel in texels.clone().map(rgb) {
        for k in 0..3 {
            low[k] = low[k].min(texel[k]);
            high[k] = high[k].max(texel[k]);
            sum[k] += texel[k];
        }
    }
    if low[0] > high[0] {
        return [[0; 3]; 2];
    }
    for k in [0, 2] {
        let covariance: i32 = texels
            .clone()
            .map(rgb)
            .map(|c| (count * c[k] - sum[k]) / count * (count * c[1] - sum[1]) / count)
            .sum();
        if covariance < 0 {
            std::mem::swap(&mut low[k], &mut high[k]);
        }
    }
    [low, high]
}

fn rgb565(rgb: [i32; 3]) -> u16 {
    let round = |x: i32, steps: i32| ((x * steps + 127) / 255) as u16;
    (round(rgb[0], 31) << 11) | (round(rgb[1], 63) << 5) | round(rgb[2], 31)
}

fn rgb_from_565(packed: u16) -> [i32; 3] {
    let packed = i32::from(packed);
    [(packed >> 11) * 255 / 31, ((packed >> 5) & 63) * 255 / 63, (packed & 31) * 255 / 31]
}

fn squared_distance(texel: &[u8; 4], color: [i32; 3]) -> i32 {
    (0..3).map(|k| (i32::from(texel[k]) - color[k]).pow(2)).sum()
}
