//! The one matrix product of this crate, so that it can be swapped in one place.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

/// A read-only matrix over a slice: `rows x cols`, row-major with a row stride, optionally seen transposed.
#[derive(Clone, Copy, Debug)]
pub struct Matrix<'a> {
    view: MatRef<'a, f32>,
}

impl<'a> Matrix<'a> {
    /// Views a slice whose rows follow one another.
    ///
    /// # Panics
    /// When `data.len() != rows * cols`.
    pub fn new(data: &'a [f32], rows: usize, cols: usize) -> Self {
        Self { view: MatRef::from_row_major_slice(data, rows, cols) }
    }

    /// Views a slice in which a row begins every `stride` values; `cols <= stride`.
    ///
    /// # Panics
    /// When the last row ends beyond the slice, or `stride < cols`.
    pub fn strided(data: &'a [f32], rows: usize, cols: usize, stride: usize) -> Self {
        Self { view: MatRef::from_row_major_slice_with_stride(data, rows, cols, stride) }
    }

    /// Swaps rows and columns without moving data.
    pub fn t(self) -> Self {
        Self { view: self.view.transpose() }
    }
}

/// A writable row-major matrix over a slice.
#[derive(Debug)]
pub struct MatrixMut<'a> {
    view: MatMut<'a, f32>,
}

impl<'a> MatrixMut<'a> {
    /// Views a slice whose rows follow one another.
    ///
    /// # Panics
    /// When `data.len() != rows * cols`.
    pub fn new(data: &'a mut [f32], rows: usize, cols: usize) -> Self {
        Self { view: MatMut::from_row_major_slice_mut(data, rows, cols) }
    }
}

/// `(a: m x k, b: k x n) => out: m x n`, which is overwritten; on the calling thread.
///
/// # Panics
/// When the shapes do not fit one another.
pub fn gemm(out: MatrixMut<'_>, a: Matrix<'_>, b: Matrix<'_>) {
    matmul(out.view, Accum::Replace, a.view, b.view, 1.0, Par::Seq);
}
