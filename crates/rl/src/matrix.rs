//! Matrices over slices, the arguments of the products, and the arrays in which their values are stored.

use std::ops::Range;

use aligned_vec::{AVec, ConstAlign, avec};
use faer::MatRef;

/// Bytes of a cache line, and the most of a vector register.
const ALIGNMENT: usize = 64;

/// An array that begins at a cache line, so that no vector register is read from two.
pub(crate) type Aligned = AVec<f32, ConstAlign<ALIGNMENT>>;

/// Returns an array of zeros.
pub(crate) fn zeros(len: usize) -> Aligned {
    avec![[ALIGNMENT]| 0.0; len]
}

/// A read-only matrix over a slice: `rows x cols`, row-major with a row stride, optionally seen transposed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Matrix<'a> {
    pub data: &'a [f32],
    pub rows: usize,
    pub cols: usize,
    pub row_stride: usize,
    pub col_stride: usize,
}

impl<'a> Matrix<'a> {
    /// Views a slice that stores the rows one after another.
    ///
    /// # Panics
    /// If `data.len() != rows * cols`.
    pub fn new(data: &'a [f32], rows: usize, cols: usize) -> Self {
        assert_eq!(data.len(), rows * cols, "not {rows} x {cols} values");
        Self { data, rows, cols, row_stride: cols, col_stride: 1 }
    }

    /// Views a slice in which a row begins every `stride` values, `stride >= cols`.
    ///
    /// # Panics
    /// If the last row ends beyond the slice, or `stride < cols`.
    pub fn strided(data: &'a [f32], rows: usize, cols: usize, stride: usize) -> Self {
        assert!(cols <= stride, "rows of {cols} every {stride} values");
        assert!(rows == 0 || (rows - 1) * stride + cols <= data.len(), "the last row ends beyond the slice");
        Self { data, rows, cols, row_stride: stride, col_stride: 1 }
    }

    /// Swaps rows and columns without moving data.
    pub fn t(self) -> Self {
        let Self { data, rows, cols, row_stride, col_stride } = self;
        Self { data, rows: cols, cols: rows, row_stride: col_stride, col_stride: row_stride }
    }

    /// Returns the part with these rows and columns.
    ///
    /// # Panics
    /// If a row or column is outside the matrix.
    pub fn part(self, rows: Range<usize>, cols: Range<usize>) -> Self {
        assert!(rows.end <= self.rows && cols.end <= self.cols, "the part is not inside the matrix");
        let data = &self.data[rows.start * self.row_stride + cols.start * self.col_stride..];
        Self { data, rows: rows.len(), cols: cols.len(), ..self }
    }

    /// Returns the matrix or its transpose, whichever stores the values of a row one after another.
    pub fn by_rows(self) -> Self {
        if self.col_stride == 1 { self } else { self.t() }
    }

    /// Returns a row of a matrix that stores the values of a row one after another.
    ///
    /// # Panics
    /// If the matrix stores them otherwise, or has no such row.
    pub fn row(self, row: usize) -> &'a [f32] {
        assert_eq!(self.col_stride, 1, "the values of a row are not stored one after another");
        &self.data[row * self.row_stride..][..self.cols]
    }

    /// Returns the matrix as faer's type.
    pub fn view(self) -> MatRef<'a, f32> {
        if self.col_stride == 1 {
            MatRef::from_row_major_slice_with_stride(self.data, self.rows, self.cols, self.row_stride)
        } else {
            MatRef::from_column_major_slice_with_stride(self.data, self.rows, self.cols, self.col_stride)
        }
    }
}

/// A writable row-major matrix over a slice.
#[derive(Debug)]
pub(crate) struct MatrixMut<'a> {
    pub data: &'a mut [f32],
    pub rows: usize,
    pub cols: usize,
}

impl<'a> MatrixMut<'a> {
    /// Views a slice that stores the rows one after another.
    ///
    /// # Panics
    /// If `data.len() != rows * cols`.
    pub fn new(data: &'a mut [f32], rows: usize, cols: usize) -> Self {
        assert_eq!(data.len(), rows * cols, "not {rows} x {cols} values");
        Self { data, rows, cols }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_and_their_copies_begin_at_a_cache_line() {
        for len in [1, 15, 16, 1000, 100_000] {
            let first = zeros(len);
            for array in [first.clone(), first] {
                assert_eq!((array.len(), array.as_ptr().addr() % ALIGNMENT), (len, 0));
            }
        }
    }
}
