//! How manifests become bytes: `magic: u32, bincode bytes: u64, zstd(bincode)`.

use crate::error::{FormatError, ensure};
use crate::limits::MAX_MESSAGE_BYTES;

const HEADER_BYTES: usize = 12;

fn config() -> impl bincode::config::Config {
    bincode::config::standard().with_limit::<MAX_MESSAGE_BYTES>()
}

/// Takes `value` to drop it before its bytes are compressed.
pub(crate) fn encode(magic: [u8; 4], value: impl bincode::Encode) -> Result<Vec<u8>, FormatError> {
    let at = String::from_utf8_lossy(&magic).into_owned();
    let plain = bincode::encode_to_vec(&value, config())
        .map_err(|error| FormatError::new(&at, "to encode", error))?;
    drop(value);
    ensure(
        plain.len() <= MAX_MESSAGE_BYTES,
        &at,
        format!("at most {MAX_MESSAGE_BYTES} bytes"),
        plain.len(),
    )?;
    let mut bytes = magic.to_vec();
    bytes.extend((plain.len() as u64).to_le_bytes());
    bytes.extend(
        zstd::bulk::compress(&plain, 9)
            .map_err(|error| FormatError::new(&at, "to compress", error))?,
    );
    Ok(bytes)
}

/// Most bytes of memory for one of the message: a text that is empty takes one there and 24 here.
const MOST_MEMORY_A_BYTE: usize = 32;
const SMALL: usize = 2 << 20;
const MIDDLE: usize = 32 << 20;
const LARGE: usize = 256 << 20;
/// The message and what it becomes.
const HUGE: usize = 2 * MAX_MESSAGE_BYTES;
/// Limits of bincode, which makes room for as many items as a list claims before it reads them.
const LIMITS: [usize; 5] = [SMALL, MIDDLE, LARGE, MAX_MESSAGE_BYTES, HUGE];

/// The limit that holds whatever a message of `plain_bytes` may become, or less where memory is.
fn limit(plain_bytes: usize, memory_bytes: u64) -> usize {
    let holds = |&limit: &usize| limit >= plain_bytes.saturating_mul(MOST_MEMORY_A_BYTE);
    let fits = |&limit: &usize| limit as u64 <= memory_bytes;
    let holding = LIMITS.into_iter().find(holds).unwrap_or(HUGE);
    holding.min(LIMITS.into_iter().rev().find(fits).unwrap_or(SMALL))
}

fn decode_within<T: bincode::Decode<()>, const LIMIT: usize>(
    plain: &[u8],
) -> Result<(T, usize), bincode::error::DecodeError> {
    bincode::decode_from_slice(plain, bincode::config::standard().with_limit::<LIMIT>())
}

/// Decodes with at most `memory_bytes` for the message and what it becomes.
pub(crate) fn decode<T: bincode::Decode<()>>(
    magic: [u8; 4],
    bytes: &[u8],
    memory_bytes: u64,
) -> Result<T, FormatError> {
    let at = String::from_utf8_lossy(&magic).into_owned();
    ensure(
        bytes.len() >= HEADER_BYTES,
        &at,
        "at least 12 bytes",
        bytes.len(),
    )?;
    let found = String::from_utf8_lossy(&bytes[..4]).into_owned();
    ensure(bytes[..4] == magic, "magic", &at, format!("{found:?}"))?;
    let mut length = [0; 8];
    length.copy_from_slice(&bytes[4..HEADER_BYTES]);
    let length = u64::from_le_bytes(length);
    let most = memory_bytes.min(MAX_MESSAGE_BYTES as u64);
    ensure(
        length <= most,
        &at,
        format_args!("at most {most} bytes"),
        length,
    )?;
    let packed = &bytes[HEADER_BYTES..];
    // The frame's own size field bounds the allocation: a short file cannot ask for a gigabyte.
    let claimed = zstd::zstd_safe::get_frame_content_size(packed)
        .ok()
        .flatten();
    ensure(
        claimed == Some(length),
        &at,
        format_args!("a zstd frame of {length} bytes"),
        format_args!("{claimed:?}"),
    )?;
    ensure(
        length / 20_000 <= packed.len() as u64,
        &at,
        "a compression ratio below 20000",
        length,
    )?;
    let plain = zstd::bulk::decompress(packed, length as usize)
        .map_err(|error| FormatError::new(&at, "zstd", error))?;
    let limit = limit(plain.len(), memory_bytes - length);
    let decoded = match limit {
        SMALL => decode_within::<T, SMALL>(&plain),
        MIDDLE => decode_within::<T, MIDDLE>(&plain),
        LARGE => decode_within::<T, LARGE>(&plain),
        MAX_MESSAGE_BYTES => decode_within::<T, MAX_MESSAGE_BYTES>(&plain),
        _ => decode_within::<T, HUGE>(&plain),
    };
    let (value, used) = decoded.map_err(|error| match error {
        bincode::error::DecodeError::LimitExceeded => {
            let found = format!("a message of {length} bytes that claims more");
            FormatError::new(&at, format!("lists of at most {limit} bytes"), found)
        }
        error => FormatError::new(&at, "bincode", error),
    })?;
    ensure(
        used == plain.len(),
        &at,
        format_args!("{used} bytes"),
        plain.len(),
    )?;
    Ok(value)
}
