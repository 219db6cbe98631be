//! A camera in another process of this machine: `rig mock-camera` serves its images on a Unix socket.
//!
//! The client sends its [`CameraConfig`] as JSON, the server answers with [`CameraInfo`] or a refusal, both behind a
//! 32-bit little-endian length; then images follow as in [`super::wire`] for as long as the connection stands. Stamps are
//! CLOCK_MONOTONIC, the same for all processes. One client at a time.

use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{Camera, CameraConfig, CameraError, CameraImage, CameraInfo, wire};

/// Name of the socket in the tank's folder.
pub const SOCKET_NAME: &str = "camera.sock";

/// How long a greeting is awaited, chosen; while one client is served, others wait in vain.
const GREETING_TIMEOUT: Duration = Duration::from_secs(3);
/// Longest greeting that is accepted \[bytes\], chosen.
const MAX_GREETING_BYTES: usize = 1 << 16;

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Answer {
    Info(CameraInfo),
    Refused(String),
}

/// The client's side.
pub struct SocketCamera {
    info: CameraInfo,
    path: PathBuf,
    config: CameraConfig,
    stream: Option<UnixStream>,
    /// Bytes of a message that has not come whole yet.
    pending: Vec<u8>,
}

impl SocketCamera {
    /// Connects to the mock camera in the tank's folder that `config` names, relative to `folder`, and sets it up.
    ///
    /// # Errors
    /// [`CameraError::Refused`] when nobody listens there or the camera refuses.
    pub fn open(config: &CameraConfig, folder: &Path) -> Result<Self, CameraError> {
        let tank = config.tank.as_ref().ok_or_else(|| config.missing("tank"))?;
        let path = folder.join(tank).join(SOCKET_NAME);
        let (stream, info) = connect(&path, config)?;
        Ok(Self { info, path, config: config.clone(), stream: Some(stream), pending: Vec::new() })
    }

    /// Reads until `wanted` bytes are pending.
    fn fill(&mut self, wanted: usize, deadline: Instant, timeout: Duration) -> Result<(), CameraError> {
        let camera = || self.info.name.clone();
        let Some(stream) = &mut self.stream else {
            return Err(CameraError::Refused {
                camera: camera(),
                what: "was asked for images before it was started".into(),
            });
        };
        let mut got = self.pending.len();
        self.pending.resize(wanted.max(got), 0);
        let result = loop {
            if got >= wanted {
                break Ok(());
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break Err(CameraError::Stalled { camera: camera(), waited_ms: timeout.as_millis() as u64 });
            }
            match stream.set_read_timeout(Some(left)).and_then(|()| stream.read(&mut self.pending[got..])) {
                Ok(0) => break Err(CameraError::Gone { camera: camera() }),
                Ok(count) => got += count,
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                    ) => {}
                Err(_) => break Err(CameraError::Gone { camera: camera() }),
            }
        };
        self.pending.truncate(got);
        result
    }
}

impl Camera for SocketCamera {
    fn info(&self) -> &CameraInfo {
        &self.info
    }

    fn start(&mut self) -> Result<(), CameraError> {
        if self.stream.is_none() {
            let (stream, info) = connect(&self.path, &self.config)?;
            self.stream = Some(stream);
            self.info = info;
        }
        self.pending.clear();
        let stream = self.stream.as_mut();
        stream
            .map_or(Ok(()), |stream| stream.write_all(b"s"))
            .map_err(|_| CameraError::Gone { camera: self.info.name.clone() })
    }

    fn next_image(&mut self, timeout: Duration) -> Result<CameraImage, CameraError> {
        let deadline = Instant::now() + timeout;
        self.fill(wire::HEADER_BYTES, deadline, timeout)?;
        let damaged = |error: wire::WireError| CameraError::Refused {
            camera: self.info.name.clone(),
            what: format!("{error}; both sides must be the same version of rig"),
        };
        let Some(header) = self.pending.first_chunk() else {
            return Err(CameraError::Gone { camera: self.info.name.clone() });
        };
        let (image, length) = wire::read_header(header).map_err(damaged)?;
        self.fill(wire::HEADER_BYTES + length, deadline, timeout)?;
        let data = self.pending.split_off(wire::HEADER_BYTES);
        self.pending.clear();
        Ok(CameraImage { data, ..image })
    }

