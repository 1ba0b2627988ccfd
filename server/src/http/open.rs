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

use super::AppState;
use super::encoding;
use super::error::HttpError;
use super::error_log;
use super::etag::{self, REVALIDATE};
use super::fair::Asker;
use super::page_cache::Compressed;
use crate::library::LibraryError;

/// Assets read ahead of the connection.
const ASSETS_AHEAD: usize = 4;
/// Assets up to this go out as one piece: a scene of many small ones is not a flood of tiny frames.
const JOIN_BYTES: usize = 16 * 1024;

/// `GET /v1/scenes/{scene}/open`
pub(super) async fn open(
    State(state): State<AppState>,
    Path(name): Path<String>,
    method: Method,
    asker: Asker,
    request: HeaderMap,
) -> Result<Response, HttpError> {
    state.may_read(&request, &name)?;
    let library = state.0.library.clone();
    let reference = library.reference(&name).await?;
    let compresses = encoding::takes_zstd(&request);
    let tag = match etag::tag(reference.scene) {
        tag if compresses => encoding::weak(&tag),
        tag => tag,
    };
    if etag::is_held(&request, &tag) {
        let held = etag::not_modified(tag, REVALIDATE);
        return Ok(([encoding::VARIES], held).into_response());
    }
    state.0.metrics.opened(&name);
    let headers = [(CONTENT_TYPE, wire::MEDIA_TYPE)];
    let encoding = compresses.then_some([encoding::ZSTD]);
    let response = |body| {
        let tag = [(ETAG, tag), encoding::VARIES];
        ([REVALIDATE], tag, headers, encoding, body).into_response()
    };
    if method == Method::HEAD {
        return Ok(response(Body::empty()));
    }
    let scene_bytes = state.0.pages.object(&reference.scene, asker).await?;
    // An asset that the scene uses with several materials comes once.
    let mut seen = HashSet::new();
    let scene = library.decode_scene(&reference.scene, &scene_bytes)?;
    let assets: Vec<_> = scene
        .assets
        .iter()
        .map(|asset| asset.asset)
        .filter(|asset| seen.insert(*asset))
        .collect();
    // Frames of Zstandard one after the other are one stream (RFC 8878, section 3), so that each asset's is kept.
    let mut first = block(BlockKind::Scene, reference.scene, scene_bytes).to_vec();
    let mut end = Bytes::copy_from_slice(&wire::end_block());
    if compresses {
        first = vec![encoding::compressed(async { Ok(first) }).await?];
        end = encoding::compressed(async { Ok(vec![end]) }).await?;
    }
    let assets = stream::iter(assets)
        .map(move |asset| asset_blocks(state.clone(), asset, asker, compresses))
        .buffered(ASSETS_AHEAD)
        .map_ok(|pieces| stream::iter(pieces.into_iter().map(Ok::<_, LibraryError>)))
        .try_flatten();
    let blocks = stream::iter(first.into_iter().map(Ok))
        .chain(assets)
        .chain(stream::once(async { Ok(end) }))
        .inspect_err(error_log::cut_short);
    Ok(response(Body::from_stream(blocks)))
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
            vec![pages.compressed(Compressed::Opening, &hash, make).await?]
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
        true => vec![Bytes::from(pieces.concat())],
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
