//! Members: the objects of a glTF document out of JSON, as forgiving as JSON readers are.
//!
//! Members that nobody reads are passed over, `null` stands for an absent one, the last of repeated
//! ones counts, and whole numbers may be written `36.0`. A member that must be there is checked
//! where it is used, so that objects which nothing uses never refuse a file.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{
    Deserialize, DeserializeOwned, Deserializer, Error, IgnoredAny, MapAccess, Unexpected, Visitor,
};
use serde_json::value::RawValue;

use crate::import::error::short;

/// Declares structs with the JSON keys of their fields; `..field` collects the names of others.
macro_rules! members {
    ($(
        $(#[$meta:meta])*
        struct $name:ident {
            $($(#[$note:meta])* $key:literal $field:ident: $type:ty,)*
            $(..$rest:ident)?
        }
    )*) => {$(
        $(#[$meta])*
        #[derive(Debug, Default)]
        pub(in crate::import) struct $name {
            $($(#[$note])* pub(in crate::import) $field: $type,)*
            $(pub(in crate::import) $rest: Vec<String>,)?
        }

        impl<'de> serde::Deserialize<'de> for $name {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Members;
                impl<'de> serde::de::Visitor<'de> for Members {
                    type Value = $name;

                    fn expecting(&self, formatter: &mut std::fmt::Formatter) -> std::fmt::Result {
                        formatter.write_str("an object")
                    }

                    fn visit_map<A: serde::de::MapAccess<'de>>(
                        self,
                        mut members: A,
                    ) -> Result<$name, A::Error> {
                        let mut object = $name::default();
                        while let Some(key) = members.next_key::<String>()? {
                            match key.as_str() {
                                $($key => {
                                    object.$field =
                                        members.next_value::<Option<_>>()?.unwrap_or_default();
                                })*
                                _ => {
                                    members.next_value::<serde::de::IgnoredAny>()?;
                                    $(object.$rest.push(key);)?
                                }
                            }
                        }
                        Ok(object)
                    }
                }
                deserializer.deserialize_map(Members)
            }
        }
    )*};
}
pub(super) use members;

/// A number without a fraction, at least 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::import) struct Whole(pub(in crate::import) u64);

impl<'de> Deserialize<'de> for Whole {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Number;
        impl Visitor<'_> for Number {
            type Value = Whole;

            fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
                formatter.write_str("a whole number")
            }

            fn visit_u64<E: Error>(self, value: u64) -> Result<Whole, E> {
                Ok(Whole(value))
            }

            fn visit_f64<E: Error>(self, value: f64) -> Result<Whole, E> {
                // All whole numbers below are exact.
                const END: f64 = (1u64 << 53) as f64;
                match value.fract() == 0.0 && (0.0..=END).contains(&value) {
                    true => Ok(Whole(value as u64)),
                    false => Err(E::invalid_value(Unexpected::Float(value), &self)),
                }
            }
        }
        deserializer.deserialize_any(Number)
    }
}

/// A place in one of the document's lists.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(in crate::import) struct Index(u32);

impl Index {
    pub(in crate::import) fn value(self) -> usize {
        self.0 as usize
    }
}

impl<'de> Deserialize<'de> for Index {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let Whole(value) = Whole::deserialize(deserializer)?;
        u32::try_from(value).map(Self).map_err(|_| {
            let message = format!("{value}, expected an index below {}", 1u64 << 32);
            D::Error::custom(message)
        })
    }
}

/// A name, absent where another value stands in its place.
#[derive(Debug, Default)]
pub(in crate::import) struct Name(pub(in crate::import) Option<String>);

impl<'de> Deserialize<'de> for Name {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let Tolerant(name) = Tolerant::<String>::deserialize(deserializer)?;
        Ok(Self(name.ok()))
    }
}

/// An object that a file may do without: one that cannot be read is kept as the reason.
#[derive(Debug)]
pub(in crate::import) struct Tolerant<T>(pub(in crate::import) Result<T, String>);

impl<'de, T: DeserializeOwned> Deserialize<'de> for Tolerant<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = <&RawValue>::deserialize(deserializer)?;
        let read = serde_json::from_str(text.get());
        Ok(Self(read.map_err(|error| short(&error.to_string()))))
    }
}

/// How many values a list has that nobody reads.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::import) struct Amount(pub(in crate::import) u64);

impl<'de> Deserialize<'de> for Amount {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = <&RawValue>::deserialize(deserializer)?;
        // Another value than a list holds none. Ignored values take no memory.
        let list: Vec<IgnoredAny> = serde_json::from_str(text.get()).unwrap_or_default();
        Ok(Self(list.len() as u64))
    }
}

/// Accessors by the names of attributes.
#[derive(Debug, Default)]
pub(in crate::import) struct Attributes(pub(in crate::import) BTreeMap<String, Index>);

impl Attributes {
    /// The accessor of `name`.
    pub(in crate::import) fn find(&self, name: &str) -> Option<usize> {
        self.0.get(name).map(|index| index.value())
    }
}

impl<'de> Deserialize<'de> for Attributes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Members;
        impl<'de> Visitor<'de> for Members {
            type Value = Attributes;

            fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
                formatter.write_str("an object of accessors")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Attributes, A::Error> {
                let mut attributes = BTreeMap::new();
                while let Some(name) = members.next_key::<String>()? {
                    match members.next_value::<Option<Index>>()? {
                        Some(index) => attributes.insert(name, index),
                        None => attributes.remove(&name),
                    };
                }
                Ok(Attributes(attributes))
            }
        }
        deserializer.deserialize_map(Members)
    }
}
