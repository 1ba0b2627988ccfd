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

/// Reads them.
#[derive(Debug)]
pub(super) struct DigitReader<'a, const BASE: u8> {
    bytes: std::slice::Iter<'a, u8>,
    byte: u8,
    left: u32,
}

impl<'a, const BASE: u8> DigitReader<'a, BASE> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes: bytes.iter(),
            byte: 0,
            left: 0,
        }
    }

    /// The next digit; [`Self::rest`] finds the bytes that hold too much.
    #[inline]
    pub fn next(&mut self) -> Result<u8, &'static str> {
        if self.left == 0 {
            self.byte = *self.bytes.next().ok_or("more digits than there are")?;
            self.left = per_byte(BASE);
        }
        self.left -= 1;
        let digit = match self.left {
            // What is too large for the highest place is no digit.
            0 => self.byte,
            _ => self.byte % BASE,
        };
        self.byte /= BASE;
        match digit < BASE {
            true => Ok(digit),
            false => Err("a byte of digits that is too large"),
        }
    }

    /// That nothing is left but zeros in the last byte.
    pub fn finish(mut self) -> Result<(), &'static str> {
        match (self.bytes.next(), self.byte) {
            (None, 0) => Ok(()),
            _ => Err("digits that nothing needs"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn come_back<const BASE: u8>(digits: &[u8]) {
        let mut writer = DigitWriter::<BASE>::default();
        digits.iter().for_each(|&digit| writer.push(digit % BASE));
        let mut reader = DigitReader::<BASE>::new(&writer.bytes);
        for &digit in digits {
            assert_eq!(reader.next(), Ok(digit % BASE));
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
        let refused = DigitReader::<5>::new(&[125]);
        let mut refused = refused;
        assert_eq!((refused.next(), refused.next()), (Ok(0), Ok(0)));
        assert!(refused.next().is_err());
        let mut left = DigitReader::<3>::new(&[9]);
        assert_eq!((left.next(), left.finish().is_err()), (Ok(0), true));
    }
}
