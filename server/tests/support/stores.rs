//! The stores that a library may lie in.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use lodestream_server::library::Library;
use object_store::ObjectStore;
use object_store::aws::AmazonS3Builder;
use object_store::local::LocalFileSystem;
use object_store::memory::InMemory;
use object_store::prefix::PrefixStore;

/// A test over each kind of store.
pub async fn on_each_store<F: Future<Output = ()>>(test: impl Fn(Library) -> F) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new").join("library");
    test(Library::open_or_create(path.to_str().unwrap()).unwrap()).await;
    test(Library::open("memory://").unwrap()).await;
    match s3() {
        Some(location) => test(Library::open(&location).unwrap()).await,
        None => println!("SKIPPED: S3, as LODESTREAM_TEST_S3 does not name a bucket"),
    }
}

/// The same, with the raw store of each library, to damage its files.
pub async fn on_each_raw_store<F: Future<Output = ()>>(
    test: impl Fn(Library, Arc<dyn ObjectStore>) -> F,
) {
    let folder = tempfile::tempdir().unwrap();
    let library = Library::open(folder.path().to_str().unwrap()).unwrap();
    let files = LocalFileSystem::new_with_prefix(folder.path()).unwrap();
    test(library, Arc::new(files)).await;
    let memory = Arc::new(InMemory::new());
    test(Library::over(memory.clone(), "memory"), memory).await;
    let Some(location) = s3() else {
        println!("SKIPPED: S3, as LODESTREAM_TEST_S3 does not name a bucket");
        return;
    };
    let place = location.strip_prefix("s3://").unwrap();
    let (bucket, prefix) = place.split_once('/').unwrap();
    // Opened first: it installs the crypto provider.
    let library = Library::open(&location).unwrap();
    let client = AmazonS3Builder::from_env().with_bucket_name(bucket);
    let files = PrefixStore::new(client.build().unwrap(), prefix);
    test(library, Arc::new(files)).await;
}

/// A prefix of its own in the bucket of the environment.
fn s3() -> Option<String> {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let bucket = std::env::var("LODESTREAM_TEST_S3").ok()?;
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    let own = format!("{}-{}-{number}", std::process::id(), now.as_nanos());
    Some(format!("{}/{own}", bucket.trim_end_matches('/')))
}
