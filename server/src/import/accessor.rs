//! Accessor: elements of a buffer view as numbers, sparse ones laid over.
//!
//! `open` checks every range once; reading elements afterwards cannot leave the view.

use std::ops::Range;

pub(super) use gltf::json::accessor::ComponentType;

use super::Document;
use super::buffers::{demand, out_of_range};
use super::document::{self, SparsePart, Whole};
use super::error::{Read, malformed};
use super::rows::Rows;

/// The type of this code, where there is one.
fn component_type(code: Option<Whole>) -> Option<ComponentType> {
    use gltf::json::accessor as code;
    Some(match u32::try_from(code?.0).ok()? {
        code::BYTE => ComponentType::I8,
        code::UNSIGNED_BYTE => ComponentType::U8,
        code::SHORT => ComponentType::I16,
        code::UNSIGNED_SHORT => ComponentType::U16,
        code::UNSIGNED_INT => ComponentType::U32,
        code::FLOAT => ComponentType::F32,
        _ => return None,
    })
}

fn number(value: Option<Whole>) -> String {
    value.map_or("none".to_owned(), |it| it.0.to_string())
}

/// `accessors[index]`, to which `user` points, unless it cannot be read.
pub(super) fn find<'a>(
    document: &Document<'a>,
    index: usize,
    user: &str,
) -> Read<&'a document::Accessor> {
    let accessors = &document.root.accessors;
    match accessors.get(index).map(|it| &it.0) {
        Some(Ok(accessor)) => Ok(accessor),
        Some(Err(reason)) => Err(malformed(
            format!("{user} (accessors[{index}])"),
            "an accessor",
            reason,
        )),
        None => Err(out_of_range(user, "accessors", accessors.len(), index)),
    }
}

/// The elements of one accessor, in their file.
pub(super) struct Accessor {
    /// `accessors[7]`
    pub(super) place: String,
    pub(super) count: usize,
    pub(super) component: ComponentType,
    /// Components of an element: 1 to 4, or the 16 of a matrix.
    pub(super) lanes: usize,
    pub(super) normalized: bool,
    /// `count` rows. `None`: all zero but for the sparse elements.
    base: Option<Rows>,
    sparse: Option<Sparse>,
}

/// Invariant: `indices` increase strictly and lie below the accessor's count; there is a value for each.
struct Sparse {
    indices: Vec<u32>,
    values: Vec<u8>,
}

const UNSIGNED: &[ComponentType] = &[ComponentType::U8, ComponentType::U16, ComponentType::U32];
/// Bytes of the largest element, a matrix.
const ELEMENT_BYTES: usize = 64;
/// An accessor without a buffer view costs no bytes in the file, so its count is held to this many elements a sparse one.
const UNBACKED_PER_SPARSE: u64 = 64;
const UNBACKED_ALWAYS: u64 = 1024;

impl Accessor {
    /// Opens `accessors[index]`, to which `user` (`meshes[0].primitives[0].indices`) points.
    pub(super) fn open(document: &Document, index: usize, user: &str) -> Read<Self> {
        Self::open_beside(document, index, user, 0)
    }

