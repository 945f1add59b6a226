//! Little-endian reading and writing of sections, every read checked.

use std::borrow::Cow;
use std::fmt;
use std::io::Read;

use bytemuck::{Pod, Zeroable};
use fantex_base::{Error, Result, are, counted};

use crate::error::{ends, not_finite, out_of_range, too_many, wrong_count};

pub(crate) struct ByteReader<'a> {
    rest: Rest<'a>,
    /// Bytes in all, and those that are read.
    length: usize,
    at: usize,
}

/// What is not read yet.
enum Rest<'a> {
    Slice(&'a [u8]),
    /// Bytes that are unpacked as they are read.
    Stream(Box<dyn Read + 'a>),
}

/// Bytes of an array that are read at once.
const PIECE_BYTES: usize = 16 << 10;

impl<'a> ByteReader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: Rest::Slice(bytes), length: bytes.len(), at: 0 }
    }

    /// Of a stream that should have `length` bytes.
    pub(crate) fn of_stream(stream: Box<dyn Read + 'a>, length: usize) -> Self {
        Self { rest: Rest::Stream(stream), length, at: 0 }
    }

    /// That so many bytes should be left.
    fn check_left(&self, count: usize, what: &'static str) -> Result<()> {
        if count > self.remaining() { Err(ends(what, self.length)) } else { Ok(()) }
    }

    /// The next `count` bytes; `what` names them in the error.
    pub(crate) fn take(&mut self, count: usize, what: &'static str) -> Result<Cow<'a, [u8]>> {
        self.check_left(count, what)?;
        if let Rest::Slice(rest) = &mut self.rest {
            let (taken, left) = rest.split_at(count);
            *rest = left;
            self.at += count;
            return Ok(Cow::Borrowed(taken));
        }
        let mut taken = vec![0; count];
        self.fill(&mut taken, what)?;
        Ok(Cow::Owned(taken))
    }

    fn array<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N]> {
        let mut array = [0; N];
        self.fill(&mut array, what)?;
        Ok(array)
    }

    /// The next bytes, as many as there is room for.
    fn fill(&mut self, room: &mut [u8], what: &'static str) -> Result<()> {
        self.check_left(room.len(), what)?;
        match &mut self.rest {
            Rest::Slice(rest) => {
                let (taken, left) = rest.split_at(room.len());
                room.copy_from_slice(taken);
                *rest = left;
            }
            Rest::Stream(stream) => stream.read_exact(room).map_err(|_| not_unpacked(self.length))?,
        }
        self.at += room.len();
        Ok(())
    }

    pub(crate) fn u8(&mut self, what: &'static str) -> Result<u8> {
        Ok(self.array::<1>(what)?[0])
    }

    pub(crate) fn u32(&mut self, what: &'static str) -> Result<u32> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn u64(&mut self, what: &'static str) -> Result<u64> {
        Ok(u64::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn f64(&mut self, what: &'static str) -> Result<f64> {
        let value = f64::from_le_bytes(self.array(what)?);
        if value.is_finite() { Ok(value) } else { Err(not_finite(what, 0)) }
    }

    pub(crate) fn f32(&mut self, what: &'static str) -> Result<f32> {
        let value = f32::from_le_bytes(self.array(what)?);
        if value.is_finite() { Ok(value) } else { Err(not_finite(what, 0)) }
    }

    /// `N` finite floats.
    pub(crate) fn f32s<const N: usize>(&mut self, what: &'static str) -> Result<[f32; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f32(what)?;
        }
        Ok(values)
    }

    /// A 32-bit count of at most `limit`.
    pub(crate) fn count(&mut self, limit: usize, what: &'static str) -> Result<usize> {
        let count = self.u32(what)?;
        if count as usize > limit {
            return Err(too_many(what, u64::from(count), limit as u64));
        }
        Ok(count as usize)
    }

    /// An array of `count` items of `LANES` 32-bit words each, as [`ByteWriter::words`] writes it. Checks that the bytes
    /// are there before it allocates.
    pub(crate) fn words<const LANES: usize>(
        &mut self,
        count: usize,
        what: &'static str,
    ) -> Result<Vec<[u32; LANES]>> {
        let too_many = || ends(what, self.length);
        let words = count.checked_mul(LANES).ok_or_else(too_many)?;
        self.check_left(words.checked_mul(4).ok_or_else(too_many)?, what)?;
        let mut items = vec![[0u32; LANES]; count];
        let mut piece = [0; PIECE_BYTES];
        for shift in [0, 8, 16, 24] {
            for codes in items.as_flattened_mut().chunks_mut(PIECE_BYTES) {
                let bytes = &mut piece[..codes.len()];
                self.fill(bytes, what)?;
                codes.iter_mut().zip(bytes).for_each(|(code, &mut byte)| *code |= u32::from(byte) << shift);
            }
        }
        let mut previous = [0u32; LANES];
        for item in &mut items {
            for (code, previous) in item.iter_mut().zip(&mut previous) {
                *previous = previous.wrapping_add(unzigzag(*code));
                *code = *previous;
            }
        }
        Ok(items)
    }

    /// An array of `count` items of `LANES` finite floats each.
    pub(crate) fn floats<const LANES: usize>(
        &mut self,
        count: usize,
        what: &'static str,
    ) -> Result<Vec<[f32; LANES]>> {
        let words = self.words::<LANES>(count, what)?;
        let items: Vec<[f32; LANES]> = words.into_iter().map(|item| item.map(f32::from_bits)).collect();
        check_finite(&items, what)?;
        Ok(items)
    }

    /// Bytes that are not read yet.
    pub(crate) fn remaining(&self) -> usize {
        self.length - self.at
    }

    pub(crate) fn end(mut self) -> Result<()> {
        match (self.remaining(), &mut self.rest) {
            (0, Rest::Slice(_)) => Ok(()),
            // What checks the stream's contents comes with its end.
            (0, Rest::Stream(stream)) => match stream.read(&mut [0]) {
                Ok(0) => Ok(()),
                _ => Err(not_unpacked(self.length)),
            },
            (count, _) => {
                let (bytes, are) = (counted(count, "byte"), are(count));
                Err(Error::malformed(format!("{bytes} {are} left over at the end")))
            }
        }
    }
}

