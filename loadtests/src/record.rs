//! `record`: a camera path becomes a trace of page references, for `policies` and for other cache simulators.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use lodestream_client::path::CameraPath;
use lodestream_client::stream::OpenedScene;
use lodestream_client::trace::{Trace, TraceError, TraceFrame, TraceHeader, TraceWriter};
use rayon::prelude::*;

use crate::viewer::ViewedScene;

/// How a trace is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum TraceFormat {
    /// JSON lines with priorities and dependencies: what `policies` reads.
    Lodestream,
    /// Records of 24 bytes that libCacheSim and its like read: little-endian `u32` time in seconds, `u64` page, `u32` bytes,
    /// `i64` index of the page's next record, or -1.
    OracleGeneral,
    /// `time,obj_id,obj_size` with a heading.
    Csv,
}

/// Why a trace could not be made.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// A path whose frames are not a whole number a second.
    #[error("fps: expected a whole number of frames a second from 1 to 4294967295, found {0}")]
    Fps(f64),
    /// A file that cannot be read or written.
    #[error("{file}: {source}")]
    File {
        /// The file.
        file: PathBuf,
        /// What went wrong.
        source: TraceError,
    },
}

/// Walks `path` at its fixed steps with nothing resident: every page of every level that its pixel error asks for.
///
/// # Errors
/// [`RecordError::Fps`] where the trace's header cannot hold the path's speed.
pub fn record(
    name: &str,
    scene: &OpenedScene,
    path: &CameraPath,
    pixel_error_px: f32,
) -> Result<Trace, RecordError> {
    let whole = path.fps.fract() == 0.0 && (1.0..=u32::MAX as f64).contains(&path.fps);
    if !whole {
        return Err(RecordError::Fps(path.fps));
    }
    let viewed = ViewedScene::new(scene);
    let frames = (0..path.frames).into_par_iter().map(|frame| {
        let requests = viewed.requests(&path.camera(frame), pixel_error_px);
        TraceFrame::new(frame, &requests)
    });
    Ok(Trace {
        header: TraceHeader::of(name, scene, path.fps as u32),
        frames: frames.collect(),
    })
}

/// Reads a trace of the format `lodestream`.
///
/// # Errors
/// [`RecordError::File`] with the file and, where its content is wrong, the line.
pub fn read(file: &Path) -> Result<Trace, RecordError> {
    let wrong = |source| RecordError::File {
        file: file.to_owned(),
        source,
    };
    let input = File::open(file).map_err(|error| wrong(error.into()))?;
    Trace::read(std::io::BufReader::new(input)).map_err(wrong)
}

/// Writes a trace.
///
/// # Errors
/// [`RecordError::File`] with the file.
pub fn write_file(trace: &Trace, format: TraceFormat, file: &Path) -> Result<(), RecordError> {
    let wrong = |source| RecordError::File {
        file: file.to_owned(),
        source,
    };
    let output = File::create(file).map_err(|error| wrong(error.into()))?;
    write(trace, format, BufWriter::new(output)).map_err(wrong)
}

/// Writes a trace into anything.
///
/// # Errors
/// What the output says.
pub fn write(trace: &Trace, format: TraceFormat, mut output: impl Write) -> Result<(), TraceError> {
    match format {
        TraceFormat::Lodestream => {
            let mut writer = TraceWriter::new(output, &trace.header)?;
            for frame in &trace.frames {
                writer.frame(frame)?;
            }
            return writer.finish();
        }
        TraceFormat::OracleGeneral => {
            let references = references(trace);
            for (reference, next) in references.iter().zip(next_references(&references)) {
                output.write_all(&reference.secs.to_le_bytes())?;
                output.write_all(&u64::from(reference.page).to_le_bytes())?;
                output.write_all(&reference.bytes.to_le_bytes())?;
                output.write_all(&next.to_le_bytes())?;
            }
        }
        TraceFormat::Csv => {
            output.write_all(b"time,obj_id,obj_size\n")?;
            for Reference { secs, page, bytes } in references(trace) {
                writeln!(output, "{secs},{page},{bytes}")?;
            }
        }
    }
    Ok(output.flush()?)
}

