//! What the caller has asked for and the board does not know yet.
//!
//! The caller's thread draws pictures and must not wait. So it puts its messages here, under a lock that is held for no longer
//! than it takes to move them, and whoever holds the board next takes them over: the scheduler, as a rule.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use fantex_store::{ClusterId, PageError};

use super::board::Board;
use crate::Parcel;

/// Messages that are taken over before others may have the board.
const CHUNK: usize = 256;

/// What a caller says of a parcel, with the clusters that hold its pages.
#[derive(Debug)]
pub(super) enum Message {
    /// It is wanted, so urgently.
    Request(Parcel, f32, Result<Vec<ClusterId>, PageError>),
    /// It is not wanted any more.
    Cancel(Parcel, Option<Vec<ClusterId>>),
}

/// Messages in the order in which they came.
#[derive(Debug, Default)]
pub(super) struct Inbox {
    messages: Mutex<VecDeque<Message>>,
}

/// What there is to do when messages have been taken over.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Effects {
    /// There are clusters to read, or reads to give up.
    pub(super) for_scheduler: bool,
    /// So many jobs have come.
    pub(super) jobs: usize,
    /// There is room for ready parcels again.
    pub(super) has_room: bool,
    /// Messages are left.
    pub(super) has_more: bool,
}

impl Inbox {
    fn lock(&self) -> MutexGuard<'_, VecDeque<Message>> {
        self.messages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn add(&self, messages: impl Iterator<Item = Message>) {
        // Made before the lock is taken.
        let mut messages: VecDeque<Message> = messages.collect();
        self.lock().append(&mut messages);
    }

    /// Whether there are more messages than are taken over at a time.
    pub(super) fn is_long(&self) -> bool {
        self.lock().len() > CHUNK
    }

    /// Takes over some messages. Whoever holds the board sees each either here or there.
    pub(super) fn take_some(&self, board: &mut Board) -> Effects {
        let mut inbox = self.lock();
        let count = inbox.len().min(CHUNK);
        let messages: Vec<Message> = inbox.drain(..count).collect();
        let has_more = !inbox.is_empty();
        drop(inbox);
        let mut effects = Effects { has_more, ..Effects::default() };
        let was_full = board.ready_is_full();
        for message in messages {
            match message {
                Message::Request(parcel, urgency, Ok(clusters)) => {
                    let change = board.request(parcel, &clusters, urgency);
                    effects.for_scheduler |= change.reads;
                    effects.jobs += change.jobs;
                }
                Message::Request(parcel, urgency, Err(error)) => board.refuse(parcel, urgency, error),
                Message::Cancel(parcel, Some(clusters)) => {
                    effects.for_scheduler |= board.cancel(parcel, &clusters);
                }
                Message::Cancel(parcel, None) => board.cancel_refused(parcel),
            }
        }
        effects.has_room = was_full && !board.ready_is_full();
        effects
    }

    /// Takes over all messages.
    pub(super) fn take_all(&self, board: &mut Board) -> Effects {
        let mut all = self.take_some(board);
        while all.has_more {
            let some = self.take_some(board);
            all.for_scheduler |= some.for_scheduler;
            all.jobs += some.jobs;
            all.has_room |= some.has_room;
            all.has_more = some.has_more;
        }
        all
    }
}
