//! Resolves and checks a node's settings: its arguments, files and environment.

mod budget;
mod cautions;
mod change;
mod clouds;
mod engine;
mod environment;
mod error;
mod middleware;
mod parameter;
mod policy;
mod qos;
mod reader;
mod table;

use std::path::PathBuf;
use std::time::Duration;

use fuseline_engine::Commit;
use fuseline_tokio::Timers;

use crate::arguments::{Arguments, Level};
use crate::key::{IntegerKind, MessageKey, has_header};
use crate::names::NodeName;
use crate::parameters::{Value, ValueOrigin, given};
pub use crate::settings::budget::EndToEndSettings;
pub use crate::settings::change::{Change, ChangeError};
use crate::settings::environment::Environment;
pub use crate::settings::error::{SettingsError, SettingsFlaw};
pub use crate::settings::middleware::Middleware;
use crate::settings::parameter::none_if_zero;
pub use crate::settings::parameter::{Kind, Parameter, Preset, Spec, TABLE};
pub use crate::settings::policy::{DeadlineSettings, PolicyKind, SpeedTopic};
pub use crate::settings::qos::{Qos, Role, Topic};
use crate::settings::reader::ParameterReader;

/// The types of topics that do not depend on parameters.
const FLOAT64: &str = "std_msgs/msg/Float64";
pub(crate) const ODOMETRY: &str = "nav_msgs/msg/Odometry";
const STATUS: &str = "diagnostic_msgs/msg/DiagnosticStatus";
const DIAGNOSTICS: &str = "diagnostic_msgs/msg/DiagnosticArray";

/// A node's settings. All names are full names, and all values have been checked.
#[derive(Clone, PartialEq, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "each is a parameter of its own")]
pub struct Settings {
    /// The node's namespace and name.
    pub node: NodeName,
    /// The middleware of the node's own topics, and of input and output.
    pub middleware: Middleware,
    /// The domain, 0 to 232.
    pub domain: u16,
    /// `true` to use DDS only on this computer. Zenoh's own configuration names its peers.
    pub localhost_only: bool,
    /// The topic of messages.
    pub input: StreamSettings,
    /// The time without an input after which diagnostics warn; `None` for ten usual gaps.
    pub silence: Option<Duration>,
    /// The topic of results.
    pub output: StreamSettings,
    /// The topic of preliminary results under progressive.
    pub revisions: Option<String>,
    /// The greatest number of messages that may be open at once, 1 to 1024.
    pub window: u16,
    /// The commit rule (F6, F9).
    pub commit: Commit,
    /// The timers that wake the node at a due instant.
    pub timers: Timers,
    /// The priority under `SCHED_FIFO` of the thread that serves timers, with memory locked; 0 for
    /// neither.
    pub realtime: u8,
    /// `true` if the node is managed: it starts unconfigured, and services request its transitions.
    pub lifecycle: bool,
    /// The longest deadline that is accepted.
    pub greatest_deadline: Duration,
    /// The deadline of a cloud that has none of its own.
    pub deadline: Duration,
    /// The topic that changes `deadline`, if any.
    pub deadline_topic: Option<String>,
    /// The end-to-end deadline and the origin of messages.
    pub end_to_end: EndToEndSettings,
    /// The policy that chooses deadlines, up to `deadline`.
    pub deadlines: DeadlineSettings,
    /// The computation on this robot.
    pub local: Local,
    /// The clouds, in the order of the parameter `clouds`; up to 15.
    pub clouds: Vec<Cloud>,
    /// The topic of the statuses, one for each message.
    pub status: String,
    /// The topic of `/diagnostics`.
    pub diagnostics: String,
    /// The time from one report of diagnostics to the next.
    pub diagnostics_period: Duration,
    /// The file in which to record a trace, if any.
    pub trace: Option<PathBuf>,
    /// The file in which to record a trace as MCAP, if any.
    pub mcap: Option<PathBuf>,
    /// `true` if the stamps of the node's own messages follow `/clock`.
    pub use_sim_time: bool,
    /// The least severe level that is logged, if one was given.
    pub log_level: Option<Level>,
    /// `true` if logs are also published.
    pub rosout: bool,
    /// All topics, with their quality of service.
    pub topics: Vec<Topic>,
    /// All parameters, with their values.
    pub declared: Vec<Parameter>,
    /// The variables, remapping rules and files that the node does not honour, each in a sentence.
    pub unheeded: Vec<String>,
}