/// What is packed is damaged or has another length.
fn not_unpacked(length: usize) -> Error {
    Error::damaged(format!("the data do not unpack to {}", counted(length, "byte")))
}

impl fmt::Debug for ByteReader<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ByteReader")
            .field("length", &self.length)
            .field("at", &self.at)
            .finish_non_exhaustive()
    }
}

pub(crate) fn check_finite<const LANES: usize>(items: &[[f32; LANES]], what: &'static str) -> Result<()> {
    match items.iter().position(|item| item.iter().any(|x| !x.is_finite())) {
        Some(index) => Err(not_finite(what, index)),
        None => Ok(()),
    }
}

pub(crate) fn limit(what: &'static str, count: usize, limit: usize) -> Result<()> {
    if count > limit {
        return Err(too_many(what, count as u64, limit as u64));
    }
    Ok(())
}

/// Refuses any number but none and `count`.
pub(crate) fn exactly(what: &'static str, got: usize, count: usize) -> Result<()> {
    if got != 0 && got != count {
        return Err(wrong_count(what, count as u64, got as u64));
    }
    Ok(())
}

/// Refuses an index or code beyond its range.
pub(crate) fn below(what: &'static str, index: usize, value: u32, limit: usize) -> Result<()> {
    if value as usize >= limit {
        return Err(out_of_range(what, index, u64::from(value), limit as u64));
    }
    Ok(())
}

#[derive(Default)]
pub(crate) struct ByteWriter {
    pub(crate) bytes: Vec<u8>,
}

