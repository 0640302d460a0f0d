//! What follows a matrix product, value by value: done to each part of it while the part is in registers.

use pulp::{Arch, Simd, WithSimd};

/// Something done to a product as soon as its values are there.
pub(crate) trait Epilogue: Copy + Send + Sync {
    /// Whether it changes values.
    const CHANGES: bool = true;

    /// Takes the `values` that begin at `column` of `row`, and returns what to keep. Behind the last column there may be
    /// values that nothing is kept of.
    fn apply<S: Simd>(self, simd: S, row: usize, column: usize, values: S::f32s) -> S::f32s;
}

/// Keeps the product as it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Keep;

impl Epilogue for Keep {
    const CHANGES: bool = false;

    #[inline(always)]
    fn apply<S: Simd>(self, _: S, _: usize, _: usize, values: S::f32s) -> S::f32s {
        values
    }
}

/// Adds a bias to each column and rectifies. A value that is not a number stays one, so that divergence shows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BiasRelu<'a> {
    /// As long as a row.
    pub bias: &'a [f32],
}

impl Epilogue for BiasRelu<'_> {
    #[inline(always)]
    fn apply<S: Simd>(self, simd: S, _: usize, column: usize, values: S::f32s) -> S::f32s {
        let zero = simd.splat_f32s(0.0);
        let values = simd.add_f32s(values, load(simd, &self.bias[column..]));
        simd.select_f32s(simd.less_than_f32s(values, zero), zero, values)
    }
}

/// Clears the gradient where the rectified activation is zero.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReluMask<'a> {
    /// Rows of the gradient's width.
    pub activation: &'a [f32],
    /// The width.
    pub width: usize,
}

impl Epilogue for ReluMask<'_> {
    #[inline(always)]
    fn apply<S: Simd>(self, simd: S, row: usize, column: usize, values: S::f32s) -> S::f32s {
        let activation = load(simd, &self.activation[row * self.width..][column..self.width]);
        let zero = simd.splat_f32s(0.0);
        simd.select_f32s(simd.equal_f32s(activation, zero), zero, values)
    }
}

/// Does to rows what an epilogue would have done to the part of a product that they are, which begins at row `first`.
///
/// # Panics
/// When `width` is 0.
pub(crate) fn each_row(values: &mut [f32], width: usize, first: usize, epilogue: impl Epilogue) {
    Arch::new().dispatch(EachRow { values, width, first, epilogue });
}

struct EachRow<'a, E> {
    values: &'a mut [f32],
    width: usize,
    first: usize,
    epilogue: E,
}

impl<E: Epilogue> WithSimd for EachRow<'_, E> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (i, row) in self.values.chunks_exact_mut(self.width).enumerate() {
            for (j, part) in row.chunks_mut(S::F32_LANES).enumerate() {
                let values = self.epilogue.apply(simd, self.first + i, j * S::F32_LANES, load(simd, part));
                store(simd, part, values);
            }
        }
    }
}

/// Reads a register full of values; zeros follow the last.
#[inline(always)]
pub(crate) fn load<S: Simd>(simd: S, values: &[f32]) -> S::f32s {
    match S::as_simd_f32s(values).0.first() {
        Some(whole) => *whole,
        None => simd.partial_load_f32s(values),
    }
}

/// Writes a register, or as much of it as there is room for.
#[inline(always)]
pub(crate) fn store<S: Simd>(simd: S, to: &mut [f32], values: S::f32s) {
    match S::as_mut_simd_f32s(to).0.first_mut() {
        Some(whole) => *whole = values,
        None => simd.partial_store_f32s(to, values),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectification_keeps_what_is_not_a_number() {
        let mut row = [f32::NAN, -2.0, 3.0];
        each_row(&mut row, 3, 0, BiasRelu { bias: &[0.0, 1.0, 1.0] });
        assert!(row[0].is_nan());
        assert_eq!(row[1..], [0.0, 4.0]);
    }
}
