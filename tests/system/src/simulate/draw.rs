//! Draws scenarios from seeds: quiet ones, wild ones, and many near their edges. `play` runs them.

use std::iter;
use std::time::Duration;

use fuseline_testkit::Rng;
use fuseline_tokio::Commit;

use crate::simulate::scenario::{
    CallResult, Disk, Finish, MessageScript, OfferAction, OnBoard, ReaderPlan, Scenario,
    ScenarioCloud, ScenarioLink, SourceAction,
};

/// This many lines of a trace may always wait for the disk, because the disk is as slow as the
/// host.
const LINES: usize = 30_000;

/// A source's behaviour for some time.
#[derive(Clone, Copy)]
enum SourcePhase {
    /// It returns a result within this time.
    Fair(Duration),
    /// It returns a result around its due instant.
    Edge,
    /// It never returns a result.
    Dead,
    /// It fails at once.
    Refusing,
    /// It does anything.
    Wild,
}

impl Scenario {
    /// Draws the run of this seed.
    pub(crate) fn of_seed(seed: u64) -> Self {
        let mut rng = Rng::with_seed(seed);
        let rng = &mut rng;
        let priorities = priorities(rng);
        let local = local(rng);
        let clouds: Vec<ScenarioCloud> = priorities.into_iter().map(|p| remote(rng, p)).collect();
        let count = match rng.u8(0..10) {
            0..2 => rng.usize(1..8),
            2..4 => rng.usize(8..80),
            _ => rng.usize(80..LINES / (6 + 5 * clouds.len())),
        };
        let gap = Duration::from_micros(rng.one_of(&[0, 200, 1_000, 5_000, 20_000]));
        let span = gap.saturating_mul(u32::try_from(count).unwrap_or(u32::MAX));
        let end = finish(rng, span);
        let side = rng.u8(0..6) == 0;
        let side = side.then(|| (rng.u64(1..4), rng.usize(1..4)));
        let frames = frames(rng, count, gap, &clouds, (&local, end), side.is_some());
        let readers = rng.one_of(&[1, 1, 1, 2, 3]);
        let readers = iter::repeat_with(|| audience(rng, end)).take(readers).collect();
        let mut drawn = Self {
            seed,
            readers,
            window: rng.one_of(&[1, 2, 3, 8, 16, 64, 1024]),
            commit: rng.one_of(&[Commit::Eager, Commit::Patient]),
            input_len: rng.one_of(&[1, 4, 64, 1024]),
            output_len: rng.one_of(&[1, 2, 16, 1024]),
            local,
            clouds,
            link: None,
            side,
            metered: rng.u8(0..8) == 0,
            hints: (rng.u8(0..4) == 0).then(|| rng.u8(0..4) == 0),
            disk: match rng.u8(0..12) {
                0 => Disk::Whole(Some(rng.u64(1..20_000))),
                1 => Disk::FullAfter(rng.u64(1..6), rng.u64(1..20_000)),
                _ => Disk::Whole(None),
            },
            stalls: stalls(rng, span),
            frames,
            end,
        };
        // This comes last, so that earlier seeds keep their runs.
        if rng.u8(0..3) == 0 {
            drawn.commit = Commit::Progressive;
        }
        drawn.link = link(rng);
        if drawn.link.is_some() {
            bound_deadlines(&mut drawn.frames);
        }
        drawn
    }
}

/// Gives each cloud a deadline that ends, because a result that the link loses has no other end.
fn bound_deadlines(frames: &mut [MessageScript]) {
    for message in frames {
        for offer in message.offers.iter_mut().chain([&mut message.side]) {
            if let OfferAction::Offers(deadline, _) = offer {
                *deadline = (*deadline).min(Duration::from_secs(5));
            }
        }
    }
}

