//! Files of upload tokens.

use axum::http::StatusCode;
use lodestream_server::http::tokens::Tokens;

use super::input::folder;
use super::served::upload_status;

pub const MOST_BYTES: [usize; 2] = [16 << 20, 64];

/// What an error may say of a line, numbers left out.
const SAID: [&str; 4] = [
    "none",
    "line  of  bytes",
    "one of  in line ",
    "line  with  more words",
];

pub fn run(data: &[u8]) {
    let file = folder("tokens").join("file");
    std::fs::write(&file, data).expect("writes");
    let read = Tokens::read(&file);
    let text = std::str::from_utf8(data).unwrap_or_default();
    let lines = text.lines().map(str::trim);
    let tokens: Vec<&str> = lines
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .collect();
    let is_token = |line: &&str| line.len() >= 16 && !line.contains(char::is_whitespace);
    let fits = !tokens.is_empty() && tokens.iter().all(is_token);
    assert_eq!(read.is_ok(), fits);
    match read {
        Ok(known) => {
            for token in tokens.iter().take(4) {
                let header = [b"Bearer ", token.as_bytes()].concat();
                let status = upload_status(known.clone(), &header);
                // None: no header has such bytes.
                assert_ne!(status, Some(StatusCode::UNAUTHORIZED), "{token:?}");
            }
            let other = upload_status(known, b"Bearer none of them is one of them");
            assert_eq!(other, Some(StatusCode::UNAUTHORIZED));
        }
        Err(error) => {
            // Never the line itself.
            let error = error.to_string();
            let found = error.rsplit_once(", found ").map_or("none", |it| it.1);
            let found: String = found.chars().filter(|it| !it.is_ascii_digit()).collect();
            assert!(SAID.contains(&&*found), "{error}");
        }
    }
}
