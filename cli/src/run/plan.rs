//! The plan of a run: its checked options, with models and drives loaded. Every mistake that can be
//! refused is refused here.

use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::ValueEnum;
use fuseline_tokio::Commit;
use thiserror::Error;

use crate::duration::{SHORTEST, duration};
use crate::emulation::Emulation;
use crate::fault::Fault;
use crate::input::is_standard;
use crate::judging::AcceptOption;
use crate::output::{self, Output, Overwrite};
use crate::report::PAGE;
use crate::run::cloud::{self, CloudAddress, CloudOptions, CloudsError, NamedValue, RemoteServer};
use crate::run::config::{CloudFile, CloudFileError};
use crate::run::served::Served;
use fuseline_evaluation::link::{LinkArgs, LinkWidth, RecordedLink};
use fuseline_evaluation::models::Model;

/// The default name of the trace.
pub(crate) const TRACE: &str = "fuseline-trace.jsonl";
/// The greatest number of messages of a run. It is bounded because each message is stored for the
/// policies.
const MESSAGES: u64 = 1_000_000;

#[derive(clap::Args)]
#[command(after_help = "\
Local and the clouds are emulated. They take the runtimes that the paper measured, up to 5 % more or
less by the seed, and replies take the round trips of a recorded drive in addition. Requests and replies
are real gRPC on 127.0.0.1, and timers and the operator run in real time. So a seed repeats the models
and the networks, but not every nanosecond. The trace replays exactly.

Built-in drives: cicv5g/{arterial_n78_v80, rural_n8_v0, rural_n8_v10, strong_to_weak_n8_v30,
urban_n78_v40, weak_to_strong_n8_v50} and vnperf/{downtown, highway}:{verizon, sprint, wifi}. Others are
CSV files with columns sent_ms or second, and rtt_ms or NETWORK_rtt_ms; -1 means no network, and
messages then wait for it. A drive that is over starts again.

Examples:
  fuseline run --for 10s --commit patient
  fuseline run --report --open
  fuseline run --drive west=vnperf/downtown:verizon --start west=300s
  fuseline run --cloud name=a,priority=1,model=DINO-SWIN-Small,drive=my.csv,start=5s
  fuseline run --cloud name=a,priority=1,model=my-detector,runtime=45ms,ap=52,drive=my.csv
  fuseline run --cloud name=b,priority=2,model=DINO-SWIN-Tiny,url=http://10.0.0.2:50051
  fuseline run --config fuseline.toml")]
