#![no_main]

lodestream_fuzz::fuzz!(opened_scene);