impl ByteWriter {
    pub(crate) fn put(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    pub(crate) fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    pub(crate) fn u32(&mut self, value: u32) {
        self.put(&value.to_le_bytes());
    }

    pub(crate) fn u64(&mut self, value: u64) {
        self.put(&value.to_le_bytes());
    }

    pub(crate) fn f64(&mut self, value: f64) {
        self.put(&value.to_le_bytes());
    }

    pub(crate) fn f32s(&mut self, values: &[f32]) {
        values.iter().for_each(|v| self.put(&v.to_le_bytes()));
    }

    /// An array of words in a form that packs well: of every lane the difference from the item before (wrapping, zigzag),
    /// first the lowest bytes of all words, then the next ones, and so on.
    pub(crate) fn words<const LANES: usize>(&mut self, items: impl ExactSizeIterator<Item = [u32; LANES]>) {
        let words = items.len() * LANES;
        let start = self.bytes.len();
        self.bytes.resize(start + 4 * words, 0);
        let planes = &mut self.bytes[start..];
        let mut previous = [0u32; LANES];
        for (i, item) in items.enumerate() {
            for lane in 0..LANES {
                let difference = zigzag(item[lane].wrapping_sub(previous[lane])).to_le_bytes();
                for (plane, byte) in difference.into_iter().enumerate() {
                    planes[plane * words + i * LANES + lane] = byte;
                }
            }
            previous = item;
        }
    }

    /// An array of items of `LANES` floats each, stored by their bits like [`words`](Self::words).
    pub(crate) fn floats<const LANES: usize>(&mut self, items: impl ExactSizeIterator<Item = [f32; LANES]>) {
        self.words(items.map(|item| item.map(f32::to_bits)));
    }
}

/// 0, -1, 1, -2, ... becomes 0, 1, 2, 3, ...
pub(crate) fn zigzag(difference: u32) -> u32 {
    (difference << 1) ^ (((difference as i32) >> 31) as u32)
}

/// Inverse of [`zigzag`].
pub(crate) fn unzigzag(code: u32) -> u32 {
    (code >> 1) ^ (code & 1).wrapping_neg()
}

/// A copy of bytes as values of a plain type, whatever their alignment; left-over bytes are dropped.
pub(crate) fn values_from_bytes<T: Pod + Zeroable>(bytes: &[u8]) -> Vec<T> {
    let mut values = vec![T::zeroed(); bytes.len() / size_of::<T>()];
    let used = values.len() * size_of::<T>();
    bytemuck::cast_slice_mut(&mut values).copy_from_slice(&bytes[..used]);
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_survive_the_round_trip() {
        let items = [[0u32, u32::MAX], [7, 3], [u32::MAX, 0], [1 << 31, (1 << 31) - 1]];
        let mut writer = ByteWriter::default();
        writer.words(items.into_iter());
        assert_eq!(writer.bytes.len(), 32);
        let mut reader = ByteReader::new(&writer.bytes);
        assert_eq!(reader.words::<2>(4, "items").unwrap(), items);
        reader.end().unwrap();
    }

    #[test]
    fn streams_are_read_as_slices_are() {
        let items: Vec<[u32; 3]> = (0..20_000u32).map(|i| [i, i.wrapping_mul(0x9E37_79B9), !i]).collect();
        let mut writer = ByteWriter::default();
        writer.u32(7);
        writer.words(items.iter().copied());
        let bytes = &writer.bytes;
        let read = |mut reader: ByteReader<'_>| -> Result<Vec<[u32; 3]>> {
            assert_eq!(&*reader.take(4, "seven")?, &7u32.to_le_bytes());
            let items = reader.words::<3>(20_000, "items")?;
            reader.end().map(|()| items)
        };
        let stream = |end: usize, length| read(ByteReader::of_stream(Box::new(&bytes[..end]), length));
        let whole = bytes.len();
        assert_eq!(read(ByteReader::new(bytes)).unwrap(), items);
        assert_eq!(stream(whole, whole).unwrap(), items);
        // The stream is shorter and longer than said, or both are no such array.
        for (end, length) in [(whole - 1, whole), (whole, whole - 1), (whole, whole + 1), (4, 4)] {
            stream(end, length).unwrap_err();
        }
    }

    #[test]
    fn a_huge_count_is_refused_before_it_is_allocated() {
        let mut reader = ByteReader::new(&[0; 64]);
        let error = reader.words::<3>(usize::MAX / 2, "items").unwrap_err();
        assert_eq!(error.to_string(), "the data end after 64 bytes, within items");
    }

    #[test]
    fn zigzag_keeps_small_differences_small() {
        assert_eq!([0, 1u32.wrapping_neg(), 1, 2u32.wrapping_neg()].map(zigzag), [0, 1, 2, 3]);
        for x in [0, 1, 5, u32::MAX, 1 << 31] {
            assert_eq!(unzigzag(zigzag(x)), x);
        }
    }
}
