//! A browser's and an attacker's way to a server: requests written out byte by byte.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// An answer.
#[derive(Debug)]
pub struct Answer {
    /// Its status.
    pub status: u16,
    /// Its headers, as they came.
    pub head: String,
    /// Its body.
    pub body: String,
}

impl Answer {
    /// The body as JSON.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error}: {}", self.body))
    }
}

/// Sends `method path` with the lines `head`, each ended by `\r\n`, and `body`; reads the answer to its end.
pub fn ask(address: SocketAddr, method: &str, path: &str, head: &str, body: &str) -> Answer {
    let mut stream = TcpStream::connect(address).expect("the server listens");
    stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a timeout");
    let length = if body.is_empty() { String::new() } else { format!("Content-Length: {}\r\n", body.len()) };
    let request = format!("{method} {path} HTTP/1.1\r\n{head}{length}Connection: close\r\n\r\n{body}");
    // a server may answer and close before it has read all
    let _ = stream.write_all(request.as_bytes());
    let answer = String::from_utf8_lossy(&read(&mut BufReader::new(stream))).into_owned();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((&answer, ""));
    let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
    Answer { status, head: head.to_ascii_lowercase(), body: unchunked(head, body) }
}

/// An answer as it came: as long as it says, for not every server hangs up then, or to its end.
fn read(stream: &mut impl BufRead) -> Vec<u8> {
    let (mut answer, mut length) = (Vec::new(), None);
    loop {
        let begun = answer.len();
        // what a server has cut off is all that there is
        if stream.read_until(b'\n', &mut answer).unwrap_or(0) == 0 {
            return answer;
        }
        let line = String::from_utf8_lossy(&answer[begun..]).to_ascii_lowercase();
        if let Some(said) = line.strip_prefix("content-length:") {
            length = said.trim().parse::<u64>().ok();
        }
        if line.trim().is_empty() {
            let _ = stream.take(length.unwrap_or(u64::MAX)).read_to_end(&mut answer);
            return answer;
        }
    }
}

fn unchunked(head: &str, body: &str) -> String {
    if !head.to_ascii_lowercase().contains("transfer-encoding: chunked") {
        return body.into();
    }
    let (mut rest, mut whole) = (body, String::new());
    while let Some((size, after)) = rest.split_once("\r\n") {
        let size = usize::from_str_radix(size.trim(), 16).unwrap_or(0);
        if size == 0 || after.len() < size {
            break;
        }
        whole.push_str(&after[..size]);
        rest = after[size..].trim_start_matches("\r\n");
    }
    whole
}

/// Server-sent events as they come.
#[derive(Debug)]
pub struct Events(BufReader<TcpStream>);

impl Events {
    /// Listens at `path`.
    pub fn listen(address: SocketAddr, path: &str) -> Self {
        let mut stream = TcpStream::connect(address).expect("the server listens");
        stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a timeout");
        write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n").expect("a request");
        Self(BufReader::new(stream))
    }

    /// The next event's data, as JSON.
    pub fn wait(&mut self) -> serde_json::Value {
        self.next_in_time().expect("an event")
    }

    /// The same; nothing where none comes for half a minute, or the server has closed the stream.
    pub fn next_in_time(&mut self) -> Option<serde_json::Value> {
        loop {
            let mut line = String::new();
            self.0.read_line(&mut line).ok().filter(|&read| read > 0)?;
            if let Some(data) = line.strip_prefix("data: ") {
                return Some(serde_json::from_str(data).unwrap_or_else(|error| panic!("{error}: {data}")));
            }
        }
    }
}
