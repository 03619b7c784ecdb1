//! Zenoh's configuration, from where `rmw_zenoh` has it.

use zenoh::Config;

use crate::error::NodeError;

/// Names a file with the configuration of the session.
const FILE: &str = "ZENOH_SESSION_CONFIG_URI";
/// Changes parts of it: `key=value;key=value`, each value as in JSON5.
const OVERRIDE: &str = "ZENOH_CONFIG_OVERRIDE";

/// The settings that `rmw_zenoh` has unless a file says otherwise: a peer that meets others through
/// a router on this host. Clients have timestamps too: without them late subscribers will not get
/// earlier messages.
const USUAL: [(&str, &str); 6] = [
    ("mode", "\"peer\""),
    ("connect/endpoints", "[\"tcp/localhost:7447\"]"),
    ("listen/endpoints", "[\"tcp/localhost:0\"]"),
    ("scouting/multicast/enabled", "false"),
    ("scouting/gossip/enabled", "true"),
    ("timestamping/enabled", "true"),
];

/// Returns the configuration that the environment selects.
///
/// # Errors
/// The file cannot be read, or what changes it is not a part of it.
pub(crate) fn from_environment() -> Result<Config, NodeError> {
    read(|name| std::env::var_os(name).map(|value| value.to_string_lossy().into_owned()))
}

fn read(environment: impl Fn(&str) -> Option<String>) -> Result<Config, NodeError> {
    let wrong = |name: &str, error: &dyn std::fmt::Display| {
        NodeError::ZenohConfig(format!("{name}: {error}"))
    };
    let setting = |name: &str| environment(name).filter(|value| !value.trim().is_empty());
    let mut config = if let Some(path) = setting(FILE) {
        let named = format!("{FILE}={path}");
        Config::from_file(path.trim()).map_err(|error| wrong(&named, &error))?
    } else {
        let mut config = Config::default();
        for (key, value) in USUAL {
            config.insert_json5(key, value).map_err(|error| wrong(key, &error))?;
        }
        config
    };
    for change in setting(OVERRIDE).iter().flat_map(|text| text.split(';')) {
        let change = change.trim();
        if change.is_empty() {
            continue;
        }
        let wrong = |error: &dyn std::fmt::Display| wrong(&format!("{OVERRIDE}, {change}"), error);
        let Some((key, value)) = change.split_once('=') else {
            return Err(wrong(&"give key=value"));
        };
        config.insert_json5(key.trim(), value.trim()).map_err(|error| wrong(&error))?;
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(file: &str, changes: &str) -> Result<Config, NodeError> {
        read(|name| match name {
            FILE => Some(file.to_owned()),
            OVERRIDE => Some(changes.to_owned()),
            _ => None,
        })
    }

    #[test]
    fn without_a_file_it_is_a_peer_of_a_router_on_this_machine_and_a_change_counts() {
        let usual = with("", "").unwrap();
        assert_eq!(usual.get_json("connect/endpoints").unwrap(), "[\"tcp/localhost:7447\"]");
        let changed =
            with("", "mode=\"client\"; connect/endpoints=[\"tcp/10.0.0.1:7447\"];").unwrap();
        assert_eq!(changed.get_json("mode").unwrap(), "\"client\"");
        assert_eq!(changed.get_json("connect/endpoints").unwrap(), "[\"tcp/10.0.0.1:7447\"]");
    }

    #[test]
    fn what_cannot_be_read_is_an_error_that_names_it() {
        for (file, changes, named) in [
            ("/nowhere/config.json5", "", "/nowhere/config.json5"),
            ("", "mode", "key=value"),
            ("", "no_such_key=1", "no_such_key"),
            ("", "mode=\"sideways\"", "sideways"),
        ] {
            let refused = with(file, changes).unwrap_err().to_string();
            assert!(refused.contains(named), "{refused}");
        }
    }
}
