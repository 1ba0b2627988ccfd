//! Where bytes come from: a server over HTTP, or a library folder. Both give the same answers.

use std::sync::Arc;

use bytes::Bytes;
use lodestream_format::ContentHash;
use lodestream_format::wire::{PagesPost, SceneEntry};

use super::error::{StreamError, check_hash};
use super::folder_source::FolderSource;
use super::http::HttpSource;
use super::limits::StreamLimits;
use super::opened_scene::{OpenedAsset, OpenedScene};
use super::page_check::pack_range;

pub use super::http::PageAnswer;

/// A library, near or far. Clones share connections.
#[derive(Debug, Clone)]
pub struct Source {
    kind: Kind,
    limits: StreamLimits,
}

#[derive(Debug, Clone)]
enum Kind {
    Http(Arc<HttpSource>),
    Folder(Arc<FolderSource>),
}

impl Source {
    /// `http://…` or `https://…`, else a library folder. Nothing is asked of a server before the first request.
    ///
    /// # Errors
    /// [`StreamError::Location`] where the folder is none or holds no library, or the URL is none.
    pub fn connect(url_or_folder: &str) -> Result<Source, StreamError> {
        Self::connect_within(url_or_folder, &StreamLimits::default())
    }

    /// [`Source::connect`] with bounds other than the usual ones.
    ///
    /// # Errors
    /// As [`Source::connect`].
    pub fn connect_within(
        url_or_folder: &str,
        limits: &StreamLimits,
    ) -> Result<Source, StreamError> {
        let kind = if url_or_folder.contains("://") {
            Kind::Http(Arc::new(HttpSource::new(url_or_folder, limits)?))
        } else {
            Kind::Folder(Arc::new(FolderSource::new(url_or_folder)?))
        };
        Ok(Source {
            kind,
            limits: *limits,
        })
    }

    /// Whether [`Source::post_pages`] has somebody to post to.
    pub fn takes_posts(&self) -> bool {
        matches!(self.kind, Kind::Http(_))
    }

    /// Every scene of the library, by name.
    pub async fn scenes(&self) -> Result<Vec<SceneEntry>, StreamError> {
        match &self.kind {
            Kind::Http(http) => http.scenes().await,
            Kind::Folder(folder) => {
                let folder = folder.clone();
                blocking(move || folder.scenes()).await
            }
        }
    }

    /// A scene with its hierarchies and root pages, everything hash-checked and parsed, within
    /// [`StreamLimits::open_memory_bytes`].
    pub async fn open(&self, scene: &str) -> Result<OpenedScene, StreamError> {
        let parts = match &self.kind {
            Kind::Http(http) => http.open(scene).await?,
            Kind::Folder(folder) => {
                let (folder, scene) = (folder.clone(), scene.to_owned());
                let memory_bytes = self.limits.open_memory_bytes;
                blocking(move || folder.open(&scene, memory_bytes)).await?
            }
        };
        blocking(move || OpenedScene::parse(parts)).await
    }

    /// The frames of pages `first..=last` of an asset, end to end; as many bytes as the asset says, not yet hash-checked.
    pub async fn pages(
        &self,
        opened: &OpenedAsset,
        first: u32,
        last: u32,
    ) -> Result<Bytes, StreamError> {
        let hash = opened.hash;
        let range =
            pack_range(&opened.asset, first, last).ok_or_else(|| StreamError::NotFound {
                place: format!("pages {first}-{last} of asset {hash}"),
            })?;
        match &self.kind {
            Kind::Http(http) => {
                http.pages(&hash, first, last, range.end - range.start)
                    .await
            }
            Kind::Folder(folder) => {
                let (folder, pack) = (folder.clone(), opened.asset.pack);
                blocking(move || folder.object_range(&pack, range)).await
            }
        }
    }

    /// Posts for many pages of `assets` at once and calls `take` with each as it comes, until the
    /// answer ends.
    ///
    /// # Errors
    /// [`StreamError::Http`] where the answer breaks off; what came before has been taken.
    /// [`StreamError::Format`] where it brings anything that was not asked for.
    pub async fn post_pages(
        &self,
        post: &PagesPost,
        assets: &[OpenedAsset],
        take: impl FnMut(PageAnswer),
    ) -> Result<(), StreamError> {
        match &self.kind {
            Kind::Http(http) => http.post_pages(post, assets, take).await,
            Kind::Folder(_) => Err(posts_need_http()),
        }
    }

    /// An object of at most `most_bytes` with its hash checked.
    ///
    /// # Errors
    /// [`StreamError::Length`] where it has more.
    pub async fn object(&self, hash: &ContentHash, most_bytes: u64) -> Result<Bytes, StreamError> {
        let bytes = match &self.kind {
            Kind::Http(http) => http.object(hash, most_bytes).await?,
            Kind::Folder(folder) => {
                let (folder, hash) = (folder.clone(), *hash);
                blocking(move || folder.object(&hash, most_bytes)).await?
            }
        };
        check_hash(|| format!("object {hash}"), hash, &bytes)?;
        Ok(bytes)
    }
}

pub(crate) fn posts_need_http() -> StreamError {
    StreamError::Setting {
        setting: "transport",
        expected: "GET, since a folder takes no posts".to_owned(),
        found: "POST".to_owned(),
    }
}

/// Runs `work` where blocking harms nobody.
pub(crate) async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, StreamError> + Send + 'static,
) -> Result<T, StreamError> {
    tokio::task::spawn_blocking(work)
        .await
        .unwrap_or_else(|error| {
            Err(StreamError::Setting {
                setting: "worker thread",
                expected: "an answer".to_owned(),
                found: error.to_string(),
            })
        })
}
