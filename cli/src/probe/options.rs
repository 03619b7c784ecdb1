//! The options of `fuseline probe`.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use fuseline_tokio::grpc;

use crate::duration::{SHORTEST, duration};
use crate::fault::Fault;
use crate::files::{self, FileError};
use crate::output::Overwrite;

#[derive(clap::Args)]
#[command(after_help = "\
The probe sends a request of 33.3 KB 30 times a second, even if replies of 1 KB
are outstanding, so calls overlap. If more than 30 requests are unanswered when
one is due, the probe pauses until all are answered. It records the skipped
slots and does not make up for them. The paper's drive through San Francisco did
the same, and the summary shows its figures beside yours.

The recording is CSV with the columns sent_ms, rtt_ms (-1: the call failed, or a
pause began), queued and utc_ms (milliseconds since 1970). fuseline run takes it
as it is.

Ctrl-C ends the probe: it waits up to 1 s for answers, completes the recording,
draws the plots and prints the summary. Exit code 0 when done, even after
Ctrl-C; 2 if an option or a file cannot be used, or the server does not answer.

Examples:
  fuseline probe --serve --listen 0.0.0.0:50051
  fuseline probe http://10.0.0.2:50051 --for 1m
  fuseline probe https://cloud:50051 --ca ca.pem --token-file secret --for 10m
  fuseline probe http://10.0.0.2:50051 -o pictures
  fuseline probe --plot fuseline-probe.csv -o pictures
  fuseline run --drive west=fuseline-probe.csv")]
pub(crate) struct Args {
    /// The address at which `fuseline probe --serve` listens: <http://HOST:PORT>, or https.
    #[arg(value_name = "URL", required_unless_present_any = ["serve", "plot"],
        conflicts_with_all = ["serve", "plot"])]
    pub(crate) url: Option<String>,
    /// Answer probes instead of probing.
    #[arg(long)]
    pub(crate) serve: bool,
    /// The address and port to listen on; port 0 chooses one.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:50051", requires = "serve")]
    pub(crate) listen: SocketAddr,
    /// The duration of the probe, up to a week [default: until Ctrl-C].
    #[arg(long = "for", value_name = "TIME", value_parser = span, allow_hyphen_values = true)]
    pub(crate) span: Option<Duration>,
    /// Requests a second, 0.1 to 1000.
    #[arg(long, value_name = "HZ", default_value = "30", value_parser = rate,
        allow_negative_numbers = true)]
    pub(crate) rate: f64,
    /// The time after which a call counts as failed: 1s to 10m.
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = give_up,
        allow_hyphen_values = true)]
    pub(crate) give_up: Duration,
    /// The file of the recording, written from the start on [default: fuseline-probe.csv, or
    /// fuseline-probe-2.csv and so on if that exists].
    #[arg(long, value_name = "FILE")]
    pub(crate) csv: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) overwrite: Overwrite,
    /// Write plots to this folder once the probe has ended, as SVG and PNG on light and dark
    /// ground, and a page that holds them: round trips over time and their distribution.
    #[arg(short, long, value_name = "DIR", conflicts_with = "serve")]
    pub(crate) output: Option<PathBuf>,
    /// Measure nothing, but plot this recording, or a network of another drive.
    #[arg(long, value_name = "FILE[:NETWORK]", requires = "output", conflicts_with_all = ["serve", "json"])]
    pub(crate) plot: Option<PathBuf>,
    /// The time that a cloud would compute in addition, up to 1m.
    #[arg(long, value_name = "TIME", default_value = "118.2ms", value_parser = minute,
        allow_hyphen_values = true)]
    pub(crate) runtime: Duration,
    /// The time by which a result would have to be there, up to 1m.
    #[arg(long, value_name = "TIME", default_value = "500ms", value_parser = minute,
        allow_hyphen_values = true)]
    pub(crate) deadline: Duration,
    /// The CA certificates to trust instead of the system's, in PEM.
    #[arg(long, value_name = "FILE", conflicts_with = "serve")]
    pub(crate) ca: Option<PathBuf>,
    /// This side's certificate, in PEM.
    #[arg(long, value_name = "FILE", requires = "key")]
    pub(crate) cert: Option<PathBuf>,
    /// The certificate's private key, in PEM.
    #[arg(long, value_name = "FILE", requires = "cert")]
    pub(crate) key: Option<PathBuf>,
    /// With --serve, the CA certificates that must have signed clients' certificates, in PEM
    /// (mutual TLS).
    #[arg(long, value_name = "FILE", requires_all = ["serve", "cert"])]
    pub(crate) client_ca: Option<PathBuf>,
    /// A file with the bearer token that each call has, or must have; by default the environment's
    /// `FUSELINE_TOKEN`.
    #[arg(long, value_name = "FILE")]
    pub(crate) token_file: Option<PathBuf>,
    /// Print the summary as one JSON object.
    #[arg(long, conflicts_with = "serve")]
    pub(crate) json: bool,
}

impl Args {
    /// Returns the server to measure the way to.
    ///
    /// # Errors
    /// If a file that it is described with is of no use.
    pub(crate) fn remote(&self, url: &str) -> Result<grpc::Remote, Fault> {
        Ok(grpc::Remote {
            ca: self.ca.as_deref().map(files::certificates).transpose()?,
            identity: files::identity(self.cert.as_deref(), self.key.as_deref())?,
            token: self.token()?,
            // A network that is away for a while is what is measured.
            ping_deadline: self.give_up,
            ..grpc::Remote::new(url)
        })
    }

    /// Returns the server of `--serve`, with what it demands of clients.
    ///
    /// # Errors
    /// If a file that it is described with is of no use.
    pub(crate) fn server(&self) -> Result<grpc::Server, Fault> {
        Ok(grpc::Server {
            identity: files::identity(self.cert.as_deref(), self.key.as_deref())?,
            client_ca: self.client_ca.as_deref().map(files::certificates).transpose()?,
            token: self.token()?,
            bounds: grpc::Bounds::default(),
        })
    }

    fn token(&self) -> Result<Option<grpc::Token>, FileError> {
        match &self.token_file {
            Some(file) => files::token(file).map(Some),
            None => files::token_of_environment(),
        }
    }

    pub(crate) fn files(&self) -> Vec<&Path> {
        let all = [&self.ca, &self.cert, &self.key, &self.token_file];
        all.into_iter().flatten().map(PathBuf::as_path).collect()
    }

    /// Returns the number of requests that are due in all.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive and far below 2^53"
    )]
    pub(crate) fn slots(&self) -> Option<u64> {
        // A number that is whole up to rounding counts as whole.
        self.span.map(|span| (span.as_secs_f64() * self.rate - 1e-6).ceil() as u64)
    }

    pub(crate) fn period(&self) -> Duration {
        Duration::from_secs_f64(self.rate.recip())
    }
}

fn span(text: &str) -> Result<Duration, String> {
    duration(text, "60s", &(SHORTEST..=Duration::from_secs(604_800)))
}

fn give_up(text: &str) -> Result<Duration, String> {
    duration(text, "60s", &(Duration::from_secs(1)..=Duration::from_secs(600)))
}

fn rate(text: &str) -> Result<f64, &'static str> {
    let rate = text.parse().ok().filter(|rate| (0.1..=1000.0).contains(rate));
    rate.ok_or("it must be from 0.1 to 1000")
}

fn minute(text: &str) -> Result<Duration, String> {
    duration(text, "500ms", &(Duration::ZERO..=Duration::from_secs(60)))
}