/// The input or the output of the node.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct StreamSettings {
    /// The topic.
    pub topic: String,
    /// The type of the messages, `package/msg/Type`.
    pub type_name: String,
    /// The place of the key in a message, which matches it to an input.
    pub key: MessageKey,
}

/// The computation on this robot (priority 0).
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Local {
    /// The middleware of its topics.
    pub middleware: Middleware,
    /// The topic on which it gets messages.
    pub input: String,
    /// The topic on which it sends results.
    pub output: String,
    /// The time that it may take (F1).
    pub deadline: Duration,
    /// The greatest number of messages that it may have at once, 1 to 1024.
    pub in_flight: u16,
    /// The number of further messages that may wait for it, 0 to 1024.
    pub waiting: u16,
}

/// One cloud.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Cloud {
    /// The cloud's name, which is one part of a ROS name.
    pub name: String,
    /// The cloud's priority, 1 to 65535, different for each cloud. The greater one wins.
    pub priority: u16,
    /// The cloud's deadline; `None` means [`Settings::deadline`].
    pub deadline: Option<Duration>,
    /// `true` if requests are sent to the cloud.
    pub enabled: bool,
    /// The number of waiting requests at which the gate shuts (F2g); at least 1.
    pub limit: u64,
    /// The number of waiting requests at or below which the gate opens again; less than `limit`.
    pub resume: u64,
    /// The greatest number of requests under way, 1 to 1024.
    pub in_flight: u16,
    /// The time that a request may continue after its due instant, so that its policy learns how
    /// long it takes.
    pub linger: Duration,
    /// The topic on which its late results are published, if any.
    pub hints: Option<String>,
    /// The way to reach it.
    pub way: CloudConnection,
}

/// The way to reach a cloud.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum CloudConnection {
    /// Two topics.
    Topics {
        /// The middleware of the topics.
        middleware: Middleware,
        /// The topic on which it gets messages.
        input: String,
        /// The topic on which it sends results.
        output: String,
    },
    /// gRPC, with a server of `fuseline.v1.Infer`.
    Grpc(Grpc),
}

/// A gRPC server, and the node's credentials for it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Grpc {
    /// `https://host:port`, or `http://host:port` without TLS.
    pub url: String,
    /// The file of the CA's certificate; required with `https`.
    pub ca: Option<PathBuf>,
    /// The file of the node's certificate, which is given if `key` is.
    pub certificate: Option<PathBuf>,
    /// The file of the node's key.
    pub key: Option<PathBuf>,
    /// The file of the node's token.
    pub token_file: Option<PathBuf>,
    /// The name for which the server's certificate must be valid, if it is not the URL's host.
    pub server_name: Option<String>,
}

