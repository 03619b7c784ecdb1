//! The vehicle's link: one uplink and one downlink, each with a queue, that all of its requests and replies share.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

use fuseline_deadline::{LinkQueue, LinkRate};
use schemars::JsonSchema;
use serde::Serialize;
use tokio::time::{Instant, sleep_until};

use crate::drives::Drive;

/// Which way; an index.
pub(crate) const UPLINK: usize = 0;
/// The other one.
pub(crate) const DOWNLINK: usize = 1;

#[derive(Clone, Copy, clap::Args)]
pub(crate) struct LinkArgs {
    /// The rate of the vehicle's uplink, in Mbit/s, where the drive has no column `uplink_mbps` [default: no limit].
    #[arg(long, value_name = "MBIT/S", value_parser = mbits, allow_negative_numbers = true)]
    uplink: Option<f64>,
    /// The rate of its downlink, in Mbit/s, where the drive has no column `downlink_mbps` [default: no limit].
    #[arg(long, value_name = "MBIT/S", value_parser = mbits, allow_negative_numbers = true)]
    downlink: Option<f64>,
    /// How much may wait for each, in KB; a request that finds no room fails, a reply is lost.
    #[arg(long, value_name = "KB", default_value = "4000", value_parser = kilobytes,
        allow_negative_numbers = true)]
    link_queue: f64,
}

/// How wide a vehicle's link is.
#[derive(Clone, Copy, PartialEq, Debug, JsonSchema, Serialize)]
pub(crate) struct LinkWidth {
    /// Bits in a second, where the drive does not say; none: no limit.
    pub(crate) uplink: Option<u64>,
    /// The same for the other way.
    pub(crate) downlink: Option<u64>,
    /// How many bytes may wait for each.
    pub(crate) queue_bytes: u64,
}

/// A link whose rates are a drive's, or fixed.
#[derive(Clone, Copy)]
pub(crate) struct RecordedLink<'a> {
    pub(crate) width: LinkWidth,
    /// The drive, and where in it the link's time begins.
    pub(crate) drive: Option<(&'a Drive, Duration)>,
}

/// A link in real time; clones are the same one.
#[derive(Clone)]
pub(crate) struct LiveLink(Arc<LiveLinkState>);

struct LiveLinkState {
    width: LinkWidth,
    drive: Option<(Drive, Duration)>,
    began: Arc<OnceLock<Instant>>,
    queues: Mutex<[LinkQueue; 2]>,
}

impl LinkArgs {
    pub(crate) fn width(&self) -> LinkWidth {
        LinkWidth {
            uplink: self.uplink.map(|mbits| whole(mbits * 1e6)),
            downlink: self.downlink.map(|mbits| whole(mbits * 1e6)),
            queue_bytes: whole(self.link_queue * 1e3),
        }
    }
}

impl LinkWidth {
    const fn fixed(&self, way: usize) -> Option<u64> {
        if way == UPLINK { self.uplink } else { self.downlink }
    }
}

impl RecordedLink<'_> {
    /// Whether it has a limit in some way.
    pub(crate) fn is_limited(&self) -> bool {
        [UPLINK, DOWNLINK].into_iter().any(|way| self.rate(way, 0).is_some())
    }

    /// What it carries at an instant of its time; none: no limit.
    pub(crate) fn rate(&self, way: usize, at: u64) -> Option<LinkRate> {
        let recorded = self.drive.and_then(|(drive, start)| {
            let (bits_per_second, lasts) = drive.rate(way, start + Duration::from_nanos(at))?;
            let lasts = u64::try_from(lasts.as_nanos()).unwrap_or(u64::MAX);
            Some(LinkRate { bits_per_second, until: at.saturating_add(lasts) })
        });
        recorded.or_else(|| self.width.fixed(way).map(LinkRate::constant))
    }

    /// When a message that is given to a queue of this link is through; none if it finds no room.
    pub(crate) fn send(
        &self,
        way: usize,
        queue: &mut LinkQueue,
        at: u64,
        bytes: u64,
    ) -> Option<u64> {
        let Some(free) = self.rate(way, at) else { return Some(at) };
        queue.send(at, bytes, |at| self.rate(way, at).unwrap_or(free))
    }
}

impl LiveLink {
    /// A link whose time begins at `began`, with the rates of `drive` where it has them; none if it has no limit.
    pub(crate) fn new(
        width: LinkWidth,
        drive: Option<(Drive, Duration)>,
        began: Arc<OnceLock<Instant>>,
    ) -> Option<Self> {
        let queues = Mutex::new([LinkQueue::new(width.queue_bytes); 2]);
        let link = Self(Arc::new(LiveLinkState { width, drive, began, queues }));
        link.recorded().is_limited().then_some(link)
    }

    /// Waits until a message is through; whether it found room.
    pub(crate) async fn pass(&self, way: usize, bytes: usize) -> bool {
        let began = *self.0.began.get_or_init(Instant::now);
        let at = u64::try_from(began.elapsed().as_nanos()).unwrap_or(u64::MAX);
        let through = {
            let mut queues = self.0.queues.lock().unwrap_or_else(PoisonError::into_inner);
            self.recorded().send(way, &mut queues[way], at, bytes as u64)
        };
        let Some(through) = through else { return false };
        match began.checked_add(Duration::from_nanos(through)) {
            Some(through) => sleep_until(through).await,
            None => std::future::pending().await,
        }
        true
    }

    fn recorded(&self) -> RecordedLink<'_> {
        let drive = self.0.drive.as_ref().map(|(drive, start)| (drive, *start));
        RecordedLink { width: self.0.width, drive }
    }
}

/// To the nearest.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "options are bounded")]
fn whole(figure: f64) -> u64 {
    figure.round() as u64
}

fn mbits(text: &str) -> Result<f64, &'static str> {
    let mbits = text.trim().parse().ok().filter(|mbits| (0.001..=1e6).contains(mbits));
    mbits.ok_or("it must be from 0.001 to 1000000")
}

fn kilobytes(text: &str) -> Result<f64, &'static str> {
    let kilobytes = text.trim().parse().ok().filter(|kb| (0.001..=1e7).contains(kb));
    kilobytes.ok_or("it must be from 0.001 to 10000000")
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: LinkWidth =
        LinkWidth { uplink: Some(8_000_000), downlink: None, queue_bytes: 10_000 };

    #[test]
    fn a_way_without_a_rate_has_no_limit() {
        let link = RecordedLink { width: WIDTH, drive: None };
        let mut queue = LinkQueue::new(WIDTH.queue_bytes);
        assert_eq!(link.send(UPLINK, &mut queue, 5, 1_000), Some(1_000_005));
        assert_eq!(link.send(UPLINK, &mut queue, 5, 9_500), None);
        assert_eq!(link.send(DOWNLINK, &mut queue, 5, 9_500), Some(5));
        assert!(link.is_limited());
        let none = LinkWidth { uplink: None, ..WIDTH };
        assert!(!RecordedLink { width: none, drive: None }.is_limited());
    }

    #[tokio::test(start_paused = true)]
    async fn all_messages_of_a_vehicle_share_its_queue() {
        let link = LiveLink::new(WIDTH, None, Arc::default()).unwrap();
        let start = Instant::now();
        let (one, other) = tokio::join!(link.pass(UPLINK, 5_000), link.pass(UPLINK, 5_000));
        assert!(one && other);
        // Timers are served by the millisecond.
        assert!((10..=11).contains(&start.elapsed().as_millis()));
        let (one, other) = tokio::join!(link.pass(UPLINK, 5_000), link.pass(UPLINK, 6_000));
        assert!(one && !other, "10 KB may wait");
    }
}
