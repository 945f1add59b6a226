//! Which bytes of an object its store copies from others, and which are sent to it.
//!
//! ```text
//!  object   |  own  |      run      | own |  run |  own  |        run        | own |
//!  pieces   |    sent    | copied   |         sent           |    copied     | sent|
//! ```
//!
//! A store makes an object of at most 10 000 pieces; each but the last has 5 MiB or more, and none more than 5 GiB
//! (<https://docs.aws.amazon.com/AmazonS3/latest/userguide/qfacts.html>). So what is sent takes as much of the run behind it as it lacks, and
//! runs that would be too short then are sent.

use std::ops::Range;

/// Fewest bytes of a piece that is not the last.
const MIN_PIECE_BYTES: u64 = 5 << 20;

/// Most bytes of a piece.
const MAX_PIECE_BYTES: u64 = 5 << 30;

const MAX_PIECES: usize = 10_000;

/// Pieces of each kind, sent and copied, that long stretches are cut into, about. The rest of [`MAX_PIECES`] is for short ones.
const USUAL_PIECES: u64 = 4_500;

/// Bytes of a piece that is sent, unless there would be too many. Twice as many are still one piece.
const SENT_BYTES: u64 = 8 << 20;

/// As [`SENT_BYTES`], of one that is copied: a store copies several at a time, each at about the speed of a disk.
const COPIED_BYTES: u64 = 64 << 20;

/// A piece of an object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Piece {
    pub(super) range: Range<u64>,
    /// The run that it is copied from; none where it is sent.
    pub(super) run: Option<usize>,
}

impl Piece {
    pub(super) fn length(&self) -> u64 {
        self.range.end - self.range.start
    }
}

/// Cuts an object of `length` bytes into pieces. `runs` are the bytes that the store has elsewhere: ascending, none of them empty.
///
/// Besides what is in no run, at most 10 MiB per run are sent, unless there are so many runs that shorter ones have to be sent, too.
pub(super) fn pieces(length: u64, runs: &[Range<u64>]) -> Vec<Piece> {
    // What is left of a run once it has given what is lacking before it can be copied.
    let mut shortest = 2 * MIN_PIECE_BYTES;
    loop {
        let pieces = pieces_of(&stretches(length, runs, shortest));
        if pieces.len() <= MAX_PIECES || pieces.iter().all(|piece| piece.run.is_none()) {
            return pieces;
        }
        shortest *= 2;
    }
}

/// What is sent and what is copied, in turn, where runs of fewer than `shortest` bytes are sent.
fn stretches(length: u64, runs: &[Range<u64>], shortest: u64) -> Vec<Piece> {
    let mut stretches = Vec::new();
    let mut push = |range: Range<u64>, run| {
        if !range.is_empty() {
            stretches.push(Piece { range, run });
        }
    };
    let mut end = 0;
    for (index, run) in runs.iter().enumerate().filter(|(_, run)| run.end - run.start >= shortest) {
        let is_next = run.start == end;
        let start = if is_next { run.start } else { run.start.max(end + MIN_PIECE_BYTES) };
        push(end..start, None);
        push(start..run.end, Some(index));
        end = run.end;
    }
    push(end..length, None);
    stretches
}

