//! Twin of `restore`, `restore_normals` and `transcode` together: a page's memory form from its disk form and its parents.

pub use lodestream_format::disk_form::memory_form as transcode;
