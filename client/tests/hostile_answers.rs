//! Every other answer of a server that means its viewer harm: lists, objects, pages, posts, and how
//! slowly they come.
// A failing unwrap is a failing test.
#![allow(clippy::unwrap_used)]

mod hostile_common;
mod stream_common;

use std::io;
use std::time::Duration;

use hostile_common::counting::{Counting, Measure};
use hostile_common::scene::*;
use hostile_common::{Client, Hostile};
use lodestream_client::stream::{
    PageState, PixelErrorControl, Residency, Source, StreamError, StreamLimits, StreamingRequest,
};
use lodestream_format::ContentHash;
use lodestream_format::wire::{BlockKind, PageStatus, PageWant, PagesPost, block_header};
use stream_common::config;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_list_of_scenes_has_an_end() {
    let entry = |name: &str| {
        let hash = ContentHash::of(b"scene");
        format!("{{\"name\":\"{name}\",\"scene\":\"{hash}\",\"published_secs\":1}}")
    };
    let next = |path: &str| {
        let after = path.split("after=s").nth(1).unwrap_or("0");
        format!("s{:012}", after.parse::<u64>().unwrap() + 1)
    };
    let long = (0..2000)
        .map(|_| entry(&"a".repeat(200)))
        .collect::<Vec<_>>()
        .join(",");
    type Page = Box<dyn Fn(&str) -> String + Send + Sync>;
    let cases: [(&str, Page, &str); 6] = [
        (
            "full pages",
            Box::new(move |path| format!("{{\"scenes\":[{long}],\"next\":\"{}\"}}", next(path))),
            "expected at most 67108864 bytes, found more",
        ),
        (
            "empty pages",
            Box::new(move |path| format!("{{\"scenes\":[],\"next\":\"{}\"}}", next(path))),
            "expected at most 67108864 bytes, found more",
        ),
        (
            "one page of 5 MB",
            Box::new(|_| format!("{{\"scenes\":[]}}{}", " ".repeat(5 << 20))),
            "expected 4194304 bytes, found",
        ),
        (
            "a name that is none",
            Box::new(move |_| format!("{{\"scenes\":[{}]}}", entry("\\u001b[2J"))),
            "scene name: expected",
        ),
        (
            "a name of a megabyte",
            Box::new(move |_| format!("{{\"scenes\":[{}]}}", entry(&"a".repeat(MIB)))),
            "scene name: expected",
        ),
        (
            "the same page again",
            Box::new(|_| "{\"scenes\":[],\"next\":\"a\"}".to_owned()),
            "next: expected a name after",
        ),
    ];
    for (what, page, expected) in cases {
        let server = Hostile::start(move |path, client| client.answer("", page(path).as_bytes()));
        let (runtime, source) = (runtime(), source(&server));
        let measure = Measure::new();
        let error = runtime.block_on(source.scenes()).unwrap_err();
        refused(what, &error, expected);
        let (peak, sent) = (measure.peak_bytes(), server.sent_bytes());
        assert!(peak < 128 * MIB, "{what}: {peak} bytes of memory");
        assert!(sent < 2 * MOST_SENT_BYTES, "{what}: {sent} bytes sent");
    }
}

/// A byte now and then, at every stage of every kind of answer.
#[test]
fn trickles_and_silence_are_given_up() {
    let scene = made();
    let opened = scene.opened.assets[0].clone();
    let body = blocks(&parts(&scene));
    let pause = Duration::from_millis(200);
    type Answer = Box<dyn Fn(&str, &mut Client) -> io::Result<()> + Send + Sync>;
    let answers: Vec<(&str, Answer)> = vec![
        ("silence", Box::new(|_, client| client.stall())),
        (
            "headers that trickle",
            Box::new(move |_, client| client.trickle(b"H", pause)),
        ),
        (
            "headers without end",
            Box::new(move |_, client| {
                client.send(b"HTTP/1.1 200 OK\r\n")?;
                client.trickle(b"x: y\r\n", pause)
            }),
        ),
        (
            "hints without end",
            Box::new(move |_, client| client.trickle(b"HTTP/1.1 103 Early Hints\r\n\r\n", pause)),
        ),
        (
            "a body that trickles",
            Box::new(move |_, client| {
                client.begin("")?;
                client.trickle(b"1\r\nL\r\n", pause)
            }),
        ),
        (
            "a body that stalls",
            Box::new(move |_, client| {
                client.begin("")?;
                client.chunk(&body[..1000])?;
                client.stall()
            }),
        ),
    ];
    let runtime = runtime();
    for (what, answer) in answers {
        let server = Hostile::start(answer);
        let source = source(&server);
        let post = PagesPost {
            viewer: 1,
            sequence: 1,
            wants: vec![],
        };
        let assets = std::slice::from_ref(&opened);
        let hash = ContentHash::of(b"object");
        let (open, scenes, object, pages, posted) = runtime.block_on(async {
            tokio::join!(
                source.open("made"),
                source.scenes(),
                source.object(&hash, 1 << 20),
                source.pages(&opened, 0, 0),
                source.post_pages(&post, assets, |_| ()),
            )
        });
        let errors = [
            open.err(),
            scenes.err(),
            object.err(),
            pages.err(),
            posted.err(),
        ];
        for error in errors {
            let error = error.expect(what);
            let is_slow = matches!(error, StreamError::Slow { .. });
            // Bodies may show their content before their time is over, and transports may lose
            // patience.
            let is_early = what.starts_with("a body") || what.starts_with("hints");
            assert!(is_slow || is_early, "{what}: {error}");
        }
    }
}

