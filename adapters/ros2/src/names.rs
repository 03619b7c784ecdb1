//! ROS 2's names of nodes, topics and types, expanded and remapped.

use std::str::FromStr;

use thiserror::Error;

use crate::settings::SettingsError;

/// Topics of other nodes that launch files remap for all of theirs.
const OF_OTHERS: [&str; 2] = ["/tf", "/tf_static"];

/// The node's topics and services that keep their names.
const FIXED: [&str; 15] = [
    "/clock",
    "/parameter_events",
    "/rosout",
    "~/change_state",
    "~/describe_parameters",
    "~/get_available_states",
    "~/get_available_transitions",
    "~/get_parameter_types",
    "~/get_parameters",
    "~/get_state",
    "~/get_transition_graph",
    "~/list_parameters",
    "~/set_parameters",
    "~/set_parameters_atomically",
    "~/transition_event",
];

/// The greatest number of characters in a topic's full name, as in rmw.
const TOPIC_CHARS: usize = 247;

/// A node's name and namespace, from which relative and private names are resolved.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct NodeName {
    /// `/`, or `/a/b`.
    pub namespace: String,
    /// The name, one part without slashes.
    pub name: String,
}

/// A remapping rule, `[node:]from:=to`.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Remap {
    /// The node that the rule is for, a name without namespace; `None` means any node.
    pub node: Option<String>,
    /// The name that the rule replaces, and the new one.
    pub rule: RemapRule,
}

/// The name that a remapping rule replaces.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum RemapRule {
    /// `__node:=name`: the node's name.
    Node(String),
    /// `__ns:=/name`: the node's namespace.
    Namespace(String),
    /// A topic: the full name of the first is replaced by the full name of the second.
    Topic(String, String),
}

/// The reason why a name is not valid.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Error)]
pub enum NameError {
    /// The name is empty.
    #[error("it is empty")]
    Empty,
    /// The name has a slash at the end, or two in a row.
    #[error("a part between slashes is empty")]
    Slash,
    /// The name has a character that ROS names cannot have.
    #[error("{0:?} is not a letter, digit or underscore")]
    Character(char),
    /// A part begins with a digit; it must begin with a letter or an underscore.
    #[error("a part begins with a digit")]
    Digit,
    /// The name has two underscores in a row, which DDS reserves.
    #[error("it has two underscores in a row")]
    Underscores,
    /// A topic's full name is too long for DDS.
    #[error("its full name has more than {TOPIC_CHARS} characters")]
    Long,
    /// The namespace is relative.
    #[error("it does not begin with a slash")]
    Relative,
    /// The type is not `package/msg/Type`.
    #[error("it is not like package/msg/Type")]
    Type,
}

/// The reason why a remapping rule cannot be read.
#[derive(Clone, PartialEq, Eq, Debug, Error)]
pub enum RemapError {
    /// There is no `:=`.
    #[error("give FROM:=TO")]
    Shape,
    /// Schemes such as `rostopic://`.
    #[error("schemes such as rostopic:// are not supported; give the topic's name alone")]
    Scheme,
    /// A name in it is not valid.
    #[error("{name:?} is not a valid name: {source}")]
    Name {
        /// The name.
        name: String,
        /// The reason.
        source: NameError,
    },
}

impl NodeName {
    /// Creates the name of a node in a namespace.
    ///
    /// # Errors
    /// Returns an error if one of them is not valid, or if the namespace does not begin with a
    /// slash.
    pub fn new(namespace: &str, name: &str) -> Result<Self, NameError> {
        check_token(name)?;
        check_namespace(namespace)?;
        Ok(Self { namespace: namespace.to_owned(), name: name.to_owned() })
    }

    /// Returns this name after the first rule for its name, and then the first rule for its
    /// namespace.
    #[must_use]
    pub fn remapped(mut self, remaps: &[Remap]) -> Self {
        let name = self.rules(remaps).find_map(|remap| match &remap.rule {
            RemapRule::Node(name) => Some(name.clone()),
            RemapRule::Namespace(_) | RemapRule::Topic(..) => None,
        });
        self.name = name.unwrap_or(self.name);
        let namespace = self.rules(remaps).find_map(|remap| match &remap.rule {
            RemapRule::Namespace(namespace) => Some(namespace.clone()),
            RemapRule::Node(_) | RemapRule::Topic(..) => None,
        });
        self.namespace = namespace.unwrap_or(self.namespace);
        self
    }

