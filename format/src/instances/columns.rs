//! Columns of a list of instances: numbers of one meaning together, in planes of bytes.

mod reading;

use super::placing::{Integers, LinearPart, Offset};
use super::shared::SharedParts;

pub(super) use reading::Reading;

/// Kinds of a form: bits 0 and 1 of an instance's first byte.
const SHARED: u8 = 0;
const TURNED: u8 = 1;
const GENERAL: u8 = 2;
const EXACT: u8 = 3;
const KINDS: u8 = 3;
/// Bit of a turned form that mirrors.
const MIRRORED: u8 = 1 << 2;
/// First of the bits of a turned form that say which of its four numbers are not zero.
const FIRST_NUMBER: u32 = 3;
/// Bit of an offset that is stored bit by bit.
const EXACT_OFFSET: u8 = 1 << 7;
/// In the place of a column's width: a table of values, and an index an instance.
const TABLE: u8 = 0x80;
/// Fewest instances a value of a table.
const TABLE_SHARE: usize = 4;
/// Most values of a table.
const MOST_TABLE: usize = 1 << 16;

/// Columns that grow instance by instance.
#[derive(Debug, Default)]
pub(super) struct Columns {
    parts: [Vec<u64>; 9],
    forms: Vec<u8>,
    assets: Vec<u64>,
    numbers: Vec<u64>,
    octaves: Vec<u64>,
    turned: [Vec<u64>; 4],
    general: [Vec<u64>; 9],
    exact: [Vec<u64>; 9],
    steps: [Vec<u64>; 3],
    offsets: [Vec<u64>; 3],
}

impl Columns {
    pub fn with_shared(shared: &SharedParts) -> Self {
        let mut columns = Self::default();
        for part in shared.parts() {
            push_all(
                &mut columns.parts,
                part.iter().flatten().map(|it| it.to_bits()),
            );
        }
        columns
    }

    pub fn push(&mut self, asset: u32, integers: &Integers) {
        self.assets.push(u64::from(asset));
        let form = match integers.linear {
            LinearPart::Shared(number) => {
                self.numbers.push(u64::from(number));
                SHARED
            }
            LinearPart::Turned {
                mirrored,
                octave,
                numbers,
            } => {
                self.octaves.push(u64::from(octave));
                let mut form = TURNED;
                if mirrored {
                    form |= MIRRORED;
                }
                for (index, number) in numbers.into_iter().enumerate() {
                    if number != 0 {
                        form |= 1 << (FIRST_NUMBER + index as u32);
                        self.turned[index].push(folded(number));
                    }
                }
                form
            }
            LinearPart::General { octave, numbers } => {
                self.octaves.push(u64::from(octave));
                push_all(&mut self.general, numbers.into_iter().map(folded));
                GENERAL
            }
            LinearPart::Exact(linear) => {
                let bits = linear.iter().flatten().map(|value| value.to_bits());
                push_all(&mut self.exact, bits);
                EXACT
            }
        };
        let form = match integers.offset {
            Offset::Steps(numbers) => {
                push_all(&mut self.steps, numbers.into_iter().map(folded));
                form
            }
            Offset::Exact(offset) => {
                push_all(&mut self.offsets, offset.into_iter().map(f64::to_bits));
                form | EXACT_OFFSET
            }
        };
        self.forms.push(form);
    }

    /// The bytes of all columns. Each column goes as soon as it is written.
    pub fn into_bytes(self) -> Vec<u8> {
        let mut bytes = (self.parts[0].len() as u32).to_le_bytes().to_vec();
        for column in self.parts {
            write_floats(&mut bytes, column);
        }
        bytes.extend(self.forms);
        let integers = [self.assets, self.numbers, self.octaves];
        let integers = integers.into_iter().chain(self.turned).chain(self.general);
        for column in integers.chain(self.steps) {
            write_integers(&mut bytes, &column);
        }
        for column in self.exact.into_iter().chain(self.offsets) {
            write_floats(&mut bytes, column);
        }
        bytes
    }
}

fn push_all<const N: usize>(columns: &mut [Vec<u64>; N], values: impl Iterator<Item = u64>) {
    for (column, value) in columns.iter_mut().zip(values) {
        column.push(value);
    }
}

/// The width in bytes, then the lowest bytes of all, then the next ones.
fn write_integers(bytes: &mut Vec<u8>, column: &[u64]) {
    let most = column.iter().copied().max().unwrap_or(0);
    let width = (u64::BITS - most.leading_zeros()).div_ceil(8);
    bytes.push(width as u8);
    for plane in 0..width {
        bytes.extend(column.iter().map(|value| (value >> (8 * plane)) as u8));
    }
}

/// Bits of floats: a table where values repeat, else differences.
fn write_floats(bytes: &mut Vec<u8>, column: Vec<u64>) {
    let mut values = column.clone();
    values.sort_unstable_by_key(|&bits| ordered(bits));
    values.dedup();
    let pays = values.len() <= MOST_TABLE && values.len() * TABLE_SHARE <= column.len();
    if !pays || column.is_empty() {
        drop(values);
        return write_differences(bytes, column);
    }
    let indices = column.iter().map(|&bits| {
        let index = values.binary_search_by_key(&ordered(bits), |&value| ordered(value));
        // Every value is in the table.
        index.unwrap_or_default() as u64
    });
    let indices: Vec<u64> = indices.collect();
    bytes.push(TABLE);
    bytes.extend((values.len() as u32).to_le_bytes());
    write_differences(bytes, values);
    write_integers(bytes, &indices);
}

/// Differences from the value before, without the bits that all have as zeros: floats of single
/// precision have 29.
fn write_differences(bytes: &mut Vec<u8>, mut column: Vec<u64>) {
    let mut before = 0;
    let mut all = 0;
    for value in &mut column {
        let own = ordered(*value);
        *value = own.wrapping_sub(before) as u64;
        all |= *value;
        before = own;
    }
    let shift = if all == 0 { 0 } else { all.trailing_zeros() };
    for value in &mut column {
        *value = folded(*value as i64 >> shift);
    }
    bytes.push(shift as u8);
    write_integers(bytes, &column);
}

/// An integer that grows with the float of these bits; that of `-0.0` is below all.
fn ordered(bits: u64) -> i64 {
    let signed = bits as i64;
    // The sign alone, of -0.0, stays.
    match signed > i64::MIN && signed < 0 {
        true => i64::MIN - signed,
        false => signed,
    }
}

/// The inverse of [`ordered`].
fn float(ordered: i64) -> f64 {
    let signed = match ordered > i64::MIN && ordered < 0 {
        true => i64::MIN - ordered,
        false => ordered,
    };
    f64::from_bits(signed as u64)
}

/// Small integers of either sign become small ones without.
fn folded(number: i64) -> u64 {
    ((number << 1) ^ (number >> 63)) as u64
}

/// The inverse of [`folded`].
fn unfolded(number: u64) -> i64 {
    (number >> 1) as i64 ^ -((number & 1) as i64)
}
