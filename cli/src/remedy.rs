//! Which options to change where a vehicle's figures make no sense.

use fuseline_deadline::{Figure, Invalid};

/// The options that could be at fault, named alike by `fuseline deadline` and the scenarios.
pub(crate) const fn options(invalid: Invalid) -> &'static str {
    match invalid {
        Invalid::Order(figure) | Invalid::Implausible { figure, .. } => match figure {
            Figure::Deceleration => "--deceleration",
            Figure::BrakeDelay => "--brake-delay",
            Figure::PeriodLocal | Figure::PeriodCloud => "--rate",
            Figure::LocalResponse => "--local-response",
            Figure::RangeLocal => "--range-local",
            Figure::RangeCloud => "--range-cloud",
            Figure::Weight => "--class",
            Figure::Speed => "--speed",
            Figure::Reveal => "--reveal",
            Figure::Lateness
            | Figure::Margin
            | Figure::AccuracyLocal
            | Figure::AccuracyCloud
            | Figure::Price
            | Figure::Overlap => "the options",
        },
        Invalid::CloudSeesLess => "--range-local or --range-cloud",
        Invalid::Classes(_) => "--class",
        Invalid::NoFrames => "--frames",
        Invalid::Probes { .. } => "the options",
    }
}