/// Far more slowly than any modem, yet all the time.
#[test]
fn a_slow_link_opens() {
    let scene = made();
    let body = blocks(&parts(&scene));
    let server = Hostile::start(move |_, client| {
        std::thread::sleep(Duration::from_millis(300));
        client.begin("")?;
        for piece in body.chunks(body.len() / 40) {
            std::thread::sleep(Duration::from_millis(100));
            client.chunk(piece)?;
        }
        client.chunk(&[])
    });
    // A grace that no pause of a busy machine reaches.
    let limits = StreamLimits {
        grace: Duration::from_secs(20),
        least_bytes_a_sec: 1.0,
        ..limits()
    };
    let source = Source::connect_within(&server.url, &limits).unwrap();
    let opened = runtime().block_on(source.open("made")).unwrap();
    assert_eq!(opened.page_count(), scene.opened.page_count());
}

#[test]
fn http2_floods_are_hung_up_on() {
    const DATA: u8 = 0;
    const HEADERS: u8 = 1;
    const CONTINUATION: u8 = 9;
    const END_HEADERS: u8 = 4;
    /// `:status: 200` of the static table (RFC 7541, appendix A).
    const STATUS_200: [u8; 1] = [0x88];
    /// A literal field without indexing: `x: y`.
    const FIELD: [u8; 5] = [0, 1, b'x', 1, b'y'];
    type Answer = Box<dyn Fn(&mut Client) -> io::Result<()> + Send + Sync>;
    let floods: Vec<(&str, Answer)> = vec![
        (
            "continuations",
            Box::new(|client| {
                client.frame(HEADERS, 0, 1, &STATUS_200)?;
                loop {
                    client.frame(CONTINUATION, 0, 1, &FIELD.repeat(2000))?;
                }
            }),
        ),
        (
            "empty data",
            Box::new(|client| {
                client.frame(HEADERS, END_HEADERS, 1, &STATUS_200)?;
                loop {
                    client.frame(DATA, 0, 1, &[])?;
                }
            }),
        ),
        (
            "data that trickles",
            Box::new(|client| {
                client.frame(HEADERS, END_HEADERS, 1, &STATUS_200)?;
                loop {
                    std::thread::sleep(Duration::from_millis(200));
                    client.frame(DATA, 0, 1, b"L")?;
                }
            }),
        ),
    ];
    for (what, flood) in floods {
        let server = Hostile::start_http2(move |_, client| {
            client.http2_request()?;
            flood(client)
        });
        let (runtime, source) = (runtime(), source(&server));
        let measure = Measure::new();
        let opened = runtime.block_on(source.open("made"));
        assert!(opened.is_err(), "{what}");
        let peak = measure.peak_bytes();
        assert!(peak < PEAK_BYTES, "{what}: {peak} bytes");
    }
}

#[test]
fn redirects_are_not_followed() {
    let elsewhere = Hostile::start(|_, client| client.answer("", b"{\"scenes\":[]}"));
    for to in [
        format!("{}/v1/scenes", elsewhere.url),
        "/v1/scenes".to_owned(),
    ] {
        let field = format!("HTTP/1.1 302 Found\r\nLocation: {to}\r\nContent-Length: 0\r\n\r\n");
        let server = Hostile::start(move |_, client| client.send(field.as_bytes()));
        let error = runtime().block_on(source(&server).scenes()).unwrap_err();
        refused(
            "a redirect",
            &error,
            &format!("found 302 to {to:?}, which is not followed"),
        );
        assert_eq!((server.requests(), elsewhere.requests()), (1, 0));
    }
}

