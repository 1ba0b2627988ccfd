//! Builds that are found again: after an edit, after a failure in the middle, and never where a record is not true.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;

use lodestream_format::ContentHash;
use lodestream_server::build::{BuildOptions, PositionStep, build};
use lodestream_server::import::Mesh;
use lodestream_server::ingest::{
    BUILDER_VERSION, IngestError, IngestOptions, IngestReport, ingest,
};
use lodestream_server::library::{Check, Library, LibraryError, Repaired};
use support::binary::{command, json, ok, run, stderr, text};
use support::bumps::{self, Bump, bump};
use support::watched::Watched;
use support::{age, files, runtime};

const THREE: [Bump; 3] = [bump("a", 1, 12), bump("b", 2, 16), bump("c", 3, 20)];

fn options(input: &Path) -> IngestOptions {
    IngestOptions {
        inputs: vec![input.to_owned()],
        scene: "x".to_owned(),
        threads: Some(2),
        ..IngestOptions::default()
    }
}

/// Ingests and gives the report with the scene's name.
fn ingested(
    library: &Library,
    options: &IngestOptions,
) -> Result<(IngestReport, ContentHash), Box<IngestError>> {
    let runtime = runtime();
    let report = ingest(runtime.handle(), library, options).map_err(Box::new)?;
    let reference = runtime.block_on(library.reference(&options.scene)).unwrap();
    Ok((report, reference.scene))
}

fn watched() -> (Arc<Watched>, Library) {
    let store = Watched::new();
    let library = Library::over(store.clone(), "watched");
    (store, library)
}

#[test]
fn a_second_ingest_builds_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let options = options(&bumps::write(folder.path(), "three", &THREE));
    let (store, library) = watched();
    let (first, scene) = ingested(&library, &options).unwrap();
    assert_eq!((first.assets, first.built, first.reused), (3, 3, 0));
    // Three objects and a record a mesh; texture, scene and reference.
    assert_eq!(store.take_written().len(), 3 * 4 + 3);
    let (second, again) = ingested(&library, &options).unwrap();
    assert_eq!(again, scene);
    assert_eq!((second.assets, second.built, second.reused), (3, 0, 3));
    assert_eq!(store.take_written(), ["scenes/x"]);
    assert_eq!((second.seconds.build, second.seconds.encode), (0.0, 0.0));
    let figures = |report: &IngestReport| IngestReport {
        built: 0,
        reused: 0,
        seconds: Default::default(),
        peak_rss_bytes: None,
        ..report.clone()
    };
    assert_eq!(figures(&second), figures(&first));
}

#[test]
fn after_an_edit_only_the_changed_mesh_is_built_and_written() {
    let folder = tempfile::tempdir().unwrap();
    let before = bumps::write(folder.path(), "before", &THREE);
    let edited = [THREE[0], bump("b", 9, 16), THREE[2]];
    let after = bumps::write(folder.path(), "after", &edited);
    let (store, library) = watched();
    ingested(&library, &options(&before)).unwrap();
    store.take_written();
    let (report, scene) = ingested(&library, &options(&after)).unwrap();
    assert_eq!((report.assets, report.built, report.reused), (3, 1, 2));
    let written = store.take_written();
    let below = |folder: &str| {
        written
            .iter()
            .filter(|path| path.starts_with(folder))
            .count()
    };
    // Pack, hierarchy, asset, scene; record; reference.
    assert_eq!(
        (below("objects/"), below("builds/"), below("scenes/")),
        (4, 1, 1)
    );
    let (_, fresh) = ingested(&watched().1, &options(&after)).unwrap();
    assert_eq!(scene, fresh);
}

#[test]
fn old_objects_are_not_sent_again() {
    let folder = tempfile::tempdir().unwrap();
    let input = bumps::write(folder.path(), "three", &THREE);
    let place = folder.path().join("library");
    let library = Library::open_or_create(text(&place)).unwrap();
    let (_, scene) = ingested(&library, &options(&input)).unwrap();
    age(&files(&place));
    let (report, again) = ingested(&library, &options(&input)).unwrap();
    assert_eq!((report.built, again), (0, scene));
    let young = |path: &PathBuf| {
        let age = path.metadata().unwrap().modified().unwrap().elapsed();
        age.unwrap().as_secs() < 86_400
    };
    let young: Vec<_> = files(&place).into_iter().filter(young).collect();
    let below = |name: &str| {
        let folder = place.join(name);
        young
            .iter()
            .filter(|path| path.starts_with(&folder))
            .count()
    };
    // The scene object is small; records are made young so that gc leaves what they name.
    assert_eq!(
        (below("objects"), below("builds"), below("scenes")),
        (1, 3, 1)
    );
}

