//! The built binary: backup, repair, folders that are no libraries, file modes.
// A failed expectation is the test's failure.
#![cfg(unix)]
#![allow(clippy::unwrap_used)]

mod support;

use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};

use support::binary::{command, copy_of_library, fails, ingested, json, ok, run, stderr, text};
use support::bumps::{self, bump};
use support::files;

/// Damages a file.
type Harm = fn(&Path);

/// Kinds of damage, those that only a folder can have included.
const HARMS: [(&str, Harm); 8] = [
    ("flipped", |file| {
        let mut bytes = fs::read(file).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x20;
        fs::write(file, bytes).unwrap();
    }),
    ("truncated", |file| {
        let bytes = fs::read(file).unwrap();
        fs::write(file, &bytes[..bytes.len() - 1]).unwrap();
    }),
    ("grown", |file| {
        let bytes = [fs::read(file).unwrap(), vec![0]].concat();
        fs::write(file, bytes).unwrap();
    }),
    ("zeroed", |file| {
        let length = file.metadata().unwrap().len() as usize;
        fs::write(file, vec![0; length]).unwrap();
    }),
    ("gone", |file| fs::remove_file(file).unwrap()),
    ("unreadable", |file| {
        // A link to itself: root cannot read it either.
        fs::remove_file(file).unwrap();
        symlink(file.file_name().unwrap(), file).unwrap();
    }),
    ("an empty folder", |file| {
        fs::remove_file(file).unwrap();
        fs::create_dir(file).unwrap();
    }),
    ("a folder with a file", |file| {
        fs::remove_file(file).unwrap();
        fs::create_dir(file).unwrap();
        fs::write(file.join("somebody's"), "keep me").unwrap();
    }),
];

/// Files of a library but the mark.
fn contents(library: &Path) -> Vec<PathBuf> {
    let mut found = files(library);
    found.retain(|file| !file.ends_with("library.json") && !file.ends_with(".lock"));
    found
}

fn model() -> PathBuf {
    ingested().0.path().join("model.glb")
}

fn verify(library: &Path, how: &str) {
    let output = run(&["verify", "--library", text(library)]);
    assert_eq!(output.status.code(), Some(0), "{how}: {}", stderr(&output));
}

#[test]
fn a_verifying_copy_mends_every_file_of_a_folder() {
    let (folder, backup) = copy_of_library();
    let source = ingested().0.path().join("library");
    let report = folder.path().join("report.json");
    let args = ["copy", text(&source), text(&backup), "--verify"];
    let args = [&args[..], &["--report", text(&report)]].concat();
    for (how, harm) in HARMS {
        let whole = contents(&source).len();
        let mut damaged = contents(&backup);
        assert_eq!(damaged.len(), whole, "{how}");
        if how == "unreadable" {
            // Listings fail at such a link; objects are found without a listing.
            damaged.retain(|file| file.starts_with(backup.join("objects")));
        }
        for file in &damaged {
            harm(file);
        }
        let output = run(&["verify", "--library", text(&backup)]);
        // An empty library has no fault.
        let code = if how == "gone" { 0 } else { 1 };
        assert_eq!(
            output.status.code(),
            Some(code),
            "{how}: {}",
            stderr(&output)
        );
        let told = ok(&args);
        verify(&backup, how);
        let done = json(&report);
        let repaired = done["repaired"]["objects"].as_u64().unwrap();
        // Without references nothing tells that objects are missing.
        assert_eq!(repaired >= 8, how != "gone", "{how}: {done}");
        let line = format!("{repaired} repaired of {} bytes", done["repaired"]["bytes"]);
        assert!(told.contains(&line), "{how}: {told}");
        let again = ok(&args);
        assert!(again.contains("0 of 8 objects sent, 0 bytes"), "{again}");
        let kept = files(&backup.join("lost"));
        assert_eq!(kept.is_empty(), how != "a folder with a file", "{how}");
    }
}

/// All files at once, then object by object with whole records.
#[test]
fn an_ingest_over_damage_mends_it() {
    let (folder, library) = copy_of_library();
    let report = folder.path().join("report.json");
    let model = model();
    let args = ["ingest", text(&model), "--library", text(&library)];
    let args = [&args[..], &["--scene", "pair", "--report", text(&report)]].concat();
    for (how, harm) in HARMS {
        let objects = contents(&library.join("objects"));
        let notes = contents(&library.join("builds"));
        for file in objects.iter().chain(&notes) {
            harm(file);
        }
        ok(&args);
        verify(&library, how);
        assert_eq!(json(&report)["built"], 2, "{how}");
        ok(&args);
        let done = json(&report);
        assert_eq!((&done["built"], &done["reused"]), (&0.into(), &2.into()));
        assert_eq!(done["repaired"]["objects"], 0, "{how}");
        if !["flipped", "gone", "an empty folder"].contains(&how) {
            continue;
        }
        // Whole records now name one damaged object.
        for (at, file) in objects.iter().enumerate() {
            let bytes = file.metadata().unwrap().len();
            harm(file);
            let told = ok(&args);
            let done = json(&report);
            let counted = &done["repaired"];
            let sum = (counted["objects"].as_u64(), counted["bytes"].as_u64());
            assert_eq!(sum, (Some(1), Some(bytes)), "{how}, object {at}");
            let line = format!("1 objects of {bytes} bytes repaired");
            assert!(told.contains(&line), "{how}, object {at}: {told}");
        }
        verify(&library, how);
    }
    fs::write(library.join("scenes/pair"), "{").unwrap();
    ok(&args);
    verify(&library, "reference");
}