#[test]
fn objects_and_pages_keep_to_their_size() {
    let scene = made();
    let opened = scene.opened.assets[0].clone();
    let runtime = runtime();
    let endless = Hostile::start(|_, client| {
        client.begin("")?;
        loop {
            client.chunk(&[0; 65_536])?;
        }
    });
    let source_of = |server: &Hostile| source(server);
    let measure = Measure::new();
    let hash = ContentHash::of(b"object");
    let error = runtime
        .block_on(source_of(&endless).object(&hash, 1 << 20))
        .unwrap_err();
    refused("an object", &error, "expected 1048576 bytes, found");
    let error = runtime
        .block_on(source_of(&endless).pages(&opened, 0, 0))
        .unwrap_err();
    refused("a page", &error, "bytes, found");
    assert!(measure.peak_bytes() < PEAK_BYTES);
    drop(measure);
    let announced = Hostile::start(|_, client| {
        client.send(b"HTTP/1.1 200 OK\r\nContent-Length: 1000000000000\r\n\r\n")?;
        client.stall()
    });
    let error = runtime
        .block_on(source_of(&announced).object(&hash, 1 << 20))
        .unwrap_err();
    refused(
        "an announced object",
        &error,
        "expected 1048576 bytes, found 1000000000000",
    );
    let long = "x".repeat(5000);
    for encoding in ["gzip", "zstd", "br", &long] {
        let field = format!("Content-Encoding: {encoding}\r\n");
        let packed = Hostile::start(move |_, client| client.answer(&field, &[0; 100]));
        let error = runtime
            .block_on(source_of(&packed).object(&hash, 1 << 20))
            .unwrap_err();
        refused(encoding, &error, "content-encoding: expected");
    }
}

#[test]
fn a_post_takes_each_page_that_it_asked_for_once() {
    let scene = made();
    let opened = scene.opened.assets[0].clone();
    let (hash, frames) = (opened.hash, scene.assets[0].frames.clone());
    let page = |page: u32| block(BlockKind::Page, page, hash, &frames[page as usize]);
    let other = scene.opened.assets[1].hash;
    let longer = [&frames[0][..], &[0]].concat();
    let failed = block_header(BlockKind::Page, PageStatus::Failed, 0, hash, 5).to_vec();
    for (what, body, taken, expected) in [
        (
            "a page that nobody asked for",
            [page(0), page(2)].concat(),
            1,
            "expected a page that was asked for, once",
        ),
        (
            "the same page again",
            page(0).repeat(1000),
            1,
            "expected a page that was asked for, once",
        ),
        (
            "a page of another asset",
            block(BlockKind::Page, 0, other, &frames[0]),
            0,
            "expected a page that was asked for",
        ),
        (
            "a longer page",
            block(BlockKind::Page, 0, hash, &longer),
            0,
            "bytes, found",
        ),
        (
            "a failure with a payload",
            [failed, vec![0; 5]].concat(),
            0,
            "expected 0 bytes, found 5 bytes",
        ),
        (
            "a scene",
            block(BlockKind::Scene, 0, hash, &[0; 9]),
            0,
            "expected a page, found Scene",
        ),
    ] {
        let server = Hostile::start(move |_, client| {
            client.begin("")?;
            client.chunk(&body)?;
            client.stall()
        });
        let post = PagesPost {
            viewer: 1,
            sequence: 1,
            wants: vec![PageWant {
                asset: hash,
                first: 0,
                last: 1,
                priority: 1.0,
            }],
        };
        let mut pages = Vec::new();
        let assets = std::slice::from_ref(&opened);
        let source = source(&server);
        let posted = source.post_pages(&post, assets, |page| pages.push(page.page));
        let error = runtime().block_on(posted).unwrap_err();
        refused(what, &error, expected);
        assert_eq!(pages.len(), taken, "{what}");
    }
}

/// A server that says "in a year" is asked again in minutes, and an opening does not wait for it.
#[test]
fn retry_after_a_year_is_minutes() {
    let server = Hostile::start(|_, client| {
        client.send(b"HTTP/1.1 503 Busy\r\nRetry-After: 31536000\r\nContent-Length: 0\r\n\r\n")
    });
    let busy = runtime()
        .block_on(source(&server).open("made"))
        .unwrap_err();
    refused("a busy server", &busy, "expected status 200, found 503");
    assert_eq!(server.requests(), 1);
    let scene = made();
    let settings = config(&scene.opened, 50, PixelErrorControl::Governed);
    let mut residency = Residency::new(&scene.opened, settings).unwrap();
    residency.take_changes();
    let requests: Vec<_> = (0..scene.opened.page_count())
        .map(|page| StreamingRequest {
            page,
            error_px: 9.0,
            priority_px: 9.0,
        })
        .collect();
    residency.update(0.0, &requests);
    let fetch = residency.next_fetches(0.0)[0];
    let page = scene.opened.assets[fetch.asset_index].page_base + fetch.first_page;
    residency.arrived(page, Err(busy), 0.0);
    let state = residency.page_state(page);
    let PageState::Failed { retry_at_secs, .. } = state else {
        panic!("{state:?}");
    };
    assert!(retry_at_secs <= 400.0, "{retry_at_secs}");
}