impl Settings {
    /// Resolves the arguments and the files that they name. `environment` looks up a variable.
    ///
    /// Arguments win over files, later ones over earlier ones, and all of them over the
    /// environment. An integer is accepted where a number is expected: ROS 2 refuses it, but
    /// its meaning is clear.
    ///
    /// # Errors
    /// Returns the first mistake, with its place and the remedy.
    ///
    /// ```
    /// use fuseline_ros2::{Arguments, Settings};
    ///
    /// let words = ["--ros-args", "-p", "input.type:=sensor_msgs/msg/Image"];
    /// let more = ["-p", "output.type:=vision_msgs/msg/Detection2DArray", "-p", "clouds:=[west]"];
    /// let arguments = Arguments::parse(words.into_iter().chain(more).map(Into::into))?;
    /// let settings = Settings::from(&arguments, |_variable| None)?;
    /// assert_eq!(settings.clouds[0].name, "west");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn from(
        arguments: &Arguments,
        environment: impl Fn(&str) -> Option<String>,
    ) -> Result<Self, SettingsError> {
        let node = NodeName { namespace: "/".to_owned(), name: "fuseline".to_owned() };
        let node = node.remapped(&arguments.remaps);
        let (mut overrides, mut idle) = given(&arguments.files, &arguments.assignments, &node)?;
        let environment = Environment(environment);
        for from in environment.overrides()? {
            overrides.entry(from.name.clone()).or_insert(from);
        }
        let log_level = log_level(arguments, &node);
        let mut reader = ParameterReader::new(overrides, node.clone(), &arguments.remaps);
        let mut settings = read(&mut reader, node.clone())?;
        idle.extend(reader.apply_rest()?);
        idle.extend(node.idle_rules(&arguments.remaps, &reader.own_names)?);
        settings.topics = reader.topics;
        settings.declared = reader.declared;
        settings.log_level = log_level;
        settings.rosout = arguments.rosout;
        settings.unheeded = environment.cautions(&settings);
        settings.unheeded.extend(idle);
        settings.unheeded.extend(idle_log_levels(arguments, &node));
        settings.check()?;
        Ok(settings)
    }

    /// Returns the topic with this full name.
    ///
    /// # Panics
    /// Panics if the node has no such topic.
    #[must_use]
    pub fn topic(&self, name: &str) -> &Topic {
        let mut topics = self.topics.iter();
        topics
            .find(|topic| topic.name == name)
            .unwrap_or_else(|| panic!("there is no topic {name}"))
    }

    /// Returns the parameter with this name.
    pub(crate) fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.declared.iter().find(|parameter| parameter.name == name)
    }

    /// Returns the origin of a parameter's value.
    fn origin(&self, name: &str) -> ValueOrigin {
        self.parameter(name).map_or(ValueOrigin::Default, |parameter| parameter.origin.clone())
    }
}

/// Reads all parameters except those of quality of service.
fn read(r: &mut ParameterReader, node: NodeName) -> Result<Settings, SettingsError> {
    let middleware = middleware::read(r, "middleware", None)?;
    let input = stream(r, "input", Role::Subscription)?;
    let silence = r.seconds("input.silence")?;
    let output = stream(r, "output", Role::Publisher)?;
    let window = r.integer("window", None)?;
    let commit = r.choice("commit", &Commit::ALL)?;
    let revisions = revisions(r, commit, &output)?;
    let timers = r.choice("timers", &[Timers::Kernel, Timers::Tokio])?;
    let realtime: u8 = r.integer("realtime", None)?;
    let lifecycle = r.flag("lifecycle")?;
    if lifecycle && realtime != 0 {
        let expected = "0 to a managed node, whose next configuration would start its threads with that priority";
        let flaw = SettingsFlaw::Value(Value::Integer(realtime.into()), expected.to_owned());
        return Err(r.flaw("realtime", flaw));
    }
    let greatest_deadline = r.greatest_deadline()?;
    let deadline = r.seconds("deadline")?;
    let deadline_topic = r.topic("deadline_topic", None, FLOAT64, Role::Subscription)?;
    let end_to_end = budget::read(r, &input.topic)?;
    let deadlines = policy::read(r)?;
    let types = [input.type_name.as_str(), output.type_name.as_str()];
    let local = local(r, types, window, middleware)?;
    let clouds = clouds::read(r, types, middleware, (deadlines.rate, deadline))?;
    let (trace, mcap) = (r.path("trace.file")?, r.path("trace.mcap")?);
    let domain = r.integer("domain_id", None)?;
    let localhost_only = r.flag("localhost_only")?;
    let diagnostics_period = r.seconds("diagnostics.period")?;
    let use_sim_time = r.flag("use_sim_time")?;
    Ok(Settings {
        node,
        middleware,
        domain,
        localhost_only,
        input,
        silence: none_if_zero(silence),
        output,
        revisions,
        window,
        commit,
        timers,
        realtime,
        lifecycle,
        greatest_deadline,
        deadline,
        deadline_topic,
        end_to_end,
        deadlines,
        local,
        clouds,
        status: r.fixed_topic("~/status", STATUS)?,
        diagnostics: r.fixed_topic("/diagnostics", DIAGNOSTICS)?,
        diagnostics_period,
        trace,
        mcap,
        use_sim_time,
        log_level: None,
        rosout: true,
        topics: Vec::new(),
        declared: Vec::new(),
        unheeded: Vec::new(),
    })
}

