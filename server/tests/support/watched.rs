//! A store in memory that notes what is read and written, and can be told to fail.

use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use futures_util::stream::BoxStream;
use object_store::memory::InMemory;
use object_store::path::Path;
use object_store::{
    CopyOptions, GetOptions, GetResult, ListResult, MultipartUpload, ObjectMeta, ObjectStore,
    PutMultipartOptions, PutOptions, PutPayload, PutResult, Result,
};

#[derive(Debug)]
pub struct Watched {
    inner: InMemory,
    /// Paths in the order of their writes.
    written: Mutex<Vec<String>>,
    /// Writes that still succeed.
    writes_left: AtomicI64,
    /// Ranges read so far.
    ranges: AtomicU64,
    /// Look-ups and whole reads so far, and lists.
    looks: AtomicU64,
    lists: AtomicU64,
    /// Listed, and not given.
    hidden: Mutex<Option<Path>>,
    reads_fail: AtomicBool,
    delay_millis: AtomicU64,
}

impl Watched {
    pub fn new() -> Arc<Self> {
        Arc::new(Self {
            inner: InMemory::new(),
            written: Mutex::default(),
            writes_left: AtomicI64::new(i64::MAX),
            ranges: AtomicU64::new(0),
            looks: AtomicU64::new(0),
            lists: AtomicU64::new(0),
            hidden: Mutex::default(),
            reads_fail: AtomicBool::new(false),
            // As long as others need to come and wait.
            delay_millis: AtomicU64::new(20),
        })
    }

    /// What was written since the last call, sorted.
    pub fn take_written(&self) -> Vec<String> {
        let mut written = std::mem::take(&mut *self.written.lock().expect("works"));
        written.sort();
        written
    }

    /// Ranges read since the start.
    pub fn ranges(&self) -> u64 {
        self.ranges.load(Ordering::SeqCst)
    }

    /// Look-ups and whole reads since the start.
    pub fn looks(&self) -> u64 {
        self.looks.load(Ordering::SeqCst)
    }

    /// Lists since the start.
    pub fn lists(&self) -> u64 {
        self.lists.load(Ordering::SeqCst)
    }

    /// Lists what lies at `path` and does not give it.
    pub fn hide(&self, path: &str) {
        *self.hidden.lock().expect("works") = Some(Path::from(path));
    }

    /// Whether reads fail from now on.
    pub fn fail_reads(&self, fail: bool) {
        self.reads_fail.store(fail, Ordering::SeqCst);
    }

    /// How long a range takes from now on.
    pub fn delay_reads(&self, delay: std::time::Duration) {
        let millis = delay.as_millis() as u64;
        self.delay_millis.store(millis, Ordering::SeqCst);
    }

    /// All writes after so many fail.
    pub fn fail_after(&self, writes: i64) {
        self.writes_left.store(writes, Ordering::SeqCst);
    }
}

impl std::fmt::Display for Watched {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("watched memory")
    }
}

#[async_trait::async_trait]
impl ObjectStore for Watched {
    async fn put_opts(
        &self,
        location: &Path,
        payload: PutPayload,
        opts: PutOptions,
    ) -> Result<PutResult> {
        if self.writes_left.fetch_sub(1, Ordering::SeqCst) <= 0 {
            return Err(object_store::Error::Generic {
                store: "watched",
                source: "the disk is full".into(),
            });
        }
        self.written
            .lock()
            .expect("works")
            .push(location.to_string());
        self.inner.put_opts(location, payload, opts).await
    }

    async fn put_multipart_opts(
        &self,
        location: &Path,
        opts: PutMultipartOptions,
    ) -> Result<Box<dyn MultipartUpload>> {
        self.inner.put_multipart_opts(location, opts).await
    }

    async fn get_opts(&self, location: &Path, options: GetOptions) -> Result<GetResult> {
        if options.range.is_some() {
            self.ranges.fetch_add(1, Ordering::SeqCst);
            let delay = self.delay_millis.load(Ordering::SeqCst);
            tokio::time::sleep(std::time::Duration::from_millis(delay)).await;
        } else {
            self.looks.fetch_add(1, Ordering::SeqCst);
        }
        if self.hidden.lock().expect("works").as_ref() == Some(location) {
            return Err(object_store::Error::NotFound {
                path: location.to_string(),
                source: "hidden".into(),
            });
        }
        if self.reads_fail.load(Ordering::SeqCst) {
            return Err(object_store::Error::Generic {
                store: "watched",
                source: "the network is down".into(),
            });
        }
        self.inner.get_opts(location, options).await
    }

    fn delete_stream(
        &self,
        locations: BoxStream<'static, Result<Path>>,
    ) -> BoxStream<'static, Result<Path>> {
        self.inner.delete_stream(locations)
    }

    fn list(&self, prefix: Option<&Path>) -> BoxStream<'static, Result<ObjectMeta>> {
        self.lists.fetch_add(1, Ordering::SeqCst);
        self.inner.list(prefix)
    }

    async fn list_with_delimiter(&self, prefix: Option<&Path>) -> Result<ListResult> {
        self.inner.list_with_delimiter(prefix).await
    }

    async fn copy_opts(&self, from: &Path, to: &Path, options: CopyOptions) -> Result<()> {
        self.inner.copy_opts(from, to, options).await
    }
}
