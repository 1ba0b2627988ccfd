//! The stores that a library may lie in.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use lodestream_server::library::Library;

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

/// A prefix of its own in the bucket of the environment.
fn s3() -> Option<String> {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let bucket = std::env::var("LODESTREAM_TEST_S3").ok()?;
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    let own = format!("{}-{}-{number}", std::process::id(), now.as_nanos());
    Some(format!("{}/{own}", bucket.trim_end_matches('/')))
}