    fn stop(&mut self) {
        self.stream = None;
    }
}

fn connect(path: &Path, config: &CameraConfig) -> Result<(UnixStream, CameraInfo), CameraError> {
    let refused = |what: String| CameraError::Refused { camera: path.display().to_string(), what };
    let mut stream = UnixStream::connect(path).map_err(|error| {
        refused(format!("connecting: {error}; start `rig mock-camera --tank` on that tank's folder first"))
    })?;
    let greeting = send(&mut stream, config).and_then(|()| receive(&mut stream));
    match greeting {
        Ok(Answer::Info(info)) => Ok((stream, info)),
        Ok(Answer::Refused(what)) => Err(refused(what)),
        Err(error) => Err(refused(format!(
            "no greeting within {} s ({error}); is another run using it?",
            GREETING_TIMEOUT.as_secs()
        ))),
    }
}

fn send(stream: &mut UnixStream, value: &impl Serialize) -> std::io::Result<()> {
    let json = serde_json::to_vec(value)?;
    stream.set_write_timeout(Some(GREETING_TIMEOUT))?;
    stream.write_all(&(json.len() as u32).to_le_bytes())?;
    stream.write_all(&json)
}

fn receive<T: DeserializeOwned>(stream: &mut UnixStream) -> std::io::Result<T> {
    stream.set_read_timeout(Some(GREETING_TIMEOUT))?;
    let mut length = [0; 4];
    stream.read_exact(&mut length)?;
    let length = u32::from_le_bytes(length) as usize;
    if length > MAX_GREETING_BYTES {
        return Err(std::io::Error::new(ErrorKind::InvalidData, format!("greeting of {length} bytes")));
    }
    let mut json = vec![0; length];
    stream.read_exact(&mut json)?;
    Ok(serde_json::from_slice(&json)?)
}

/// Listens in the tank's folder; a socket that a killed server left behind is replaced.
///
/// # Errors
/// What the system says, also when another server listens there.
pub fn listen(tank: &Path) -> std::io::Result<UnixListener> {
    let path = tank.join(SOCKET_NAME);
    if UnixStream::connect(&path).is_ok() {
        return Err(std::io::Error::new(ErrorKind::AddrInUse, "another mock camera serves this tank"));
    }
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    UnixListener::bind(&path)
}

/// Serves one client, until it goes or the camera ends: `open` makes the camera that the client asks for.
///
/// # Errors
/// What the camera failed with; a client that goes away is no error.
pub fn serve<C: Camera>(
    mut client: UnixStream,
    open: impl FnOnce(&CameraConfig) -> Result<C, CameraError>,
) -> Result<(), CameraError> {
    let Ok(config) = receive::<CameraConfig>(&mut client) else { return Ok(()) };
    let mut camera = match open(&config) {
        Ok(camera) => camera,
        Err(error) => {
            let _ = send(&mut client, &Answer::Refused(error.to_string()));
            return Err(error);
        }
    };
    if send(&mut client, &Answer::Info(camera.info().clone())).is_err() {
        return Ok(());
    }
    // The client says when to start, and may take its time; it goes by closing.
    let mut start = [0];
    let untimed = client.set_read_timeout(None).and_then(|()| client.set_write_timeout(None));
    if untimed.is_err() || client.read_exact(&mut start).is_err() {
        return Ok(());
    }
    camera.start()?;
    let result = loop {
        match camera.next_image(config.stall()) {
            Ok(image) => {
                let sent =
                    client.write_all(&wire::header(&image)).and_then(|()| client.write_all(&image.data));
                if sent.is_err() {
                    break Ok(());
                }
            }
            // A stalled camera is silent: the client notices by itself, and goes.
            Err(CameraError::Stalled { .. }) => {
                let brief = client.set_read_timeout(Some(Duration::from_millis(1)));
                if brief.is_err() || client.read(&mut start).is_ok_and(|count| count == 0) {
                    break Ok(());
                }
            }
            Err(error) => break Err(error),
        }
    };
    camera.stop();
    result
}

#[cfg(test)]
mod tests;
