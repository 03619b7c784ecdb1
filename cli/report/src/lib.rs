#![doc = include_str!("../README.md")]

mod columns;
mod judging;
mod page;
mod quantile;
mod reasons;
mod statistics;
mod trace_page;

pub use judging::{AnyViolation, Findings, TraceJudge, JudgeMode, Summary};
pub use quantile::{Arrival, PERCENT, Quantile, quantiles};
pub use statistics::{COLUMNS, Ending, Forwarded, Message, TraceStatistics, Row, Totals};
pub use trace_page::{MOST_EVENTS, Page, PageError, TracePage};
