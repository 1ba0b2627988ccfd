//! Lines of an OBJ, continuations joined, and the memory that their statements hold.

use std::io::{BufRead as _, Read as _};
use std::path::Path;

use super::Parser;
use crate::import::allowance::Allowance;
use crate::import::error::{Read, cannot_read, malformed};
use crate::import::file::Extent;
use crate::import::warnings::Warnings;
use crate::import::{attributes, plain, text};

/// The longest line, continuations included: a polygon of a million corners.
const LINE_BYTES: u64 = 1 << 25;
/// After a longer line the memory is looked at again.
const LONG_LINE_BYTES: usize = 1 << 14;
impl Parser {
    /// Reads every statement.
    pub(super) fn run(
        &mut self,
        file: &Extent,
        allowance: &Allowance,
        warnings: &mut Warnings,
    ) -> Read<()> {
        const MARK_BYTES: u64 = 3;
        let mut reader = file.reader(text::mark_bytes(&file.head(MARK_BYTES)?));
        let mut line = Vec::new();
        let mut next_look = 0;
        loop {
            line.clear();
            loop {
                let least = line.len();
                let limit = LINE_BYTES - least as u64;
                let read = (&mut reader).take(limit).read_until(b'\n', &mut line);
                read.map_err(|cause| cannot_read(self.place(), Path::new("file"), &cause))?;
                self.line += u64::from(line.len() > least);
                if line.len() as u64 >= LINE_BYTES {
                    let expected = format!("a line below {LINE_BYTES} bytes");
                    return Err(malformed(self.place(), expected, "a longer one"));
                }
                let trimmed = line.trim_ascii_end();
                // A comment goes on to the end of its line, whatever it ends by.
                let is_comment = || {
                    let read = &line[least..];
                    text::before_comment(read).len() < read.len()
                };
                if line.len() == least || !trimmed.ends_with(b"\\") || is_comment() {
                    break;
                }
                let length = trimmed.len() - 1;
                line.truncate(length);
                line.push(b' ');
            }
            if line.is_empty() {
                break;
            }
            // Old programs of the Macintosh end lines by a carriage return alone.
            for statement in line.split(|&byte| byte == b'\r') {
                self.statement(statement.trim_ascii(), allowance, warnings)?;
            }
            if self.line >= next_look || line.len() > LONG_LINE_BYTES {
                next_look = self.line + plain::BETWEEN_LOOKS as u64;
                allowance.fits(self.held_bytes(), self.place())?;
            }
        }
        allowance.fits(self.held_bytes(), self.place())?;
        warnings.add(attributes::REPLACED_UVS, self.uvs_replaced, "file");
        Ok(())
    }

    /// Bytes that are held, and those that the mesh of it takes.
    fn held_bytes(&self) -> u64 {
        fn bytes<T>(list: &Vec<T>) -> u64 {
            (list.capacity() * size_of::<T>()) as u64
        }
        bytes(&self.positions)
            + bytes(&self.colors)
            + bytes(&self.uvs)
            + bytes(&self.normals)
            + bytes(&self.vertices)
            + plain::table_bytes(self.vertex_of_corner.capacity())
            + bytes(&self.triangles)
            + bytes(&self.triangle_materials)
            + bytes(&self.polygons)
            + bytes(&self.not_finite)
            + bytes(&self.polygon)
            + self.name_bytes
            + plain::completing_bytes(self.vertices.len() as u64, self.triangles.len() as u64)
    }

    /// Demands room for as many positions again before their list doubles.
    pub(super) fn look_before_growth(&self, allowance: &Allowance) -> Read<()> {
        let count = self.positions.len();
        if count < self.positions.capacity() {
            return Ok(());
        }
        let colors = self.colors.capacity() * size_of::<[f32; 4]>();
        let growth = count * size_of::<[f64; 3]>() + colors;
        allowance.fits(self.held_bytes() + growth as u64, self.place())
    }

    /// Demands room for a long face before it is read.
    pub(super) fn look_ahead(&self, text: &[u8], allowance: &Allowance) -> Read<()> {
        /// A corner, with its vertex, its triangle, and the free places after each.
        const CORNER_BYTES: u64 = 112;
        if text.len() <= LONG_LINE_BYTES {
            return Ok(());
        }
        let words = text.split(u8::is_ascii_whitespace);
        let corners = words.filter(|it| !it.is_empty()).count() as u64;
        let need = corners * CORNER_BYTES + plain::completing_bytes(corners, corners);
        allowance.fits(self.held_bytes() + need, self.place())
    }
}
