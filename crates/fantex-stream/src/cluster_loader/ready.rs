//! Parcels that have come, until they are taken.
//!
//! There are tens of thousands of them after a cut, but few urgencies. So each urgency has a line, and who is called away leaves a name
//! in it that no longer counts: looking for a name costs a hash, not a walk down a tree that no cache holds.

use std::collections::{BTreeMap, HashMap, VecDeque};

use fantex_store::PageError;

use super::by_urgency::Urgency;
use crate::{Parcel, ParcelTexels};

/// Texels, or why there are none.
type Outcome = Result<ParcelTexels, PageError>;

/// Names that no longer count are dropped when there are so many more of them than of others.
const MOST_LEFT_BEHIND: usize = 1 << 12;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Ready {
    outcomes: HashMap<Parcel, (Urgency, Outcome)>,
    /// In each line in the order in which they came.
    lines: BTreeMap<Urgency, VecDeque<Parcel>>,
    /// Names in all lines.
    names: usize,
    bytes: usize,
}

impl Ready {
    pub(super) fn len(&self) -> usize {
        self.outcomes.len()
    }

    /// Bytes of texels.
    pub(super) fn bytes(&self) -> usize {
        self.bytes
    }

    /// Puts one in, in place of what there is of it.
    pub(super) fn insert(&mut self, parcel: Parcel, urgency: Urgency, outcome: Outcome) {
        self.bytes += bytes_of(&outcome);
        let last = self.outcomes.insert(parcel, (urgency, outcome));
        if let Some((_, last)) = &last {
            self.bytes -= bytes_of(last);
        }
        if last.is_none_or(|(last, _)| last != urgency) {
            self.line_up(parcel, urgency);
        }
    }

    /// Gives one another urgency; false if there is none of that name.
    pub(super) fn set_urgency(&mut self, parcel: Parcel, urgency: Urgency) -> bool {
        let Some((known, _)) = self.outcomes.get_mut(&parcel) else { return false };
        if std::mem::replace(known, urgency) != urgency {
            self.line_up(parcel, urgency);
        }
        true
    }

    fn line_up(&mut self, parcel: Parcel, urgency: Urgency) {
        self.lines.entry(urgency).or_default().push_back(parcel);
        self.names += 1;
        if self.names > MOST_LEFT_BEHIND + 2 * self.outcomes.len() {
            let outcomes = &self.outcomes;
            self.lines.retain(|urgency, line| {
                line.retain(|name| outcomes.get(name).is_some_and(|(known, _)| known == urgency));
                !line.is_empty()
            });
            self.names = self.lines.values().map(VecDeque::len).sum();
        }
    }

    /// Takes one out; false if there is none of that name.
    pub(super) fn remove(&mut self, parcel: Parcel) -> bool {
        let outcome = self.outcomes.remove(&parcel);
        self.bytes -= outcome.as_ref().map_or(0, |(_, outcome)| bytes_of(outcome));
        outcome.is_some()
    }

    /// Takes the most urgent out, if it has at most so many bytes.
    pub(super) fn take_first(&mut self, most_bytes: usize) -> Option<(Parcel, Outcome)> {
        loop {
            let mut last = self.lines.last_entry()?;
            let Some(&parcel) = last.get().front() else {
                last.remove();
                continue;
            };
            let outcome = self.outcomes.get(&parcel).filter(|(urgency, _)| urgency == last.key());
            let bytes = outcome.map(|(_, outcome)| bytes_of(outcome));
            if let Some(bytes) = bytes
                && bytes > most_bytes
            {
                return None;
            }
            last.get_mut().pop_front();
            self.names -= 1;
            if let Some(bytes) = bytes {
                self.bytes -= bytes;
                return self.outcomes.remove(&parcel).map(|(_, outcome)| (parcel, outcome));
            }
        }
    }
}

/// What a parcel counts for: its texels, if any.
fn bytes_of(outcome: &Outcome) -> usize {
    outcome.as_ref().map_or(0, ParcelTexels::bytes)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn the_most_urgent_comes_first_once_whatever_was_said_of_it_before() {
        let parcel = |bundle| Parcel::Bundle { bundle, step: 0 };
        let outcome =
            |bytes: usize| Ok(ParcelTexels { extent: [4, 4], channels: vec![Arc::from(vec![0; bytes])] });
        let mut ready = Ready::default();
        for (bundle, urgency) in [(1, 0.5), (2, 3.0), (3, -1.0), (4, 3.0), (5, 2.0)] {
            ready.insert(parcel(bundle), Urgency(urgency), outcome(10 * bundle as usize));
        }
        assert!(ready.set_urgency(parcel(3), Urgency(9.0)) && !ready.set_urgency(parcel(6), Urgency(1.0)));
        ready.set_urgency(parcel(3), Urgency(-1.0));
        ready.set_urgency(parcel(3), Urgency(9.0));
        assert!(ready.remove(parcel(5)) && !ready.remove(parcel(5)));
        ready.insert(parcel(1), Urgency(0.5), outcome(11));
        assert_eq!((ready.len(), ready.bytes()), (4, 11 + 20 + 30 + 40));
        assert!(ready.take_first(29).is_none());
        let taken = std::iter::from_fn(|| ready.take_first(usize::MAX)).map(|(parcel, _)| parcel);
        assert_eq!(taken.collect::<Vec<_>>(), [3, 2, 4, 1].map(parcel));
        assert_eq!((ready.len(), ready.bytes(), ready.names), (0, 0, 0));
    }

    #[test]
    fn names_that_no_longer_count_do_not_pile_up() {
        let mut ready = Ready::default();
        for i in 0..100_000 {
            let parcel = Parcel::Bundle { bundle: i % 3, step: 0 };
            let texels = ParcelTexels { extent: [4, 4], channels: Vec::new() };
            ready.insert(parcel, Urgency((i % 7) as f32), Ok(texels));
            assert!(ready.names <= MOST_LEFT_BEHIND + 7, "{}", ready.names);
        }
    }
}
