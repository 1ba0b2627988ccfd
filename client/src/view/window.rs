//! The window's events and frames.

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Instant;

use lodestream_shaders::types::ShadeMode;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::event_loop::ActiveEventLoop;
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::{Window, WindowId};

use super::ViewOptions;
use super::navigation::Navigation;
use super::overlay::TextBox;
use crate::error::ClientError;
use crate::gpu::{self, Gpu, GpuError, Work};
use crate::opening::SessionOptions;
use crate::picture::write_png;
use crate::report::Report;
use crate::session::Session;

/// Digit keys' modes, from 1 on; 0 is the tenth.
const MODES: [ShadeMode; 10] = [
    ShadeMode::Shaded,
    ShadeMode::Triangles,
    ShadeMode::Clusters,
    ShadeMode::Groups,
    ShadeMode::Levels,
    ShadeMode::Pages,
    ShadeMode::Depth,
    ShadeMode::Normals,
    ShadeMode::Materials,
    ShadeMode::Overdraw,
];
const DIGITS: [KeyCode; 10] = [
    KeyCode::Digit1,
    KeyCode::Digit2,
    KeyCode::Digit3,
    KeyCode::Digit4,
    KeyCode::Digit5,
    KeyCode::Digit6,
    KeyCode::Digit7,
    KeyCode::Digit8,
    KeyCode::Digit9,
    KeyCode::Digit0,
];
/// Step of the pixel error a key.
const PIXEL_ERROR_STEP: f32 = 1.25;

/// The application: nothing before the window exists.
pub(super) struct App {
    options: ViewOptions,
    opened: Option<Opened>,
    outcome: Result<(), ClientError>,
}

struct Opened {
    // Before the window: dropped in this order.
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    session: Session,
    window: Arc<Window>,
    navigation: Navigation,
    home: Navigation,
    keys: HashSet<KeyCode>,
    button: Option<MouseButton>,
    pointer: (f64, f64),
    last_frame: Instant,
    smooth_ms: f64,
    frames: u64,
    shows_text: bool,
}

impl App {
    pub(super) fn new(options: ViewOptions) -> Self {
        Self {
            options,
            opened: None,
            outcome: Ok(()),
        }
    }

    /// Writes what was asked for; called after the loop ended.
    pub(super) fn finish(self) -> Result<Report, ClientError> {
        self.outcome?;
        let Some(opened) = self.opened else {
            return Ok(Report::default());
        };
        let session = &opened.session;
        if let Some(file) = &self.options.screenshot {
            let color = session.renderer.read_color()?;
            write_png(file, session.renderer.size_px(), &color)?;
        }
        let report = session.report();
        if let Some(file) = &self.options.report {
            report.write(file)?;
        }
        Ok(report)
    }

