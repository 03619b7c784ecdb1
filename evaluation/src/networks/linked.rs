//! Frames over a link that has a rate. Each frame waits for the frames before it.

use std::time::Duration;

use fuseline_deadline::LinkDirection;
use fuseline_deadline::LinkQueue;

use crate::approach::{figure, nanos, seconds, whole};
use crate::link::RecordedLink;
use crate::models::REPLY_BYTES;
use crate::networks::policy::OBSERVED;

/// The cloud's response for each frame, from 30 s before a start on. All policies send all frames,
/// so they see the same responses.
pub(crate) struct LinkedResponses {
    /// The responses of the frames before the start, the last of them first.
    before: Vec<Option<u64>>,
    after: Vec<Option<u64>>,
    period: f64,
}

/// How one frame travels. Its instants count from 30 s before the start.
struct LinkedFrame {
    captured: u64,
    /// The instant at which its reply reaches the downlink.
    replied: Option<u64>,
}

impl LinkedResponses {
    /// Computes the responses of a frame every `period`, from 30 s before the start until `longest`
    /// after it, in s. `response` returns the round trip plus the cloud's runtime for a request
    /// that leaves the uplink at an instant.
    pub(crate) fn new(
        link: &RecordedLink<'_>,
        period: f64,
        longest: f64,
        bytes: u64,
        response: impl Fn(u64) -> Option<u64>,
    ) -> Self {
        let origin = whole(OBSERVED);
        let earlier = (1_u64..).map(|frame| nanos(figure(frame) * period));
        let earlier = earlier.take_while(|age| *age <= origin).map(|age| origin - age);
        let mut captured: Vec<u64> = earlier.collect();
        let count = captured.len();
        captured.reverse();
        let later = (0_u64..).map(|frame| figure(frame) * period);
        captured.extend(
            later.take_while(|at| *at <= longest + 2.0 * period).map(|at| origin + nanos(at)),
        );
        let mut uplink = LinkQueue::new(link.width.queue_bytes);
        let send = |captured: u64| {
            let sent = link.send(LinkDirection::Uplink, &mut uplink, captured, bytes);
            let replied = sent.and_then(|sent| Some(sent.saturating_add(response(sent)?)));
            LinkedFrame { captured, replied }
        };
        let frames: Vec<LinkedFrame> = captured.into_iter().map(send).collect();
        let mut responses = received(link, &frames);
        let after = responses.split_off(count);
        responses.reverse();
        Self { before: responses, after, period }
    }

    /// Returns the response of the frame captured this long before the start.
    pub(crate) fn before(&self, age: Duration) -> Option<Duration> {
        let frame = self.index(whole(age)).checked_sub(1)?;
        self.before.get(frame).copied().flatten().map(Duration::from_nanos)
    }

    /// Returns the response of the frame captured this long after the start, in ns.
    pub(crate) fn after(&self, at: u64) -> Option<u64> {
        self.after.get(self.index(at)).copied().flatten()
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a frame's number")]
    fn index(&self, at: u64) -> usize {
        (seconds(at) / self.period).round() as usize
    }
}

/// Returns the time from each frame's capture until its reply has passed the downlink. Replies
/// queue in the order in which they come.
fn received(link: &RecordedLink<'_>, frames: &[LinkedFrame]) -> Vec<Option<u64>> {
    let mut order: Vec<(u64, usize)> = frames
        .iter()
        .enumerate()
        .filter_map(|(index, frame)| Some((frame.replied?, index)))
        .collect();
    order.sort_unstable();
    let mut downlink = LinkQueue::new(link.width.queue_bytes);
    let mut responses = vec![None; frames.len()];
    for (replied, index) in order {
        let through =
            link.send(LinkDirection::Downlink, &mut downlink, replied, REPLY_BYTES as u64);
        responses[index] = through.map(|through| through.saturating_sub(frames[index].captured));
    }
    responses
}
