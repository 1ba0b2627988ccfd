//! End to end over HTTP: build, publish, serve, stream, draw.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used)] // A test's way to fail.

mod gpu_common;

use std::path::Path;
use std::time::Duration;

use gpu_common::{TestScene, gpu, keep_picture, plain_scene, textured_scene};
use lodestream_client::gpu::Gpu;
use lodestream_client::opening::SessionOptions;
use lodestream_client::picture::psnr_db;
use lodestream_client::play::{PlayOptions, play_on};
use lodestream_client::reference::{Reference, reference};
use lodestream_client::render::{RenderOptions, render_on};
use lodestream_client::report::Report;
use lodestream_client::trace::Trace;
use lodestream_server::http::AppState;
use lodestream_server::http::serve::Server;
use lodestream_server::library::Library;

const SIZE: [u32; 2] = [480, 270];

/// A server over a library with `test` as "scene"; both live as long as this.
struct Served {
    url: String,
    folder: tempfile::TempDir,
    _runtime: tokio::runtime::Runtime,
}

fn serve(test: &TestScene) -> Served {
    let folder = tempfile::tempdir().unwrap();
    test.publish(folder.path(), "scene");
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let server = runtime.block_on(Server::bind("127.0.0.1:0")).unwrap();
    let url = format!("http://{}", server.address());
    let library = Library::open(folder.path().to_str().unwrap()).unwrap();
    let state = AppState::new(library, 1 << 20);
    runtime.spawn(server.run(state, std::future::pending()));
    Served {
        url,
        folder,
        _runtime: runtime,
    }
}

fn options(location: &str) -> SessionOptions {
    SessionOptions {
        size_px: SIZE,
        ..SessionOptions::new(location, "scene")
    }
}

fn render(gpu: &Gpu, session: SessionOptions, out: &Path) -> (Report, Vec<u32>) {
    let options = RenderOptions {
        session,
        camera: None,
        reference: false,
        timeout: Duration::from_secs(120),
        repeat: 1,
        out: out.to_owned(),
        depth: Some(out.with_extension("pfm")),
        cut: Some(out.with_extension("ply")),
        report: Some(out.with_extension("json")),
    };
    let report = render_on(gpu, &options).unwrap();
    let image = image::open(out).unwrap().into_rgba8();
    let color = image
        .as_raw()
        .chunks_exact(4)
        .map(|rgba| u32::from_le_bytes(rgba.try_into().unwrap()))
        .collect();
    (report, color)
}

fn full_detail(gpu: &Gpu, session: &SessionOptions) -> Reference {
    reference(gpu, session, |opening| {
        lodestream_client::camera::framing(&opening.subject, SIZE)
    })
    .unwrap()
}

fn over_http(gpu: &Gpu, test: &TestScene, name: &str) {
    let served = serve(test);
    let out = served.folder.path().join("out.png");
    let (report, color) = render(gpu, options(&served.url), &out);
    assert!(report.settled_secs.is_some() && report.pixel_error_shown == 1.0);
    assert!(report.pages_fetched > 0 && report.bytes_fetched > 0);
    let expected = full_detail(gpu, &options(&served.url));
    keep_picture(&format!("{name}_settled"), SIZE, &color);
    keep_picture(&format!("{name}_reference"), SIZE, &expected.color);
    let psnr = psnr_db(&color, &expected.color);
    // A pixel of error at silhouettes and at borders of materials.
    assert!(psnr >= 38.0, "{psnr} dB");
    // A folder gives the same picture as the server in front of it.
    let folder = options(served.folder.path().to_str().unwrap());
    let (near, from_folder) = render(gpu, folder, &out);
    assert_eq!(near.drawn, report.drawn);
    assert!(psnr_db(&color, &from_folder) > 60.0);
    check_files(&out, &report);
}