fn stream(
    r: &mut ParameterReader,
    name: &'static str,
    role: Role,
) -> Result<StreamSettings, SettingsError> {
    let of = |part: &str| format!("{name}.{part}");
    if !r.is_given(&of("type")) {
        return Err(SettingsError::Type { name: of("type") });
    }
    let type_name = r.text(&of("type"), None)?;
    let key = key(r, name, &type_name)?;
    let topic = r.named_topic(&of("topic"), None, &type_name, role)?;
    Ok(StreamSettings { topic, type_name, key })
}

/// Returns the topic of preliminary results, beside that of outputs.
fn revisions(
    r: &mut ParameterReader,
    commit: Commit,
    output: &StreamSettings,
) -> Result<Option<String>, SettingsError> {
    let name = "output.revisions_topic";
    if commit == Commit::Progressive {
        let default = format!("{}/revisions", output.topic);
        r.named_topic(name, Some(&default), &output.type_name, Role::Publisher).map(Some)
    } else if r.is_given(name) {
        Err(r.flaw(name, SettingsFlaw::Alone("commit: progressive".to_owned())))
    } else {
        Ok(None)
    }
}

fn key(
    r: &mut ParameterReader,
    stream: &'static str,
    type_name: &str,
) -> Result<MessageKey, SettingsError> {
    let names = [format!("{stream}.key"), format!("{stream}.key_offset")];
    let [key, offset] = [&names[0], &names[1]];
    if !r.is_given(key) && !has_header(type_name) {
        let origin = r.origin(&format!("{stream}.type"));
        let type_name = type_name.to_owned();
        return Err(SettingsError::Key { origin, type_name, name: key.clone() });
    }
    let kinds = [IntegerKind::U32, IntegerKind::I32, IntegerKind::U64, IntegerKind::I64].map(Some);
    let kind = r.choice(key, &[&[None], &kinds[..]].concat())?;
    match kind {
        Some(kind) => Ok(MessageKey::Integer { offset: r.integer(offset, None)?, kind }),
        None if r.is_given(offset) => Err(r.flaw(offset, SettingsFlaw::Offset)),
        None => Ok(MessageKey::Header),
    }
}

fn local(
    r: &mut ParameterReader,
    types: [&str; 2],
    window: u16,
    middleware: Middleware,
) -> Result<Local, SettingsError> {
    let middleware = middleware::read(r, "local.middleware", Some(middleware))?;
    let in_flight = r.integer("local.in_flight", None)?;
    let waiting = r.integer("local.waiting", Some(window.into()))?;
    let deadline = r.seconds("local.deadline")?;
    let [input, output] = topics(r, "local", types)?;
    Ok(Local { middleware, input, output, deadline, in_flight, waiting })
}

/// Returns the two topics of a source.
fn topics(
    r: &mut ParameterReader,
    name: &str,
    types: [&str; 2],
) -> Result<[String; 2], SettingsError> {
    let mut topic = |side: &str, type_name, role| {
        let default = format!("{name}/{side}");
        r.named_topic(&format!("{name}.{side}_topic"), Some(&default), type_name, role)
    };
    let input = topic("input", types[0], Role::Publisher)?;
    Ok([input, topic("output", types[1], Role::Subscription)?])
}

/// Returns the name of the node's logger, which is its only one.
fn logger(node: &NodeName) -> String {
    node.full()[1..].replace('/', ".")
}

/// Returns a warning for each level of a logger that this node does not have.
fn idle_log_levels(arguments: &Arguments, node: &NodeName) -> Vec<String> {
    let own = logger(node);
    let others = arguments.log_levels.iter().filter_map(|(logger, _)| logger.as_ref());
    let others = others.filter(|other| **other != own);
    let warning = |other| {
        format!("--log-level {other}:=…: this node has no logger {other}; its own is {own}")
    };
    others.map(warning).collect()
}

/// Returns the last level for this node's logger, or else for all.
fn log_level(arguments: &Arguments, node: &NodeName) -> Option<Level> {
    let logger = logger(node);
    let levels = || arguments.log_levels.iter().rev();
    let own = levels().find(|(other, _)| other.as_ref() == Some(&logger));
    own.or_else(|| levels().find(|(other, _)| other.is_none())).map(|(_, level)| *level)
}
