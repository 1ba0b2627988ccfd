//! JSON: text to the `gltf` crate's typed document.
//!
//! That document keeps indices as `u32` and cuts larger numbers silently, skips `extras` without
//! parsing them, its errors know a column but no path, and three bytes of text may become a
//! kilobyte. So the text is walked once before, by `walk`, which counts what the document would
//! take.

use gltf::json::Root;
use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::value::RawValue;

use super::allowance::Allowance;
use super::error::{Fault, Read, malformed, shown};
use super::walk;

/// Longest message of the parser that is looked at: it quotes the text.
const MESSAGE_CHARS: usize = 400;

/// Parses and checks syntax, nesting (serde_json stops at 128 levels), index ranges, the memory
/// that the document takes and the asset's version.
pub(super) fn parse(text: &str, allowance: &Allowance) -> Read<Root> {
    // The text, the strings and extras that are copied out of it, and a copy with what it lacks.
    allowance.take(3 * text.len() as u64, "JSON")?;
    let meter = walk::Meter::new(text.len() as u64, allowance.left_bytes());
    walk::walk(text, &meter).map_err(|error| fault(text, &error))?;
    allowance.take(meter.bytes(), "JSON")?;
    let root = match Root::from_str(text) {
        Ok(root) => root,
        // The crate asks for `scenes[].nodes`, which the specification leaves optional.
        Err(error) if shown(&error, MESSAGE_CHARS).starts_with("missing field `nodes`") => {
            with_scene_nodes(text).map_err(|error| fault(text, &error))?
        }
        Err(error) => return Err(fault(text, &error)),
    };
    check_version(&root)?;
    Ok(root)
}

/// The document of `text` with empty lists of nodes where scenes have none.
fn with_scene_nodes(text: &str) -> serde_json::Result<Root> {
    #[derive(Deserialize)]
    struct Document<'a> {
        #[serde(borrow, default)]
        scenes: Vec<&'a RawValue>,
    }
    #[derive(Deserialize)]
    struct Scene {
        nodes: Option<IgnoredAny>,
    }
    let document: Document = serde_json::from_str(text)?;
    let mut whole = String::with_capacity(text.len());
    let mut copied = 0;
    for scene in document.scenes {
        let Some(inside) = scene.get().strip_prefix('{') else {
            continue;
        };
        if serde_json::from_str::<Scene>(scene.get())?.nodes.is_some() {
            continue;
        }
        // `inside` is a part of `text`.
        let start = inside.as_ptr() as usize - text.as_ptr() as usize;
        whole.push_str(&text[copied..start]);
        let is_empty = inside.trim_start().starts_with('}');
        whole.push_str(if is_empty {
            "\"nodes\":[]"
        } else {
            "\"nodes\":[],"
        });
        copied = start;
    }
    whole.push_str(&text[copied..]);
    serde_json::from_str(&whole)
}

fn check_version(root: &Root) -> Read<()> {
    let version = &root.asset.version;
    if version.split('.').next() != Some("2") {
        return Err(malformed("asset.version", "2.0", version));
    }
    match root.asset.min_version.as_deref() {
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

#[cfg(test)]
mod tests {
    use super::with_scene_nodes;

    #[test]
    fn scenes_without_nodes_get_an_empty_list() {
        let text =
            r#"{"asset":{"version":"2.0"},"scenes":[{}, { "name" : "a}" },{"nodes":[1]},{ }]}"#;
        let root = with_scene_nodes(text).expect("parses");
        let nodes: Vec<usize> = root.scenes.iter().map(|scene| scene.nodes.len()).collect();
        assert_eq!(nodes, [0, 0, 1, 0]);
        assert_eq!(root.scenes[1].name.as_deref(), Some("a}"));
    }
}
