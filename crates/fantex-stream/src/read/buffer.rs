//! Buffers: aligned as direct I/O needs them, and used again and again.

use std::ops::{Deref, Range};
use std::sync::{Arc, Mutex, PoisonError};

/// Direct reads start and end at multiples of this in the file, and start at one in memory. (Most disks are content with 512.)
pub(crate) const ALIGNMENT: usize = 4096;

/// Memory that starts at a multiple of [`ALIGNMENT`]. Nothing about it is unsafe: it is a vector that is a little too long.
#[derive(Debug, Default)]
pub(crate) struct AlignedBytes {
    pub(crate) bytes: Vec<u8>,
    /// Where the aligned part starts.
    pub(crate) start: usize,
}

impl AlignedBytes {
    /// Room for `length` bytes at least, of any content. Keeps its memory where that is long enough.
    fn reserve(&mut self, length: usize) {
        if self.bytes.len() < self.start + length {
            // Not resized: the old content would be copied. Powers of two, so that few lengths suit most reads.
            let room = length.next_power_of_two().max(64 << 10);
            self.bytes = vec![0; room + ALIGNMENT];
            self.start = self.bytes.as_ptr().align_offset(ALIGNMENT).min(ALIGNMENT);
        }
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

/// Buffers that are not in use. Shared by the lanes of a back end and the holders of [`ReadBuffer`]s.
#[derive(Debug)]
pub struct BufferPool {
    idle: Mutex<Vec<AlignedBytes>>,
    /// Bytes of idle buffers that are kept at most.
    keep_bytes: usize,
}

impl BufferPool {
    /// A pool that keeps at most `keep_bytes` of idle buffers.
    pub fn new(keep_bytes: usize) -> Arc<Self> {
        Arc::new(Self { idle: Mutex::default(), keep_bytes })
    }

    /// A buffer with room for `length` bytes.
    pub(crate) fn take(&self, length: usize) -> AlignedBytes {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        // The last returned is most likely still in the processor's cache; a fitting one is better.
        let fitting = idle.iter().rposition(|buffer| buffer.capacity() >= length + 2 * ALIGNMENT);
        let mut buffer = match fitting {
            Some(index) => idle.swap_remove(index),
            None => idle.pop().unwrap_or_default(),
        };
        drop(idle);
        buffer.reserve(length);
        buffer
    }

    pub(crate) fn put_back(&self, buffer: AlignedBytes) {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let kept: usize = idle.iter().map(AlignedBytes::capacity).sum();
        if kept + buffer.capacity() <= self.keep_bytes {
            idle.push(buffer);
        }
    }
}

/// The bytes of a read. They go back to their pool when it is dropped.
#[derive(Debug)]
pub struct ReadBuffer {
    memory: AlignedBytes,
    /// Of `memory.bytes`.
    range: Range<usize>,
    pool: Option<Arc<BufferPool>>,
}

impl ReadBuffer {
    /// A part of a pool's buffer, given relative to its aligned start.
    pub(crate) fn new(memory: AlignedBytes, part: Range<usize>, pool: Arc<BufferPool>) -> Self {
        let range = memory.start + part.start..memory.start + part.end;
        Self { memory, range, pool: Some(pool) }
    }
}

impl From<Vec<u8>> for ReadBuffer {
    fn from(bytes: Vec<u8>) -> Self {
        let range = 0..bytes.len();
        Self { memory: AlignedBytes { bytes, start: 0 }, range, pool: None }
    }
}

impl Deref for ReadBuffer {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.memory.bytes[self.range.clone()]
    }
}

impl Drop for ReadBuffer {
    fn drop(&mut self) {
        if let Some(pool) = &self.pool {
            pool.put_back(std::mem::take(&mut self.memory));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_are_aligned_and_used_again() {
        let pool = BufferPool::new(1 << 20);
        for length in [1, 4096, 70_000, 300_000, 5] {
            let memory = pool.take(length);
            assert_eq!((memory.bytes.as_ptr() as usize + memory.start) % ALIGNMENT, 0);
            assert!(memory.bytes.len() - memory.start >= length);
            let place = memory.bytes.as_ptr();
            drop(ReadBuffer::new(memory, 0..length, Arc::clone(&pool)));
            let again = pool.take(length);
            assert_eq!(again.bytes.as_ptr(), place);
            pool.put_back(again);
        }
        // What exceeds the limit is freed.
        pool.put_back(pool.take(2 << 20));
        assert!(pool.idle.lock().unwrap().iter().map(AlignedBytes::capacity).sum::<usize>() <= 1 << 20);
    }
}