#[test]
fn a_file_where_a_folder_should_be_is_moved_away() {
    let (_folder, library) = copy_of_library();
    let source = ingested().0.path().join("library");
    let object = files(&library.join("objects")).remove(0);
    let shard = object.parent().unwrap();
    fs::remove_dir_all(shard).unwrap();
    fs::write(shard, "not a folder").unwrap();
    let model = model();
    let ingest = ["ingest", text(&model), "--library", text(&library)];
    ok(&[&ingest[..], &["--scene", "pair"]].concat());
    verify(&library, "ingest");
    fs::remove_dir_all(shard).unwrap();
    fs::write(shard, "not a folder").unwrap();
    ok(&["copy", text(&source), text(&library), "--verify"]);
    verify(&library, "copy");
    let kept = files(&library.join("lost"));
    assert_eq!(kept.len(), 2);
    assert_eq!(fs::read(&kept[1]).unwrap(), b"not a folder");
}

#[test]
fn a_copy_ingests_again_without_building() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let input = bumps::write(folder.path(), "two", &[bump("a", 1, 12), bump("b", 2, 16)]);
    let (first, second, report) = (path("first"), path("second"), path("report"));
    let ingest = |library: &Path| {
        let args = ["ingest", text(&input), "--library", text(library)];
        let told = ["--scene", "x", "--report", text(&report)];
        ok(&[&args[..], &told].concat());
        let done = json(&report);
        (done["built"].as_u64(), done["reused"].as_u64())
    };
    assert_eq!(ingest(&first), (Some(2), Some(0)));
    let copied = ok(&["copy", text(&first), text(&second)]);
    assert!(copied.contains("2 build records"), "{copied}");
    assert_eq!(ingest(&second), (Some(0), Some(2)));
    // Only the damaged record is sent again.
    let record = files(&second.join("builds")).remove(0);
    fs::write(&record, "half of it").unwrap();
    let copied = ok(&["copy", text(&first), text(&second)]);
    assert!(copied.contains("1 build records"), "{copied}");
    assert_eq!(ingest(&second), (Some(0), Some(2)));
}

#[test]
fn commands_on_a_place_that_is_no_library_fail() {
    let folder = tempfile::tempdir().unwrap();
    let (empty, home) = (folder.path().join("empty"), folder.path().join("home"));
    let (library, model) = (ingested().0.path().join("library"), model());
    fs::create_dir(&empty).unwrap();
    fs::create_dir(&home).unwrap();
    fs::write(home.join("letter.txt"), "Dear").unwrap();
    let out = folder.path().join("out.glb");
    let before = files(folder.path());
    for place in [&empty, &home] {
        let at = ["--library", text(place)];
        let copy_to = folder.path().join("copy");
        for args in [
            &["verify"][..],
            &["verify", "x"],
            &["list"],
            &["list", "--assets"],
            &["show", "x"],
            &["remove", "x"],
            &["gc", "--grace-secs", "0"],
            &["serve", "--listen", "127.0.0.1:0"],
            &["export", "x", "--source", "--out", text(&out)],
            &["ingest", "--scene", "x", "--job", "0"],
            &["ingest", "--scene", "x", "--finish"],
        ] {
            fails(
                &[args, &at].concat(),
                1,
                &["expected a library", text(place)],
            );
        }
        fails(
            &["copy", text(place), text(&copy_to)],
            1,
            &["expected a library", text(place)],
        );
        assert!(!copy_to.exists());
    }
    for args in [
        &[
            "ingest",
            text(&model),
            "--library",
            text(&home),
            "--scene",
            "x",
        ][..],
        &["copy", text(&library), text(&home)],
    ] {
        fails(args, 1, &["other files (letter.txt)", text(&home)]);
    }
    fails(
        &["list", "--library", "memory://"],
        1,
        &["expected a library"],
    );
    assert_eq!(files(folder.path()), before, "nothing was written");
    // Ingest and copy make a library of an empty or missing folder.
    let into = ["--library", text(&empty), "--scene", "x"];
    ok(&[&["ingest", text(&model)][..], &into].concat());
    ok(&["verify", "--library", text(&empty)]);
    let new = folder.path().join("new/backup");
    ok(&["copy", text(&library), text(&new)]);
    ok(&["list", "--library", text(&new)]);
    fails(&["copy", text(&new), text(&new)], 1, &["another library"]);
    fs::write(
        new.join("library.json"),
        r#"{"format": "lodestream-library", "version": 7}"#,
    )
    .unwrap();
    fails(
        &["verify", "--library", text(&new)],
        1,
        &["found 7", "at most 1"],
    );
    // Older than the mark.
    fs::remove_file(empty.join("library.json")).unwrap();
    ok(&["verify", "--library", text(&empty)]);
    assert!(!empty.join("library.json").exists());
    ok(&[&["ingest", text(&model)][..], &into].concat());
    assert!(empty.join("library.json").exists());
}

