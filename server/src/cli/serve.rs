//! `serve`: until a signal.

use super::args::ServeArgs;
use super::commands::CommandError;
use super::output;
use crate::http::AppState;
use crate::http::serve::{Server, StopSignal};
use crate::http::tls::Tls;
use crate::library::Library;

/// Serves a library.
pub(super) fn serve(args: ServeArgs) -> Result<(), CommandError> {
    let library = Library::open(&args.library)?;
    let mut builder = tokio::runtime::Builder::new_multi_thread();
    if let Some(threads) = args.threads {
        builder.worker_threads(threads);
    }
    let runtime = builder
        .enable_all()
        .build()
        .map_err(CommandError::Runtime)?;
    runtime.block_on(async {
        let listen = |cause| CommandError::Listen {
            address: args.listen.clone(),
            cause,
        };
        let server = Server::bind(&args.listen).await.map_err(listen)?;
        let stop = StopSignal::install().map_err(CommandError::Runtime)?;
        let (server, scheme) = match (&args.tls_cert, &args.tls_key) {
            (Some(certificates), Some(key)) => {
                (server.with_tls(Tls::load(certificates, key)?), "https")
            }
            _ => (server, "http"),
        };
        output::line(format_args!("listening on {scheme}://{}", server.address()));
        let state = AppState::new(library, args.cache_bytes as usize);
        server.run(state, stop.wait()).await;
        Ok(())
    })
}