    /// The same where bytes of the file account for `backed` elements already.
    pub(super) fn open_beside(
        document: &Document,
        index: usize,
        user: &str,
        backed: u64,
    ) -> Read<Self> {
        let accessor = find(document, index, user)?;
        let place = format!("{user} (accessor {index})");
        let Some(component) = component_type(accessor.component_type) else {
            let expected = "one of 5120, 5121, 5122, 5123, 5125, 5126";
            let found = number(accessor.component_type);
            return Err(malformed(format!("{place}.componentType"), expected, found));
        };
        let lanes = match accessor.kind.as_deref() {
            Some("SCALAR") => 1,
            Some("VEC2") => 2,
            Some("VEC3") => 3,
            Some("VEC4") => 4,
            Some("MAT4") => 16,
            other => {
                let expected = "SCALAR, VEC2 to VEC4 or MAT4";
                let found = other.unwrap_or("none");
                return Err(malformed(format!("{place}.type"), expected, found));
            }
        };
        let size = Size {
            component_bytes: component.size(),
            element_bytes: component.size() * lanes,
        };
        let count = demand(accessor.count, &format!("{place}.count"))?.0;
        let sparse_count = accessor.claimed_sparse_count();
        let base = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.0;
                Some(elements(
                    document,
                    view.value(),
                    offset,
                    count,
                    size,
                    &place,
                )?)
            }
            None => {
                let most = sparse_count
                    .saturating_mul(UNBACKED_PER_SPARSE)
                    .max(UNBACKED_ALWAYS)
                    .max(backed);
                if count > most {
                    let expected = format!("a bufferView, or {most} elements at most");
                    return Err(malformed(
                        place,
                        expected,
                        format!("{count} elements of zero"),
                    ));
                }
                None
            }
        };
        let mut opened = Self {
            place,
            // In range: every element lies in memory, or the bound above holds.
            count: count as usize,
            component,
            lanes,
            normalized: accessor.normalized,
            base,
            sparse: None,
        };
        if accessor.sparse.is_some() {
            opened.sparse = Some(opened.open_sparse(document, index, size)?);
        }
        Ok(opened)
    }

    fn open_sparse(&self, document: &Document, index: usize, size: Size) -> Read<Sparse> {
        let place = format!("{}.sparse", self.place);
        let Some(sparse) = &find(document, index, &place)?.sparse else {
            return Err(malformed(place, "a sparse object", "none"));
        };
        let count = demand(sparse.count, &format!("{place}.count"))?.0;
        if count > self.count as u64 {
            let expected = format!("{} elements at most", self.count);
            return Err(malformed(format!("{place}.count"), expected, count));
        }
        let indices_place = format!("{place}.indices");
        let component = component_type(sparse.indices.component_type);
        let Some(component) = component.filter(|it| UNSIGNED.contains(it)) else {
            let expected = "one of 5121, 5123, 5125";
            let found = number(sparse.indices.component_type);
            let place = format!("{indices_place}.componentType");
            return Err(malformed(place, expected, found));
        };
        let index_size = Size {
            component_bytes: component.size(),
            element_bytes: component.size(),
        };
        let elements_of = |part: &SparsePart, size, place: &str| {
            let view = demand(part.buffer_view, &format!("{place}.bufferView"))?;
            elements(
                document,
                view.value(),
                part.byte_offset.0,
                count,
                size,
                place,
            )
        };
        let raw = elements_of(&sparse.indices, index_size, &indices_place)?;
        let values = elements_of(&sparse.values, size, &format!("{place}.values"))?;

        // In range: the elements of both lie in the file.
        let mut indices: Vec<u32> = Vec::with_capacity(count as usize);
        raw.visit_range(0..count, |at, bytes| {
            let index = unsigned(bytes);
            let rising = indices.last().is_none_or(|&last| last < index);
            if !rising || index as usize >= self.count {
                let expected = format!("increasing indices below {}", self.count);
                let found = format!("{index} at element {at}");
                return Err(malformed(&indices_place, expected, found));
            }
            indices.push(index);
            Ok(())
        })?;
        let mut tight = Vec::with_capacity(indices.len() * size.element_bytes);
        values.visit_range(0..count, |_, bytes| {
            tight.extend_from_slice(bytes);
            Ok(())
        })?;
        Ok(Sparse {
            indices,
            values: tight,
        })
    }

    /// The sparse element that lies over `element`, else `base`.
    fn over<'a>(&'a self, element: u64, base: &'a [u8]) -> &'a [u8] {
        if let Some(sparse) = &self.sparse
            && let Ok(element) = u32::try_from(element)
            && let Ok(at) = sparse.indices.binary_search(&element)
        {
            let bytes = self.element_bytes();
            return &sparse.values[at * bytes..(at + 1) * bytes];
        }
        base
    }

    fn element_bytes(&self) -> usize {
        self.component.size() * self.lanes
    }

    /// Gives the elements `ascending`, each below the count, to `visit` with their places in that list, as floats,
    /// normalised where the accessor says so; `N` is at most `lanes`.
    pub(super) fn visit_floats<const N: usize>(
        &self,
        ascending: &[u32],
        mut visit: impl FnMut(usize, [f32; N]),
    ) -> Read<()> {
        match &self.base {
            Some(rows) => rows.visit(ascending, |at, bytes| {
                visit(at, self.floats(self.over(u64::from(ascending[at]), bytes)));
            }),
            None => {
                for (at, &element) in ascending.iter().enumerate() {
                    visit(
                        at,
                        self.floats(self.over(u64::from(element), &[0; ELEMENT_BYTES])),
                    );
                }
                Ok(())
            }
        }
    }

    fn floats<const N: usize>(&self, element: &[u8]) -> [f32; N] {
        if self.component == ComponentType::F32 {
            let float = |lane: usize| element[4 * lane..].first_chunk().copied();
            return std::array::from_fn(|lane| f32::from_le_bytes(float(lane).unwrap_or_default()));
        }
        let bytes = self.component.size();
        std::array::from_fn(|lane| {
            let at = lane * bytes;
            float(self.component, self.normalized, &element[at..at + bytes])
        })
    }

    /// All elements, as [`Accessor::visit_floats`] gives them.
    pub(super) fn all_floats<const N: usize>(&self) -> Read<Vec<[f32; N]>> {
        let all: Vec<u32> = (0..self.count as u32).collect();
        let mut floats = Vec::with_capacity(self.count);
        self.visit_floats(&all, |_, element| floats.push(element))?;
        Ok(floats)
    }

    /// Gives the elements `range`, which lies below the count, of a scalar of unsigned integers to `visit`, each with its number.
    pub(super) fn visit_unsigned(
        &self,
        range: Range<u64>,
        mut visit: impl FnMut(u64, u32) -> Read<()>,
    ) -> Read<()> {
        match &self.base {
            Some(rows) if self.sparse.is_none() => {
                rows.visit_range(range, |at, bytes| visit(at, unsigned(bytes)))
            }
            Some(rows) => {
                rows.visit_range(range, |at, bytes| visit(at, unsigned(self.over(at, bytes))))
            }
            None => {
                for at in range {
                    visit(at, unsigned(self.over(at, &[0; 4])))?;
                }
                Ok(())
            }
        }
    }

    /// Demands a number of lanes and one of `components`, each with what is asked of `normalized` (`None`: either).
    pub(super) fn expect(&self, lanes: &[usize], components: &[Component]) -> Read<()> {
        if !lanes.contains(&self.lanes) {
            let expected: Vec<_> = lanes.iter().map(|&lanes| type_name(lanes)).collect();
            let place = format!("{}.type", self.place);
            return Err(malformed(
                place,
                expected.join(" or "),
                type_name(self.lanes),
            ));
        }
        let accepted = |(component, normalized): &Component| {
            *component == self.component && normalized.is_none_or(|it| it == self.normalized)
        };
        if !components.iter().any(accepted) {
            let expected: Vec<_> = components.iter().map(component_name).collect();
            let found = component_name(&(self.component, Some(self.normalized)));
            let place = format!("{}.componentType", self.place);
            return Err(malformed(place, expected.join(" or "), found));
        }
        Ok(())
    }
}

