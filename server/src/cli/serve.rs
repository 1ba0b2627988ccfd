//! `serve`: until a signal.

use std::time::Duration;

use futures_util::future::OptionFuture;

use super::args::ServeArgs;
use super::commands::CommandError;
use super::output;
use super::private;
use crate::confine;
use crate::http::cors::Cors;
use crate::http::limits::ClientLimits;
use crate::http::reload::{self, Reload};
use crate::http::serve::{Server, StopSignal};
use crate::http::tls::Tls;
use crate::http::tokens::{Coverage, Tokens};
use crate::http::uploads::{UploadOptions, UploadsFolder};
use crate::http::{AppState, Serves, StateOptions, descriptors};
use crate::library::{Library, LibraryError};

/// Longest wait for the mark.
const STORE_TIMEOUT: Duration = Duration::from_secs(5);

/// Checks the library; uploads make a new one. A store that is down is left to `/readyz`.
async fn open_library(library: &Library, args: &ServeArgs) -> Result<(), CommandError> {
    private::shut(args.private.private, library)?;
    let looked = async {
        match args.upload_tokens {
            Some(_) => library.make().await,
            None => library.check().await,
        }
    };
    match tokio::time::timeout(STORE_TIMEOUT, looked).await {
        Ok(Err(error @ LibraryError::Store { .. })) if library.is_remote() => {
            tracing::warn!("{error}");
            Ok(())
        }
        Ok(looked) => Ok(looked?),
        Err(_) => {
            tracing::warn!("library {}: no answer yet", library.location());
            Ok(())
        }
    }
}

/// Serves a library.
pub(super) fn serve(args: ServeArgs) -> Result<(), CommandError> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = args.threads.unwrap_or(threads);
    bound_arenas(threads);
    descriptors::raise().map_err(CommandError::Runtime)?;
    if args.upload_tokens.is_some() {
        Library::open_or_create(&args.library)?;
    }
    let library = Library::open_to_serve(&args.library)?;
    // It accepts; threads of their own serve.
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandError::Runtime)?;
    runtime.block_on(async {
        let listen = |address: &str| {
            let address = address.to_owned();
            |cause| CommandError::Listen { address, cause }
        };
        open_library(&library, &args).await?;
        let server = Server::bind(&args.listen).await;
        let server = server.map_err(listen(&args.listen))?;
        let server = server
            .with_threads(threads)
            .map_err(CommandError::Runtime)?;
        let mut server = server.with_cors(Cors::of(&args.cors_origins)?);
        let mut metrics = None;
        if let Some(address) = &args.metrics_listen {
            let only = Server::bind(address).await.map_err(listen(address))?;
            metrics = Some(only.with_routes(Serves::Metrics));
            server = server.with_routes(Serves::Library);
        }
        let stop = StopSignal::install().map_err(CommandError::Runtime)?;
        let reload = Reload::install().map_err(CommandError::Runtime)?;
        let tls = match (&args.tls_cert, &args.tls_key) {
            (Some(certificates), Some(key)) => Some(Tls::load(certificates, key)?),
            (None, None) => None,
            _ => unreachable!("each of the two options requires the other"),
        };
        let (server, scheme) = match tls.clone() {
            Some(tls) => (server.with_tls(tls), "https"),
            None => (server, "http"),
        };
        let readers = args.read_tokens.as_deref().map(Tokens::from_read_file);
        let readers = readers.transpose()?;
        let uploaders = args.upload_tokens.as_deref().map(Tokens::from_upload_file);
        let uploaders = uploaders.transpose()?;
        let covered = covered(&library, readers.as_ref(), uploaders.as_ref()).await?;
        let limits = ClientLimits {
            requests_per_sec: args.client_requests,
            connections: args.client_connections,
        };
        let uploads = uploaders.map(|tokens| uploads(&args, tokens));
        let uploads = uploads.transpose()?;
        let options = StateOptions {
            cache_bytes: args.cache_bytes as usize,
            limits,
            uploads,
            readers,
        };
        let state = AppState::with_options(library, options);
        // From here on the server answers.
        output::line(format_args!("listening on {scheme}://{}", server.address()));
        if let Some(metrics) = &metrics {
            output::line(format_args!("metrics on http://{}", metrics.address()));
        }
        covered.iter().for_each(output::line);
        let reload = tokio::spawn(reload.run(tls, state.clone()));
        let metrics = metrics.map(|metrics| metrics.run(state.clone(), state.drained()));
        tokio::join!(server.run(state, stop.wait()), OptionFuture::from(metrics));
        reload.abort();
        Ok(())
    })
}

/// Lets the threads of a server share what is freed. By default each has an arena of its own, eight
/// a core, and what one that waits for the disk frees stays there: a third of what clients cost
/// that do not read.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn bound_arenas(threads: usize) {
    let arenas = threads.saturating_add(1).try_into().unwrap_or(i32::MAX);
    // SAFETY: it takes two numbers, and no other thread runs yet (mallopt(3)).
    let is_set = unsafe { libc::mallopt(libc::M_ARENA_MAX, arenas) } == 1;
    if !is_set {
        tracing::warn!("expected the allocator to take {arenas} arenas; it has its own number");
    }
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn bound_arenas(_: usize) {}

/// How many scenes each line of the tokens covers, once they are compared with the library.
async fn covered(
    library: &Library,
    readers: Option<&Tokens>,
    uploaders: Option<&Tokens>,
) -> Result<Vec<Coverage>, CommandError> {
    let mut lines = Vec::new();
    if readers.is_none() && uploaders.is_none() {
        return Ok(lines);
    }
    let names = reload::scene_names(library).await;
    for tokens in [readers, uploaders].into_iter().flatten() {
        lines.extend(reload::coverage(tokens, &names, readers)?);
    }
    Ok(lines)
}

/// Uploads by the holders of `tokens`, as the other options ask for them.
fn uploads(args: &ServeArgs, tokens: Tokens) -> Result<UploadOptions, CommandError> {
    let confined = !args.upload_unconfined;
    if confined {
        confine::check().map_err(|cause| CommandError::Unconfined { cause })?;
    }
    let scratch = args.upload_scratch.clone();
    let scratch = scratch.unwrap_or_else(std::env::temp_dir);
    let failed = |cause| CommandError::Uploads {
        folder: scratch.clone(),
        cause,
    };
    // Builds run in a folder of their own.
    let real = std::fs::canonicalize(&scratch).map_err(failed)?;
    let library = match args.library.contains("://") {
        true => args.library.clone(),
        false => std::fs::canonicalize(&args.library)
            .map_err(failed)?
            .to_string_lossy()
            .into_owned(),
    };
    Ok(UploadOptions {
        tokens,
        program: std::env::current_exe().map_err(CommandError::Runtime)?,
        library,
        folder: UploadsFolder::new(&real).map_err(failed)?,
        max_bytes: args.upload_bytes,
        max_triangles: args.upload_triangles,
        max_secs: args.upload_secs,
        memory_bytes: args.upload_memory,
        confined,
    })
}
