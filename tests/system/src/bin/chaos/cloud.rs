//! A cloud in a process of its own, so that it can be killed and stopped.

use std::io::BufRead;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use bytes::{BufMut, BytesMut};
use fuseline_tokio::Error;
use fuseline_tokio::grpc::{Bounds, Identity, Reply, Request, Server, serve};
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::time::sleep;

/// The time that a cloud takes when nothing is wrong.
const WORK: Duration = Duration::from_millis(10);

#[derive(clap::Args)]
pub(crate) struct Args {
    #[arg(long)]
    listen: SocketAddr,
    /// Its number, which each reply bears.
    #[arg(long)]
    number: u64,
    /// The folder with `ca.pem`, and the certificate and key `NAME.pem`, `NAME.key`.
    #[arg(long)]
    folder: PathBuf,
    #[arg(long)]
    name: String,
}

/// Replies with the payload of the request and the cloud's own number. Each line of standard input
/// is a delay in milliseconds to add from now on.
pub(crate) async fn cloud(args: Args) -> Result<(), Error> {
    let read = |name: String| std::fs::read(args.folder.join(name));
    let identity = Identity {
        certificate: read(format!("{}.pem", args.name))?,
        key: read(format!("{}.key", args.name))?,
    };
    let server = Server {
        identity: Some(identity),
        client_ca: Some(read("ca.pem".to_owned())?),
        // All operators run on one host here.
        bounds: Bounds { connections_each: 1024, ..Bounds::default() },
        ..Server::default()
    };
    let delay = Arc::new(AtomicU64::new(0));
    let (reported, number) = (Arc::clone(&delay), args.number);
    let (end, ended) = oneshot::channel::<()>();
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            reported.store(line.trim().parse().unwrap_or(0), Ordering::Relaxed);
        }
        drop(end);
    });
    let infer = move |request: Request| {
        let late = Duration::from_millis(delay.load(Ordering::Relaxed));
        async move {
            sleep(WORK + late).await;
            let mut payload = BytesMut::from(&request.payload[..]);
            payload.put_u64(number);
            Ok(Reply { payload: payload.freeze(), of: Some(request.timestamp), ..Reply::default() })
        }
    };
    let listener = TcpListener::bind(args.listen).await?;
    tokio::select! {
        ended = serve(infer, server, listener, std::future::pending()) => Ok(ended?),
        _ = ended => Ok(()),
    }
}
