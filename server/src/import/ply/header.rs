//! The header: format, elements, properties.

use crate::import::error::{Read, malformed};
use crate::import::file::Extent;
use crate::import::text;

/// Longer headers are refused; real ones take a few hundred bytes.
const MOST_BYTES: u64 = 1 << 20;
/// Kinds of elements; real files have two to five.
const MOST_ELEMENTS: usize = 256;

pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Names that `comment TextureFile` gives: the habit of scanning programs.
    pub(super) textures: Vec<String>,
    /// Where the first element starts in the file.
    pub(super) body_offset: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

#[derive(Clone)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

#[derive(Clone)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// The number in the first [`Scalar::bytes`] of `bytes`, which must be there.
    pub(super) fn read(self, bytes: &[u8], big_endian: bool) -> f64 {
        let mut word = [0; 8];
        let length = self.bytes();
        word[..length].copy_from_slice(&bytes[..length]);
        if big_endian {
            word[..length].reverse();
        }
        let [a, b, c, d, ..] = word;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(word),
        }
    }
}

impl Scalar {
    /// Appends `value` in little-endian bytes; integers are held to their range.
    pub(super) fn push(self, value: f64, bytes: &mut Vec<u8>) {
        match self {
            Self::I8 => bytes.push(value as i8 as u8),
            Self::U8 => bytes.push(value as u8),
            Self::I16 => bytes.extend((value as i16).to_le_bytes()),
            Self::U16 => bytes.extend((value as u16).to_le_bytes()),
            Self::I32 => bytes.extend((value as i32).to_le_bytes()),
            Self::U32 => bytes.extend((value as u32).to_le_bytes()),
            Self::F32 => bytes.extend((value as f32).to_le_bytes()),
            Self::F64 => bytes.extend(value.to_le_bytes()),
        }
    }
}

impl Element {
    /// Bytes of a binary row; `None` where a list makes rows differ.
    pub(super) fn row_bytes(&self) -> Option<usize> {
        let bytes = |property: &Property| match property.kind {
            Kind::Scalar(scalar) => Some(scalar.bytes()),
            Kind::List { .. } => None,
        };
        self.properties.iter().map(bytes).sum()
    }

    /// The least that a row takes: binary bytes, or characters with their separator.
    pub(super) fn least_row_bytes(&self, encoding: Encoding) -> u64 {
        let bytes = |property: &Property| match (encoding, property.kind) {
            (Encoding::Text, _) => 2,
            (_, Kind::Scalar(scalar) | Kind::List { count: scalar, .. }) => scalar.bytes() as u64,
        };
        self.properties.iter().map(bytes).sum()
    }
}

/// Parses the header at the start of `file`.
pub(super) fn parse(file: &Extent) -> Read<Header> {
    let head = file.head(MOST_BYTES)?;
    let mark = text::mark_bytes(&head);
    let head = text::without_mark(&head);
    let mut header = Header {
        encoding: Encoding::Text,
        elements: Vec::new(),
        textures: Vec::new(),
        body_offset: 0,
    };
    // Old programs of the Macintosh end lines by a carriage return alone. The body may begin with
    // any byte, so that one line says how all end.
    let is_old = head.starts_with(b"ply\r") && !head.starts_with(b"ply\r\n");
    let end = if is_old { b'\r' } else { b'\n' };
    let mut format_seen = false;
    let mut at = 0;
    for number in 1u32.. {
        let place = format!("header line {number}");
        let Some(length) = head[at..].iter().position(|&byte| byte == end) else {
            return Err(malformed(
                place,
                "end_header",
                "the end of the header's bytes",
            ));
        };
        let line = String::from_utf8_lossy(&head[at..at + length]);
        at += length + 1;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["ply"] if number == 1 => {}
            _ if number == 1 => return Err(malformed(place, "ply", line.trim_end())),
            ["format", name, "1.0"] => {
                format_seen = true;
                header.encoding = match name {
                    "ascii" => Encoding::Text,
                    "binary_little_endian" => Encoding::LittleEndian,
                    "binary_big_endian" => Encoding::BigEndian,
                    _ => {
                        let expected = "ascii, binary_little_endian or binary_big_endian";
                        return Err(malformed(place, expected, name));
                    }
                };
            }
            ["comment", "TextureFile", ..] => {
                let name = line.split_once("TextureFile").map_or("", |it| it.1.trim());
                header.textures.push(name.to_owned());
            }
            ["comment" | "obj_info", ..] | [] => {}
            ["element", name, count] => {
                let Ok(count) = count.parse() else {
                    return Err(malformed(place, "a number of elements", count));
                };
                if header.elements.iter().any(|it| it.name == name) {
                    return Err(malformed(place, "each element once", name));
                }
                if header.elements.len() >= MOST_ELEMENTS {
                    return Err(malformed(
                        place,
                        format!("{MOST_ELEMENTS} elements at most"),
                        name,
                    ));
                }
                header.elements.push(Element {
                    name: name.to_owned(),
                    count,
                    properties: Vec::new(),
                });
            }
            ["property", ref kind @ .., name] => {
                let kind = property_kind(kind);
                let (Some(kind), Some(element)) = (kind, header.elements.last_mut()) else {
                    let expected = "a property of a known type after its element";
                    return Err(malformed(place, expected, line.trim_end()));
                };
                element.properties.push(Property {
                    name: name.to_owned(),
                    kind,
                });
            }
            ["end_header"] => break,
            _ => {
                let expected = "format, comment, element, property or end_header";
                return Err(malformed(place, expected, line.trim_end()));
            }
        }
    }
    if !format_seen {
        return Err(malformed("header", "a format line", "none"));
    }
    header.body_offset = mark + at as u64;
    Ok(header)
}

fn property_kind(words: &[&str]) -> Option<Kind> {
    match words {
        [scalar] => Scalar::named(scalar).map(Kind::Scalar),
        ["list", count, item] => {
            let (count, item) = (Scalar::named(count)?, Scalar::named(item)?);
            count.is_integer().then_some(Kind::List { count, item })
        }
        _ => None,
    }
}
