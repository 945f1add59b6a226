//! Reads from servers.

use std::io::{self, BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;

use fantex_store::ByteSource as _;
use fantex_stream::read::{HttpSource, QueuedReader as _, ReadRequest, http_reader};

fn listen() -> (TcpListener, String) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}/a.fan", listener.local_addr().unwrap());
    (listener, url)
}

fn read_request(stream: &TcpStream) {
    let mut lines = BufReader::new(stream).lines();
    while !lines.next().unwrap().unwrap().is_empty() {}
}

#[test]
fn who_drops_a_reader_does_not_wait_for_the_server() {
    let (listener, url) = listen();
    let mut reader = http_reader(Arc::new(HttpSource::new(&url, 1)), 1).unwrap();
    reader.submit(ReadRequest { token: 0, offset: 0, length: 1 });
    let (stream, _) = listener.accept().unwrap();
    read_request(&stream);
    drop(reader);
    // The reading thread still waits for an answer: it has not closed the connection.
    stream.set_nonblocking(true).unwrap();
    assert_eq!(stream.peek(&mut [0]).unwrap_err().kind(), io::ErrorKind::WouldBlock);
}

#[test]
fn sources_on_one_server_share_their_connections() {
    let (listener, url) = listen();
    let server = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        for _ in 0..2 {
            read_request(&stream);
            let answer =
                "HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 0-0/1\r\nContent-Length: 1\r\n\r\nx";
            stream.write_all(answer.as_bytes()).unwrap();
        }
    });
    for _ in 0..2 {
        assert_eq!(HttpSource::new(&url, 1).length().unwrap(), 1);
    }
    server.join().unwrap();
}
