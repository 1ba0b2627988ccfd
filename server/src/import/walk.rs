//! Walk: a pass over JSON before the typed document is made of it. It allocates nothing but keys,
//! and refuses a document that would take too much memory.

use std::cell::Cell;
use std::fmt;
use std::mem::size_of;

use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};

use super::document;
use super::scene::{Instance, Material};

/// Memory that a document may take for each byte of its text. Real ones come to 40 at most: a
/// million nodes of few bytes each. An empty material comes to 400.
const MOST_BYTES_PER_BYTE: u64 = 64;
const BYTES_ALWAYS: u64 = 256 << 20;

/// Counts the bytes that the typed document takes.
pub(super) struct Meter {
    bytes: Cell<u64>,
    most_bytes: u64,
}

impl Meter {
    /// For so many bytes of text; `most_bytes` is all that there is.
    pub(super) fn new(text_bytes: u64, most_bytes: u64) -> Self {
        let real = text_bytes.saturating_mul(MOST_BYTES_PER_BYTE);
        Self {
            bytes: Cell::new(0),
            most_bytes: real.max(BYTES_ALWAYS).min(most_bytes),
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        self.bytes.get()
    }

    fn add<E: Error>(&self, bytes: u64) -> Result<(), E> {
        let sum = self.bytes.get().saturating_add(bytes);
        self.bytes.set(sum);
        match sum <= self.most_bytes {
            true => Ok(()),
            false => {
                let most = self.most_bytes;
                let message =
                    format!("more, expected objects that take {most} bytes of memory at most");
                Err(E::custom(message))
            }
        }
    }
}

/// Visits every value of `text`.
pub(super) fn walk(text: &str, meter: &Meter) -> serde_json::Result<()> {
    let mut reader = serde_json::Deserializer::from_str(text);
    let root = Walk {
        meter,
        kind: Kind::Typed,
        item: Item::OTHER,
    };
    root.deserialize(&mut reader)?;
    reader.end()
}

/// How the values below are held.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// As a struct of the document.
    Typed,
    /// As a struct that keeps the names of members that it does not know: `extensions`.
    Extensions,
    /// As names and indices: an ordered map.
    Attributes,
    /// Not at all: `extras`.
    Nothing,
}

#[derive(Clone, Copy)]
struct Walk<'a> {
    meter: &'a Meter,
    kind: Kind,
    /// An object or array in an array here.
    item: Item,
}

/// An index, a number, or a short string.
const SCALAR_BYTES: usize = 24;
/// The first entry of a map allocates a node of eleven; a node is half full at least.
const ATTRIBUTES_BYTES: u64 = 512;
const ATTRIBUTE_BYTES: u64 = 96;
/// With what it boxes.
const EXTENSIONS_BYTES: u64 = (size_of::<document::Extensions>()
    + size_of::<document::Meshopt>()
    + size_of::<document::SpecularGlossiness>()
    + size_of::<document::TextureTransform>()) as u64;
const EXTENSION_BYTES: u64 = 2 * SCALAR_BYTES as u64;

/// Memory of an object in a list.
#[derive(Clone, Copy)]
struct Item {
    /// Its place in the list, of which a vector has up to twice as many.
    place_bytes: u64,
    /// Memory that the import takes for it besides.
    own_bytes: u64,
}

impl Item {
    const fn new(place_bytes: usize, own_bytes: usize) -> Self {
        Self {
            place_bytes: place_bytes as u64,
            own_bytes: own_bytes as u64,
        }
    }

    const SCALAR: Self = Self::new(SCALAR_BYTES, 0);
    const OTHER: Self = Self::new(64, 0);

