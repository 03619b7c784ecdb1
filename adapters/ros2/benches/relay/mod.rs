//! A relay, which publishes at once and unread on one topic what comes on another. The node's own
//! cost is what it costs beyond the relay.

use std::net::Ipv4Addr;

use futures_util::StreamExt;

use rustdds::policy::{Deadline, History, Reliability};
use rustdds::{DomainParticipantBuilder, Duration, QosPolicyBuilder, TopicKind};

use crate::messages::Any;
use crate::raw::{Cdr, Payload};

/// The topic to read, the topic to write, and their type in DDS.
pub(crate) type Hop = [&'static str; 3];

/// Relays over DDS, with the quality of service of the node's topics, until the process is killed.
pub(crate) async fn over_dds(domain: u16, hops: [Hop; 2]) -> Result<(), Any> {
    let participant =
        DomainParticipantBuilder::new(domain).with_only_networks([Ipv4Addr::LOCALHOST]).build()?;
    let qos = QosPolicyBuilder::new()
        .reliability(Reliability::Reliable { max_blocking_time: Duration::ZERO })
        .history(History::KeepLast { depth: 10 });
    let offered = qos.clone().deadline(Deadline(Duration::from_millis(5))).build();
    let qos = qos.build();
    let publisher = participant.create_publisher(&qos)?;
    let subscriber = participant.create_subscriber(&qos)?;
    let topic = |name: &str, ty: &str| {
        participant.create_topic(format!("rt/{name}"), ty.into(), &qos, TopicKind::NoKey)
    };
    for [from, to, ty] in hops {
        let reader =
            subscriber.create_simple_datareader_no_key::<Payload, Cdr>(&topic(from, ty)?, None)?;
        let writer = publisher
            .create_datawriter_no_key::<Payload, Cdr>(&topic(to, ty)?, Some(offered.clone()))?;
        tokio::spawn(async move {
            let mut samples = Box::pin(reader.as_async_stream());
            while let Some(sample) = samples.next().await {
                let relayed = sample.map(|it| writer.write(it.into_value(), None));
                assert!(matches!(relayed, Ok(Ok(()))), "the relay lost a message");
            }
        });
    }
    std::future::pending().await
}

/// Relays over Zenoh until the process is killed. Payloads, attachments, and the parts of keys
/// other than the topic stay the same.
#[cfg(feature = "zenoh")]
pub(crate) async fn over_zenoh(domain: u16, hops: [Hop; 2]) -> Result<(), Any> {
    let config = crate::ros::over_zenoh::config("client", "connect/endpoints")?;
    let session = zenoh::open(config).await?;
    for [from, to, _] in hops {
        let samples = session.declare_subscriber(format!("{domain}/{from}/**")).await?;
        let session = session.clone();
        tokio::spawn(async move {
            while let Ok(sample) = samples.recv_async().await {
                let key = sample.key_expr().as_str().replacen(from, to, 1);
                let put = session.put(key, sample.payload().clone());
                put.attachment(sample.attachment().cloned()).await.expect("the relay's session");
            }
        });
    }
    std::future::pending().await
}
