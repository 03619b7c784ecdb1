//! The clouds of a run and the connections to them.

use std::net::Ipv4Addr;
use std::sync::{Arc, OnceLock};
use std::{future, io};

use fuseline_tokio::grpc::{self, Connection};
use tokio::net::TcpListener;
use tokio::task::JoinSet;
use tokio::time::Instant;

use crate::diagnostics::print_line;
use crate::emulation::answer;
use crate::fault::Fault;
use crate::files::{self, FileError};
use crate::run::cloud::RemoteServer;
use crate::run::error::RunError;
use crate::run::plan::{CloudServer, RunPlan};

/// A connection to each cloud.
pub(crate) struct Network {
    /// The connections, in the plan's order.
    pub(crate) connections: Vec<Connection>,
    /// The servers of the emulated clouds, each on its own port. They end when this is dropped.
    pub(crate) servers: JoinSet<Result<(), grpc::ServeError>>,
    /// The instant at which the emulated drives began.
    pub(crate) began: Arc<OnceLock<Instant>>,
}

impl Network {
    /// Starts the emulated clouds. A connection is made when it is first used.
    ///
    /// # Errors
    /// Returns an error if a cloud's description cannot be used, or if this host has no free port.
    pub(crate) async fn connect(plan: &RunPlan) -> Result<Self, Fault> {
        let (mut connections, mut servers) = (Vec::new(), JoinSet::new());
        let began = Arc::new(OnceLock::new());
        for cloud in &plan.clouds {
            let remote = match &cloud.server {
                CloudServer::Remote(remote) => describe(remote).map_err(|(key, source)| {
                    RunError::File { place: plan.place(&cloud.name, key), source }
                })?,
                CloudServer::Emulated(emulation) => {
                    let (listener, url) = listen().await.map_err(RunError::Loopback)?;
                    let infer = answer(emulation.clone(), Arc::clone(&began));
                    servers.spawn(grpc::serve(
                        infer,
                        grpc::Server::default(),
                        listener,
                        future::pending(),
                    ));
                    grpc::Remote::new(url)
                }
            };
            let connection = remote.connect();
            connections.push(connection.map_err(|source| {
                let (place, cloud) = (plan.place(&cloud.name, "url"), cloud.name.clone());
                RunError::Remote { place, cloud, source }
            })?);
        }
        Ok(Self { connections, servers, began })
    }

    /// Asks the servers elsewhere what they serve, and warns if the user stated something else.
    pub(crate) async fn describe(&self, plan: &mut RunPlan) {
        for (cloud, connection) in plan.clouds.iter_mut().zip(&self.connections) {
            if matches!(cloud.server, CloudServer::Remote(_))
                && let Some(difference) = cloud.served.describe(connection.clone()).await
            {
                print_line(format_args!("warning: {}: {difference}", cloud.name));
            }
        }
    }
}

async fn listen() -> io::Result<(TcpListener, String)> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await?;
    let url = format!("http://{}", listener.local_addr()?);
    Ok((listener, url))
}

/// Reads the files that are needed to reach a remote server. An error comes with the key that names
/// the file.
fn describe(remote: &RemoteServer) -> Result<grpc::Remote, (&'static str, FileError)> {
    let RemoteServer { url, ca, cert, key, token } = remote;
    let of_pair = |error: FileError| match &error {
        FileError::Read { path, .. } | FileError::NoKey { path, .. }
            if key.as_deref() == Some(path) =>
        {
            ("key", error)
        }
        _ => ("cert", error),
    };
    let ca = ca.as_deref().map(files::certificates).transpose();
    let token = token.as_deref().map(files::token).transpose();
    Ok(grpc::Remote {
        ca: ca.map_err(|error| ("ca", error))?,
        identity: files::identity(cert.as_deref(), key.as_deref()).map_err(of_pair)?,
        token: token.map_err(|error| ("token", error))?,
        ..grpc::Remote::new(url)
    })
}
