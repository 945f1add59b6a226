//! Reads by tasks of whoever runs them: a web page, where nothing may block and `fetch` answers later.

use std::future::Future;
use std::io;
use std::pin::Pin;
use std::sync::Arc;

use super::{LaneReader, MAX_READ_BYTES, ReadBuffer, ReadCompletion, ReadRequest, ReaderInfo};

/// Something to be run beside others, on the thread that made it.
pub type Task = Pin<Box<dyn Future<Output = ()>>>;

/// A reader whose `info.depth` lanes are tasks, handed to `spawn`, that await `read`. Its owner must not wait for completions
/// ([`QueuedReader::wait`](super::QueuedReader::wait) with no time, or zero) on the thread that runs the tasks. They end when the reader is
/// dropped.
pub fn task_reader<R>(
    info: ReaderInfo,
    mut spawn: impl FnMut(Task),
    read: impl Fn(ReadRequest) -> R + 'static,
) -> LaneReader
where
    R: Future<Output = io::Result<Vec<u8>>>,
{
    let reader = LaneReader::new(info);
    let read = std::rc::Rc::new(read);
    for lane in 0..info.depth {
        let (queue, reports) = (Arc::clone(&reader.queue), reader.reports());
        let read = std::rc::Rc::clone(&read);
        spawn(Box::pin(async move {
            while let Some(request) = queue.next_async(lane).await {
                let result = match request.length {
                    length if length > MAX_READ_BYTES => Err(io::ErrorKind::InvalidInput.into()),
                    length => read(request).await.and_then(|bytes| {
                        let is_whole = bytes.len() == length;
                        if is_whole {
                            Ok(ReadBuffer::from(bytes))
                        } else {
                            Err(io::ErrorKind::UnexpectedEof.into())
                        }
                    }),
                };
                reports.send(ReadCompletion { token: request.token, result });
            }
        }));
    }
    reader
}
