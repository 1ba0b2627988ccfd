//! Stored neighbours: those of all meshes of a plan, an object that its jobs read.

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use crate::build::Neighbours;

/// Level of zstd: the object is read once by every job.
const LEVEL: i32 = 9;

/// [`Neighbours`] as text. Coordinates are bits: they must come back exactly.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredNeighbours {
    step_exponent: Option<i32>,
    fixed: Vec<[u32; 3]>,
}

/// Writes the neighbours of meshes, in their order.
///
/// # Errors
/// Those of the compressor.
pub(in crate::ingest) fn encode<'a>(
    neighbours: impl Iterator<Item = &'a Neighbours>,
) -> std::io::Result<Bytes> {
    let stored: Vec<StoredNeighbours> = neighbours
        .map(|neighbours| StoredNeighbours {
            step_exponent: neighbours.step_exponent,
            fixed: (neighbours.fixed.iter())
                .map(|at| at.map(f32::to_bits))
                .collect(),
        })
        .collect();
    let text = serde_json::to_vec(&stored)?;
    Ok(zstd::encode_all(&text[..], LEVEL)?.into())
}

/// Reads what [`encode`] wrote.
///
/// # Errors
/// Bytes of another kind.
pub(in crate::ingest) fn decode(bytes: &[u8]) -> std::io::Result<Vec<Neighbours>> {
    let text = zstd::stream::read::Decoder::new(bytes)?;
    let stored: Vec<StoredNeighbours> = serde_json::from_reader(std::io::BufReader::new(text))?;
    let neighbours = stored.into_iter().map(|stored| Neighbours {
        step_exponent: stored.step_exponent,
        fixed: (stored.fixed.into_iter())
            .map(|at| at.map(f32::from_bits))
            .collect(),
    });
    Ok(neighbours.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_come_back_bit_by_bit() {
        let all = [
            Neighbours::default(),
            Neighbours {
                step_exponent: Some(-17),
                fixed: vec![[0.1, -0.0, 1e-40], [3e38, 5.0, -7.25]],
            },
        ];
        let bytes = encode(all.iter()).expect("in memory");
        let read = decode(&bytes).expect("what was written");
        assert_eq!(read, all);
        let hashes = |all: &[Neighbours]| all.iter().map(Neighbours::hash).collect::<Vec<_>>();
        assert_eq!(hashes(&read), hashes(&all));
        assert!(decode(&bytes[..bytes.len() - 3]).is_err());
        assert!(decode(b"{}").is_err());
    }
}
