//! Exceptions of Python's algorithms, which are called where nothing can be raised.

use pyo3::PyErr;
use pyo3::PyResult;
use std::sync::{Arc, Mutex, PoisonError};

/// The first exception of an algorithm, until it is raised.
#[derive(Clone, Debug, Default)]
pub struct Trouble(Arc<Mutex<Option<PyErr>>>);

impl Trouble {
    /// Keeps an exception, unless there is one.
    pub fn keep(&self, error: PyErr) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }

    /// # Errors
    /// The exception that was kept since the last call.
    pub fn raise(&self) -> PyResult<()> {
        let trouble = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        trouble.map_or(Ok(()), Err)
    }
}