pub(crate) struct Args {
    /// The time that the camera runs, at most a day.
    #[arg(long = "for", value_name = "TIME", default_value = "30s", value_parser = span, allow_hyphen_values = true,
        alias = "seconds")]
    span: Duration,
    /// The number of frames that the camera takes each second, 0.1 to 1000.
    #[arg(long, value_name = "HZ", default_value = "10", value_parser = rate,
        allow_negative_numbers = true)]
    rate: f64,
    /// The longest time that a cloud may take: whole milliseconds, 1ms to 1m.
    #[arg(long, value_name = "TIME", default_value = "500ms", value_parser = deadline,
        allow_hyphen_values = true)]
    deadline: u64,
    /// Chooses the deadline of each request, up to --deadline.
    #[arg(long, value_enum, default_value = "expected")]
    policy: DeadlinePolicy,
    /// The price of a millisecond of waiting, in points of AP, for --policy expected: 0 to 1.
    #[arg(long, value_name = "AP", default_value = "0.01", value_parser = price,
        allow_negative_numbers = true)]
    price_per_ms: f64,
    /// The commit rule, which says when results are forwarded.
    #[arg(long, value_enum, default_value = "eager")]
    commit: CommitRule,
    /// The number of messages that may be open at once, 1 to 1024.
    #[arg(long, value_name = "N", default_value = "16",
        allow_negative_numbers = true,
        value_parser = clap::value_parser!(u16).range(1..=1024))]
    window: u16,
    /// The seed of the emulated runtimes' spread.
    #[arg(long, value_name = "N", default_value = "1")]
    seed: u64,
    /// The model on board: NAME@orin or NAME@a100. Add ,runtime=TIME and ,ap=AP to replace the
    /// paper's figures, or to describe a model of your own.
    #[arg(long, value_name = "MODEL", default_value = "DETR-ResNet-50@orin")]
    local: Model,
    /// The number of messages that local computes at once, 1 to 1024.
    #[arg(long, value_name = "N", default_value = "4", value_parser = workers,
        allow_negative_numbers = true)]
    workers: NonZero<usize>,
    /// The number of calls to one cloud that may be under way at once, 1 to 1024; further requests
    /// wait.
    #[arg(long, value_name = "N", default_value = "8", value_parser = workers,
        allow_negative_numbers = true)]
    calls: NonZero<usize>,
    /// A cloud, in place of the two default ones; repeatable. Keys: name, priority, and model,
    /// runtime, ap, drive and start for an emulated cloud, or url, ca, cert, key and token (the
    /// last four are files) for a server elsewhere. A model that is not in the paper needs its
    /// runtime; ap is its box AP, 0 to 100.
    #[arg(long = "cloud", value_name = "KEY=VALUE,…", default_values = cloud::DEFAULTS)]
    clouds: Vec<CloudOptions>,
    /// Read the clouds from a TOML file: a table [[cloud]] for each, with the keys of --cloud.
    /// Paths in it are relative to the current folder.
    #[arg(long, value_name = "FILE", conflicts_with = "clouds")]
    config: Option<PathBuf>,
    /// Another drive for a cloud; repeatable.
    #[arg(long = "drive", value_name = "CLOUD=DRIVE")]
    drives: Vec<NamedValue<String>>,
    /// The time of the drive at which a cloud begins; repeatable.
    #[arg(long = "start", value_name = "CLOUD=TIME")]
    starts: Vec<NamedValue<Duration>>,
    #[command(flatten)]
    link: LinkArgs,
    /// The trace's file, written from the start of the run [default: fuseline-trace.jsonl, or
    /// fuseline-trace-2.jsonl and so on if that exists].
    #[arg(long, value_name = "FILE")]
    pub(crate) trace: Option<PathBuf>,
    /// Also make the trace's page, as fuseline report does, and print where it is.
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    #[expect(clippy::option_option, reason = "not wanted, wanted, and wanted by a name")]
    report: Option<Option<PathBuf>>,
    #[command(flatten)]
    pub(crate) overwrite: Overwrite,
    #[command(flatten)]
    pub(crate) accept: AcceptOption,
    #[arg(long, hide = true)]
    require_clouds: bool,
    /// Open the page in a browser.
    #[arg(long, requires = "report")]
    open: bool,
    /// Print the report as one JSON object.
    #[arg(long)]
    pub(crate) json: bool,
}

/// The policy that chooses deadlines.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub(crate) enum DeadlinePolicy {
    /// Waits as long as it is worth it, judged by the last 32 calls to each cloud, and no longer
    /// than local takes while a cloud is gone. Late calls run on, so that their ends are seen.
    Expected,
    /// Always uses --deadline.
    Constant,
}

/// The commit rule (F6).
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
enum CommitRule {
    /// Forwards the best result when the first cloud's timer fires.
    Eager,
    /// Forwards the best result when nothing better can come.
    Patient,
    /// Forwards each better result at once.
    Progressive,
}

/// The plan of a run.
pub(crate) struct RunPlan {
    pub(crate) span: Duration,
    /// The number of frames per second.
    pub(crate) rate: f64,
    pub(crate) period: Duration,
    pub(crate) frames: u64,
    /// The longest deadline.
    pub(crate) deadline_ms: u64,
    pub(crate) policy: DeadlinePolicy,
    /// Points of AP for a millisecond of waiting.
    pub(crate) price_per_ms: f64,
    pub(crate) commit: Commit,
    pub(crate) window: u16,
    pub(crate) seed: u64,
    pub(crate) local: Model,
    pub(crate) workers: usize,
    /// The number of calls to one cloud that may be under way at once.
    pub(crate) calls: usize,
    /// The clouds, in the order of the options.
    pub(crate) clouds: Vec<CloudPlan>,
    /// The link that all clouds share.
    pub(crate) link: LinkWidth,
    pub(crate) trace: PathBuf,
    /// The file of the trace's page, if one is wanted.
    pub(crate) page: Option<Output>,
    /// `true` if it is to be opened in a browser.
    pub(crate) open: bool,
    /// The file that the clouds come from.
    file: Option<CloudFile>,
}

/// One cloud of a run.
pub(crate) struct CloudPlan {
    pub(crate) name: String,
    pub(crate) priority: u16,
    /// The model that it serves, as far as that is known.
    pub(crate) served: Served,
    pub(crate) server: CloudServer,
}

