//! The table of configurations.

use fuseline_traces::{Cloud, Commit};

use super::{Readings, Size, World};
use crate::sighting::Sighting;

/// Sightings that the patient rule cannot show.
const EAGER: &[Sighting] =
    &[Sighting::EagerOverPending, Sighting::EagerOwn, Sighting::LimitHolds, Sighting::StaysArmed];
/// Sightings that the eager rule cannot show.
const PATIENT: &[Sighting] = &[Sighting::PatientWaits, Sighting::Disarmed];
/// Sightings that the rules which hold results cannot show.
const SENT: &[Sighting] = &[
    Sighting::Improved,
    Sighting::ImprovedAgain,
    Sighting::Outranked,
    Sighting::OutrankedDropped,
    Sighting::FinalByTimer,
    Sighting::FinalByFailure,
];
/// Sightings that the progressive rule cannot show.
const HELD: &[Sighting] = &[
    Sighting::EagerOverPending,
    Sighting::EagerOwn,
    Sighting::LimitHolds,
    Sighting::StaysArmed,
    Sighting::PatientWaits,
    Sighting::Disarmed,
    Sighting::ResultHeld,
    Sighting::FailForwards,
    Sighting::TimerForwards,
    Sighting::BestOfTwo,
    Sighting::Prompt,
    Sighting::Floor,
    Sighting::Discarded,
    Sighting::LastRequest,
    // A firing sends nothing under progressive.
    Sighting::Once,
];
/// Sightings that need backlogs around the limit of a gate.
const GATES: &[Sighting] = &[Sighting::GateShuts, Sighting::GateStays, Sighting::GateOpens];
/// Sightings that need a cloud with a held result, and a second cloud that outranks it.
const TWO_CLOUDS: &[Sighting] = &[
    Sighting::OfferJoins,
    Sighting::EagerOverPending,
    Sighting::EagerOwn,
    Sighting::LimitHolds,
    Sighting::PatientWaits,
    Sighting::StaysArmed,
    Sighting::Disarmed,
    Sighting::BestOfTwo,
    Sighting::Cancelled,
    Sighting::OutrankedDropped,
];
/// Sightings that need three clouds: a cloud that is offered, a cloud with a held result, and a
/// cloud that outranks it.
const THREE_CLOUDS: &[Sighting] = &[Sighting::OfferOutranked, Sighting::Outranked];
/// Sightings that need a second timestamp.
const TWO_TIMESTAMPS: &[Sighting] = &[Sighting::OpenFull, Sighting::OpenRoom];
/// Sightings that need two open timestamps.
const TWO_OPEN: &[Sighting] = &[Sighting::TimestampsTogether];
/// Sightings that need a deadline for local.
const LIMITS: &[Sighting] = &[
    Sighting::OpenLimited,
    Sighting::LimitAlone,
    Sighting::LimitWithCloud,
    Sighting::LimitHolds,
    Sighting::LimitRetires,
];
/// Sightings that need results after the instant of the state.
const LEAPS: &[Sighting] =
    &[Sighting::TimerFirst, Sighting::Once, Sighting::DueInstant, Sighting::OpenRoom];
/// Sightings that need three readings of the clock.
const THREE_INSTANTS: &[Sighting] = &[Sighting::DuesPassed, Sighting::EagerOverPending];

/// Returns a cloud whose gate shuts with one message in its queue.
const fn cloud(p: u16) -> Cloud {
    Cloud { p, name: None, limit: 1, resume: 0 }
}

const ONE: &[Cloud] = &[cloud(5)];
const TWO: &[Cloud] = &[cloud(5), cloud(2)];
const THREE: &[Cloud] = &[cloud(5), cloud(2), cloud(7)];

const MAX: u64 = u64::MAX;

/// The values that most rows share.
const BASE: World = World {
    name: "",
    size: Size::Quick,
    commit: Commit::Eager,
    window: 1,
    clouds: ONE,
    timestamps: &[0],
    clock: &[0, 1, 2, 3],
    readings: Readings::Now,
    local_deadlines: &[None, Some(2)],
    deadlines: &[1, 2],
    backlogs: &[0],
    absent: &[SENT],
    states: 0,
};

const NARROW: World =
    World { timestamps: &[0, 1], clock: &[0, 1, 2, 3, 4], readings: Readings::Any, ..BASE };

const TALL: World = World {
    clouds: TWO,
    clock: &[0, 1, 2, 3, 4],
    readings: Readings::Any,
    deadlines: &[1, 2, 3],
    ..BASE
};

const EDGES: World = World {
    window: 2,
    timestamps: &[0, MAX - 1, MAX],
    clock: &[0, MAX - 2, MAX - 1, MAX],
    readings: Readings::Any,
    local_deadlines: &[None, Some(1), Some(MAX)],
    deadlines: &[1, MAX],
    ..BASE
};

const WIDE: World = World {
    size: Size::Standard,
    window: 2,
    clouds: TWO,
    timestamps: &[0, 1, 2],
    clock: &[0, 1, 2, 3, 4],
    readings: Readings::Next,
    ..BASE
};

const HIGH: World = World {
    clouds: THREE,
    clock: &[0, 1, 2, 3],
    readings: Readings::Any,
    deadlines: &[1, 2],
    ..BASE
};

const HIGHER: World = World {
    size: Size::Standard,
    clock: &[0, 1, 2, 3, 4, 5, 6],
    local_deadlines: &[None, Some(1), Some(3)],
    deadlines: &[1, 2, 3, 4],
    ..HIGH
};

const LONG: World = World { size: Size::Large, deadlines: &[1, 2, 3], ..WIDE };

const BROAD: World = World {
    size: Size::Large,
    window: 2,
    clouds: THREE,
    timestamps: &[0, 1],
    clock: &[0, 1, 2],
    local_deadlines: &[None],
    ..BASE
};

