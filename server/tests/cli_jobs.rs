//! An ingest in jobs: planned, built in any order and at once, finished; the same scene as in one run.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use std::path::{Path, PathBuf};
use std::process::Child;

use support::binary::{command, fails, json, ok, run, stderr, text};
use support::bumps::{self, Bump, bump};
use support::{age, files};

const FIRST: [Bump; 5] = [
    bump("a", 1, 12),
    bump("b", 2, 40),
    bump("c", 3, 20),
    bump("d", 4, 8),
    bump("e", 5, 24),
];
/// Two meshes of `FIRST` under other names, and two more.
const SECOND: [Bump; 4] = [
    bump("b again", 2, 40),
    bump("f", 6, 30),
    bump("d again", 4, 8),
    bump("g", 7, 14),
];
const UNIQUE: u64 = 7;

struct Planned {
    folder: tempfile::TempDir,
    inputs: [PathBuf; 2],
    library: PathBuf,
}

impl Planned {
    fn new(jobs: u32) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let inputs = [
            bumps::write(folder.path(), "first", &FIRST),
            bumps::write(folder.path(), "second", &SECOND),
        ];
        let library = folder.path().join("library");
        let planned = Self {
            folder,
            inputs,
            library,
        };
        planned.plan(jobs);
        planned
    }

    fn plan(&self, jobs: u32) -> String {
        let jobs = jobs.to_string();
        let [first, second] = &self.inputs;
        ok(&[
            "ingest",
            text(first),
            text(second),
            "--library",
            text(&self.library),
            "--scene",
            "x",
            "--plan",
            "--jobs",
            &jobs,
        ])
    }

    fn args<'a>(&'a self, more: &[&'a str]) -> Vec<&'a str> {
        let mut args = vec!["ingest", "--library", text(&self.library), "--scene", "x"];
        args.extend(more);
        args
    }

    fn spawn(&self, job: u32, report: &Path) -> Child {
        let job = job.to_string();
        let args = self.args(&["--job", &job, "-q", "--report", text(report)]);
        command(&args).spawn().unwrap()
    }

    /// What `list` says after an ingest in one run into another library.
    fn expected(&self) -> String {
        let other = self.folder.path().join("other");
        let [first, second] = &self.inputs;
        let args = ["ingest", text(first), text(second), "--library"];
        ok(&[&args[..], &[text(&other), "--scene", "x", "-q"]].concat());
        ok(&["list", "--library", text(&other)])
    }

    fn list(&self) -> String {
        ok(&["list", "--library", text(&self.library)])
    }
}

#[test]
fn jobs_at_once_and_twice_make_the_scene_of_one_run() {
    let planned = Planned::new(3);
    let report = |name: String| planned.folder.path().join(name);
    // Nothing is published, and nothing built.
    assert_eq!(planned.list(), "");
    assert_eq!(files(&planned.library.join("builds")), [] as [PathBuf; 0]);
    fails(
        &planned.args(&["--finish"]),
        1,
        &["scene x", "7 meshes", "jobs 0-2"],
    );

    let mut children: Vec<Child> = [2, 0, 1, 0]
        .iter()
        .enumerate()
        .map(|(at, &job)| planned.spawn(job, &report(format!("{at}.json"))))
        .collect();
    assert!(
        children
            .iter_mut()
            .all(|child| child.wait().unwrap().success())
    );
    let reports: Vec<_> = (0..3)
        .map(|at| json(&report(format!("{at}.json"))))
        .collect();
    let sum = |key: &str| -> u64 { reports.iter().map(|r| r[key].as_u64().unwrap()).sum() };
    assert_eq!(sum("meshes"), UNIQUE, "equal meshes are in one job");
    assert_eq!(reports[0]["job"], 2);
    assert_eq!(reports[0]["jobs"], 3);
    for job in 0..3 {
        let report = report(format!("again{job}.json"));
        assert!(planned.spawn(job, &report).wait().unwrap().success());
        let again = json(&report);
        assert_eq!(
            (&again["built"], &again["reused"]),
            (&0.into(), &again["meshes"])
        );
    }
    let figures = report("finish.json".to_owned());
    for _ in 0..2 {
        ok(&planned.args(&["--finish", "--report", text(&figures)]));
        assert_eq!(planned.list(), planned.expected());
    }
    let figures = json(&figures);
    assert_eq!(
        (&figures["built"], &figures["reused"]),
        (&0.into(), &UNIQUE.into())
    );
    let triangles: u64 = FIRST.iter().chain(&SECOND).map(Bump::triangles).sum();
    assert_eq!(figures["input_triangles"], triangles);
    ok(&["verify", "--library", text(&planned.library)]);
}

