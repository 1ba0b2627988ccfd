//! `render`: one settled picture.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use crate::camera::{Pose, framing, near_metres};
use crate::cut_file;
use crate::error::ClientError;
use crate::gpu::{self, Gpu};
use crate::opening::SessionOptions;
use crate::picture::{depth_metres, write_pfm, write_png};
use crate::reference::reference;
use crate::report::Report;
use crate::session::Session;

/// What to draw and where to write it.
#[derive(Debug, Clone)]
pub struct RenderOptions {
    /// Scene, size, pixel error, pool, mode.
    pub session: SessionOptions,
    /// The camera; without it the whole scene is framed.
    pub camera: Option<Pose>,
    /// Full detail, without culling and level of detail.
    pub reference: bool,
    /// Longest wait for pages.
    pub timeout: Duration,
    /// Pictures drawn; more than one for timing.
    pub repeat: u32,
    /// The picture.
    pub out: PathBuf,
    /// View-space depth.
    pub depth: Option<PathBuf>,
    /// Triangles of the cut.
    pub cut: Option<PathBuf>,
    /// The report.
    pub report: Option<PathBuf>,
}

/// Draws and writes. A view that does not settle in time is drawn and written as it is, and then an error.
pub fn render(options: &RenderOptions) -> Result<Report, ClientError> {
    let (gpu, _) = Gpu::open(&gpu::instance(), options.session.adapter.as_deref(), None)?;
    render_on(&gpu, options)
}

/// [`render`] on a device that exists.
pub fn render_on(gpu: &Gpu, options: &RenderOptions) -> Result<Report, ClientError> {
    match options.reference {
        true => render_reference(gpu, options),
        false => render_settled(gpu, options),
    }
}

fn render_settled(gpu: &Gpu, options: &RenderOptions) -> Result<Report, ClientError> {
    let start = Instant::now();
    let mut session = Session::on(gpu, &options.session)?;
    let size_px = options.session.size_px;
    let camera = match options.camera {
        Some(pose) => pose.camera(size_px),
        None => session.framing(size_px),
    };
    let settled = session.settle(&camera, options.timeout)?;
    let settled_secs = start.elapsed().as_secs_f64();
    let failure = (!settled).then(|| session.not_settled(options.timeout));
    if let Some(failure) = &failure {
        session.warn(failure.to_string());
    }
    for _ in 0..options.repeat.max(1) {
        session.picture(&camera)?;
    }
    write_png(&options.out, size_px, &session.renderer.read_color()?)?;
    if let Some(file) = &options.depth {
        let visbuffer = session.renderer.read_visbuffer()?;
        let depth = depth_metres(&visbuffer, session.near_metres());
        write_pfm(file, size_px, &depth)?;
    }
    if let Some(file) = &options.cut {
        let visible = session.renderer.read_visible()?;
        let pool = session.renderer.read_pool()?;
        let cut = cut_file::triangles(session.arrays(), &visible, &pool);
        cut_file::write_ply(file, &cut)?;
    }
    let mut report = session.report();
    report.settled_secs = settled.then_some(settled_secs);
    if let Some(file) = &options.report {
        report.write(file)?;
    }
    failure.map_or(Ok(report), Err)
}

fn render_reference(gpu: &Gpu, options: &RenderOptions) -> Result<Report, ClientError> {
    if options.cut.is_some() {
        return Err(ClientError::Setting {
            at: "--cut".to_owned(),
            expected: "a view with level of detail".to_owned(),
            found: "--reference, which chooses no cut".to_owned(),
        });
    }
    let size_px = options.session.size_px;
    let (mut near, mut framed) = (0.0, None);
    let mut drawn = reference(gpu, &options.session, |opening| {
        near = near_metres(&opening.arrays, &opening.subject);
        options.camera.map_or_else(
            || framing(framed.insert(opening.subject.clone()), size_px),
            |pose| pose.camera(size_px),
        )
    })?;
    if let Some(subject) = framed {
        drawn.report.tell_outside(&subject);
    }
    write_png(&options.out, size_px, &drawn.color)?;
    if let Some(file) = &options.depth {
        write_pfm(file, size_px, &depth_metres(&drawn.visbuffer, near))?;
    }
    if let Some(file) = &options.report {
        drawn.report.write(file)?;
    }
    Ok(drawn.report)
}
