//! The life of a page, in one place: every state, every event, one transition function.
//!
//! ```text
//!          Want            Issue             Arrive            Place             Install
//! Absent --------> Wanted --------> InFlight --------> Decoded --------> Resident --------> Installed
//!   ^  ^             |  ^             |  |                | ^                                  |
//!   |  +---Forget----+  +--Retry--+   |  +--Fail--+       | |                                  |
//!   |                             |   |           v       | |                                  |
//!   |                             +---|------- Failed     | |                                  |
//!   +-------------Cancel--------------+                   | |                                  |
//!   +-------------Drop------------------------------------+ |                                  |
//!   +-------------Evict----------------------------------------------------------------------- +
//!   +-------------Open (root pages, which never leave)------+
//! ```

/// Where a page is on its way into the picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum PageState {
    /// Nothing is known or asked.
    #[default]
    Absent,
    /// The camera wants it and it waits for its turn.
    Wanted,
    /// A fetch that holds it is under way.
    InFlight,
    /// Its checked disk form lies in host memory and waits for its dependencies and a slot.
    Decoded,
    /// It has a slot; its upload is on the way.
    Resident,
    /// Culling may use it: the page table points at it.
    Installed,
    /// Its last fetch failed; it may be asked for again from then on.
    Failed {
        /// Seconds on the residency's clock.
        retry_at_secs: f64,
        /// Failures in a row.
        attempts: u32,
    },
}

/// What can happen to a page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PageEvent {
    /// The camera wants it.
    Want,
    /// The camera no longer wants it, and nothing was sent.
    Forget,
    /// A fetch was handed out.
    Issue,
    /// Its fetch was called off.
    Cancel,
    /// Its disk form came and passed every check.
    Arrive,
    /// Its fetch failed.
    Fail {
        /// When to try again, seconds.
        retry_at_secs: f64,
        /// Failures in a row.
        attempts: u32,
    },
    /// The back-off is over and it is still wanted.
    Retry,
    /// It came with the scene.
    Open,
    /// It got a slot.
    Place,
    /// The page table points at it.
    Install,
    /// It came too late to be of use.
    Drop,
    /// Its slot goes to another page.
    Evict,
}

/// An event that makes no sense in a state: a fault in this program, never in its input.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("page state {state:?}: expected an event that it allows, found {event:?}")]
pub struct IllegalTransition {
    /// The state, which stays.
    pub state: PageState,
    /// The event.
    pub event: PageEvent,
}

impl PageState {
    /// The state after `event`.
    pub fn after(self, event: PageEvent) -> Result<PageState, IllegalTransition> {
        use PageEvent as E;
        use PageState as S;
        match (self, event) {
            (S::Absent, E::Want) | (S::Failed { .. }, E::Retry) => Ok(S::Wanted),
            (S::Wanted, E::Forget) | (S::InFlight, E::Cancel) => Ok(S::Absent),
            (S::Decoded, E::Drop) | (S::Installed, E::Evict) => Ok(S::Absent),
            (S::Wanted, E::Issue) => Ok(S::InFlight),
            (S::InFlight, E::Arrive) | (S::Absent, E::Open) => Ok(S::Decoded),
            (
                S::InFlight,
                E::Fail {
                    retry_at_secs,
                    attempts,
                },
            ) => Ok(S::Failed {
                retry_at_secs,
                attempts,
            }),
            (S::Decoded, E::Place) => Ok(S::Resident),
            (S::Resident, E::Install) => Ok(S::Installed),
            (state, event) => Err(IllegalTransition { state, event }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAIL: PageEvent = PageEvent::Fail {
        retry_at_secs: 1.0,
        attempts: 1,
    };
    const FAILED: PageState = PageState::Failed {
        retry_at_secs: 1.0,
        attempts: 1,
    };

    #[test]
    fn just_the_arrows_of_the_diagram_exist() {
        use PageEvent as E;
        use PageState as S;
        let states = [
            S::Absent,
            S::Wanted,
            S::InFlight,
            S::Decoded,
            S::Resident,
            S::Installed,
            FAILED,
        ];
        let events = [
            E::Want,
            E::Forget,
            E::Issue,
            E::Cancel,
            E::Arrive,
            FAIL,
            E::Retry,
            E::Open,
            E::Place,
            E::Install,
            E::Drop,
            E::Evict,
        ];
        let arrows = [
            (S::Absent, E::Want, S::Wanted),
            (S::Absent, E::Open, S::Decoded),
            (S::Wanted, E::Forget, S::Absent),
            (S::Wanted, E::Issue, S::InFlight),
            (S::InFlight, E::Cancel, S::Absent),
            (S::InFlight, E::Arrive, S::Decoded),
            (S::InFlight, FAIL, FAILED),
            (FAILED, E::Retry, S::Wanted),
            (S::Decoded, E::Place, S::Resident),
            (S::Decoded, E::Drop, S::Absent),
            (S::Resident, E::Install, S::Installed),
            (S::Installed, E::Evict, S::Absent),
        ];
        for state in states {
            for event in events {
                let arrow = arrows
                    .iter()
                    .find(|(from, by, _)| *from == state && *by == event);
                let expected = arrow
                    .map(|&(_, _, to)| to)
                    .ok_or(IllegalTransition { state, event });
                assert_eq!(state.after(event), expected);
            }
        }
    }
}
