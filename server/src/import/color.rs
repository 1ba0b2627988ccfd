//! Colours of mesh files: sRGB by their programs' habit, linear in the scene.

/// The linear value, 0..=1, of an sRGB one (IEC 61966-2-1).
pub(super) fn linear_from_srgb(value: f64) -> f64 {
    match value <= 0.040_45 {
        true => value / 12.92,
        false => ((value + 0.055) / 1.055).powf(2.4),
    }
}

/// sRGB bytes with linear alpha to linear bytes, by a table.
pub(super) struct LinearBytes([u8; 256]);

impl LinearBytes {
    pub(super) fn new() -> Self {
        Self(std::array::from_fn(|byte| {
            (linear_from_srgb(byte as f64 / 255.0) * 255.0).round() as u8
        }))
    }

    pub(super) fn of(&self, [r, g, b, a]: [u8; 4]) -> [u8; 4] {
        let linear = |byte: u8| self.0[usize::from(byte)];
        [linear(r), linear(g), linear(b), a]
    }
}