/// Depth and cut say what the picture shows.
fn check_files(out: &Path, report: &Report) {
    let drawn = report.drawn.unwrap();
    let pfm = std::fs::read(out.with_extension("pfm")).unwrap();
    let values: &[u8] = &pfm[pfm.len() - SIZE[0] as usize * SIZE[1] as usize * 4..];
    let depths: Vec<f32> = values
        .chunks_exact(4)
        .map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()))
        .collect();
    let hit = depths.iter().filter(|depth| **depth > 0.0).count();
    assert!(hit * 20 > depths.len(), "{hit} pixels hit");
    let ply = std::fs::read(out.with_extension("ply")).unwrap();
    let header = String::from_utf8_lossy(&ply[..200]).into_owned();
    assert!(
        header.contains(&format!("element face {}\n", drawn.triangles)),
        "{header}"
    );
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.with_extension("json")).unwrap()).unwrap();
    for key in [
        "settled_secs",
        "frames",
        "requests",
        "pages_fetched",
        "bytes_fetched",
        "pages_resident",
        "pages_evicted",
        "pool_bytes",
        "drawn",
        "pixel_error_shown",
        "frame_ms",
        "adapter",
        "passes_recorded",
        "pipelines_built",
    ] {
        assert!(!json[key].is_null(), "{key} is missing");
    }
}

#[test]
fn a_settled_picture_is_near_the_reference() {
    if let Some(gpu) = gpu() {
        over_http(&gpu, &plain_scene(), "http_plain");
        over_http(&gpu, &textured_scene(), "http_textured");
    }
}

/// What a scene lacks it does not pay for: no textures, no masks, no overdraw.
#[test]
fn passes_that_a_scene_does_not_need_are_not_built() {
    let Some(gpu) = gpu() else { return };
    let served = serve(&plain_scene());
    let out = served.folder.path().join("out.png");
    let (report, _) = render(&gpu, options(&served.url), &out);
    assert_eq!(report.texture_bytes, 0);
    for absent in ["raster_masked", "raster_overdraw", "present"] {
        assert!(!report.pipelines_built.contains(&absent), "{absent}");
        assert!(!report.passes_recorded.contains(&absent), "{absent}");
    }
    for present in [
        "transcode",
        "cull_nodes",
        "cull_clusters",
        "raster",
        "shade",
    ] {
        assert!(report.pipelines_built.contains(&present), "{present}");
        assert!(report.passes_recorded.contains(&present), "{present}");
    }
}

/// The smallest pool still shows the whole silhouette, coarsely, and says so.
#[test]
fn a_tiny_pool_draws_a_coarser_picture_without_holes() {
    let Some(gpu) = gpu() else { return };
    let test = plain_scene();
    let served = serve(&test);
    let out = served.folder.path().join("out.png");
    let roots: u64 = test
        .assets
        .iter()
        .flat_map(|(asset, _)| &asset.pages[..asset.root_page_count as usize])
        .map(|page| (page.memory_words as u64 * 4).next_multiple_of(256))
        .sum();
    let session = SessionOptions {
        pool_bytes: Some(roots + 4 * 128 * 1024),
        pixel_error_px: 0.1,
        ..options(&served.url)
    };
    let (report, color) = render(&gpu, session, &out);
    keep_picture("tiny_pool", SIZE, &color);
    assert!(
        report.pixel_error_shown > 0.1,
        "{}",
        report.pixel_error_shown
    );
    assert!(report.pixel_error_limit.is_some());
    assert!(report.pool_bytes <= roots + 4 * 128 * 1024);
    let expected = full_detail(&gpu, &options(&served.url));
    let pfm = std::fs::read(out.with_extension("pfm")).unwrap();
    let rows = pfm.len() - expected.visbuffer.len() * 4;
    let covered = |at: usize| {
        let (x, y) = (at % SIZE[0] as usize, at / SIZE[0] as usize);
        // A PFM begins with the lowest row.
        let from = rows + ((SIZE[1] as usize - 1 - y) * SIZE[0] as usize + x) * 4;
        f32::from_le_bytes(pfm[from..from + 4].try_into().unwrap()) > 0.0
    };
    let width = SIZE[0] as usize;
    // A hole is a pixel that full detail covers all around, and this picture does not cover.
    let reach = (report.pixel_error_shown.ceil() as usize).clamp(1, 8);
    let mut holes = 0;
    for y in reach..SIZE[1] as usize - reach {
        for x in reach..width - reach {
            let around = (y - reach..=y + reach)
                .flat_map(|y| (x - reach..=x + reach).map(move |x| y * width + x));
            if !covered(y * width + x) && around.into_iter().all(|at| expected.visbuffer[at] != 0) {
                holes += 1;
            }
        }
    }
    assert_eq!(holes, 0);
}

