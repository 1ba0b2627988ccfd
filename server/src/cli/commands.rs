//! The subcommands that end by themselves.

use std::path::PathBuf;

use tokio::runtime::Handle;

use super::args::{Command, CopyArgs, ExportArgs, GcArgs, SceneArgs, VerifyArgs};
use super::output::{self, line};
use super::private;
use crate::confine::ConfineError;
use crate::export::{self, Detail, ExportError};
use crate::http::cors::OriginError;
use crate::http::tls::TlsError;
use crate::http::tokens::TokensError;
use crate::ingest::IngestError;
use crate::library::{CopyOptions, CopyReport, GcOptions, Library, LibraryError};
use crate::verify;

/// Why a command failed: one line.
#[derive(Debug, thiserror::Error)]
pub(super) enum CommandError {
    /// The file of tokens.
    #[error(transparent)]
    Tokens(#[from] TokensError),
    #[error(transparent)]
    Library(#[from] LibraryError),
    #[error(transparent)]
    Ingest(Box<IngestError>),
    #[error("--plan: expected a library that outlives this command, found memory://")]
    PlanInMemory,
    #[error(transparent)]
    Export(Box<ExportError>),
    #[error("{found}: expected no fault, found {faults}")]
    Faults { found: String, faults: usize },
    #[error("{}: cannot write the report: {cause}", file.display())]
    Report {
        file: PathBuf,
        cause: std::io::Error,
    },
    #[error("{address}: cannot listen: {cause}")]
    Listen {
        address: String,
        cause: std::io::Error,
    },
    #[error(transparent)]
    Tls(#[from] TlsError),
    #[error("{0}: expected another library than the source, found the same")]
    SameLibrary(String),
    #[cfg(not(unix))]
    #[error("--private: expected a system with modes of files, found none")]
    NotPrivate,
    #[error("internal error: {0}")]
    Internal(String),
    #[error("--cors-origin: {0}")]
    Cors(#[from] OriginError),
    #[error("cannot start threads: {0}")]
    Runtime(std::io::Error),
    #[error(transparent)]
    Confine(#[from] ConfineError),
    #[error("{}: cannot hold models on their way: {cause}", folder.display())]
    Uploads {
        folder: PathBuf,
        cause: std::io::Error,
    },
    #[error("{cause}; --upload-unconfined takes models without it")]
    Unconfined { cause: ConfineError },
}

/// Runs any command but `serve`.
pub(super) fn run(command: Command, quiet: bool) -> Result<(), CommandError> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .map_err(CommandError::Runtime)?;
    let handle = runtime.handle();
    match command {
        Command::Ingest(args) => super::ingest::ingest(handle, args, quiet),
        Command::List(args) => super::show::list(handle, &args),
        Command::Show(args) => super::show::show(handle, &args),
        Command::Remove(args) => remove(handle, &args, quiet),
        Command::Gc(args) => gc(handle, &args, quiet),
        Command::Copy(args) => copy(handle, &args, quiet),
        Command::Verify(args) => verify(handle, &args, quiet),
        Command::Export(args) => export(handle, &args, quiet),
        Command::Serve(args) => super::serve::serve(args),
    }
}

fn remove(handle: &Handle, args: &SceneArgs, quiet: bool) -> Result<(), CommandError> {
    let library = handle.block_on(Library::open_existing(&args.library.library))?;
    handle.block_on(library.remove(&args.scene))?;
    let removed = serde_json::json!({ "removed": args.scene });
    output::report(args.library.report.as_deref(), &removed)?;
    if !quiet {
        line(format_args!("{}: removed", args.scene));
    }
    Ok(())
}

fn gc(handle: &Handle, args: &GcArgs, quiet: bool) -> Result<(), CommandError> {
    let library = handle.block_on(Library::open_existing(&args.library.library))?;
    private::shut(args.private.private, &library)?;
    let done = handle.block_on(library.gc(GcOptions {
        grace_secs: args.grace_secs,
        dry_run: args.dry_run,
    }))?;
    output::report(args.library.report.as_deref(), &done)?;
    if !quiet {
        let verb = if args.dry_run { "would go" } else { "removed" };
        line(format_args!(
            "{} objects of {} bytes {verb}, {} live, {} too young; {} build records and {} plans {verb}, {} and {} stay; \
             {} staged files of {} bytes {verb}, {} stay",
            done.removed,
            done.removed_bytes,
            done.live,
            done.young,
            done.removed_records,
            done.removed_plans,
            done.records,
            done.plans,
            done.removed_staged,
            done.removed_staged_bytes,
            done.staged,
        ));
    }
    Ok(())
}

fn copy(handle: &Handle, args: &CopyArgs, quiet: bool) -> Result<(), CommandError> {
    let source = handle.block_on(Library::open_existing(&args.from))?;
    if is_same(&args.from, &args.to) {
        return Err(CommandError::SameLibrary(args.to.clone()));
    }
    let target = handle.block_on(Library::open_or_make(&args.to))?;
    private::shut(args.private.private, &target)?;
    let options = CopyOptions {
        scenes: args.scenes.clone(),
        verify: args.verify,
        delete: args.delete,
        allow_empty: args.allow_empty,
    };
    let done = handle.block_on(target.copy_from(&source, &options))?;
    output::report(args.report.as_deref(), &done)?;
    if !quiet {
        copied(&done, args.verify);
    }
    for fault in &done.unrepaired {
        output::error_line(fault);
    }
    match done.unrepaired.len() {
        0 => Ok(()),
        faults => Err(CommandError::Faults {
            found: format!("library {}", target.location()),
            faults,
        }),
    }
}

/// Whether both name one folder, or one place in a store.
fn is_same(from: &str, to: &str) -> bool {
    let plain = |location: &str| location.trim_end_matches('/').to_owned();
    match (std::fs::canonicalize(from), std::fs::canonicalize(to)) {
        (Ok(from), Ok(to)) => from == to,
        _ => plain(from) == plain(to),
    }
}

fn copied(done: &CopyReport, verified: bool) {
    line(format_args!(
        "{} scenes, {} published, {} removed, {} of {} objects sent, {} bytes, {} build records; {} repaired of {} bytes",
        done.scenes,
        done.published,
        done.removed.len(),
        done.copied,
        done.objects,
        done.copied_bytes,
        done.records,
        done.repaired.objects,
        done.repaired.bytes,
    ));
    match verified {
        true => line(format_args!(
            "{} objects of {} bytes hashed there and whole, {} damaged ones removed that no scene needs",
            done.verified, done.verified_bytes, done.dropped,
        )),
        false => line("objects there of the right length count as whole (--verify hashes them)"),
    }
}

fn verify(handle: &Handle, args: &VerifyArgs, quiet: bool) -> Result<(), CommandError> {
    let library = handle.block_on(Library::open_existing(&args.library.library))?;
    let done = verify::verify(handle, &library, args.scene.as_deref())?;
    output::report(args.library.report.as_deref(), &done)?;
    if !quiet || !done.faults.is_empty() {
        line(format_args!(
            "{} scenes, {} objects, {} bytes, {} build records, {} pages, {} clusters, {} faults",
            done.scenes,
            done.objects,
            done.bytes,
            done.records,
            done.pages,
            done.clusters,
            done.faults.len(),
        ));
    }
    for fault in &done.faults {
        output::error_line(fault);
    }
    match done.faults.len() {
        0 => Ok(()),
        faults => Err(CommandError::Faults {
            found: format!("library {}", library.location()),
            faults,
        }),
    }
}

fn export(handle: &Handle, args: &ExportArgs, quiet: bool) -> Result<(), CommandError> {
    let library = handle.block_on(Library::open_existing(&args.scene.library.library))?;
    let detail = match (args.error, args.triangles) {
        (Some(metres), _) => Detail::Error(metres),
        (None, Some(triangles)) => Detail::Triangles(triangles),
        (None, None) => Detail::Source,
    };
    let done = export::export(handle, &library, &args.scene.scene, detail, &args.out)
        .map_err(|error| CommandError::Export(Box::new(error)))?;
    output::report(args.scene.library.report.as_deref(), &done)?;
    if !quiet {
        line(format_args!(
            "{}: {} triangles in {} assets, {} in {} instances, error at most {} m",
            args.out.display(),
            done.triangles,
            done.assets,
            done.drawn_triangles,
            done.instances,
            done.error_metres,
        ));
    }
    Ok(())
}
