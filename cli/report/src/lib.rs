#![doc = include_str!("../README.md")]

mod columns;
mod judging;
mod page;
mod quantile;
mod reasons;
mod statistics;
mod trace_page;

pub use judging::{AnyViolation, Findings, JudgeMode, Summary, TraceJudge};
pub use quantile::{Arrival, NEVER, PERCENT, Quantile, Response, quantiles, quantiles_among};
pub use statistics::{COLUMNS, Ending, Forwarded, Message, Row, Totals, TraceStatistics};
pub use trace_page::{MOST_EVENTS, Page, PageError, TracePage};
