//! What the caller has asked for and the board does not know yet.
//!
//! The caller's thread draws pictures and must not wait. So it puts its messages here, under a lock that is held for no longer
//! than it takes to move them, and whoever holds the board next takes them over: the scheduler, as a rule.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use fantex_store::{ClusterId, PageError, PageId};

use super::board::{Board, Change};

/// Messages that are taken over before others may have the board.
const CHUNK: usize = 256;

/// What a caller says of a page, with the cluster that holds it.
#[derive(Debug)]
pub(super) enum Message {
    /// It is wanted, so urgently.
    Request(PageId, f32, Result<ClusterId, PageError>),
    /// It is not wanted any more.
    Cancel(PageId, Option<ClusterId>),
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
    /// There is room for ready pages again.
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
                Message::Request(page, urgency, Ok(cluster)) => match board.request(page, cluster, urgency) {
                    Change::None => {}
                    Change::Read => effects.for_scheduler = true,
                    Change::Job => effects.jobs += 1,
                },
                Message::Request(page, urgency, Err(error)) => board.refuse(page, urgency, error),
                Message::Cancel(page, Some(cluster)) => {
                    effects.for_scheduler |= board.cancel(page, cluster);
                }
                Message::Cancel(page, None) => board.cancel_refused(page),
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