/// The server that answers a cloud's requests.
pub(crate) enum CloudServer {
    /// This process.
    Emulated(Emulation),
    /// A server elsewhere.
    Remote(RemoteServer),
}

/// The reason why options do not make a run.
#[derive(Debug, Error)]
pub(crate) enum PlanError {
    #[error("{}{source}", at(.place.as_deref()))]
    Clouds { place: Option<String>, source: CloudsError },
    #[error(transparent)]
    File(#[from] CloudFileError),
    #[error("{frames} frames are too many; choose --for and --rate for at most {MESSAGES}")]
    Frames { frames: u64 },
    #[error("--report={0}: that is the trace or standard output; give the page a name of its own")]
    Page(String),
    #[error(
        "--require-clouds no longer exists: a cloud that answers nothing in time leaves the verdict in doubt (exit \
         code 3); leave it out"
    )]
    RequireClouds,
    #[error("--trace -: a trace is read again once it is written; name a file")]
    Stdout,
}

impl From<PlanError> for Fault {
    fn from(error: PlanError) -> Self {
        Self::own(error)
    }
}

impl RunPlan {
    /// Checks the options and loads the drives.
    ///
    /// # Errors
    /// Returns the first mistake.
    pub(crate) fn new(args: &Args) -> Result<Self, Fault> {
        if args.require_clouds {
            return Err(PlanError::RequireClouds.into());
        }
        let period = Duration::from_secs_f64(args.rate.recip());
        // A number of frames that is whole except for rounding counts as whole.
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "positive and far below 2^53"
        )]
        let frames = (args.span.as_secs_f64() * args.rate - 1e-6).ceil() as u64;
        if frames > MESSAGES {
            return Err(PlanError::Frames { frames }.into());
        }
        let file = args.config.as_deref().map(CloudFile::read);
        let file = file.transpose().map_err(PlanError::from)?;
        let mistaken = |source: CloudsError| {
            let is_own = |key: &str| key == "name" || key == "priority";
            let place = source.at_fault();
            let place = place.filter(|(cloud, key)| is_own(key) || !args.changes(cloud));
            let place = place.and_then(|(cloud, key)| file.as_ref()?.place(cloud, key));
            PlanError::Clouds { place: place.map(ToOwned::to_owned), source }
        };
        let mut wanted = file.as_ref().map_or_else(|| &args.clouds, |file| &file.clouds).clone();
        cloud::adjust(&mut wanted, &args.drives, &args.starts).map_err(mistaken)?;
        let trace = trace(args, &wanted)?;
        let page = args.report.as_ref();
        let page = page.map(|path| page_of(path.as_deref(), &trace, &wanted, args.overwrite));
        let page = page.transpose()?;
        let clouds = wanted.into_iter().map(|cloud| CloudPlan::new(cloud, args.seed));
        Ok(Self {
            span: args.span,
            rate: args.rate,
            period,
            frames,
            deadline_ms: args.deadline,
            policy: args.policy,
            price_per_ms: args.price_per_ms,
            commit: match args.commit {
                CommitRule::Eager => Commit::Eager,
                CommitRule::Patient => Commit::Patient,
                CommitRule::Progressive => Commit::Progressive,
            },
            window: args.window,
            seed: args.seed,
            local: args.local.clone(),
            workers: args.workers.get(),
            calls: args.calls.get(),
            clouds: clouds.collect::<Result<_, CloudsError>>().map_err(mistaken)?,
            link: args.link.width(),
            trace,
            page,
            open: args.open,
            file,
        })
    }

    /// Returns the place of a cloud's key in the file of clouds, if the cloud comes from one.
    pub(crate) fn place(&self, cloud: &str, key: &str) -> Option<String> {
        self.file.as_ref()?.place(cloud, key).map(ToOwned::to_owned)
    }

    /// Returns `true` if clouds share a link that has a rate.
    pub(crate) fn is_linked(&self) -> bool {
        let drive = self.link_drive().map(|cloud| (&cloud.drive, cloud.start));
        RecordedLink { width: self.link, drive }.is_limited()
    }

    /// Returns the drive whose recording has the link's rates, which is the first cloud's with such
    /// rates.
    pub(crate) fn link_drive(&self) -> Option<&Emulation> {
        self.clouds.iter().filter_map(CloudPlan::emulation).find(|cloud| cloud.drive.has_rates())
    }

    /// Returns the longest time that a cloud may take.
    pub(crate) const fn deadline(&self) -> Duration {
        Duration::from_millis(self.deadline_ms)
    }
}