/// A page that fails its hash is never drawn: the picture is coarser there, whole, written, and the command fails.
#[test]
fn a_damaged_page_leaves_a_coarser_picture_and_an_error() {
    let Some(gpu) = gpu() else { return };
    let test = plain_scene();
    let folder = tempfile::tempdir().unwrap();
    test.publish(folder.path(), "scene");
    let asset = &test.assets[0].0;
    let pack = folder
        .path()
        .join(lodestream_format::library::object_path(&asset.pack));
    let mut bytes = std::fs::read(&pack).unwrap();
    let last = asset.pages.last().unwrap();
    bytes[last.offset as usize + 20] ^= 1;
    std::fs::write(&pack, bytes).unwrap();
    let out = folder.path().join("out.png");
    let options = RenderOptions {
        session: SessionOptions {
            pixel_error_px: 0.05,
            ..options(folder.path().to_str().unwrap())
        },
        camera: Some("eye=1.6,1.4,2.4;target=0,0.6,0;fov=50".parse().unwrap()),
        reference: false,
        timeout: Duration::from_secs(2),
        repeat: 1,
        out: out.clone(),
        depth: None,
        cut: None,
        report: Some(out.with_extension("json")),
    };
    let error = render_on(&gpu, &options).unwrap_err().to_string();
    assert!(
        error.contains("pages missing") && error.contains("hash"),
        "{error}"
    );
    assert!(image::open(&out).is_ok());
    let text = std::fs::read_to_string(out.with_extension("json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert!(report["settled_secs"].is_null());
    assert!(report["drawn"]["triangles"].as_u64() > Some(1000));
}

/// A reference whose pages do not fit the pool at once is the same picture.
#[test]
fn a_reference_in_batches_is_the_reference() {
    let Some(gpu) = gpu() else { return };
    let served = serve(&textured_scene());
    let whole = full_detail(&gpu, &options(&served.url));
    let small = SessionOptions {
        pool_bytes: Some(128 * 1024),
        ..options(&served.url)
    };
    let batches = full_detail(&gpu, &small);
    assert_eq!(whole.report.reference_batches, Some(1));
    assert!(batches.report.reference_batches > Some(1));
    assert_eq!(whole.report.drawn, batches.report.drawn);
    let depth = |words: &[u64]| words.iter().map(|word| word >> 32).collect::<Vec<_>>();
    assert_eq!(depth(&whole.visbuffer), depth(&batches.visbuffer));
    // Where two surfaces meet at one depth the larger id wins, and ids are a batch's own.
    let psnr = psnr_db(&whole.color, &batches.color);
    assert!(psnr > 45.0, "{psnr} dB");
}

#[test]
fn a_path_plays_frame_by_frame() {
    let Some(gpu) = gpu() else { return };
    let served = serve(&plain_scene());
    let folder = served.folder.path();
    let path = folder.join("path.json");
    let text = r#"{"fps": 30, "frames": 4, "size": [160, 90], "keys": [
        {"frame": 0, "eye": [0, 3, 8], "target": [0, 0.5, 0], "fov_degrees": 50},
        {"frame": 3, "eye": [0, 1.2, 2.5], "target": [0, 0.5, 0], "fov_degrees": 50}]}"#;
    std::fs::write(&path, text).unwrap();
    let play = |frames: &Path| {
        let options = PlayOptions {
            session: options(&served.url),
            path: path.clone(),
            frames: Some(frames.to_owned()),
            trace: Some(frames.with_extension("jsonl")),
            report: None,
            realtime: false,
            settle: Duration::from_secs(60),
        };
        play_on(&gpu, &options).unwrap()
    };
    let (first, second) = (folder.join("a"), folder.join("b"));
    let report = play(&first);
    assert_eq!(report.warnings, [""; 0]);
    play(&second);
    let read = |folder: &Path| {
        let file = std::fs::File::open(folder.with_extension("jsonl")).unwrap();
        Trace::read(std::io::BufReader::new(file)).unwrap()
    };
    let trace = read(&first);
    assert_eq!(trace.frames.len(), 4);
    assert!(trace.frames.iter().all(|frame| !frame.requests.is_empty()));
    assert_eq!(trace, read(&second));
    let mut pictures = Vec::new();
    for frame in 0..4 {
        let name = format!("frame_{frame:05}.png");
        let read = |folder: &Path| image::open(folder.join(&name)).unwrap().into_rgb8();
        assert_eq!(read(&first).as_raw(), read(&second).as_raw(), "{name}");
        pictures.push(read(&first).into_raw());
    }
    assert_ne!(pictures[0], pictures[3]);
}
