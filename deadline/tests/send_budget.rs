//! Checks that the send budget never spends more than the link carries, and spends it where it is
//! worth most.

use fuseline_deadline::{Accuracy, End, Expected, Policy, SendBudget, Situation};
use proptest::collection::vec;
use proptest::prelude::*;
use std::time::Duration;

const SECOND: u64 = 1_000_000_000;
const NEVER: Option<u32> = None;
/// Longer than any message takes, unless a test says otherwise.
const LONGEST: Duration = Duration::from_secs(1_000_000);

/// Counts the messages that each stream sends, if all streams offer together `rate` times a second
/// for 60 s.
fn sent<const N: usize>(
    mut budget: SendBudget<N>,
    rate: u64,
    streams: [(u64, f64); N],
) -> [u64; N] {
    let mut sent = [0; N];
    for number in 0..60 * rate {
        for (stream, (bytes, gain)) in streams.iter().enumerate() {
            let now = number * SECOND / rate;
            sent[stream] += u64::from(budget.offer(stream, now, *bytes, *gain));
        }
    }
    sent
}

proptest! {
    #[test]
    fn no_more_is_sent_than_the_rate_times_the_time(
        rate in 0..100_000_u64,
        probe_every in prop_oneof![Just(NEVER), (0..20_u32).prop_map(Some)],
        offers in vec((0..3_usize, 0..SECOND, 0..20_000_u64, -1.0..10.0_f64), 1..200),
    ) {
        let mut budget = SendBudget::<3>::new(rate, LONGEST, probe_every);
        let (mut now, mut sent, mut first) = (0, 0_u128, None);
        for (stream, gap, bytes, gain) in offers {
            now += gap;
            let first = *first.get_or_insert(now);
            if budget.offer(stream, now, bytes, gain) {
                sent += u128::from(bytes) * u128::from(SECOND);
            }
            prop_assert!(sent <= u128::from(rate) * u128::from(now - first));
        }
    }

    #[test]
    fn other_streams_never_harm_a_worthier_one(
        rate in 1_000..200_000_u64, bytes in 100..20_000_u64, other in 100..20_000_u64,
    ) {
        #[expect(clippy::cast_precision_loss, reason = "some thousands of bytes")]
        let gains = (10.0 * bytes as f64, 1.0 * other as f64);
        let alone = sent(SendBudget::new(rate, LONGEST, NEVER), 10, [(bytes, gains.0)]);
        let both = sent(SendBudget::new(rate, LONGEST, NEVER), 10, [(bytes, gains.0), (other, gains.1)]);
        prop_assert_eq!(alone[0], both[0]);
    }
}

#[test]
fn greatest_gain_per_byte_comes_first() {
    // The budget is 1 MB a second for ten offers a second, or 100 KB for each.
    let budget = SendBudget::new(1_000_000, LONGEST, NEVER);
    let streams = [(100_000, 1.0), (33_300, 1.0), (20_000, 0.1), (1_000, 0.0)];
    let [large, small, poor, useless] = sent(budget, 10, streams);
    assert_eq!(small, 599, "it gains most a byte; its first offer makes it known");
    // 66.7 KB are left each time for messages of 100 KB.
    assert_eq!(large, 599 * 667 / 1000);
    assert_eq!((poor, useless), (0, 0));
}

#[test]
fn all_is_sent_where_the_link_carries_all() {
    let budget = SendBudget::new(1_334_000, LONGEST, NEVER);
    // The stream that is worth more saves for a second message first.
    assert_eq!(sent(budget, 10, [(100_000, 1.0), (33_300, 1.0)]), [598, 599]);
}

#[test]
fn passed_over_stream_gets_a_probe() {
    let streams = [(10_000, 5.0), (10_000, 0.0)];
    let [worthy, probed] = sent(SendBudget::new(100_000, LONGEST, Some(30)), 10, streams);
    // The second offer is sent, and then one in 31: 30 are passed over, and the next is the probe.
    assert!((19..=20).contains(&probed), "{probed}");
    assert!((577..=580).contains(&worthy), "{worthy}");
}

#[test]
fn what_is_not_a_gain_is_not_sent() {
    for gain in [0.0, -1.0, f64::NAN, f64::NEG_INFINITY] {
        assert_eq!(
            sent(SendBudget::new(1_000_000, LONGEST, NEVER), 10, [(10, gain)]),
            [0],
            "{gain}"
        );
    }
    let mut budget = SendBudget::<1>::new(1_000_000, LONGEST, NEVER);
    assert!(!budget.offer(1, 0, 10, 1.0), "there is no such stream");
}

#[test]
fn too_long_messages_are_never_sent_or_probed() {
    // The budget is 10 KB a second, so 5 KB take half a second.
    for (bytes, most) in [(5_000, 120), (5_001, 0)] {
        let budget = SendBudget::new(10_000, Duration::from_millis(500), Some(3));
        let [sent] = sent(budget, 10, [(bytes, 9.0)]);
        assert!(sent <= most && (sent > 100) == (most > 0), "{bytes}: {sent}");
    }
}

#[test]
fn a_new_rate_holds_from_then_on() {
    let mut budget = SendBudget::<1>::new(0, LONGEST, NEVER);
    assert!(!budget.offer(0, 0, 1_000, 1.0));
    assert!(!budget.offer(0, 10 * SECOND, 1_000, 1.0));
    budget.set_rate(1_000);
    assert!(!budget.offer(0, 11 * SECOND - 1, 1_000, 1.0));
    assert!(budget.offer(0, 11 * SECOND, 1_000, 1.0));
}

#[test]
fn a_gain_is_the_policys_own_estimate() {
    const LOCAL: Duration = Duration::from_millis(300);
    let cap = Duration::from_millis(500);
    let loss = Accuracy { local: 42.0, cloud: 52.0, price_per_ms: 0.01 };
    let mut policy: Expected<_> = Expected::new(loss, LOCAL, None).unwrap();
    let gain = |policy: &Expected<Accuracy>| policy.gain(&Situation::UNKNOWN, cap);
    assert!(gain(&policy).abs() < 1e-9, "nothing is known");
    for _ in 0..32 {
        policy.ended(End::Answered(Duration::from_millis(200)));
        policy.ended(End::Censored(Duration::from_millis(500)));
    }
    // Half of the messages gain 10 points and save 100 ms.
    let half = gain(&policy);
    assert!((half - 5.5).abs() < 1e-6, "{half}");
    for _ in 0..64 {
        policy.ended(End::Censored(Duration::from_millis(500)));
    }
    assert!(gain(&policy).abs() < 1e-9, "the cloud is gone");
}