#[test]
fn wherever_the_store_fails_the_next_run_goes_on_from_there() {
    let folder = tempfile::tempdir().unwrap();
    let options = options(&bumps::write(folder.path(), "three", &THREE));
    let (store, library) = watched();
    let (_, scene) = ingested(&library, &options).unwrap();
    let writes = store.take_written().len() as i64;
    let mut resumed = 0;
    for succeed in 0..writes {
        let (store, library) = watched();
        store.fail_after(succeed);
        let error = ingested(&library, &options).unwrap_err();
        let named = error.to_string().contains("the disk is full");
        assert!(named, "after {succeed}: {error}");
        assert!(runtime().block_on(library.reference("x")).is_err());
        let written = store.take_written();
        let records = written
            .iter()
            .filter(|path| path.starts_with("builds/"))
            .count() as u64;
        store.fail_after(i64::MAX);
        let (report, again) = ingested(&library, &options).unwrap();
        assert_eq!(again, scene, "after {succeed}");
        assert_eq!(
            (report.reused, report.built),
            (records, 3 - records),
            "after {succeed}"
        );
        resumed += records;
    }
    assert!(resumed > 3, "{resumed}");
}

#[test]
fn a_killed_ingest_is_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let many: Vec<Bump> = (0..60).map(|seed| bump("many", seed, 24)).collect();
    let input = bumps::write(folder.path(), "many", &many);
    let ingest_into = |library: &Path, report: &Path| {
        let mut command = command(&["ingest", text(&input), "--library", text(library)]);
        command.args(["--scene", "x", "-q", "--report", text(report)]);
        command
    };
    let (library, report) = (folder.path().join("killed"), folder.path().join("r.json"));
    let mut child = ingest_into(&library, &report)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    // A file that is being written when the process dies is no record.
    let whole = |path: &PathBuf| !path.to_string_lossy().contains('#');
    let builds = library.join("builds");
    let records = || files(&builds).iter().filter(|path| whole(path)).count();
    while records() == 0 && child.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!report.exists(), "the ingest was over before it was killed");
    let records = records();
    assert!((1..60).contains(&records), "{records}");

    assert!(ingest_into(&library, &report).status().unwrap().success());
    let resumed = json(&report);
    assert_eq!(resumed["reused"], records);
    assert_eq!(resumed["built"], 60 - records);
    let whole = folder.path().join("whole");
    assert!(ingest_into(&whole, &report).status().unwrap().success());
    let list = |library: &Path| ok(&["list", "--library", text(library)]);
    assert_eq!(list(&library), list(&whole));
    ok(&["verify", "--library", text(&library)]);
}