#[test]
fn a_plan_is_the_same_each_time_and_deals_every_mesh() {
    let planned = Planned::new(3);
    let file = planned.library.join("plans").join("x");
    let first = std::fs::read(&file).unwrap();
    let told = planned.plan(3);
    assert_eq!(std::fs::read(&file).unwrap(), first);
    for word in [
        "7 meshes",
        "3 jobs",
        "--job 0",
        "$(seq 0 2)",
        "--array=0-2",
        "--finish",
    ] {
        assert!(told.contains(word), "{word:?} in {told}");
    }
    for job in 0..3 {
        ok(&planned.args(&["--job", &job.to_string()]));
    }
    let told = planned.plan(20);
    assert!(told.contains("7 meshes are built already"), "{told}");
    assert!(told.contains("13 jobs have nothing to do"), "{told}");
    assert_eq!(ok(&planned.args(&["--job", "19", "-q"])), "");
    ok(&planned.args(&["--finish"]));
    assert_eq!(planned.list(), planned.expected());
}

#[test]
fn auto_takes_the_number_of_the_scheduler() {
    let planned = Planned::new(2);
    let args = planned.args(&["--job", "auto"]);
    for (variable, value, code, word) in [
        ("SLURM_ARRAY_TASK_ID", "1", 0, "job 1 of"),
        ("JOB_COMPLETION_INDEX", "0", 0, "job 0 of"),
        ("SLURM_ARRAY_TASK_ID", "2", 1, "a job of 0 to 1, found 2"),
        ("SLURM_ARRAY_TASK_ID", "one", 2, "SLURM_ARRAY_TASK_ID"),
        ("OTHER", "1", 2, "JOB_COMPLETION_INDEX"),
    ] {
        let mut command = command(&args);
        for name in ["SLURM_ARRAY_TASK_ID", "JOB_COMPLETION_INDEX"] {
            command.env_remove(name);
        }
        let output = command.env(variable, value).output().unwrap();
        let told = String::from_utf8_lossy(&output.stdout).into_owned() + &stderr(&output);
        assert_eq!(
            output.status.code(),
            Some(code),
            "{variable}={value}: {told}"
        );
        assert!(told.contains(word), "{variable}={value}: {told}");
    }
    ok(&planned.args(&["--finish"]));
}

#[test]
fn inputs_that_changed_are_named_and_moved_ones_can_be_given() {
    let planned = Planned::new(1);
    let [first, second] = &planned.inputs;
    let job = || planned.args(&["--job", "0"]);
    let document = std::fs::read(second).unwrap();
    std::fs::write(second, [&document[..], b" "].concat()).unwrap();
    fails(&job(), 1, &["second.gltf", "as it was planned", "--plan"]);
    std::fs::remove_file(second).unwrap();
    fails(
        &job(),
        1,
        &["second.gltf", "cannot read", "so the plan says"],
    );
    // The same document over another file.
    let edited = [SECOND[0], bump("f", 66, 30), SECOND[2], SECOND[3]];
    bumps::write(planned.folder.path(), "second", &edited);
    assert_eq!(std::fs::read(second).unwrap(), document);
    fails(&job(), 1, &["second.gltf", "mesh \"f\"", "other meshes"]);
    fails(&planned.args(&["--finish"]), 1, &["jobs 0"]);

    let elsewhere = planned.folder.path().join("elsewhere");
    std::fs::create_dir(&elsewhere).unwrap();
    let moved = [
        bumps::write(&elsewhere, "first", &FIRST),
        bumps::write(&elsewhere, "second", &SECOND),
    ];
    std::fs::remove_file(first).unwrap();
    let all = [text(&moved[0]), text(&moved[1]), "--job", "0"];
    fails(
        &planned.args(&all[1..]),
        1,
        &["all 2 inputs or none, found 1"],
    );
    ok(&planned.args(&all));
    // Nothing left to build: the inputs are not looked for.
    ok(&job());
    // No inputs at all.
    std::fs::remove_file(second).unwrap();
    ok(&planned.args(&["--finish"]));
    let expected = Planned::new(1);
    assert_eq!(planned.list(), expected.expected());
}

