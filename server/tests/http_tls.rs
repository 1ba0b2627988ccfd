//! The server over TLS: HTTP/2 and HTTP/1.1 by ALPN, the certificate checked by the client; what speaks no TLS gets nothing.
// A failed expectation is the test's failure.
#![allow(clippy::unwrap_used)]

mod support;

use lodestream_server::http::AppState;
use lodestream_server::http::serve::Server;
use lodestream_server::http::tls::Tls;
use lodestream_server::library::Library;
use reqwest::Version;
use support::made;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::sync::oneshot;

const NAME: &str = "library.test";

const HTTP1: &[u8] = b"GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n";
/// The preface, no settings, and a frame that ends the connection (GOAWAY).
const HTTP2: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0\
    \0\0\x08\x07\0\0\0\0\0\0\0\0\0\0\0\0\0";
/// The head of a frame that takes the other side's settings.
const ACK: [u8; 9] = [0, 0, 0, 4, 1, 0, 0, 0, 0];

/// A connection that offers these protocols.
async fn speak(
    trusted: &rcgen::Certificate,
    address: std::net::SocketAddr,
    protocols: &[&[u8]],
) -> tokio_rustls::client::TlsStream<tokio::net::TcpStream> {
    let mut roots = rustls::RootCertStore::empty();
    roots.add(trusted.der().clone()).unwrap();
    let config = rustls::ClientConfig::builder().with_root_certificates(roots);
    let mut config = config.with_no_client_auth();
    config.alpn_protocols = protocols.iter().map(|name| name.to_vec()).collect();
    let connector = tokio_rustls::TlsConnector::from(std::sync::Arc::new(config));
    let stream = tokio::net::TcpStream::connect(address).await.unwrap();
    connector
        .connect(NAME.try_into().unwrap(), stream)
        .await
        .unwrap()
}

#[tokio::test]
async fn pages_come_over_tls_in_both_versions() {
    support::server::client();
    let folder = tempfile::tempdir().unwrap();
    let made = rcgen::generate_simple_self_signed([NAME.to_owned()]).unwrap();
    let files = ["cert.pem", "key.pem"].map(|name| folder.path().join(name));
    std::fs::write(&files[0], made.cert.pem()).unwrap();
    std::fs::write(&files[1], made.signing_key.serialize_pem()).unwrap();
    let library = Library::open("memory://").unwrap();
    let asset = made::asset(&library, 3, 5, 90_000).await;
    let server = Server::bind("127.0.0.1:0").await.unwrap();
    let server = server.with_tls(Tls::load(&files[0], &files[1]).unwrap());
    let address = server.address();
    let (stop, stopped) = oneshot::channel::<()>();
    let running = tokio::spawn(server.run(AppState::new(library, 1 << 20), async {
        let _ = stopped.await;
    }));

    // Says nothing, for as long as the others are served.
    let mut silent = tokio::net::TcpStream::connect(address).await.unwrap();
    let root = || reqwest::Certificate::from_der(made.cert.der()).unwrap();
    let client = || {
        reqwest::Client::builder()
            .no_proxy()
            .resolve(NAME, address)
            .tls_certs_only([root()])
    };
    let clients = [
        (client().build().unwrap(), Version::HTTP_2),
        (client().http1_only().build().unwrap(), Version::HTTP_11),
    ];
    for (client, version) in &clients {
        for page in [0, 0, 4] {
            let url = format!(
                "https://{NAME}:{}/v1/assets/{}/pages/{page}-{page}",
                address.port(),
                asset.hash
            );
            let answer = client.get(url).send().await.unwrap();
            assert_eq!(answer.version(), *version);
            assert_eq!(answer.bytes().await.unwrap(), asset.frame(page));
        }
    }
    let other_name = client().resolve("other.test", address).build().unwrap();
    let url = format!("https://other.test:{}/healthz", address.port());
    assert!(other_name.get(url).send().await.is_err(), "another name");

    let mut plain = tokio::net::TcpStream::connect(address).await.unwrap();
    plain
        .write_all(b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")
        .await
        .unwrap();
    let mut answer = vec![];
    // A TLS alert and the end, or a reset.
    let _ = plain.read_to_end(&mut answer).await;
    assert!(!answer.starts_with(b"HTTP"), "{answer:?}");

    for (agreed, said, is_answered) in [
        (&[&b"h2"[..]][..], HTTP1, false),
        (&[b"http/1.1"], HTTP2, false),
        (&[], HTTP2, false),
        (&[b"h2"], HTTP2, true),
        (&[b"http/1.1"], HTTP1, true),
        (&[], HTTP1, true),
    ] {
        let mut spoken = speak(&made.cert, address, agreed).await;
        spoken.write_all(said).await.unwrap();
        let mut answer = vec![];
        // Over once the server is done with it, in one way or another.
        let read = spoken.read_to_end(&mut answer).await;
        let is_ok = match said == HTTP1 {
            true => answer.starts_with(b"HTTP/1.1 200"),
            false => answer.windows(ACK.len()).any(|frame| frame == ACK),
        };
        assert_eq!(is_ok, is_answered, "{agreed:?} {read:?} {answer:?}");
    }

    drop(stop);
    drop(clients);
    running.await.unwrap();
    let mut nothing = [0; 1];
    assert!(!matches!(silent.read(&mut nothing).await, Ok(1)));
}