/// Draws a link, from one that is hardly felt to one that carries almost nothing.
fn link(rng: &mut Rng) -> Option<ScenarioLink> {
    let rate = |rng: &mut Rng| rng.one_of(&[1_000_000, 20_000_000, 1_000_000_000]);
    let is_there = rng.u8(0..4) == 0;
    is_there.then(|| ScenarioLink {
        rates: [rate(rng), rate(rng)],
        queue_bytes: rng.one_of(&[0, 10_000, 1_000_000]),
        bytes: [rng.usize(1..40_000), rng.usize(1..2_000)],
    })
}

fn local(rng: &mut Rng) -> OnBoard {
    OnBoard {
        at_once: rng.one_of(&[1, 2, 4, 64]),
        waiting: (rng.u8(0..3) == 0).then(|| rng.usize(0..8)),
        skip_answered: rng.u8(0..3) == 0,
        deadline: (rng.u8(0..3) > 0).then(|| edge(rng, Duration::from_millis(30))),
    }
}

fn remote(rng: &mut Rng, p: u16) -> ScenarioCloud {
    let limit = rng.one_of(&[1, 2, 5, 31, 1000]);
    let linger = Duration::from_millis(rng.one_of(&[0, 0, 0, 10, 100]));
    ScenarioCloud {
        p,
        limit,
        resume: rng.u64(0..limit),
        calls: rng.one_of(&[1, 2, 8, 64]),
        linger,
        policy: (rng.u8(0..5) == 0).then(|| Duration::from_millis(rng.one_of(&[0, 5, 20, 1000]))),
    }
}

/// Draws the messages, with what each source does about them.
fn frames(
    rng: &mut Rng,
    count: usize,
    gap: Duration,
    clouds: &[ScenarioCloud],
    (local, end): (&OnBoard, Finish),
    side: bool,
) -> Vec<MessageScript> {
    let mut skies = vec![(0, SourcePhase::Wild); clouds.len() + 2];
    let mut frames = Vec::with_capacity(count);
    for _ in 0..count {
        for (remaining, phase) in &mut skies {
            if *remaining == 0 {
                (*remaining, *phase) = (rng.usize(4..80), sky(rng));
            }
            *remaining -= 1;
        }
        let due = local.deadline.unwrap_or(Duration::from_millis(30));
        let mut of_local = act(rng, skies[0].1, due);
        // A computation without a deadline that does not end by itself never ends (A9).
        if local.deadline.is_none() && of_local.result.hangs() && !matches!(end, Finish::Stop(_)) {
            of_local.result = CallResult::Fails;
        }
        let offers = clouds.iter().zip(&skies[2..]).map(|(_, sky)| offer_action(rng, sky.1));
        let offers = offers.collect();
        let side = if side { offer_action(rng, skies[1].1) } else { OfferAction::Nothing };
        let gap = match rng.u8(0..16) {
            0 => gap * rng.u32(2..20),
            1..4 => Duration::ZERO,
            4 => gap + Duration::from_nanos(rng.u64(1..2_000_000)),
            _ => gap,
        };
        let yields = if rng.u8(0..8) == 0 { rng.u8(1..6) } else { 0 };
        frames.push(MessageScript { gap, yields, local: of_local, offers, side });
    }
    frames
}

fn sky(rng: &mut Rng) -> SourcePhase {
    match rng.u8(0..16) {
        0..8 => SourcePhase::Fair(Duration::from_millis(rng.one_of(&[1, 5, 20, 50]))),
        8..11 => SourcePhase::Edge,
        11..13 => SourcePhase::Dead,
        13 => SourcePhase::Refusing,
        _ => SourcePhase::Wild,
    }
}

fn offer_action(rng: &mut Rng, phase: SourcePhase) -> OfferAction {
    match rng.u8(0..40) {
        0..3 => OfferAction::Nothing,
        3 => OfferAction::Panics,
        4 => OfferAction::Offers(Duration::ZERO, SourceAction::answers(Duration::ZERO)),
        5 => OfferAction::Offers(
            Duration::MAX,
            act(rng, SourcePhase::Fair(Duration::ZERO), Duration::ZERO),
        ),
        _ => {
            let deadline = Duration::from_millis(rng.one_of(&[1, 10, 20, 20, 20, 21, 50]));
            let deadline = edge(rng, deadline);
            OfferAction::Offers(deadline, act(rng, phase, deadline))
        }
    }
}