#[test]
fn gc_leaves_what_a_plan_waits_for() {
    let planned = Planned::new(2);
    ok(&planned.args(&["--job", "0"]));
    let gc = || ok(&["gc", "--library", text(&planned.library)]);
    age(&files(&planned.library));
    // A job that starts makes the plan young, and with it all that it needs.
    let output = run(&planned.args(&["--job", "0"]));
    assert!(output.status.success(), "{}", stderr(&output));
    age(&files(&planned.library.join("builds")));
    let told = gc();
    assert!(told.starts_with("0 objects"), "{told}");
    ok(&planned.args(&["--job", "1"]));
    ok(&planned.args(&["--finish"]));
    assert_eq!(planned.list(), planned.expected());
    // Published: the plan may go, the builds stay as long as the scene.
    age(&files(&planned.library));
    let told = gc();
    assert!(
        told.contains("0 build records and 1 plans removed, 7 and 0 stay"),
        "{told}"
    );
    fails(
        &planned.args(&["--finish"]),
        1,
        &["scene x", "expected a plan", "--plan"],
    );
    ok(&["verify", "--library", text(&planned.library)]);
    ok(&["remove", "x", "--library", text(&planned.library)]);
    let told = gc();
    assert!(
        told.contains("7 build records and 0 plans removed, 0 and 0 stay"),
        "{told}"
    );
    assert_eq!(
        files(&planned.library),
        [planned.library.join("library.json")]
    );
}

#[test]
fn a_lost_build_is_asked_for_again_and_a_damaged_plan_is_named() {
    let planned = Planned::new(2);
    for job in ["0", "1"] {
        ok(&planned.args(&["--job", job]));
    }
    let record = files(&planned.library.join("builds")).remove(0);
    std::fs::remove_file(record).unwrap();
    fails(
        &planned.args(&["--finish"]),
        1,
        &["1 meshes not built yet", "jobs "],
    );
    for job in ["0", "1"] {
        ok(&planned.args(&["--job", job]));
    }
    ok(&planned.args(&["--finish"]));
    let plan = planned.library.join("plans").join("x");
    let whole = std::fs::read(&plan).unwrap();
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 1;
    for damage in [&flipped[..], &whole[..100], b""] {
        std::fs::write(&plan, damage).unwrap();
        for what in [&["--finish"][..], &["--job", "0"]] {
            fails(&planned.args(what), 1, &["plans/x", "expected"]);
        }
    }
}

