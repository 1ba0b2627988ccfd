#![no_main]

lodestream_fuzz::fuzz!(post);
