//! JSON: text to the typed document.
//!
//! Three bytes of text may become hundreds of memory, and the parser's errors know a column but no
//! path. So the text is walked once before, by `walk`, which counts what the document would take.

use super::allowance::Allowance;
use super::document::Root;
use super::error::{Fault, Read, malformed, shown};
use super::walk;

/// Longest message of the parser that is looked at: it quotes the text.
const MESSAGE_CHARS: usize = 400;

/// Parses and checks syntax, nesting (serde_json stops at 128 levels), index ranges, the memory
/// that the document takes and the asset's version.
pub(super) fn parse(text: &str, allowance: &Allowance) -> Read<Root> {
    // The text, the strings that are copied out of it, and the longest of them unescaped.
    allowance.take(3 * text.len() as u64, "JSON")?;
    let meter = walk::Meter::new(text.len() as u64, allowance.left_bytes());
    walk::walk(text, &meter).map_err(|error| fault(text, &error))?;
    allowance.take(meter.bytes(), "JSON")?;
    let root = serde_json::from_str(text).map_err(|error| fault(text, &error))?;
    check_version(&root)?;
    Ok(root)
}

fn check_version(root: &Root) -> Read<()> {
    let asset = root.asset.as_ref();
    let version = asset.and_then(|asset| asset.version.as_deref());
    let version = version.unwrap_or("none");
    if version.split('.').next() != Some("2") {
        return Err(malformed("asset.version", "2.0", version));
    }
    match asset.and_then(|asset| asset.min_version.as_deref()) {
        None | Some("2.0" | "1.0") => Ok(()),
        Some(least) => Err(malformed("asset.minVersion", "2.0 at most", least)),
    }
}

fn fault(text: &str, error: &serde_json::Error) -> Fault {
    let message = shown(error, MESSAGE_CHARS);
    // The position is part of the place; serde_json has it in the message, too.
    let message = message
        .rsplit_once(" at line ")
        .map_or(&*message, |it| it.0);
    let (found, expected) = match message.split_once(", expected ") {
        Some((found, expected)) => (found, expected),
        None => (message, "glTF 2.0 JSON"),
    };
    let place = match (error.line(), error.column()) {
        (0, _) => "JSON".to_owned(),
        (line, column) => {
            let path = place(text, line, column);
            format!("JSON line {line} column {column}{path}")
        }
    };
    malformed(place, expected, found)
}

/// ` (accessors[0].count)`: the path of the value that stands before `line` and `column`, both from 1.
fn place(text: &str, line: usize, column: usize) -> String {
    const DEEPEST: usize = 8;
    const KEY_BYTES: usize = 64;
    enum Level<'a> {
        Object(&'a str),
        Array(usize),
    }
    let line_start: usize = text
        .split_inclusive('\n')
        .take(line - 1)
        .map(str::len)
        .sum();
    // An error at a closing bracket is about what the bracket closes.
    let end = (line_start + column.saturating_sub(1)).min(text.len());
    let bytes = &text.as_bytes()[..end];
    let mut levels = Vec::new();
    let mut awaits_key = false;
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        at += 1;
        match byte {
            b'{' => {
                levels.push(Level::Object(""));
                awaits_key = true;
            }
            b'[' => {
                levels.push(Level::Array(0));
                awaits_key = false;
            }
            b'}' | b']' => {
                levels.pop();
                awaits_key = false;
            }
            b',' => match levels.last_mut() {
                Some(Level::Array(index)) => *index += 1,
                _ => awaits_key = true,
            },
            b'"' => {
                let start = at;
                while let Some(&byte) = bytes.get(at) {
                    match byte {
                        b'"' => break,
                        b'\\' => at += 2,
                        _ => at += 1,
                    }
                }
                if awaits_key && let Some(Level::Object(key)) = levels.last_mut() {
                    let length = (at.min(end) - start).min(KEY_BYTES);
                    *key = text.get(start..start + length).unwrap_or("…");
                    awaits_key = false;
                }
                at += 1;
            }
            _ => {}
        }
    }
    let mut path = String::new();
    for level in levels.iter().take(DEEPEST) {
        match level {
            Level::Object("") => {}
            Level::Object(key) if path.is_empty() => path.push_str(key),
            Level::Object(key) => path.extend([".", key]),
            Level::Array(index) => path.push_str(&format!("[{index}]")),
        }
    }
    if levels.len() > DEEPEST {
        path.push('…');
    }
    match path.is_empty() {
        true => path,
        false => format!(" ({path})"),
    }
}
