//! Digits: numbers below a small base, several to a byte, the first in the lowest place. What follows what shows in the byte, so that
//! a byte-wise compressor sees pairs and triples.

/// Digits of a base that one byte holds.
const fn per_byte(base: u8) -> u32 {
    let (mut digits, mut values) = (0, 1u32);
    while values * base as u32 <= 256 {
        values *= base as u32;
        digits += 1;
    }
    digits
}

/// Appends digits below `BASE`.
#[derive(Debug, Default)]
pub(super) struct DigitWriter<const BASE: u8> {
    pub bytes: Vec<u8>,
    digits: u32,
    place: u8,
}

impl<const BASE: u8> DigitWriter<BASE> {
    pub fn push(&mut self, digit: u8) {
        debug_assert!(digit < BASE, "{digit} is no digit of base {BASE}");
        if self.digits.is_multiple_of(per_byte(BASE)) {
            self.bytes.push(0);
            self.place = 1;
        }
        if let Some(last) = self.bytes.last_mut() {
            *last += digit * self.place;
        }
        self.place = self.place.wrapping_mul(BASE);
        self.digits += 1;
    }
}

/// The digits of some bytes, one after the other. Past the end come zeros.
#[derive(Debug)]
pub(super) struct Digits {
    pub digits: Vec<u8>,
    pub next: usize,
    per_byte: usize,
}

/// For each byte its digits, a byte each from the lowest on; `u64::MAX` for one that has none.
const fn table<const BASE: u8>() -> [u64; 256] {
    let mut table = [u64::MAX; 256];
    let mut byte = 0;
    while byte < (BASE as usize).pow(per_byte(BASE)) {
        let (mut value, mut place, mut digits) = (byte, 0, 0);
        while place < per_byte(BASE) {
            digits |= ((value % BASE as usize) as u64) << (8 * place);
            value /= BASE as usize;
            place += 1;
        }
        table[byte] = digits;
        byte += 1;
    }
    table
}

impl Digits {
    /// Splits the bytes; `None` where one is too large.
    pub fn new<const BASE: u8>(bytes: &[u8]) -> Option<Self> {
        let table = const { &table::<BASE>() };
        let per_byte = per_byte(BASE) as usize;
        // Each byte writes eight digits, the next one over those that are not its own.
        let mut digits = vec![0; per_byte * bytes.len() + 8];
        let mut too_large = false;
        for (place, &byte) in bytes.iter().enumerate() {
            let own = table[byte as usize];
            too_large |= own == u64::MAX;
            digits[per_byte * place..][..8].copy_from_slice(&own.to_le_bytes());
        }
        digits.truncate(per_byte * bytes.len());
        (!too_large).then_some(Self {
            digits,
            next: 0,
            per_byte,
        })
    }

    /// The next digit, 0 past the end: [`Self::finish`] tells.
    #[inline(always)]
    pub fn next(&mut self) -> u8 {
        let digit = self.digits.get(self.next).copied().unwrap_or(0);
        self.next += 1;
        digit
    }

    /// That no more were read than there are, and nothing is left but zeros in the last byte.
    pub fn finish(&self) -> Result<(), &'static str> {
        let Some(left) = self.digits.get(self.next..) else {
            return Err("more digits than there are");
        };
        match left.len() < self.per_byte && left.iter().all(|&digit| digit == 0) {
            true => Ok(()),
            false => Err("digits that nothing needs"),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A test's way to fail.
    use super::*;
    use proptest::prelude::*;

    fn come_back<const BASE: u8>(digits: &[u8]) {
        let mut writer = DigitWriter::<BASE>::default();
        digits.iter().for_each(|&digit| writer.push(digit % BASE));
        let mut reader = Digits::new::<BASE>(&writer.bytes).unwrap();
        for &digit in digits {
            assert_eq!(reader.next(), digit % BASE);
        }
        assert_eq!(reader.finish(), Ok(()));
    }

    proptest! {
        #[test]
        fn digits_come_back(digits in prop::collection::vec(any::<u8>(), 0..40)) {
            come_back::<3>(&digits);
            come_back::<5>(&digits);
        }
    }

    #[test]
    fn five_of_three_and_three_of_five_fit_a_byte() {
        assert_eq!([per_byte(3), per_byte(5)], [5, 3]);
        assert!(Digits::new::<5>(&[125]).is_none());
        assert!(Digits::new::<5>(&[124]).is_some());
        let mut left = Digits::new::<3>(&[9]).unwrap();
        assert_eq!((left.next(), left.finish().is_err()), (0, true));
        let mut none = Digits::new::<3>(&[]).unwrap();
        assert_eq!((none.next(), none.finish().is_err()), (0, true));
    }
}
