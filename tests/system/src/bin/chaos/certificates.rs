//! The certificates of a run: a CA, good certificates, and an expired one.

use fuseline_tokio::Error;
use fuseline_tokio::grpc::Identity;
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair, date_time_ymd};

/// The CA of a run.
pub(crate) struct Ca {
    pub(crate) certificate: Vec<u8>,
    issuer: Issuer<'static, KeyPair>,
}

impl Ca {
    pub(crate) fn new() -> Result<Self, Error> {
        let mut params = CertificateParams::new([])?;
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let key = KeyPair::generate()?;
        let certificate = params.self_signed(&key)?.pem().into_bytes();
        Ok(Self { certificate, issuer: Issuer::new(params, key) })
    }

    /// Signs a certificate that is good until the beginning of a year.
    pub(crate) fn sign(&self, name: &str, year: i32) -> Result<Identity, Error> {
        let key = KeyPair::generate()?;
        let mut params = CertificateParams::new([name.to_owned()])?;
        params.not_after = date_time_ymd(year, 1, 1);
        let certificate = params.signed_by(&key, &self.issuer)?.pem().into_bytes();
        Ok(Identity { certificate, key: key.serialize_pem().into_bytes() })
    }
}