#[test]
fn a_record_that_is_not_true_is_named_and_not_used() {
    let folder = tempfile::tempdir().unwrap();
    let input = bumps::write(folder.path(), "one", &[bump("a", 1, 12)]);
    let place = folder.path().join("library");
    let report = folder.path().join("report.json");
    let args = [
        "ingest",
        text(&input),
        "--library",
        text(&place),
        "--scene",
        "x",
        "--report",
        text(&report),
    ];
    ok(&args);
    let list = || ok(&["list", "--library", text(&place)]);
    let scene = list();
    let library = Library::open(text(&place)).unwrap();
    let asset = runtime().block_on(async {
        let reference = library.reference("x").await.unwrap();
        let scene = library.scene(&reference.scene).await.unwrap();
        scene.assets[0].asset
    });
    let parts = runtime().block_on(library.asset(&asset)).unwrap();
    let object = |hash: &ContentHash| place.join(lodestream_format::library::object_path(hash));
    let record = files(&place.join("builds")).remove(0);
    let key = record.file_name().unwrap().to_str().unwrap().to_owned();
    let other = b"{\"asset\":1}";
    let other = format!(
        "{}\n{}\n",
        ContentHash::of(other),
        String::from_utf8_lossy(other)
    );
    let flip = |bytes: &[u8]| {
        let mut flipped = bytes.to_vec();
        flipped[bytes.len() / 2] ^= 1;
        Some(flipped)
    };
    let short = |bytes: &[u8]| Some(bytes[..bytes.len() / 2].to_vec());
    let none = |_: &[u8]| None;
    let cases: [(&str, PathBuf, &dyn Fn(&[u8]) -> Option<Vec<u8>>); 10] = [
        ("pack gone", object(&parts.pack), &none),
        ("pack short", object(&parts.pack), &short),
        ("hierarchy gone", object(&parts.hierarchy), &none),
        ("asset gone", object(&asset), &none),
        ("asset flipped", object(&asset), &flip),
        ("record flipped", record.clone(), &flip),
        ("record short", record.clone(), &short),
        ("record empty", record.clone(), &|_| Some(vec![])),
        ("record of another kind", record.clone(), &|_| {
            Some(other.clone().into_bytes())
        }),
        ("record no text", record.clone(), &|_| Some(vec![0xff; 70])),
    ];
    for (what, path, damage) in cases {
        let whole = std::fs::read(&path).unwrap();
        match damage(&whole) {
            Some(damaged) => std::fs::write(&path, damaged).unwrap(),
            None => std::fs::remove_file(&path).unwrap(),
        }
        let output = run(&args);
        let told = stderr(&output);
        assert_eq!(output.status.code(), Some(0), "{what}: {told}");
        let named = |line: &str| line.contains("WARN") && line.contains(&key);
        assert!(told.lines().any(named), "{what}: {told}");
        assert_eq!(json(&report)["built"], 1, "{what}");
        assert_eq!(list(), scene, "{what}");
        // A record holds seconds.
        let mended = path == record || std::fs::read(&path).unwrap() == whole;
        assert!(mended, "{what}");
        assert!(!stderr(&run(&args)).contains(&key), "{what}: mended");
        assert_eq!(json(&report)["built"], 0, "{what}");
        ok(&["verify", "--library", text(&place)]);
    }
}

#[test]
fn a_flipped_pack_is_built_anew_and_rebuild_builds_everything() {
    let folder = tempfile::tempdir().unwrap();
    let input = bumps::write(folder.path(), "three", &THREE);
    let place = folder.path().join("library");
    let library = Library::open_or_create(text(&place)).unwrap();
    let mut options = options(&input);
    let (_, scene) = ingested(&library, &options).unwrap();
    let largest = files(&place.join("objects"))
        .into_iter()
        .max_by_key(|path| path.metadata().unwrap().len());
    let pack = largest.unwrap();
    let whole = std::fs::read(&pack).unwrap();
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 1;
    std::fs::write(&pack, &flipped).unwrap();
    // Only hashing all of a pack tells.
    options.check = Check::Length;
    assert_eq!(ingested(&library, &options).unwrap().0.built, 0);
    assert_eq!(
        run(&["verify", "--library", text(&place)]).status.code(),
        Some(1)
    );
    options.check = Check::Hash;
    let (report, again) = ingested(&library, &options).unwrap();
    assert_eq!((report.built, report.reused, again), (1, 2, scene));
    let repaired = Repaired {
        objects: 1,
        bytes: whole.len() as u64,
    };
    assert_eq!(report.repaired, repaired);
    assert_eq!(std::fs::read(&pack).unwrap(), whole);
    std::fs::write(&pack, &flipped).unwrap();
    options.rebuild = true;
    let (report, again) = ingested(&library, &options).unwrap();
    assert_eq!((report.built, report.reused, again), (3, 0, scene));
    assert_eq!(std::fs::read(&pack).unwrap(), whole);
}

#[test]
fn other_options_are_other_builds_and_other_names_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let input = bumps::write(folder.path(), "three", &THREE);
    let library = Library::open("memory://").unwrap();
    ingested(&library, &options(&input)).unwrap();
    let mut coarse = options(&input);
    // So coarse that triangles collapse, which is told with the mesh's name.
    coarse.build.position_step = PositionStep::Metres(2.0);
    let (first, _) = ingested(&library, &coarse).unwrap();
    assert_eq!((first.built, first.reused), (3, 0));
    let renamed = [bump("d", 1, 12), bump("e", 2, 16), bump("f", 3, 20)];
    coarse.inputs = vec![bumps::write(folder.path(), "renamed", &renamed)];
    let (second, scene) = ingested(&library, &coarse).unwrap();
    assert_eq!((second.built, second.reused), (0, 3));
    let (fresh, fresh_scene) = ingested(&watched().1, &coarse).unwrap();
    assert_eq!(scene, fresh_scene);
    assert_eq!(second.warnings, fresh.warnings);
    let names = |report: &IngestReport, name: &str| {
        let prefix = format!("mesh \"{name}\": ");
        report.warnings.iter().any(|line| line.starts_with(&prefix))
    };
    assert!(names(&first, "a") && names(&second, "d") && !names(&second, "a"));
}

