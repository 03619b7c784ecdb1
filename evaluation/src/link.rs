//! The vehicle's link: one uplink and one downlink, each with a queue, that all of its requests and
//! replies share.

use std::time::Duration;

use fuseline_deadline::{LinkDirection, LinkQueue, LinkRate};
use fuseline_testkit::networks::Drive;
use fuseline_traces::nanos;
use serde::Serialize;

/// The options that say how wide a vehicle's link is.
#[derive(Clone, Copy, clap::Args)]
pub struct LinkArgs {
    /// The rate of the vehicle's uplink, in Mbit/s, where the drive has no column `uplink_mbps`
    /// [default: no limit].
    #[arg(long, value_name = "MBIT/S", value_parser = mbits, allow_negative_numbers = true)]
    uplink: Option<f64>,
    /// The rate of its downlink, in Mbit/s, where the drive has no column `downlink_mbps` [default:
    /// no limit].
    #[arg(long, value_name = "MBIT/S", value_parser = mbits, allow_negative_numbers = true)]
    downlink: Option<f64>,
    /// The room of each queue, in KB; a request that finds no room fails, a reply is lost.
    #[arg(long, value_name = "KB", default_value = "4000", value_parser = kilobytes,
        allow_negative_numbers = true)]
    link_queue: f64,
}

/// The rates of a vehicle's link.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub struct LinkWidth {
    /// The uplink's bits a second if the drive does not state them, or `None` for no limit.
    pub uplink: Option<u64>,
    /// The downlink's bits a second if the drive does not state them, or `None` for no limit.
    pub downlink: Option<u64>,
    /// The number of bytes that may wait in each direction.
    pub queue_bytes: u64,
}

/// A link with fixed rates, or with the rates of a drive.
#[derive(Clone, Copy)]
pub struct RecordedLink<'a> {
    /// The fixed rates and the queues.
    pub width: LinkWidth,
    /// The drive, and where in it the link's time begins.
    pub drive: Option<(&'a Drive, Duration)>,
}

impl LinkArgs {
    /// Returns the width that the options state.
    #[must_use]
    pub fn width(&self) -> LinkWidth {
        LinkWidth {
            uplink: self.uplink.map(|mbits| whole(mbits * 1e6)),
            downlink: self.downlink.map(|mbits| whole(mbits * 1e6)),
            queue_bytes: whole(self.link_queue * 1e3),
        }
    }
}

impl LinkWidth {
    const fn fixed(&self, direction: LinkDirection) -> Option<u64> {
        match direction {
            LinkDirection::Uplink => self.uplink,
            LinkDirection::Downlink => self.downlink,
        }
    }
}

impl RecordedLink<'_> {
    /// Returns `true` if either direction has a limit.
    #[must_use]
    pub fn is_limited(&self) -> bool {
        [LinkDirection::Uplink, LinkDirection::Downlink]
            .into_iter()
            .any(|direction| self.rate(direction, 0).is_some())
    }

    /// Returns the rate at an instant of the link's time, or `None` if there is no limit.
    #[must_use]
    pub fn rate(&self, direction: LinkDirection, at: u64) -> Option<LinkRate> {
        let recorded = self.drive.and_then(|(drive, start)| {
            let (bits_per_second, lasts) =
                drive.rate(direction as usize, start + Duration::from_nanos(at))?;
            Some(LinkRate { bits_per_second, until: at.saturating_add(nanos(lasts)) })
        });
        recorded.or_else(|| self.width.fixed(direction).map(LinkRate::constant))
    }

    /// Returns when a message that is given to a queue of this link has passed it, or `None` if the
    /// queue has no room.
    #[must_use]
    pub fn send(
        &self,
        direction: LinkDirection,
        queue: &mut LinkQueue,
        at: u64,
        bytes: u64,
    ) -> Option<u64> {
        let Some(free) = self.rate(direction, at) else { return Some(at) };
        queue.send(at, bytes, |at| self.rate(direction, at).unwrap_or(free))
    }
}

/// Rounds to the nearest whole number.
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
        assert_eq!(link.send(LinkDirection::Uplink, &mut queue, 5, 1_000), Some(1_000_005));
        assert_eq!(link.send(LinkDirection::Uplink, &mut queue, 5, 9_500), None);
        assert_eq!(link.send(LinkDirection::Downlink, &mut queue, 5, 9_500), Some(5));
        assert!(link.is_limited());
        let none = LinkWidth { uplink: None, ..WIDTH };
        assert!(!RecordedLink { width: none, drive: None }.is_limited());
    }
}
