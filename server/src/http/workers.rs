//! Threads that serve connections, each with a runtime of its own: a connection stays on the thread that it was given to, in turn. What a
//! page costs is mostly the kernel's; a runtime that moves tasks between threads adds wake-ups of the other one to it.

use std::io;
use std::thread::JoinHandle;

use tokio::runtime::{Builder, Runtime};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};

/// Threads beside each that wait for the disk. More do not make it faster, and each keeps memory of
/// its own.
const BLOCKING_THREADS: usize = 32;

/// Begins to serve a connection; called on its thread, within its runtime.
type Begin = Box<dyn FnOnce() + Send>;

/// The threads; they end, with what they serve, when this is dropped.
#[derive(Debug)]
pub(super) struct Workers {
    workers: Vec<Worker>,
    next: usize,
}

#[derive(Debug)]
struct Worker {
    connections: Option<UnboundedSender<Begin>>,
    thread: Option<JoinHandle<()>>,
}

impl Workers {
    /// Starts `threads` of them.
    pub(super) fn start(threads: usize) -> io::Result<Self> {
        let workers = (0..threads).map(|number| {
            let runtime = Builder::new_current_thread()
                .enable_all()
                .max_blocking_threads(BLOCKING_THREADS)
                .build()?;
            let (connections, receiver) = unbounded_channel();
            let thread = std::thread::Builder::new().name(format!("serve {number}"));
            Ok(Worker {
                connections: Some(connections),
                thread: Some(thread.spawn(move || serve(&runtime, receiver))?),
            })
        });
        Ok(Self {
            workers: workers.collect::<io::Result<_>>()?,
            next: 0,
        })
    }

    /// Gives a connection to the next thread.
    pub(super) fn give(&mut self, begin: impl FnOnce() + Send + 'static) {
        self.next = (self.next + 1) % self.workers.len().max(1);
        let worker = self.workers.get(self.next);
        if let Some(connections) = worker.and_then(|worker| worker.connections.as_ref()) {
            // A thread that is gone panicked, and said so; its connections end.
            let _ = connections.send(Box::new(begin));
        }
    }
}

fn serve(runtime: &Runtime, mut connections: UnboundedReceiver<Begin>) {
    runtime.block_on(async {
        while let Some(begin) = connections.recv().await {
            begin();
        }
    });
}

impl Drop for Workers {
    fn drop(&mut self) {
        for worker in &mut self.workers {
            worker.connections = None;
        }
        for worker in &mut self.workers {
            if let Some(thread) = worker.thread.take() {
                // A panic was told when it happened.
                let _ = thread.join();
            }
        }
    }
}
