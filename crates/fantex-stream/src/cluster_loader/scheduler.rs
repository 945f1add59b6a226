//! The thread (or a step of the caller's) that decides what is read next, and the order of clusters in the file, by which neighbours are read together.

use std::collections::HashMap;
use std::io;
use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

use fantex_store::{Asset, ClusterId};
use web_time::Instant;

use super::Effects;
use super::Shared;
use crate::read::{QueuedReader, ReadCompletion, ReadRequest};

/// How long an idle scheduler waits for more requests before it reads, so that neighbours are read together. A frame's requests
/// come within this time.
const COALESCE_WINDOW: Duration = Duration::from_micros(100);

struct ActiveRead {
    read: ClusterRead,
    submitted: Instant,
}

/// Owns the reader. See the [module](super).
pub(super) struct Scheduler {
    shared: Arc<Shared>,
    reader: Box<dyn QueuedReader>,
    order: FileOrder,
    reads_by_token: HashMap<u64, ActiveRead>,
    tokens: HashMap<ClusterId, u64>,
    next_token: u64,
}

impl Scheduler {
    pub(super) fn new(shared: Arc<Shared>, reader: Box<dyn QueuedReader>, order: FileOrder) -> Self {
        Self { shared, reader, order, reads_by_token: HashMap::new(), tokens: HashMap::new(), next_token: 0 }
    }

    /// Works until the board is closed.
    pub(super) fn run(mut self) {
        loop {
            self.shared.scheduler.clear();
            if self.shared.board.lock().is_closed {
                return;
            }
            self.take_messages();
            self.cancel_abandoned_reads();
            let next_due = self.begin_reads();
            let timeout = next_due.map(|due| due.saturating_duration_since(Instant::now()));
            let was_idle = self.reads_by_token.is_empty();
            match self.reader.wait(timeout) {
                Some(completion) => self.complete_all(completion),
                None if was_idle => std::thread::sleep(COALESCE_WINDOW),
                None => {}
            }
        }
    }

    /// Takes what has been read and begins what may be read now; waits for nothing.
    pub(super) fn step(&mut self) {
        self.shared.scheduler.clear();
        if let Some(completion) = self.reader.wait(Some(Duration::ZERO)) {
            self.complete_all(completion);
        }
        self.take_messages();
        self.cancel_abandoned_reads();
        self.begin_reads();
    }

    /// Brings what the caller has asked for onto the board, a little at a time: others need it, too.
    fn take_messages(&self) {
        let mut has_more = true;
        while has_more {
            let mut effects = Effects::default();
            self.shared.inbox.take_some(&mut self.shared.board.lock(), &mut effects);
            has_more = effects.has_more;
            // The scheduler itself is about to look.
            self.shared.notify(Effects { for_scheduler: false, has_more: false, ..effects });
        }
    }

    /// Cancels reads that have not begun and of which no cluster is wanted.
    fn cancel_abandoned_reads(&mut self) {
        let abandoned = self.shared.board.lock().take_abandoned();
        for cluster in abandoned {
            let Some(&token) = self.tokens.get(&cluster) else { continue };
            let Some(active) = self.reads_by_token.get(&token) else { continue };
            let mut board = self.shared.board.lock();
            if active.read.clusters.iter().all(|(id, _)| board.is_abandoned(*id)) && self.reader.cancel(token)
            {
                for (id, range) in &active.read.clusters {
                    board.read_cancelled(*id, (range.end - range.start) as usize);
                    self.tokens.remove(id);
                }
                board.counts.reads_in_flight -= 1;
                self.reads_by_token.remove(&token);
            }
        }
    }