    /// Returns the full name, `/namespace/name`.
    #[must_use]
    pub fn full(&self) -> String {
        self.within(&self.name)
    }

    /// Returns the full name of a topic, which may be relative, private (`~/x`) or full.
    ///
    /// # Errors
    /// Returns an error if the name is not valid or too long.
    pub fn expand(&self, topic: &str) -> Result<String, NameError> {
        let full = if let Some(private) = topic.strip_prefix("~/") {
            format!("{}/{private}", self.full())
        } else if topic.starts_with('/') {
            topic.to_owned()
        } else if topic.is_empty() {
            return Err(NameError::Empty);
        } else {
            self.within(topic)
        };
        full[1..].split('/').try_for_each(check_token)?;
        if full.len() > TOPIC_CHARS { Err(NameError::Long) } else { Ok(full) }
    }

    /// Returns the full name of a topic after the first rule that matches it. As in rcl, both sides
    /// of a rule are expanded, and no rule is applied to the result of another.
    ///
    /// # Errors
    /// Returns an error if the name is not valid, or too long before or after the rule.
    pub fn topic(&self, topic: &str, remaps: &[Remap]) -> Result<String, NameError> {
        let full = self.expand(topic)?;
        for Remap { rule, .. } in self.rules(remaps) {
            if let RemapRule::Topic(from, to) = rule
                && self.expand(from)? == full
            {
                return self.expand(to);
            }
        }
        Ok(full)
    }

    /// Returns the rules for topics that apply to none of `topics`, which have their own names
    /// here, in a sentence each. Such a rule may be for all nodes of a launch file.
    ///
    /// # Errors
    /// A rule for a name that cannot be remapped, or one for this node alone and for no topic of
    /// it; with the reason.
    pub(crate) fn idle_rules(
        &self,
        remaps: &[Remap],
        topics: &[String],
    ) -> Result<Vec<String>, SettingsError> {
        let expanded = |names: &[&str]| -> Vec<String> {
            names.iter().filter_map(|name| self.expand(name).ok()).collect()
        };
        let own = expanded(&topics.iter().map(String::as_str).collect::<Vec<_>>());
        let (fixed, mut seen, mut idle) = (expanded(&FIXED), Vec::new(), Vec::new());
        for Remap { node, rule } in self.rules(remaps) {
            let RemapRule::Topic(from, to) = rule else { continue };
            let full = self.expand(from).unwrap_or_else(|_| from.clone());
            let rule = format!("{from}:={to}");
            let refused = |why| {
                let (rule, names) = (rule.clone(), own.join(", "));
                Err(SettingsError::Remap { rule, why, names })
            };
            if fixed.contains(&full) {
                return refused(format!("{full} cannot be renamed"));
            } else if seen.contains(&full) {
                idle.push(format!("-r {rule}: an earlier rule renames {full}"));
            } else if !own.contains(&full) && node.is_some() {
                return refused(format!("this node has no topic {full}"));
            } else if !own.contains(&full) && !OF_OTHERS.contains(&full.as_str()) {
                let nearest = nearest(&full, own.iter().map(String::as_str));
                idle.push(format!(
                    "-r {rule}: this node has no topic {full}; the nearest is {nearest}"
                ));
            }
            seen.push(full);
        }
        Ok(idle)
    }

    /// Returns the rules for this node.
    fn rules<'a>(&self, remaps: &'a [Remap]) -> impl Iterator<Item = &'a Remap> {
        let is_ours = |remap: &&Remap| remap.node.as_ref().is_none_or(|node| *node == self.name);
        remaps.iter().filter(is_ours)
    }

    fn within(&self, name: &str) -> String {
        format!("{}/{name}", self.namespace.trim_end_matches('/'))
    }
}

impl FromStr for Remap {
    type Err = RemapError;

