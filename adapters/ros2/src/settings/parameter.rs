//! The table of the node's parameters. The node reads, describes, changes and refuses parameters by
//! it, and the book prints it.

use std::fmt;
use std::time::Duration;

use fuseline_deadline::{Hazard, Parameters};

use crate::names::check_type;
use crate::parameters::{Value, ValueOrigin};
use crate::settings::clouds::is_server;
use crate::settings::{FLOAT64, Middleware, ODOMETRY, PolicyKind};

/// A parameter with its value.
#[derive(Clone, PartialEq, Debug)]
pub struct Parameter {
    /// The parameter's name.
    pub name: String,
    /// The parameter's value.
    pub value: Value,
    /// The parameter's line of the table. Its kind has the bounds that other parameters set.
    pub spec: Spec,
    /// The origin of its value.
    pub origin: ValueOrigin,
}

/// A line of the table.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Spec {
    /// The parameter's name. The name of a parameter that each cloud has begins with `<cloud>.`
    pub name: &'static str,
    /// The values that it may have.
    pub kind: Kind,
    /// The value if none is given.
    pub preset: Preset,
    /// `true` if it may be changed while the node runs.
    pub at_run_time: bool,
    /// The parameter's purpose.
    pub about: &'static str,
}

/// The values that a parameter may have.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Kind {
    /// `true` or `false`.
    Flag,
    /// A whole number from the first to the second.
    Integer(i64, i64),
    /// A time above 0.
    Seconds,
    /// A time, or 0. The text says what 0 means.
    SecondsOr(&'static str),
    /// A time up to `greatest_deadline`.
    Deadline,
    /// A time up to `greatest_deadline`, or 0 for the node's deadline.
    OwnDeadline,
    /// A number of at least 0.
    Figure,
    /// One of these words.
    Words(&'static [&'static str]),
    /// `dds`, or `zenoh` if that is built in.
    Middleware,
    /// The name of a message's type.
    Type,
    /// A topic, a file or other text.
    Text,
    /// The URL of a server.
    Server,
    /// A list of names.
    Names,
}

