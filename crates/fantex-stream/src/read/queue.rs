//! What the owner of a reader and its lanes share.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::{Poll, Waker};
use std::time::{Duration, Instant};

use super::{ReadCompletion, ReadRequest};

/// What comes through the channel to the owner.
enum Event {
    Completed(ReadCompletion),
    Woken,
}

/// Interrupts a reader's wait, from any thread.
#[derive(Clone, Debug)]
pub struct ReadWaker(Sender<Event>);

impl std::fmt::Debug for Event {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Completed(_) => "Completed",
            Self::Woken => "Woken",
        })
    }
}

impl ReadWaker {
    /// Interrupts. No effect on a reader that is gone.
    pub fn wake(&self) {
        self.0.send(Event::Woken).unwrap_or_default();
    }
}

/// Requests that wait for a lane.
#[derive(Debug, Default)]
struct Waiting {
    requests: VecDeque<ReadRequest>,
    /// Lanes that are tasks and have nothing to do, each once.
    idle_tasks: Vec<(usize, Waker)>,
    closed: bool,
}

/// The queue from the owner to the lanes.
#[derive(Debug, Default)]
pub(super) struct RequestQueue {
    waiting: Mutex<Waiting>,
    arrived: Condvar,
}

impl RequestQueue {
    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next request, for a lane that is a thread; none after closing.
    pub(super) fn next(&self) -> Option<ReadRequest> {
        let mut waiting = self.lock();
        loop {
            if waiting.closed {
                return None;
            }
            if let Some(request) = waiting.requests.pop_front() {
                return Some(request);
            }
            waiting = self.arrived.wait(waiting).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// The next request, for a lane that is a task and has this number; none after closing.
    pub(super) fn next_async(&self, lane: usize) -> impl Future<Output = Option<ReadRequest>> + '_ {
        std::future::poll_fn(move |context| {
            let mut waiting = self.lock();
            waiting.idle_tasks.retain(|(idle, _)| *idle != lane);
            if waiting.closed {
                return Poll::Ready(None);
            }
            if let Some(request) = waiting.requests.pop_front() {
                return Poll::Ready(Some(request));
            }
            waiting.idle_tasks.push((lane, context.waker().clone()));
            Poll::Pending
        })
    }

    pub(super) fn push(&self, request: ReadRequest) {
        let idle_task = {
            let mut waiting = self.lock();
            waiting.requests.push_back(request);
            waiting.idle_tasks.pop()
        };
        self.arrived.notify_one();
        if let Some((_, task)) = idle_task {
            task.wake();
        }
    }

    /// True if the request had not begun.
    pub(super) fn remove(&self, token: u64) -> bool {
        let mut waiting = self.lock();
        let place = waiting.requests.iter().position(|request| request.token == token);
        place.and_then(|place| waiting.requests.remove(place)).is_some()
    }

    /// Lets all lanes end. Requests that have not begun are dropped.
    pub(super) fn close(&self) {
        let idle_tasks = {
            let mut waiting = self.lock();
            waiting.closed = true;
            waiting.requests.clear();
            std::mem::take(&mut waiting.idle_tasks)
        };
        self.arrived.notify_all();
        idle_tasks.into_iter().for_each(|(_, task)| task.wake());
    }
}

/// Where lanes report.
#[derive(Clone, Debug)]
pub(super) struct Reports(Sender<Event>);

impl Reports {
    /// Hands a completion to the owner, if there is one still.
    pub(super) fn send(&self, completion: ReadCompletion) {
        self.0.send(Event::Completed(completion)).unwrap_or_default();
    }
}

/// The owner's end.
#[derive(Debug)]
pub(super) struct OwnerEnd {
    pub(super) queue: Arc<RequestQueue>,
    events: Receiver<Event>,
    sender: Sender<Event>,
}

impl OwnerEnd {
    pub(super) fn new() -> Self {
        let (sender, events) = channel();
        Self { queue: Arc::default(), events, sender }
    }

    pub(super) fn reports(&self) -> Reports {
        Reports(self.sender.clone())
    }

    pub(super) fn waker(&self) -> ReadWaker {
        ReadWaker(self.sender.clone())
    }

    pub(super) fn wait(&self, timeout: Option<Duration>) -> Option<ReadCompletion> {
        let event = match timeout {
            // A disconnected channel cannot be: this end holds a sender.
            None => self.events.recv().ok(),
            Some(timeout) => self.events.recv_timeout(timeout).ok(),
        };
        match event {
            Some(Event::Completed(completion)) => Some(completion),
            Some(Event::Woken) | None => None,
        }
    }
}

/// The time until `deadline`, as a limit for a wait.
pub(crate) fn time_until(deadline: Instant) -> Duration {
    deadline.saturating_duration_since(Instant::now())
}
