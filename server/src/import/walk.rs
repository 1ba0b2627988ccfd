//! Walk: a pass over JSON before the typed document is made of it. It allocates nothing but keys,
//! and refuses indices beyond `u32` and a document that would take too much memory.

use std::cell::Cell;
use std::fmt;
use std::mem::size_of;

use gltf::json;
use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};

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
        index: false,
        named_indices: false,
        item: Item::OTHER,
    };
    root.deserialize(&mut reader)?;
    reader.end()
}

/// How the values below are held.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// As a struct of the crate.
    Typed,
    /// As names and indices: an ordered map.
    Attributes,
    /// As a tree of values, read by way of another: `extensions`, `min` and `max`.
    Tree,
    /// As text: `extras`.
    Text,
}

#[derive(Clone, Copy)]
struct Walk<'a> {
    meter: &'a Meter,
    kind: Kind,
    /// The number here is an index or an enumeration.
    index: bool,
    /// All keys below are names of things with indices (`attributes`, `targets`).
    named_indices: bool,
    /// An object or array in an array here.
    item: Item,
}

/// An index, or a short string.
const SCALAR_BYTES: usize = 24;
/// The first entry of a map allocates a node of eleven; a node is half full at least.
const ATTRIBUTES_BYTES: u64 = 512;
const ATTRIBUTE_BYTES: u64 = 96;
const TREE_MAP_BYTES: u64 = 1024;
const TREE_ENTRY_BYTES: u64 = 320;

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
    /// A value of a tree and of the one that it is read by.
    const TREE: Self = Self::new(64, 0);

    /// Of the list `key`.
    fn of(key: &str) -> Self {
        /// Notes, names and hashes of a mesh until it is built.
        const MESH: usize = 1536;
        /// A checked primitive with its accessors.
        const PRIMITIVE: usize = 768;
        /// A place on the stack of the walk over the nodes, and marks.
        const NODE: usize = 2 * size_of::<Instance>() + 32;
        const SAMPLERS: [usize; 2] = [
            size_of::<json::texture::Sampler>(),
            size_of::<json::animation::Sampler>(),
        ];
        match key {
            "accessors" => Self::new(size_of::<json::Accessor>(), 0),
            "animations" => Self::new(size_of::<json::Animation>(), 0),
            "buffers" => Self::new(size_of::<json::Buffer>(), 128),
            "bufferViews" => Self::new(size_of::<json::buffer::View>(), 0),
            "cameras" => Self::new(size_of::<json::Camera>(), 0),
            "channels" => Self::new(size_of::<json::animation::Channel>(), 0),
            "images" => Self::new(size_of::<json::Image>(), 256),
            "materials" => Self::new(size_of::<json::Material>(), 2 * size_of::<Material>()),
            "meshes" => Self::new(size_of::<json::Mesh>(), MESH),
            "nodes" => Self::new(size_of::<json::Node>(), NODE),
            "primitives" => Self::new(size_of::<json::mesh::Primitive>(), PRIMITIVE),
            "samplers" => Self::new(SAMPLERS[0].max(SAMPLERS[1]), 0),
            "scenes" => Self::new(size_of::<json::Scene>(), 0),
            "skins" => Self::new(size_of::<json::Skin>(), 0),
            "targets" => Self::new(size_of::<json::mesh::MorphTarget>(), 0),
            "textures" => Self::new(size_of::<json::Texture>(), 0),
            _ => Self::OTHER,
        }
    }
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

impl Walk<'_> {
    fn below(self, key: &str) -> Self {
        let kind = match (self.kind, key) {
            (Kind::Typed | Kind::Attributes, "extras") => Kind::Text,
            (Kind::Typed | Kind::Attributes, "extensions" | "min" | "max") => Kind::Tree,
            (Kind::Typed, "attributes") => Kind::Attributes,
            (Kind::Attributes, _) => Kind::Typed,
            (kind, _) => kind,
        };
        if matches!(kind, Kind::Tree | Kind::Text) {
            return Self {
                kind,
                index: false,
                named_indices: false,
                item: Item::TREE,
                ..self
            };
        }
        let named_indices = self.named_indices || matches!(key, "attributes" | "targets");
        Self {
            kind,
            index: named_indices || INDEX_KEYS.contains(&key),
            named_indices,
            item: Item::of(key),
            ..self
        }
    }

    /// Counts an entry of a map, its first or another.
    fn add_entry<E: Error>(self, first: bool, key_bytes: usize) -> Result<(), E> {
        let (map, entry) = match self.kind {
            Kind::Typed | Kind::Text => return Ok(()),
            Kind::Attributes => (ATTRIBUTES_BYTES, ATTRIBUTE_BYTES),
            Kind::Tree => (TREE_MAP_BYTES, TREE_ENTRY_BYTES),
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

    fn visit_u64<E: Error>(self, value: u64) -> Result<bool, E> {
        // u32::MAX itself stands for "none" inside the crate.
        if self.index && value >= u64::from(u32::MAX) {
            let message = format!("{value}, expected an index below {}", u32::MAX);
            return Err(E::custom(message));
        }
        Ok(false)
    }

    fn visit_f64<E>(self, _: f64) -> Result<bool, E> {
        Ok(false)
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<bool, E> {
        if self.kind == Kind::Tree {
            self.meter.add(text.len() as u64)?;
        }
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
            if self.kind == Kind::Text {
                continue;
            }
            let item = match (self.kind, is_object) {
                (Kind::Tree, _) => Item::TREE,
                (_, true) => self.item,
                (_, false) => Item::SCALAR,
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