/// A parameter's value if none is given.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Preset {
    /// `true` or `false`.
    Flag(bool),
    /// A whole number.
    Integer(i64),
    /// A number with a point.
    Double(f64),
    /// A text.
    Text(&'static str),
    /// An empty list.
    Nothing,
    /// The value of another parameter, or a value that depends on several. The text describes it.
    Other(&'static str),
}

/// In the order in which they are read.
#[rustfmt::skip]
pub const TABLE: &[Spec] = &[
    fixed("middleware", Kind::Middleware, Preset::Text(Middleware::Dds.name()), "The middleware of the node's topics"),
    fixed("input.type", Kind::Type, GIVEN, "The type of the messages"),
    fixed("input.key", KEYS, HEADER, KEY),
    fixed("input.key_offset", OFFSET, Preset::Integer(0), KEY_OFFSET),
    fixed("input.topic", Kind::Text, Preset::Text("input"), "The topic of messages"),
    fixed("input.silence", Kind::SecondsOr("seconds, at most 1e9, or 0 for ten usual gaps between inputs"), Preset::Double(0.0),
        "The seconds without an input after which diagnostics warn; 0 for ten usual gaps, and 10 s for the first input"),
    fixed("output.type", Kind::Type, GIVEN, "The type of the results"),
    fixed("output.key", KEYS, HEADER, KEY),
    fixed("output.key_offset", OFFSET, Preset::Integer(0), KEY_OFFSET),
    fixed("output.topic", Kind::Text, Preset::Text("output"), "The topic of outputs"),
    fixed("window", Kind::Integer(1, 1024), Preset::Integer(16),
        "The number of messages that may be open at once; further ones are refused (F1)"),
    fixed("commit", Kind::Words(&["eager", "patient", "progressive"]), Preset::Text("eager"),
        "The commit rule, which says when the best available result is sent (F6, F9)"),
    fixed("output.revisions_topic", Kind::Text, Preset::Other("`<output>/revisions`"),
        "The topic of results that better ones may follow; used under progressive"),
    fixed("timers", Kind::Words(&["kernel", "tokio"]), Preset::Text(if cfg!(target_os = "linux") { "kernel" } else { "tokio" }),
        "The timers that wake the node at a due instant; tokio's have a granularity of 1 ms"),
    fixed("realtime", Kind::Integer(0, 99), Preset::Integer(0),
        "The thread's priority under SCHED_FIFO, with memory locked; 0 for neither"),
    fixed("lifecycle", Kind::Flag, Preset::Flag(false),
        "If true, the node starts unconfigured and waits for a lifecycle manager"),
    fixed("greatest_deadline", Kind::Seconds, Preset::Double(60.0),
        "The longest deadline that is accepted, also from the topic, in seconds"),
    changeable("deadline", Kind::Deadline, Preset::Double(0.5),
        "The deadline of a request, in seconds"),
    fixed("deadline_topic", Kind::Text, Preset::Text(""),
        "The topic that changes the deadline; empty for none"),
    fixed("origin", Kind::Text, Preset::Text(""),
        "The stream that messages come from, in traces and requests; the input's topic if it is empty"),
    fixed("within", Kind::SecondsOr("seconds, at most 1e9, or 0 for no end-to-end deadline"), Preset::Double(0.0),
        "The end-to-end deadline of the pipeline, from a message's acceptance, in seconds; 0 for none"),
    fixed("reserve", Kind::SecondsOr("seconds, at most 1e9 and less than within, or 0 for nothing"), Preset::Double(0.0),
        "The part of within that is kept for the nodes downstream, in seconds"),
    fixed("policy", Kind::Words(&PolicyKind::NAMES), Preset::Text(PolicyKind::Set.as_str()),
        "The policy that chooses deadlines, up to the one that is set"),
    fixed("policy.rate", Kind::Figure, Preset::Double(0.0),
        "Messages a second, or 0 if unknown; a policy with which the node cannot keep up is refused"),
    fixed("policy.local_response", Kind::Figure, Preset::Double(VEHICLE.local_response.least.as_secs_f64()),
        "Local's least response, in seconds"),
    fixed("policy.local_response_most", Kind::Figure, Preset::Other("`policy.local_response`"),
        "Local's greatest response, in seconds"),
    fixed("policy.deceleration", Kind::Figure, Preset::Double(VEHICLE.deceleration.least.0), "The deceleration of full braking, in m/s²"),
    fixed("policy.brake_delay", Kind::Figure, Preset::Double(VEHICLE.brake_delay.least.as_secs_f64()),
        "The time until the brakes act, in seconds"),
    fixed("policy.margin", Kind::Figure, Preset::Double(VEHICLE.margin.0),
        "The distance to keep from an obstacle, in metres"),
    fixed("policy.lateness", Kind::Figure, Preset::Double(VEHICLE.lateness.as_secs_f64()),
        "The greatest lateness of an output, in seconds"),
    fixed("policy.range_local", Kind::Figure, Preset::Double(Hazard::DEFAULT.range_local.least.0),
        "The distance that local sees, in metres"),
    fixed("policy.range_cloud", Kind::Figure, Preset::Double(Hazard::DEFAULT.range_cloud.least.0),
        "The distance that clouds see, in metres"),
    fixed("policy.accuracy_local", Kind::Figure, Preset::Double(42.0),
        "Local's accuracy, in percent; the AP of the paper's model"),
    fixed("policy.accuracy_cloud", Kind::Figure, Preset::Double(58.0),
        "The clouds' accuracy, in percent; the AP of the paper's model"),
    fixed("policy.price_per_ms", Kind::Figure, Preset::Double(0.01),
        "The price of a millisecond of waiting, in percent of accuracy; chosen by us"),
    fixed("policy.probe_every", Kind::Integer(1, 64), Preset::Integer(16),
        "One message in this many measures how long a cloud takes"),
    fixed("policy.speed_type", Kind::Words(&[ODOMETRY, FLOAT64]), Preset::Text(ODOMETRY),
        "The type of the speed's topic"),
    fixed("policy.speed_topic", Kind::Text, Preset::Text(""),
        "The topic of the speed in m/s, which guard and guarded need; empty for none"),
    fixed("policy.speed_age", Kind::Seconds, Preset::Double(0.5),
        "The time for which a speed is valid, in seconds; afterwards the speed is unknown"),
    fixed("local.middleware", Kind::Middleware, MIDDLEWARE, "The middleware of local's topics"),
    fixed("local.in_flight", Kind::Integer(1, 1024), Preset::Integer(4),
        "The number of messages that local may have at once"),
    fixed("local.waiting", Kind::Integer(0, 1024), Preset::Other("`window`"),
        "The number of further messages that may wait for local; beyond that the oldest is given up (D17)"),
    changeable("local.deadline", Kind::Deadline, Preset::Double(1.0),
        "Local's deadline, in seconds (F1); a later result counts as lost"),
    fixed("local.input_topic", Kind::Text, Preset::Text("local/input"), INPUT),
    fixed("local.output_topic", Kind::Text, Preset::Text("local/output"), OUTPUT),
    fixed("clouds", Kind::Names, Preset::Nothing, "The clouds' names, up to 15"),
    fixed("<cloud>.priority", Kind::Integer(1, 65_535), Preset::Other("its place in `clouds`"),
        "The greater wins"),
    changeable("<cloud>.deadline", Kind::OwnDeadline, Preset::Double(0.0),
        "The deadline of the cloud's requests, in seconds; 0 for the node's deadline"),
    changeable("<cloud>.enabled", Kind::Flag, Preset::Flag(true), "If false, the cloud gets no requests"),
    fixed("<cloud>.in_flight", Kind::Integer(1, 1024), Preset::Integer(8),
        "The number of requests that may be under way"),
    fixed("<cloud>.limit", Kind::Integer(1, i64::MAX), Preset::Other("`policy.rate` × deadline, else `in_flight` (A15)"),
        "The gate shuts when this many requests wait (F2g)"),
    fixed("<cloud>.resume", Kind::Integer(0, i64::MAX), Preset::Integer(0),
        "The shut gate opens when this many or fewer wait; less than limit"),
    fixed("<cloud>.linger", Kind::SecondsOr("seconds, at most 1e9, or 0"), Preset::Double(0.0),
        "The time for which a request may continue after its due instant, in seconds, so that the policy learns how long it takes"),
    fixed("<cloud>.grpc.url", Kind::Server, Preset::Text(""),
        "The URL of the cloud's gRPC server, of fuseline.v1.Infer; empty if it has topics"),
    fixed("<cloud>.grpc.ca", Kind::Text, Preset::Text(""),
        "The file of the CA's certificate; https needs it"),
    fixed("<cloud>.grpc.certificate", Kind::Text, Preset::Text(""), "The file of the node's certificate"),
    fixed("<cloud>.grpc.key", Kind::Text, Preset::Text(""), "The file of the node's key"),
    fixed("<cloud>.grpc.token_file", Kind::Text, Preset::Text(""),
        "The file of the node's token; over http only to this computer"),
    fixed("<cloud>.grpc.server_name", Kind::Text, Preset::Text(""),
        "The name for which the server's certificate must be valid"),
    fixed("<cloud>.middleware", Kind::Middleware, MIDDLEWARE, "The middleware of the cloud's topics"),
    fixed("<cloud>.input_topic", Kind::Text, Preset::Other("`<cloud>/input`"), INPUT),
    fixed("<cloud>.output_topic", Kind::Text, Preset::Other("`<cloud>/output`"), OUTPUT),
    fixed("<cloud>.hints", Kind::Text, Preset::Text(""),
        "The topic on which its late results are published; empty for none"),
    fixed("trace.file", Kind::Text, Preset::Text(""),
        "The file to record a trace in; empty for none"),
    fixed("trace.mcap", Kind::Text, Preset::Text(""),
        "The file to record a trace in, as MCAP; empty for none"),
    fixed("domain_id", Kind::Integer(0, 232), Preset::Integer(0), "The domain"),
    fixed("localhost_only", Kind::Flag, Preset::Flag(false),
        "If true, DDS is used only on this computer"),
    fixed("diagnostics.period", Kind::Seconds, Preset::Double(1.0),
        "The period of diagnostics, in seconds"),
    changeable("use_sim_time", Kind::Flag, Preset::Flag(false),
        "If true, the stamps of the node's own messages follow /clock"),
];

/// The prefix of a parameter that each cloud has.
const CLOUD: &str = "<cloud>";
/// The beginning of the parameters of quality of service.
pub(super) const QOS: &str = "qos_overrides";

/// The longest time that a parameter may have.
const LONGEST: Duration = Duration::from_secs(1_000_000_000);
const GIVEN: Preset = Preset::Other("must be given");
const HEADER: Preset = Preset::Text("header");
const VEHICLE: Parameters = Parameters::DEFAULT;
const MIDDLEWARE: Preset = Preset::Other("`middleware`");
const KEYS: Kind = Kind::Words(&["header", "uint32", "int32", "uint64", "int64"]);
const KEY: &str = "The part of a message that matches it to an input; the default works only for types known to have a header";
const OFFSET: Kind = Kind::Integer(0, 65_528);
const KEY_OFFSET: &str = "The offset of an integer key, in bytes after the encapsulation header";
const INPUT: &str = "The topic on which it gets messages";
const OUTPUT: &str = "The topic on which it sends results";

const fn fixed(name: &'static str, kind: Kind, preset: Preset, about: &'static str) -> Spec {
    Spec { name, kind, preset, at_run_time: false, about }
}

const fn changeable(name: &'static str, kind: Kind, preset: Preset, about: &'static str) -> Spec {
    Spec { at_run_time: true, ..fixed(name, kind, preset, about) }
}

/// Returns a number of seconds as a deadline, or `None` if it is not valid: a deadline is more than
/// 0 when rounded to nanoseconds, and at most 10⁹ seconds.
fn seconds(seconds: f64) -> Option<Duration> {
    let time = Duration::try_from_secs_f64(seconds).ok()?;
    (time > Duration::ZERO && time <= LONGEST).then_some(time)
}

/// Returns none for a time of 0, which stands for another parameter's value or for no time.
pub(super) fn none_if_zero(time: Duration) -> Option<Duration> {
    Some(time).filter(|time| !time.is_zero())
}

/// Returns the line of a parameter, by its own name or that of a cloud's.
pub(super) fn spec(name: &str) -> Option<&'static Spec> {
    let part = name.split_once('.').map(|(_, part)| part);
    let of_cloud = |spec: &&Spec| part.is_some_and(|part| is_part(spec.name, part));
    let is_it = |spec: &&Spec| spec.name == name;
    TABLE.iter().find(is_it).or_else(|| TABLE.iter().find(of_cloud))
}