/// Draws the action of a source with a deadline.
fn act(rng: &mut Rng, phase: SourcePhase, deadline: Duration) -> SourceAction {
    let yields = if rng.u8(0..8) == 0 { rng.u8(1..4) } else { 0 };
    let (after, result) = match phase {
        SourcePhase::Fair(most) => (most.mul_f64(rng.f64()), CallResult::Answers),
        SourcePhase::Edge => (edge(rng, deadline), CallResult::Answers),
        SourcePhase::Dead => (Duration::ZERO, CallResult::Hangs),
        SourcePhase::Refusing => (Duration::ZERO, CallResult::Fails),
        SourcePhase::Wild => {
            let after = rng.one_of(&[Duration::ZERO, deadline / 2, deadline, deadline * 2]);
            (after.min(Duration::from_secs(5)), rng.one_of(&CallResult::ALL))
        }
    };
    SourceAction { after, yields, result }
}

fn finish(rng: &mut Rng, span: Duration) -> Finish {
    let at = (span + Duration::from_millis(30)).mul_f64(rng.f64());
    match rng.u8(0..10) {
        0..7 => Finish::Input,
        7 => Finish::Alone,
        8 => Finish::Stop(at),
        _ => Finish::Crash(at),
    }
}

/// Draws a reader. A reader that leaves is rare.
fn audience(rng: &mut Rng, end: Finish) -> ReaderPlan {
    let is_lazy = rng.u8(0..5) == 0;
    let lag =
        (rng.u8(0..6) == 0).then(|| (rng.usize(0..60), Duration::from_millis(rng.u64(0..400))));
    ReaderPlan {
        joins_after: rng.usize(0..40),
        pace: if is_lazy { Duration::from_micros(rng.u64(0..3000)) } else { Duration::ZERO },
        lag,
        leaves_after: (rng.u8(0..12) == 0 && end != Finish::Alone).then(|| rng.usize(0..60)),
    }
}

/// Draws stalls of whole milliseconds: tokio's clock advances by these, and would be up to two late
/// between them.
fn stalls(rng: &mut Rng, span: Duration) -> Vec<(Duration, Duration)> {
    let count = rng.one_of(&[0, 0, 0, 1, 4]);
    let stall = |rng: &mut Rng| (span.mul_f64(rng.f64()), Duration::from_millis(rng.u64(1..90)));
    let mut stalls: Vec<_> = iter::repeat_with(|| stall(rng)).take(count).collect();
    stalls.sort_unstable();
    stalls
}

fn priorities(rng: &mut Rng) -> Vec<u16> {
    let count = if rng.u8(0..40) == 0 { 15 } else { rng.one_of(&[0, 1, 1, 1, 1, 2, 2, 2, 3, 5]) };
    let mut drawn: Vec<u16> = rng.sample(1..=20, count);
    if rng.u8(0..10) == 0
        && let Some(last) = drawn.last_mut()
    {
        *last = u16::MAX;
    }
    rng.shuffle(&mut drawn);
    drawn
}

/// Returns about this duration: exactly, a nanosecond off, or up to half as much off.
fn edge(rng: &mut Rng, about: Duration) -> Duration {
    match rng.u8(0..8) {
        0..3 => about,
        3 => about.saturating_sub(Duration::from_nanos(1)),
        4 => about + Duration::from_nanos(1),
        5 => about.saturating_sub(Duration::from_millis(1)),
        6 => about + Duration::from_millis(1),
        _ => about.mul_f64(0.5 + rng.f64()),
    }
}

impl CallResult {
    const ALL: [Self; 8] = [
        Self::Answers,
        Self::Fails,
        Self::Panics,
        Self::PanicsAtOnce,
        Self::BadResponse,
        Self::PanickingResponse,
        Self::Hangs,
        Self::HangsAndPanics,
    ];

    const fn hangs(self) -> bool {
        matches!(self, Self::Hangs | Self::HangsAndPanics)
    }
}
