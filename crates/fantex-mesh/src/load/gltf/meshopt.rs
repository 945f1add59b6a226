//! Buffer views compressed by meshoptimizer (Khronos Group, "EXT_meshopt_compression", 2022, and its successor
//! "KHR_meshopt_compression", whose attributes may be of version 1 and colours of luma and chroma).
//!
//! Written here rather than taken from a crate: the common one builds the C++ library, and the port to Rust, a mesh library of forty
//! times this size, pins another crate to one version. Every byte is checked where it is read.

use fantex_base::{Error, Result, counted};

use super::schema::Meshopt;

/// The bytes of a compressed view: `count` elements of `stride` bytes each, whose product was compared with a limit.
///
/// # Errors
/// The data are damaged, or the mode, the filter or the stride is unknown.
pub(super) fn decode(view: &Meshopt, source: &[u8]) -> Result<Vec<u8>> {
    let (count, stride) = (view.count, view.byte_stride);
    let filter = view.filter.as_deref().unwrap_or("NONE");
    let fits = match (view.mode.as_str(), filter) {
        ("ATTRIBUTES", "NONE" | "EXPONENTIAL") => stride.is_multiple_of(4) && (4..=256).contains(&stride),
        ("ATTRIBUTES", "OCTAHEDRAL" | "COLOR") => stride == 4 || stride == 8,
        ("ATTRIBUTES", "QUATERNION") => stride == 8,
        ("TRIANGLES", "NONE") => (stride == 2 || stride == 4) && count.is_multiple_of(3),
        ("INDICES", "NONE") => stride == 2 || stride == 4,
        (mode, _) => {
            let sentence = format!("its compression of mode {mode:?} with filter {filter:?} is unknown");
            return Err(Error::unsupported(sentence));
        }
    };
    if !fits {
        let (mode, elements, stride) = (&view.mode, counted(count, "element"), counted(stride, "byte"));
        return Err(Error::malformed(format!(
            "it has {elements} of {stride}, which does not suit mode {mode:?} with filter {filter:?}"
        )));
    }
    let mut source = Source(source);
    let decoded = match view.mode.as_str() {
        "ATTRIBUTES" => attributes(&mut source, count, stride).map(|mut bytes| {
            match filter {
                "EXPONENTIAL" => {
                    for word in bytes.as_chunks_mut().0 {
                        *word = exponential(u32::from_le_bytes(*word)).to_le_bytes();
                    }
                }
                "NONE" => {}
                _ => {
                    // Four signed numbers of one byte or two.
                    let (width, shift) = (stride / 4, 32 - 2 * stride);
                    for element in bytes.chunks_exact_mut(stride) {
                        let number = |k: usize| {
                            let mut wide = [0; 4];
                            wide[4 - width..].copy_from_slice(&element[k * width..][..width]);
                            i32::from_le_bytes(wide) >> shift
                        };
                        let numbers = unfiltered(filter, std::array::from_fn(number), 2 * stride as u32);
                        for (number, bytes) in numbers.into_iter().zip(element.chunks_exact_mut(width)) {
                            bytes.copy_from_slice(&number.to_le_bytes()[..width]);
                        }
                    }
                }
            }
            bytes
        }),
        "TRIANGLES" => triangles(&mut source, count).map(|indices| narrowed(&indices, stride)),
        _ => sequence(&mut source, count).map(|indices| narrowed(&indices, stride)),
    };
    decoded.ok_or_else(|| Error::malformed("its compressed data are damaged"))
}

fn narrowed(indices: &[u32], stride: usize) -> Vec<u8> {
    indices.iter().flat_map(|index| index.to_le_bytes().into_iter().take(stride)).collect()
}

/// What is not read yet.
struct Source<'a>(&'a [u8]);

impl<'a> Source<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        self.0.split_off(..count)
    }

    fn take_last(&mut self, count: usize) -> Option<&'a [u8]> {
        let start = self.0.len().checked_sub(count)?;
        self.0.split_off(start..)
    }

    fn byte(&mut self) -> Option<u8> {
        self.0.split_off_first().copied()
    }

    /// The version behind a mode's mark.
    fn version(&mut self, mark: u8) -> Option<u8> {
        let header = self.byte()?;
        (header & 0xf0 == mark && header & 15 <= 1).then_some(header & 15)
    }

    /// A number in groups of seven bits, the lowest first, in five bytes at most.
    fn variable(&mut self) -> Option<u32> {
        let mut value = 0;
        for shift in (0..35).step_by(7) {
            let byte = self.byte()?;
            value |= u32::from(byte & 127) << shift;
            if byte < 128 {
                break;
            }
        }
        Some(value)
    }
}

