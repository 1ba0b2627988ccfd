#![no_main]

lodestream_fuzz::fuzz!(memory_form);
