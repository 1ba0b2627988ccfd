//! What was left out or changed, one line a kind.

use std::collections::HashMap;

use super::error::one_line;

/// Kinds in the order of their first mention. A file of ten thousand meshes that all lack the same thing gives one line.
#[derive(Clone, Debug, Default)]
pub(super) struct Warnings {
    kinds: Vec<Kind>,
    /// Names out of the file make kinds, so there may be very many.
    at: HashMap<String, usize>,
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
    pub(super) fn add(&mut self, what: impl Into<String>, amount: u64, place: &str) {
        if amount > 0 {
            self.note(Kind {
                what: what.into(),
                amount,
                places: 1,
                first_place: place.to_owned(),
            });
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.kinds.is_empty()
    }

    /// Appends what another stage noted.
    pub(super) fn merge(&mut self, others: Warnings) {
        for kind in others.kinds {
            self.note(kind);
        }
    }

    fn note(&mut self, new: Kind) {
        if let Some(&at) = self.at.get(&new.what) {
            self.kinds[at].amount += new.amount;
            self.kinds[at].places += new.places;
        } else {
            self.at.insert(new.what.clone(), self.kinds.len());
            self.kinds.push(new);
        }
    }

    /// `triangles with a repeated index left out: 128 (first at meshes[0].primitives[0])`
    pub(super) fn into_lines(self) -> Vec<String> {
        let line = |kind: &Kind| {
            let places = match kind.places {
                1 => format!("at {}", kind.first_place),
                places => format!("in {places} places, first at {}", kind.first_place),
            };
            one_line(&format!("{}: {} ({places})", kind.what, kind.amount))
        };
        self.kinds.iter().map(line).collect()
    }
}
