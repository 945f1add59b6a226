//! Streams of numbers: one interface over binary and ASCII data.

use super::header::Scalar;

/// Why no number came.
#[derive(Debug)]
pub(super) enum SourceError {
    End,
    /// The line and the word that is not a number.
    NotANumber(usize, String),
}

/// Numbers in the order in which the file stores them.
pub(super) trait NumberSource {
    /// The next number.
    fn next(&mut self, scalar: Scalar) -> Result<f64, SourceError>;

    /// Skips numbers of one type.
    fn skip(&mut self, scalar: Scalar, count: u64) -> Result<(), SourceError>;

    /// Bytes not yet read: an upper limit for what may still come.
    fn left(&self) -> u64;
}

/// Binary data; `BIG` for big-endian.
pub(super) struct Binary<'a, const BIG: bool> {
    pub(super) rest: &'a [u8],
}

impl<const BIG: bool> Binary<'_, BIG> {
    #[inline]
    fn take<const N: usize>(&mut self) -> Result<[u8; N], SourceError> {
        let (&bytes, rest) = self.rest.split_first_chunk::<N>().ok_or(SourceError::End)?;
        self.rest = rest;
        Ok(bytes)
    }
}

impl<const BIG: bool> NumberSource for Binary<'_, BIG> {
    #[inline]
    fn next(&mut self, scalar: Scalar) -> Result<f64, SourceError> {
        macro_rules! number {
            ($type:ty) => {{
                let bytes = self.take()?;
                f64::from(if BIG { <$type>::from_be_bytes(bytes) } else { <$type>::from_le_bytes(bytes) })
            }};
        }
        Ok(match scalar {
            Scalar::I8 => number!(i8),
            Scalar::U8 => number!(u8),
            Scalar::I16 => number!(i16),
            Scalar::U16 => number!(u16),
            Scalar::I32 => number!(i32),
            Scalar::U32 => number!(u32),
            Scalar::F32 => number!(f32),
            Scalar::F64 => number!(f64),
        })
    }

    fn skip(&mut self, scalar: Scalar, count: u64) -> Result<(), SourceError> {
        let bytes = count.checked_mul(scalar.size() as u64).and_then(|n| usize::try_from(n).ok());
        self.rest = bytes.and_then(|n| self.rest.get(n..)).ok_or(SourceError::End)?;
        Ok(())
    }

    fn left(&self) -> u64 {
        self.rest.len() as u64
    }
}

/// Numbers as words.
pub(super) struct Ascii<'a> {
    pub(super) rest: &'a [u8],
    pub(super) line: usize,
}

impl<'a> Ascii<'a> {
    fn word(&mut self) -> Result<&'a [u8], SourceError> {
        let start = self.rest.iter().position(|b| !b.is_ascii_whitespace()).ok_or(SourceError::End)?;
        self.line += self.rest[..start].iter().filter(|&&b| b == b'\n').count();
        let text = &self.rest[start..];
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        self.rest = &text[end..];
        Ok(&text[..end])
    }
}

impl NumberSource for Ascii<'_> {
    fn next(&mut self, _: Scalar) -> Result<f64, SourceError> {
        let word = self.word()?;
        let parsed = std::str::from_utf8(word).ok().and_then(|text| text.parse().ok());
        parsed.ok_or_else(|| {
            let shown = String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned();
            SourceError::NotANumber(self.line, shown)
        })
    }

    fn skip(&mut self, _: Scalar, count: u64) -> Result<(), SourceError> {
        (0..count).try_for_each(|_| self.word().map(|_| ()))
    }

    fn left(&self) -> u64 {
        // The last number needs no separator after it.
        self.rest.len() as u64 + 1
    }
}
