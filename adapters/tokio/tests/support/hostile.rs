//! A client that can write any frames.

use std::collections::HashMap;
use std::net::SocketAddr;

use bytes::Bytes;
use prost::Message;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

pub(crate) const DATA: u8 = 0;
pub(crate) const HEADERS: u8 = 1;
pub(crate) const RST_STREAM: u8 = 3;
pub(crate) const SETTINGS: u8 = 4;
pub(crate) const PING: u8 = 6;
pub(crate) const WINDOW_UPDATE: u8 = 8;
pub(crate) const CONTINUATION: u8 = 9;
pub(crate) const END_HEADERS: u8 = 4;

/// The preface of HTTP/2 and an empty SETTINGS frame.
pub(crate) const GREETING: [u8; 33] = *b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0";

/// Returns the headers of a call, in HPACK with nothing indexed.
pub(crate) fn call() -> Vec<u8> {
    let path = b"/fuseline.v1.Infer/Infer";
    let mut block = vec![0x83, 0x86, 0x04, u8::try_from(path.len()).unwrap()];
    block.extend_from_slice(path);
    block.extend_from_slice(&header(":authority", "x"));
    block.extend_from_slice(&header("content-type", "application/grpc"));
    block.extend_from_slice(&header("te", "trailers"));
    block
}

/// Returns one header, not indexed. The value may have up to 16,000 bytes.
pub(crate) fn header(name: &str, value: &str) -> Vec<u8> {
    let mut block = vec![0, u8::try_from(name.len()).unwrap()];
    block.extend_from_slice(name.as_bytes());
    if value.len() < 127 {
        block.push(u8::try_from(value.len()).unwrap());
    } else {
        let rest = value.len() - 127;
        let (low, high) = (u8::try_from(rest % 128).unwrap(), u8::try_from(rest / 128).unwrap());
        block.extend_from_slice(&[127, low | 128, high]);
    }
    block.extend_from_slice(value.as_bytes());
    block
}

/// Returns a request in gRPC's framing.
pub(crate) fn request(timestamp: u64) -> Bytes {
    let request =
        fuseline_tokio::grpc::Request { timestamp, ..fuseline_tokio::grpc::Request::default() };
    let message = request.encode_to_vec();
    let length = u32::try_from(message.len()).unwrap().to_be_bytes();
    [&[0][..], &length, &message].concat().into()
}

/// A connection on which the test writes every byte. The frames that the server sends are read and
/// counted.
pub(crate) struct Raw {
    pub(crate) address: SocketAddr,
    stream: Option<TcpStream>,
    read: Vec<u8>,
    /// The number of bytes that the server still accepts on the connection. `windows` has the same
    /// for streams.
    window: i64,
    is_greeted: bool,
    pongs: usize,
    initial: i64,
    /// By stream, in addition to the initial window.
    windows: HashMap<u32, i64>,
    reset: Vec<u32>,
    answered: Vec<u32>,
}

impl Raw {
    pub(crate) fn new(address: SocketAddr) -> Self {
        Self {
            address,
            stream: None,
            read: Vec::new(),
            window: 65_535,
            is_greeted: false,
            pongs: 0,
            initial: 65_535,
            windows: HashMap::new(),
            reset: Vec::new(),
            answered: Vec::new(),
        }
    }

    pub(crate) async fn connect(&self) -> TcpStream {
        TcpStream::connect(self.address).await.unwrap()
    }

    pub(crate) async fn open(&mut self) {
        self.stream = Some(self.connect().await);
    }

    /// Connects, sends the preface and acknowledges the server's settings.
    pub(crate) async fn greet(&mut self) {
        self.open().await;
        self.bytes(&GREETING).await;
        while !self.is_greeted && self.received().await {}
        self.frame(SETTINGS, 1, 0, &[]).await;
    }

