//! ROS nodes that communicate only on this host, over DDS or over Zenoh.

use std::net::Ipv4Addr;
use std::time::Duration;

use ros2_client::dds;
use ros2_client::qos::{History, WhenFull};
use ros2_client::{MessageInfo, MessageTypeName, Name, NodeName, NodeOptions, QosProfile};
use rustdds::DomainParticipantBuilder;
use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::time::timeout;

use crate::messages::Any;

/// The time after which a wait for a missing peer starts again.
const AGAIN: Duration = Duration::from_millis(200);

/// A ROS node that communicates only on this host.
#[cfg_attr(feature = "zenoh", expect(clippy::large_enum_variant, reason = "a process has few"))]
pub(crate) enum Node {
    Dds(dds::Node),
    #[cfg(feature = "zenoh")]
    Zenoh(ros2_client::zenoh::Node),
}

pub(crate) enum Publisher<M: Serialize> {
    Dds(dds::Publisher<M>),
    #[cfg(feature = "zenoh")]
    Zenoh(ros2_client::zenoh::Publisher<M>),
}

#[cfg_attr(feature = "zenoh", expect(clippy::large_enum_variant, reason = "a process has few"))]
pub(crate) enum Subscription<M> {
    Dds(dds::Subscription<M>),
    #[cfg(feature = "zenoh")]
    Zenoh(ros2_client::zenoh::Subscription<M>),
}

/// Returns whether this process is configured to use Zenoh.
pub(crate) fn is_over_zenoh() -> bool {
    cfg!(feature = "zenoh") && std::env::args().any(|word| word == "--zenoh")
}

pub(crate) fn node_in(domain: u16, name: &str) -> Result<Node, Any> {
    let (name, options) = (NodeName::new("/", name)?, NodeOptions::new().enable_rosout(false));
    #[cfg(feature = "zenoh")]
    if is_over_zenoh() {
        return over_zenoh::node(domain, name, options).map(Node::Zenoh);
    }
    let participant =
        DomainParticipantBuilder::new(domain).with_only_networks([Ipv4Addr::LOCALHOST]).build()?;
    let context = dds::Context::from_domain_participant(participant)?;
    let mut node = context.new_node(name, options).map_err(|error| format!("{error:?}"))?;
    tokio::spawn(node.spinner()?.spin());
    Ok(Node::Dds(node))
}

pub(crate) fn publisher<M: Serialize>(
    node: &mut Node,
    topic: &str,
    ty: &str,
) -> Result<Publisher<M>, Any> {
    let (name, ty) = names(topic, ty)?;
    match node {
        Node::Dds(node) => {
            let topic = node.create_topic(&name, ty, &quality())?;
            Ok(Publisher::Dds(node.create_publisher(&topic, Some(quality()))?))
        }
        #[cfg(feature = "zenoh")]
        Node::Zenoh(node) => {
            let topic = node.create_topic(&name, ty, &quality());
            Ok(Publisher::Zenoh(node.create_publisher(&topic, None)?))
        }
    }
}

pub(crate) fn subscription<M: DeserializeOwned + 'static>(
    node: &mut Node,
    topic: &str,
    ty: &str,
) -> Result<Subscription<M>, Any> {
    let (name, ty) = names(topic, ty)?;
    match node {
        Node::Dds(node) => {
            let topic = node.create_topic(&name, ty, &quality())?;
            Ok(Subscription::Dds(node.create_subscription(&topic, Some(quality()))?))
        }
        #[cfg(feature = "zenoh")]
        Node::Zenoh(node) => {
            let topic = node.create_topic(&name, ty, &quality());
            Ok(Subscription::Zenoh(node.create_subscription(&topic, None)?))
        }
    }
}

impl<M: Serialize> Publisher<M> {
    pub(crate) async fn publish(&self, message: M) -> Result<(), Any> {
        match self {
            Self::Dds(publisher) => {
                publisher.async_publish(message).await.map_err(|error| error.to_string().into())
            }
            #[cfg(feature = "zenoh")]
            Self::Zenoh(publisher) => {
                publisher.async_publish(message).await.map_err(|error| error.to_string().into())
            }
        }
    }

    /// Waits until somebody subscribes.
    pub(crate) async fn subscribed(&self, node: &Node) {
        match (self, node) {
            // A wait may miss a subscriber while the host is busy. A new wait first looks at which
            // subscribers are there.
            (Self::Dds(publisher), Node::Dds(node)) => {
                while timeout(AGAIN, publisher.wait_for_subscription(node)).await.is_err() {}
            }
            #[cfg(feature = "zenoh")]
            (Self::Zenoh(publisher), Node::Zenoh(node)) => {
                publisher.wait_for_subscription(node).await;
            }
            #[cfg(feature = "zenoh")]
            _ => unreachable!("a node publishes by its own middleware"),
        }
    }
}

impl<M: DeserializeOwned + 'static> Subscription<M> {
    pub(crate) async fn take(&self) -> Result<(M, MessageInfo), Any> {
        match self {
            Self::Dds(topic) => topic.async_take().await.map_err(|error| error.to_string().into()),
            #[cfg(feature = "zenoh")]
            Self::Zenoh(topic) => {
                topic.async_take().await.map_err(|error| error.to_string().into())
            }
        }
    }
}

fn names(topic: &str, ty: &str) -> Result<(Name, MessageTypeName), Any> {
    let (package, ty) = ty.split_once('/').ok_or("a type has a package")?;
    Ok((Name::parse(&format!("/{topic}"))?, MessageTypeName::new(package, ty)))
}

fn quality() -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .history(History::KeepLast { depth: 10 })
}

/// Nodes over Zenoh, which meet through a router of their own.
#[cfg(feature = "zenoh")]
pub(crate) mod over_zenoh {
    use ros2_client::zenoh::{Context, ContextOptions, Node};
    use ros2_client::{NodeName, NodeOptions};
    use zenoh::{Config, Wait};

    use crate::messages::Any;

    /// The address of the router. It differs from the default address, where a router of the user's
    /// own may listen.
    const ROUTER: &str = "[\"tcp/127.0.0.1:7487\"]";

    /// Returns the variable by which the node under test finds the router.
    pub(crate) fn variable() -> (&'static str, String) {
        ("ZENOH_CONFIG_OVERRIDE", format!("connect/endpoints={ROUTER}"))
    }

    pub(crate) fn config(mode: &str, endpoints: &str) -> Result<Config, Any> {
        let mut config = Config::default();
        config.insert_json5("mode", &format!("\"{mode}\""))?;
        config.insert_json5(endpoints, ROUTER)?;
        config.insert_json5("scouting/multicast/enabled", "false")?;
        // The router starts at the same time.
        config.insert_json5("connect/timeout_ms", "10000")?;
        Ok(config)
    }

    pub(super) fn node(domain: u16, name: NodeName, options: NodeOptions) -> Result<Node, Any> {
        let options_of_context = ContextOptions::new()
            .domain_id(domain)
            .zenoh_config(config("client", "connect/endpoints")?);
        let context = Context::with_options(options_of_context)?;
        context.new_node(name, options).map_err(|error| error.to_string().into())
    }

    /// Runs the router until the process is killed.
    pub(crate) async fn route() -> Result<(), Any> {
        let _session = zenoh::open(config("router", "listen/endpoints")?).wait()?;
        std::future::pending().await
    }
}
