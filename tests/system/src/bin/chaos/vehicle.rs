//! The operator under test: local and two clouds, with no other configuration.

use std::sync::Arc;
use std::time::Duration;

use bytes::{Buf, BufMut, BytesMut};
use fuseline_tokio::grpc::{self, Connection, Reply, Request};
use fuseline_tokio::{Call, Error, Local, Operator, Setup};
use tokio::time::{Instant, sleep};

use crate::gauges::Overruns;

/// The time that a cloud may take.
pub(crate) const DEADLINE: Duration = Duration::from_millis(100);

/// The time that local takes.
const LOCAL: Duration = Duration::from_millis(5);

/// Every message of this number goes only to the lower cloud, so that both clouds have outputs when
/// nothing is disrupted.
const LOWER_ALONE: u64 = 4;

/// The origin of a result.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct ResultOrigin {
    pub(crate) operator: u64,
    pub(crate) message: u64,
    /// The cloud's number, or `None` for local.
    pub(crate) cloud: Option<usize>,
}

/// An operator's number, its clouds, and the record of calls that outlived their deadlines.
pub(crate) struct ChaosVehicle {
    pub(crate) number: u64,
    /// The number and the connection of each cloud, with the lower one first.
    pub(crate) clouds: [(usize, Connection); 2],
    /// The calls that outlived their deadlines.
    pub(crate) outlived: Arc<Overruns>,
}

/// Returns a cloud's name in tallies and traces.
pub(crate) fn name(cloud: Option<usize>) -> String {
    cloud.map_or_else(|| "local".to_owned(), |cloud| format!("cloud-{cloud}"))
}

impl Operator for ChaosVehicle {
    type Input = u64;
    type Output = ResultOrigin;

    fn setup(self, setup: &mut Setup<u64, ResultOrigin>) -> Local<u64, ResultOrigin> {
        let operator = self.number;
        for (priority, (number, connection)) in (1..).zip(self.clouds) {
            let message_handler = move |message: &u64, timestamp| {
                let is_requested = priority == 1 || !message.is_multiple_of(LOWER_ALONE);
                let mut payload = BytesMut::new();
                payload.put_u64(operator);
                payload.put_u64(*message);
                let request =
                    Request { timestamp, payload: payload.freeze(), ..Request::default() };
                is_requested.then_some((request, DEADLINE))
            };
            let response_handler = move |reply: Reply| {
                let mut payload = reply.payload;
                let answer = ResultOrigin {
                    operator: payload.try_get_u64()?,
                    message: payload.try_get_u64()?,
                    cloud: Some(usize::try_from(payload.try_get_u64()?)?),
                };
                let is_own = answer.cloud == Some(number);
                is_own.then_some(answer).ok_or_else(|| "another cloud's".into())
            };
            let (infer, outlived) = (grpc::infer(connection), Arc::clone(&self.outlived));
            let handle = move |request, call: Call| {
                let life = CallGuard {
                    ends: Instant::now() + call.deadline,
                    outlived: Arc::clone(&outlived),
                };
                let call = infer(request, call);
                async move {
                    let _life = life;
                    call.await
                }
            };
            let cloud = setup.use_cloud(handle, message_handler, response_handler, priority);
            cloud.name = name(Some(number));
        }
        Local::futures(16, move |message: Arc<u64>, _| async move {
            sleep(LOCAL).await;
            Ok::<_, Error>(ResultOrigin { operator, message: *message, cloud: None })
        })
    }
}

/// Checks that a call ends by its deadline.
struct CallGuard {
    ends: Instant,
    outlived: Arc<Overruns>,
}

impl Drop for CallGuard {
    fn drop(&mut self) {
        let by = self.ends.elapsed();
        if !by.is_zero() {
            self.outlived.note(by);
        }
    }
}