/// A page that one frame wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Reference {
    secs: u32,
    page: u32,
    /// On the wire.
    bytes: u32,
}

/// All references in order: frame by frame, most urgent first. Root pages are left out: no cache ever decides on them.
fn references(trace: &Trace) -> Vec<Reference> {
    let fps = trace.header.fps.max(1);
    let of_frame = |frame: &TraceFrame| {
        let secs = frame.frame / fps;
        let pages = frame.requests.iter().map(|&(page, ..)| page);
        let pages = pages.filter(|&page| !trace.header.pages[page as usize].root);
        let bytes = |page: u32| trace.header.pages[page as usize].bytes;
        pages
            .map(|page| Reference {
                secs,
                page,
                bytes: bytes(page),
            })
            .collect::<Vec<_>>()
    };
    trace.frames.iter().flat_map(of_frame).collect()
}

/// For each reference the index of the next one of the same page, or -1.
fn next_references(references: &[Reference]) -> Vec<i64> {
    let pages = references
        .iter()
        .map(|reference| reference.page as usize + 1)
        .max()
        .unwrap_or(0);
    let mut upcoming = vec![-1i64; pages];
    let mut next = vec![-1i64; references.len()];
    for (index, reference) in references.iter().enumerate().rev() {
        next[index] = std::mem::replace(&mut upcoming[reference.page as usize], index as i64);
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_client::trace::{TRACE_VERSION, TracePage};

    fn trace() -> Trace {
        let page = |root, bytes| TracePage {
            bytes,
            memory_words: 8,
            root,
            dependencies: vec![],
        };
        let header = TraceHeader {
            version: TRACE_VERSION,
            scene: "by hand".into(),
            fps: 2,
            pages: vec![page(true, 10), page(false, 300), page(false, 70_000)],
        };
        let frame = |frame, pages: &[u32]| TraceFrame {
            frame,
            requests: pages.iter().map(|&page| (page, 4.0, 8.0)).collect(),
        };
        Trace {
            header,
            frames: vec![
                frame(0, &[0, 1]),
                frame(1, &[2, 1]),
                frame(2, &[]),
                frame(3, &[0, 2]),
            ],
        }
    }

    fn written(format: TraceFormat) -> Vec<u8> {
        let mut bytes = Vec::new();
        assert!(write(&trace(), format, &mut bytes).is_ok());
        bytes
    }

    #[test]
    fn csv_is_exact() {
        let expected = "time,obj_id,obj_size\n0,1,300\n0,2,70000\n0,1,300\n1,2,70000\n";
        assert_eq!(
            String::from_utf8_lossy(&written(TraceFormat::Csv)),
            expected
        );
    }

    #[test]
    fn oracle_general_is_exact() {
        let bytes = written(TraceFormat::OracleGeneral);
        assert_eq!(bytes.len(), 4 * 24);
        // time 0, page 2, 70000 = 0x11170 bytes, next at record 3.
        let second = [
            0u8, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0x70, 0x11, 1, 0, 3, 0, 0, 0, 0, 0, 0, 0,
        ];
        assert_eq!(bytes[24..48], second);
        let next: Vec<i64> = bytes
            .chunks_exact(24)
            .map(|record| i64::from_le_bytes(std::array::from_fn(|byte| record[16 + byte])))
            .collect();
        assert_eq!(next, [2, 3, -1, -1]);
        assert_eq!(bytes[72..76], 1u32.to_le_bytes());
    }

    #[test]
    fn the_own_format_comes_back() {
        let back = Trace::read(written(TraceFormat::Lodestream).as_slice());
        assert_eq!(back.ok(), Some(trace()));
    }
}
