//! Reads and writes arrays as NPY files.

use std::io;

use npyz::{NpyFile, Order, WriterBuilder};

/// (shape, values in C order) => the bytes of the file
pub(crate) fn to_bytes(shape: &[usize], values: impl IntoIterator<Item = f64>) -> io::Result<Vec<u8>> {
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    let mut bytes = Vec::new();
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(&mut bytes).begin_nd()?;
    writer.extend(values)?;
    writer.finish()?;
    Ok(bytes)
}

/// (the bytes of a file) => (shape, values in C order)
pub(crate) fn from_bytes(bytes: &[u8]) -> io::Result<(Vec<usize>, Vec<f64>)> {
    let invalid = |message: String| io::Error::new(io::ErrorKind::InvalidData, message);
    let file = NpyFile::new(bytes)?;
    let shape: Vec<usize> = file.shape().iter().map(|&n| n as usize).collect();
    // A header can claim any size; no memory is reserved for more numbers than the file can hold.
    let needed = shape.iter().try_fold(size_of::<f64>(), |product, &n| product.checked_mul(n));
    if needed.is_none_or(|needed| needed > bytes.len()) {
        return Err(invalid(format!("the shape {shape:?} needs more data than the {} bytes of the file", bytes.len())));
    }
    if shape.len() > 1 && file.order() != Order::C {
        return Err(invalid("the array is in Fortran order; expected C order".to_owned()));
    }
    Ok((shape, file.into_vec()?))
}
