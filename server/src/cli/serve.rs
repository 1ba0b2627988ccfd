//! `serve`: until a signal.

use super::args::ServeArgs;
use super::commands::CommandError;
use super::output;
use crate::http::AppState;
use crate::http::limits::ClientLimits;
use crate::http::serve::{Server, StopSignal};
use crate::http::tls::Tls;
use crate::http::tokens::{ReadTokens, Tokens};
use crate::http::uploads::UploadOptions;
use crate::library::Library;

/// Serves a library.
pub(super) fn serve(args: ServeArgs) -> Result<(), CommandError> {
    let library = Library::open_to_serve(&args.library)?;
    // It accepts; threads of their own serve.
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandError::Runtime)?;
    runtime.block_on(async {
        let listen = |cause| CommandError::Listen {
            address: args.listen.clone(),
            cause,
        };
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let server = Server::bind(&args.listen).await.map_err(listen)?;
        let threads = args.threads.unwrap_or(threads);
        let server = server
            .with_threads(threads)
            .map_err(CommandError::Runtime)?;
        let stop = StopSignal::install().map_err(CommandError::Runtime)?;
        let (server, scheme) = match (&args.tls_cert, &args.tls_key) {
            (Some(certificates), Some(key)) => {
                (server.with_tls(Tls::load(certificates, key)?), "https")
            }
            _ => (server, "http"),
        };
        output::line(format_args!("listening on {scheme}://{}", server.address()));
        let limits = ClientLimits {
            requests_per_sec: args.client_requests,
            connections: args.client_connections,
        };
        let mut state = AppState::with_limits(library, args.cache_bytes as usize, limits);
        if let Some(file) = &args.read_tokens {
            state = state.read_by(ReadTokens::read(file)?);
        }
        if let Some(file) = &args.upload_tokens {
            state = state.taking_uploads(UploadOptions {
                tokens: Tokens::read(file)?,
                program: std::env::current_exe().map_err(CommandError::Runtime)?,
                library: args.library.clone(),
                scratch: args.upload_scratch.unwrap_or_else(std::env::temp_dir),
                max_bytes: args.upload_bytes,
                max_triangles: args.upload_triangles,
                max_secs: args.upload_secs,
                memory_bytes: args.upload_memory,
            });
        }
        server.run(state, stop.wait()).await;
        Ok(())
    })
}
