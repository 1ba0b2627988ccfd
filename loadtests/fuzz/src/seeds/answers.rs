//! Requests, and streams that answer them.

use lodestream_format::ContentHash;
use lodestream_format::wire::{self, BlockKind, PageStatus};

use super::Seeds;
use crate::targets::input::sized;
use crate::targets::served::TOKEN;

/// The stream of an `open`, and one of pages.
pub fn streams(seeds: &Seeds, name: &str, objects: &[(u8, &[u8])]) {
    let mut open = Vec::new();
    for &(kind, object) in objects {
        let kind = [
            BlockKind::Scene,
            BlockKind::Asset,
            BlockKind::Hierarchy,
            BlockKind::RootPages,
        ][usize::from(kind) - 1];
        let mut hash = ContentHash::of(object);
        if kind == BlockKind::RootPages {
            hash = ContentHash::of(objects[1].1);
        }
        let bytes = object.len() as u64;
        open.extend(wire::block_header(kind, PageStatus::Ok, 0, hash, bytes));
        open.extend(object);
    }
    open.extend(wire::end_block());
    let mut pages = Vec::new();
    for (page, status) in [
        (1, PageStatus::Ok),
        (2, PageStatus::NotFound),
        (3, PageStatus::Failed),
    ] {
        let frame: &[u8] = if page == 1 { b"frame" } else { b"" };
        let bytes = frame.len() as u64;
        pages.extend(wire::block_header(
            BlockKind::Page,
            status,
            page,
            ContentHash([1; 32]),
            bytes,
        ));
        pages.extend(frame);
    }
    pages.extend(wire::end_block());
    for (kind, stream) in [(1, &open), (0, &pages)] {
        let name = format!("{name}-{kind}");
        seeds.add("blocks", &name, &[&[99], stream]);
        seeds.add(
            "client_answer",
            &name,
            &[&[kind, 0, 99], &sized(b""), stream],
        );
    }
}

/// Everything else that is small.
pub fn requests(seeds: &Seeds) {
    let token = format!("authorization: Bearer {TOKEN}");
    for (name, text) in [
        ("list", "GET /v1/scenes?after=a&limit=1\n\n"),
        (
            "show",
            "GET /v1/scenes/a\nif-none-match: W/\"x\", \"$S.1\"\n\n",
        ),
        ("open", "GET /v1/scenes/b.2/open\nif-none-match: \"$S\"\n\n"),
        ("head", "HEAD /v1/objects/$P\n\n"),
        (
            "range",
            "GET /v1/objects/$P\nrange: bytes=3-17\nif-range: \"$P\"\n\n",
        ),
        ("last", "GET /v1/objects/$P\nrange: bytes=-9\n\n"),
        (
            "rest",
            "GET /v1/objects/$P\nrange: bytes=250-\naccept-encoding: gzip\n\n",
        ),
        ("outside", "GET /v1/objects/$P\nrange: bytes=256-\n\n"),
        ("pages", "GET /v1/assets/$A/pages/0-2\nif-none-match: *\n\n"),
        ("page", "GET /v1/assets/$A/pages/1-1\n\n"),
        ("escaped", "GET /v1/assets/%24A/pages/%31-1\n\n"),
        (
            "options",
            "OPTIONS /v1/pages\norigin: http://a\naccess-control-request-method: POST\n\n",
        ),
        (
            "post",
            "POST /v1/pages\n\n{\"viewer\":1,\"sequence\":1,\"wants\":[]}",
        ),
        ("put", "PUT /v1/scenes/c?kind=ply\n$T\n\nply\nformat"),
        ("large", "PUT /v1/scenes/c\n$T\ncontent-length: 9999\n\nx"),
        ("document", "GET /v1/openapi.json\n\n"),
        ("health", "GET /healthz\n\n"),
        ("ready", "GET /readyz\n\n"),
        ("metrics", "GET /metrics\n\n"),
        ("none", "DELETE http://host/v1/nothing?#x\nhost: y\n\n"),
    ] {
        let text = text.replace("$T", &token);
        seeds.add("request", name, &[text.as_bytes()]);
        let line = text
            .replacen('\n', " HTTP/1.1\nhost: a\n", 1)
            .replace('\n', "\r\n");
        seeds.add("connection", name, &[&[99], line.as_bytes()]);
    }
    let head = "GET /v1/assets/$A/pages/0-1 HTTP/1.1\r\nHost: a\r\n";
    let two = format!("{head}\r\n{head}connection: close\r\n\r\n");
    seeds.add("connection", "two", &[&[20], two.as_bytes()]);
    let preface = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0";
    seeds.add("connection", "preface", &[&[255], preface]);
    let want = r#"{"asset":"$A","first":0,"last":2,"priority":1.5}"#;
    let other = format!(
        r#"{{"asset":"{}","first":1,"last":9,"priority":-1e-3}}"#,
        "0".repeat(64)
    );
    let post = format!(r#"{{"viewer":7,"sequence":3,"wants":[{want},{other},{want}]}}"#);
    seeds.add("post", "wants", &[post.as_bytes()]);
    seeds.add(
        "tokens",
        "two",
        &[b"# ours\n0123456789abcdef\n\n  fedcba9876543210  \n"],
    );
    seeds.add("tokens", "short", &[b"0123456789abcde\n"]);
    let scenes = r#"{"scenes":[{"name":"a","scene":"0000000000000000000000000000000000000000000000000000000000000000","published_secs":1}],"next":"a"}"#;
    seeds.add(
        "client_answer",
        "scenes",
        &[
            &[2, 0, 9],
            &sized(b""),
            scenes.as_bytes(),
            b"\xfe{\"scenes\":[]}",
        ],
    );
    seeds.add(
        "client_answer",
        "object",
        &[&[3, 0, 9], &sized(b""), b"any bytes"],
    );
    seeds.add(
        "client_answer",
        "pages",
        &[&[4, 0, 9], &sized(b""), &[7; 150]],
    );
    seeds.add("client_answer", "later", &[&[3, 2, 9], &sized(b" 1.5 ")]);
    seeds.add("client_files", "scenes", &[b"s", scenes.as_bytes()]);
    let path = r#"{"fps":30,"frames":60,"size":[320,200],"keys":[{"frame":0,"eye":[0,0,5],"target":[0,0,0]},{"frame":59,"eye":[1,2,3],"target":[0,0,0],"up":[0,0,1],"fov_degrees":40}]}"#;
    seeds.add("client_files", "path", &[b"p", path.as_bytes()]);
    let trace = "{\"version\":2,\"scene\":\"a\",\"fps\":30,\"pages\":[{\"bytes\":9,\"memory_words\":8,\"root\":true,\"dependencies\":[]},\
        {\"bytes\":9,\"memory_words\":8,\"root\":false,\"dependencies\":[0]}]}\n{\"frame\":0,\"requests\":[[1,2.5,9.0],[0,1.0,4.0]]}\n";
    seeds.add("client_files", "trace", &[b"t", trace.as_bytes()]);
}