    fn fail(&mut self, event_loop: &ActiveEventLoop, error: ClientError) {
        self.outcome = Err(error);
        event_loop.exit();
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.opened.is_none() {
            match Opened::new(event_loop, &self.options) {
                Ok(opened) => self.opened = Some(opened),
                Err(error) => self.fail(event_loop, error),
            }
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(opened) = &mut self.opened else {
            return;
        };
        let outcome = match event {
            WindowEvent::CloseRequested => {
                event_loop.exit();
                Ok(())
            }
            WindowEvent::RedrawRequested => {
                let outcome = opened.frame();
                if self
                    .options
                    .frames
                    .is_some_and(|most| opened.frames >= most)
                {
                    event_loop.exit();
                }
                outcome
            }
            WindowEvent::Resized(size) => opened.resize(size),
            WindowEvent::KeyboardInput { event, .. } => match event.physical_key {
                PhysicalKey::Code(KeyCode::Escape) => {
                    event_loop.exit();
                    Ok(())
                }
                PhysicalKey::Code(code) => {
                    opened.key(code, event.state == ElementState::Pressed, event.repeat)
                }
                PhysicalKey::Unidentified(_) => Ok(()),
            },
            WindowEvent::MouseInput { state, button, .. } => {
                opened.button = (state == ElementState::Pressed).then_some(button);
                Ok(())
            }
            WindowEvent::CursorMoved { position, .. } => {
                opened.drag(position.x, position.y);
                Ok(())
            }
            WindowEvent::MouseWheel { delta, .. } => {
                opened.navigation.zoom(match delta {
                    MouseScrollDelta::LineDelta(_, lines) => lines as f64,
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y / 40.0,
                });
                Ok(())
            }
            _ => Ok(()),
        };
        if let Err(error) = outcome {
            self.fail(event_loop, error);
        }
    }

    fn about_to_wait(&mut self, _: &ActiveEventLoop) {
        if let Some(opened) = &self.opened {
            opened.window.request_redraw();
        }
    }
}

impl Opened {
    fn new(event_loop: &ActiveEventLoop, options: &ViewOptions) -> Result<Self, ClientError> {
        let failed = |error: String| GpuError::Surface(error);
        let [width, height] = options.session.size_px;
        let attributes = Window::default_attributes()
            .with_title(format!("Lodestream: {}", options.session.scene))
            .with_inner_size(PhysicalSize::new(width, height));
        let window = event_loop
            .create_window(attributes)
            .map_err(|error| failed(error.to_string()))?;
        let window = Arc::new(window);
        let instance = gpu::instance();
        let surface = instance
            .create_surface(window.clone())
            .map_err(|error| failed(error.to_string()))?;
        let adapter = options.session.adapter.as_deref();
        let (gpu, adapter) = Gpu::open(&instance, adapter, Some(&surface))?;
        let size = window.inner_size();
        let size_px = [size.width.max(1), size.height.max(1)];
        let mut config = surface
            .get_default_config(&adapter, size_px[0], size_px[1])
            .ok_or_else(|| failed(format!("{} cannot present to it", gpu.name)))?;
        // `color` is encoded already: a format that encodes once more would wash it out.
        config.format = surface
            .get_capabilities(&adapter)
            .formats
            .into_iter()
            .find(|format| {
                matches!(
                    format,
                    wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Rgba8Unorm
                )
            })
            .ok_or_else(|| failed("expected a BGRA or RGBA format of 8 bits".to_owned()))?;
        surface.configure(&gpu.device, &config);
        // Opened shaded, so that the textures are there when the mode is changed.
        let session_options = SessionOptions {
            size_px,
            mode: ShadeMode::Shaded,
            fetches_hidden: true,
            ..options.session.clone()
        };
        let mut session = Session::on(&gpu, &session_options)?;
        session.set_mode(options.session.mode)?;
        session.time_frames();
        let radius = session.subject().radius_metres;
        let home = Navigation::new(session.framing(size_px), radius);
        let navigation = options
            .camera
            .map_or(home, |pose| Navigation::new(pose.camera(size_px), radius));
        Ok(Self {
            surface,
            config,
            session,
            window,
            navigation,
            home,
            keys: HashSet::new(),
            button: None,
            pointer: (0.0, 0.0),
            last_frame: Instant::now(),
            smooth_ms: 0.0,
            frames: 0,
            shows_text: true,
        })
    }

    fn resize(&mut self, size: PhysicalSize<u32>) -> Result<(), ClientError> {
        if size.width > 0 && size.height > 0 {
            (self.config.width, self.config.height) = (size.width, size.height);
            self.surface
                .configure(&self.session.renderer.gpu.device, &self.config);
            self.session.renderer.resize([size.width, size.height])?;
        }
        Ok(())
    }

    fn key(&mut self, code: KeyCode, pressed: bool, repeat: bool) -> Result<(), ClientError> {
        if !pressed {
            self.keys.remove(&code);
            return Ok(());
        }
        self.keys.insert(code);
        let asked = self.session.streamer.stats().pixel_error_asked;
        match code {
            KeyCode::Equal | KeyCode::NumpadAdd => {
                self.session
                    .streamer
                    .set_pixel_error(asked * PIXEL_ERROR_STEP)?;
            }
            KeyCode::Minus | KeyCode::NumpadSubtract => {
                self.session
                    .streamer
                    .set_pixel_error(asked / PIXEL_ERROR_STEP)?;
            }
            KeyCode::BracketLeft => self.navigation.change_speed(0.5),
            KeyCode::BracketRight => self.navigation.change_speed(2.0),
            KeyCode::KeyF => self.navigation = self.home,
            KeyCode::KeyO if !repeat => {
                let renderer = &mut self.session.renderer;
                renderer.set_occlusion(!renderer.has_occlusion());
            }
            KeyCode::KeyR if !repeat => {
                let renderer = &mut self.session.renderer;
                renderer.set_compute_raster(!renderer.has_compute_raster());
            }
            KeyCode::KeyH if !repeat => self.shows_text = !self.shows_text,
            _ => {
                if let Some(index) = DIGITS.iter().position(|&digit| digit == code) {
                    self.session.set_mode(MODES[index])?;
                }
            }
        }
        Ok(())
    }

