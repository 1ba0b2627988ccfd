//! What a library keeps beside objects: plans, build records, scene references. They are read as `ingest --finish` does.

use std::sync::{Arc, OnceLock};

use lodestream_format::ContentHash;
use lodestream_format::library::SceneReference;
use lodestream_server::ingest;
use lodestream_server::library::{BuildRecord, Check, Library, PlanNote};
use object_store::memory::InMemory;
use object_store::path::Path;
use object_store::{ObjectStoreExt, PutPayload};
use serde_json::Value;
use tokio::runtime::Runtime;

use super::input::{Input, manifest, with_hashes};

pub const MOST_BYTES: [usize; 2] = [16 << 20, 4096];

/// The key of the build.
const KEY: ContentHash = ContentHash([7; 32]);

/// A byte whose bits say which notes come with their hashes; plan and build record behind their lengths; the outline's plain bytes. `$B`
/// is the build's key, `$O` the outline.
pub fn run(data: &[u8]) {
    static RUNTIME: OnceLock<Runtime> = OnceLock::new();
    let runtime = RUNTIME.get_or_init(|| Runtime::new().expect("a runtime"));
    let mut input = Input(data);
    let hashed = input.byte();
    let (plan, build) = (input.sized(), input.sized());
    let outline = manifest(b"LSS2", input.0);
    let hashes = [(b'B', KEY), (b'O', ContentHash::of(&outline))];
    let note = |bit: u8, text: &[u8]| {
        let json = with_hashes(text, &hashes);
        match hashed & bit {
            0 => [
                format!("{}\n", ContentHash::of(&json)).into_bytes(),
                json,
                b"\n".to_vec(),
            ]
            .concat(),
            _ => json,
        }
    };
    let store = Arc::new(InMemory::new());
    let put = |path: String, bytes: Vec<u8>| {
        let path = Path::from(path);
        let put = store.put(&path, PutPayload::from(bytes));
        runtime.block_on(put).expect("stores");
    };
    let key = KEY.to_string();
    put("plans/s".to_owned(), note(1, plan));
    put(format!("builds/{}/{key}", &key[..2]), note(2, build));
    put("scenes/s".to_owned(), with_hashes(build, &hashes));
    let name = hashes[1].1.to_string();
    put(format!("objects/{}/{name}", &name[..2]), outline);
    let library = Library::over(store.clone(), "memory://");
    runtime.block_on(async {
        if let Ok(note) = library.plan::<Value>("s").await {
            library.put_plan("t", &note).await.expect("stores");
            let again: PlanNote<Value> = library.plan("t").await.expect("what was written");
            assert_eq!(again, note);
        }
        if let Ok(Some(record)) = library.build::<Value>(&KEY).await {
            let record: BuildRecord<Value> = record;
            library.put_build(&KEY, &record).await.expect("stores");
            let again = library.build(&KEY).await.expect("what was written");
            assert_eq!(again, Some(record));
        }
        if let Ok(reference) = library.reference("s").await {
            let reference: SceneReference = reference;
            let page = library.scenes(None, 9).await.expect("one scene");
            assert_eq!(page.scenes[0].reference, reference);
        }
    });
    let quiet = ingest::ProgressTo::default();
    if let Ok(report) = ingest::finish(runtime.handle(), &library, "s", Check::Hash, quiet) {
        let reference = runtime.block_on(library.reference("s"));
        assert!(reference.is_ok(), "{report:?}");
    }
}
