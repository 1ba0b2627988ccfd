//! Sample scenes, made in code: a city of instances and a fractal rock.
//!
//! They need no download, say nothing about anyone else's work (CC0), and are the same bytes on every machine.

mod city;
mod crowd;
mod glb;
pub(crate) mod noise;
pub(crate) mod number;
mod rock;
mod surface;
mod textures;

pub use city::city;
pub use crowd::crowd;
pub use glb::{Glb, SampleError};
pub use rock::rock;
