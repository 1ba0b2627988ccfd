//! Traces: which pages a viewer wanted, frame by frame. A trace replays without a server, a scene or a GPU.
//!
//! JSON lines. The first is a [`TraceHeader`], each following one a [`TraceFrame`].

use std::io::{BufRead, Write};

use serde::{Deserialize, Serialize};

use crate::stream::{OpenedScene, StreamingRequest};

/// Version that [`TraceHeader::version`] has to name.
pub const TRACE_VERSION: u32 = 2;

/// What a replay has to know about the pages; scene-wide numbers throughout.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TraceHeader {
    /// [`TRACE_VERSION`].
    pub version: u32,
    /// Name of the scene.
    pub scene: String,
    /// Frames a second of the camera path.
    pub fps: u32,
    /// Pages.
    pub pages: Vec<TracePage>,
}

/// A page as a replay sees it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TracePage {
    /// Bytes on the wire.
    pub bytes: u32,
    /// Words of the memory form.
    pub memory_words: u32,
    /// Whether it is a root page.
    pub root: bool,
    /// Scene-wide pages that it depends on.
    pub dependencies: Vec<u32>,
}

/// One frame's requests.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TraceFrame {
    /// Number of the frame.
    pub frame: u32,
    /// Pages wanted, most urgent first: page, largest projected error and sum of the projected
    /// errors over groups and instances, both in pixels.
    pub requests: Vec<(u32, f32, f32)>,
}

/// A whole trace.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// The pages.
    pub header: TraceHeader,
    /// The frames in order.
    pub frames: Vec<TraceFrame>,
}

/// A trace that cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// The file or pipe failed.
    #[error("trace: {0}")]
    Io(#[from] std::io::Error),
    /// A line is not what it has to be.
    #[error("trace line {line}: expected {expected}, found {found}")]
    Line {
        /// Counted from 1.
        line: usize,
        /// What has to stand there.
        expected: &'static str,
        /// What the parser said.
        found: String,
    },
}

impl TraceHeader {
    /// Describes the pages of an opened scene.
    pub fn of(name: &str, scene: &OpenedScene, fps: u32) -> Self {
        let pages = scene.assets.iter().flat_map(|opened| {
            opened
                .asset
                .pages
                .iter()
                .enumerate()
                .map(|(page, entry)| TracePage {
                    bytes: entry.bytes,
                    memory_words: entry.memory_words,
                    root: page < opened.asset.root_page_count as usize,
                    dependencies: entry
                        .dependencies
                        .iter()
                        .map(|page| opened.page_base + page)
                        .collect(),
                })
        });
        Self {
            version: TRACE_VERSION,
            scene: name.to_owned(),
            fps,
            pages: pages.collect(),
        }
    }
}

impl TraceFrame {
    /// Orders the requests, most urgent first, ties by page, so that equal runs give equal bytes.
    pub fn new(frame: u32, requests: &[StreamingRequest]) -> Self {
        let mut requests: Vec<_> = requests
            .iter()
            .map(|request| (request.page, request.error_px, request.priority_px))
            .collect();
        requests.sort_by(|a, b| b.2.total_cmp(&a.2).then(a.0.cmp(&b.0)));
        Self { frame, requests }
    }
}

/// Writes a trace line by line.
#[derive(Debug)]
pub struct TraceWriter<W: Write> {
    output: W,
}

impl<W: Write> TraceWriter<W> {
    /// Writes the header.
    pub fn new(mut output: W, header: &TraceHeader) -> Result<Self, TraceError> {
        write_line(&mut output, header)?;
        Ok(Self { output })
    }

    /// Appends a frame.
    pub fn frame(&mut self, frame: &TraceFrame) -> Result<(), TraceError> {
        write_line(&mut self.output, frame)
    }

    /// Writes out what is buffered.
    pub fn finish(mut self) -> Result<(), TraceError> {
        Ok(self.output.flush()?)
    }
}

fn write_line(output: &mut impl Write, value: &impl Serialize) -> Result<(), TraceError> {
    serde_json::to_writer(&mut *output, value).map_err(std::io::Error::from)?;
    Ok(output.write_all(b"\n")?)
}

impl Trace {
    /// Reads and checks a trace: every page number is known, dependencies point backwards.
    pub fn read(input: impl BufRead) -> Result<Self, TraceError> {
        let mut lines = input.lines().enumerate();
        let wrong = |line: usize, expected, found: String| TraceError::Line {
            line,
            expected,
            found,
        };
        let (_, first) = lines
            .next()
            .ok_or_else(|| wrong(1, "a trace header", "nothing".into()))?;
        let header: TraceHeader = serde_json::from_str(&first?)
            .map_err(|error| wrong(1, "a trace header", error.to_string()))?;
        if header.version != TRACE_VERSION {
            return Err(wrong(1, "version 2", header.version.to_string()));
        }
        for (page, entry) in header.pages.iter().enumerate() {
            if let Some(wide) = entry
                .dependencies
                .iter()
                .find(|&&dependency| dependency as usize >= page)
            {
                return Err(wrong(
                    1,
                    "dependencies on earlier pages",
                    format!("page {page} on {wide}"),
                ));
            }
        }
        let mut frames = Vec::new();
        for (index, line) in lines {
            let line = line?;
            if line.is_empty() {
                continue;
            }
            let frame: TraceFrame = serde_json::from_str(&line)
                .map_err(|error| wrong(index + 1, "a frame", error.to_string()))?;
            if let Some((page, ..)) = frame
                .requests
                .iter()
                .find(|(page, ..)| *page as usize >= header.pages.len())
            {
                return Err(wrong(index + 1, "known pages", page.to_string()));
            }
            frames.push(frame);
        }
        Ok(Self { header, frames })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header() -> TraceHeader {
        let page = |root, dependencies| TracePage {
            bytes: 9,
            memory_words: 8,
            root,
            dependencies,
        };
        TraceHeader {
            version: TRACE_VERSION,
            scene: "rock".into(),
            fps: 30,
            pages: vec![page(true, vec![]), page(false, vec![0])],
        }
    }

    #[test]
    fn traces_round_trip_and_wrong_lines_are_named() -> Result<(), TraceError> {
        let mut bytes = Vec::new();
        let mut writer = TraceWriter::new(&mut bytes, &header())?;
        let requests = [
            StreamingRequest {
                page: 0,
                error_px: 1.0,
                priority_px: 4.0,
            },
            StreamingRequest {
                page: 1,
                error_px: 0.5,
                priority_px: 7.5,
            },
        ];
        writer.frame(&TraceFrame::new(0, &requests))?;
        writer.finish()?;
        let trace = Trace::read(bytes.as_slice())?;
        assert_eq!(trace.header, header());
        assert_eq!(
            trace.frames,
            vec![TraceFrame {
                frame: 0,
                requests: vec![(1, 0.5, 7.5), (0, 1.0, 4.0)]
            }]
        );

        bytes.extend(b"{\"frame\":1,\"requests\":[[2,1.0,1.0]]}\n");
        let error = Trace::read(bytes.as_slice())
            .map(|_| ())
            .map_err(|error| error.to_string());
        assert_eq!(
            error,
            Err("trace line 3: expected known pages, found 2".into())
        );
        assert!(Trace::read(&b""[..]).is_err() && Trace::read(&b"{}\n"[..]).is_err());
        Ok(())
    }
}
