//! Tests that many calls use no more memory than a few do, on one thread and on several.

use std::alloc::System;
use std::future::{Ready, ready};
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use cap::Cap;
use fuseline_tokio::tower::{FallbackLayer, FallbackService};
use fuseline_tokio::{Call, Config, Error, Items, Local, Operator, Setup, Writer, spawn, stream};
use tokio::runtime::Builder;
use tower_layer::Layer;
use tower_service::Service;

const SECOND: Duration = Duration::from_secs(1);

#[global_allocator]
static ALLOCATED: Cap<System> = Cap::new(System, usize::MAX);

/// An operator whose cloud answers, fails, panics and is too late in turn. Local computes in tasks
/// or in threads. Every fourth message has a side request.
struct ChangeableOperator {
    has_threads: bool,
}

impl Operator for ChangeableOperator {
    type Input = u64;
    type Output = u64;

    fn setup(self, setup: &mut Setup<u64, u64>) -> Local<u64, u64> {
        let handle = |message: u64, _: Call| async move {
            match message % 8 {
                5 => Err(Error::from("on purpose")),
                6 => std::future::pending().await,
                7 => panic!("on purpose"),
                _ => Ok(message),
            }
        };
        let deadline = Duration::from_millis(1);
        let cloud = setup.use_cloud(handle, move |message, _| Some((*message, deadline)), Ok, 1);
        cloud.linger = deadline;
        setup.on_late_result(|_| {});
        let answer = |message: u64, _: Call| async move { Ok::<_, Error>(message) };
        let wanted = |message: &u64, _| message.is_multiple_of(4).then_some((*message, SECOND));
        setup.use_side_request(answer, wanted, |_| Ok(()));
        if self.has_threads {
            Local::threads(2, || |message: &u64, _| Ok(*message))
        } else {
            Local::futures(64, |message: Arc<u64>, _| async move { Ok(*message) })
        }
    }
}

async fn messages(writer: &mut Writer<u64>, output: &mut Items<u64>, count: u64) {
    for message in 0..count {
        writer.write(message).unwrap();
        output.read().await.unwrap();
    }
}

/// A service that answers at once.
#[derive(Clone)]
struct EchoService;

impl Service<u64> for EchoService {
    type Response = u64;
    type Error = Error;
    type Future = Ready<Result<u64, Error>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Error>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: u64) -> Self::Future {
        ready(Ok(request))
    }
}

async fn requests(service: &mut FallbackService<u64, u64>, count: u64) {
    for request in 0..count {
        service.call(request).await.unwrap();
    }
}

/// Many calls leave no memory behind (D8).
#[test]
fn many_calls_leave_no_memory_behind() {
    std::panic::set_hook(Box::new(|_| {}));
    for (mut runtime, has_threads) in [
        (Builder::new_current_thread(), false),
        (Builder::new_multi_thread(), false),
        (Builder::new_current_thread(), true),
    ] {
        let runtime = runtime.enable_all().build().unwrap();
        runtime.block_on(async {
            let (mut writer, input) = stream(8);
            let operator = ChangeableOperator { has_threads };
            let (running, mut output) = spawn(operator, Config::default(), input).unwrap();
            // After this many messages, everything that is remembered about the last 1024 messages
            // is allocated.
            messages(&mut writer, &mut output, 1500).await;
            let before = ALLOCATED.allocated();
            messages(&mut writer, &mut output, 3000).await;
            let more = ALLOCATED.allocated().saturating_sub(before);
            assert!(more < 3000 * 12, "{more} bytes more after 3000 messages");
            drop(writer);
            drop(output);
            running.join().await.unwrap();

            let mut service = FallbackLayer::new(EchoService).layer(EchoService);
            requests(&mut service, 1500).await;
            let before = ALLOCATED.allocated();
            requests(&mut service, 3000).await;
            let more = ALLOCATED.allocated().saturating_sub(before);
            assert!(more < 3000 * 12, "{more} bytes more after 3000 requests");
        });
    }
}
