//! JSON that the client reads: camera paths, traces, references, lists of scenes.

use lodestream_client::path::CameraPath;
use lodestream_client::trace::{Trace, TraceWriter};
use lodestream_format::library::SceneReference;
use lodestream_format::wire::ScenesPage;

use super::input::Input;

pub const MOST_BYTES: [usize; 2] = [1 << 20, 512];

/// A byte that says what the rest is.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    match input.byte() {
        b'p' => camera_path(input.0),
        b't' => trace(input.0),
        b'r' => {
            if let Ok(reference) = serde_json::from_slice::<SceneReference>(input.0) {
                let json = serde_json::to_vec(&reference).expect("JSON");
                assert_eq!(serde_json::from_slice(&json).ok(), Some(reference));
            }
        }
        _ => {
            if let Ok(page) = serde_json::from_slice::<ScenesPage>(input.0) {
                let json = serde_json::to_vec(&page).expect("JSON");
                assert_eq!(serde_json::from_slice(&json).ok(), Some(page));
            }
        }
    }
}

fn camera_path(text: &[u8]) {
    let Ok(path) = CameraPath::parse(&String::from_utf8_lossy(text), "file") else {
        return;
    };
    let json = serde_json::to_string(&path).expect("JSON");
    let again = CameraPath::parse(&json, "file").expect("what was written can be read");
    assert_eq!(again, path);
    for frame in [0, 1, path.frames / 2, path.frames - 1] {
        path.camera(frame);
        path.secs(frame);
    }
}

fn trace(text: &[u8]) {
    let Ok(trace) = Trace::read(text) else {
        return;
    };
    let mut bytes = Vec::new();
    let mut writer = TraceWriter::new(&mut bytes, &trace.header).expect("writes");
    for frame in &trace.frames {
        writer.frame(frame).expect("writes");
    }
    writer.finish().expect("writes");
    let finite = |frame: &lodestream_client::trace::TraceFrame| {
        frame
            .requests
            .iter()
            .all(|(_, error_px, priority_px)| error_px.is_finite() && priority_px.is_finite())
    };
    if trace.frames.iter().all(finite) {
        let again = Trace::read(&*bytes).expect("what was written can be read");
        assert_eq!((again.header, again.frames), (trace.header, trace.frames));
    }
}