    fn from_str(text: &str) -> Result<Self, RemapError> {
        let (from, to) = text.split_once(":=").ok_or(RemapError::Shape)?;
        if text.contains("://") {
            return Err(RemapError::Scheme);
        }
        let (node, from) = match from.split_once(':') {
            Some((node, from)) => (Some(node), from),
            None => (None, from),
        };
        let check = |name: &str, checked: Result<(), NameError>| {
            checked.map_err(|source| RemapError::Name { name: name.to_owned(), source })
        };
        // The validity of a name does not depend on the node.
        let anyone = NodeName { namespace: "/".to_owned(), name: "node".to_owned() };
        let topic = |name: &str| check(name, anyone.expand(name).map(|_| ()));
        if let Some(node) = node {
            check(node, check_token(node))?;
        }
        let rule = match from {
            "__node" | "__name" => {
                check(to, check_token(to))?;
                RemapRule::Node(to.to_owned())
            }
            "__ns" => {
                check(to, check_namespace(to))?;
                RemapRule::Namespace(to.to_owned())
            }
            _ => {
                topic(from)?;
                topic(to)?;
                RemapRule::Topic(from.to_owned(), to.to_owned())
            }
        };
        Ok(Self { node: node.map(str::to_owned), rule })
    }
}

/// Returns the name with the fewest typing errors between them.
pub(crate) fn nearest<'n>(name: &str, names: impl Iterator<Item = &'n str>) -> String {
    let nearest = names.min_by_key(|known| strsim::damerau_levenshtein(name, known));
    nearest.unwrap_or_default().to_owned()
}

/// Checks one part of a name: letters, digits and single underscores, not beginning with a digit.
///
/// # Errors
/// If it is something else.
pub fn check_token(token: &str) -> Result<(), NameError> {
    let strange = |c: &char| !c.is_ascii_alphanumeric() && *c != '_';
    if token.is_empty() {
        Err(NameError::Slash)
    } else if let Some(strange) = token.chars().find(strange) {
        Err(NameError::Character(strange))
    } else if token.starts_with(|first: char| first.is_ascii_digit()) {
        Err(NameError::Digit)
    } else if token.contains("__") {
        Err(NameError::Underscores)
    } else {
        Ok(())
    }
}

/// Checks the name of a message type, `package/msg/Type`, as rosidl does.
///
/// # Errors
/// If it is something else.
pub fn check_type(name: &str) -> Result<(), NameError> {
    let mut parts = name.split('/');
    let (Some(package), Some("msg"), Some(message), None) =
        (parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return Err(NameError::Type);
    };
    check_token(package)?;
    check_token(message)?;
    let is_package = package.starts_with(|first: char| first.is_ascii_lowercase())
        && !package.ends_with('_')
        && !package.contains(|c: char| c.is_ascii_uppercase());
    let is_message =
        message.starts_with(|first: char| first.is_ascii_uppercase()) && !message.contains('_');
    if is_package && is_message { Ok(()) } else { Err(NameError::Type) }
}

