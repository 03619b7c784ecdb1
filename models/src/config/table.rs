//! The table.

use fuseline_traces::{Cloud, Commit};

use super::{Config, Reach, Size};
use crate::mark::Mark;

/// What the patient rule has not.
const EAGER: &[Mark] =
    &[Mark::EagerOverPending, Mark::EagerOwn, Mark::LimitHolds, Mark::StaysArmed];
/// What the eager rule has not.
const PATIENT: &[Mark] = &[Mark::PatientWaits, Mark::Disarmed];
/// What needs backlogs about the limit of a gate.
const GATES: &[Mark] = &[Mark::GateShuts, Mark::GateStays, Mark::GateOpens];
/// What needs two clouds: one held, one to outrank it.
const TWO_CLOUDS: &[Mark] = &[
    Mark::OfferJoins,
    Mark::EagerOverPending,
    Mark::EagerOwn,
    Mark::LimitHolds,
    Mark::PatientWaits,
    Mark::StaysArmed,
    Mark::Disarmed,
    Mark::BestOfTwo,
    Mark::Cancelled,
];
/// What needs three clouds: one offered, one held, one to outrank it.
const THREE_CLOUDS: &[Mark] = &[Mark::OfferOutranked];
/// What needs a second timestamp.
const TWO_TIMESTAMPS: &[Mark] = &[Mark::OpenFull, Mark::OpenRoom];
/// What needs two timestamps open at once.
const TWO_OPEN: &[Mark] = &[Mark::TimestampsTogether];
/// What needs a deadline of local.
const LIMITS: &[Mark] = &[
    Mark::OpenLimited,
    Mark::LimitAlone,
    Mark::LimitWithCloud,
    Mark::LimitHolds,
    Mark::LimitRetires,
];
/// What needs results that come after the instant of the state.
const LEAPS: &[Mark] = &[Mark::TimerFirst, Mark::Once, Mark::DueInstant, Mark::OpenRoom];
/// What needs three readings of the clock.
const THREE_INSTANTS: &[Mark] = &[Mark::DuesPassed, Mark::EagerOverPending];

/// A cloud whose gate shuts with one message in its queue.
const fn cloud(p: u16) -> Cloud {
    Cloud { p, name: None, limit: 1, resume: 0 }
}

const ONE: &[Cloud] = &[cloud(5)];
const TWO: &[Cloud] = &[cloud(5), cloud(2)];
const THREE: &[Cloud] = &[cloud(5), cloud(2), cloud(7)];

const MAX: u64 = u64::MAX;

/// What most rows share.
const BASE: Config = Config {
    name: "",
    size: Size::Quick,
    commit: Commit::Eager,
    window: 1,
    clouds: ONE,
    timestamps: &[0],
    clock: &[0, 1, 2, 3],
    reach: Reach::Now,
    limits: &[None, Some(2)],
    deadlines: &[1, 2],
    backlogs: &[0],
    absent: &[],
    states: 0,
};

const NARROW: Config =
    Config { timestamps: &[0, 1], clock: &[0, 1, 2, 3, 4], reach: Reach::Any, ..BASE };

const TALL: Config = Config {
    clouds: TWO,
    clock: &[0, 1, 2, 3, 4],
    reach: Reach::Any,
    deadlines: &[1, 2, 3],
    ..BASE
};

const EDGES: Config = Config {
    window: 2,
    timestamps: &[0, MAX - 1, MAX],
    clock: &[0, MAX - 2, MAX - 1, MAX],
    reach: Reach::Any,
    limits: &[None, Some(1), Some(MAX)],
    deadlines: &[1, MAX],
    ..BASE
};

const WIDE: Config = Config {
    size: Size::Standard,
    window: 2,
    clouds: TWO,
    timestamps: &[0, 1, 2],
    clock: &[0, 1, 2, 3, 4],
    reach: Reach::Next,
    ..BASE
};

const HIGH: Config =
    Config { clouds: THREE, clock: &[0, 1, 2, 3], reach: Reach::Any, deadlines: &[1, 2], ..BASE };

const HIGHER: Config = Config {
    size: Size::Standard,
    clock: &[0, 1, 2, 3, 4, 5, 6],
    limits: &[None, Some(1), Some(3)],
    deadlines: &[1, 2, 3, 4],
    ..HIGH
};

const LONG: Config = Config { size: Size::Large, deadlines: &[1, 2, 3], ..WIDE };