/// Cuts stretches into pieces of nearly one length each.
fn pieces_of(stretches: &[Piece]) -> Vec<Piece> {
    let piece_bytes = |is_sent: bool, least: u64| {
        let of_kind = stretches.iter().filter(|stretch| stretch.run.is_none() == is_sent);
        let total: u64 = of_kind.map(Piece::length).sum();
        total.div_ceil(USUAL_PIECES).next_multiple_of(1 << 20).clamp(least, MAX_PIECE_BYTES / 2)
    };
    let (sent_bytes, copied_bytes) = (piece_bytes(true, SENT_BYTES), piece_bytes(false, COPIED_BYTES));
    let mut pieces = Vec::new();
    for Piece { range, run } in stretches {
        let length = range.end - range.start;
        let count = (length / if run.is_some() { copied_bytes } else { sent_bytes }).max(1);
        let (each, longer) = (length / count, length % count);
        let start_of = |number: u64| range.start + number * each + number.min(longer);
        pieces.extend(
            (0..count).map(|number| Piece { range: start_of(number)..start_of(number + 1), run: *run }),
        );
    }
    pieces
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MIB: u64 = 1 << 20;

    /// Lengths of what is in no run and of runs, in turn.
    fn laid_out(lengths: &[[u64; 2]], last: u64) -> (u64, Vec<Range<u64>>) {
        let mut end = 0;
        let run_of = |&[own, run]: &[u64; 2]| {
            let start = end + own;
            end = start + run;
            start..end
        };
        let runs: Vec<_> = lengths.iter().map(run_of).collect();
        (end + last, runs)
    }

    fn is_copied(piece: &&Piece) -> bool {
        piece.run.is_some()
    }

    fn total<'a>(pieces: impl Iterator<Item = &'a Piece>) -> u64 {
        pieces.map(Piece::length).sum()
    }

    /// The pieces are the object, and what a store takes.
    fn check(length: u64, runs: &[Range<u64>], pieces: &[Piece]) {
        let mut end = 0;
        for (number, piece) in pieces.iter().enumerate() {
            assert_eq!(piece.range.start, end);
            end = piece.range.end;
            assert!(piece.length() > 0 && piece.length() <= MAX_PIECE_BYTES, "{piece:?}");
            assert!(piece.length() >= MIN_PIECE_BYTES || number + 1 == pieces.len(), "{piece:?}");
            if let Some(run) = piece.run {
                assert!(runs[run].start <= piece.range.start && piece.range.end <= runs[run].end);
            }
        }
        assert_eq!(end, length);
        assert!(pieces.len() <= MAX_PIECES, "{}", pieces.len());
    }

    fn any_length() -> impl Strategy<Value = u64> {
        prop_oneof![0..3 * MIB, 4 * MIB..12 * MIB, 0..300 * MIB, 0..40_000 * MIB]
    }

    proptest! {
        #[test]
        fn pieces_are_the_object_and_little_is_sent(
            lengths in prop::collection::vec((any_length(), any_length()), 0..40),
            last in any_length(),
        ) {
            let lengths: Vec<_> = lengths.iter().map(|&(own, run)| [own, run + 1]).collect();
            let (length, runs) = laid_out(&lengths, last);
            let pieces = pieces(length, &runs);
            check(length, &runs, &pieces);
            let in_runs: u64 = runs.iter().map(|run| run.end - run.start).sum();
            let given: u64 = runs.iter().map(|run| (run.end - run.start).min(2 * MIN_PIECE_BYTES)).sum();
            let sent = total(pieces.iter().filter(|piece| !is_copied(piece)));
            prop_assert!(sent <= length - in_runs + given, "{sent} of {length}");
        }
    }

    #[test]
    fn few_pieces_are_made_of_many_runs_and_of_long_ones() {
        for (count, run, copied) in [
            (20_000, 3 * MIB, 0),
            (4_000, 16 * MIB, 50),
            (20_000, 16 * MIB, 0),
            (100, 100 << 30, 99),
            (1, 10 << 40, 99),
        ] {
            let (length, runs) = laid_out(&vec![[MIB / 4, run]; count], 1000);
            let pieces = pieces(length, &runs);
            check(length, &runs, &pieces);
            let share = 100 * (total(pieces.iter().filter(is_copied)) / MIB) / (length / MIB);
            assert!(share >= copied, "{count} runs of {run} bytes: {share} %");
        }
    }

    #[test]
    fn runs_that_touch_need_nothing_between_them() {
        let (length, runs) = laid_out(&[[0, 6 * MIB], [0, 20 * MIB], [0, 30 * MIB]], 0);
        let found: Vec<_> =
            pieces(length, &runs).into_iter().map(|piece| (piece.run, piece.length() / MIB)).collect();
        // The first one is too short to give anything.
        assert_eq!(found, [(None, 6), (Some(1), 20), (Some(2), 30)]);
        assert!(pieces(0, &[]).is_empty());
    }
}