#[test]
fn list_and_show_tell_what_scenes_share() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("library");
    let library = Library::open_or_create(text(&place)).unwrap();
    let mut one = options(&bumps::write(folder.path(), "three", &THREE));
    ingested(&library, &one).unwrap();
    // The same mesh twice, and another.
    let two = [THREE[0], bump("again", 1, 12), bump("d", 4, 8)];
    one.inputs = vec![bumps::write(folder.path(), "two", &two)];
    one.scene = "y".to_owned();
    ingested(&library, &one).unwrap();

    let report = folder.path().join("report.json");
    let with = [
        "--library",
        text(&place),
        "--assets",
        "--report",
        text(&report),
    ];
    let told = ok(&[&["list"][..], &with].concat());
    assert_eq!(told.matches("\t1 shared\t").count(), 2, "{told}");
    let scenes = json(&report);
    assert_eq!(
        (&scenes[0]["assets"], &scenes[1]["assets"]),
        (&3.into(), &2.into())
    );
    let told = ok(&[&["show", "y"][..], &with].concat());
    assert!(
        told.contains("\t2 instances\t1 other scenes\t288 triangles\t"),
        "{told}"
    );
    let rows = &json(&report)["assets_table"];
    assert_eq!(rows.as_array().unwrap().len(), 2);
    assert_eq!(rows[0]["other_scenes"], serde_json::json!(["x"]));
    assert_eq!(
        (&rows[1]["name"], &rows[1]["instances"]),
        (&"d".into(), &1.into())
    );
    assert_eq!(rows[1]["other_scenes"], serde_json::json!([]));
    assert_eq!(rows[0]["pack_bytes"], scenes[0]["shared_pack_bytes"]);
}

#[test]
fn a_store_that_fails_to_read_ends_the_ingest() {
    // An error of the store is no missing record: building everything anew would hide it.
    let folder = tempfile::tempdir().unwrap();
    let input = bumps::write(folder.path(), "three", &THREE);
    let (store, library) = watched();
    ingested(&library, &options(&input)).unwrap();
    store.fail_reads(true);
    let error = ingested(&library, &options(&input)).unwrap_err();
    let store = matches!(*error, IngestError::Library(LibraryError::Store { .. }));
    assert!(store, "{error}");
}

/// Fails where the builder's bytes change: raise `BUILDER_VERSION` then, and pin the new bytes beside it.
#[test]
#[cfg(target_arch = "x86_64")]
fn the_builder_version_goes_with_the_bytes() {
    let row = 41;
    let at = |index: u32| (index % row, index / row);
    let positions = (0..row * row).map(at).map(|(x, y)| {
        let height = (x * 31 + y * 17).wrapping_mul(2_654_435_761) >> 24;
        [x as f32, y as f32, height as f32 / 256.0]
    });
    let triangles = (0..row * row).map(at).filter(|&(x, y)| x < 40 && y < 40);
    let triangles: Vec<[u32; 3]> = triangles
        .flat_map(|(x, y)| {
            let a = y * row + x;
            [[a, a + 1, a + row], [a + 1, a + row + 1, a + row]]
        })
        .collect();
    let mesh = Mesh {
        name: "pinned".to_owned(),
        positions: positions.collect(),
        triangle_materials: vec![0; triangles.len()],
        triangles,
        material_slots: vec![0],
        ..Mesh::default()
    };
    let built = build(&mesh, &BuildOptions::default()).unwrap();
    assert_eq!(
        (
            BUILDER_VERSION,
            ContentHash::of(&built.asset_bytes).to_string().as_str()
        ),
        (
            11,
            "baa3cf748a3fc4831fdea5598bc8508ec6b5628613d8f93cf50fab8be18dea63"
        ),
    );
}
