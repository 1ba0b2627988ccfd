//! Builders held against each other and against the truth.

pub mod inputs;
