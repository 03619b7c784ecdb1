//! Finds out when peers have met the second participant.
//!
//! Discovery reports whom this process has met. A peer may meet this process seconds later, if an
//! announcement is lost. Until then, the peer gets nothing from the second participant, and sends
//! nothing to it.

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use rustdds::no_key::DataWriter;
use rustdds::{GUID, WriteOptionsBuilder};
use tokio::sync::oneshot;
use tokio::time::sleep;

use crate::middleware::end::Endpoint;
use crate::raw::{Cdr, Payload};
use crate::settings::Qos;

/// The time from one look at what two subscriptions received to the next.
const PERIOD: Duration = Duration::from_millis(100);

/// A subscription of a participant's. It ends when this is dropped.
pub(crate) struct OpenSubscription {
    end: Arc<Endpoint>,
    _open: oneshot::Sender<()>,
}

/// Waits until each reliable subscriber of a new publisher has met it.
///
/// It writes a sample that is for nobody. Subscribers are told that there is nothing under its
/// number, and acknowledge it.
pub(crate) async fn until_met(writer: &DataWriter<Payload, Cdr>, qos: Qos) {
    // `rustdds` would not tell that to a later subscriber of a transient-local topic, which then
    // waits for the sample.
    if !qos.reliable || qos.transient_local {
        return;
    }
    let nobody = WriteOptionsBuilder::new().to_single_reader(GUID::GUID_UNKNOWN).build();
    let nothing = Payload { big_endian: false, body: Bytes::new() };
    if writer.write_with_options(nothing, nobody).is_ok() {
        drop(writer.async_wait_for_acknowledgments().await);
    }
}

impl OpenSubscription {
    /// Returns it, and what resolves when it ends.
    pub(crate) fn new(end: Arc<Endpoint>) -> (Self, impl Future<Output = ()> + Send + 'static) {
        let (open, closed) = oneshot::channel();
        (Self { end, _open: open }, async move { drop(closed.await) })
    }

    /// Waits until the next one gets all that the publishers of this one send.
    pub(crate) async fn until_followed_by(&self, next: &Endpoint) {
        while !next.follows(&self.end) {
            sleep(PERIOD).await;
        }
    }
}