/// A component type, and whether it must, must not, or may be normalised.
pub(super) type Component = (ComponentType, Option<bool>);

#[derive(Clone, Copy)]
struct Size {
    component_bytes: usize,
    element_bytes: usize,
}

/// The elements at `offset` in a view, checked for range and alignment.
fn elements(
    document: &Document,
    view: usize,
    offset: u64,
    count: u64,
    size: Size,
    place: &str,
) -> Read<Rows> {
    let view_index = view;
    let view = document.buffers.view(document.root, view, place)?;
    let stride = view.stride.unwrap_or(size.element_bytes);
    if stride < size.element_bytes {
        let place = format!("bufferViews[{view_index}].byteStride");
        let expected = format!("{} at least for {place}", size.element_bytes);
        return Err(malformed(place, expected, stride));
    }
    // In u128: offset, count and stride are the file's, and their product wraps in 64 bits.
    let end = match count {
        0 => u128::from(offset),
        _ => {
            let last = u128::from(count - 1) * stride as u128;
            u128::from(offset) + last + size.element_bytes as u128
        }
    };
    let length = view.extent.len();
    let rest = length.checked_sub(offset);
    let extent = rest.and_then(|rest| view.extent.slice(offset, rest));
    let Some(extent) = extent.filter(|_| end <= u128::from(length)) else {
        let expected = format!("elements within the {length} bytes of its view");
        let found = format!("{count} of them at byte {offset}, ending at {end}");
        return Err(malformed(place, expected, found));
    };
    let start = view.offset_in_buffer + offset;
    if !start.is_multiple_of(size.component_bytes as u64)
        || !stride.is_multiple_of(size.component_bytes)
    {
        let expected = format!("alignment to {} bytes", size.component_bytes);
        let found = format!("byte {start} of the buffer");
        return Err(malformed(place, expected, found));
    }
    Ok(Rows {
        extent,
        stride,
        row_bytes: size.element_bytes,
    })
}

/// The number that `bytes`, as long as the component, hold.
fn float(component: ComponentType, normalized: bool, bytes: &[u8]) -> f32 {
    // The specification's conversions; the signed ones reach -1 at two values.
    let (value, one) = match (component, bytes) {
        (ComponentType::F32, &[a, b, c, d]) => return f32::from_le_bytes([a, b, c, d]),
        (ComponentType::I8, &[a]) => (f32::from(a as i8), 127.0),
        (ComponentType::I16, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])), 32767.0),
        (ComponentType::U8, _) => (unsigned(bytes) as f32, 255.0),
        (ComponentType::U16, _) => (unsigned(bytes) as f32, 65535.0),
        _ => return unsigned(bytes) as f32,
    };
    match normalized {
        true => (value / one).max(-1.0),
        false => value,
    }
}

/// The little-endian integer of 1, 2 or 4 bytes.
#[inline]
fn unsigned(bytes: &[u8]) -> u32 {
    match *bytes {
        [a] => u32::from(a),
        [a, b] => u32::from(u16::from_le_bytes([a, b])),
        [a, b, c, d] => u32::from_le_bytes([a, b, c, d]),
        _ => 0,
    }
}

fn type_name(lanes: usize) -> String {
    match lanes {
        1 => "SCALAR".to_owned(),
        16 => "MAT4".to_owned(),
        lanes => format!("VEC{lanes}"),
    }
}

fn component_name((component, normalized): &Component) -> String {
    let name = match component {
        ComponentType::I8 => "i8",
        ComponentType::U8 => "u8",
        ComponentType::I16 => "i16",
        ComponentType::U16 => "u16",
        ComponentType::U32 => "u32",
        ComponentType::F32 => return "f32".to_owned(),
    };
    match normalized {
        Some(true) => format!("normalized {name}"),
        _ => name.to_owned(),
    }
}
