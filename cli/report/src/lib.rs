#![doc = include_str!("../README.md")]

mod columns;
mod judging;
mod page;
mod quantile;
mod reasons;
mod reckoning;
mod sheet;

pub use judging::{AnyViolation, Found, Judging, Manner, Summary};
pub use quantile::{Arrival, NEVER, PERCENT, Quantile, Response, quantiles, quantiles_among};
pub use reckoning::{COLUMNS, Ending, Forwarded, Message, Reckoning, Row, Totals};
pub use sheet::{MOST_EVENTS, Page, PageError, Sheet};
