//! Builders held against each other and against the truth.
//!
//! `inputs` and files (`target`) are built and timed in turns (`rows`, `study`), memory in a process of its own (`memory`).
//! Both builders' results become one shape (`dag`), which is measured (`distance`, `edges`, `curves`, `groups`); so is what a library holds (`stored`).
//! Single stages are held against what libraries offer for them (`libraries`).

pub mod clusterlod;
pub mod curves;
pub mod dag;
pub mod distance;
pub mod edges;
pub mod groups;
pub mod inputs;
pub mod knobs;
pub mod libraries;
pub mod memory;
pub mod print;
pub mod process;
pub mod rows;
pub mod stability;
pub mod stored;
pub mod study;
pub mod target;
