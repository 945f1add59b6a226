//! Work in the background whose result is picked up by the next frame.

use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::time::Instant;

/// Work under way on a thread of its own. Dropped, it runs to its end, and its result is lost.
#[derive(Debug)]
pub struct Job<T> {
    receiver: Receiver<T>,
    started: Instant,
}

#[derive(Debug)]
pub enum JobState<T> {
    Running,
    Done(T),
    /// It ended without a result: a fault of the program, whose details stand on standard error.
    Lost,
}

impl<T: Send + 'static> Job<T> {
    /// Starts work. `wake` is called when it has ended, however it ended.
    ///
    /// # Errors
    /// The operating system's, where there can be no further thread.
    pub fn spawn(
        name: &str,
        wake: impl FnOnce() + Send + 'static,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> std::io::Result<Self> {
        let (sender, receiver) = mpsc::channel();
        std::thread::Builder::new().name(format!("fantex-{name}")).spawn(move || {
            /// Wakes also where the work panics.
            struct OnDrop<F: FnOnce()>(Option<F>);
            impl<F: FnOnce()> Drop for OnDrop<F> {
                fn drop(&mut self) {
                    if let Some(wake) = self.0.take() {
                        wake();
                    }
                }
            }
            let _wake = OnDrop(Some(wake));
            // Owned by this scope, so that it is gone before the one who waits is woken.
            let sender = sender;
            let result = work();
            // Whoever dropped the job does not want the result.
            sender.send(result).ok();
        })?;
        Ok(Self { receiver, started: Instant::now() })
    }

    /// Asks for the result, without waiting. After [`JobState::Done`] it is lost.
    pub fn poll(&self) -> JobState<T> {
        match self.receiver.try_recv() {
            Ok(result) => JobState::Done(result),
            Err(TryRecvError::Empty) => JobState::Running,
            Err(TryRecvError::Disconnected) => JobState::Lost,
        }
    }

    /// Waits for the result; `None` where it ended without one.
    pub fn wait(self) -> Option<T> {
        self.receiver.recv().ok()
    }

    pub fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }
}