/// Returns `true` if `<cloud>.<part>` is a parameter of clouds.
pub(super) fn is_of_a_cloud(part: &str) -> bool {
    TABLE.iter().any(|spec| is_part(spec.name, part))
}

/// Returns `true` if the node's own parameters begin with this.
pub(super) fn is_reserved(first: &str) -> bool {
    first == QOS || TABLE.iter().any(|spec| spec.name.split('.').next() == Some(first))
}

fn is_part(name: &str, part: &str) -> bool {
    name.strip_prefix(CLOUD).and_then(|rest| rest.strip_prefix('.')) == Some(part)
}

impl Kind {
    /// Returns `true` if a parameter of this kind may have the value. No deadline is longer than
    /// `greatest`.
    pub(super) fn accepts(self, value: &Value, greatest: Duration) -> bool {
        match (self, value) {
            (Self::Flag, Value::Bool(_))
            | (Self::Text, Value::String(_))
            | (Self::Names, Value::Strings(_)) => true,
            (Self::Integer(least, most), Value::Integer(it)) => (least..=most).contains(it),
            (Self::Words(words), Value::String(word)) => words.contains(&&**word),
            (Self::Middleware, Value::String(word)) => {
                word == Middleware::Dds.name()
                    || (word == Middleware::Zenoh.name() && cfg!(feature = "zenoh"))
            }
            (Self::Type, Value::String(name)) => check_type(name).is_ok(),
            (Self::Server, Value::String(url)) => url.is_empty() || is_server(url),
            (Self::Figure, _) => value.number().is_some_and(|it| it.is_finite() && it >= 0.0),
            (_, _) => self.time(value, greatest).is_some(),
        }
    }

