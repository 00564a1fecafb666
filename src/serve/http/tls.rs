//! TLS by rustls; certificate and key can be reloaded.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use rustls::client::WebPkiServerVerifier;
use rustls::client::danger::ServerCertVerifier;
use rustls::crypto::ring::default_provider;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use rustls::{CertificateError, RootCertStore, ServerConfig};
use tokio_rustls::TlsAcceptor;

use crate::error::{Error, Result};
use crate::sync::lock;

/// TLS configuration of a server.
pub struct Tls {
    certificate: PathBuf,
    key: PathBuf,
    now: Mutex<LoadedTls>,
}

/// The contents of both files.
#[derive(Clone)]
struct LoadedTls {
    config: Arc<ServerConfig>,
    /// The server's own certificate.
    own: CertificateDer<'static>,
}

impl Tls {
    /// Reads a PEM chain of certificates, the server's first, and its PEM private key.
    pub fn read(certificate: &Path, key: &Path) -> Result<Tls> {
        let now = Mutex::new(load(certificate, key)?);
        Ok(Tls { certificate: certificate.into(), key: key.into(), now })
    }

    /// Reads both files again; on an error the previous ones stay in use.
    pub fn reload(&self) -> Result<()> {
        let loaded = load(&self.certificate, &self.key)?;
        *lock(&self.now) = loaded;
        Ok(())
    }

    /// Why the server's certificate is not valid at this moment: it has expired, or is not valid yet.
    pub fn invalid_now(&self) -> Option<String> {
        let own = lock(&self.now).own.clone();
        let mut roots = RootCertStore::empty();
        roots.add(own.clone()).ok()?;
        let provider = Arc::new(default_provider());
        let verifier = WebPkiServerVerifier::builder_with_provider(Arc::new(roots), provider).build().ok()?;
        let name = ServerName::try_from("localhost").ok()?;
        // Validity is checked first; other objections, such as another name, do not matter here.
        match verifier.verify_server_cert(&own, &[], &name, &[], UnixTime::now()) {
            Err(rustls::Error::InvalidCertificate(
                e @ (CertificateError::Expired
                | CertificateError::ExpiredContext { .. }
                | CertificateError::NotValidYet
                | CertificateError::NotValidYetContext { .. }),
            )) => Some(e.to_string()),
            _ => None,
        }
    }

    /// Acceptor for new connections.
    pub fn acceptor(&self) -> TlsAcceptor {
        lock(&self.now).config.clone().into()
    }
}

fn load(certificate: &Path, key: &Path) -> Result<LoadedTls> {
    let refuse = |option: &str, path: &Path, e: &dyn std::fmt::Display, allowed: &str| {
        Error::input(option, format!("{} ({e})", path.display()), allowed)
    };
    let of_chain = "a PEM file of certificates, the server's own first";
    let chain = CertificateDer::pem_file_iter(certificate)
        .and_then(|all| all.collect::<std::result::Result<Vec<_>, _>>())
        .map_err(|e| refuse("--tls-cert", certificate, &e, of_chain))?;
    let Some(own) = chain.first().cloned() else {
        return Err(refuse("--tls-cert", certificate, &"no certificate", of_chain));
    };
    let private = PrivateKeyDer::from_pem_file(key)
        .map_err(|e| refuse("--tls-key", key, &e, "a PEM file of a private key"))?;
    let mut config = ServerConfig::builder_with_provider(Arc::new(default_provider()))
        .with_safe_default_protocol_versions()
        .and_then(|config| config.with_no_client_auth().with_single_cert(chain, private))
        .map_err(|e| {
            refuse("--tls-key", key, &e, "the private key of the first certificate of --tls-cert")
        })?;
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok(LoadedTls { config: Arc::new(config), own })
}
