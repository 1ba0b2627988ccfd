//! A server that does as it likes, over HTTP/1.1, and a count of what it got rid of.
// Each test binary uses its own part of this module; failing loudly is a test's unwrap's purpose.
#![allow(dead_code, clippy::unwrap_used)]

pub mod counting;
pub mod scene;

use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// A running server.
pub struct Hostile {
    pub url: String,
    sent_bytes: Arc<AtomicU64>,
    requests: Arc<AtomicU64>,
}

/// A connection whose request has come.
pub struct Client {
    stream: TcpStream,
    sent_bytes: Arc<AtomicU64>,
}

impl Hostile {
    /// Answers every request with `answer`, which gets its path; a connection ends with the first
    /// error.
    pub fn start(
        answer: impl Fn(&str, &mut Client) -> io::Result<()> + Send + Sync + 'static,
    ) -> Self {
        Self::listen(true, answer)
    }

    /// The same for HTTP/2 by prior knowledge: `answer` begins after the client's preface, on
    /// stream 1.
    pub fn start_http2(
        answer: impl Fn(&str, &mut Client) -> io::Result<()> + Send + Sync + 'static,
    ) -> Self {
        Self::listen(false, answer)
    }

    fn listen(
        refuses_http2: bool,
        answer: impl Fn(&str, &mut Client) -> io::Result<()> + Send + Sync + 'static,
    ) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let (sent_bytes, requests) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
        let (sent, counted, answer) = (sent_bytes.clone(), requests.clone(), Arc::new(answer));
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let (sent, counted, answer) = (sent.clone(), counted.clone(), answer.clone());
                std::thread::spawn(move || {
                    let stream = stream.unwrap();
                    stream.set_nodelay(true).unwrap();
                    let mut client = Client {
                        stream,
                        sent_bytes: sent,
                    };
                    // A client that hangs up ends the connection with an error, which is its right.
                    let _ = serve(&mut client, refuses_http2, &counted, &*answer);
                });
            }
        });
        Self {
            url,
            sent_bytes,
            requests,
        }
    }

    /// Bytes that the system took from it.
    pub fn sent_bytes(&self) -> u64 {
        self.sent_bytes.load(Ordering::Relaxed)
    }

    /// Requests that came.
    pub fn requests(&self) -> u64 {
        self.requests.load(Ordering::Relaxed)
    }
}

fn serve(
    client: &mut Client,
    refuses_http2: bool,
    requests: &AtomicU64,
    answer: &dyn Fn(&str, &mut Client) -> io::Result<()>,
) -> io::Result<()> {
    loop {
        let head = client.head()?;
        if head.starts_with("PRI ") && refuses_http2 {
            return client.send(b"HTTP/1.1 400 Bad Request\r\nConnection: close\r\n\r\n");
        }
        requests.fetch_add(1, Ordering::Relaxed);
        let path = head.split(' ').nth(1).unwrap_or_default().to_owned();
        let body = head
            .lines()
            .find_map(|line| line.strip_prefix("content-length: "))
            .map_or(0, |bytes| bytes.trim().parse().unwrap());
        client.stream.read_exact(&mut vec![0; body])?;
        answer(&path, client)?;
    }
}

impl Client {
    fn head(&mut self) -> io::Result<String> {
        let (mut head, mut byte) = (Vec::new(), [0]);
        while !head.ends_with(b"\r\n\r\n") {
            self.stream.read_exact(&mut byte)?;
            head.push(byte[0]);
        }
        Ok(String::from_utf8_lossy(&head).into_owned())
    }

    pub fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.stream.write_all(bytes)?;
        self.sent_bytes
            .fetch_add(bytes.len() as u64, Ordering::Relaxed);
        Ok(())
    }

    /// The head of an answer whose body comes in chunks, with more `fields`.
    pub fn begin(&mut self, fields: &str) -> io::Result<()> {
        let head = format!("HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n{fields}\r\n");
        self.send(head.as_bytes())
    }

    /// A chunk of the body; the empty one ends it.
    pub fn chunk(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.send(format!("{:x}\r\n", bytes.len()).as_bytes())?;
        self.send(bytes)?;
        self.send(b"\r\n")
    }

    /// A whole answer.
    pub fn answer(&mut self, fields: &str, body: &[u8]) -> io::Result<()> {
        let length = body.len();
        let head = format!("HTTP/1.1 200 OK\r\nContent-Length: {length}\r\n{fields}\r\n");
        self.send(head.as_bytes())?;
        self.send(body)
    }

    /// Says nothing until the client hangs up.
    pub fn stall(&mut self) -> io::Result<()> {
        io::copy(&mut self.stream, &mut io::sink()).map(|_| ())
    }

    /// `piece` for ever, with a pause before each.
    pub fn trickle(&mut self, piece: &[u8], pause: Duration) -> io::Result<()> {
        loop {
            std::thread::sleep(pause);
            self.send(piece)?;
        }
    }

    /// A frame of HTTP/2 (RFC 9113, 4.1).
    pub fn frame(&mut self, kind: u8, flags: u8, stream: u8, payload: &[u8]) -> io::Result<()> {
        let mut frame = (payload.len() as u32).to_be_bytes()[1..].to_vec();
        frame.extend([kind, flags, 0, 0, 0, stream]);
        frame.extend(payload);
        self.send(&frame)
    }
}

impl Client {
    /// Reads frames of HTTP/2 until a request has come, and says hello.
    pub fn http2_request(&mut self) -> io::Result<()> {
        const HEADERS: u8 = 1;
        const SETTINGS: u8 = 4;
        const ACK: u8 = 1;
        // The rest of the preface.
        self.stream.read_exact(&mut [0; 6])?;
        self.frame(SETTINGS, 0, 0, &[])?;
        self.frame(SETTINGS, ACK, 0, &[])?;
        loop {
            let mut head = [0; 9];
            self.stream.read_exact(&mut head)?;
            let length = u32::from_be_bytes([0, head[0], head[1], head[2]]);
            self.stream.read_exact(&mut vec![0; length as usize])?;
            if head[3] == HEADERS {
                return Ok(());
            }
        }
    }
}
