//! A client of HTTP/2 that reads only when it is told to, and counts what it read.

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpSocket, TcpStream};

use super::server::Running;

/// What the client's socket takes in without being read.
pub const RECEIVE_BYTES: usize = 64 * 1024;

const DATA: u8 = 0;
const HEADERS: u8 = 1;
const SETTINGS: u8 = 4;
const PING: u8 = 6;
const WINDOW_UPDATE: u8 = 8;
const END_STREAM: u8 = 1;
const END_HEADERS: u8 = 4;
const ACK: u8 = 1;
/// As much as a window can be.
const WINDOW: u32 = i32::MAX as u32;

/// A connection.
pub struct Slow {
    stream: TcpStream,
    next: u32,
    read_bytes: usize,
    ended: Vec<u32>,
}

impl Slow {
    /// Connects; no window of HTTP/2 ever holds the server back.
    pub async fn connect(server: &Running) -> Self {
        let socket = TcpSocket::new_v4().unwrap();
        // The system doubles it for its own needs.
        socket
            .set_recv_buffer_size(RECEIVE_BYTES as u32 / 2)
            .unwrap();
        let stream = socket.connect(server.address).await.unwrap();
        let mut slow = Self {
            stream,
            next: 1,
            read_bytes: 0,
            ended: vec![],
        };
        slow.stream
            .write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n")
            .await
            .unwrap();
        let window = [&[0, 4][..], &WINDOW.to_be_bytes()].concat();
        slow.frame(SETTINGS, 0, 0, &window).await;
        slow.frame(WINDOW_UPDATE, 0, 0, &(WINDOW - 65_535).to_be_bytes())
            .await;
        slow
    }

    async fn frame(&mut self, kind: u8, flags: u8, stream: u32, payload: &[u8]) {
        let mut bytes = (payload.len() as u32).to_be_bytes()[1..].to_vec();
        bytes.extend([kind, flags]);
        bytes.extend(stream.to_be_bytes());
        bytes.extend(payload);
        self.stream.write_all(&bytes).await.unwrap();
    }

    /// Asks for `path`; gives the stream's number.
    pub async fn get(&mut self, path: &str, priority: &str) -> u32 {
        let mut fields = vec![];
        for (name, value) in [
            (":method", "GET"),
            (":scheme", "http"),
            (":authority", "127.0.0.1"),
            (":path", path),
            ("priority", priority),
        ] {
            // A literal that no table keeps, with a name that is new (RFC 7541, section 6.2.2).
            fields.extend([0, name.len() as u8]);
            fields.extend(name.as_bytes());
            assert!(value.len() < 127, "one byte of length");
            fields.push(value.len() as u8);
            fields.extend(value.as_bytes());
        }
        let stream = self.next;
        self.next += 2;
        self.frame(HEADERS, END_STREAM | END_HEADERS, stream, &fields)
            .await;
        stream
    }

    /// Bytes read so far.
    pub fn read_bytes(&self) -> usize {
        self.read_bytes
    }

    /// Reads at least so many bytes more.
    pub async fn read(&mut self, bytes: usize) {
        let until = self.read_bytes + bytes;
        while self.read_bytes < until {
            self.read_frame().await;
        }
    }

    /// Reads until the answer of `stream` is there.
    pub async fn read_until_end_of(&mut self, stream: u32) {
        while !self.ended.contains(&stream) {
            self.read_frame().await;
        }
    }

    async fn read_frame(&mut self) {
        let mut head = [0; 9];
        self.stream.read_exact(&mut head).await.unwrap();
        let bytes = u32::from_be_bytes([0, head[0], head[1], head[2]]) as usize;
        let mut payload = vec![0; bytes];
        self.stream.read_exact(&mut payload).await.unwrap();
        self.read_bytes += 9 + bytes;
        let stream = u32::from_be_bytes([head[5], head[6], head[7], head[8]]);
        match (head[3], head[4]) {
            (DATA | HEADERS, flags) if flags & END_STREAM != 0 => self.ended.push(stream),
            (SETTINGS, 0) => self.frame(SETTINGS, ACK, 0, &[]).await,
            (PING, 0) => self.frame(PING, ACK, 0, &payload).await,
            _ => {}
        }
    }
}
