//! `GET /v1/scenes/{scene}/open`: scene, assets, hierarchies and root pages in one answer: first picture in one round trip.

use std::collections::HashSet;
use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::header::{CONTENT_TYPE, ETAG};
use axum::http::{HeaderMap, Method};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::wire::{self, BlockKind, PageStatus};
use lodestream_format::{Asset, ContentHash};
use tokio::sync::OnceCell;

use super::AppState;
use super::encoding;
use super::error::HttpError;
use super::error_log;
use super::etag::{self, REVALIDATE};
use super::fair::Asker;
use super::limits::ClientAddress;
use super::page_cache::Made;
use crate::library::LibraryError;

/// Assets read ahead of the connection.
const ASSETS_AHEAD: usize = 4;
/// Assets up to this go out as one piece: a scene of many small ones is not a flood of tiny frames.
const JOIN_BYTES: usize = 16 * 1024;
const HASH_BYTES: usize = 32;

/// `GET /v1/scenes/{scene}/open`
pub(super) async fn open(
    State(state): State<AppState>,
    Path(name): Path<String>,
    method: Method,
    asker: Asker,
    client: ClientAddress,
    request: HeaderMap,
) -> Result<Response, HttpError> {
    state.check_read(&request, &name)?;
    let reference = state.reference(client, &name).await?;
    let compresses = encoding::takes_zstd(&request);
    let tag = match etag::tag(reference.scene) {
        tag if compresses => encoding::weak(&tag),
        tag => tag,
    };
    if etag::is_held(&request, &tag) {
        let held = etag::not_modified(tag, REVALIDATE);
        let held = ([encoding::VARIES], held).into_response();
        return Ok(state.guarded(&name, held));
    }
    state.0.metrics.opened(&name);
    let headers = [(CONTENT_TYPE, wire::MEDIA_TYPE)];
    let encoding = compresses.then_some([encoding::ZSTD]);
    let guard = state.clone();
    let response = |body| {
        let tag = [(ETAG, tag), encoding::VARIES];
        let answer = ([REVALIDATE], tag, headers, encoding, body).into_response();
        guard.guarded(&name, answer)
    };
    if method == Method::HEAD {
        return Ok(response(Body::empty()));
    }
    // Boxed, as what follows: an answer that waits takes no more than it has.
    let began = Box::pin(begin(&state, &reference.scene, asker, compresses));
    let (first, assets) = began.await?;
    let end = end(compresses).await?;
    let assets = stream::iter((1..assets.len() / HASH_BYTES).filter_map(move |number| {
        let hash = assets.get(number * HASH_BYTES..(number + 1) * HASH_BYTES)?;
        Some(ContentHash(hash.try_into().ok()?))
    }));
    let assets = assets
        .map(move |asset| Box::pin(asset_blocks(state.clone(), asset, asker, compresses)))
        .buffered(ASSETS_AHEAD)
        .map_ok(|pieces| stream::iter(pieces.into_iter().map(Ok::<_, LibraryError>)))
        .try_flatten();
    let blocks = stream::iter(first.into_iter().map(Ok))
        .chain(assets)
        .chain(stream::once(async { Ok(end) }))
        .inspect_err(error_log::cut_short);
    Ok(response(Body::from_stream(blocks)))
}

/// The beginning of a scene's answer, and the hashes of its assets behind its own, one after the
/// other: never nothing, for what weighs nothing stays in the cache for ever. Frames of Zstandard
/// one after the other are one stream (RFC 8878, section 3), so that each is kept.
async fn begin(
    state: &AppState,
    hash: &ContentHash,
    asker: Asker,
    compresses: bool,
) -> Result<(Vec<Bytes>, Bytes), LibraryError> {
    let pages = &state.0.pages;
    let object = pages.object(hash, asker).await?;
    let listed = async {
        let scene = state.0.library.decode_scene(hash, &object)?;
        // An asset that the scene uses with several materials comes once.
        let mut seen = HashSet::new();
        let assets = scene.assets.iter().map(|asset| asset.asset);
        let assets = assets.filter(|asset| seen.insert(*asset));
        let hashes: Vec<[u8; HASH_BYTES]> = std::iter::once(*hash)
            .chain(assets)
            .map(|hash| hash.0)
            .collect();
        Ok(Bytes::from(hashes.concat()))
    };
    let assets = pages.made(Made::Assets, hash, listed).await?;
    let first = block(BlockKind::Scene, *hash, object).to_vec();
    let first = match compresses {
        false => first,
        true => {
            let make = encoding::compressed(async { Ok(first) });
            vec![pages.made(Made::Scene, hash, make).await?]
        }
    };
    Ok((first, assets))
}

/// The end of every answer.
async fn end(compresses: bool) -> Result<Bytes, LibraryError> {
    static COMPRESSED: OnceCell<Bytes> = OnceCell::const_new();
    let end = Bytes::copy_from_slice(&wire::end_block());
    match compresses {
        false => Ok(end),
        true => COMPRESSED
            .get_or_try_init(|| encoding::compressed(async { Ok(vec![end]) }))
            .await
            .cloned(),
    }
}

/// Asset, Hierarchy and RootPages of one asset.
async fn asset_blocks(
    state: AppState,
    hash: ContentHash,
    asker: Asker,
    compresses: bool,
) -> Result<Vec<Bytes>, LibraryError> {
    let asset = state.0.tables.asset(&state.0.library, &hash).await?;
    let blocks = blocks_of(&state, &asset, &hash, asker);
    let pieces = match compresses {
        false => blocks.await?,
        true => {
            let (pages, make) = (&state.0.pages, encoding::compressed(blocks));
            vec![pages.made(Made::Opening, &hash, make).await?]
        }
    };
    state.0.metrics.pages_sent(asset.root_page_count as u64);
    Ok(pieces)
}

async fn blocks_of(
    state: &AppState,
    asset: &Arc<Asset>,
    hash: &ContentHash,
    asker: Asker,
) -> Result<Vec<Bytes>, LibraryError> {
    let roots = 0..=asset.root_page_count - 1;
    let cache = &state.0.pages;
    let (asset_object, hierarchy, root_pages) = futures_util::try_join!(
        cache.object(hash, asker),
        cache.object(&asset.hierarchy, asker),
        cache.pages(asset, roots, asker),
    )?;
    let mut pieces = Vec::with_capacity(8);
    pieces.extend(block(BlockKind::Asset, *hash, asset_object));
    pieces.extend(block(BlockKind::Hierarchy, asset.hierarchy, hierarchy));
    pieces.push(block_header(
        BlockKind::RootPages,
        *hash,
        root_pages.bytes(),
    ));
    pieces.extend(root_pages);
    let total: usize = pieces.iter().map(Bytes::len).sum();
    Ok(match total <= JOIN_BYTES {
        true => vec![cache.memory().keep(Bytes::from(pieces.concat()))],
        false => pieces,
    })
}

fn block(kind: BlockKind, hash: ContentHash, payload: Bytes) -> [Bytes; 2] {
    [block_header(kind, hash, payload.len() as u64), payload]
}

fn block_header(kind: BlockKind, hash: ContentHash, bytes: u64) -> Bytes {
    let header = wire::block_header(kind, PageStatus::Ok, 0, hash, bytes);
    Bytes::copy_from_slice(&header)
}