    /// Of the list `key`.
    fn of(key: &str) -> Self {
        /// Notes, names and hashes of a mesh until it is built.
        const MESH: usize = 1536;
        /// A checked primitive with its accessors.
        const PRIMITIVE: usize = 768;
        /// A morph target with its accessors.
        const TARGET: usize = 256;
        /// A place on the stack of the walk over the nodes, and marks.
        const NODE: usize = 2 * size_of::<Instance>() + 96;
        /// Notes of a skin until the meshes are built.
        const SKIN: usize = 256;
        /// The reason why an object cannot be read.
        const REASON: usize = 128;
        use document as d;
        match key {
            "accessors" => Self::new(
                size_of::<d::Tolerant<d::Accessor>>(),
                size_of::<d::Sparse>() + REASON,
            ),
            "buffers" => Self::new(size_of::<d::Buffer>(), 768),
            "bufferViews" => Self::new(size_of::<d::BufferView>(), 0),
            "images" => Self::new(size_of::<d::Tolerant<d::Image>>(), 256 + REASON),
            "materials" => Self::new(
                size_of::<d::Tolerant<d::Material>>(),
                2 * size_of::<Material>() + REASON,
            ),
            "meshes" => Self::new(size_of::<d::Mesh>(), MESH),
            "nodes" => Self::new(size_of::<d::Tolerant<d::Node>>(), NODE + REASON),
            "primitives" => Self::new(size_of::<d::Primitive>(), PRIMITIVE),
            "samplers" => Self::new(size_of::<d::Tolerant<d::Sampler>>(), REASON),
            "scenes" => Self::new(size_of::<d::Scene>(), 0),
            "skins" => Self::new(size_of::<d::Skin>(), SKIN),
            "targets" => Self::new(size_of::<d::Attributes>(), TARGET),
            "textures" => Self::new(size_of::<d::Tolerant<d::Texture>>(), REASON),
            _ => Self::OTHER,
        }
    }
}

/// Lists and objects that nobody reads.
const IGNORED: &[&str] = &["animations", "cameras", "extras", "max", "min"];

impl Walk<'_> {
    fn below(self, key: &str) -> Self {
        let kind = match (self.kind, key) {
            (Kind::Nothing, _) => Kind::Nothing,
            (Kind::Typed, key) if IGNORED.contains(&key) => Kind::Nothing,
            (Kind::Typed, "extensions") => Kind::Extensions,
            (Kind::Typed, "attributes" | "targets") => Kind::Attributes,
            _ => Kind::Typed,
        };
        Self {
            kind,
            item: Item::of(key),
            ..self
        }
    }

    /// Counts an entry of a map, its first or another.
    fn add_entry<E: Error>(self, first: bool, key_bytes: usize) -> Result<(), E> {
        let (map, entry) = match self.kind {
            Kind::Typed | Kind::Nothing => return Ok(()),
            Kind::Attributes => (ATTRIBUTES_BYTES, ATTRIBUTE_BYTES),
            Kind::Extensions => (EXTENSION_BYTES, EXTENSION_BYTES),
        };
        let key_bytes = key_bytes as u64;
        self.meter.add(key_bytes + if first { map } else { entry })
    }
}

impl<'de> DeserializeSeed<'de> for Walk<'_> {
    /// Whether it is an object or an array.
    type Value = bool;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<bool, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk<'_> {
    type Value = bool;

    fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str("any JSON value")
    }

    fn visit_bool<E>(self, _: bool) -> Result<bool, E> {
        Ok(false)
    }

    fn visit_i64<E>(self, _: i64) -> Result<bool, E> {
        Ok(false)
    }

    fn visit_u64<E>(self, _: u64) -> Result<bool, E> {
        Ok(false)
    }

    fn visit_f64<E>(self, _: f64) -> Result<bool, E> {
        Ok(false)
    }

    fn visit_str<E>(self, _: &str) -> Result<bool, E> {
        Ok(false)
    }

    fn visit_unit<E>(self) -> Result<bool, E> {
        Ok(false)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut values: A) -> Result<bool, A::Error> {
        const LEAST_CAPACITY: u64 = 4;
        let (mut count, mut capacity) = (0u64, 0u64);
        while let Some(is_object) = values.next_element_seed(self)? {
            count += 1;
            if self.kind == Kind::Nothing {
                continue;
            }
            let item = match is_object {
                true => self.item,
                false => Item::SCALAR,
            };
            self.meter.add(item.own_bytes)?;
            // A vector doubles when it is full, and does not go back.
            if count > capacity {
                let grown = (2 * capacity).max(LEAST_CAPACITY);
                self.meter.add((grown - capacity) * item.place_bytes)?;
                capacity = grown;
            }
        }
        Ok(true)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut values: A) -> Result<bool, A::Error> {
        if self.kind == Kind::Extensions {
            self.meter.add(EXTENSIONS_BYTES)?;
        }
        let mut first = true;
        while let Some(key) = values.next_key::<String>()? {
            if key.len() > u16::MAX as usize {
                return Err(A::Error::custom("a key of more than 65535 bytes"));
            }
            self.add_entry(first, key.len())?;
            first = false;
            values.next_value_seed(self.below(&key))?;
        }
        Ok(true)
    }
}
