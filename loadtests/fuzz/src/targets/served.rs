//! A server without a socket, over a small library in memory.

use std::path::PathBuf;
use std::sync::OnceLock;

use axum::body::{Body, Bytes, to_bytes};
use axum::http::{HeaderMap, Request, StatusCode};
use hyper::service::Service as _;
use hyper_util::service::TowerToHyperService;
use lodestream_format::asset::PageEntry;
use lodestream_format::grid::Grid;
use lodestream_format::instances::InstanceSteps;
use lodestream_format::scene::{Instance, SceneAsset};
use lodestream_format::{Aabb, Asset, ContentHash, Scene};
use lodestream_server::http::tokens::Tokens;
use lodestream_server::http::uploads::{UploadOptions, UploadsFolder};
use lodestream_server::http::{AppState, StateOptions, router};
use lodestream_server::library::Library;
use tokio::runtime::Runtime;

use super::input::folder;

/// A token that it knows.
pub const TOKEN: &str = "0123456789abcdef";
/// More than any answer has.
const MOST_ANSWER: usize = 1 << 24;

/// The server, and what its library holds.
pub struct Served {
    runtime: Runtime,
    service: TowerToHyperService<axum::Router>,
    pub state: AppState,
    pub asset: Asset,
    pub pack: Vec<u8>,
    /// By their letters in inputs: asset, pack, scene.
    pub hashes: [(u8, ContentHash); 3],
}

/// An answer, whole.
pub struct Answer {
    pub status: StatusCode,
    pub headers: HeaderMap,
    pub body: Bytes,
}

impl Served {
    pub fn answer(&self, request: Request<Body>) -> Answer {
        answer(&self.runtime, &self.service, request)
    }
}

/// A runtime of this thread alone.
pub fn runtime() -> Runtime {
    let mut builder = tokio::runtime::Builder::new_current_thread();
    builder.enable_all().build().expect("a runtime")
}

fn answer(
    runtime: &Runtime,
    service: &TowerToHyperService<axum::Router>,
    request: Request<Body>,
) -> Answer {
    runtime.block_on(async {
        let Ok(response) = service.call(request).await;
        let (parts, body) = response.into_parts();
        let body = to_bytes(body, MOST_ANSWER).await.expect("a whole answer");
        Answer {
            status: parts.status,
            headers: parts.headers,
            body,
        }
    })
}

/// One for all inputs.
pub fn served() -> &'static Served {
    static SERVED: OnceLock<Served> = OnceLock::new();
    SERVED.get_or_init(|| {
        let runtime = runtime();
        let library = Library::open("memory://").expect("a library");
        let (asset, pack, hashes) = runtime.block_on(fill(&library));
        let file = folder("served").join("tokens");
        std::fs::write(&file, TOKEN).expect("writes");
        let tokens = Tokens::from_upload_file(&file).expect("a token");
        let state = AppState::with_options(library, options(1 << 20, tokens));
        Served {
            runtime,
            service: TowerToHyperService::new(router(state.clone())),
            state,
            asset,
            pack,
            hashes,
        }
    })
}

/// The status of an upload to a server with these tokens.
pub fn upload_status(tokens: Tokens, authorization: &[u8]) -> Option<StatusCode> {
    let request = Request::put("/v1/scenes/a").header("authorization", authorization);
    let request = request.body(Body::empty()).ok()?;
    let library = Library::open("memory://").expect("a library");
    let state = AppState::with_options(library, options(1 << 16, tokens));
    let service = TowerToHyperService::new(router(state));
    Some(answer(&served().runtime, &service, request).status)
}

fn options(cache_bytes: usize, tokens: Tokens) -> StateOptions {
    StateOptions {
        cache_bytes,
        uploads: Some(uploads(tokens)),
        ..StateOptions::default()
    }
}

/// Whatever is uploaded, no program builds it.
fn uploads(tokens: Tokens) -> UploadOptions {
    UploadOptions {
        tokens,
        program: PathBuf::from("/nowhere/lodestream-server"),
        library: "memory://".to_owned(),
        folder: UploadsFolder::new(&folder("scratch")).expect("a folder"),
        confined: false,
        max_bytes: 64,
        max_triangles: 1,
        max_secs: 1,
        memory_bytes: 1 << 20,
    }
}

async fn fill(library: &Library) -> (Asset, Vec<u8>, [(u8, ContentHash); 3]) {
    let put = async |bytes: Vec<u8>| {
        let stored = library.put_object(Bytes::from(bytes), 60).await;
        stored.expect("stores").0
    };
    let pack: Vec<u8> = (0..=255).collect();
    let page = |(page, bytes): (u32, u32)| {
        let offset = [0, 100, 150][page as usize];
        PageEntry {
            offset,
            bytes,
            memory_words: 9,
            hash: ContentHash::of(&pack[offset as usize..][..bytes as usize]),
            dependencies: (0..page).collect(),
        }
    };
    let unit = [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
    ];
    let asset = Asset {
        attributes: Default::default(),
        position_grid: Grid { step_exponent: -10 },
        uv_grid: Grid { step_exponent: -13 },
        center_q: [0; 3],
        aabb: Aabb {
            min: [-1.0; 3],
            max: [1.0; 3],
        },
        material_slots: 1,
        source_triangles: 1,
        dag_triangles: 1,
        clusters: 1,
        levels: 1,
        pack: put(pack.clone()).await,
        hierarchy: put(b"hierarchy".to_vec()).await,
        proxy: Default::default(),
        root_page_count: 1,
        pages: [(0, 100), (1, 50), (2, 106)].map(page).to_vec(),
    };
    let hash = put(asset.encode().expect("encodes")).await;
    let scene = Scene {
        assets: vec![SceneAsset {
            name: "a".to_owned(),
            asset: hash,
            materials: vec![],
            steps: InstanceSteps::default(),
        }],
        instances: vec![Instance {
            asset: 0,
            world_from_object: unit,
        }],
        ..Scene::default()
    };
    let scene = put(scene.encode().expect("encodes")).await;
    library.publish("a", scene).await.expect("publishes");
    library.publish("b.2", scene).await.expect("publishes");
    let hashes = [(b'A', hash), (b'P', asset.pack), (b'S', scene)];
    (asset, pack, hashes)
}