    fn drag(&mut self, x: f64, y: f64) {
        let (dx, dy) = (x - self.pointer.0, y - self.pointer.1);
        self.pointer = (x, y);
        let shift =
            self.keys.contains(&KeyCode::ShiftLeft) || self.keys.contains(&KeyCode::ShiftRight);
        match self.button {
            Some(MouseButton::Left) if shift => self.navigation.pan(dx, dy, self.config.height),
            Some(MouseButton::Middle) => self.navigation.pan(dx, dy, self.config.height),
            Some(MouseButton::Left) => self.navigation.orbit(dx, dy),
            Some(MouseButton::Right) => self.navigation.look(dx, dy),
            _ => {}
        }
    }

    fn fly(&mut self, secs: f64) {
        let along = |plus: KeyCode, minus: KeyCode| {
            self.keys.contains(&plus) as i32 as f64 - self.keys.contains(&minus) as i32 as f64
        };
        let along = [
            along(KeyCode::KeyD, KeyCode::KeyA),
            along(KeyCode::KeyE, KeyCode::KeyQ),
            along(KeyCode::KeyW, KeyCode::KeyS),
        ];
        if along != [0.0; 3] {
            self.navigation.fly(along, secs);
        }
    }

    /// One frame: move, draw, present, and hand what has come back to the streamer. Nothing here waits for the GPU.
    fn frame(&mut self) -> Result<(), ClientError> {
        let elapsed = self.last_frame.elapsed().as_secs_f64();
        self.last_frame = Instant::now();
        self.smooth_ms += (elapsed * 1e3 - self.smooth_ms) * 0.1;
        self.fly(elapsed.min(0.25));
        let target = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(target)
            | wgpu::CurrentSurfaceTexture::Suboptimal(target) => target,
            wgpu::CurrentSurfaceTexture::Outdated | wgpu::CurrentSurfaceTexture::Lost => {
                self.surface
                    .configure(&self.session.renderer.gpu.device, &self.config);
                return Ok(());
            }
            wgpu::CurrentSurfaceTexture::Timeout | wgpu::CurrentSurfaceTexture::Occluded => {
                return Ok(());
            }
            wgpu::CurrentSurfaceTexture::Validation => {
                let reason = "the next picture of the window is not valid".to_owned();
                return Err(GpuError::Surface(reason).into());
            }
        };
        let size_px = [self.config.width, self.config.height];
        let camera = self.navigation.camera(size_px);
        self.session.look(&camera);
        let view = self.session.view(&camera);
        self.session.renderer.draw(&view, Work::Picture)?;
        let text = match self.shows_text {
            true => self.lines(),
            false => Vec::new(),
        };
        let text = TextBox::new(&text, size_px);
        let format = self.config.format;
        self.session.renderer.present(
            &target.texture.create_view(&Default::default()),
            format,
            |gpu, encoder, color| text.record(gpu, encoder, color, size_px[0]),
        )?;
        self.window.pre_present_notify();
        self.session.renderer.gpu.queue.present(target);
        let results = self.session.renderer.collect(false)?;
        if results.is_empty() {
            let changes = self.session.streamer.poll();
            self.session.apply(&changes)?;
        }
        self.session.take(results)?;
        self.frames += 1;
        self.session.count_frame(elapsed * 1e3);
        if self.frames % 30 == 1 {
            let title = self.lines().join("  ");
            self.window.set_title(&format!("Lodestream: {title}"));
        }
        Ok(())
    }

    fn lines(&self) -> Vec<String> {
        let stats = self.session.streamer.stats();
        let drawn = self.session.drawn();
        let mode = format!("{:?}", self.session.mode());
        vec![
            format!(
                "{}  {mode}  {:.1} ms  {:.2} px of {:.2} asked",
                self.session.scene_name(),
                self.smooth_ms,
                self.session.pixel_error_shown(),
                stats.pixel_error_asked
            ),
            format!(
                "{} triangles  {} clusters, {} by compute, {} hidden  {} instances",
                drawn.triangles,
                drawn.clusters,
                drawn.clusters_software,
                drawn.hidden_clusters,
                drawn.instances
            ),
            format!(
                "{} pages resident, {} missing  {:.1} MB fetched",
                stats.pages_resident,
                stats.pages_missing,
                self.session.bytes_fetched() as f64 * 1e-6
            ),
        ]
    }
}
