//! Leftovers and obstacles that only a library in a folder of this machine can have.

mod obstacles;
mod staged;
