//! `GET /v1/openapi.json`: what the other routes take and answer, for people and for programs that write clients.

use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};

use super::etag::REVALIDATE;

/// The document; a test holds it against the router.
const DOCUMENT: &str = include_str!("openapi.json");

/// `GET /v1/openapi.json`
pub(super) async fn openapi() -> Response {
    ([REVALIDATE], [(CONTENT_TYPE, "application/json")], DOCUMENT).into_response()
}

#[cfg(test)]
mod tests {
    use super::super::{Serves, routes};
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn the_document_has_every_route_and_no_other() {
        let document: serde_json::Value = serde_json::from_str(DOCUMENT).expect("JSON");
        let described = document["paths"].as_object().expect("paths");
        let described: BTreeSet<&str> = described.keys().map(String::as_str).collect();
        let routes: BTreeSet<&str> = routes(Serves::All)
            .into_iter()
            .map(|(path, _)| path)
            .collect();
        assert_eq!(described, routes);
    }
}
