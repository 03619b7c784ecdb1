#![doc = include_str!("../README.md")]

mod columns;
mod deadlines;
mod judging;
mod notes;
mod page;
mod part;
pub mod policies;
mod quantile;
mod reasons;
mod statistics;
mod timestamp_map;
mod trace_page;

pub use judging::{JudgeMode, TraceJudge};
pub use notes::{PolicyScores, RunNotes};
pub use part::{PartFilter, TraceRange};
pub use quantile::{ArrivalTime, NEVER, PERCENT, Quantile, Response, quantiles, quantiles_among};
pub use statistics::{
    COLUMNS, ForwardedOutput, MessageRecord, RequestRow, TimestampOutcome, Totals, TraceStatistics,
};
pub use trace_page::{MOST_EVENTS, PageWriter, TracePage};
