//! One program of the tests that need no process of their own. The package of `tests` builds it: it is not optimized.

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
