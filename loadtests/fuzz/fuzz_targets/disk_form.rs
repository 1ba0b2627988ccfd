#![no_main]

lodestream_fuzz::fuzz!(disk_form);