    /// Submits as many reads as may be in flight. Returns when a paused cluster is due.
    fn begin_reads(&mut self) -> Option<Instant> {
        // A few more than can be in flight, so that the reader does not wait for this thread.
        let depth = self.reader.info().depth;
        let most = depth + depth.div_ceil(4);
        let mut reads = Vec::new();
        let mut board = self.shared.board.lock();
        let next_due = board.resume_paused(Instant::now());
        let options = &self.shared.options;
        while self.reads_by_token.len() + reads.len() < most
            && board.has_room_for_reads()
            && let Some((cluster, mergeable)) = board.next_to_read()
        {
            let read = if mergeable {
                let wanted = |id| board.is_mergeable(id);
                self.order.merged(cluster, options.merge_bytes, options.merge_gap_bytes, wanted)
            } else {
                self.order.alone(cluster)
            };
            for (id, range) in &read.clusters {
                board.read_begins(*id, (range.end - range.start) as usize);
            }
            reads.push(read);
        }
        let counts = &mut board.counts;
        counts.reads_in_flight += reads.len();
        counts.max_reads_in_flight = counts.max_reads_in_flight.max(counts.reads_in_flight);
        drop(board);
        reads.into_iter().for_each(|read| self.submit(read));
        next_due
    }

    fn submit(&mut self, read: ClusterRead) {
        let token = self.next_token;
        self.next_token += 1;
        let length = (read.range.end - read.range.start) as usize;
        self.reader.submit(ReadRequest { token, offset: read.range.start, length });
        for (id, _) in &read.clusters {
            self.tokens.insert(*id, token);
        }
        self.reads_by_token.insert(token, ActiveRead { read, submitted: Instant::now() });
    }

    /// Takes a completion, and those that have come along with it.
    fn complete_all(&mut self, first: ReadCompletion) {
        let mut next = Some(first);
        while let Some(completion) = next {
            self.complete(completion);
            next = self.reader.wait(Some(Duration::ZERO));
        }
    }

    fn complete(&mut self, completion: ReadCompletion) {
        let ReadCompletion { token, result } = completion;
        let Some(ActiveRead { read, submitted }) = self.reads_by_token.remove(&token) else { return };
        let mut length = read.range.end - read.range.start;
        if self.reader.info().direct {
            length = length.next_multiple_of(4096);
        }
        let mut board = self.shared.board.lock();
        let counts = &mut board.counts;
        counts.reads += 1;
        counts.reads_in_flight -= 1;
        counts.bytes_read += length;
        counts.read_seconds += submitted.elapsed().as_secs_f64();
        let result = result.map(Arc::new).map_err(Arc::new);
        let alone = read.clusters.len() == 1;
        let mut jobs = 0;
        for (id, range) in read.clusters {
            self.tokens.remove(&id);
            let stored_bytes = (range.end - range.start) as usize;
            let from = (range.start - read.range.start) as usize;
            let error = match &result {
                Ok(bytes) if from + stored_bytes <= bytes.len() => {
                    let part = from..from + stored_bytes;
                    jobs += usize::from(board.read_ends(id, Arc::clone(bytes), part));
                    continue;
                }
                // Fewer bytes than were asked for.
                Ok(_) => Arc::new(io::ErrorKind::UnexpectedEof.into()),
                Err(error) => Arc::clone(error),
            };
            let error = self.shared.asset.read_error(&range, error);
            board.read_fails(id, stored_bytes, error, alone);
        }
        drop(board);
        self.shared.notify(Effects { jobs, ..Effects::default() });
    }
}

// Clusters in the order in which they lie in the file.

/// All clusters by their offset.
#[derive(Debug)]
pub(super) struct FileOrder {
    /// Ascending by start.
    by_offset: Vec<(ClusterId, Range<u64>)>,
    /// Per level and cluster its place in `by_offset`.
    places: Vec<Vec<u32>>,
}

/// A read of one or more clusters that are neighbours in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ClusterRead {
    /// Bytes of the file.
    pub(super) range: Range<u64>,
    /// Clusters in it and their bytes of the file.
    pub(super) clusters: Vec<(ClusterId, Range<u64>)>,
}

impl FileOrder {
    pub(super) fn new(asset: &Asset) -> Self {
        Self::from_ranges(asset.clusters().map(|id| (id, asset.cluster_range(id))).collect())
    }

