//! The clouds' parameters.

use std::net::IpAddr;
use std::time::Duration;

use crate::names::check_token;
use crate::parameters::ValueOrigin;
use crate::settings::parameter::{is_reserved, none_if_zero};
use crate::settings::reader::ParameterReader;
use crate::settings::{
    Cloud, CloudConnection, Grpc, Middleware, Role, SettingsError, SettingsFlaw, middleware, topics,
};

/// The part of the node that `/diagnostics` report beside the sources.
const OWN_REPORT: &str = "fusion";

/// Reads which clouds there are, and then each.
pub(super) fn read(
    r: &mut ParameterReader,
    types: [&str; 2],
    middleware: Middleware,
    pace: (Option<f64>, Duration),
) -> Result<Vec<Cloud>, SettingsError> {
    let names = r.names("clouds")?;
    let listed = r.origin("clouds");
    for (at, cloud) in names.iter().enumerate() {
        let why = if check_token(cloud).is_err() {
            "give a name of letters, digits and single underscores"
        } else if is_reserved(cloud) {
            "the node's own parameters begin with that name; give another name"
        } else if cloud == OWN_REPORT {
            "the node reports itself by that name in /diagnostics; give another name"
        } else if names[..at].contains(cloud) {
            "it is given twice; leave one out"
        } else {
            continue;
        };
        return Err(SettingsError::Cloud { origin: listed, cloud: cloud.clone(), why });
    }
    let mut clouds: Vec<Cloud> = Vec::new();
    for (name, default) in names.into_iter().zip(1..) {
        let parameter = format!("{name}.priority");
        let priority = r.integer(&parameter, Some(default))?;
        if let Some(other) = clouds.iter().find(|other| other.priority == priority) {
            let flaw = SettingsFlaw::Priority(priority, other.name.clone());
            // By default it is the position in the list.
            let given = Some(r.origin(&parameter)).filter(|it| *it != ValueOrigin::Default);
            return Err(SettingsError::Flaw { origin: given.unwrap_or(listed), name, flaw });
        }
        clouds.push(cloud(r, (name, priority), types, middleware, pace)?);
    }
    Ok(clouds)
}

fn cloud(
    r: &mut ParameterReader,
    (name, priority): (String, u16),
    types: [&str; 2],
    middleware: Middleware,
    (rate, node_deadline): (Option<f64>, Duration),
) -> Result<Cloud, SettingsError> {
    let of = |part: &str| format!("{name}.{part}");
    let deadline = r.seconds(&of("deadline"))?;
    let enabled = r.flag(&of("enabled"))?;
    let in_flight: u16 = r.integer(&of("in_flight"), None)?;
    let deadline = none_if_zero(deadline);
    let given = deadline.unwrap_or(node_deadline);
    let answerable = rate.map_or(in_flight.into(), |rate| answerable(rate, given));
    let limit: i64 = r.integer(&of("limit"), Some(answerable))?;
    let resume = r.integer_up_to(&of("resume"), limit - 1, None)?;
    let linger = r.seconds(&of("linger"))?;
    let connection = if let Some(grpc) = grpc(r, &name)? {
        CloudConnection::Grpc(grpc)
    } else {
        let middleware = middleware::read(r, &of("middleware"), Some(middleware))?;
        let [input, output] = topics(r, &name, types)?;
        CloudConnection::Topics { middleware, input, output }
    };
    let hints = hints(r, &name, types[1], &connection, linger)?;
    let limit = limit.unsigned_abs();
    Ok(Cloud {
        name,
        priority,
        deadline,
        enabled,
        limit,
        resume,
        in_flight,
        linger,
        hints,
        way: connection,
    })
}

/// Returns how many messages come within a deadline; what waits behind as many is answered too late
/// (A15).
#[expect(clippy::cast_possible_truncation, reason = "the cast saturates, which is what is wanted")]
fn answerable(rate: f64, deadline: Duration) -> i64 {
    ((rate * deadline.as_secs_f64()) as i64).max(1)
}