#[test]
fn a_mirror_is_emptied_only_where_that_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (source, mirror) = (path("source"), path("mirror"));
    let input = bumps::write(folder.path(), "one", &[bump("a", 1, 8)]);
    for scene in ["x", "y"] {
        ok(&[
            "ingest",
            text(&input),
            "--library",
            text(&source),
            "--scene",
            scene,
        ]);
    }
    let copy = ["copy", text(&source), text(&mirror)];
    ok(&copy);
    ok(&["remove", "y", "--library", text(&source)]);
    let list = || ok(&["list", "--library", text(&mirror)]).lines().count();
    ok(&copy);
    assert_eq!(list(), 2);
    fails(
        &[&copy[..], &["--delete", "--scene", "x"]].concat(),
        2,
        &["--delete", "--scene"],
    );
    let done = ok(&[&copy[..], &["--delete"]].concat());
    assert!(done.contains("1 removed"), "{done}");
    assert_eq!(list(), 1);
    ok(&["remove", "x", "--library", text(&source)]);
    fails(&[&copy[..], &["--delete"]].concat(), 1, &["scenes to copy"]);
    fs::create_dir(source.join("scenes/x")).unwrap();
    let copy_empty = [&copy[..], &["--delete", "--allow-empty"]].concat();
    fails(&copy_empty, 1, &["scenes/x", "a folder"]);
    fs::remove_dir_all(source.join("scenes")).unwrap();
    fails(&[&copy[..], &["--delete"]].concat(), 1, &["scenes to copy"]);
    fs::rename(&source, path("elsewhere")).unwrap();
    fails(&[&copy[..], &["--delete"]].concat(), 1, &[text(&source)]);
    assert_eq!(list(), 1);
    fs::rename(path("elsewhere"), &source).unwrap();
    ok(&copy_empty);
    assert_eq!(list(), 0);
}

/// A staged file keeps its mode when it is renamed, so final modes tell both.
#[test]
fn a_private_library_is_shut_for_other_users() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let input = bumps::write(folder.path(), "one", &[bump("a", 1, 8)]);
    let mode = |path: &Path| path.metadata().unwrap().permissions().mode() & 0o777;
    fn all(folder: &Path) -> Vec<PathBuf> {
        let within = fs::read_dir(folder).unwrap().map(|it| it.unwrap().path());
        let folders: Vec<PathBuf> = within.filter(|path| path.is_dir()).collect();
        let mut found = files(folder);
        found.extend(folders.iter().flat_map(|folder| all(folder)));
        found.extend(folders);
        found
    }
    let ingest = |library: &Path, more: &[&str]| {
        let args = ["ingest", text(&input), "--library", text(library)];
        let mut command = command(&[&args[..], &["--scene", "x"], more].concat());
        // The option counts, not the environment.
        let done = command.env("LODESTREAM_PRIVATE", "false").status();
        assert!(done.unwrap().success());
    };
    let private = path("private");
    ingest(&private, &["--private"]);
    let copy = path("copy");
    ok(&["copy", text(&private), text(&copy), "--private"]);
    for library in [&private, &copy] {
        assert_eq!(mode(library), 0o700);
        assert!(all(library).len() > 10);
        for path in all(library) {
            assert_eq!(mode(&path) & 0o077, 0, "{}", path.display());
        }
    }
    let open = path("open");
    ingest(&open, &[]);
    // Independent of the umask of the test run.
    fs::set_permissions(&open, fs::Permissions::from_mode(0o755)).unwrap();
    let args = ["gc", "--library", text(&open)];
    ok(&args);
    assert_eq!(mode(&open), 0o755);
    let shut = command(&args).env("LODESTREAM_PRIVATE", "true").status();
    assert!(shut.unwrap().success());
    assert_eq!(mode(&open), 0o700);
}
