//! `play`: a camera path at fixed steps. Unless asked to keep pace with the clock, every frame waits until what it wants
//! is installed, so that the same path gives the same pictures on any link.

use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use crate::error::ClientError;
use crate::gpu::{self, Gpu};
use crate::opening::SessionOptions;
use crate::path::CameraPath;
use crate::picture::{FileError, write_png};
use crate::report::Report;
use crate::session::Session;
use crate::trace::{TraceFrame, TraceHeader, TraceWriter};

/// What to play and what to keep of it.
#[derive(Debug, Clone)]
pub struct PlayOptions {
    /// Scene, pixel error, pool, mode; the size is the path's.
    pub session: SessionOptions,
    /// The path file.
    pub path: PathBuf,
    /// Folder of the frames' pictures.
    pub frames: Option<PathBuf>,
    /// File of the frames' streaming requests ([`crate::trace`]).
    pub trace: Option<PathBuf>,
    /// The report.
    pub report: Option<PathBuf>,
    /// One frame a step of the clock, with whatever has come by then.
    pub realtime: bool,
    /// Longest wait for one frame's pages.
    pub settle: Duration,
}

/// Plays the path.
pub fn play(options: &PlayOptions) -> Result<Report, ClientError> {
    let (gpu, _) = Gpu::open(&gpu::instance(), options.session.adapter.as_deref(), None)?;
    play_on(&gpu, options)
}

/// [`play`] on a device that exists.
pub fn play_on(gpu: &Gpu, options: &PlayOptions) -> Result<Report, ClientError> {
    let path = CameraPath::read(&options.path)?;
    let mut session = Session::on(
        gpu,
        &SessionOptions {
            size_px: path.size,
            // Only a path that does not wait meets pages that come late.
            fetches_hidden: options.realtime,
            ..options.session.clone()
        },
    )?;
    if let Some(folder) = &options.frames {
        std::fs::create_dir_all(folder).map_err(|error| FileError::new(folder, error))?;
    }
    let mut trace = match &options.trace {
        Some(file) => {
            let created = File::create(file).map_err(|error| FileError::new(file, error))?;
            let scene = session.streamer.scene();
            let fps = path.fps.round().max(1.0) as u32;
            let header = TraceHeader::of(&options.session.scene, scene, fps);
            let writer = TraceWriter::new(BufWriter::new(created), &header)
                .map_err(|error| FileError::new(file, error))?;
            Some((file, writer))
        }
        None => None,
    };
    let start = Instant::now();
    let mut unsettled = 0;
    for frame in 0..path.frames {
        let camera = path.camera(frame);
        let requests = session.request_pages(&camera)?;
        if options.realtime {
            let due = Duration::from_secs_f64(path.secs(frame));
            std::thread::sleep(due.saturating_sub(start.elapsed()));
        } else if !session.settle(&camera, options.settle)? {
            unsettled += 1;
        }
        session.picture(&camera)?;
        if let Some(folder) = &options.frames {
            let file = folder.join(format!("frame_{frame:05}.png"));
            write_png(&file, path.size, &session.renderer.read_color()?)?;
        }
        if let Some((file, writer)) = &mut trace {
            writer
                .frame(&TraceFrame::new(frame, &requests))
                .map_err(|error| FileError::new(file, error))?;
        }
    }
    if let Some((file, writer)) = trace {
        writer
            .finish()
            .map_err(|error| FileError::new(file, error))?;
    }
    if unsettled > 0 {
        session.warn(format!(
            "{unsettled} of {} frames did not settle",
            path.frames
        ));
    }
    let report = session.report();
    if let Some(file) = &options.report {
        report.write(file)?;
    }
    Ok(report)
}