/// From 0, 1, 2, 3, ... to 0, -1, 1, -2, ...
fn signed(value: u32) -> u32 {
    (value >> 1) ^ (value & 1).wrapping_neg()
}

// Attributes: blocks of elements; in a block one stream for each byte of an element, of differences between successive elements.

const MAX_BLOCK: usize = 256;
const GROUP: usize = 16;

fn attributes(source: &mut Source, count: usize, stride: usize) -> Option<Vec<u8>> {
    let version = source.version(0xa0)?;
    let channel_count = if version == 0 { 0 } else { stride / 4 };
    let tail_bytes = stride + channel_count;
    let tail = source.take_last(tail_bytes.max(if version == 0 { 32 } else { 24 }))?;
    let (first, channels) = tail[tail.len() - tail_bytes..].split_at(stride);
    // An empty stream has no element to begin with, so what a count demands is allocated only as blocks appear.
    let block = ((8192 / stride) & !(GROUP - 1)).min(MAX_BLOCK);
    let mut last = first.to_vec();
    let mut out = Vec::new();
    while out.len() < count * stride {
        let start = out.len();
        let in_block = block.min(count - start / stride);
        let controls = source.take(channel_count)?;
        out.resize(start + in_block * stride, 0);
        for k in (0..stride).step_by(4) {
            let control = controls.get(k / 4).copied();
            let channel = channels.get(k / 4).copied().unwrap_or(0);
            let mut streams = [[0; MAX_BLOCK]; 4];
            for (j, stream) in streams.iter_mut().enumerate() {
                let widths = match control.map(|control| control >> (2 * j) & 3) {
                    None => [0, 2, 4, 8],
                    Some(0) => [0, 1, 2, 4],
                    Some(1) => [1, 2, 4, 8],
                    Some(2) => continue,
                    Some(_) => {
                        stream[..in_block].copy_from_slice(source.take(in_block)?);
                        continue;
                    }
                };
                read_stream(source, stream, in_block.div_ceil(GROUP), widths)?;
            }
            let mut last_word = u32::from_le_bytes(*last[k..].first_chunk()?);
            for (i, element) in out[start..].chunks_exact_mut(stride).enumerate() {
                last_word = next_word(last_word, streams.map(|stream| stream[i]), channel)?;
                element[k..k + 4].copy_from_slice(&last_word.to_le_bytes());
            }
            last[k..k + 4].copy_from_slice(&last_word.to_le_bytes());
        }
    }
    source.0.is_empty().then_some(out)
}

/// Groups of 16 bytes, each with one of four widths in bits; a value of all ones stands for a byte behind the group's bits.
fn read_stream(source: &mut Source, stream: &mut [u8], groups: usize, widths: [usize; 4]) -> Option<()> {
    let header = source.take(groups.div_ceil(4))?;
    for (i, group) in stream.chunks_exact_mut(GROUP).take(groups).enumerate() {
        let width = widths[usize::from(header[i / 4] >> (2 * (i % 4)) & 3)];
        let packed = source.take(GROUP * width / 8)?;
        match width {
            0 => group.fill(0),
            8 => group.copy_from_slice(packed),
            _ => {
                let (per_byte, ones) = (8 / width, (1 << width) - 1);
                for (k, value) in group.iter_mut().enumerate() {
                    // Single bits begin with the lowest, others with the highest.
                    let place = if width == 1 { k % 8 } else { 8 - width * (k % per_byte + 1) };
                    *value = packed[k / per_byte] >> place & ones;
                    if *value == ones {
                        *value = source.byte()?;
                    }
                }
            }
        }
    }
    Some(())
}

