//! The board as threads share it.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use super::board::{Board, Order};

/// The board behind its lock.
#[derive(Debug)]
pub(super) struct SharedBoard {
    board: Mutex<Board>,
    /// For workers: there are jobs, or room for ready pages, or an end.
    work: Condvar,
}

impl SharedBoard {
    pub(super) fn new(board: Board) -> Self {
        Self { board: Mutex::new(board), work: Condvar::new() }
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, Board> {
        self.board.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Jobs are on the board: wakes a worker for each.
    pub(super) fn jobs_arrived(&self, count: usize) {
        match count {
            0 => {}
            1 => self.work.notify_one(),
            _ => self.work.notify_all(),
        }
    }

    pub(super) fn room_arrived(&self) {
        self.work.notify_all();
    }

    /// Waits for something to do.
    pub(super) fn wait_for_order(&self) -> Order {
        let mut board = self.lock();
        loop {
            if let Some(order) = board.next_order() {
                return order;
            }
            board = self.work.wait(board).unwrap_or_else(PoisonError::into_inner);
        }
    }

    pub(super) fn close(&self) {
        self.lock().close();
        self.work.notify_all();
    }
}