/// Returns the topic of its late results, if there is to be one.
fn hints(
    r: &mut ParameterReader,
    cloud: &str,
    type_name: &str,
    connection: &CloudConnection,
    linger: Duration,
) -> Result<Option<String>, SettingsError> {
    let name = format!("{cloud}.hints");
    let topic = r.topic(&name, None, type_name, Role::Publisher)?;
    if topic.is_some() && linger.is_zero() && matches!(connection, CloudConnection::Grpc(_)) {
        return Err(r.flaw(&name, SettingsFlaw::Hints(format!("{cloud}.linger"))));
    }
    Ok(topic)
}

fn grpc(r: &mut ParameterReader, cloud: &str) -> Result<Option<Grpc>, SettingsError> {
    let of = |part: &str| format!("{cloud}.grpc.{part}");
    let (address, parts) =
        (of("url"), ["ca", "certificate", "key", "token_file", "server_name"].map(of));
    let url = r.text(&address, None)?;
    let given = |r: &ParameterReader, names: &[&String]| {
        names.iter().find(|name| r.is_given(name)).map(|name| (*name).clone())
    };
    if url.is_empty() {
        return match given(r, &parts.each_ref()) {
            Some(part) => Err(r.flaw(&part, SettingsFlaw::Alone(address))),
            None => Ok(None),
        };
    }
    let topics =
        ["input_topic", "output_topic", "middleware"].map(|side| format!("{cloud}.{side}"));
    if let Some(name) = given(r, &topics.each_ref()) {
        return Err(r.flaw(&name, SettingsFlaw::Topics(cloud.to_owned())));
    }
    let [ca, certificate, key, token_file, server_name] = &parts;
    let is_secure = url.starts_with("https://");
    if is_secure && !r.is_given(ca) {
        return Err(r.flaw(&address, SettingsFlaw::Ca(ca.clone())));
    }
    if let Some(name) = given(r, &[ca, certificate, key]).filter(|_| !is_secure) {
        return Err(r.flaw(&name, SettingsFlaw::Plain(address)));
    }
    if r.is_given(token_file) && !is_secure && !is_local(&url) {
        return Err(r.flaw(token_file, SettingsFlaw::Token(address)));
    }
    for (one, other) in [(certificate, key), (key, certificate)] {
        if r.is_given(one) && !r.is_given(other) {
            return Err(r.flaw(one, SettingsFlaw::Alone(other.clone())));
        }
    }
    Ok(Some(Grpc {
        url,
        ca: r.path(ca)?,
        certificate: r.path(certificate)?,
        key: r.path(key)?,
        token_file: r.path(token_file)?,
        server_name: Some(r.text(server_name, None)?).filter(|name| !name.is_empty()),
    }))
}

/// Returns `true` if a server's URL names this computer.
fn is_local(url: &str) -> bool {
    let host = url.split("://").nth(1).unwrap_or_default().trim_end_matches('/');
    let host =
        host.rsplit_once(':').filter(|(_, port)| !port.ends_with(']')).map_or(host, |it| it.0);
    let address = host.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    host == "localhost" || address.is_ok_and(|it| it.is_loopback())
}

/// Returns `true` if it names a server, with nothing behind the port: a path would be left out.
pub(super) fn is_server(url: &str) -> bool {
    let rest = url.strip_prefix("http://").or_else(|| url.strip_prefix("https://"));
    let Some(rest) = rest.map(|rest| rest.strip_suffix('/').unwrap_or(rest)) else { return false };
    let (host, port) = match rest.rsplit_once(':') {
        Some((host, port)) if !port.ends_with(']') => (host, Some(port)),
        Some(_) | None => (rest, None),
    };
    let is_port = |port: &str| port.parse::<u16>().is_ok_and(|port| port > 0);
    !host.is_empty() && !host.contains(['/', '?', '#', '@', ' ']) && port.is_none_or(is_port)
}