    /// Sends the bytes. Returns `false` if the server ended the connection.
    pub(crate) async fn bytes(&mut self, mut bytes: &[u8]) -> bool {
        while !bytes.is_empty() {
            let (mut coming, mut going) = self.stream.as_mut().unwrap().split();
            let mut logged = [0; 4096];
            // The server's bytes must be read at the same time, or the server would wait for this
            // client.
            tokio::select! {
                sent = going.write(bytes) => match sent {
                    Ok(sent) => bytes = &bytes[sent..],
                    Err(_) => return false,
                },
                read = coming.read(&mut logged) => match read {
                    Ok(0) | Err(_) => return false,
                    Ok(read) => self.receive(&logged[..read]),
                },
            }
        }
        true
    }

    pub(crate) async fn frame(&mut self, kind: u8, flags: u8, stream: u32, payload: &[u8]) -> bool {
        let length = u32::try_from(payload.len()).unwrap().to_be_bytes();
        let mut frame = [&length[1..], &[kind, flags]].concat();
        frame.extend_from_slice(&stream.to_be_bytes());
        frame.extend_from_slice(payload);
        if kind == DATA {
            let sent = i64::try_from(payload.len()).unwrap();
            self.window -= sent;
            *self.windows.entry(stream).or_default() -= sent;
        }
        self.bytes(&frame).await
    }

    /// Waits until the server accepts this many more bytes of a stream, or ends the stream or the
    /// connection.
    pub(crate) async fn room(&mut self, stream: u32, bytes: usize) {
        let bytes = i64::try_from(bytes).unwrap();
        let of = |raw: &Self| raw.initial + raw.windows.get(&stream).unwrap_or(&0);
        while of(self).min(self.window) < bytes && !self.is_reset(stream) {
            if !self.received().await {
                return;
            }
        }
    }

    /// Waits until the server has processed everything that was sent so far.
    pub(crate) async fn taken_in(&mut self) {
        let before = self.pongs;
        self.frame(PING, 0, 0, &[0; 8]).await;
        while self.pongs == before && self.received().await {}
    }

    /// Reads the server's next bytes. Returns `false` if the server ended the connection.
    pub(crate) async fn received(&mut self) -> bool {
        let mut logged = [0; 4096];
        match self.stream.as_mut().unwrap().read(&mut logged).await {
            Ok(0) | Err(_) => false,
            Ok(read) => {
                self.receive(&logged[..read]);
                true
            }
        }
    }

    pub(crate) fn is_answered(&self, stream: u32) -> bool {
        self.answered.contains(&stream)
    }

    pub(crate) fn is_reset(&self, stream: u32) -> bool {
        self.reset.contains(&stream)
    }

    /// Reads until the server ends the connection.
    pub(crate) async fn ended(&mut self) {
        let mut logged = [0; 4096];
        while self.stream.as_mut().unwrap().read(&mut logged).await.is_ok_and(|read| read > 0) {}
    }

    fn receive(&mut self, logged: &[u8]) {
        self.read.extend_from_slice(logged);
        while let Some((head, rest)) = self.read.split_at_checked(9) {
            let length = u32::from_be_bytes([0, head[0], head[1], head[2]]) as usize;
            let Some(payload) = rest.get(..length) else { return };
            let number = |of: &[u8]| u32::from_be_bytes(of.try_into().unwrap());
            let settings = payload.chunks_exact(6).find(|setting| setting[..2] == [0, 4]);
            match (head[3], number(&head[5..9])) {
                (SETTINGS, _) => {
                    self.is_greeted = true;
                    self.initial = settings.map_or(self.initial, |it| number(&it[2..]).into());
                }
                (PING, _) => self.pongs += 1,
                (WINDOW_UPDATE, 0) => self.window += i64::from(number(payload)),
                (WINDOW_UPDATE, stream) => {
                    *self.windows.entry(stream).or_default() += i64::from(number(payload));
                }
                (HEADERS, stream) => self.answered.push(stream),
                (RST_STREAM, stream) => self.reset.push(stream),
                _ => {}
            }
            self.read.drain(..9 + length);
        }
    }
}