impl Args {
    /// Returns `true` if an option changes the drive or the start of this cloud.
    fn changes(&self, cloud: &str) -> bool {
        self.drives.iter().any(|drive| drive.cloud == cloud)
            || self.starts.iter().any(|start| start.cloud == cloud)
    }
}

impl DeadlinePolicy {
    /// Returns its name on the command line.
    pub(crate) const fn as_str(self) -> &'static str {
        match self {
            Self::Expected => "expected",
            Self::Constant => "constant",
        }
    }
}

impl CloudPlan {
    fn new(wanted: CloudOptions, seed: u64) -> Result<Self, CloudsError> {
        let CloudOptions { name, priority, address } = wanted;
        let (known, server) = match address {
            CloudAddress::Remote { model, remote } => {
                (Served::reported(model.as_ref()), CloudServer::Remote(remote))
            }
            CloudAddress::Emulated { model, drive, start } => {
                let emulation = Emulation::new(model, &drive, start, seed)
                    .map_err(|source| CloudsError::Emulation { cloud: name.clone(), source })?;
                (Served::from(&emulation), CloudServer::Emulated(emulation))
            }
        };
        Ok(Self { name, priority, served: known, server })
    }

    /// Returns its emulation, if it is one.
    pub(crate) const fn emulation(&self) -> Option<&Emulation> {
        match &self.server {
            CloudServer::Emulated(emulation) => Some(emulation),
            CloudServer::Remote(_) => None,
        }
    }
}

/// Returns a place, if it is known, with what separates it from a message.
pub(crate) fn at(place: Option<&str>) -> String {
    place.map(|place| format!("{place}: ")).unwrap_or_default()
}

/// Returns the file for the trace. It must not be a file that the clouds' options name.
fn trace(args: &Args, clouds: &[CloudOptions]) -> Result<PathBuf, Fault> {
    let Some(path) = args.trace.as_deref() else { return Ok(TRACE.into()) };
    if is_standard(path) {
        return Err(PlanError::Stdout.into());
    }
    let read = clouds.iter().flat_map(CloudOptions::files);
    let read: Vec<&Path> = read.chain(args.config.as_deref()).collect();
    output::file(path, &read, args.overwrite)?;
    Ok(path.to_owned())
}

/// Returns the page, which is neither the trace nor standard output.
fn page_of(
    path: Option<&Path>,
    trace: &Path,
    clouds: &[CloudOptions],
    overwrite: Overwrite,
) -> Result<Output, Fault> {
    let page = path.unwrap_or(Path::new(PAGE));
    let absolute = [page, trace].map(|path| std::path::absolute(path).ok());
    if is_standard(page) || absolute[0].is_some() && absolute[0] == absolute[1] {
        return Err(PlanError::Page(page.display().to_string()).into());
    }
    let read: Vec<&Path> = clouds.iter().flat_map(CloudOptions::files).chain([trace]).collect();
    Output::or_numbered(path, PAGE, &read, overwrite)
}

/// Reads a time of at most a day.
fn span(text: &str) -> Result<Duration, String> {
    duration(text, "30s", &(SHORTEST..=Duration::from_secs(86_400)))
}

/// Formats whole milliseconds.
fn deadline(text: &str) -> Result<u64, String> {
    let read = duration(text, "500ms", &(Duration::from_millis(1)..=Duration::from_secs(60)))?;
    let ms = u64::try_from(read.as_millis()).unwrap_or(u64::MAX);
    (Duration::from_millis(ms) == read)
        .then_some(ms)
        .ok_or("it must be whole milliseconds".to_owned())
}

fn rate(text: &str) -> Result<f64, &'static str> {
    let rate = text.parse().ok().filter(|rate| (0.1..=1000.0).contains(rate));
    rate.ok_or("it must be from 0.1 to 1000")
}

fn price(text: &str) -> Result<f64, &'static str> {
    let price = text.parse().ok().filter(|price| (0.0..=1.0).contains(price));
    price.ok_or("it must be from 0 to 1")
}

fn workers(text: &str) -> Result<NonZero<usize>, &'static str> {
    let workers = text.parse().ok().filter(|workers: &NonZero<usize>| workers.get() <= 1024);
    workers.ok_or("it must be from 1 to 1024")
}