/// The four bytes of the next element after those of the last: differences of bytes or of 16-bit words, or exclusive ors of
/// rotated words, as the lowest bits of `channel` say.
fn next_word(last: u32, bytes: [u8; 4], channel: u8) -> Option<u32> {
    let zigzag = |v: u8| (v >> 1) ^ (v & 1).wrapping_neg();
    Some(match channel & 3 {
        0 => {
            let last = last.to_le_bytes();
            u32::from_le_bytes(std::array::from_fn(|j| last[j].wrapping_add(zigzag(bytes[j]))))
        }
        1 => {
            let half = |j: usize| {
                let v = u16::from_le_bytes([bytes[j], bytes[j + 1]]);
                let difference = (v >> 1) ^ (v & 1).wrapping_neg();
                u32::from(((last >> (8 * j)) as u16).wrapping_add(difference))
            };
            half(0) | half(2) << 16
        }
        2 => last ^ u32::from_le_bytes(bytes).rotate_right(u32::from(channel >> 4)),
        _ => return None,
    })
}

// Indices: triangles as edges and vertices that were met lately, or any sequence as differences.

/// The last sixteen of something, counted backwards from 1.
struct Recent<T>([T; 16], usize);

impl<T: Copy> Recent<T> {
    fn push(&mut self, value: T) {
        self.0[self.1 & 15] = value;
        self.1 += 1;
    }

    fn get(&self, back: u8) -> T {
        self.0[self.1.wrapping_sub(usize::from(back)) & 15]
    }
}

fn triangles(source: &mut Source, count: usize) -> Option<Vec<u32>> {
    let version = source.version(0xe0)?;
    let codes = source.take(count / 3)?;
    let common = source.take_last(16)?;
    let mut indices = Vec::with_capacity(count);
    let mut edges = Recent([[u32::MAX; 2]; 16], 0);
    let mut vertices = Recent([u32::MAX; 16], 0);
    let (mut next, mut last) = (0u32, 0u32);
    let fresh = |next: &mut u32| std::mem::replace(next, next.wrapping_add(1));
    for &code in codes {
        let [a, b, c];
        if code < 0xf0 {
            [a, b] = edges.get((code >> 4) + 1);
            let is_known = match (code & 15, version) {
                (0, _) => {
                    c = fresh(&mut next);
                    false
                }
                (back, version) if back < if version == 0 { 15 } else { 13 } => {
                    c = vertices.get(back + 1);
                    true
                }
                (near, _) => {
                    last = match near {
                        13 => last.wrapping_sub(1),
                        14 => last.wrapping_add(1),
                        _ => last.wrapping_add(signed(source.variable()?)),
                    };
                    c = last;
                    false
                }
            };
            if !is_known {
                vertices.push(c);
            }
        } else {
            let is_explicit = code >= 0xfe;
            let pair = if is_explicit { source.byte()? } else { common[usize::from(code & 15)] };
            if is_explicit && pair == 0 {
                next = 0;
            }
            let places = [if code == 0xff { 15 } else { 0 }, pair >> 4, pair & 15];
            let mut corners = [0; 3];
            // New vertices are numbered before others are written out.
            for (corner, place) in corners.iter_mut().zip(places) {
                *corner = if place == 0 { fresh(&mut next) } else { vertices.get(place) };
            }
            for (corner, place) in corners.iter_mut().zip(places) {
                if is_explicit && place == 15 {
                    last = last.wrapping_add(signed(source.variable()?));
                    *corner = last;
                }
            }
            for (corner, place) in corners.into_iter().zip(places) {
                if place == 0 || is_explicit && place == 15 {
                    vertices.push(corner);
                }
            }
            [a, b, c] = corners;
            edges.push([b, a]);
        }
        edges.push([c, b]);
        edges.push([a, c]);
        indices.extend([a, b, c]);
    }
    source.0.is_empty().then_some(indices)
}

fn sequence(source: &mut Source, count: usize) -> Option<Vec<u32>> {
    source.version(0xd0)?;
    source.take_last(4)?;
    // Each index takes a byte at least.
    if source.0.len() < count {
        return None;
    }
    let mut last = [0u32; 2];
    let mut indices = Vec::with_capacity(count);
    for _ in 0..count {
        let value = source.variable()?;
        let base = &mut last[(value & 1) as usize];
        *base = base.wrapping_add(signed(value >> 1));
        indices.push(*base);
    }
    source.0.is_empty().then_some(indices)
}

// Filters: what attributes are made of once they are decompressed.

