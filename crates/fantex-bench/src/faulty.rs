//! A reader that is slow or unreliable on purpose.

use std::collections::HashMap;
use std::io;
use std::time::{Duration, Instant};

use fantex_base::Random;
use fantex_stream::read::{QueuedReader, ReadCompletion, ReadRequest, ReadWaker, ReaderInfo};

/// What goes wrong, and how often. Probabilities are of 0..1 and per read. Which reads are hit follows from the seed, the read's
/// offset and how often that offset has been read, not from time or threads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReadFaults {
    /// Chooses the reads.
    pub seed: u64,
    /// Reads that fail, in a way that may pass.
    pub error_probability: f64,
    /// Reads of which a byte is wrong.
    pub corruption_probability: f64,
    /// Reads that find the end of the file.
    pub truncation_probability: f64,
    /// Added to the time that each read takes.
    pub delay: Duration,
    /// Bytes per second of a slow disk, shared by all reads.
    pub bytes_per_second: Option<f64>,
}

/// Wraps a reader and injects faults.
pub struct FaultyReader {
    inner: Box<dyn QueuedReader>,
    faults: ReadFaults,
    /// Reads so far per offset.
    attempts: HashMap<u64, u64>,
    /// What to do to reads that are in flight.
    corruptions: HashMap<u64, u64>,
    /// Until when the slow disk has work.
    busy_until: Instant,
    /// When reads in flight may arrive at the earliest.
    due: HashMap<u64, Instant>,
    /// Done, but held back.
    held: Vec<(Instant, ReadCompletion)>,
}

impl FaultyReader {
    /// Wraps a reader.
    pub fn new(inner: Box<dyn QueuedReader>, faults: ReadFaults) -> Self {
        Self {
            inner,
            faults,
            attempts: HashMap::new(),
            corruptions: HashMap::new(),
            busy_until: Instant::now(),
            due: HashMap::new(),
            held: Vec::new(),
        }
    }

    /// When a read that is submitted now may arrive.
    fn due_time(&mut self, length: usize) -> Instant {
        let now = Instant::now();
        let Some(speed) = self.faults.bytes_per_second else { return now + self.faults.delay };
        let seconds = (length as f64 / speed.max(1.0)).min(1e6);
        self.busy_until = self.busy_until.max(now) + Duration::from_secs_f64(seconds);
        self.busy_until + self.faults.delay
    }

    fn take_due(&mut self) -> Option<ReadCompletion> {
        let now = Instant::now();
        let index = self.held.iter().position(|(due, _)| *due <= now)?;
        Some(self.held.swap_remove(index).1)
    }
}

impl QueuedReader for FaultyReader {
    fn submit(&mut self, request: ReadRequest) {
        let attempt = self.attempts.entry(request.offset).or_default();
        *attempt += 1;
        let mut random = Random::of_seeds([self.faults.seed, request.offset, *attempt]);
        let due = self.due_time(request.length);
        let is_refused = random.chance(self.faults.error_probability);
        if is_refused || random.chance(self.faults.truncation_probability) {
            let end = || io::ErrorKind::UnexpectedEof.into();
            let error = if is_refused { io::Error::other("an injected fault") } else { end() };
            self.held.push((due, ReadCompletion { token: request.token, result: Err(error) }));
            // The owner may be waiting without a limit.
            self.inner.waker().wake();
            return;
        }
        if random.chance(self.faults.corruption_probability) {
            self.corruptions.insert(request.token, random.next_u64());
        }
        self.due.insert(request.token, due);
        self.inner.submit(request);
    }

    fn cancel(&mut self, token: u64) -> bool {
        let cancelled = self.inner.cancel(token);
        if cancelled {
            self.due.remove(&token);
            self.corruptions.remove(&token);
        }
        cancelled
    }

    fn wait(&mut self, timeout: Option<Duration>) -> Option<ReadCompletion> {
        let deadline = timeout.map(|timeout| Instant::now() + timeout);
        loop {
            if let Some(completion) = self.take_due() {
                return Some(completion);
            }
            let next_due = self.held.iter().map(|(due, _)| *due).min();
            let limit = deadline.into_iter().chain(next_due).min();
            let Some(mut completion) =
                self.inner.wait(limit.map(|limit| limit.saturating_duration_since(Instant::now())))
            else {
                if next_due.is_none_or(|due| due > Instant::now()) {
                    return None;
                }
                continue;
            };
            if let (Some(place), Ok(buffer)) =
                (self.corruptions.remove(&completion.token), &mut completion.result)
                && !buffer.is_empty()
            {
                let index = (place % buffer.len() as u64) as usize;
                let mut bytes = buffer.to_vec();
                bytes[index] ^= 1 << (place >> 61);
                *buffer = bytes.into();
            }
            let due = self.due.remove(&completion.token).unwrap_or_else(Instant::now);
            self.held.push((due, completion));
        }
    }

    fn waker(&self) -> ReadWaker {
        self.inner.waker()
    }

    fn info(&self) -> ReaderInfo {
        self.inner.info()
    }
}
