//! Seeds: small files and messages as our own programs write them, of a sheet that is made here.

mod answers;
mod pages;
mod sheet;

use std::path::{Path, PathBuf};

use lodestream_format::{Asset, ContentHash};
use lodestream_server::export::{Detail, export};
use lodestream_server::ingest::{self, IngestOptions, JobOptions, ProgressTo};
use lodestream_server::library::{Check, Library};
use serde_json::Value;
use tokio::runtime::Runtime;

use crate::targets::input::{plain, sized};

/// Writes seeds below a folder, a folder a target.
pub struct Seeds(PathBuf);

impl Seeds {
    /// One more for `target`.
    pub fn add(&self, target: &str, name: &str, pieces: &[&[u8]]) {
        let folder = self.0.join(target);
        std::fs::create_dir_all(&folder).expect("a folder");
        std::fs::write(folder.join(name), pieces.concat()).expect("writes");
    }
}

/// All of them.
pub fn write(folder: &Path) {
    let seeds = Seeds(folder.to_owned());
    let runtime = Runtime::new().expect("a runtime");
    sheet::files(&seeds);
    pages::forms(&seeds);
    answers::requests(&seeds);
    for side in [3, 14] {
        scene(&seeds, &runtime, side);
    }
}

/// Everything that an ingest of a sheet stores.
fn scene(seeds: &Seeds, runtime: &Runtime, side: u32) {
    let folder = tempfile::tempdir().expect("a folder");
    let model = folder.path().join("sheet.obj");
    // Without a library: a warning would name the folder.
    let text = sheet::obj(side).replace("mtllib m.mtl\n", "");
    std::fs::write(&model, text).expect("writes");
    let library = Library::open("memory://").expect("a library");
    let options = IngestOptions {
        inputs: vec![model.clone()],
        scene: "s".to_owned(),
        threads: Some(1),
        ..IngestOptions::default()
    };
    let name = |what: &str| format!("{what}-{side}");
    ingest::plan(runtime.handle(), &library, &options, 1).expect("a plan");
    let job = JobOptions {
        scene: "s".to_owned(),
        job: 0,
        inputs: vec![],
        threads: Some(1),
        memory_limit_bytes: None,
        scratch: None,
        ..JobOptions::default()
    };
    ingest::job(runtime.handle(), &library, &job).expect("builds");
    ingest::finish(runtime.handle(), &library, "s", Check::Hash, ProgressTo::default()).expect("a scene");
    // Large inputs are slow ones.
    let small = ["out.glb", "out.ply"].into_iter().filter(|_| side < 4);
    for file in small {
        let out = folder.path().join(file);
        export(runtime.handle(), &library, "s", Detail::Source, &out).expect("exports");
        let target = if file.ends_with("glb") { "gltf" } else { "ply" };
        seeds.add(
            target,
            &name("export"),
            &[&std::fs::read(out).expect("reads")],
        );
    }
    runtime.block_on(async {
        let object = async |hash| library.object(&hash).await.expect("an object");
        let note = library.plan::<Value>("s").await.expect("a plan");
        let key = note.builds[0];
        let outline = note.plan["outline"].as_str().and_then(|it| it.parse().ok());
        let outline: ContentHash = outline.expect("a hash");
        let build = library.build::<Value>(&key).await.expect("reads");
        let text = |json: Result<String, serde_json::Error>| {
            let json = json.expect("JSON").replace(&key.to_string(), "$B");
            let json = json.replace(&*model.to_string_lossy(), "sheet.obj");
            json.replace(&outline.to_string(), "$O").into_bytes()
        };
        let plan = text(serde_json::to_string(&note));
        let build = text(serde_json::to_string(&build.expect("built")));
        let outline = plain(&object(outline).await);
        let notes = [&[0][..], &sized(&plan), &sized(&build), &outline].concat();
        seeds.add("records", &name("notes"), &[&notes]);

        let reference = library.reference("s").await.expect("published");
        let json = serde_json::to_vec(&reference).expect("JSON");
        seeds.add("client_files", &name("reference"), &[b"r", &json]);
        seeds.add(
            "records",
            &name("reference"),
            &[&[0], &sized(&plan), &sized(&json)],
        );
        let scene = object(reference.scene).await;
        seeds.add("scene", &name("whole"), &[&[0], &scene]);
        seeds.add("scene", &name("plain"), &[&[1], &plain(&scene)]);
        let decoded = library.scene(&reference.scene).await.expect("a scene");
        let asset = object(decoded.assets[0].asset).await;
        seeds.add("asset", &name("whole"), &[&[0], &asset]);
        seeds.add("asset", &name("plain"), &[&[1], &plain(&asset)]);
        let decoded = Asset::decode(&asset).expect("an asset");
        let hierarchy = object(decoded.hierarchy).await;
        let count = decoded.pages.len() as u16;
        seeds.add(
            "hierarchy",
            &name("object"),
            &[&count.to_le_bytes(), &hierarchy],
        );
        let pack = object(decoded.pack).await;
        for (number, page) in decoded.pages.iter().enumerate() {
            let frame = &pack[page.offset as usize..][..page.bytes as usize];
            seeds.add("frame", &name(&format!("page-{number}")), &[frame]);
        }
        let parts = [
            sized(&plain(&scene)),
            sized(&plain(&asset)),
            sized(&hierarchy),
        ];
        seeds.add("opened_scene", &name("parts"), &[&parts.concat(), &pack]);
        let objects = [(1, &scene), (2, &asset), (3, &hierarchy), (4, &pack)];
        answers::streams(
            seeds,
            &name("open"),
            &objects.map(|(kind, bytes)| (kind, &bytes[..])),
        );
    });
}
