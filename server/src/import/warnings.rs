//! Warnings: kinds of things left out or changed, a line each, and so many at most.

use super::error::shown;

/// Kinds that are told. Names out of the file make kinds, so there may be very many.
const MOST_KINDS: usize = 100;
/// Longest text of a kind, in characters: a fault in brackets fits.
const KIND_CHARS: usize = 400;
const PLACE_CHARS: usize = 120;

/// Kinds in the order of their first mention. A file of ten thousand meshes that all lack the same
/// thing gives one line.
#[derive(Clone, Debug, Default)]
pub(super) struct Warnings {
    kinds: Vec<Kind>,
    /// Mentions of kinds beyond [`MOST_KINDS`].
    untold: u64,
}

#[derive(Clone, Debug)]
struct Kind {
    what: String,
    amount: u64,
    places: u64,
    first_place: String,
}

impl Warnings {
    /// Notes `amount` of `what` at `place`; nothing where the amount is 0.
    pub(super) fn add(&mut self, what: impl AsRef<str>, amount: u64, place: &str) {
        if amount > 0 {
            let what = shown(&what.as_ref(), KIND_CHARS);
            if let Some(kind) = self.place_for(&what, amount, 1) {
                *kind = shown(&place, PLACE_CHARS);
            }
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.kinds.is_empty()
    }

    /// Appends what another stage noted.
    pub(super) fn merge(&mut self, others: Warnings) {
        self.untold = self.untold.saturating_add(others.untold);
        for kind in others.kinds {
            if let Some(place) = self.place_for(&kind.what, kind.amount, kind.places) {
                *place = kind.first_place;
            }
        }
    }

    /// Counts; where the kind is new and is told, what to fill with its place.
    fn place_for(&mut self, what: &str, amount: u64, places: u64) -> Option<&mut String> {
        if let Some(known) = self.kinds.iter_mut().find(|kind| kind.what == what) {
            known.amount = known.amount.saturating_add(amount);
            known.places = known.places.saturating_add(places);
            return None;
        }
        if self.kinds.len() >= MOST_KINDS {
            self.untold = self.untold.saturating_add(places);
            return None;
        }
        self.kinds.push(Kind {
            what: what.to_owned(),
            amount,
            places,
            first_place: String::new(),
        });
        self.kinds.last_mut().map(|kind| &mut kind.first_place)
    }

    /// `triangles with a repeated index left out: 128 (at meshes[0].primitives[0])`
    pub(super) fn into_lines(self) -> Vec<String> {
        let line = |kind: &Kind| {
            let places = match kind.places {
                1 => format!("at {}", kind.first_place),
                places => format!("in {places} places, first at {}", kind.first_place),
            };
            format!("{}: {} ({places})", kind.what, kind.amount)
        };
        let mut lines: Vec<String> = self.kinds.iter().map(line).collect();
        if self.untold > 0 {
            lines.push(format!("and {} more warnings of other kinds", self.untold));
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_kinds_come_to_few_lines() {
        let mut all = Warnings::default();
        for part in 0..10 {
            let mut some = Warnings::default();
            for kind in 0..1000 {
                some.add(
                    format!("{part} {kind} {}", "x".repeat(10_000)),
                    1,
                    &"y".repeat(10_000),
                );
            }
            all.merge(some);
        }
        let lines = all.into_lines();
        assert_eq!(lines.len(), MOST_KINDS + 1);
        assert_eq!(lines[MOST_KINDS], "and 9900 more warnings of other kinds");
        let most = KIND_CHARS + PLACE_CHARS + 20;
        assert!(lines.iter().all(|line| line.chars().count() <= most));
    }
}
