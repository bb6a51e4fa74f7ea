//! Tables of Arrow, which other packages take over without a copy.

use arrow_array::cast::AsArray;
use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::types::{Float64Type, UInt32Type};
use arrow_array::{Array, RecordBatch, RecordBatchIterator};
use arrow_schema::ffi::FFI_ArrowSchema;
use arrow_schema::{ArrowError, DataType};
use numpy::PyArray1;
use pyo3::exceptions::{PyKeyError, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyList};

/// Columns of equal length. `pyarrow.table(table)`, `polars.DataFrame(table)` and `pandas.DataFrame.from_arrow(table)` take it by
/// the PyCapsule interface of Arrow, without a copy; `table["speed_mps"]` is a column as an array of numpy.
#[pyclass(module = "city3d", frozen)]
#[derive(Debug)]
pub struct Table {
    batch: RecordBatch,
}

impl Table {
    pub fn new(batch: RecordBatch) -> Self {
        Self { batch }
    }

    /// Its rows as a stream of Arrow, in a capsule.
    pub fn stream<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        let rows = RecordBatchIterator::new([Ok(self.batch.clone())], self.batch.schema());
        PyCapsule::new_with_value(py, FFI_ArrowArrayStream::new(Box::new(rows)), c"arrow_array_stream")
    }
}

/// An error of Arrow.
pub fn failed(error: ArrowError) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}

#[pymethods]
impl Table {
    /// Names of the columns.
    #[getter]
    fn column_names(&self) -> Vec<String> {
        self.batch.schema().fields().iter().map(|field| field.name().clone()).collect()
    }

    /// Number of rows.
    #[getter]
    fn num_rows(&self) -> usize {
        self.batch.num_rows()
    }

    fn __len__(&self) -> usize {
        self.batch.num_rows()
    }

    /// A column: an array of numbers, NaN where there is none, or a list of texts.
    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let Some(column) = self.batch.column_by_name(name) else {
            let names = self.column_names().join(", ");
            return Err(PyKeyError::new_err(format!("no column {name:?}: there are {names}")));
        };
        match column.data_type() {
            DataType::Float64 => {
                let numbers = column.as_primitive::<Float64Type>();
                let all = numbers.iter().map(|number| number.unwrap_or(f64::NAN));
                Ok(PyArray1::from_iter(py, all).into_any())
            }
            DataType::UInt32 => {
                Ok(PyArray1::from_slice(py, column.as_primitive::<UInt32Type>().values()).into_any())
            }
            _ => {
                let words = column.as_any_dictionary();
                let (keys, names) = (words.normalized_keys(), words.values().as_string::<i32>());
                let texts = keys
                    .iter()
                    .enumerate()
                    .map(|(row, key)| (!words.is_null(row)).then(|| names.value(*key)));
                Ok(PyList::new(py, texts.collect::<Vec<_>>())?.into_any())
            }
        }
    }

    /// The rows as a stream of Arrow. They come in the types of the columns, whatever is asked for.
    #[pyo3(signature = (requested_schema = None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema;
        self.stream(py)
    }

    /// Names and types of the columns, as Arrow has them.
    fn __arrow_c_schema__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        let schema = FFI_ArrowSchema::try_from(self.batch.schema().as_ref()).map_err(failed)?;
        PyCapsule::new_with_value(py, schema, c"arrow_schema")
    }

    fn __repr__(&self) -> String {
        format!("<city3d.Table of {} rows: {}>", self.batch.num_rows(), self.column_names().join(", "))
    }
}
