//! Words of a text, one after the other, and the facets that they list.

use std::io::BufRead as _;

use crate::import::allowance::Allowance;
use crate::import::error::{Fault, Read, cannot_read, malformed};
use crate::import::file::{Extent, Reader};
use crate::import::warnings::Warnings;
use crate::import::{origin, plain, text};

/// The longest word that is looked at.
const WORD_BYTES: u64 = 1 << 12;

/// Words of a text, with the line that each stands in.
struct Words {
    reader: Reader,
    line: u64,
    /// Only bytes that end a text may follow.
    is_ended: bool,
    /// Lines of colours that are left out.
    colors: u64,
}

/// Whether a byte ends a text, as some programs fill it up: zeros, and the mark of old systems.
pub(super) fn is_end(byte: u8) -> bool {
    matches!(byte, 0 | 0x1a)
}

impl Words {
    /// The next word in small letters, comments left out; empty at the end.
    fn next(&mut self) -> Read<String> {
        loop {
            let word = self.word()?;
            if !["#", ";", "//"].iter().any(|it| word.starts_with(it)) {
                return Ok(word);
            }
            self.skip_line()?;
        }
    }

    fn word(&mut self) -> Read<String> {
        let mut word = String::new();
        loop {
            let Some(byte) = self.peek()? else {
                return Ok(word);
            };
            if byte.is_ascii_whitespace() || is_end(byte) {
                if !word.is_empty() {
                    return Ok(word);
                }
                self.is_ended |= is_end(byte);
                self.line += u64::from(byte == b'\n');
            } else if self.is_ended {
                return Err(self.unexpected("nothing behind a byte of 0", "more"));
            } else {
                word.push(char::from(byte).to_ascii_lowercase());
                if word.len() as u64 > WORD_BYTES {
                    return Err(self.unexpected("a word of STL", "one without an end"));
                }
            }
            self.reader.consume(1);
        }
    }

    /// The next word that is no colour.
    fn keyword(&mut self) -> Read<String> {
        loop {
            let word = self.next()?;
            if word != "color" {
                return Ok(word);
            }
            self.colors += 1;
            self.skip_line()?;
        }
    }

    /// `endfacet` and the like, also in two words.
    fn expect_end(&mut self, of: &str) -> Read<()> {
        let word = self.keyword()?;
        match word.strip_prefix("end") {
            Some("") => self.expect(of),
            Some(rest) if rest == of => Ok(()),
            _ => Err(self.unexpected(&format!("end{of}"), &word)),
        }
    }

    fn peek(&mut self) -> Read<Option<u8>> {
        match self.reader.fill_buf() {
            Ok(bytes) => Ok(bytes.first().copied()),
            Err(cause) => {
                let place = format!("line {}", self.line);
                Err(cannot_read(place, std::path::Path::new("file"), &cause))
            }
        }
    }

    /// Leaves out the rest of the line: the name of a solid.
    fn skip_line(&mut self) -> Read<()> {
        while let Some(byte) = self.peek()? {
            if matches!(byte, b'\n' | b'\r') || is_end(byte) {
                return Ok(());
            }
            self.reader.consume(1);
        }
        Ok(())
    }

    fn expect(&mut self, keyword: &str) -> Read<()> {
        let word = self.keyword()?;
        match word == keyword {
            true => Ok(()),
            false => Err(self.unexpected(keyword, &word)),
        }
    }

    fn number(&mut self) -> Read<f64> {
        let word = self.next()?;
        let number = text::number(word.as_bytes());
        number.ok_or_else(|| self.unexpected("a number", &word))
    }

    fn position(&mut self) -> Read<[f64; 3]> {
        Ok([self.number()?, self.number()?, self.number()?])
    }

    /// Corners of a facet, behind its first word.
    fn facet(&mut self) -> Read<[[f64; 3]; 3]> {
        self.expect("normal")?;
        // Some writers give NaN for a facet without an area; the normal is not read anyway.
        for _ in 0..3 {
            self.next()?;
        }
        self.expect("outer")?;
        self.expect("loop")?;
        let mut corners = [[0.0; 3]; 3];
        for corner in &mut corners {
            self.expect("vertex")?;
            *corner = self.position()?;
        }
        self.expect_end("loop")?;
        self.expect_end("facet")?;
        Ok(corners)
    }

    fn unexpected(&self, expected: &str, found: &str) -> Fault {
        let found = match found.is_empty() {
            true => "the end of the file".to_owned(),
            false => format!("\"{found}\""),
        };
        malformed(format!("line {}", self.line), expected, found)
    }
}

/// Facets of a text.
pub(super) struct Listed {
    pub(super) facets: Vec<[[f64; 3]; 3]>,
    /// Facets that are not finite, and the line that the first of them ends at.
    pub(super) not_finite: u64,
    pub(super) first_line: u64,
}

impl Listed {
    /// Bytes that are held.
    pub(super) fn held_bytes(&self) -> u64 {
        (self.facets.capacity() * size_of::<[[f64; 3]; 3]>()) as u64
    }

    /// Takes in a facet that ends at `line`.
    fn add(&mut self, facet: [[f64; 3]; 3], line: u64) {
        if facet.into_iter().all(origin::is_finite) {
            self.facets.push(facet);
            return;
        }
        if self.not_finite == 0 {
            self.first_line = line;
        }
        self.not_finite += 1;
    }
}

/// Reads `solid NAME`, facets of three corners, `endsolid NAME`; several solids become one list.
pub(super) fn read(text: &Extent, allowance: &Allowance, warnings: &mut Warnings) -> Read<Listed> {
    let mut words = Words {
        reader: text.reader(0),
        line: 1,
        is_ended: false,
        colors: 0,
    };
    let mut listed = Listed {
        facets: Vec::new(),
        not_finite: 0,
        first_line: 0,
    };
    let (mut is_open, mut has_solid) = (false, false);
    loop {
        let word = words.keyword()?;
        match &*word {
            "" if !is_open && has_solid => break,
            "" | "solid" if is_open => {
                let facets = listed.facets.len() as u64 + listed.not_finite;
                if word.is_empty() && facets == 0 {
                    return Err(words.unexpected("facet or endsolid", &word));
                }
                let place = format!("line {}", words.line);
                warnings.add("solids without endsolid taken as whole", 1, &place);
                is_open = !word.is_empty();
                words.skip_line()?;
            }
            "solid" => {
                (is_open, has_solid) = (true, true);
                words.skip_line()?;
            }
            // A solid's name may stand behind.
            "end" | "endsolid" if is_open => {
                if word == "end" {
                    words.expect("solid")?;
                }
                is_open = false;
                words.skip_line()?;
            }
            "facet" if is_open => {
                listed.add(words.facet()?, words.line);
                let count = listed.facets.len();
                plain::check_triangle_count(count as u64, "facets")?;
                if count.is_multiple_of(plain::BETWEEN_LOOKS) {
                    // A closed surface has half as many vertices.
                    let completing = plain::completing_bytes(count as u64 / 2, count as u64);
                    let line = format!("line {}", words.line);
                    allowance.fits(listed.held_bytes() + completing, line)?;
                }
            }
            _ if is_open => return Err(words.unexpected("facet or endsolid", &word)),
            _ => return Err(words.unexpected("solid", &word)),
        }
    }
    warnings.add("colours of facets left out", words.colors, "file");
    Ok(listed)
}
