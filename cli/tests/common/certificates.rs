//! Certificates of a test's own.

use std::fs;

use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, IsCa, KeyPair};
use tempfile::{TempDir, tempdir};

/// A directory with `ca.pem`, a server's and a client's certificate, and a stranger's with
/// `other.pem`.
pub(crate) fn certificates() -> TempDir {
    let dir = tempdir().unwrap();
    let issuer = |name: &str| {
        let mut params = CertificateParams::new(vec![name.to_owned()]).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        CertifiedIssuer::self_signed(params, KeyPair::generate().unwrap()).unwrap()
    };
    let write = |name: &str, text: String| fs::write(dir.path().join(name), text).unwrap();
    let (ca, other) = (issuer("ca"), issuer("other"));
    write("ca.pem", ca.pem());
    write("other.pem", other.pem());
    for (name, ca) in [("server", &ca), ("client", &ca), ("stranger", &other)] {
        let key = KeyPair::generate().unwrap();
        let params = CertificateParams::new(vec!["localhost".to_owned()]).unwrap();
        write(&format!("{name}.pem"), params.signed_by(&key, ca).unwrap().pem());
        write(&format!("{name}.key"), key.serialize_pem());
    }
    dir
}
