//! Files of upload tokens.

use axum::http::StatusCode;
use lodestream_server::http::tokens::Tokens;

use super::input::folder;
use super::served::upload_status;

pub const MOST_BYTES: [usize; 2] = [16 << 20, 64];

/// What an error may say of a line, numbers left out.
const SAID: [&str; 7] = [
    "none",
    "a control character",
    "a byte order mark",
    "a first word of  bytes that is no token",
    "word , which no scene can be named",
    "word , which is the token of line ",
    "the token of line  again",
];

pub fn run(data: &[u8]) {
    let file = folder("tokens").join("file");
    std::fs::write(&file, data).expect("writes");
    let text = std::str::from_utf8(data).unwrap_or_default();
    let lines = text.lines().map(|line| line.trim_matches([' ', '\t']));
    let lines: Vec<&str> = lines
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .collect();
    match Tokens::from_upload_file(&file) {
        Ok(known) => {
            assert!(!lines.is_empty());
            for line in lines.iter().take(4) {
                let token = line.split([' ', '\t']).next().unwrap_or_default();
                assert!(token.len() >= 16, "{token:?}");
                let header = [b"Bearer ", token.as_bytes()].concat();
                let status = upload_status(known.clone(), &header);
                // A line that names other scenes than the one that is asked for is refused as such.
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
