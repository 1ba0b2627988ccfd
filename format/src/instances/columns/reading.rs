//! Reads columns back. Their lengths follow from the forms, so nothing is allocated but tables.

use super::super::Linear;
use super::super::placing::{Integers, LinearPart, MOST_OCTAVE, Offset};
use super::{
    EXACT_OFFSET, FIRST_NUMBER, GENERAL, KINDS, MIRRORED, MOST_TABLE, SHARED, TABLE, TURNED, float,
    unfolded,
};
use crate::error::{FormatError, ensure};
use crate::reader::u32_at;

/// Columns that are read instance by instance.
pub(in crate::instances) struct Reading<'a> {
    shared: u32,
    forms: &'a [u8],
    assets: Integral<'a>,
    numbers: Integral<'a>,
    octaves: Integral<'a>,
    turned: [Integral<'a>; 4],
    general: [Integral<'a>; 9],
    exact: [Floating<'a>; 9],
    steps: [Integral<'a>; 3],
    offsets: [Floating<'a>; 3],
    rest: Bytes<'a>,
}

impl<'a> Reading<'a> {
    /// The columns of `count` instances, and the linear parts that they share.
    pub fn new(bytes: &'a [u8], count: usize) -> Result<(Self, Vec<Linear>), FormatError> {
        let mut rest = Bytes(bytes);
        let shared = rest.u32("shared parts")?;
        // No more than instances: what a list claims stays within what it has bytes for.
        let most = MOST_TABLE.min(count);
        ensure(
            shared as usize <= most,
            "instance columns: shared parts",
            format_args!("at most {most}"),
            shared,
        )?;
        let mut parts: [Floating; 9] = rest.columns(|rest| rest.floats(shared as usize))?;
        let parts = (0..shared).map(|_| {
            let mut part = Linear::default();
            for (value, column) in part.iter_mut().flatten().zip(&mut parts) {
                *value = column.next()?;
            }
            Ok(part)
        });
        let parts = parts.collect::<Result<Vec<_>, FormatError>>()?;
        let forms = rest.take(count, "forms")?;
        let of = |wanted: &dyn Fn(u8) -> bool| forms.iter().filter(|form| wanted(**form)).count();
        let of_kind = |kind: u8| of(&|form| form & KINDS == kind);
        let turned = of_kind(TURNED);
        let general = of_kind(GENERAL);
        let exact_offsets = of(&|form| form & EXACT_OFFSET != 0);
        let reading = Self {
            shared,
            forms,
            assets: rest.integers(count)?,
            numbers: rest.integers(of_kind(SHARED))?,
            octaves: rest.integers(turned + general)?,
            turned: {
                let mut index = 0;
                rest.columns(|rest| {
                    let bit = 1 << (FIRST_NUMBER + index);
                    index += 1;
                    rest.integers(of(&|form| form & KINDS == TURNED && form & bit != 0))
                })?
            },
            general: rest.columns(|rest| rest.integers(general))?,
            steps: rest.columns(|rest| rest.integers(count - exact_offsets))?,
            exact: rest.columns(|rest| rest.floats(of_kind(super::EXACT)))?,
            offsets: rest.columns(|rest| rest.floats(exact_offsets))?,
            rest,
        };
        Ok((reading, parts))
    }

    /// The asset and the integers of the instance `index`, which follows the one before.
    pub fn next(&mut self, index: usize) -> Result<(u32, Integers), FormatError> {
        let form = self.forms[index];
        let spare = match form & KINDS {
            TURNED => 0,
            _ => !(KINDS | EXACT_OFFSET),
        };
        let at = |part: &str| format!("scene instance {index} {part}");
        ensure(form & spare == 0, at("form"), "spare bits of zero", form)?;
        let asset = self.assets.next();
        let asset =
            u32::try_from(asset).map_err(|_| FormatError::new(at("asset"), "a u32", asset))?;
        let linear = match form & KINDS {
            SHARED => {
                let number = self.numbers.next();
                let shared = u64::from(self.shared);
                ensure(
                    number < shared,
                    at("shared part"),
                    format_args!("below {shared}"),
                    number,
                )?;
                LinearPart::Shared(number as u32)
            }
            TURNED => {
                let octave = self.octave(&at)?;
                let mut numbers = [0; 4];
                for (bit, (number, column)) in numbers.iter_mut().zip(&mut self.turned).enumerate()
                {
                    if form & 1 << (FIRST_NUMBER + bit as u32) != 0 {
                        *number = unfolded(column.next());
                    }
                }
                LinearPart::Turned {
                    mirrored: form & MIRRORED != 0,
                    octave,
                    numbers,
                }
            }
            GENERAL => LinearPart::General {
                octave: self.octave(&at)?,
                numbers: self
                    .general
                    .each_mut()
                    .map(|column| unfolded(column.next())),
            },
            _ => {
                let mut linear = Linear::default();
                for (value, column) in linear.iter_mut().flatten().zip(&mut self.exact) {
                    *value = column.next()?;
                }
                LinearPart::Exact(linear)
            }
        };
        let offset = match form & EXACT_OFFSET {
            0 => Offset::Steps(self.steps.each_mut().map(|column| unfolded(column.next()))),
            _ => {
                let mut offset = [0.0; 3];
                for (value, column) in offset.iter_mut().zip(&mut self.offsets) {
                    *value = column.next()?;
                }
                Offset::Exact(offset)
            }
        };
        Ok((asset, Integers { linear, offset }))
    }

    fn octave(&mut self, at: &dyn Fn(&str) -> String) -> Result<u8, FormatError> {
        let octave = self.octaves.next();
        ensure(
            octave <= u64::from(MOST_OCTAVE),
            at("octave"),
            format_args!("at most {MOST_OCTAVE}"),
            octave,
        )?;
        Ok(octave as u8)
    }

    /// Checks that nothing follows.
    pub fn finish(self) -> Result<(), FormatError> {
        let left = self.rest.0.len();
        ensure(left == 0, "instance columns", "no more bytes", left)
    }
}

/// Bytes that were not read yet.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize, part: &str) -> Result<&'a [u8], FormatError> {
        let Some((taken, rest)) = self.0.split_at_checked(count) else {
            let at = format!("instance columns: {part}");
            return Err(FormatError::new(at, format!("{count} bytes"), self.0.len()));
        };
        self.0 = rest;
        Ok(taken)
    }

    fn u32(&mut self, part: &str) -> Result<u32, FormatError> {
        Ok(u32_at(self.take(4, part)?, 0))
    }

    fn columns<T, const N: usize>(
        &mut self,
        mut read: impl FnMut(&mut Self) -> Result<T, FormatError>,
    ) -> Result<[T; N], FormatError> {
        let mut columns = Vec::with_capacity(N);
        for _ in 0..N {
            columns.push(read(self)?);
        }
        columns
            .try_into()
            .map_err(|_| FormatError::new("instance columns", N, "another count"))
    }

    fn integers(&mut self, count: usize) -> Result<Integral<'a>, FormatError> {
        let width = self.take(1, "width")?[0];
        ensure(
            width <= 8,
            "instance columns: width",
            "at most 8 bytes",
            width,
        )?;
        let bytes = self.take(count.saturating_mul(width.into()), "planes")?;
        Ok(Integral {
            bytes,
            count,
            next: 0,
        })
    }

    fn differences(&mut self, shift: u8, count: usize) -> Result<Floating<'a>, FormatError> {
        ensure(
            shift < 64,
            "instance columns: shift",
            "at most 63 bits",
            shift,
        )?;
        Ok(Floating::Differences {
            differences: self.integers(count)?,
            shift,
            before: 0,
        })
    }

    fn floats(&mut self, count: usize) -> Result<Floating<'a>, FormatError> {
        let shift = self.take(1, "shift")?[0];
        if shift != TABLE {
            return self.differences(shift, count);
        }
        let values = self.u32("values")? as usize;
        let most = MOST_TABLE.min(count);
        ensure(
            values <= most,
            "instance columns: values",
            format_args!("at most {most}"),
            values,
        )?;
        let shift = self.take(1, "shift")?[0];
        let mut differences = self.differences(shift, values)?;
        let values = (0..values).map(|_| differences.next());
        let values = values.collect::<Result<_, _>>()?;
        Ok(Floating::Table(values, self.integers(count)?))
    }
}

