//! All tests are in one program, so that it is built only once.

mod paper_vehicle;
mod scenario;
