//! Prints on standard error, and names the options to change.

use std::fmt;
use std::io::{self, Write};

use fuseline_deadline::{Figure, Invalid};

/// Prints a line on standard error. If it is closed, the command goes on.
pub(crate) fn print_line(line: impl fmt::Display) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}

/// Returns the options that could be at fault, which have the same names in `fuseline deadline` and
/// the scenarios.
pub(crate) const fn options_at_fault(invalid: Invalid) -> &'static str {
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