/// A column of integers, in planes.
struct Integral<'a> {
    bytes: &'a [u8],
    count: usize,
    next: usize,
}

impl Integral<'_> {
    /// The next one. There are as many as the forms say.
    fn next(&mut self) -> u64 {
        let mut value = 0;
        let planes = self.bytes.chunks_exact(self.count.max(1));
        for (plane, bytes) in planes.enumerate() {
            value |= u64::from(bytes[self.next]) << (8 * plane);
        }
        self.next += 1;
        value
    }
}

/// A column of floats.
enum Floating<'a> {
    /// Differences from the one before, in the order of floats.
    Differences {
        differences: Integral<'a>,
        shift: u8,
        before: i64,
    },
    /// Values, and indices of them.
    Table(Vec<f64>, Integral<'a>),
}

impl Floating<'_> {
    fn next(&mut self) -> Result<f64, FormatError> {
        match self {
            Self::Differences {
                differences,
                shift,
                before,
            } => {
                *before = before.wrapping_add(unfolded(differences.next()) << *shift);
                Ok(float(*before))
            }
            Self::Table(values, indices) => {
                let index = indices.next();
                let value = usize::try_from(index).ok().and_then(|it| values.get(it));
                value.copied().ok_or_else(|| {
                    let expected = format!("below {}", values.len());
                    FormatError::new("instance columns: index", expected, index)
                })
            }
        }
    }
}
