//! Virtual viewers on the CPU twins: eviction policies, traces and server load without a GPU; sample scenes; pictures
//! compared; one report of it all.

pub mod build;
pub mod compare;
pub mod load;
pub mod pages;
pub mod percentiles;
pub mod policies;
pub mod record;
pub mod report;
pub mod samples;
pub mod viewer;