    /// Returns the value as a time, if this is a kind of time that accepts it.
    pub(crate) fn time(self, value: &Value, greatest: Duration) -> Option<Duration> {
        let most = self.longest(greatest)?;
        match (self, value.number()?) {
            (Self::SecondsOr(_) | Self::OwnDeadline, 0.0) => Some(Duration::ZERO),
            (_, number) => seconds(number).filter(|time| *time <= most),
        }
    }

    /// Returns the longest time that is accepted; none if this is no kind of time.
    pub(crate) const fn longest(self, greatest: Duration) -> Option<Duration> {
        match self {
            Self::Seconds | Self::SecondsOr(_) => Some(LONGEST),
            Self::Deadline | Self::OwnDeadline => Some(greatest),
            _ => None,
        }
    }

    /// Describes the values that a parameter of this kind accepts, for an error.
    pub(crate) fn expected(self, greatest: Duration) -> String {
        match self {
            Self::Flag => "true or false".to_owned(),
            Self::Integer(least, i64::MAX) => format!("an integer of at least {least}"),
            Self::Integer(least, most) => format!("an integer from {least} to {most}"),
            Self::Seconds => "seconds, more than 0 and at most 1e9".to_owned(),
            Self::SecondsOr(words) => words.to_owned(),
            Self::Deadline => format!(
                "seconds, more than 0 and at most greatest_deadline ({})",
                greatest.as_secs_f64()
            ),
            Self::OwnDeadline => {
                format!("{}, or 0 for deadline", Self::Deadline.expected(greatest))
            }
            Self::Figure => "a number of at least 0".to_owned(),
            Self::Words([rest @ .., last]) if !rest.is_empty() => {
                format!("{} or {last}", rest.join(", "))
            }
            Self::Words(words) => words.concat(),
            Self::Middleware if cfg!(feature = "zenoh") => "dds or zenoh".to_owned(),
            Self::Middleware => "dds; zenoh needs a build with --features zenoh".to_owned(),
            Self::Type => "a type such as sensor_msgs/msg/Image".to_owned(),
            Self::Text => "a string, in quotes if it looks like something else".to_owned(),
            Self::Server => "http://host:port or https://host:port".to_owned(),
            Self::Names => "a list of names such as [west, east]".to_owned(),
        }
    }
}

