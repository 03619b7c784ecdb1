//! Names and attachments as `rmw_zenoh` has them.
//!
//! A topic's messages have the key `<domain>/<topic>/<type>/<hash of the type>`. Each node, each
//! end of a topic and each service has a liveliness token, whose key says what it is:
//! `@ros2_lv/<domain>/<session>/<node>/<entity>/<kind>/
//! <enclave>/<namespace>/<name>`, then for all but nodes `/<topic>/<type>/<hash>/<quality of service>`. In tokens `%`
//! stands for a slash within a name.
//!
//! In ROS 2 Lyrical (`rmw_zenoh` 0.10.5) the ends of a type with an unbounded `uint8[]` say in one
//! more part where its bytes may be: `/backends:cpu:` is in main memory. Where all subscriptions of
//! a topic say something, those that say this get messages by the key `<their key>/_buf_cpu`; one
//! that says nothing may get none at all. The node does not know the fields of its types: its
//! subscriptions say so whatever the type, but for those that are `transient_local`, which have no
//! such part.

use xxhash_rust::xxh3::xxh3_128;

use crate::middleware::end::Gid;
use crate::names::NodeName;
use crate::settings::Qos;

/// Ends the token of a subscription that takes what is in main memory.
const BACKENDS: &str = "/backends:cpu:";
/// Ends the key of what is for such subscriptions alone.
const GROUP: &str = "/_buf_cpu";
/// The length of an attachment, in bytes.
const ATTACHMENT: usize = 33;

/// The announcement of a token.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum TokenKind {
    Node,
    Publisher,
    Subscription,
    Service,
}

/// The owner of the tokens.
#[derive(Clone, Debug)]
pub(super) struct TokenOwner {
    pub(super) domain: u16,
    /// The session's identifier, as Zenoh prints it.
    pub(super) session: String,
    pub(super) node: NodeName,
}

/// The end of a topic, or a service, for a token.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Entity<'a> {
    pub(super) kind: TokenKind,
    /// Its full name.
    pub(super) name: &'a str,
    /// Its type's name in DDS.
    pub(super) type_name: &'a str,
    /// Its type's hash.
    pub(super) hash: &'a str,
}

/// The attachment of each message, request and answer.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Attachment {
    /// The sequence number of its publisher or client, from 1.
    pub(crate) sequence: i64,
    /// The instant at which the message was sent, in nanoseconds of the time of day.
    pub(crate) sent: i64,
    /// The source.
    pub(crate) source: Gid,
}

impl TokenKind {
    const fn code(self) -> &'static str {
        match self {
            Self::Node => "NN",
            Self::Publisher => "MP",
            Self::Subscription => "MS",
            Self::Service => "SS",
        }
    }
}

impl TokenOwner {
    /// Returns the key of a topic's messages, or of a service's requests; a hash of `*` is any.
    pub(super) fn key(&self, name: &str, type_name: &str, hash: &str) -> String {
        format!("{}/{}/{type_name}/{hash}", self.domain, name.trim_matches('/'))
    }

    /// Returns the token of the node itself.
    pub(super) fn node_token(&self) -> String {
        self.token_of(0, TokenKind::Node)
    }

    /// Returns the token of one of its ends; `number` is its own among the node's.
    pub(super) fn token(&self, number: u64, entity: &Entity, qos: Qos) -> String {
        let Entity { kind, name, type_name, hash } = entity;
        let is_in_group = *kind == TokenKind::Subscription && !qos.transient_local;
        let backends = if is_in_group { BACKENDS } else { "" };
        let (begin, name, qos) = (self.token_of(number, *kind), mangled(name), quality(qos));
        format!("{begin}/{name}/{type_name}/{hash}/{qos}{backends}")
    }

    fn token_of(&self, number: u64, kind: TokenKind) -> String {
        let Self { domain, session, node } = self;
        let (kind, namespace, name) = (kind.code(), mangled(&node.namespace), &node.name);
        format!("@ros2_lv/{domain}/{session}/0/{number}/{kind}/%/{namespace}/{name}")
    }

    /// Returns a key for the tokens of all ends of this kind on a topic, whatever their type.
    pub(super) fn tokens_of_topic(&self, kind: TokenKind, topic: &str) -> String {
        let (domain, kind, topic) = (self.domain, kind.code(), mangled(topic));
        format!("@ros2_lv/{domain}/*/*/*/{kind}/*/*/*/{topic}/*/*/*/**")
    }

    /// Returns a key for the tokens of all topics and services with this type.
    pub(super) fn tokens_of_type(&self, type_name: &str) -> String {
        format!("@ros2_lv/{}/*/*/*/*/*/*/*/*/{type_name}/*/*/**", self.domain)
    }

    /// Returns `true` if a token is of this session.
    pub(super) fn owns(&self, token: &str) -> bool {
        token.split('/').nth(2) == Some(&self.session)
    }
}

