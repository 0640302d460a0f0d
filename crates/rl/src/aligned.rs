//! Arrays that begin at a cache line.

use std::ops::{Deref, DerefMut};

use faer::Col;

/// Values of which a vector register's worth lies in one cache line; used as a slice.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Aligned(Col<f32>);

impl Aligned {
    pub fn zeros(len: usize) -> Self {
        Self(Col::zeros(len))
    }
}

impl Deref for Aligned {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        let Some(column) = self.0.try_as_col_major() else { unreachable!("the values of a `Col` follow one another") };
        column.as_slice()
    }
}

impl DerefMut for Aligned {
    fn deref_mut(&mut self) -> &mut [f32] {
        let Some(column) = self.0.try_as_col_major_mut() else {
            unreachable!("the values of a `Col` follow one another")
        };
        column.as_slice_mut()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_and_their_copies_begin_at_a_cache_line() {
        for len in [1, 15, 16, 1000, 100_000] {
            let first = Aligned::zeros(len);
            for array in [first.clone(), first] {
                assert_eq!((array.len(), array.as_ptr().addr() % 64), (len, 0));
            }
        }
    }
}