/// Four numbers of 8 or 16 bits. Where a vector has no length, the results are zero.
fn unfiltered(filter: &str, [a, b, c, d]: [i32; 4], bits: u32) -> [i32; 4] {
    let round = |v: f32| (v + 0.5f32.copysign(v)) as i32;
    match filter {
        // Two coordinates and the length of 1; the fourth number is left alone.
        "OCTAHEDRAL" => {
            let (x, y) = (a as f32, b as f32);
            let z = c as f32 - x.abs() - y.abs();
            let fold = z.min(0.0);
            let [x, y] = [x, y].map(|v| v + if v >= 0.0 { fold } else { -fold });
            let scale = ((1 << (bits - 1)) - 1) as f32 / (x * x + y * y + z * z).sqrt();
            [round(x * scale), round(y * scale), round(z * scale), d]
        }
        // The three smaller components; the last number has the place of the fourth and the scale.
        "QUATERNION" => {
            let scale = std::f32::consts::FRAC_1_SQRT_2 / (d | 3) as f32;
            let [x, y, z] = [a, b, c].map(|v| v as f32 * scale);
            let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
            let mut turned = [w, x, y, z].map(|v| round(v * 32767.0));
            turned.rotate_right((d & 3) as usize);
            turned
        }
        // Luma, chroma of orange and green, and alpha, whose highest bit tells the scale.
        _ => {
            let max = (1u32 << bits) - 1;
            let (y, alpha) = (a & max as i32, d as u32 & max);
            let one = alpha.checked_ilog2().map_or(0, |bit| (2u32 << bit) - 1);
            let alpha = (alpha << 1 & one | alpha & 1) as i32;
            let scale = max as f32 / one as f32;
            [y + b - c, y + c, y - b - c, alpha].map(|v| round(v as f32 * scale))
        }
    }
}

/// A float as a mantissa of 24 bits and an exponent of eight.
fn exponential(word: u32) -> f32 {
    let (mantissa, exponent) = ((word << 8) as i32 >> 8, word as i32 >> 24);
    libm::ldexp(mantissa.into(), exponent) as f32
}

#[cfg(test)]
mod tests {
    use base64::Engine as _;
    use base64::engine::general_purpose::STANDARD;

    use super::*;

    /// Mode, filter and stride; encoded by meshoptimizer 1.3, and what its own decoder makes of it.
    #[rustfmt::skip]
    const VECTORS: [(&str, &str, usize, &str, &str); 12] = [
        ("ATTRIBUTES", "OCTAHEDRAL", 4, "oWUAAgC+AAIA8gACAEUAAAAAAAAAAAAAAAAAAAAAAAAA8UF/HgA=", "6WVJHl6z2vs="),
        ("ATTRIBUTES", "OCTAHEDRAL", 8, "oZVaAAIAGgACAAUAAgCWAAIAJwACAK8AAAAAAAAAAAAAAAAAAM0Bc/7/AadUAAA=", "lSek7oaHp1QHsVSlINST/A=="),
        ("ATTRIBUTES", "QUATERNION", 8, "oVWVAAIAjAACAK8AAgAaAAIAaQACAOgAAgDLAAIABgAAAAAAAAAAAAAAAAAA3tCrFqB1/H8AAA==", "/Fms3gcQLFP0VJfqqQq0XA=="),
        ("ATTRIBUTES", "EXPONENTIAL", 4, "oVUAAgDQAAIAmAACAEMAAgBKAAAAAAAAAAAAAAAAAAAAAAAAABVGjssA", "1nNjsPok2UI="),
        ("ATTRIBUTES", "COLOR", 4, "oVYAAgCFAAIAfwACADkAAAAAAAAAAAAAAAAAAAAAAAAAVS//4gA=", "hVQnxIIUqos="),
        ("ATTRIBUTES", "COLOR", 8, "oVVVAAIAQwACAAIAAgCaAAIACAACAHIAAgADAAIAbAACAAMAAAAAAAAAAAAAAAAAAHYHtfv2APwLAAA=", "UiPIhrqsh395kjZoOrJCJg=="),
        ("ATTRIBUTES", "NONE", 8, "oT8/AIPFEwC1k4/YbuQ6iX4lHx0AVxBeG2mTjn9eOA8eb0NgfwBGAKRcUlIyKigoKCggFBQUAQYAeQEA2bXcRh70Rcrwn50yTj3YBABuTt3eSFCj4FRG8VROpuZtAKSuhFJQSCgmJiYmJBwSEBABAgABAAAAAAAAAAAAAAAAAAAAAAAAPtSjPAEB", "AAAAAD7Uozw+1KM80Zx1PdvLIz12dcw90Zx1PWTkDj5RqqM9h1M3PnZ1zD2Wd18+rCv1PRCggz5k5A4+bU6XPlAkIz7Svqo+h1M3PkrpvT75b0s++sXQPpZ3Xz4rTeM+UWhzPkR39T4QoIM+a54DP31+jT5MSww/bU6XPri+FD/eDqE+OvUcPw=="),
        ("ATTRIBUTES", "NONE", 16, "oe////8A7AC9AMsALQDnAAoAYwBgABIAUgDWAFcA+QCTAPYAAAAAfMwvh57+Js7OnOuikuNYyHIAAAA=", "fMwvh57+Js7OnOuikuNYyAfNuV6Hiiuc/qUUDWZmDkM="),
        ("INDICES", "NONE", 2, "0QgCAAIQBgAAAAA=", "AgABAAEAAAAEAAIA"),
        ("INDICES", "NONE", 4, "0QQMAgoIAgAAAAA=", "AQAAAAQAAAADAAAAAAAAAAIAAAABAAAA"),
        ("TRIANGLES", "NONE", 2, "4f4eEA4QDhAOEA4PGAB2h1ZneKmGZYlomAFpAAA=", "AAABAAwADAABAA0ADQABAAIADQACAA4ADgACAAMADgADAA8ADwADAAQADwAEABAAEAAEAAUAEAAFABEA"),
        ("TRIANGLES", "NONE", 2, "4fD/EP7+/v7//v4TAiFBMTH/KAICBWEAdodWZ3iphmWJaJgBaQAA", "AAABAAIAAQACAAAAAAACAAMABAABAAMABQACAAQABgADAAUABwAEAAYAFQAWABcACAAJAAYACgAHAAkA"),
    ];

