//! Reads ROS 2's environment variables: domain, middleware, whom to meet, and security.
//!
//! Each is honoured, or the node says that it is not. A node that is to be secured and cannot be
//! does not start.

use crate::parameters::{ParameterOverride, Value, ValueOrigin};
use crate::settings::{Middleware, Settings, SettingsError};

const DOMAIN: &str = "ROS_DOMAIN_ID";
const RMW: &str = "RMW_IMPLEMENTATION";
const RANGE: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";
const LOCALHOST: &str = "ROS_LOCALHOST_ONLY";
const PEERS: &str = "ROS_STATIC_PEERS";
const SECURITY: &str = "ROS_SECURITY_ENABLE";
const STRATEGY: &str = "ROS_SECURITY_STRATEGY";

/// The middlewares with which the node is tested, as ROS 2 names them, and which of its own speaks
/// with each.
const KNOWN: [(&str, Middleware); 4] = [
    ("rmw_fastrtps_cpp", Middleware::Dds),
    ("rmw_fastrtps_dynamic_cpp", Middleware::Dds),
    ("rmw_cyclonedds_cpp", Middleware::Dds),
    ("rmw_zenoh_cpp", Middleware::Zenoh),
];

/// The variables that configure other implementations of DDS, and what the node does instead.
const OTHERS: [(&str, &str); 4] = [
    ("ROS_DISCOVERY_SERVER", "it does not ask that server for peers, and may find none"),
    ("CYCLONEDDS_URI", "localhost_only and domain_id set its interfaces and peers"),
    ("FASTRTPS_DEFAULT_PROFILES_FILE", "the profiles do not set its transports and peers"),
    ("FASTDDS_DEFAULT_PROFILES_FILE", "the profiles do not set its transports and peers"),
];

/// Looks up a variable; an empty one counts as not set, as in rcl.
pub(super) struct Environment<F>(pub(super) F);

impl<F: Fn(&str) -> Option<String>> Environment<F> {
    fn get(&self, variable: &str) -> Option<String> {
        (self.0)(variable).filter(|value| !value.is_empty())
    }

    /// Returns the parameters that variables stand for.
    ///
    /// # Errors
    /// If security is to be enforced, which the node does not have.
    pub(super) fn overrides(&self) -> Result<Vec<ParameterOverride>, SettingsError> {
        if self.is_secured()
            && self.get(STRATEGY).is_some_and(|it| it.eq_ignore_ascii_case("Enforce"))
        {
            return Err(SettingsError::Security { enable: SECURITY, strategy: STRATEGY });
        }
        let all = [self.domain(), self.localhost_only(), self.middleware()];
        Ok(all.into_iter().flatten().collect())
    }

    fn domain(&self) -> Option<ParameterOverride> {
        let text = self.get(DOMAIN)?;
        let value = text.parse().map_or(Value::String(text), Value::Integer);
        Some(given("domain_id", value, DOMAIN))
    }

    fn localhost_only(&self) -> Option<ParameterOverride> {
        // As in rcl, what is no range counts as LOCALHOST. There is no node without discovery, so
        // OFF counts as LOCALHOST too.
        let is_near = |range: String| !matches!(&*range, "SUBNET" | "SYSTEM_DEFAULT" | "NOT_SET");
        let variable = if self.get(RANGE).is_some_and(is_near) {
            RANGE
        } else if self.get(LOCALHOST)? == "1" {
            LOCALHOST
        } else {
            return None;
        };
        Some(given("localhost_only", Value::Bool(true), variable))
    }

    fn middleware(&self) -> Option<ParameterOverride> {
        let name = self.get(RMW)?;
        let known = KNOWN.into_iter().find(|(known, _)| *known == name);
        let chosen = known.map_or(Middleware::Dds, |(_, middleware)| middleware);
        Some(given("middleware", Value::String(chosen.to_string()), RMW))
    }

    /// Returns `true` if ROS 2 turns security on.
    fn is_secured(&self) -> bool {
        self.get(SECURITY).is_some_and(|value| value == "true")
    }

    /// Returns the variables that are set but not honoured, or not as they read, each in a
    /// sentence.
    pub(super) fn cautions(&self, settings: &Settings) -> Vec<String> {
        let mut all = Vec::new();
        match self.get(SECURITY) {
            Some(value) if value == "true" => all.push(format!(
                "{SECURITY} is true, but this node has no DDS security (SROS2): it joins unsecured, and \
                 secured peers may refuse it"
            )),
            Some(value) if value != "false" => {
                all.push(format!("{SECURITY} is {value:?}, which ROS 2 reads as false; give true \
                                  or false"));
            }
            Some(_) | None => {}
        }
        let of_rmw = settings.origin("middleware") == ValueOrigin::Environment(RMW);
        if let Some(name) = self.get(RMW).filter(|name| of_rmw && !is_known(name)) {
            all.push(format!(
                "{RMW} is {name}, which this node does not know: it uses DDS, as rmw_fastrtps and \
                 rmw_cyclonedds do; give the parameter middleware"
            ));
        }
        if settings.needs(Middleware::Dds) {
            all.extend(self.of_discovery());
            let set = OTHERS.into_iter().filter(|(variable, _)| self.get(variable).is_some());
            all.extend(set.map(|(variable, what)| {
                format!("{variable} is set, and this node does not read it: {what}")
            }));
        }
        all
    }

    fn of_discovery(&self) -> Vec<String> {
        let mut all = Vec::new();
        match self.get(RANGE).as_deref() {
            Some("OFF") => all.push(format!(
                "{RANGE} is OFF, but this node finds its peers by discovery alone: it looks for them on \
                 this computer only, as for LOCALHOST"
            )),
            Some("LOCALHOST" | "SUBNET" | "SYSTEM_DEFAULT" | "NOT_SET") | None => {}
            Some(other) => {
                all.push(format!("{RANGE} is {other:?}, which is not a range; LOCALHOST is \
                                  assumed, as in rcl"));
            }
        }
        match self.get(LOCALHOST).as_deref() {
            Some("0" | "1") | None => {}
            Some(other) => {
                all.push(format!("{LOCALHOST} is {other:?}, which ROS 2 reads as 0; give 0 or 1"));
            }
        }
        if let Some(peers) = self.get(PEERS) {
            all.push(format!(
                "{PEERS} is {peers:?}, and this node does not read it: it finds peers by multicast and on this computer; reach \
                 others over Zenoh"
            ));
        }
        all
    }
}

fn is_known(name: &str) -> bool {
    KNOWN.iter().any(|(known, _)| *known == name)
}

fn given(name: &str, value: Value, variable: &'static str) -> ParameterOverride {
    let origin = ValueOrigin::Environment(variable);
    ParameterOverride { name: name.to_owned(), value, origin, is_shared: false }
}
