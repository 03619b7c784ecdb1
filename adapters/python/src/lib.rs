//! The extension module `fuseline._fuseline`. Users see the package around it, in
//! `python/fuseline`.

mod answer_classes;
mod calls;
mod engine;
mod fleet;
mod fusion;
mod judging;
mod logging;
mod networks;
mod pipeline;
mod policy;
mod raised;
mod reading;
mod tally;
mod time;

use pyo3::prelude::*;

/// The machine, the judges and the policies of deadlines, which the package `fuseline` exports.
#[pymodule]
mod _fuseline {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::calls::PyCalls;
    #[pymodule_export]
    use crate::engine::{PyCounting, PyEngine, check_linger};
    #[pymodule_export]
    use crate::fleet::survey;
    #[pymodule_export]
    use crate::fusion::PyFusion;
    #[pymodule_export]
    use crate::judging::{check, read, replay, report};
    #[pymodule_export]
    use crate::networks::{PyDrive, compare_responses, compare_trace, drives};
    #[pymodule_export]
    use crate::pipeline::{PyAligner, PyGate, PyLatency, PyReorderer};
    #[pymodule_export]
    use crate::policy::{PyExpected, PyGuard, PyObservations, loss};
    #[pymodule_export]
    use crate::time::nanoseconds;

    #[pymodule_init]
    #[expect(clippy::unnecessary_wraps, reason = "the macro asks for it")]
    fn init(_module: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::logging::install();
        Ok(())
    }
}
