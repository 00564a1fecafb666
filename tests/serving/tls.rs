//! HTTPS: trusting and non-trusting clients, and certificate renewal at run time.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject;
use rustls::{ClientConfig, ClientConnection, RootCertStore, Stream};

fn of(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/serving/tls").join(name)
}

/// The presented certificate, and the response to a request.
fn ask(address: &str, trusted: &Path) -> Result<(Vec<u8>, String), std::io::Error> {
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(trusted).unwrap()).unwrap();
    let config = ClientConfig::builder_with_provider(Arc::new(rustls::crypto::ring::default_provider()))
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    let mut connection = ClientConnection::new(Arc::new(config), "localhost".try_into().unwrap()).unwrap();
    let mut socket = TcpStream::connect(address)?;
    let mut stream = Stream::new(&mut connection, &mut socket);
    stream.write_all(b"GET /readyz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer)?;
    Ok((connection.peer_certificates().unwrap()[0].to_vec(), answer))
}

/// A server process, killed on drop.
struct Program(Child);

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start(certificate: &Path, key: &Path) -> (Program, String) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_iplw"))
        .args(["serve", "--http", "127.0.0.1:0", "--tls-cert"])
        .args([certificate, Path::new("--tls-key"), key])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let address = line.trim().strip_prefix("listening on https://").unwrap_or_else(|| panic!("{line:?}"));
    (Program(child), address.into())
}

#[test]
fn serves_clients_that_trust_its_certificate() {
    let (_server, address) = start(&of("cert.pem"), &of("key.pem"));
    let (_, answer) = ask(&address, &of("ca.pem")).unwrap();
    assert!(answer.starts_with("HTTP/1.1 200 OK") && answer.contains("\"ready\""), "{answer}");
    // Neither with another authority nor without TLS.
    assert!(ask(&address, &of("cert.pem")).is_err());
    let mut clear = TcpStream::connect(&address).unwrap();
    clear.write_all(b"GET /readyz HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    let mut said = Vec::new();
    let _ = clear.read_to_end(&mut said);
    assert!(!said.starts_with(b"HTTP"), "{said:?}");
}

#[test]
fn reloads_valid_certificates_on_sighup() {
    let place = tempfile::tempdir().unwrap();
    let (certificate, key) = (place.path().join("cert.pem"), place.path().join("key.pem"));
    let put = |from: &str, key_from: &str| {
        std::fs::copy(of(from), &certificate).unwrap();
        std::fs::copy(of(key_from), &key).unwrap();
    };
    put("cert.pem", "key.pem");
    let (server, address) = start(&certificate, &key);
    let shown = || ask(&address, &of("ca.pem")).unwrap().0;
    let first = shown();
    let hang_up = || {
        let done = Command::new("kill").args(["-HUP", &server.0.id().to_string()]).status().unwrap();
        assert!(done.success());
    };
    put("renewed.pem", "key.pem");
    hang_up();
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(shown(), first, "a key that is not the certificate's changes nothing");
    put("renewed.pem", "renewed_key.pem");
    hang_up();
    let begun = Instant::now();
    while shown() == first {
        assert!(begun.elapsed().as_secs() < 10, "the renewed one is shown");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn rejects_invalid_certificates_by_name() {
    let place = tempfile::tempdir().unwrap();
    let refused = |certificate: &Path, key: &Path, wanted: &str| {
        let tried = Command::new(env!("CARGO_BIN_EXE_iplw"))
            .args(["serve", "--http", "127.0.0.1:0", "--tls-cert"])
            .args([certificate, Path::new("--tls-key"), key])
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&tried.stderr).into_owned();
        assert!(tried.status.code() == Some(2) && said.contains(wanted), "{said}");
    };
    refused(&place.path().join("none"), &of("key.pem"), "--tls-cert");
    refused(&of("cert.pem"), &of("cert.pem"), "--tls-key");
    refused(&of("cert.pem"), &of("renewed_key.pem"), "--tls-key");
}

#[test]
fn warns_of_an_expired_certificate() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_iplw"))
        .args(["serve", "--http", "127.0.0.1:0", "--tls-cert"])
        .args([of("expired.pem"), "--tls-key".into(), of("expired_key.pem")])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut log = BufReader::new(child.stderr.take().unwrap()).lines();
    let _server = Program(child);
    let warning = log.next().unwrap().unwrap();
    assert!(
        warning.contains("clients will refuse the certificate") && warning.contains("expired"),
        "{warning}"
    );
}
