//! Eviction policies against each other: the same trace through the real residency, once a policy and pool.
//!
//! ```text
//! trace (a viewer's wants, frame by frame) -> replay (residency, link, simulated time) -> study (figures, page)
//! ```
//!
//! `fifo`, `clock` and `clairvoyant` stand beside the client's own policies.

mod clairvoyant;
mod clock;
mod fifo;
mod link;
mod replay;
mod study;
mod study_page;

pub use clairvoyant::{Clairvoyant, Future, Recorder};
pub use clock::Clock;
pub use fifo::Fifo;
pub use link::{Link, LinkSpeed};
pub use replay::{MOST_ERROR_PX, Order, Outcome, ReplayOptions, SimulatedPage, replay};
pub use study::{Run, Study, StudyOptions, TraceFigures, study};
pub use study_page::page;

use lodestream_client::stream::{DecayedError, EvictionPolicy, LowestError, Lru};

/// A policy of a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum PolicyName {
    /// What was wanted longest ago leaves.
    Lru,
    /// What removed the smallest error leaves.
    LowestError,
    /// The client's default: error, halved with age.
    DecayedError,
    /// What was installed longest ago leaves.
    Fifo,
    /// LRU approximated with one bit a page.
    Clock,
    /// Knows the future: the bound.
    Clairvoyant,
}

impl PolicyName {
    /// Every policy, the bound last.
    pub const ALL: [Self; 6] = [
        Self::Lru,
        Self::LowestError,
        Self::DecayedError,
        Self::Fifo,
        Self::Clock,
        Self::Clairvoyant,
    ];

    /// A fresh policy of the name, over a trace whose wants are `future`.
    pub fn build(self, future: &Future) -> Box<dyn EvictionPolicy> {
        match self {
            Self::Lru => Box::new(Lru),
            Self::LowestError => Box::new(LowestError),
            Self::DecayedError => Box::new(DecayedError::default()),
            Self::Fifo => Box::new(Fifo::default()),
            Self::Clock => Box::new(Clock::default()),
            Self::Clairvoyant => Box::new(Clairvoyant::new(future.clone())),
        }
    }
}