    /// `clusters`: level by level, ascending.
    fn from_ranges(clusters: Vec<(ClusterId, Range<u64>)>) -> Self {
        let levels = clusters.last().map_or(0, |(id, _)| id.level as usize + 1);
        let mut by_offset = clusters;
        by_offset.sort_by_key(|(id, range)| (range.start, *id));
        let mut places = vec![Vec::new(); levels];
        for (place, (id, _)) in by_offset.iter().enumerate() {
            let level: &mut Vec<u32> = &mut places[id.level as usize];
            let index = id.index as usize;
            level.resize(level.len().max(index + 1), 0);
            level[index] = place as u32;
        }
        Self { by_offset, places }
    }

    fn place(&self, id: ClusterId) -> usize {
        self.places[id.level as usize][id.index as usize] as usize
    }

    pub(super) fn range(&self, id: ClusterId) -> Range<u64> {
        self.by_offset[self.place(id)].1.clone()
    }

    /// A read of one cluster and nothing else.
    pub(super) fn alone(&self, id: ClusterId) -> ClusterRead {
        let range = self.range(id);
        ClusterRead { range: range.clone(), clusters: vec![(id, range)] }
    }

    /// A read of a cluster and of its `wanted` neighbours on both sides, of at most `max_bytes`, with gaps of at most
    /// `gap_bytes`.
    pub(super) fn merged(
        &self,
        id: ClusterId,
        max_bytes: u64,
        gap_bytes: u64,
        wanted: impl Fn(ClusterId) -> bool,
    ) -> ClusterRead {
        let mut read = self.alone(id);
        let place = self.place(id);
        for (neighbour, range) in &self.by_offset[place + 1..] {
            if range.start > read.range.end.saturating_add(gap_bytes)
                || range.end - read.range.start > max_bytes
            {
                break;
            }
            if wanted(*neighbour) {
                read.range.end = read.range.end.max(range.end);
                read.clusters.push((*neighbour, range.clone()));
            }
        }
        for (neighbour, range) in self.by_offset[..place].iter().rev() {
            if range.end.saturating_add(gap_bytes) < read.range.start
                || read.range.end - range.start > max_bytes
            {
                break;
            }
            if wanted(*neighbour) && range.end <= read.range.end {
                read.range.start = range.start;
                read.clusters.push((*neighbour, range.clone()));
            }
        }
        read
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id(level: u32, index: u32) -> ClusterId {
        ClusterId { level, index }
    }

    /// Two levels, interleaved: 0.0 1.0 0.1 0.2 (gap) 0.3
    fn order() -> FileOrder {
        FileOrder::from_ranges(vec![
            (id(0, 0), 4096..8000),
            (id(0, 1), 12288..20000),
            (id(0, 2), 20480..24576),
            (id(0, 3), 90112..90200),
            (id(1, 0), 8192..12000),
        ])
    }

    #[test]
    fn wanted_neighbours_are_read_together() {
        let order = order();
        let read = order.merged(id(0, 1), 1 << 20, 4096, |_| true);
        assert_eq!(read.range, 4096..24576);
        let ids: Vec<_> = read.clusters.iter().map(|(id, _)| *id).collect();
        assert_eq!(ids, [id(0, 1), id(0, 2), id(1, 0), id(0, 0)]);
    }

    #[test]
    fn reads_are_bounded_and_skip_what_is_not_wanted() {
        let order = order();
        assert_eq!(order.merged(id(0, 1), 13_000, 4096, |_| true).range, 12288..24576);
        // 1.0 is small enough to be read along.
        let read = order.merged(id(0, 1), 1 << 20, 5000, |other| other == id(0, 0));
        assert_eq!((read.range, read.clusters.len()), (4096..20000, 2));
        let read = order.merged(id(0, 1), 1 << 20, 1000, |other| other == id(0, 0));
        assert_eq!(read, order.alone(id(0, 1)));
        assert_eq!(order.merged(id(0, 3), 1 << 20, 4096, |_| true), order.alone(id(0, 3)));
    }
}
