//! Requests: methods, paths, queries, ranges, entity tags, tokens, bodies. Every answer is held against what it promises.

use axum::body::Body;
use axum::http::header::{
    ACCESS_CONTROL_ALLOW_ORIGIN, CONTENT_LENGTH, CONTENT_RANGE, ETAG, HeaderName, HeaderValue,
};
use axum::http::{Method, Request, StatusCode};

use super::input::with_hashes;
use super::served::{Answer, Served, served};

pub const MOST_BYTES: [usize; 2] = [64 << 20, 4096];

/// `METHOD target`, a header a line, an empty line, the body; `$A`, `$P` and `$S` are hashes of asset, pack and scene.
pub fn run(data: &[u8]) {
    let served = served();
    let text = with_hashes(data, &served.hashes);
    let Some((request, method, path)) = read(&text) else {
        return;
    };
    let answer = served.answer(request);
    let (status, headers) = (answer.status, &answer.headers);
    assert!(!status.is_server_error(), "{status}");
    assert!(headers.contains_key(ACCESS_CONTROL_ALLOW_ORIGIN));
    let empty = method == Method::HEAD || status == StatusCode::NOT_MODIFIED;
    if empty {
        assert!(answer.body.is_empty());
    } else if let Some(length) = headers.get(CONTENT_LENGTH) {
        let length = length.to_str().ok().and_then(|it| it.parse().ok());
        assert_eq!(length, Some(answer.body.len()));
    }
    if status == StatusCode::NOT_MODIFIED {
        assert!(headers.contains_key(ETAG));
    }
    if method == Method::GET {
        check_bytes(served, &path, &answer);
    }
}

/// That parts of the pack are those that were asked for.
fn check_bytes(served: &Served, path: &str, answer: &Answer) {
    let [(_, asset), (_, pack), _] = served.hashes;
    if answer.status == StatusCode::PARTIAL_CONTENT {
        let range = answer.headers.get(CONTENT_RANGE).expect("a range");
        let range = range.to_str().expect("text").strip_prefix("bytes ");
        let (range, _) = range.and_then(|it| it.split_once('/')).expect("a range");
        let (first, last) = range.split_once('-').expect("two numbers");
        let number = |text: &str| text.parse::<usize>().expect("a number");
        assert_eq!(answer.body.len(), number(last) + 1 - number(first));
        if path == format!("/v1/objects/{pack}") {
            assert_eq!(answer.body, served.pack[number(first)..=number(last)]);
        }
    }
    let pages = path.strip_prefix(&format!("/v1/assets/{asset}/pages/"));
    if let Some((first, last)) = pages.and_then(|it| it.split_once('-'))
        && answer.status == StatusCode::OK
    {
        // The router unescapes paths: what is no number here is one there.
        let pages = &served.asset.pages;
        let page = |text: &str| pages.get(text.parse::<usize>().ok()?);
        if let (Some(first), Some(last)) = (page(first), page(last)) {
            let range = first.offset as usize..(last.offset + u64::from(last.bytes)) as usize;
            assert_eq!(answer.body, served.pack[range]);
        }
    }
}

fn read(text: &[u8]) -> Option<(Request<Body>, Method, String)> {
    let mut lines = text.splitn(2, |&byte| byte == b'\n');
    let (first, mut rest) = (lines.next()?, lines.next().unwrap_or_default());
    let space = first.iter().position(|&byte| byte == b' ')?;
    let method = Method::from_bytes(&first[..space]).ok()?;
    let mut request = Request::builder().method(&method).uri(&first[space + 1..]);
    while !rest.is_empty() {
        let end = rest.iter().position(|&byte| byte == b'\n');
        let end = end.unwrap_or(rest.len());
        let (line, after) = rest.split_at(end);
        rest = after.get(1..).unwrap_or_default();
        if line.is_empty() {
            break;
        }
        let Some(colon) = line.iter().position(|&byte| byte == b':') else {
            continue;
        };
        let name = HeaderName::from_bytes(&line[..colon]).ok()?;
        let value = HeaderValue::from_bytes(line[colon + 1..].trim_ascii()).ok()?;
        request = request.header(name, value);
    }
    let request = request.body(Body::from(rest.to_vec())).ok()?;
    let path = request.uri().path().to_owned();
    Some((request, method, path))
}
