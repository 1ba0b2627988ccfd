//! JSON: text to the `gltf` crate's typed document.
//!
//! That document keeps indices as `u32` and cuts larger numbers silently, skips `extras` without parsing them, and its errors
//! know a column but no path. So the text is walked once before.

use std::fmt;

use gltf::json::Root;
use serde::de::{DeserializeSeed, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};

use super::error::{Fault, Read, malformed};

/// Parses and checks syntax, nesting (serde_json stops at 128 levels), index ranges and the asset's version.
pub(super) fn parse(text: &str) -> Read<Root> {
    let mut reader = serde_json::Deserializer::from_str(text);
    Walk::default()
        .deserialize(&mut reader)
        .and_then(|()| reader.end())
        .map_err(|error| fault(text, &error))?;
    let root = match Root::from_str(text) {
        Ok(root) => root,
        // The crate asks for `scenes[].nodes`, which the specification leaves optional.
        Err(error) if error.to_string().starts_with("missing field `nodes`") => {
            with_scene_nodes(text).map_err(|error| fault(text, &error))?
        }
        Err(error) => return Err(fault(text, &error)),
    };
    check_version(&root)?;
    Ok(root)
}

fn with_scene_nodes(text: &str) -> serde_json::Result<Root> {
    let mut value: serde_json::Value = serde_json::from_str(text)?;
    let scenes = value.get_mut("scenes").and_then(|it| it.as_array_mut());
    for scene in scenes.into_iter().flatten() {
        if let Some(scene) = scene.as_object_mut() {
            scene
                .entry("nodes")
                .or_insert_with(|| Vec::<u32>::new().into());
        }
    }
    serde_json::from_value(value)
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
    let message = error.to_string();
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
                    *key = text.get(start..at.min(end)).unwrap_or("");
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

/// Visits every value and refuses indices and enumerations beyond `u32`.
#[derive(Clone, Copy, Default)]
struct Walk {
    /// The number here is an index or an enumeration.
    index: bool,
    /// All keys below are names of things with indices (`attributes`, `targets`).
    named_indices: bool,
    /// Below `extras` or `extensions`, where keys mean what their authors like.
    foreign: bool,
}

const INDEX_KEYS: &[&str] = &[
    "buffer",
    "bufferView",
    "camera",
    "children",
    "componentType",
    "index",
    "indices",
    "input",
    "inverseBindMatrices",
    "joints",
    "magFilter",
    "material",
    "mesh",
    "minFilter",
    "mode",
    "node",
    "nodes",
    "output",
    "sampler",
    "scene",
    "skeleton",
    "skin",
    "source",
    "target",
    "texCoord",
    "wrapS",
    "wrapT",
];

impl Walk {
    fn below(self, key: &str) -> Self {
        if self.foreign || matches!(key, "extras" | "extensions") {
            return Self {
                index: false,
                named_indices: false,
                foreign: true,
            };
        }
        let named_indices = self.named_indices || matches!(key, "attributes" | "targets");
        Self {
            index: named_indices || INDEX_KEYS.contains(&key),
            named_indices,
            foreign: false,
        }
    }
}

impl<'de> DeserializeSeed<'de> for Walk {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk {
    type Value = ();

    fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str("any JSON value")
    }

    fn visit_bool<E>(self, _: bool) -> Result<(), E> {
        Ok(())
    }

    fn visit_i64<E>(self, _: i64) -> Result<(), E> {
        Ok(())
    }

    fn visit_u64<E: serde::de::Error>(self, value: u64) -> Result<(), E> {
        // u32::MAX itself stands for "none" inside the crate.
        if self.index && value >= u64::from(u32::MAX) {
            let message = format!("{value}, expected an index below {}", u32::MAX);
            return Err(E::custom(message));
        }
        Ok(())
    }

    fn visit_f64<E>(self, _: f64) -> Result<(), E> {
        Ok(())
    }

    fn visit_str<E>(self, _: &str) -> Result<(), E> {
        Ok(())
    }

    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut values: A) -> Result<(), A::Error> {
        while values.next_element_seed(self)?.is_some() {}
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut values: A) -> Result<(), A::Error> {
        while let Some(key) = values.next_key::<String>()? {
            if key.len() > u16::MAX as usize {
                return Err(A::Error::custom("a key of more than 65535 bytes"));
            }
            values.next_value_seed(self.below(&key))?;
        }
        Ok(())
    }
}
