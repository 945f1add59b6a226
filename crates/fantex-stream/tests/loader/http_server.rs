//! A web server of one file, written for these tests.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

/// How the server behaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Manner {
    /// Answers ranges.
    Ranges,
    /// Knows no ranges.
    WholeFiles,
    /// Breaks every third connection in the middle of an answer.
    Drops,
    /// Answers every third request with "503 Service Unavailable".
    Busy,
    /// Has no such file.
    Nothing,
}

struct Site {
    manner: Manner,
    bytes: Vec<u8>,
    ranges: Mutex<Vec<(u64, u64)>>,
    requests: AtomicU64,
    closed: AtomicBool,
}

/// Serves a file until it is dropped.
pub(crate) struct Server {
    site: Arc<Site>,
    port: u16,
    listener: Option<JoinHandle<()>>,
}

impl Server {
    pub(crate) fn start(bytes: Vec<u8>, manner: Manner) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let site = Arc::new(Site {
            manner,
            bytes,
            ranges: Mutex::default(),
            requests: AtomicU64::new(0),
            closed: AtomicBool::new(false),
        });
        let shared = Arc::clone(&site);
        let listener = std::thread::spawn(move || {
            for stream in listener.incoming() {
                if shared.closed.load(Ordering::SeqCst) {
                    return;
                }
                let site = Arc::clone(&shared);
                // Ends when the client closes the connection.
                std::thread::spawn(move || site.serve(stream.unwrap()).unwrap_or_default());
            }
        });
        Self { site, port, listener: Some(listener) }
    }

    pub(crate) fn url(&self) -> String {
        format!("http://127.0.0.1:{}/torus.fan", self.port)
    }

    /// First and last bytes that were asked for so far.
    pub(crate) fn ranges(&self) -> Vec<(u64, u64)> {
        self.site.ranges.lock().unwrap().clone()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.site.closed.store(true, Ordering::SeqCst);
        // One last connection, so that the listener looks.
        drop(TcpStream::connect(("127.0.0.1", self.port)));
        self.listener.take().unwrap().join().unwrap();
    }
}

impl Site {
    /// Answers the requests of a connection, one after the other.
    fn serve(&self, stream: TcpStream) -> std::io::Result<()> {
        stream.set_nodelay(true)?;
        let mut input = BufReader::new(stream.try_clone()?);
        let mut output = stream;
        loop {
            let mut range = None;
            let mut line = String::new();
            if input.read_line(&mut line)? == 0 {
                return Ok(());
            }
            loop {
                line.clear();
                if input.read_line(&mut line)? == 0 || line == "\r\n" {
                    break;
                }
                let lower = line.trim().to_ascii_lowercase();
                if let Some(bytes) = lower.strip_prefix("range: bytes=") {
                    let (first, last) = bytes.split_once('-').unwrap();
                    range = Some((first.parse::<u64>().unwrap(), last.parse::<u64>().unwrap()));
                }
            }
            self.ranges.lock().unwrap().extend(range);
            let is_third = self.requests.fetch_add(1, Ordering::SeqCst) % 3 == 2;
            if self.closed.load(Ordering::SeqCst) || !self.answer(&mut output, range, is_third)? {
                return Ok(());
            }
        }
    }

    /// Answers one request. False where the connection ends with it.
    fn answer(
        &self,
        output: &mut TcpStream,
        range: Option<(u64, u64)>,
        is_third: bool,
    ) -> std::io::Result<bool> {
        let length = self.bytes.len() as u64;
        if self.manner == Manner::Nothing {
            output.write_all(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n")?;
            return Ok(true);
        }
        if self.manner == Manner::Busy && is_third {
            output.write_all(b"HTTP/1.1 503 Service Unavailable\r\nContent-Length: 0\r\n\r\n")?;
            return Ok(true);
        }
        let Some((first, last)) = range.filter(|_| self.manner != Manner::WholeFiles) else {
            write!(output, "HTTP/1.1 200 OK\r\nContent-Length: {length}\r\n\r\n")?;
            output.write_all(&self.bytes)?;
            return Ok(true);
        };
        if first >= length {
            write!(
                output,
                "HTTP/1.1 416 Range Not Satisfiable\r\nContent-Range: bytes */{length}\r\nContent-Length: 0\r\n\r\n"
            )?;
            return Ok(true);
        }
        let last = last.min(length - 1);
        let body = &self.bytes[first as usize..=last as usize];
        write!(
            output,
            "HTTP/1.1 206 Partial Content\r\nContent-Range: bytes {first}-{last}/{length}\r\nContent-Length: {}\r\n\r\n",
            body.len()
        )?;
        let drops = self.manner == Manner::Drops && is_third;
        output.write_all(if drops { &body[..body.len() / 2] } else { body })?;
        Ok(!drops)
    }
}