/// Returns the type and the hash of the end that a token belongs to, or `None` if it belongs to no
/// end of a topic.
pub(super) fn type_of(token: &str) -> Option<(&str, &str)> {
    let parts: Vec<&str> = token.split('/').collect();
    match parts[..] {
        ["@ros2_lv", _, _, _, _, _, _, _, _, _, type_name, hash, _, ..] => Some((type_name, hash)),
        _ => None,
    }
}

/// Returns the key of those messages of a topic that are for subscriptions in its group alone.
pub(super) fn group_key(key: &str) -> String {
    format!("{key}{GROUP}")
}

/// Returns the hash of a message's type, by its key.
pub(super) fn hash_of(key: &str) -> &str {
    let key = key.strip_suffix(GROUP).unwrap_or(key);
    key.rsplit('/').next().unwrap_or_default()
}

/// Returns the identifier of a token's owner.
pub(crate) fn gid(token: &str) -> Gid {
    xxh3_128(token.as_bytes()).to_le_bytes()
}

impl Attachment {
    pub(crate) fn to_bytes(self) -> [u8; ATTACHMENT] {
        let mut bytes = [0; ATTACHMENT];
        bytes[..8].copy_from_slice(&self.sequence.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.sent.to_le_bytes());
        bytes[16] = 16;
        bytes[17..].copy_from_slice(&self.source);
        bytes
    }

    /// Returns `None` if the bytes are not an attachment of ROS.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (sequence, rest) = bytes.split_first_chunk()?;
        let (sent, rest) = rest.split_first_chunk()?;
        let source = rest.strip_prefix(&[16])?.try_into().ok()?;
        let [sequence, sent] = [*sequence, *sent].map(i64::from_le_bytes);
        Some(Self { sequence, sent, source })
    }
}

fn mangled(name: &str) -> String {
    name.replace('/', "%")
}

/// `reliability:durability:history,depth:deadline:lifespan:liveliness`, where what is the default
/// is left out.
fn quality(qos: Qos) -> String {
    let reliability = if qos.reliable { "" } else { "2" };
    let durability = if qos.transient_local { "1" } else { "" };
    format!("{reliability}:{durability}:,{}:,:,:,,", qos.depth)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn owner() -> TokenOwner {
        let node = NodeName { namespace: "/robot".into(), name: "fuseline".into() };
        TokenOwner { domain: 7, session: "a1b2".into(), node }
    }

    #[test]
    fn keys_and_tokens_are_those_of_rmw_zenoh() {
        let (owner, qos) = (owner(), Qos { reliable: true, transient_local: false, depth: 5 });
        let entity = Entity {
            kind: TokenKind::Publisher,
            name: "/a/b",
            type_name: "std_msgs::msg::dds_::String_",
            hash: "RIHS01_df",
        };
        assert_eq!(
            owner.key(entity.name, entity.type_name, "*"),
            "7/a/b/std_msgs::msg::dds_::String_/*"
        );
        assert_eq!(owner.node_token(), "@ros2_lv/7/a1b2/0/0/NN/%/%robot/fuseline");
        let token = owner.token(3, &entity, qos);
        assert_eq!(
            token,
            "@ros2_lv/7/a1b2/0/3/MP/%/%robot/fuseline/%a%b/std_msgs::msg::dds_::String_/RIHS01_df/::,5:,:,:,,"
        );
        assert_eq!(type_of(&token), Some((entity.type_name, entity.hash)));
        assert_eq!(type_of(&owner.node_token()), None);
        assert!(owner.owns(&token));
        let subscription = owner.token(3, &Entity { kind: TokenKind::Subscription, ..entity }, qos);
        assert!(subscription.ends_with("/RIHS01_df/::,5:,:,:,,/backends:cpu:"), "{subscription}");
        assert_eq!(type_of(&subscription), Some((entity.type_name, entity.hash)));
        let best_effort = Qos { reliable: false, transient_local: true, depth: 1 };
        assert!(owner.token(3, &entity, best_effort).ends_with("/2:1:,1:,:,:,,"));
    }

    #[test]
    fn the_hash_is_read_from_the_key_of_the_group_as_well() {
        let key = owner().key("/a/b", "std_msgs::msg::dds_::String_", "RIHS01_df");
        assert_eq!(group_key(&key), "7/a/b/std_msgs::msg::dds_::String_/RIHS01_df/_buf_cpu");
        assert_eq!([hash_of(&key), hash_of(&group_key(&key))], ["RIHS01_df"; 2]);
    }

    #[test]
    fn an_attachment_comes_back_and_nothing_else_is_one() {
        let attachment = Attachment { sequence: 7, sent: -1, source: [0xAB; 16] };
        let bytes = attachment.to_bytes();
        assert_eq!(bytes[..8], [7, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(bytes[16], 16);
        assert_eq!(Attachment::from_bytes(&bytes), Some(attachment));
        for length in 0..ATTACHMENT {
            assert_eq!(Attachment::from_bytes(&bytes[..length]), None, "{length}");
        }
        let mut longer = bytes.to_vec();
        longer.push(0);
        assert_eq!(Attachment::from_bytes(&longer), None);
    }
}