/// All configurations: quick ones first, large ones last.
pub const WORLDS: &[World] = &[
    World {
        name: "1x2w1-eager",
        absent: &[SENT, GATES, TWO_CLOUDS, THREE_CLOUDS, TWO_OPEN],
        states: 267,
        ..NARROW
    },
    World {
        name: "1x2w1-patient",
        commit: Commit::Patient,
        absent: &[SENT, GATES, TWO_CLOUDS, THREE_CLOUDS, TWO_OPEN],
        states: 267,
        ..NARROW
    },
    World {
        name: "gate",
        window: 2,
        clouds: &[
            Cloud { p: 5, name: None, limit: 2, resume: 1 },
            Cloud { p: 2, name: None, limit: 3, resume: 1 },
        ],
        timestamps: &[0, 1],
        clock: &[0, 1],
        local_deadlines: &[None],
        deadlines: &[1],
        backlogs: &[0, 1, 2, 3],
        absent: &[SENT, PATIENT, THREE_CLOUDS, LIMITS, LEAPS, THREE_INSTANTS, TWO_TIMESTAMPS],
        states: 2666,
        ..BASE
    },
    World {
        name: "2x1-eager",
        absent: &[SENT, PATIENT, GATES, THREE_CLOUDS, TWO_TIMESTAMPS, TWO_OPEN],
        states: 1446,
        ..TALL
    },
    World {
        name: "2x1-patient",
        commit: Commit::Patient,
        absent: &[SENT, EAGER, GATES, THREE_CLOUDS, TWO_TIMESTAMPS, TWO_OPEN],
        states: 1344,
        ..TALL
    },
    World {
        name: "3x1-short-eager",
        absent: &[SENT, PATIENT, GATES, TWO_TIMESTAMPS, TWO_OPEN],
        states: 3596,
        ..HIGH
    },
    World {
        name: "3x1-short-patient",
        commit: Commit::Patient,
        absent: &[SENT, EAGER, GATES, TWO_TIMESTAMPS, TWO_OPEN],
        states: 3056,
        ..HIGH
    },
    World {
        name: "1x2w1-progressive",
        commit: Commit::Progressive,
        absent: &[HELD, GATES, TWO_CLOUDS, THREE_CLOUDS, TWO_OPEN],
        states: 267,
        ..NARROW
    },
    World {
        name: "2x1-progressive",
        commit: Commit::Progressive,
        absent: &[HELD, GATES, THREE_CLOUDS, TWO_TIMESTAMPS, TWO_OPEN],
        states: 1408,
        ..TALL
    },
    World {
        name: "3x1-short-progressive",
        commit: Commit::Progressive,
        absent: &[HELD, GATES, TWO_TIMESTAMPS, TWO_OPEN],
        states: 3445,
        ..HIGH
    },
    World {
        name: "edges-eager",
        absent: &[SENT, GATES, TWO_CLOUDS, THREE_CLOUDS],
        states: 4876,
        ..EDGES
    },
    World {
        name: "edges-patient",
        commit: Commit::Patient,
        absent: &[SENT, GATES, TWO_CLOUDS, THREE_CLOUDS],
        states: 4876,
        ..EDGES
    },
    World {
        name: "1x4w3",
        size: Size::Standard,
        window: 3,
        timestamps: &[0, 1, 2, 3],
        local_deadlines: &[None],
        absent: &[
            SENT,
            GATES,
            TWO_CLOUDS,
            THREE_CLOUDS,
            LIMITS,
            LEAPS,
            &[Sighting::TimersTogether],
        ],
        states: 19_136,
        ..BASE
    },
    World {
        name: "2x3w2-eager",
        absent: &[SENT, PATIENT, GATES, THREE_CLOUDS],
        states: 356_972,
        ..WIDE
    },
    World {
        name: "2x3w2-patient",
        commit: Commit::Patient,
        absent: &[SENT, EAGER, GATES, THREE_CLOUDS],
        states: 326_300,
        ..WIDE
    },
    World {
        name: "3x1-eager",
        absent: &[SENT, PATIENT, GATES, TWO_TIMESTAMPS, TWO_OPEN],
        states: 37_788,
        ..HIGHER
    },
    World {
        name: "3x1-patient",
        commit: Commit::Patient,
        absent: &[SENT, EAGER, GATES, TWO_TIMESTAMPS, TWO_OPEN],
        states: 26_508,
        ..HIGHER
    },
    World {
        name: "3x1-progressive",
        commit: Commit::Progressive,
        absent: &[HELD, GATES, TWO_TIMESTAMPS, TWO_OPEN],
        states: 29_370,
        ..HIGHER
    },
    World {
        name: "2x3w2-progressive",
        commit: Commit::Progressive,
        absent: &[HELD, GATES, THREE_CLOUDS],
        size: Size::Large,
        states: 356_972,
        ..WIDE
    },
    World {
        name: "2x3w2-long-eager",
        absent: &[SENT, PATIENT, GATES, THREE_CLOUDS],
        states: 1_122_341,
        ..LONG
    },
    World {
        name: "2x3w2-long-patient",
        commit: Commit::Patient,
        absent: &[SENT, EAGER, GATES, THREE_CLOUDS],
        states: 941_324,
        ..LONG
    },
    World {
        name: "3x2w2-eager",
        absent: &[SENT, PATIENT, GATES, LIMITS, LEAPS, TWO_TIMESTAMPS],
        states: 429_065,
        ..BROAD
    },
    World {
        name: "3x2w2-patient",
        commit: Commit::Patient,
        absent: &[SENT, EAGER, GATES, LIMITS, LEAPS, TWO_TIMESTAMPS],
        states: 303_725,
        ..BROAD
    },
];