    #[test]
    fn data_are_decoded_as_by_meshoptimizer_itself() {
        for (mode, filter, byte_stride, encoded, expected) in VECTORS {
            let [encoded, expected] = [encoded, expected].map(|text| STANDARD.decode(text).unwrap());
            let found = decoded(mode, filter, byte_stride, expected.len() / byte_stride, &encoded).unwrap();
            assert_eq!(found.len(), expected.len());
            // Filters of 16 bits may round differently.
            let rounding = u16::from(byte_stride == 8 && filter != "NONE");
            for (a, b) in found.as_chunks().0.iter().zip(expected.as_chunks().0) {
                let [a, b] = [*a, *b].map(u16::from_le_bytes);
                assert!((a.wrapping_sub(b) as i16).unsigned_abs() <= rounding, "{mode} {filter} {a} {b}");
            }
        }
    }

    fn decoded(
        mode: &str,
        filter: &str,
        byte_stride: usize,
        count: usize,
        encoded: &[u8],
    ) -> Result<Vec<u8>> {
        let (mode, filter) = (mode.to_owned(), Some(filter.to_owned()));
        let view = Meshopt {
            buffer: 0,
            byte_offset: 0,
            byte_length: encoded.len(),
            byte_stride,
            count,
            mode,
            filter,
        };
        decode(&view, encoded)
    }

    /// Whatever the bytes, the count and the stride: an answer, of the right length.
    #[test]
    fn damaged_data_are_refused_or_decoded() {
        let mut random = 1u64;
        let mut next = |below: usize| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 33) as usize % below
        };
        for (mode, filter, stride, encoded, expected) in VECTORS {
            let [sound, expected] = [encoded, expected].map(|text| STANDARD.decode(text).unwrap());
            for _ in 0..3000 {
                let mut bytes = sound.clone();
                for _ in 0..=next(4) {
                    let at = next(bytes.len());
                    bytes[at] = next(256) as u8;
                }
                bytes.truncate(bytes.len().saturating_sub(next(80).saturating_sub(40)));
                let count = [expected.len() / stride, next(40), next(100_000)][next(3)];
                let stride = [stride, 4 * next(66)][next(2)];
                if let Ok(bytes) = decoded(mode, filter, stride, count, &bytes) {
                    assert_eq!(bytes.len(), count * stride);
                }
            }
        }
    }
}