fn check_namespace(namespace: &str) -> Result<(), NameError> {
    let Some(parts) = namespace.strip_prefix('/') else { return Err(NameError::Relative) };
    if parts.is_empty() { Ok(()) } else { parts.split('/').try_for_each(check_token) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn node() -> NodeName {
        NodeName::new("/car", "fusion").unwrap()
    }

    fn rules(rules: &[&str]) -> Vec<Remap> {
        rules.iter().map(|rule| rule.parse().unwrap()).collect()
    }

    #[test]
    fn relative_private_and_full_names_are_expanded() {
        let root = NodeName::new("/", "fusion").unwrap();
        assert_eq!(root.expand("input").unwrap(), "/input");
        assert_eq!(root.expand("~/status").unwrap(), "/fusion/status");
        assert_eq!(root.full(), "/fusion");
        assert_eq!(node().expand("local/input").unwrap(), "/car/local/input");
        assert_eq!(node().expand("~/status").unwrap(), "/car/fusion/status");
        assert_eq!(node().expand("/diagnostics").unwrap(), "/diagnostics");
        assert_eq!(node().full(), "/car/fusion");
    }

    #[test]
    fn what_is_no_topic_is_refused() {
        let long = "a".repeat(243);
        let cases = [
            ("", NameError::Empty),
            ("/", NameError::Slash),
            ("a/", NameError::Slash),
            ("a//b", NameError::Slash),
            ("~/", NameError::Slash),
            ("~", NameError::Character('~')),
            ("a/~/b", NameError::Character('~')),
            ("~a", NameError::Character('~')),
            ("ä", NameError::Character('ä')),
            ("a/2", NameError::Digit),
            ("a__b", NameError::Underscores),
            (&long, NameError::Long),
        ];
        for (topic, error) in cases {
            assert_eq!(node().expand(topic), Err(error), "{topic}");
        }
        assert!(node().expand(&long[1..]).is_ok());
        assert_eq!(NodeName::new("car", "fusion"), Err(NameError::Relative));
        assert_eq!(NodeName::new("/car/", "fusion"), Err(NameError::Slash));
        assert_eq!(NodeName::new("/", "a/b"), Err(NameError::Character('/')));
    }

    #[test]
    fn the_first_rule_that_matches_the_full_names_is_applied_once() {
        let remaps = rules(&["other:input:=/a", "/car/input:=b", "input:=/c", "/car/b:=/d"]);
        assert_eq!(node().topic("input", &remaps).unwrap(), "/car/b");
        assert_eq!(node().topic("/car/b", &remaps).unwrap(), "/d");
        let remaps = rules(&["~/status:=state", "fusion:output:=~/result"]);
        assert_eq!(node().topic("/car/fusion/status", &remaps).unwrap(), "/car/state");
        assert_eq!(node().topic("output", &remaps).unwrap(), "/car/fusion/result");
        assert_eq!(node().topic("input", &remaps).unwrap(), "/car/input");
    }

    #[test]
    fn a_node_is_renamed_first_and_its_rules_go_by_the_new_name() {
        let remaps = rules(&["__node:=front", "fusion:__ns:=/a", "front:__ns:=/b", "__node:=last"]);
        let renamed = node().remapped(&remaps);
        assert_eq!(renamed.full(), "/b/front");
        assert_eq!(node().remapped(&rules(&["__ns:=/"])).full(), "/fusion");
        assert_eq!(node().remapped(&rules(&["other:__name:=a"])).full(), "/car/fusion");
    }

    #[test]
    fn what_is_no_rule_is_refused() {
        let cases = [
            ("input", "give FROM:=TO"),
            (
                "rostopic://a:=b",
                "schemes such as rostopic:// are not supported; give the topic's name alone",
            ),
            ("input:=", "\"\" is not a valid name: it is empty"),
            ("a/*:=b", "\"a/*\" is not a valid name: '*' is not a letter, digit or underscore"),
            ("/car:a:=b", "\"/car\" is not a valid name: '/' is not a letter, digit or underscore"),
            ("__ns:=car", "\"car\" is not a valid name: it does not begin with a slash"),
            ("__node:=1", "\"1\" is not a valid name: a part begins with a digit"),
        ];
        for (rule, error) in cases {
            assert_eq!(rule.parse::<Remap>().unwrap_err().to_string(), error);
        }
    }

    #[test]
    fn types_are_package_msg_and_type() {
        for name in ["sensor_msgs/msg/Image", "tf2_msgs/msg/TFMessage", "a1/msg/B2"] {
            assert_eq!(check_type(name), Ok(()), "{name}");
        }
        for name in ["sensor_msgs/Image", "a/srv/B", "A/msg/B", "a/msg/b", "a_/msg/B", "a/msg/B_C"]
        {
            assert_eq!(check_type(name), Err(NameError::Type), "{name}");
        }
        assert_eq!(check_type("a/msg/"), Err(NameError::Slash));
        assert_eq!(check_type("a/msg/B::C"), Err(NameError::Character(':')));
    }

    proptest! {
        #[test]
        fn a_full_name_stays_itself(topic in ".{0,20}") {
            if let Ok(full) = node().expand(&topic) {
                prop_assert_eq!(node().expand(&full), Ok(full));
            }
        }

        #[test]
        fn any_text_is_a_rule_or_none(text in "[a-z_/~:=.]{0,20}") {
            drop(text.parse::<Remap>());
        }
    }
}
