//! `ingest`, whole or in jobs.

use tokio::runtime::Handle;

use super::args::IngestArgs;
use super::commands::CommandError;
use super::output::{self, line};
use super::private;
use crate::build::BuildOptions;
use crate::ingest::{
    self, IngestError, IngestOptions, IngestReport, JobOptions, PlanReport, ProgressTo,
};
use crate::library::{Check, Library, Repaired};

/// Runs what the options ask for.
pub(super) fn ingest(handle: &Handle, args: IngestArgs, quiet: bool) -> Result<(), CommandError> {
    let progress = match (args.progress_json, quiet) {
        (true, _) => ProgressTo::Lines,
        (false, true) => ProgressTo::Nothing,
        (false, false) => ProgressTo::Terminal,
    };
    let failed = |error: IngestError| CommandError::Ingest(Box::new(error));
    let check = check(&args);
    if args.finish {
        let library = existing(handle, &args)?;
        let done = ingest::finish(handle, &library, &args.scene, check, progress);
        let done = done.map_err(failed)?;
        return published(&args, &done, quiet);
    }
    if let Some(job) = args.job {
        return one_job(handle, args, job, progress, quiet);
    }
    if args.plan && args.library.starts_with("memory://") {
        return Err(CommandError::PlanInMemory);
    }
    let library = handle.block_on(Library::open_or_make(&args.library))?;
    private::shut(args.private.private, &library)?;
    let options = IngestOptions {
        inputs: args.inputs.clone(),
        scene: args.scene.clone(),
        replaces: args.replaces,
        threads: args.threads,
        memory_limit_bytes: args.memory_limit,
        build: BuildOptions {
            position_step: args.position_step,
            placement: args.placement,
            codec: args.codec,
        },
        scratch: args.scratch.clone(),
        rebuild: args.rebuild,
        check,
        max_triangles: args.max_triangles,
        allow_empty: args.allow_empty,
        self_contained: args.self_contained,
        max_image_pixels: Some(args.max_image_pixels),
        progress,
    };
    match args.jobs {
        Some(jobs) => {
            let done = ingest::plan(handle, &library, &options, jobs).map_err(failed)?;
            output::report(args.report.as_deref(), &done)?;
            if !quiet {
                planned(&args.library, &done);
            }
            Ok(())
        }
        None => {
            let done = ingest::ingest(handle, &library, &options).map_err(failed)?;
            published(&args, &done, quiet)
        }
    }
}

fn check(args: &IngestArgs) -> Check {
    match args.trust_lengths {
        true => Check::Length,
        false => Check::Hash,
    }
}

fn existing(handle: &Handle, args: &IngestArgs) -> Result<Library, CommandError> {
    let library = handle.block_on(Library::open_existing(&args.library))?;
    private::shut(args.private.private, &library)?;
    Ok(library)
}

fn published(args: &IngestArgs, done: &IngestReport, quiet: bool) -> Result<(), CommandError> {
    output::report(args.report.as_deref(), done)?;
    if quiet {
        return Ok(());
    }
    for warning in &done.warnings {
        tracing::info!("{warning}");
    }
    if !done.warnings.is_empty() {
        tracing::warn!(
            "{} warnings; -v, show and --report tell them",
            done.warnings.len()
        );
    }
    line(format_args!(
        "{}: {} triangles in {} assets ({} built, {} reused) and {} instances, {} pages, {} bytes, {:.2} s",
        args.scene,
        done.input_triangles,
        done.assets,
        done.built,
        done.reused,
        done.instances,
        done.pages,
        done.bytes.stored + done.bytes.hierarchy + done.bytes.textures,
        done.seconds.total,
    ));
    repaired(&done.repaired);
    Ok(())
}

fn repaired(repaired: &Repaired) {
    if repaired.objects > 0 {
        line(format_args!(
            "{} objects of {} bytes repaired: they were damaged or missing",
            repaired.objects, repaired.bytes
        ));
    }
}

fn one_job(
    handle: &Handle,
    args: IngestArgs,
    job: u32,
    progress: ProgressTo,
    quiet: bool,
) -> Result<(), CommandError> {
    let library = existing(handle, &args)?;
    let options = JobOptions {
        check: check(&args),
        scene: args.scene,
        job,
        inputs: args.inputs,
        threads: args.threads,
        memory_limit_bytes: args.memory_limit,
        scratch: args.scratch,
        rebuild: args.rebuild,
        self_contained: args.self_contained,
        progress,
    };
    let done = ingest::job(handle, &library, &options)
        .map_err(|error| CommandError::Ingest(Box::new(error)))?;
    output::report(args.report.as_deref(), &done)?;
    if !quiet {
        line(format_args!(
            "{}: job {} of 0 to {}: {} meshes, {} built, {} reused, {} triangles, {:.2} s",
            done.scene,
            done.job,
            done.jobs - 1,
            done.meshes,
            done.built,
            done.reused,
            done.triangles,
            done.seconds.total,
        ));
        repaired(&done.repaired);
    }
    Ok(())
}

/// What was planned, and the commands to go on with.
fn planned(library: &str, done: &PlanReport) {
    let jobs = done.jobs.len();
    let most = done.jobs.iter().map(|job| job.triangles).max();
    line(format_args!(
        "{}: {} meshes, {} triangles in {jobs} jobs of at most {} triangles; {} meshes are built already",
        done.scene,
        done.meshes,
        done.triangles,
        most.unwrap_or(0),
        done.reusable,
    ));
    repaired(&done.repaired);
    let idle = done.jobs.iter().filter(|job| job.meshes == 0).count();
    if idle > 0 {
        line(format_args!(
            "{idle} jobs have nothing to do: a mesh is not split"
        ));
    }
    let program = std::env::args()
        .next()
        .unwrap_or_else(|| "lodestream-server".to_owned());
    let command = format!(
        "{} ingest --library {} --scene {}",
        quoted(&program),
        quoted(library),
        done.scene
    );
    let last = jobs - 1;
    line(format_args!(
        "each job, from 0 to {last}, in any order:\n  {command} --job 0"
    ));
    line(format_args!(
        "or all of them:\n  parallel -q {command} --job {{}} ::: $(seq 0 {last})"
    ));
    line(format_args!(
        "  sbatch --array=0-{last} --wrap {}",
        quoted(&format!("{command} --job auto"))
    ));
    line(format_args!("then:\n  {command} --finish"));
}

/// A word as a shell reads it.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:@%,".contains(c);
    match !word.is_empty() && word.chars().all(plain) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    }
}
