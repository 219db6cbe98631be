//! Bytes that wait for the host.

const ROOM: usize = 1024;

/// A ring that takes packets whole or not at all.
pub struct Queue {
    bytes: [u8; ROOM],
    first: usize,
    length: usize,
}

impl Queue {
    pub fn new() -> Self {
        Self { bytes: [0; ROOM], first: 0, length: 0 }
    }

    /// All of `bytes` or, where there is no room, nothing: the host asks again.
    pub fn put_whole(&mut self, bytes: &[u8]) {
        if bytes.len() > ROOM - self.length {
            return;
        }
        for &byte in bytes {
            self.bytes[(self.first + self.length) % ROOM] = byte;
            self.length += 1;
        }
    }

    /// The next of them, as many as lie together.
    pub fn next_bytes(&self) -> &[u8] {
        let end = (self.first + self.length).min(ROOM);
        &self.bytes[self.first..end]
    }

    /// Forgets the first `count`.
    pub fn drop_first(&mut self, count: usize) {
        self.first = (self.first + count) % ROOM;
        self.length -= count;
    }
}
