//! `GET /v1/scenes`: the library, paged. `GET /v1/scenes/{scene}`: what the name points at now.

use axum::Json;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Path, Query, State};
use axum::http::HeaderMap;
use axum::http::header::ETAG;
use axum::response::{IntoResponse, Response};
use lodestream_format::FormatError;

use super::AppState;
use super::error::HttpError;
use super::etag::{self, REVALIDATE};
use super::limits::ClientAddress;

/// Scenes of one answer where the query does not say.
const DEFAULT_LIMIT: usize = 100;
/// Most scenes of one answer.
const MAX_LIMIT: usize = 1000;

/// Query of the list.
#[derive(Debug, serde::Deserialize)]
pub(super) struct ListQuery {
    after: Option<String>,
    limit: Option<usize>,
}

/// `GET /v1/scenes?after=NAME&limit=N`
pub(super) async fn list(
    State(state): State<AppState>,
    query: Result<Query<ListQuery>, QueryRejection>,
    request: HeaderMap,
) -> Result<Response, HttpError> {
    let Query(query) = query.map_err(|error| {
        HttpError::BadRequest(FormatError::new(
            "query",
            "after=NAME&limit=N",
            error.body_text(),
        ))
    })?;
    let limit = query.limit.unwrap_or(DEFAULT_LIMIT);
    if !(1..=MAX_LIMIT).contains(&limit) {
        let error = FormatError::new("query limit", format!("1..={MAX_LIMIT}"), limit);
        return Err(HttpError::BadRequest(error));
    }
    let may_see = |scene: &str| state.may_read(&request, scene);
    let page = state.0.listing.page(query.after.as_deref(), limit, may_see);
    let answer = ([REVALIDATE], Json(page.await?)).into_response();
    Ok(state.guarded_list(answer))
}

/// `GET /v1/scenes/{scene}`
pub(super) async fn show(
    State(state): State<AppState>,
    Path(name): Path<String>,
    client: ClientAddress,
    request: HeaderMap,
) -> Result<Response, HttpError> {
    state.check_read(&request, &name)?;
    let reference = state.reference(client, &name).await?;
    let tag = etag::tag(format!("{}.{}", reference.scene, reference.published_secs));
    if etag::is_held(&request, &tag) {
        return Ok(state.guarded(&name, etag::not_modified(tag, REVALIDATE)));
    }
    let answer = ([REVALIDATE], [(ETAG, tag)], Json(reference)).into_response();
    Ok(state.guarded(&name, answer))
}
