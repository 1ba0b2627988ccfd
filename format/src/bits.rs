//! Bit streams in little-endian 32-bit words: bit `i` is bit `i % 32` of word `i / 32`.

/// Appends fields of up to 32 bits.
#[derive(Debug, Default, Clone)]
pub struct BitWriter {
    words: Vec<u32>,
    bits: usize,
}

impl BitWriter {
    /// Appends the low `count` (0..=32) bits of `value`; higher bits must be zero.
    pub fn push(&mut self, value: u32, count: u32) {
        debug_assert!(
            count <= 32 && (count == 32 || value >> count == 0),
            "{value} does not fit {count} bits"
        );
        if count == 0 {
            return;
        }
        let shift = self.bits % 32;
        if shift == 0 {
            self.words.push(value);
        } else {
            if let Some(last) = self.words.last_mut() {
                *last |= value << shift;
            }
            if shift + count as usize > 32 {
                self.words.push(value >> (32 - shift));
            }
        }
        self.bits += count as usize;
    }

    /// Pads with zero bits to the next word.
    pub fn align(&mut self) {
        self.bits = self.words.len() * 32;
    }

    /// Words written so far, the last one padded with zeros.
    pub fn into_words(mut self) -> Vec<u32> {
        self.align();
        self.words
    }
}

/// Reads `count` (0..=32) bits at bit `first`; bits past the end are zero.
pub fn read_bits(words: &[u32], first: usize, count: u32) -> u32 {
    if count == 0 {
        return 0;
    }
    let word = |index: usize| words.get(index).copied().unwrap_or(0) as u64;
    let pair = word(first / 32) | word(first / 32 + 1) << 32;
    (pair >> (first % 32)) as u32 & (u32::MAX >> (32 - count))
}

/// Bits that hold every value up to `largest`: 0 for 0, 8 for 255.
pub fn bits_for(largest: u32) -> u32 {
    32 - largest.leading_zeros()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn fields_come_back(fields in prop::collection::vec((any::<u32>(), 0u32..=32), 0..200)) {
            let mut writer = BitWriter::default();
            let masked: Vec<_> = fields.iter().map(|&(value, count)| {
                (if count == 0 { 0 } else { value & (u32::MAX >> (32 - count)) }, count)
            }).collect();
            for &(value, count) in &masked {
                writer.push(value, count);
            }
            let words = writer.into_words();
            let mut at = 0;
            for (value, count) in masked {
                prop_assert_eq!(read_bits(&words, at, count), value);
                at += count as usize;
            }
        }
    }
}