const BROAD: Config = Config {
    size: Size::Large,
    window: 2,
    clouds: THREE,
    timestamps: &[0, 1],
    clock: &[0, 1, 2],
    limits: &[None],
    ..BASE
};

/// All configurations: quick ones first, large ones last.
pub const CONFIGS: &[Config] = &[
    Config {
        name: "1x2w1-eager",
        absent: &[GATES, TWO_CLOUDS, THREE_CLOUDS, TWO_OPEN],
        states: 249,
        ..NARROW
    },
    Config {
        name: "1x2w1-patient",
        commit: Commit::Patient,
        absent: &[GATES, TWO_CLOUDS, THREE_CLOUDS, TWO_OPEN],
        states: 249,
        ..NARROW
    },
    Config {
        name: "gate",
        window: 2,
        clouds: &[
            Cloud { p: 5, name: None, limit: 2, resume: 1 },
            Cloud { p: 2, name: None, limit: 3, resume: 1 },
        ],
        timestamps: &[0, 1],
        clock: &[0, 1],
        limits: &[None],
        deadlines: &[1],
        backlogs: &[0, 1, 2, 3],
        absent: &[PATIENT, THREE_CLOUDS, LIMITS, LEAPS, THREE_INSTANTS, TWO_TIMESTAMPS],
        states: 2666,
        ..BASE
    },
    Config {
        name: "2x1-eager",
        absent: &[PATIENT, GATES, THREE_CLOUDS, TWO_TIMESTAMPS, TWO_OPEN],
        states: 1389,
        ..TALL
    },
    Config {
        name: "2x1-patient",
        commit: Commit::Patient,
        absent: &[EAGER, GATES, THREE_CLOUDS, TWO_TIMESTAMPS, TWO_OPEN],
        states: 1272,
        ..TALL
    },
    Config {
        name: "3x1-short-eager",
        absent: &[PATIENT, GATES, TWO_TIMESTAMPS, TWO_OPEN],
        states: 3367,
        ..HIGH
    },
    Config {
        name: "3x1-short-patient",
        commit: Commit::Patient,
        absent: &[EAGER, GATES, TWO_TIMESTAMPS, TWO_OPEN],
        states: 2755,
        ..HIGH
    },
    Config {
        name: "edges-eager",
        absent: &[GATES, TWO_CLOUDS, THREE_CLOUDS],
        states: 4345,
        ..EDGES
    },
    Config {
        name: "edges-patient",
        commit: Commit::Patient,
        absent: &[GATES, TWO_CLOUDS, THREE_CLOUDS],
        states: 4345,
        ..EDGES
    },
    Config {
        name: "1x4w3",
        size: Size::Standard,
        window: 3,
        timestamps: &[0, 1, 2, 3],
        limits: &[None],
        absent: &[GATES, TWO_CLOUDS, THREE_CLOUDS, LIMITS, LEAPS, &[Mark::TimersTogether]],
        states: 19_136,
        ..BASE
    },
    Config {
        name: "2x3w2-eager",
        absent: &[PATIENT, GATES, THREE_CLOUDS],
        states: 310_145,
        ..WIDE
    },
    Config {
        name: "2x3w2-patient",
        commit: Commit::Patient,
        absent: &[EAGER, GATES, THREE_CLOUDS],
        states: 270_680,
        ..WIDE
    },
    Config {
        name: "3x1-eager",
        absent: &[PATIENT, GATES, TWO_TIMESTAMPS, TWO_OPEN],
        states: 36_104,
        ..HIGHER
    },
    Config {
        name: "3x1-patient",
        commit: Commit::Patient,
        absent: &[EAGER, GATES, TWO_TIMESTAMPS, TWO_OPEN],
        states: 24_380,
        ..HIGHER
    },
    Config {
        name: "2x3w2-long-eager",
        absent: &[PATIENT, GATES, THREE_CLOUDS],
        states: 1_122_341,
        ..LONG
    },
    Config {
        name: "2x3w2-long-patient",
        commit: Commit::Patient,
        absent: &[EAGER, GATES, THREE_CLOUDS],
        states: 941_324,
        ..LONG
    },
    Config {
        name: "3x2w2-eager",
        absent: &[PATIENT, GATES, LIMITS, LEAPS, TWO_TIMESTAMPS],
        states: 429_065,
        ..BROAD
    },
    Config {
        name: "3x2w2-patient",
        commit: Commit::Patient,
        absent: &[EAGER, GATES, LIMITS, LEAPS, TWO_TIMESTAMPS],
        states: 303_725,
        ..BROAD
    },
];
