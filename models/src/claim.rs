//! The claims about the machine: it follows the rules and keeps the promises.

use fuseline_testkit::Promise;
use fuseline_traces::Rule;

use crate::property::properties;

properties! {
    /// A rule or promise that a step can break. Each is an `always` property: no reachable state
    /// breaks it.
    Claim,
    /// A set of claims.
    Claims,
    always;
    F0 = "F0 decides as the reference machine",
    F1 = "F1 decides as the reference machine",
    F2 = "F2 decides as the reference machine",
    F2g = "F2g decides as the reference machine",
    F3 = "F3 decides as the reference machine",
    F4 = "F4 decides as the reference machine",
    F5 = "F5 decides as the reference machine",
    F6 = "F6 decides as the reference machine",
    F7 = "F7 decides as the reference machine",
    F9 = "F9 decides as the reference machine",
    F8 = "F8 every input has an outcome",
    P1 = "P1 once",
    P2 = "P2 never late",
    P3 = "P3 best available",
    P4 = "P4 prompt",
    P5 = "P5 local floor",
    P6 = "P6 free without cloud",
    P7 = "P7 no stall",
    P8 = "P8 timers",
    P9 = "P9 bounded",
    P10 = "P10 deterministic",
    P11 = "P11 accounted",
    P12 = "P12 bounded wait",
    P13 = "P13 as patient",
}

impl Claim {
    /// Returns `true` if the claim is about agreement with the reference machine.
    #[must_use]
    pub const fn is_of_reference(self) -> bool {
        (self as u8) < (Self::F8 as u8)
    }
}

impl From<Rule> for Claim {
    fn from(rule: Rule) -> Self {
        match rule {
            Rule::F0 => Self::F0,
            Rule::F1 => Self::F1,
            Rule::F2 => Self::F2,
            Rule::F2g => Self::F2g,
            Rule::F3 => Self::F3,
            Rule::F4 => Self::F4,
            Rule::F5 => Self::F5,
            Rule::F6 => Self::F6,
            // No input of a model has a value key, so no step breaks D2 or D18, and no model has a
            // period. These rules concern what is sent (F7).
            Rule::F7 | Rule::D2 | Rule::D18 | Rule::J1 | Rule::J2 => Self::F7,
            Rule::F9 => Self::F9,
            Rule::P1 => Self::P1,
            Rule::P2 => Self::P2,
            Rule::P3 => Self::P3,
            Rule::P4 => Self::P4,
            Rule::P5 => Self::P5,
            Rule::P6 => Self::P6,
            Rule::P7 => Self::P7,
            Rule::P9 => Self::P9,
        }
    }
}

impl From<Promise> for Claim {
    fn from(promise: Promise) -> Self {
        match promise {
            Promise::P1 => Self::P1,
            Promise::P2 => Self::P2,
            Promise::P3 => Self::P3,
            Promise::P4 => Self::P4,
            Promise::P5 => Self::P5,
            Promise::P6 => Self::P6,
            Promise::P7 => Self::P7,
            Promise::P8 => Self::P8,
            Promise::P9 => Self::P9,
            Promise::P11 => Self::P11,
            Promise::P12 => Self::P12,
        }
    }
}
