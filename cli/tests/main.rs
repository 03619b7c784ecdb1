//! One program of the tests: it is built once, and what waits overlaps. Each runs the command in
//! processes of its own.

mod common;

mod annotations;
mod arrows;
mod ci;
mod cli_conventions;
mod convert;
mod deadline;
mod dirty;
mod doubts;
mod drive;
mod ended;
mod exits;
mod export;
mod exported;
mod judging_notes;
mod logs;
mod opentelemetry;
mod others;
mod otlp;
mod outputs;
mod overwrite;
mod parts;
mod probe;
mod recordings;
mod replay;
mod report;
mod rows;
mod run;
mod scenario;
mod serve;
mod spans;
mod traces;
