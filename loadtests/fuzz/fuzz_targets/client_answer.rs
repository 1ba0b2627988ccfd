#![no_main]

lodestream_fuzz::fuzz!(client_answer);
