//! The node in a graph of Rust nodes: its parameter services, and a cloud behind gRPC.

#[path = "../examples/demo/messages.rs"]
mod messages;

use std::future::ready;
use std::net::Ipv4Addr;
use std::time::{Duration, SystemTime};

use bytes::Bytes;
use fuseline_ros2::{Arguments, Payload, Settings, Stop};
use fuseline_tokio::grpc::{self, Server};
use futures_util::StreamExt;
use ros2_client::dds::{Client, Context, Node, Publisher, ServiceMapping, Subscription};
use ros2_client::parameters::raw;
use ros2_client::qos::{History, WhenFull};
use ros2_client::rcl_interfaces::{
    GetParametersRequest, GetParametersResponse, SetParametersRequest, SetParametersResponse,
};
use ros2_client::{
    Message, MessageTypeName, Name, NodeName, NodeOptions, Parameter, ParameterValue, QosProfile,
    ServiceTypeName,
};
use rustdds::{DomainParticipantBuilder, Topic};
use serde::Serialize;
use tokio::net::TcpListener;
use tokio::time::{Instant, timeout};

use messages::{Any, CompressedImage, Header, PointStamped, Time};

/// The time that anything may take.
const LONG: Duration = Duration::from_secs(60);
const TYPES: [&str; 2] =
    ["input.type:=sensor_msgs/msg/CompressedImage", "output.type:=geometry_msgs/msg/PointStamped"];

/// A ROS node of this machine alone.
fn node_in(domain: u16, name: &str) -> Result<Node, Any> {
    let participant =
        DomainParticipantBuilder::new(domain).with_only_networks([Ipv4Addr::LOCALHOST]).build()?;
    let context = Context::from_domain_participant(participant)?;
    let options = NodeOptions::new().enable_rosout(false);
    let mut node = context
        .new_node(NodeName::new("/", name)?, options)
        .map_err(|error| format!("{error:?}"))?;
    tokio::spawn(node.spinner()?.spin());
    Ok(node)
}

fn publisher<M: Serialize>(node: &mut Node, topic: &str, ty: &str) -> Result<Publisher<M>, Any> {
    let topic = topic_of(node, topic, ty)?;
    Ok(node.create_publisher(&topic, Some(quality()))?)
}

fn subscription<M: 'static>(
    node: &mut Node,
    topic: &str,
    ty: &str,
) -> Result<Subscription<M>, Any> {
    let topic = topic_of(node, topic, ty)?;
    Ok(node.create_subscription(&topic, Some(quality()))?)
}

fn topic_of(node: &Node, topic: &str, ty: &str) -> Result<Topic, Any> {
    let (package, ty) = ty.split_once('/').ok_or("a type has a package")?;
    let name = Name::parse(&format!("/{topic}"))?;
    Ok(node.create_topic(&name, MessageTypeName::new(package, ty), &quality())?)
}

fn quality() -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .history(History::KeepLast { depth: 10 })
}

fn settings(domain: u16, set: &[&str]) -> Settings {
    let domain = format!("domain_id:={domain}");
    let set = [&TYPES[..], &[&domain, "localhost_only:=true"], set].concat();
    let args = set.iter().flat_map(|set| ["-p", set]);
    let args = std::iter::once("--ros-args").chain(args).map(Into::into);
    Settings::from(&Arguments::parse(args).unwrap(), |_| None).unwrap()
}

/// A domain of the test's own, also beside another run of the tests. Greater ones need ports that
/// the system gives away.
fn domain(test: u32) -> u16 {
    u16::try_from(40 + (std::process::id() * 4 + test) % 60).unwrap()
}

/// Waits for a peer.
///
/// `ros2-client` queues eight events of discovery for who waits, and drops the others: on a busy
/// host the one that matters may be among them. A new wait looks at first who is there.
async fn met<F: Future<Output = ()>>(wait: impl Fn() -> F) -> Result<(), Any> {
    let again = async { while timeout(Duration::from_millis(200), wait()).await.is_err() {} };
    Ok(timeout(LONG, again).await?)
}

/// Runs the node until `peers` are done.
async fn beside(settings: Settings, peers: impl Future<Output = Result<(), Any>>) {
    let mut stop = Stop::never();
    tokio::select! {
        ended = fuseline_ros2::run(&settings, &mut stop, None) => panic!("{ended:?}"),
        done = timeout(6 * LONG, peers) => done.expect("the peers wait for ever").unwrap(),
    }
}

