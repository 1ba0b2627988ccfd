#![no_main]

lodestream_fuzz::fuzz!(mesh_build);
