//! Collects the tests that need no process of their own into one program. The package `tests`
//! builds it, unoptimized.

mod annotations;
mod corpus;
mod judge;
mod observed;
mod packings;
mod parse;
mod read;
mod reasons;
mod record;
mod reference;