fn client<Q: Message + Clone + 'static, A: Message + 'static>(
    node: &mut Node,
    service: &str,
    ty: &str,
) -> Client<Q, A> {
    let qos = QosProfile::publisher_default().history(History::KeepLast { depth: 1 });
    let name = Name::new("/fuseline", service).unwrap();
    let ty = ServiceTypeName::new("rcl_interfaces", ty);
    node.create_client(ServiceMapping::Enhanced, &name, &ty, qos.clone(), qos).unwrap()
}

#[tokio::test]
async fn parameters_are_read_and_those_that_may_are_set() {
    let peers = async {
        let mut node = node_in(domain(0), "operator")?;
        let reader: Client<GetParametersRequest, GetParametersResponse> =
            client(&mut node, "get_parameters", "GetParameters");
        let setter: Client<SetParametersRequest, SetParametersResponse> =
            client(&mut node, "set_parameters", "SetParameters");
        met(|| reader.wait_for_service(&node)).await?;
        met(|| setter.wait_for_service(&node)).await?;
        let names = ["deadline", "window", "clouds"].map(str::to_owned).to_vec();
        let request = GetParametersRequest { names: names.clone() };
        let read = timeout(LONG, reader.async_call_service(request)).await?.unwrap();
        let values: Vec<ParameterValue> = read.values.into_iter().map(Into::into).collect();
        let clouds = ParameterValue::StringArray(vec!["west".into()]);
        assert_eq!(values, [ParameterValue::Double(0.5), ParameterValue::Integer(16), clouds]);

        let set = [
            ("deadline", ParameterValue::Double(0.25)),
            ("deadline", ParameterValue::Double(-1.0)),
            ("window", ParameterValue::Integer(4)),
            ("west.enabled", ParameterValue::Boolean(false)),
        ];
        let parameter = set
            .map(|(name, value)| raw::Parameter::from(Parameter { name: name.to_owned(), value }));
        let request = SetParametersRequest { parameter: parameter.to_vec() };
        let set = timeout(LONG, setter.async_call_service(request)).await?.unwrap();
        let reported: Vec<_> =
            set.results.iter().map(|set| (set.successful, &*set.reason)).collect();
        let range =
            "deadline cannot be -1.0; give seconds, more than 0 and at most greatest_deadline (60)";
        let fixed = "window is fixed while the node runs; restart it with another value";
        assert_eq!(reported, [(true, ""), (false, range), (false, fixed), (true, "")]);

        let request = GetParametersRequest { names };
        let read = timeout(LONG, reader.async_call_service(request)).await?.unwrap();
        let deadline = ParameterValue::from(read.values[0].clone());
        assert_eq!(deadline, ParameterValue::Double(0.25));
        Ok(())
    };
    Box::pin(beside(settings(domain(0), &["clouds:=[west]"]), peers)).await;
}

/// A serialized `PointStamped` for a serialized `CompressedImage`: the same stamp.
fn point_for(image: &Bytes) -> Bytes {
    let image = Payload::from_serialized(image).unwrap();
    // Stamp, an empty frame (a length of 1, its end, padding), three numbers.
    let body = [&image.body[..8], &[1, 0, 0, 0, 0, 0, 0, 0], &[0; 24]].concat();
    Payload { big_endian: false, body: body.into() }.to_serialized()
}