impl Preset {
    /// Returns the value; none if it depends on more.
    pub(super) fn value(self) -> Option<Value> {
        Some(match self {
            Self::Flag(flag) => Value::Bool(flag),
            Self::Integer(integer) => Value::Integer(integer),
            Self::Double(double) => Value::Double(double),
            Self::Text(text) => Value::String(text.to_owned()),
            Self::Nothing => Value::Strings(Vec::new()),
            Self::Other(_) => return None,
        })
    }
}

/// A line of the book's table.
impl fmt::Display for Spec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let star = if self.at_run_time { " *" } else { "" };
        let default = match (self.preset, self.preset.value()) {
            (Preset::Other(words), _) => words.to_owned(),
            (Preset::Text("") | Preset::Nothing, _) => String::new(),
            (Preset::Text(text), _) => format!("`{text}`"),
            (_, value) => value.map(|value| format!("`{value}`")).unwrap_or_default(),
        };
        let values = match self.kind {
            Kind::Words(words) => format!(": `{}`", words.join("`, `")),
            Kind::Middleware => format!(": `{}`, `{}`", Middleware::Dds, Middleware::Zenoh),
            Kind::Integer(least, i64::MAX) => format!(": {least} or more"),
            Kind::Integer(least, most) => format!(": {least} to {most}"),
            _ => String::new(),
        };
        write!(f, "| `{}`{star} | {default} | {}{values} |", self.name, self.about)
    }
}
