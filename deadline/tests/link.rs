//! Checks the properties that any link's queue must have: it loses and invents nothing, is first
//! in, first out, and exceeds no rate.

use fuseline_deadline::{LinkQueue, LinkRate};
use proptest::collection::vec;
use proptest::prelude::*;

const QUEUE: u64 = 5_000;

/// Rates that hold for a while each. The last one holds without end and is above 0.
#[derive(Clone, Debug)]
struct VaryingRate(Vec<(u64, u64)>);

impl VaryingRate {
    fn at(&self, instant: u64) -> LinkRate {
        let mut until = 0_u64;
        for (lasts, bits_per_second) in &self.0 {
            until += lasts;
            if instant < until {
                return LinkRate { bits_per_second: *bits_per_second, until };
            }
        }
        LinkRate::constant(3_000_000)
    }

    /// Returns the billionths of bits that it carries between two instants.
    fn carried(&self, mut from: u64, to: u64) -> u128 {
        let mut carried = 0;
        while from < to {
            let LinkRate { bits_per_second, until } = self.at(from);
            carried += u128::from(bits_per_second) * u128::from(until.min(to) - from);
            from = until.min(to);
        }
        carried
    }
}

fn rates() -> impl Strategy<Value = VaryingRate> {
    vec((1..5_000_000_u64, prop_oneof![Just(0), 1..50_000_000_u64]), 0..8).prop_map(VaryingRate)
}

/// Returns gaps in ns and sizes in bytes.
fn messages() -> impl Strategy<Value = Vec<(u64, u64)>> {
    vec((prop_oneof![Just(0), 0..3_000_000_u64], 0..2_500_u64), 1..60)
}

/// A message that was accepted: the instant, its bytes, and the instant when it was sent.
struct SentMessage {
    at: u64,
    bytes: u64,
    through: u64,
}

fn send(rate: &VaryingRate, messages: &[(u64, u64)]) -> (Vec<SentMessage>, Vec<(u64, u64)>) {
    let mut queue = LinkQueue::new(QUEUE);
    let (mut sent, mut refused, mut at) = (Vec::new(), Vec::new(), 0);
    for (gap, bytes) in messages {
        at += gap;
        match queue.send(at, *bytes, |instant| rate.at(instant)) {
            Some(through) => sent.push(SentMessage { at, bytes: *bytes, through }),
            None => refused.push((at, *bytes)),
        }
    }
    (sent, refused)
}

fn work(bytes: u64) -> u128 {
    u128::from(bytes) * 8_000_000_000
}

/// Returns the unsent amount at an instant, of the messages that were accepted by then. It only
/// adds and subtracts.
fn waiting(rate: &VaryingRate, sent: &[SentMessage], at: u64) -> u128 {
    let (mut waiting, mut now) = (0_u128, 0);
    for message in sent.iter().filter(|message| message.at <= at) {
        waiting = waiting.saturating_sub(rate.carried(now, message.at)) + work(message.bytes);
        now = message.at;
    }
    waiting.saturating_sub(rate.carried(now, at))
}

proptest! {
    #[test]
    fn messages_pass_once_and_within_the_rate(
        rate in rates(), messages in messages(),
    ) {
        let (sent, _) = send(&rate, &messages);
        for (index, message) in sent.iter().enumerate() {
            // The queue conserves messages: just before a message is sent something waits, and
            // afterwards nothing of it and of earlier messages does.
            let before = &sent[..=index];
            prop_assert_eq!(waiting(&rate, before, message.through), 0);
            if message.through > message.at {
                prop_assert!(waiting(&rate, before, message.through - 1) > 0);
            }
        }
    }

    #[test]
    fn the_first_in_is_the_first_out(rate in rates(), messages in messages()) {
        let (sent, _) = send(&rate, &messages);
        prop_assert!(sent.iter().all(|message| message.at <= message.through));
        prop_assert!(sent.is_sorted_by_key(|message| message.through));
    }

    #[test]
    fn no_rate_is_exceeded_between_any_two_ends(rate in rates(), messages in messages()) {
        let (sent, _) = send(&rate, &messages);
        for (index, first) in sent.iter().enumerate() {
            let mut bytes = 0;
            for last in &sent[index + 1..] {
                bytes += last.bytes;
                // An end is rounded up, so the previous one may be up to a nanosecond early.
                let carried = rate.carried(first.through.saturating_sub(1), last.through);
                prop_assert!(work(bytes) <= carried, "{bytes} bytes in {}..{}", first.through, last.through);
            }
        }
    }

    #[test]
    fn a_message_is_refused_only_where_it_does_not_fit(rate in rates(), messages in messages()) {
        let (sent, refused) = send(&rate, &messages);
        for (at, bytes) in refused {
            let waits = waiting(&rate, &sent, at);
            prop_assert!(waits > 0 && waits + work(bytes) > work(QUEUE));
        }
    }
}

#[test]
fn a_message_takes_its_bytes_over_the_rate_rounded_up() {
    let rate = |_| LinkRate::constant(3);
    let mut queue = LinkQueue::new(1_000);
    assert_eq!(queue.send(10, 1, rate), Some(10 + 2_666_666_667));
    // The fraction is not lost: six bytes take 16 s.
    assert_eq!(queue.send(10, 5, rate), Some(10 + 16_000_000_000));
    assert_eq!(queue.waiting(10 + 15_999_999_999, rate), 1);
    assert_eq!(queue.waiting(10 + 16_000_000_000, rate), 0);
    assert_eq!(queue.send(20_000_000_000, 0, rate), Some(20_000_000_000));
}

#[test]
fn full_queue_refuses_and_empty_takes_anything() {
    let rate = |_| LinkRate::constant(8_000_000);
    let mut queue = LinkQueue::new(1_000);
    assert_eq!(queue.send(0, 5_000, rate), Some(5_000_000), "it is empty");
    assert_eq!(queue.send(0, 1, rate), None);
    assert_eq!(queue.send(4_000_000, 1, rate), None, "exactly the limit waits");
    assert_eq!(queue.send(4_001_000, 1, rate), Some(5_001_000));
    assert_eq!(queue.send(4_001_000, 1, rate), None);
    assert_eq!(queue.send(5_001_000, 9_000, rate), Some(14_001_000));
}

#[test]
fn nothing_passes_while_the_rate_is_0() {
    let second = 1_000_000_000;
    let outage = |at| {
        if at < second {
            LinkRate { bits_per_second: 0, until: second }
        } else {
            LinkRate::constant(8_000)
        }
    };
    let mut queue = LinkQueue::new(1_000);
    assert_eq!(queue.send(0, 500, outage), Some(second + 500_000_000));
    assert_eq!(queue.waiting(second, outage), 500);
    let mut never = LinkQueue::new(1_000);
    assert_eq!(never.send(0, 1, |_| LinkRate::constant(0)), Some(u64::MAX));
}

#[test]
fn an_instant_before_the_last_one_counts_as_that() {
    let rate = |_| LinkRate::constant(8_000_000);
    let mut queue = LinkQueue::new(1_000);
    assert_eq!(queue.send(1_000, 100, rate), Some(101_000));
    assert_eq!(queue.send(0, 100, rate), Some(201_000));
}