#[test]
fn wrong_usage_is_told() {
    let planned = Planned::new(1);
    let input = text(&planned.inputs[0]);
    for (args, code, words) in [
        (&[input, "--plan"][..], 2, &["--jobs"][..]),
        (&[input, "--jobs", "2"], 2, &["--plan"]),
        (&[input, "--plan", "--jobs", "0"], 2, &["--jobs"]),
        (&["--plan", "--jobs", "2"], 2, &["INPUT"]),
        (&["--job", "-1"], 2, &["--job"]),
        (&["--job", "x"], 2, &["a number from 0, or auto"]),
        (&["--job", "0", "--finish"], 2, &["--job", "--finish"]),
        (&["--job", "0", "--codec", "none"], 2, &["--codec"]),
        (&["--finish", input], 2, &["--finish"]),
        (&["--finish", "--rebuild"], 2, &["--rebuild"]),
        (
            &[input, "--plan", "--jobs", "2", "--rebuild"],
            2,
            &["--rebuild"],
        ),
        (&["--job", "1"], 1, &["a job of 0 to 0, found 1"]),
    ] {
        fails(&planned.args(args), code, words);
    }
    let memory = ["--library", "memory://", "--scene", "x"];
    let plan = [&["ingest", input, "--plan", "--jobs", "2"][..], &memory].concat();
    fails(&plan, 1, &["--plan", "memory://"]);
    let finish = [&["ingest", "--finish"][..], &memory].concat();
    fails(&finish, 1, &["expected a library", "memory://"]);
    let none = planned.folder.path().join("none");
    let missing = [
        "ingest",
        "--finish",
        "--scene",
        "x",
        "--library",
        text(&none),
    ];
    fails(&missing, 1, &["expected a folder"]);
    assert!(ok(&["ingest", "--help"]).contains("--array=0-7"));
}

/// An open sheet of `n` x `n` quads over a square of a metre, from `x` on, with unequal heights.
fn sheet(folder: &Path, x: u32, n: u32) -> PathBuf {
    use std::fmt::Write;
    let mut text = String::new();
    for row in 0..=n {
        for column in 0..=n {
            let at = x * n + column;
            let height = (at * 31 + row * 17).wrapping_mul(2_654_435_761) >> 24;
            let [at, row] = [at, row].map(|value| f64::from(value) / f64::from(n));
            writeln!(text, "v {at} {} {row}", f64::from(height) / 4096.0).unwrap();
        }
    }
    for row in 0..n {
        for column in 0..n {
            let a = row * (n + 1) + column + 1;
            let b = a + n + 1;
            writeln!(text, "f {a} {b} {} {}", b + 1, a + 1).unwrap();
        }
    }
    let file = folder.join(format!("sheet{x}.obj"));
    std::fs::write(&file, text).unwrap();
    file
}

/// The border lies in two files, and each job reads one of them.
#[test]
fn meshes_of_different_jobs_keep_their_common_border() {
    const N: u32 = 32;
    let folder = tempfile::tempdir().unwrap();
    let inputs = [0, 1].map(|x| sheet(folder.path(), x, N));
    let [left, right] = inputs.each_ref().map(|input| text(input));
    let [planned, plain] = ["planned", "plain"].map(|name| folder.path().join(name));
    let [planned, plain] = [text(&planned), text(&plain)];
    ok(&[
        "ingest",
        left,
        right,
        "--library",
        plain,
        "--scene",
        "x",
        "-q",
    ]);
    let on_planned = ["ingest", "--library", planned, "--scene", "x", "-q"];
    ok(&[&on_planned[..], &[left, right, "--plan", "--jobs", "2"]].concat());
    for job in ["0", "1"] {
        ok(&[&on_planned[..], &["--job", job]].concat());
    }
    ok(&[&on_planned[..], &["--finish"]].concat());
    let listed = |library| ok(&["list", "--library", library]);
    assert_eq!(listed(planned), listed(plain));

    let coarse = folder.path().join("coarse.glb");
    let export = ["export", "x", "--library", planned, "--error", "1"];
    ok(&[&export[..], &["--out", text(&coarse)]].concat());
    let scene = lodestream_server::import::import(&coarse).unwrap();
    assert_eq!(scene.meshes.len(), 2);
    for mesh in &scene.meshes {
        assert!(mesh.triangles.len() < (N * N) as usize, "a coarse cut");
        let border = mesh.positions.iter().filter(|at| at[0] == 1.0);
        let mut border: Vec<u32> = border.map(|at| (at[2] * N as f32) as u32).collect();
        border.sort_unstable();
        border.dedup();
        assert_eq!(border, (0..=N).collect::<Vec<_>>());
    }
}
