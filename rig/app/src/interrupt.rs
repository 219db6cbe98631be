//! Ctrl-C and SIGTERM: the first one asks for an orderly end, and a second Ctrl-C ends at once. Any number of SIGTERM are one: whoever
//! stops a rig may say so twice, and the safe stop is not cut short by that.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

use super::Failure;
use super::failure::INTERRUPTED;

/// Carries out `work`, which is told of signals by its argument.
///
/// # Errors
/// What `work` gives; [`Failure::Internal`] when the system lets nobody listen.
pub fn interruptible<T>(work: impl AsyncFnOnce(&Interrupt) -> Result<T, Failure>) -> Result<T, Failure> {
    let runtime = tokio::runtime::Runtime::new().map_err(Failure::internal)?;
    runtime.block_on(async { work(&Interrupt::listen().map_err(Failure::internal)?).await })
}

/// Listens for as long as its runtime lives.
#[derive(Debug, Clone)]
pub struct Interrupt {
    flag: Arc<AtomicBool>,
    receiver: watch::Receiver<bool>,
}

impl Interrupt {
    /// Begins to listen; must be called within a tokio runtime.
    ///
    /// # Errors
    /// When the system does not let a handler be set.
    pub fn listen() -> std::io::Result<Self> {
        let mut int = signal(SignalKind::interrupt())?;
        let mut term = signal(SignalKind::terminate())?;
        let flag = Arc::new(AtomicBool::new(false));
        let (sender, receiver) = watch::channel(false);
        let raised = Arc::clone(&flag);
        tokio::spawn(async move {
            loop {
                let at_once = tokio::select! {
                    _ = int.recv() => true,
                    _ = term.recv() => false,
                };
                if raised.swap(true, Ordering::Relaxed) && at_once {
                    // The board's dead-man stops what still moves.
                    std::process::exit(INTERRUPTED.into());
                }
                let _ = sender.send(true);
            }
        });
        Ok(Self { flag, receiver })
    }

    /// Becomes true with the first signal.
    pub fn flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.flag)
    }

    /// Resolves with the first signal.
    pub async fn raised(&self) {
        let mut receiver = self.receiver.clone();
        if receiver.wait_for(|&raised| raised).await.is_err() {
            std::future::pending::<()>().await;
        }
    }

    /// Whether a signal has come.
    pub fn is_raised(&self) -> bool {
        self.flag.load(Ordering::Relaxed)
    }
}