#[tokio::test]
async fn a_cloud_behind_grpc_answers_and_when_it_is_gone_local_does() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("west.grpc.url:=http://{}", listener.local_addr().unwrap());
    let (end, ended) = tokio::sync::oneshot::channel::<()>();
    let (asked, mut requests) = tokio::sync::mpsc::unbounded_channel();
    let infer = move |request: grpc::Request| {
        let _ = asked.send(request.lineage);
        ready(Ok(grpc::Reply { payload: point_for(&request.payload), ..grpc::Reply::default() }))
    };
    let until = async { drop(ended.await) };
    let server = tokio::spawn(grpc::serve(infer, Server::default(), listener, until));
    // Half an hour ago.
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap();
    let first = i32::try_from(now.as_secs()).unwrap() - 1800;
    let last = first + 1000;

    let peers = async {
        let mut node = node_in(domain(1), "camera")?;
        let camera: Publisher<CompressedImage> =
            publisher(&mut node, "input", "sensor_msgs/CompressedImage")?;
        let output: Subscription<PointStamped> =
            subscription(&mut node, "output", "geometry_msgs/PointStamped")?;
        let requested: Subscription<CompressedImage> =
            subscription(&mut node, "local/input", "sensor_msgs/CompressedImage")?;
        let local: Publisher<PointStamped> =
            publisher(&mut node, "local/output", "geometry_msgs/PointStamped")?;
        for topic in ["/output", "/local/input"] {
            met(|| node.wait_for_publisher(topic)).await?;
        }
        met(|| camera.wait_for_subscription(&node)).await?;
        met(|| local.wait_for_subscription(&node)).await?;
        let (mut outputs, mut requested) =
            (Box::pin(output.async_stream()), Box::pin(requested.async_stream()));

        // The node's side of the match may come later than ours: until it did, images are lost or
        // not answered.
        let mut sec = first;
        let mut from_cloud = None;
        let start = Instant::now();
        while from_cloud.is_none() && start.elapsed() < LONG {
            sec += 1;
            send(&camera, sec).await?;
            if let Ok(Some(Ok((point, _)))) = timeout(Duration::from_secs(2), outputs.next()).await
            {
                from_cloud = Some(point);
            }
        }
        let point = from_cloud.ok_or("no output of the cloud")?;
        // The answer to an earlier one, if the host is busy.
        let Header { stamp, frame_id } = point.header;
        assert!((first + 1..=sec).contains(&stamp.sec), "{} of {sec}", stamp.sec);
        assert_eq!(frame_id, "");

        end.send(()).map_err(|()| "the server is gone")?;
        server.await??;
        while timeout(Duration::from_millis(200), requested.next()).await.is_ok() {}
        send(&camera, last).await?;
        let image = loop {
            let (image, _) = timeout(LONG, requested.next()).await?.ok_or("no stream")??;
            if image.header.stamp.sec == last {
                break image;
            }
        };
        let header = Header { frame_id: "local".into(), ..image.header };
        local.publish(PointStamped { header, point: [0.0; 3] }).map_err(|e| e.to_string())?;
        let (point, _) = timeout(LONG, outputs.next()).await?.ok_or("no stream")??;
        assert_eq!((point.header.stamp.sec, &*point.header.frame_id), (last, "local"));
        Ok(())
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.jsonl");
    let file = format!("trace.file:={}", path.display());
    let set = ["clouds:=[west]", &url, "deadline:=5.0", "local.deadline:=20.0", &file];
    Box::pin(beside(settings(domain(1), &set), peers)).await;

    // The origin is the topic, and the stamp says how old the message is.
    let text = std::fs::read_to_string(path).unwrap();
    let verdict = fuseline_traces::judge("trace", text.as_bytes()).unwrap();
    assert!(verdict.violations.is_empty(), "{verdict}");
    let opens: Vec<_> = text.lines().filter(|line| line.contains("\"open\"")).collect();
    for line in &opens {
        let (_, age) = line.split_once("\"age\":").expect("an age");
        let (age, origin) = age.split_once(',').expect("an origin");
        let seconds = age.parse::<u64>().unwrap() / 1_000_000_000;
        assert!((790..1900).contains(&seconds), "{line}");
        assert!(origin.starts_with("\"origin\":\"/input\",\"seq\":"), "{line}");
    }
    let seq = format!("\"seq\":{last}000000000}}");
    assert!(opens.last().unwrap().ends_with(&seq), "{opens:?}");
    // Values are of their messages by their stamps; the cloud's reply does not say so in words.
    for (word, p) in [("result", 0), ("emit", 0), ("result", 1), ("emit", 1)] {
        let p = format!("\"p\":{p}");
        let is_of = |line: &&str| line.contains(word) && line.contains(&p);
        let line = text.lines().find(is_of).expect("it answered");
        assert!(line.contains("\"of\":"), "{line}");
    }
    let lineage = requests.recv().await.flatten().expect("the request says what it comes from");
    assert_eq!(lineage.origin.as_deref(), Some("/input"));
    assert!(lineage.age_ns.unwrap() > 1_790_000_000_000, "{lineage:?}");
}

