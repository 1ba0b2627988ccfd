//! TLS of connections: a certificate chain and its key from PEM files, read again when they change, so that a renewed certificate needs no
//! restart. TLS 1.2 and 1.3; HTTP/2 or HTTP/1.1 as the client says (ALPN).

use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use rustls::ServerConfig;
use rustls::crypto::ring;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::{ClientHello, ResolvesServerCert};
use rustls::sign::CertifiedKey;
use tokio::net::TcpStream;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;

use super::connection::Spoken;

/// Longest handshake.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(10);

/// Why there is no TLS: one line.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A file that is not there, or is not what it should be.
    #[error("{}: expected {expected}, found {found}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// What it should hold.
        expected: &'static str,
        /// What it does.
        found: String,
    },
    /// A key that is not the certificate's, or nothing that rustls takes.
    #[error("{} and {}: expected a certificate and its key, found: {cause}", files[0].display(), files[1].display())]
    Pair {
        /// Certificate and key.
        files: [PathBuf; 2],
        /// What is wrong.
        cause: rustls::Error,
    },
}

/// Certificate, key and the files they come from; clones share them.
#[derive(Debug, Clone)]
pub struct Tls {
    acceptor: Acceptor,
    pair: Arc<Pair>,
}

#[derive(Clone)]
struct Acceptor(TlsAcceptor);

impl std::fmt::Debug for Acceptor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Acceptor")
    }
}

#[derive(Debug)]
struct Pair {
    files: [PathBuf; 2],
    now: RwLock<Arc<CertifiedKey>>,
}

impl ResolvesServerCert for Pair {
    fn resolve(&self, _: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
        // A writer only swaps the pointer.
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        Some(Arc::clone(&now))
    }
}

impl Tls {
    /// Reads a chain (the server's certificate first) and its key.
    ///
    /// # Errors
    /// Where a file cannot be read or holds something else, and where the key is not the certificate's.
    pub fn load(certificates: &Path, key: &Path) -> Result<Self, TlsError> {
        let files = [certificates.to_owned(), key.to_owned()];
        let pair = Arc::new(Pair {
            now: RwLock::new(Arc::new(read(&files)?)),
            files,
        });
        let provider = Arc::new(ring::default_provider());
        let versions =
            ServerConfig::builder_with_provider(provider).with_safe_default_protocol_versions();
        let builder = versions.map_err(|cause| TlsError::Pair {
            files: pair.files.clone(),
            cause,
        })?;
        let mut config = builder
            .with_no_client_auth()
            .with_cert_resolver(Arc::clone(&pair) as Arc<dyn ResolvesServerCert>);
        config.alpn_protocols = vec![b"h2".to_vec(), b"http/1.1".to_vec()];
        Ok(Self {
            acceptor: Acceptor(TlsAcceptor::from(Arc::new(config))),
            pair,
        })
    }

    /// The handshake, and what it agrees on; none where it fails or takes too long.
    pub(super) async fn accept(&self, stream: TcpStream) -> Option<(TlsStream<TcpStream>, Spoken)> {
        match tokio::time::timeout(HANDSHAKE_TIMEOUT, self.acceptor.0.accept(stream)).await {
            Ok(Ok(stream)) => {
                // HTTP/2 over TLS is agreed on, or it is not HTTP/2 (RFC 9113, section 3.2).
                let spoken = match stream.get_ref().1.alpn_protocol() {
                    Some(b"h2") => Spoken::Http2,
                    _ => Spoken::Http1,
                };
                Some((stream, spoken))
            }
            Ok(Err(error)) => {
                tracing::debug!("handshake: {error}");
                None
            }
            Err(_) => {
                tracing::debug!(
                    "handshake: not done after {} s",
                    HANDSHAKE_TIMEOUT.as_secs()
                );
                None
            }
        }
    }

    /// Certificates and key.
    pub(super) fn files(&self) -> &[PathBuf; 2] {
        &self.pair.files
    }

    /// Reads the files again. A bad pair is told, and the old one stays.
    pub(super) fn read_again(&self) {
        match read(&self.pair.files) {
            Ok(pair) => {
                let mut now = self
                    .pair
                    .now
                    .write()
                    .unwrap_or_else(PoisonError::into_inner);
                *now = Arc::new(pair);
                tracing::info!("{}: read again", self.pair.files[0].display());
            }
            Err(error) => tracing::error!("the old certificate stays: {error}"),
        }
    }
}

fn read(files: &[PathBuf; 2]) -> Result<CertifiedKey, TlsError> {
    let wrong = |file: usize, expected, found: String| TlsError::File {
        file: files[file].clone(),
        expected,
        found,
    };
    let expected = "certificates in PEM";
    let chain = CertificateDer::pem_file_iter(&files[0])
        .and_then(Iterator::collect::<Result<Vec<_>, _>>)
        .map_err(|error| wrong(0, expected, error.to_string()))?;
    if chain.is_empty() {
        return Err(wrong(0, expected, "none".to_owned()));
    }
    let key = PrivateKeyDer::from_pem_file(&files[1])
        .map_err(|error| wrong(1, "a private key in PEM", error.to_string()))?;
    CertifiedKey::from_der(chain, key, &ring::default_provider()).map_err(|cause| TlsError::Pair {
        files: files.clone(),
        cause,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, name: &str) -> rcgen::CertifiedKey<rcgen::KeyPair> {
        let made = rcgen::generate_simple_self_signed([name.to_owned()]).expect("makes one");
        std::fs::write(folder.join("cert.pem"), made.cert.pem()).expect("writes");
        std::fs::write(folder.join("key.pem"), made.signing_key.serialize_pem()).expect("writes");
        made
    }

    #[test]
    fn a_changed_pair_is_read_again_and_a_broken_one_is_not_taken() {
        let folder = tempfile::tempdir().expect("a folder");
        let (cert, key) = (
            folder.path().join("cert.pem"),
            folder.path().join("key.pem"),
        );
        let first = write(folder.path(), "first");
        let tls = Tls::load(&cert, &key).expect("loads");
        let now = |tls: &Tls| tls.pair.now.read().expect("works").cert[0].to_vec();
        assert_eq!(now(&tls), first.cert.der().to_vec());
        let second = write(folder.path(), "second");
        tls.read_again();
        assert_eq!(now(&tls), second.cert.der().to_vec());
        std::fs::write(&key, first.signing_key.serialize_pem()).expect("writes");
        tls.read_again();
        std::fs::write(&cert, "no certificate").expect("writes");
        tls.read_again();
        std::fs::remove_file(&cert).expect("removes");
        tls.read_again();
        assert_eq!(now(&tls), second.cert.der().to_vec());
    }

    #[test]
    fn what_is_no_pair_is_told_with_its_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let (cert, key) = (
            folder.path().join("cert.pem"),
            folder.path().join("key.pem"),
        );
        let told = |expected: &str| {
            let error = Tls::load(&cert, &key).expect_err("is refused").to_string();
            assert!(error.contains(expected) && !error.contains('\n'), "{error}");
        };
        told("cert.pem");
        let other = write(folder.path(), "other").signing_key.serialize_pem();
        write(folder.path(), "own");
        std::fs::write(&key, other).expect("writes");
        told("expected a certificate and its key");
        std::fs::write(&key, "").expect("writes");
        told("key.pem: expected a private key in PEM");
        std::fs::write(&cert, "").expect("writes");
        told("cert.pem: expected certificates in PEM, found none");
    }
}
