//! The tristrips element: lists of vertices of which each three in a row are a triangle, every
//! other one turned; -1 begins a new strip (zipper, VRIP, the Stanford scans).

use super::faces::is_corners;
use super::header::{Element, Kind, Scalar};
use super::values::Values;
use crate::import::error::{Read, malformed};

/// Reads all strips of `element` and gives their triangles to `emit`, those that only stitch left
/// out. Nothing is read where no property lists vertices.
pub(super) fn read(
    values: &mut Values,
    element: &Element,
    vertex_count: u64,
    mut emit: impl FnMut([u32; 3], &Values) -> Read<()>,
) -> Read<()> {
    for row in 0..element.count {
        for property in &element.properties {
            let (count, item) = match property.kind {
                Kind::List { count, item } => (count, item),
                Kind::Scalar(scalar) => {
                    values.skip(scalar, 1)?;
                    continue;
                }
            };
            let length = values.count(count)?;
            if !is_corners(&property.name) {
                values.skip(item, length)?;
                continue;
            }
            let mut strip = Strip::default();
            for _ in 0..length {
                let index = values.scalar(item)?;
                if index == -1.0 || index == restart(item) && index >= vertex_count as f64 {
                    strip = Strip::default();
                    continue;
                }
                if !(index >= 0.0 && index < vertex_count as f64 && index.fract() == 0.0) {
                    let expected = format!("indices below {vertex_count} or -1");
                    return Err(malformed(format!("tristrips {row}"), expected, index));
                }
                if let Some(triangle) = strip.next(index as u32) {
                    emit(triangle, values)?;
                }
            }
        }
    }
    Ok(())
}

/// -1 as an unsigned item has it.
fn restart(item: Scalar) -> f64 {
    match item {
        Scalar::U8 => f64::from(u8::MAX),
        Scalar::U16 => f64::from(u16::MAX),
        _ => f64::from(u32::MAX),
    }
}

#[derive(Default)]
struct Strip {
    last: [u32; 2],
    length: u32,
    is_turned: bool,
}

impl Strip {
    fn next(&mut self, vertex: u32) -> Option<[u32; 3]> {
        let [a, b] = self.last;
        self.last = [b, vertex];
        self.length = self.length.saturating_add(1);
        if self.length < 3 {
            return None;
        }
        let is_turned = self.is_turned;
        self.is_turned = !is_turned;
        let is_stitch = a == b || b == vertex || vertex == a;
        let triangle = if is_turned {
            [b, a, vertex]
        } else {
            [a, b, vertex]
        };
        (!is_stitch).then_some(triangle)
    }
}
