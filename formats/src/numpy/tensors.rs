//! Tensors of a recording's windows as one `.npy` array.

use super::write::growing_header;
use crate::Error;
use crate::output::Output;
use lobula_core::Shape;
use lobula_core::representation::Dtype;
use std::path::Path;

/// Writes tensors of one shape, one after the other, as an array N x C x H x W, in constant memory. The file has its
/// name once it is finished.
///
/// ```no_run
/// use lobula_core::{Shape, representation::Dtype};
/// let shape = Shape { channels: 1, height: 2, width: 2 };
/// let mut tensors = lobula_formats::TensorWriter::create("counts.npy".as_ref(), false, shape, Dtype::U8)?;
/// tensors.push(&[0, 1, 2, 3])?;
/// assert_eq!(tensors.finish()?, 1);
/// # Ok::<(), lobula_formats::Error>(())
/// ```
#[derive(Debug)]
pub struct TensorWriter {
    output: Output,
    shape: Shape,
    dtype: Dtype,
    tensors: u64,
}

impl TensorWriter {
    /// Starts a file.
    ///
    /// # Errors
    /// Where it is there already and is not to be replaced, or cannot be made.
    pub fn create(path: &Path, overwrite: bool, shape: Shape, dtype: Dtype) -> Result<Self, Error> {
        let output = Output::create(path, overwrite)?;
        let mut writer = Self { output, shape, dtype, tensors: 0 };
        writer.output.write(&writer.header())?;
        Ok(writer)
    }

    /// Adds one: its elements, row-major, little-endian.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn push(&mut self, tensor: &[u8]) -> Result<(), Error> {
        self.tensors += 1;
        self.output.write(tensor)
    }

    /// Gives the file its name; tells how many tensors it has.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn finish(mut self) -> Result<u64, Error> {
        self.output.write_at(0, &self.header())?;
        self.output.finish()?;
        Ok(self.tensors)
    }

    fn header(&self) -> Vec<u8> {
        let Shape { channels, height, width } = self.shape;
        let descr = match self.dtype {
            Dtype::U8 => "'|u1'",
            Dtype::U16 => "'<u2'",
            Dtype::F16 => "'<f2'",
            Dtype::F32 => "'<f4'",
        };
        growing_header(descr, self.tensors, &format!(" {channels}, {height}, {width}"), "")
    }
}