/// Tells when it is dropped.
struct DropNotice(tokio::sync::mpsc::UnboundedSender<&'static str>);

impl Drop for DropNotice {
    fn drop(&mut self) {
        let _ = self.0.send("ended");
    }
}

#[tokio::test]
async fn a_call_that_no_longer_matters_is_aborted_long_before_its_deadline() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("west.grpc.url:=http://{}", listener.local_addr().unwrap());
    let (publish_report, mut reported) = tokio::sync::mpsc::unbounded_channel();
    let infer = move |_: grpc::Request| {
        let publish_report = publish_report.clone();
        async move {
            publish_report.send("asked").unwrap();
            let _reported = DropNotice(publish_report);
            std::future::pending().await
        }
    };
    tokio::spawn(grpc::serve(infer, Server::default(), listener, std::future::pending()));

    let peers = async {
        let mut node = node_in(domain(2), "camera")?;
        let camera: Publisher<CompressedImage> =
            publisher(&mut node, "input", "sensor_msgs/CompressedImage")?;
        let requested: Subscription<CompressedImage> =
            subscription(&mut node, "east/input", "sensor_msgs/CompressedImage")?;
        let east: Publisher<PointStamped> =
            publisher(&mut node, "east/output", "geometry_msgs/PointStamped")?;
        met(|| node.wait_for_publisher("/east/input")).await?;
        met(|| camera.wait_for_subscription(&node)).await?;
        met(|| east.wait_for_subscription(&node)).await?;
        let mut requested = Box::pin(requested.async_stream());

        // West gets a request and never answers; east, which outranks it, does.
        let start = Instant::now();
        for sec in 1.. {
            assert!(start.elapsed() < LONG, "no call was aborted");
            send(&camera, sec).await?;
            if let Ok(Some(Ok((image, _)))) =
                timeout(Duration::from_secs(1), requested.next()).await
            {
                let header = Header { frame_id: "east".into(), ..image.header };
                east.publish(PointStamped { header, point: [0.0; 3] })
                    .map_err(|e| e.to_string())?;
            }
            let ended = async { while reported.recv().await != Some("ended") {} };
            if timeout(Duration::from_secs(1), ended).await.is_ok() {
                break;
            }
        }
        Ok(())
    };
    let set = [
        "clouds:=[west, east]",
        &url,
        "greatest_deadline:=900.0",
        "deadline:=600.0",
        "local.deadline:=900.0",
    ];
    beside(settings(domain(2), &set), peers).await;
}

#[tokio::test]
async fn messages_of_another_type_are_not_taken_in() {
    let peers = async {
        let mut node = node_in(domain(3), "camera")?;
        // RustDDS sends to a subscriber whatever the type's name there is; others do not.
        let (_stranger, image) = stranger(domain(3)).await?;
        let requested: Subscription<CompressedImage> =
            subscription(&mut node, "local/input", "sensor_msgs/CompressedImage")?;
        met(|| node.wait_for_publisher("/local/input")).await?;
        let mut requested = Box::pin(requested.async_stream());
        let camera: Publisher<CompressedImage> =
            publisher(&mut node, "input", "sensor_msgs/CompressedImage")?;
        met(|| camera.wait_for_subscription(&node)).await?;
        let start = Instant::now();
        for sec in 1000.. {
            assert!(start.elapsed() < LONG, "local was not asked");
            send(&image, sec - 1000).await?;
            send(&camera, sec).await?;
            if let Ok(Some(Ok((image, _)))) =
                timeout(Duration::from_secs(1), requested.next()).await
            {
                assert!(image.header.stamp.sec >= 1000, "a message of another type was taken in");
                // The next message was sent after the node had met both.
                if sec > 1003 {
                    break;
                }
            }
        }
        Ok(())
    };
    // Nobody answers, and each message may be requested all the same.
    Box::pin(beside(settings(domain(3), &["local.deadline:=0.5", "local.in_flight:=64"]), peers))
        .await;
}

/// A publisher of another type, once it has met the node.
async fn stranger(domain: u16) -> Result<(Node, Publisher<CompressedImage>), Any> {
    let mut stranger = node_in(domain, "stranger")?;
    let image = publisher(&mut stranger, "input", "sensor_msgs/Image")?;
    met(|| image.wait_for_subscription(&stranger)).await?;
    Ok((stranger, image))
}

async fn send(camera: &Publisher<CompressedImage>, sec: i32) -> Result<(), Any> {
    let header = Header { stamp: Time { sec, nanosec: 0 }, frame_id: "camera".into() };
    let image = CompressedImage { header, format: String::new(), data: vec![0; 100] };
    Ok(camera.async_publish(image).await.map_err(|error| error.to_string())?)
}
